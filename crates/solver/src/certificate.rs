//! How far velocities can be from the exact ones: a bound that holds whatever method made them.
//!
//! # The theorem
//!
//! Let every contact have compliance R_i > 0 ([`Law`]), and let s_i be fixed. The exact velocities
//! are the minimum of the primal
//!
//! P(v) = 1/2 (v - v*) . M (v - v*) + sum phi_i(y_i), with y_i = t_i - s_i n - J_i v,
//!
//! where phi_i(y) is the largest r . y - r . R_i r / 2 over the cone K_i of contact i. For any
//! velocities v and any impulses r of the cones let
//!
//! G = 1/2 d . M d + sum (phi_i(y_i) + r_i . R_i r_i / 2 - r_i . y_i), with d = v - v* - M^-1 J^T r.
//!
//! Then G >= 0, and 1/2 (v - v_exact) . M (v - v_exact) <= G.
//!
//! # The proof
//!
//! 1. Each term of G is at least 0: the first is a square, the others by the definition of phi_i.
//! 2. Let D(r) = sum (r_i . (t_i - s_i n) - r_i . R_i r_i / 2) - p . v* - 1/2 p . M^-1 p, p = J^T r.
//! 3. Written out, P(v) - D(r) = G: the sums of r_i . J_i v are p . v, and the rest of the terms
//!    without contacts is 1/2 (v - v*) . M (v - v*) - p . (v - v*) + 1/2 p . M^-1 p = 1/2 d . M d.
//! 4. So by 1, for any two, P(v) >= D(r); with v_exact for v: D(r) <= P(v_exact).
//! 5. The first term of P has second derivative M, and the others are convex; at the minimum the
//!    derivative is 0: P(v) >= P(v_exact) + 1/2 (v - v_exact) . M (v - v_exact).
//! 6. Together: 1/2 (v - v_exact) . M (v - v_exact) <= P(v) - P(v_exact) <= P(v) - D(r) = G.
//!
//! # What is proven, and what is measured
//!
//! Without friction s_i = 0, and G bounds the distance to the one exact answer. With friction
//! Coulomb's law asks for s_i = mu |slip_i| of the answer itself, and no such bound is known. G is
//! taken with s_i = mu |slip_i| of the velocities at hand: it is 0 exactly at a solution of
//! Coulomb's law, and otherwise bounds the distance to the exact answer for these s_i.
//! [`Certificate::natural`] is the residual of Coulomb's law itself.
//!
//! # Which impulses
//!
//! G holds for any impulses of the cones, so they need not be those that moved the bodies. Impulses that
//! share a load wrongly among contacts, to the same effect, would make it much too large. The least G
//! on the line from the impulses r at hand to those that answer the velocities is as cheap: along it
//! G is a parabola.
//!
//! Reference for the primal and dual of soft contact: Castro, Permenter and Han, An Unconstrained
//! Convex Formulation of Compliant Contact, 2022.

use crate::cone::Law;
use crate::{Manifold, Scalar, System, Vector, Velocity};

/// How good velocities and impulses are; sums over some contacts and the bodies that they touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certificate {
    /// G. \[J\]
    pub gap: f64,
    /// The part of G from velocities that the impulses do not give: 1/2 d . M d. \[J\]
    pub defect: f64,
    /// Mass of all bodies. \[kg\]
    pub mass: f64,
    /// Mass of the lightest body. \[kg\]
    pub lightest: f64,
    /// Natural map of Coulomb's law, the worst of any contact. \[m/s\]
    pub natural: f64,
    /// Fastest approach beyond the target, compliance left out: what a step adds to an overlap,
    /// over its length. \[m/s\]
    pub sinking: f64,
    /// Sum of |r . (R r - y)|: the work of contacts on velocities that they should not see. \[J\]
    pub complementarity: f64,
    /// Farthest that an impulse is outside its cone, over its effective mass. \[m/s\]
    pub cone: f64,
}

impl Certificate {
    /// Of nothing.
    pub const NONE: Self = Self {
        gap: 0.0,
        defect: 0.0,
        mass: 0.0,
        lightest: f64::INFINITY,
        natural: 0.0,
        sinking: 0.0,
        complementarity: 0.0,
        cone: 0.0,
    };

    /// sqrt(2 G / m): the root mean square of how far the velocities of the bodies can be from the
    /// exact ones, weighted by mass. \[m/s\]
    pub fn error(&self) -> f64 {
        if self.gap > 0.0 { (2.0 * self.gap / self.mass).sqrt() } else { 0.0 }
    }

    /// sqrt(2 G / m_b) of the lightest body: how far any one body can be. \[m/s\]
    pub fn worst_body(&self) -> f64 {
        if self.gap > 0.0 { (2.0 * self.gap / self.lightest).sqrt() } else { 0.0 }
    }

    /// Adds a contact that misses its target by `y` with the impulse `r`; `masses` are its
    /// effective masses along the normal and the tangents.
    fn add_contact<const L: usize>(
        &mut self,
        law: &Law,
        y: Vector<f64, L>,
        r: Vector<f64, L>,
        masses: [f64; 2],
    ) {
        let inside = law.clamp(r);
        self.cone = self.cone.max((r - inside).length() / masses[0]);
        self.sinking = self.sinking.max(y[0]);
        let w = law.soften(inside) - y;
        self.complementarity += (inside.dot(w) + inside[0] * law.shift(y, inside)).abs();
        let mut natural = (inside[0] / masses[0]).min(w[0]).abs();
        if masses[1] > 0.0 {
            let mut stepped = inside - w * masses[1];
            stepped[0] = inside[0];
            natural = natural.max((law.clamp(stepped) - inside).length() / masses[1]);
        }
        self.natural = self.natural.max(natural);
    }
}

/// G along the line of impulses: c + b x + a x^2 for x of 0..1.
#[derive(Clone, Copy, Default)]
struct Parabola {
    a: f64,
    b: f64,
    c: f64,
}

impl Parabola {
    /// Adds a contact; returns the impulse at the start of the line, and the way to its end.
    fn add_contact<const L: usize>(
        &mut self,
        law: &Law,
        y: Vector<f64, L>,
        r: Vector<f64, L>,
    ) -> [Vector<f64, L>; 2] {
        let start = law.clamp(r);
        let mut shifted = y;
        shifted[0] -= law.shift(y, start);
        let way = law.response(shifted) - start;
        let loss = law.loss(shifted, start);
        self.c += loss;
        if law.normal > 0.0 {
            self.b += way.dot(law.soften(start) - shifted);
            self.a += 0.5 * way.dot(law.soften(way));
            [start, way]
        } else {
            [start, Vector::ZERO]
        }
    }

    fn least(&self) -> f64 {
        let at = if self.a > 0.0 { (-0.5 * self.b / self.a).clamp(0.0, 1.0) } else { 0.0 };
        // Not below what rounding leaves of the terms.
        let gap = (self.c + self.b * at + self.a * at * at).max(1e-15 * self.c);
        // A rigid contact that misses its target answers with an infinite impulse.
        if gap.is_nan() { f64::INFINITY } else { gap }
    }
}

/// The certificate of a solved system, whose velocities were `prospective` without its impulses.
///
/// One pass over the contacts and one over the bodies, in their order, in `f64`. A system with
/// rigid contacts (compliance 0) that miss their targets has an infinite gap: nothing is proven.
pub fn certify<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    prospective: &[Velocity<T, L, A>],
) -> Certificate {
    let mut certificates = Vec::new();
    let islands = vec![0; system.velocities.len()];
    certify_islands(system, prospective, &islands, 1, &mut Memory::default(), &mut certificates);
    certificates.pop().unwrap_or(Certificate::NONE)
}

/// Memory of [`certify_islands`].
#[derive(Clone, Debug, Default)]
pub struct Memory<const L: usize, const A: usize> {
    /// d of each body, and what the way of the impulses adds to it.
    defects: Vec<[Velocity<f64, L, A>; 2]>,
}

/// The certificates of `count` islands, given the island of each body; `u32::MAX` is none. A
/// contact belongs to the island of whichever of its bodies has one.
pub fn certify_islands<T: Scalar, const L: usize, const A: usize>(
    system: &System<T, L, A>,
    prospective: &[Velocity<T, L, A>],
    islands: &[u32],
    count: usize,
    memory: &mut Memory<L, A>,
    out: &mut Vec<Certificate>,
) {
    out.clear();
    out.resize(count, Certificate::NONE);
    let mut lines = vec![Parabola::default(); count];
    let defects = &mut memory.defects;
    defects.clear();
    let changes = system.velocities.iter().zip(prospective);
    defects.extend(changes.map(|(v, before)| [v.cast() - before.cast(), Velocity::ZERO]));
    for manifold in &system.manifolds {
        let [a, b] = manifold.bodies.map(|body| body as usize);
        let island = islands[a].min(islands[b]) as usize;
        let Some(certificate) = out.get_mut(island) else { continue };
        let masses = system.masses_of(manifold).map(|mass| mass.cast::<f64>());
        let (mut of_a, mut of_b) = (defects[a], defects[b]);
        let (v_a, v_b) = (system.velocities[a].cast(), system.velocities[b].cast());
        let frame: Manifold<f64, L> = manifold.cast();
        for contact in &system.contacts[manifold.points()] {
            let Some(law) = Law::of(manifold, contact) else { continue };
            let contact = contact.cast::<f64>();
            let y = contact.target - contact.relative_velocity(&frame, &v_a, &v_b);
            let effective = [contact.effective_mass, contact.tangential_mass];
            certificate.add_contact(&law, y, contact.impulse, effective);
            let line = lines[island].add_contact(&law, y, contact.impulse);
            for (i, r) in line.into_iter().enumerate() {
                contact.apply(-frame.to_world(r), &masses, &mut of_a[i], &mut of_b[i]);
            }
        }
        (defects[a], defects[b]) = (of_a, of_b);
    }
    for ((mass, [d, way]), &island) in system.masses.iter().zip(&*defects).zip(islands) {
        let island = island as usize;
        let Some(certificate) = out.get_mut(island) else { continue };
        let mass = mass.mass();
        let (momentum, line) = (mass.momentum(d), &mut lines[island]);
        certificate.defect += 0.5 * momentum.dot(d);
        line.c += 0.5 * momentum.dot(d);
        line.b += momentum.dot(way);
        line.a += 0.5 * mass.squared(way);
        if mass.linear > 0.0 {
            certificate.mass += mass.linear;
            certificate.lightest = certificate.lightest.min(mass.linear);
        }
    }
    for (certificate, line) in out.iter_mut().zip(&lines) {
        certificate.gap = line.least();
    }
}
