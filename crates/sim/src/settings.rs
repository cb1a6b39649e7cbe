//! How a step is taken: every number a user may turn, with its unit and effect.

use drystone_solver::Repair;
use drystone_solver::restitution::ImpactLaw;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

use crate::input::{self, InputError};

/// Settings of [`World::step`](crate::World::step).
///
/// Three presets: [`StepSettings::certified`] for baking with proof, [`StepSettings::quality`] for as
/// much work in every step (the default), and [`StepSettings::realtime`] for games.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields, default))]
pub struct StepSettings {
    /// Substeps per step: more make contacts stiffer and motion more exact. \[1\]
    pub substeps: u32,
    /// Without a `tolerance`, a step takes more substeps where bodies are small, up to so many: none is longer than the
    /// thinnest body that is awake takes to fall by 1/1024 of its thickness. \[1\]
    pub most_substeps: u32,
    /// Sweeps over all contacts per substep. \[1\]
    pub iterations: u32,
    /// Part of an overlap that is repaired in one substep, 0..1; the rate c_d of the notes is
    /// this over the substep. \[1\]
    pub repair: f32,
    /// Softness of the contacts in a substep: the part of an impulse that is given back in each
    /// sweep, 0 (rigid) to below 1. \[1\]
    pub softness: f32,
    /// Overlap that is left alone. \[m\]
    pub slop: f32,
    /// Fastest speed at which overlap is repaired. \[m/s\]
    pub push_speed: f32,
    /// Part of its slip by which a contact that sticks returns to where it stuck, per second.
    /// \[1/s\]
    pub hold: f32,
    /// How far the velocities of an island may be from the exact solution of its contacts, root mean
    /// square by mass: after the sweeps of each substep, stronger methods follow until a bound is
    /// below this, which with friction holds for the slip at hand. 0: the sweeps alone. \[m/s\]
    pub tolerance: f32,
    /// Whether each step ends with a certificate of its last substep, whatever the tolerance: how far its
    /// velocities can be from the exact ones, and the residuals of its contacts.
    pub certify: bool,
    /// Iterations that the strongest of these methods may use on an island. \[1\]
    pub budget: u32,
    /// How deep a contact may sink that carries the weight of its whole island, or 1/64 of the thinnest body of that
    /// if it is less; stiffer than `softness` asks for where that must be. Only with a `tolerance`. \[m\]
    pub sag: f32,
    /// What contacts that collide at once do with each other: `reflections` (symmetric, a blow passes
    /// through a row of touching balls), `poisson` (compression together, then expansion) or
    /// `newton` (one after the other).
    #[cfg_attr(feature = "serde", serde(with = "ImpactLawName"))]
    pub impact_law: ImpactLaw,
    /// Approach below this speed does not bounce. \[m/s\]
    pub restitution_threshold: f32,
    /// Shapes nearer than this have a contact before they touch. \[m\]
    pub prediction_distance: f32,
    /// Contacts are searched again within a step before two near bodies have passed more than this
    /// part of the thinner one's smallest extent. \[1\]
    pub travel_per_search: f32,
    /// Searches for contacts in a step, at most. \[1\]
    pub searches: u32,
    /// Contact points are reused while two bodies move less than this against each other, and than 3 % of the
    /// thinner shape: their gaps are measured, and bodies are pushed where they were until that has moved as far.
    /// They are left as they are while neither body moves by a quarter of it, or 1 % of its size. Where a step has
    /// several searches, they reuse them for a quarter of `prediction_distance` at least. \[m\]
    pub reuse_distance: f32,
    /// Time after which an island that holds still is left out of steps, until something touches or
    /// moves it. 0: never. \[s\]
    pub sleep: f32,
    /// Whether each step reports where its energy came from and where it went. Motion does not
    /// depend on it.
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
    pub const RANGES: [(&'static str, f64, f64); 17] = [
        ("substeps", 1.0, 1000.0),
        ("most_substeps", 1.0, 1000.0),
        ("iterations", 1.0, 10_000.0),
        ("repair", 0.0, 1.0),
        ("softness", 0.0, 0.999),
        ("slop", 0.0, 1.0),
        ("push_speed", 0.0, 1e6),
        ("hold", 0.0, 1e6),
        ("tolerance", 0.0, 1e3),
        ("budget", 1.0, 10_000.0),
        ("sag", 1e-9, 1.0),
        ("restitution_threshold", 0.0, 1e6),
        ("prediction_distance", 0.0, 1e3),
        ("travel_per_search", 0.001, 1e6),
        ("searches", 1.0, 1000.0),
        ("reuse_distance", 0.0, 1e3),
        ("sleep", 0.0, 1e6),
    ];

    /// Checks all numbers against their [`RANGES`](Self::RANGES).
    ///
    /// # Errors
    /// A number is out of its range, or NaN.
    pub fn check(&self) -> Result<(), InputError> {
        let values = [
            f64::from(self.substeps),
            f64::from(self.most_substeps),
            f64::from(self.iterations),
            f64::from(self.repair),
            f64::from(self.softness),
            f64::from(self.slop),
            f64::from(self.push_speed),
            f64::from(self.hold),
            f64::from(self.tolerance),
            f64::from(self.budget),
            f64::from(self.sag),
            f64::from(self.restitution_threshold),
            f64::from(self.prediction_distance),
            f64::from(self.travel_per_search),
            f64::from(self.searches),
            f64::from(self.reuse_distance),
            f64::from(self.sleep),
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
            most_substeps: 128,
            iterations: 1,
            repair: 0.2,
            softness: 0.1,
            slop: 0.0,
            push_speed: 1.0,
            hold: 20.0,
            tolerance: 0.0,
            certify: false,
            budget: 40,
            sag: 1e-4,
            impact_law: ImpactLaw::Reflections,
            restitution_threshold: 0.1,
            prediction_distance: 0.02,
            travel_per_search: 0.1,
            searches: 32,
            reuse_distance: 5e-4,
            sleep: 0.0,
            ledger: false,
        }
    }

    /// How overlaps and gaps become target velocities in a substep of `h` \[s\].
    pub(crate) fn repair_in(&self, h: f32) -> Repair<f32> {
        Repair {
            dt: h,
            rate: self.repair,
            slop: self.slop,
            push_speed: self.push_speed,
            hold: self.hold,
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
            push_speed: 3.0,
            hold: 5.0,
            travel_per_search: 1.0,
            searches: 4,
            reuse_distance: 0.01,
            sleep: 0.5,
            ..Self::quality()
        }
    }
}

impl Default for StepSettings {
    fn default() -> Self {
        Self::quality()
    }
}
