//! [`SurfaceStates`]: surface velocities (belts) and rolling resistance, from the colliders of a
//! pair to its manifolds.
//!
//! In a scene without either, the table is empty and costs nothing.

use drystone_solver::lanes::LaneSystem;
use drystone_solver::{ConstraintFrame, Manifold, SurfaceEffects, Vector, Velocity};

use crate::bodies::Bodies;
use crate::cache::Pair;
use crate::carriers::Carriers;
use crate::colliders::Colliders;
use crate::geometry::Geometry;

/// Surface effects of the manifolds of a contact search, and the torques that pairs pass on to the
/// next search.
#[derive(Default)]
pub(crate) struct SurfaceStates<const L: usize, const A: usize> {
    /// By manifold; empty if no surface moves or resists.
    rows: Vec<SurfaceRow<L, A>>,
    /// Angular impulses of the pairs with resistance, in the order of pairs. World axes. \[N m s\]
    pub(crate) held: Vec<HeldTorque<A>>,
    before: Vec<HeldTorque<A>>,
    /// Surface effects after solving, if a ledger needs them.
    pub(crate) done: Vec<SurfaceEffects<f32, L, A>>,
}

/// Returns the belt velocity at the position of the manifold after half of `dt`. That of the start
/// would throw bodies on a turntable outward.
fn belt<const L: usize, const A: usize>(
    manifold: &Manifold<f32, L>,
    belts: [&Velocity<f32, L, A>; 2],
    velocities: &[Velocity<f32, L, A>],
    dt: f32,
) -> Velocity<f32, L, A> {
    let [a, b] = manifold.bodies.map(|body| velocities[body as usize].linear);
    let ConstraintFrame { axes, arms: [arm_a, arm_b] } = manifold.frame;
    let ahead = (b - a) * (0.5 * dt);
    let frame = ConstraintFrame { axes, arms: [arm_a + ahead, arm_b - ahead] };
    SurfaceEffects::belt(&frame, belts)
}

/// Torque of a pair that is passed on to the next search.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeldTorque<const A: usize> {
    pub(crate) colliders: [u32; 2],
    pub(crate) torque: Vector<f32, A>,
}

/// Surfaces of a manifold.
#[derive(Clone, Copy)]
struct SurfaceRow<const L: usize, const A: usize> {
    /// Surface velocities of a and b, each given at the center of mass of its body. World axes.
    /// \[m/s, rad/s\]
    belts: [Velocity<f32, L, A>; 2],
    runs: bool,
    /// Rolling and spinning resistance. \[m\]
    resistance: [f32; 2],
    /// Accumulated angular impulse, world axes. \[N m s\]
    torque: Vector<f32, A>,
}

impl<const L: usize, const A: usize> SurfaceRow<L, A> {
    const NONE: Self = Self {
        belts: [Velocity::ZERO; 2],
        runs: false,
        resistance: [0.0; 2],
        torque: Vector::ZERO,
    };
}

impl<const L: usize, const A: usize> SurfaceStates<L, A> {
    /// True if a surface of the manifold has a velocity relative to its body.
    pub(crate) fn runs(&self, manifold: usize) -> bool {
        self.rows.get(manifold).is_some_and(|row| row.runs)
    }

    /// Sets the surface effects of the manifolds in the lanes, for bodies with these velocities
    /// that move for `dt` \[s\].
    pub(crate) fn give<G: Geometry<L, A>>(
        &mut self,
        (colliders, bodies, carriers): (&Colliders<G, L, A>, &Bodies<G, L, A>, &Carriers<L, A>),
        pairs: &[Pair],
        manifolds: usize,
        (velocities, dt): (&[Velocity<f32, L, A>], f32),
        lanes: &mut LaneSystem<L, A>,
    ) {
        self.rows.clear();
        self.done.clear();
        if !colliders.has_surfaces() {
            self.held.clear();
            lanes.take_surfaces(None::<fn(usize, &Manifold<f32, L>) -> SurfaceEffects<f32, L, A>>);
            return;
        }
        self.rows.resize(manifolds, SurfaceRow::NONE);
        let mut held = self.held.iter().peekable();
        for pair in pairs.iter().filter(|pair| !pair.is_sleeping && pair.count > 0) {
            while held.next_if(|of| of.colliders < pair.colliders).is_some() {}
            let belts = pair.colliders.map(|id| colliders.belt(bodies, id as usize));
            let resistance = colliders.resistance(pair.colliders);
            let runs = belts.iter().any(|belt| *belt != Velocity::ZERO);
            if !runs && resistance == [0.0; 2] {
                continue;
            }
            let torque = held.next_if(|of| of.colliders == pair.colliders);
            let torque = torque.map_or(Vector::ZERO, |of| of.torque * (1.0 / pair.count as f32));
            self.rows[pair.manifolds()].fill(SurfaceRow { belts, runs, resistance, torque });
        }
        for carrier in &carriers.own {
            // It is given at the center of mass of the body, and needed at that of the carrier.
            let belt = &mut self.rows[carrier.manifold as usize].belts[carrier.side];
            belt.linear = belt.at(carrier.arm);
        }
        let rows = &self.rows;
        lanes.take_surfaces(Some(|number: usize, manifold: &Manifold<f32, L>| {
            let SurfaceRow { belts: [a, b], runs, resistance: [rolling, spinning], torque } =
                &rows[number];
            let belt = if *runs { belt(manifold, [a, b], velocities, dt) } else { Velocity::ZERO };
            let torque = manifold.frame.turning(*torque);
            SurfaceEffects { belt, rolling: *rolling, spinning: *spinning, torque }
        }));
    }

    /// Reads the torques back from the lanes, after the last substep of a contact search.
    pub(crate) fn take_back<G: Geometry<L, A>>(
        &mut self,
        colliders: &Colliders<G, L, A>,
        pairs: &[Pair],
        lanes: &LaneSystem<L, A>,
    ) {
        if !colliders.has_resistance {
            return;
        }
        let mut rows = self.rows.iter_mut();
        lanes.give_surfaces(|manifold, surface| {
            if let Some(row) = rows.next() {
                row.torque = manifold.frame.turning_in_world(surface.torque);
            }
        });
        std::mem::swap(&mut self.held, &mut self.before);
        self.held.clear();
        let mut before = self.before.iter().peekable();
        for pair in pairs.iter().filter(|pair| pair.count > 0) {
            while before.next_if(|of| of.colliders < pair.colliders).is_some() {}
            let torque = if pair.is_sleeping {
                before.next_if(|of| of.colliders == pair.colliders).map(|of| of.torque)
            } else {
                let rows = &self.rows[pair.manifolds()];
                let sum = rows.iter().fold(Vector::ZERO, |sum, row| sum + row.torque);
                rows.first().is_some_and(|row| row.resistance != [0.0; 2]).then_some(sum)
            };
            self.held.extend(torque.map(|torque| HeldTorque { colliders: pair.colliders, torque }));
        }
    }

    /// Copies the surface effects of the lanes, for a ledger.
    pub(crate) fn note(&mut self, lanes: &LaneSystem<L, A>) {
        self.done.clear();
        lanes.give_surfaces(|_, surface| self.done.push(*surface));
    }
}
