//! Queries against signed distances, evaluated for every collider in double precision.

use drystone::geometry::{Bounds, Geometry, Particles, Rigid2, Rigid3};
use drystone::{
    Body, BodyId, Collider, ColliderId, Dimension, InputError, Motion, RayHit, StepSettings,
    Vector, World, World3,
};
use parry3d::shape::SharedShape;

use super::common::*;

/// Results are compared only where all shapes enlarged or reduced by this much give the same. \[m\]
const SURE: f64 = 1e-4;

/// A shape with an exact signed distance.
#[derive(Clone, Debug)]
enum Form<const L: usize> {
    Ball(f32),
    /// Half height along y, and radius.
    Capsule(f32, f32),
    Box([f32; L]),
    /// The half-space below y = 0.
    Ground,
}

fn length(v: impl IntoIterator<Item = f64>) -> f64 {
    v.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

impl<const L: usize> Form<L> {
    /// Returns the signed distance of a point in the frame of the shape. \[m\]
    fn distance(&self, mut point: [f64; L]) -> f64 {
        match self {
            Self::Ball(radius) => length(point) - f64::from(*radius),
            Self::Capsule(half, radius) => {
                let half = f64::from(*half);
                point[1] -= point[1].clamp(-half, half);
                length(point) - f64::from(*radius)
            }
            Self::Box(half) => {
                let out: [f64; L] = std::array::from_fn(|i| point[i].abs() - f64::from(half[i]));
                let inner = out.into_iter().fold(f64::NEG_INFINITY, f64::max).min(0.0);
                length(out.map(|x| x.max(0.0))) + inner
            }
            Self::Ground => point[1],
        }
    }

    /// Returns the half size of its box, whose sides have these components in its frame. \[m\]
    fn extent(&self, axis: [f64; L]) -> f64 {
        match self {
            Self::Ball(radius) => f64::from(*radius),
            Self::Capsule(half, radius) => axis[1].abs() * f64::from(*half) + f64::from(*radius),
            Self::Box(half) => (0..L).map(|i| axis[i].abs() * f64::from(half[i])).sum(),
            Self::Ground => f64::INFINITY,
        }
    }

    fn random(random: &mut Random) -> Self {
        let mut size = || random.between(0.1, 0.6);
        let (half, radius) = (std::array::from_fn(|_| size()), size());
        match random.between(0.0, 3.0) as u32 {
            0 => Self::Ball(radius),
            1 => Self::Capsule(half[0], radius),
            _ => Self::Box(half),
        }
    }
}

fn rigid<G: Rigid<L, A>, const L: usize, const A: usize>(form: &Form<L>) -> G::Shape {
    match form {
        Form::Ball(radius) => G::ball(*radius),
        Form::Capsule(half, radius) => G::capsule(*half, *radius),
        Form::Box(half) => G::cuboid(*half),
        Form::Ground => G::halfspace(v(0.0, 1.0, 0.0)),
    }
}

/// Particles are balls of the capsules' radii and the boxes' first sides.
fn particle<G: RoundShapes<L, A>, const L: usize, const A: usize>(form: &Form<L>) -> G::Shape {
    match form {
        Form::Ball(radius) | Form::Capsule(_, radius) => G::ball(*radius),
        Form::Box(half) => G::ball(half[0]),
        Form::Ground => G::halfspace(v(0.0, 1.0, 0.0)),
    }
}

/// A collider, and what is known of it.
struct Part<G: Geometry<L, A>, const L: usize, const A: usize> {
    body: BodyId,
    collider: ColliderId,
    local: G::Pose,
    form: Form<L>,
}

struct Crowd<G: Dimension<L, A>, const L: usize, const A: usize> {
    world: World<G, L, A>,
    parts: Vec<Part<G, L, A>>,
    shape: fn(&Form<L>) -> G::Shape,
    random: Random,
    /// Number of results that were compared, and that were not sure.
    compared: [usize; 2],
}

/// The nearest collider on a ray, and the distance to it. \[m\]
type Nearest = Option<(usize, f64)>;

impl<G: Dimension<L, A>, const L: usize, const A: usize> Crowd<G, L, A> {
    fn new(seed: u64, shape: fn(&Form<L>) -> G::Shape) -> Self {
        let world = World::new(StepSettings::realtime());
        let random = Random(seed);
        let mut crowd = Self { world, parts: Vec::new(), shape, random, compared: [0; 2] };
        crowd.world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
        crowd.add(Motion::Static, v(0.0, -4.0, 0.0), vec![(Form::Ground, [0.0; L])], 0.0);
        crowd
    }

    fn add(
        &mut self,
        motion: Motion,
        at: [f32; L],
        forms: Vec<(Form<L>, [f32; L])>,
        speed: f32,
    ) -> BodyId {
        let mut body = Body::new(motion, at, (self.shape)(&forms[0].0));
        body.colliders.clear();
        for (form, local) in &forms {
            let local = G::pose(Vector(*local), &[]);
            body.colliders.push(Collider { pose: local, ..Collider::new((self.shape)(form)) });
        }
        if motion != Motion::Static {
            body.velocity.linear = Vector(self.random.vector(speed));
            body.velocity.angular = Vector(self.random.vector(0.1 * speed));
        }
        let id = self.world.add(body).unwrap();
        // Colliders come in reverse order of addition.
        let colliders: Vec<ColliderId> = self.world.colliders(id).collect();
        for ((form, local), collider) in forms.into_iter().zip(colliders.into_iter().rev()) {
            // Particles are balls, whatever was asked for.
            let form = match form {
                Form::Capsule(_, radius) if A == 0 => Form::Ball(radius),
                Form::Box(half) if A == 0 => Form::Ball(half[0]),
                form => form,
            };
            let local = G::pose(Vector(local), &[]);
            self.parts.push(Part { body: id, collider, local, form });
        }
        id
    }

    /// Adds a body of one to three shapes somewhere.
    fn add_random(&mut self, speed: f32) -> BodyId {
        let count = self.random.between(1.0, 3.9) as usize;
        let forms = (0..count).map(|i| {
            let local = if i == 0 || A == 0 { [0.0; L] } else { self.random.vector(0.6) };
            (Form::random(&mut self.random), local)
        });
        let forms: Vec<_> = forms.collect();
        let at = self.random.vector(4.0);
        let forms = if A == 0 { forms[..1].to_vec() } else { forms };
        self.add(Motion::Dynamic, at, forms, speed)
    }

    fn remove(&mut self, id: BodyId) {
        assert!(self.world.remove(id));
        self.parts.retain(|part| part.body != id);
    }

    fn distance(&self, part: usize, point: [f64; L]) -> f64 {
        let part = &self.parts[part];
        let frame = G::frame(&G::compose(&self.world.pose(part.body).unwrap(), &part.local));
        let arm: [f64; L] = std::array::from_fn(|i| point[i] - f64::from(frame.position[i]));
        let along = |axis: Vector<f32, L>| (0..L).map(|i| f64::from(axis[i]) * arm[i]).sum();
        part.form.distance(std::array::from_fn(|i| along(frame.axes[i])))
    }

    /// Follows a ray by steps of the smallest distance, to shapes enlarged by `by` \[m\]. None if
    /// it does not end.
    fn trace(&self, from: [f64; L], way: [f64; L], most: f64, by: f64) -> Option<Nearest> {
        let mut t = 0.0;
        for _ in 0..2000 {
            let point = std::array::from_fn(|i| from[i] + t * way[i]);
            let all = (0..self.parts.len()).map(|part| (part, self.distance(part, point) - by));
            let (part, distance) = all.min_by(|p, q| p.1.total_cmp(&q.1))?;
            if distance < 1e-6 {
                return Some(Some((part, t)));
            }
            t += distance;
            if t > most {
                return Some(None);
            }
        }
        None
    }

    fn count(&mut self, is_sure: bool) {
        self.compared[usize::from(!is_sure)] += 1;
    }

    /// Compares a ray from a random point, in every other case towards a body.
    fn check_ray(&mut self, number: usize) {
        let (origin, mut way) = (self.random.vector(6.0), self.random.vector::<L>(1.0));
        if number.is_multiple_of(2) {
            let part = self.random.between(0.0, self.parts.len() as f32) as usize;
            let target = G::frame(&self.world.pose(self.parts[part].body).unwrap()).position;
            way = std::array::from_fn(|i| target[i] - origin[i] + 0.1 * way[i]);
        }
        if way == [0.0; L] {
            return;
        }
        let most = self.random.between(0.0, 20.0);
        let found = self.world.cast_ray(origin, way, most).unwrap();
        let from = origin.map(f64::from);
        let long = length(way.map(f64::from));
        let unit = way.map(|x| f64::from(x) / long);
        let [outer, inner] = [SURE, -SURE].map(|by| self.trace(from, unit, f64::from(most), by));
        let (Some(outer), Some(inner)) = (outer, inner) else { return self.count(false) };
        let (Some((part, least)), Some((other, last))) = (outer, inner) else {
            let is_sure = outer.is_none() && inner.is_none();
            assert!(!is_sure || found.is_none(), "{found:?}");
            return self.count(is_sure);
        };
        if last == 0.0 {
            return self.check_start(found, [from, unit]);
        }
        // Where the surface is steep the bounds are near each other.
        if part != other || last - least > 100.0 * SURE || last + SURE > f64::from(most) {
            return self.count(false);
        }
        let hit = found.expect("a hit");
        let part = &self.parts[part];
        assert_eq!((hit.body, hit.collider), (part.body, part.collider));
        let distance = f64::from(hit.distance);
        assert!(least - SURE <= distance && distance <= last + SURE, "{least} {distance} {last}");
        self.check_hit(&hit, [from, unit], other);
        self.count(true);
    }

    /// Compares a ray that begins in a collider: it hits the one of the lowest slot.
    fn check_start(&mut self, found: Option<RayHit<L>>, ray: [[f64; L]; 2]) {
        let all: Vec<f64> = (0..self.parts.len()).map(|part| self.distance(part, ray[0])).collect();
        if all.iter().any(|distance| distance.abs() < SURE) {
            return self.count(false);
        }
        let holds = (0..self.parts.len()).filter(|part| all[*part] < 0.0);
        let part = holds.min_by_key(|part| self.parts[*part].collider.index()).unwrap();
        let hit = found.expect("a hit");
        assert_eq!((hit.collider, hit.distance), (self.parts[part].collider, 0.0));
        self.check_hit(&hit, ray, part);
        self.count(true);
    }

    /// Checks that point and normal of a hit are those of the surface.
    fn check_hit(&self, hit: &RayHit<L>, [from, unit]: [[f64; L]; 2], part: usize) {
        let at: [f64; L] = std::array::from_fn(|i| f64::from(hit.point[i]));
        let off = (0..L).map(|i| from[i] + unit[i] * f64::from(hit.distance) - at[i]);
        assert!(length(off) < 1e-5);
        let normal: [f64; L] = std::array::from_fn(|i| f64::from(hit.normal[i]));
        assert!((length(normal) - 1.0).abs() < 1e-5, "{normal:?}");
        let facing: f64 = (0..L).map(|i| normal[i] * unit[i]).sum();
        assert!(facing < 1e-6, "the normal is on the side of the origin");
        if hit.distance == 0.0 {
            assert!(facing < -1.0 + 1e-5, "the ray begins inside");
            return;
        }
        let above = self.distance(part, std::array::from_fn(|i| at[i] + 0.01 * normal[i]));
        assert!((above - 0.01).abs() < 2e-4, "{above} above {:?}", self.parts[part].form);
    }

    /// Compares the colliders at a random point.
    fn check_point(&mut self) {
        let point: [f32; L] = self.random.vector(5.0);
        let distances: Vec<f64> =
            (0..self.parts.len()).map(|part| self.distance(part, point.map(f64::from))).collect();
        if distances.iter().any(|distance| distance.abs() < SURE) {
            return self.count(false);
        }
        let parts = self.parts.iter().zip(distances).filter(|(_, distance)| *distance < 0.0);
        let mut expected: Vec<ColliderId> = parts.map(|(part, _)| part.collider).collect();
        expected.sort_by_key(|id| id.index());
        assert_eq!(self.world.colliders_at(point).unwrap(), expected);
        self.count(true);
    }

    /// Compares the colliders in a random box.
    fn check_box(&mut self) {
        let (center, half): ([f32; L], [f32; L]) =
            (self.random.vector(5.0), self.random.vector(1.0));
        let corner = |sign: f32| Vector(std::array::from_fn(|i| center[i] + sign * half[i].abs()));
        let bounds = Bounds { min: corner(-1.0), max: corner(1.0) };
        let gap = |part: &Part<G, L, A>| {
            let frame = G::frame(&G::compose(&self.world.pose(part.body).unwrap(), &part.local));
            let gaps = (0..L).map(|i| {
                let axis = std::array::from_fn(|k| f64::from(frame.axes[k][i]));
                let (at, extent) = (f64::from(frame.position[i]), part.form.extent(axis));
                (f64::from(bounds.min[i]) - at).max(at - f64::from(bounds.max[i])) - extent
            });
            gaps.fold(f64::NEG_INFINITY, f64::max)
        };
        let gaps: Vec<f64> = self.parts.iter().map(gap).collect();
        if gaps.iter().any(|gap| gap.abs() < SURE) {
            return self.count(false);
        }
        let parts = self.parts.iter().zip(gaps).filter(|(_, gap)| *gap < 0.0);
        let mut expected: Vec<ColliderId> = parts.map(|(part, _)| part.collider).collect();
        expected.sort_by_key(|id| id.index());
        assert_eq!(self.world.colliders_in_box(&bounds).unwrap(), expected);
        self.count(true);
    }

    fn check(&mut self) {
        for number in 0..60 {
            self.check_ray(number);
            self.check_point();
            self.check_box();
        }
    }
}

/// Checks a crowd after each kind of change.
fn crowd<G: Dimension<L, A>, const L: usize, const A: usize>(shape: fn(&Form<L>) -> G::Shape) {
    let mut compared = [0; 2];
    for seed in 0..6 {
        let mut crowd = Crowd::<G, L, A>::new(seed, shape);
        // Slow bodies stay in their boxes; fast ones leave them when they collide.
        let speed = [1.0, 20.0, 300.0][seed as usize % 3];
        let ids: Vec<BodyId> = (0..30).map(|_| crowd.add_random(speed)).collect();
        crowd.check();
        let saved = crowd.world.checkpoint();
        for _ in 0..3 {
            crowd.world.step(DT).unwrap();
            crowd.check();
        }
        crowd.world.restore(&saved).unwrap();
        crowd.check();
        run(&mut crowd.world, 0.1);
        crowd.check();
        let moved: [f32; L] = crowd.random.vector(3.0);
        crowd.world.set_pose(ids[0], &G::pose(Vector(moved), &[])).unwrap();
        crowd.check();
        crowd.remove(ids[1]);
        crowd.check();
        crowd.add_random(1.0);
        crowd.check();
        crowd.world.step(DT).unwrap();
        crowd.check();
        compared = [0, 1].map(|i| compared[i] + crowd.compared[i]);
    }
    println!("{} results are compared, {} are not sure", compared[0], compared[1]);
    assert!(compared[1] * 10 < compared[0], "{compared:?}");
}

/// Rays, points and boxes find what the signed distances of all colliders say, in crowds of slow
/// and fast bodies and compounds, before and after steps, restores, moves, removals and additions.
#[test]
fn queries_find_what_distances_say() {
    crowd::<Rigid2, 2, 1>(rigid::<Rigid2, 2, 1>);
    crowd::<Rigid3, 3, 3>(rigid::<Rigid3, 3, 3>);
    crowd::<Particles, 2, 0>(particle::<Particles, 2, 0>);
    crowd::<Particles, 3, 0>(particle::<Particles, 3, 0>);
}

/// Casts a ray at one static shape at the origin.
fn cast(shape: SharedShape, from: [f32; 3], way: [f32; 3]) -> Option<(f32, [f32; 3])> {
    let mut world = World3::new(StepSettings::realtime());
    world.add(Body::new(Motion::Static, [0.0; 3], shape)).unwrap();
    let hit = world.cast_ray(from, way, f32::INFINITY).unwrap()?;
    Some((hit.distance, hit.normal.0))
}

/// Asserts a hit at a distance to 1e-5 of it, and a normal to 1e-3.
#[track_caller]
fn assert_hit(found: Option<(f32, [f32; 3])>, distance: f32, normal: [f32; 3]) {
    let (at, along) = found.expect("a hit");
    assert!((at - distance).abs() <= 1e-5 * distance, "{at}, expected {distance}");
    let off = (0..3).map(|i| f64::from(along[i] - normal[i]));
    assert!(length(off) < 1e-3, "{along:?}, expected {normal:?}");
}

/// Distances and normals on paper for each kind of shape that has no signed distance here.
#[test]
fn rays_meet_shapes_where_they_are() {
    let (down, up) = ([0.0, -1.0, 0.0], [0.0, 1.0, 0.0]);
    let cylinder = || SharedShape::cylinder(1.0, 0.5);
    assert_hit(cast(cylinder(), [0.3, 5.0, 0.0], down), 4.0, up);
    assert_hit(cast(cylinder(), [3.0, 0.9, 0.0], [-2.0, 0.0, 0.0]), 2.5, [1.0, 0.0, 0.0]);
    assert_eq!(cast(cylinder(), [3.0, 1.1, 0.0], [-1.0, 0.0, 0.0]), None);
    assert_eq!(cast(cylinder(), [0.6, 5.0, 0.0], down), None, "along the axis, beside it");
    // A cone of half height 1 and radius 1: its side rises by 2 over 1.
    let side = [0.8f32.sqrt(), 0.2f32.sqrt(), 0.0];
    assert_hit(cast(SharedShape::cone(1.0, 1.0), [3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]), 2.5, side);
    let corners = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let hull = Rigid3::hull(&corners);
    let third = 1.0 / 3.0f32.sqrt();
    let slope = [third; 3];
    assert_hit(cast(hull, [0.5, 0.25, 5.0], [0.0, 0.0, -1.0]), 4.75, slope);
}

/// A mesh has no interior: it is hit from both sides, beside its holes, and holds no point.
#[test]
fn meshes_are_hit_from_both_sides() {
    let floor = || grid(4, 2.0);
    for (height, normal) in [(3.0, 1.0), (-3.0, -1.0)] {
        let way = [0.0, -height, 0.0];
        assert_hit(cast(floor(), [0.3, height, 0.4], way), 3.0, [0.0, normal, 0.0]);
        assert_eq!(cast(floor(), [1.3, height, 0.4], way), None);
    }
    let shell = Rigid3::mesh(
        &[[1.0, -1.0, -1.0], [-1.0, -1.0, -1.0], [0.0, -1.0, 1.0], [0.0, 1.0, 0.0]],
        &[[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]],
    );
    assert_hit(cast(shell.clone(), [0.0; 3], [0.0, -1.0, 0.0]), 1.0, [0.0, 1.0, 0.0]);
    let mut world = World3::new(StepSettings::realtime());
    world.add(Body::new(Motion::Static, [0.0; 3], shell)).unwrap();
    assert_eq!(world.colliders_at([0.0; 3]).unwrap(), []);
}

/// A ray from 100 km away is as exact as the coordinates of its origin are.
#[test]
fn rays_from_far_away_are_exact() {
    let ball = || SharedShape::ball(0.5);
    assert_hit(cast(ball(), [1e5, 0.3, 0.0], [-1.0, 0.0, 0.0]), 1e5 - 0.4, [0.8, 0.6, 0.0]);
    assert_eq!(cast(ball(), [1e5, 0.51, 0.0], [-1.0, 0.0, 0.0]), None);
    let capsule = SharedShape::capsule_y(0.5, 0.5);
    assert_hit(cast(capsule, [0.0, 0.8, 1e5], [0.0, 0.0, -3.0]), 1e5 - 0.4, [0.0, 0.6, 0.8]);
}

/// Among colliders at the same distance, the lowest slot is hit. A ray passes the colliders that
/// are not accepted, and ends at its largest distance.
#[test]
fn the_first_accepted_collider_is_hit() {
    let mut world = World3::new(StepSettings::realtime());
    let mut add = |x: f32| {
        world.add(Body::new(Motion::Static, [x, 0.0, 0.0], Rigid3::cuboid([0.5; 3]))).unwrap()
    };
    let [first, _, behind] = [2.0, 2.0, 4.0].map(&mut add);
    let along = [1.0, 0.0, 0.0];
    let hit = world.cast_ray([0.0; 3], along, 10.0).unwrap().unwrap();
    assert_eq!((hit.body, hit.distance, hit.point), (first, 1.5, Vector([1.5, 0.0, 0.0])));
    let is_behind = |id: ColliderId| world.body_of(id) == Some(behind);
    let hit = world.cast_ray_where([0.0; 3], along, 10.0, is_behind).unwrap().unwrap();
    assert_eq!((hit.body, hit.distance), (behind, 3.5));
    assert_eq!(world.cast_ray([0.0; 3], along, 1.4).unwrap(), None);
    assert_eq!(world.cast_ray([0.0; 3], along, 1.5).unwrap().map(|hit| hit.body), Some(first));
    assert_eq!(
        world.cast_ray([2.0, 0.0, 0.0], along, 0.0).unwrap().map(|hit| hit.distance),
        Some(0.0)
    );
}

/// A body that is moved by less than the margin of its box is found at its new pose.
#[test]
fn small_moves_are_seen() {
    let mut world = World3::new(StepSettings::realtime());
    let cube = Body::new(Motion::Dynamic, [0.0; 3], Rigid3::cuboid([0.5; 3]));
    let cube = world.add(cube).unwrap();
    let hit = |world: &World3| world.cast_ray([0.51, 4.0, 0.0], [0.0, -1.0, 0.0], 9.0).unwrap();
    assert_eq!(hit(&world), None);
    world.set_pose(cube, &Rigid3::pose(Vector([0.02, 0.0, 0.0]), &[])).unwrap();
    assert_eq!(hit(&world).map(|hit| hit.distance), Some(3.5));
}

/// Sleeping bodies are found, and go on sleeping.
#[test]
fn sleepers_are_found_and_sleep_on() {
    let mut world: World3 = world();
    world.settings = StepSettings::realtime();
    add_floor(&mut world, &surface(0.5, 0.0));
    let cube = Body::new(Motion::Dynamic, [0.0, 0.5, 0.0], Rigid3::cuboid([0.5; 3]));
    let cube = world.add(cube).unwrap();
    run(&mut world, 3.0);
    assert!(world.is_sleeping(cube));
    let hit = world.cast_ray([0.0, 4.0, 0.0], [0.0, -1.0, 0.0], 9.0).unwrap().unwrap();
    assert_eq!(hit.body, cube);
    assert_eq!(world.colliders_at([0.0, 0.5, 0.0]).unwrap(), [hit.collider]);
    let bounds = Bounds { min: Vector([-1.0, 0.9, -1.0]), max: Vector([1.0; 3]) };
    assert!(world.colliders_in_box(&bounds).unwrap().contains(&hit.collider));
    assert!(world.is_sleeping(cube));
}

/// Numbers that are not finite, a zero direction and a negative distance are refused.
#[test]
fn bad_queries_are_refused() {
    let mut world = World3::new(StepSettings::realtime());
    world.add(Body::new(Motion::Static, [0.0; 3], Rigid3::ball(1.0))).unwrap();
    let is_refused = |error: Option<InputError>, item: &str| {
        let Some(InputError::OutOfRange { item: own, .. }) = &error else { return false };
        own.contains(item)
    };
    let (from, way) = ([3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
    for bad in [f32::NAN, f32::INFINITY] {
        assert!(is_refused(world.cast_ray([bad, 0.0, 0.0], way, 9.0).err(), "origin"), "{bad}");
        assert!(is_refused(world.cast_ray(from, [0.0, bad, 0.0], 9.0).err(), "direction"), "{bad}");
        assert!(is_refused(world.colliders_at([0.0, 0.0, bad]).err(), "point"), "{bad}");
    }
    assert!(is_refused(world.cast_ray(from, [0.0; 3], 9.0).err(), "direction"));
    for bad in [f32::NAN, -1.0] {
        assert!(is_refused(world.cast_ray(from, way, bad).err(), "distance"), "{bad}");
    }
    let bounds = Bounds { min: Vector([f32::NAN; 3]), max: Vector([1.0; 3]) };
    assert!(is_refused(world.colliders_in_box(&bounds).err(), "box"));
    // A box without limits holds all, an empty one nothing, and tiny directions are directions.
    let all = Bounds { min: Vector([f32::NEG_INFINITY; 3]), max: Vector([f32::INFINITY; 3]) };
    assert_eq!(world.colliders_in_box(&all).unwrap().len(), 1);
    assert_eq!(world.colliders_in_box(&Bounds::EMPTY).unwrap(), []);
    let hit = world.cast_ray(from, [-1e-12, 0.0, 0.0], f32::INFINITY).unwrap();
    assert_eq!(hit.map(|hit| hit.distance), Some(2.0));
}

/// Queries between steps change no bit of the motion.
#[test]
fn queries_change_no_bit() {
    let poses = |asks: bool| {
        let mut crowd = Crowd::<Rigid3, 3, 3>::new(7, rigid::<Rigid3, 3, 3>);
        let ids: Vec<BodyId> = (0..20).map(|_| crowd.add_random(5.0)).collect();
        let mut out = Vec::new();
        for step in 0..60 {
            if asks {
                let all = Bounds { min: Vector([-9.0; 3]), max: Vector([9.0; 3]) };
                assert!(crowd.world.colliders_in_box(&all).unwrap().len() > 1);
                crowd.world.cast_ray([0.0, 5.0, 0.0], [0.1, -1.0, 0.0], 20.0).unwrap();
            }
            if step == 20 {
                crowd.remove(ids[3]);
            }
            crowd.world.step(DT).unwrap();
            crowd.world.write_poses(&mut out);
        }
        out
    };
    assert!(poses(true) == poses(false));
}
