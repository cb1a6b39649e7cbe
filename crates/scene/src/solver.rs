//! The table `solver` in the schema: names, types, defaults and words of the settings.
//!
//! They are those of `drystone::StepSettings`, which this crate does not depend on; a test of
//! `drystone-bake` compares the two.

use schemars::JsonSchema;
use serde::Serialize;

/// Settings of [`World::step`](crate::World::step).
///
/// Three presets: [`StepSettings::certified`] for baking with proof, [`StepSettings::quality`] for as
/// much work in every step (the default), and [`StepSettings::realtime`] for games.
#[derive(Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct StepSettings {
    /// Substeps per step: more make contacts stiffer and motion more exact. \[1\]
    substeps: u32,
    /// Without a `tolerance`, a step takes more substeps where bodies are small, up to so many: none is longer than the
    /// thinnest body that is awake takes to fall by 1/1024 of its thickness. \[1\]
    most_substeps: u32,
    /// Sweeps over all contacts per substep. \[1\]
    iterations: u32,
    /// Part of an overlap that is repaired in one substep, 0..1; the rate c_d of the notes is
    /// this over the substep. \[1\]
    repair: f32,
    /// Softness of the contacts in a substep: the part of an impulse that is given back in each
    /// sweep, 0 (rigid) to below 1. \[1\]
    softness: f32,
    /// Overlap that is left alone. \[m\]
    slop: f32,
    /// Fastest speed at which overlap is repaired. \[m/s\]
    push_speed: f32,
    /// Part of its slip by which a contact that sticks returns to where it stuck, per second.
    /// \[1/s\]
    hold: f32,
    /// How far the velocities of an island may be from the exact solution of its contacts, root mean
    /// square by mass: after the sweeps of each substep, stronger methods follow until a bound is
    /// below this, which with friction holds for the slip at hand. 0: the sweeps alone. \[m/s\]
    tolerance: f32,
    /// Whether each step ends with a certificate of its last substep, whatever the tolerance: how far its
    /// velocities can be from the exact ones, and the residuals of its contacts.
    certify: bool,
    /// Iterations that the strongest of these methods may use on an island. \[1\]
    budget: u32,
    /// How deep a contact may sink that carries the weight of its whole island, or 1/64 of the thinnest body of that
    /// if it is less; stiffer than `softness` asks for where that must be. Only with a `tolerance`. \[m\]
    sag: f32,
    /// What contacts that collide at once do with each other: `reflections` (symmetric, a blow passes
    /// through a row of touching balls), `poisson` (compression together, then expansion) or
    /// `newton` (one after the other).
    impact_law: ImpactLaw,
    /// Approach below this speed does not bounce. \[m/s\]
    restitution_threshold: f32,
    /// Shapes nearer than this have a contact before they touch. \[m\]
    prediction_distance: f32,
    /// Contacts are searched again within a step before two near bodies have passed more than this
    /// part of the thinner one's smallest extent. \[1\]
    travel_per_search: f32,
    /// Searches for contacts in a step, at most. \[1\]
    searches: u32,
    /// Contact points are reused while two bodies move less than this against each other, and than 3 % of the
    /// thinner shape: their gaps are measured, and bodies are pushed where they were until that has moved as far.
    /// They are left as they are while neither body moves by a quarter of it, or 1 % of its size. Where a step has
    /// several searches, they reuse them for a quarter of `prediction_distance` at least. \[m\]
    reuse_distance: f32,
    /// Time after which an island that holds still is left out of steps, until something touches or
    /// moves it. 0: never. \[s\]
    sleep: f32,
    /// Whether each step reports where its energy came from and where it went. Motion does not
    /// depend on it.
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
}
