//! The layers of a stage: the root file and all files that it refers to.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::super::error::{Place, SceneError};
use super::super::file;
use super::layer::{Layer, Spec, Target, Value};
use super::lexer::Fault;
use super::parser;

/// Largest number of layers of a stage.
const MOST: usize = 10_000;
/// Largest total size of all layers. \[byte\]
const LARGEST: usize = 1 << 30;

/// Position in a layer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Origin {
    pub(super) layer: usize,
    /// Offset in the text. \[byte\]
    pub(super) at: usize,
}

/// All layers, by index; the first is the root.
pub(super) struct Files {
    pub(super) layers: Vec<Layer>,
    pub(super) paths: Vec<PathBuf>,
    /// Layer that each asset path of each layer leads to, or why it leads nowhere.
    links: BTreeMap<(usize, String), Result<usize, String>>,
}

impl Files {
    /// Reads a file and all files that it refers to.
    pub(super) fn read(root: &Path) -> Result<Self, SceneError> {
        let mut files = Self { layers: Vec::new(), paths: Vec::new(), links: BTreeMap::new() };
        files.layer(root)?;
        let folder = root.parent().unwrap_or(Path::new(""));
        let mut known = BTreeMap::new();
        if let Ok(path) = root.canonicalize() {
            known.insert(path, 0);
        }
        let mut size = files.layers.first().map_or(0, |layer| layer.text.len());
        let mut next = 0;
        while let Some(layer) = files.layers.get(next) {
            let mut assets = Vec::new();
            collect(&layer.root, &mut assets);
            let here = files.paths.get(next).map(|path| path.parent().unwrap_or(Path::new("")));
            let here = here.unwrap_or(folder).to_owned();
            for (asset, at) in assets {
                if files.links.contains_key(&(next, asset.clone())) {
                    continue;
                }
                let link = match file::inside(&asset, &here, folder, "the scene") {
                    Err(why) => Err(why),
                    Ok(path) => match known.get(&path) {
                        Some(index) => Ok(*index),
                        None => {
                            let index = files.layers.len();
                            files.layer(&path)?;
                            size = size.saturating_add(
                                files.layers.last().map_or(0, |layer| layer.text.len()),
                            );
                            if index >= MOST || size > LARGEST {
                                let value = format!("{index} files of {size} bytes");
                                let fault = Fault::new(
                                    at,
                                    "files that the scene references",
                                    value,
                                    format!("accepted: up to {MOST} files and 1 GiB"),
                                );
                                return Err(files.fault(next, fault));
                            }
                            known.insert(path, index);
                            Ok(index)
                        }
                    },
                };
                files.links.insert((next, asset), link);
            }
            next = next.saturating_add(1);
        }
        Ok(files)
    }

    /// Reads one more layer.
    fn layer(&mut self, path: &Path) -> Result<(), SceneError> {
        let mut start = [0; 8];
        if file::starts_with(path, &mut start)
            && (&start == b"PXR-USDC" || start.starts_with(b"PK"))
        {
            // Binary data is not UTF-8; the parser recognizes it by its start and reports it.
            let binary = String::from_utf8_lossy(&start).into_owned();
            return self.parsed(path, binary);
        }
        let text = file::read_text(path)?;
        self.parsed(path, text)
    }

    fn parsed(&mut self, path: &Path, text: String) -> Result<(), SceneError> {
        let layer = parser::parse(text).map_err(|(fault, text)| error(path, &text, fault))?;
        self.layers.push(layer);
        self.paths.push(path.to_owned());
        Ok(())
    }

    /// Returns the layer that a target leads to.
    pub(super) fn follow(&self, layer: usize, target: &Target) -> Result<usize, SceneError> {
        let Some(asset) = &target.asset else { return Ok(layer) };
        match self.links.get(&(layer, asset.clone())) {
            Some(Ok(index)) => Ok(*index),
            found => {
                let why = match found {
                    Some(Err(why)) => why.clone(),
                    _ => "accepted: a file beside the scene".to_owned(),
                };
                let item = "the path of a file";
                Err(self.fault(layer, Fault::new(target.at, item, format!("@{asset}@"), why)))
            }
        }
    }

    /// Returns an error at a position in a layer.
    pub(super) fn fault(&self, layer: usize, fault: Fault) -> SceneError {
        let path = self.paths.get(layer).map_or(Path::new(""), PathBuf::as_path);
        error(path, self.layers.get(layer).map_or("", |layer| &layer.text), fault)
    }

    /// Returns line and column in the root layer; in any other layer, the file only.
    pub(super) fn place(&self, origin: Origin) -> Place {
        match self.layers.get(origin.layer) {
            Some(layer) if origin.layer == 0 => place(&layer.text, origin.at),
            _ => Place::File,
        }
    }
}

fn error(path: &Path, text: &str, fault: Fault) -> SceneError {
    SceneError {
        file: path.to_owned(),
        place: place(text, fault.at),
        item: fault.item,
        value: fault.value,
        accepted: fault.accepted,
        unreadable: false,
    }
}

/// Returns line and column of an offset.
fn place(text: &str, at: usize) -> Place {
    let before = text.get(..at).unwrap_or(text);
    let line = before.bytes().filter(|byte| *byte == b'\n').count().saturating_add(1);
    let start = before.rfind('\n').map_or(0, |end| end.saturating_add(1));
    let column = before.get(start..).unwrap_or("").chars().count().saturating_add(1);
    Place::Line { line, column }
}

/// Collects the paths of all files that a layer names.
fn collect(spec: &Spec, assets: &mut Vec<(String, usize)>) {
    for key in ["subLayers", "references", "payload"] {
        for entry in spec.metadata.get(key).into_iter().flatten() {
            if let Value::Targets(targets) = &entry.value {
                let named = targets.iter().filter_map(|t| Some((t.asset.clone()?, t.at)));
                assets.extend(named);
            }
        }
    }
    spec.children.iter().for_each(|(_, child)| collect(child, assets));
    for variant in spec.variants.values().flat_map(BTreeMap::values) {
        collect(variant, assets);
    }
}
