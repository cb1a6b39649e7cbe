//! The table `solver` in the schema: names, types, defaults and words of the settings.
//!
//! They are those of `drystone::StepSettings`, which this crate does not depend on; a test of
//! `drystone-bake` compares the two.

use schemars::JsonSchema;
use serde::Serialize;

/// Settings of [`World::step`](crate::World::step).
///
/// Three presets: [`StepSettings::certified`] for baking with proof, [`StepSettings::quality`] (the
/// default) for baking with fixed work, and [`StepSettings::realtime`] for games.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct StepSettings {
    /// Number of substeps per step. More substeps make contacts stiffer and motion more exact.
    /// \[1\]
    substeps: u32,
    /// Largest number of substeps per step in a world without `tolerance`. Up to it, a substep is
    /// no longer than the thinnest awake body takes to fall by 1/1024 of its thickness. \[1\]
    max_substeps: u32,
    /// Number of sweeps over all contacts per substep. \[1\]
    iterations: u32,
    /// Fraction of an overlap that one substep repairs, from 0 to 1. The rate c_d of the notes is
    /// this fraction divided by the substep. \[1\]
    repair: f32,
    /// Softness of contacts: the fraction of an impulse that a contact gives back in each sweep,
    /// from 0 (rigid) to below 1. \[1\]
    softness: f32,
    /// Overlap that is not repaired. \[m\]
    slop: f32,
    /// Largest speed at which overlap is repaired. \[m/s\]
    max_repair_speed: f32,
    /// Rate at which a sticking contact returns to the point where it stuck, as a fraction of its
    /// slip per second. \[1/s\]
    stick_rate: f32,
    /// Largest error of the velocities of an island: their distance from the exact solution of its
    /// contacts, root mean square by mass. Stronger methods follow the sweeps of a substep until a
    /// proven bound is below it. With friction the bound holds for the slip at hand. 0 means sweeps
    /// alone. \[m/s\]
    tolerance: f32,
    /// True if each step ends with a certificate of its last substep, even without a `tolerance`. A
    /// certificate bounds the error of the velocities, and has the residuals of the contacts.
    certify: bool,
    /// Largest number of iterations of Newton's method, the strongest, on an island. \[1\]
    newton_iterations: u32,
    /// Largest penetration of a contact that carries the weight of its whole island, or 1/64 of the
    /// thinnest body of the island if that is less. A contact that `softness` leaves softer is made
    /// as stiff as this needs. It has no effect without `tolerance`. \[m\]
    sag: f32,
    /// Largest distance by which a locked joint gives way that carries the weight of all bodies that
    /// joints connect with it. \[m\]
    stretch: f32,
    /// Law for contacts that collide at once. `reflections` is symmetric, and passes an impact
    /// through a row of touching balls. `poisson` compresses all contacts together, then expands
    /// them. `newton` takes one contact after the other.
    impact_law: ImpactLaw,
    /// Smallest speed of approach at which a contact bounces. \[m/s\]
    restitution_threshold: f32,
    /// Largest distance of two shapes that have a contact before they touch (speculative contact).
    /// \[m\]
    prediction_distance: f32,
    /// Largest relative motion of two near bodies between two contact searches, as a fraction of
    /// the thinner one's smallest extent. Within a step, contacts are searched again before it is
    /// exceeded. \[1\]
    travel_per_search: f32,
    /// Largest number of contact searches per step. \[1\]
    max_searches: u32,
    /// Largest relative motion of two bodies that reuse their contact points, if it is also below
    /// 1/32 of the thinner shape. Gaps of reused points are measured again, and impulses act at the
    /// old positions until these have moved by this distance. Points are kept unchanged while
    /// neither body moves by a quarter of it, or by 1 % of its size. In steps with several searches
    /// the distance is at least a quarter of `prediction_distance`. \[m\]
    reuse_distance: f32,
    /// Time after which an island at rest sleeps. Steps leave it out until something touches or
    /// moves it. 0 means never. \[s\]
    sleep_delay: f32,
    /// True if each step reports the sources and sinks of its energy. The motion does not depend on
    /// it.
    ledger: bool,
}

/// [`ImpactLaw`] as it is written.
#[derive(Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[expect(dead_code, reason = "the schema lists what a scene may say")]
enum ImpactLaw {
    Newton,
    Poisson,
    Reflections,
}

impl Default for StepSettings {
    fn default() -> Self {
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
}
