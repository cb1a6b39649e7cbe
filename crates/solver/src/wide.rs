//! Eight manifolds at a time: a [`System`] packed into [`Lanes`], color by color.
//!
//! The kernels are those of [`pgs`](crate::pgs), run on a number that is eight numbers. The velocities of
//! the bodies are gathered once per visit to a block and serve all its points.

use std::array::from_fn;

use crate::color::Coloring;
use crate::lanes::{Lanes, WIDTH, fastest};
use crate::pgs::visit;
use crate::{Contact, InverseMass, Manifold, Real, Repair, System, Vector, Velocity};

/// A system of `f32` contacts, packed.
#[derive(Clone, Debug, Default)]
pub struct Wide<const L: usize, const A: usize> {
    blocks: Vec<Block<L, A>>,
    contacts: Vec<Contact<Lanes, L>>,
    coloring: Coloring,
    /// Manifolds of a color, by number of points.
    sorted: Vec<u32>,
}

/// Up to eight manifolds that move different bodies.
#[derive(Clone, Debug)]
struct Block<const L: usize, const A: usize> {
    /// How many of the lanes are in use.
    lanes: usize,
    /// Which manifold of the system each lane is.
    source: [u32; WIDTH],
    bodies: [[u32; WIDTH]; 2],
    masses: [InverseMass<Lanes, L, A>; 2],
    /// `bodies` of this one mean nothing: each lane has its own.
    manifold: Manifold<Lanes, L>,
}

impl<const L: usize, const A: usize> Wide<L, A> {
    /// An empty one.
    pub fn new() -> Self {
        Self {
            blocks: Vec::new(),
            contacts: Vec::new(),
            coloring: Coloring::default(),
            sorted: Vec::new(),
        }
    }

    /// Takes over the manifolds and contacts of `system`.
    pub fn pack(&mut self, system: &System<f32, L, A>) {
        self.coloring.assign(
            system.velocities.len(),
            system.manifolds.iter().map(|manifold| manifold.bodies),
            |body| system.masses[body as usize] != InverseMass::FIXED,
        );
        self.blocks.clear();
        self.contacts.clear();
        let mut start = 0;
        for &end in &self.coloring.ends {
            self.sorted.clear();
            self.sorted.extend(&self.coloring.order[start as usize..end as usize]);
            // Alike in length, so that few lanes idle; stable, so that the order stays defined.
            self.sorted.sort_by_key(|&index| system.manifolds[index as usize].count);
            for group in self.sorted.chunks(WIDTH) {
                let block = pack_block(system, group, &mut self.contacts);
                self.blocks.push(block);
            }
            start = end;
        }
    }

    /// Gives impulses and targets back to the contacts of `system`.
    pub fn unpack(&self, system: &mut System<f32, L, A>) {
        for block in &self.blocks {
            for lane in 0..block.lanes {
                let points = system.manifolds[block.source[lane] as usize].points();
                let wide = &self.contacts[block.manifold.points()];
                for (contact, wide) in system.contacts[points].iter_mut().zip(wide) {
                    contact.impulse = Vector(from_fn(|i| wide.impulse[i].0[lane]));
                    contact.target = Vector(from_fn(|i| wide.target[i].0[lane]));
                }
            }
        }
    }

    /// Takes over the impulses of collisions from the contacts of `system`.
    pub fn take_impacts(&mut self, system: &System<f32, L, A>) {
        for block in &self.blocks {
            for lane in 0..block.lanes {
                let points = system.manifolds[block.source[lane] as usize].points();
                let wide = &mut self.contacts[block.manifold.points()];
                for (contact, wide) in system.contacts[points].iter().zip(wide) {
                    wide.impact.0[lane] = contact.impact;
                }
            }
        }
    }

    /// [`System::set_targets`] and [`System::apply_impulses`] in one pass.
    pub fn start(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        displacements: &[Velocity<f32, L, A>],
        repair: &Repair<f32>,
    ) {
        let repair = Repair {
            dt: splat(repair.dt),
            rate: splat(repair.rate),
            slop: splat(repair.slop),
            push_speed: splat(repair.push_speed),
            hold: splat(repair.hold),
        };
        fastest(
            #[inline(always)]
            || {
                for block in &self.blocks {
                    let manifold = &block.manifold;
                    let [moved_a, moved_b] = block.gather(displacements);
                    let [mut a, mut b] = block.gather(velocities);
                    for contact in &mut self.contacts[manifold.points()] {
                        contact.set_target(manifold, &moved_a, &moved_b, &repair);
                        let impulse = manifold.to_world(contact.impulse);
                        contact.apply(impulse, &block.masses, &mut a, &mut b);
                    }
                    block.scatter([a, b], velocities);
                }
            },
        );
    }

    /// [`pgs::sweep_normals`](crate::pgs::sweep_normals).
    pub fn sweep_normals(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.visit_all::<false, false>(velocities);
    }

    /// [`pgs::relax`](crate::pgs::relax).
    pub fn relax(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.visit_all::<true, true>(velocities);
    }

    fn visit_all<const RIGID: bool, const FRICTION: bool>(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
    ) {
        fastest(
            #[inline(always)]
            || {
                for block in &self.blocks {
                    let manifold = &block.manifold;
                    let [mut a, mut b] = block.gather(velocities);
                    let points = &mut self.contacts[manifold.points()];
                    let masses = &block.masses;
                    visit::<Lanes, L, A, RIGID, FRICTION>(manifold, points, masses, &mut a, &mut b);
                    block.scatter([a, b], velocities);
                }
            },
        );
    }
}

impl<const L: usize, const A: usize> Block<L, A> {
    #[inline(always)]
    fn gather(&self, from: &[Velocity<f32, L, A>]) -> [Velocity<Lanes, L, A>; 2] {
        self.bodies.map(|bodies| {
            let each = bodies.map(|body| &from[body as usize]);
            Velocity {
                linear: Vector(from_fn(|i| Lanes(each.map(|velocity| velocity.linear[i])))),
                angular: Vector(from_fn(|i| Lanes(each.map(|velocity| velocity.angular[i])))),
            }
        })
    }

    #[inline(always)]
    fn scatter(&self, velocities: [Velocity<Lanes, L, A>; 2], to: &mut [Velocity<f32, L, A>]) {
        for (bodies, velocity) in self.bodies.iter().zip(&velocities) {
            for lane in 0..self.lanes {
                to[bodies[lane] as usize] = Velocity {
                    linear: Vector(from_fn(|i| velocity.linear[i].0[lane])),
                    angular: Vector(from_fn(|i| velocity.angular[i].0[lane])),
                };
            }
        }
    }
}

fn splat(value: f32) -> Lanes {
    Lanes([value; WIDTH])
}

fn pack_block<const L: usize, const A: usize>(
    system: &System<f32, L, A>,
    group: &[u32],
    contacts: &mut Vec<Contact<Lanes, L>>,
) -> Block<L, A> {
    let first = contacts.len();
    let most = group.iter().map(|&index| system.manifolds[index as usize].count).max();
    // What a lane has too few points for stays zero: masses of 0 take no impulse.
    contacts.resize(first + most.unwrap_or(0) as usize, Contact::default());
    // Idle lanes read the bodies of the first, and are not written back.
    let leader = system.manifolds[group[0] as usize].bodies;
    let mut block = Block {
        lanes: group.len(),
        source: [0; WIDTH],
        bodies: leader.map(|body| [body; WIDTH]),
        masses: [InverseMass::default(); 2],
        manifold: Manifold {
            bodies: [0, 0],
            frame: [Vector::ZERO; L],
            friction: Lanes::ZERO,
            restitution: Lanes::ZERO,
            first: first as u32,
            count: most.unwrap_or(0),
        },
    };
    for (lane, &index) in group.iter().enumerate() {
        let manifold = &system.manifolds[index as usize];
        block.source[lane] = index;
        block.manifold.friction.0[lane] = manifold.friction;
        for (wide, axis) in block.manifold.frame.iter_mut().zip(&manifold.frame) {
            set(wide, lane, axis);
        }
        for side in 0..2 {
            let body = manifold.bodies[side];
            let mass = &system.masses[body as usize];
            block.bodies[side][lane] = body;
            block.masses[side].linear.0[lane] = mass.linear;
            for (wide, row) in block.masses[side].angular.0.iter_mut().zip(&mass.angular.0) {
                set(wide, lane, row);
            }
        }
        for (wide, contact) in
            contacts[first..].iter_mut().zip(&system.contacts[manifold.points()])
        {
            set(&mut wide.anchor_a, lane, &contact.anchor_a);
            set(&mut wide.anchor_b, lane, &contact.anchor_b);
            set(&mut wide.gap, lane, &contact.gap);
            set(&mut wide.impulse, lane, &contact.impulse);
            wide.effective_mass.0[lane] = contact.effective_mass;
            wide.tangential_mass.0[lane] = contact.tangential_mass;
            wide.compliance.0[lane] = contact.compliance;
        }
    }
    block
}

fn set<const N: usize>(wide: &mut Vector<Lanes, N>, lane: usize, of: &Vector<f32, N>) {
    for i in 0..N {
        wide[i].0[lane] = of[i];
    }
}
