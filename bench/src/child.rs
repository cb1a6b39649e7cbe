//! Child processes: each engine runs in its own, so that engines do not share memory, and a crash
//! ends only one of them. The program starts itself. It requests each round on the child's standard
//! input, and reads one line of JSON per round.

use std::io::{self, BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde::{Deserialize, Serialize};

use crate::case::Case;
use crate::engines::{Effort, EngineKind, build};
use crate::judge::Judge;
use crate::run::{run, settled};

/// Answer of a child to the request of a round.
#[derive(Serialize, Deserialize)]
pub(crate) enum Answer {
    Ran(RunResult),
    Refused(String),
}

/// Result of a round.
#[derive(Serialize, Deserialize)]
pub(crate) struct RunResult {
    /// Time of each step. \[ms\]
    pub(crate) times: Vec<f64>,
    /// Hash of the final poses ([`crate::run::Run::fingerprint`]).
    pub(crate) end: u64,
    /// Judgement on the run; only in the first round.
    pub(crate) judgement: Option<Judgement>,
}

/// Quality of a run.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Judgement {
    /// Deepest overlap in the last quarter; `None` if a pose was not finite. \[m\]
    pub(crate) depth: Option<f64>,
    /// Largest miss of a joint in the whole run and in its last quarter, if there are joints; not
    /// finite if a pose was not. \[m\]
    pub(crate) gaps: Option<[f64; 2]>,
    /// Fraction of the bodies that stand where they started. \[1\]
    pub(crate) standing: f64,
    /// True if the scene is built to stand still.
    pub(crate) stands: bool,
}

/// Answers requests for rounds until the input ends.
///
/// # Errors
/// The answers cannot be written.
pub(crate) fn answer(
    case: &Case,
    kind: EngineKind,
    effort: Effort,
    threads: usize,
) -> io::Result<()> {
    let mut first = true;
    for question in io::stdin().lock().lines() {
        question?;
        let answer =
            round(case, kind, effort, threads, first).map_or_else(Answer::Refused, Answer::Ran);
        first = false;
        let mut out = io::stdout().lock();
        serde_json::to_writer(&mut out, &answer)?;
        writeln!(out)?;
        out.flush()?;
    }
    Ok(())
}

fn round(
    case: &Case,
    kind: EngineKind,
    effort: Effort,
    threads: usize,
    first: bool,
) -> Result<RunResult, String> {
    let mut engine =
        build(kind, &case.scene, effort, threads).map_err(|refusal| refusal.to_string())?;
    let judge = if first { Some(Judge::new(&case.scene)?) } else { None };
    let watched = judge.as_ref().filter(|_| !case.scene.joints.is_empty());
    let (mut gaps, mut poses) = ([0.0f64; 2], Vec::new());
    let run = run(case, &mut *engine, threads, |step, engine| {
        let Some(judge) = watched else { return };
        poses.clear();
        engine.write_poses(&mut poses);
        let gap = judge.gap(&poses).unwrap_or(f64::INFINITY);
        let late = step >= settled(case.steps);
        gaps = [gaps[0].max(gap), if late { gaps[1].max(gap) } else { gaps[1] }];
    })
    .map_err(|refusal| refusal.to_string())?;
    let judgement = judge.as_ref().map(|judge| {
        let depths: Option<Vec<f64>> =
            run.samples.iter().map(|poses| judge.deepest(poses)).collect();
        Judgement {
            depth: depths.map(|depths| depths.into_iter().fold(0.0, f64::max)),
            gaps: watched.map(|_| gaps),
            standing: judge.standing(&run.end, case.stand_tolerance),
            stands: case.stand_tolerance.is_some() || judge.starts_at_rest(),
        }
    });
    Ok(RunResult { end: run.fingerprint(), times: run.times, judgement })
}

/// A process that runs one scene in one engine.
pub(crate) struct Engine {
    child: Child,
    questions: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
}

impl Engine {
    /// Starts the process.
    ///
    /// # Errors
    /// The process cannot be started.
    pub(crate) fn start(
        case: &Case,
        kind: EngineKind,
        effort: Effort,
        threads: usize,
    ) -> io::Result<Self> {
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["--child", kind.name(), "--effort", &effort.to_string()]);
        command.args(["--steps", &case.steps.to_string(), "--threads", &threads.to_string()]);
        match &case.file {
            Some(file) => command.arg(absolute(file)?),
            None => command.args(["--scenes", &case.name]),
        };
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let (questions, answers) = (child.stdin.take(), child.stdout.take());
        let answers = answers.ok_or_else(|| io::Error::other("the child has no output"))?;
        Ok(Self { child, questions, answers: BufReader::new(answers) })
    }

    /// Lets the child run a round.
    ///
    /// # Errors
    /// The engine refused the scene, or the process ended.
    pub(crate) fn round(&mut self) -> Result<RunResult, String> {
        match self.ask() {
            Ok(Some(Answer::Ran(round))) => Ok(round),
            Ok(Some(Answer::Refused(why))) => Err(why),
            Ok(None) => {
                let status = self.child.wait().map_err(|error| error.to_string())?;
                Err(format!("its process ended: {status}"))
            }
            Err(error) => Err(format!("its process cannot be asked: {error}")),
        }
    }

    fn ask(&mut self) -> io::Result<Option<Answer>> {
        if let Some(questions) = &mut self.questions {
            // If the process has ended, reading its answer reports that.
            let _ = writeln!(questions);
        }
        let mut line = String::new();
        if self.answers.read_line(&mut line)? == 0 {
            return Ok(None);
        }
        Ok(Some(serde_json::from_str(&line)?))
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        self.questions = None;
        let _ = self.child.wait();
    }
}

/// Returns an absolute path, so that a name with a leading dash is not taken for an option.
fn absolute(file: &Path) -> io::Result<std::path::PathBuf> {
    std::path::absolute(file)
}
