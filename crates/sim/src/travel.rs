//! Travel bounds, for continuous collision detection (CCD): motion of bodies within a step and
//! relative to each other. They determine how far ahead contacts are searched, and how often.

use drystone_solver::thread_pool::ThreadPool;
use drystone_solver::{InverseMass, Vector, Velocity};

use crate::bodies::{GRAIN, SearchMotion};
use crate::cache::Pair;
use crate::geometry::{Frame, Reach};

/// Grain size for sharing pairs between threads.
const PAIR_GRAIN: usize = 256;

/// Rotations that move surfaces by less than this fraction of the thinner shape are not checked for
/// a common rotation of both bodies. \[1\]
const TURNS: f32 = 0.25;

/// A shape that moves by more than this fraction of its thickness as it rotates could pass through
/// shapes that are not near yet. \[1\]
const SWING: f32 = 0.5;

/// Bounds on the motion of a body within a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct TravelBound<const L: usize> {
    /// Displacement of the center, dt v. \[m\]
    pub(crate) linear: Vector<f32, L>,
    /// Displacement of surfaces by rotation: dt |omega| times the reach of the cores of its shapes;
    /// and that of a mesh that deforms. \[m\]
    pub(crate) angular: f32,
    /// Part of `angular` by which the body deforms. \[m\]
    pub(crate) deformed: f32,
    /// Largest relative displacement of its center and that of a neighbor. If the neighbor pushes
    /// it within the step, it can move this far against another neighbor. \[m\]
    pub(crate) neighbor_push: f32,
}

impl<const L: usize> TravelBound<L> {
    /// Returns the displacement by rotation of a shape of this thickness \[m\] if it is large, as
    /// that of a swinging bat; else 0. \[m\]
    pub(crate) fn swing(&self, thickness: f32) -> f32 {
        if self.angular > SWING * thickness { self.angular } else { 0.0 }
    }
}

/// Motion of all bodies.
#[derive(Clone, Copy)]
pub(crate) struct MotionView<'a, const L: usize, const A: usize> {
    pub(crate) velocities: &'a [Velocity<f32, L, A>],
    pub(crate) frames: &'a [Frame<L>],
    /// Reach of the shapes of each body.
    pub(crate) reach: &'a [Reach],
    pub(crate) since_search: &'a [SearchMotion<L>],
    /// Largest speed of a vertex of each body; the array may be shorter. \[m/s\]
    pub(crate) surface_speeds: &'a [f32],
    /// Duration of the motion. \[s\]
    pub(crate) dt: f32,
}

impl<const L: usize, const A: usize> MotionView<'_, L, A> {
    /// Returns bounds on the relative motion of two bodies: of their centers, and of their surfaces
    /// by rotation. \[m\] Returns `None` if the sum is less than their `clearance` \[m\], which is
    /// evaluated only for large rotations.
    #[inline(always)]
    pub(crate) fn relative_travel(
        &self,
        own: &[TravelBound<L>],
        pair: &Pair,
        clearance: impl Fn() -> f32,
    ) -> Option<[f32; 2]> {
        let [a, b] = pair.bodies.map(|body| &own[body as usize]);
        let travel = [(a.linear - b.linear).length(), a.angular + b.angular];
        if travel[1] <= TURNS * pair.thickness || a.deformed + b.deformed > 0.0 {
            return Some(travel);
        }
        (travel[0] + travel[1] >= clearance()).then(|| self.in_rotating_frame(pair.bodies, travel))
    }

    /// Returns these bounds as seen from one of the rotating bodies, if they are smaller. Bodies in
    /// a drum rotate with it.
    #[inline(never)]
    fn in_rotating_frame(&self, bodies: [u32; 2], travel: [f32; 2]) -> [f32; 2] {
        let [a, b] = bodies.map(|body| body as usize);
        let (own, other) = (&self.velocities[a], &self.velocities[b]);
        let apart = self.frames[a].position - self.frames[b].position;
        let turning = (own.angular - other.angular).length();
        let from_a = (other.linear - own.at(-apart)).length();
        let from_b = (own.linear - other.at(apart)).length();
        [[from_a, turning * self.reach[b].core], [from_b, turning * self.reach[a].core]]
            .map(|seen| seen.map(|speed| speed * self.dt))
            .into_iter()
            .fold(
                travel,
                |least, seen| if seen[0] + seen[1] < least[0] + least[1] { seen } else { least },
            )
    }
}

/// Travel bounds of all bodies, and their relative motion.
#[derive(Default)]
pub(crate) struct TravelBounds<const L: usize> {
    /// By body.
    pub(crate) own: Vec<TravelBound<L>>,
    /// Results of each thread.
    travel: Vec<ThreadTravel>,
}

/// Relative motion of the pairs of one thread.
#[derive(Default)]
struct ThreadTravel {
    /// By body: [`TravelBound::neighbor_push`].
    neighbor_pushes: Vec<f32>,
    /// Largest relative motion of any pair, as a fraction of the thinner shape. \[1\]
    worst: f32,
}

impl<const L: usize> TravelBounds<L> {
    /// Computes the bounds of all bodies.
    pub(crate) fn find<const A: usize>(&mut self, moving: MotionView<'_, L, A>, pool: &ThreadPool) {
        let MotionView { velocities, reach, dt, .. } = moving;
        self.own.resize(velocities.len(), TravelBound::default());
        let (useful, share) = pool.share(velocities.len(), GRAIN);
        let moves = velocities.chunks(share).zip(reach.chunks(share));
        let parts = self.own.chunks_mut(share).zip(moves);
        pool.for_each(useful, parts, |(own, (velocities, reach))| {
            for ((own, velocity), reach) in own.iter_mut().zip(velocities).zip(reach) {
                let angular = velocity.angular.length() * reach.core * dt;
                let linear = velocity.linear * dt;
                *own = TravelBound { linear, angular, ..TravelBound::default() };
            }
        });
        for (own, speed) in self.own.iter_mut().zip(moving.surface_speeds) {
            own.deformed = speed * dt;
            own.angular += own.deformed;
        }
    }

    /// Computes the relative motion of near bodies, `fall` \[m\] by gravity included, and their
    /// pushes of neighbors. Returns the largest relative motion as a fraction of the thinner shape.
    /// \[1\]
    ///
    /// Bodies are near if their clearance is less than their relative motion plus `fall` and
    /// `margin` \[m\]. A fixed body gets no push, so a body that moves along a floor does not
    /// affect others on it.
    pub(crate) fn find_pushes<const A: usize>(
        &mut self,
        moving: MotionView<'_, L, A>,
        masses: &[InverseMass<f32, L, A>],
        pairs: &[Pair],
        [fall, margin]: [f32; 2],
        pool: &ThreadPool,
    ) -> f32 {
        let Self { own, travel } = self;
        let (useful, share) = pool.share(pairs.len(), PAIR_GRAIN);
        travel.resize_with(pairs.len().div_ceil(share), ThreadTravel::default);
        pool.for_each(useful, pairs.chunks(share).zip(&mut *travel), |(pairs, travel)| {
            travel.neighbor_pushes.clear();
            travel.neighbor_pushes.resize(own.len(), 0.0);
            let (neighbor_pushes, mut worst) = (&mut travel.neighbor_pushes[..], 0.0f32);
            for pair in pairs.iter().filter(|pair| !pair.is_sleeping) {
                let [a, b] = pair.bodies;
                let (a, b) = (a as usize, b as usize);
                let clearance = pair.gap(moving.since_search) - fall - margin;
                let Some([apart, turning]) = moving.relative_travel(own, pair, || clearance) else {
                    continue;
                };
                if apart + turning < clearance {
                    continue;
                }
                neighbor_pushes[a] = neighbor_pushes[a].max(apart);
                neighbor_pushes[b] = neighbor_pushes[b].max(apart);
                worst = worst.max((apart + turning + fall) / pair.thickness);
            }
            travel.worst = worst;
        });
        let (_, share) = pool.share(own.len(), GRAIN);
        pool.for_each(useful, own.chunks_mut(share).enumerate(), |(part, own)| {
            for travel in &*travel {
                let neighbor_pushes =
                    travel.neighbor_pushes[share * part..].iter().zip(&masses[share * part..]);
                for (own, (neighbor_push, mass)) in own.iter_mut().zip(neighbor_pushes) {
                    if *mass != InverseMass::FIXED {
                        own.neighbor_push = own.neighbor_push.max(*neighbor_push);
                    }
                }
            }
        });
        travel.iter().fold(0.0, |worst, travel| worst.max(travel.worst))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::Random;

    /// Bodies in arrays.
    struct Swarm {
        velocities: Vec<Velocity<f32, 3, 3>>,
        frames: Vec<Frame<3>>,
        reach: Vec<Reach>,
        since_search: Vec<SearchMotion<3>>,
    }

    impl Swarm {
        fn of(bodies: usize, random: &mut Random) -> Self {
            let mut velocity = || Velocity { linear: random.vector(), angular: random.vector() };
            let velocities = (0..bodies).map(|_| velocity()).collect();
            let frame = |position| Frame { position, ..Frame::IDENTITY };
            let frames = (0..bodies).map(|_| frame(random.vector())).collect();
            let reach = |core| Reach { all: 1.0, core };
            let reach = (0..bodies).map(|_| reach(0.5 + 0.4 * random.number())).collect();
            Self { velocities, frames, reach, since_search: vec![SearchMotion::NOWHERE; bodies] }
        }

        fn moving(&self, dt: f32) -> MotionView<'_, 3, 3> {
            let Self { velocities, frames, reach, since_search } = self;
            MotionView { velocities, frames, reach, since_search, surface_speeds: &[], dt }
        }
    }

    /// With any number of threads, pushes and the worst pair are equal to those computed pair by
    /// pair. There are enough pairs for threads to share.
    #[test]
    fn travel_bounds_do_not_depend_on_the_threads() {
        let mut random = Random(5);
        let bodies = 900;
        let swarm = Swarm::of(bodies, &mut random);
        let mut body = || ((0.5 + 0.5 * random.number()) * bodies as f32) as u32 % bodies as u32;
        let pairs: Vec<Pair> = (0..9000).map(|at| pair([body(), body()], at % 7 == 0)).collect();
        let (moving, fall) = (swarm.moving(0.1), 0.01);
        let mut masses = free(bodies);
        masses[7] = InverseMass::FIXED;
        let mut alone = TravelBounds::default();
        alone.find(moving, &ThreadPool::new(1));
        let (mut neighbor_pushes, mut worst) = (vec![0.0f32; bodies], 0.0f32);
        for pair in pairs.iter().filter(|pair| !pair.is_sleeping) {
            let [apart, turning] = moving.relative_travel(&alone.own, pair, || 0.0).unwrap();
            for body in pair.bodies.map(|body| body as usize) {
                neighbor_pushes[body] = neighbor_pushes[body].max(apart);
            }
            worst = worst.max((apart + turning + fall) / pair.thickness);
        }
        neighbor_pushes[7] = 0.0;
        for members in 1..5 {
            let (pool, mut travels) = (ThreadPool::new(members), TravelBounds::default());
            // The results of the first run must not affect the second.
            for moving in [swarm.moving(0.3), moving] {
                travels.find(moving, &pool);
                let found = travels.find_pushes(moving, &masses, &pairs, [fall, 0.0], &pool);
                if moving.dt == 0.1 {
                    assert_eq!(found, worst, "{members} members");
                    let own: Vec<f32> = travels.own.iter().map(|own| own.neighbor_push).collect();
                    assert_eq!(own, neighbor_pushes, "{members} members");
                }
            }
        }
    }

    /// No point that belongs to both bodies, as a contact point, moves by more than the bound,
    /// however they rotate.
    #[test]
    fn no_point_moves_beyond_its_travel_bound() {
        let mut random = Random(9);
        let (dt, mut least) = (0.1, f32::INFINITY);
        for _ in 0..2000 {
            let mut swarm = Swarm::of(2, &mut random);
            let [core_a, core_b] = [0, 1].map(|body| swarm.reach[body].core);
            let towards = random.vector();
            let towards = towards * (1.0 / towards.length());
            let place = towards * core_b;
            swarm.frames[1].position = Vector::ZERO;
            swarm.frames[0].position = place + towards * core_a;
            let moving = swarm.moving(dt);
            let mut travels = TravelBounds::default();
            travels.find(moving, &ThreadPool::new(1));
            let pair = pair([0, 1], false);
            let said: f32 =
                moving.relative_travel(&travels.own, &pair, || 0.0).unwrap().iter().sum();
            let [a, b] = [0, 1]
                .map(|body| swarm.velocities[body].at(place - swarm.frames[body].position) * dt);
            let travel = (a - b).length();
            assert!(travel <= said + 1e-6, "{travel} m, {said} m said");
            least = least.min(said / travel);
        }
        assert!(least < 1.2, "far too much is said: {least} times at least");
    }

    /// A body in a drum rotates with it: it has no motion relative to the wall, however far the
    /// wall is from the axis.
    #[test]
    fn common_rotation_is_no_relative_motion() {
        let mut random = Random(4);
        let mut swarm = Swarm::of(2, &mut random);
        let (spin, place) = (random.vector(), random.vector() * 10.0);
        swarm.frames[1].position = Vector::ZERO;
        swarm.frames[0].position = place;
        swarm.reach[1].core = 12.0;
        swarm.velocities[1] = Velocity { linear: random.vector(), angular: spin };
        swarm.velocities[0] = Velocity { linear: swarm.velocities[1].at(place), angular: spin };
        let (moving, pool, mut travels) =
            (swarm.moving(0.1), ThreadPool::new(1), TravelBounds::default());
        travels.find(moving, &pool);
        let mut pairs = [pair([0, 1], false)];
        let found = travels.find_pushes(moving, &free(2), &pairs, [0.0; 2], &pool);
        assert!(found < 1e-4 && travels.own[0].neighbor_push < 1e-5, "{found}, {:?}", travels.own);
        // Now a third of the drum's rotation is relative, and distant bodies do not count.
        swarm.velocities[0].angular = spin * (2.0 / 3.0);
        let moving = swarm.moving(0.1);
        let found = travels.find_pushes(moving, &free(2), &pairs, [0.0; 2], &pool);
        let turned = spin.length() / 3.0 * swarm.reach[0].core * 0.1;
        assert!((found * pairs[0].thickness - turned).abs() < 1e-5, "{found}");
        pairs[0].clearance = 100.0;
        assert_eq!(travels.find_pushes(moving, &free(2), &pairs, [0.0; 2], &pool), 0.0);
    }

    /// Returns the inverse masses of bodies that can be moved.
    fn free(bodies: usize) -> Vec<InverseMass<f32, 3, 3>> {
        vec![InverseMass { linear: 1.0, ..InverseMass::FIXED }; bodies]
    }

    fn pair(bodies: [u32; 2], is_sleeping: bool) -> Pair {
        Pair { bodies, is_sleeping, thickness: 0.2 + 1e-3 * bodies[0] as f32, ..Pair::APART }
    }
}
