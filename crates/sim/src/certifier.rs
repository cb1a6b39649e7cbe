//! Solving to a tolerance: what a step keeps for its certificates.

use drystone_solver::island::{self, Islands};
use drystone_solver::jam::{self, Jam};
use drystone_solver::ladder::{Climber, Outcome};
use drystone_solver::solution::Goal;
use drystone_solver::wide::Wide;
use drystone_solver::{InverseMass, System, Velocity};

use crate::settings::StepSettings;

/// A contact that misses its target by more than this after a step may be jammed: more than what
/// rests on soft contacts misses. \[m/s\]
const MISSED: f64 = 0.1;

/// Steps from one search for jams in vain to the next, at most: in a high wall a search takes as long as a
/// thousand real-time steps.
const LONGEST_WAIT: u32 = 64;

/// Islands, and how they are brought within the tolerance.
#[derive(Default)]
pub(crate) struct Certifier<const L: usize, const A: usize> {
    islands: Islands,
    pub(crate) climber: Climber<L, A>,
    loads: Vec<Load>,
    wait: Wait,
}

/// When jams are looked for again: after twice as many steps each time that there were none.
#[derive(Default)]
struct Wait {
    left: u32,
    whole: u32,
}

impl Wait {
    /// Whether it is over. Counts a step.
    fn is_over(&mut self) -> bool {
        let over = self.left == 0;
        self.left = self.left.saturating_sub(1);
        over
    }

    /// Begins after a search.
    fn begin(&mut self, in_vain: bool) {
        self.whole = if in_vain { (2 * self.whole).clamp(1, LONGEST_WAIT) } else { 0 };
        self.left = self.whole;
    }
}

/// What holds an island up.
#[derive(Clone, Copy, Default)]
struct Load {
    /// \[N\]
    weight: f32,
    /// Manifolds with fixed bodies.
    supports: f32,
}

/// How much contacts give way at most.
///
/// Those which carry an island sink by the sag: the island's weight W \[N\] on its n manifolds with
/// fixed bodies gives the stiffness k = W / (n sag), and a spring of implicit form that repairs the part
/// c of its depth per substep h has epsilon = c / (h^2 k).
#[derive(Clone, Copy, Default)]
pub(crate) struct Stiffness<'a> {
    /// None: as they come.
    islands: Option<(&'a Islands, &'a [Load])>,
    /// c sag / h^2. \[m/s^2\]
    give: f32,
}

impl Stiffness<'_> {
    /// The largest epsilon of contacts between these bodies. \[1/kg\]
    pub(crate) fn compliance(&self, bodies: [u32; 2]) -> f32 {
        let Some((islands, loads)) = self.islands else { return f32::INFINITY };
        let load = loads.get(islands.of_pair(bodies) as usize).copied().unwrap_or_default();
        self.give / (load.weight / load.supports.max(1.0))
    }
}

impl<const L: usize, const A: usize> Certifier<L, A> {
    /// Weighs the islands, for the stiffness of contacts in substeps of `h` \[s\] between these `pairs`.
    pub(crate) fn stiffness(
        &mut self,
        pairs: impl Iterator<Item = [u32; 2]>,
        weight: impl Fn(usize) -> f32,
        settings: &StepSettings,
        h: f32,
    ) -> Stiffness<'_> {
        let of_body = &self.islands.of_body;
        self.loads.clear();
        self.loads.resize(self.islands.count, Load::default());
        for (body, &island) in of_body.iter().enumerate() {
            if let Some(load) = self.loads.get_mut(island as usize) {
                load.weight += weight(body);
            }
        }
        for bodies in pairs {
            if bodies.iter().any(|&body| of_body[body as usize] == island::NONE)
                && let Some(load) = self.loads.get_mut(self.islands.of_pair(bodies) as usize)
            {
                load.supports += 1.0;
            }
        }
        let give = settings.repair * settings.sag / (h * h);
        Stiffness { islands: Some((&self.islands, &self.loads)), give }
    }

    /// Contacts whose targets no velocities can meet; after searches in vain not in every step. `sinking` is
    /// the most that any missed its target by. \[m/s\]
    pub(crate) fn jams(
        &mut self,
        system: &mut System<f32, L, A>,
        wide: &Wide<L, A>,
        sinking: f64,
    ) -> Vec<Jam> {
        if sinking <= MISSED || !self.wait.is_over() {
            return Vec::new();
        }
        wide.unpack(system);
        let jams = jam::find(system, &mut self.islands, MISSED);
        self.wait.begin(jams.is_empty());
        jams
    }

    /// Finds the islands of a part of a step, in which these pairs of bodies touch.
    pub(crate) fn find_islands(
        &mut self,
        masses: &[InverseMass<f32, L, A>],
        pairs: impl Iterator<Item = [u32; 2]>,
    ) {
        self.islands.join(masses, pairs);
    }

    /// Takes over a system that has been packed, for all substeps of a part of a step.
    pub(crate) fn start(&mut self, system: &System<f32, L, A>, wide: &mut Wide<L, A>) {
        wide.set_islands(&self.islands);
        self.climber.start(system, &self.islands);
    }

    /// Brings a substep within the tolerance, from the impulses of the one before; with all residuals
    /// if `examined`.
    pub(crate) fn refine(
        &mut self,
        system: &mut System<f32, L, A>,
        wide: &mut Wide<L, A>,
        prospective: &[Velocity<f32, L, A>],
        settings: &StepSettings,
        examined: bool,
    ) -> Outcome {
        let goal =
            Goal { tolerance: f64::from(settings.tolerance), budget: settings.budget as usize };
        let islands = &self.islands;
        if examined {
            self.climber.climb::<true>(system, wide, prospective, islands, &goal)
        } else {
            self.climber.climb::<false>(system, wide, prospective, islands, &goal)
        }
    }

    /// The certificate of a substep as it is.
    pub(crate) fn examine(
        &mut self,
        velocities: &[Velocity<f32, L, A>],
        wide: &Wide<L, A>,
        prospective: &[Velocity<f32, L, A>],
    ) -> Outcome {
        self.climber.examine(velocities, wide, prospective, &self.islands)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After 1, 2, 4 steps and so on, up to the longest wait; in each step while there are jams.
    #[test]
    fn searches_in_vain_become_rare() {
        let mut wait = Wait::default();
        let mut searches = Vec::new();
        for step in 0..400 {
            if wait.is_over() {
                searches.push(step);
                wait.begin(true);
            }
        }
        assert_eq!(searches[..8], [0, 2, 5, 10, 19, 36, 69, 134]);
        let mut wait = Wait::default();
        wait.begin(true);
        wait.begin(true);
        assert_eq!([0; 4].map(|_| wait.is_over()), [false, false, true, true]);
        wait.begin(false);
        assert_eq!([0; 2].map(|_| wait.is_over()), [true, true]);
    }
}
