//! Kinematics of a contact: motion of its arms and its frame while its bodies rotate.
//!
//! J is computed at the poses of the contact search. If it is kept for a whole step, an arm r that
//! rotates with its body acts too late: rocking and rolling bodies gain energy in each step,
//! however short the substeps are. Therefore J is updated after each substep, from the
//! displacements of the bodies alone.
//!
//! Each surface has a center of curvature, which moves with its body: a corner or a face at
//! distance 0, the center of a ball at distance R. With the arms c of both centers, the rotation
//! vectors theta and the displacements d of a substep,
//!
//! c' = R(theta) c,   gap' = n' . (x_a' + c_a' - x_b' - c_b') - R_a - R_b,
//!
//! where n rotates with the body that has the face, or stays along the line of the centers. J d is
//! the first-order part of gap' - gap. The rest is the bend, (h^2 / 2) kappa with kappa the
//! curvature of the path. Targets that include it let a body roll without being lifted or lowered.
//!
//! Positions are solved with J before the motion, velocities ([`relax`](crate::pgs::relax)) with J
//! after it, as in RATTLE: H. C. Andersen, "Rattle: a velocity version of the Shake
//! algorithm", 1983.

use crate::vector::spin;
use crate::{ConstraintFrame, Contact, Manifold, Real, Vector, Velocity, moment};

/// Slower rotations do not update J. \[rad/s\]
///
/// Below it an arm may lag behind its body by a step. A body that rocks this slowly at 10 rad/s has
/// an amplitude of 0.002 rad. A heap that is nearly at rest rotates more slowly.
pub const LEAST_SPIN: f32 = 0.02;

/// Faster rotations update M^-1 to the current orientation. \[rad per substep\]
pub const FAST_TURN: f32 = 5e-3;

/// Contacts that have rotated by more than this since they were found are not updated: by then
/// other corners touch. \[rad\]
const MOST_TURN: f64 = 0.2;

/// Returns (most |arm|)^2 less the squared way of the arm in a turn, for the largest turn, [`MOST_TURN`].
/// No closure, as these are not always inlined.
#[inline(always)]
fn left_of_turn<T: Real, const L: usize, const A: usize>(
    turn: Vector<T, A>,
    arm: Vector<T, L>,
) -> T {
    let moved = spin(turn, arm);
    arm.dot(arm) * T::from_f64(MOST_TURN * MOST_TURN) - moved.dot(moved)
}

/// Returns R(theta) r - r by Cayley's map, whose angle is exact to fourth order.
#[inline(always)]
fn turn<T: Real, const L: usize, const A: usize>(
    theta: Vector<T, A>,
    r: Vector<T, L>,
) -> Vector<T, L> {
    let squared = theta.dot(theta);
    let half = theta * (T::from_f64(0.5) + squared * T::from_f64(1.0 / 24.0));
    let scale = T::from_f64(2.0) / (T::ONE + half.dot(half));
    let across = spin(half, r);
    (across + spin(half, across)) * scale
}

/// A manifold after a displacement of its bodies.
pub(crate) struct Moved<T: Real, const L: usize> {
    pub(crate) frame: ConstraintFrame<T, L>,
    /// Change of its gap beyond J d. \[m\]
    pub(crate) bend: T,
}

impl<T: Real, const L: usize> Manifold<T, L> {
    /// Returns the distances from the centers of curvature to the manifold's center, for surfaces
    /// `gap` apart. \[m\]
    ///
    /// The center lies on the surface that moves with the points: on that of b if a face of a
    /// carries the normal, else on that of a; across two edges it lies midway.
    #[inline(always)]
    fn radii_across(&self, gap: T) -> [T; 2] {
        let of_a = self.normal_share[0];
        [self.radii[0] + gap * of_a, self.radii[1] + gap * (T::ONE - of_a)]
    }

    /// Returns the arms of the centers of curvature. \[m\]
    #[inline(always)]
    fn cores(&self, [of_a, of_b]: [T; 2]) -> [Vector<T, L>; 2] {
        let normal = self.normal();
        [self.frame.arms[0] + normal * of_a, self.frame.arms[1] - normal * of_b]
    }

    /// Returns a positive number if the motion of a body requires an update of J. That is a
    /// rotation faster than [`LEAST_SPIN`] that turns an arm or the normal; those of a ball do not
    /// turn.
    ///
    /// `moved` are the displacements in the time `dt` \[s\]; `gap` is that at the manifold's
    /// center, as in J.
    #[inline(always)]
    pub(crate) fn turns<const A: usize>(&self, gap: T, moved: [&Velocity<T, L, A>; 2], dt: T) -> T {
        let cores = self.cores(self.radii_across(gap));
        let least = dt * T::from_f64(f64::from(LEAST_SPIN));
        let least = least * least;
        let (a, b) = (self.turn_of(0, cores[0], moved[0]), self.turn_of(1, cores[1], moved[1]));
        a.max(b) - least
    }

    /// Returns the squared rotation of a body, if its arm or the normal turns with it. \[rad^2\]
    #[inline(always)]
    fn turn_of<const A: usize>(
        &self,
        side: usize,
        core: Vector<T, L>,
        moved: &Velocity<T, L, A>,
    ) -> T {
        let (arm, turn) = (self.frame.arms[side], moved.angular);
        let has_arm = core.dot(core) - arm.dot(arm) * T::from_f64(1e-10);
        let carries = self.normal_share[side] - T::from_f64(0.5);
        has_arm.max(carries).choose(turn.dot(turn), T::ZERO)
    }

    /// Returns a positive number if the arms and the normal have rotated by less than [`MOST_TURN`]
    /// since the manifold was found.
    ///
    /// The arm of a ball's center does not count. The arguments are the displacements since then,
    /// and the gap at the manifold's center, as in J.
    #[inline(always)]
    pub(crate) fn holds<const A: usize>(&self, gap: T, [a, b]: [&Velocity<T, L, A>; 2]) -> T {
        let normal = self.normal();
        let cores = self.cores(self.radii_across(gap));
        let carried = a.angular * self.normal_share[0] + b.angular * self.normal_share[1];
        let arms = left_of_turn(a.angular, cores[0]).min(left_of_turn(b.angular, cores[1]));
        // A center of curvature in the center of mass has no arm.
        (arms + T::from_f64(1e-12)).min(left_of_turn(carried, normal))
    }

    /// Returns the manifold after the displacements \[m, rad\] of its bodies, for surfaces
    /// `gap` \[m\] apart at its center. Its tangents follow the fraction `twist` of the spin of the
    /// body that has the points.
    #[inline(always)]
    pub(crate) fn moved<const A: usize>(
        &self,
        gap: T,
        [a, b]: [&Velocity<T, L, A>; 2],
        twist: T,
    ) -> Moved<T, L> {
        let normal = self.normal();
        let [of_a, of_b] = self.normal_share;
        let along_centers = T::ONE - of_a - of_b;
        let radii = self.radii_across(gap);
        let cores = self.cores(radii);
        let changes = [turn(a.angular, cores[0]), turn(b.angular, cores[1])];
        let linear = a.linear - b.linear;
        let parted = linear + changes[0] - changes[1];

        let distance = radii[0] + radii[1];
        let now = distance + normal.dot(parted);
        let over = now.choose(along_centers / now, T::ZERO);
        let across: Vector<T, A> = moment(normal, parted);
        let mut rotation = a.angular * of_a + b.angular * of_b + across * over;
        if A == L && L == 3 {
            let mut axis = Vector::<T, A>::ZERO;
            for i in 0..A {
                axis[i] = normal[i];
            }
            let spun = (a.angular * of_b + b.angular * of_a).dot(axis) * twist;
            rotation += axis * (spun - rotation.dot(axis));
        }
        let mut axes = self.frame.axes;
        for axis in &mut axes {
            *axis += turn(rotation, *axis);
        }
        let turned = axes[0] - normal;

        let apart = self.frame.arms[1] - self.frame.arms[0] + linear;
        let from_a = apart + cores[0] + changes[0] - axes[0] * radii[0];
        let from_b = cores[1] + changes[1] + axes[0] * radii[1];
        let center = from_a * (T::ONE - of_a) + from_b * of_a;

        let first_order = spin(a.angular, self.frame.arms[0]) - spin(b.angular, self.frame.arms[1]);
        let bend = turned.dot(normal) * distance
            + turned.dot(parted)
            + normal.dot(changes[0] - changes[1] - first_order);
        let frame = ConstraintFrame { axes, arms: [center - apart, center] };
        Moved { frame, bend }
    }
}

impl<T: Real, const L: usize> Contact<T, L> {
    /// Recomputes the gap for an updated J, so that gap + J d stays the same.
    ///
    /// `before` is the twist of the displacements since the gap was measured, by the old J and with
    /// the bend; `after` is their twist by the new J.
    #[inline(always)]
    pub(crate) fn renew<const A: usize>(
        &mut self,
        before: &Velocity<T, L, A>,
        after: &Velocity<T, L, A>,
    ) {
        let gap = self.gap + self.relative_velocity(before);
        self.gap = gap - self.relative_velocity(after);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXES: [[f64; 2]; 4] = [[1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [0.0, 0.0]];

    fn moved(linear: [f64; 2], angle: f64) -> Velocity<f64, 2, 1> {
        Velocity { linear: Vector(linear), angular: Vector([angle]) }
    }

    fn manifold(radii: [f64; 2], normal_share: [f64; 2]) -> Manifold<f64, 2> {
        Manifold {
            frame: ConstraintFrame {
                axes: [Vector([0.0, 1.0]), Vector([-1.0, 0.0])],
                arms: [Vector([0.3, -0.5]), Vector([0.1, 0.4])],
            },
            radii,
            normal_share,
            ..Manifold::default()
        }
    }

    fn with_arms(of: Manifold<f64, 2>, arms: [Vector<f64, 2>; 2]) -> Manifold<f64, 2> {
        Manifold { frame: ConstraintFrame { arms, ..of.frame }, ..of }
    }

    /// Rolls a ball with its center of mass off its center, on a floor without slip. Its center
    /// moves straight, the gap stays the same, and the contact point is below the center.
    #[test]
    fn what_rolls_stays_on_the_floor() {
        let (radius, beside) = (0.5, Vector([0.2, 0.1]));
        let arm = Vector([0.0, -radius]) - beside;
        let rolling = with_arms(manifold([radius, 0.0], [0.0, 1.0]), [arm, Vector([3.0, 0.0])]);
        for angle in [0.5, 0.1, 0.05] {
            // x = x_center + R(angle) beside.
            let center = Vector([-radius * angle, 0.0]);
            let linear = center + turn(Vector([angle]), beside);
            let of_a = moved(linear.0, angle);
            let Moved { frame: ConstraintFrame { axes, arms }, bend } =
                rolling.moved(0.0, [&of_a, &moved([0.0; 2], 0.0)], 0.0);
            assert_eq!(axes, rolling.frame.axes);
            let below = Vector([0.0, -radius]) - (beside + turn(Vector([angle]), beside));
            assert!((arms[0] - below).length() < 1e-12, "{arms:?}");
            let by_j = (linear + spin(of_a.angular, arm)).dot(axes[0]);
            assert!((by_j + bend).abs() < 1e-4 * angle.powi(4), "{by_j} and {bend}");
        }
    }

    /// Checks that J d plus the bend is the actual change of the gap, and that both arms end at one
    /// point.
    #[test]
    fn the_bend_is_what_j_leaves_out() {
        for normal_share in AXES {
            let radii = if normal_share == [0.0, 0.0] { [0.4, 0.7] } else { [0.0, 0.6] };
            let rows = manifold(radii, normal_share);
            let (gap, a, b) = (0.02, moved([0.03, -0.01], 0.08), moved([-0.02, 0.02], -0.05));
            let Moved { frame: ConstraintFrame { axes, arms }, bend } =
                rows.moved(gap, [&a, &b], 0.0);
            let cores = [
                rows.frame.arms[0] + rows.frame.axes[0] * (radii[0] + normal_share[0] * gap),
                rows.frame.arms[1]
                    - rows.frame.axes[0] * (radii[1] + (1.0 - normal_share[0]) * gap),
            ];
            let turned =
                [cores[0] + turn(a.angular, cores[0]), cores[1] + turn(b.angular, cores[1])];
            let apart = rows.frame.arms[1] - rows.frame.arms[0] + a.linear - b.linear;
            let between = apart + turned[0] - turned[1];
            let now =
                if normal_share == [0.0, 0.0] { between.length() } else { between.dot(axes[0]) };
            let by_j = rows.frame.axes[0].dot(a.at(rows.frame.arms[0]) - b.at(rows.frame.arms[1]));
            let exact = now - radii[0] - radii[1] - gap;
            assert!(
                (by_j + bend - exact).abs() < 2e-6,
                "{normal_share:?}: {} and {exact}",
                by_j + bend
            );
            assert!((arms[1] - arms[0] - apart).length() < 1e-12);
            assert!((axes[0].length() - 1.0).abs() < 1e-12);
        }
    }
}
