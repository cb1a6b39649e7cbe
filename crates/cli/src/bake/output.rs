//! Files that a bake writes.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use drystone_bake::recording;
use drystone_bake::recording::contacts::{self, ContactRecording};
use drystone_bake::recording::journal::Extras;
use drystone_bake::recording::npz::Arrays;
use drystone_scene::{Read, Warning, write_whole};

use super::arguments::BakeArguments;
use super::record::Bake;
use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;
use crate::files::{folder, place, refuse_overwrite};
use crate::frames::{FrameOptions, OutputMotion};

/// File format of a motion.
#[derive(Clone, Copy)]
pub(crate) enum Format {
    Glb,
    Npz,
    Poses,
    Usda,
}

/// Paths of all outputs.
pub(super) struct Outputs {
    motions: Vec<(PathBuf, Format)>,
    contacts: Vec<(PathBuf, ContactFormat)>,
    report: Option<PathBuf>,
    dumps: Vec<PathBuf>,
}

impl Outputs {
    /// Collects the outputs. Refuses wrong extensions, the scene as an output, and an output given
    /// twice.
    pub(super) fn new(arguments: &BakeArguments) -> Result<Self, Failure> {
        let motions =
            arguments.output.iter().map(|path| Ok((path.clone(), Format::of("--output", path)?)));
        let motions = motions.collect::<Result<_, Failure>>()?;
        let contacts =
            arguments.contacts.iter().map(|path| Ok((path.clone(), ContactFormat::of(path)?)));
        let contacts = contacts.collect::<Result<_, Failure>>()?;
        let report = arguments.report.clone();
        let outputs = Self { motions, contacts, report, dumps: super::dump::files(arguments)? };
        if let Some(path) = &outputs.report
            && extension(path) != "json"
        {
            return Err(wrong_extension("--report", path, ".json"));
        }
        let mut seen = BTreeSet::from([place(&arguments.scene)]);
        for path in outputs.paths() {
            if place(path) == place(&arguments.scene) {
                let text = format!("{}: the output is the scene itself", path.display());
                return Err(Failure::Input(format!("{text}; give it another name")));
            }
            if !seen.insert(place(path)) {
                let text = format!("{}: is given twice as output", path.display());
                return Err(Failure::Input(format!("{text}; give each its own name")));
            }
        }
        Ok(outputs)
    }

    fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        let motions = self.motions.iter().map(|(path, _)| path);
        let contacts = self.contacts.iter().map(|(path, _)| path);
        motions.chain(contacts).chain(&self.report).chain(&self.dumps)
    }

    /// Returns what the outputs need besides poses and joints.
    pub(super) fn extras(&self) -> Extras {
        let velocities = self.motions.iter().any(|(_, format)| matches!(format, Format::Npz));
        Extras { velocities, contacts: !self.contacts.is_empty() }
    }

    /// Refuses outputs in the place of a layer of the stage that was read.
    pub(super) fn spare_layers(&self, read: &Read) -> Result<(), Failure> {
        let layers = || read.stage.iter().flat_map(|stage| &stage.layers).map(PathBuf::as_path);
        self.paths().try_for_each(|path| refuse_overwrite(path, layers()))
    }

    /// Returns the output that was named first.
    pub(super) fn first<'a>(&'a self, arguments: &'a BakeArguments) -> &'a Path {
        self.paths().next().unwrap_or(&arguments.scene)
    }

    /// Returns the files of the contact problem of a step.
    pub(super) fn dumps(&self) -> &[PathBuf] {
        &self.dumps
    }

    /// Checks that the files can be written, before the simulation starts.
    pub(super) fn check_folders(&self) -> Result<(), Failure> {
        self.paths().try_for_each(|path| check_folder(path))
    }

    /// Writes the motion. Returns the files, with warnings about what they leave out.
    pub(super) fn write(
        &self,
        read: &Read,
        bake: &Bake,
        frame_options: &FrameOptions,
    ) -> Result<(Vec<PathBuf>, Vec<Warning>), Failure> {
        let (names, contacts) = (read.scene.names(), bake.contacts());
        let joints = bake.joint_recording(&read.scene);
        let motion = frame_options.motion(OutputMotion {
            recording: Cow::Borrowed(&bake.recording),
            names: &names,
            contacts: &contacts,
            joints: Cow::Borrowed(&joints),
            velocities: Cow::Borrowed(&bake.velocities),
        })?;
        let mut warnings = Vec::new();
        for (path, format) in &self.motions {
            warnings.extend(format.write(path, Some(read), &motion, frame_options)?);
        }
        for (path, format) in &self.contacts {
            let written = format.write(path, read, (bake, &motion), frame_options);
            written.map_err(|error| Failure::cannot_write(path, &error))?;
        }
        let motions = self.motions.iter().map(|(path, _)| path);
        let contacts = self.contacts.iter().map(|(path, _)| path);
        Ok((motions.chain(contacts).cloned().collect(), warnings))
    }
}

/// File format of contacts.
#[derive(Clone, Copy)]
enum ContactFormat {
    Npz,
    Usda,
}

impl ContactFormat {
    fn of(path: &Path) -> Result<Self, Failure> {
        match extension(path).as_str() {
            "npz" => Ok(Self::Npz),
            "usda" => Ok(Self::Usda),
            _ => Err(wrong_extension("--contacts", path, ".npz, .usda")),
        }
    }

    /// Writes the contacts of the frames of a motion.
    fn write(
        self,
        path: &Path,
        read: &Read,
        (bake, motion): (&Bake, &OutputMotion<'_>),
        frame_options: &FrameOptions,
    ) -> io::Result<()> {
        let recording = &motion.recording;
        let (dimension, frame_time) = (recording.dimension, recording.frame_time);
        let all = ContactRecording { dimension, frame_time, start: 0, frames: &bake.impulses };
        match self {
            Self::Npz => {
                let (start, count) = (recording.start, recording.frames());
                // Without bodies there are no frames.
                let frames = all.frames.get(start..start + count).unwrap_or_default();
                let contacts = ContactRecording { start, frames, ..all };
                recording::npz::write_contacts(path, &contacts, motion.names)
            }
            Self::Usda => {
                let options = frame_options.sampling();
                contacts::write_usda(path, &all, recording, read.stage.as_ref(), &options)
            }
        }
    }
}

impl Format {
    /// Returns the format of a path by its extension.
    pub(crate) fn of(flag: &str, path: &Path) -> Result<Self, Failure> {
        match extension(path).as_str() {
            "glb" => Ok(Self::Glb),
            "npz" => Ok(Self::Npz),
            "poses" => Ok(Self::Poses),
            "usda" => Ok(Self::Usda),
            _ => Err(wrong_extension(flag, path, ".glb, .npz, .poses, .usda")),
        }
    }

    /// Writes a motion. `read` is its scene, which arrays do not need. Returns warnings about what
    /// the file leaves out.
    pub(crate) fn write(
        self,
        path: &Path,
        read: Option<&Read>,
        motion: &OutputMotion<'_>,
        frame_options: &FrameOptions,
    ) -> Result<Vec<Warning>, Failure> {
        let mut warnings = Vec::new();
        let options = &frame_options.sampling();
        let OutputMotion { recording, names, contacts, joints, velocities } = motion;
        let source = read.and_then(|read| read.source.as_ref());
        let stage = read.and_then(|read| read.stage.as_ref());
        let stage = stage.filter(|_| !frame_options.new_stage());
        let written = match (self, read.map(|read| &read.scene), source) {
            (Self::Poses, ..) => recording::poses::write(path, recording),
            (Self::Npz, ..) => {
                let arrays = Arrays { recording, velocities, names, contacts, joints };
                recording::npz::write(path, &arrays)
            }
            (Self::Usda, Some(scene), _) => match stage {
                Some(stage) => {
                    recording::usd_layer::write(path, (scene, stage), recording, joints, options)
                        .map(|own| warnings.extend(own))
                }
                None => {
                    let form = frame_options.bodies_as_prims();
                    recording::usda::write_as(path, (scene, form), recording, joints, options)
                }
            },
            (Self::Glb, Some(scene), None) => {
                recording::glb::write(path, scene, recording, options)
            }
            (Self::Glb, Some(_), Some(source)) => write_whole(path, |out| {
                warnings.extend(recording::gltf::write(out, source, recording, options)?);
                Ok(())
            }),
            (Self::Glb | Self::Usda, None, _) => {
                let text = format!("{}: needs shapes; give the scene", path.display());
                return Err(Failure::Input(text));
            }
        };
        written.map(|()| warnings).map_err(|error| Failure::cannot_write(path, &error))
    }
}

/// Creates the folder of an output if it is missing, and checks that files can be written to it.
fn check_folder(path: &Path) -> Result<(), Failure> {
    let refuse =
        |why: &str| Err(Failure::File(format!("{}: cannot be written: {why}", path.display())));
    match fs::metadata(path) {
        Ok(data) if data.is_dir() => return refuse("a folder is in its place"),
        Ok(data) if !data.is_file() => return refuse("it is not a regular file"),
        Ok(data) if data.permissions().readonly() => return refuse("it is read-only"),
        _ => {}
    }
    fs::create_dir_all(folder(path)).map_err(|error| Failure::cannot_write(path, &error))?;
    // Only an attempt shows whether a file can be created in the folder.
    let probe = place(path).with_file_name(format!(".drystone-{}.probe", std::process::id()));
    File::create(&probe).map_err(|error| Failure::cannot_write(path, &error))?;
    fs::remove_file(&probe).map_err(|error| Failure::cannot_write(path, &error))
}

/// Formats a path with the size of its file.
pub(super) fn describe(path: &Path) -> String {
    let size = fs::metadata(path).map_or(0, |data| data.len()) as f64;
    let (size, unit) = match size {
        ..1e3 => (size, "B"),
        ..1e6 => (size / 1e3, "kB"),
        _ => (size / 1e6, "MB"),
    };
    format!("{} ({size:.0} {unit})", path.display())
}
