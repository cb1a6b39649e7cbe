//! The file as bytes: GLB chunks, the JSON text, buffers and where they come from.

use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use super::super::error::{Place, SceneError, Warning};
use super::super::file;
use super::json::{Cursor, parse};

/// Most bytes that a file, or all buffers together, may have.
const MOST: u64 = 2 << 30;

/// A file taken apart.
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
        return open_glb(file, &bytes, warnings);
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

/// What went wrong, without the line and column that the place already says.
fn reason(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.split(" at line ").next().unwrap_or(&text).to_string()
}

fn read_file(file: &Path, most: u64) -> std::io::Result<Vec<u8>> {
    file::read_bytes(file, most)?
        .ok_or_else(|| std::io::Error::other(format!("it is larger than {most} bytes")))
}

fn open_glb(
    file: &Path,
    bytes: &[u8],
    warnings: &mut Vec<Warning>,
) -> Result<Container, SceneError> {
    let wrong = |offset: usize, item: &str, value: String, accepted: String| SceneError {
        file: file.to_path_buf(),
        place: Place::Byte(offset as u64),
        item: item.into(),
        value,
        accepted,
        unreadable: false,
    };
    let word = |offset: usize| -> Option<u32> {
        let slice = bytes.get(offset..offset.checked_add(4)?)?;
        Some(u32::from_le_bytes(slice.try_into().ok()?))
    };
    let cut = |offset: usize, item: &str| {
        wrong(
            offset,
            &format!("{item}, cut off by the end of the file"),
            String::new(),
            format!("the file has {} bytes", bytes.len()),
        )
    };
    if !bytes.starts_with(b"glTF") {
        return Err(if b"glTF".starts_with(bytes) {
            cut(bytes.len(), "GLB header")
        } else {
            let magic = String::from_utf8_lossy(bytes.get(..4).unwrap_or(bytes)).into_owned();
            wrong(0, "magic of the GLB", format!("{magic:?}"), "\"glTF\" is accepted".into())
        });
    }
    let version = word(4).ok_or_else(|| cut(4, "version in the GLB header"))?;
    if version != 2 {
        return Err(wrong(4, "version of the GLB", version.to_string(), "2 is accepted".into()));
    }
    let declared = word(8).ok_or_else(|| cut(8, "length in the GLB header"))?;
    let end = declared as usize;
    if end > bytes.len() {
        let has = format!("the file has {} bytes", bytes.len());
        return Err(wrong(8, "length of the GLB", declared.to_string(), has));
    }
    if end < bytes.len() {
        warnings.push(Warning {
            place: Place::Byte(end as u64),
            message: format!("{} bytes after the GLB are ignored", bytes.len().abs_diff(end)),
        });
    }

    let mut document = None;
    let mut bin = None;
    let mut chunks = 0_usize;
    let mut offset = 12_usize;
    while offset < end {
        let payload = offset.saturating_add(8);
        let (Some(length), Some(kind)) = (word(offset), word(offset.saturating_add(4))) else {
            return Err(cut(offset, "header of a GLB chunk"));
        };
        let stop = payload.saturating_add(length as usize);
        let chunk = bytes.get(payload..stop).filter(|_| stop <= end).ok_or_else(|| {
            let left = end.saturating_sub(payload);
            let room = format!("{left} bytes are left in the file");
            wrong(offset, "length of a GLB chunk", length.to_string(), room)
        })?;
        match (&kind.to_le_bytes(), chunks) {
            (b"JSON", 0) => {
                document = Some(parse(chunk).map_err(|error| {
                    let at = payload.saturating_add(byte_of(chunk, error.line(), error.column()));
                    let accepted = "a glTF 2.0 document in UTF-8 is accepted";
                    let item = format!("JSON: {}", reason(&error));
                    wrong(at, &item, String::new(), accepted.into())
                })?);
            }
            (b"BIN\0", 1) => bin = Some(chunk.to_vec()),
            (b"JSON", _) | (b"BIN\0", _) => {
                let order = "one JSON chunk, then at most one BIN chunk are accepted";
                let kind = String::from_utf8_lossy(&kind.to_le_bytes()).into_owned();
                let at = offset.saturating_add(4);
                return Err(wrong(at, "type of a GLB chunk", format!("{kind:?}"), order.into()));
            }
            (_, 0) => {
                let at = offset.saturating_add(4);
                let value = format!("{kind:#x}");
                return Err(wrong(
                    at,
                    "type of the first GLB chunk",
                    value,
                    "JSON is accepted".into(),
                ));
            }
            _ => {}
        }
        chunks = chunks.saturating_add(1);
        offset = stop;
    }
    let document = document.ok_or_else(|| {
        wrong(12, "GLB without a JSON chunk", String::new(), "one is required".into())
    })?;
    Ok(Container { document, bin, glb: true })
}

/// Offset of a line and column, both from 1.
fn byte_of(text: &[u8], line: usize, column: usize) -> usize {
    let start = match line.checked_sub(2) {
        None => 0,
        Some(skip) => text
            .iter()
            .enumerate()
            .filter(|(_, byte)| **byte == b'\n')
            .nth(skip)
            .map_or(0, |(at, _)| at.saturating_add(1)),
    };
    start.saturating_add(column.saturating_sub(1)).min(text.len())
}

/// Loads every buffer; a buffer that names no source has no data.
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

/// The bytes that a URI stands for.
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

/// The file inside of `folder` that a relative URI names, or why there is none.
pub(crate) fn contained(uri: &str, folder: &Path) -> Result<PathBuf, String> {
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

/// The bytes of a base64 data URI.
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
