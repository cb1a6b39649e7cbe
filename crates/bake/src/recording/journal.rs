//! Journal of a running bake, from which the bake can continue after its process has ended for any
//! reason.
//!
//! The first line names the format. Records follow, each with kind, length, content and checksum.
//! The first one is the [`Header`]. Then come a frame for the initial state and one for each step,
//! with checkpoints among them.
//!
//! Records are only appended. An interrupted bake leaves whole records and at most one torn record,
//! which its checksum reveals. A reader sees every whole record, even while more are being written.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::borrow::Cow;
use std::fs::{File, TryLockError};
use std::io::{self, BufReader, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::joints::{JointFrame, JointLayout, JointRecording};
use super::{Named, Recording, Velocities};
use crate::any_world::PairImpulses;
use drystone::geometry::pose_numbers;
use drystone::{Measure, StepReport, StepSettings};
use drystone_scene::{self as scene, Scene, sync_directory};

/// First line of a journal.
const MAGIC: &[u8] = b"drystone journal 1\n";

/// Largest record that is read. \[byte\]
const MAX_RECORD: u64 = 1 << 36;

/// Identity of a bake. Two bakes with the same header have the same frames, as far as both have
/// them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of Drystone.
    pub version: String,
    /// XXH3 (64 bits) of the scene as JSON without its number of steps and settings, in
    /// hexadecimal.
    pub scene: String,
    /// Step settings.
    pub settings: StepSettings,
    /// Number of dimensions: 2 or 3.
    pub dimension: usize,
    /// Time between two frames. \[s\]
    pub frame_time: f64,
    /// Names of the bodies.
    pub names: Vec<String>,
    /// Names of the joints.
    #[serde(default, skip_serializing_if = "JointLayout::is_empty")]
    pub joints: JointLayout,
    /// Data of frames besides poses and joints.
    #[serde(default)]
    pub extras: Extras,
}

/// Data of the frames of a journal besides poses and joints. They do not change the bake.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Extras {
    /// Velocities of the bodies.
    pub velocities: bool,
    /// Impulses of contacts.
    pub contacts: bool,
}

impl Header {
    /// Returns the header of a scene baked with these settings.
    pub fn new(scene: &Scene, settings: &StepSettings) -> Self {
        let timeless = Scene { steps: None, solver: serde_json::Map::new(), ..scene.clone() };
        let text = scene::to_json(&timeless);
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: format!("{:016x}", xxhash_rust::xxh3::xxh3_64(text.as_bytes())),
            settings: settings.clone(),
            dimension: scene.dimension,
            frame_time: scene.time_step,
            names: scene.names(),
            joints: JointLayout::of(scene),
            extras: Extras::default(),
        }
    }

    /// Describes the difference from the header of the bake that was `asked` for, if there is one.
    pub fn difference(&self, asked: &Self) -> Option<String> {
        if self.version != asked.version {
            return Some(format!("it has version {}; accepted: {}", self.version, asked.version));
        }
        if self.settings != asked.settings {
            let [own, other] = [self, asked].map(|of| serde_json::to_value(&of.settings));
            let (own, other) = (own.unwrap_or_default(), other.unwrap_or_default());
            let keys = own.as_object().into_iter().flatten();
            let differs = |(key, value): (&String, &serde_json::Value)| {
                let asked = other.get(key).filter(|asked| *asked != value)?;
                Some(format!("{key} {value}, not {asked}"))
            };
            let list: Vec<_> = keys.filter_map(differs).collect();
            return Some(format!("it was baked with {}", list.join(", ")));
        }
        let same = Self { extras: asked.extras, ..self.clone() };
        (same != *asked)
            .then(|| "it is of another scene, or of an earlier version of this one".to_owned())
    }

    /// Describes what the bake that was `asked` for needs and the frames do not hold, if there is
    /// anything.
    pub fn lack(&self, asked: &Self) -> Option<&'static str> {
        let (own, other) = (self.extras, asked.extras);
        if other.velocities && !own.velocities {
            return Some("its frames have no velocities, which .npz needs");
        }
        (other.contacts && !own.contacts).then_some("its frames have no contacts for --contacts")
    }

    /// Returns the number of floats per frame.
    fn numbers(&self) -> usize {
        self.names.len().saturating_mul(pose_numbers(self.dimension))
    }
}

/// A completed step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Wall time of [`AnyWorld::step`](crate::AnyWorld::step) alone.
    pub time: Duration,
    /// Report of the step.
    pub report: StepReport,
    /// Measurements after the step.
    pub measure: Measure,
    /// [`AnyWorld::state_hash`](crate::AnyWorld::state_hash) after the step.
    pub state: u64,
}

/// State at a frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameState<'a> {
    /// Poses of all bodies.
    pub poses: &'a [f32],
    /// The joints.
    pub joints: &'a JointFrame,
    /// Velocities of all bodies, if the header has them ([`Extras`]).
    pub velocities: &'a [f32],
    /// Impulses of the step that led to the frame, if the header has them.
    pub contacts: &'a PairImpulses,
}

/// Poses of all bodies and the joints, and the step that led to them (`None` for the initial
/// state).
#[derive(Serialize, Deserialize)]
struct FrameRecord<'a, P> {
    step: Option<Cow<'a, Step>>,
    poses: P,
    joints: Cow<'a, JointFrame>,
    velocities: P,
    contacts: Cow<'a, PairImpulses>,
}

/// Position of a checkpoint in a journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    /// Number of steps before the checkpoint.
    pub step: usize,
    start: u64,
    length: u64,
}

/// Contents of a journal.
#[derive(Clone, Debug, PartialEq)]
pub struct Contents {
    /// Identity of the bake.
    pub header: Header,
    /// Frames, the initial state first.
    pub recording: Recording,
    /// Joints at each frame.
    pub joints: Vec<JointFrame>,
    /// Velocities at each frame, if the header has them.
    pub velocities: Velocities,
    /// Impulses of contacts at each frame, if the header has them.
    pub contacts: Vec<PairImpulses>,
    /// Steps between the frames.
    pub steps: Vec<Step>,
    /// Checkpoints in order.
    pub checkpoints: Vec<Mark>,
    /// True if the initial state has been read.
    begun: bool,
}

impl Contents {
    /// Returns the recording with the names of its bodies, and the joints.
    pub fn named(self) -> Named {
        let broken = self.steps.iter().map(|step| step.report.broken.as_slice());
        let joints = JointRecording::new(self.header.joints, &self.joints, broken);
        let Self { recording, velocities, .. } = self;
        Named { recording, names: self.header.names, joints, velocities }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum RecordKind {
    Header = b'H',
    FrameRecord = b'F',
    Checkpoint = b'C',
}

/// A journal open for writing. Where the file system supports locks, no other process can write to
/// the file meanwhile.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    end: u64,
    /// True if the file name survives a power failure.
    is_synced: bool,
}

impl Journal {
    /// Starts a journal, replacing one that exists.
    ///
    /// # Errors
    /// If the system refuses, another process writes to the file, or the existing file is no
    /// journal.
    pub fn create(path: &Path, header: &Header) -> io::Result<Self> {
        let mut file = open(path, true)?;
        if read_magic(&mut file)? == Magic::Other {
            return Err(refusal("the file is not a journal"));
        }
        file.set_len(0)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(MAGIC)?;
        let path = path.to_owned();
        let mut journal = Self { path, file, end: MAGIC.len() as u64, is_synced: false };
        journal.append(RecordKind::Header, &serde_json::to_vec(header)?)?;
        Ok(journal)
    }

    /// Continues a journal and cuts off a torn record at its end. Returns `None` if there is no
    /// journal, or none that reached the initial state.
    ///
    /// # Errors
    /// Those of [`Journal::create`].
    pub fn resume(path: &Path) -> io::Result<Option<(Self, Contents)>> {
        let mut file = match open(path, false) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            file => file?,
        };
        let Some((contents, end)) = contents(&mut file)?.filter(|(contents, _)| contents.begun)
        else {
            return Ok(None);
        };
        file.set_len(end)?;
        file.seek(SeekFrom::Start(end))?;
        Ok(Some((Self { path: path.to_owned(), file, end, is_synced: true }, contents)))
    }

    /// Appends a frame, and the step that led to it.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn frame(&mut self, step: Option<&Step>, state: &FrameState<'_>) -> io::Result<()> {
        let FrameState { poses, joints, velocities, contacts } = *state;
        let (step, joints) = (step.map(Cow::Borrowed), Cow::Borrowed(joints));
        let frame =
            FrameRecord { step, poses, joints, velocities, contacts: Cow::Borrowed(contacts) };
        let frame = postcard::to_stdvec(&frame).map_err(io::Error::other)?;
        self.append(RecordKind::FrameRecord, &frame)
    }

    /// Appends the simulation state after the steps written so far, and syncs as [`Journal::sync`]
    /// does.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn checkpoint(&mut self, state: &[u8]) -> io::Result<()> {
        self.append(RecordKind::Checkpoint, state)?;
        self.sync()
    }

    /// Flushes all records to the disk, so that they survive a power failure.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()?;
        if !std::mem::replace(&mut self.is_synced, true) {
            sync_directory(&self.path);
        }
        Ok(())
    }

    /// Reads the simulation state at a checkpoint of this journal.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn state_at(&mut self, mark: Mark) -> io::Result<Vec<u8>> {
        let mut state = vec![0; usize::try_from(mark.length).map_err(io::Error::other)?];
        self.file.seek(SeekFrom::Start(mark.start))?;
        self.file.read_exact(&mut state)?;
        self.file.seek(SeekFrom::Start(self.end))?;
        Ok(state)
    }

    /// Returns the size of the journal. \[byte\]
    pub fn size(&self) -> u64 {
        self.end
    }

    /// Appends a record in a single write, so that a killed process leaves no torn record.
    fn append(&mut self, kind: RecordKind, content: &[u8]) -> io::Result<()> {
        let mut record = vec![kind as u8];
        record.extend((content.len() as u64).to_le_bytes());
        record.extend(content);
        record.extend(xxh3_64_with_seed(&record, self.end).to_le_bytes());
        self.file.write_all(&record)?;
        self.end = self.end.saturating_add(record.len() as u64);
        Ok(())
    }
}

/// Reads the contents of a journal, which may still be growing.
///
/// # Errors
/// If the system refuses, the file is no journal, or the journal has no whole header yet.
pub fn read(path: &Path) -> io::Result<Contents> {
    let found = contents(&mut scene::open(path)?)?;
    found
        .map(|(contents, _)| contents)
        .ok_or_else(|| refusal("the file is not a journal, or is empty"))
}

fn refusal(why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, why.to_owned())
}

/// Opens a file and locks it against other writers.
fn open(path: &Path, create: bool) -> io::Result<File> {
    let file = File::options().read(true).write(true).create(create).truncate(false).open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(io::Error::new(
            io::ErrorKind::ResourceBusy,
            "another bake writes to it; give this one another output",
        )),
        // Without locks in the file system, users must not start two bakes to the same file.
        Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => Ok(file),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Magic {
    /// Empty, or an incomplete first line.
    Missing,
    Journal,
    Other,
}

fn read_magic(file: &mut impl io::Read) -> io::Result<Magic> {
    let mut start = Vec::new();
    file.take(MAGIC.len() as u64).read_to_end(&mut start)?;
    Ok(match start.as_slice() {
        whole if whole == MAGIC => Magic::Journal,
        part if MAGIC.starts_with(part) => Magic::Missing,
        _ => Magic::Other,
    })
}

/// Reads the whole records of a journal and returns the offset of their end; `None` without a
/// header.
fn contents(file: &mut File) -> io::Result<Option<(Contents, u64)>> {
    let size = file.metadata()?.len();
    let mut reader = Reader { file: BufReader::new(file), at: MAGIC.len() as u64, size };
    match read_magic(&mut reader.file)? {
        Magic::Missing => return Ok(None),
        Magic::Other => return Err(refusal("the file is not a journal")),
        Magic::Journal => {}
    }
    let Some(first) = reader.next()? else { return Ok(None) };
    if first.kind != RecordKind::Header as u8 {
        return Err(refusal("it does not begin with a header"));
    }
    let mut contents = Contents::new(serde_json::from_slice(&first.content)?)?;
    while let Some(record) = reader.next()? {
        contents.add(record)?;
    }
    Ok(Some((contents, reader.at)))
}

/// A record with a valid checksum.
struct JournalRecord {
    kind: u8,
    content: Vec<u8>,
    /// Offset of the content in the file. \[byte\]
    start: u64,
}

struct Reader<R> {
    file: R,
    /// Offset of the next record. \[byte\]
    at: u64,
    /// Size of the file when reading began. \[byte\]
    size: u64,
}

/// Lengths of the parts before and after the content of a record. \[byte\]
const HEAD: u64 = 9;
const TAIL: u64 = 8;

impl<R: io::Read> Reader<R> {
    /// Returns the next record; `None` if it is not whole.
    fn next(&mut self) -> io::Result<Option<JournalRecord>> {
        let room = self.size.saturating_sub(self.at).saturating_sub(HEAD + TAIL);
        let mut head = [0; HEAD as usize];
        if !self.fills(&mut head)? {
            return Ok(None);
        }
        let [kind, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        if length > room.min(MAX_RECORD) {
            return Ok(None);
        }
        let mut record =
            vec![0; usize::try_from(HEAD.saturating_add(length)).map_err(io::Error::other)?];
        let (own_head, content) = record.split_at_mut(HEAD as usize);
        own_head.copy_from_slice(&head);
        let mut checksum = [0; TAIL as usize];
        if !self.fills(content)? || !self.fills(&mut checksum)? {
            return Ok(None);
        }
        if u64::from_le_bytes(checksum) != xxh3_64_with_seed(&record, self.at) {
            return Ok(None);
        }
        let start = self.at.saturating_add(HEAD);
        self.at = start.saturating_add(length).saturating_add(TAIL);
        Ok(Some(JournalRecord { kind, content: record.split_off(HEAD as usize), start }))
    }

    /// Fills a buffer; returns false if the file ends before.
    fn fills(&mut self, buffer: &mut [u8]) -> io::Result<bool> {
        match self.file.read_exact(buffer) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
            Err(error) => Err(error),
        }
    }
}

impl Contents {
    fn new(header: Header) -> io::Result<Self> {
        if !matches!(header.dimension, 2 | 3) {
            return Err(refusal("its dimension is neither 2 nor 3"));
        }
        let recording = Recording {
            dimension: header.dimension,
            bodies: header.names.len(),
            frame_time: header.frame_time,
            start: 0,
            poses: Vec::new(),
        };
        Ok(Self {
            header,
            recording,
            joints: Vec::new(),
            velocities: Velocities::default(),
            contacts: Vec::new(),
            steps: Vec::new(),
            checkpoints: Vec::new(),
            begun: false,
        })
    }

    fn add(&mut self, record: JournalRecord) -> io::Result<()> {
        if record.kind == RecordKind::Checkpoint as u8 {
            let (start, length) = (record.start, record.content.len() as u64);
            self.checkpoints.push(Mark { step: self.steps.len(), start, length });
            return Ok(());
        }
        if record.kind != RecordKind::FrameRecord as u8 {
            return Err(refusal("it has a record of a kind that this version does not know"));
        }
        let frame: FrameRecord<'_, Vec<f32>> = postcard::from_bytes(&record.content)
            .map_err(|error| refusal(&format!("a frame cannot be read: {error}")))?;
        if !frame.fits(&self.header) || frame.step.is_some() != self.begun {
            return Err(refusal("a frame does not fit its header"));
        }
        self.begun = true;
        self.recording.poses.extend(frame.poses);
        self.velocities.numbers.extend(frame.velocities);
        if self.header.extras.contacts {
            self.contacts.push(frame.contacts.into_owned());
        }
        self.joints.push(frame.joints.into_owned());
        self.steps.extend(frame.step.map(Cow::into_owned));
        Ok(())
    }
}

impl FrameRecord<'_, Vec<f32>> {
    /// Returns true if it has what the header says.
    fn fits(&self, header: &Header) -> bool {
        let Header { dimension, extras, .. } = *header;
        let bodies = header.names.len();
        let velocities = bodies.saturating_mul(Velocities::stride(dimension));
        let no_contacts = self.contacts.bodies.is_empty();
        self.poses.len() == header.numbers()
            && self.velocities.len() == if extras.velocities { velocities } else { 0 }
            && (extras.contacts || no_contacts)
            && self.contacts.fits(bodies, dimension)
            && self.joints.fits(&header.joints)
    }
}

#[cfg(test)]
mod tests;
