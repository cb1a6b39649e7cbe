//! Comparison of engines: the table, and the tradeoff of time against overlap.

use std::path::Path;

use crate::Options;
use crate::case::Case;
use crate::child::{Engine, Judgement};
use crate::engines::{Effort, EngineKind};
use crate::frontier::{self, Frontier};
use crate::run::{mean, per_step, settled};
use crate::table::{Table, number};

/// Measurements of an engine on a scene.
struct Measured {
    kind: EngineKind,
    effort: Effort,
    /// Time of each step of each round. \[ms\]
    rounds: Vec<Vec<f64>>,
    judgement: Judgement,
}

impl Measured {
    fn standing(&self) -> String {
        match self.judgement.stands {
            true => format!("{:.0} %", 100.0 * self.judgement.standing),
            false => "-".to_string(),
        }
    }

    /// Formats the deepest overlap. \[mm\]
    fn overlap(&self) -> String {
        self.judgement.depth.map_or("not finite".to_string(), |depth| number(1e3 * depth))
    }

    /// Formats the largest miss of a joint: in the whole run, and in its last quarter. \[mm\]
    fn gaps(&self) -> [String; 2] {
        self.judgement.gaps.map_or(["-".into(), "-".into()], |gaps| {
            gaps.map(|gap| match gap.is_finite() {
                true => number(1e3 * gap),
                false => "not finite".to_string(),
            })
        })
    }
}

/// Runs a scene in all engines, round by round in turn. Appends to `left_out` the engines that
/// failed, and why.
fn measure(
    case: &Case,
    asked: &[(EngineKind, Effort)],
    options: &Options,
    left_out: &mut Vec<String>,
) -> Vec<Measured> {
    let mut running = Vec::new();
    let mut leave_out = |kind: EngineKind, effort: Effort, why: &str| {
        let effort = match effort {
            Effort::Default => String::new(),
            effort => format!(" ({effort})"),
        };
        let line = format!("{}: without {}{effort}: {why}", case.name, kind.name());
        eprintln!("{line}");
        left_out.push(line);
    };
    for &(kind, effort) in asked {
        if !kind.has_dimension(case.scene.dimension) {
            continue;
        }
        match Engine::start(case, kind, effort, options.threads) {
            Ok(engine) => running.push((engine, kind, effort, Vec::new(), Vec::new())),
            Err(error) => leave_out(kind, effort, &format!("no process for it: {error}")),
        }
    }
    for round in 1..=options.rounds {
        eprintln!("{}: round {round} of {}", case.name, options.rounds);
        running.retain_mut(|(engine, kind, effort, rounds, verdicts)| match engine.round() {
            Ok(round) => {
                rounds.push(round.times);
                verdicts.push((round.end, round.judgement));
                true
            }
            Err(why) => {
                leave_out(*kind, *effort, &why);
                false
            }
        });
    }
    let mut measured = Vec::new();
    for (_, kind, effort, rounds, verdicts) in running {
        if verdicts.iter().any(|(end, _)| *end != verdicts[0].0) {
            eprintln!("{}: {} ended differently in different rounds", case.name, kind.name());
        }
        if let Some(judgement) = verdicts.into_iter().find_map(|(_, judgement)| judgement) {
            measured.push(Measured { kind, effort, rounds, judgement });
        }
    }
    measured
}

/// Prints time and quality of every engine on every scene.
pub(crate) fn table(cases: &[Case], kinds: &[EngineKind], options: &Options) {
    let asked: Vec<_> = kinds.iter().map(|&kind| (kind, Effort::Default)).collect();
    let mut left_out = Vec::new();
    let mut table = Table::new(&[
        "scene",
        "dim",
        "bodies",
        "engine",
        "ms",
        "ratio",
        "settled ms",
        "ratio",
        "rounds",
        "overlap mm",
        "gap mm",
        "settled gap",
        "stand",
    ]);
    for case in cases {
        let late = settled(case.steps);
        let measured = measure(case, &asked, options, &mut left_out);
        for engine in &measured {
            let first = &measured[0].rounds;
            let whole = [first, &engine.rounds].map(|rounds| per_step(rounds, 0));
            let quarter = [first, &engine.rounds].map(|rounds| per_step(rounds, late));
            let ratios = first.iter().zip(&engine.rounds);
            let ratios = ratios.map(|(a, b)| mean(&a[late..]) / mean(&b[late..]));
            let (low, high) =
                ratios.fold((f64::MAX, 0.0f64), |(low, high), x| (low.min(x), high.max(x)));
            let [gap, late_gap] = engine.gaps();
            table.row(vec![
                case.name.clone(),
                case.scene.dimension.to_string(),
                case.dynamic_bodies().to_string(),
                engine.kind.name().to_string(),
                number(whole[1]),
                format!("{:.2}", whole[0] / whole[1]),
                number(quarter[1]),
                format!("{:.2}", quarter[0] / quarter[1]),
                format!("{low:.2}..{high:.2}"),
                engine.overlap(),
                gap,
                late_gap,
                engine.standing(),
            ]);
        }
    }
    table.print(options.markdown);
    println!();
    caption(kinds, options);
    println!(
        "ratio: time of the first engine of a scene by that of the engine; below 1, the first is \
         faster. settled: last quarter of the steps. rounds: lowest and highest ratio of settled \
         times of a single round."
    );
    notes(&left_out, kinds);
}

/// Prints time and overlap of every engine at several settings, and draws them.
///
/// # Errors
/// The picture cannot be written.
pub(crate) fn quality(
    cases: &[Case],
    kinds: &[EngineKind],
    options: &Options,
    svg: Option<&Path>,
) -> Result<(), String> {
    let asked: Vec<(EngineKind, Effort)> = kinds
        .iter()
        .flat_map(|&kind| kind.efforts().into_iter().map(move |effort| (kind, effort)))
        .collect();
    let mut left_out = Vec::new();
    let mut table = Table::new(&[
        "scene",
        "dim",
        "engine",
        "setting",
        "ms",
        "settled ms",
        "overlap mm",
        "gap mm",
        "stand",
    ]);
    let mut frontiers = Vec::new();
    for case in cases {
        let late = settled(case.steps);
        let mut frontier = Frontier::new(format!("{}, {}D", case.name, case.scene.dimension));
        for engine in measure(case, &asked, options, &mut left_out) {
            let settled_time = per_step(&engine.rounds, late);
            table.row(vec![
                case.name.clone(),
                case.scene.dimension.to_string(),
                engine.kind.name().to_string(),
                engine.effort.to_string(),
                number(per_step(&engine.rounds, 0)),
                number(settled_time),
                engine.overlap(),
                engine.gaps()[0].clone(),
                engine.standing(),
            ]);
            // The gaps of mechanisms count.
            let gap = engine.judgement.gaps.map(|gaps| gaps[0]).filter(|gap| gap.is_finite());
            let measure = if case.scene.joints.is_empty() { engine.judgement.depth } else { gap };
            if let Some(depth) = measure {
                let fallen = engine.judgement.stands && engine.judgement.standing < 1.0;
                let name = engine.effort.to_string();
                frontier.add(engine.kind, name, [settled_time, 1e3 * depth], fallen);
            }
        }
        frontiers.push(frontier);
    }
    table.print(options.markdown);
    println!();
    frontier::ratios(&frontiers).print(options.markdown);
    println!();
    caption(kinds, options);
    println!(
        "setting: substeps; jolt: collision steps. Substeps and contact stiffness of rapier, Box2D \
         and Box3D are raised together. sag: Drystone's settings for baking with proof, with contacts \
         that sink by so many mm under the weight of all that they bear. overlap below: settled time of \
         Drystone's cheapest setting that keeps it, by that of the cheapest of all others."
    );
    notes(&left_out, kinds);
    if let Some(file) = svg {
        std::fs::write(file, frontier::svg(&frontiers))
            .map_err(|error| format!("{}: cannot be written: {error}", file.display()))?;
    }
    Ok(())
}

fn caption(kinds: &[EngineKind], options: &Options) {
    let engines: Vec<_> =
        kinds.iter().map(|kind| format!("{} ({})", kind.name(), kind.version())).collect();
    println!("Engines: {}.", engines.join(", "));
    let time = if options.threads == 1 { "processor" } else { "wall clock" };
    println!(
        "{} rounds, {} thread(s), {time} time per step. Drystone: real-time settings; others: \
         their defaults; no sleeping.",
        options.rounds, options.threads
    );
}

fn notes(left_out: &[String], kinds: &[EngineKind]) {
    for line in left_out {
        println!("{line}");
    }
    let missing: Vec<_> =
        EngineKind::ALL.into_iter().filter(|kind| !kind.is_built()).map(EngineKind::name).collect();
    if !missing.is_empty() && kinds.iter().all(|kind| kind.is_built()) {
        println!("Not in this build: {}; build with --features peers.", missing.join(", "));
    }
}
