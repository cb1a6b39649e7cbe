//! Scenes made in code, in SI units with +y up. Every machine makes the same numbers.

use std::f64::consts::PI;

use drystone_scene::{BodiesAs, Motion, Rotation, Scene, ShapeKind, WorldTrack};
use parry3d_f64::shape::SharedShape as Exact;

use crate::case::Case;

/// Shape of a body.
enum MadeShape {
    /// Half extents. \[m\]
    Box([f32; 3]),
    /// Radius. \[m\]
    Sphere(f32),
    /// Points relative to the center of mass. \[m\]
    Hull(Vec<[f32; 3]>),
}

/// A body, dynamic unless `fixed`.
struct Body {
    form: MadeShape,
    position: [f32; 3],
    /// Unit quaternion x, y, z, w.
    rotation: [f32; 4],
    velocity: [f32; 3],
    density: f32,
    fixed: bool,
}

impl Body {
    fn new(form: MadeShape, position: [f32; 3]) -> Self {
        let rotation = [0.0, 0.0, 0.0, 1.0];
        Self { form, position, rotation, velocity: [0.0; 3], density: 1000.0, fixed: false }
    }

    fn fixed(half: [f32; 3], position: [f32; 3]) -> Self {
        Self { fixed: true, ..Self::new(MadeShape::Box(half), position) }
    }

    /// Returns the body for a scene of `dimension`; in 2D without z components.
    fn described(&self, dimension: usize, friction: f64) -> drystone_scene::Body {
        let axes = |of: &[f32; 3]| of[..dimension].iter().map(|&x| x.into()).collect::<Vec<f64>>();
        let kind = match &self.form {
            MadeShape::Box(half) => ShapeKind::Box { half_extents: axes(half) },
            &MadeShape::Sphere(radius) => ShapeKind::Sphere { radius: radius.into() },
            MadeShape::Hull(points) => {
                ShapeKind::ConvexHull { points: points.iter().map(axes).collect() }
            }
        };
        let turn = |q: [f32; 4]| match dimension {
            2 => Rotation::Angle(0.0),
            _ => Rotation::Quaternion(q.map(f64::from)),
        };
        let motion = if self.fixed { Motion::Static } else { Motion::Dynamic };
        let mut body = match dimension {
            2 => drystone_scene::Body::new(motion, [0.0; 2], kind),
            _ => drystone_scene::Body::new(motion, [0.0; 3], kind),
        };
        body.shapes[0].material.friction = friction;
        body.mass.density = Some(self.density.into());
        body.position = axes(&self.position);
        body.rotation = turn(self.rotation);
        body.linear_velocity = axes(&self.velocity);
        body
    }
}

/// Names of all scenes that run if none is requested.
pub(crate) const NAMES: [&str; 12] = [
    "stack_30",
    "pyramid_20",
    "pyramid_40",
    "arch",
    "dominoes_200",
    "box_pile_1000",
    "hull_pile_500",
    "sphere_pile_1000",
    "sphere_pile_8000",
    "stack_30_2d",
    "pyramid_20_2d",
    "disk_pile_1000_2d",
];

/// Makes a scene by its name.
pub(crate) fn made(name: &str) -> Option<Case> {
    let (steps, friction, bodies) = match name {
        "stack_30" | "stack_30_2d" => (1200, 0.5, stack(30)),
        "pyramid_20" | "pyramid_20_2d" => (1200, 0.5, pyramid(20)),
        "pyramid_40" => (1200, 0.5, pyramid(40)),
        "arch" => (1200, 0.7, arch()),
        "dominoes_200" => (1200, 0.5, dominoes(200)),
        "box_pile_1000" => (600, 0.5, pile(1000, 10, 0.92, 3, tumbled_box)),
        "hull_pile_500" => (600, 0.5, pile(500, 8, 0.66, 5, tumbled_hull)),
        "disk_pile_1000_2d" => (600, 0.5, disks(1000, 25, 0.6)),
        _ => {
            // Sphere piles may have any number of spheres.
            let count = name.strip_prefix("sphere_pile_")?.parse().ok()?;
            let side = (1..=200).find(|side| side * side * side >= count)?;
            (600, 0.5, pile(count, side, 0.6, side.div_ceil(10) as u64, sphere))
        }
    };
    let dimension = if name.ends_with("_2d") { 2 } else { 3 };
    let mut gravity = vec![0.0; dimension];
    gravity[1] = -9.81;
    let scene = Scene {
        name: Some(name.to_string()),
        dimension,
        gravity,
        time_step: 1.0 / 60.0,
        track: WorldTrack::default(),
        steps: Some(steps),
        bodies_as: BodiesAs::Rigid,
        bodies: bodies.iter().map(|body| body.described(dimension, friction)).collect(),
        joints: Vec::new(),
        solver: serde_json::Map::new(),
    };
    let name = name.to_string();
    Some(Case { name, file: None, scene, steps: steps as usize, stand_tolerance: None })
}

fn ground() -> Body {
    Body::fixed([50.0, 1.0, 50.0], [0.0, -1.0, 0.0])
}

fn unit_box(position: [f32; 3]) -> Body {
    Body::new(MadeShape::Box([0.5; 3]), position)
}

fn stack(count: usize) -> Vec<Body> {
    let boxes = (0..count).map(|i| unit_box([0.0, 0.5 + i as f32, 0.0]));
    std::iter::once(ground()).chain(boxes).collect()
}

fn pyramid(base: usize) -> Vec<Body> {
    let mut bodies = vec![ground()];
    for layer in 0..base {
        let count = base - layer;
        for i in 0..count {
            let x = (i as f32 - (count - 1) as f32 / 2.0) * 1.02;
            bodies.push(unit_box([x, 0.5 + layer as f32, 0.0]));
        }
    }
    bodies
}

/// Makes fifteen wedges between two abutments.
fn arch() -> Vec<Body> {
    const WEDGES: usize = 15;
    let mut bodies = Vec::from([-4.5, 4.5].map(|x| Body::fixed([1.5, 1.0, 1.5], [x, -1.0, 0.0])));
    for i in 0..WEDGES {
        let mut corners = Vec::new();
        for radius in [4.0, 5.0] {
            for side in [i, i + 1] {
                let (sin, cos) = (PI * side as f64 / WEDGES as f64).sin_cos();
                corners.extend([-0.5, 0.5].map(|z| [radius * cos, radius * sin, z]));
            }
        }
        let (hull, center, _) = centered(&corners);
        bodies.push(Body::new(hull, center));
    }
    bodies
}

fn dominoes(count: usize) -> Vec<Body> {
    const PITCH: f32 = 0.25;
    let middle = count as f32 * PITCH / 2.0;
    let mut bodies = vec![Body::fixed([middle + 10.0, 1.0, 5.0], [middle, -1.0, 0.0])];
    for i in 0..count {
        let form = MadeShape::Box([0.05, 0.25, 0.125]);
        bodies.push(Body::new(form, [i as f32 * PITCH, 0.25, 0.0]));
    }
    let striker = Body::new(MadeShape::Sphere(0.15), [-0.6, 0.35, 0.0]);
    bodies.push(Body { velocity: [2.0, 0.0, 0.0], density: 2000.0, ..striker });
    bodies
}

/// Makes bodies in layers of `side` x `side`, `pitch` apart, above an open container of the same
/// width.
fn pile(
    count: usize,
    side: usize,
    pitch: f32,
    seed: u64,
    make: fn(&mut Random) -> (MadeShape, [f32; 4]),
) -> Vec<Body> {
    let mut random = Random::new(seed);
    let width = side as f32 * pitch;
    let height = count.div_ceil(side * side) as f32 * pitch + 2.0;
    // Half thickness of the floor and the walls. \[m\]
    const T: f32 = 0.5;
    let (out, up, middle) = (width / 2.0 + T, height / 2.0 + T, height / 2.0 - T);
    let mut bodies = vec![
        Body::fixed([out, T, out], [0.0, -T, 0.0]),
        Body::fixed([T, up, out + T], [-out, middle, 0.0]),
        Body::fixed([T, up, out + T], [out, middle, 0.0]),
        Body::fixed([out + T, up, T], [0.0, middle, -out]),
        Body::fixed([out + T, up, T], [0.0, middle, out]),
    ];
    for i in 0..count {
        let (layer, place) = (i / (side * side), i % (side * side));
        let cell = [place / side, layer, place % side];
        let start = [0.5 * pitch - width / 2.0, 0.6 * pitch, 0.5 * pitch - width / 2.0];
        let position: [f32; 3] = std::array::from_fn(|axis| {
            start[axis] + (cell[axis] as f32 + random.within(-0.03, 0.03)) * pitch
        });
        let (form, rotation) = make(&mut random);
        bodies.push(Body { rotation, ..Body::new(form, position) });
    }
    bodies
}

/// Makes disks in rows of `width`, `pitch` apart, above an open container of the same width.
fn disks(count: usize, width: usize, pitch: f32) -> Vec<Body> {
    let mut random = Random::new(4);
    let half = width as f32 * pitch / 2.0;
    let height = (count.div_ceil(width) as f32 * pitch + 2.0) / 2.0;
    let mut bodies = vec![
        Body::fixed([half + 1.0, 0.5, 0.5], [0.0, -0.5, 0.0]),
        Body::fixed([0.5, height, 0.5], [-half - 0.5, height, 0.0]),
        Body::fixed([0.5, height, 0.5], [half + 0.5, height, 0.0]),
    ];
    for i in 0..count {
        let cell = [(i % width) as f32 + 0.5, (i / width) as f32 + 0.6];
        let [x, y] = cell.map(|along| (along + random.within(-0.03, 0.03)) * pitch);
        let (form, _) = sphere(&mut random);
        bodies.push(Body::new(form, [x - half, y, 0.0]));
    }
    bodies
}

fn sphere(random: &mut Random) -> (MadeShape, [f32; 4]) {
    (MadeShape::Sphere(random.within(0.22, 0.28)), [0.0, 0.0, 0.0, 1.0])
}

fn tumbled_box(random: &mut Random) -> (MadeShape, [f32; 4]) {
    let half = std::array::from_fn(|_| random.within(0.18, 0.26));
    (MadeShape::Box(half), random.direction())
}

/// Makes the hull of 12 to 20 points near an ellipsoid of radius 0.3.
fn tumbled_hull(random: &mut Random) -> (MadeShape, [f32; 4]) {
    const RADIUS: f32 = 0.3;
    let least = 0.35 * 4.0 / 3.0 * PI * f64::from(0.8 * RADIUS).powi(3);
    let count = 12 + (random.next() * 9.0) as usize;
    loop {
        let stretch: [f32; 3] = std::array::from_fn(|_| random.within(0.7, 1.0));
        let points: Vec<[f64; 3]> = (0..count)
            .map(|_| {
                let far = RADIUS * random.within(0.9, 1.0);
                let direction: [f32; 3] = random.direction();
                std::array::from_fn(|i| f64::from(far * direction[i] * stretch[i]))
            })
            .collect();
        let (hull, _, volume) = centered(&points);
        if volume > least {
            return (hull, random.direction());
        }
    }
}

/// Makes the hull of points, moved so that its center of mass is its origin. Also returns the
/// original center of mass and the volume.
fn centered(points: &[[f64; 3]]) -> (MadeShape, [f32; 3], f64) {
    let vectors: Vec<_> = points.iter().map(|&p| p.into()).collect();
    let hull = Exact::convex_hull(&vectors).expect("a solid hull");
    let solid = hull.mass_properties(1.0);
    let center = solid.local_com.to_array();
    let around = |p: &[f64; 3]| std::array::from_fn(|i| (p[i] - center[i]) as f32);
    (MadeShape::Hull(points.iter().map(around).collect()), center.map(|x| x as f32), solid.mass())
}

/// Random numbers by xorshift with a multiplied output.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..8).for_each(|_| _ = random.next());
        random
    }

    /// Returns a number from 0 to below 1.
    fn next(&mut self) -> f32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 40;
        bits as f32 / (1u32 << 24) as f32
    }

    fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next()
    }

    /// Returns a uniformly distributed unit vector; with four components it is a random rotation.
    fn direction<const N: usize>(&mut self) -> [f32; N] {
        loop {
            let v: [f32; N] = std::array::from_fn(|_| self.within(-1.0, 1.0));
            let squared: f32 = v.iter().map(|x| x * x).sum();
            if (1e-4..=1.0).contains(&squared) {
                let length = squared.sqrt();
                return v.map(|x| x / length);
            }
        }
    }
}
