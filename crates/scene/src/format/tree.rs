//! Syntax tree for both TOML and JSON, with the offset of every value.

use std::borrow::Cow;
use std::collections::HashSet;
use std::fmt;
use std::path::Path;

use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use toml::de::{DeTable, DeValue};

use crate::error::{Place, SceneError};

/// Source text that can convert an offset to a line and column for messages.
#[derive(Clone, Copy)]
pub(super) struct Text<'a> {
    pub(super) file: &'a Path,
    pub(super) text: &'a str,
}

/// A value and the offset at which it starts in the text. The offset is 0 in JSON, whose parser
/// does not report it.
pub(super) struct TreeNode<'a> {
    pub(super) start: usize,
    pub(super) value: Tree<'a>,
}

pub(super) enum Tree<'a> {
    Null,
    Bool(bool),
    Integer(i128),
    Float(f64),
    Text(Cow<'a, str>),
    Array(Vec<TreeNode<'a>>),
    Table(Vec<TreeEntry<'a>>),
}

pub(super) struct TreeEntry<'a> {
    pub(super) start: usize,
    pub(super) key: Cow<'a, str>,
    pub(super) node: TreeNode<'a>,
}

impl<'a> Text<'a> {
    /// Wraps a text without its leading byte order mark, if any.
    pub(super) fn new(file: &'a Path, text: &'a str) -> Self {
        Self { file, text: text.strip_prefix('\u{feff}').unwrap_or(text) }
    }

    pub(super) fn toml(self) -> Result<TreeNode<'a>, SceneError> {
        let document = DeTable::parse(self.text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            self.syntax("TOML", error.message(), self.line_at(at))
        })?;
        Ok(TreeNode { start: 0, value: self.toml_table(document.into_inner())? })
    }

    pub(super) fn json(self) -> Result<TreeNode<'a>, SceneError> {
        let mut parser = serde_json::Deserializer::from_str(self.text);
        let node = TreeNode::deserialize(&mut parser).and_then(|node| parser.end().map(|()| node));
        node.map_err(|error| {
            let full = error.to_string();
            let message = full.rsplit_once(" at line ").map_or(full.as_str(), |(start, _)| start);
            self.syntax("JSON", message, self.line_of_bytes(error.line(), error.column()))
        })
    }

    /// Returns line and column of an offset.
    pub(super) fn line_at(self, offset: usize) -> Place {
        let before = self.text.get(..offset).unwrap_or(self.text);
        let line = before.bytes().filter(|&b| b == b'\n').count().saturating_add(1);
        let last = before.rsplit('\n').next().unwrap_or("");
        Place::Line { line, column: last.chars().count().saturating_add(1) }
    }

    /// Returns the position in characters: serde_json counts columns in bytes.
    fn line_of_bytes(self, line: usize, column: usize) -> Place {
        let text = self.text.split('\n').nth(line.saturating_sub(1)).unwrap_or("");
        let before = text
            .get(..column.saturating_sub(1))
            .map_or(column, |s| s.chars().count().saturating_add(1));
        Place::Line { line: line.max(1), column: before.max(1) }
    }

    fn syntax(self, language: &str, message: &str, place: Place) -> SceneError {
        SceneError {
            file: self.file.to_owned(),
            place,
            item: format!("{language} syntax: {}", one_line(message)),
            value: String::new(),
            accepted: format!("the file must be valid {language}"),
            unreadable: false,
        }
    }

    fn toml_table(self, table: DeTable<'a>) -> Result<Tree<'a>, SceneError> {
        let entries = table.into_iter().map(|(key, value)| {
            Ok(TreeEntry {
                start: key.span().start,
                key: key.into_inner(),
                node: self.toml_value(value.span().start, value.into_inner())?,
            })
        });
        entries.collect::<Result<_, _>>().map(Tree::Table)
    }

    fn toml_value(self, start: usize, value: DeValue<'a>) -> Result<TreeNode<'a>, SceneError> {
        let value = match value {
            DeValue::String(text) => Tree::Text(text),
            DeValue::Boolean(value) => Tree::Bool(value),
            DeValue::Datetime(time) => Tree::Text(Cow::Owned(time.to_string())),
            DeValue::Integer(number) => {
                match i128::from_str_radix(number.as_str(), number.radix()) {
                    Ok(number) => Tree::Integer(number),
                    Err(_) => return Err(self.too_large(start, &number.to_string())),
                }
            }
            DeValue::Float(number) => match number.as_str().parse::<f64>() {
                Ok(value) if !value.is_infinite() || number.as_str().contains("inf") => {
                    Tree::Float(value)
                }
                _ => return Err(self.too_large(start, number.as_str())),
            },
            DeValue::Array(items) => {
                let items = items.into_iter();
                let nodes = items.map(|v| self.toml_value(v.span().start, v.into_inner()));
                Tree::Array(nodes.collect::<Result<_, _>>()?)
            }
            DeValue::Table(table) => self.toml_table(table)?,
        };
        Ok(TreeNode { start, value })
    }

    fn too_large(self, start: usize, number: &str) -> SceneError {
        let message = format!("the number {} is too large", shorten(number));
        self.syntax("TOML", &message, self.line_at(start))
    }
}

/// Returns text from a file shortened and without control characters, for one line of a message.
pub(super) fn one_line(text: &str) -> String {
    let printable = |c: char| if c.is_control() { ' ' } else { c };
    shorten(&text.chars().take(MESSAGE + 1).map(printable).collect::<String>())
}

const MESSAGE: usize = 120;

fn shorten(text: &str) -> String {
    match text.char_indices().nth(MESSAGE) {
        Some((end, _)) => format!("{}...", text.get(..end).unwrap_or("")),
        None => text.to_owned(),
    }
}

/// Displays the value as it would be written in the file, shortened.
impl fmt::Display for Tree<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Tree::Null => write!(f, "null"),
            Tree::Bool(value) => write!(f, "{value}"),
            Tree::Integer(value) => write!(f, "{value}"),
            Tree::Float(value) if value.is_nan() => write!(f, "nan"),
            Tree::Float(value) => write!(f, "{value:?}"),
            Tree::Text(text) => write!(f, "\"{}\"", one_line(text)),
            Tree::Array(items) => write_list(f, items, 2),
            Tree::Table(_) => write!(f, "a table"),
        }
    }
}

/// Writes the first four items of a list, and of lists in it up to this depth.
fn write_list(f: &mut fmt::Formatter<'_>, items: &[TreeNode<'_>], depth: u32) -> fmt::Result {
    let Some(deeper) = depth.checked_sub(1) else {
        return write!(f, "[{} items]", items.len());
    };
    write!(f, "[")?;
    for (i, item) in items.iter().take(4).enumerate() {
        write!(f, "{}", if i > 0 { ", " } else { "" })?;
        match &item.value {
            Tree::Array(inner) => write_list(f, inner, deeper)?,
            other => write!(f, "{other}")?,
        }
    }
    write!(f, "{}]", if items.len() > 4 { ", ..." } else { "" })
}

impl<'de> Deserialize<'de> for TreeNode<'de> {
    fn deserialize<D: Deserializer<'de>>(parser: D) -> Result<Self, D::Error> {
        let value = parser.deserialize_any(TreeVisitor)?;
        Ok(TreeNode { start: 0, value })
    }
}

struct TreeVisitor;

impl<'de> Visitor<'de> for TreeVisitor {
    type Value = Tree<'de>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a value")
    }

    fn visit_unit<E: Error>(self) -> Result<Tree<'de>, E> {
        Ok(Tree::Null)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Tree<'de>, E> {
        Ok(Tree::Bool(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Tree<'de>, E> {
        Ok(Tree::Integer(value.into()))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Tree<'de>, E> {
        Ok(Tree::Integer(value.into()))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Tree<'de>, E> {
        Ok(Tree::Float(value))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Tree<'de>, E> {
        Ok(Tree::Text(Cow::Owned(text.to_owned())))
    }

    fn visit_borrowed_str<E: Error>(self, text: &'de str) -> Result<Tree<'de>, E> {
        Ok(Tree::Text(Cow::Borrowed(text)))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Tree<'de>, A::Error> {
        let mut nodes = Vec::new();
        while let Some(node) = items.next_element()? {
            nodes.push(node);
        }
        Ok(Tree::Array(nodes))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Tree<'de>, A::Error> {
        let mut entries = Vec::new();
        let mut seen = HashSet::new();
        while let Some(KeyText(key)) = map.next_key()? {
            if !seen.insert(key.clone()) {
                return Err(A::Error::custom(format!("duplicate key \"{}\"", one_line(&key))));
            }
            entries.push(TreeEntry { start: 0, key, node: map.next_value()? });
        }
        Ok(Tree::Table(entries))
    }
}

struct KeyText<'a>(Cow<'a, str>);

impl<'de> Deserialize<'de> for KeyText<'de> {
    fn deserialize<D: Deserializer<'de>>(parser: D) -> Result<Self, D::Error> {
        struct KeyVisitor;
        impl<'de> Visitor<'de> for KeyVisitor {
            type Value = KeyText<'de>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a key")
            }
            fn visit_str<E: Error>(self, text: &str) -> Result<KeyText<'de>, E> {
                Ok(KeyText(Cow::Owned(text.to_owned())))
            }
            fn visit_borrowed_str<E: Error>(self, text: &'de str) -> Result<KeyText<'de>, E> {
                Ok(KeyText(Cow::Borrowed(text)))
            }
        }
        parser.deserialize_str(KeyVisitor)
    }
}
