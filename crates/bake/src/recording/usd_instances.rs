//! Bodies of equal shapes as instances of one prototype, for stages of many pieces.

use std::io;

use super::Recording;
use super::clock::Clock;
use super::pose::{Pose, pose_at};
use drystone_scene::export::usd::{PrimWriter, Prims, list, tuple};
use drystone_scene::{Motion, Scene};

/// Digits of the rotations in half precision, which has about three.
const HALF_DIGITS: f64 = 1e4;

/// Groups of bodies with equal shapes.
pub(super) struct Groups(Vec<Vec<usize>>);

impl Groups {
    /// Groups the dynamic and kinematic bodies that have no joint and do not deform. Each group has two or more.
    pub(super) fn of(scene: &Scene) -> Self {
        let joined = |body: usize| scene.joints.iter().any(|of| of.bodies.contains(&Some(body)));
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (index, body) in scene.bodies.iter().enumerate() {
            let deforms = body.shapes.iter().any(|of| of.kind.vertex_track().is_some());
            let is_alone = body.shapes.is_empty() || joined(index) || deforms;
            if body.motion == Motion::Static || is_alone {
                continue;
            }
            let is_same = |group: &&mut Vec<usize>| scene.bodies[group[0]].shapes == body.shapes;
            match groups.iter_mut().find(is_same) {
                Some(group) => group.push(index),
                None => groups.push(vec![index]),
            }
        }
        groups.retain(|group| group.len() > 1);
        Self(groups)
    }

    /// Returns true if a body is in a group.
    pub(super) fn have(&self, body: usize) -> bool {
        self.0.iter().any(|group| group.binary_search(&body).is_ok())
    }

    /// Returns a prim of type `PointInstancer` for each group. Its ids are the indices of bodies.
    ///
    /// # Errors
    /// If a pose is not finite.
    pub(super) fn prims(
        &self,
        prims: &Prims<'_>,
        recording: &Recording,
        clock: &Clock,
    ) -> io::Result<Vec<PrimWriter>> {
        let prim = |(index, group): (usize, &Vec<usize>)| {
            let name = format!("Instances_{index}");
            instancer(prims, &name, group, (recording, clock))
        };
        self.0.iter().enumerate().map(prim).collect()
    }
}

fn instancer(
    prims: &Prims<'_>,
    name: &str,
    group: &[usize],
    (recording, clock): (&Recording, &Clock),
) -> io::Result<PrimWriter> {
    let mut prim = PrimWriter::new("PointInstancer", name);
    prim.set("int64[] ids", list(group.iter()));
    prim.set("int[] protoIndices", list(group.iter().map(|_| 0)));
    prim.set("rel prototypes", format!("</World/{name}/Prototypes/Shape>"));
    let mut samples: [Vec<(f64, String)>; 3] = Default::default();
    for time in &clock.times {
        let poses: Vec<Pose> = group.iter().map(|body| pose_at(recording, *body, *time)).collect();
        let is_finite =
            |pose: &Pose| pose.position.iter().chain(&pose.rotation).all(|x| x.is_finite());
        if let Some(wrong) = poses.iter().position(|pose| !is_finite(pose)) {
            let message = format!("the pose of body {} at {time} s is not finite", group[wrong]);
            return Err(io::Error::new(io::ErrorKind::InvalidData, message));
        }
        let quaternion = |[x, y, z, w]: [f64; 4]| [w, x, y, z];
        let single = |numbers: [f64; 4]| tuple(&quaternion(numbers).map(|x| x as f32));
        let half = |x: f64| (x * HALF_DIGITS).round() / HALF_DIGITS;
        let texts = [
            list(poses.iter().map(|pose| tuple(&pose.position.map(|x| x as f32)))),
            list(poses.iter().map(|pose| single(pose.rotation))),
            list(poses.iter().map(|pose| tuple(&quaternion(pose.rotation).map(half)))),
        ];
        for (samples, text) in samples.iter_mut().zip(texts) {
            samples.push((clock.code(*time), text));
        }
    }
    // Readers of older versions know rotations in half precision only.
    let names = ["point3f[] positions", "quatf[] orientationsf", "quath[] orientations"];
    for (name, samples) in names.into_iter().zip(samples) {
        let first = samples.first().map(|(_, text)| text.clone());
        let is_constant = samples.windows(2).all(|pair| pair[0].1 == pair[1].1);
        prim.follow(name, samples.into_iter().filter(|_| !is_constant), first);
    }
    // A prototype that is only an `over` is not drawn where it stands.
    let mut shape = PrimWriter::new("Xform", "Shape");
    shape.children = prims.body(group[0]).children;
    shape.children.iter_mut().for_each(|shape| shape.set("bool physics:collisionEnabled", 0));
    let mut prototypes = PrimWriter::over("Prototypes");
    prototypes.children.push(shape);
    prim.children.push(prototypes);
    Ok(prim)
}
