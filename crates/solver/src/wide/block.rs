//! [`Block`]: sixteen manifolds side by side.

use super::Rows;
use crate::batch::Outline;
use crate::color::{Coloring, Members};
use crate::each_lane;
use crate::island::NONE;
use crate::lanes::{Lanes, WIDTH, gathered};
use crate::pgs::Parts;
use crate::{Contact, InverseMass, Manifold, Mobility, Vector};

/// Up to sixteen manifolds that move different bodies.
#[derive(Clone, Debug)]
pub(crate) struct Block<V: Lanes, const L: usize, const A: usize> {
    /// How many of the lanes are in use.
    pub(super) lanes: usize,
    pub(super) bodies: [[u32; WIDTH]; 2],
    /// All bodies are before this one.
    pub(super) end: u32,
    /// Of each side, the lanes whose body can be moved, as bits.
    pub(super) moving: [u16; 2],
    pub(super) islands: [u32; WIDTH],
    pub(super) masses: [InverseMass<V, L, A>; 2],
    pub(super) mobility: Mobility<V, L, A>,
    /// `bodies` of this one mean nothing: each lane has its own.
    pub(super) manifold: Manifold<V, L>,
}

impl<V: Lanes, const L: usize, const A: usize> Block<V, L, A> {
    pub(super) fn empty() -> Self {
        Self {
            lanes: 0,
            bodies: [[0; WIDTH]; 2],
            end: 1,
            moving: [0; 2],
            islands: [NONE; WIDTH],
            masses: [InverseMass::default(); 2],
            mobility: Mobility::default(),
            manifold: Manifold::default(),
        }
    }

    /// Gives it other manifolds, of so many points at most.
    pub(super) fn seat(&mut self, members: &Members, points: u32, coloring: &Coloring) {
        self.manifold.count = points;
        (self.lanes, self.end, self.moving) = (members.lanes, 0, [0; 2]);
        for (lane, &manifold) in members.manifolds.iter().enumerate() {
            let Outline { bodies, moving, .. } = *coloring.outline(manifold);
            for side in 0..2 {
                self.bodies[side][lane] = bodies[side];
                self.end = self.end.max(bodies[side] + 1);
                // Idle lanes are not written back.
                let moving = moving[side] && lane < members.lanes;
                self.moving[side] |= u16::from(moving) << lane;
            }
        }
    }

    /// Takes its manifolds in, and their points.
    #[inline(always)]
    pub(super) fn take(
        &mut self,
        manifolds: &[u32; WIDTH],
        rows: &impl Rows<L>,
        masses: &[InverseMass<f32, L, A>],
        points: &mut [Contact<V, L>],
    ) {
        for (own, bodies) in self.masses.iter_mut().zip(&self.bodies) {
            let of = each_lane!(lane => &masses[bodies[lane] as usize]);
            own.linear = V::from_array(each_lane!(lane => of[lane].linear));
            for i in 0..A {
                own.angular.0[i] = gathered(each_lane!(lane => &of[lane].angular.0[i]));
            }
        }
        points.fill(Contact::default());
        rows.take(manifolds, &self.bodies, self.moving, &mut self.manifold, points);
    }

    /// Finds the effective masses of its points ([`Contact::prepare`]).
    #[inline(always)]
    pub(super) fn prepare(&mut self, points: &mut [Contact<V, L>], softness: V) {
        self.mobility = Mobility::of(&self.manifold, &self.masses);
        for contact in points {
            contact.prepare(&self.manifold, &self.mobility, softness);
        }
    }

    /// Its points, of those of it and the blocks that follow, which are cut off after its room.
    #[inline(always)]
    pub(super) fn points_in<'a, T>(&self, later: &mut &'a mut [T], room: u32) -> &'a mut [T] {
        let own = later.split_off_mut(..room as usize).unwrap_or_default();
        &mut own[..self.manifold.count as usize]
    }

    /// The manifold in a lane, without its points.
    pub(super) fn manifold_in(&self, lane: usize) -> Manifold<f32, L> {
        let wide = &self.manifold;
        Manifold {
            bodies: self.bodies.map(|side| side[lane]),
            frame: std::array::from_fn(|i| get(&wide.frame[i], lane)),
            arms: std::array::from_fn(|i| get(&wide.arms[i], lane)),
            friction: wide.friction.get(lane),
            restitution: wide.restitution.get(lane),
            compliance: wide.compliance.get(lane),
            first: 0,
            count: 0,
        }
    }

    pub(super) fn parts(&self) -> Parts<'_, V, L, A> {
        (&self.manifold, &self.mobility, &self.masses)
    }

    /// Whether all its manifolds belong to islands that are done.
    pub(super) fn is_done(&self, done: &[bool]) -> bool {
        let mut own = self.islands[..self.lanes].iter();
        own.all(|&island| done.get(island as usize).copied().unwrap_or(true))
    }
}

pub(super) fn splat<V: Lanes>(value: f32) -> V {
    V::from_array([value; WIDTH])
}

/// What a lane of a contact has.
pub(super) fn contact_in<V: Lanes, const L: usize>(
    wide: &Contact<V, L>,
    lane: usize,
) -> Contact<f32, L> {
    Contact {
        place: get(&wide.place, lane),
        gap: get(&wide.gap, lane),
        target: get(&wide.target, lane),
        impulse: get(&wide.impulse, lane),
        impact: wide.impact.get(lane),
        effective_mass: wide.effective_mass.get(lane),
        tangential_mass: wide.tangential_mass.get(lane),
        compliance: wide.compliance.get(lane),
        tangential_compliance: wide.tangential_compliance.get(lane),
    }
}

#[inline(always)]
pub(super) fn get<V: Lanes, const N: usize>(wide: &Vector<V, N>, lane: usize) -> Vector<f32, N> {
    let mut out = Vector::ZERO;
    for i in 0..N {
        out[i] = wide[i].get(lane);
    }
    out
}
