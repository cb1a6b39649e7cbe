//! Access to input files: bounded in size, and only inside the scene's folder.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Component, Path, PathBuf};

use super::error::{Place, SceneError};

/// Largest scene file. \[byte\]
const MAX_SIZE: u64 = 1 << 30;

/// Reads the whole file as UTF-8 text.
pub(super) fn read_text(file: &Path) -> Result<String, SceneError> {
    let bytes = read_bytes(file, MAX_SIZE).map_err(|error| SceneError {
        file: file.to_owned(),
        place: Place::File,
        item: "the file cannot be read".to_owned(),
        value: String::new(),
        accepted: error.to_string(),
        unreadable: true,
    })?;
    let refuse = |place, item: &str, value: String, accepted: &str| SceneError {
        file: file.to_owned(),
        place,
        item: item.to_owned(),
        value,
        accepted: format!("accepted: {accepted}"),
        unreadable: false,
    };
    let Some(bytes) = bytes else {
        return Err(refuse(Place::File, "the size", "over 1 GiB".to_owned(), "at most 1 GiB"));
    };
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let byte = error.as_bytes().get(at).copied().unwrap_or(0);
        refuse(Place::Byte(at as u64), "the text", format!("byte 0x{byte:02x}"), "UTF-8")
    })
}

/// Opens a file for reading. Refuses special files, which may be endless or block until somebody
/// writes.
///
/// # Errors
/// If the path is a folder or not a regular file, or if the system refuses.
pub fn open(path: &Path) -> io::Result<File> {
    let data = std::fs::metadata(path)?;
    if data.is_dir() {
        return Err(io::Error::other("Is a directory"));
    }
    if !data.is_file() {
        return Err(io::Error::other("Not a regular file"));
    }
    File::open(path)
}

/// Reads all bytes of a file; `None` if there are more than `most`.
///
/// # Errors
/// Those of [`open`], or the system refuses.
pub fn read_bytes(file: &Path, most: u64) -> io::Result<Option<Vec<u8>>> {
    let file = open(file)?;
    if file.metadata()?.len() > most {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    // The file may grow while it is read.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok(if bytes.len() as u64 > most { None } else { Some(bytes) })
}

/// Fills `start` with the first bytes of a regular file. Returns false if that fails or the file is
/// shorter.
pub(super) fn starts_with(file: &Path, start: &mut [u8]) -> bool {
    let regular = std::fs::metadata(file).is_ok_and(|data| data.is_file());
    regular && File::open(file).is_ok_and(|mut file| file.read_exact(start).is_ok())
}

/// Resolves `path` relative to the folder `here`. Returns the canonical path if it lies in the
/// folder `home` or below. The error says why it was refused; it calls `home` the folder of
/// `whose`.
pub(super) fn inside(path: &str, here: &Path, home: &Path, whose: &str) -> Result<PathBuf, String> {
    let refused = || format!("a relative path to a file inside the folder of {whose} is accepted");
    let relative = Path::new(path);
    let plain = relative
        .components()
        .all(|c| matches!(c, Component::Normal(_) | Component::CurDir | Component::ParentDir));
    let scheme = path.split('/').next().is_some_and(|first| first.contains(':'));
    if path.is_empty() || !plain || scheme || path.contains(['\\', '\0']) {
        return Err(refused());
    }
    let named = |folder: &Path| {
        if folder.as_os_str().is_empty() { PathBuf::from(".") } else { folder.to_owned() }
    };
    let absent = |error: io::Error| format!("it could not be read: {error}");
    // Every step is checked. Otherwise a path that leaves the folder and comes back would reveal
    // whether folders outside exist.
    let home = named(home).canonicalize().map_err(absent)?;
    let mut reached = named(here).canonicalize().map_err(absent)?;
    for step in relative.components() {
        reached = reached.join(step).canonicalize().map_err(absent)?;
        if !reached.starts_with(&home) {
            return Err(refused());
        }
    }
    Ok(reached)
}
