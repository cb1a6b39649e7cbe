//! Animations that move nodes, converted to tracks of poses.

use std::collections::BTreeMap;

use super::super::description::Track;
use super::super::error::{SceneError, Warning};
use super::super::graph::math::{self, Quat, Vec3};
use super::super::graph::track;
use super::super::graph::transform::Affine;
use super::accessors::Accessors;
use super::json::Cursor;
use super::nodes::Node;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interpolation {
    Linear,
    Step,
    Cubic,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum TargetPath {
    Translation,
    Rotation,
}

/// Values of one property of a node over time.
struct Channel {
    path: TargetPath,
    interpolation: Interpolation,
    times: Vec<f64>,
    /// One value per time; for cubic splines, in-tangent, value and out-tangent.
    values: Vec<[f64; 4]>,
}

impl Channel {
    fn sample(&self, time: f64) -> [f64; 4] {
        let after = self.times.partition_point(|t| *t <= time);
        let value = |key: usize, part: usize| {
            let at = match self.interpolation {
                Interpolation::Cubic => key.saturating_mul(3).saturating_add(part),
                _ => key,
            };
            self.values.get(at).copied().unwrap_or([0.0; 4])
        };
        let Some(before) = after.checked_sub(1) else { return value(0, 1) };
        let (Some(t0), Some(t1)) = (self.times.get(before), self.times.get(after)) else {
            return value(before, 1);
        };
        let span = t1 - t0;
        let t = (time - t0) / span;
        let (a, b) = (value(before, 1), value(after, 1));
        match self.interpolation {
            Interpolation::Step => a,
            Interpolation::Linear if self.path == TargetPath::Rotation => math::slerp(a, b, t),
            Interpolation::Linear => mix([(a, 1.0 - t), (b, t)]),
            Interpolation::Cubic => {
                let (t2, t3) = (t * t, t * t * t);
                mix([
                    (a, 2.0 * t3 - 3.0 * t2 + 1.0),
                    (value(before, 2), span * (t3 - 2.0 * t2 + t)),
                    (b, -2.0 * t3 + 3.0 * t2),
                    (value(after, 0), span * (t3 - t2)),
                ])
            }
        }
    }
}

fn mix<const N: usize>(parts: [([f64; 4], f64); N]) -> [f64; 4] {
    parts.into_iter().fold([0.0; 4], |[x, y, z, w], ([a, b, c, d], weight)| {
        [x + a * weight, y + b * weight, z + c * weight, w + d * weight]
    })
}

/// Translations and rotations of the first animation in the file.
pub(super) struct Animation {
    channels: BTreeMap<(usize, TargetPath), Channel>,
}

/// Name of the animation of a bake. It moves no bodies when its file is read as a scene.
pub const BAKED: &str = "Drystone";

fn is_baked(animation: &Cursor<'_>) -> bool {
    let name = animation.get("name").ok().flatten();
    name.is_some_and(|name| name.text().is_ok_and(|name| name == BAKED))
}

impl Animation {
    pub(super) fn read(
        root: &Cursor<'_>,
        accessors: &Accessors<'_>,
        nodes: &[Node<'_>],
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, SceneError> {
        let mut this = Self { channels: BTreeMap::new() };
        let mut animations = root.list("animations")?;
        animations.retain(|animation| !is_baked(animation));
        let Some(animation) = animations.first() else { return Ok(this) };
        if let Some(second) = animations.get(1) {
            let count = animations.len();
            warnings.push(Warning {
                place: second.place(),
                message: format!("only the first of {count} animations moves bodies"),
            });
        }
        let samplers = animation.list("samplers")?;
        for channel in animation.list("channels")? {
            let sampler = channel.require("sampler")?;
            let sampler = samplers.get(sampler.index(samplers.len(), "samplers")?);
            let target = channel.require("target")?;
            let path = match target.require("path")?.text()? {
                "translation" => TargetPath::Translation,
                "rotation" => TargetPath::Rotation,
                _ => continue,
            };
            let (Some(sampler), Some(node)) = (sampler, target.get("node")?) else { continue };
            let node = node.index(nodes.len(), "nodes")?;
            let read = read_channel(sampler, path, accessors)?;
            if this.channels.insert((node, path), read).is_some() {
                return Err(target.fault(
                    "target of an animation channel",
                    "each property of a node is accepted once per animation",
                ));
            }
        }
        Ok(this)
    }

    /// Returns true if the animation moves the node itself, not only an ancestor.
    pub(super) fn moves(&self, node: usize) -> bool {
        self.channels
            .range((node, TargetPath::Translation)..=(node, TargetPath::Rotation))
            .next()
            .is_some()
    }

    /// Returns the poses of a node in the world, as it and its ancestors move.
    pub(super) fn track(&self, nodes: &[Node<'_>], node: usize) -> Result<Track, SceneError> {
        let Some(owner) = nodes.get(node) else { return Ok(Track::default()) };
        let chain = chain(nodes, node);
        let channels: Vec<(usize, &Channel)> = chain
            .iter()
            .flat_map(|index| {
                let range = (*index, TargetPath::Translation)..=(*index, TargetPath::Rotation);
                self.channels.range(range).map(|((mover, _), channel)| (*mover, channel))
            })
            .collect();
        let mut times = Vec::new();
        let mut movers: Vec<usize> = Vec::new();
        for (mover, channel) in &channels {
            if movers.last() != Some(mover) {
                movers.push(*mover);
            }
            times.extend(&channel.times);
            if channel.interpolation == Interpolation::Step {
                // The pose just before a jump keeps the track constant up to it.
                times.extend(channel.times.iter().skip(1).map(|t| t.next_down()));
            }
        }
        // The keys suffice if only one node moves and its rotation does not carry the body along an
        // arc.
        let cubic = channels.iter().any(|(_, c)| c.interpolation == Interpolation::Cubic);
        let swings = channels.iter().any(|(m, c)| c.path == TargetPath::Rotation && *m != node);
        let exact = movers.len() <= 1 && !cubic && !swings;
        let times = track::times(times, exact).map_err(|(length, accepted)| {
            let item = format!("animation of the node, {length} s long");
            owner.cursor.fault(item, accepted)
        })?;
        Ok(track::of(times, |time| self.pose(nodes, &chain, time)))
    }

    /// Returns the pose in the world at a time; `chain` leads from the root to the node.
    fn pose(&self, nodes: &[Node<'_>], chain: &[usize], time: f64) -> (Vec3, Quat) {
        let mut world = Affine::IDENTITY;
        let mut turn = math::NO_TURN;
        for index in chain {
            let Some(node) = nodes.get(*index) else { continue };
            let mut local = node.local;
            let mut matrix = node.matrix;
            if let Some(channel) = self.channels.get(&(*index, TargetPath::Translation)) {
                let [x, y, z, _] = channel.sample(time);
                local.translation = [x, y, z];
            }
            if let Some(channel) = self.channels.get(&(*index, TargetPath::Rotation)) {
                let sampled = math::quat_unit(channel.sample(time));
                local.rotation = sampled.unwrap_or(local.rotation);
            }
            if self.moves(*index) {
                matrix = local.affine();
            }
            world = world.after(&matrix);
            turn = math::quat_unit(math::quat_mul(turn, local.rotation)).unwrap_or(turn);
        }
        (world.shift, turn)
    }
}

/// Returns the nodes from the root down to `node`.
pub(super) fn chain(nodes: &[Node<'_>], node: usize) -> Vec<usize> {
    let mut chain: Vec<usize> =
        std::iter::successors(Some(node), |i| nodes.get(*i).and_then(|n| n.parent)).collect();
    chain.reverse();
    chain
}

fn read_channel(
    sampler: &Cursor<'_>,
    path: TargetPath,
    accessors: &Accessors<'_>,
) -> Result<Channel, SceneError> {
    let interpolation = match sampler.get("interpolation")? {
        None => Interpolation::Linear,
        Some(cursor) => match cursor.text()? {
            "LINEAR" => Interpolation::Linear,
            "STEP" => Interpolation::Step,
            "CUBICSPLINE" => Interpolation::Cubic,
            _ => return Err(cursor.error("LINEAR, STEP or CUBICSPLINE is accepted")),
        },
    };
    let input = sampler.require("input")?;
    let times = accessors.get(&input)?;
    if times.kind() != "SCALAR" || !times.is_float() {
        return Err(input.error("an accessor of float scalars (times) is accepted"));
    }
    let times: Vec<f64> = accessors.elements::<1>(times)?.into_iter().map(|[t]| t).collect();
    let ascending = times.windows(2).all(|pair| matches!(pair, [a, b] if a < b));
    if !ascending || times.first().is_none_or(|t| *t < 0.0) {
        return Err(input.error("an accessor of ascending times from 0 on is accepted"));
    }
    let output = sampler.require("output")?;
    let accessor = accessors.get(&output)?;
    let (kind, values): (_, Vec<[f64; 4]>) = match (path, accessor.kind()) {
        (TargetPath::Translation, "VEC3") if accessor.is_float() => {
            let values = accessors.elements::<3>(accessor)?.into_iter();
            ("VEC3", values.map(|[x, y, z]| [x, y, z, 0.0]).collect())
        }
        (TargetPath::Rotation, "VEC4") => ("VEC4", accessors.elements::<4>(accessor)?),
        (TargetPath::Translation, _) => return Err(output.error("an accessor of type VEC3, float")),
        (TargetPath::Rotation, _) => {
            return Err(output.error("an accessor of type VEC4 is accepted"));
        }
    };
    let per_key = if interpolation == Interpolation::Cubic { 3 } else { 1 };
    let expected = times.len().saturating_mul(per_key);
    if values.len() != expected {
        return Err(output.fault(
            format!("{} elements of type {kind} for {} times", values.len(), times.len()),
            format!("{expected} are accepted"),
        ));
    }
    Ok(Channel { path, interpolation, times, values })
}
