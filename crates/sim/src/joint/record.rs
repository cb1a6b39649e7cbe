//! [`JointRecord`]: a joint of a world.

use drystone_solver::{Axis, SymmetricMatrix, Velocity};

use super::coordinates::{JointOrigin, JointPlaces, Place, RowCoordinate, Turn, Vec3, cross};
use super::rows::{Role, RowPlan, RowState};
use super::{Breaking, Coordinate, Drive, JointAxis};

/// Marks the world in the place of a body.
pub(crate) const WORLD: u32 = u32::MAX;

/// A joint of a world.
#[derive(Clone, Debug)]
pub(crate) struct JointRecord {
    /// Slots of the bodies, or [`WORLD`].
    pub(crate) bodies: [u32; 2],
    /// Frames relative to the centers of mass, or in the world.
    pub(crate) frames: [Place; 2],
    pub(crate) origin: JointOrigin,
    pub(crate) axes: Vec<JointAxis>,
    pub(crate) rows: Vec<RowPlan>,
    pub(crate) states: Vec<RowState>,
    /// By axis: the angles of its coordinate with their turns. \[rad\]
    pub(crate) turns: Vec<[f64; 2]>,
    pub(crate) breaking: Breaking,
    pub(crate) collide: bool,
    pub(crate) enabled: bool,
    pub(crate) broken: bool,
    pub(crate) user_data: u128,
    /// Lengths of the impulses on both bodies in the last substep ([`tension`](super::tension)). \[N s\]
    pub(crate) pulls: [f64; 2],
    /// Impulse on a and its moment about the joint in this step, or in the last one, summed in frames that
    /// turn with a and with b. \[N s, N m s\]
    pub(crate) load: [[Vec3; 2]; 2],
}

impl JointRecord {
    /// Takes the state of another record of the same joint.
    pub(crate) fn take_state(&mut self, from: &Self) {
        self.states.copy_from_slice(&from.states);
        self.turns.copy_from_slice(&from.turns);
        (self.pulls, self.load, self.broken) = (from.pulls, from.load, from.broken);
        self.origin.start = from.origin.start;
    }

    /// Returns true if a gear counts the spin of its bodies.
    pub(crate) fn counts_spin(&self) -> bool {
        self.axes.iter().any(|axis| matches!(axis.coordinate, Coordinate::Gear { .. }))
    }

    /// Scales the impulses of the last substep.
    pub(crate) fn scale(&mut self, factor: f64) {
        for RowState { solved, relaxed, solved_before, .. } in &mut self.states {
            [solved, relaxed, solved_before].into_iter().for_each(|own| *own *= factor);
        }
        self.pulls.iter_mut().for_each(|own| *own *= factor);
    }

    /// Returns its places, where `of` returns those of its bodies.
    pub(crate) fn places(&self, of: impl Fn(u32) -> Place) -> JointPlaces<'_> {
        self.places_at(self.bodies.map(of))
    }

    /// Returns its places, where its bodies are at these.
    #[inline(always)]
    pub(crate) fn places_at(&self, [a, b]: [Place; 2]) -> JointPlaces<'_> {
        let frames = [a.of(&self.frames[0]), b.of(&self.frames[1])];
        JointPlaces::new(frames, &self.origin, [a.position, b.position])
    }

    /// Counts the turns of axes without rows.
    pub(crate) fn count_turns(&self, places: &JointPlaces<'_>, turns: &mut [[f64; 2]]) {
        for (index, axis) in self.axes.iter().enumerate() {
            let has_row = || self.rows.iter().any(|row| row.axis == index);
            if axis.coordinate.counts_turns() && !has_row() {
                let found = places.read(&RowCoordinate::Of(axis.coordinate));
                turns[index] = found.turned(&self.turns[index]).1;
            }
        }
    }

    /// Returns by how much its positions \[m\] and rotations \[rad\] miss their locks and limits.
    pub(crate) fn misses(&self, places: &JointPlaces<'_>) -> [f64; 2] {
        let mut out = [0.0f64; 2];
        let mut apart = 0.0;
        for plan in &self.rows {
            let found = places.read(&plan.coordinate);
            let miss = plan.role.miss(found.turned(&self.turns[plan.axis]).0);
            match plan.coordinate {
                // Positions along three axes make one distance.
                RowCoordinate::Of(Coordinate::Linear(_)) => apart += miss * miss,
                RowCoordinate::Of(of) if !of.is_angle() => out[0] = out[0].max(miss),
                _ => out[1] = out[1].max(miss),
            }
        }
        [out[0].max(apart.sqrt()), out[1]]
    }

    /// Returns an impulse on it and its moment in a step of `dt` \[s\] over those that break it. \[1\]
    pub(crate) fn strain(&self, [pull, turn]: [f64; 2], dt: f64) -> f64 {
        let Breaking { force, torque, impulse } = self.breaking;
        (pull / (force * dt)).max(pull / impulse).max(turn / (torque * dt))
    }

    /// Adds to its load in this step. `turns` are the rotations of its bodies.
    pub(crate) fn bear(&mut self, load: [Vec3; 2], turns: [Turn; 2]) {
        for (side, (sums, turn)) in self.load.iter_mut().zip(turns).enumerate() {
            let back = if self.bodies[side] == WORLD { Turn::NONE } else { turn.inverse() };
            sums.iter_mut().zip(load).for_each(|(sum, own)| *sum += back.rotate(own));
        }
    }

    /// Returns the sizes of its impulse and of its moment in the step. A load that turns with a body is
    /// as large as one that stands still. \[N s, N m s\]
    pub(crate) fn largest_load(&self) -> [f64; 2] {
        let [with_a, with_b] = self.load.map(|of| of.map(|own| own.length()));
        [with_a[0].max(with_b[0]), with_a[1].max(with_b[1])]
    }

    /// Returns its load by these impulses of its rows, at these arms from the centers of mass of its
    /// bodies. \[N s, N m s\]
    pub(crate) fn load_by<const L: usize, const A: usize>(
        &self,
        axes: &[Axis<f64, L, A>],
        impulses: impl Iterator<Item = f64>,
        arms: &[Vec3; 2],
    ) -> [Vec3; 2] {
        let [mut pull, mut turn] = [Vec3::ZERO; 2];
        for (axis, impulse) in axes.iter().zip(impulses) {
            let Velocity { linear, angular } = axis.jacobian[0] * impulse;
            (0..L).for_each(|i| pull[i] += linear[i]);
            (0..A).for_each(|i| turn[if A == 1 { 2 } else { i }] += angular[i]);
        }
        let side = self.first_side();
        let sign = if side == 1 { -1.0 } else { 1.0 };
        [pull * sign, (turn - cross(arms[side], pull)) * sign]
    }

    /// Returns A_ii of a drive that gives an acceleration about an axis, where the axes of its frames agree;
    /// none for another row. `inverse` is I^-1 of a body in its frame. \[1/(kg m^2)\]
    ///
    /// By A_ii of where bodies are, stiffness would change with their rotations about other axes: two such
    /// springs could drive each other without end.
    pub(crate) fn mobility_at_zero(
        &self,
        plan: &RowPlan,
        inverse: impl Fn(u32) -> Option<SymmetricMatrix<f64, 3>>,
    ) -> Option<f64> {
        if !matches!(plan.role, Role::Drive(Drive { acceleration: true, .. })) {
            return None;
        }
        let axis = match plan.coordinate {
            RowCoordinate::Of(Coordinate::Twist) => 0,
            RowCoordinate::Of(Coordinate::Swing(axis) | Coordinate::Cardan(axis)) => axis,
            _ => return None,
        };
        let mut unit = Vec3::ZERO;
        unit[axis] = 1.0;
        let mut mobility = 0.0;
        for (frame, &body) in self.frames.iter().zip(&self.bodies) {
            if body != WORLD {
                let about = frame.turn.rotate(unit);
                mobility += about.dot(inverse(body)? * about);
            }
        }
        (mobility > 0.0).then_some(mobility)
    }

    /// Returns true if it has a [line](RowPlan::has_line), which may turn when its bodies do not.
    pub(crate) fn has_line(&self) -> bool {
        self.rows.iter().any(RowPlan::has_line)
    }

    /// Returns the side of its first body: 1 if a is the world.
    pub(crate) fn first_side(&self) -> usize {
        usize::from(self.bodies[0] == WORLD)
    }

    /// Returns its bodies, without the world.
    pub(crate) fn members(&self) -> impl Iterator<Item = u32> + '_ {
        self.bodies.iter().copied().filter(|body| *body != WORLD)
    }
}
