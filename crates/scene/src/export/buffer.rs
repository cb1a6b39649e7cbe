//! Appends binary data to a glTF document, and writes both as `.glb`.

use std::io::{self, Write};

use serde_json::{Value, json};

/// A glTF document with one of its buffers, to which data is appended.
pub struct GltfBuffer<'a> {
    /// The document.
    pub document: &'a mut Value,
    /// Bytes of the buffer.
    pub bytes: &'a mut Vec<u8>,
    /// Index of the buffer in the document; it is created if it is one past the last.
    pub buffer: usize,
}

/// Purpose of the data of a buffer view.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// Anything but vertices.
    Data,
    /// Vertex attributes.
    Vertices,
    /// Vertex indices.
    Indices,
}

impl GltfBuffer<'_> {
    /// Appends an item to a list of the document and returns its index.
    pub fn push(&mut self, list: &str, item: Value) -> usize {
        if !self.document.is_object() {
            *self.document = json!({});
        }
        let list = &mut self.document[list];
        if !list.is_array() {
            *list = json!([]);
        }
        let items = list.as_array_mut().map_or(0, |items| {
            items.push(item);
            items.len()
        });
        items - 1
    }

    /// Makes a node the child of another.
    pub(super) fn adopt(&mut self, parent: usize, child: usize) {
        let children = &mut self.document["nodes"][parent]["children"];
        match children.as_array_mut() {
            Some(children) => children.push(json!(child)),
            None => *children = json!([child]),
        }
    }

    /// Appends a view of these bytes, which starts at a multiple of 4, and returns its index.
    pub fn push_view(&mut self, data: &[u8], used_for: Use) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut view = json!({
            "buffer": self.buffer,
            "byteOffset": self.bytes.len(),
            "byteLength": data.len(),
        });
        match used_for {
            Use::Data => {}
            Use::Vertices => view["target"] = json!(34962),
            Use::Indices => view["target"] = json!(34963),
        }
        self.bytes.extend_from_slice(data);
        self.store_length();
        self.push("bufferViews", view)
    }

    fn store_length(&mut self) {
        let count = self.document["buffers"].as_array().map_or(0, Vec::len);
        if self.buffer == count {
            self.push("buffers", json!({}));
        }
        self.document["buffers"][self.buffer]["byteLength"] = json!(self.bytes.len());
    }

    /// Appends an accessor to floats in a view of their own. With `bounds`, it states the smallest
    /// and largest components.
    pub fn push_floats<const N: usize>(
        &mut self,
        data: &[[f32; N]],
        used_for: Use,
        bounds: bool,
    ) -> usize {
        let view = self.push_view(&float_bytes(data), used_for);
        self.push("accessors", float_accessor(view, 0, data, bounds))
    }

    /// Appends an accessor to vertex indices.
    pub fn push_indices(&mut self, data: &[u32]) -> usize {
        let short = data.iter().all(|index| *index < u32::from(u16::MAX));
        let bytes: Vec<u8> = if short {
            data.iter().flat_map(|index| (*index as u16).to_le_bytes()).collect()
        } else {
            data.iter().flat_map(|index| index.to_le_bytes()).collect()
        };
        let view = self.push_view(&bytes, Use::Indices);
        let component = if short { 5123 } else { 5125 };
        let accessor = json!({
            "bufferView": view,
            "componentType": component,
            "count": data.len(),
            "type": "SCALAR",
        });
        self.push("accessors", accessor)
    }

    /// Appends an accessor to colors of 4 bytes; 255 stands for 1.
    pub fn push_colors(&mut self, data: &[[u8; 4]]) -> usize {
        let view = self.push_view(data.as_flattened(), Use::Vertices);
        let accessor = json!({
            "bufferView": view,
            "componentType": 5121,
            "normalized": true,
            "count": data.len(),
            "type": "VEC4",
        });
        self.push("accessors", accessor)
    }
}

/// Returns floats as little-endian bytes.
pub fn float_bytes<const N: usize>(data: &[[f32; N]]) -> Vec<u8> {
    data.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Returns an accessor to floats in a view. With `bounds`, it states the smallest and largest
/// components.
pub fn float_accessor<const N: usize>(
    view: usize,
    offset: usize,
    data: &[[f32; N]],
    bounds: bool,
) -> Value {
    let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
    let mut accessor = json!({
        "bufferView": view,
        "byteOffset": offset,
        "componentType": 5126,
        "count": data.len(),
        "type": kind,
    });
    if bounds {
        let fold = |start: f32, pick: fn(f32, f32) -> f32| {
            let mut bound = [start; N];
            data.iter().for_each(|x| (0..N).for_each(|i| bound[i] = pick(bound[i], x[i])));
            json!(bound.map(f64::from).to_vec())
        };
        accessor["min"] = fold(f32::INFINITY, f32::min);
        accessor["max"] = fold(f32::NEG_INFINITY, f32::max);
    }
    accessor
}

/// Writes a document and its first buffer as `.glb`.
///
/// # Errors
/// If the system refuses, or the file would exceed the 4 GiB that the format can hold.
pub fn write_glb(out: &mut dyn Write, document: &Value, buffer: &[u8]) -> io::Result<()> {
    let mut text = serde_json::to_vec(document)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let padding = buffer.len().next_multiple_of(4) - buffer.len();
    let mut total = 12 + 8 + text.len();
    if !buffer.is_empty() {
        total += 8 + buffer.len() + padding;
    }
    let size = |length: usize| {
        u32::try_from(length).map(u32::to_le_bytes).map_err(|_| {
            io::Error::new(io::ErrorKind::InvalidData, "a .glb file cannot exceed 4 GiB")
        })
    };
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&size(total)?)?;
    out.write_all(&size(text.len())?)?;
    out.write_all(b"JSON")?;
    out.write_all(&text)?;
    if !buffer.is_empty() {
        out.write_all(&size(buffer.len() + padding)?)?;
        out.write_all(b"BIN\0")?;
        out.write_all(buffer)?;
        out.write_all(&[0; 3][..padding])?;
    }
    Ok(())
}
