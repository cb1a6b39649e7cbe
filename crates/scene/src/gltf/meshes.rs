//! Triangle meshes of the file.

use super::super::error::SceneError;
use super::super::graph::transform::Affine;
use super::super::graph::triangles::Triangles;
use super::accessors::Accessors;
use super::json::Cursor;
use super::nodes::Node;

/// Meshes, checked on creation; triangles are read on demand.
pub(super) struct Meshes<'a> {
    meshes: Vec<Cursor<'a>>,
    accessors: &'a Accessors<'a>,
    quantized: bool,
}

impl<'a> Meshes<'a> {
    /// Checks the primitives of all meshes.
    pub(super) fn read(
        root: &Cursor<'a>,
        accessors: &'a Accessors<'a>,
    ) -> Result<Self, SceneError> {
        let used = root.list("extensionsUsed")?;
        let quantized = used.iter().any(|e| e.value.as_str() == Some("KHR_mesh_quantization"));
        let this = Self { meshes: root.list("meshes")?, accessors, quantized };
        for mesh in &this.meshes {
            for primitive in mesh.require("primitives")?.items()? {
                this.primitive(&primitive, &mut None)?;
            }
        }
        Ok(this)
    }

    pub(super) fn len(&self) -> usize {
        self.meshes.len()
    }

    /// Returns the triangles of a mesh.
    pub(super) fn triangles(&self, mesh: usize) -> Result<Triangles, SceneError> {
        let mut out = Some(Triangles::default());
        if let Some(mesh) = self.meshes.get(mesh) {
            for primitive in mesh.require("primitives")?.items()? {
                self.primitive(&primitive, &mut out)?;
            }
        }
        Ok(out.unwrap_or_default())
    }

    /// Returns the triangles of a node and everything below it, in the node's own space. The flag
    /// is true if a skin or morph targets deform any of the meshes.
    pub(super) fn below(
        &self,
        nodes: &[Node<'_>],
        node: usize,
    ) -> Result<(Triangles, bool), SceneError> {
        let mut all = Triangles::default();
        let mut deformed = false;
        let mut stack = vec![(node, Affine::IDENTITY)];
        while let Some((index, map)) = stack.pop() {
            let Some(node) = nodes.get(index) else { continue };
            if let Some(mesh) = node.mesh {
                all.append(&self.triangles(mesh)?, &map).ok_or_else(|| {
                    node.cursor.fault(node.label(index), "up to 2^32 vertices are accepted")
                })?;
                let targets = self.meshes.get(mesh).map(|m| m.get("weights")).transpose()?;
                deformed |= node.cursor.get("skin")?.is_some()
                    || node.cursor.get("weights")?.is_some()
                    || targets.flatten().is_some();
            }
            for child in &node.children {
                if let Some(below) = nodes.get(*child) {
                    stack.push((*child, map.after(&below.matrix)));
                }
            }
        }
        Ok((all, deformed))
    }

    /// Checks a primitive and adds its triangles to `out`, if it is `Some`.
    fn primitive(
        &self,
        primitive: &Cursor<'_>,
        out: &mut Option<Triangles>,
    ) -> Result<(), SceneError> {
        let mode = match primitive.get("mode")? {
            Some(mode) => match mode.integer()? {
                known @ 0..=6 => known,
                _ => return Err(mode.error("0..6 is accepted")),
            },
            None => 4,
        };
        let attributes = primitive.require("attributes")?;
        for key in attributes.object()?.keys() {
            self.accessors.get(&attributes.require(key)?)?;
        }
        let Some(at) = attributes.get("POSITION")? else { return Ok(()) };
        let positions = self.accessors.get(&at)?;
        if positions.kind() != "VEC3" || !(positions.is_float() || self.quantized) {
            let components = if positions.is_float() { "float" } else { "whole" };
            let found =
                format!("accessor of type {} with {components} components", positions.kind());
            return Err(at.fault(
                format!("POSITION, an {found}"),
                "an accessor of type VEC3 with float components is accepted",
            ));
        }
        let vertices = positions.count as u64;
        let indices = match primitive.get("indices")? {
            Some(cursor) => {
                let accessor = self.accessors.get(&cursor)?;
                let restart = accessor.restart().filter(|_| accessor.kind() == "SCALAR");
                let Some(restart) = restart else {
                    return Err(
                        cursor.error("an accessor of unsigned whole scalars (indices) is accepted")
                    );
                };
                if self.accessors.has_data(accessor) {
                    let mut indices = Vec::new();
                    for (order, [value]) in
                        self.accessors.elements::<1>(accessor)?.into_iter().enumerate()
                    {
                        let index = value as u32;
                        if u64::from(index) >= vertices || index == restart {
                            return Err(cursor.fault(
                                format!("index {order} of the primitive = {index}"),
                                format!(
                                    "below {vertices} (the vertices) and not {restart} is accepted"
                                ),
                            ));
                        }
                        indices.push(index);
                    }
                    Some(indices)
                } else {
                    None
                }
            }
            None => None,
        };
        let Some(out) = out.as_mut() else { return Ok(()) };
        if mode < 4 {
            return Ok(());
        }
        let count = u32::try_from(vertices)
            .map_err(|_| at.fault("POSITION", "up to 2^32 vertices are accepted"))?;
        let list = match (&indices, primitive.get("indices")?) {
            (Some(indices), _) => indices.clone(),
            (None, None) => (0..count).collect(),
            (None, Some(cursor)) => {
                return Err(cursor.fault("indices without data", "a buffer with data is required"));
            }
        };
        let own = Triangles {
            vertices: self.accessors.elements::<3>(positions)?,
            triangles: assemble(mode, &list),
        };
        out.append(&own, &Affine::IDENTITY)
            .ok_or_else(|| at.fault("POSITION", "up to 2^32 vertices are accepted"))
    }
}

/// Returns the triangles of a list, strip or fan, without the degenerate ones that join strips.
fn assemble(mode: u64, indices: &[u32]) -> Vec<[u32; 3]> {
    let mut triangles: Vec<[u32; 3]> = match mode {
        4 => indices.as_chunks::<3>().0.to_vec(),
        5 => indices
            .windows(3)
            .enumerate()
            .filter_map(|(i, window)| {
                let [a, b, c] = *window else { return None };
                Some(if i.is_multiple_of(2) { [a, b, c] } else { [a, c, b] })
            })
            .collect(),
        _ => {
            let hub = indices.first().copied().unwrap_or(0);
            let rest = indices.get(1..).unwrap_or_default();
            rest.windows(2)
                .filter_map(|window| {
                    let [b, c] = *window else { return None };
                    Some([b, c, hub])
                })
                .collect()
        }
    };
    triangles.retain(|[a, b, c]| a != b && b != c && a != c);
    triangles
}
