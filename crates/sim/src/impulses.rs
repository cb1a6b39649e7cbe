//! Impulses of contacts, summed over the substeps of a step.

use std::ops::Range;

use drystone_solver::{Contact, System, Vector, Velocity};

/// Normal impulses of several contact points.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ImpulseSum<const L: usize> {
    /// Sum of the impulses. \[N s\]
    pub(crate) impulse: f32,
    /// Sum of the world positions, each times its impulse. \[N s m\]
    place: Vector<f32, L>,
    /// Sum of the normals, each times its impulse. \[N s\]
    normal: Vector<f32, L>,
    /// Largest approach speed at a point with an impulse, before the step. \[m/s\]
    pub(crate) speed: f32,
}

impl<const L: usize> ImpulseSum<L> {
    fn add(&mut self, other: &Self) {
        self.impulse += other.impulse;
        self.place += other.place;
        self.normal += other.normal;
        self.speed = self.speed.max(other.speed);
    }

    /// Returns the mean of the positions, weighted by the impulses. \[m\]
    pub(crate) fn point(&self) -> Vector<f32, L> {
        self.place * (1.0 / self.impulse)
    }

    /// Returns the unit normal; zero if normals cancel.
    pub(crate) fn normal(&self) -> Vector<f32, L> {
        let length = self.normal.length();
        if length > 0.0 { self.normal * (1.0 / length) } else { Vector::ZERO }
    }
}

/// Impulses between two colliders.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairSum<const L: usize> {
    pub(crate) colliders: [u32; 2],
    pub(crate) bodies: [u32; 2],
    pub(crate) sum: ImpulseSum<L>,
}

/// Impulses that a step records.
#[derive(Debug, Default)]
pub(crate) struct ImpulseRecord<const L: usize, const A: usize> {
    /// Velocities before the step.
    pub(crate) before: Vec<Velocity<f32, L, A>>,
    /// Sums of each manifold over the substeps of a part, without their places.
    pub(crate) manifolds: Vec<ImpulseSum<L>>,
    /// Sum of the normal impulses of each contact point over these substeps. \[N s\]
    pub(crate) contacts: Vec<f32>,
    /// Sums of pairs of colliders over the step, sorted by colliders after it.
    pub(crate) pairs: Vec<PairSum<L>>,
}

impl<const L: usize, const A: usize> ImpulseRecord<L, A> {
    /// Adds impulses of the contacts \[N s\]: those of a substep, or of the impacts in a part.
    pub(crate) fn add(&mut self, system: &System<f32, L, A>, of: impl Fn(&Contact<f32, L>) -> f32) {
        self.manifolds.resize(system.manifolds.len(), ImpulseSum::default());
        self.contacts.resize(system.contacts.len(), 0.0);
        let before = |body: u32| self.before.get(body as usize).copied().unwrap_or_default();
        for (own, manifold) in self.manifolds.iter_mut().zip(&system.manifolds) {
            let normal = manifold.frame.axes[0];
            for index in manifold.points() {
                let contact = &system.contacts[index];
                let impulse = of(contact);
                if impulse <= 0.0 {
                    continue;
                }
                self.contacts[index] += impulse;
                let [a, b] = manifold.bodies;
                let [arm_a, arm_b] = manifold.frame.anchors(contact.offset);
                let speed = -(before(a).at(arm_a) - before(b).at(arm_b)).dot(normal);
                let (speed, normal) = (speed.max(0.0), normal * impulse);
                own.add(&ImpulseSum { impulse, place: Vector::ZERO, normal, speed });
            }
        }
    }

    /// Adds the sum of the manifolds of a pair to the pairs. `points` are the indices of its
    /// contact points, with their world positions \[m\].
    pub(crate) fn add_pair(
        &mut self,
        [colliders, bodies]: [[u32; 2]; 2],
        manifolds: Range<usize>,
        points: impl Iterator<Item = (usize, Vector<f32, L>)>,
    ) {
        let mut sum = ImpulseSum::default();
        self.manifolds[manifolds].iter().for_each(|own| sum.add(own));
        sum.place = points.fold(Vector::ZERO, |sum, (index, point)| {
            sum + point * self.contacts.get(index).copied().unwrap_or(0.0)
        });
        self.pairs.push(PairSum { colliders, bodies, sum });
    }

    /// Sums the pairs over the parts of the step.
    pub(crate) fn join(&mut self) {
        self.pairs.sort_by_key(|pair| pair.colliders);
        self.pairs.dedup_by(|later, first| {
            let same = later.colliders == first.colliders;
            if same {
                first.sum.add(&later.sum);
            }
            same
        });
    }

    /// Returns the sum of a pair of colliders after a step.
    pub(crate) fn of(&self, colliders: [u32; 2]) -> Option<&ImpulseSum<L>> {
        let at = self.pairs.binary_search_by_key(&colliders, |pair| pair.colliders).ok()?;
        Some(&self.pairs[at].sum)
    }
}
