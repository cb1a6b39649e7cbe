//! A layer: what one file says.

use std::collections::BTreeMap;

use super::lexer::clipped;

/// What a file says, without what others add to it.
#[derive(Debug, Default)]
pub(super) struct Layer {
    pub(super) text: String,
    /// Its metadata and the prims at the top.
    pub(super) root: Spec,
    /// Prims that it speaks of.
    pub(super) prims: usize,
}

/// Whether a prim is made, spoken of, or a template.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Specifier {
    #[default]
    Over,
    Def,
    Class,
}

/// What a layer says of a prim.
#[derive(Debug, Default)]
pub(super) struct Spec {
    pub(super) at: usize,
    pub(super) specifier: Specifier,
    pub(super) kind: String,
    pub(super) metadata: BTreeMap<String, Vec<Entry>>,
    pub(super) properties: BTreeMap<String, Property>,
    /// In their order, with their names.
    pub(super) children: Vec<(String, Spec)>,
    places: BTreeMap<String, usize>,
    /// The variants of each set.
    pub(super) variants: BTreeMap<String, BTreeMap<String, Spec>>,
}

impl Spec {
    pub(super) fn new(at: usize, specifier: Specifier) -> Self {
        Self { at, specifier, ..Self::default() }
    }

    pub(super) fn child(&self, name: &str) -> Option<&Spec> {
        self.places.get(name).and_then(|place| self.children.get(*place)).map(|(_, spec)| spec)
    }

    /// Adds a child; false where there is one of this name.
    pub(super) fn adopt(&mut self, name: &str, spec: Spec) -> bool {
        let new = self.places.insert(name.to_owned(), self.children.len()).is_none();
        self.children.push((name.to_owned(), spec));
        new
    }

    /// The one value of some metadata.
    pub(super) fn metadata(&self, key: &str) -> Option<&Entry> {
        self.metadata.get(key).and_then(|entries| entries.last())
    }
}

/// How a list changes the lists of weaker layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Edit {
    Replace,
    Prepend,
    Append,
    Delete,
    /// Changes nothing here.
    Reorder,
}

/// Metadata.
#[derive(Debug)]
pub(super) struct Entry {
    pub(super) edit: Edit,
    pub(super) value: Value,
    pub(super) at: usize,
}

/// What a layer says of an attribute or a relationship.
#[derive(Debug, Default)]
pub(super) struct Property {
    pub(super) at: usize,
    pub(super) value: Option<Value>,
    /// By time code.
    pub(super) samples: Option<Vec<(f64, Value)>>,
    /// Of a relationship.
    pub(super) targets: Vec<Entry>,
}

/// Where an arc or a relationship leads.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Target {
    pub(super) asset: Option<String>,
    pub(super) path: String,
    pub(super) time: Time,
    pub(super) at: usize,
}

/// From the time codes of a layer to those of the layer that takes it in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Time {
    pub(super) offset: f64,
    pub(super) scale: f64,
}

impl Time {
    pub(super) const SAME: Self = Self { offset: 0.0, scale: 1.0 };

    /// `self` after `inner`.
    pub(super) fn after(self, inner: Self) -> Self {
        let offset = self.offset + self.scale * inner.offset;
        Self { offset, scale: self.scale * inner.scale }
    }
}

/// A value of an attribute or of metadata.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// `None`: nothing, whatever weaker layers say.
    Blocked,
    Number(f64),
    Text(String),
    /// A vector, a quaternion or a matrix.
    Tuple(Vec<f64>),
    /// A list of numbers; empty lists of anything.
    Numbers(Vec<f64>),
    /// A list of vectors of this many numbers.
    Tuples(usize, Vec<f64>),
    Texts(Vec<String>),
    Targets(Vec<Target>),
    Dictionary(Vec<(String, Value)>),
    /// What no reader of physics asks for.
    Other,
}

impl Value {
    /// As written, cut where it is long.
    pub(super) fn label(&self) -> String {
        let numbers = |numbers: &[f64]| {
            let texts: Vec<_> = numbers.iter().take(20).map(|x| format!("{x:?}")).collect();
            texts.join(", ")
        };
        clipped(&match self {
            Self::Blocked => "None".to_owned(),
            Self::Number(x) => format!("{x:?}"),
            Self::Text(text) => format!("{text:?}"),
            Self::Tuple(list) => format!("({})", numbers(list)),
            Self::Numbers(list) => format!("[{}]", numbers(list)),
            Self::Tuples(width, list) => {
                let first = list.chunks(*width).take(8).map(|item| format!("({})", numbers(item)));
                format!("[{}]", first.collect::<Vec<_>>().join(", "))
            }
            Self::Texts(list) => format!("{list:?}"),
            Self::Targets(list) => {
                let first = list.iter().take(8).map(|target| match &target.asset {
                    Some(asset) => format!("@{asset}@"),
                    None => format!("<{}>", target.path),
                });
                first.collect::<Vec<_>>().join(", ")
            }
            Self::Dictionary(_) => "a dictionary".to_owned(),
            Self::Other => "of a kind that is not read".to_owned(),
        })
    }
}
