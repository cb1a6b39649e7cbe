//! Benchmark of Drystone and other engines on the same scenes, in alternating rounds.

mod alone;
mod case;
mod child;
mod compare;
/// Operation counter, shared with the solver's tests.
#[path = "../../crates/solver/tests/suite/common/counting.rs"]
mod counting;
mod engines;
mod frontier;
mod hold;
mod judge;
mod kernel;
mod made;
mod mechanisms;
mod run;
mod scenes;
mod shapes;
mod table;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

use engines::{Effort, EngineKind};

/// Run the same scenes in Drystone and other engines, and print times and overlaps.
#[derive(Parser)]
#[command(version)]
pub(crate) struct Options {
    /// Run these scene files, or all in these folders [default: the scenes made in code]
    paths: Vec<PathBuf>,
    /// Run only the scenes with these names, separated by commas
    #[arg(long, value_delimiter = ',')]
    scenes: Vec<String>,
    /// Run the scenes of joints, not those of contacts alone
    #[arg(long)]
    joints: bool,
    /// Run these engines, separated by commas [default: all of this build]
    #[arg(long, value_delimiter = ',', value_enum)]
    engines: Vec<EngineKind>,
    /// Run each scene so many times in each engine, in turn
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,
    /// Take so many steps in each scene, instead of its own number
    #[arg(long, value_parser = clap::value_parser!(u32).range(4..))]
    steps: Option<u32>,
    /// Use so many threads in each engine; with more than one, times are of the clock
    #[arg(long, default_value = "1", value_parser = threads)]
    threads: usize,
    /// Print markdown
    #[arg(long)]
    markdown: bool,
    /// Run every engine at several settings, and print time and overlap of each
    #[arg(long)]
    quality: bool,
    /// Draw the times and overlaps of --quality
    #[arg(long, value_name = "FILE", requires = "quality")]
    svg: Option<PathBuf>,
    /// Run Drystone alone, and print its time by stage
    #[arg(long, conflicts_with_all = ["quality", "engines"])]
    stages: bool,
    /// Run Drystone alone, and print its time per contact and its memory per body, in piles of 1000
    /// to 64 000 spheres or in other scenes
    #[arg(long, conflicts_with_all = ["quality", "engines", "stages"])]
    flat: bool,
    /// Run the sweep alone, and print its time beside the limits of the machine
    #[arg(long, exclusive = true)]
    kernel: bool,
    /// Run one engine on one scene, as the program starts itself
    #[arg(long, hide = true, value_enum)]
    child: Option<EngineKind>,
    /// Set the effort of the child
    #[arg(long, hide = true, default_value = "default")]
    effort: Effort,
}

fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(count @ 1..=64) => Ok(count),
        _ => Err("accepted: 1 to 64".to_string()),
    }
}

fn main() -> ExitCode {
    match work(&Options::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

fn work(options: &Options) -> Result<(), String> {
    if options.kernel {
        kernel::run();
        return Ok(());
    }
    let piles = ["sphere_pile_1000", "sphere_pile_8000", "sphere_pile_64000"].map(String::from);
    let names =
        if options.flat && options.scenes.is_empty() { &piles[..] } else { &options.scenes[..] };
    let mut cases = scenes::cases(&options.paths, names, options.joints)?;
    for case in &mut cases {
        case.steps = options.steps.map_or(case.steps, |steps| steps as usize);
        if case.steps < 4 {
            return Err(format!("{}: {} steps; accepted: at least 4", case.name, case.steps));
        }
    }
    if let Some(kind) = options.child {
        for case in &cases {
            child::answer(case, kind, options.effort, options.threads)
                .map_err(|error| error.to_string())?;
        }
        return Ok(());
    }
    if options.flat {
        return alone::flat(&cases, options).map_err(|refusal| refusal.to_string());
    }
    if options.stages {
        return alone::stages(&cases, options).map_err(|refusal| refusal.to_string());
    }
    if let Some(kind) = options.engines.iter().find(|kind| !kind.is_built()) {
        return Err(format!("{} is not in this build; build with --features peers", kind.name()));
    }
    let kinds: Vec<EngineKind> = match options.engines.as_slice() {
        [] => EngineKind::ALL.into_iter().filter(|kind| kind.is_built()).collect(),
        some => some.to_vec(),
    };
    if options.quality {
        return compare::quality(&cases, &kinds, options, options.svg.as_deref());
    }
    compare::table(&cases, &kinds, options);
    Ok(())
}
