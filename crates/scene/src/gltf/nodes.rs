//! The node tree with local and world transforms, checked for cycles.

use super::super::error::{SceneError, Warning};
use super::super::graph::math::{self, Mat3, Quat};
use super::super::graph::transform::{Affine, Trs, split};
use super::super::graph::{FAR, TURN_SLACK};
use super::json::Cursor;

/// A node.
pub(super) struct Node<'a> {
    pub(super) cursor: Cursor<'a>,
    pub(super) name: Option<&'a str>,
    pub(super) parent: Option<usize>,
    pub(super) children: Vec<usize>,
    pub(super) local: Trs,
    /// Local transform as written, including any shear of a matrix.
    pub(super) matrix: Affine,
    pub(super) world: Affine,
    /// Product of the rotations from the root, not distorted by any scale.
    pub(super) turn: Quat,
    /// True if no node from the root to here is scaled.
    pub(super) rigid: bool,
    /// True if the node is part of the scene.
    pub(super) present: bool,
    pub(super) mesh: Option<usize>,
}

impl Node<'_> {
    /// Returns the linear map of the world transform without its rotation.
    pub(super) fn scale(&self) -> Mat3 {
        if self.rigid {
            // Exact: without rounding errors of the product.
            return math::IDENTITY;
        }
        math::mul(math::transpose(math::rotation(self.turn)), self.world.linear)
    }

    /// Returns the name of the node in messages.
    pub(super) fn label(&self, index: usize) -> String {
        match self.name {
            Some(name) if !name.is_empty() => format!("node '{name}'"),
            _ => format!("node {index}"),
        }
    }
}

/// Reads all nodes; `present` marks those of the scene that is simulated.
pub(super) fn read<'a>(
    root: &Cursor<'a>,
    meshes: usize,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Node<'a>>, SceneError> {
    let cursors = root.list("nodes")?;
    let count = cursors.len();
    let mut nodes = Vec::with_capacity(count);
    for cursor in cursors {
        let mesh = cursor.get("mesh")?.map(|mesh| mesh.index(meshes, "meshes")).transpose()?;
        let name = cursor.get("name")?.map(|name| name.text()).transpose()?;
        let (local, matrix) = transform(&cursor, warnings)?;
        nodes.push(Node {
            name,
            parent: None,
            children: Vec::new(),
            local,
            matrix,
            world: Affine::IDENTITY,
            turn: math::NO_TURN,
            rigid: local.scale == [1.0; 3] && cursor.get("matrix")?.is_none(),
            present: false,
            mesh,
            cursor,
        });
    }
    adopt(&mut nodes)?;

    let order = top_down(&nodes)?;
    for index in order {
        let above = nodes.get(index).and_then(|n| n.parent).and_then(|p| nodes.get(p));
        let (world, turn, rigid) =
            above.map_or((Affine::IDENTITY, math::NO_TURN, true), |p| (p.world, p.turn, p.rigid));
        if let Some(node) = nodes.get_mut(index) {
            node.rigid &= rigid;
            node.world = world.after(&node.matrix);
            node.turn = math::quat_as_written(math::quat_after(turn, node.local.rotation))
                .unwrap_or(math::NO_TURN);
            let numbers = node.world.linear.iter().flatten().chain(&node.world.shift);
            if !numbers.copied().all(|x| x.abs() <= FAR) {
                return Err(node.cursor.fault(
                    "transform of the node in the scene",
                    format!("coordinates and scales up to {FAR:e} are accepted"),
                ));
            }
        }
    }
    mark_scene(root, &mut nodes)?;
    Ok(nodes)
}

/// Links children and parents; a node has at most one parent.
fn adopt(nodes: &mut [Node<'_>]) -> Result<(), SceneError> {
    let count = nodes.len();
    for index in 0..count {
        let Some(cursor) = nodes.get(index).map(|n| n.cursor.clone()) else { continue };
        for child in cursor.list("children")? {
            let target = child.index(count, "nodes")?;
            if target == index {
                return Err(child.error("a node is no child of itself"));
            }
            if let Some(node) = nodes.get_mut(target) {
                if let Some(parent) = node.parent {
                    return Err(child.error(format!("it already is a child of node {parent}")));
                }
                node.parent = Some(index);
            }
            if let Some(node) = nodes.get_mut(index) {
                node.children.push(target);
            }
        }
    }
    Ok(())
}

/// Returns all nodes, parents before children.
///
/// # Errors
/// If nodes form a cycle.
fn top_down(nodes: &[Node<'_>]) -> Result<Vec<usize>, SceneError> {
    let mut stack: Vec<usize> =
        nodes.iter().enumerate().filter(|(_, n)| n.parent.is_none()).map(|(i, _)| i).collect();
    stack.reverse();
    let mut order = Vec::with_capacity(nodes.len());
    let mut reached = vec![false; nodes.len()];
    while let Some(index) = stack.pop() {
        order.push(index);
        if let Some(flag) = reached.get_mut(index) {
            *flag = true;
        }
        if let Some(node) = nodes.get(index) {
            stack.extend(node.children.iter().rev());
        }
    }
    // Since each node has at most one parent, only cycles are unreachable from the roots.
    match nodes.iter().zip(&reached).find(|(_, reached)| !**reached) {
        Some((node, _)) => {
            let children = node.cursor.get("children")?.unwrap_or_else(|| node.cursor.clone());
            Err(children.error("nodes that are their own ancestors are not accepted"))
        }
        None => Ok(order),
    }
}

fn mark_scene(root: &Cursor<'_>, nodes: &mut [Node<'_>]) -> Result<(), SceneError> {
    let count = nodes.len();
    let scenes = root.list("scenes")?;
    let chosen = match root.get("scene")? {
        Some(scene) => Some(scene.index(scenes.len(), "scenes")?),
        None if scenes.is_empty() => None,
        None => Some(0),
    };
    let mut roots = Vec::new();
    for (index, scene) in scenes.iter().enumerate() {
        for entry in scene.list("nodes")? {
            let target = entry.index(count, "nodes")?;
            if nodes.get(target).is_some_and(|n| n.parent.is_some()) {
                return Err(entry.error("nodes without a parent are accepted"));
            }
            if Some(index) == chosen {
                roots.push(target);
            }
        }
    }
    if chosen.is_none() {
        roots = (0..count).filter(|i| nodes.get(*i).is_some_and(|n| n.parent.is_none())).collect();
    }
    while let Some(index) = roots.pop() {
        if let Some(node) = nodes.get_mut(index) {
            // A root listed twice is visited once.
            if !node.present {
                node.present = true;
                roots.extend(&node.children);
            }
        }
    }
    Ok(())
}

/// Reads the local transform of a node as translation, rotation and scale, and as the map written
/// in the file.
fn transform(node: &Cursor<'_>, warnings: &mut Vec<Warning>) -> Result<(Trs, Affine), SceneError> {
    let mut trs = Trs { translation: [0.0; 3], rotation: math::NO_TURN, scale: [1.0; 3] };
    if let Some(translation) = node.get("translation")? {
        trs.translation = translation.numbers(FAR)?;
    }
    if let Some(rotation) = node.get("rotation")? {
        trs.rotation = unit_quaternion(&rotation)?;
    }
    if let Some(scale) = node.get("scale")? {
        trs.scale = scale.numbers(FAR)?;
    }
    let Some(matrix) = node.get("matrix")? else {
        return Ok((trs, trs.affine()));
    };
    for key in ["translation", "rotation", "scale"] {
        if let Some(other) = node.get(key)? {
            return Err(other.error("a node has either a 'matrix' or this"));
        }
    }
    let [a0, a1, a2, a3, b0, b1, b2, b3, c0, c1, c2, c3, t0, t1, t2, t3] =
        matrix.numbers::<16>(FAR)?;
    if [a3, b3, c3, t3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(matrix.error("a matrix with the last row 0, 0, 0, 1 is accepted"));
    }
    let linear = [[a0, a1, a2], [b0, b1, b2], [c0, c1, c2]];
    let affine = Affine { linear, shift: [t0, t1, t2] };
    let (rotation, scale, shear) = split(linear)
        .ok_or_else(|| matrix.error("a matrix made of translation, rotation and scale"))?;
    if shear > 1e-4 {
        warnings.push(Warning {
            place: matrix.place(),
            message: "this matrix shears: meshes follow it, implicit shapes become convex hulls, \
                      and an animated node loses the shear"
                .into(),
        });
    }
    Ok((Trs { translation: affine.shift, rotation, scale }, affine))
}

/// Reads a quaternion and normalizes it, unless its length is 1 up to the rounding of `f64`. The
/// length must be 1 up to the rounding of exporters.
pub(super) fn unit_quaternion(cursor: &Cursor<'_>) -> Result<Quat, SceneError> {
    let q: Quat = cursor.numbers(FAR)?;
    let off = (math::quat_dot(q, q).sqrt() - 1.0).abs();
    match math::quat_as_written(q) {
        Some(unit) if off <= TURN_SLACK => Ok(unit),
        _ => Err(cursor.error("a quaternion x, y, z, w of length 1 is accepted")),
    }
}
