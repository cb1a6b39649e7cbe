//! Drystone without other engines: time by stage, time per contact, memory per body.

use drystone::{Stage, StepSettings};

use crate::Options;
use crate::case::Case;
use crate::engines::{Drystone, Refusal};
use crate::run::{mean, per_step, run, settled, undisturbed};
use crate::table::{Table, number};

/// Prints the wall time of each stage: the 10th percentile over the steps of the last quarter of
/// all rounds. A median would charge interruptions to the longest stages.
///
/// # Errors
/// Drystone does not support the scene.
pub(crate) fn stages(cases: &[Case], options: &Options) -> Result<(), Refusal> {
    let mut head = vec!["us per step"];
    head.extend(Stage::ALL.map(Stage::name));
    head.push("all");
    let mut table = Table::new(&head);
    for case in cases {
        let late = settled(case.steps);
        let mut times = vec![Vec::new(); Stage::ALL.len()];
        for _ in 0..options.rounds {
            let engine = Drystone::new(&case.scene, StepSettings::realtime(), options.threads)?;
            run(case, &mut engine.timed(), options.threads, |step, engine| {
                for (times, time) in times.iter_mut().zip(&engine.report.stages) {
                    if step >= late {
                        times.push(time.as_secs_f64() * 1e6);
                    }
                }
            })?;
        }
        let each: Vec<f64> = times.into_iter().map(undisturbed).collect();
        let all: f64 = each.iter().sum();
        let mut cells = vec![case.name.clone()];
        cells.extend(each.iter().map(|&x| format!("{} ({:.0} %)", number(x), 100.0 * x / all)));
        cells.push(number(all));
        table.row(cells);
    }
    table.print(options.markdown);
    println!();
    println!(
        "Drystone, realtime settings, {} thread(s); last quarter of the steps, {} rounds; a tenth of \
         the steps are faster.",
        options.threads, options.rounds
    );
    Ok(())
}

/// Prints the time per contact and step, which is constant if it does not depend on the size of the
/// pile.
///
/// # Errors
/// Drystone does not support the scene.
pub(crate) fn flat(cases: &[Case], options: &Options) -> Result<(), Refusal> {
    let mut table = Table::new(&[
        "settings",
        "scene",
        "contacts",
        "ms per step",
        "ns per contact",
        "bytes per body",
    ]);
    let presets = [("realtime", StepSettings::realtime()), ("quality", StepSettings::quality())];
    for (name, settings) in presets {
        let mut rounds: Vec<Vec<Vec<f64>>> = cases.iter().map(|_| Vec::new()).collect();
        let mut contacts = vec![0.0; cases.len()];
        let mut bytes = vec![0.0f64; cases.len()];
        for round in 1..=options.rounds {
            for (number, case) in cases.iter().enumerate() {
                eprintln!("{name}, {}: round {round} of {}", case.name, options.rounds);
                let before = resident();
                let mut engine = Drystone::new(&case.scene, settings.clone(), options.threads)?;
                let late = settled(case.steps);
                let mut counts = Vec::new();
                let run = run(case, &mut engine, options.threads, |step, engine| {
                    if step >= late {
                        counts.push(engine.report.contacts as f64);
                    }
                })?;
                let own = (resident() - before) / case.scene.bodies.len() as f64;
                bytes[number] = bytes[number].max(own);
                rounds[number].push(run.times);
                contacts[number] = mean(&counts);
            }
        }
        let mut per_contact = Vec::new();
        for (((case, rounds), contacts), bytes) in
            cases.iter().zip(&rounds).zip(&contacts).zip(&bytes)
        {
            let time = per_step(rounds, settled(case.steps));
            per_contact.push(time * 1e6 / contacts);
            table.row(vec![
                name.to_string(),
                case.name.clone(),
                format!("{contacts:.0}"),
                number(time),
                number(time * 1e6 / contacts),
                format!("{bytes:.0}"),
            ]);
        }
        let most = per_contact.iter().copied().fold(0.0, f64::max);
        table.row(vec![
            name.to_string(),
            "the most / the first".to_string(),
            String::new(),
            String::new(),
            format!("{:.2}", most / per_contact[0]),
            String::new(),
        ]);
    }
    table.print(options.markdown);
    Ok(())
}

/// Returns the resident memory of the process \[B\]; 0 where Linux does not report it.
fn resident() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse().ok());
    1024.0 * kilobytes.unwrap_or(0.0)
}
