//! Random scenes of rigid bodies, worlds made of them, and their energy.
//!
//! A scene depends on its seed and dimension only. No two of its bodies overlap at the start.

use super::{Random, Rigid};
use drystone::Dimension;
use drystone::geometry::{Bounds, MassProperties, Rigid2, Rigid3};
use drystone::{Body, BodyId, Collider, Inertia, StepSettings, World};
use drystone_bake::convert::{material, motion};
use drystone_scene::{BodiesAs, Filter, Material, Motion, Rotation, Scene, Shape, ShapeKind};
use drystone_solver::{SymmetricMatrix, Vector, Velocity};

/// Returns the number in an environment variable, or `default`.
pub(crate) fn variable(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// A random scene with its preset and number of steps.
#[derive(Clone)]
pub(crate) struct Trial {
    pub(crate) seed: u64,
    pub(crate) scene: Scene,
    /// Name of the preset.
    pub(crate) preset: &'static str,
    pub(crate) steps: u32,
    /// Half of the inner size of a closed container around the origin. \[m\]
    pub(crate) container: Option<Vec<f64>>,
    /// True if a body of infinite mass moves, which may do any work.
    pub(crate) driven: bool,
    /// Largest extent of a body. \[m\]
    pub(crate) size: f64,
}

impl Trial {
    pub(crate) fn settings(&self) -> StepSettings {
        match self.preset {
            "certified" => StepSettings::certified(),
            "quality" => StepSettings::quality(),
            _ => StepSettings::realtime(),
        }
    }

    pub(crate) fn describe(&self) -> String {
        let Self { seed, scene, preset, steps, size, .. } = self;
        let (bodies, dimension) = (scene.bodies.len(), scene.dimension);
        let rate = 1.0 / scene.time_step;
        let forms: Vec<String> = scene.bodies.iter().map(describe_body).collect();
        format!(
            "seed {seed}, {dimension}D, {bodies} bodies of up to {size:.3e} m, {preset}, \
             {steps} steps at {rate:.0} 1/s, gravity {:?}: {}",
            scene.gravity,
            forms.join(", ")
        )
    }
}

/// The features of a trial that make it hard.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hardness {
    /// Smallest extent of any shape of a dynamic body. \[m\]
    pub(crate) thinnest: f64,
    /// Largest distance that a surface moves in the first step, over the smallest extent. \[1\]
    pub(crate) travel: f64,
    /// Largest over smallest density. \[1\]
    pub(crate) densities: f64,
    /// Largest ratio of the longest to the shortest extent of a shape. \[1\]
    pub(crate) aspect: f64,
}

impl Hardness {
    pub(crate) fn new(trial: &Trial) -> Self {
        let (mut thinnest, mut speed, mut aspect) = (f64::INFINITY, 0.0f64, 1.0f64);
        let (mut lightest, mut heaviest) = (f64::INFINITY, 0.0f64);
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        for body in trial.scene.bodies.iter().filter(|body| body.motion == Motion::Dynamic) {
            let mut reach = 0.0f64;
            for shape in &body.shapes {
                let [short, long] = extents(&shape.kind);
                thinnest = thinnest.min(short);
                aspect = aspect.max(long / short);
                reach = reach.max(norm(&shape.position) + 0.5 * long);
            }
            let own = norm(&body.linear_velocity) + norm(&body.angular_velocity) * reach;
            speed = speed.max(own);
            if let Some(density) = body.mass.density {
                (lightest, heaviest) = (lightest.min(density), heaviest.max(density));
            }
        }
        let travel = speed * trial.scene.time_step / thinnest;
        Self { thinnest, travel, densities: (heaviest / lightest).max(1.0), aspect }
    }
}

/// Returns the shortest and the longest extent of a shape along its axes. \[m\]
fn extents(kind: &ShapeKind) -> [f64; 2] {
    let of = |half: &[f64]| {
        let least = half.iter().copied().fold(f64::INFINITY, f64::min);
        [2.0 * least, 2.0 * half.iter().copied().fold(0.0, f64::max)]
    };
    match kind {
        ShapeKind::Sphere { radius } => of(&[*radius]),
        ShapeKind::Box { half_extents } => of(half_extents),
        ShapeKind::Capsule { radius, half_height } => of(&[*radius, radius + half_height]),
        ShapeKind::Cylinder { radius, half_height } => of(&[*radius, *half_height]),
        ShapeKind::ConvexHull { points } => {
            let half = |axis: usize| {
                let along = points.iter().map(|point| point[axis]);
                let [low, high] = along
                    .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
                        [low.min(x), high.max(x)]
                    });
                0.5 * (high - low)
            };
            of(&(0..points[0].len()).map(half).collect::<Vec<_>>())
        }
        ShapeKind::Halfspace { .. } | ShapeKind::Trimesh { .. } => [f64::INFINITY; 2],
    }
}

fn describe_body(body: &drystone_scene::Body) -> String {
    let kind = |shape: &Shape| match &shape.kind {
        ShapeKind::Sphere { .. } => "sphere",
        ShapeKind::Box { .. } => "box",
        ShapeKind::Capsule { .. } => "capsule",
        ShapeKind::Cylinder { .. } => "cylinder",
        ShapeKind::ConvexHull { .. } => "hull",
        ShapeKind::Halfspace { .. } => "half-space",
        ShapeKind::Trimesh { .. } => "mesh",
    };
    let kinds: Vec<&str> = body.shapes.iter().map(kind).collect();
    let fixed = if body.motion == Motion::Dynamic { "" } else { "static " };
    format!("{fixed}{}", kinds.join("+"))
}

/// Geometry of rigid bodies whose shapes come from scenes.
pub(crate) trait Forms<const L: usize, const A: usize>: Rigid<L, A> {
    /// Builds a hull or a shape that only this dimension has.
    fn special(kind: &ShapeKind) -> Option<Self::Shape>;

    /// Builds a shape, or returns None if its points enclose nothing.
    fn form(kind: &ShapeKind) -> Option<Self::Shape> {
        Some(match kind {
            ShapeKind::Sphere { radius } => Self::ball(*radius as f32),
            ShapeKind::Box { half_extents } => Self::cuboid(floats(half_extents)),
            ShapeKind::Capsule { radius, half_height } => {
                Self::capsule(*half_height as f32, *radius as f32)
            }
            ShapeKind::Halfspace { normal } => Self::halfspace(floats(normal)),
            other => return Self::special(other),
        })
    }
}

impl Forms<2, 1> for Rigid2 {
    fn special(kind: &ShapeKind) -> Option<Self::Shape> {
        let ShapeKind::ConvexHull { points } = kind else { return None };
        let points: Vec<_> = points.iter().map(|p| floats::<2>(p).into()).collect();
        parry2d::shape::SharedShape::convex_hull(&points)
    }
}

impl Forms<3, 3> for Rigid3 {
    fn special(kind: &ShapeKind) -> Option<Self::Shape> {
        use parry3d::shape::SharedShape;
        match kind {
            ShapeKind::ConvexHull { points } => {
                let points: Vec<_> = points.iter().map(|p| floats::<3>(p).into()).collect();
                SharedShape::convex_hull(&points)
            }
            ShapeKind::Cylinder { radius, half_height } => {
                Some(SharedShape::cylinder(*half_height as f32, *radius as f32))
            }
            ShapeKind::Trimesh { vertices, triangles, .. } => {
                let vertices: Vec<_> = vertices.iter().map(|p| floats::<3>(p)).collect();
                Some(<Rigid3 as Rigid<3, 3>>::mesh(&vertices, triangles))
            }
            _ => None,
        }
    }
}

pub(crate) fn floats<const L: usize>(of: &[f64]) -> [f32; L] {
    std::array::from_fn(|i| of.get(i).copied().unwrap_or(0.0) as f32)
}

fn pose<G: Dimension<L, A>, const L: usize, const A: usize>(
    position: &[f64],
    rotation: &Rotation,
) -> G::Pose {
    match rotation {
        Rotation::Angle(angle) => G::pose(Vector(floats(position)), &[*angle as f32]),
        Rotation::Quaternion(q) => G::pose(Vector(floats(position)), &q.map(|x| x as f32)),
    }
}

/// Returns mass, center and moments of a body as its scene states them.
pub(crate) fn inertia<G: Forms<L, A>, const L: usize, const A: usize>(
    body: &drystone_scene::Body,
) -> Option<Inertia<L, A>> {
    let density = body.mass.density.unwrap_or(1000.0) as f32;
    let mut solid = MassProperties::ZERO;
    for shape in &body.shapes {
        let own = G::mass(&G::form(&shape.kind)?, density);
        solid = solid
            .joined(&own.placed(&G::frame(&pose::<G, L, A>(&shape.position, &shape.rotation))));
    }
    let mut inertia = Inertia::of(&solid);
    if body.mass.mass.is_some_and(f64::is_infinite) {
        inertia = Inertia { center: solid.center, ..Inertia::FIXED };
    }
    if let Some(moments) = &body.mass.inertia {
        let moment = |i: usize| moments.get(i).copied().unwrap_or(0.0) as f32;
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        let diagonal =
            |f: &dyn Fn(usize) -> f32| SymmetricMatrix::diagonal(Vector(std::array::from_fn(f)));
        inertia.moments = diagonal(&|i| finite(moment(i)));
        inertia.inverse_moments = diagonal(&|i| 1.0 / moment(i));
    }
    Some(inertia)
}

/// Returns the body of a world that a scene describes, or None if a shape encloses nothing.
pub(crate) fn body_of<G: Forms<L, A>, const L: usize, const A: usize>(
    body: &drystone_scene::Body,
) -> Option<Body<G, L, A>> {
    let mut colliders = Vec::new();
    for shape in &body.shapes {
        colliders.push(Collider {
            pose: pose::<G, L, A>(&shape.position, &shape.rotation),
            material: material(&shape.material),
            ..Collider::new(G::form(&shape.kind)?)
        });
    }
    let inertia = match body.motion {
        Motion::Dynamic => Some(inertia::<G, L, A>(body)?),
        _ => None,
    };
    Some(Body {
        motion: motion(body.motion),
        pose: pose::<G, L, A>(&body.position, &body.rotation),
        velocity: Velocity {
            linear: Vector(floats(&body.linear_velocity)),
            angular: Vector(floats(&body.angular_velocity)),
        },
        inertia,
        gravity_factor: body.gravity_factor as f32,
        damping: [0.0; 2],
        surface_velocity: None,
        colliders,
        user_data: 0,
    })
}

/// A world with the masses and gravity factors on which its energy depends.
pub(crate) struct Running<G: Dimension<L, A>, const L: usize, const A: usize> {
    pub(crate) world: World<G, L, A>,
    pub(crate) ids: Vec<BodyId>,
    /// Inertia of each body; None for static and kinematic bodies.
    pub(crate) inertia: Vec<Option<Inertia<L, A>>>,
    gravity_factor: Vec<f64>,
}

/// Energy of a world. \[J\]
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Energy {
    pub(crate) kinetic: f64,
    pub(crate) potential: f64,
    /// 1/2 M (1 m/s)^2, with M the mass of all bodies that gravity and contacts move.
    pub(crate) unit: f64,
}

impl<G: Forms<L, A>, const L: usize, const A: usize> Running<G, L, A> {
    /// Builds a world, or returns None if a shape encloses nothing.
    pub(crate) fn new(scene: &Scene, settings: StepSettings) -> Option<Self> {
        let mut world = World::new(settings);
        world.gravity = Vector(floats(&scene.gravity));
        let (mut ids, mut inertia, mut gravity_factor) = (vec![], vec![], vec![]);
        for own in &scene.bodies {
            let body = body_of::<G, L, A>(own)?;
            inertia.push(body.inertia);
            gravity_factor.push(own.gravity_factor);
            ids.push(world.add(body).unwrap());
        }
        Some(Self { world, ids, inertia, gravity_factor })
    }

    /// Returns the center of mass of a body. \[m\]
    pub(crate) fn center(&self, index: usize) -> Vector<f32, L> {
        let frame = G::frame(&self.world.pose(self.ids[index]).unwrap());
        frame.point(self.inertia[index].map_or(Vector::ZERO, |inertia| inertia.center))
    }

    /// Computes the energy from masses, moments, poses and velocities in double precision. Infinite
    /// masses add nothing.
    pub(crate) fn energy(&self) -> Energy {
        let mut energy = Energy::default();
        for (index, inertia) in self.inertia.iter().enumerate() {
            let Some(inertia) = inertia else { continue };
            let frame = G::frame(&self.world.pose(self.ids[index]).unwrap());
            let velocity = self.world.velocity(self.ids[index]).unwrap();
            for i in 0..A {
                // Local components of the angular velocity.
                let local = |k: usize| -> f64 {
                    if A == 1 {
                        return f64::from(velocity.angular[0]);
                    }
                    (0..L)
                        .map(|j| f64::from(frame.axes[k][j]) * f64::from(velocity.angular[j]))
                        .sum()
                };
                for j in 0..A {
                    let moment = f64::from(inertia.moments.0[i][j]);
                    energy.kinetic += 0.5 * moment * local(i) * local(j);
                }
            }
            if !inertia.mass.is_finite() {
                continue;
            }
            let mass = f64::from(inertia.mass);
            let center = self.center(index);
            for i in 0..L {
                let pull = f64::from(self.world.gravity[i]) * self.gravity_factor[index];
                energy.kinetic += 0.5 * mass * f64::from(velocity.linear[i]).powi(2);
                energy.potential -= mass * pull * f64::from(center[i]);
            }
            energy.unit += 0.5 * mass;
        }
        energy
    }

    /// Returns whether all poses and velocities are finite.
    pub(crate) fn finite(&self) -> bool {
        let mut numbers = Vec::new();
        self.world.write_poses(&mut numbers);
        for velocity in self.world.velocities() {
            numbers.extend(velocity.linear.0.iter().chain(&velocity.angular.0));
        }
        numbers.iter().all(|x| x.is_finite())
    }
}

impl Random {
    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.between(0.0, count as f32) as usize).min(count - 1)
    }

    /// Returns true with this probability.
    pub(crate) fn chance(&mut self, part: f32) -> bool {
        self.between(0.0, 1.0) < part
    }

    /// Returns a number between two positive ones, uniform in the logarithm.
    pub(crate) fn scale(&mut self, low: f32, high: f32) -> f32 {
        self.between(low.ln(), high.ln()).exp()
    }

    pub(crate) fn rotation(&mut self, dimension: usize) -> Rotation {
        if dimension == 3 {
            Rotation::Quaternion(self.quaternion().map(f64::from))
        } else {
            Rotation::Angle(f64::from(self.between(-3.0, 3.0)))
        }
    }

    /// Returns a random direction times a length.
    pub(crate) fn arrow(&mut self, dimension: usize, length: f32) -> Vec<f64> {
        let arrow: Vec<f64> = (0..dimension).map(|_| f64::from(self.between(-1.0, 1.0))).collect();
        let norm = arrow.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm < 0.1 {
            return self.arrow(dimension, length);
        }
        arrow.iter().map(|x| x / norm * f64::from(length)).collect()
    }
}

pub(crate) fn shape(kind: ShapeKind, dimension: usize) -> Shape {
    Shape {
        kind,
        position: vec![0.0; dimension],
        rotation: Rotation::identity(dimension),
        material: Material::default(),
        surface_velocity: None,
        filter: Filter::default(),
    }
}

pub(crate) fn body(motion: Motion, shapes: Vec<Shape>, dimension: usize) -> drystone_scene::Body {
    drystone_scene::Body {
        name: None,
        motion,
        position: vec![0.0; dimension],
        rotation: Rotation::identity(dimension),
        linear_velocity: vec![0.0; dimension],
        angular_velocity: vec![0.0; if dimension == 3 { 3 } else { 1 }],
        mass: drystone_scene::Mass::default(),
        gravity_factor: 1.0,
        linear_damping: 0.0,
        angular_damping: 0.0,
        force: vec![0.0; dimension],
        start_asleep: false,
        surface_velocity: None,
        shapes,
        track: drystone_scene::Track::default(),
    }
}

/// Smallest extent of a body. \[m\]
const THINNEST: f32 = 1e-3;

/// Returns a convex shape whose longest extent is `size` \[m\], up to `aspect` times its shortest.
fn convex(random: &mut Random, dimension: usize, size: f32, aspect: f32) -> ShapeKind {
    let half = 0.5 * size;
    let thin =
        |random: &mut Random| (half / random.scale(1.0, aspect)).max(0.5 * THINNEST).min(half);
    match random.below(if dimension == 3 { 6 } else { 4 }) {
        0 => ShapeKind::Sphere { radius: f64::from(half) },
        1 => {
            let mut half_extents = vec![f64::from(half)];
            half_extents.extend((1..dimension).map(|_| f64::from(thin(random))));
            let turns = random.below(dimension);
            half_extents.rotate_right(turns);
            ShapeKind::Box { half_extents }
        }
        2 => {
            let radius = thin(random).min(0.95 * half);
            ShapeKind::Capsule { radius: radius.into(), half_height: (half - radius).into() }
        }
        3 => {
            let mut extents = vec![half];
            extents.extend((1..dimension).map(|_| thin(random)));
            let count = 4 + random.below(17);
            let point = |random: &mut Random| {
                let at = random.arrow(dimension, 1.0);
                at.iter().zip(&extents).map(|(x, half)| x * f64::from(*half)).collect()
            };
            ShapeKind::ConvexHull { points: (0..count).map(|_| point(random)).collect() }
        }
        4 => {
            let other = thin(random);
            let [radius, half_height] =
                if random.chance(0.5) { [half, other] } else { [other, half] };
            ShapeKind::Cylinder { radius: radius.into(), half_height: half_height.into() }
        }
        _ => {
            let other = thin(random);
            let [radius, height] = if random.chance(0.5) { [half, other] } else { [other, half] };
            let sides = 3 + random.below(22);
            let mut points = vec![vec![0.0, f64::from(height), 0.0]];
            for side in 0..sides {
                let angle = side as f64 / sides as f64 * std::f64::consts::TAU;
                let (sin, cos) = angle.sin_cos();
                let radius = f64::from(radius);
                points.push(vec![radius * cos, -f64::from(height), radius * sin]);
            }
            ShapeKind::ConvexHull { points }
        }
    }
}

/// Returns a box around all shapes of a body, or None if one of them encloses nothing.
fn bounds<G: Forms<L, A>, const L: usize, const A: usize>(
    body: &drystone_scene::Body,
) -> Option<Bounds<L>> {
    let place = pose::<G, L, A>(&body.position, &body.rotation);
    let mut all = Bounds::EMPTY;
    for shape in &body.shapes {
        let own = pose::<G, L, A>(&shape.position, &shape.rotation);
        all = all.joined(&G::bounds(&G::form(&shape.kind)?, &G::compose(&place, &own)));
    }
    Some(all)
}

/// Ranges that the bodies of a scene share.
struct Range {
    size: f32,
    aspect: f32,
    speed: f32,
    spin: f32,
    density: [f32; 2],
    restitution: [f32; 2],
    upright: f32,
    gap: f32,
}

impl Range {
    fn new(random: &mut Random) -> Self {
        let densities = [[1e3, 1e3], [3e2, 3e3], [1.0, 1e6]];
        let restitutions = [[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]];
        Self {
            size: random.scale(1e-3, 100.0).max(2e-3),
            aspect: [1.5, 3.0, 10.0, 30.0, 1e3][random.below(5)],
            speed: if random.chance(0.4) { 0.0 } else { random.scale(0.01, 20.0) },
            spin: if random.chance(0.5) { 0.0 } else { random.scale(0.1, 200.0) },
            density: densities[random.below(3)],
            restitution: restitutions[random.below(5)],
            upright: [0.0, 0.5, 1.0][random.below(3)],
            gap: [1e-5, 0.02, 0.3][random.below(3)],
        }
    }

    fn material(&self, random: &mut Random) -> Material {
        let friction = match random.below(5) {
            0 => 0.0,
            1 => random.between(1.0, 3.0),
            _ => random.between(0.0, 1.0),
        };
        let [low, high] = self.restitution;
        let restitution = f64::from(random.between(low, high));
        Material { friction: friction.into(), restitution, ..Material::default() }
    }

    /// Returns a random body at the origin.
    fn body(&self, random: &mut Random, dimension: usize) -> drystone_scene::Body {
        let size = (self.size * random.scale(0.1, 1.0)).max(THINNEST);
        let parts = if random.chance(0.15) { 2 + random.below(2) } else { 1 };
        let material = self.material(random);
        let mut shapes = Vec::new();
        for _ in 0..parts {
            let mut own = shape(convex(random, dimension, size, self.aspect), dimension);
            if parts > 1 {
                own.position = random.arrow(dimension, 0.4 * size);
                own.rotation = random.rotation(dimension);
            }
            own.material = material.clone();
            shapes.push(own);
        }
        let mut body = body(Motion::Dynamic, shapes, dimension);
        body.mass.density = Some(random.scale(self.density[0], self.density[1] * 1.0001).into());
        if !random.chance(self.upright) {
            body.rotation = random.rotation(dimension);
        }
        let speed = self.speed * random.between(0.0, 1.0);
        body.linear_velocity = random.arrow(dimension, speed);
        // The surface moves at 100 m/s at most.
        let spin = (self.spin * random.between(0.0, 1.0)).min(200.0 / size);
        body.angular_velocity = random.arrow(body.angular_velocity.len(), spin);
        body
    }
}

fn middle<const L: usize>(bounds: &Bounds<L>) -> Vector<f32, L> {
    (bounds.min + bounds.max) * 0.5
}

/// Returns bodies side by side and on top of each other whose boxes do not overlap, and the box
/// around all.
fn cluster<G: Forms<L, A>, const L: usize, const A: usize>(
    random: &mut Random,
    range: &Range,
    count: usize,
) -> (Vec<drystone_scene::Body>, Bounds<L>) {
    let mut bodies: Vec<drystone_scene::Body> = Vec::new();
    let mut boxes: Vec<Bounds<L>> = Vec::new();
    for _ in 0..20 * count {
        if bodies.len() == count {
            break;
        }
        let mut body = range.body(random, L);
        let Some(own) = bounds::<G, L, A>(&body) else { continue };
        if inertia::<G, L, A>(&body)
            .is_none_or(|inertia| inertia.mass.is_nan() || inertia.mass <= 0.0)
        {
            continue;
        }
        let mut by = Vector::ZERO;
        if !boxes.is_empty() {
            let other = boxes[random.below(boxes.len())];
            let axis = random.below(L);
            by = middle(&other) - middle(&own);
            for i in 0..L {
                let extent = own.max[i] - own.min[i] + other.max[i] - other.min[i];
                if i == axis {
                    let sign = if random.chance(0.5) { 1.0 } else { -1.0 };
                    let gap = range.size * range.gap * random.between(0.1, 1.0);
                    by[i] += sign * (0.5 * extent + gap);
                } else {
                    by[i] += random.between(-0.3, 0.3) * extent;
                }
            }
        }
        let own = Bounds { min: own.min + by, max: own.max + by };
        if boxes.iter().any(|other| other.overlaps(&own)) {
            continue;
        }
        body.position = by.0.iter().map(|x| f64::from(*x)).collect();
        bodies.push(body);
        boxes.push(own);
    }
    let all = boxes.iter().fold(Bounds::EMPTY, |all, own| all.joined(own));
    (bodies, all)
}

/// Returns a grid of triangles around the origin, flat or with bumps up to y = 0.
fn terrain(random: &mut Random, size: f32, bump: f32) -> ShapeKind {
    let n = 2 + random.below(10) as u32;
    let at = |i: u32| f64::from((i as f32 / n as f32 - 0.5) * size);
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            vertices.push([at(i), -f64::from(random.between(0.0, 1.0) * bump), at(j)]);
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
    ShapeKind::Trimesh { vertices, triangles, decomposition: None, vertex_track: None }
}

/// Static shapes around the bodies of a trial: nothing, a floor, a terrain or a container.
struct Surroundings {
    statics: Vec<drystone_scene::Body>,
    /// Half of the inner size of the container, if it is one. \[m\]
    container: Option<Vec<f64>>,
}

impl Surroundings {
    /// Puts something random below or around a box of this half size \[m\].
    fn new(random: &mut Random, range: &Range, half: &[f32]) -> Self {
        let dimension = half.len();
        let largest = half.iter().copied().fold(0.0, f32::max);
        let gap = range.size * range.gap.max(1e-4);
        let ground_material = range.material(random);
        let wall = |kind: ShapeKind, position: Vec<f64>| {
            let mut own = shape(kind, dimension);
            own.material = ground_material.clone();
            let mut wall = body(Motion::Static, vec![own], dimension);
            wall.position = position;
            wall
        };
        let below = |depth: f32| {
            let mut place = vec![0.0; dimension];
            place[1] = -f64::from(half[1] + gap + depth);
            place
        };
        let width = 4.0 * largest + 2.0 * range.size;
        let floor = match random.below(10) {
            0 | 1 => return Self { statics: Vec::new(), container: None },
            2 | 3 => {
                let mut normal = vec![0.0; dimension];
                normal[1] = 1.0;
                wall(ShapeKind::Halfspace { normal }, below(0.0))
            }
            4 | 5 => {
                let mut half_extents = vec![f64::from(width); dimension];
                half_extents[1] = f64::from(0.5 * width);
                wall(ShapeKind::Box { half_extents }, below(0.5 * width))
            }
            6 | 7 if dimension == 3 => {
                let bump = if random.chance(0.3) { 0.2 * range.size } else { 0.0 };
                wall(terrain(random, 2.0 * width, bump), below(0.0))
            }
            _ => {
                let inner: Vec<f32> = half.iter().map(|half| half + gap).collect();
                return Self {
                    statics: container(&inner, largest, wall),
                    container: Some(inner.into_iter().map(f64::from).collect()),
                };
            }
        };
        Self { statics: vec![floor], container: None }
    }
}

/// Returns the walls of a container of this inner half size. `thick` is half their thickness. \[m\]
fn container(
    inner: &[f32],
    thick: f32,
    wall: impl Fn(ShapeKind, Vec<f64>) -> drystone_scene::Body,
) -> Vec<drystone_scene::Body> {
    let sides = (0..inner.len()).flat_map(|axis| [-1.0, 1.0].map(|sign| (axis, sign)));
    let walls = sides.map(|(axis, sign)| {
        let mut half_extents: Vec<f64> =
            inner.iter().map(|half| f64::from(half + 2.0 * thick)).collect();
        half_extents[axis] = f64::from(thick);
        let mut place = vec![0.0; inner.len()];
        place[axis] = sign * f64::from(inner[axis] + thick);
        wall(ShapeKind::Box { half_extents }, place)
    });
    walls.collect()
}

/// Gives one body an infinite mass or infinite moments, if it is dynamic. Returns true if it moves
/// all the same, or None if its shapes have no inertia.
fn drive<G: Forms<L, A>, const L: usize, const A: usize>(
    random: &mut Random,
    bodies: &mut [drystone_scene::Body],
) -> Option<bool> {
    let index = random.below(bodies.len());
    let body = &mut bodies[index];
    if body.motion != Motion::Dynamic {
        return Some(false);
    }
    let own = inertia::<G, L, A>(body)?;
    let moments = |infinite: usize| {
        let moment =
            |i: usize| if i == infinite { f64::INFINITY } else { f64::from(own.moments.0[i][i]) };
        Some((0..A).map(moment).collect())
    };
    match random.below(3) {
        0 => body.mass.mass = Some(f64::INFINITY),
        1 => {
            body.mass.mass = Some(f64::INFINITY);
            body.mass.inertia = moments(A);
        }
        _ => body.mass.inertia = moments(random.below(A)),
    }
    if body.mass.mass.is_some() {
        body.mass.density = None;
        body.gravity_factor = 0.0;
    }
    let driven = random.chance(0.5);
    if !driven {
        body.linear_velocity.fill(0.0);
        body.angular_velocity.fill(0.0);
    }
    Some(driven)
}

/// Returns the trial of a seed, or None if no body could be placed.
pub(crate) fn trial<G: Forms<L, A>, const L: usize, const A: usize>(seed: u64) -> Option<Trial> {
    let random = &mut Random(seed.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(L as u64));
    let range = Range::new(random);
    let count = random.scale(1.0, 31.0) as usize;
    let (mut bodies, all) = cluster::<G, L, A>(random, &range, count);
    if bodies.is_empty() {
        return None;
    }
    let center = middle(&all);
    for body in &mut bodies {
        for i in 0..L {
            body.position[i] -= f64::from(center[i]);
        }
    }
    let half: Vec<f32> = (0..L).map(|i| 0.5 * (all.max[i] - all.min[i])).collect();
    let Surroundings { mut statics, container } = Surroundings::new(random, &range, &half);
    if random.chance(0.2) && bodies.len() > 1 {
        let index = random.below(bodies.len());
        bodies[index].motion = Motion::Static;
        bodies[index].linear_velocity.fill(0.0);
        bodies[index].angular_velocity.fill(0.0);
    }
    let driven = random.chance(0.08) && drive::<G, L, A>(random, &mut bodies)?;
    statics.extend(bodies);
    let mut gravity = vec![0.0; L];
    if random.chance(0.75) {
        gravity[1] = -9.81;
        if random.chance(0.3) {
            gravity[0] = f64::from(random.between(-5.0, 5.0));
        }
    }
    let count = statics.len() as u32;
    let scene = Scene {
        name: None,
        dimension: L,
        gravity,
        track: drystone_scene::WorldTrack::default(),
        time_step: 1.0 / [24.0, 30.0, 60.0, 120.0, 240.0][random.below(5)],
        steps: None,
        bodies_as: BodiesAs::Rigid,
        joints: Vec::new(),
        bodies: statics,
        solver: serde_json::Map::new(),
    };
    let preset = ["certified", "quality", "realtime"][random.below(3)];
    let steps = (600 / count).clamp(24, 60);
    let size = f64::from(range.size);
    Some(Trial { seed, scene, preset, steps, container, driven, size })
}
