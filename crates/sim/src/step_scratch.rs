//! [`StepScratch`]: buffers that the stages of a step share.

use drystone_solver::{InverseMass, Velocity};

use crate::balance::Balance;
use crate::bodies::SpinState;
use crate::cache::{ManifoldCache, Pair};
use crate::geometry::Geometry;
use crate::impulses::ImpulseRecord;
use crate::ledger::LedgerBuilder;
use crate::narrow_phase::PairWorker;
use crate::patches::Patches;
use crate::seams::SeamResolver;
use crate::travel::TravelBounds;

/// Buffers of a step. No later step reads them.
pub(crate) struct StepScratch<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) fresh_pairs: Vec<Pair>,
    pub(crate) old_cache: ManifoldCache<L>,
    /// By body: true if it may touch something new.
    pub(crate) active: Vec<bool>,
    pub(crate) travel: TravelBounds<L>,
    pub(crate) workers: Vec<PairWorker<G, L, A>>,
    pub(crate) seams: SeamResolver<L>,
    pub(crate) patches: Patches<L>,
    /// Velocities of a substep without the impulses of its contacts.
    pub(crate) prospective: Vec<Velocity<f32, L, A>>,
    /// Displacements since the last contact search.
    pub(crate) displacements: Vec<Velocity<f32, L, A>>,
    /// Velocities that [standing springs](crate::joint::rows) give to bodies in a substep, if there are
    /// joints.
    pub(crate) standing_gains: Vec<Velocity<f32, L, A>>,
    /// Bodies of which contacts and joints take turns in a substep, if there are joints.
    pub(crate) unsettled: Vec<bool>,
    /// Displacements of a substep before bodies move, where contacts of bodies with joints need them
    /// ([`Lead`](drystone_solver::lanes::Lead)).
    pub(crate) offsets: Vec<Velocity<f32, L, A>>,
    /// Velocities at the start of the substep, for the same contacts.
    pub(crate) before: Vec<Velocity<f32, L, A>>,
    /// Velocity changes by forces, in a substep in which bodies may bounce.
    pub(crate) force_gains: Vec<Velocity<f32, L, A>>,
    /// Velocities, v*, displacements and gains by contacts at the start of a substep, if there are joints.
    pub(crate) start: [Vec<Velocity<f32, L, A>>; 4],
    pub(crate) part: PartStart<G, L, A>,
    /// M^-1 of the bodies when the rows of their contacts were read last, if there are joints; and by body:
    /// true if it is another now.
    pub(crate) read_masses: Vec<InverseMass<f32, L, A>>,
    pub(crate) renewed: Vec<bool>,
    /// By body: true if it is dynamic and has contacts, and if it has any with a body to which it is not joined.
    pub(crate) touched: Vec<[bool; 2]>,
    pub(crate) ledger: LedgerBuilder<L, A>,
    /// Normal impulses of the last step, if they are recorded.
    pub(crate) impulses: ImpulseRecord<L, A>,
}

/// The bodies at the start of a part that may be taken back.
pub(crate) struct PartStart<G: Geometry<L, A>, const L: usize, const A: usize> {
    pub(crate) poses: Vec<G::Pose>,
    pub(crate) velocities: Vec<Velocity<f32, L, A>>,
    pub(crate) contact_gains: Vec<Velocity<f32, L, A>>,
    pub(crate) balances: Vec<Balance<L, A>>,
    pub(crate) inverse_masses: Vec<InverseMass<f32, L, A>>,
    pub(crate) spin_states: Vec<SpinState<A>>,
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Default for PartStart<G, L, A> {
    fn default() -> Self {
        Self {
            poses: Vec::new(),
            velocities: Vec::new(),
            contact_gains: Vec::new(),
            balances: Vec::new(),
            inverse_masses: Vec::new(),
            spin_states: Vec::new(),
        }
    }
}

impl<G: Geometry<L, A>, const L: usize, const A: usize> Default for StepScratch<G, L, A> {
    fn default() -> Self {
        Self {
            fresh_pairs: Vec::new(),
            old_cache: ManifoldCache::default(),
            active: Vec::new(),
            travel: TravelBounds::default(),
            workers: Vec::new(),
            seams: SeamResolver::default(),
            patches: Patches::default(),
            prospective: Vec::new(),
            displacements: Vec::new(),
            standing_gains: Vec::new(),
            unsettled: Vec::new(),
            offsets: Vec::new(),
            before: Vec::new(),
            force_gains: Vec::new(),
            start: Default::default(),
            part: PartStart::default(),
            read_masses: Vec::new(),
            renewed: Vec::new(),
            touched: Vec::new(),
            ledger: LedgerBuilder::default(),
            impulses: ImpulseRecord::default(),
        }
    }
}
