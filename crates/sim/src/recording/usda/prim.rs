//! Prims of a stage, and their text form.

use std::fmt::{Display, Write as _};
use std::io::{self, Write};

use super::Track;

/// A prim to be written.
pub(super) struct Prim {
    kind: &'static str,
    name: String,
    /// Lines of metadata in the parentheses, except the schemas.
    pub(super) metadata: Vec<String>,
    /// Applied API schemas.
    pub(super) schemas: Vec<&'static str>,
    /// Attributes: type and name, and the value.
    attributes: Vec<(String, String)>,
    pub(super) children: Vec<Prim>,
}

impl Prim {
    pub(super) fn new(kind: &'static str, name: impl Into<String>) -> Self {
        let (metadata, schemas, attributes) = (Vec::new(), Vec::new(), Vec::new());
        Self { kind, name: name.into(), metadata, schemas, attributes, children: Vec::new() }
    }

    /// Sets an attribute, given by type and name.
    pub(super) fn set(&mut self, attribute: impl Into<String>, value: impl Display) {
        let (attribute, value) = (attribute.into(), value.to_string());
        match self.attributes.iter_mut().find(|(known, _)| *known == attribute) {
            Some((_, old)) => *old = value,
            None => self.attributes.push((attribute, value)),
        }
    }

    /// Sets position \[m\], rotation (x, y, z, w) and scale relative to the parent.
    pub(super) fn place(&mut self, position: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) {
        let [x, y, z, w] = rotation;
        let mut order = "\"xformOp:translate\", \"xformOp:orient\"".to_owned();
        self.set("double3 xformOp:translate", tuple(&position));
        self.set("quatd xformOp:orient", tuple(&[w, x, y, z]));
        if scale != [1.0; 3] {
            self.set("float3 xformOp:scale", tuple(&scale));
            order += ", \"xformOp:scale\"";
        }
        self.set("uniform token[] xformOpOrder", format!("[{order}]"));
    }

    /// Gives an attribute the samples of a track, or its constant value.
    pub(super) fn follow<const N: usize>(
        &mut self,
        attribute: &str,
        codes: &[f64],
        track: &Track<N>,
        text: impl Fn([f32; N]) -> String,
    ) {
        let mut samples = String::new();
        for (sample, value) in track.kept.iter().zip(&track.values) {
            let code = codes.get(*sample as usize).copied().unwrap_or(0.0);
            let _ = write!(samples, "{code}: {}, ", text(*value));
        }
        if !samples.is_empty() {
            // The value without a time stays that of the scene.
            self.set(format!("{attribute}.timeSamples"), format!("{{ {samples}}}"));
        } else if let Some(first) = track.first {
            self.set(attribute, text(first));
        }
    }

    /// Writes the prim and all its children.
    pub(super) fn write(&self, out: &mut dyn Write, depth: usize) -> io::Result<()> {
        let indent = "    ".repeat(depth);
        writeln!(out, "{indent}def {} \"{}\" (", self.kind, self.name)?;
        for line in &self.metadata {
            writeln!(out, "{indent}    {line}")?;
        }
        // USD does not allow an empty list.
        if !self.schemas.is_empty() {
            let schemas = list(self.schemas.iter().map(|name| format!("\"{name}\"")));
            writeln!(out, "{indent}    prepend apiSchemas = {schemas}")?;
        }
        writeln!(out, "{indent})\n{indent}{{")?;
        for (attribute, value) in &self.attributes {
            writeln!(out, "{indent}    {attribute} = {value}")?;
        }
        for child in &self.children {
            child.write(out, depth + 1)?;
        }
        writeln!(out, "{indent}}}")
    }
}

/// Formats numbers as (a, b, c).
pub(super) fn tuple(numbers: &[impl Display]) -> String {
    let numbers: Vec<_> = numbers.iter().map(ToString::to_string).collect();
    format!("({})", numbers.join(", "))
}

/// Formats items as [a, b, c].
pub(super) fn list(items: impl Iterator<Item = impl Display>) -> String {
    let items: Vec<_> = items.map(|item| item.to_string()).collect();
    format!("[{}]", items.join(", "))
}

/// Quotes a string as USD requires.
pub(super) fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            '\n' => out.push_str("\\n"),
            '\t' => out.push_str("\\t"),
            c if c.is_ascii_control() => out.extend(format!("\\x{:02x}", u32::from(c)).chars()),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out + "\""
}
