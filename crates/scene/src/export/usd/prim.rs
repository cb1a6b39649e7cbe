//! Prims of a stage, and their text form.

use std::fmt::Display;
use std::io::{self, Write};

/// A prim to be written.
pub struct PrimWriter {
    /// Specifier and type.
    kind: String,
    name: String,
    /// Lines of metadata in the parentheses, except the schemas.
    pub metadata: Vec<String>,
    /// Applied API schemas.
    pub schemas: Vec<&'static str>,
    /// Attributes: type and name, and the value.
    attributes: Vec<(String, String)>,
    /// Prims below it.
    pub children: Vec<PrimWriter>,
}

impl PrimWriter {
    /// Returns a prim of a kind, without attributes.
    pub fn new(kind: &str, name: impl Into<String>) -> Self {
        Self::specified(format!("def {kind}"), name.into())
    }

    /// Returns opinions about a prim that a weaker layer defines; none at first.
    pub fn over(name: impl Into<String>) -> Self {
        Self::specified("over".to_owned(), name.into())
    }

    fn specified(kind: String, name: String) -> Self {
        let (metadata, schemas, attributes) = (Vec::new(), Vec::new(), Vec::new());
        Self { kind, name, metadata, schemas, attributes, children: Vec::new() }
    }

    /// Returns the opinions about a prim below this one, by its path relative to it. Adds those
    /// that are missing.
    pub fn over_at(&mut self, path: &str) -> &mut Self {
        let names = path.split('/').filter(|name| !name.is_empty());
        names.fold(self, |above, name| {
            // Paths arrive in their order, so the last child is the most likely one.
            let known = above.children.iter().rposition(|child| child.name == name);
            let at = known.unwrap_or_else(|| {
                above.children.push(Self::over(name));
                above.children.len() - 1
            });
            &mut above.children[at]
        })
    }

    /// Sets an attribute, given by type and name.
    pub fn set(&mut self, attribute: impl Into<String>, value: impl Display) {
        let (attribute, value) = (attribute.into(), value.to_string());
        match self.attributes.iter_mut().find(|(known, _)| *known == attribute) {
            Some((_, old)) => *old = value,
            None => self.attributes.push((attribute, value)),
        }
    }

    /// Sets position \[m\], rotation (x, y, z, w) and scale relative to the parent.
    pub fn place(&mut self, position: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) {
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

    /// Gives an attribute these samples by time code, or its constant value if there are none.
    pub fn follow(
        &mut self,
        attribute: &str,
        samples: impl Iterator<Item = (f64, String)>,
        constant: Option<String>,
    ) {
        let samples: String = samples.map(|(code, value)| format!("{code}: {value}, ")).collect();
        if !samples.is_empty() {
            // The value without a time stays that of the scene.
            self.set(format!("{attribute}.timeSamples"), format!("{{ {samples}}}"));
        } else if let Some(value) = constant {
            self.set(attribute, value);
        }
    }

    /// Writes the prim and all its children.
    ///
    /// # Errors
    /// The system refuses.
    pub fn write(&self, out: &mut dyn Write, depth: usize) -> io::Result<()> {
        let indent = "    ".repeat(depth);
        writeln!(out, "{indent}{} \"{}\" (", self.kind, self.name)?;
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
pub fn tuple(numbers: &[impl Display]) -> String {
    let numbers: Vec<_> = numbers.iter().map(ToString::to_string).collect();
    format!("({})", numbers.join(", "))
}

/// Formats items as [a, b, c].
pub fn list(items: impl Iterator<Item = impl Display>) -> String {
    let items: Vec<_> = items.map(|item| item.to_string()).collect();
    format!("[{}]", items.join(", "))
}

/// Quotes a string as USD requires.
pub fn quoted(text: &str) -> String {
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

/// Returns a vector in 3D: missing components are 0.
pub(super) fn space(vector: &[f64]) -> [f64; 3] {
    std::array::from_fn(|i| vector.get(i).copied().unwrap_or(0.0))
}
