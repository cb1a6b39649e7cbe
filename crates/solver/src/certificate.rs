//! Certificates: an a-posteriori bound on the distance of velocities from the exact solution,
//! whatever method computed them.
//!
//! # The theorem
//!
//! Let every contact have a compliance R_i > 0 ([`Law`]), and let the shifts s_i be fixed. The
//! exact velocities minimize the primal
//!
//! P(v) = 1/2 (v - v*) . M (v - v*) + sum phi_i(y_i), with y_i = t_i - s_i n - J_i v,
//!
//! where phi_i(y) is the maximum of r . y - r . R_i r / 2 over the cone K_i of contact i. For any
//! velocities v and any impulses r in the cones let
//!
//! G = 1/2 d . M d + sum (phi_i(y_i) + r_i . R_i r_i / 2 - r_i . y_i),
//! with d = v - v* - M^-1 J^T r.
//!
//! Then G >= 0, and with |x| = sqrt(x . M x):
//!
//! |v - v_exact| <= |d| / 2 + sqrt(G - |d|^2 / 4).
//!
//! The bound is sqrt(G) if the velocities follow from the impulses (d = 0), and at most sqrt(2 G).
//!
//! The proof uses of the cones only that they are closed and convex. So the theorem holds for any
//! such sets: for locks, limits, motors, friction of joints, as for contacts
//! (`tests/suite/theorem.rs`, with targets on both sides).
//!
//! # Assumptions
//!
//! - M is positive definite: every mass and moment of inertia is above 0. Infinite ones are left
//!   out of the sums. Such a body keeps v* whatever the impulses, so its d, its part of P and its
//!   error are 0.
//! - Every compliance is above 0, the tangential one too where there is friction. With R_i = 0,
//!   phi_i is infinite wherever a target is missed, and so is G.
//! - r lies in the cones; elsewhere D is -infinity. An impulse outside its cone is first projected
//!   onto it ([`Law::clamp`]).
//! - v*, t, J, R, mu and s are taken as given. The certificate does not see missed contacts, wrong
//!   arms and normals, or the overlaps behind the targets.
//! - Sums are rounded: in `f64`, of terms that are all at least 0. G is not reported below 1e-15 of
//!   its terms. The velocities and impulses themselves are `f32` and count as exact.
//! - v are the velocities that move the bodies. The later sweep that removes the velocity of
//!   overlap repair (`relax` of a world) solves another problem, and its error is not certified.
//!
//! # Proof
//!
//! 1. Each term of G is at least 0: the first is a square, the others by the definition of phi_i.
//! 2. With p = J^T r let
//!    D(r) = sum (r_i . (t_i - s_i n) - r_i . R_i r_i / 2) - p . v* - 1/2 p . M^-1 p.
//! 3. Written out, P(v) - D(r) = G: the sums of r_i . J_i v are p . v, and the remaining terms
//!    without contacts are 1/2 (v - v*) . M (v - v*) - p . (v - v*) + 1/2 p . M^-1 p = 1/2 d . M d.
//! 4. At v_exact and its impulses r_exact each term of G is 0, so P(v_exact) = D(r_exact). By 1, P
//!    is nowhere less and D nowhere more.
//! 5. The first term of P has the second derivative M, the others are convex, and at the minimum
//!    the derivative is 0. Hence P(v) >= P(v_exact) + 1/2 |e|^2, with e = v - v_exact.
//! 6. The last term of -D has the second derivative M^-1 in p. Hence
//!    D(r) <= D(r_exact) - 1/2 |e - d|^2, since M^-1 (p - p_exact) = (v - d - v*) - (v_exact - v*).
//! 7. Together: |e|^2 / 2 + |e - d|^2 / 2 <= G, that is |e - d/2|^2 + |d|^2 / 4 <= G.
//!
//! # Proven and measured quantities
//!
//! Without friction s_i = 0, and G bounds the distance to the one exact solution. With friction,
//! Coulomb's law requires s_i = mu |slip_i| of the solution itself, and no such bound is known.
//! Here G uses s_i = mu |slip_i| of the current velocities. It is 0 exactly at a solution of
//! Coulomb's law; otherwise it bounds the distance to the exact solution for these s_i.
//! [`Certificate::natural_residual`] is the residual of Coulomb's law itself.
//!
//! # Choice of impulses
//!
//! The bound holds for any impulses in the cones, not only for those that moved the bodies.
//! Impulses that distribute a load wrongly among contacts, with the same effect on the bodies,
//! would make G much too large. Therefore r also runs along a line, from the current impulses to
//! the impulses that respond to the velocities ([`Law::response`]). Along it G and |d|^2 are
//! parabolas, so the best bound costs no further pass.
//!
//! Reference for the primal and dual of soft contact: Castro, Permenter and Han, An Unconstrained
//! Convex Formulation of Compliant Contact, 2022.

use crate::island::Islands;
use crate::lanes::Doubles;
use crate::law::{Cone, Law};
use crate::mechanism::Mechanisms;
use crate::{
    Axis, Cast, Contact, InverseMass, Manifold, Mass, Real, Scalar, System, Vector, Velocity,
};

/// Quality of velocities and impulses, accumulated over some contacts and their bodies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certificate {
    /// Duality gap G. \[J\]
    pub duality_gap: f64,
    /// Part of G from velocities that the impulses do not produce: 1/2 d . M d, for the impulses of
    /// `duality_gap`. \[J\]
    pub defect: f64,
    /// Mass of all bodies \[kg\]. If all bodies have infinite mass and only rotate, their moments
    /// of inertia \[kg m^2\]; errors are then in rad/s.
    pub mass: f64,
    /// Mass of the lightest body. \[kg\]
    pub lightest: f64,
    /// Residual of the natural map of Coulomb's law, maximum over the contacts. \[m/s\]
    pub natural_residual: f64,
    /// Fastest approach beyond the target, compliance left out: the growth of an overlap in a step
    /// divided by its length. \[m/s\]
    pub approach_error: f64,
    /// Sum of |r . (R r - y)|, with y shifted for Coulomb's law; 0 at a solution. \[J\]
    pub complementarity: f64,
    /// Largest distance of an impulse from its cone, divided by the effective mass. \[m/s\]
    pub cone: f64,
}

impl Certificate {
    /// Certificate of an empty system.
    pub const NONE: Self = Self {
        duality_gap: 0.0,
        defect: 0.0,
        mass: 0.0,
        lightest: f64::INFINITY,
        natural_residual: 0.0,
        approach_error: 0.0,
        complementarity: 0.0,
        cone: 0.0,
    };

    /// Returns the bound on the error of the velocities, root mean square weighted by mass, as
    /// (|d| / 2 + sqrt(G - |d|^2 / 4)) / sqrt(m). \[m/s\]
    pub fn error(&self) -> f64 {
        self.farthest(self.mass)
    }

    /// Returns the bound on the error of any single body: as [`error`](Self::error), with the mass
    /// of the lightest body. \[m/s\]
    pub fn worst_body(&self) -> f64 {
        self.farthest(self.lightest)
    }

    fn farthest(&self, mass: f64) -> f64 {
        if self.duality_gap > 0.0 {
            reach(self.duality_gap, self.defect) / mass.sqrt()
        } else {
            0.0
        }
    }

    /// Adds the residuals of a manifold.
    fn add(&mut self, residuals: &ManifoldResiduals) {
        self.natural_residual = self.natural_residual.max(residuals.natural_residual);
        self.approach_error = self.approach_error.max(residuals.approach_error);
        self.cone = self.cone.max(residuals.cone);
        self.complementarity += residuals.complementarity;
    }
}

/// Returns |d| / 2 + sqrt(G - |d|^2 / 4) from G and the defect 1/2 |d|^2. \[sqrt(J)\]
fn reach(gap: f64, defect: f64) -> f64 {
    let half = 0.5 * defect;
    half.sqrt() + (gap - half).max(0.0).sqrt()
}

/// The parabola c + b x + a x^2 for x in 0..1 along the line of impulses.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Parabola<T> {
    a: T,
    b: T,
    c: T,
}

impl Parabola<f64> {
    fn at(&self, x: f64) -> f64 {
        self.c + x * (self.b + x * self.a)
    }

    fn add<const LINE: bool>(&mut self, other: &Self) {
        self.c += other.c;
        if LINE {
            self.b += other.b;
            self.a += other.a;
        }
    }
}

/// Number of samples on the line, besides its start.
const PLACES: u32 = 8;

/// G along the line, and its part from the defect.
#[derive(Clone, Copy, Debug, Default)]
struct Line {
    gap: Parabola<f64>,
    defect: Parabola<f64>,
}

impl Line {
    /// Returns G and the defect with the smallest bound among samples from the start of the line to
    /// the minimum of G.
    fn best(&self) -> [f64; 2] {
        let Parabola { a, b, .. } = self.gap;
        let least = if a > 0.0 { (-0.5 * b / a).clamp(0.0, 1.0) } else { 0.0 };
        let start = self.at(0.0);
        if least == 0.0 {
            return start;
        }
        let reach = |[gap, defect]: [f64; 2]| reach(gap, defect);
        let places = (1..=PLACES).map(|part| self.at(least * f64::from(part) / f64::from(PLACES)));
        places.fold(start, |best, other| if reach(other) < reach(best) { other } else { best })
    }

    fn at(&self, x: f64) -> [f64; 2] {
        let gap = self.gap.at(x);
        // A rigid contact that misses its target responds with an infinite impulse.
        if gap.is_nan() {
            return [f64::INFINITY, 0.0];
        }
        // Rounding leaves at least this much of the terms, and may leave less than nothing.
        let gap = gap.max(1e-15 * self.gap.c).max(0.0);
        [gap, self.defect.at(x).clamp(0.0, gap)]
    }
}

/// Contribution of a manifold to the certificate of its island.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ManifoldResiduals {
    line: Parabola<f64>,
    natural_residual: f64,
    approach_error: f64,
    complementarity: f64,
    cone: f64,
}

/// J^T r of a body: at the start of the line, and its change along the line.
pub(crate) type Momenta<const L: usize, const A: usize> = [Velocity<f64, L, A>; 2];

/// Contribution of the points of one manifold, or of several manifolds side by side in lanes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ManifoldTerms<T: Real, const L: usize, const A: usize> {
    line: Parabola<T>,
    natural_residual: T,
    approach_error: T,
    complementarity: T,
    cone: T,
    /// Momentum that a gains and b loses ([`ConstraintFrame::momenta`]): from the impulses at the start of
    /// the line, and from their change along the line.
    momenta: [[Velocity<T, L, A>; 2]; 2],
}

impl<T: Real, const L: usize, const A: usize> ManifoldTerms<T, L, A> {
    const NONE: Self = Self {
        line: Parabola { a: T::ZERO, b: T::ZERO, c: T::ZERO },
        natural_residual: T::ZERO,
        approach_error: T::ZERO,
        complementarity: T::ZERO,
        cone: T::ZERO,
        momenta: [[Velocity::ZERO; 2]; 2],
    };

    /// Evaluates one [`part`](Cast::part) of the points, on bodies that move at `velocities`.
    /// Without `RESIDUALS` it evaluates G alone; without `LINE`, the start of the line alone.
    #[inline(always)]
    pub(crate) fn of<U: Real + Cast<T>, const RESIDUALS: bool, const LINE: bool>(
        part: usize,
        manifold: &Manifold<U, L>,
        points: &[Contact<U, L>],
        velocities: &[Velocity<U, L, A>; 2],
    ) -> Self {
        let manifold = &manifold.part(part);
        let [a, b] = velocities;
        let twist = manifold.frame.twist(&a.part(part), &b.part(part));
        let mut wrenches = [Velocity::ZERO; 2];
        let mut terms = Self::NONE;
        for contact in points {
            let contact = contact.part(part);
            let (u, law) = (contact.relative_velocity(&twist), Cone::of(manifold, &contact));
            let inside = law.clamp(contact.impulse);
            if RESIDUALS {
                terms.add_residuals(&law, &contact, u, inside);
            }
            // The response of a rigid contact is not finite, so its line is the start alone. A
            // contact that nothing can move contributes nothing.
            let mass = contact.effective_mass;
            let soft = law.normal.choose(mass, T::ZERO);
            let law = law.shifted(u, inside);
            let [start, way] = terms.add_line::<L, LINE>(&law, [mass, soft], u, inside);
            contact.add_wrench(0..L, start, &mut wrenches[0]);
            if LINE {
                contact.add_wrench(0..L, way, &mut wrenches[1]);
            }
        }
        terms.momenta[0] = manifold.frame.momenta(&wrenches[0]);
        if LINE {
            terms.momenta[1] = manifold.frame.momenta(&wrenches[1]);
        }
        terms
    }

    /// Evaluates the rows of a joint of bodies that move at `velocities`, as [`of`](Self::of).
    pub(crate) fn of_joint(axes: &[Axis<T, L, A>], [a, b]: &[Velocity<T, L, A>; 2]) -> Self {
        let mut terms = Self::NONE;
        for axis in axes {
            let (mass, law) = (axis.effective_mass, axis.law);
            let (u, inside) = (Vector([axis.velocity(a, b)]), axis.inside());
            let residual = axis.residual::<false>(u[0]);
            terms.natural_residual = terms.natural_residual.max(residual);
            let out = absolute(axis.impulse - inside[0]) / mass;
            terms.cone = terms.cone.max(mass.choose(out, T::ZERO));
            let work = absolute(inside.dot(law.missing(u, inside)));
            terms.complementarity += mass.choose(work, T::ZERO);
            let soft = law.compliance.choose(mass, T::ZERO);
            let [start, way] = terms.add_line::<1, true>(&law, [mass, soft], u, inside);
            let [to_a, to_b] = &axis.jacobian;
            for (momenta, impulse) in terms.momenta.iter_mut().zip([start[0], way[0]]) {
                momenta[0] += *to_a * impulse;
                momenta[1] -= *to_b * impulse;
            }
        }
        terms
    }

    /// Adds the residuals of a contact at the relative velocity `u`, with its impulse `r` in the
    /// cone.
    #[inline(always)]
    fn add_residuals(
        &mut self,
        law: &Cone<T, L>,
        contact: &Contact<T, L>,
        u: Vector<T, L>,
        r: Vector<T, L>,
    ) {
        let [mass, across] = [contact.effective_mass, contact.tangential_mass];
        let y = contact.target - u;
        let mut w = law.soften(r) - y;
        let mut stepped = r - w * across;
        stepped[0] = r[0];
        let slip = (law.clamp(stepped) - r).length() / across;
        let natural_residual = absolute((r[0] / mass).min(w[0])).max(across.choose(slip, T::ZERO));
        w[0] += law.shift(u, r);
        self.natural_residual = self.natural_residual.max(mass.choose(natural_residual, T::ZERO));
        self.approach_error = self.approach_error.max(mass.choose(y[0], T::ZERO));
        self.cone = self.cone.max(mass.choose((contact.impulse - r).length() / mass, T::ZERO));
        self.complementarity += mass.choose(absolute(r.dot(w)), T::ZERO);
    }

    /// Adds the terms of G of a constraint at the relative velocity `u`, with its impulse `r` in K.
    /// Returns the impulse at the start of the line, and its change along the line. The constraint
    /// takes part if its `mass` is positive, and has a line if that of `soft` is.
    #[inline(always)]
    fn add_line<const N: usize, const LINE: bool>(
        &mut self,
        law: &impl Law<T, N>,
        [mass, soft]: [T; 2],
        u: Vector<T, N>,
        r: Vector<T, N>,
    ) -> [Vector<T, N>; 2] {
        let start = r.only_if(mass);
        self.line.c += mass.choose(law.loss(u, r), T::ZERO);
        if !LINE {
            return [start, Vector::ZERO];
        }
        let soft = law.is_parabola(u, r).choose(soft, T::ZERO);
        let way = (law.response(u) - r).only_if(soft);
        let half = T::from_f64(0.5);
        self.line.b -= soft.choose(way.dot(law.missing(u, r)), T::ZERO);
        self.line.a += soft.choose(half * way.dot(law.soften(way)), T::ZERO);
        [start, way]
    }
}

impl<T: Doubles, const L: usize, const A: usize> ManifoldTerms<T, L, A> {
    /// Copies the contribution of one lane into `to`.
    #[inline(always)]
    pub(crate) fn tell<const RESIDUALS: bool, const LINE: bool>(
        &self,
        lane: usize,
        to: &mut ManifoldResiduals,
    ) {
        to.line.c = self.line.c.get(lane);
        if LINE {
            to.line.a = self.line.a.get(lane);
            to.line.b = self.line.b.get(lane);
        }
        if RESIDUALS {
            to.natural_residual = self.natural_residual.get(lane);
            to.approach_error = self.approach_error.get(lane);
            to.complementarity = self.complementarity.get(lane);
            to.cone = self.cone.get(lane);
        }
    }

    /// Adds the momentum of the body on one side of a lane; without `LINE`, that of the start
    /// alone.
    #[inline(always)]
    pub(crate) fn add_momenta<const LINE: bool>(
        &self,
        side: usize,
        lane: usize,
        body: &mut Momenta<L, A>,
    ) {
        // The momentum that a gains, b loses.
        let sign = if side == 0 { 1.0 } else { -1.0 };
        for (own, added) in body.iter_mut().zip(&self.momenta).take(1 + usize::from(LINE)) {
            for i in 0..L {
                own.linear[i] += sign * added[side].linear[i].get(lane);
            }
            for i in 0..A {
                own.angular[i] += sign * added[side].angular[i].get(lane);
            }
        }
    }
}

#[inline(always)]
fn absolute<T: Real>(x: T) -> T {
    x.max(-x)
}

/// Computes the certificate of a solved system, where `prospective` are the velocities without its
/// impulses.
///
/// Makes one pass over the contacts and one over the bodies, in their order, in `f64`. If a rigid
/// contact (compliance 0) misses its target the gap is infinite: nothing is proven.
pub fn certify<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    prospective: &[Velocity<T, L, A>],
) -> Certificate {
    let mut scratch = CertificateScratch::default();
    scratch.set_masses(system);
    scratch.certify(system, prospective)
}

/// Buffers that accumulate certificates per island, kept between calls.
#[derive(Clone, Debug, Default)]
pub struct CertificateScratch<const L: usize, const A: usize> {
    masses: Vec<(Mass<L, A>, InverseMass<f64, L, A>)>,
    /// One per body; 0 between calls.
    momenta: Vec<Momenta<L, A>>,
    /// Contribution of each manifold; `shares` holds that of each body.
    residuals_of: Vec<ManifoldResiduals>,
    shares: Vec<Parabola<f64>>,
    lines: Vec<Line>,
    certificates: Vec<Certificate>,
    /// Island and contribution of each joint, until the next certificates.
    of_joints: Vec<(u32, ManifoldResiduals)>,
}

impl<const L: usize, const A: usize> CertificateScratch<L, A> {
    /// Stores the mass matrices of the bodies of a system.
    pub fn set_masses<T: Scalar>(&mut self, system: &System<T, L, A>) {
        self.masses.clear();
        self.masses.extend(system.masses.iter().map(|mass| (mass.mass(), mass.cast())));
    }

    /// Updates the mass matrices of bodies whose inverse masses have changed because they turned.
    pub fn retake_masses<T: Scalar>(&mut self, system: &System<T, L, A>) {
        for (known, mass) in self.masses.iter_mut().zip(&system.masses) {
            let inverse = mass.cast();
            if known.1 != inverse {
                *known = (mass.mass(), inverse);
            }
        }
    }

    /// Finds the mass \[kg\] and the root-mean-square speed \[m/s\] of each island, in the measure
    /// of [`Certificate::error`].
    pub(crate) fn find_speeds<T: Scalar>(
        &self,
        velocities: &[Velocity<T, L, A>],
        islands: &Islands,
        [masses, speeds]: [&mut Vec<f64>; 2],
    ) {
        for of_islands in [&mut *masses, &mut *speeds] {
            of_islands.clear();
            of_islands.resize(islands.count, 0.0);
        }
        for (((mass, _), velocity), &island) in
            self.masses.iter().zip(velocities).zip(&islands.of_body)
        {
            if let Some(speed) = speeds.get_mut(island as usize) {
                *speed += mass.squared(&velocity.cast());
                mass.add_measure(&mut masses[island as usize]);
            }
        }
        for (speed, mass) in speeds.iter_mut().zip(masses) {
            *mass = mass.abs();
            *speed = (*speed / *mass).sqrt();
        }
    }

    /// Returns the [errors](Certificate::error) of the last certificates, evaluated for the current
    /// impulses (the start of the line). \[m/s\]
    pub(crate) fn errors_at_hand(&self) -> impl Iterator<Item = f64> {
        let islands = self.certificates.iter().zip(&self.lines);
        islands.map(|(of, line)| {
            let [gap, defect] = line.at(0.0);
            Certificate { duality_gap: gap, defect, ..*of }.error()
        })
    }

    /// Computes [`certify`] with the stored masses.
    pub fn certify<T: Scalar>(
        &mut self,
        system: &System<T, L, A>,
        prospective: &[Velocity<T, L, A>],
    ) -> Certificate {
        let count = system.manifolds.len() + system.joints.len();
        let (momenta, residuals_of) = self.start(1, count);
        let (of_manifolds, of_joints) = residuals_of.split_at_mut(system.manifolds.len());
        for (manifold, residuals) in system.manifolds.iter().zip(of_manifolds) {
            let points = &system.contacts[manifold.points()];
            let velocities = system.velocities_of(manifold);
            let terms: ManifoldTerms<f64, L, A> =
                ManifoldTerms::of::<T, true, true>(0, manifold, points, &velocities);
            terms.tell::<true, true>(0, residuals);
            for (side, body) in manifold.bodies.into_iter().enumerate() {
                terms.add_momenta::<true>(side, 0, &mut momenta[body as usize]);
            }
        }
        for (joint, residuals) in system.joints.iter().zip(of_joints) {
            let axes: Vec<_> = system.axes[joint.axes()].iter().map(Axis::cast).collect();
            let velocities =
                joint.bodies.map(|body| system.velocities[body as usize].cast::<f64>());
            let terms = ManifoldTerms::of_joint(&axes, &velocities);
            terms.tell::<true, true>(0, residuals);
            for (side, body) in joint.bodies.into_iter().enumerate() {
                terms.add_momenta::<true>(side, 0, &mut momenta[body as usize]);
            }
        }
        (0..count).for_each(|constraint| self.add::<true, true>(0, constraint));
        for bodies in self.bodies(system.masses.len()) {
            bodies.share::<T, true>(&system.velocities, prospective);
        }
        self.finish::<true>(|_| 0)[0]
    }

    /// Adds the contributions of joints to the next certificates of islands.
    pub(crate) fn add_joints<const LINE: bool>(
        &mut self,
        mechanisms: &Mechanisms<L, A>,
        velocities: &[Velocity<f32, L, A>],
        islands: &Islands,
    ) {
        self.of_joints.clear();
        if mechanisms.is_empty() {
            return;
        }
        self.momenta.resize(self.masses.len(), [Velocity::ZERO; 2]);
        let joints = mechanisms.joints.iter().map(|joint| (islands.of_pair(joint.bodies), joint));
        for (island, joint) in joints.filter(|(island, _)| (*island as usize) < islands.count) {
            let own = joint.bodies.map(|body| velocities[body as usize].cast::<f64>());
            let axes = &mechanisms.axes[joint.axes()];
            let terms = ManifoldTerms::of_joint(axes, &own);
            let mut residuals = ManifoldResiduals::default();
            terms.tell::<true, LINE>(0, &mut residuals);
            for (side, body) in joint.bodies.into_iter().enumerate() {
                terms.add_momenta::<LINE>(side, 0, &mut self.momenta[body as usize]);
            }
            self.of_joints.push((island, residuals));
        }
    }

    /// Clears the sums for this many islands and manifolds, except for what joints have added. Returns the momenta of all bodies, to
    /// be added to, and the contributions of the manifolds, to be filled in.
    pub(crate) fn start(
        &mut self,
        islands: usize,
        manifolds: usize,
    ) -> (&mut [Momenta<L, A>], &mut [ManifoldResiduals]) {
        self.lines.clear();
        self.lines.resize(islands, Line::default());
        self.certificates.clear();
        self.certificates.resize(islands, Certificate::NONE);
        for (island, residuals) in self.of_joints.drain(..) {
            if let Some(certificate) = self.certificates.get_mut(island as usize) {
                certificate.add(&residuals);
                self.lines[island as usize].gap.add::<true>(&residuals.line);
            }
        }
        self.momenta.resize(self.masses.len(), [Velocity::ZERO; 2]);
        self.residuals_of.resize(manifolds, ManifoldResiduals::default());
        (&mut self.momenta, &mut self.residuals_of)
    }

    /// Adds the contribution of a manifold to its island.
    #[inline(always)]
    pub(crate) fn add<const RESIDUALS: bool, const LINE: bool>(
        &mut self,
        island: u32,
        manifold: usize,
    ) {
        let residuals = &self.residuals_of[manifold];
        let Some(certificate) = self.certificates.get_mut(island as usize) else { return };
        if RESIDUALS {
            certificate.add(residuals);
        }
        self.lines[island as usize].gap.add::<LINE>(&residuals.line);
    }

    /// Splits the bodies into ranges of `count`.
    pub(crate) fn bodies(
        &mut self,
        count: usize,
    ) -> impl Iterator<Item = BodyRange<'_, L, A>> + Send {
        self.shares.resize(self.masses.len(), Parabola::default());
        let (count, Self { masses, momenta, shares, .. }) = (count.max(1), self);
        let chunks = masses.chunks(count).zip(momenta.chunks_mut(count)).enumerate();
        chunks.zip(shares.chunks_mut(count)).map(move |((part, (masses, momenta)), shares)| {
            BodyRange { first: count * part, masses, momenta, shares }
        })
    }

    /// Returns the certificates after all manifolds and bodies have been added. `island` returns
    /// the island of a body; an index beyond the islands excludes the body.
    pub(crate) fn finish<const LINE: bool>(
        &mut self,
        island: impl Fn(usize) -> u32,
    ) -> &[Certificate] {
        for (body, ((mass, _), share)) in self.masses.iter().zip(&self.shares).enumerate() {
            let island = island(body) as usize;
            let Some(certificate) = self.certificates.get_mut(island) else { continue };
            let line = &mut self.lines[island];
            line.gap.add::<LINE>(share);
            line.defect.add::<LINE>(share);
            mass.add_measure(&mut certificate.mass);
            if mass.linear > 0.0 {
                certificate.lightest = certificate.lightest.min(mass.linear);
            }
        }
        for (certificate, line) in self.certificates.iter_mut().zip(&self.lines) {
            certificate.mass = certificate.mass.abs();
            [certificate.duality_gap, certificate.defect] = line.best();
        }
        &self.certificates
    }
}

/// A contiguous range of bodies, and their contributions to the line.
pub(crate) struct BodyRange<'a, const L: usize, const A: usize> {
    first: usize,
    masses: &'a [(Mass<L, A>, InverseMass<f64, L, A>)],
    momenta: &'a mut [Momenta<L, A>],
    shares: &'a mut [Parabola<f64>],
}

impl<const L: usize, const A: usize> BodyRange<'_, L, A> {
    /// Computes the contributions from all velocities, and resets the momenta to 0.
    #[inline(always)]
    pub(crate) fn share<T: Scalar, const LINE: bool>(
        self,
        velocities: &[Velocity<T, L, A>],
        prospective: &[Velocity<T, L, A>],
    ) {
        let Self { first, masses, momenta, shares } = self;
        let velocities = velocities[first..].iter().zip(&prospective[first..]);
        let bodies = masses.iter().zip(momenta).zip(shares);
        for ((((mass, inverse), momenta), share), (velocity, prospective)) in bodies.zip(velocities)
        {
            let [start, way] = &std::mem::replace(momenta, [Velocity::ZERO; 2]);
            let d = velocity.cast() - prospective.cast() - inverse.velocity(start);
            share.c = 0.5 * mass.squared(&d);
            if LINE {
                share.b = -d.dot(way);
                share.a = 0.5 * way.dot(&inverse.velocity(way));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gap that rounding leaves below zero counts as zero, and does not panic.
    #[test]
    fn a_gap_of_rounding_errors_is_nothing() {
        let of = |c| Parabola { a: 0.0, b: 0.0, c };
        let line = Line { gap: of(-8.6e-33), defect: of(1e-20) };
        assert_eq!(line.best(), [0.0; 2]);
    }
}
