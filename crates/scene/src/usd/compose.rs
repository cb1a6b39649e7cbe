//! Composition: combines the opinions of all layers about each prim.
//!
//! Opinions about a prim come from the root layer stack. Weaker ones come from its inherits,
//! variants, references, payloads and specializes, in this order. Each source is a [`PrimNode`],
//! which may have sources of its own. The children of a prim are the children of its nodes.

use std::collections::BTreeMap;

use super::super::error::SceneError;
use super::files::{Files, Origin};
use super::layer::{Edit, MetadataEntry, Spec, Target, Time, Value};
use super::lexer::Fault;
use super::tokens::DEEPEST;

/// Limit on composed nodes: this many per prim written in the files, plus [`FEWEST_NODES`]. Only
/// references in a ring or ones that multiply each other exceed it.
const NODES_PER_PRIM: usize = 100;
const FEWEST_NODES: usize = 1000;

/// Composition arcs of a prim, strongest first.
const ARCS: [&str; 5] = ["inherits", "variants", "references", "payload", "specializes"];

/// Opinion of one layer about a prim.
#[derive(Clone, Copy)]
pub(super) struct Site<'a> {
    pub(super) layer: usize,
    pub(super) spec: &'a Spec,
    pub(super) time: Time,
}

/// One source of opinions about a prim.
#[derive(Clone)]
pub(super) struct PrimNode<'a> {
    /// Root layer of the source's layer stack.
    stack: usize,
    /// Path of the prim in that stack.
    path: String,
    /// Opinions in the stack, from the strongest layer to the weakest.
    sites: Vec<Site<'a>>,
    /// Maps paths of this node to paths of the node above: the first prefix is replaced by the
    /// second.
    map: (String, String),
    /// True if paths without that prefix mean the same in the node above.
    open: bool,
    time: Time,
    /// Weaker sources, each with the index of its arc in [`ARCS`].
    arcs: Vec<(usize, PrimNode<'a>)>,
}

/// An opinion and the path maps of the nodes around it, outermost first.
pub(super) struct Opinion<'a> {
    pub(super) site: Site<'a>,
    maps: Vec<(&'a str, &'a str, bool)>,
}

impl Opinion<'_> {
    /// Maps a path in the opinion's layer to a path of the stage. `None` if it leads outside the
    /// prim that was referenced.
    pub(super) fn path(&self, path: &str, owner: &str) -> Option<String> {
        let mut path = if path.starts_with('/') {
            path.to_owned()
        } else {
            // Relative to the prim that holds the path.
            return absolute(path, owner);
        };
        for (from, to, open) in self.maps.iter().rev() {
            path = match below(&path, from) {
                Some(rest) => format!("{}{rest}", if *to == "/" { "" } else { to }),
                None if *open => path,
                None => return None,
            };
        }
        Some(path)
    }
}

/// Returns the part of a path after a prefix; `None` if the path does not start with it.
fn below<'p>(path: &'p str, prefix: &str) -> Option<&'p str> {
    if prefix == "/" {
        return Some(path);
    }
    path.strip_prefix(prefix).filter(|rest| rest.is_empty() || rest.starts_with(['/', '.']))
}

fn absolute(path: &str, owner: &str) -> Option<String> {
    let mut parts: Vec<&str> = owner.split('/').filter(|part| !part.is_empty()).collect();
    for step in path.split('/') {
        match step {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            name => parts.push(name),
        }
    }
    Some(format!("/{}", parts.join("/")))
}

/// Composes layers into nodes.
pub(super) struct Composer<'a> {
    files: &'a Files,
    stacks: BTreeMap<usize, Vec<Site<'a>>>,
    nodes: usize,
    most: usize,
}

type Chosen = BTreeMap<String, String>;

impl<'a> Composer<'a> {
    pub(super) fn new(files: &'a Files) -> Self {
        let prims = files.layers.iter().fold(0_usize, |sum, layer| sum.saturating_add(layer.prims));
        let most = prims.saturating_mul(NODES_PER_PRIM).saturating_add(FEWEST_NODES);
        Self { files, stacks: BTreeMap::new(), nodes: 0, most }
    }

    /// Returns the root node of the stage.
    pub(super) fn root(&mut self) -> Result<PrimNode<'a>, SceneError> {
        self.top(0)
    }

    fn top(&mut self, stack: usize) -> Result<PrimNode<'a>, SceneError> {
        let sites = match self.stacks.get(&stack) {
            Some(sites) => sites.clone(),
            None => {
                let mut sites = Vec::new();
                self.sublayers(stack, Time::SAME, &mut Vec::new(), &mut sites)?;
                self.stacks.insert(stack, sites.clone());
                sites
            }
        };
        let map = ("/".to_owned(), "/".to_owned());
        let path = "/".to_owned();
        Ok(PrimNode { stack, path, sites, map, open: false, time: Time::SAME, arcs: Vec::new() })
    }

    /// Adds a layer and its sublayers to `sites`, the strongest first.
    fn sublayers(
        &mut self,
        layer: usize,
        time: Time,
        above: &mut Vec<usize>,
        sites: &mut Vec<Site<'a>>,
    ) -> Result<(), SceneError> {
        let Some(Site { spec, .. }) = self.layer(layer, time) else { return Ok(()) };
        sites.push(Site { layer, spec, time });
        above.push(layer);
        for entry in spec.metadata.get("subLayers").into_iter().flatten() {
            let Value::Targets(targets) = &entry.value else { continue };
            for target in targets {
                self.count(layer, target.at)?;
                let next = self.files.follow(layer, target)?;
                if above.contains(&next) || above.len() > DEEPEST {
                    return Err(self.ring(layer, target));
                }
                self.sublayers(next, time.after(target.time), above, sites)?;
            }
        }
        above.pop();
        Ok(())
    }

    fn layer(&self, layer: usize, time: Time) -> Option<Site<'a>> {
        self.files.layers.get(layer).map(|of| Site { layer, spec: &of.root, time })
    }

    fn ring(&self, layer: usize, target: &Target) -> SceneError {
        let value = Value::Targets(vec![target.clone()]).label();
        let accepted = format!("accepted: references without cycles, up to {DEEPEST} deep");
        self.files.fault(layer, Fault::new(target.at, "target of a reference", value, accepted))
    }

    /// Counts a node.
    ///
    /// # Errors
    /// If there are more than the limit.
    fn count(&mut self, layer: usize, at: usize) -> Result<(), SceneError> {
        self.nodes = self.nodes.saturating_add(1);
        if self.nodes <= self.most {
            return Ok(());
        }
        let value = format!("more than {} prims", self.most);
        let accepted = "accepted: up to 100 for each that is written; references form a cycle or \
         multiply each other";
        Err(self
            .files
            .fault(layer, Fault::new(at, "number of prims in the scene", value, accepted)))
    }

    /// Returns the child of a node with all its sources; `None` if no layer mentions it.
    pub(super) fn child(
        &mut self,
        parent: &PrimNode<'a>,
        name: &str,
        chosen: &mut Chosen,
        depth: usize,
    ) -> Result<Option<PrimNode<'a>>, SceneError> {
        let sites: Vec<_> = parent
            .sites
            .iter()
            .filter_map(|site| Some(Site { spec: site.spec.child(name)?, ..*site }))
            .collect();
        let slash = if parent.path == "/" { "" } else { "/" };
        let node = PrimNode {
            stack: parent.stack,
            path: format!("{}{slash}{name}", parent.path),
            sites,
            map: parent.map.clone(),
            open: parent.open,
            time: parent.time,
            arcs: Vec::new(),
        };
        let node = self.expanded(node, &parent.arcs, Some(name), chosen, depth)?;
        Ok((!node.sites.is_empty() || !node.arcs.is_empty()).then_some(node))
    }

    /// Adds to a node its own arcs and, at the same strength, the matching children of its parent's
    /// arcs.
    fn expanded(
        &mut self,
        mut node: PrimNode<'a>,
        above: &[(usize, PrimNode<'a>)],
        name: Option<&str>,
        chosen: &mut Chosen,
        depth: usize,
    ) -> Result<PrimNode<'a>, SceneError> {
        let at = node
            .sites
            .first()
            .map_or(Origin::default(), |site| Origin { layer: site.layer, at: site.spec.at });
        self.count(at.layer, at.at)?;
        for site in &node.sites {
            let entry = site.spec.metadata("variants");
            if let Some(Value::Dictionary(choices)) = entry.map(|entry| &entry.value) {
                for (set, choice) in choices {
                    if let Value::Text(choice) = choice {
                        chosen.entry(set.clone()).or_insert_with(|| choice.clone());
                    }
                }
            }
        }
        for (strength, key) in ARCS.into_iter().enumerate() {
            if key == "variants" {
                for variant in self.variants(&node, chosen, depth)? {
                    node.arcs.push((strength, variant));
                }
            }
            for (site, target) in edited(&node.sites, key) {
                let arc = match self.arc(&node, site, &target, chosen, depth)? {
                    Some(arc) => arc,
                    // A class that is inherited or specialized may be absent: it then has no
                    // opinions.
                    None if matches!(key, "inherits" | "specializes") => continue,
                    None => return Err(self.absent(site.layer, &target)),
                };
                node.arcs.push((strength, arc));
            }
            let Some(name) = name else { continue };
            for (_, arc) in above.iter().filter(|(kind, _)| *kind == strength) {
                if let Some(child) = self.child(arc, name, chosen, depth)? {
                    node.arcs.push((strength, child));
                }
            }
        }
        Ok(node)
    }

    /// Returns one node for each variant set of a node with a chosen variant.
    fn variants(
        &mut self,
        node: &PrimNode<'a>,
        chosen: &mut Chosen,
        depth: usize,
    ) -> Result<Vec<PrimNode<'a>>, SceneError> {
        let mut sets: BTreeMap<&str, Vec<Site<'a>>> = BTreeMap::new();
        for site in &node.sites {
            for (set, variants) in &site.spec.variants {
                let spec = chosen.get(set).and_then(|choice| variants.get(choice));
                sets.entry(set).or_default().extend(spec.map(|spec| Site { spec, ..*site }));
            }
        }
        let mut nodes = Vec::new();
        for sites in sets.into_values().filter(|sites| !sites.is_empty()) {
            let map = ("/".to_owned(), "/".to_owned());
            let variant =
                PrimNode { sites, map, time: Time::SAME, arcs: Vec::new(), ..node.clone() };
            nodes.push(self.expanded(variant, &[], None, chosen, depth)?);
        }
        Ok(nodes)
    }

    fn absent(&self, layer: usize, target: &Target) -> SceneError {
        let value = format!("<{}>", target.path);
        let accepted = "accepted: an existing prim";
        self.files.fault(layer, Fault::new(target.at, "target of a reference", value, accepted))
    }

    /// Returns the node that an arc leads to; `None` if there is no such prim.
    fn arc(
        &mut self,
        node: &PrimNode<'a>,
        site: Site<'a>,
        target: &Target,
        chosen: &mut Chosen,
        depth: usize,
    ) -> Result<Option<PrimNode<'a>>, SceneError> {
        let depth = depth.saturating_add(1);
        if depth > DEEPEST {
            return Err(self.ring(site.layer, target));
        }
        let refuse = |value: String, accepted: &str| {
            let fault = Fault::new(target.at, "target of a reference", value, accepted);
            self.files.fault(site.layer, fault)
        };
        let outside = target.asset.is_some();
        let stack = if outside { self.files.follow(site.layer, target)? } else { node.stack };
        let path = if target.path.is_empty() {
            let root = self.files.layers.get(stack).map(|layer| &layer.root);
            let default = root.and_then(|root| root.metadata("defaultPrim"));
            match default.map(|entry| &entry.value) {
                Some(Value::Text(name)) => format!("/{name}"),
                _ => {
                    let value = Value::Targets(vec![target.clone()]).label();
                    let accepted = "accepted: a file with a defaultPrim, or a path: @file@</Prim>";
                    return Err(refuse(value, accepted));
                }
            }
        } else if target.path.starts_with('/') && !target.path.contains(['{', '.']) {
            target.path.clone()
        } else {
            return Err(refuse(format!("<{}>", target.path), "accepted: </Path/Of/A/Prim>"));
        };
        let names: Vec<&str> = path.split('/').filter(|name| !name.is_empty()).collect();
        let mut reached = self.top(stack)?;
        for (order, name) in names.iter().enumerate() {
            let last = order.saturating_add(1) == names.len();
            let mut own = Chosen::new();
            let chosen = if last { &mut *chosen } else { &mut own };
            match self.child(&reached, name, chosen, depth)? {
                Some(next) => reached = next,
                None => return Ok(None),
            }
        }
        if names.is_empty() {
            return Ok(None);
        }
        reached.map = (path, node.path.clone());
        reached.open = !outside;
        reached.time = site.time.after(target.time);
        Ok(Some(reached))
    }
}

impl<'a> PrimNode<'a> {
    /// Returns all opinions about the prim, the strongest first.
    pub(super) fn opinions(&'a self) -> Vec<Opinion<'a>> {
        let mut all = Vec::new();
        self.gather(&mut Vec::new(), Time::SAME, &mut all);
        all
    }

    fn gather(
        &'a self,
        maps: &mut Vec<(&'a str, &'a str, bool)>,
        time: Time,
        all: &mut Vec<Opinion<'a>>,
    ) {
        let time = time.after(self.time);
        maps.push((&self.map.0, &self.map.1, self.open));
        all.extend(self.sites.iter().map(|site| Opinion {
            site: Site { time: time.after(site.time), ..*site },
            maps: maps.clone(),
        }));
        self.arcs.iter().for_each(|(_, arc)| arc.gather(maps, time, all));
        maps.pop();
    }
}

/// Returns the targets of one kind of arc, strongest first, after the list edits of a node's
/// layers.
fn edited<'a>(sites: &[Site<'a>], key: &str) -> Vec<(Site<'a>, Target)> {
    let mut list: Vec<(Site<'a>, Target)> = Vec::new();
    for site in sites.iter().rev() {
        for entry in site.spec.metadata.get(key).into_iter().flatten() {
            let targets = match &entry.value {
                Value::Targets(targets) => targets.as_slice(),
                _ => &[],
            };
            let named = targets.iter().map(|target| (*site, target.clone())).collect();
            edit(&mut list, entry, named, |a, b| {
                a.1.asset == b.1.asset && a.1.path == b.1.path && a.0.layer == b.0.layer
            });
        }
    }
    list
}

/// Applies the list edit of an entry.
pub(super) fn edit<T>(
    list: &mut Vec<T>,
    entry: &MetadataEntry,
    mut items: Vec<T>,
    same: impl Fn(&T, &T) -> bool,
) {
    match entry.edit {
        Edit::Replace => *list = items,
        Edit::Reorder => {}
        Edit::Delete => list.retain(|known| !items.iter().any(|item| same(item, known))),
        Edit::Prepend => {
            list.retain(|known| !items.iter().any(|item| same(item, known)));
            items.append(list);
            *list = items;
        }
        Edit::Append => {
            list.retain(|known| !items.iter().any(|item| same(item, known)));
            list.append(&mut items);
        }
    }
}
