//! The composed prims of a stage.

use std::collections::{BTreeMap, BTreeSet};

use super::super::error::SceneError;
use super::compose::{Composer, Opinion, PrimNode, edit};
use super::files::{Files, Origin};
use super::layer::{MetadataEntry, Specifier, Time, Value};
use super::lexer::Fault;
use super::tokens::DEEPEST;

/// A composed prim.
#[derive(Debug, Default)]
pub(super) struct Prim {
    pub(super) path: String,
    pub(super) name: String,
    /// Display name, if there is one.
    pub(super) label: Option<String>,
    /// Type of the prim.
    pub(super) kind: String,
    pub(super) schemas: BTreeSet<String>,
    pub(super) properties: BTreeMap<String, Property>,
    pub(super) parent: Option<usize>,
    pub(super) origin: Origin,
    /// True if its copies may share what is below it.
    pub(super) instanceable: bool,
}

/// A composed property.
#[derive(Debug, Default)]
pub(super) struct Property {
    pub(super) origin: Origin,
    /// Value without a time, of the strongest opinion that has a value or samples.
    pub(super) value: Option<Value>,
    /// Samples of the same opinion, by time code of the stage.
    pub(super) samples: Option<Vec<(f64, Value)>>,
    /// Target paths in the stage.
    pub(super) targets: Vec<String>,
    decided: bool,
}

impl Property {
    /// Returns the value without a time, else that of the first sample.
    pub(super) fn value(&self) -> Option<&Value> {
        let first = || self.samples.as_ref().and_then(|s| s.first()).map(|(_, value)| value);
        self.value.as_ref().or_else(first).filter(|value| **value != Value::Blocked)
    }
}

/// Returns all defined and active prims, parents before children.
pub(super) fn all(files: &Files) -> Result<Vec<Prim>, SceneError> {
    let mut composer = Composer::new(files);
    let root = composer.root()?;
    let mut walk = PrimWalk { files, composer, prims: Vec::new() };
    walk.children(&root, None, 0)?;
    Ok(walk.prims)
}

struct PrimWalk<'f> {
    files: &'f Files,
    composer: Composer<'f>,
    prims: Vec<Prim>,
}

impl<'f> PrimWalk<'f> {
    fn children(
        &mut self,
        node: &PrimNode<'f>,
        parent: Option<usize>,
        depth: usize,
    ) -> Result<(), SceneError> {
        for name in names(node) {
            let mut chosen = BTreeMap::new();
            let Some(child) = self.composer.child(node, &name, &mut chosen, 0)? else { continue };
            let Some(prim) = prim(&child, name, parent, &self.prims) else { continue };
            if depth >= DEEPEST {
                let item = "the depth of a prim";
                let value = format!("more than {DEEPEST}");
                let accepted = format!("accepted: up to {DEEPEST}");
                let fault = Fault::new(prim.origin.at, item, value, accepted);
                return Err(self.files.fault(prim.origin.layer, fault));
            }
            let index = self.prims.len();
            self.prims.push(prim);
            self.children(&child, Some(index), depth.saturating_add(1))?;
        }
        Ok(())
    }
}

/// Returns the names of the children, those from weaker opinions first.
fn names(node: &PrimNode<'_>) -> Vec<String> {
    let mut known = BTreeSet::new();
    let mut names = Vec::new();
    for opinion in node.opinions().iter().rev() {
        for (name, _) in &opinion.site.spec.children {
            if known.insert(name) {
                names.push(name.clone());
            }
        }
    }
    names
}

/// Composes the prim of a node. `None` if it is only an `over`, a class, or inactive.
fn prim(node: &PrimNode<'_>, name: String, parent: Option<usize>, prims: &[Prim]) -> Option<Prim> {
    let opinions = node.opinions();
    let specs = || opinions.iter().map(|opinion| opinion.site.spec);
    let made = specs().find(|spec| spec.specifier != Specifier::Over)?;
    let flag = specs().find_map(|spec| spec.metadata("active"));
    let off = |value: &Value| *value == Value::Number(0.0) || is_word(value, "false");
    if made.specifier == Specifier::Class || flag.is_some_and(|entry| off(&entry.value)) {
        return None;
    }
    let above = parent.and_then(|parent| prims.get(parent)).map_or("", |prim| prim.path.as_str());
    let path = format!("{above}/{name}");
    let first = opinions.first()?;
    let mut schemas = Vec::new();
    for spec in opinions.iter().rev().map(|opinion| opinion.site.spec) {
        for entry in spec.metadata.get("apiSchemas").into_iter().flatten() {
            edit(&mut schemas, entry, texts(entry), |a, b| a == b);
        }
    }
    let shared = specs().find_map(|spec| spec.metadata("instanceable"));
    let instanceable = shared.is_some_and(|entry| !off(&entry.value));
    let label = specs().find_map(|spec| match &spec.metadata("displayName")?.value {
        Value::Text(text) => Some(text.clone()),
        _ => None,
    });
    Some(Prim {
        properties: properties(&opinions, &path),
        kind: specs()
            .map(|spec| &spec.kind)
            .find(|kind| !kind.is_empty())
            .cloned()
            .unwrap_or_default(),
        schemas: schemas.into_iter().collect(),
        origin: Origin { layer: first.site.layer, at: first.site.spec.at },
        path,
        name,
        label,
        parent,
        instanceable,
    })
}

pub(super) fn is_word(value: &Value, word: &str) -> bool {
    matches!(value, Value::Text(text) if text.eq_ignore_ascii_case(word))
}

fn texts(entry: &MetadataEntry) -> Vec<String> {
    match &entry.value {
        Value::Texts(texts) => texts.clone(),
        Value::Text(text) => vec![text.clone()],
        _ => Vec::new(),
    }
}

/// Composes all properties; each takes the value of its strongest opinion that has one.
fn properties(opinions: &[Opinion<'_>], path: &str) -> BTreeMap<String, Property> {
    let mut all: BTreeMap<String, Property> = BTreeMap::new();
    for opinion in opinions {
        for (name, said) in &opinion.site.spec.properties {
            let new = !all.contains_key(name);
            let property = all.entry(name.clone()).or_default();
            if new {
                property.origin = Origin { layer: opinion.site.layer, at: said.at };
            }
            if property.decided {
                continue;
            }
            if property.value.is_none() {
                property.value.clone_from(&said.value);
            }
            property.samples =
                said.samples.as_ref().map(|samples| moved(samples, opinion.site.time));
            property.decided = said.value.is_some() || said.samples.is_some();
        }
    }
    // List edits apply from the weakest opinion to the strongest.
    for opinion in opinions.iter().rev() {
        for (name, said) in &opinion.site.spec.properties {
            let Some(property) = all.get_mut(name) else { continue };
            for entry in &said.targets {
                let targets = match &entry.value {
                    Value::Targets(targets) => targets.as_slice(),
                    _ => &[],
                };
                let paths = targets.iter().filter_map(|to| opinion.path(&to.path, path)).collect();
                edit(&mut property.targets, entry, paths, |a, b| a == b);
            }
        }
    }
    all
}

/// Returns the samples with time codes of the stage.
fn moved(samples: &[(f64, Value)], time: Time) -> Vec<(f64, Value)> {
    let mut moved: Vec<_> = samples
        .iter()
        .map(|(code, value)| {
            let code = if time == Time::SAME { *code } else { time.offset + time.scale * code };
            (code, value.clone())
        })
        .collect();
    moved.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    moved
}
