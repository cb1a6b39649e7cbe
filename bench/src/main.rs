//! Drystone and rapier on the same scenes, in one process, round after round.

mod engines;
mod judge;
mod scenes;
mod table;

use std::process::ExitCode;

use clap::Parser;
use cpu_time::ThreadTime;
use drystone::{Stage, StepSettings};

use engines::{Drystone, Engine, Placement, Rapier};
use judge::Judge;
use scenes::{NAMES, Scene};
use table::{Table, number};

/// Poses and contacts are looked at once in so many steps.
const SAMPLE: usize = 20;

/// Runs the same scenes through Drystone (realtime settings) and rapier (its defaults), one
/// thread each, and prints times and what came of it.
#[derive(Parser)]
#[command(version)]
struct Options {
    /// Scenes, with commas between; all if absent
    #[arg(long, value_delimiter = ',')]
    scenes: Vec<String>,
    /// Times each engine runs each scene, in turn
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,
    /// Steps of each scene instead of its own
    #[arg(long, value_parser = clap::value_parser!(u32).range(4..))]
    steps: Option<u32>,
    /// Prints markdown
    #[arg(long)]
    markdown: bool,
    /// Runs Drystone alone and prints its time by stage
    #[arg(long)]
    stages: bool,
    /// Runs Drystone alone and prints its time per contact in a small and a large pile
    #[arg(long, conflicts_with_all = ["scenes", "stages"])]
    flat: bool,
}

fn main() -> ExitCode {
    let options = Options::parse();
    let asked: Vec<&str> = match (options.flat, options.scenes.is_empty()) {
        (true, _) => vec!["sphere_pile_1000", "sphere_pile_8000"],
        (false, true) => NAMES.to_vec(),
        (false, false) => options.scenes.iter().map(String::as_str).collect(),
    };
    let mut scenes = Vec::new();
    for name in asked {
        let Some(mut scene) = scenes::scene(name) else {
            eprintln!("there is no scene {name}; the scenes are: {}", NAMES.join(", "));
            return ExitCode::FAILURE;
        };
        scene.steps = options.steps.map_or(scene.steps, |steps| steps as usize);
        scenes.push(scene);
    }
    if options.flat {
        flat(&scenes, &options);
    } else if options.stages {
        stages(&scenes, &options);
    } else {
        compare(&scenes, &options);
    }
    ExitCode::SUCCESS
}

/// One run of one engine.
struct Run {
    /// Processor time of each step. \[ms\]
    times: Vec<f64>,
    /// Now and then in the last quarter.
    samples: Vec<Vec<Placement>>,
    end: Vec<Placement>,
    /// Mean over the samples: manifolds and points.
    contacts: [f64; 2],
}

/// First step of the last quarter.
fn settled(steps: usize) -> usize {
    steps - steps / 4
}

fn run<E: Engine>(scene: &Scene, mut engine: E, mut after_step: impl FnMut(usize, &E)) -> Run {
    let mut times = Vec::with_capacity(scene.steps);
    let mut samples = Vec::new();
    let mut contacts = [0.0; 2];
    for step in 0..scene.steps {
        let start = ThreadTime::now();
        engine.step();
        times.push(start.elapsed().as_secs_f64() * 1e3);
        after_step(step, &engine);
        if step >= settled(scene.steps) && (scene.steps - 1 - step).is_multiple_of(SAMPLE) {
            samples.push(engine.placements());
            let now = engine.contacts();
            contacts = [0, 1].map(|i| contacts[i] + now[i] as f64);
        }
    }
    let contacts = contacts.map(|sum| sum / samples.len() as f64);
    Run { times, end: engine.placements(), samples, contacts }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let half = values.len() / 2;
    if values.len() % 2 == 1 { values[half] } else { 0.5 * (values[half - 1] + values[half]) }
}

/// The value that a tenth stay below.
fn undisturbed(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 10]
}

/// Time per step from step `from` on: of each step the median over the rounds, then the mean of
/// these, so that a disturbance counts only if it strikes the same step in most rounds. \[ms\]
fn per_step(runs: &[Run], from: usize) -> f64 {
    let steps = runs[0].times.len();
    let each: Vec<f64> = (from..steps)
        .map(|step| median(runs.iter().map(|run| run.times[step]).collect()))
        .collect();
    mean(&each)
}

fn compare(scenes: &[Scene], options: &Options) {
    let mut table = Table::new(&[
        "scene",
        "bodies",
        "manifolds D/R",
        "contacts D/R",
        "ms D",
        "ms R",
        "D/R",
        "settled D",
        "settled R",
        "D/R",
        "rounds",
        "overlap D mm",
        "overlap R mm",
        "stand D",
        "stand R",
    ]);
    for scene in scenes {
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for round in 1..=options.rounds {
            eprintln!("{}: round {round} of {}", scene.name, options.rounds);
            let drystone = Drystone::new(scene, StepSettings::realtime());
            ours.push(run(scene, drystone, |_, _| {}));
            theirs.push(run(scene, Rapier::new(scene), |_, _| {}));
        }
        for (engine, runs) in [("Drystone", &ours), ("rapier", &theirs)] {
            if runs.iter().any(|run| run.end != runs[0].end) {
                eprintln!("{}: {engine} ended differently in different rounds", scene.name);
            }
        }
        let late = settled(scene.steps);
        let whole = [&ours, &theirs].map(|runs| per_step(runs, 0));
        let quarter = [&ours, &theirs].map(|runs| per_step(runs, late));
        let ratios = ours.iter().zip(&theirs);
        let ratios = ratios.map(|(a, b)| mean(&a.times[late..]) / mean(&b.times[late..]));
        let (low, high) =
            ratios.fold((f64::MAX, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
        let judge = Judge::new(scene);
        let results = [&ours[0], &theirs[0]].map(|run| {
            let depths = run.samples.iter().map(|placements| judge.deepest(placements));
            let stand = format!("{:.0} %", 100.0 * judge.standing(&run.end));
            let stand = if scene.stands { stand } else { "-".to_string() };
            (number(1e3 * depths.fold(0.0, f64::max)), stand)
        });
        let contacts = [&ours[0], &theirs[0]].map(|run| run.contacts.map(|x| format!("{x:.0}")));
        let [(our_depth, our_stand), (their_depth, their_stand)] = results;
        table.row(vec![
            scene.name.to_string(),
            scene.bodies.iter().filter(|body| !body.fixed).count().to_string(),
            format!("{}/{}", contacts[0][0], contacts[1][0]),
            format!("{}/{}", contacts[0][1], contacts[1][1]),
            number(whole[0]),
            number(whole[1]),
            format!("{:.2}", whole[0] / whole[1]),
            number(quarter[0]),
            number(quarter[1]),
            format!("{:.2}", quarter[0] / quarter[1]),
            format!("{low:.2}..{high:.2}"),
            our_depth,
            their_depth,
            our_stand,
            their_stand,
        ]);
    }
    table.print(options.markdown);
    println!();
    println!(
        "D: Drystone, realtime settings; R: rapier 0.36, its defaults; one thread each, {} rounds. \
         Processor time per step.",
        options.rounds
    );
    println!(
        "settled: last quarter of the steps. rounds: lowest and highest ratio of settled times of \
         a single round."
    );
}

/// Wall time by stage: of the steps of the last quarter, all rounds together, the time that a
/// tenth of them stay below. A median would charge interruptions to the longest stages.
fn stages(scenes: &[Scene], options: &Options) {
    let mut head = vec!["us per step"];
    head.extend(Stage::ALL.map(Stage::name));
    head.push("all");
    let mut table = Table::new(&head);
    for scene in scenes {
        let late = settled(scene.steps);
        let mut times = vec![Vec::new(); Stage::ALL.len()];
        for _ in 0..options.rounds {
            let drystone = Drystone::new(scene, StepSettings::realtime());
            run(scene, drystone, |step, engine| {
                for (times, time) in times.iter_mut().zip(&engine.report.stages) {
                    if step >= late {
                        times.push(time.as_secs_f64() * 1e6);
                    }
                }
            });
        }
        let each: Vec<f64> = times.into_iter().map(undisturbed).collect();
        let all: f64 = each.iter().sum();
        let mut cells = vec![scene.name.to_string()];
        cells.extend(each.iter().map(|&x| format!("{} ({:.0} %)", number(x), 100.0 * x / all)));
        cells.push(number(all));
        table.row(cells);
    }
    table.print(options.markdown);
    println!();
    println!(
        "Drystone, realtime settings, one thread; last quarter of the steps, {} rounds; a tenth of \
         the steps are faster.",
        options.rounds
    );
}

/// Time per contact and step: flat if it does not depend on the size of the pile.
fn flat(scenes: &[Scene], options: &Options) {
    let mut table =
        Table::new(&["settings", "scene", "contacts", "ms per step", "ns per contact and step"]);
    let presets = [("realtime", StepSettings::realtime()), ("quality", StepSettings::quality())];
    for (name, settings) in presets {
        let mut per_contact = Vec::new();
        let mut runs: Vec<Vec<Run>> = scenes.iter().map(|_| Vec::new()).collect();
        for round in 1..=options.rounds {
            for (scene, runs) in scenes.iter().zip(&mut runs) {
                eprintln!("{name}, {}: round {round} of {}", scene.name, options.rounds);
                runs.push(run(scene, Drystone::new(scene, settings.clone()), |_, _| {}));
            }
        }
        for (scene, runs) in scenes.iter().zip(&runs) {
            let time = per_step(runs, settled(scene.steps));
            let contacts = runs[0].contacts[1];
            per_contact.push(time * 1e6 / contacts);
            table.row(vec![
                name.to_string(),
                scene.name.to_string(),
                format!("{contacts:.0}"),
                number(time),
                number(time * 1e6 / contacts),
            ]);
        }
        let growth = per_contact[1] / per_contact[0];
        table.row(vec![
            name.to_string(),
            "8000 / 1000".to_string(),
            String::new(),
            String::new(),
            format!("{growth:.2}"),
        ]);
    }
    table.print(options.markdown);
}
