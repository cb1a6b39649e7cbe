//! Files that are written completely or not at all.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes a file of which nobody ever sees a part. The data goes to a temporary file in the same
/// folder, whose name ends in `.partial`. Once that is on the disk, it is renamed to the target.
///
/// # Errors
/// If the target is a directory, not a regular file or read-only, or if the system refuses. An
/// existing target then stays unchanged, and the temporary file is removed.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    // Renaming onto a link would replace the link, not the file that it points to.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    match fs::metadata(&target) {
        Ok(data) if data.is_dir() => return Err(refusal("a directory is in its place")),
        Ok(data) if !data.is_file() => return Err(refusal("it is not a regular file")),
        // A rename would replace even a read-only file.
        Ok(data) if data.permissions().readonly() => {
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, "it is read-only"));
        }
        _ => {}
    }
    let (file, temporary) = create_beside(&target)?;
    let mut buffered = BufWriter::with_capacity(1 << 20, file);
    write(&mut buffered)?;
    let file = buffered.into_inner().map_err(io::IntoInnerError::into_error)?;
    file.sync_all()?;
    drop(file);
    fs::rename(&temporary.path, &target)?;
    std::mem::forget(temporary);
    sync_directory(&target);
    Ok(())
}

fn refusal(why: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, why.to_owned())
}

/// A temporary file, removed when dropped, even by a panic.
struct Temporary {
    path: PathBuf,
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

fn create_beside(target: &Path) -> io::Result<(File, Temporary)> {
    let name = target.file_name().ok_or_else(|| refusal("it has no file name"))?;
    let mut last = io::Error::from(io::ErrorKind::AlreadyExists);
    // Another process, or one that was killed, may have a file of that name.
    for attempt in 0..100 {
        let mut partial = OsString::from(name);
        partial.push(format!(".{}-{attempt}.partial", process()));
        let path = target.with_file_name(partial);
        match File::options().write(true).create_new(true).open(&path) {
            Ok(file) => return Ok((file, Temporary { path })),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => last = error,
            Err(error) => return Err(error),
        }
    }
    Err(last)
}

/// Returns a number that no other process has. WebAssembly has no processes, and panics if asked.
fn process() -> u32 {
    if cfg!(target_family = "wasm") { 0 } else { std::process::id() }
}

/// Makes the name of a file survive a power failure. Not every system can; the file is whole either
/// way.
pub fn sync_directory(target: &Path) {
    let parent = target.parent().filter(|parent| !parent.as_os_str().is_empty());
    if let Ok(directory) = File::open(parent.unwrap_or(Path::new("."))) {
        let _ = directory.sync_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn replaces_a_file_and_leaves_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.bin");
        fs::write(&path, "before").unwrap();
        write_whole(&path, |out| out.write_all(b"after")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"after");
        assert_eq!(names(directory.path()), ["out.bin"]);
    }

    #[test]
    fn an_error_or_a_panic_keeps_the_old_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.bin");
        fs::write(&path, "before").unwrap();
        let fail = |out: &mut dyn Write| {
            out.write_all(b"half")?;
            Err(io::Error::other("no space"))
        };
        assert_eq!(write_whole(&path, fail).unwrap_err().to_string(), "no space");
        let panics = std::panic::catch_unwind(|| write_whole(&path, |_| panic!("on purpose")));
        assert!(panics.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"before");
        assert_eq!(names(directory.path()), ["out.bin"]);
    }

    #[test]
    fn leaves_a_read_only_file_alone() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.bin");
        fs::write(&path, "before").unwrap();
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).unwrap();
        let error = write_whole(&path, |out| out.write_all(b"after")).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::PermissionDenied);
        assert_eq!(fs::read(&path).unwrap(), b"before");
    }

    #[test]
    fn refuses_directories() {
        let directory = tempfile::tempdir().unwrap();
        assert!(write_whole(directory.path(), |_| Ok(())).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn writes_through_links_and_refuses_devices() {
        let directory = tempfile::tempdir().unwrap();
        let (path, link) = (directory.path().join("out"), directory.path().join("link"));
        fs::write(&path, "before").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write_whole(&link, |out| out.write_all(b"after")).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&path).unwrap(), b"after");
        assert!(write_whole(Path::new("/dev/null"), |_| Ok(())).is_err());
    }
}
