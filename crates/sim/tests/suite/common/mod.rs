//! Worlds, shapes, bodies and comparisons that the tests share.

pub(crate) mod counting;

use drystone::Dimension;
use drystone::geometry::particles::SphereShape;
use drystone::geometry::{Geometry, Particles, Rigid2, Rigid3};
use drystone::{Body, BodyId, Inertia, Material, Motion, StepSettings, World};
use drystone_solver::{SymmetricMatrix, Vector, Velocity};

/// Time step of a frame. \[s\]
pub(crate) const DT: f32 = 1.0 / 60.0;

/// Gravitational acceleration. \[m/s^2\]
pub(crate) const GRAVITY: f32 = 9.81;

/// Returns the length of a substep of a frame at the default settings. \[s\]
pub(crate) fn substep() -> f32 {
    DT / StepSettings::quality().substeps as f32
}

/// Returns the first `L` of three components.
pub(crate) fn v<const L: usize>(x: f32, y: f32, z: f32) -> [f32; L] {
    std::array::from_fn(|i| [x, y, z][i])
}

/// Shapes that particles and rigid bodies have.
pub(crate) trait RoundShapes<const L: usize, const A: usize>: Dimension<L, A> {
    fn ball(radius: f32) -> Self::Shape;
    fn halfspace(normal: [f32; L]) -> Self::Shape;
}

/// Shapes of rigid bodies.
pub(crate) trait Rigid<const L: usize, const A: usize>: RoundShapes<L, A> {
    fn cuboid(half: [f32; L]) -> Self::Shape;
    fn capsule(half_height: f32, radius: f32) -> Self::Shape;
    fn hull(points: &[[f32; L]]) -> Self::Shape;
    /// Returns a triangle mesh as scenes build it: bodies slide over its inner edges without
    /// catching.
    fn mesh(vertices: &[[f32; L]], triangles: &[[u32; 3]]) -> Self::Shape;
    /// Returns the pose at `position`, rotated by `angle` \[rad\] about z.
    fn turned(position: [f32; L], angle: f32) -> Self::Pose;
}

impl<const L: usize> RoundShapes<L, 0> for Particles
where
    Self: Dimension<L, 0> + Geometry<L, 0, Shape = SphereShape<L>>,
{
    fn ball(radius: f32) -> Self::Shape {
        SphereShape::Sphere { radius }
    }

    fn halfspace(normal: [f32; L]) -> Self::Shape {
        SphereShape::Halfspace { normal: Vector(normal) }
    }
}

macro_rules! rigid {
    ($geometry:ty, $parry:ident, $l:literal, $a:literal, $cuboid:expr, $rotation:expr) => {
        impl RoundShapes<$l, $a> for $geometry {
            fn ball(radius: f32) -> Self::Shape {
                $parry::shape::SharedShape::ball(radius)
            }

            fn halfspace(normal: [f32; $l]) -> Self::Shape {
                $parry::shape::SharedShape::halfspace($parry::math::Vector::from(normal))
            }
        }

        impl Rigid<$l, $a> for $geometry {
            fn cuboid(half: [f32; $l]) -> Self::Shape {
                $cuboid(half)
            }

            fn capsule(half_height: f32, radius: f32) -> Self::Shape {
                $parry::shape::SharedShape::capsule_y(half_height, radius)
            }

            fn hull(points: &[[f32; $l]]) -> Self::Shape {
                let points: Vec<_> =
                    points.iter().map(|p| $parry::math::Vector::from(*p)).collect();
                $parry::shape::SharedShape::convex_hull(&points).unwrap()
            }

            fn mesh(vertices: &[[f32; $l]], triangles: &[[u32; 3]]) -> Self::Shape {
                use $parry::shape::{SharedShape, TriMeshFlags};
                let vertices = vertices.iter().map(|v| $parry::math::Vector::from(*v)).collect();
                let flags = TriMeshFlags::FIX_INTERNAL_EDGES
                    | TriMeshFlags::MERGE_DUPLICATE_VERTICES
                    | TriMeshFlags::DELETE_DEGENERATE_TRIANGLES;
                SharedShape::trimesh_with_flags(vertices, triangles.to_vec(), flags).unwrap()
            }

            fn turned(position: [f32; $l], angle: f32) -> Self::Pose {
                Self::pose(Vector(position), &$rotation(angle))
            }
        }
    };
}

rigid!(
    Rigid2,
    parry2d,
    2,
    1,
    |[x, y]: [f32; 2]| parry2d::shape::SharedShape::cuboid(x, y),
    |angle: f32| [angle]
);
rigid!(
    Rigid3,
    parry3d,
    3,
    3,
    |[x, y, z]: [f32; 3]| parry3d::shape::SharedShape::cuboid(x, y, z),
    |angle: f32| [0.0, 0.0, (angle * 0.5).sin(), (angle * 0.5).cos()]
);

/// Returns a flat floor of `n` times `n` squares of two triangles each, centered and facing up.
pub(crate) fn grid(n: u32, size: f32) -> parry3d::shape::SharedShape {
    let at = |i: u32| (i as f32 / n as f32 - 0.5) * size;
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            vertices.push([at(i), 0.0, at(j)]);
        }
    }
    for i in 0..n {
        for j in 0..n {
            let corner = i * (n + 1) + j;
            let (right, ahead) = (corner + n + 1, corner + 1);
            triangles.push([corner, ahead, right]);
            triangles.push([ahead, right + 1, right]);
        }
    }
    Rigid3::mesh(&vertices, &triangles)
}

/// Returns an empty world with gravity along -y.
pub(crate) fn world<G: Dimension<L, A>, const L: usize, const A: usize>() -> World<G, L, A> {
    let mut world = World::new(StepSettings::quality());
    world.gravity = Vector(v(0.0, -GRAVITY, 0.0));
    world
}

/// Returns an empty world without gravity.
pub(crate) fn weightless<G: Dimension<L, A>, const L: usize, const A: usize>() -> World<G, L, A> {
    World::new(StepSettings::quality())
}

pub(crate) fn surface(friction: f64, restitution: f64) -> Material {
    Material { friction, restitution, ..Material::default() }
}

/// Returns a body with one shape.
pub(crate) fn body<G: Dimension<L, A>, const L: usize, const A: usize>(
    motion: Motion,
    position: [f32; L],
    shape: G::Shape,
    material: &Material,
) -> Body<G, L, A> {
    let mut body = Body::new(motion, position, shape);
    body.colliders[0].material = material.clone();
    body
}

pub(crate) fn dynamic<G: Dimension<L, A>, const L: usize, const A: usize>(
    position: [f32; L],
    shape: G::Shape,
    material: &Material,
) -> Body<G, L, A> {
    body(Motion::Dynamic, position, shape, material)
}

/// Adds the half-space below y = 0.
pub(crate) fn add_floor<G: RoundShapes<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    material: &Material,
) -> BodyId {
    let shape = G::halfspace(v(0.0, 1.0, 0.0));
    world.add(body(Motion::Static, [0.0; L], shape, material)).unwrap()
}

/// Returns the body with another linear velocity.
pub(crate) fn moving<G: Dimension<L, A>, const L: usize, const A: usize>(
    mut body: Body<G, L, A>,
    linear: [f32; L],
) -> Body<G, L, A> {
    body.velocity.linear = Vector(linear);
    body
}

/// Returns the body with this mass and the inertia of its first shape scaled to it.
pub(crate) fn weighing<G: Dimension<L, A>, const L: usize, const A: usize>(
    mut body: Body<G, L, A>,
    mass: f32,
) -> Body<G, L, A> {
    let collider = &body.colliders[0];
    let density = mass / G::mass(&collider.shape, 1.0).mass;
    body.inertia = Some(Inertia::of(&G::mass(&collider.shape, density)));
    body
}

/// Steps by frames until `seconds` have passed.
pub(crate) fn run<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &mut World<G, L, A>,
    seconds: f32,
) {
    for _ in 0..(seconds / DT).round() as usize {
        world.step(DT).unwrap();
    }
}

pub(crate) fn place<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: BodyId,
) -> Vector<f32, L> {
    G::frame(&world.pose(id).unwrap()).position
}

pub(crate) fn velocity<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: BodyId,
) -> Velocity<f32, L, A> {
    world.velocity(id).unwrap()
}

/// Returns the cosine between the y axes of a body and of the world.
pub(crate) fn upright<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: BodyId,
) -> f32 {
    G::frame(&world.pose(id).unwrap()).axes[1][1]
}

/// Returns the kinetic plus the potential energy. \[J\]
pub(crate) fn energy<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
) -> f64 {
    let measure = world.measure();
    measure.kinetic_energy + measure.potential_energy
}

/// Returns the sum of the normal impulses between two bodies in the last substep. \[N s\]
pub(crate) fn impulse_between<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    a: BodyId,
    b: BodyId,
) -> f32 {
    let system = world.system();
    let pair = [a.index() as u32, b.index() as u32];
    let between = |bodies: &[u32; 2]| *bodies == pair || *bodies == [pair[1], pair[0]];
    let manifolds = system.manifolds.iter().filter(|manifold| between(&manifold.bodies));
    manifolds
        .flat_map(|manifold| &system.contacts[manifold.points()])
        .map(|contact| contact.impulse[0])
        .sum()
}

/// Returns R D R^T w, the angular momentum of a body with the principal moments D. \[kg m^2/s\]
pub(crate) fn angular_momentum<G: Dimension<L, A>, const L: usize, const A: usize>(
    world: &World<G, L, A>,
    id: BodyId,
    moments: SymmetricMatrix<f32, A>,
) -> Vector<f32, A> {
    let frame = G::frame(&world.pose(id).unwrap());
    frame.tensor(moments) * velocity(world, id).angular
}

/// Prints the measured value, and panics if it differs from the expected one by more than this
/// fraction of it.
#[track_caller]
pub(crate) fn assert_within(what: &str, measured: f32, expected: f32, part: f32) {
    println!("{what}: {measured}, expected {expected} within {} %", part * 100.0);
    assert!(
        (measured - expected).abs() <= part * expected.abs(),
        "{what}: {measured}, expected {expected} within {} %",
        part * 100.0
    );
}

/// Prints the measured value, and panics if it is not below `bound`.
#[track_caller]
pub(crate) fn assert_below(what: &str, measured: f32, bound: f32) {
    println!("{what}: {measured}, to be below {bound}");
    assert!(measured < bound, "{what}: {measured}, to be below {bound}");
}

/// Prints the measured value, and panics if it is not above `bound`.
#[track_caller]
pub(crate) fn assert_above(what: &str, measured: f32, bound: f32) {
    println!("{what}: {measured}, to be above {bound}");
    assert!(measured > bound, "{what}: {measured}, to be above {bound}");
}

/// Random numbers that are the same on every platform (SplitMix64).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Returns a number between `low` and `high`.
    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        low + (high - low) * ((z >> 40) as f32 / (1u64 << 24) as f32)
    }

    pub(crate) fn vector<const L: usize>(&mut self, length: f32) -> [f32; L] {
        std::array::from_fn(|_| self.between(-length, length))
    }

    pub(crate) fn quaternion(&mut self) -> [f32; 4] {
        let q: [f32; 4] = self.vector(1.0);
        let length = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        if length > 0.1 { q.map(|x| x / length) } else { self.quaternion() }
    }
}
