//! Contents of a single layer.

use std::collections::BTreeMap;

use super::lexer::clipped;

/// A parsed layer, before composition.
#[derive(Debug, Default)]
pub(super) struct Layer {
    pub(super) text: String,
    /// Layer metadata and root prims.
    pub(super) root: Spec,
    /// Number of prims in the layer.
    pub(super) prims: usize,
}

/// Kind of an opinion: it defines a prim, only adds to it, or defines a class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Specifier {
    #[default]
    Over,
    Def,
    Class,
}

/// Opinion of a layer about a prim.
#[derive(Debug, Default)]
pub(super) struct Spec {
    pub(super) at: usize,
    pub(super) specifier: Specifier,
    pub(super) kind: String,
    pub(super) metadata: BTreeMap<String, Vec<MetadataEntry>>,
    pub(super) properties: BTreeMap<String, PropertySpec>,
    /// Children by name, in their order.
    pub(super) children: Vec<(String, Spec)>,
    places: BTreeMap<String, usize>,
    /// Variants by set and name.
    pub(super) variants: BTreeMap<String, BTreeMap<String, Spec>>,
}

impl Spec {
    pub(super) fn new(at: usize, specifier: Specifier) -> Self {
        Self { at, specifier, ..Self::default() }
    }

    pub(super) fn child(&self, name: &str) -> Option<&Spec> {
        self.places.get(name).and_then(|place| self.children.get(*place)).map(|(_, spec)| spec)
    }

    /// Adds a child. Returns false if there is already one with this name.
    pub(super) fn adopt(&mut self, name: &str, spec: Spec) -> bool {
        let new = self.places.insert(name.to_owned(), self.children.len()).is_none();
        self.children.push((name.to_owned(), spec));
        new
    }

    /// Returns the value of metadata that has a single value: the last one written.
    pub(super) fn metadata(&self, key: &str) -> Option<&MetadataEntry> {
        self.metadata.get(key).and_then(|entries| entries.last())
    }
}

/// List edit: the effect of a list on those of weaker layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Edit {
    Replace,
    Prepend,
    Append,
    Delete,
    /// Changes nothing here.
    Reorder,
}

/// A metadata entry.
#[derive(Debug)]
pub(super) struct MetadataEntry {
    pub(super) edit: Edit,
    pub(super) value: Value,
    pub(super) at: usize,
}

/// Opinion of a layer about an attribute or a relationship.
#[derive(Debug, Default)]
pub(super) struct PropertySpec {
    pub(super) at: usize,
    pub(super) value: Option<Value>,
    /// Samples by time code.
    pub(super) samples: Option<Vec<(f64, Value)>>,
    /// Targets of a relationship.
    pub(super) targets: Vec<MetadataEntry>,
}

/// Target of a composition arc or a relationship.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Target {
    pub(super) asset: Option<String>,
    pub(super) path: String,
    pub(super) time: Time,
    pub(super) at: usize,
}

/// Map from the time codes of a layer to those of the layer that includes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Time {
    pub(super) offset: f64,
    pub(super) scale: f64,
}

impl Time {
    pub(super) const SAME: Self = Self { offset: 0.0, scale: 1.0 };

    /// Returns `self` after `inner`.
    pub(super) fn after(self, inner: Self) -> Self {
        let offset = self.offset + self.scale * inner.offset;
        Self { offset, scale: self.scale * inner.scale }
    }
}

/// Value of an attribute or of metadata.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// `None` in the file: hides the values of weaker layers.
    Blocked,
    Number(f64),
    Text(String),
    /// A vector, a quaternion or a matrix.
    Tuple(Vec<f64>),
    /// A list of numbers, or an empty list of any type.
    Numbers(Vec<f64>),
    /// A list of vectors with this many components each.
    Tuples(usize, Vec<f64>),
    Texts(Vec<String>),
    Targets(Vec<Target>),
    Dictionary(Vec<(String, Value)>),
    /// A value that the reader never uses.
    Other,
}

impl Value {
    /// Returns the value as written, cut off if it is long.
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
