//! Collects what is needed to write a layer over a stage.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::motion::Transforms;
use super::source::{StageBody, StageSource};
use super::stage::Stage;
use crate::description::{Body, Motion};

/// Collects the prims of bodies and joints, given by their indices.
pub(super) fn source(
    file: &Path,
    stage: &Stage<'_>,
    transforms: &Transforms,
    bodies: &[(usize, &Body)],
    joints: &[usize],
) -> StageSource {
    let mut source = StageSource {
        file: file.to_owned(),
        layers: stage.layers(),
        units: stage.units,
        has_rate: stage.has_rate,
        default_prim: stage.default_prim(),
        bodies: Vec::with_capacity(bodies.len()),
        joints: joints.iter().map(|prim| path(stage, *prim)).collect(),
        instances: Vec::new(),
    };
    let mut places = BTreeMap::new();
    for (index, (prim, body)) in bodies.iter().enumerate() {
        let chain = transforms.chain(stage, *prim);
        let mut above = Vec::new();
        let mut carrier = None;
        for at in chain.iter().skip(1) {
            carrier = places.get(at).copied();
            if carrier.is_some() {
                break;
            }
            above.extend(transforms.own(*at).cloned());
        }
        let is_written = carrier.is_some() || moves(body);
        if is_written {
            places.insert(*prim, index);
        }
        source.bodies.push(StageBody {
            path: path(stage, *prim),
            is_written,
            reset: transforms.own(*prim).is_some_and(|own| own.reset),
            carrier,
            rest: transforms.of(*prim).scale,
            above,
        });
    }
    let written = bodies.iter().zip(&source.bodies).filter(|(_, own)| own.is_written);
    let changed = written.map(|((prim, _), _)| *prim).chain(joints.iter().copied());
    let above = changed.flat_map(|prim| stage.up(prim).skip(1));
    let instances: BTreeSet<_> =
        above.filter(|(_, prim)| prim.instanceable).map(|(_, prim)| &prim.path).collect();
    source.instances = instances.into_iter().cloned().collect();
    source
}

fn path(stage: &Stage<'_>, prim: usize) -> String {
    stage.prim(prim).map_or_else(String::new, |prim| prim.path.clone())
}

/// Returns true if the simulation may move a body otherwise than the stage does.
fn moves(body: &Body) -> bool {
    let mut velocity = body.linear_velocity.iter().chain(&body.angular_velocity);
    match body.motion {
        Motion::Static => false,
        Motion::Kinematic => body.track.times.is_empty() && velocity.any(|x| *x != 0.0),
        Motion::Dynamic => true,
    }
}
