//! Random systems of contacts, and quantities that the tests compute from them independently of the
//! crate.
pub(crate) mod counting;

use drystone_solver::{
    ConstraintFrame, Contact, InverseMass, Manifold, SymmetricMatrix, System, Vector, Velocity,
    contact_frame,
};

/// Runs a generic check for particles and for rigid bodies, in two and in three dimensions.
#[macro_export]
macro_rules! in_all_four {
    ($check:ident $(, $argument:expr)*) => {{
        $check::<2, 0>($($argument),*);
        $check::<3, 0>($($argument),*);
        $check::<2, 1>($($argument),*);
        $check::<3, 3>($($argument),*);
    }};
}

/// Asserts that |a - b| is at most `tolerance` times the largest of 1, |a| and |b|.
#[track_caller]
pub(crate) fn assert_close(a: f64, b: f64, tolerance: f64) {
    let scale = 1f64.max(a.abs()).max(b.abs());
    assert!((a - b).abs() <= tolerance * scale, "{a} is not {b}");
}

#[track_caller]
pub(crate) fn assert_all_close(
    a: impl IntoIterator<Item = f64>,
    b: impl IntoIterator<Item = f64>,
    tolerance: f64,
) {
    let (a, b): (Vec<_>, Vec<_>) = (a.into_iter().collect(), b.into_iter().collect());
    assert_eq!(a.len(), b.len());
    let scale = a.iter().chain(&b).fold(1f64, |largest, x| largest.max(x.abs()));
    for (i, (x, y)) in a.iter().zip(&b).enumerate() {
        assert!((x - y).abs() <= tolerance * scale, "entry {i}: {x} is not {y}\n{a:?}\n{b:?}");
    }
}

/// The SplitMix64 generator: its seed determines the system.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    pub(crate) fn vector<const N: usize>(&mut self) -> Vector<f64, N> {
        Vector(std::array::from_fn(|_| self.within(-1.0, 1.0)))
    }

    pub(crate) fn unit<const N: usize>(&mut self) -> Vector<f64, N> {
        loop {
            let v = self.vector::<N>();
            let length = v.length();
            if N == 0 || (0.1..1.0).contains(&length) {
                return v * (1.0 / length);
            }
        }
    }
}

/// A system, with properties of its bodies that only the tests need.
#[derive(Clone)]
pub(crate) struct Scene<const L: usize, const A: usize> {
    pub(crate) system: System<f64, L, A>,
    pub(crate) positions: Vec<Vector<f64, L>>,
    /// Mass of each body; infinite for a wall. \[kg\]
    pub(crate) masses: Vec<f64>,
    pub(crate) inertias: Vec<SymmetricMatrix<f64, A>>,
}

impl<const L: usize, const A: usize> Scene<L, A> {
    pub(crate) fn new() -> Self {
        Self {
            system: System::new(),
            positions: Vec::new(),
            masses: Vec::new(),
            inertias: Vec::new(),
        }
    }

    /// Adds a body at rest with these principal moments of inertia about these axes; returns its
    /// index.
    pub(crate) fn body(
        &mut self,
        position: Vector<f64, L>,
        mass: f64,
        moments: Vector<f64, A>,
        axes: &[Vector<f64, A>; A],
    ) -> u32 {
        let inverse = SymmetricMatrix::diagonal(moments.map(|i| 1.0 / i)).rotated(axes);
        self.positions.push(position);
        self.masses.push(mass);
        self.inertias.push(SymmetricMatrix::diagonal(moments).rotated(axes));
        self.system.add_body(Velocity::ZERO, InverseMass { linear: 1.0 / mass, angular: inverse })
    }

    /// Adds a ball, with a radius of gyration of 1 m, and returns its index.
    pub(crate) fn ball(&mut self, position: Vector<f64, L>, mass: f64) -> u32 {
        let axes = std::array::from_fn(|i| {
            Vector(std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }))
        });
        self.body(position, mass, Vector([mass; A]), &axes)
    }

    /// Adds a fixed body and returns its index.
    pub(crate) fn wall(&mut self) -> u32 {
        self.positions.push(Vector::ZERO);
        self.masses.push(f64::INFINITY);
        self.inertias.push(SymmetricMatrix::ZERO);
        self.system.add_body(Velocity::ZERO, InverseMass::FIXED)
    }

    /// Adds contacts between two bodies at these points, projected onto the tangent plane through
    /// the first point. The normal points from the second body to the first.
    pub(crate) fn touch(
        &mut self,
        bodies: [u32; 2],
        normal: Vector<f64, L>,
        points: &[Vector<f64, L>],
    ) {
        let center = points[0];
        let manifold = Manifold {
            bodies,
            frame: ConstraintFrame {
                axes: contact_frame(normal),
                arms: bodies.map(|body| center - self.positions[body as usize]),
            },
            ..Manifold::default()
        };
        let place = |point: &Vector<f64, L>| {
            let mut place = manifold.frame.to_frame(*point - center);
            place[0] = 0.0;
            place
        };
        let contacts: Vec<_> =
            points.iter().map(|p| Contact { offset: place(p), ..Contact::default() }).collect();
        self.system.add_manifold(manifold, &contacts);
    }

    /// Adds one contact halfway between the bodies, for systems where its position does not matter.
    pub(crate) fn push(&mut self, a: u32, b: u32, normal: Vector<f64, L>) {
        let middle = |x: Vector<f64, L>, y: Vector<f64, L>| (x + y) * 0.5;
        let point = middle(self.positions[a as usize], self.positions[b as usize]);
        self.touch([a, b], normal, &[point]);
    }

    /// Returns the sum of 1/2 m v^2 + 1/2 omega . I omega. \[J\]
    pub(crate) fn kinetic_energy(&self) -> f64 {
        let mut energy = 0.0;
        for (i, v) in self.system.velocities.iter().enumerate() {
            if self.masses[i].is_finite() {
                energy += 0.5 * self.masses[i] * v.linear.dot(v.linear);
                energy += 0.5 * v.angular.dot(self.inertias[i] * v.angular);
            }
        }
        energy
    }

    /// Returns the sum of m v. \[N s\]
    pub(crate) fn momentum(&self) -> Vector<f64, L> {
        let mut sum = Vector::ZERO;
        for (i, v) in self.system.velocities.iter().enumerate() {
            sum += v.linear * self.masses[i];
        }
        sum
    }

    /// Returns the sum of x x m v + I omega, with one component for each plane of rotation.
    /// \[N m s\]
    pub(crate) fn angular_momentum(&self) -> Vec<f64> {
        let planes: &[[usize; 2]] = if L == 2 { &[[0, 1]] } else { &[[1, 2], [2, 0], [0, 1]] };
        let mut sums = vec![0.0; planes.len()];
        for (i, v) in self.system.velocities.iter().enumerate() {
            let (x, p) = (self.positions[i], v.linear * self.masses[i]);
            let own = self.inertias[i] * v.angular;
            for (axis, &[j, k]) in planes.iter().enumerate() {
                sums[axis] += x[j] * p[k] - x[k] * p[j];
                if A > 0 {
                    sums[axis] += own[axis];
                }
            }
        }
        sums
    }
}

/// Parameters of a random system.
#[derive(Clone, Copy)]
pub(crate) struct Recipe {
    pub(crate) bodies: usize,
    pub(crate) manifolds: usize,
    /// Largest number of points in a manifold; the smallest is 1.
    pub(crate) points: usize,
    /// True if some manifolds touch a wall.
    pub(crate) walls: bool,
}

/// Returns a scene of random bodies with contacts at random positions. Normals between particles
/// lie along the line between them. Targets are random; effective masses are those of rigid
/// contacts.
pub(crate) fn random_scene<const L: usize, const A: usize>(
    random: &mut Random,
    recipe: Recipe,
) -> Scene<L, A> {
    let mut scene = Scene::new();
    for _ in 0..recipe.bodies {
        let mass = 2f64.powf(random.within(-2.0, 2.0));
        let moments = Vector(std::array::from_fn(|_| mass * random.within(0.1, 0.9)));
        let axes = contact_frame(random.unit::<A>());
        let body = scene.body(random.vector::<L>() * 2.0, mass, moments, &axes);
        scene.system.velocities[body as usize] =
            Velocity { linear: random.vector(), angular: random.vector() };
    }
    let wall = scene.wall();
    for _ in 0..recipe.manifolds {
        let a = random.below(recipe.bodies) as u32;
        let mut b = (a + 1 + random.below(recipe.bodies - 1) as u32) % recipe.bodies as u32;
        if recipe.walls && random.below(3) == 0 {
            b = wall;
        }
        let apart = scene.positions[a as usize] - scene.positions[b as usize];
        let normal = if A == 0 { apart * (1.0 / apart.length()) } else { random.unit() };
        let middle = (scene.positions[a as usize] + scene.positions[b as usize]) * 0.5;
        let count = if A == 0 { 1 } else { 1 + random.below(recipe.points) };
        let points: Vec<_> = (0..count).map(|_| middle + random.vector()).collect();
        scene.touch([a, b], normal, &points);
        let manifold = scene.system.manifolds.last_mut().unwrap();
        manifold.friction = random.within(0.0, 1.0);
        manifold.restitution = random.within(0.0, 1.0);
    }
    for contact in &mut scene.system.contacts {
        contact.target[0] = random.within(-1.0, 1.0);
    }
    scene.system.prepare(0.0);
    scene
}
