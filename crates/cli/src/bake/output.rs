//! Files that a bake writes.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use drystone_bake::recording::{self, Sampling};
use drystone_scene::{Read, Warning, write_whole};

use super::arguments::BakeArguments;
use super::record::Bake;
use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;
use crate::files::{folder, place};
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
        let report = arguments.report.clone();
        let outputs = Self { motions, report, dumps: super::dump::files(arguments)? };
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
        self.motions.iter().map(|(path, _)| path).chain(&self.report).chain(&self.dumps)
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
        let motion = frame_options.motion(&bake.recording, &names, &contacts, &joints)?;
        let options = frame_options.sampling();
        let mut warnings = Vec::new();
        for (path, format) in &self.motions {
            warnings.extend(format.write(path, Some(read), &motion, &options)?);
        }
        Ok((self.motions.iter().map(|(path, _)| path.clone()).collect(), warnings))
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
        options: &Sampling,
    ) -> Result<Vec<Warning>, Failure> {
        let mut warnings = Vec::new();
        let OutputMotion { recording, names, contacts, joints } = motion;
        let source = read.and_then(|read| read.source.as_ref());
        let written = match (self, read.map(|read| &read.scene), source) {
            (Self::Poses, ..) => recording::poses::write(path, recording),
            (Self::Npz, ..) => recording::npz::write(path, recording, names, contacts, joints),
            (Self::Usda, Some(scene), _) => {
                recording::usda::write(path, scene, recording, joints, options)
            }
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
