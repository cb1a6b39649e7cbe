//! Contact normals at seams and corners: the axes along which bodies are held apart, without
//! collisions with internal edges.
//!
//! Two solids may be apart along several axes. The axis with the largest gap, which
//! [`Geometry::collide`] reports, may be the wrong one. Consider a box that slides over the seam
//! between two flush boxes. It has a gap to the side of the next box, and none above its top. Two
//! rules decide:
//!
//! 1. An axis holds bodies apart if they have a gap along it. A small overlap counts as none if it
//!    is sag. This is the case if a contact holds one of the bodies above a plane, and the other
//!    body does not stick out of that plane by more than a multiple of the contact's overlap.
//! 2. Among these axes, the one counts along which the bodies overlap least after their motion
//!    until the next search. This motion takes account of the contacts that hold them.
//!
//! So a body does not hit the side of a box that is flush with the floor, but a step that sticks
//! out stops it.

use drystone_solver::lanes::Reuse;
use drystone_solver::{Vector, Velocity};

use crate::bodies::Bodies;
use crate::cache::{CachedManifold, CachedPoint, ManifoldCache, Pair, deepest_first};
use crate::geometry::{Ball, Curvature, Frame, Geometry, MAX_POINTS, NormalCarrier};

/// A neighbor is flush with a plane if it sticks out by less than this fraction of the thinner
/// shape. \[1\]
const FLUSH: f32 = 5e-4;

/// Allowed overlap with the plane of a contact that sags, as a multiple of the contact's overlap.
/// Neighbors may sag differently, and each adds sag to those below. \[1\]
const SAGS: f32 = 3.0;

/// Overlap that counts as sag is at most this fraction of the thinner shape. \[1\]
const MOST_SAG: f32 = 0.05;

/// Factor of the motion ahead: contacts that bodies almost reach at their present velocities count,
/// too. \[1\]
pub(crate) const AHEAD: f32 = 1.1;

/// Touching bodies are at rest if they approach by less than this fraction of the thinner shape
/// until the next search. \[1\]
pub(crate) const STILL: f32 = 2e-4;

/// Axes with a larger cosine between them count as equal. \[1\]
const SAME: f32 = 1.0 - 1e-6;

/// Axes with a larger cosine between them hold bodies in nearly the same direction. \[1\]
const ALIKE: f32 = 0.95;

/// Largest slope of meshes that are taken as flush. \[1\]
const SLOPE: f32 = 0.3;

/// A plane does not hold bodies along an axis if the cosine between its normal and the axis is less
/// than this. \[1\]
const ACROSS: f32 = 0.7;

/// Largest number of planes that are compared for one manifold.
const PLANES: usize = 32;

/// Coordinate stored as `found_at` of manifolds that got another axis: so far away that their
/// points are recomputed in the next step. \[m\]
const NOWHERE: f32 = 1e9;

/// A manifold whose bodies approach by more than its gap: the index of its pair, and its index
/// among the manifolds of the pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Approaching {
    pub(crate) pair: u32,
    pub(crate) manifold: u32,
}

/// Input of [`SeamResolver::resolve`].
pub(crate) struct SeamInput<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) shapes: &'a [G::Prepared],
    /// Poses of the shapes, rotated with their bodies, relative to the centers of mass of the
    /// bodies.
    pub(crate) poses: &'a [G::Pose],
    pub(crate) bodies: &'a Bodies<G, L, A>,
    pub(crate) velocities: &'a [Velocity<f32, L, A>],
    pub(crate) gravity: Vector<f32, L>,
    /// Time until the next contact search. \[s\]
    pub(crate) dt: f32,
}

/// Scratch memory of [`resolve`](Self::resolve).
#[derive(Default)]
pub(crate) struct SeamResolver<const L: usize> {
    /// By body: its first manifold, as twice the index, plus 1 if the body is b.
    first: Vec<u32>,
    /// By manifold and side: the next manifold of the same body.
    next: Vec<u32>,
    /// By manifold: its pair.
    pair_of: Vec<u32>,
    changes: Vec<AxisChange<L>>,
    /// By change: whether it stands, if that is known.
    stands: Vec<Option<bool>>,
}

/// True if a manifold got another axis than the one it was found with.
pub(crate) fn is_turned<const L: usize>(manifold: &CachedManifold<L>) -> bool {
    manifold.found_at.position[0] == NOWHERE
}

/// End of a list of manifolds.
const END: u32 = u32::MAX;

/// A manifold that gets another axis.
#[derive(Clone, Copy)]
struct AxisChange<const L: usize> {
    closing: Approaching,
    manifold: u32,
    /// Manifold of the plane that allows it; [`END`] if there is none.
    plane: u32,
    /// The body whose contact points are kept, a (0) or b (1): the one that a plane holds, or else
    /// the one that passes the other's face.
    side: usize,
    separating: SeparatingAxis<L>,
    /// True if the new axis is close to the old one, so that it holds the bodies as that one did.
    slight: bool,
}

/// An axis that holds two bodies apart.
#[derive(Clone, Copy)]
struct SeparatingAxis<const L: usize> {
    /// Unit vector from b to a.
    axis: Vector<f32, L>,
    /// Gap along the axis. \[m\]
    gap: f32,
    /// Heights along the axis of the lowest point of a and the highest one of b, from the center of
    /// mass of b: at each contact point. \[m\]
    levels: [[f32; 2]; MAX_POINTS],
}

/// A contact that holds one of two bodies above a plane.
#[derive(Clone, Copy)]
struct HoldingPlane<const L: usize> {
    manifold: u32,
    /// The body that is held, a (0) or b (1).
    side: usize,
    /// Unit normal from b to a, whichever of them is held.
    axis: Vector<f32, L>,
    /// Overlap along the axis that counts as none. \[m\]
    allowed: f32,
    /// The body that holds it, and the gap to that body. \[m\]
    holder: u32,
    gap: f32,
}

impl<const L: usize> HoldingPlane<L> {
    /// Returns the normal towards the body that is held.
    fn outward(&self) -> Vector<f32, L> {
        self.axis * if self.side == 0 { 1.0 } else { -1.0 }
    }

    const NONE: Self =
        Self { manifold: END, side: 0, axis: Vector::ZERO, allowed: 0.0, holder: 0, gap: 0.0 };
}

/// Shapes, poses and frames of a pair, relative to the center of mass of b.
struct SeamPair<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    shapes: [&'a G::Prepared; 2],
    poses: [G::Pose; 2],
    frames: [Frame<L>; 2],
    /// Body b.
    base: u32,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> SeamPair<'_, G, L, A> {
    /// Returns the gap of the bodies along an axis from b to a, or `None` for unbounded shapes. Of a
    /// mesh those parts count that are in the balls `around` the contact points on a and b.
    fn along(&self, axis: Vector<f32, L>, around: &[[Ball<L>; 2]]) -> Option<SeparatingAxis<L>> {
        let level = |side: usize, ball: &Ball<L>| {
            let outward = if side == 0 { -axis } else { axis };
            Some(axis.dot(G::support(self.shapes[side], &self.poses[side], outward, *ball)?))
        };
        let mut levels = [[0.0; 2]; MAX_POINTS];
        for (at, [a, b]) in around.iter().enumerate() {
            let known = at > 0 && !self.has_mesh();
            levels[at] = if known { levels[0] } else { [level(0, a)?, level(1, b)?] };
        }
        let gaps = levels[..around.len()].iter().map(|[a, b]| a - b);
        Some(SeparatingAxis { axis, gap: gaps.fold(f32::INFINITY, f32::min), levels })
    }

    /// Returns the balls of a radius \[m\] about contact points on a and b.
    fn around(&self, points: &[CachedPoint<L>], radius: f32) -> [[Ball<L>; 2]; MAX_POINTS] {
        let mut around = [[Ball { center: Vector::ZERO, radius }; 2]; MAX_POINTS];
        for ([a, b], point) in around.iter_mut().zip(points) {
            a.center = self.frames[0].point(point.on_a);
            b.center = self.frames[1].point(point.on_b);
        }
        around
    }

    fn has_mesh(&self) -> bool {
        self.shapes.iter().any(|shape| G::is_open(shape))
    }

    /// True if a normal is that of a face of a mesh.
    fn is_face_of_mesh(&self, normal: NormalCarrier) -> bool {
        match normal {
            NormalCarrier::FaceOfA => G::is_open(self.shapes[0]),
            NormalCarrier::FaceOfB => G::is_open(self.shapes[1]),
            _ => false,
        }
    }

    /// Returns the radii by which both are rounded about their cores where they face each other.
    /// \[m\]
    fn rounding_radius(&self, normal: Vector<f32, L>) -> [f32; 2] {
        [0, 1].map(|side| G::rounding_radius(self.shapes[side], &self.poses[side], normal))
    }
}

impl<const L: usize> SeamResolver<L> {
    /// Changes manifolds to the axes along which their bodies are held apart. Each is decided by
    /// the manifolds as they were found, so the order does not matter.
    pub(crate) fn resolve<G: Geometry<L, A>, const A: usize>(
        &mut self,
        input: &SeamInput<'_, G, L, A>,
        closing: impl Iterator<Item = Approaching>,
        pairs: &mut [Pair],
        cache: &mut ManifoldCache<L>,
    ) {
        self.changes.clear();
        let mut linked = false;
        for closing in closing {
            if !std::mem::replace(&mut linked, true) {
                self.link(input.bodies, pairs, cache);
            }
            let manifold = pairs[closing.pair as usize].first + closing.manifold;
            let change = self.decide(input, pairs, (closing, manifold), cache);
            self.changes.extend(change);
        }
        cache.manifolds.iter_mut().for_each(|manifold| manifold.undecided = false);
        self.stands.clear();
        self.stands.resize(self.changes.len(), None);
        for at in 0..self.changes.len() {
            if self.stands(at) {
                let change = &self.changes[at];
                let pair = &mut pairs[change.closing.pair as usize];
                input.change_axis(pair, change, cache);
            }
        }
    }

    /// True if a change stands: a manifold does not give way to one that gives way to another. Of
    /// manifolds that give way in a circle, the first does.
    fn stands(&mut self, at: usize) -> bool {
        if let Some(known) = self.stands[at] {
            return known;
        }
        self.stands[at] = Some(true);
        let plane = self.changes[at].plane;
        let of_plane = self.changes.binary_search_by_key(&plane, |other| other.manifold);
        let stands =
            of_plane.map_or(true, |other| self.changes[other].slight || !self.stands(other));
        self.stands[at] = Some(stands);
        stands
    }

    /// Links the manifolds of each dynamic body into a list.
    fn link<G: Geometry<L, A>, const A: usize>(
        &mut self,
        bodies: &Bodies<G, L, A>,
        pairs: &[Pair],
        cache: &ManifoldCache<L>,
    ) {
        self.pair_of.clear();
        self.pair_of.resize(cache.manifolds.len(), 0);
        for (pair, number) in pairs.iter().zip(0..).filter(|(pair, _)| !pair.is_sleeping) {
            self.pair_of[pair.manifolds()].fill(number);
        }
        self.first.clear();
        self.first.resize(bodies.poses.len(), END);
        self.next.clear();
        self.next.resize(2 * cache.manifolds.len(), END);
        for (number, manifold) in cache.manifolds.iter().enumerate().rev() {
            for (side, &body) in manifold.bodies.iter().enumerate() {
                if bodies.is_dynamic(body as usize) {
                    let own = 2 * number + side;
                    self.next[own] = std::mem::replace(&mut self.first[body as usize], own as u32);
                }
            }
        }
    }

    /// Returns the manifolds of a body, and whether the body is their b.
    fn of(&self, body: u32) -> impl Iterator<Item = (u32, bool)> {
        let start = Some(self.first[body as usize]).filter(|&at| at != END);
        let after = |at: &u32| Some(self.next[*at as usize]).filter(|&at| at != END);
        std::iter::successors(start, after).map(|at| (at / 2, at % 2 == 1))
    }

    /// Returns the planes above which contacts hold a body of a manifold, and their number. A plane
    /// counts if the other body does not stick out of it at its contact point, or is flush with the
    /// body that holds it.
    fn planes<G: Geometry<L, A>, const A: usize>(
        &self,
        input: &SeamInput<'_, G, L, A>,
        (pairs, pair, manifold): (&[Pair], &Pair, &CachedManifold<L>),
        (corner, around): (&SeamPair<'_, G, L, A>, &[[Ball<L>; 2]]),
        cache: &ManifoldCache<L>,
    ) -> ([HoldingPlane<L>; PLANES], usize) {
        let (view, mut planes, mut count) = (cache.view(), [HoldingPlane::NONE; PLANES], 0);
        let is_deep = view.impulses_of(manifold)[0].gap[0] < -MOST_SAG * pair.thickness;
        for side in 0..2 {
            // A mesh decides among its own faces, unless it reports that a body is far inside.
            let own = if is_deep { 0..0 } else { pair.manifolds() };
            let others = self.of(manifold.bodies[side]);
            let others = others.filter(|(other, _)| !own.contains(&(*other as usize)));
            for (other, is_b) in others.take(PLANES) {
                let holding = &cache.manifolds[other as usize];
                let outward = holding.normal * if is_b { -1.0 } else { 1.0 };
                let axis = outward * if side == 0 { 1.0 } else { -1.0 };
                if axis.dot(manifold.normal) > SAME || count == PLANES {
                    continue;
                }
                let gap = view.impulses_of(holding)[0].gap[0];
                let apart = input.bodies.relative_position([holding.bodies[1], manifold.bodies[1]]);
                let position = view.points_of(holding)[0].push_point + apart;
                let sag = (-gap).max(0.0);
                let most = MOST_SAG * pair.thickness;
                let allowed = (SAGS * sag + FLUSH * pair.thickness).min(most);
                let mut plane = HoldingPlane {
                    manifold: other,
                    side,
                    axis,
                    allowed,
                    holder: holding.bodies[usize::from(!is_b)],
                    gap,
                };
                let holder = &pairs[self.pair_of[other as usize] as usize];
                if corner.has_mesh()
                    && input.is_flush((holder, is_b), &plane, (corner, around), pair.thickness)
                {
                    plane.allowed = most;
                } else if outward.dot(around[0][1 - side].center - position) > allowed {
                    continue;
                }
                planes[count] = plane;
                count += 1;
            }
        }
        (planes, count)
    }

    /// Returns the new axis of a manifold, if it gets one.
    fn decide<G: Geometry<L, A>, const A: usize>(
        &self,
        input: &SeamInput<'_, G, L, A>,
        pairs: &[Pair],
        (closing, number): (Approaching, u32),
        cache: &ManifoldCache<L>,
    ) -> Option<AxisChange<L>> {
        let pair = &pairs[closing.pair as usize];
        let view = cache.view();
        let manifold = &cache.manifolds[number as usize];
        let corner = input.corner(pair);
        let (normal, gap) = (manifold.normal, view.impulses_of(manifold)[0].gap[0]);
        // A step that sticks out of a plane does so within this distance of its contact points.
        let radius = MOST_SAG * pair.thickness + SLOPE * gap.abs();
        let points = view.points_of(manifold);
        let around = &corner.around(points, radius)[..points.len()];
        let positions = around[0].map(|ball| ball.center);
        let held = (pairs, pair, manifold);
        let (planes, count) = self.planes(input, held, (&corner, around), cache);
        let planes = &planes[..count];
        // A contact that touches, with no plane that holds its bodies, is not at the side of a
        // neighbor. Nearly all contacts of a heap end here. A mesh decides among its own faces.
        if planes.is_empty() && (gap <= 0.0 || corner.has_mesh()) {
            return None;
        }
        let mut ahead = input.ahead(&corner, (manifold, gap), &positions, planes);
        // Bodies that touch and hardly move keep their axis; otherwise resting bodies jitter.
        if gap <= 0.0 && normal.dot(ahead).abs() <= STILL * pair.thickness {
            if !manifold.undecided {
                return None;
            }
            ahead = Vector::ZERO;
        }
        let most = gap + normal.dot(ahead);
        if most >= gap.max(0.0) {
            return None;
        }
        let near = reach_of_sides(pair, (normal, gap), ahead, planes);
        let mut search = AxisSearch {
            corner: &corner,
            closing,
            manifold: number,
            own: (normal, most),
            is_sharp: corner.rounding_radius(normal) == [0.0; 2],
            on_mesh: corner.is_face_of_mesh(manifold.surfaces.normal),
            planes,
            around,
            ahead,
            most,
            best: None,
        };
        for plane in planes {
            search.consider(plane.axis, Some(plane), plane.side);
        }
        search.consider_sides(normal, (&positions, near));
        search.best
    }
}

/// The search for the axis along which two bodies overlap least after their motion.
struct AxisSearch<'a, G: Geometry<L, A>, const L: usize, const A: usize> {
    corner: &'a SeamPair<'a, G, L, A>,
    closing: Approaching,
    manifold: u32,
    /// Axis of the manifold, and the gap along it after the motion. \[m\]
    own: (Vector<f32, L>, f32),
    /// True if neither body is rounded along this axis.
    is_sharp: bool,
    /// True if it is the normal of a face of a mesh, which does not give way to axes close to it.
    on_mesh: bool,
    /// Planes that hold one of the bodies.
    planes: &'a [HoldingPlane<L>],
    /// Balls about the contact points on each body.
    around: &'a [[Ball<L>; 2]],
    /// Motion of a relative to b until the next search. \[m\]
    ahead: Vector<f32, L>,
    /// Largest gap after this motion so far. \[m\]
    most: f32,
    best: Option<AxisChange<L>>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> AxisSearch<'_, G, L, A> {
    /// Considers an axis along which a plane holds the body `side`. Without a plane the bodies must
    /// pass each other along the axis without overlap. An axis close to the manifold's own is not
    /// considered if they overlap more along it than the motion costs: its sag changes with its
    /// load, and the axes would take turns.
    fn consider(&mut self, axis: Vector<f32, L>, held: Option<&HoldingPlane<L>>, side: usize) {
        let held = held.unwrap_or(&HoldingPlane::NONE);
        let (normal, then) = self.own;
        let slight = axis.dot(normal) > ALIKE;
        if slight && self.on_mesh {
            return;
        }
        let rivals = self.is_sharp && slight;
        let deepest = if rivals { then.min(0.0) } else { f32::NEG_INFINITY };
        let least = deepest.max(-held.allowed);
        let Some(separating) = self.corner.along(axis, self.around).filter(|of| of.gap >= least)
        else {
            return;
        };
        let then = separating.gap.max(0.0) + axis.dot(self.ahead);
        if then > self.most && (held.manifold != END || then >= 0.0) {
            self.most = then;
            let (closing, manifold) = (self.closing, self.manifold);
            let plane = held.manifold;
            self.best = Some(AxisChange { closing, manifold, plane, side, separating, slight });
        }
    }

    /// Considers the faces of both bodies whose planes are within `near` \[m\] of the contact,
    /// except the one with the contact's own normal. A body on a plane touches the other's side
    /// below its edge: by its sag, and by the height that it still climbs on its way there.
    fn consider_sides(
        &mut self,
        normal: Vector<f32, L>,
        (positions, near): (&[Vector<f32, L>; 2], f32),
    ) {
        let SeamPair { shapes, poses, .. } = self.corner;
        let planes = self.planes;
        for side in 0..2 {
            let mut face = |outward: Vector<f32, L>| {
                let axis = outward * if side == 0 { -1.0 } else { 1.0 };
                if axis.dot(normal) > SAME {
                    return;
                }
                let alike = |plane: &&HoldingPlane<L>| plane.axis.dot(axis) >= ACROSS;
                let held = planes.iter().filter(alike).max_by(|p, q| {
                    p.allowed.total_cmp(&q.allowed).then(q.manifold.cmp(&p.manifold))
                });
                self.consider(axis, held, held.map_or(1 - side, |held| held.side));
            };
            let ball = Ball { center: positions[side], radius: near };
            G::faces_at(shapes[side], &poses[side], ball, &mut face);
        }
    }
}

/// Returns the distance within which faces count as sides of a contact. \[m\]
fn reach_of_sides<const L: usize>(
    pair: &Pair,
    (normal, gap): (Vector<f32, L>, f32),
    ahead: Vector<f32, L>,
    planes: &[HoldingPlane<L>],
) -> f32 {
    let until = gap.max(0.0) / -normal.dot(ahead).min(-f32::MIN_POSITIVE);
    planes.iter().fold(FLUSH * pair.thickness, |most, plane| {
        let up = plane.axis - normal * plane.axis.dot(normal);
        let climbs = up.dot(ahead).abs() / up.length() * until.min(1.0);
        most.max(plane.allowed + climbs)
    })
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> SeamInput<'_, G, L, A> {
    /// Returns the relative motion of two bodies until the next search for contacts, as far as the
    /// planes that hold them let them move. \[m\] Across a `gap` \[m\] they fall freely.
    fn ahead(
        &self,
        corner: &SeamPair<'_, G, L, A>,
        (manifold, gap): (&CachedManifold<L>, f32),
        positions: &[Vector<f32, L>; 2],
        planes: &[HoldingPlane<L>],
    ) -> Vector<f32, L> {
        let normal = manifold.normal;
        let velocity = |body: u32, position: Vector<f32, L>| {
            let center = self.bodies.relative_position([body, manifold.bodies[1]]);
            let own = self.velocities[body as usize].at(position - center);
            let falls = gap > 0.0 && self.bodies.is_dynamic(body as usize);
            let gravity = self.bodies.gravity_on(body as usize, self.gravity);
            if falls { own + gravity * (0.5 * self.dt) } else { own }
        };
        // A round body moves as its core does, however it rotates.
        let round = corner.rounding_radius(normal);
        let cores = [positions[0] + normal * round[0], positions[1] - normal * round[1]];
        let mut velocities = [0, 1].map(|side| velocity(manifold.bodies[side], cores[side]));
        for plane in planes {
            // The holder lets the body approach by no more than this gap.
            let outward = plane.outward();
            if outward.dot(normal).abs() < ACROSS {
                let by = velocity(plane.holder, cores[plane.side]);
                let towards = outward.dot(velocities[plane.side] - by);
                let least = -plane.gap.max(0.0) / self.dt;
                velocities[plane.side] += outward * (least - towards).max(0.0);
            }
        }
        (velocities[0] - velocities[1]) * (AHEAD * self.dt)
    }

    fn corner(&self, pair: &Pair) -> SeamPair<'_, G, L, A> {
        let [a, b] = pair.bodies.map(|body| body as usize);
        let [shape_a, shape_b] = pair.colliders.map(|shape| shape as usize);
        let apart = self.bodies.relative_position(pair.bodies);
        let frames = &self.bodies.frames;
        SeamPair {
            shapes: [&self.shapes[shape_a], &self.shapes[shape_b]],
            poses: [G::advance(&self.poses[shape_a], apart, Vector::ZERO), self.poses[shape_b]],
            frames: [
                Frame { position: apart, ..frames[a] },
                Frame { position: Vector::ZERO, ..frames[b] },
            ],
            base: pair.bodies[1],
        }
    }

    /// True if the other body is flush with the body that holds a plane, where they meet: the tops
    /// above its contact points are on the holder. `holder` is the pair of the plane, and whether
    /// the body that is held is its b.
    fn is_flush(
        &self,
        (holder, is_b): (&Pair, bool),
        plane: &HoldingPlane<L>,
        (corner, around): (&SeamPair<'_, G, L, A>, &[[Ball<L>; 2]]),
        thickness: f32,
    ) -> bool {
        let other = 1 - plane.side;
        let collider = holder.colliders[usize::from(!is_b)] as usize;
        let apart = self.bodies.relative_position([plane.holder, corner.base]);
        let pose = G::advance(&self.poses[collider], apart, Vector::ZERO);
        let (shape, own, radius) = (corner.shapes[other], &corner.poses[other], FLUSH * thickness);
        around.iter().all(|balls| {
            let ball = balls[other];
            // Points that will come down beside the edge are not on the mesh yet.
            let touches = G::reaches(shape, own, Ball { radius, ..ball });
            let top = G::support(shape, own, plane.outward(), ball);
            let meets = |center| G::reaches(&self.shapes[collider], &pose, Ball { center, radius });
            !touches || top.is_some_and(meets)
        })
    }

    /// Changes the axis of a manifold. Its points stay where they are on one of the bodies. On a
    /// round body they move to the nearest points along the new axis.
    fn change_axis(&self, pair: &mut Pair, change: &AxisChange<L>, cache: &mut ManifoldCache<L>) {
        let SeparatingAxis { axis, levels, .. } = change.separating;
        let reuse = &mut cache.reuse[change.manifold as usize];
        let kept = matches!(reuse, Reuse::Kept(_));
        *reuse = reuse.changed();
        let mut all = cache.view_mut();
        let (manifold, points, impulses) = all.slot_mut(change.manifold as usize);
        if kept {
            manifold.impulse_normal = manifold.normal;
        }
        let corner = self.corner(pair);
        let [a, b] = &corner.frames;
        let of_a = change.side == 0;
        // A cylinder is not rounded from its side to its caps.
        let [around, now] =
            [manifold.normal, axis].map(|along| corner.rounding_radius(along)[change.side]);
        let around = around.min(now);
        let moved = (manifold.normal - axis) * if of_a { around } else { -around };
        for ((point, cached), [low, high]) in points.iter_mut().zip(&mut *impulses).zip(levels) {
            let own = if of_a { a.point(point.on_a) } else { b.point(point.on_b) } + moved;
            let along = axis.dot(own);
            let gap = if of_a { along - high } else { low - along };
            let [on_a, on_b] = if of_a { [own, own - axis * gap] } else { [own + axis * gap, own] };
            (point.on_a, point.on_b) = (a.local_point(on_a), b.local_point(on_b));
            point.push_point = if of_a { on_a } else { on_b };
            cached.gap[0] = gap;
        }
        deepest_first(points, impulses);
        manifold.normal = axis;
        // The body with the plane carries the normal.
        manifold.surfaces = if of_a {
            Curvature { radii: [around, 0.0], normal: NormalCarrier::FaceOfB }
        } else {
            Curvature { radii: [0.0, around], normal: NormalCarrier::FaceOfA }
        };
        manifold.local_normal = manifold.carrier(a, b).local_direction(axis);
        manifold.found_at.position = Vector([NOWHERE; L]);
        pair.clearance = 0.0;
    }
}

#[cfg(test)]
mod tests;
