//! GLB container: a header, a chunk with the document, and optionally one with the bytes of a
//! buffer.

use std::path::Path;

use serde_json::Value;

use super::json::{parse, reason};
use crate::error::{Place, SceneError, Warning};

/// Lengths of the file header and of a chunk header. \[byte\]
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;

/// Returns the document of a GLB and its binary chunk.
pub(super) fn read(
    file: &Path,
    bytes: &[u8],
    warnings: &mut Vec<Warning>,
) -> Result<(Value, Option<Vec<u8>>), SceneError> {
    let glb = Glb { file, bytes };
    let end = glb.header(warnings)?;
    let (mut document, mut bin) = (None, None);
    let (mut chunks, mut offset) = (0_usize, HEADER);
    while offset < end {
        let (kind, chunk, stop) = glb.chunk(offset, end)?;
        match (&kind.to_le_bytes(), chunks) {
            (b"JSON", 0) => document = Some(glb.document(chunk, offset)?),
            (b"BIN\0", 1) => bin = Some(chunk.to_vec()),
            (b"JSON", _) | (b"BIN\0", _) => {
                let order = "one JSON chunk, then at most one BIN chunk are accepted";
                let kind = String::from_utf8_lossy(&kind.to_le_bytes()).into_owned();
                let at = offset.saturating_add(4);
                return Err(glb.wrong(at, "type of a GLB chunk", format!("{kind:?}"), order));
            }
            (_, 0) => {
                let (at, item) = (offset.saturating_add(4), "type of the first GLB chunk");
                return Err(glb.wrong(at, item, format!("{kind:#x}"), "JSON is accepted"));
            }
            _ => {}
        }
        chunks = chunks.saturating_add(1);
        offset = stop;
    }
    let none = || glb.wrong(HEADER, "GLB without a JSON chunk", String::new(), "one is required");
    Ok((document.ok_or_else(none)?, bin))
}

/// A file that is being parsed.
struct Glb<'a> {
    file: &'a Path,
    bytes: &'a [u8],
}

impl<'a> Glb<'a> {
    fn wrong(&self, offset: usize, item: &str, value: String, accepted: &str) -> SceneError {
        SceneError {
            file: self.file.to_path_buf(),
            place: Place::Byte(offset as u64),
            item: item.into(),
            value,
            accepted: accepted.into(),
            unreadable: false,
        }
    }

    /// Returns the error that an item is cut off by the end of the file.
    fn cut(&self, offset: usize, item: &str) -> SceneError {
        let item = format!("{item}, cut off by the end of the file");
        self.wrong(offset, &item, String::new(), &self.size())
    }

    fn size(&self) -> String {
        format!("the file has {} bytes", self.bytes.len())
    }

    fn word(&self, offset: usize) -> Option<u32> {
        let slice = self.bytes.get(offset..offset.checked_add(4)?)?;
        Some(u32::from_le_bytes(slice.try_into().ok()?))
    }

    /// Checks the header and returns the offset at which the GLB ends.
    fn header(&self, warnings: &mut Vec<Warning>) -> Result<usize, SceneError> {
        let bytes = self.bytes;
        if !bytes.starts_with(b"glTF") {
            if b"glTF".starts_with(bytes) {
                return Err(self.cut(bytes.len(), "GLB header"));
            }
            let magic = String::from_utf8_lossy(bytes.get(..4).unwrap_or(bytes)).into_owned();
            let accepted = "\"glTF\" is accepted";
            return Err(self.wrong(0, "magic of the GLB", format!("{magic:?}"), accepted));
        }
        let version = self.word(4).ok_or_else(|| self.cut(4, "version in the GLB header"))?;
        if version != 2 {
            let (item, value) = ("version of the GLB", version.to_string());
            return Err(self.wrong(4, item, value, "2 is accepted"));
        }
        let declared = self.word(8).ok_or_else(|| self.cut(8, "length in the GLB header"))?;
        let end = declared as usize;
        if end > bytes.len() {
            let (item, value) = ("length of the GLB", declared.to_string());
            return Err(self.wrong(8, item, value, &self.size()));
        }
        if end < bytes.len() {
            warnings.push(Warning {
                place: Place::Byte(end as u64),
                message: format!("{} bytes after the GLB are ignored", bytes.len().abs_diff(end)),
            });
        }
        Ok(end)
    }

    /// Returns the type and the bytes of the chunk at `offset`, and the offset of its end.
    fn chunk(&self, offset: usize, end: usize) -> Result<(u32, &'a [u8], usize), SceneError> {
        let start = offset.saturating_add(CHUNK_HEADER);
        let words = [offset, offset.saturating_add(4)].map(|at| self.word(at));
        let [Some(length), Some(kind)] = words else {
            return Err(self.cut(offset, "header of a GLB chunk"));
        };
        let stop = start.saturating_add(length as usize);
        let chunk = self.bytes.get(start..stop).filter(|_| stop <= end).ok_or_else(|| {
            let left = format!("{} bytes are left in the file", end.saturating_sub(start));
            self.wrong(offset, "length of a GLB chunk", length.to_string(), &left)
        })?;
        Ok((kind, chunk, stop))
    }

    /// Parses the document in the chunk at `offset`.
    fn document(&self, chunk: &[u8], offset: usize) -> Result<Value, SceneError> {
        parse(chunk).map_err(|error| {
            let within = byte_of(chunk, error.line(), error.column());
            let at = offset.saturating_add(CHUNK_HEADER).saturating_add(within);
            let item = format!("JSON: {}", reason(&error));
            let accepted = "a glTF 2.0 document in UTF-8 is accepted";
            self.wrong(at, &item, String::new(), accepted)
        })
    }
}

/// Returns the offset of a line and column, both from 1.
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
