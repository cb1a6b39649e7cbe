//! How far bodies move within a step and pass each other: how far ahead contacts are looked for, and how often.

use drystone_solver::team::Team;
use drystone_solver::{Vector, Velocity};

use crate::bodies::PIECE;
use crate::cache::Pair;
use crate::geometry::Reach;

/// Pairs that are worth as much as the least that is shared.
const PAIRS: usize = 256;

/// How a body moves within a step.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Travel<const L: usize> {
    /// dt v. \[m\]
    pub(crate) linear: Vector<f32, L>,
    /// dt |omega| times what its shapes reach that turns. \[m\]
    pub(crate) angular: f32,
    /// dt |v - v of a neighbor|, the largest: how far it can move against another neighbor, should
    /// this one push it within the step. \[m\]
    pub(crate) blow: f32,
}

/// How all bodies move within a step, and pass each other.
#[derive(Default)]
pub(crate) struct Travels<const L: usize> {
    /// By body.
    pub(crate) own: Vec<Travel<L>>,
    /// What each thread has found.
    passed: Vec<Passed>,
}

/// What pairs pass of each other.
#[derive(Default)]
struct Passed {
    /// By body: [`Travel::blow`].
    blows: Vec<f32>,
    /// The most of any pair, as part of the thinner shape. \[1\]
    worst: f32,
}

impl<const L: usize> Travels<L> {
    /// Those of bodies with these velocities, whose shapes reach so far \[m\], in `dt` \[s\].
    pub(crate) fn find<const A: usize>(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        reach: &[Reach],
        dt: f32,
        team: &Team,
    ) {
        self.own.resize(velocities.len(), Travel::default());
        let (useful, share) = team.share(velocities.len(), PIECE);
        let moves = velocities.chunks(share).zip(reach.chunks(share));
        let parts = self.own.chunks_mut(share).zip(moves);
        team.for_each(useful, parts, |(own, (velocities, reach))| {
            for ((own, velocity), reach) in own.iter_mut().zip(velocities).zip(reach) {
                let angular = velocity.angular.length() * reach.core * dt;
                *own = Travel { linear: velocity.linear * dt, angular, blow: 0.0 };
            }
        });
    }

    /// Finds what near bodies pass of each other, with what gravity adds, `fall` \[m\], and their blows; the most, as
    /// part of the thinner shape. \[1\]
    pub(crate) fn pass(&mut self, pairs: &[Pair], fall: f32, team: &Team) -> f32 {
        let Self { own, passed } = self;
        let (useful, share) = team.share(pairs.len(), PAIRS);
        passed.resize_with(pairs.len().div_ceil(share), Passed::default);
        team.for_each(useful, pairs.chunks(share).zip(&mut *passed), |(pairs, passed)| {
            passed.blows.clear();
            passed.blows.resize(own.len(), 0.0);
            let (blows, mut worst) = (&mut passed.blows[..], 0.0f32);
            for pair in pairs.iter().filter(|pair| !pair.rests) {
                let [a, b] = pair.bodies;
                let (a, b) = (a as usize, b as usize);
                let (own_a, own_b) = (&own[a], &own[b]);
                let apart = (own_a.linear - own_b.linear).length();
                blows[a] = blows[a].max(apart);
                blows[b] = blows[b].max(apart);
                let travel = apart + own_a.angular + own_b.angular + fall;
                worst = worst.max(travel / pair.thickness);
            }
            passed.worst = worst;
        });
        let (_, share) = team.share(own.len(), PIECE);
        team.for_each(useful, own.chunks_mut(share).enumerate(), |(part, own)| {
            for passed in &*passed {
                for (own, blow) in own.iter_mut().zip(&passed.blows[share * part..]) {
                    own.blow = own.blow.max(*blow);
                }
            }
        });
        passed.iter().fold(0.0, |worst, passed| worst.max(passed.worst))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::Random;

    /// Blows and the worst pair, of so many pairs that threads share them, are those of the definition.
    #[test]
    fn what_pairs_pass_by_any_number_of_threads() {
        let mut random = Random(5);
        let bodies = 900;
        let mut vector = || Vector(std::array::from_fn(|_| random.number()));
        let velocities: Vec<Velocity<f32, 3, 3>> =
            (0..bodies).map(|_| Velocity { linear: vector(), angular: vector() }).collect();
        let reach: Vec<Reach> =
            (0..bodies).map(|_| Reach { all: 1.0, core: 0.5 + 0.4 * random.number() }).collect();
        let mut body = || ((0.5 + 0.5 * random.number()) * bodies as f32) as u32 % bodies as u32;
        let pairs: Vec<Pair> = (0..9000).map(|at| pair([body(), body()], at % 7 == 0)).collect();
        let (dt, fall) = (0.1, 0.01);
        let (mut blows, mut worst) = (vec![0.0f32; bodies], 0.0f32);
        for pair in pairs.iter().filter(|pair| !pair.rests) {
            let [a, b] = pair.bodies.map(|body| body as usize);
            let apart = (velocities[a].linear * dt - velocities[b].linear * dt).length();
            blows[a] = blows[a].max(apart);
            blows[b] = blows[b].max(apart);
            let [p, q] =
                [a, b].map(|body| velocities[body].angular.length() * reach[body].core * dt);
            worst = worst.max((apart + p + q + fall) / pair.thickness);
        }
        for members in 1..5 {
            let (team, mut travels) = (Team::new(members), Travels::default());
            // What the first has left must not matter to the second.
            for factor in [3.0, 1.0] {
                travels.find(&velocities, &reach, factor * dt, &team);
                let found = travels.pass(&pairs, fall, &team);
                if factor == 1.0 {
                    assert_eq!(found, worst, "{members} members");
                    let own: Vec<f32> = travels.own.iter().map(|own| own.blow).collect();
                    assert_eq!(own, blows, "{members} members");
                }
            }
        }
    }

    fn pair(bodies: [u32; 2], rests: bool) -> Pair {
        Pair {
            colliders: bodies,
            bodies,
            friction: 0.5,
            restitution: 0.0,
            thickness: 0.2 + 1e-3 * bodies[0] as f32,
            rolls: false,
            rests,
            lever: 1.0,
            until: 0.0,
            first: 0,
            count: 0,
        }
    }
}
