//! Settings of a step, each with its unit, range and effect.

use drystone_solver::Repair;
use drystone_solver::restitution::ImpactLaw;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

use crate::input::{self, InputError};

/// Settings of [`World::step`](crate::World::step).
///
/// Three presets: [`StepSettings::certified`] for baking with proof, [`StepSettings::quality`] (the
/// default) for baking with fixed work, and [`StepSettings::realtime`] for games.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields, default))]
pub struct StepSettings {
    /// Number of substeps per step. More substeps make contacts stiffer and motion more exact.
    /// \[1\]
    pub substeps: u32,
    /// Largest number of substeps per step in a world without `tolerance`. Up to it, a substep is
    /// no longer than the thinnest awake body takes to fall by 1/1024 of its thickness. \[1\]
    pub max_substeps: u32,
    /// Number of sweeps over all contacts per substep. \[1\]
    pub iterations: u32,
    /// Fraction of an overlap that one substep repairs, from 0 to 1. The rate c_d of the notes is
    /// this fraction divided by the substep. \[1\]
    pub repair: f32,
    /// Softness of contacts: the fraction of an impulse that a contact gives back in each sweep,
    /// from 0 (rigid) to below 1. \[1\]
    pub softness: f32,
    /// Overlap that is not repaired. \[m\]
    pub slop: f32,
    /// Largest speed at which overlap is repaired. \[m/s\]
    pub max_repair_speed: f32,
    /// Rate at which a sticking contact returns to the point where it stuck, as a fraction of its
    /// slip per second. \[1/s\]
    pub stick_rate: f32,
    /// Largest error of the velocities of an island: their distance from the exact solution of its
    /// contacts, root mean square by mass. Stronger methods follow the sweeps of a substep until a
    /// proven bound is below it. With friction the bound holds for the slip at hand. 0 means sweeps
    /// alone. \[m/s\]
    pub tolerance: f32,
    /// True if each step ends with a certificate of its last substep, even without a `tolerance`. A
    /// certificate bounds the error of the velocities, and has the residuals of the contacts.
    pub certify: bool,
    /// Largest number of iterations of Newton's method, the strongest, on an island. \[1\]
    pub newton_iterations: u32,
    /// Largest penetration of a contact that carries the weight of its whole island, or 1/64 of the
    /// thinnest body of the island if that is less. A contact that `softness` leaves softer is made
    /// as stiff as this needs. It has no effect without `tolerance`. \[m\]
    pub sag: f32,
    /// Largest distance by which a locked joint gives way that carries the weight of all bodies that
    /// joints connect with it. \[m\]
    pub stretch: f32,
    /// Law for contacts that collide at once. `reflections` is symmetric, and passes an impact
    /// through a row of touching balls. `poisson` compresses all contacts together, then expands
    /// them. `newton` takes one contact after the other.
    #[cfg_attr(feature = "serde", serde(with = "ImpactLawName"))]
    pub impact_law: ImpactLaw,
    /// Smallest speed of approach at which a contact bounces. \[m/s\]
    pub restitution_threshold: f32,
    /// Largest distance of two shapes that have a contact before they touch (speculative contact).
    /// \[m\]
    pub prediction_distance: f32,
    /// Largest relative motion of two near bodies between two contact searches, as a fraction of
    /// the thinner one's smallest extent. Within a step, contacts are searched again before it is
    /// exceeded. \[1\]
    pub travel_per_search: f32,
    /// Largest number of contact searches per step. \[1\]
    pub max_searches: u32,
    /// Largest relative motion of two bodies that reuse their contact points, if it is also below
    /// 1/32 of the thinner shape. Gaps of reused points are measured again, and impulses act at the
    /// old positions until these have moved by this distance. Points are kept unchanged while
    /// neither body moves by a quarter of it, or by 1 % of its size. In steps with several searches
    /// the distance is at least a quarter of `prediction_distance`. \[m\]
    pub reuse_distance: f32,
    /// Time after which an island at rest sleeps. Steps leave it out until something touches or
    /// moves it. 0 means never. \[s\]
    pub sleep_delay: f32,
    /// True if each step reports the sources and sinks of its energy. The motion does not depend on
    /// it.
    pub ledger: bool,
}

/// [`ImpactLaw`] as it is written.
#[cfg(feature = "serde")]
#[derive(Serialize, Deserialize)]
#[serde(remote = "ImpactLaw", rename_all = "lowercase")]
enum ImpactLawName {
    Newton,
    Poisson,
    Reflections,
}

impl StepSettings {
    /// Name, least and largest value of each setting that is a number.
    pub const RANGES: [(&'static str, f64, f64); 18] = [
        ("substeps", 1.0, 1000.0),
        ("max_substeps", 1.0, 1000.0),
        ("iterations", 1.0, 10_000.0),
        ("repair", 0.0, 1.0),
        ("softness", 0.0, 0.999),
        ("slop", 0.0, 1.0),
        ("max_repair_speed", 0.0, 1e6),
        ("stick_rate", 0.0, 1e6),
        ("tolerance", 0.0, 1e3),
        ("newton_iterations", 1.0, 10_000.0),
        ("sag", 1e-9, 1.0),
        ("stretch", 1e-12, 1.0),
        ("restitution_threshold", 0.0, 1e6),
        ("prediction_distance", 0.0, 1e3),
        ("travel_per_search", 0.001, 1e6),
        ("max_searches", 1.0, 1000.0),
        ("reuse_distance", 0.0, 1e3),
        ("sleep_delay", 0.0, 1e6),
    ];

    /// Checks all numbers against their [`RANGES`](Self::RANGES).
    ///
    /// # Errors
    /// A number is out of its range, or NaN.
    pub fn check(&self) -> Result<(), InputError> {
        let values = [
            f64::from(self.substeps),
            f64::from(self.max_substeps),
            f64::from(self.iterations),
            f64::from(self.repair),
            f64::from(self.softness),
            f64::from(self.slop),
            f64::from(self.max_repair_speed),
            f64::from(self.stick_rate),
            f64::from(self.tolerance),
            f64::from(self.newton_iterations),
            f64::from(self.sag),
            f64::from(self.stretch),
            f64::from(self.restitution_threshold),
            f64::from(self.prediction_distance),
            f64::from(self.travel_per_search),
            f64::from(self.max_searches),
            f64::from(self.reuse_distance),
            f64::from(self.sleep_delay),
        ];
        let all = Self::RANGES.iter().zip(values);
        all.into_iter().try_for_each(|(&(name, least, most), value)| {
            // Bounds in the precision of the setting.
            let [least, most] = [least, most].map(|bound| f64::from(bound as f32));
            input::within(format_args!("the setting {name}"), value, [least, most])
        })
    }

    /// For baking: stiff contacts, small overlaps, exact motion.
    pub const fn quality() -> Self {
        Self {
            substeps: 32,
            max_substeps: 128,
            iterations: 1,
            repair: 0.2,
            softness: 0.1,
            slop: 0.0,
            max_repair_speed: 1.0,
            stick_rate: 20.0,
            tolerance: 0.0,
            certify: false,
            newton_iterations: 40,
            sag: 1e-4,
            stretch: 1e-6,
            impact_law: ImpactLaw::Reflections,
            restitution_threshold: 0.1,
            prediction_distance: 0.02,
            travel_per_search: 0.1,
            max_searches: 32,
            reuse_distance: 5e-4,
            sleep_delay: 0.0,
            ledger: false,
        }
    }

    /// Returns the parameters that turn overlaps and gaps into target velocities, for a substep of
    /// `h` \[s\].
    pub(crate) fn repair_in(&self, h: f32) -> Repair<f32> {
        Repair {
            dt: h,
            rate: self.repair,
            slop: self.slop,
            max_repair_speed: self.max_repair_speed,
            stick_rate: self.stick_rate,
        }
    }

    /// For baking with proof: every substep is solved until its certificate is within 1 mm/s.
    pub const fn certified() -> Self {
        Self { substeps: 8, tolerance: 1e-3, certify: true, ..Self::quality() }
    }

    /// For games: the least work that keeps piles and stacks standing.
    pub const fn realtime() -> Self {
        Self {
            substeps: 4,
            max_repair_speed: 3.0,
            stick_rate: 5.0,
            travel_per_search: 1.0,
            max_searches: 4,
            reuse_distance: 0.01,
            sleep_delay: 0.5,
            stretch: 1e-5,
            ..Self::quality()
        }
    }
}

impl Default for StepSettings {
    fn default() -> Self {
        Self::quality()
    }
}
