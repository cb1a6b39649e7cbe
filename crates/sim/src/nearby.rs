//! Masses, near pairs and contact points of a world, in numbers of any dimension.

use drystone_solver::Manifold;

use crate::geometry::Geometry;
use crate::report::{ContactPoints, Nearby};
use crate::world::World;

impl<G: Geometry<L, A>, const L: usize, const A: usize> World<G, L, A> {
    /// Returns the mass of each slot, in order; infinite for static and kinematic bodies. \[kg\]
    pub fn masses(&self) -> Vec<f64> {
        (0..self.len()).map(|slot| self.mass(slot)).collect()
    }

    /// Returns the pairs of bodies near each other at the last search for contacts, one entry per
    /// manifold. Bodies are slots.
    pub fn nearby(&self) -> Vec<Nearby> {
        let system = self.system_at_search();
        let of = |manifold: &Manifold<f32, L>| {
            let contacts = system.contacts[manifold.points()].iter();
            Nearby {
                bodies: manifold.bodies.map(|body| self.solver.carriers.body_of(body) as usize),
                normal: manifold.normal().0.map(f64::from).to_vec(),
                gap: contacts
                    .map(|contact| f64::from(contact.gap[0]))
                    .fold(f64::INFINITY, f64::min),
                friction: f64::from(manifold.friction),
            }
        };
        system.manifolds.iter().map(of).collect()
    }
    /// Returns the contact points of the last substep after solving, at the poses after the step.
    /// Those of pairs that sleep are left out.
    pub fn contact_points(&self) -> ContactPoints {
        let system = self.system();
        let mut out = ContactPoints::default();
        for manifold in &system.manifolds {
            let carriers = &self.solver.carriers;
            let own = |body: u32| self.bodies.frames[body as usize].position;
            let a = manifold.bodies[0];
            let center = carriers.get(a).map_or_else(|| own(a), |carrier| carrier.position);
            for contact in &system.contacts[manifold.points()] {
                let arm = manifold.frame.arms[0] + manifold.frame.to_world(contact.offset);
                out.bodies.push(manifold.bodies.map(|body| carriers.body_of(body)));
                out.points.extend((center + arm).0);
                out.frames.extend(manifold.frame.axes.iter().flat_map(|axis| axis.0));
                out.impulses.extend(contact.impulse.0);
                out.gaps.push(contact.gap[0]);
                out.friction.push(manifold.friction);
            }
        }
        out
    }
}
