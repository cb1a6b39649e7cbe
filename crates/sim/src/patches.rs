//! Contact patches of compounds: points that two bodies share in one plane form one patch, and
//! covered sides between parts have no contacts.
//!
//! 1. A contact with a side of a part is opened if another part of the same body covers that side.
//!    An open contact has such a large gap that it takes no impulse. So bricks of four parts that
//!    stand on each other do not push sideways at the seams between the parts.
//! 2. If the gaps of all points in a plane are those between two planes, the outermost points
//!    determine them. The inner points are opened.
//!
//! Each part of a body that lies on another body has a manifold of its own. Two bricks of five
//! parts share up to 36 points in one plane, where four are enough. Which of them carry the load is
//! not determined. Sweeps then shift the load between them, and a tower of such bricks creeps
//! sideways.

use drystone_solver::Vector;
use drystone_solver::lanes::{FAR, Reuse};

use crate::bodies::Bodies;
use crate::cache::{self, ManifoldCache, Pair, deepest_first};
use crate::colliders::Colliders;
use crate::geometry::{Ball, ContactManifold, Geometry, MAX_POINTS, ManifoldPoint};

/// Normals with a larger cosine between them count as equal. \[1\]
const SAME: f32 = 1.0 - 1e-4;

/// A point is in a plane if its distance is at most this fraction of the extent of the patch. \[1\]
const FLAT: f32 = 1e-4;

/// A part covers a side if its distance from it is at most this fraction of the thinner shape.
/// \[1\]
const FLUSH: f32 = 5e-4;

/// Distance in front of a side at which a cover is looked for, as a multiple of that tolerance.
/// \[1\]
const AHEAD: f32 = 4.0;

/// A patch has a width if it is more than this fraction of its length. \[1\]
const WIDE: f32 = 0.05;

/// Finds and reduces the contact patches of bodies with several shapes.
#[derive(Default)]
pub(crate) struct Patches<const L: usize> {
    /// Manifolds of compounds in this step, and those of bodies that have moved.
    all: Vec<PatchPart>,
    parts: Vec<PatchPart>,
    /// Manifolds to be opened.
    none: Vec<u32>,
    /// Points in a plane: all, and those that are kept. Their features are indices into `origins`.
    plane: Vec<ManifoldPoint<L>>,
    touch: ContactManifold<L>,
    origins: Vec<[usize; 2]>,
}

/// A manifold of two bodies of which one has several shapes.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct PatchPart {
    bodies: [u32; 2],
    manifold: u32,
    pair: u32,
    /// True if its surfaces have no surface velocity and no rolling resistance.
    plain: bool,
}

/// Shapes and bodies, by which positions are tested.
pub(crate) struct Shapes<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) colliders: &'a Colliders<G, L, A>,
    pub(crate) bodies: &'a Bodies<G, L, A>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Shapes<'_, G, L, A> {
    /// True if a shape of a pair contains `position`, from the center of mass of b, or is within
    /// `near` of it. \[m\]
    fn contains(&self, pair: &Pair, side: usize, position: Vector<f32, L>, near: f32) -> bool {
        let shape = pair.colliders[side] as usize;
        let position = if side == 0 {
            position - self.bodies.relative_position(pair.bodies)
        } else {
            position
        };
        let ball = Ball { center: position, radius: near };
        G::reaches(&self.colliders.shapes[shape], &self.colliders.poses[shape], ball)
    }
}

impl<const L: usize> Patches<L> {
    /// Finds the manifolds of compounds that have changed, and opens those between covered sides.
    pub(crate) fn find<G: Geometry<L, A>, const A: usize>(
        &mut self,
        pairs: &[Pair],
        shapes: &Shapes<'_, G, L, A>,
        cache: &mut ManifoldCache<L>,
    ) {
        let Self { all, parts: changed, none, .. } = self;
        all.clear();
        changed.clear();
        if !shapes.colliders.has_compounds() {
            return;
        }
        let is_part = |body: &u32| shapes.colliders.is_compound(*body);
        for (pair, number) in pairs.iter().zip(0..) {
            let bodies = pair.bodies;
            if pair.count > 0 && !pair.is_sleeping && bodies.iter().any(is_part) {
                let plain = shapes.colliders.is_plain(pair.colliders);
                let part =
                    |of: usize| PatchPart { bodies, manifold: of as u32, pair: number, plain };
                all.extend(pair.manifolds().map(part));
            }
        }
        all.sort_unstable();
        for parts in all.chunk_by(|a, b| a.bodies == b.bodies) {
            let kept =
                |part: &PatchPart| matches!(cache.reuse[part.manifold as usize], Reuse::Kept(_));
            if parts.len() > 1 && !parts.iter().all(kept) {
                changed.extend_from_slice(parts);
                none.clear();
                covered((parts, pairs), shapes, cache, none);
                for &manifold in &*none {
                    let own = cache.manifolds[manifold as usize].points();
                    cache.impulses[own].fill(cache::open(FAR));
                    let reuse = &mut cache.reuse[manifold as usize];
                    *reuse = reuse.changed();
                }
            }
        }
    }

    /// Opens the points that the changed patches do not need.
    pub(crate) fn join(&mut self, cache: &mut ManifoldCache<L>) {
        let changed = std::mem::take(&mut self.parts);
        for parts in changed.chunk_by(|a, b| a.bodies == b.bodies) {
            self.join_all(parts, cache);
        }
        self.parts = changed;
    }

    /// Opens the inner points of each plane in which two bodies touch.
    fn join_all(&mut self, parts: &[PatchPart], cache: &mut ManifoldCache<L>) {
        for (at, first) in parts.iter().enumerate() {
            let manifold = cache.manifolds[first.manifold as usize];
            let is_alike = |part: &&PatchPart| {
                let other = &cache.manifolds[part.manifold as usize];
                part.plain
                    && other.normal.dot(manifold.normal) > SAME
                    && other.friction == manifold.friction
                    && other.restitution == manifold.restitution
            };
            // Skip it if it was joined with an earlier one.
            if !first.plain || parts[..at].iter().any(|part| is_alike(&part)) {
                continue;
            }
            self.origins.clear();
            self.touch.points.clear();
            self.touch.normal = manifold.normal;
            let view = cache.view();
            for part in parts[at..].iter().filter(is_alike) {
                let own = &cache.manifolds[part.manifold as usize];
                let points = view.points_of(own).iter().zip(view.impulses_of(own)).enumerate();
                for (point, (cached_point, cached)) in points.filter(|(_, (_, of))| of.gap[0] < FAR)
                {
                    self.touch.points.push(ManifoldPoint {
                        on_a: cached_point.push_point,
                        on_b: cached_point.push_point,
                        gap: cached.gap[0],
                        feature: self.origins.len() as u64,
                    });
                    self.origins.push([part.manifold as usize, point]);
                }
            }
            self.open_inner(cache);
        }
    }

    /// Opens the points of a plane that lie within others, if these determine their depths.
    fn open_inner(&mut self, cache: &mut ManifoldCache<L>) {
        let all = self.touch.points.len();
        if all <= if L == 2 { 2 } else { MAX_POINTS } {
            return;
        }
        self.plane.clear();
        self.plane.extend_from_slice(&self.touch.points);
        self.touch.reduce();
        let Some(depth) = Depth::of(&self.touch.points, self.touch.normal) else { return };
        if !self.plane.iter().all(|point| depth.determines(point)) {
            return;
        }
        for (number, &[manifold, point]) in self.origins.iter().enumerate() {
            if self.touch.points.iter().any(|of| of.feature == number as u64) {
                continue;
            }
            let own = cache.manifolds[manifold].points();
            cache.impulses[own.start + point] = cache::open(FAR);
            cache.reuse[manifold] = cache.reuse[manifold].changed();
        }
        for &[manifold, _] in &self.origins {
            let own = cache.manifolds[manifold].points();
            deepest_first(&mut cache.points[own.clone()], &mut cache.impulses[own]);
        }
    }
}

/// Appends to `none` the manifolds all of whose points are on a side that another part of the same
/// body covers.
fn covered<G: Geometry<L, A>, const L: usize, const A: usize>(
    (parts, pairs): (&[PatchPart], &[Pair]),
    shapes: &Shapes<'_, G, L, A>,
    cache: &ManifoldCache<L>,
    none: &mut Vec<u32>,
) {
    let normal = |part: &PatchPart| cache.manifolds[part.manifold as usize].normal;
    let first = normal(&parts[0]);
    if parts.iter().all(|part| normal(part).dot(first) > SAME) {
        return;
    }
    let is_covered = |part: &PatchPart, side: usize, position: Vector<f32, L>| {
        let own = &pairs[part.pair as usize];
        let near = FLUSH * own.thickness;
        let outward = normal(part) * if side == 0 { -1.0 } else { 1.0 };
        let position = position + outward * (AHEAD * near);
        parts.iter().any(|other| {
            let other = &pairs[other.pair as usize];
            other.colliders[side] != own.colliders[side]
                && shapes.contains(other, side, position, near)
        })
    };
    let is_none = |part: &&PatchPart| {
        let points = cache.view().points_of(&cache.manifolds[part.manifold as usize]);
        (0..2).any(|side| points.iter().all(|point| is_covered(part, side, point.push_point)))
    };
    none.extend(parts.iter().filter(is_none).map(|part| part.manifold));
}

/// The gap between two planes: a linear function of the position.
struct Depth<const L: usize> {
    from: Vector<f32, L>,
    gap: f32,
    slope: Vector<f32, L>,
    tolerance: f32,
}

impl<const L: usize> Depth<L> {
    /// Returns the function through the corners of a patch, or `None` if the patch has no width.
    fn of(corners: &[ManifoldPoint<L>], normal: Vector<f32, L>) -> Option<Self> {
        let [first, second, rest @ ..] = corners else { return None };
        let level = |v: Vector<f32, L>| v - normal * normal.dot(v);
        let along = level(second.on_a - first.on_a);
        let length = along.length();
        let along = along * (1.0 / length);
        let mut slope = along * ((second.gap - first.gap) / length);
        if L > 2 {
            let aside = |point: &ManifoldPoint<L>| {
                let arm = level(point.on_a - first.on_a);
                arm - along * along.dot(arm)
            };
            let widest = |a: &&ManifoldPoint<L>, b: &&ManifoldPoint<L>| {
                aside(a).length().total_cmp(&aside(b).length())
            };
            let third = rest.iter().max_by(widest)?;
            let width = aside(third).length();
            if width < WIDE * length {
                return None;
            }
            let rise = third.gap - first.gap - slope.dot(third.on_a - first.on_a);
            slope += aside(third) * (rise / (width * width));
        }
        let (from, gap, tolerance) = (first.on_a, first.gap, FLAT * length);
        (length > 0.0).then_some(Self { from, gap, slope, tolerance })
    }

    /// True if the gap of a point agrees with the function.
    fn determines(&self, point: &ManifoldPoint<L>) -> bool {
        let gap = self.gap + self.slope.dot(point.on_a - self.from);
        (point.gap - gap).abs() <= self.tolerance
    }
}
