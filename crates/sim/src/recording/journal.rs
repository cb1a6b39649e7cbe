//! The journal of a bake that is under way: what it takes to go on after the process has ended, however
//! it ended.
//!
//! A first line names the format; then come records: kind, length, content, checksum. The first is the
//! [`Header`], then one frame for the initial state and one for each step, and checkpoints among
//! them. Records are only appended, so a bake that was cut off leaves whole records and at most one torn
//! one, which its checksum tells. Whoever reads sees every whole record, also while more are written.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::fs::{File, TryLockError};
use std::io::{self, BufReader, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::Recording;
use super::file::sync_directory;
use super::npz::Named;
use crate::geometry::pose_numbers;
use crate::report::{Measure, StepReport};
use crate::scene::{self, Scene};
use crate::settings::StepSettings;

/// The first line of a journal.
const MAGIC: &[u8] = b"drystone journal 1\n";

/// Largest record that is read. \[byte\]
const MAX_RECORD: u64 = 1 << 36;

/// What a bake is of. Two bakes with the same header have the same frames, as far as both have them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Of Drystone.
    pub version: String,
    /// XXH3 (64 bits) of the scene as JSON without its length and settings, in hexadecimal.
    pub scene: String,
    /// How its steps are taken.
    pub settings: StepSettings,
    /// 2 or 3.
    pub dimension: usize,
    /// Time between two frames. \[s\]
    pub frame_time: f64,
    /// One for each body.
    pub names: Vec<String>,
}

impl Header {
    /// Of a scene under these settings.
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
        }
    }

    /// In what it differs from the header of a bake that was `asked` for.
    pub fn difference(&self, asked: &Self) -> Option<String> {
        if self.version != asked.version {
            return Some(format!("it is of version {}, not {}", self.version, asked.version));
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
        (self != asked)
            .then(|| "it is of another scene, or of this one before it was changed".to_owned())
    }

    /// Numbers of a frame.
    fn numbers(&self) -> usize {
        self.names.len().saturating_mul(pose_numbers(self.dimension))
    }
}

/// A step that was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Wall time of [`Simulation::step`](crate::Simulation::step) alone.
    pub time: Duration,
    /// What it said of itself.
    pub report: StepReport,
    /// What came out.
    pub measure: Measure,
    /// [`Simulation::state_hash`](crate::Simulation::state_hash) after it.
    pub state: u64,
}

/// The poses of all bodies, and the step that led to them; none to the initial state.
#[derive(Serialize, Deserialize)]
struct Frame<'a, P> {
    step: Option<std::borrow::Cow<'a, Step>>,
    poses: P,
}

/// Where in a journal a checkpoint is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    /// Steps that were taken before it.
    pub step: usize,
    start: u64,
    length: u64,
}

/// What a journal holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Contents {
    /// What the bake is of.
    pub header: Header,
    /// The frames, the initial state first.
    pub recording: Recording,
    /// The steps between them.
    pub steps: Vec<Step>,
    /// In order.
    pub checkpoints: Vec<Mark>,
    /// Whether it has the initial state.
    begun: bool,
}

impl Contents {
    /// The recording with the names of its bodies.
    pub fn named(self) -> Named {
        Named { recording: self.recording, names: self.header.names }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Kind {
    Header = b'H',
    Frame = b'F',
    Checkpoint = b'C',
}

/// A journal that is being written. Nobody else can write to it meanwhile.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    end: u64,
    /// Whether its name would outlast a power cut.
    lasting: bool,
}

impl Journal {
    /// Starts a journal in place of what is there.
    ///
    /// # Errors
    /// The system refuses; another process writes to it; the file there is no journal.
    pub fn create(path: &Path, header: &Header) -> io::Result<Self> {
        let mut file = open(path, true)?;
        if read_magic(&mut file)? == Magic::Other {
            return Err(refusal("the file there is no journal"));
        }
        file.set_len(0)?;
        file.seek(SeekFrom::Start(0))?;
        file.write_all(MAGIC)?;
        let path = path.to_owned();
        let mut journal = Self { path, file, end: MAGIC.len() as u64, lasting: false };
        journal.append(Kind::Header, &serde_json::to_vec(header)?)?;
        Ok(journal)
    }

    /// Goes on with a journal; nothing if there is none, or none that got as far as the initial state.
    /// A torn record at the end is cut off.
    ///
    /// # Errors
    /// As for [`Journal::create`].
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
        Ok(Some((Self { path: path.to_owned(), file, end, lasting: true }, contents)))
    }

    /// Appends a frame.
    ///
    /// # Errors
    /// The system refuses.
    pub fn frame(&mut self, step: Option<&Step>, poses: &[f32]) -> io::Result<()> {
        let step = step.map(std::borrow::Cow::Borrowed);
        let frame = postcard::to_stdvec(&Frame { step, poses }).map_err(io::Error::other)?;
        self.append(Kind::Frame, &frame)
    }

    /// Appends the state after `step` steps, and sees to it that all until here outlasts a power cut.
    ///
    /// # Errors
    /// The system refuses.
    pub fn checkpoint(&mut self, state: &[u8]) -> io::Result<()> {
        self.append(Kind::Checkpoint, state)?;
        self.sync()
    }

    /// Sees to it that all until here outlasts a power cut.
    ///
    /// # Errors
    /// The system refuses.
    pub fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()?;
        if !std::mem::replace(&mut self.lasting, true) {
            sync_directory(&self.path);
        }
        Ok(())
    }

    /// The state at a mark of this journal.
    ///
    /// # Errors
    /// The system refuses.
    pub fn state_at(&mut self, mark: Mark) -> io::Result<Vec<u8>> {
        let mut state = vec![0; usize::try_from(mark.length).map_err(io::Error::other)?];
        self.file.seek(SeekFrom::Start(mark.start))?;
        self.file.read_exact(&mut state)?;
        self.file.seek(SeekFrom::Start(self.end))?;
        Ok(state)
    }

    /// Bytes so far.
    pub fn size(&self) -> u64 {
        self.end
    }

    /// In one piece, so that a process that is killed tears no record.
    fn append(&mut self, kind: Kind, content: &[u8]) -> io::Result<()> {
        let mut record = vec![kind as u8];
        record.extend((content.len() as u64).to_le_bytes());
        record.extend(content);
        record.extend(xxh3_64_with_seed(&record, self.end).to_le_bytes());
        self.file.write_all(&record)?;
        self.end = self.end.saturating_add(record.len() as u64);
        Ok(())
    }
}

/// What a journal holds by now; it may be growing.
///
/// # Errors
/// The system refuses; the file is no journal, or has not got as far as its header.
pub fn read(path: &Path) -> io::Result<Contents> {
    let found = contents(&mut scene::open(path)?)?;
    found.map(|(contents, _)| contents).ok_or_else(|| refusal("it is no journal, or an empty one"))
}

fn refusal(why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, why.to_owned())
}

/// A file that nobody else writes to as long as it is open.
fn open(path: &Path, create: bool) -> io::Result<File> {
    let file = File::options().read(true).write(true).create(create).truncate(false).open(path)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(io::Error::new(
            io::ErrorKind::ResourceBusy,
            "another bake writes to it; give this one another output",
        )),
        // Where a file system knows no locks, two bakes to one place are the user's to avoid.
        Err(TryLockError::Error(error)) if error.kind() == io::ErrorKind::Unsupported => Ok(file),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Magic {
    /// Nothing, or a first line that is not whole.
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

/// The whole records of a journal, and where they end; nothing without a header.
fn contents(file: &mut File) -> io::Result<Option<(Contents, u64)>> {
    let size = file.metadata()?.len();
    let mut reader = Reader { file: BufReader::new(file), at: MAGIC.len() as u64, size };
    match read_magic(&mut reader.file)? {
        Magic::Missing => return Ok(None),
        Magic::Other => return Err(refusal("the file there is no journal")),
        Magic::Journal => {}
    }
    let Some(first) = reader.next()? else { return Ok(None) };
    if first.kind != Kind::Header as u8 {
        return Err(refusal("it does not begin with a header"));
    }
    let mut contents = Contents::new(serde_json::from_slice(&first.content)?)?;
    while let Some(record) = reader.next()? {
        contents.add(record)?;
    }
    Ok(Some((contents, reader.at)))
}

/// A record whose checksum is right.
struct Record {
    kind: u8,
    content: Vec<u8>,
    /// Where the content starts in the file.
    start: u64,
}

struct Reader<R> {
    file: R,
    /// Where the next record starts.
    at: u64,
    /// Of the file, when reading began.
    size: u64,
}

/// Bytes before and after the content of a record.
const HEAD: u64 = 9;
const TAIL: u64 = 8;

impl<R: io::Read> Reader<R> {
    /// The next record, if it is whole.
    fn next(&mut self) -> io::Result<Option<Record>> {
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
        Ok(Some(Record { kind, content: record.split_off(HEAD as usize), start }))
    }

    /// Whether there are enough bytes to fill a buffer.
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
        let (steps, checkpoints) = (Vec::new(), Vec::new());
        Ok(Self { header, recording, steps, checkpoints, begun: false })
    }

    fn add(&mut self, record: Record) -> io::Result<()> {
        if record.kind == Kind::Checkpoint as u8 {
            let (start, length) = (record.start, record.content.len() as u64);
            self.checkpoints.push(Mark { step: self.steps.len(), start, length });
            return Ok(());
        }
        if record.kind != Kind::Frame as u8 {
            return Err(refusal("it has a record of a kind that this version does not know"));
        }
        let frame: Frame<'_, Vec<f32>> = postcard::from_bytes(&record.content)
            .map_err(|error| refusal(&format!("a frame cannot be read: {error}")))?;
        if frame.poses.len() != self.header.numbers() || frame.step.is_some() != self.begun {
            return Err(refusal("a frame does not fit its header"));
        }
        self.begun = true;
        self.recording.poses.extend(frame.poses);
        self.steps.extend(frame.step.map(std::borrow::Cow::into_owned));
        Ok(())
    }
}

#[cfg(test)]
mod tests;
