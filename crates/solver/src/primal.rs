//! [`PrimalProblem`]: the convex function P(v) of the velocities whose minimum solves a system,
//! with its gradient, its second derivative and a line search.
//!
//! ```text
//! P(v)     = 1/2 (v - v*) . M (v - v*) + sum phi_i(J_i v)
//! gradient = M (v - v*) - J^T r(v)                    r: response of the laws
//! H        = M + J^T (-dr/du) J                       one row of blocks per body
//! ```
//!
//! [`newton`](crate::newton) minimizes it over contacts and joints;
//! [`mechanism`](crate::mechanism) has a form of its own for joints alone.

use crate::cholesky::BlockMatrix;
use crate::law::{Cone, Interval, Law, SmoothLaw};
use crate::{Axis, Contact, InverseMass, Manifold, Mass, System, Vector, Velocity, moment};

/// Blocks of H to which a contact of a and b contributes: (a, a), (a, b), (b, b).
const PAIRS: [(usize, usize); 3] = [(0, 0), (0, 1), (1, 1)];

/// Largest number of velocity components of a body, L + A.
const MOST: usize = 6;

/// P(v) for fixed shifts of Coulomb's law.
#[derive(Clone, Debug, Default)]
pub(crate) struct PrimalProblem<const L: usize, const A: usize> {
    prospective: Vec<Velocity<f64, L, A>>,
    masses: Vec<Mass<L, A>>,
    /// Row of blocks of each body; none for fixed bodies.
    place: Vec<Option<u32>>,
    /// For each body with locked velocities: the projection onto the free ones.
    free: Vec<Option<Projection>>,
    contacts: Vec<Row<Cone<f64, L>, L>>,
    axes: Vec<Row<Interval<f64>, 1>>,
    hessian: BlockMatrix,
    /// -gradient, then the step -H^-1 gradient.
    step: Vec<f64>,
    /// The step as velocities of all bodies.
    direction: Vec<Velocity<f64, L, A>>,
    /// The rows along that direction.
    contact_lines: Vec<LawOnLine<Cone<f64, L>, L>>,
    axis_lines: Vec<LawOnLine<Interval<f64>, 1>>,
}

impl<const L: usize, const A: usize> PrimalProblem<L, A> {
    /// Builds the problem; `None` if a row is rigid without a bound.
    pub(crate) fn new(
        system: &System<f64, L, A>,
        prospective: Vec<Velocity<f64, L, A>>,
    ) -> Option<Self> {
        let mut problem = Self { prospective, ..Self::default() };
        problem.set_masses(system.masses.iter().copied());
        for manifold in &system.manifolds {
            for index in manifold.points() {
                let contact = &system.contacts[index];
                if contact.effective_mass <= 0.0 {
                    continue;
                }
                let law = Cone::of(manifold, contact);
                if law.normal <= 0.0 {
                    return None;
                }
                problem.contacts.push(Row::of_contact::<A>(manifold, contact, index, law));
            }
        }
        for joint in &system.joints {
            let bodies = joint.bodies.map(|body| body as usize);
            if !problem.add_axes(bodies, joint.axes(), &system.axes) {
                return None;
            }
        }
        let of_contacts = problem.contacts.iter().map(|row| row.bodies);
        let pairs: Vec<_> = of_contacts.chain(problem.axes.iter().map(|row| row.bodies)).collect();
        problem.connect(pairs.into_iter());
        Some(problem)
    }

    /// Sets the masses of the bodies. Only [`connect`](Self::connect) reads which of them can move.
    fn set_masses(&mut self, masses: impl Iterator<Item = InverseMass<f64, L, A>>) {
        self.masses.clear();
        self.free.clear();
        for inverse in masses {
            let mass = inverse.mass();
            self.free.push(projection(&mass, &inverse));
            self.masses.push(mass);
        }
    }

    /// Makes room for the blocks of these pairs of bodies in H.
    fn connect(&mut self, pairs: impl Iterator<Item = [usize; 2]>) {
        let mut count = 0;
        let place = self.masses.iter().map(|mass| {
            (*mass != Mass::ZERO).then(|| {
                count += 1;
                count - 1
            })
        });
        self.place = place.collect();
        let pairs = pairs.filter_map(|bodies| {
            let [a, b] = bodies.map(|body| self.place[body]);
            Some([a?, b?])
        });
        self.hessian = BlockMatrix::new(L + A, count as usize, pairs);
    }

    /// Adds rows of a joint of these bodies. Returns false if one is rigid without a bound.
    fn add_axes(
        &mut self,
        bodies: [usize; 2],
        indices: std::ops::Range<usize>,
        axes: &[Axis<f64, L, A>],
    ) -> bool {
        for index in indices {
            let axis = &axes[index];
            if axis.effective_mass <= 0.0 {
                continue;
            }
            let Some(law) = with_compliance(axis.law) else { return false };
            let jacobian = axis.jacobian.map(|jacobian| [flat(&jacobian)]);
            self.axes.push(Row { index, bodies, law, jacobian });
        }
        true
    }

    /// Updates the shifts of Coulomb's law to the velocities and impulses of the system.
    pub(crate) fn renew_shifts(&mut self, system: &System<f64, L, A>) {
        for row in &mut self.contacts {
            let r = row.law.clamp(system.contacts[row.index].impulse);
            row.law = row.law.shifted(row.velocity(&system.velocities), r);
        }
    }

    /// Sets the impulses of the system to the response to its velocities.
    pub(crate) fn answer(&self, system: &mut System<f64, L, A>) {
        for row in &self.contacts {
            let u = row.velocity(&system.velocities);
            system.contacts[row.index].impulse = row.law.response(u);
        }
        for row in &self.axes {
            let u = row.velocity(&system.velocities);
            system.axes[row.index].impulse = row.law.response(u)[0];
        }
    }

    /// Factors H and finds the step -H^-1 gradient. Returns false if H is not positive definite,
    /// which happens only with numbers that are not finite.
    pub(crate) fn factor(&mut self, velocities: &[Velocity<f64, L, A>]) -> bool {
        self.gather(velocities);
        if !self.hessian.factor() {
            return false;
        }
        self.hessian.solve(&mut self.step);
        true
    }

    /// Sets the step to -gradient, and sums H.
    fn gather(&mut self, velocities: &[Velocity<f64, L, A>]) {
        let size = L + A;
        self.step.clear();
        self.hessian.clear();
        for (body, mass) in self.masses.iter().enumerate() {
            let Some(at) = self.place[body] else { continue };
            let apart = velocities[body] - self.prospective[body];
            self.step.extend_from_slice(&flat(&(mass.momentum(&apart) * -1.0))[..size]);
            let free = self.free[body].as_ref();
            self.hessian.add(at, at, |i, j| mass_entry(mass, free, i, j));
        }
        let Self { contacts, axes, place, free, hessian, step, .. } = self;
        let mut add = |bodies: [usize; 2], terms: &dyn Fn([Option<u32>; 2]) -> PairTerms| {
            let at = bodies.map(|body| place[body]);
            let free = bodies.map(|body| free[body].as_ref());
            terms(at).add_to(hessian, step, at, free);
        };
        for rows in contacts.chunk_by(|one, next| one.bodies == next.bodies) {
            add(rows[0].bodies, &|at| PairTerms::of::<_, _, L, A>(rows, velocities, at));
        }
        for rows in axes.chunk_by(|one, next| one.bodies == next.bodies) {
            add(rows[0].bodies, &|at| PairTerms::of::<_, _, L, A>(rows, velocities, at));
        }
    }

    /// Moves the velocities along the step, as far as P falls. Returns true if that is the full
    /// step.
    pub(crate) fn descend(&mut self, velocities: &mut [Velocity<f64, L, A>]) -> bool {
        let size = L + A;
        let Self { step, place, direction, .. } = self;
        direction.clear();
        direction.extend(place.iter().map(|at| match at {
            None => Velocity::ZERO,
            Some(at) => {
                let own = &step[*at as usize * size..][..size];
                Velocity {
                    linear: Vector(std::array::from_fn(|i| own[i])),
                    angular: Vector(std::array::from_fn(|i| own[L + i])),
                }
            }
        }));
        follow(&self.contacts, velocities, direction, &mut self.contact_lines);
        follow(&self.axes, velocities, direction, &mut self.axis_lines);
        let length = self.search(velocities);
        for (velocity, direction) in velocities.iter_mut().zip(&self.direction) {
            *velocity += *direction * length;
        }
        length == 1.0
    }

    /// Returns the length of the step at which P stops falling.
    fn search(&self, velocities: &[Velocity<f64, L, A>]) -> f64 {
        let (mut constant, mut linear) = (0.0, 0.0);
        for (body, mass) in self.masses.iter().enumerate() {
            let momentum = mass.momentum(&self.direction[body]);
            constant += momentum.dot(&(velocities[body] - self.prospective[body]));
            linear += momentum.dot(&self.direction[body]);
        }
        let (contacts, axes) = (&self.contact_lines, &self.axis_lines);
        let derivative = |length: f64| {
            constant + linear * length - (work(contacts, length) + work(axes, length))
        };
        length_of_step(derivative)
    }
}

/// Returns the length of a step at which P stops falling: the zero of its `derivative`, which
/// increases with the length. It is found by secants and bisection.
pub(crate) fn length_of_step(derivative: impl Fn(f64) -> f64) -> f64 {
    let start = derivative(0.0);
    let (mut low, mut high) = (0.0, 1.0);
    let (mut at_low, mut at_high) = (start, derivative(1.0));
    // If P still falls at the full step, or has nearly stopped, the full step gives quadratic
    // convergence.
    if at_high <= 0.1 * start.abs() {
        return 1.0;
    }
    for round in 0..40 {
        let secant = low - at_low * (high - low) / (at_high - at_low);
        let middle = if round % 3 == 2 { 0.5 * (low + high) } else { secant };
        let value = derivative(middle);
        if value.abs() <= 0.05 * start.abs() {
            return middle;
        }
        if value > 0.0 {
            (high, at_high) = (middle, value);
        } else {
            (low, at_low) = (middle, value);
        }
    }
    low
}

/// A constraint of the problem.
#[derive(Clone, Debug)]
struct Row<K, const N: usize> {
    /// Index in the system.
    index: usize,
    bodies: [usize; 2],
    law: K,
    /// J_i: contribution of each body's velocities to u, with the sign of the body.
    jacobian: [[[f64; MOST]; N]; 2],
}

impl<const L: usize> Row<Cone<f64, L>, L> {
    fn of_contact<const A: usize>(
        manifold: &Manifold<f64, L>,
        contact: &Contact<f64, L>,
        index: usize,
        law: Cone<f64, L>,
    ) -> Self {
        let side = |sign: f64, anchor: Vector<f64, L>| {
            manifold.frame.axes.map(|axis| {
                let push = axis * sign;
                flat::<L, A>(&Velocity { linear: push, angular: moment(anchor, push) })
            })
        };
        let [anchor_a, anchor_b] = manifold.frame.anchors(contact.offset);
        Self {
            index,
            bodies: manifold.bodies.map(|body| body as usize),
            law,
            jacobian: [side(1.0, anchor_a), side(-1.0, anchor_b)],
        }
    }
}

impl<K, const N: usize> Row<K, N> {
    /// Returns J_i v.
    fn velocity<const L: usize, const A: usize>(
        &self,
        velocities: &[Velocity<f64, L, A>],
    ) -> Vector<f64, N> {
        let v = self.bodies.map(|body| flat(&velocities[body]));
        Vector(std::array::from_fn(|k| {
            let along = |side: usize| {
                (0..L + A).map(|i| self.jacobian[side][k][i] * v[side][i]).sum::<f64>()
            };
            along(0) + along(1)
        }))
    }
}

/// A law on a line of velocities: with u at its start, and the change of u along it.
type LawOnLine<K, const N: usize> = (K, Vector<f64, N>, Vector<f64, N>);

/// Sets the lines of all rows along a direction.
fn follow<K: Law<f64, N>, const N: usize, const L: usize, const A: usize>(
    rows: &[Row<K, N>],
    velocities: &[Velocity<f64, L, A>],
    direction: &[Velocity<f64, L, A>],
    lines: &mut Vec<LawOnLine<K, N>>,
) {
    let of = |row: &Row<K, N>| (row.law, row.velocity(velocities), row.velocity(direction));
    lines.clear();
    lines.extend(rows.iter().map(of));
}

/// Returns the work of the responses at this length of the line, per length. \[J\]
fn work<K: Law<f64, N>, const N: usize>(lines: &[LawOnLine<K, N>], length: f64) -> f64 {
    let of = |(law, u, way): &LawOnLine<K, N>| law.response_along(*u, *way, length).dot(*way);
    lines.iter().map(of).sum()
}

/// Velocity over the bound of a rigid row that gives the row its compliance in H. A bounded row may
/// be rigid: the certificate holds for it as it is. \[m/s, or rad/s\]
const YIELD: f64 = 1e-4;

/// Returns the law of a row with a compliance; `None` if it is rigid without a bound.
pub(crate) fn with_compliance(law: Interval<f64>) -> Option<Interval<f64>> {
    let most = law.bounds[1].max(-law.bounds[0]);
    let compliance = if law.compliance > 0.0 { law.compliance } else { YIELD / most };
    (compliance > 0.0).then_some(Interval { compliance, ..law })
}

/// Terms of H and of the gradient from the constraints of a pair of bodies.
struct PairTerms {
    /// Blocks of H ([`PAIRS`]).
    blocks: [[[f64; MOST]; MOST]; PAIRS.len()],
    /// J^T r of each body.
    forces: [[f64; MOST]; 2],
}

impl PairTerms {
    /// Sums the terms of bodies with these rows of blocks.
    fn of<K: SmoothLaw<N>, const N: usize, const L: usize, const A: usize>(
        rows: &[Row<K, N>],
        velocities: &[Velocity<f64, L, A>],
        at: [Option<u32>; 2],
    ) -> Self {
        let mut out = Self { blocks: [[[0.0; MOST]; MOST]; PAIRS.len()], forces: [[0.0; MOST]; 2] };
        for row in rows {
            let u = row.velocity(velocities);
            let r = row.law.response(u);
            for (force, jacobian) in out.forces.iter_mut().zip(&row.jacobian) {
                for k in 0..N {
                    for i in 0..L + A {
                        force[i] += jacobian[k][i] * r[k];
                    }
                }
            }
            let slope = row.law.slope(u);
            for (block, (p, q)) in out.blocks.iter_mut().zip(PAIRS) {
                if at[p].is_some() && at[q].is_some() {
                    add_product(block, &row.jacobian[p], &slope.0, &row.jacobian[q], L + A);
                }
            }
        }
        out
    }

    /// Adds the terms to H and to the step, as far as velocities are free.
    fn add_to(
        self,
        hessian: &mut BlockMatrix,
        step: &mut [f64],
        at: [Option<u32>; 2],
        free: [Option<&Projection>; 2],
    ) {
        let size = hessian.size();
        for ((mut force, at), free) in self.forces.into_iter().zip(at).zip(free) {
            let Some(at) = at else { continue };
            if let Some(free) = free {
                force = product(free, &[force])[0];
            }
            let all = &mut step[at as usize * size..][..size];
            all.iter_mut().zip(&force).for_each(|(all, own)| *all += own);
        }
        for (mut block, (p, q)) in self.blocks.into_iter().zip(PAIRS) {
            if let (Some(p_at), Some(q_at)) = (at[p], at[q]) {
                if let Some(free) = free[q] {
                    block = product(free, &block);
                }
                if let Some(free) = free[p] {
                    block = transposed(&product(free, &transposed(&block)));
                }
                hessian.add(p_at, q_at, |i, j| block[i][j]);
            }
        }
    }
}

fn flat<const L: usize, const A: usize>(v: &Velocity<f64, L, A>) -> [f64; MOST] {
    std::array::from_fn(|i| match i {
        _ if i < L => v.linear[i],
        _ if i < L + A => v.angular[i - L],
        _ => 0.0,
    })
}

/// A symmetric matrix that keeps the free velocities of a body and removes the locked ones.
pub(crate) type Projection = [[f64; MOST]; MOST];

/// Returns the projection M^-1 M of a body; `None` if all its velocities are free.
pub(crate) fn projection<const L: usize, const A: usize>(
    mass: &Mass<L, A>,
    inverse: &InverseMass<f64, L, A>,
) -> Option<Projection> {
    // The trace of M^-1 M is the number of free velocities.
    let mut turns = 0.0;
    for i in 0..A {
        for j in 0..A {
            turns += inverse.angular.entry(i, j) * mass.angular.entry(j, i);
        }
    }
    if mass.linear > 0.0 && turns > A as f64 - 0.5 {
        return None;
    }
    let mut free = [[0.0; MOST]; MOST];
    for (i, row) in free.iter_mut().enumerate().take(L) {
        row[i] = if mass.linear > 0.0 { 1.0 } else { 0.0 };
    }
    for i in 0..A {
        let mut along = Vector::ZERO;
        along[i] = 1.0;
        let own = inverse.angular * (mass.angular * along);
        for j in 0..A {
            free[L + j][L + i] = own[j];
        }
    }
    Some(free)
}

/// Returns the product of rows with a projection.
fn product<const N: usize>(free: &Projection, rows: &[[f64; MOST]; N]) -> [[f64; MOST]; N] {
    rows.map(|row| std::array::from_fn(|j| (0..MOST).map(|k| row[k] * free[k][j]).sum()))
}

fn transposed(of: &[[f64; MOST]; MOST]) -> [[f64; MOST]; MOST] {
    std::array::from_fn(|i| std::array::from_fn(|j| of[j][i]))
}

/// Returns an entry of a body's block of M. Locked velocities get the unit matrix, and no force.
pub(crate) fn mass_entry<const L: usize, const A: usize>(
    mass: &Mass<L, A>,
    free: Option<&Projection>,
    i: usize,
    j: usize,
) -> f64 {
    let value = match (i < L, j < L) {
        (true, true) if i == j => mass.linear,
        (false, false) => mass.angular.0[i - L][j - L],
        _ => 0.0,
    };
    let Some(free) = free else { return value };
    value + if i == j { 1.0 } else { 0.0 } - free[i][j]
}

/// Adds J_p^T slope J_q to `out`.
fn add_product<const L: usize>(
    out: &mut [[f64; MOST]; MOST],
    p: &[[f64; MOST]; L],
    slope: &[Vector<f64, L>; L],
    q: &[[f64; MOST]; L],
    size: usize,
) {
    for k in 0..L {
        let mut row = [0.0; MOST];
        for l in 0..L {
            for j in 0..size {
                row[j] += slope[k][l] * q[l][j];
            }
        }
        for i in 0..size {
            for j in 0..size {
                out[i][j] += p[k][i] * row[j];
            }
        }
    }
}
