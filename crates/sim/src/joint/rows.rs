//! Rows of a joint: which it has, and their laws in a substep.
//!
//! A lock keeps its coordinate q at q_0 while the bodies move along curved paths. If they keep
//! their velocities v, q is q_end at the end of the substep, and a change dv of them adds h J dv.
//! With repair = c (q - q_0),
//!
//! ```text
//! q_end + h J dv = q - repair      so    t = J v - (q_end - q + repair) / h
//! ```
//!
//! A limit acts on one side only. It may be reached within the substep, but not passed.
//!
//! Gravity moves bodies by half of its gain before a row acts (`motion.rs`). So the mean velocity of a
//! substep is (q_end - q) / h, not J v. Springs, motors and friction aim at a mean velocity, too: the
//! curve J v - (q_end - q) / h is part of their targets.
//!
//! A spring that alone moves an effective mass m follows its oscillation exactly. With frequency w,
//! damping ratio zeta and w_d = w sqrt(1 - zeta^2),
//!
//! ```text
//! a   = exp(-2 zeta w h),       b h = 1 + a - 2 exp(-zeta w h) cos(w_d h)
//! eps = a / (m (1 - a)),        t   = b (q_0 - q) / (1 - a)
//! ```
//!
//! Its damping holds bodies too much that locks make heavier. So where h d / m is beyond [`LIGHT`], it is
//! implicit, and the spring as without damping:
//!
//! ```text
//! eps = 1 / (h d),              t = k (2 - 2 cos(w h)) / (w h)^2 (q_0 - q) / d
//! ```
//!
//! Beyond w h = 1/2, and with a velocity v_0, a spring is implicit:
//!
//! ```text
//! eps = 1 / (h^2 k + h d),      t = (k (q_0 - q) + d v_0) / (h k + d)
//! ```
//!
//! A spring that stands has the impulse s = gain (q_0 - q) / eps. As gravity, it moves its bodies by half
//! of its gain before the solve, and they end with (J'^T s' - J^T s) / 2 more, with the spring of the next
//! substep. So velocities are those at the end of a substep: zero for a weight that stands on a spring.
//!
//! Motors and dry friction at their bounds, and dampers, push as in the substep before. They move their bodies
//! by half of that gain, too, and give nothing at the end: the solve gave all.

use drystone_solver::law::Interval;

use super::coordinates::{RowCoordinate, smaller};
use super::{Coordinate, Drive, JointAxis, Softness};

/// A row of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RowPlan {
    pub(crate) coordinate: RowCoordinate,
    pub(crate) role: Role,
    /// Index of its axis in the joint.
    pub(crate) axis: usize,
}

impl RowPlan {
    /// Returns true if the row has a line that turns when bodies move across it: a rod or a limit of a
    /// length, or a limit of an angle between directions.
    pub(crate) fn has_line(&self) -> bool {
        let is_length = match self.coordinate {
            RowCoordinate::Of(coordinate) => coordinate.is_unsigned(),
            RowCoordinate::Ellipse(_) => true,
            _ => false,
        };
        self.role.is_rigid() && is_length
    }

    /// Returns true if the row holds the direction of the x axis, as that of a hinge does.
    pub(crate) fn turns_with_axis(&self) -> bool {
        matches!(self.role, Role::Lock(..))
            && matches!(
                self.coordinate,
                RowCoordinate::SwingVector(_)
                    | RowCoordinate::RotationVector(_)
                    | RowCoordinate::Lean(_)
            )
    }
}

/// Kind of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Role {
    /// Keeps a value.
    Lock(f64, Option<Softness>),
    /// Keeps between two values.
    Limit([f64; 2], Option<Softness>),
    Drive(Drive),
    /// Largest force. \[N, or N m\]
    Friction(f64),
}

/// Returns the rows of these axes of a joint in a space of `dimension`.
pub(crate) fn plan(axes: &[JointAxis], dimension: usize) -> Vec<RowPlan> {
    let mut rows = Vec::new();
    for (index, axis) in axes.iter().enumerate() {
        let mut add = |coordinate, role| rows.push(RowPlan { coordinate, role, axis: index });
        let own = RowCoordinate::Of(axis.coordinate);
        match (axis.lock(), axis.limits) {
            (Some(0.0), _) => {
                let role = Role::Lock(0.0, axis.softness);
                locked_to_zero(axis.coordinate, axes, dimension).for_each(|row| add(row, role));
            }
            (Some(value), _) => add(own, Role::Lock(value, axis.softness)),
            (None, Some(limits)) if limits.iter().any(|limit| limit.is_finite()) => {
                match (axis.coordinate, axis.softness) {
                    (Coordinate::EllipticCone(angles), None) => {
                        let limits = limits.map(|limit| limit * smaller(&angles));
                        add(RowCoordinate::Ellipse(angles), Role::Limit(limits, None));
                    }
                    (_, softness) => add(own, Role::Limit(limits, softness)),
                }
            }
            _ => {}
        }
        for drive in &axis.drives {
            let acts = drive.stiffness > 0.0 || drive.damping > 0.0;
            if acts && drive.max_force > 0.0 {
                add(own, Role::Drive(*drive));
            }
        }
        if axis.friction > 0.0 {
            add(own, Role::Friction(axis.friction));
        }
    }
    rows
}

/// Returns the coordinates that together lock a coordinate to zero. Distances and angles between
/// directions have no derivative there: all components of their vector are locked.
fn locked_to_zero(
    coordinate: Coordinate,
    axes: &[JointAxis],
    dimension: usize,
) -> impl Iterator<Item = RowCoordinate> {
    let is_zero = |coordinate: Coordinate| {
        axes.iter().any(|axis| axis.coordinate == coordinate && axis.lock() == Some(0.0))
    };
    let swings = is_zero(Coordinate::Swing(1)) && is_zero(Coordinate::Swing(2));
    let all = swings && is_zero(Coordinate::Twist);
    let linear = |axis| RowCoordinate::Of(Coordinate::Linear(axis));
    let rows: Vec<RowCoordinate> = match coordinate {
        Coordinate::Twist if all => vec![RowCoordinate::RotationVector(0)],
        Coordinate::Swing(about) if all => vec![RowCoordinate::RotationVector(about)],
        Coordinate::Swing(about) if swings => vec![RowCoordinate::SwingVector(about)],
        Coordinate::Swing(about) => vec![RowCoordinate::Lean(about)],
        Coordinate::Distance => (0..dimension).map(linear).collect(),
        Coordinate::Radial(along) => (0..3).filter(|axis| *axis != along).map(linear).collect(),
        Coordinate::Cone => [1, 2].map(RowCoordinate::SwingVector).into(),
        Coordinate::Rotation => [0, 1, 2].map(RowCoordinate::RotationVector).into(),
        other => vec![RowCoordinate::Of(other)],
    };
    rows.into_iter()
}

/// Parameters of a row that stay constant through a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowParams {
    /// Length of the substep. \[s\]
    pub(crate) h: f64,
    /// Effective mobility A_ii. \[1/kg, or 1/(kg m^2)\]
    pub(crate) mobility: f64,
    /// A_ii by which accelerations of drives are forces. \[1/kg, or 1/(kg m^2)\]
    pub(crate) unit: f64,
    /// Arm by which a force of a lock is the moment of this row; 1 for a position. \[m, or 1\]
    pub(crate) arm: f64,
    /// Arm by which the weight of the mechanism turns this row; 1 for a position. \[m, or 1\]
    pub(crate) lever: f64,
    /// Compliance of a lock. \[1/kg, or 1/(kg m^2)\]
    pub(crate) compliance: f64,
    /// Fraction of a gap that the substep repairs, and the largest speed of repair.
    /// \[1, m/s or rad/s\]
    pub(crate) repair: [f64; 2],
    /// Largest impulse of a motor or damper without a bound: locks and limits bear it. \[N s, or N m s\]
    pub(crate) strongest: f64,
    /// True if J is that of the end of the substep, since the line of the row turns far.
    pub(crate) is_turned: bool,
}

impl RowParams {
    /// Returns the compliance of a limit and the fraction of a gap that it repairs.
    ///
    /// With eps and c those of a lock, it is a spring of h^2 k = c / eps with h d = (1 - c) / eps. In short
    /// substeps that spring would swing, so its damping ratio is [`DAMPED`] at least: h d >= 2 zeta
    /// sqrt(h^2 k / A_ii).
    fn damped_limit(&self) -> [f64; 2] {
        let share = self.repair[0];
        let stiffness = share / self.compliance;
        let damping = (1.0 - share) / self.compliance;
        let least = 2.0 * DAMPED * (stiffness / self.mobility).sqrt();
        if damping >= least || self.mobility <= 0.0 {
            return [self.compliance, share];
        }
        let compliance = 1.0 / (stiffness + least);
        [compliance, stiffness * compliance]
    }

    /// Returns the factor from the numbers of a drive to forces.
    fn scale(&self, drive: &Drive) -> f64 {
        if drive.acceleration { 1.0 / self.unit } else { 1.0 }
    }
}

/// Motion of a row in a substep, as far as it is known before the solve.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    /// q.
    pub(crate) value: f64,
    /// q at the end of the substep if the bodies keep their velocities.
    pub(crate) end: f64,
    /// J v of these velocities.
    pub(crate) rate: f64,
}

/// State of a row between substeps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct RowState {
    /// q, with its turns. \[m, or rad\]
    pub(crate) value: f64,
    /// Impulses of the last solve and of the sweep that relaxed it. \[N s, or N m s\]
    pub(crate) solved: f64,
    pub(crate) relaxed: f64,
    /// Impulse of the solve before the last. \[N s, or N m s\]
    pub(crate) solved_before: f64,
}

impl RowState {
    /// Returns the impulse of the last solve, as far as it is at most twice that of the one before.
    /// The impulse of an impact does not last. \[N s, or N m s\]
    pub(crate) fn lasting(&self) -> f64 {
        let most = 2.0 * self.solved_before.abs();
        self.solved.max(-most).min(most)
    }
}

/// Compliance and target of a spring: t = gain (q_0 - q) + drift.
#[derive(Clone, Copy, Debug)]
struct Spring {
    compliance: f64,
    gain: f64,
    drift: f64,
    /// True if it is so stiff that a substep does not resolve its oscillation.
    is_implicit: bool,
    /// True if its damping is implicit.
    is_damped: bool,
}

impl Spring {
    fn of(stiffness: f64, damping: f64, velocity: f64, params: &RowParams) -> Self {
        let RowParams { h, mobility, .. } = *params;
        let omega = (stiffness * mobility).sqrt();
        if stiffness > 0.0 && velocity == 0.0 && omega * h < 0.5 {
            let (drift, is_implicit) = (0.0, false);
            let is_damped = damping * mobility * h > LIGHT;
            if is_damped {
                let turn = omega * h;
                let kept = 2.0 * (1.0 - libm::cos(turn)) / (turn * turn);
                let (compliance, gain) = (1.0 / (h * damping), stiffness * kept / damping);
                return Self { compliance, gain, drift, is_implicit, is_damped };
            }
            // zeta w = d / (2 m).
            let decay = 0.5 * damping * mobility * h;
            let squared = omega * omega * h * h - decay * decay;
            let turn = squared.abs().sqrt();
            let cosine = if squared > 0.0 { libm::cos(turn) } else { libm::cosh(turn) };
            let (a, root) = (libm::exp(-2.0 * decay), libm::exp(-decay));
            let b = (1.0 + a - 2.0 * root * cosine) / h;
            let kept = a.min(1.0 - 1e-12);
            let compliance = mobility * kept / (1.0 - kept);
            return Self { compliance, gain: b / (1.0 - kept), drift, is_implicit, is_damped };
        }
        let sum = h * stiffness + damping;
        let (compliance, gain) = (1.0 / (h * sum), stiffness / sum);
        let is_implicit = omega * h >= 0.5;
        let is_damped = damping > 0.0;
        Self { compliance, gain, drift: damping * velocity / sum, is_implicit, is_damped }
    }
}

/// Part of a velocity that damping takes in a substep beyond which the damping is implicit: the exact
/// row is that of bodies without other joints. \[1\]
const LIGHT: f64 = 0.01;

/// Largest acceleration of bodies at rest against which a stiff spring stands. \[m/s^2\]
const FIRM: f64 = 200.0;

/// Largest velocity at which a motor or dry friction yields before it has reached its bound. \[m/s, or
/// rad/s\]
const YIELD: f64 = 1e-5;

/// Share of the compliance of a lock that a motor without a bound has. The stretch of a lock is
/// repaired, but what a motor slips is lost. \[1\]
const SLIP: f64 = 0.01;

/// Least damping ratio of a limit: a body that runs into it comes back at 1 / (4 zeta^2) of its speed. \[1\]
const DAMPED: f64 = 8.0;

const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Role {
    /// Returns the compliance. \[1/kg, or 1/(kg m^2)\]
    pub(crate) fn compliance(&self, params: &RowParams) -> f64 {
        if let Some(spring) = self.spring(params) {
            return spring.compliance;
        }
        match self {
            Self::Limit(_, None) => params.damped_limit()[0],
            Self::Lock(_, None) => params.compliance,
            Self::Drive(Drive { max_force, .. }) | Self::Friction(max_force)
                if max_force.is_finite() =>
            {
                let own = params.compliance.min(YIELD / (max_force * params.h));
                own.max(params.compliance * SLIP)
            }
            _ => params.compliance * SLIP,
        }
    }

    /// Returns true if the row is a spring or a damper.
    #[inline(always)]
    pub(crate) fn is_spring(&self) -> bool {
        match self {
            Self::Lock(_, softness) | Self::Limit(_, softness) => softness.is_some(),
            Self::Drive(drive) => drive.damping.is_finite(),
            Self::Friction(_) => false,
        }
    }

    /// Returns the spring or damper of the row, if it is one.
    fn spring(&self, params: &RowParams) -> Option<Spring> {
        match self {
            Self::Lock(_, Some(softness)) | Self::Limit(_, Some(softness)) => {
                Some(Spring::of(softness.stiffness, softness.damping, 0.0, params))
            }
            Self::Drive(drive) if drive.damping.is_finite() => {
                let scale = params.scale(drive);
                let [stiffness, damping] = [drive.stiffness, drive.damping].map(|of| of * scale);
                Some(Spring::of(stiffness, damping, drive.velocity, params))
            }
            _ => None,
        }
    }

    /// Returns q_0 - q of a spring.
    fn stretch(&self, value: f64) -> f64 {
        match self {
            Self::Lock(at, _) => at - value,
            Self::Limit([low, high], _) => (low - value).max(0.0) + (high - value).min(0.0),
            Self::Drive(drive) => drive.position - value,
            Self::Friction(_) => 0.0,
        }
    }

    /// Returns the largest impulse of a drive in a substep.
    fn most(drive: &Drive, value: f64, params: &RowParams) -> f64 {
        if drive.max_force.is_finite() {
            return drive.max_force * params.h;
        }
        // A spring bears what its stiffness says.
        let force = drive.stiffness * params.scale(drive) * (drive.position - value);
        params.strongest + force.abs() * params.h
    }

    /// Returns the impulse s of a spring that stands, or 0 \[N s, or N m s\]. One that moves
    /// may have another in each substep if it is stiff, and less where its damping opposes it. So of these
    /// only what they have in common with the impulse that was `solved` counts, of stiff ones up to an
    /// acceleration of [`FIRM`].
    pub(crate) fn standing(&self, value: f64, solved: f64, params: &RowParams) -> f64 {
        let Some(spring) = self.spring(params) else { return 0.0 };
        let most = match self {
            Self::Drive(drive) => Self::most(drive, value, params),
            _ => f64::INFINITY,
        };
        let own = spring.gain * self.stretch(value) / spring.compliance;
        let own = own.max(-most).min(most);
        if !spring.is_implicit && !spring.is_damped {
            return own;
        }
        let firm = FIRM * params.h / (params.mobility * params.arm);
        let most = if spring.is_implicit { firm } else { f64::INFINITY };
        if own * solved > 0.0 { own.abs().min(solved.abs()).min(most).copysign(own) } else { 0.0 }
    }

    /// Returns the impulse that a motor or dry friction at its bound, or a damper, gives in each substep; 0 for
    /// another row. \[N s, N m s\]
    pub(crate) fn constant(&self, state: &RowState, params: &RowParams) -> f64 {
        let RowState { solved, solved_before, .. } = *state;
        let most = match self {
            Self::Drive(drive) if drive.damping == f64::INFINITY => drive.max_force * params.h,
            Self::Friction(most) => most * params.h,
            Self::Drive(drive) if drive.stiffness == 0.0 && solved * solved_before > 0.0 => {
                return solved.abs().min(solved_before.abs()).copysign(solved);
            }
            _ => f64::INFINITY,
        };
        if solved.abs() >= most * (1.0 - 1e-9) { solved } else { 0.0 }
    }

    /// Returns true if the row may give the same in each substep: a spring, a motor or friction.
    pub(crate) fn may_stand(&self) -> bool {
        self.is_spring() || matches!(self, Self::Drive(_) | Self::Friction(_))
    }

    /// Returns the law of the row in a substep.
    pub(crate) fn law(&self, at: &Motion, params: &RowParams) -> Interval<f64> {
        let RowParams { h, repair: [share, speed], .. } = *params;
        // The part of the path that velocities alone do not tell.
        let curve = at.rate - (at.end - at.value) / h;
        let repaired = |share: f64, gap: f64| (share * gap).max(-speed * h).min(speed * h);
        let compliance = self.compliance(params);
        let spring = self.spring(params).map(|of| [of.gain, of.drift]);
        let [gain, drift] = spring.unwrap_or([0.0, self.motor().unwrap_or(0.0)]);
        let (targets, bounds) = match self {
            Self::Lock(value, None) => ([curve - repaired(share, at.value - value) / h; 2], ANY),
            Self::Lock(value, Some(_)) => ([curve + gain * (value - at.value); 2], ANY),
            Self::Limit([low, high], None) => {
                let share = params.damped_limit()[1];
                let up = (low - at.value).min(repaired(share, (low - at.value).max(0.0)));
                let down = (high - at.value).max(repaired(share, (high - at.value).min(0.0)));
                ([curve + up / h, curve + down / h], ANY)
            }
            Self::Limit([low, high], Some(_)) => {
                let to = |limit: &f64| curve + gain * (limit - at.value);
                ([to(low), to(high)], ANY)
            }
            Self::Drive(drive) => {
                let most = Self::most(drive, at.value, params);
                let aim = gain * (drive.position - at.value) + drift;
                ([curve + aim; 2], [-most, most])
            }
            Self::Friction(most) => ([curve; 2], [-most * h, most * h]),
        };
        Interval { targets, bounds, compliance }
    }

    /// Returns the velocity that a motor without stiffness or dry friction keeps.
    fn motor(&self) -> Option<f64> {
        match self {
            Self::Drive(Drive { damping: f64::INFINITY, velocity, .. }) => Some(*velocity),
            Self::Friction(_) => Some(0.0),
            _ => None,
        }
    }

    /// Returns the law of the sweep that ends a substep, for the change of the impulse. It takes
    /// out the velocity from repair and curvature. The row had the `law` in the substep of `h` \[s\], and
    /// `state` has q at its end. Its joint may break if `breaks`.
    pub(crate) fn relaxing_law(
        &self,
        law: &Interval<f64>,
        state: &RowState,
        (h, breaks): (f64, bool),
    ) -> Interval<f64> {
        let compliance = law.compliance;
        let &RowState { value, solved, .. } = state;
        let (targets, bounds) = match self {
            Self::Lock(_, None) => ([0.0; 2], ANY),
            Self::Limit([low, high], None) => {
                let below = ((low - value) / h).min(0.0);
                let above = ((high - value) / h).max(0.0);
                match () {
                    () if solved > 0.0 => ([below; 2], [-solved, f64::INFINITY]),
                    () if solved < 0.0 => ([above; 2], [f64::NEG_INFINITY, -solved]),
                    // One that has not been reached, and can break, bears a blow in one substep.
                    () if breaks => {
                        let out =
                            |target: f64| if target == 0.0 { 0.0 } else { target * f64::INFINITY };
                        ([out(below), out(above)], ANY)
                    }
                    () => ([below, above], ANY),
                }
            }
            _ => match self.motor() {
                Some(velocity) => {
                    let bounds = law.bounds.map(|bound| bound - solved);
                    ([velocity - compliance * solved; 2], bounds)
                }
                None => (law.targets, [0.0; 2]),
            },
        };
        Interval { targets, bounds, compliance }
    }

    /// Returns the law by which the row bears what bodies gain in each substep, as far as it is not such a
    /// gain itself.
    pub(crate) fn bearing_law(
        &self,
        state: &RowState,
        params: &RowParams,
        is_broken: bool,
    ) -> Interval<f64> {
        let within = |most: f64| [-most, most];
        let bounds = match self {
            _ if is_broken || self.is_spring() || self.constant(state, params) != 0.0 => [0.0; 2],
            Self::Lock(..) => ANY,
            Self::Limit(..) if state.solved > 0.0 => [0.0, f64::INFINITY],
            Self::Limit(..) if state.solved < 0.0 => [f64::NEG_INFINITY, 0.0],
            Self::Limit(..) => [0.0; 2],
            Self::Drive(drive) => within(Self::most(drive, state.value, params)),
            Self::Friction(most) => within(most * params.h),
        };
        Interval { targets: [0.0; 2], bounds, compliance: self.compliance(params) }
    }

    /// Returns by how much q misses its lock or its limits.
    pub(crate) fn miss(&self, value: f64) -> f64 {
        match self {
            Self::Lock(at, None) => (value - at).abs(),
            Self::Limit([low, high], None) => (low - value).max(value - high).max(0.0),
            _ => 0.0,
        }
    }

    /// Returns true if the row is a lock or a limit without softness.
    pub(crate) fn is_rigid(&self) -> bool {
        matches!(self, Self::Lock(_, None) | Self::Limit(_, None))
    }

    /// Returns true if the row is a lock without softness.
    pub(crate) fn is_rigid_lock(&self) -> bool {
        matches!(self, Self::Lock(_, None))
    }

    /// Returns true if the row is a motor that runs: it keeps its bodies awake.
    pub(crate) fn runs(&self) -> bool {
        matches!(self, Self::Drive(drive) if drive.velocity != 0.0)
    }
}
