//! `drystone bake`: reads a scene, simulates it and writes its motion.

mod arguments;
mod dump;
mod joints;
mod journal;
mod output;
mod progress;
mod record;
mod report;
mod summary;
mod words;

use std::collections::BTreeSet;
use std::num::NonZero;
use std::{fmt, thread};

use drystone::StepSettings;
use drystone_bake::check::{decompositions, keys};
use drystone_bake::recording::journal::Header;
use drystone_bake::{AnyWorld, Decompositions};
use drystone_scene::{Read, Scene};

use crate::failure::Failure;
use crate::print;
pub(crate) use arguments::BakeArguments;
use arguments::MAX_STEPS;
use dump::{Dump, Part};
use journal::BakeJournal;
pub(crate) use output::Format;
use output::Outputs;
use progress::Progress;
use record::{Bake, Length, listen};
use summary::Summary;

/// Simulated time of a scene that states none. \[s\]
const DURATION: f64 = 10.0;

/// Runs the command.
pub(crate) fn run(arguments: &BakeArguments) -> Result<(), Failure> {
    let outputs = Outputs::new(arguments)?;
    let read = drystone_bake::read(&arguments.scene)?;
    print_warnings(arguments, read.warnings.iter());
    print_warnings(arguments, keys(&read.scene).into_iter().map(|of| of.what));
    outputs.spare_layers(&read)?;
    arguments.frame_options.check(&read)?;
    outputs.check_folders()?;
    listen();
    let mut world = prepare(arguments, &read.scene)?;
    let threads = threads(arguments);
    world.set_threads(threads);
    // Stages are always timed, since a bake that is resumed may ask for a report only then.
    world.time_stages(true);
    let steps = steps(arguments, &read.scene)?;
    arguments.frame_options.steps(0..=steps as usize, read.scene.time_step)?;
    let dump_step = dump::step(arguments.dump_step, steps)?;
    let mut progress = Progress::new(arguments, steps);
    let header = Header { extras: outputs.extras(), ..Header::new(&read.scene, world.settings()) };
    let mut journal = BakeJournal::open(arguments, outputs.first(arguments), header)?;
    let length = Length { steps: steps as usize, dump_step: dump_step.map(|step| step as usize) };
    let baked = Bake::run(&mut world, &read.scene, length, &mut journal, &mut progress);
    if let Err(Failure::Diverged(_)) = baked {
        journal.discard(usize::MAX);
        return baked.map(|_| ());
    }
    let bake = baked?;
    let summary = Summary::new(&read.scene, &bake, &world.masses());
    let files = match write(arguments, &outputs, &read, &bake, &summary, threads) {
        Err(Failure::File(what)) => {
            return Err(Failure::File(format!("{what}; {}", journal.resume_command())));
        }
        files => files?,
    };
    journal.discard(bake.steps.len());
    if !arguments.quiet {
        let head = summary::Head { file: &arguments.scene, settings: world.settings(), threads };
        return print(&format!("{}{files}", summary.text(&read.scene, &head)));
    }
    // Even a quiet bake reports the faults that the audit found.
    print_warnings(arguments, summary.faults(&read.scene).into_iter());
    Ok(())
}

fn print_warnings(arguments: &BakeArguments, warnings: impl Iterator<Item = impl fmt::Display>) {
    let mut said = BTreeSet::new();
    for warning in warnings.map(|warning| warning.to_string()) {
        if said.insert(warning.clone()) {
            eprintln!("drystone: warning: {}: {warning}", arguments.scene.display());
        }
    }
}

fn prepare(arguments: &BakeArguments, scene: &Scene) -> Result<AnyWorld, Failure> {
    let in_file = |error: &dyn fmt::Display| {
        Failure::Input(format!("{}: {error}", arguments.scene.display()))
    };
    let mut known = Decompositions::of_user();
    let world = drystone_bake::build_with(scene, settings(arguments, scene)?, &mut known)
        .map_err(|error| in_file(&error))?;
    if !arguments.quiet {
        for finding in decompositions(scene, &mut known) {
            eprintln!("drystone: note: {}", finding.what);
        }
    }
    Ok(world)
}

fn settings(arguments: &BakeArguments, scene: &Scene) -> Result<StepSettings, Failure> {
    let preset = match (arguments.realtime, arguments.tolerance) {
        (true, _) => StepSettings { certify: true, ..StepSettings::realtime() },
        (false, Some(0.0)) => StepSettings { certify: true, ..StepSettings::quality() },
        (false, _) => StepSettings::certified(),
    };
    let mut settings = drystone_bake::settings(scene, preset)?;
    if let Some(substeps) = arguments.substeps {
        (settings.substeps, settings.max_substeps) = (substeps, substeps);
    }
    settings.iterations = arguments.iterations.unwrap_or(settings.iterations);
    settings.sleep_delay = arguments.sleep.map_or(settings.sleep_delay, |seconds| seconds as f32);
    settings.tolerance = arguments.tolerance.unwrap_or(settings.tolerance);
    settings.ledger |= arguments.ledger;
    Ok(settings)
}

fn threads(arguments: &BakeArguments) -> usize {
    let all = || thread::available_parallelism().map_or(1, NonZero::get);
    arguments.threads.map_or_else(all, |threads| threads as usize)
}

fn steps(arguments: &BakeArguments, scene: &Scene) -> Result<u32, Failure> {
    // Without the margin, rounding of the quotient would add a step to whole durations.
    let of = |seconds: f64| (seconds / scene.time_step * (1.0 - 1e-9)).ceil();
    let Some(seconds) = arguments.duration else {
        return Ok(arguments.steps.or(scene.steps).unwrap_or(of(DURATION) as u32));
    };
    if of(seconds) > f64::from(MAX_STEPS) {
        let longest = f64::from(MAX_STEPS) * scene.time_step;
        return Err(Failure::Input(format!(
            "--duration is {seconds} s; accepted: up to {longest} s, {MAX_STEPS} steps"
        )));
    }
    Ok(of(seconds) as u32)
}

fn write(
    arguments: &BakeArguments,
    outputs: &Outputs,
    read: &Read,
    bake: &Bake,
    summary: &Summary,
    threads: usize,
) -> Result<String, Failure> {
    let (mut files, warnings) = outputs.write(read, bake, &arguments.frame_options)?;
    print_warnings(arguments, warnings.iter());
    let header = Header::new(&read.scene, &bake.settings);
    if let Some(saved) = &bake.saved {
        let part = if arguments.dump_impacts { Part::Impacts } else { Part::Contacts };
        let step = arguments.dump_step.unwrap_or_default();
        let dump = Dump { scene: &read.scene, header: &header, step, part, saved };
        let (dumps, warnings) = dump.write(outputs.dumps())?;
        print_warnings(arguments, warnings.iter());
        files.extend(dumps);
    }
    if let Some(path) = &arguments.report {
        let scene = &arguments.scene;
        report::write(
            path,
            &report::ReportInput { scene, header: &header, threads, bake, summary },
        )?;
        files.push(path.clone());
    }
    Ok(files.iter().map(|path| format!("wrote        {}\n", output::describe(path))).collect())
}
