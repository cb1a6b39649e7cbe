//! The passes over a packed system, block by block.
//!
//! They are most of the code that there is to compile, and it is hard to optimise. So it is compiled
//! once, with this crate, for every kind of lanes and bodies: who uses a packed system calls it through
//! [`Passes`].

use std::any::Any;
use std::fmt::Debug;

use super::block::{Block, splat};
use super::conjugate;
use super::walk::{Field, Ground, Reading};
use super::{Batch, Packed};
use crate::certificate::{Certificate, Evidence, Tally};
use crate::island::Islands;
use crate::lanes::{Lanes, PART, WIDTH, lanes_of};
use crate::team::{Shared, Team};
use crate::{Contact, Repair, Velocity};

/// Bodies that are worth as much as the least that is shared, in a certificate.
const PIECE: usize = 16;

type Velocities<const L: usize, const A: usize> = [Velocity<f32, L, A>];

/// What [`Packed`] has done to its blocks, by the names of its own methods.
pub(crate) trait Passes<V: Lanes, const L: usize, const A: usize>: Debug + Sync {
    fn prepare(&self, block: &mut Block<V, L, A>, points: &mut [Contact<V, L>], softness: f32);

    fn apply_impulses(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>);

    fn set_targets(&self, batch: &mut Batch<'_, V, L, A>, targets: &Targets<'_, V, L, A>);

    fn sweep_normals(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        targets: Option<&Targets<'_, V, L, A>>,
    );

    fn sweep(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>);

    fn relax(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>);

    fn conjugate(
        &self,
        packed: &mut Packed<V, L, A>,
        velocities: &mut Velocities<L, A>,
        done: &[bool],
    );

    /// With residuals, for the line: both as in [`Packed::certify`].
    fn certify<'a>(
        &self,
        packed: &Packed<V, L, A>,
        which: [bool; 2],
        velocities: [&Velocities<L, A>; 2],
        islands: &Islands,
        tally: &'a mut Tally<L, A>,
    ) -> &'a [Certificate];

    /// Of rigid contacts.
    fn residual(&self, packed: &Packed<V, L, A>, velocities: &Velocities<L, A>) -> f32;

    fn overlap(&self, packed: &Packed<V, L, A>) -> f32;

    fn trace(&self, batch: &mut Batch<'_, V, L, A>, displacements: &Velocities<L, A>, hold: f32);
}

/// References to `&dyn Passes<Self, L, A>`, one for each kind of bodies.
pub(crate) type Table = [&'static dyn Any; 4];

/// The [`Table`] of a type of lanes. Whatever it stands in must not be generic, nor be inlined: it is
/// where they are compiled.
macro_rules! table {
    ($lanes:ty) => {{
        use $crate::wide::passes::{Compiled, Passes};
        [
            &(&Compiled as &'static dyn Passes<$lanes, 2, 0>),
            &(&Compiled as &'static dyn Passes<$lanes, 3, 0>),
            &(&Compiled as &'static dyn Passes<$lanes, 2, 1>),
            &(&Compiled as &'static dyn Passes<$lanes, 3, 3>),
        ]
    }};
}
pub(crate) use table;

/// The passes for these lanes and bodies.
///
/// # Panics
/// There are no such bodies: neither particles nor rigid ones, in the plane nor in space.
pub(super) fn passes<V: Lanes, const L: usize, const A: usize>() -> &'static dyn Passes<V, L, A> {
    let own = V::passes().into_iter().find_map(|of| of.downcast_ref::<&dyn Passes<V, L, A>>());
    *own.expect("particles or rigid bodies, of two dimensions or three")
}

#[derive(Debug)]
pub(crate) struct Compiled;

impl<V: Lanes, const L: usize, const A: usize> Passes<V, L, A> for Compiled {
    fn prepare(&self, block: &mut Block<V, L, A>, points: &mut [Contact<V, L>], softness: f32) {
        V::run(
            #[inline(always)]
            || block.prepare(points, splat(softness)),
        );
    }

    fn apply_impulses(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>) {
        let (team, useful) = workers(batch);
        let ground = Ground::new(batch, velocities);
        team.run(useful, &|member| {
            V::run(
                #[inline(always)]
                || {
                    for mut at in ground.walk(member) {
                        let mut wrench = Velocity::ZERO;
                        for contact in at.points() {
                            contact.add_wrench(0..L, contact.impulse, &mut wrench);
                        }
                        let [mut a, mut b] = at.gather();
                        at.between();
                        at.block.manifold.apply(&wrench, &at.block.masses, &mut a, &mut b);
                        at.scatter([a, b]);
                    }
                },
            );
        });
    }

    fn set_targets(&self, batch: &mut Batch<'_, V, L, A>, targets: &Targets<'_, V, L, A>) {
        let (team, useful) = workers(batch);
        let field = Field::new(batch);
        team.run(useful, &|member| {
            V::run(
                #[inline(always)]
                || {
                    field.each_own(
                        member,
                        1,
                        #[inline(always)]
                        |_, block, points| {
                            targets.set(block, &mut points[..block.manifold.count as usize]);
                        },
                    );
                },
            );
        });
    }

    fn sweep_normals(
        &self,
        batch: &mut Batch<'_, V, L, A>,
        velocities: &mut Velocities<L, A>,
        targets: Option<&Targets<'_, V, L, A>>,
    ) {
        visit_all::<V, L, A, false, false>(batch, velocities, targets);
    }

    fn sweep(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>) {
        visit_all::<V, L, A, false, true>(batch, velocities, None);
    }

    fn relax(&self, batch: &mut Batch<'_, V, L, A>, velocities: &mut Velocities<L, A>) {
        visit_all::<V, L, A, true, true>(batch, velocities, None);
    }

    fn conjugate(
        &self,
        packed: &mut Packed<V, L, A>,
        velocities: &mut Velocities<L, A>,
        done: &[bool],
    ) {
        conjugate::iterate(packed, velocities, done);
    }

    fn certify<'a>(
        &self,
        packed: &Packed<V, L, A>,
        which: [bool; 2],
        velocities: [&Velocities<L, A>; 2],
        islands: &Islands,
        tally: &'a mut Tally<L, A>,
    ) -> &'a [Certificate] {
        match which {
            [false, false] => certify::<V, L, A, false, false>(packed, velocities, islands, tally),
            [false, true] => certify::<V, L, A, false, true>(packed, velocities, islands, tally),
            [true, false] => certify::<V, L, A, true, false>(packed, velocities, islands, tally),
            [true, true] => certify::<V, L, A, true, true>(packed, velocities, islands, tally),
        }
    }

    fn residual(&self, packed: &Packed<V, L, A>, velocities: &Velocities<L, A>) -> f32 {
        worst(
            packed,
            #[inline(always)]
            |block, points| {
                let [a, b] = block.gather_from(0, velocities);
                let twist = block.manifold.twist(&a, &b);
                let own = points.iter().map(
                    #[inline(always)]
                    |point| point.residual::<A, true>(block.manifold.friction, &twist),
                );
                own.fold(V::ZERO, |worst, own| own.max(worst))
            },
        )
    }

    fn overlap(&self, packed: &Packed<V, L, A>) -> f32 {
        worst(
            packed,
            #[inline(always)]
            |_, points| {
                let own = points.iter().map(|point| -point.gap[0]);
                own.fold(V::ZERO, |worst, own| own.max(worst))
            },
        )
    }

    fn trace(&self, batch: &mut Batch<'_, V, L, A>, displacements: &Velocities<L, A>, hold: f32) {
        let ((team, useful), first) = (workers(batch), batch.bodies.start);
        let (coloring, traces) = (batch.coloring, batch.traces);
        assert_eq!(traces.count(), coloring.all_points(), "a trace for each point");
        let field = Field::new(batch);
        team.run(useful, &|member| {
            V::run(
                #[inline(always)]
                || {
                    field.each_own(
                        member,
                        1,
                        #[inline(always)]
                        |index, block, points| {
                            if block.used == 0 {
                                return;
                            }
                            let (manifold, members) = (&block.manifold, &coloring.members[index]);
                            let [moved_a, moved_b] = block.gather_from(first, displacements);
                            let moved = manifold.twist(&moved_a, &moved_b);
                            let points = points[..manifold.count as usize].iter_mut();
                            for (point, contact) in points.enumerate() {
                                let gap = contact.gap + contact.relative_velocity(&moved);
                                contact.gap =
                                    contact.held_slip(manifold.friction, splat(hold), gap);
                                traces.put(coloring, members, point, contact);
                            }
                        },
                    );
                },
            );
        });
    }
}

/// The largest of what blocks and their points have; nothing comes of points that are not there.
#[inline(always)]
fn worst<V: Lanes, const L: usize, const A: usize>(
    packed: &Packed<V, L, A>,
    of: impl Fn(&Block<V, L, A>, &[Contact<V, L>]) -> V,
) -> f32 {
    let mut worst = V::ZERO;
    V::run(
        #[inline(always)]
        || {
            for block in packed.blocks.iter().filter(|block| block.used != 0) {
                // In this order, what is no number is passed over.
                worst = of(block, &packed.contacts[block.manifold.points()]).max(worst);
            }
        },
    );
    (0..WIDTH).map(|lane| worst.get(lane)).fold(0.0, f32::max)
}

/// Who goes over a batch, and whether they had better do it together.
fn workers<'a, V: Lanes, const L: usize, const A: usize>(
    batch: &Batch<'a, V, L, A>,
) -> (&'a Team, bool) {
    (batch.team, batch.team.is_useful(batch.size()))
}

fn visit_all<V: Lanes, const L: usize, const A: usize, const RIGID: bool, const FRICTION: bool>(
    batch: &mut Batch<'_, V, L, A>,
    velocities: &mut Velocities<L, A>,
    targets: Option<&Targets<'_, V, L, A>>,
) {
    let (team, useful) = workers(batch);
    let ground = Ground::new(batch, velocities).and(targets.map(|targets| targets.displacements));
    team.run(useful, &|member| {
        V::run(
            #[inline(always)]
            || {
                for mut at in ground.walk(member) {
                    let points = at.points();
                    if let Some(targets) = targets {
                        targets.set(at.block, points);
                    }
                    at.visit::<RIGID, FRICTION>(points);
                }
            },
        );
    });
}

fn certify<
    'a,
    V: Lanes,
    const L: usize,
    const A: usize,
    const RESIDUALS: bool,
    const LINE: bool,
>(
    packed: &Packed<V, L, A>,
    [velocities, prospective]: [&Velocities<L, A>; 2],
    islands: &Islands,
    tally: &'a mut Tally<L, A>,
) -> &'a [Certificate] {
    let (team, blocks) = (&packed.team, &packed.blocks);
    let (momenta, verdicts) = tally.start(islands.count, WIDTH * blocks.len());
    let (momenta, verdicts) = (Shared::new(0, momenta), Shared::new(0, verdicts));
    let ground = Reading::new(packed, velocities);
    team.run(team.is_useful(blocks.len()), &|member| {
        V::run(
            #[inline(always)]
            || {
                for mut at in ground.walk(member) {
                    let (block, moving, verdicts) =
                        (at.block(), at.gather(), at.of_lanes(&verdicts));
                    let points = &packed.contacts[block.manifold.points()];
                    for part in 0..WIDTH / PART {
                        let used = block.used >> (PART * part) & ((1 << PART) - 1);
                        if used == 0 {
                            continue;
                        }
                        let evidence: Evidence<V::Doubles, L, A> =
                            Evidence::of::<V, RESIDUALS, LINE>(part, &block.manifold, points, &moving);
                        for lane in lanes_of(used << (PART * part)) {
                            let own = lane % PART;
                            evidence.tell::<RESIDUALS, LINE>(own, &mut verdicts[lane]);
                            for side in 0..2 {
                                if let Some(body) = at.of_body(&momenta, side, lane) {
                                    evidence.add_momenta::<LINE>(side, own, body);
                                }
                            }
                        }
                    }
                }
            },
        );
    });
    for (index, block) in blocks.iter().enumerate() {
        for lane in lanes_of(block.used) {
            tally.add::<RESIDUALS, LINE>(block.islands[lane], WIDTH * index + lane);
        }
    }
    let (useful, share) = team.share(velocities.len(), PIECE);
    team.for_each(useful, tally.bodies(share), |bodies| {
        V::run(
            #[inline(always)]
            || bodies.share::<f32, LINE>(velocities, prospective),
        );
    });
    tally.finish::<LINE>(|body| islands.of_body[body])
}

/// What targets are set from ([`System::set_targets`](crate::System::set_targets)).
#[derive(Clone, Copy)]
pub(crate) struct Targets<'a, V: Lanes, const L: usize, const A: usize> {
    /// The number of the first body.
    first: usize,
    displacements: &'a [Velocity<f32, L, A>],
    repair: Repair<V>,
}

impl<'a, V: Lanes, const L: usize, const A: usize> Targets<'a, V, L, A> {
    pub(super) fn new(
        first: usize,
        displacements: &'a [Velocity<f32, L, A>],
        repair: &Repair<f32>,
    ) -> Self {
        Self {
            first,
            displacements,
            repair: Repair {
                dt: splat(repair.dt),
                rate: splat(repair.rate),
                slop: splat(repair.slop),
                push_speed: splat(repair.push_speed),
                hold: splat(repair.hold),
            },
        }
    }

    /// Those of the points of a block.
    #[inline(always)]
    fn set(&self, block: &Block<V, L, A>, points: &mut [Contact<V, L>]) {
        if block.center {
            self.set_felt::<0>(block, points);
        } else {
            self.set_felt::<A>(block, points);
        }
    }

    /// The same of points that feel `B` components of turning ([`Manifold::twist_felt`]).
    #[inline(always)]
    fn set_felt<const B: usize>(&self, block: &Block<V, L, A>, points: &mut [Contact<V, L>]) {
        let [a, b] = block.gather_from(self.first, self.displacements);
        let moved: Velocity<V, L, B> = block.manifold.twist_felt(&a, &b);
        for contact in points {
            contact.set_target(&moved, &self.repair);
        }
    }
}
