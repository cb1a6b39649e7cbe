//! Files as bytes: the JSON text and the buffers with their sources.

use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use super::super::error::{Place, SceneError, Warning};
use super::super::file;
use super::glb;
use super::json::{Cursor, parse, reason};

/// Largest size of a file, and of all buffers together. \[byte\]
const MOST: u64 = 2 << 30;

/// Contents of a file.
pub(super) struct Container {
    pub(super) document: Value,
    /// The BIN chunk of a GLB.
    pub(super) bin: Option<Vec<u8>>,
    pub(super) glb: bool,
}

/// Reads the document and, from a GLB, its binary chunk.
pub(super) fn open(file: &Path, warnings: &mut Vec<Warning>) -> Result<Container, SceneError> {
    let bytes = read_file(file, MOST).map_err(|error| SceneError {
        file: file.to_path_buf(),
        place: Place::File,
        item: "file".into(),
        value: String::new(),
        accepted: format!("it could not be read: {error}"),
        unreadable: true,
    })?;
    let named_glb = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
    if named_glb || bytes.starts_with(b"glTF") {
        let (document, bin) = glb::read(file, &bytes, warnings)?;
        return Ok(Container { document, bin, glb: true });
    }
    let document = parse(&bytes).map_err(|error| SceneError {
        file: file.to_path_buf(),
        place: Place::Line { line: error.line(), column: error.column() },
        item: format!("JSON: {}", reason(&error)),
        value: String::new(),
        accepted: "a glTF 2.0 document in UTF-8 without a byte order mark is accepted".into(),
        unreadable: false,
    })?;
    Ok(Container { document, bin: None, glb: false })
}

fn read_file(file: &Path, most: u64) -> std::io::Result<Vec<u8>> {
    file::read_bytes(file, most)?
        .ok_or_else(|| std::io::Error::other(format!("it is larger than {most} bytes")))
}

/// Loads every buffer; one without a source has no data.
pub(super) fn buffers(
    root: &Cursor<'_>,
    folder: &Path,
    container: &mut Container,
) -> Result<Vec<Option<Vec<u8>>>, SceneError> {
    let mut total = 0_u64;
    let mut buffers = Vec::new();
    for (index, buffer) in root.list("buffers")?.iter().enumerate() {
        let length = buffer.require("byteLength")?;
        let declared = length.integer()?;
        total = total.saturating_add(declared);
        if declared == 0 || total > MOST {
            return Err(length.error(format!("1 to {MOST} is accepted, for all buffers together")));
        }
        let mut bytes = match buffer.get("uri")? {
            Some(uri) => load(&uri, folder)?,
            None if index == 0 && container.glb => match container.bin.take() {
                Some(bin) => bin,
                None => {
                    return Err(buffer.fault(
                        "buffer 0 without data",
                        "a 'uri' or the BIN chunk of the GLB is required",
                    ));
                }
            },
            None => {
                buffers.push(None);
                continue;
            }
        };
        let declared = usize::try_from(declared).unwrap_or(usize::MAX);
        if bytes.len() < declared {
            return Err(length.error(format!("its data has {} bytes", bytes.len())));
        }
        bytes.truncate(declared);
        buffers.push(Some(bytes));
    }
    Ok(buffers)
}

/// Loads the bytes that a URI refers to.
fn load(uri: &Cursor<'_>, folder: &Path) -> Result<Vec<u8>, SceneError> {
    let text = uri.text()?;
    if text.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        return data(text).ok_or_else(|| uri.error("a data URI in base64 is accepted"));
    }
    let path = contained(text, folder).map_err(|why| uri.error(why))?;
    read_file(&path, MOST).map_err(|error| {
        let mut report = uri.error(format!("it could not be read: {error}"));
        report.unreadable = true;
        report
    })
}

/// Returns the file inside `folder` that a relative URI names.
///
/// # Errors
/// The reason why it is refused.
pub fn contained(uri: &str, folder: &Path) -> Result<PathBuf, String> {
    const INSIDE: &str = "a relative path to a file inside the folder of the glTF is accepted";
    let decoded = percent(uri).ok_or("a percent-encoded path in UTF-8 is accepted")?;
    let relative = Path::new(&decoded);
    if relative.components().any(|c| c == Component::ParentDir) {
        return Err(INSIDE.into());
    }
    file::inside(&decoded, folder, folder, "the glTF")
}

fn percent(text: &str) -> Option<String> {
    let mut decoded = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(byte) = bytes.next() {
        if byte == b'%' {
            let high = char::from(bytes.next()?).to_digit(16)?;
            let low = char::from(bytes.next()?).to_digit(16)?;
            decoded.push(u8::try_from((high << 4) | low).ok()?);
        } else {
            decoded.push(byte);
        }
    }
    String::from_utf8(decoded).ok()
}

/// Decodes a base64 data URI.
fn data(uri: &str) -> Option<Vec<u8>> {
    let (head, body) = uri.split_once(',')?;
    if !head.to_ascii_lowercase().ends_with(";base64") {
        return None;
    }
    let body = body.trim_end_matches('=');
    let mut bytes = Vec::with_capacity(body.len());
    let (mut held, mut bits) = (0_u32, 0_u32);
    for symbol in body.bytes() {
        let value = match symbol {
            b'A'..=b'Z' => symbol.wrapping_sub(b'A'),
            b'a'..=b'z' => symbol.wrapping_sub(b'a').wrapping_add(26),
            b'0'..=b'9' => symbol.wrapping_sub(b'0').wrapping_add(52),
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        held = (held << 6) | u32::from(value);
        bits = bits.saturating_add(6);
        if bits >= 8 {
            bits = bits.saturating_sub(8);
            bytes.push((held >> bits) as u8);
            held &= (1_u32 << bits).wrapping_sub(1);
        }
    }
    Some(bytes)
}
