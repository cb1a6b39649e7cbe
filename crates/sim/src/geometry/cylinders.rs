//! Contact of cylinders with each other and with half-spaces, boxes, hulls, balls and capsules. For
//! meshes see `mesh`.
//!
//! A cylinder has a segment as its axis and two discs as caps. The same points always face a plane
//! ([`Facing`]). These are points on the rim of the nearer cap, the first of them in the direction
//! of the lean, and the point above the first on the other rim. A cylinder lies on the line between
//! these two points. The first one is the deepest point of a coin that rolls on its rim. So lying,
//! leaning and standing cylinders are one case.
//!
//! The axis of separation is searched in a few families, each solved for its best member. They are
//! the normals of faces, the axes of the cylinders, the axes across a line and a cylinder
//! ([`PosedCylinder::to_line`]), and those across two rims ([`climb`]). The gap along each
//! candidate is then measured on the whole shapes, so a family that does not apply loses.

use drystone_solver::{Vector, moment};

use super::polyhedra::{Clipper, PREFERENCE, Plane, best_face, edge_beyond};
use super::rounds::{RoundedCore, between_rounds, nearest};
use super::solid::Solid;
use super::{ContactManifold, Frame, ManifoldPoint};

use crate::geometry::Vec3;

/// A cylinder about the y axis of its frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cylinder {
    /// Radius. \[m\]
    pub(super) radius: f32,
    /// Half of the distance between the caps. \[m\]
    pub(super) half_height: f32,
}

/// A cylinder with a position and an orientation.
#[derive(Clone, Copy, Debug)]
pub(super) struct PosedCylinder {
    center: Vec3,
    /// Unit vector along the axis.
    axis: Vec3,
    /// Unit vector across the axis that rotates with the body.
    side: Vec3,
    radius: f32,
    half: f32,
}

/// A cylinder that leans against a face by less than this stands flat on it. The lean is then
/// rounding, and the rim points do not follow it. \[rad\]
const AIMED: f32 = 2e-4;

/// Lines at an angle whose sine is less than this count as parallel. \[1\]
const PARALLEL: f32 = 0.1;

/// Points outside a border by less than this fraction of the size within it count as on the border.
/// \[1\]
const BORDER: f32 = 1e-4;

/// A face is projected along an axis only if the cosine between the axis and its normal is more
/// than this. \[1\]
pub(super) const STEEP: f32 = 0.1;

/// Tolerance of [`deepest_allowed`] as a fraction of the prediction distance. \[1\]
const AS_DEEP: f32 = 1e-3;

/// Tolerance of [`deepest_allowed`] as a fraction of the overlap. \[1\]
const OF_OVERLAP: f32 = 0.25;

/// Relative rounding error: tolerance of [`deepest_allowed`] as a fraction of the size. \[1\]
const ROUNDING: f32 = 1e-6;

/// Penalty of an edge, as a fraction of the difference between its own gap and that of the whole
/// shapes along its axis. \[1\]
const BEHIND: f32 = 0.01;

/// Number of bisections that find a direction to single precision.
const BISECTIONS: usize = 24;

/// Largest number of Newton steps.
const CLIMBS: usize = 16;

/// Kinds of contact points, in the upper bits of their features. Points on the rims have the
/// features 0..8.
const CROSSING: u32 = 1 << 28;
const CUT: u32 = 2 << 28;
const CORNER: u32 = 3 << 28;
const OTHER_RIM: u32 = 1 << 27;
const EDGE: u32 = 5 << 28;
const WHOLE: u32 = 6 << 28;
const BESIDE: u32 = 7 << 28;

/// Cosine and sine of the angles from the lowest point of a rim to others on which a cylinder comes
/// down when it wobbles: 10 and 20 degrees on either side. \[1\]
const WOBBLE: [[f32; 2]; 4] = [
    [0.984_807_8, 0.173_648_2],
    [0.984_807_8, -0.173_648_2],
    [0.939_692_6, 0.342_020_1],
    [0.939_692_6, -0.342_020_1],
];

impl Cylinder {
    pub(super) fn placed(&self, frame: &Frame<3>) -> PosedCylinder {
        PosedCylinder {
            center: frame.position,
            axis: frame.axes[1],
            side: frame.axes[0],
            radius: self.radius,
            half: self.half_height,
        }
    }
}

/// The nearest feature of another shape to a cylinder, or the feature with the least overlap.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearestFeature {
    /// Unit vector from the cylinder to the feature.
    pub(super) normal: Vec3,
    /// Gap along the normal. \[m\]
    pub(super) gap: f32,
    /// Position of the nearest point on a segment, from 0 to 1.
    pub(super) part: f32,
    /// True if the feature is beside the cylinder, not over a rim or a cap.
    beside: bool,
}

/// If the cosine between axis and normal is above this, a cylinder touches with a cap, or with a
/// rim that does not roll. \[1\]
const TILTED: f32 = 0.9;

impl PosedCylinder {
    /// Returns the distance along a normal from the surface to the axis about which the cylinder
    /// rolls; 0 if it touches with a cap. \[m\]
    pub(super) fn rounding_radius(&self, normal: Vec3) -> f32 {
        let cosine = self.axis.dot(normal);
        if cosine.abs() < TILTED { self.radius / (1.0 - cosine * cosine).sqrt() } else { 0.0 }
    }

    /// True if the cylinder stands on a cap along a normal.
    pub(super) fn is_on_cap(&self, normal: Vec3) -> bool {
        self.axis.dot(normal).abs() > 1.0 - 1e-6
    }

    /// Returns the midpoint of the part of the axis that is inside a solid.
    fn within(&self, solid: &impl Solid<3>) -> Option<Vec3> {
        let core = self.core();
        let along = core.ends[1] - core.ends[0];
        let mut range = [0.0f32, 1.0f32];
        for face in 0..solid.faces() {
            let (normal, vertex) = solid.face(face);
            let (height, rise) = (normal.dot(core.ends[0] - vertex), normal.dot(along));
            if rise > 0.0 {
                range[1] = range[1].min(-height / rise);
            } else if rise < 0.0 {
                range[0] = range[0].max(-height / rise);
            } else if height > 0.0 {
                return None;
            }
        }
        (range[0] < range[1]).then(|| core.at(0.5 * (range[0] + range[1])))
    }

    /// Returns the gap along an axis from a solid to the cylinder. \[m\]
    fn gap_along(&self, n: Vec3, solid: &impl Solid<3>) -> f32 {
        n.dot(self.center - solid.support(n)) - self.extent(n)
    }

    fn size(&self) -> f32 {
        self.radius + self.half
    }

    pub(super) fn center(&self) -> Vec3 {
        self.center
    }

    /// Returns the outward normal and the center of each cap.
    pub(super) fn caps(&self) -> [(Vec3, Vec3); 2] {
        [self.axis, -self.axis].map(|normal| (normal, self.center + normal * self.half))
    }

    /// Returns the square of the radius. \[m^2\]
    pub(super) fn disc(&self) -> f32 {
        self.radius * self.radius
    }

    /// Returns the coordinates of a point in the plane across the axis, from the axis. \[m\]
    pub(super) fn seen_along(&self, point: Vec3) -> [f32; 2] {
        let arm = point - self.center;
        let other: Vec3 = moment(self.axis, self.side);
        [self.side.dot(arm), other.dot(arm)]
    }

    /// True if a segment is certainly farther away than `prediction`. \[m\]
    pub(super) fn is_beyond(&self, ends: [Vec3; 2], prediction: f32) -> bool {
        let (core, own) = (self.core(), RoundedCore { ends, radius: 0.0 });
        let [s, t] = nearest(&core, &own);
        let apart = core.at(s) - own.at(t);
        let reach = self.radius + prediction;
        apart.dot(apart) > reach * reach
    }

    /// Returns candidates for the separation from a segment. The first is the nearest way out. If
    /// the segment has entered through the side, the second leads out through the opposite side.
    pub(super) fn nearest_features(&self, ends: [Vec3; 2]) -> impl Iterator<Item = NearestFeature> {
        let found = self.to_segment(ends);
        let passed = found.beside && found.gap < 0.0;
        let gap = -found.gap - 2.0 * self.radius;
        let other = NearestFeature { normal: -found.normal, gap, ..found };
        [Some(found), passed.then_some(other)].into_iter().flatten()
    }

    /// Returns the contact points on the cylinder and on an edge, along a candidate from
    /// [`Self::nearest_features`]. If edge and axis are parallel, these are both ends of their
    /// common part, else the nearest points.
    pub(super) fn contact_points_on(
        &self,
        [from, to]: [Vec3; 2],
        found: &NearestFeature,
        prediction: f32,
    ) -> [Option<[Vec3; 2]>; 2] {
        let (normal, along) = (-found.normal, to - from);
        let across: Vec3 = moment(along, self.axis);
        let nearest = from + along * found.part;
        let single = [Some([nearest + normal * found.gap, nearest]), None];
        // A rim that leans against the edge by rounding stands on it as the side does.
        if normal.dot(self.axis).abs() >= PARALLEL
            || across.dot(across) >= PARALLEL * PARALLEL * along.dot(along)
        {
            return single;
        }
        let (rise, start) = (self.axis.dot(along), self.axis.dot(from - self.center));
        let flank = self.flank(-normal);
        let parts = [-self.half, self.half].map(|end| ((end - start) / rise).clamp(0.0, 1.0));
        let both = parts.map(|part| {
            let at = self.center + self.axis * (start + rise * part) + flank;
            [at, from + along * part]
        });
        let gaps = both.map(|[on_a, on_b]| normal.dot(on_a - on_b));
        let deepest = gaps[0].min(gaps[1]);
        if parts[0] == parts[1] || deepest > deepest_allowed(found.gap, self.size(), prediction) {
            return single;
        }
        both.map(Some)
    }

    /// Returns the component of a direction across the axis.
    fn across(&self, direction: Vec3) -> Vec3 {
        direction - self.axis * self.axis.dot(direction)
    }

    /// Returns the farthest point along a direction.
    fn support(&self, direction: Vec3) -> Vec3 {
        let cap = self.axis * self.half.copysign(self.axis.dot(direction));
        self.center + cap + self.flank(direction)
    }

    /// Returns the extent along a unit vector, from the center. \[m\]
    pub(super) fn extent(&self, direction: Vec3) -> f32 {
        let along = self.axis.dot(direction);
        self.half * along.abs() + self.radius * self.across(direction).length()
    }

    /// Returns the axis as the core of a capsule.
    fn core(&self) -> RoundedCore<3> {
        let arm = self.axis * self.half;
        RoundedCore { ends: [self.center - arm, self.center + arm], radius: self.radius }
    }

    /// Returns the offset from the axis to the line on the side that is farthest along a direction.
    /// \[m\]
    fn flank(&self, direction: Vec3) -> Vec3 {
        let across = self.across(direction);
        let length = across.length();
        if length > 0.0 { self.level(across * (1.0 / length)) * self.radius } else { across }
    }

    /// Moves a point that is farther from the axis than the side towards the axis, onto the side.
    fn onto(&self, point: Vec3) -> Vec3 {
        let out = self.across(point - self.center);
        point - out * (1.0 - self.radius / out.length()).max(0.0)
    }

    /// Removes the component along the axis that rounding has left in a unit vector across it. This
    /// component is large if the vector was short before it was normalized.
    fn level(&self, across: Vec3) -> Vec3 {
        across - self.axis * self.axis.dot(across)
    }

    /// Finds the nearest way from the surface to a point.
    fn to_point(self, point: Vec3, part: f32) -> NearestFeature {
        let arm = point - self.center;
        let along = self.axis.dot(arm);
        let across = arm - self.axis * along;
        let distance = across.length();
        let outward = if distance > 0.0 { across * (1.0 / distance) } else { self.side };
        let upward = self.axis * 1.0f32.copysign(along);
        let (out, up) = (distance - self.radius, along.abs() - self.half);
        let (normal, gap) = if out > 0.0 && up > 0.0 {
            let gap = (out * out + up * up).sqrt();
            ((outward * out + upward * up) * (1.0 / gap), gap)
        } else if out > up {
            (outward, out)
        } else {
            (upward, up)
        };
        NearestFeature { normal, gap, part, beside: out > 0.0 && up <= 0.0 }
    }

    /// Finds the best axis between the surface and the line through a point along a unit vector e.
    ///
    /// Seen along e, the line is a point. The cylinder is the projection of its axis, a segment,
    /// with half an ellipse, its cap, about each end. With x along the segment, the ellipse has the
    /// half axes r |e . u| and r. In the direction n = (x, y) the gap is X x + Y y - r sqrt(y^2 +
    /// (e . u)^2 x^2), with (X, Y) from the end of the segment to the point. The gap is largest
    /// where its derivative vanishes.
    fn to_line(self, point: Vec3, e: Vec3) -> NearestFeature {
        let arm = point - self.center;
        let arm = arm - e * e.dot(arm);
        let up = self.axis - e * e.dot(self.axis);
        let sine = up.length();
        if sine < 1e-6 {
            let distance = arm.length();
            let across = if distance > 0.0 { arm } else { self.across(self.side) };
            let normal = across * (1.0 / across.length());
            return NearestFeature { normal, gap: distance - self.radius, part: 0.0, beside: true };
        }
        let axes = [up * (1.0 / sine), moment(e, up * (1.0 / sine))];
        let at = axes.map(|axis| axis.dot(arm));
        let beyond = [at[0].abs() - self.half * sine, at[1].abs()];
        let cosine = e.dot(self.axis).abs();
        let ellipse = |[x, y]: [f32; 2]| (y * y + cosine * cosine * x * x).sqrt();
        let n = if beyond[0] <= 0.0 {
            let over = beyond[0] - self.radius * cosine > beyond[1] - self.radius;
            if over { [1.0, 0.0] } else { [0.0, 1.0] }
        } else {
            let mut range = [0.0, 1.0];
            for _ in 0..BISECTIONS {
                let y = 0.5 * (range[0] + range[1]);
                let x = 1.0 - y;
                let curved = self.radius * sine * sine * x * y / ellipse([x, y]);
                let rises = beyond[1] * x - beyond[0] * y > curved;
                range[usize::from(!rises)] = y;
            }
            let y = 0.5 * (range[0] + range[1]);
            let length = ((1.0 - y) * (1.0 - y) + y * y).sqrt();
            [(1.0 - y) / length, y / length]
        };
        let gap = beyond[0] * n[0] + beyond[1] * n[1] - self.radius * ellipse(n);
        let normal = axes[0] * n[0].copysign(at[0]) + axes[1] * n[1].copysign(at[1]);
        NearestFeature { normal, gap, part: 0.0, beside: n[0] == 0.0 }
    }

    /// Finds the nearest way from the surface to a segment.
    fn to_segment(self, [from, to]: [Vec3; 2]) -> NearestFeature {
        let length = (to - from).length();
        if length == 0.0 {
            return self.to_point(from, 0.0);
        }
        let e = (to - from) * (1.0 / length);
        let found = self.to_line(from, e);
        let (arm, cosine) = (from - self.center, e.dot(self.axis));
        let at = if !found.beside {
            e.dot(self.support(found.normal) - from)
        } else {
            let across: Vec3 = moment(e, self.axis);
            let squared = across.dot(across);
            if squared > 1e-8 {
                (cosine * self.axis.dot(arm) - e.dot(arm)) / squared
            } else {
                // Take the middle of the part that lies along the cylinder.
                let ends = [-self.half, self.half]
                    .map(|end| ((end - self.axis.dot(arm)) * cosine).clamp(0.0, length));
                if ends[0] == ends[1] {
                    let part = ends[0] / length;
                    return self.to_point(from + (to - from) * part, part);
                }
                0.5 * (ends[0] + ends[1])
            }
        };
        if (0.0..=length).contains(&at) {
            return NearestFeature { part: at / length, ..found };
        }
        let part = if at <= 0.0 { 0.0 } else { 1.0 };
        self.to_point(if part == 0.0 { from } else { to }, part)
    }

    /// Returns the points that face a plane with this outward normal, aimed at the lowest point of
    /// the rim. `before` is the feature of a contact point of the step before.
    pub(super) fn facing(&self, normal: Vec3, before: Option<u64>) -> Facing {
        let along = self.axis.dot(normal);
        let lean = self.axis * along - normal;
        let sine = lean.length();
        let aimed = sine > AIMED;
        let first = if aimed { self.level(lean * (1.0 / sine)) } else { self.side };
        let second: Vec3 = moment(self.axis, first);
        let toward = self.axis * 1.0f32.copysign(-along);
        let center = self.center + toward * self.half;
        let quarter = match before {
            _ if !aimed => 0,
            // The lowest point keeps its feature as it moves around the rim.
            Some(name) if name < 8 => name as u32 & 3,
            _ => {
                let other: Vec3 = moment(self.axis, self.side);
                let at = [self.side.dot(first), other.dot(first)];
                let axis = usize::from(at[1].abs() > at[0].abs());
                axis as u32 + if at[axis] > 0.0 { 0 } else { 2 }
            }
        };
        let cap = if along > 0.0 { 0 } else { 4 };
        let arms = [first * self.radius, second * self.radius];
        let above = aimed.then(|| center - toward * (2.0 * self.half) + arms[0]);
        let rolls = self.rounding_radius(normal) > 0.0;
        Facing { center, toward, arms, quarter, cap, above, rolls }
    }
}

/// The points of a cylinder that can touch a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    /// Center of the nearer cap. \[m\]
    center: Vec3,
    /// Outward normal of that cap.
    toward: Vec3,
    /// Arms from the center to the rim: to its lowest point, and to the point a quarter turn on.
    /// \[m\]
    arms: [Vec3; 2],
    /// Quarter in which the lowest point was when it got its feature.
    quarter: u32,
    /// Offset of the cap in features: 0 or 4.
    cap: u32,
    /// Point on the rim of the other cap above the lowest point; none if the cylinder stands flat.
    above: Option<Vec3>,
    /// True if the cylinder rolls on the lowest point. Other rim points then do not come down as it
    /// rolls.
    rolls: bool,
}

impl Facing {
    /// Returns each point with its feature.
    pub(super) fn points(&self) -> impl Iterator<Item = (Vec3, u32)> {
        let [first, second] = self.arms;
        let name = |of: u32, cap: u32| cap + ((self.quarter + of) & 3);
        let rim = [first, second, -first, -second].into_iter().zip(0..);
        let (center, cap) = (self.center, self.cap);
        let above = self.above.map(|above| (above, name(0, 4 - cap)));
        let rim = rim.take(if self.rolls { 1 } else { 4 });
        let rim = rim.map(move |(arm, of)| (center + arm, name(of, cap)));
        rim.chain(above)
    }

    /// Returns these points, and those beside the lowest one on which the cylinder comes down when
    /// it wobbles.
    fn points_and_beside(&self) -> impl Iterator<Item = (Vec3, u32)> {
        let wobbles = self.above.is_some() && !self.rolls;
        let ([first, second], center) = (self.arms, self.center);
        let beside = WOBBLE.into_iter().zip(BESIDE..).take(if wobbles { 4 } else { 0 });
        let at = move |[cosine, sine]: [f32; 2]| center + first * cosine + second * sine;
        self.points().chain(beside.map(move |(angle, name)| (at(angle), name)))
    }

    /// Returns the line on which the cylinder lies: its start, and the vector to its end.
    pub(super) fn line(&self) -> Option<[Vec3; 2]> {
        let start = self.center + self.arms[0];
        self.above.map(|above| [start, above - start])
    }

    /// Moves a point along `normal` to the plane of the cap. Returns it and the distance \[m\], or
    /// `None` if the cap faces sideways.
    fn lifted(&self, point: Vec3, normal: Vec3) -> Option<(Vec3, f32)> {
        let cosine = -self.toward.dot(normal);
        let gap = self.toward.dot(point - self.center) / cosine;
        (cosine > STEEP).then(|| (point + normal * gap, gap))
    }

    /// Returns the contact of a point of another shape with the cap, seen along `normal`.
    fn on_cap(&self, on_b: Vec3, normal: Vec3, name: u32) -> Option<ManifoldPoint<3>> {
        let (on_a, gap) = self.lifted(on_b, normal).filter(|(on_a, _)| self.holds(*on_a))?;
        Some(point(on_a, on_b, gap, name))
    }

    /// True if a point in the plane of the cap is on the cap.
    fn holds(&self, point: Vec3) -> bool {
        within(point - self.center, self.arms[0].dot(self.arms[0]))
    }
}

/// True if the end of this arm is in a disc about its start; `squared` is the square of the radius.
pub(super) fn within(arm: Vec3, squared: f32) -> bool {
    arm.dot(arm) <= squared * (1.0 + 2.0 * BORDER)
}

fn point(on_a: Vec3, on_b: Vec3, gap: f32, name: u32) -> ManifoldPoint<3> {
    ManifoldPoint { on_a, on_b, gap, feature: u64::from(name) }
}

/// Keeps the points within `prediction`. Returns true if the deepest one represents a contact with
/// this gap. \[m\]
fn is_supported(touch: &mut ContactManifold<3>, gap: f32, size: f32, prediction: f32) -> bool {
    touch.points.retain(|point| point.gap <= prediction);
    let least = touch.points.iter().map(|point| point.gap).fold(f32::INFINITY, f32::min);
    least <= deepest_allowed(gap, size, prediction)
}

/// Returns the largest gap of a point that represents a contact with this gap. \[m\]
fn deepest_allowed(gap: f32, size: f32, prediction: f32) -> f32 {
    gap + AS_DEEP * prediction + OF_OVERLAP * (-gap).max(0.0) + ROUNDING * size
}

/// Fills `touch` with the contact points of a cylinder, as a, and a half-space, up to a gap of
/// `prediction` \[m\]. Returns the gap. \[m\]
pub(super) fn on_plane(
    cylinder: &PosedCylinder,
    plane: &Plane<3>,
    prediction: f32,
    before: Option<u64>,
    touch: &mut ContactManifold<3>,
) -> f32 {
    touch.normal = plane.normal;
    let mut apart = f32::INFINITY;
    for (on_a, name) in cylinder.facing(plane.normal, before).points_and_beside() {
        let gap = plane.normal.dot(on_a - plane.point);
        apart = apart.min(gap);
        if gap <= prediction {
            touch.points.push(point(on_a, on_a - plane.normal * gap, gap, name));
        }
    }
    touch.reduce();
    apart
}

/// Appends the contact points of a cylinder over a face of a solid, as seen along `normal`, which
/// points from the solid to the cylinder.
fn over_polygon(
    cylinder: &PosedCylinder,
    (solid, face): (&impl Solid<3>, usize),
    normal: Vec3,
    before: Option<u64>,
    clipper: &mut Clipper<3>,
    touch: &mut ContactManifold<3>,
) {
    touch.normal = normal;
    let (upright, vertex) = solid.face(face);
    let cosine = upright.dot(normal);
    if cosine < STEEP {
        return;
    }
    let facing = cylinder.facing(upright, before);
    let dropped = |on_a: Vec3, name: u32| {
        let gap = upright.dot(on_a - vertex) / cosine;
        point(on_a, on_a - normal * gap, gap, name)
    };
    touch.points.extend(facing.points_and_beside().map(|(at, name)| dropped(at, name)));
    let Clipper { reference: memory, incident: corners, .. } = clipper;
    let mut lying = facing.line().map(LyingLine::new);
    let mut number = 0;
    solid.sides(face, memory, |on_side, outward| {
        // Tilt the plane of the side, so that it clips points before they are projected along
        // `normal`.
        let on_side = on_side + upright * upright.dot(vertex - on_side);
        let outward = outward - upright * (outward.dot(normal) / cosine);
        if let Some(line) = &mut lying {
            line.cut(on_side, outward, number);
        }
        for (which, at) in crossings(&facing, on_side, outward).into_iter().flatten().enumerate() {
            touch.points.push(dropped(at, CROSSING | (2 * number) | which as u32));
        }
        number += 1;
    });
    for (at, side) in lying.iter().flat_map(LyingLine::cuts) {
        touch.points.push(dropped(at, CUT | side));
    }
    number = 0;
    solid.sides(face, memory, |on_side, outward| {
        let border = BORDER * outward.dot(outward);
        touch.points.retain(|point| {
            point.feature as u32 >> 1 == (CROSSING | (2 * number)) >> 1
                || outward.dot(point.on_b - on_side) <= border
        });
        number += 1;
    });
    // A cylinder rolls on its lowest point, if the face is below it. Others do not come down.
    let crosses = |point: &ManifoldPoint<3>| point.feature as u32 >> 28 == CROSSING >> 28;
    if facing.rolls && !touch.points.iter().all(crosses) {
        touch.points.retain(|point| !crosses(point));
    }
    corners.clear();
    solid.corners(face, corners);
    let lifted = corners.iter().map(|corner| (corner.position, CORNER | corner.feature));
    touch.points.extend(lifted.filter_map(|(on_b, name)| facing.on_cap(on_b, normal, name)));
}

/// The line on which a cylinder lies, and the part of it over a face.
struct LyingLine {
    start: Vec3,
    /// Vector to the end.
    along: Vec3,
    /// Ends of the part, from 0 to 1.
    range: [f32; 2],
    /// Sides of the face that cut the line there.
    sides: [Option<u32>; 2],
}

impl LyingLine {
    fn new([start, along]: [Vec3; 2]) -> Self {
        Self { start, along, range: [0.0, 1.0], sides: [None; 2] }
    }

    /// Keeps the part behind the plane through a side.
    fn cut(&mut self, on_side: Vec3, outward: Vec3, side: u32) {
        let (height, rise) = (outward.dot(self.start - on_side), outward.dot(self.along));
        let end = usize::from(rise > 0.0);
        let part = -height / rise;
        if rise == 0.0 && height > 0.0 {
            self.range = [1.0, 0.0];
        } else if rise > 0.0 && part < self.range[1] || rise < 0.0 && part > self.range[0] {
            (self.range[end], self.sides[end]) = (part, Some(side));
        }
    }

    /// Returns the points at which sides cut it, each with its side.
    fn cuts(&self) -> impl Iterator<Item = (Vec3, u32)> {
        let is_over = self.range[0] < self.range[1];
        let ends = self.range.into_iter().zip(self.sides).filter(move |_| is_over);
        ends.filter_map(|(part, side)| Some((self.start + self.along * part, side?)))
    }
}

/// Returns the points at which the rim of the nearer cap crosses a plane.
fn crossings(facing: &Facing, on_plane: Vec3, outward: Vec3) -> [Option<Vec3>; 2] {
    // Solve a x + b y = c with x^2 + y^2 = 1.
    let [a, b] = facing.arms.map(|arm| outward.dot(arm));
    let c = outward.dot(on_plane - facing.center);
    let squared = a * a + b * b;
    let left = squared - c * c;
    if left <= 0.0 || squared <= 0.0 {
        return [None; 2];
    }
    let root = left.sqrt();
    [root, -root].map(|root| {
        let (x, y) = ((a * c - b * root) / squared, (b * c + a * root) / squared);
        Some(facing.center + facing.arms[0] * x + facing.arms[1] * y)
    })
}

/// Appends the contact points of a cylinder over a cap of another, as seen along `normal`, which
/// points out of that cap.
fn over_cap(
    cylinder: &PosedCylinder,
    other: &PosedCylinder,
    normal: Vec3,
    before: Option<u64>,
    touch: &mut ContactManifold<3>,
) {
    touch.normal = normal;
    let middle = other.center + normal * other.half;
    let squared = other.radius * other.radius;
    let dropped = |on_a: Vec3, name: u32| {
        let gap = normal.dot(on_a - middle);
        point(on_a, on_a - normal * gap, gap, name)
    };
    let facing = cylinder.facing(normal, before);
    let points = facing.points_and_beside().map(|(at, name)| dropped(at, name));
    touch.points.extend(points.filter(|point| within(point.on_b - middle, squared)));
    if let Some([start, along]) = facing.line() {
        let arm = dropped(start, 0).on_b - middle;
        let flat = along - normal * normal.dot(along);
        let range = in_disc(arm, flat, squared);
        for (end, part) in range.into_iter().enumerate() {
            if range[0] < range[1] && part > 0.0 && part < 1.0 {
                touch.points.push(dropped(start + along * part, CUT | end as u32));
            }
        }
    }
    // Parallel caps: their rims cross here. Otherwise these points are not on the cap and drop out.
    let center = facing.center - normal * normal.dot(facing.center - middle);
    let between = middle - center;
    let distance = between.length();
    let foot =
        (distance * distance + cylinder.radius * cylinder.radius - squared) / (2.0 * distance);
    let left = cylinder.radius * cylinder.radius - foot * foot;
    if distance > 0.0 && left > 0.0 {
        let along = between * (1.0 / distance);
        let aside: Vec3 = moment(normal, along);
        for (which, root) in [left.sqrt(), -left.sqrt()].into_iter().enumerate() {
            let on_b = center + along * foot + aside * root;
            touch.points.extend(facing.on_cap(on_b, normal, CROSSING | which as u32));
        }
    }
    for (on_b, name) in other.facing(facing.toward, None).points_and_beside() {
        touch.points.extend(facing.on_cap(on_b, normal, OTHER_RIM | name));
    }
}

/// Returns the range of a line from `arm` along `along`, from 0 to 1, that is in a disc about the
/// origin; `squared` is the square of its radius. If there is none, the first number is larger than
/// the second.
pub(super) fn in_disc(arm: Vec3, along: Vec3, squared: f32) -> [f32; 2] {
    let (a, b, c) = (along.dot(along), arm.dot(along), arm.dot(arm) - squared);
    let left = b * b - a * c;
    if left <= 0.0 || a <= 0.0 {
        return if c <= 0.0 { [0.0, 1.0] } else { [1.0, 0.0] };
    }
    let root = left.sqrt();
    [((-b - root) / a).max(0.0), ((-b + root) / a).min(1.0)]
}

/// Fills `touch` with the contact points of a cylinder, as a, and a solid, up to a gap of
/// `prediction` \[m\], in the frame of the solid. Returns a lower bound of the gap. \[m\] `before`
/// is the feature of a contact point of the step before.
pub(super) fn on_solid(
    cylinder: &PosedCylinder,
    solid: &impl Solid<3>,
    prediction: f32,
    before: Option<u64>,
    clipper: &mut Clipper<3>,
    touch: &mut ContactManifold<3>,
) -> f32 {
    let size = cylinder.size();
    let best = best_face(solid, cylinder.center, prediction, |d| cylinder.support(d));
    let mut gap = best.gap;
    if gap > prediction {
        return gap;
    }
    let upright = solid.face(best.face).0;
    over_polygon(cylinder, (solid, best.face), upright, before, clipper, touch);
    let mut supported = is_supported(touch, gap, size, prediction);
    if supported && (gap >= 0.0 || best.is_sure(solid)) {
        touch.reduce();
        return gap;
    }
    let beyond = if supported { gap + PREFERENCE * prediction } else { gap };
    let caps = [cylinder.axis, -cylinder.axis].map(|n| (cylinder.gap_along(n, solid), n));
    let cap = if caps[1].0 > caps[0].0 { caps[1] } else { caps[0] };
    if cap.0 > beyond {
        gap = cap.0;
        touch.points.clear();
        if gap > prediction {
            return gap;
        }
        let face = solid.facing(cap.1);
        over_polygon(cylinder, (solid, face), cap.1, before, clipper, touch);
        supported = is_supported(touch, gap, size, prediction);
    }
    if supported && gap >= 0.0 {
        touch.reduce();
        return gap;
    }
    let beyond = if supported { edge_beyond(gap, prediction) } else { gap };
    if let Some((edge, ends, found)) = best_edge(cylinder, solid, prediction, beyond) {
        gap = found.gap;
        touch.points.clear();
        if gap <= prediction {
            on_edge(cylinder, (edge, ends), &found, prediction, touch);
        }
    } else if touch.points.is_empty() {
        let Some(on_a) = cylinder.within(solid) else { return gap.max(prediction) };
        touch.points.push(point(on_a, on_a - touch.normal * gap, gap, WHOLE));
    }
    touch.reduce();
    gap
}

/// Returns the edge of a solid along whose axis it is farthest from a cylinder, with its ends, if
/// the gap is more than `beyond` \[m\].
fn best_edge(
    cylinder: &PosedCylinder,
    solid: &impl Solid<3>,
    prediction: f32,
    beyond: f32,
) -> Option<(usize, [Vec3; 2], NearestFeature)> {
    let mut best = (beyond, None);
    for edge in 0..solid.edges() {
        let ends = solid.edge(edge);
        if cylinder.is_beyond(ends, prediction) {
            continue;
        }
        for found in cylinder.nearest_features(ends).filter(|found| found.gap <= prediction) {
            let gap = cylinder.gap_along(-found.normal, solid);
            // Among edges with the same axis, prefer the one that touches.
            let value = gap - BEHIND * (found.gap - gap).abs();
            if value > best.0 {
                best = (value, Some((edge, ends, NearestFeature { gap, ..found })));
            }
        }
    }
    best.1
}

/// Fills `touch` with the contact points of a cylinder and an edge along the axis of `found`.
fn on_edge(
    cylinder: &PosedCylinder,
    (edge, ends): (usize, [Vec3; 2]),
    found: &NearestFeature,
    prediction: f32,
    touch: &mut ContactManifold<3>,
) {
    touch.normal = -found.normal;
    let places = cylinder.contact_points_on(ends, found, prediction);
    let both = u32::from(places[1].is_some());
    for ([on_a, on_b], end) in places.into_iter().flatten().zip(both..) {
        let gap = touch.normal.dot(on_a - on_b);
        if gap <= prediction || both == 0 {
            let name = EDGE | end << 24 | edge as u32 & 0xff_ffff;
            touch.points.push(point(on_a, on_b, if both == 0 { found.gap } else { gap }, name));
        }
    }
}

/// Fills `touch` with the contact points of a cylinder, as a, and a ball or capsule, up to a gap of
/// `prediction` \[m\]. Returns the gap. \[m\]
pub(super) fn on_round(
    cylinder: &PosedCylinder,
    round: &RoundedCore<3>,
    prediction: f32,
    touch: &mut ContactManifold<3>,
) -> f32 {
    let mut found = cylinder.to_segment(round.ends);
    if found.gap < 0.0 {
        // The core is in the cylinder: find the shortest way out for all of it.
        let middle = round.at(0.5) - cylinder.center;
        let across: Vec3 = moment(cylinder.axis, round.ends[1] - round.ends[0]);
        let separates = |normal: Vec3| {
            let [from, to] = round.ends.map(|end| normal.dot(end - cylinder.center));
            let part = if from < to { 0.0 } else { 1.0 };
            (from.min(to) - cylinder.extent(normal), part)
        };
        found.gap = separates(found.normal).0;
        let ways = [cylinder.axis, across, cylinder.across(middle)];
        for way in ways.into_iter().filter(|way| way.dot(*way) > 0.0) {
            let normal = way * (1.0f32.copysign(way.dot(middle)) / way.length());
            let (gap, part) = separates(normal);
            if gap > found.gap {
                found = NearestFeature { normal, gap, part, beside: false };
            }
        }
    }
    let gap = found.gap - round.radius;
    if gap > prediction {
        return gap;
    }
    let along = round.ends[1] - round.ends[0];
    let upright = cylinder.axis.dot(found.normal);
    if found.beside && along != Vector::ZERO {
        return between_rounds(&cylinder.core(), round, prediction, touch);
    }
    let rise = found.normal.dot(along);
    if upright.abs() > 1.0 - 1e-6 && rise * rise < PARALLEL * PARALLEL * along.dot(along) {
        let normal = cylinder.axis * -1.0f32.copysign(upright);
        let arm = cylinder.across(round.ends[0] - cylinder.center);
        let over = in_disc(arm, cylinder.across(along), cylinder.radius * cylinder.radius);
        if over[0] < over[1] {
            touch.normal = normal;
            let cap = cylinder.center - normal * cylinder.half;
            for (part, name) in over.into_iter().zip(1..) {
                let on_b = round.at(part) + normal * round.radius;
                let gap = normal.dot(cap - on_b);
                if gap <= prediction {
                    touch.points.push(point(on_b + normal * gap, on_b, gap, WHOLE | name));
                }
            }
            return gap;
        }
    }
    touch.normal = -found.normal;
    let on_b = round.at(found.part) + touch.normal * round.radius;
    touch.points.push(point(on_b + touch.normal * gap, on_b, gap, WHOLE));
    gap
}

/// Fills `touch` with the contact points of two cylinders, up to a gap of `prediction` \[m\].
/// Returns a lower bound of the gap. \[m\]
pub(super) fn between(
    a: &PosedCylinder,
    b: &PosedCylinder,
    prediction: f32,
    before: Option<u64>,
    touch: &mut ContactManifold<3>,
) -> f32 {
    let apart = a.center - b.center;
    let caps = [a, b].map(|of| {
        let n = of.axis * 1.0f32.copysign(of.axis.dot(apart));
        (gap_between([a, b], n), n)
    });
    let of_b = caps[1].0 > caps[0].0 + PREFERENCE * prediction;
    let cap = caps[usize::from(of_b)];
    if cap.0 > prediction {
        return cap.0;
    }
    let (mut gap, normal) = best_axis([a, b], cap, prediction);
    if gap > prediction {
        return gap;
    }
    let size = a.size().max(b.size());
    if gap <= edge_beyond(cap.0, prediction) {
        if of_b {
            over_cap(a, b, cap.1, before, touch);
        } else {
            over_cap(b, a, -cap.1, before, touch);
            touch.exchange();
        }
        if is_supported(touch, cap.0, size, prediction) || gap <= cap.0 {
            if touch.points.is_empty() {
                let (on_a, gap) = nearest_on_rim([a, b], cap, prediction);
                let on_b = b.onto(on_a - cap.1 * gap);
                touch.points.push(point(on_a, on_b, gap, WHOLE));
            }
            touch.reduce();
            return cap.0;
        }
        touch.points.clear();
    }
    touch.normal = normal;
    gap = flanks([a, b], (normal, gap), prediction, touch).unwrap_or_else(|| {
        // The sides cross, or a rim touches.
        let cosines = [a, b].map(|of| of.axis.dot(normal).abs());
        let on_a = if cosines[0].max(cosines[1]) < AIMED {
            let [s, _] = nearest(&a.core(), &b.core());
            a.core().at(s) + a.flank(-normal)
        } else if cosines[0] > cosines[1] {
            nearest_on_rim([a, b], (gap, normal), prediction).0
        } else {
            nearest_on_rim([b, a], (gap, -normal), prediction).0 + normal * gap
        };
        touch.points.push(point(on_a, on_a - normal * gap, gap, EDGE));
        gap
    });
    gap
}

/// Returns the point of a cylinder, as a, that is nearest to another, b, and its gap along a normal
/// \[m\]; `gap` is the least gap \[m\]. If a cap faces b, the point of its rim towards the axis of b
/// counts: the farthest point along the normal may be on the other side.
fn nearest_on_rim(
    [a, b]: [&PosedCylinder; 2],
    (gap, normal): (f32, Vec3),
    prediction: f32,
) -> (Vec3, f32) {
    let lowest = a.support(-normal);
    let towards = lowest - a.flank(-normal) + a.flank(b.center - a.center);
    let towards_gap = gap + normal.dot(towards - lowest);
    let faces = a.is_on_cap(normal) && gap >= 0.0 && towards_gap <= prediction;
    if faces { (towards, towards_gap) } else { (lowest, gap) }
}

/// Returns the gap of two cylinders along an axis from b to a. \[m\]
fn gap_between([a, b]: [&PosedCylinder; 2], n: Vec3) -> f32 {
    n.dot(a.center - b.center) - a.extent(n) - b.extent(n)
}

/// Returns the largest gap of two cylinders \[m\] along an axis across sides or rims, and that
/// axis, from b to a. The search ends as soon as a gap between sides is more than `prediction`. It
/// starts from `cap`, the gap along the best axis of a cylinder, and that axis.
fn best_axis([a, b]: [&PosedCylinder; 2], cap: (f32, Vec3), prediction: f32) -> (f32, Vec3) {
    let apart = a.center - b.center;
    let lines = [b.to_line(a.center, a.axis).normal, -a.to_line(b.center, b.axis).normal];
    let mut best = (f32::NEG_INFINITY, lines[0]);
    let mut consider = |n: Vec3| {
        let own = gap_between([a, b], n);
        if own > best.0 {
            best = (own, n);
        }
        best
    };
    let [_, sides] = lines.map(&mut consider);
    if sides.0 > prediction {
        return sides;
    }
    let mut start = if sides.0 > cap.0 { sides.1 } else { cap.1 };
    let distance = apart.length();
    if distance > 0.0 {
        consider(climb([a, b], apart, apart * (1.0 / distance)));
    }
    for _ in 0..2 {
        // Directions between the deepest point of one cylinder and the surface of the other.
        let own = b.to_point(a.support(-start), 0.0).normal;
        let other = -a.to_point(b.support(start), 0.0).normal;
        for from in [start, own, other] {
            consider(climb([a, b], apart, from));
        }
        start = consider(own).1;
    }
    consider(start)
}

/// Fills `touch` with the ends of the common line of two parallel cylinders that lie on each other.
/// Returns `None` if they do not, or if the ends are less deep than the gap along the normal.
fn flanks(
    [a, b]: [&PosedCylinder; 2],
    (normal, gap): (Vec3, f32),
    prediction: f32,
    touch: &mut ContactManifold<3>,
) -> Option<f32> {
    let across: Vec3 = moment(a.axis, b.axis);
    let lying = |of: &PosedCylinder| of.axis.dot(normal).abs() < PARALLEL;
    if across.dot(across) >= PARALLEL * PARALLEL || !lying(a) || !lying(b) {
        return None;
    }
    let ends = b.core().ends.map(|end| a.axis.dot(end - a.center).clamp(-a.half, a.half));
    let ends = [ends[0].min(ends[1]), ends[0].max(ends[1])];
    let sides = [a.flank(-normal), b.flank(normal)];
    for (end, name) in ends.into_iter().zip(1..) {
        let at = a.center + a.axis * end;
        let other = b.axis.dot(at - b.center).clamp(-b.half, b.half);
        let (on_a, on_b) = (at + sides[0], b.center + b.axis * other + sides[1]);
        touch.points.push(point(on_a, on_b, normal.dot(on_a - on_b), EDGE | name));
    }
    let size = a.size().max(b.size());
    if ends[0] < ends[1] && is_supported(touch, gap, size, prediction) {
        return Some(gap);
    }
    touch.points.clear();
    None
}

/// Climbs to the axis along which two rims have the largest gap, or the least overlap.
///
/// This is Newton's method on the sphere of directions n for S(n) = n . d - sum of (h |n . u| + r
/// |n - (n . u) u|), with the distance d of the centers. It stops at a kink; the other families
/// cover kinks.
fn climb(both: [&PosedCylinder; 2], apart: Vec3, start: Vec3) -> Vec3 {
    let value = |n: Vec3| n.dot(apart) - both[0].extent(n) - both[1].extent(n);
    let (mut n, mut height) = (start, value(start));
    for _ in 0..CLIMBS {
        let mut slope = apart;
        let mut rims = [(Vector::ZERO, 0.0); 2];
        for (of, rim) in both.into_iter().zip(&mut rims) {
            let across = of.across(n);
            let sine = across.length();
            if sine < 1e-4 {
                return n;
            }
            slope -= of.axis * of.half.copysign(of.axis.dot(n)) + across * (of.radius / sine);
            let tangent: Vec3 = moment(of.axis, n);
            *rim = (tangent * (1.0 / sine), of.radius / sine);
        }
        slope -= n * n.dot(slope);
        let size = both[0].size() + both[1].size();
        if slope.dot(slope) <= ROUNDING * ROUNDING * size * size {
            return n;
        }
        let x = rims[0].0;
        let y: Vec3 = moment(n, x);
        let seen = [x, y].map(|axis| slope.dot(axis));
        // Negated Hessian in the tangent plane, with its diagonal raised until it is positive
        // definite.
        let mut bend = [height, 0.0, height];
        for (tangent, curve) in rims {
            let [p, q] = [x, y].map(|axis| tangent.dot(axis));
            bend[0] += curve * p * p;
            bend[1] += curve * p * q;
            bend[2] += curve * q * q;
        }
        let middle = 0.5 * (bend[0] + bend[2]);
        let half = 0.5 * (bend[0] - bend[2]);
        let least = middle - (half * half + bend[1] * bend[1]).sqrt();
        let lack = (1e-3 * size - least).max(0.0);
        bend[0] += lack;
        bend[2] += lack;
        let determinant = bend[0] * bend[2] - bend[1] * bend[1];
        let step = x * ((bend[2] * seen[0] - bend[1] * seen[1]) / determinant)
            + y * ((bend[0] * seen[1] - bend[1] * seen[0]) / determinant);
        let length = step.length();
        let mut scale = if length > 0.5 { 0.5 / length } else { 1.0 };
        let next = (0..8).find_map(|_| {
            let to = n + step * scale;
            let to = to * (1.0 / to.length());
            scale *= 0.5;
            Some((to, value(to))).filter(|(_, reached)| *reached > height)
        });
        let Some(next) = next else { return n };
        (n, height) = next;
    }
    n
}

#[cfg(test)]
mod tests;
