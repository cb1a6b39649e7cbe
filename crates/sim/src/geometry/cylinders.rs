//! Contact of cylinders, with each other and with half-spaces, boxes, hulls, balls and capsules; with meshes see
//! `mesh`.
//!
//! A cylinder is a segment, its axis, with two discs, its caps. What of it looks against a face are
//! always the same places ([`Facing`]): four on the rim of the cap that is nearer, the first where
//! the cylinder leans to, and the one above it on the rim of the other cap. The line between these
//! two is the line on which it lies; the deepest point of a coin that rolls on its rim is the first.
//! So lying, leaning and standing are one case.
//!
//! The axis of separation is one of a few families, each solved for its best member: the normal of
//! a face, the axis of a cylinder, across a line and a cylinder ([`Placed::to_line`]), and across
//! two rims ([`climb`]). What an axis really separates is then measured on the whole shapes, so a
//! family that does not apply loses.

use drystone_solver::{Vector, moment};

use super::polyhedra::{Clipper, Plane};
use super::rounds::{RoundedCore, between_rounds, nearest};
use super::separation::{PREFERENCE, best_face, edge_beyond};
use super::solid::Solid;
use super::{ContactManifold, Frame, ManifoldPoint};

/// A vector in space.
type V = Vector<f32, 3>;

/// A cylinder about the y axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cylinder {
    /// \[m\]
    pub(super) radius: f32,
    /// Half of the distance between the caps. \[m\]
    pub(super) half_height: f32,
}

/// A cylinder somewhere.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    center: V,
    /// Unit vector.
    axis: V,
    /// A unit vector across the axis that turns with the body.
    side: V,
    radius: f32,
    half: f32,
}

/// A cylinder that leans by less than this against a face stands flat on it: then the places on its
/// rim do not follow the lean, which is rounding. \[rad\]
const AIMED: f32 = 2e-4;

/// Lines at an angle whose sine is less than this lie along each other. \[1\]
const PARALLEL: f32 = 0.1;

/// What lies outside of a border by less than this part of the size within it lies on it. \[1\]
const BORDER: f32 = 1e-4;

/// A face is looked at along an axis only if the cosine between that and its normal is more than
/// this. \[1\]
pub(super) const STEEP: f32 = 0.1;

/// A manifold stands for all of a contact if it is as deep to within this part of the prediction
/// distance, ... \[1\]
const AS_DEEP: f32 = 1e-3;

/// ... this part of the overlap, ... \[1\]
const OF_OVERLAP: f32 = 0.25;

/// ... and this part of the size, which is rounding. \[1\]
const ROUNDING: f32 = 1e-6;

/// An edge loses this part of how far it is behind what an axis separates. \[1\]
const BEHIND: f32 = 0.01;

/// Bisections until a direction is known to single precision.
const BISECTIONS: usize = 24;

/// Steps of Newton's method at most.
const CLIMBS: usize = 16;

/// Kinds of points, in the upper bits of their names; those on a rim are 0..8.
const CROSSING: u32 = 1 << 28;
const CUT: u32 = 2 << 28;
const CORNER: u32 = 3 << 28;
const OTHER_RIM: u32 = 4 << 28;
const EDGE: u32 = 5 << 28;
const WHOLE: u32 = 6 << 28;

impl Cylinder {
    pub(super) fn placed(&self, frame: &Frame<3>) -> Placed {
        Placed {
            center: frame.position,
            axis: frame.axes[1],
            side: frame.axes[0],
            radius: self.radius,
            half: self.half_height,
        }
    }
}

/// Where something is nearest to a cylinder, or least deep in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    /// From the cylinder to it, a unit vector.
    pub(super) normal: V,
    /// \[m\]
    pub(super) gap: f32,
    /// Where on a segment, from 0 to 1.
    pub(super) part: f32,
    /// Whether it is beside the cylinder, not over a rim or cap.
    beside: bool,
}

/// The cosine between axis and normal above which a cylinder touches with a cap or a rim that does not
/// roll. \[1\]
const TILTED: f32 = 0.9;

impl Placed {
    /// The distance along a normal from its surface to its axis, about which it rolls; 0 where it stands. \[m\]
    pub(super) fn roundness(&self, normal: V) -> f32 {
        let cosine = self.axis.dot(normal);
        if cosine.abs() < TILTED { self.radius / (1.0 - cosine * cosine).sqrt() } else { 0.0 }
    }

    /// Whether it stands on a cap along a normal.
    pub(super) fn stands(&self, normal: V) -> bool {
        self.axis.dot(normal).abs() > 1.0 - 1e-6
    }

    /// The middle of what of the axis is in a solid.
    fn within(&self, solid: &impl Solid<3>) -> Option<V> {
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

    fn size(&self) -> f32 {
        self.radius + self.half
    }

    pub(super) fn center(&self) -> V {
        self.center
    }

    /// The outward normal and the middle of each cap.
    pub(super) fn caps(&self) -> [(V, V); 2] {
        [self.axis, -self.axis].map(|normal| (normal, self.center + normal * self.half))
    }

    /// The square of its radius. \[m^2\]
    pub(super) fn disc(&self) -> f32 {
        self.radius * self.radius
    }

    /// Coordinates of a point across the axis, from it. \[m\]
    pub(super) fn seen_along(&self, point: V) -> [f32; 2] {
        let arm = point - self.center;
        let other: V = moment(self.axis, self.side);
        [self.side.dot(arm), other.dot(arm)]
    }

    /// A segment is surely farther away than `prediction`. \[m\]
    pub(super) fn is_beyond(&self, ends: [V; 2], prediction: f32) -> bool {
        let (core, own) = (self.core(), RoundedCore { ends, radius: 0.0 });
        let [s, t] = nearest(&core, &own);
        let apart = core.at(s) - own.at(t);
        let reach = self.radius + prediction;
        apart.dot(apart) > reach * reach
    }

    /// Ways from the surface to a segment: the nearest, and if that comes from within, the way round the axis that has
    /// passed it.
    pub(super) fn ways_to(&self, ends: [V; 2]) -> impl Iterator<Item = Nearest> {
        let found = self.to_segment(ends);
        let passed = found.beside && found.gap < 0.0;
        let gap = -found.gap - 2.0 * self.radius;
        let other = Nearest { normal: -found.normal, gap, ..found };
        [Some(found), passed.then_some(other)].into_iter().flatten()
    }

    /// Places on the cylinder and on an edge where they touch along a way: at both ends if one lies along the other, else
    /// where they are nearest.
    pub(super) fn places_on(
        &self,
        [from, to]: [V; 2],
        found: &Nearest,
        prediction: f32,
    ) -> [Option<[V; 2]>; 2] {
        let (normal, along) = (-found.normal, to - from);
        let across: V = moment(along, self.axis);
        let nearest = from + along * found.part;
        let single = [Some([nearest + normal * found.gap, nearest]), None];
        if !found.beside || across.dot(across) >= PARALLEL * PARALLEL * along.dot(along) {
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

    /// A direction as far as it is across the axis.
    fn across(&self, direction: V) -> V {
        direction - self.axis * self.axis.dot(direction)
    }

    /// The farthest point along a direction.
    fn support(&self, direction: V) -> V {
        let cap = self.axis * self.half.copysign(self.axis.dot(direction));
        self.center + cap + self.flank(direction)
    }

    /// How far it reaches along a unit vector from its center. \[m\]
    pub(super) fn extent(&self, direction: V) -> f32 {
        let along = self.axis.dot(direction);
        self.half * along.abs() + self.radius * self.across(direction).length()
    }

    /// The axis as the core of a capsule.
    fn core(&self) -> RoundedCore<3> {
        let arm = self.axis * self.half;
        RoundedCore { ends: [self.center - arm, self.center + arm], radius: self.radius }
    }

    /// The line on its side that is farthest along a direction, from the axis. \[m\]
    fn flank(&self, direction: V) -> V {
        let across = self.across(direction);
        let length = across.length();
        if length > 0.0 { self.level(across * (1.0 / length)) * self.radius } else { across }
    }

    /// A unit vector across the axis without what rounding has left along that: much, where it was
    /// short.
    fn level(&self, across: V) -> V {
        across - self.axis * self.axis.dot(across)
    }

    /// From the surface to a point.
    fn to_point(self, point: V, part: f32) -> Nearest {
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
        Nearest { normal, gap, part, beside: out > 0.0 && up <= 0.0 }
    }

    /// From the surface to a line through a point along a unit vector e.
    ///
    /// Seen along e the line is a point, and the cylinder a segment, its axis, with half an ellipse
    /// about each end: its cap. With x along the segment, the ellipse has the half axes r |e . u| and r. Of
    /// the direction n = (x, y) the gap is X x + Y y - r sqrt(y^2 + (e . u)^2 x^2), with (X, Y)
    /// from the end of the segment to the point; where its derivative is zero it is largest.
    fn to_line(self, point: V, e: V) -> Nearest {
        let arm = point - self.center;
        let arm = arm - e * e.dot(arm);
        let up = self.axis - e * e.dot(self.axis);
        let sine = up.length();
        if sine < 1e-6 {
            let distance = arm.length();
            let across = if distance > 0.0 { arm } else { self.across(self.side) };
            let normal = across * (1.0 / across.length());
            return Nearest { normal, gap: distance - self.radius, part: 0.0, beside: true };
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
        Nearest { normal, gap, part: 0.0, beside: n[0] == 0.0 }
    }

    /// From the surface to a segment.
    fn to_segment(self, [from, to]: [V; 2]) -> Nearest {
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
            let across: V = moment(e, self.axis);
            let squared = across.dot(across);
            if squared > 1e-8 {
                (cosine * self.axis.dot(arm) - e.dot(arm)) / squared
            } else {
                // In the middle of what lies along the cylinder.
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
            return Nearest { part: at / length, ..found };
        }
        let part = if at <= 0.0 { 0.0 } else { 1.0 };
        self.to_point(if part == 0.0 { from } else { to }, part)
    }

    /// What looks against a face with this outward normal, aimed at where it is nearest. `before` is
    /// the feature of a point where they touched a step ago.
    pub(super) fn facing(&self, normal: V, before: Option<u64>) -> Facing {
        let along = self.axis.dot(normal);
        let lean = self.axis * along - normal;
        let sine = lean.length();
        let aimed = sine > AIMED;
        let first = if aimed { self.level(lean * (1.0 / sine)) } else { self.side };
        let second: V = moment(self.axis, first);
        let toward = self.axis * 1.0f32.copysign(-along);
        let center = self.center + toward * self.half;
        let quarter = match before {
            _ if !aimed => 0,
            // It keeps its name while it goes around.
            Some(name) if name < 8 => name as u32 & 3,
            _ => {
                let other: V = moment(self.axis, self.side);
                let at = [self.side.dot(first), other.dot(first)];
                let axis = usize::from(at[1].abs() > at[0].abs());
                axis as u32 + if at[axis] > 0.0 { 0 } else { 2 }
            }
        };
        let cap = if along > 0.0 { 0 } else { 4 };
        let arms = [first * self.radius, second * self.radius];
        let above = aimed.then(|| center - toward * (2.0 * self.half) + arms[0]);
        let rolls = self.roundness(normal) > 0.0;
        Facing { center, toward, arms, quarter, cap, above, rolls }
    }
}

/// What of a cylinder looks against a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facing {
    /// Of the cap that is nearer.
    center: V,
    /// Out of that cap.
    toward: V,
    /// From there to its rim: to where it is nearest, and a quarter on.
    arms: [V; 2],
    /// In which quarter the first was when it got its name.
    quarter: u32,
    /// 0 or 4.
    cap: u32,
    /// On the rim of the other cap, above the first; none where the cylinder stands flat.
    above: Option<V>,
    /// The cylinder rolls on the first of these places. Others of the rim do not come down as that turns.
    rolls: bool,
}

impl Facing {
    /// Each point with its name.
    pub(super) fn points(&self) -> impl Iterator<Item = (V, u32)> {
        let [first, second] = self.arms;
        let name = |of: u32, cap: u32| cap + ((self.quarter + of) & 3);
        let rim = [first, second, -first, -second].into_iter().zip(0..);
        let (center, cap) = (self.center, self.cap);
        let above = self.above.map(|above| (above, name(0, 4 - cap)));
        let rim = rim.take(if self.rolls { 1 } else { 4 });
        rim.map(move |(arm, of)| (center + arm, name(of, cap))).chain(above)
    }

    /// The line on which it lies, from its start along it.
    pub(super) fn line(&self) -> Option<[V; 2]> {
        let start = self.center + self.arms[0];
        self.above.map(|above| [start, above - start])
    }

    /// A point carried along `normal` to the plane of the cap, and how far that is. `None`: the cap
    /// looks aside.
    fn lifted(&self, point: V, normal: V) -> Option<(V, f32)> {
        let cosine = -self.toward.dot(normal);
        let gap = self.toward.dot(point - self.center) / cosine;
        (cosine > STEEP).then(|| (point + normal * gap, gap))
    }

    /// Whether a point of the cap's plane is on the cap.
    fn holds(&self, point: V) -> bool {
        within(point - self.center, self.arms[0].dot(self.arms[0]))
    }
}

/// Whether what this arm leads to is in a disc with a radius of this square.
pub(super) fn within(arm: V, squared: f32) -> bool {
    arm.dot(arm) <= squared * (1.0 + 2.0 * BORDER)
}

fn point(on_a: V, on_b: V, gap: f32, name: u32) -> ManifoldPoint<3> {
    ManifoldPoint { on_a, on_b, gap, feature: u64::from(name) }
}

/// Keeps what is near. Whether its deepest point stands for a contact with this gap. \[m\]
fn is_supported(touch: &mut ContactManifold<3>, gap: f32, size: f32, prediction: f32) -> bool {
    touch.points.retain(|point| point.gap <= prediction);
    let least = touch.points.iter().map(|point| point.gap).fold(f32::INFINITY, f32::min);
    least <= deepest_allowed(gap, size, prediction)
}

/// The gap of a point that stands for a contact with this gap, at most. \[m\]
fn deepest_allowed(gap: f32, size: f32, prediction: f32) -> f32 {
    gap + AS_DEEP * prediction + OF_OVERLAP * (-gap).max(0.0) + ROUNDING * size
}

/// Fills `touch` with where a cylinder, as a, overlaps a half-space or is within `prediction` \[m\]
/// of it; returns the gap. \[m\]
pub(super) fn on_plane(
    cylinder: &Placed,
    plane: &Plane<3>,
    prediction: f32,
    before: Option<u64>,
    touch: &mut ContactManifold<3>,
) -> f32 {
    touch.normal = plane.normal;
    let mut apart = f32::INFINITY;
    for (on_a, name) in cylinder.facing(plane.normal, before).points() {
        let gap = plane.normal.dot(on_a - plane.point);
        apart = apart.min(gap);
        if gap <= prediction {
            touch.points.push(point(on_a, on_a - plane.normal * gap, gap, name));
        }
    }
    touch.reduce();
    apart
}

/// Appends where a cylinder is over a face of a solid, as seen along `normal`, which points from the
/// solid to the cylinder.
fn over_polygon(
    cylinder: &Placed,
    (solid, face): (&impl Solid<3>, usize),
    normal: V,
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
    let dropped = |on_a: V, name: u32| {
        let gap = upright.dot(on_a - vertex) / cosine;
        point(on_a, on_a - normal * gap, gap, name)
    };
    touch.points.extend(facing.points().map(|(at, name)| dropped(at, name)));
    let Clipper { reference: memory, incident: corners, .. } = clipper;
    let line = facing.line();
    let (mut range, mut cuts, mut number) = ([0.0, 1.0], [None; 2], 0);
    solid.sides(face, memory, |on_side, outward| {
        // The same side for points that are not carried to the face yet.
        let on_side = on_side + upright * upright.dot(vertex - on_side);
        let outward = outward - upright * (outward.dot(normal) / cosine);
        if let Some([start, along]) = line {
            let (height, rise) = (outward.dot(start - on_side), outward.dot(along));
            let end = usize::from(rise > 0.0);
            let part = -height / rise;
            if rise == 0.0 && height > 0.0 {
                range = [1.0, 0.0];
            } else if rise > 0.0 && part < range[1] || rise < 0.0 && part > range[0] {
                (range[end], cuts[end]) = (part, Some(number));
            }
        }
        for (which, at) in crossings(&facing, on_side, outward).into_iter().flatten().enumerate() {
            touch.points.push(dropped(at, CROSSING | (2 * number) | which as u32));
        }
        number += 1;
    });
    if let Some([start, along]) = line.filter(|_| range[0] < range[1]) {
        for (part, cut) in range.into_iter().zip(cuts) {
            touch.points.extend(cut.map(|side| dropped(start + along * part, CUT | side)));
        }
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
    corners.clear();
    solid.corners(face, corners);
    for corner in corners {
        let Some((on_a, gap)) = facing.lifted(corner.position, normal) else { break };
        if facing.holds(on_a) {
            touch.points.push(point(on_a, corner.position, gap, CORNER | corner.feature));
        }
    }
}

/// Where the rim of the nearer cap crosses a plane.
fn crossings(facing: &Facing, on_plane: V, outward: V) -> [Option<V>; 2] {
    // A x + B y = C with x^2 + y^2 = 1.
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

/// Appends where a cylinder is over the cap of another, as seen along `normal`, which points out of
/// that cap.
fn over_cap(
    cylinder: &Placed,
    other: &Placed,
    normal: V,
    before: Option<u64>,
    touch: &mut ContactManifold<3>,
) {
    touch.normal = normal;
    let middle = other.center + normal * other.half;
    let squared = other.radius * other.radius;
    let dropped = |on_a: V, name: u32| {
        let gap = normal.dot(on_a - middle);
        point(on_a, on_a - normal * gap, gap, name)
    };
    let facing = cylinder.facing(normal, before);
    let points = facing.points().map(|(at, name)| dropped(at, name));
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
    // The rims of both caps cross here if they are parallel; else this is not on the cap.
    let center = facing.center - normal * normal.dot(facing.center - middle);
    let between = middle - center;
    let distance = between.length();
    let foot =
        (distance * distance + cylinder.radius * cylinder.radius - squared) / (2.0 * distance);
    let left = cylinder.radius * cylinder.radius - foot * foot;
    if distance > 0.0 && left > 0.0 {
        let along = between * (1.0 / distance);
        let aside: V = moment(normal, along);
        for (which, root) in [left.sqrt(), -left.sqrt()].into_iter().enumerate() {
            let on_b = center + along * foot + aside * root;
            let lifted = facing.lifted(on_b, normal).filter(|(on_a, _)| facing.holds(*on_a));
            let name = CROSSING | which as u32;
            touch.points.extend(lifted.map(|(on_a, gap)| point(on_a, on_b, gap, name)));
        }
    }
    for (on_b, name) in other.facing(facing.toward, None).points() {
        let lifted = facing.lifted(on_b, normal).filter(|(on_a, _)| facing.holds(*on_a));
        touch.points.extend(lifted.map(|(on_a, gap)| point(on_a, on_b, gap, OTHER_RIM | name)));
    }
}

/// The part of a line, from where this arm leads to, that is in a disc with a radius of this square;
/// the first is more than the second where there is none.
pub(super) fn in_disc(arm: V, along: V, squared: f32) -> [f32; 2] {
    let (a, b, c) = (along.dot(along), arm.dot(along), arm.dot(arm) - squared);
    let left = b * b - a * c;
    if left <= 0.0 || a <= 0.0 {
        return if c <= 0.0 { [0.0, 1.0] } else { [1.0, 0.0] };
    }
    let root = left.sqrt();
    [((-b - root) / a).max(0.0), ((-b + root) / a).min(1.0)]
}

/// Fills `touch` with where a cylinder, as a, overlaps a solid or is within `prediction` \[m\] of it,
/// in the solid's frame; returns how far they are apart at least. \[m\] `before` is the feature of a
/// point where they touched a step ago.
pub(super) fn on_solid(
    cylinder: &Placed,
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
    // What an axis from the solid to the cylinder separates.
    let separates = |n: V| n.dot(cylinder.center - solid.support(n)) - cylinder.extent(n);
    let beyond = if supported { gap + PREFERENCE * prediction } else { gap };
    let caps = [cylinder.axis, -cylinder.axis].map(|n| (separates(n), n));
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
    let mut best = (beyond, None);
    for edge in 0..solid.edges() {
        let ends = solid.edge(edge);
        if cylinder.is_beyond(ends, prediction) {
            continue;
        }
        for found in cylinder.ways_to(ends).filter(|found| found.gap <= prediction) {
            let gap = separates(-found.normal);
            // Of edges with one axis, the one that is touched.
            let value = gap - BEHIND * (found.gap - gap).abs();
            if value > best.0 {
                best = (value, Some((edge, ends, Nearest { gap, ..found })));
            }
        }
    }
    if let (_, Some((edge, ends, found))) = best {
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

/// Fills `touch` with where a cylinder touches an edge, along an axis that has this gap.
fn on_edge(
    cylinder: &Placed,
    (edge, ends): (usize, [V; 2]),
    found: &Nearest,
    prediction: f32,
    touch: &mut ContactManifold<3>,
) {
    touch.normal = -found.normal;
    let places = cylinder.places_on(ends, found, prediction);
    let both = u32::from(places[1].is_some());
    for ([on_a, on_b], end) in places.into_iter().flatten().zip(both..) {
        let gap = touch.normal.dot(on_a - on_b);
        if gap <= prediction || both == 0 {
            let name = EDGE | end << 24 | edge as u32 & 0xff_ffff;
            touch.points.push(point(on_a, on_b, if both == 0 { found.gap } else { gap }, name));
        }
    }
}

/// Fills `touch` with where a cylinder, as a, overlaps a ball or capsule or is within `prediction`
/// \[m\] of it; returns the gap. \[m\]
pub(super) fn on_round(
    cylinder: &Placed,
    round: &RoundedCore<3>,
    prediction: f32,
    touch: &mut ContactManifold<3>,
) -> f32 {
    let mut found = cylinder.to_segment(round.ends);
    if found.gap < 0.0 {
        // The core is in the cylinder: which way out is the shortest for all of it.
        let middle = round.at(0.5) - cylinder.center;
        let across: V = moment(cylinder.axis, round.ends[1] - round.ends[0]);
        let separates = |normal: V| {
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
                found = Nearest { normal, gap, part, beside: false };
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

/// Fills `touch` with where two cylinders overlap or are within `prediction` \[m\]; returns how far
/// they are apart at least. \[m\]
pub(super) fn between(
    a: &Placed,
    b: &Placed,
    prediction: f32,
    before: Option<u64>,
    touch: &mut ContactManifold<3>,
) -> f32 {
    let apart = a.center - b.center;
    let separates = |n: V| n.dot(apart) - a.extent(n) - b.extent(n);
    let caps = [a, b].map(|of| {
        let n = of.axis * 1.0f32.copysign(of.axis.dot(apart));
        (separates(n), n)
    });
    let of_b = caps[1].0 > caps[0].0 + PREFERENCE * prediction;
    let cap = caps[usize::from(of_b)];
    if cap.0 > prediction {
        return cap.0;
    }
    let lines = [b.to_line(a.center, a.axis).normal, -a.to_line(b.center, b.axis).normal];
    let mut best = (f32::NEG_INFINITY, lines[0]);
    let mut consider = |n: V| {
        let own = separates(n);
        if own > best.0 {
            best = (own, n);
        }
        best
    };
    let [_, sides] = lines.map(&mut consider);
    if sides.0 > prediction {
        return sides.0;
    }
    let mut start = if sides.0 > cap.0 { sides.1 } else { cap.1 };
    let distance = apart.length();
    if distance > 0.0 {
        consider(climb([a, b], apart, apart * (1.0 / distance)));
    }
    for _ in 0..2 {
        // From the farthest point of one to the nearest of the other.
        let own = b.to_point(a.support(-start), 0.0).normal;
        let other = -a.to_point(b.support(start), 0.0).normal;
        for from in [start, own, other] {
            consider(climb([a, b], apart, from));
        }
        start = consider(own).1;
    }
    let (mut gap, normal) = consider(start);
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
                let on_a = a.support(-cap.1);
                touch.points.push(point(on_a, on_a - cap.1 * cap.0, cap.0, WHOLE));
            }
            touch.reduce();
            return cap.0;
        }
        touch.points.clear();
    }
    touch.normal = normal;
    gap = flanks([a, b], (normal, gap), prediction, touch).unwrap_or_else(|| {
        // Their sides cross, or a rim touches.
        let cosines = [a, b].map(|of| of.axis.dot(normal).abs());
        let on_a = if cosines[0].max(cosines[1]) < AIMED {
            let [s, _] = nearest(&a.core(), &b.core());
            a.core().at(s) + a.flank(-normal)
        } else if cosines[0] > cosines[1] {
            a.support(-normal)
        } else {
            b.support(normal) + normal * gap
        };
        touch.points.push(point(on_a, on_a - normal * gap, gap, EDGE));
        gap
    });
    gap
}

/// Fills `touch` with the ends of where two cylinders lie along each other, if they do, and these
/// are as deep as the gap along the normal.
fn flanks(
    [a, b]: [&Placed; 2],
    (normal, gap): (V, f32),
    prediction: f32,
    touch: &mut ContactManifold<3>,
) -> Option<f32> {
    let across: V = moment(a.axis, b.axis);
    let lying = |of: &Placed| of.axis.dot(normal).abs() < PARALLEL;
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

/// Climbs to the axis that two rims are farthest apart along, or overlap least: Newton's method on
/// the sphere of directions n for S(n) = n . d - sum of h |n . u| + r |n - (n . u) u|, with the
/// distance d of the centers. Where a kink is in the way it stops; other families have these.
fn climb(both: [&Placed; 2], apart: V, start: V) -> V {
    let value = |n: V| n.dot(apart) - both[0].extent(n) - both[1].extent(n);
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
            let tangent: V = moment(of.axis, n);
            *rim = (tangent * (1.0 / sine), of.radius / sine);
        }
        slope -= n * n.dot(slope);
        let size = both[0].size() + both[1].size();
        if slope.dot(slope) <= ROUNDING * ROUNDING * size * size {
            return n;
        }
        let x = rims[0].0;
        let y: V = moment(n, x);
        let seen = [x, y].map(|axis| slope.dot(axis));
        // How much it bends down; made definite by what it lacks.
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
