//! Summary of a bake: a few numbers for the report, and a text for the terminal.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use drystone::{Jam, Ledger, Measure, StepSettings};
use drystone_bake::audit::{Audit, Overlap, audit, gained_most};
use drystone_bake::recording::journal::Step;
use drystone_scene::{BodiesAs, Body, Joint, Motion, Scene, SurfaceVelocity};
use serde::Serialize;

use super::joints::JointSummary;
use super::record::Bake;
use super::words::counted;

/// Energy above the initial energy that counts as rounding, as a fraction of the energy that the
/// run converts. \[1\]
const ENERGY_TOLERANCE: f64 = 1e-3;
/// Speed of all bodies whose energy counts as rounding: the tolerance of a bake. \[m/s\]
const ROUNDING: f64 = 1e-3;
/// Largest displacement over the last second of a body at rest. \[m\]
const AT_REST: f64 = 1e-3;
/// Initial overlap above which the summary mentions it. \[m\]
const OVERLAP: f64 = 1e-4;
/// Number of bodies that the text names before it counts the rest.
const NAMED: usize = 3;

/// Numbers of a run.
#[derive(Serialize)]
pub(super) struct Summary {
    dynamic: usize,
    r#static: usize,
    kinematic: usize,
    /// Dynamic bodies that follow a track until they are released.
    released: usize,
    /// Bodies with meshes that deform.
    deforming: usize,
    /// Bodies with a surface velocity, such as conveyor belts.
    running: usize,
    /// Joints with springs or motors.
    driven: usize,
    /// Simulated time. \[s\]
    simulated: f64,
    /// Number of steps.
    steps: usize,
    /// Minimum and maximum over the steps.
    substeps: [u32; 2],
    contacts_mean: f64,
    contacts_max: usize,
    /// Bodies asleep at the end.
    asleep: usize,
    step_ms_median: f64,
    total_ms: f64,
    /// Deepest penetration in any step. \[m\]
    deepest_penetration: f64,
    /// Deepest penetration in the last second. \[m\]
    settled_penetration: f64,
    /// Deepest overlap that the audit finds in the initial state. \[m\]
    initial_penetration: f64,
    /// Initial energy, kinetic plus potential. \[J\]
    energy_start: f64,
    /// Final energy, kinetic plus potential. \[J\]
    energy_end: f64,
    /// Maximum rise of the energy above an earlier one. \[J\]
    energy_rise: f64,
    /// First step after which the energy exceeds an earlier one by more than the tolerance. Also
    /// names the body that has gained most in the largest rise. Absent unless `energy_created` is
    /// true.
    #[serde(skip_serializing_if = "Option::is_none")]
    energy_risen: Option<Risen>,
    /// Rise that counts as rounding. \[J\]
    energy_tolerance: f64,
    /// True if energy was created: by contacts according to the ledger, else by the energy rise.
    /// Absent without a ledger if kinematic bodies, bodies on tracks, deforming meshes, surface
    /// velocities, motors or springs may have added energy.
    energy_created: Option<bool>,
    /// Sums over the energy ledgers of the steps; absent without them.
    ledger: Option<EnergySummary>,
    /// Largest residual in any step. \[m/s\]
    residual_worst: f64,
    /// Residual of the last step. \[m/s\]
    residual_last: f64,
    /// Certified accuracy of the contact solutions; absent if nothing was certified.
    certified: Option<Certified>,
    /// Bodies in jammed contacts, whose targets no velocities can meet; each with its first such
    /// step.
    jammed: BTreeMap<u32, usize>,
    /// Joints in jams, likewise.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    jammed_joints: BTreeMap<u32, usize>,
    /// Speed of the fastest body at the end. \[m/s\]
    fastest: f64,
    fastest_body: Option<usize>,
    /// Largest displacement of a dynamic body over the last second. \[m\]
    moved: f64,
    moved_body: Option<usize>,
    /// Misses and breaks of joints; absent without joints.
    #[serde(skip_serializing_if = "Option::is_none")]
    joints: Option<JointSummary>,
    /// True if any shape has friction and bodies are rigid.
    friction: bool,
    /// Result of the audit: overlaps and passages measured from shapes and poses alone.
    audit: Audit,
}

/// First energy gain beyond the tolerance.
#[derive(Serialize)]
struct Risen {
    /// Step, counted from 1.
    step: usize,
    body: usize,
    /// Energy that this body has gained. \[J\]
    gain: f64,
}

/// Sums over the energy ledgers of all steps.
#[derive(Serialize)]
struct EnergySummary {
    /// Sum of each ledger item over all steps. \[J\]
    items: BTreeMap<&'static str, f64>,
    /// Maximum over time of the energy that contacts have given minus the energy they have taken
    /// since the start. Soft contacts act as springs and return energy that they took earlier.
    /// \[J\]
    created: f64,
    /// Step in which contacts gave most energy, and that energy. \[J\]
    worst_step: usize,
    worst: f64,
}

/// Bounds on the velocity error of the worst island, root mean square weighted by mass.
#[derive(Serialize)]
struct Certified {
    /// Requested tolerance. \[m/s\]
    tolerance: f64,
    /// Number of steps in which all islands were within the tolerance.
    steps: usize,
    /// Number of islands: the maximum over the substeps of each step, summed over the steps.
    islands: usize,
    /// Maximum and median over the steps of the largest error of an island. \[m/s\]
    worst: f64,
    median: f64,
    /// Step and body with the worst error.
    worst_step: usize,
    worst_body: Option<u32>,
    /// Maximum over the steps, in the last substep of each: residual of Coulomb's law, approach
    /// speed beyond a target, and cone violation. \[m/s\]
    natural_residual: f64,
    approach_error: f64,
    cone: f64,
    /// NNCG iterations, summed over all substeps.
    iterations: usize,
    /// Islands that needed Newton's method, summed over all substeps.
    newton: usize,
}

impl Certified {
    /// States the median and the worst bound. A rigid contact that misses its target has none.
    fn spread(&self, place: &str) -> String {
        let mm = |speed: f64| format!("within {:.3} mm/s", speed * 1e3);
        let (half, all) = (mm(self.median), mm(self.worst));
        match (self.median.is_finite(), self.worst.is_finite()) {
            (true, true) => format!(
                "{half} of the exact contact solution in half of the steps, {all} in all (root \
                 mean square; {place})"
            ),
            (true, false) => format!(
                "{half} of the exact contact solution in half of the steps (root mean square); \
                 without a bound {place}"
            ),
            (false, _) => format!("without a bound in half of the steps, as {place}"),
        }
    }
}

/// Further input of the text.
pub(super) struct Head<'a> {
    pub(super) file: &'a Path,
    pub(super) settings: &'a StepSettings,
    pub(super) threads: usize,
}

/// Returns true if a body or one of its shapes has a surface velocity.
fn runs(body: &Body) -> bool {
    let mut motions = body.shapes.iter().map(|of| of.surface_velocity.as_ref());
    let own = body.surface_velocity.as_ref();
    motions.any(|of| of.or(own).is_some_and(SurfaceVelocity::runs))
}

/// Returns the deepest overlap after a step. \[m\]
fn depth_of(step: &Step) -> f64 {
    step.measure.deepest_penetration
}

/// Returns the number of bodies with a surface velocity.
fn running(scene: &Scene) -> usize {
    scene.bodies.iter().filter(|body| runs(body)).count()
}

/// Returns true if bodies, surfaces or joints of the scene move by themselves, and so may add
/// energy.
fn adds_energy(scene: &Scene) -> bool {
    let lifts = scene.track.gravities.iter().any(|gravity| *gravity != scene.gravity);
    lifts
        || scene.bodies.iter().any(|body| body.motion == Motion::Kinematic)
        || released(scene) + deforming(scene) + running(scene) + driven(scene) > 0
}

/// Returns the number of bodies with meshes that deform.
fn deforming(scene: &Scene) -> usize {
    let deforms = |body: &&Body| body.shapes.iter().any(|of| of.kind.vertex_track().is_some());
    scene.bodies.iter().filter(deforms).count()
}

/// Returns the number of dynamic bodies that follow a track until their release.
fn released(scene: &Scene) -> usize {
    let is_released = |body: &&Body| body.motion == Motion::Dynamic && !body.track.times.is_empty();
    scene.bodies.iter().filter(is_released).count()
}

/// Returns the number of joints with a motor or a spring.
fn driven(scene: &Scene) -> usize {
    scene.joints.iter().filter(|joint| drives(joint)).count()
}

/// Returns true if springs or motors act on a joint, or limits that give way like springs.
fn drives(joint: &Joint) -> bool {
    joint.enabled
        && joint.axes.iter().any(|axis| !axis.drives.is_empty() || axis.softness.is_some())
}

fn energy(measure: &Measure) -> f64 {
    measure.kinetic_energy + measure.potential_energy
}

/// Minimum and maximum number of substeps over the steps.
fn substeps(steps: &[Step]) -> [u32; 2] {
    let each = || steps.iter().map(|step| step.report.substeps).filter(|count| *count > 0);
    [each().min(), each().max()].map(Option::unwrap_or_default)
}

/// Audits the motion beside the penetrations that the steps measured.
fn audit_of(scene: &Scene, bake: &Bake) -> Audit {
    let known = bake.steps.iter().map(|step| step.measure.deepest_penetration);
    // The first frame has no contacts yet.
    let known: Vec<f64> = std::iter::once(0.0).chain(known).collect();
    audit(scene, &bake.recording, &bake.settings, &known)
}

/// Returns the times of the steps, the shortest first. \[ms\]
fn times(steps: &[Step]) -> Vec<f64> {
    let mut times: Vec<f64> = steps.iter().map(|step| step.time.as_secs_f64() * 1e3).collect();
    times.sort_unstable_by(f64::total_cmp);
    times
}

impl Summary {
    /// Summarizes a run.
    pub(super) fn new(scene: &Scene, bake: &Bake, masses: &[f64]) -> Self {
        let (audit, steps) = (audit_of(scene, bake), &bake.steps);
        let count = |motion| scene.bodies.iter().filter(|body| body.motion == motion).count();
        let last_second = ((1.0 / scene.time_step).round() as usize).clamp(1, steps.len().max(1));
        let settled = &steps[steps.len().saturating_sub(last_second)..];
        let contacts = || steps.iter().map(|step| step.report.contacts);
        let largest = |numbers: &mut dyn Iterator<Item = f64>| numbers.fold(0.0, f64::max);
        let end = steps.last().map_or(bake.start, |step| step.measure);
        let moving = bake.moved_most(scene, last_second);
        let start = energy(&bake.start);
        let energy_tolerance = energy_tolerance(bake, masses);
        let rises = Rises::of(bake, energy_tolerance);
        let ledger = energy_summary(bake);
        let energy_created = match &ledger {
            Some(sums) => Some(sums.created > energy_tolerance),
            None => (!adds_energy(scene)).then_some(rises.first.is_some()),
        };
        let times = times(steps);
        Self {
            dynamic: count(Motion::Dynamic),
            r#static: count(Motion::Static),
            kinematic: count(Motion::Kinematic),
            released: released(scene),
            deforming: deforming(scene),
            running: running(scene),
            driven: driven(scene),
            simulated: scene.simulated(steps.len()),
            steps: steps.len(),
            substeps: substeps(steps),
            contacts_mean: contacts().sum::<usize>() as f64 / steps.len().max(1) as f64,
            contacts_max: contacts().max().unwrap_or(0),
            asleep: steps.last().map_or(0, |step| step.report.asleep),
            step_ms_median: times.get(times.len() / 2).copied().unwrap_or(0.0),
            total_ms: times.iter().sum(),
            deepest_penetration: largest(&mut steps.iter().map(depth_of)),
            settled_penetration: largest(&mut settled.iter().map(depth_of)),
            initial_penetration: audit.start.as_ref().map_or(0.0, |of| of.depth),
            energy_start: start,
            energy_end: energy(&end),
            energy_rise: rises.most,
            energy_risen: (energy_created == Some(true))
                .then(|| risen(scene, bake, masses, &rises))
                .flatten(),
            energy_tolerance,
            energy_created,
            ledger,
            residual_worst: largest(&mut steps.iter().map(|step| step.measure.residual)),
            residual_last: end.residual,
            certified: certified(bake),
            jammed: jammed(bake, |jam| &jam.bodies),
            jammed_joints: jammed(bake, |jam| &jam.joints),
            fastest: end.fastest,
            fastest_body: moving_body(bake.moved_most(scene, 1)),
            moved: moving.map_or(0.0, |(_, distance)| distance),
            moved_body: moving_body(moving),
            joints: JointSummary::new(scene, bake),
            friction: has_friction(scene),
            audit,
        }
    }

    /// Returns the summary as text.
    pub(super) fn text(&self, scene: &Scene, head: &Head<'_>) -> String {
        let mut out = String::new();
        for (title, line) in [
            ("scene", self.scene(scene, head)),
            ("simulated", self.length(scene, head)),
            ("time", self.time(head)),
            ("contacts", self.contacts()),
            ("penetration", self.penetration()),
            ("joints", self.joints.as_ref().map_or_else(String::new, |of| of.text(scene))),
            ("energy", self.energy()),
            (self.title(), self.certified(scene)),
            ("", self.bound_limits()),
            ("audit", self.audited(scene)),
            ("residual", self.residual()),
            ("motion", self.motion(scene)),
        ] {
            if !line.is_empty() {
                let _ = writeln!(out, "{title:<12} {line}");
            }
        }
        for line in self.notes(scene) {
            let _ = writeln!(out, "{:<12} {line}", "note");
        }
        out
    }

    fn scene(&self, scene: &Scene, head: &Head<'_>) -> String {
        let name = scene.name.as_ref().map_or_else(String::new, |name| format!(" ({name})"));
        format!(
            "{}{name}: {} bodies in {}D, {} dynamic, {} static, {} kinematic",
            head.file.display(),
            scene.bodies.len(),
            scene.dimension,
            self.dynamic,
            self.r#static,
            self.kinematic,
        )
    }

    fn length(&self, scene: &Scene, head: &Head<'_>) -> String {
        let iterations = head.settings.iterations;
        let substeps = match self.substeps {
            [fewest, most] if fewest < most => format!("{fewest} to {most} substeps"),
            [_, most] => counted(most as usize, "substep"),
        };
        let tolerance = head.settings.tolerance * 1e3;
        let work = match (tolerance > 0.0, iterations) {
            (true, _) => format!("each solved to {tolerance} mm/s"),
            (false, 1) => "1 sweep each".to_owned(),
            (false, _) => format!("{iterations} sweeps each"),
        };
        let steps = counted(self.steps, "step");
        format!(
            "{steps} of {:.4} ms, {:.3} s in all; {substeps}, {work}",
            scene.time_step * 1e3,
            self.simulated,
        )
    }

    fn time(&self, head: &Head<'_>) -> String {
        format!(
            "{:.3} ms per step (median), {:.2} s for all, on {}",
            self.step_ms_median,
            self.total_ms / 1e3,
            counted(head.threads, "thread"),
        )
    }

    fn contacts(&self) -> String {
        let sleepers = match self.asleep {
            0 => String::new(),
            1 => "; 1 body sleeps at the end, and has none".to_owned(),
            many => format!("; {many} bodies sleep at the end, and have none"),
        };
        let (mean, most) = (self.contacts_mean, self.contacts_max);
        format!("{mean:.1} points on average, {most} at most{sleepers}")
    }

    fn penetration(&self) -> String {
        let mm = |depth: f64| format!("{:.3} mm", depth * 1e3);
        let (most, settled) = (mm(self.deepest_penetration), mm(self.settled_penetration));
        format!("{most} at the deepest, {settled} in the last {}", self.last())
    }

    /// Names the last second, or the whole run if that is shorter.
    fn last(&self) -> String {
        if self.simulated < 0.9995 {
            format!("{:.3} s", self.simulated)
        } else {
            "second".to_owned()
        }
    }

    fn energy(&self) -> String {
        let (start, end) = (joule(self.energy_start), joule(self.energy_end));
        let (rise, tolerance) = (joule(self.energy_rise), joule(self.energy_tolerance));
        let verdict = match (self.energy_created, &self.ledger) {
            (None, _) => format!("; {} may add to it", self.sources()),
            (Some(false), _) => format!("; none was created (tolerance {tolerance})"),
            (Some(true), Some(sums)) => format!(
                "; contacts created {}, most of it, {}, in step {} (tolerance {tolerance})",
                joule(sums.created),
                joule(sums.worst),
                sums.worst_step
            ),
            (Some(true), None) => {
                format!("; it rose by {rise} (tolerance {tolerance})")
            }
        };
        format!("{start} at the start, {end} at the end{verdict}")
    }

    /// Names what may add energy.
    fn sources(&self) -> String {
        let all = [
            (self.kinematic, "kinematic bodies"),
            (self.released, "bodies on tracks"),
            (self.deforming, "deforming meshes"),
            (self.running, "running surfaces"),
            (self.driven, "motors and springs"),
        ];
        let there: Vec<_> = all.iter().filter(|(count, _)| *count > 0).map(|(_, it)| *it).collect();
        if there.len() < 3 { there.join(" and ") } else { there.join(", ") }
    }

    /// Title of the line about certificates. It says "certified" only if the audit found no missed
    /// contact.
    fn title(&self) -> &'static str {
        if self.audit.is_clean() { "certified" } else { "velocities" }
    }

    /// States what the certified error refers to, and what it does not bound.
    fn bound_limits(&self) -> String {
        match (&self.certified, self.friction) {
            (Some(of), true) if of.islands > 0 => {
                "bounded: velocities with overlap repair, as bodies move; friction for the slip \
                 at hand, not Coulomb's law itself"
            }
            _ => "",
        }
        .to_owned()
    }

    /// Describes the audit and its result.
    fn audited(&self, scene: &Scene) -> String {
        let of = &self.audit;
        let overlap = match &of.deepest {
            None => "no overlap".to_owned(),
            Some(deepest) => format!("deepest overlap {}", self.overlap(scene, deepest)),
        };
        let frames = counted(of.frames, "frame");
        let found = if of.is_clean() { "" } else { "; bodies overlap or tunneled, see the notes" };
        format!("{overlap} in {frames} measured by shapes alone{found}")
    }

    fn overlap(&self, scene: &Scene, of: &Overlap) -> String {
        let [a, b] = of.bodies.map(|body| scene.name_of(body));
        let time = of.frame as f64 * scene.time_step;
        format!("{:.3} mm, {a} and {b} at {time:.3} s", of.depth * 1e3)
    }

    /// Describes each fault that the audit found and contacts should have prevented.
    pub(super) fn faults(&self, scene: &Scene) -> Vec<String> {
        let of = &self.audit;
        let more = |count: usize| {
            let rest = count.saturating_sub(NAMED);
            if rest > 0 { format!(", and {rest} more") } else { String::new() }
        };
        let mut lines = Vec::new();
        if !of.passages.is_empty() {
            let through = of.passages.iter().take(NAMED).map(|passage| {
                let [a, b] = passage.bodies.map(|body| scene.name_of(body));
                format!("{a} through {b} at {:.3} s", passage.frame as f64 * scene.time_step)
            });
            let through = through.collect::<Vec<_>>().join(", ");
            lines.push(format!("tunneled through a surface: {through}{}", more(of.passages.len())));
        }
        if !of.overlaps.is_empty() {
            let inside = of.overlaps.iter().take(NAMED).map(|of| {
                format!("{} (accepted: {:.3} mm)", self.overlap(scene, of), of.accepted * 1e3)
            });
            let inside = inside.collect::<Vec<_>>().join(", ");
            lines.push(format!("overlapped too deeply: {inside}{}", more(of.overlaps.len())));
        }
        if !of.fallen.is_empty() {
            let named = names(scene, &of.fallen);
            lines.push(format!("fell below all surfaces that could carry it: {named}"));
        }
        lines
    }

    fn certified(&self, scene: &Scene) -> String {
        if self.dynamic == 0 {
            return "nothing: no body moves by itself".to_owned();
        }
        let Some(of) = &self.certified else {
            return "nothing was proven; ask for it with --tolerance 1mm/s".to_owned();
        };
        if of.islands == 0 {
            return "nothing: nothing touched, so there were no contacts to solve".to_owned();
        }
        let mm = |speed: f64| format!("{:.3} mm/s", speed * 1e3);
        let all = self.steps;
        let worst = if of.worst.is_finite() {
            format!("worst {}", mm(of.worst))
        } else {
            "no bound".to_owned()
        };
        let body = of
            .worst_body
            .map_or_else(String::new, |body| format!(", around {}", scene.name_of(body as usize)));
        let place = format!("in step {}{body}", of.worst_step);
        if of.tolerance <= 0.0 {
            return format!("the last substep of each step {}", of.spread(&place));
        }
        let within = mm(of.tolerance);
        if of.steps < all {
            return format!(
                "{} of {all} steps within {within} of the exact contact solution; {worst} {place}",
                of.steps
            );
        }
        let overlap = self.deepest_penetration * 1e3;
        let energy = match self.energy_created {
            Some(false) => ", no energy created",
            _ => "",
        };
        if !self.audit.is_clean() {
            return format!(
                "all {all} steps within {within} of the exact solution of the contacts that were \
                 found; bodies overlap or tunneled"
            );
        }
        format!(
            "all {all} steps within {within} of the exact contact solution (root mean square; \
             {worst}), deepest overlap {overlap:.3} mm{energy}"
        )
    }

    fn residual(&self) -> String {
        format!(
            "{:.2e} m/s at worst, {:.2e} m/s at the end",
            self.residual_worst, self.residual_last
        )
    }

    fn motion(&self, scene: &Scene) -> String {
        let Some(body) = self.fastest_body else {
            return "nothing moves at the end".to_owned();
        };
        format!("{} is the fastest at the end, {}", scene.name_of(body), speed(self.fastest))
    }

    /// Names the jammed bodies and the first step in which they were jammed.
    fn jam(&self, scene: &Scene) -> Option<String> {
        let first = *self.jammed.values().min()?;
        let bodies: Vec<usize> = self.jammed.keys().map(|&body| body as usize).collect();
        let named = names(scene, &bodies);
        let joints = self.jammed_joints.keys().map(|&joint| scene.joint_name_of(joint as usize));
        let joints: Vec<_> = joints.collect();
        let of = match joints.len() {
            0 => "contacts".to_owned(),
            1 => format!("contacts and of joint {}", joints[0]),
            _ => format!("contacts and of joints {}", first_few(&joints)),
        };
        Some(format!(
            "jammed from step {first}: {named}; no velocities satisfy the targets of their {of}"
        ))
    }

    /// Notes on unexpected results.
    fn notes(&self, scene: &Scene) -> Vec<String> {
        let mut lines = Vec::new();
        if self.energy_created == Some(true) {
            let created = self.ledger.as_ref().map_or(self.energy_rise, |sums| sums.created);
            let who = self.energy_risen.as_ref().map_or_else(String::new, |of| {
                format!(
                    ", from step {} ({:.3} s); {} gained most, {}",
                    of.step,
                    of.step as f64 * scene.time_step,
                    scene.name_of(of.body),
                    joule(of.gain)
                )
            });
            lines.push(format!("energy was created: {}{who}", joule(created)));
        }
        lines.extend(self.jam(scene));
        lines.extend(self.joints.as_ref().and_then(|of| of.breaks(scene, NAMED)));
        if let Some(of) = self.audit.start.as_ref().filter(|of| of.depth > OVERLAP) {
            let [a, b] = of.bodies.map(|body| scene.name_of(body));
            lines.push(format!(
                "{a} and {b} overlap by {:.3} mm at the start, and are pushed apart",
                of.depth * 1e3
            ));
        }
        lines.extend(self.faults(scene));
        if let Some(body) = self.moved_body.filter(|_| self.moved > AT_REST) {
            let far = self.moved * 1e3;
            lines.push(format!(
                "not at rest: {} moved {far:.1} mm in the last {}",
                scene.name_of(body),
                self.last()
            ));
        }
        lines
    }
}

fn energy_summary(bake: &Bake) -> Option<EnergySummary> {
    let ledgers = bake.steps.iter().map(|step| step.report.energy);
    let ledgers: Vec<_> = ledgers.collect::<Option<_>>()?;
    let mut total = Ledger::default();
    ledgers.iter().for_each(|ledger| total.join(ledger));
    let given = ledgers.iter().map(Ledger::by_contacts).enumerate();
    let (step, worst) = given.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let balance = ledgers.iter().scan(0.0, |balance, ledger| {
        *balance += ledger.by_contacts();
        Some(*balance)
    });
    Some(EnergySummary {
        items: total.items().into_iter().collect(),
        created: balance.fold(0.0, f64::max),
        worst_step: step + 1,
        worst,
    })
}

/// Names the first few bodies and counts the rest.
fn names(scene: &Scene, bodies: &[usize]) -> String {
    first_few(&bodies.iter().map(|&body| scene.name_of(body)).collect::<Vec<_>>())
}

/// Lists the first few names and counts the rest.
fn first_few(names: &[String]) -> String {
    let more = names.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", names[..names.len().min(NAMED)].join(", "))
}

/// Returns the bodies or the joints of jams, each with its first step.
fn jammed(bake: &Bake, of: impl Fn(&Jam) -> &[u32]) -> BTreeMap<u32, usize> {
    let mut first = BTreeMap::new();
    for (step, taken) in bake.steps.iter().enumerate() {
        for index in taken.report.jams.iter().flat_map(&of) {
            first.entry(*index).or_insert(step + 1);
        }
    }
    first
}

fn certified(bake: &Bake) -> Option<Certified> {
    let outcomes = bake.steps.iter().enumerate();
    let outcomes: Vec<_> =
        outcomes.filter_map(|(step, of)| Some((step, of.report.certified?))).collect();
    // The first of equal ones: several steps may have no bound.
    let (step, worst) = *outcomes.iter().rev().max_by(|a, b| a.1.error.total_cmp(&b.1.error))?;
    // A step in which all bodies sleep has no islands, and nothing to certify.
    let awake = outcomes.iter().filter(|(_, of)| of.islands > 0);
    let mut errors: Vec<f64> = awake.map(|(_, of)| of.error).collect();
    errors.sort_unstable_by(f64::total_cmp);
    let residual = |i: usize| outcomes.iter().map(|(_, of)| of.residuals[i]).fold(0.0, f64::max);
    Some(Certified {
        tolerance: f64::from(bake.settings.tolerance),
        steps: outcomes.iter().filter(|(_, of)| of.failed == 0).count(),
        islands: outcomes.iter().map(|(_, of)| of.islands).sum(),
        worst: worst.error,
        median: errors.get(errors.len() / 2).copied().unwrap_or(0.0),
        natural_residual: residual(0),
        approach_error: residual(1),
        cone: residual(2),
        worst_step: step + 1,
        worst_body: worst.worst,
        iterations: outcomes.iter().map(|(_, of)| of.iterations).sum(),
        newton: outcomes.iter().map(|(_, of)| of.newton).sum(),
    })
}

/// Returns the energy above the initial energy that counts as rounding. \[J\]
fn energy_tolerance(bake: &Bake, masses: &[f64]) -> f64 {
    let mass: f64 = masses.iter().filter(|mass| mass.is_finite()).sum();
    ENERGY_TOLERANCE * turnover(bake) + 0.5 * mass * ROUNDING * ROUNDING
}

/// Maximum energy of the run above its minimum. \[J\]
fn turnover(bake: &Bake) -> f64 {
    let potential = |measure: &Measure| measure.potential_energy;
    let start = potential(&bake.start);
    let lowest = bake.steps.iter().map(|step| potential(&step.measure)).fold(start, f64::min);
    let kinetic = bake.steps.iter().map(|step| step.measure.kinetic_energy);
    kinetic.fold(bake.start.kinetic_energy + start - lowest, f64::max)
}

fn moving_body(moved: Option<(usize, f64)>) -> Option<usize> {
    moved.filter(|(_, distance)| *distance > 0.0).map(|(body, _)| body)
}

/// Returns true if bodies are rigid and any shape has friction.
fn has_friction(scene: &Scene) -> bool {
    let mut shapes = scene.bodies.iter().flat_map(|body| &body.shapes);
    scene.bodies_as == BodiesAs::Rigid && shapes.any(|shape| shape.material.friction > 0.0)
}

/// Rises of the energy above its lowest value before. Frames are counted from 0, the initial state.
struct Rises {
    /// The largest rise \[J\], and the frames between which it is.
    most: f64,
    frames: [usize; 2],
    /// First frame that is above an earlier one by more than the tolerance.
    first: Option<usize>,
}

impl Rises {
    fn of(bake: &Bake, tolerance: f64) -> Self {
        let mut lowest = (energy(&bake.start), 0);
        let mut rises = Self { most: 0.0, frames: [0; 2], first: None };
        for (frame, step) in (1..).zip(&bake.steps) {
            let now = energy(&step.measure);
            let rise = now - lowest.0;
            if rise > rises.most {
                (rises.most, rises.frames) = (rise, [lowest.1, frame]);
            }
            if rise > tolerance && rises.first.is_none() {
                rises.first = Some(frame);
            }
            if rise < 0.0 {
                lowest = (now, frame);
            }
        }
        rises
    }
}

/// Returns the step of the first rise, and the body that has gained most energy in the largest.
fn risen(scene: &Scene, bake: &Bake, masses: &[f64], rises: &Rises) -> Option<Risen> {
    let step = rises.first?;
    let (body, gain) = gained_most(scene, &bake.recording, masses, rises.frames)?;
    Some(Risen { step, body, gain })
}

fn joule(energy: f64) -> String {
    match energy.abs() {
        0.0 => "0 J".to_owned(),
        ..1e-3 => format!("{energy:.2e} J"),
        ..1e4 => format!("{energy:.3} J"),
        _ => format!("{energy:.0} J"),
    }
}

fn speed(speed: f64) -> String {
    match speed {
        ..1e-5 => "below 0.01 mm/s".to_owned(),
        ..0.1 => format!("{:.2} mm/s", speed * 1e3),
        _ => format!("{speed:.3} m/s"),
    }
}
