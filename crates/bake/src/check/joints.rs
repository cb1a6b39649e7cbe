//! Findings about joints.

use drystone::JointState;
use drystone_scene::{Coordinate, Joint, JointAxis, Motion, Rotation, Scene};

use super::{Finding, FindingKind, length};

/// Distance of the frames of a joint at the start up to which it counts as rounding. \[m\]
const APART: f64 = 1e-4;
/// Rotation between the frames of a joint at the start up to which it counts as rounding. \[rad\]
const TURNED: f64 = 1e-3;
/// Accepted ratio of the masses of the two bodies of a joint. \[1\]
const RATIO: f64 = 1e3;
/// Largest accepted middle one of three Cardan angles at the start. \[rad\]
const SINGULAR: f64 = 80.0 * std::f64::consts::PI / 180.0;

/// Finds joints that their bodies do not fit at the start. `states` has all joints of the scene as
/// they are then, and `masses` those of the bodies.
pub(super) fn joints(scene: &Scene, states: &[JointState], masses: &[f64]) -> Vec<Finding> {
    let standing = standing(scene);
    let all = scene.joints.iter().zip(states).enumerate();
    let acting = all.filter(|(_, (joint, _))| joint.enabled);
    acting
        .flat_map(|(index, (joint, state))| {
            let at = JointAt { scene, index, joint };
            let mut findings = at.apart(&state.values);
            findings.extend(at.limits(&state.values));
            findings.extend(at.idle(masses));
            findings.extend(at.mass_ratio(masses));
            findings.extend(at.singular());
            findings.extend(at.housing(&standing));
            findings
        })
        .collect()
}

/// A joint of a scene.
struct JointAt<'a> {
    scene: &'a Scene,
    index: usize,
    joint: &'a Joint,
}

impl JointAt<'_> {
    /// Finds a locked position or rotation that the bodies do not have.
    fn apart(&self, values: &[f64]) -> Vec<Finding> {
        let misses = |angle: bool| {
            let locked = self.joint.axes.iter().zip(values).filter(move |(axis, _)| {
                is_locked(axis) && axis.softness.is_none() && is_angle(&axis.coordinate) == angle
            });
            locked.map(|(axis, value)| miss(axis, *value))
        };
        // Positions along three axes make one distance.
        let gap = misses(false).map(|miss| miss * miss).sum::<f64>().sqrt();
        let turn = misses(true).fold(0.0, f64::max);
        let mut findings = Vec::new();
        if gap > APART {
            findings.push(self.finding(
                FindingKind::JointApart,
                [gap, APART],
                |name| format!("the frames of {name} are {} apart at the start", length(gap)),
                &length(APART),
                "repair pulls the bodies together: move them, or the anchors of the joint",
            ));
        }
        if turn > TURNED {
            let degrees = turn.to_degrees();
            findings.push(self.finding(
                FindingKind::JointTurned,
                [turn, TURNED],
                |name| {
                    format!("the frames of {name} are turned by {degrees:.2} degrees at the start")
                },
                &format!("{:.2} degrees", TURNED.to_degrees()),
                "repair turns the bodies: rotate them, or the frames of the joint",
            ));
        }
        findings
    }

    /// Finds the axis that is farthest beyond its limits, of those that are not locked.
    fn limits(&self, values: &[f64]) -> Option<Finding> {
        let limited = self.joint.axes.iter().zip(values).filter(|(axis, _)| !is_locked(axis));
        let tolerance = |axis: &JointAxis| if is_angle(&axis.coordinate) { TURNED } else { APART };
        let excess = |(axis, value): &(&JointAxis, &f64)| miss(axis, **value) / tolerance(axis);
        let (axis, &value) = limited.max_by(|a, b| excess(a).total_cmp(&excess(b)))?;
        let (by, limit) = (miss(axis, value), tolerance(axis));
        if by <= limit {
            return None;
        }
        let shown = |x: f64| match &axis.coordinate {
            Coordinate::EllipticCone(_) => format!("{x:.4}"),
            of if is_angle(of) => format!("{:.2} degrees", x.to_degrees()),
            _ => length(x),
        };
        let [low, high] = axis.limits.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let accepted = match (low.is_finite(), high.is_finite()) {
            (true, true) => format!("{} to {}", shown(low), shown(high)),
            (true, false) => format!("from {}", shown(low)),
            _ => format!("up to {}", shown(high)),
        };
        let coordinate = axis.coordinate.name();
        Some(self.stated(
            FindingKind::JointLimit,
            [by, limit],
            |name| format!("{name} starts beyond its limits: {coordinate} is {}", shown(value)),
            &accepted,
            "repair pushes the bodies back: move them, or widen the limits",
        ))
    }

    /// Finds a joint of two bodies that no force can move.
    fn idle(&self, masses: &[f64]) -> Option<Finding> {
        let mass = |body: Option<usize>| body.map_or(f64::INFINITY, |body| masses[body]);
        let moves = self.joint.bodies.iter().any(|body| mass(*body).is_finite());
        (!moves).then(|| Finding {
            value: None,
            limit: None,
            ..self.finding(
                FindingKind::JointIdle,
                [0.0; 2],
                |name| format!("{name} connects two bodies of infinite mass"),
                "at least one that forces can move",
                "it does nothing: remove it, or give one of its bodies a mass",
            )
        })
    }

    /// Finds a joint whose bodies differ much in mass.
    fn mass_ratio(&self, masses: &[f64]) -> Option<Finding> {
        let [Some(a), Some(b)] = self.joint.bodies else { return None };
        let (heavy, light) = if masses[a] > masses[b] { (a, b) } else { (b, a) };
        let ratio = masses[heavy] / masses[light];
        (ratio.is_finite() && ratio > RATIO).then(|| {
            let [heavy, light] = [heavy, light].map(|body| self.scene.name_of(body));
            self.finding(
                FindingKind::JointMassRatio,
                [ratio, RATIO],
                |name| format!("{name} connects {heavy} with {light}, {ratio:.0} times lighter"),
                &format!("{RATIO}"),
                "rounding may make it jitter: make the heavy one lighter or the light one heavier",
            )
        })
    }

    /// Finds Cardan angles near the place where two of them mean the same rotation.
    fn singular(&self) -> Option<Finding> {
        let is_cardan = |axis: &JointAxis| matches!(axis.coordinate, Coordinate::Cardan(_));
        if !self.joint.axes.iter().any(is_cardan) {
            return None;
        }
        let axis = |side: usize, own: [f64; 3]| {
            let frame = rotated(&self.joint.frames[side].rotation, own);
            match self.joint.bodies[side] {
                Some(body) => rotated(&self.scene.bodies[body].rotation, frame),
                None => frame,
            }
        };
        let sine = -super::dot(&axis(0, [1.0, 0.0, 0.0]), &axis(1, [0.0, 0.0, 1.0]));
        let angle = libm::asin(sine.clamp(-1.0, 1.0));
        (angle.abs() > SINGULAR).then(|| {
            let degrees = angle.to_degrees();
            self.finding(
                FindingKind::JointSingular,
                [angle.abs(), SINGULAR],
                |name| format!("the middle Cardan angle of {name} is {degrees:.1} degrees"),
                &format!("{:.0} degrees", SINGULAR.to_degrees()),
                "near 90 degrees the other two turn about the same axis: choose other axes, or \
                 twist and swing",
            )
        })
    }

    /// Finds a body that turns and bears one of a gear or a rack, which counts its rotation, too.
    fn housing(&self, standing: &[bool]) -> Option<Finding> {
        if !self.joint.axes.iter().any(is_geared) {
            return None;
        }
        let own = |body: usize| self.joint.bodies.contains(&Some(body));
        let bearings = self.scene.joints.iter().filter(|joint| locked_rotations(joint) >= 2);
        let holders = bearings.filter_map(|joint| match joint.bodies {
            [Some(a), Some(b)] if own(a) != own(b) => Some(if own(a) { b } else { a }),
            _ => None,
        });
        let turns = |body: &usize| !standing[*body];
        let holder = self.scene.name_of(holders.filter(turns).min()?);
        Some(Finding {
            value: None,
            limit: None,
            ..self.finding(
                FindingKind::JointHousing,
                [0.0; 2],
                |name| format!("{name} turns bodies that {holder} holds, which moves"),
                "bodies held by the world, or by one that stands still",
                "it counts the rotation of the housing about its axis, too: fix the housing, or drive \
                 each body by a motor",
            )
        })
    }

    /// Makes a finding with an upper bound.
    fn finding(
        &self,
        kind: FindingKind,
        numbers: [f64; 2],
        what: impl FnOnce(&str) -> String,
        accepted: &str,
        advice: &str,
    ) -> Finding {
        let bound =
            if numbers[1] > 0.0 { format!("up to {accepted}") } else { accepted.to_owned() };
        self.stated(kind, numbers, what, &bound, advice)
    }

    /// Makes a finding with the value found and its limit. `what` takes the name of the joint, as in
    /// `joint 'door'`.
    fn stated(
        &self,
        kind: FindingKind,
        [value, limit]: [f64; 2],
        what: impl FnOnce(&str) -> String,
        accepted: &str,
        advice: &str,
    ) -> Finding {
        let name = self.scene.joint_name_of(self.index);
        let what = what(&if self.joint.name.is_some() { format!("joint {name}") } else { name });
        Finding {
            kind,
            bodies: self.joint.bodies.iter().flatten().copied().collect(),
            joint: Some(self.index),
            value: Some(value),
            limit: Some(limit),
            what: format!("{what}; accepted: {accepted}"),
            advice: advice.to_owned(),
        }
    }
}

/// Returns for each body whether it keeps its rotation: it is static, or joints hold it to one that is.
fn standing(scene: &Scene) -> Vec<bool> {
    let mut standing: Vec<_> =
        scene.bodies.iter().map(|body| body.motion == Motion::Static).collect();
    let holds = |joint: &&Joint| locked_rotations(joint) == 3;
    loop {
        let mut found = false;
        for joint in scene.joints.iter().filter(holds) {
            if joint.bodies.iter().any(|body| body.is_none_or(|body| standing[body])) {
                for body in joint.bodies.into_iter().flatten() {
                    found |= !std::mem::replace(&mut standing[body], true);
                }
            }
        }
        if !found {
            return standing;
        }
    }
}

/// Returns the number of relative rotations that a joint takes from its bodies.
fn locked_rotations(joint: &Joint) -> usize {
    let locks = |axis: &&JointAxis| {
        is_locked(axis) && axis.softness.is_none() && is_angle(&axis.coordinate) && !is_geared(axis)
    };
    if joint.enabled { joint.axes.iter().filter(locks).count() } else { 0 }
}

/// Returns true for a coordinate of rotations that are not measured against another body.
fn is_geared(axis: &JointAxis) -> bool {
    matches!(axis.coordinate, Coordinate::Gear { .. } | Coordinate::Rack { .. })
}

fn is_locked(axis: &JointAxis) -> bool {
    axis.limits.is_some_and(|[low, high]| low == high)
}

/// Returns true for a coordinate that is no length.
fn is_angle(coordinate: &Coordinate) -> bool {
    !matches!(
        coordinate,
        Coordinate::Linear(_)
            | Coordinate::Radial(_)
            | Coordinate::Distance
            | Coordinate::Rack { .. }
            | Coordinate::Screw { .. }
            | Coordinate::Pulley { .. }
    )
}

/// Returns by how much a value is beyond the limits of its axis.
fn miss(axis: &JointAxis, value: f64) -> f64 {
    axis.limits.map_or(0.0, |[low, high]| (low - value).max(value - high).max(0.0))
}

/// Rotates a vector by a unit quaternion: v + 2 r × (r × v + w v).
fn rotated(by: &Rotation, v: [f64; 3]) -> [f64; 3] {
    let [x, y, z, w] = by.quaternion();
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let r = [x, y, z];
    let inner = cross(r, v);
    let outer = cross(r, [0, 1, 2].map(|i| inner[i] + w * v[i]));
    [0, 1, 2].map(|i| v[i] + 2.0 * outer[i])
}
