//! Typed access to the tree: each query returns a value, or an error that names the item.

use std::cell::RefCell;
use std::fmt::{self, Display};

use super::tree::{Text, Tree, TreeEntry, TreeNode, one_line};
use crate::description::Rotation;
use crate::error::{Place, SceneError, Warning};

/// Data shared by one walk over a file.
pub(super) struct ReadContext<'a> {
    pub(super) text: Text<'a>,
    pub(super) json: bool,
    pub(super) warnings: RefCell<Vec<Warning>>,
}

/// Path from the root to a value, for JSON pointers.
#[derive(Clone, Copy)]
pub(super) struct ValuePath<'a> {
    parent: Option<&'a ValuePath<'a>>,
    step: Step<'a>,
}

#[derive(Clone, Copy)]
enum Step<'a> {
    Root,
    Key(&'a str),
    Index(usize),
}

/// A value with its name and owner as messages show them: `radius` of `shape 0 of body 'ball'`.
#[derive(Clone, Copy)]
pub(super) struct FieldCursor<'a> {
    walk: &'a ReadContext<'a>,
    pub(super) node: &'a TreeNode<'a>,
    path: ValuePath<'a>,
    name: &'a str,
    owner: &'a dyn Display,
}

/// A table and the keys that it may contain.
pub(super) struct TableCursor<'a> {
    walk: &'a ReadContext<'a>,
    start: usize,
    entries: &'a [TreeEntry<'a>],
    path: ValuePath<'a>,
    owner: &'a dyn Display,
    keys: &'static [&'static str],
}

/// Range of accepted numbers.
pub(super) struct Range {
    pub(super) min: f64,
    pub(super) max: f64,
    /// True if infinity is accepted as well, with either sign if `min` is negative.
    pub(super) infinite: bool,
    pub(super) unit: &'static str,
}

pub(super) const VELOCITY: Range = Range::new(-1e6, 1e6, "m/s");
pub(super) const SPIN: Range = Range::new(-1e6, 1e6, "rad/s");

impl Range {
    pub(super) const fn new(min: f64, max: f64, unit: &'static str) -> Self {
        Self { min, max, infinite: false, unit }
    }

    pub(super) const fn or_infinite(self) -> Self {
        Self { infinite: true, ..self }
    }

    fn contains(&self, x: f64) -> bool {
        let below = self.min < 0.0 && x == f64::NEG_INFINITY;
        (self.min <= x && x <= self.max) || (self.infinite && (below || x == f64::INFINITY))
    }
}

impl Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "from {} to {}", Number(self.min), Number(self.max))?;
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        match (self.infinite, self.min < 0.0) {
            (false, _) => Ok(()),
            (true, false) => write!(f, ", or inf"),
            (true, true) => write!(f, ", or -inf, or inf"),
        }
    }
}

/// A count of numbers and their range, for messages.
#[derive(Clone, Copy)]
struct Numbers<'a>(usize, &'a Range);

impl Display for Numbers<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Infinity is accepted for each of them, not instead of the list.
        let each = if self.1.infinite { ", each" } else { "" };
        write!(f, "{} numbers{each} {}", self.0, self.1)
    }
}

/// A number formatted for a message.
pub(super) struct Number(pub(super) f64);

impl Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Single precision is shorter, and enough for a message.
        let x = self.0 as f32;
        if x == 0.0 || (1e-3..1e6).contains(&x.abs()) {
            write!(f, "{x}")
        } else {
            write!(f, "{x:e}")
        }
    }
}

impl<'a> ReadContext<'a> {
    pub(super) fn place(&self, start: usize, path: &ValuePath<'_>) -> Place {
        match path.pointer() {
            _ if !self.json => self.text.line_at(start),
            root if root.is_empty() => Place::File,
            pointer => Place::Pointer(pointer),
        }
    }

    pub(super) fn root(
        &'a self,
        node: &'a TreeNode<'a>,
        owner: &'a dyn Display,
    ) -> FieldCursor<'a> {
        let path = ValuePath { parent: None, step: Step::Root };
        FieldCursor { walk: self, node, path, name: "the scene", owner }
    }
}

impl ValuePath<'_> {
    fn pointer(&self) -> String {
        let mut steps = Vec::new();
        let mut path = Some(self);
        while let Some(ValuePath { parent, step }) = path {
            match step {
                Step::Root => {}
                Step::Key(key) => {
                    steps.push(one_line(key).replace('~', "~0").replace('/', "~1"));
                }
                Step::Index(index) => steps.push(index.to_string()),
            }
            path = *parent;
        }
        steps.iter().rev().map(|step| format!("/{step}")).collect()
    }
}

impl<'a> FieldCursor<'a> {
    fn item(&self) -> String {
        item(self.name, self.owner)
    }

    /// Returns the error that this value is not one of those accepted.
    pub(super) fn refuse(&self, accepted: impl Display) -> SceneError {
        self.refuse_value(self.node.value.to_string(), accepted)
    }

    pub(super) fn refuse_value(&self, value: String, accepted: impl Display) -> SceneError {
        SceneError {
            file: self.walk.text.file.to_owned(),
            place: self.walk.place(self.node.start, &self.path),
            item: self.item(),
            value,
            accepted: format!("accepted: {accepted}"),
            unreadable: false,
        }
    }

    /// Adds the warning that this value has no effect, or another one than expected.
    pub(super) fn warn(&self, what: impl Display) {
        self.warn_of(&self.item(), what);
    }

    /// Adds a warning about this value, which messages call `item`.
    pub(super) fn warn_of(&self, item: &str, what: impl Display) {
        let place = self.walk.place(self.node.start, &self.path);
        let message = format!("{item} {what}");
        self.walk.warnings.borrow_mut().push(Warning { place, message });
    }

    fn number(&self) -> Option<f64> {
        match &self.node.value {
            Tree::Integer(value) => Some(*value as f64),
            Tree::Float(value) => Some(*value),
            // JSON has no infinity.
            Tree::Text(text) if text == "inf" => Some(f64::INFINITY),
            Tree::Text(text) if text == "-inf" => Some(f64::NEG_INFINITY),
            _ => None,
        }
    }

    pub(super) fn real(&self, range: &Range) -> Result<f64, SceneError> {
        match self.number() {
            Some(x) if range.contains(x) => Ok(x),
            _ => Err(self.refuse(format_args!("a number {range}"))),
        }
    }

    pub(super) fn whole(&self, max: u32) -> Result<u32, SceneError> {
        match &self.node.value {
            Tree::Integer(x) => u32::try_from(*x).ok().filter(|x| *x <= max),
            _ => None,
        }
        .ok_or_else(|| self.refuse(format_args!("a whole number from 0 to {max}")))
    }

    pub(super) fn text(&self) -> Result<&'a str, SceneError> {
        match &self.node.value {
            Tree::Text(text) => Ok(text),
            _ => Err(self.refuse("a text")),
        }
    }

    pub(super) fn choice<T: Copy>(&self, choices: &[(&str, T)]) -> Result<T, SceneError> {
        let text = match &self.node.value {
            Tree::Text(text) => text.as_ref(),
            _ => "",
        };
        let found = choices.iter().find(|(name, _)| *name == text);
        found.map(|(_, value)| *value).ok_or_else(|| {
            let names: Vec<_> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
            self.refuse(names.join(", "))
        })
    }

    /// Returns the items of a list; messages give each the name of the list.
    pub(super) fn items<'b, D: Display>(
        &'b self,
        accepted: D,
    ) -> Result<impl ExactSizeIterator<Item = FieldCursor<'b>> + use<'a, 'b, D>, SceneError> {
        let Tree::Array(nodes) = &self.node.value else {
            return Err(self.refuse(accepted));
        };
        Ok(nodes.iter().enumerate().map(|(index, node)| FieldCursor {
            walk: self.walk,
            node,
            path: ValuePath { parent: Some(&self.path), step: Step::Index(index) },
            name: self.name,
            owner: self.owner,
        }))
    }

    pub(super) fn vector(&self, n: usize, range: &Range) -> Result<Vec<f64>, SceneError> {
        let accepted = Numbers(n, range);
        let items = self.items(accepted)?;
        let numbers: Option<Vec<f64>> =
            items.map(|x| x.number().filter(|x| range.contains(*x))).collect();
        numbers.filter(|x| x.len() == n).ok_or_else(|| self.refuse(accepted))
    }

    /// Reads a vector of length 1. A length within 1e-3 of 1 is normalized.
    pub(super) fn unit(&self, n: usize) -> Result<Vec<f64>, SceneError> {
        let refuse = || {
            self.refuse(format_args!("{n} numbers that make a vector of length 1 (within 1e-3)"))
        };
        let mut x = self.vector(n, &Range::new(-2.0, 2.0, "")).map_err(|_| refuse())?;
        let square: f64 = x.iter().map(|x| x * x).sum();
        let length = square.sqrt();
        if (length - 1.0).abs() > 1e-3 {
            return Err(refuse());
        }
        // A vector whose length is 1 up to rounding stays as written, so that it survives a round
        // trip.
        if (square - 1.0).abs() > 8.0 * f64::EPSILON {
            x.iter_mut().for_each(|x| *x /= length);
        }
        Ok(x)
    }

    pub(super) fn quaternion(&self) -> Result<[f64; 4], SceneError> {
        let x = self.unit(4)?;
        x.try_into().map_err(|_| self.refuse("4 numbers"))
    }

    pub(super) fn rotation(&self, dimension: usize) -> Result<Rotation, SceneError> {
        if dimension == 3 {
            return self.quaternion().map(Rotation::Quaternion);
        }
        self.real(&Range::new(-1e6, 1e6, "rad")).map(Rotation::Angle)
    }

    /// Returns the entries of a table with arbitrary keys.
    pub(super) fn named<'b>(
        &'b self,
    ) -> Result<impl Iterator<Item = (&'b str, FieldCursor<'b>)>, SceneError> {
        let Tree::Table(entries) = &self.node.value else {
            return Err(self.refuse("a table"));
        };
        Ok(entries.iter().map(|entry| {
            let path = ValuePath { parent: Some(&self.path), step: Step::Key(&entry.key) };
            let node = &entry.node;
            let name = entry.key.as_ref();
            (name, FieldCursor { walk: self.walk, node, path, name, owner: &self.name })
        }))
    }

    /// Opens a table and checks that it contains no keys except `keys`.
    pub(super) fn table<'b>(
        &'b self,
        keys: &'static [&'static str],
        owner: &'b dyn Display,
    ) -> Result<TableCursor<'b>, SceneError> {
        let table = self.open(keys, owner)?;
        table.check_keys(|_| None)?;
        Ok(table)
    }

    /// Opens a table without checking its keys, where they depend on its contents.
    pub(super) fn open<'b>(
        &'b self,
        keys: &'static [&'static str],
        owner: &'b dyn Display,
    ) -> Result<TableCursor<'b>, SceneError> {
        let Tree::Table(entries) = &self.node.value else {
            return Err(self.refuse("a table"));
        };
        let (walk, start, path) = (self.walk, self.node.start, self.path);
        Ok(TableCursor { walk, start, entries, path, owner, keys })
    }

    pub(super) fn is_table(&self) -> bool {
        matches!(self.node.value, Tree::Table(_))
    }

    pub(super) fn boolean(&self) -> Result<bool, SceneError> {
        match self.node.value {
            Tree::Bool(value) => Ok(value),
            _ => Err(self.refuse("true or false")),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        match &self.node.value {
            Tree::Array(items) => items.is_empty(),
            Tree::Table(entries) => entries.is_empty(),
            Tree::Null => true,
            _ => false,
        }
    }
}

impl<'a> TableCursor<'a> {
    /// Refuses keys that the table may not contain. `owner_of` says where else a key belongs.
    pub(super) fn check_keys(
        &self,
        owner_of: impl Fn(&str) -> Option<String>,
    ) -> Result<(), SceneError> {
        match self.entries.iter().find(|entry| !self.keys.contains(&entry.key.as_ref())) {
            None => Ok(()),
            Some(entry) => {
                let nearest = || nearest_known(&entry.key, self.keys);
                Err(self.unknown(entry, owner_of(&entry.key).unwrap_or_else(nearest)))
            }
        }
    }

    fn unknown(&self, entry: &TreeEntry<'_>, accepted: String) -> SceneError {
        let path = ValuePath { parent: Some(&self.path), step: Step::Key(&entry.key) };
        let name = format!("unknown key '{}'", one_line(&entry.key));
        SceneError {
            file: self.walk.text.file.to_owned(),
            place: self.walk.place(entry.start, &path),
            item: item(&name, self.owner),
            value: String::new(),
            accepted,
            unreadable: false,
        }
    }

    /// Returns the name of a part of this table's owner, for messages.
    pub(super) fn nested(&self, part: String) -> String {
        item(&part, self.owner)
    }

    /// Returns true if `key` is one of the keys that this table may contain.
    pub(super) fn knows(&self, key: &str) -> bool {
        self.keys.contains(&key)
    }

    pub(super) fn get<'b>(&'b self, key: &'static str) -> Option<FieldCursor<'b>> {
        debug_assert!(self.keys.contains(&key), "{key} is not a key of {}", self.owner);
        let entry = self.entries.iter().find(|entry| entry.key == key)?;
        let path = ValuePath { parent: Some(&self.path), step: Step::Key(key) };
        Some(FieldCursor { walk: self.walk, node: &entry.node, path, name: key, owner: self.owner })
    }

    /// Returns the text under a key, if it is a text. Used to name the owner before anything is
    /// checked.
    pub(super) fn peek(&self, key: &str) -> Option<&'a str> {
        let entry = self.entries.iter().find(|entry| entry.key == key)?;
        match &entry.node.value {
            Tree::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(super) fn require<'b>(
        &'b self,
        key: &'static str,
        accepted: impl Display,
    ) -> Result<FieldCursor<'b>, SceneError> {
        self.get(key).ok_or_else(|| {
            let item = format!("{} is missing", item(key, self.owner));
            self.refuse(item, String::new(), format_args!("accepted: {accepted}"))
        })
    }

    /// Returns an error about the table as a whole.
    pub(super) fn refuse(&self, item: String, value: String, help: impl Display) -> SceneError {
        SceneError {
            file: self.walk.text.file.to_owned(),
            place: self.walk.place(self.start, &self.path),
            item,
            value,
            accepted: help.to_string(),
            unreadable: false,
        }
    }

    pub(super) fn real_or(
        &self,
        key: &'static str,
        range: &Range,
        default: f64,
    ) -> Result<f64, SceneError> {
        self.get(key).map_or(Ok(default), |field| field.real(range))
    }

    pub(super) fn vector_or(
        &self,
        key: &'static str,
        range: &Range,
        default: Vec<f64>,
    ) -> Result<Vec<f64>, SceneError> {
        self.get(key).map_or_else(|| Ok(default.clone()), |f| f.vector(default.len(), range))
    }
}

fn item(name: &str, owner: &dyn Display) -> String {
    let owner = owner.to_string();
    if owner.is_empty() { name.to_owned() } else { format!("{name} of {owner}") }
}

/// Returns the known key nearest to one that does not exist, as help in a message.
pub fn nearest_known<S: AsRef<str>>(key: &str, known: &[S]) -> String {
    let nearest = known.iter().map(AsRef::as_ref).min_by_key(|k| edit_distance(key, k));
    format!("the nearest known key is '{}'", nearest.unwrap_or(""))
}

/// Levenshtein distance: the number of insertions, deletions and replacements that turn `a` into
/// `b`.
fn edit_distance(a: &str, b: &str) -> usize {
    // Cut off beyond the length of any key: more letters cannot bring it nearer to one.
    let a: Vec<char> = a.chars().take(48).collect();
    let mut row: Vec<usize> = (0..=a.len()).collect();
    for (i, letter) in b.chars().enumerate() {
        let mut diagonal = i;
        let mut left = i.saturating_add(1);
        let mut next = vec![left];
        for (other, &above) in a.iter().zip(row.iter().skip(1)) {
            let replaced = diagonal.saturating_add(usize::from(*other != letter));
            left = replaced.min(left.min(above).saturating_add(1));
            diagonal = above;
            next.push(left);
        }
        row = next;
    }
    row.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edit_distance_counts_letters() {
        assert_eq!(edit_distance("frition", "friction"), 1);
        assert_eq!(edit_distance("", "mass"), 4);
        assert_eq!(edit_distance("kitten", "sitting"), 3);
    }
}
