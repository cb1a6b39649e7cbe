//! A temporary folder to run the command line in.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// A box and a ball fall onto a floor, for two seconds.
pub(crate) const SCENE: &str = r#"
name = "drop"
duration = 2

[[bodies]]
name = "floor"
motion = "static"
shapes = [{ type = "halfspace", normal = [0, 1, 0] }]

[[bodies]]
name = "box"
position = [0, 0.6, 0]
rotation = [0.1, 0, 0.2, 0.9746794]
shapes = [{ type = "box", half_extents = [0.2, 0.1, 0.3] }]

[[bodies]]
name = "ball"
position = [0.1, 1.2, 0]
shapes = [{ type = "sphere", radius = 0.2 }]
"#;

/// A temporary folder with a scene in it.
pub(crate) struct Place {
    folder: TempDir,
}

impl Place {
    pub(crate) fn new(scene: &str) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        fs::write(place.path("scene.toml"), scene).unwrap();
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns a `drystone` command that runs in this folder.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        self.command_of(OsStr::new(env!("CARGO_BIN_EXE_drystone")), arguments)
    }

    fn command_of(&self, program: &OsStr, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.folder.path()).args(arguments);
        command
    }

    /// Runs `drystone` in this folder.
    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs another build of `drystone` in this folder.
    pub(crate) fn run_build(&self, program: &OsStr, arguments: &[&str]) -> Output {
        self.command_of(program, arguments).output().unwrap()
    }

    pub(crate) fn fails(&self, code: i32, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
        message
    }

    pub(crate) fn succeeds(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {message}");
        String::from_utf8(output.stdout).unwrap()
    }

    pub(crate) fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// Returns the path of an example scene of the project.
pub(crate) fn example(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes").join(name);
    path.to_str().unwrap().to_owned()
}
