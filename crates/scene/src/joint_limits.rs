//! Joints as limits and drives of axes: the terms of glTF, and the coordinates that they mean.
//!
//! A limit of one, two or three linear axes is one of the position along an axis, of the distance
//! from a line, or of the distance of two points. A limit of one, two or three angular axes is one
//! of the rotation about an axis, of the angle between two axes, or of the whole angle. If it locks
//! several axes, each is locked by itself.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::f64::consts::FRAC_PI_2;

use crate::format::joint::coordinate::rank;
use crate::joint::{Coordinate, Drive, Joint, JointAxis, Softness};

/// A limit of up to three axes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Limit {
    pub(crate) is_angular: bool,
    /// True for x, y and z if it limits them.
    pub(crate) axes: [bool; 3],
    /// Least and largest value; infinite if there is none. \[m, or rad\]
    pub(crate) range: [f64; 2],
    pub(crate) softness: Option<Softness>,
}

/// A drive of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AxisDrive {
    pub(crate) is_angular: bool,
    pub(crate) axis: usize,
    pub(crate) drive: Drive,
}

/// The limits and drives of a joint.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct JointLimits {
    pub(crate) limits: Vec<Limit>,
    pub(crate) drives: Vec<AxisDrive>,
}

/// Coordinates of a joint, in frames whose x axis is the axis `twist` of the frames of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct JointCoordinates {
    pub(crate) axes: Vec<JointAxis>,
    /// Axis about which twists are measured. The axes that follow it cyclically become y and z.
    pub(crate) twist: usize,
    /// Limits without effect, and the reason.
    pub(crate) notes: Vec<String>,
}

/// Largest position and angle; beyond it, a limit is none. \[m, or rad\]
pub(crate) const FAR: f64 = 1e6;

/// Damping of a drive that keeps its velocity, for programs that know no infinite one.
/// \[N s/m, or N m s/rad\]
const DAMPING: f64 = 1e9;

impl Limit {
    fn count(&self) -> usize {
        self.axes.iter().filter(|limited| **limited).count()
    }

    fn is_lock(&self) -> bool {
        self.range == [0.0, 0.0]
    }

    /// Returns the first axis that it does not limit.
    fn rest(&self) -> usize {
        self.axes.iter().position(|limited| !limited).unwrap_or(0)
    }

    fn indices(&self) -> impl Iterator<Item = usize> {
        (0_usize..3).zip(self.axes).filter(|(_, limited)| *limited).map(|(i, _)| i)
    }
}

/// Extent of the motion about an axis.
#[derive(Clone, Copy, PartialEq)]
enum Width {
    /// Neither limited nor driven.
    Free,
    Locked,
    /// Largest angle. \[rad\]
    Limited(f64),
}

impl JointLimits {
    /// Returns the terms of a joint whose frames have x as the twist axis. Coordinates and values
    /// that the terms lack are left out, or replaced by the nearest.
    pub(crate) fn of(joint: &Joint) -> Self {
        let mut all = Self::default();
        for axis in joint.axes.iter().filter(|_| joint.enabled) {
            let Some((is_angular, axes)) = axes_of(axis.coordinate) else { continue };
            let scale = match axis.coordinate {
                Coordinate::EllipticCone([y, z]) => y.max(z),
                _ => 1.0,
            };
            let unbounded = [f64::NEG_INFINITY, f64::INFINITY];
            let range = axis.limits.unwrap_or(unbounded).map(|x| reachable(x * scale));
            if range != unbounded {
                all.limits.push(Limit { is_angular, axes, range, softness: axis.softness });
            }
            let mut single = (0..3).zip(axes).filter(|(_, limited)| *limited);
            let (Some((index, _)), None) = (single.next(), single.next()) else { continue };
            all.drives.extend(axis.drives.iter().map(|drive| AxisDrive {
                is_angular,
                axis: index,
                drive: finite(*drive),
            }));
        }
        all
    }

    /// Returns the coordinates that the terms mean, in the order of the own format.
    pub(crate) fn coordinates(&self) -> JointCoordinates {
        let twist = self.twist();
        let mut all = JointCoordinates { twist, ..JointCoordinates::default() };
        for limit in &self.limits {
            if limit.count() == 0 || limit.range == [f64::NEG_INFINITY, f64::INFINITY] {
                all.notes.push("a limit without axes, min and max does not act".to_owned());
            } else if limit.count() > 1 && limit.is_lock() {
                for axis in limit.indices() {
                    all.limit(single(limit.is_angular, axis, twist), limit);
                }
            } else {
                match meaning(limit, twist) {
                    Some(coordinate) => all.limit(coordinate, limit),
                    None => all.notes.push(
                        "a cone about another axis than that of the first cone does not act"
                            .to_owned(),
                    ),
                }
            }
        }
        for AxisDrive { is_angular, axis, drive } in &self.drives {
            if drive.stiffness == 0.0 && drive.position != 0.0 {
                let note = "a drive with a positionTarget and no stiffness seeks no position";
                all.notes.push(note.to_owned());
            }
            all.axis(single(*is_angular, *axis, twist)).drives.push(*drive);
        }
        all.axes.sort_by_key(|axis| rank(axis.coordinate));
        all
    }

    /// Chooses the axis about which twists are measured: that of a cone, else the one that turns
    /// widely, as of a hinge, else the only one that is locked, or the only one that is not.
    fn twist(&self) -> usize {
        let cone = |limit: &&Limit| limit.is_angular && limit.count() == 2 && !limit.is_lock();
        if let Some(cone) = self.limits.iter().find(cone) {
            return cone.rest();
        }
        let widths = [0, 1, 2].map(|axis| self.width(axis));
        let angle = |width: Width| match width {
            Width::Limited(angle) => angle,
            _ => 0.0,
        };
        let all = || (0_usize..3).zip(widths);
        let widest = all().fold((0, 0.0), |(best, most), (axis, width)| {
            if angle(width) > most { (axis, angle(width)) } else { (best, most) }
        });
        if widest.1 > FRAC_PI_2 {
            return widest.0;
        }
        let mut locked = all().filter(|(_, width)| *width == Width::Locked).map(|(axis, _)| axis);
        match (locked.next(), locked.next(), locked.next()) {
            (Some(one), None, None) => one,
            (Some(_), Some(_), None) => {
                all().find(|(_, width)| *width != Width::Locked).map_or(0, |(axis, _)| axis)
            }
            _ => widest.0,
        }
    }

    fn width(&self, axis: usize) -> Width {
        let limits = self.limits.iter().filter(|limit| {
            let is_own = limit.axes.get(axis).is_some_and(|limited| *limited);
            limit.is_angular && is_own && (limit.count() == 1 || limit.is_lock())
        });
        let width = limits.fold(Width::Free, |width, limit| {
            let angle = limit.range.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
            match width {
                _ if limit.is_lock() => Width::Locked,
                Width::Locked => Width::Locked,
                Width::Limited(before) => Width::Limited(before.min(angle)),
                Width::Free => Width::Limited(angle),
            }
        });
        let is_driven = self.drives.iter().any(|of| of.is_angular && of.axis == axis);
        if width == Width::Free && is_driven { Width::Limited(f64::INFINITY) } else { width }
    }
}

impl JointCoordinates {
    /// Returns the axis with this coordinate, which is added if it is not there.
    fn axis(&mut self, coordinate: Coordinate) -> &mut JointAxis {
        let is_new = !self.axes.iter().any(|axis| axis.coordinate == coordinate);
        if is_new {
            let (limits, softness, drives, friction) = (None, None, Vec::new(), 0.0);
            self.axes.push(JointAxis { coordinate, limits, softness, drives, friction });
        }
        let place = self.axes.iter().position(|axis| axis.coordinate == coordinate);
        #[expect(clippy::indexing_slicing, reason = "the axis is there")]
        &mut self.axes[place.unwrap_or_default()]
    }

    /// Limits a coordinate; limits of the same coordinate act together.
    fn limit(&mut self, coordinate: Coordinate, limit: &Limit) {
        let [mut low, high] = limit.range;
        if low == f64::NEG_INFINITY && is_distance(coordinate) {
            low = 0.0;
        }
        let axis = self.axis(coordinate);
        let Some([least, most]) = axis.limits else {
            axis.limits = Some([low, high]);
            axis.softness = limit.softness;
            return;
        };
        let both = [low.max(least), high.min(most)];
        let [low, high] = both;
        if axis.softness == limit.softness && low <= high {
            axis.limits = Some(both);
        } else {
            let note = "a second limit of the same axes contradicts the first and does not act";
            self.notes.push(note.to_owned());
        }
    }
}

/// Returns a limit of at most [`FAR`], or an infinite one.
fn reachable(limit: f64) -> f64 {
    if limit.is_finite() { limit.clamp(-FAR, FAR) } else { limit }
}

/// Replaces an infinite damping by [`DAMPING`].
fn finite(drive: Drive) -> Drive {
    let damping = if drive.damping.is_finite() { drive.damping } else { DAMPING };
    Drive { damping, ..drive }
}

/// Returns a limit, or infinity for one beyond [`FAR`].
pub(crate) fn bounded(limit: f64) -> f64 {
    if limit.abs() <= FAR { limit } else { f64::INFINITY.copysign(limit) }
}

/// Returns the axis `axis` of the frames of a file in frames whose x axis is `twist`.
fn turned(axis: usize, twist: usize) -> usize {
    axis.wrapping_add(3).wrapping_sub(twist) % 3
}

/// Returns the coordinate of a single axis.
fn single(is_angular: bool, axis: usize, twist: usize) -> Coordinate {
    match (is_angular, turned(axis, twist)) {
        (false, axis) => Coordinate::Linear(axis),
        (true, 0) => Coordinate::Twist,
        (true, axis) => Coordinate::Swing(axis),
    }
}

/// Returns the coordinate that a limit is about; `None` for a cone about another axis than `twist`.
fn meaning(limit: &Limit, twist: usize) -> Option<Coordinate> {
    match (limit.is_angular, limit.count()) {
        (is_angular, 1) => limit.indices().next().map(|axis| single(is_angular, axis, twist)),
        (false, 2) => Some(Coordinate::Radial(turned(limit.rest(), twist))),
        (false, _) => Some(Coordinate::Distance),
        (true, 2) => (limit.rest() == twist).then_some(Coordinate::Cone),
        (true, _) => Some(Coordinate::Rotation),
    }
}

/// Returns whether a coordinate is angular, and its axes in frames whose x axis is the twist axis;
/// `None` if no limit is about it.
fn axes_of(coordinate: Coordinate) -> Option<(bool, [bool; 3])> {
    let one = |axis: usize| [0, 1, 2].map(|i| i == axis);
    let others = |axis: usize| [0, 1, 2].map(|i| i != axis);
    Some(match coordinate {
        Coordinate::Linear(axis) => (false, one(axis)),
        Coordinate::Radial(axis) => (false, others(axis)),
        Coordinate::Distance => (false, [true; 3]),
        Coordinate::Twist | Coordinate::Angle => (true, one(0)),
        Coordinate::Swing(axis) | Coordinate::Cardan(axis) => (true, one(axis)),
        Coordinate::Cone | Coordinate::EllipticCone(_) => (true, others(0)),
        Coordinate::Rotation => (true, [true; 3]),
        Coordinate::Gear { .. }
        | Coordinate::Rack { .. }
        | Coordinate::Screw { .. }
        | Coordinate::Pulley { .. } => return None,
    })
}

/// Returns true for coordinates that are never negative.
fn is_distance(coordinate: Coordinate) -> bool {
    use Coordinate::{Cone, Distance, Radial, Rotation};
    matches!(coordinate, Radial(_) | Distance | Cone | Rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NO: f64 = f64::INFINITY;

    fn limit(is_angular: bool, axes: &[usize], range: [f64; 2]) -> Limit {
        let axes = [0, 1, 2].map(|i| axes.contains(&i));
        Limit { is_angular, axes, range, softness: None }
    }

    fn linear(axes: &[usize], range: [f64; 2]) -> Limit {
        limit(false, axes, range)
    }

    fn angular(axes: &[usize], range: [f64; 2]) -> Limit {
        limit(true, axes, range)
    }

    fn drive(axis: usize) -> AxisDrive {
        let drive = Drive {
            position: 0.0,
            velocity: 2.0,
            stiffness: 0.0,
            damping: 1.0,
            max_force: NO,
            acceleration: true,
        };
        AxisDrive { is_angular: true, axis, drive }
    }

    /// Returns twist axis, and coordinates with their limits.
    fn read(limits: Vec<Limit>, drives: Vec<AxisDrive>) -> (usize, Vec<(Coordinate, [f64; 2])>) {
        let all = JointLimits { limits, drives }.coordinates();
        let limits = |axis: &JointAxis| (axis.coordinate, axis.limits.unwrap_or([-NO, NO]));
        (all.twist, all.axes.iter().map(limits).collect())
    }

    #[test]
    fn linear_axes_mean_a_plane_a_line_and_a_point() {
        use Coordinate::{Distance, Linear, Radial};
        let (_, axes) = read(
            vec![
                linear(&[1], [-1.0, 2.0]),
                linear(&[0, 2], [0.5, 1.0]),
                linear(&[0, 1, 2], [-NO, 3.0]),
            ],
            vec![],
        );
        let expected = [(Linear(1), [-1.0, 2.0]), (Radial(1), [0.5, 1.0]), (Distance, [0.0, 3.0])];
        assert_eq!(axes, expected);
        let locks = [0, 1, 2].map(|i| (Linear(i), [0.0, 0.0]));
        assert_eq!(read(vec![linear(&[2, 0, 1], [0.0, 0.0])], vec![]).1, locks);
        let apart = [(Linear(0), [1.0, 1.0])];
        assert_eq!(read(vec![linear(&[0], [1.0, 1.0])], vec![]).1, apart);
    }

    /// A hinge about any axis twists about it, so that it counts turns.
    #[test]
    fn hinges_twist() {
        use Coordinate::{Swing, Twist};
        for axis in 0..3 {
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            let locks = vec![angular(&others[..1], [0.0; 2]), angular(&others[1..], [0.0; 2])];
            let expected = vec![(Swing(1), [0.0; 2]), (Swing(2), [0.0; 2])];
            assert_eq!(read(locks.clone(), vec![]), (axis, expected.clone()));
            let turns = [vec![(Twist, [-NO, NO])], expected].concat();
            assert_eq!(read(locks, vec![drive(axis)]), (axis, turns));
            let both = read(vec![angular(&others, [0.0; 2])], vec![]);
            assert_eq!((both.0, both.1.len()), (axis, 2));
        }
    }

    /// Two limits beside a lock are a pyramid; one limit of two axes is a cone; each about the
    /// third axis.
    #[test]
    fn pyramids_and_cones_point_along_their_third_axis() {
        use Coordinate::{Cone, Swing, Twist};
        let pyramid =
            vec![angular(&[0], [-0.7, 0.7]), angular(&[2], [-0.5, 0.5]), angular(&[1], [0.0, 0.0])];
        let expected = vec![(Twist, [0.0, 0.0]), (Swing(1), [-0.5, 0.5]), (Swing(2), [-0.7, 0.7])];
        assert_eq!(read(pyramid, vec![]), (1, expected));
        let cone = vec![angular(&[0, 1], [-NO, 0.4]), angular(&[2], [-0.1, 0.1])];
        assert_eq!(read(cone, vec![]), (2, vec![(Twist, [-0.1, 0.1]), (Cone, [0.0, 0.4])]));
        let cones = vec![angular(&[0, 1], [0.0, 0.4]), angular(&[0, 2], [0.0, 0.4])];
        let all = JointLimits { limits: cones, drives: vec![] }.coordinates();
        assert_eq!((all.axes.len(), all.notes.len()), (1, 1));
    }

    /// Wide limits and driven axes twist, whatever else is locked.
    #[test]
    fn wide_rotations_twist() {
        let one = vec![angular(&[1], [0.0, 0.0])];
        assert_eq!(read(one.clone(), vec![]).0, 1);
        assert_eq!(read(one.clone(), vec![drive(2)]).0, 2);
        assert_eq!(read([one, vec![angular(&[0], [-3.0, 3.0])]].concat(), vec![]).0, 0);
        assert_eq!(read(vec![angular(&[0, 1, 2], [0.0, 0.0])], vec![]).0, 0);
        assert_eq!(read(vec![angular(&[0, 1, 2], [0.0, 1.0])], vec![]).1.len(), 1);
    }

    /// Limits of the same coordinate act together; contradictions and limits without effect are
    /// noted.
    #[test]
    fn limits_of_the_same_axis_act_together() {
        let all = |limits| JointLimits { limits, drives: vec![] }.coordinates();
        let both = all(vec![linear(&[0], [-1.0, 2.0]), linear(&[0], [0.0, 3.0])]);
        assert_eq!(both.axes[0].limits, Some([0.0, 2.0]));
        assert!(both.notes.is_empty());
        let off = all(vec![linear(&[0], [-1.0, 2.0]), linear(&[0], [3.0, 4.0])]);
        assert_eq!((off.axes[0].limits, off.notes.len()), (Some([-1.0, 2.0]), 1));
        let none = all(vec![linear(&[0], [-NO, NO]), linear(&[], [0.0, 1.0])]);
        assert_eq!((none.axes.len(), none.notes.len()), (0, 2));
    }
}
