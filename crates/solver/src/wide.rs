//! Sixteen manifolds at a time: a [`System`] packed into [`Lanes`], color by color.
//!
//! The kernels are those of [`pgs`](crate::pgs), run on a number that is sixteen numbers. The
//! velocities of the bodies are gathered once per visit to a block and serve all its points.

mod conjugate;

use crate::certificate::{Certificate, Evidence, Tally};
use crate::color::Coloring;
use crate::island::{Islands, NONE};
use crate::lanes::{Lanes, PART, Portable, Row, WIDTH};
use crate::pgs::{Parts, visit};
use crate::{Contact, InverseMass, Manifold, Mobility, Repair, System, Vector, Velocity};
use conjugate::Conjugate;

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
}

/// The gap of a point that is not there. \[m\]
const FAR: f32 = 1e6;

/// Up to sixteen manifolds that move different bodies.
#[derive(Clone, Debug)]
struct Block<V: Lanes, const L: usize, const A: usize> {
    /// How many of the lanes are in use.
    lanes: usize,
    bodies: [[u32; WIDTH]; 2],
    islands: [u32; WIDTH],
    masses: [InverseMass<V, L, A>; 2],
    mobility: Mobility<V, L, A>,
    /// `bodies` of this one mean nothing: each lane has its own.
    manifold: Manifold<V, L>,
}

impl<V: Lanes, const L: usize, const A: usize> Packed<V, L, A> {
    /// An empty one.
    pub fn new() -> Self {
        Self {
            blocks: Vec::new(),
            contacts: Vec::new(),
            coloring: Coloring::default(),
            conjugate: Conjugate::default(),
        }
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
        // In the order of the manifolds: they come from memory in a stream, while the blocks that
        // are being filled, at most one for each color and number of points, stay in cache.
        for (manifold, &place) in system.manifolds.iter().zip(&self.coloring.places) {
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            let block = &mut self.blocks[block];
            let points = &mut self.contacts[block.manifold.points()];
            block.take(lane, manifold, system, points);
        }
        self.prepare(splat(softness));
    }

    fn prepare(&mut self, softness: V) {
        V::run(
            #[inline(always)]
            || {
                for block in &mut self.blocks {
                    block.mobility = Mobility::of(&block.manifold, &block.masses);
                    for contact in &mut self.contacts[block.manifold.points()] {
                        contact.prepare(&block.manifold, &block.mobility, softness);
                    }
                }
            },
        );
    }

    /// Gives impulses, targets and effective masses to the contacts of `system`.
    pub fn unpack(&self, system: &mut System<f32, L, A>) {
        for (manifold, &place) in system.manifolds.iter().zip(&self.coloring.places) {
            let (block, lane) = (place as usize / WIDTH, place as usize % WIDTH);
            let wide = &self.contacts[self.blocks[block].manifold.points()];
            for (contact, wide) in system.contacts[manifold.points()].iter_mut().zip(wide) {
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
        V::run(
            #[inline(always)]
            || {
                for block in &self.blocks {
                    let manifold = &block.manifold;
                    let [moved_a, moved_b] = block.gather(displacements);
                    let moved = manifold.twist(&moved_a, &moved_b);
                    let mut wrench = Velocity::ZERO;
                    for contact in &mut self.contacts[manifold.points()] {
                        contact.set_target(&moved, &repair);
                        contact.add_wrench(0..L, contact.impulse, &mut wrench);
                    }
                    let [mut a, mut b] = block.gather(velocities);
                    manifold.apply(&wrench, &block.masses, &mut a, &mut b);
                    block.scatter([a, b], velocities);
                }
            },
        );
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
                    let own = block.gather(velocities);
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
        V::run(
            #[inline(always)]
            || {
                for block in &self.blocks {
                    let manifold = &block.manifold;
                    let [mut a, mut b] = block.gather(velocities);
                    let points = &mut self.contacts[manifold.points()];
                    visit::<V, L, A, RIGID, FRICTION>(block.parts(), points, &mut a, &mut b);
                    block.scatter([a, b], velocities);
                }
            },
        );
    }
}

impl<V: Lanes, const L: usize, const A: usize> Block<V, L, A> {
    fn empty() -> Self {
        Self {
            lanes: 0,
            bodies: [[0; WIDTH]; 2],
            islands: [NONE; WIDTH],
            masses: [InverseMass::default(); 2],
            mobility: Mobility::default(),
            manifold: Manifold::default(),
        }
    }

    /// Puts a manifold into a lane of the block and of its points.
    fn take(
        &mut self,
        lane: usize,
        manifold: &Manifold<f32, L>,
        system: &System<f32, L, A>,
        points: &mut [Contact<V, L>],
    ) {
        if self.lanes == 0 {
            // Idle lanes read the bodies of the first, and are not written back. What a lane has
            // too few points for is so far open that it never takes an impulse.
            self.bodies = manifold.bodies.map(|body| [body; WIDTH]);
            self.masses = [InverseMass::default(); 2];
            self.manifold.frame = [Vector::ZERO; L];
            self.manifold.arms = [Vector::ZERO; 2];
            let mut open = Contact::default();
            open.gap[0] = splat(FAR);
            points.fill(open);
        }
        self.lanes += 1;
        self.manifold.friction.set(lane, manifold.friction);
        self.manifold.compliance.set(lane, manifold.compliance);
        for (wide, axis) in self.manifold.frame.iter_mut().zip(&manifold.frame) {
            set(wide, lane, axis);
        }
        for side in 0..2 {
            set(&mut self.manifold.arms[side], lane, &manifold.arms[side]);
            let body = manifold.bodies[side];
            let mass = &system.masses[body as usize];
            self.bodies[side][lane] = body;
            self.masses[side].linear.set(lane, mass.linear);
            for (wide, row) in self.masses[side].angular.0.iter_mut().zip(&mass.angular.0) {
                set(wide, lane, row);
            }
        }
        for (wide, contact) in points.iter_mut().zip(&system.contacts[manifold.points()]) {
            set(&mut wide.place, lane, &contact.place);
            set(&mut wide.gap, lane, &contact.gap);
            set(&mut wide.impulse, lane, &contact.impulse);
        }
    }

    fn parts(&self) -> Parts<'_, V, L, A> {
        (&self.manifold, &self.mobility, &self.masses)
    }

    /// Whether all its manifolds belong to islands that are done.
    fn is_done(&self, done: &[bool]) -> bool {
        let mut own = self.islands[..self.lanes].iter();
        own.all(|&island| done.get(island as usize).copied().unwrap_or(true))
    }

    #[inline(always)]
    fn gather(&self, from: &[Velocity<f32, L, A>]) -> [Velocity<V, L, A>; 2] {
        let mut out = [Velocity::ZERO; 2];
        for (bodies, out) in self.bodies.iter().zip(&mut out) {
            let mut rows = [[[0.0; 4]; WIDTH]; 2];
            for lane in 0..WIDTH {
                [rows[0][lane], rows[1][lane]] = to_rows(&from[bodies[lane] as usize]);
            }
            let [first, last] = [V::from_rows(rows[0]), V::from_rows(rows[1])];
            for i in 0..L + A {
                let number = if i < 4 { first[i] } else { last[i - 2] };
                if i < L {
                    out.linear[i] = number;
                } else {
                    out.angular[i - L] = number;
                }
            }
        }
        out
    }

    #[inline(always)]
    fn scatter(&self, velocities: [Velocity<V, L, A>; 2], to: &mut [Velocity<f32, L, A>]) {
        for (bodies, velocity) in self.bodies.iter().zip(&velocities) {
            let (mut first, mut last) = ([V::ZERO; 4], [V::ZERO; 4]);
            for i in 0..L + A {
                let number = if i < L { velocity.linear[i] } else { velocity.angular[i - L] };
                if i < 4 {
                    first[i] = number;
                }
                if i >= 2 {
                    last[i - 2] = number;
                }
            }
            let (first, last) = (V::to_rows(first), V::to_rows(last));
            for lane in 0..self.lanes {
                let body = &mut to[bodies[lane] as usize];
                for i in 0..L + A {
                    let number = if i < 4 { first[lane][i] } else { last[lane][i - 2] };
                    if i < L {
                        body.linear[i] = number;
                    } else {
                        body.angular[i - L] = number;
                    }
                }
            }
        }
    }
}

/// The numbers of a velocity, from the first and, where they are more than four, from the third.
#[inline(always)]
fn to_rows<const L: usize, const A: usize>(velocity: &Velocity<f32, L, A>) -> [Row; 2] {
    let mut rows = [[0.0; 4]; 2];
    for i in 0..L + A {
        let number = if i < L { velocity.linear[i] } else { velocity.angular[i - L] };
        if i < 4 {
            rows[0][i] = number;
        }
        if i >= 2 {
            rows[1][i - 2] = number;
        }
    }
    rows
}

fn splat<V: Lanes>(value: f32) -> V {
    V::from_array([value; WIDTH])
}

fn set<V: Lanes, const N: usize>(wide: &mut Vector<V, N>, lane: usize, of: &Vector<f32, N>) {
    for i in 0..N {
        wide[i].set(lane, of[i]);
    }
}
