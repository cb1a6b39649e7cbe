//! Sixteen manifolds at a time: a [`System`] packed into [`Lanes`], color by color.
//!
//! The kernels are those of [`pgs`](crate::pgs), run on a number that is sixteen numbers. The
//! velocities of the bodies are gathered once per visit to a block and serve all its points.

mod block;
mod conjugate;
mod walk;

use std::sync::Arc;

use crate::certificate::{Certificate, Evidence, Tally};
use crate::color::Coloring;
use crate::island::Islands;
use crate::lanes::{Lanes, PART, Portable, WIDTH};
use crate::pgs::visit;
use crate::team::{Team, chunks_with_parts};
use crate::{Contact, InverseMass, Repair, System, Velocity};
use block::{Block, fill, prepare, set, splat};
use conjugate::Conjugate;
use walk::Ground;

/// A system of `f32` contacts, packed, on the best lanes of this machine.
#[derive(Clone, Debug)]
pub enum Wide<const L: usize, const A: usize> {
    /// On any machine.
    Portable(Packed<Portable, L, A>),
    /// On one with AVX2.
    #[cfg(target_arch = "x86_64")]
    Avx2(Packed<crate::lanes::Avx2, L, A>),
}

/// Does the same on whichever lanes there are.
macro_rules! on_lanes {
    ($wide:expr, $packed:ident => $do:expr) => {
        match $wide {
            Wide::Portable($packed) => $do,
            #[cfg(target_arch = "x86_64")]
            Wide::Avx2($packed) => $do,
        }
    };
}

impl<const L: usize, const A: usize> Wide<L, A> {
    /// An empty one.
    pub fn new() -> Self {
        #[cfg(target_arch = "x86_64")]
        if crate::lanes::avx2_available() {
            return Self::Avx2(Packed::new());
        }
        Self::Portable(Packed::new())
    }

    /// [`Packed::set_team`].
    pub fn set_team(&mut self, team: Arc<Team>) {
        on_lanes!(self, packed => packed.set_team(team));
    }

    /// [`Packed::pack`].
    pub fn pack(&mut self, system: &System<f32, L, A>, softness: f32) {
        on_lanes!(self, packed => packed.pack(system, softness));
    }

    /// [`Packed::unpack`].
    pub fn unpack(&self, system: &mut System<f32, L, A>) {
        on_lanes!(self, packed => packed.unpack(system));
    }

    /// [`Packed::take_impacts`].
    pub fn take_impacts(&mut self, system: &System<f32, L, A>) {
        on_lanes!(self, packed => packed.take_impacts(system));
    }

    /// [`Packed::take_impulses`].
    pub fn take_impulses(&mut self, system: &System<f32, L, A>) {
        on_lanes!(self, packed => packed.take_impulses(system));
    }

    /// [`Packed::start`].
    pub fn start(
        &mut self,
        velocities: &mut [Velocity<f32, L, A>],
        displacements: &[Velocity<f32, L, A>],
        repair: &Repair<f32>,
    ) {
        on_lanes!(self, packed => packed.start(velocities, displacements, repair));
    }

    /// [`Packed::set_islands`].
    pub fn set_islands(&mut self, islands: &Islands) {
        on_lanes!(self, packed => packed.set_islands(islands));
    }

    /// [`Packed::certify`].
    pub fn certify<'a, const RESIDUALS: bool, const LINE: bool>(
        &self,
        velocities: &[Velocity<f32, L, A>],
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        tally: &'a mut Tally<L, A>,
    ) -> &'a [Certificate] {
        on_lanes!(self, packed => {
            packed.certify::<RESIDUALS, LINE>(velocities, prospective, islands, tally)
        })
    }

    /// [`Packed::begin_conjugate`].
    pub fn begin_conjugate(&mut self, islands: usize) {
        on_lanes!(self, packed => packed.begin_conjugate(islands));
    }

    /// [`Packed::conjugate`].
    pub fn conjugate(&mut self, velocities: &mut [Velocity<f32, L, A>], done: &[bool]) {
        on_lanes!(self, packed => packed.conjugate(velocities, done));
    }

    /// [`Packed::sweep`].
    pub fn sweep(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, packed => packed.sweep(velocities));
    }

    /// [`Packed::sweep_normals`].
    pub fn sweep_normals(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, packed => packed.sweep_normals(velocities));
    }

    /// [`Packed::relax`].
    pub fn relax(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        on_lanes!(self, packed => packed.relax(velocities));
    }
}

impl<const L: usize, const A: usize> Default for Wide<L, A> {
    fn default() -> Self {
        Self::new()
    }
}

/// A system of `f32` contacts, packed into lanes of type `V`.
#[derive(Clone, Debug, Default)]
pub struct Packed<V: Lanes, const L: usize, const A: usize> {
    blocks: Vec<Block<V, L, A>>,
    contacts: Vec<Contact<V, L>>,
    coloring: Coloring,
    conjugate: Conjugate<V, L>,
    team: Arc<Team>,
}

/// Manifolds that a thread takes at once.
const CHUNK: usize = 256;

impl<V: Lanes, const L: usize, const A: usize> Packed<V, L, A> {
    /// An empty one.
    pub fn new() -> Self {
        Self {
            blocks: Vec::new(),
            contacts: Vec::new(),
            coloring: Coloring::default(),
            conjugate: Conjugate::default(),
            team: Arc::default(),
        }
    }

    /// Lets a team work on it; results do not depend on it.
    pub fn set_team(&mut self, team: Arc<Team>) {
        self.team = team;
    }

    /// Takes over the manifolds and contacts of `system`, and finds their effective masses
    /// ([`Contact::prepare`]).
    pub fn pack(&mut self, system: &System<f32, L, A>, softness: f32) {
        self.coloring.assign(
            system.velocities.len(),
            system.manifolds.iter().map(|manifold| (manifold.bodies, manifold.count)),
            |body| system.masses[body as usize] != InverseMass::FIXED,
        );
        self.blocks.resize_with(self.coloring.points.len(), Block::empty);
        let mut first = 0;
        for (block, &count) in self.blocks.iter_mut().zip(&self.coloring.points) {
            block.lanes = 0;
            (block.manifold.first, block.manifold.count) = (first, count);
            first += count;
        }
        self.contacts.resize_with(first as usize, Contact::default);
        let Self { blocks, contacts, coloring, team, .. } = self;
        let useful = team.is_useful(blocks.len());
        let share = blocks.len().div_ceil(if useful { team.members() } else { 1 });
        let parts = chunks_with_parts(&coloring.points, share, contacts, |&points| points as usize);
        let parts = parts.zip(blocks.chunks_mut(share.max(1))).enumerate();
        team.for_each(useful, parts, |(part, ((_, contacts), blocks))| {
            fill(part * share, blocks, contacts, coloring, system);
            V::run(
                #[inline(always)]
                || prepare(blocks, contacts, splat(softness)),
            );
        });
    }

    /// Gives impulses, targets and effective masses to the contacts of `system`.
    pub fn unpack(&self, system: &mut System<f32, L, A>) {
        let System { manifolds, contacts, .. } = system;
        let parts = chunks_with_parts(manifolds, CHUNK, contacts, |of| of.count as usize);
        let parts = parts.zip(self.coloring.places.chunks(CHUNK));
        let useful = self.team.is_useful(self.blocks.len());
        self.team.for_each(useful, parts, |((manifolds, contacts), places)| {
            let mut later = contacts;
            for (manifold, &place) in manifolds.iter().zip(places) {
                let own;
                (own, later) = later.split_at_mut(manifold.count as usize);
                self.give(place as usize, own);
            }
        });
    }

    /// Gives the contacts of a manifold what the lane at `place` has.
    fn give(&self, place: usize, contacts: &mut [Contact<f32, L>]) {
        let (block, lane) = (place / WIDTH, place % WIDTH);
        let wide = &self.contacts[self.blocks[block].manifold.points()];
        for (contact, wide) in contacts.iter_mut().zip(wide) {
            for i in 0..L {
                contact.impulse[i] = wide.impulse[i].get(lane);
                contact.target[i] = wide.target[i].get(lane);
            }
            contact.effective_mass = wide.effective_mass.get(lane);
            contact.tangential_mass = wide.tangential_mass.get(lane);
            contact.compliance = wide.compliance.get(lane);
            contact.tangential_compliance = wide.tangential_compliance.get(lane);
        }
    }

    /// Takes over the impulses of collisions from the contacts of `system`.
    pub fn take_impacts(&mut self, system: &System<f32, L, A>) {
        self.copy_in(system, |wide, lane, contact| wide.impact.set(lane, contact.impact));
    }

    /// Takes over the impulses from the contacts of `system`.
    pub fn take_impulses(&mut self, system: &System<f32, L, A>) {
        self.copy_in(system, |wide, lane, contact| set(&mut wide.impulse, lane, &contact.impulse));
    }

    /// `copy` for each contact of `system` and its lane.
    fn copy_in(
        &mut self,
        system: &System<f32, L, A>,
        copy: impl Fn(&mut Contact<V, L>, usize, &Contact<f32, L>),
    ) {
        for (manifold, &place) in system.manifolds.iter().zip(&self.coloring.places) {
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            let wide = &mut self.contacts[self.blocks[block].manifold.points()];
            for (contact, wide) in system.contacts[manifold.points()].iter().zip(wide) {
                copy(wide, lane, contact);
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
        let (team, ground) = self.ground(velocities);
        team.run(team.is_useful(ground.blocks.len()), &|member| {
            V::run(
                #[inline(always)]
                || {
                    for mut visit in ground.walk(member) {
                        let (block, manifold) = (visit.block, &visit.block.manifold);
                        let [moved_a, moved_b] = block.gather_from(displacements);
                        let moved = manifold.twist(&moved_a, &moved_b);
                        let mut wrench = Velocity::ZERO;
                        for contact in visit.points() {
                            contact.set_target(&moved, &repair);
                            contact.add_wrench(0..L, contact.impulse, &mut wrench);
                        }
                        let [mut a, mut b] = visit.gather();
                        manifold.apply(&wrench, &block.masses, &mut a, &mut b);
                        visit.scatter([a, b]);
                    }
                },
            );
        });
    }

    /// What a team works on.
    fn ground<'a>(
        &'a mut self,
        velocities: &'a mut [Velocity<f32, L, A>],
    ) -> (&'a Team, Ground<'a, V, L, A>) {
        let Self { blocks, contacts, coloring, team, .. } = self;
        (team, Ground::new(blocks, coloring, contacts, velocities))
    }

    /// Tells each manifold which island it belongs to.
    pub fn set_islands(&mut self, islands: &Islands) {
        for block in &mut self.blocks {
            for lane in 0..WIDTH {
                let bodies = block.bodies.map(|side| side[lane]);
                block.islands[lane] = islands.of_pair(bodies);
            }
        }
    }

    /// The certificate of each island ([`certificate`](crate::certificate)), in `f64`, with the
    /// masses that `tally` was given; with `RESIDUALS` or G alone, for the best impulses on the `LINE`
    /// or those at hand.
    pub fn certify<'a, const RESIDUALS: bool, const LINE: bool>(
        &self,
        velocities: &[Velocity<f32, L, A>],
        prospective: &[Velocity<f32, L, A>],
        islands: &Islands,
        tally: &'a mut Tally<L, A>,
    ) -> &'a [Certificate] {
        tally.start(islands.count);
        V::run(
            #[inline(always)]
            || {
                for block in &self.blocks {
                    let points = &self.contacts[block.manifold.points()];
                    let own = block.gather_from(velocities);
                    for part in 0..block.lanes.div_ceil(PART) {
                        let evidence: Evidence<V::Doubles, L, A> =
                            Evidence::of::<V, RESIDUALS, LINE>(part, &block.manifold, points, &own);
                        for lane in PART * part..block.lanes.min(PART * (part + 1)) {
                            let bodies = block.bodies.map(|side| side[lane]);
                            tally.add::<V::Doubles, RESIDUALS, LINE>(
                                bodies,
                                block.islands[lane],
                                &evidence,
                                lane % PART,
                            );
                        }
                    }
                }
                tally.finish::<f32, LINE>(velocities, prospective, |body| islands.of_body[body])
            },
        )
    }

    /// [`pgs::sweep`](crate::pgs::sweep).
    pub fn sweep(&mut self, velocities: &mut [Velocity<f32, L, A>]) {
        self.visit_all::<false, true>(velocities);
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
        let (team, ground) = self.ground(velocities);
        team.run(team.is_useful(ground.blocks.len()), &|member| {
            V::run(
                #[inline(always)]
                || {
                    for mut at in ground.walk(member) {
                        let [mut a, mut b] = at.gather();
                        let points = at.points();
                        visit::<V, L, A, RIGID, FRICTION>(at.block.parts(), points, &mut a, &mut b);
                        at.scatter([a, b]);
                    }
                },
            );
        });
    }
}
