//! Journal of a bake as the command uses it: begin, resume, and delete in the end.

use std::ffi::OsString;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{env, fs};

use drystone_bake::recording::Velocities;
use drystone_bake::recording::joints::JointFrame;
use drystone_bake::recording::journal::{Extras, FrameState, Header, Journal, Mark, Step};
use drystone_bake::{AnyCheckpoint, AnyWorld, PairImpulses};

use super::arguments::BakeArguments;
use crate::failure::Failure;

/// Content of a journal when its bake is resumed.
pub(super) struct Kept {
    pub(super) steps: Vec<Step>,
    pub(super) poses: Vec<f32>,
    pub(super) joints: Vec<JointFrame>,
    pub(super) velocities: Velocities,
    pub(super) impulses: Vec<PairImpulses>,
}

/// The journal of this bake.
pub(super) struct BakeJournal {
    path: PathBuf,
    header: Header,
    /// `None` until the journal is begun.
    journal: Option<Journal>,
    kept: Option<Kept>,
    /// Number of steps in the journal that was found.
    found: usize,
    marks: Vec<Mark>,
    /// Minimum time between checkpoints.
    every: Duration,
    last: Instant,
    /// Sizes of the last checkpoint and of the journal after it. \[byte\]
    sizes: [u64; 2],
}

impl BakeJournal {
    /// Looks for a journal beside the first output. Resumes it if that is requested. Otherwise
    /// refuses to discard the steps of a journal of this bake.
    pub(super) fn open(
        arguments: &BakeArguments,
        beside: &Path,
        header: Header,
    ) -> Result<Self, Failure> {
        let mut path = OsString::from(beside);
        path.push(".journal");
        let every = Duration::from_secs_f64(arguments.checkpoint);
        let mut journal = Self {
            path: path.into(),
            header,
            journal: None,
            kept: None,
            found: 0,
            marks: Vec::new(),
            every,
            last: Instant::now(),
            sizes: [0; 2],
        };
        let found = Journal::resume(&journal.path).map_err(|error| journal.refused(&error))?;
        let Some((found_journal, contents)) = found else { return Ok(journal) };
        let (difference, steps) =
            (contents.header.difference(&journal.header), contents.steps.len());
        match difference {
            None if arguments.resume => {
                if let Some(why) = contents.header.lack(&journal.header) {
                    return Err(journal.wrong(&format!(
                        "cannot be resumed: {why}; resume without, or delete it"
                    )));
                }
                journal.header = contents.header;
                journal.found = steps;
                journal.marks = contents.checkpoints;
                journal.kept = Some(Kept {
                    steps: contents.steps,
                    poses: contents.recording.poses,
                    joints: contents.joints,
                    velocities: contents.velocities,
                    impulses: contents.contacts,
                });
                journal.journal = Some(found_journal);
            }
            None if steps > 0 => {
                return Err(journal.wrong(&format!(
                    "has {steps} steps of this bake already; resume it with --resume, or delete it"
                )));
            }
            Some(why) if arguments.resume => {
                return Err(journal.wrong(&format!("cannot be resumed: {why}; delete it")));
            }
            // An empty journal, or that of another bake, is replaced.
            _ => {}
        }
        Ok(journal)
    }

    /// Returns what frames hold besides poses and joints.
    pub(super) fn extras(&self) -> Extras {
        self.header.extras
    }

    /// Takes the content of the resumed journal; `None` from the second call on.
    pub(super) fn kept(&mut self) -> Option<Kept> {
        self.kept.take()
    }

    /// Begins the journal with the initial state.
    pub(super) fn begin(&mut self, start: &FrameState<'_>) -> Result<(), Failure> {
        let create = || {
            let mut journal = Journal::create(&self.path, &self.header)?;
            journal.frame(None, start)?;
            Ok(journal)
        };
        self.journal = Some(create().map_err(|error| self.refused(&error))?);
        Ok(())
    }

    /// Appends a step with the state after it, and at intervals a checkpoint of the whole world.
    pub(super) fn write(
        &mut self,
        step: &Step,
        state: &FrameState<'_>,
        world: &AnyWorld,
    ) -> Result<(), Failure> {
        let Some(journal) = &mut self.journal else { return Ok(()) };
        let mut written = journal.frame(Some(step), state);
        // Checkpoints at most double the size of the journal.
        let [checkpoint, size] = self.sizes;
        let due = self.last.elapsed() >= self.every && journal.size() >= size + checkpoint;
        if written.is_ok() && due {
            let state = world.checkpoint().to_bytes();
            written = journal.checkpoint(&state);
            self.last = Instant::now();
            self.sizes = [state.len() as u64, journal.size()];
        }
        written.map_err(|error| {
            Failure::File(format!(
                "{}; {}",
                cannot_write(&self.path, &error),
                self.resume_command()
            ))
        })
    }

    /// Restores the last checkpoint before a step, or leaves the simulation at its start. Returns
    /// the number of steps taken until there.
    pub(super) fn restore(
        &mut self,
        world: &mut AnyWorld,
        before: usize,
    ) -> Result<usize, Failure> {
        let mark = self.marks.iter().rev().find(|mark| mark.step < before);
        let (Some(&mark), Some(journal)) = (mark, &mut self.journal) else { return Ok(0) };
        let state = journal.state_at(mark).map_err(|error| self.refused(&error))?;
        let restored = AnyCheckpoint::from_bytes(&state).and_then(|state| world.restore(&state));
        restored.map_err(|error| self.wrong(&error.to_string()))?;
        Ok(mark.step)
    }

    /// Checks that a repeated step leads to the same state as before.
    pub(super) fn compare(&self, step: usize, known: &Step, state: u64) -> Result<(), Failure> {
        if known.state == state {
            return Ok(());
        }
        Err(self.wrong(&format!(
            "step {step} differs from the journal, so another build or machine baked it; resume \
             with that one, or delete it"
        )))
    }

    /// Syncs the journal, and returns the failure that reports an interruption by the user.
    pub(super) fn interrupted(&mut self, taken: usize, all: usize) -> Failure {
        let synced = self.journal.as_mut().map_or(Ok(()), Journal::sync);
        match synced {
            Err(error) => self.refused(&error),
            Ok(()) => {
                let resume_command = self.resume_command();
                Failure::Interrupted(format!(
                    "interrupted after step {taken} of {all}; {resume_command}"
                ))
            }
        }
    }

    /// Describes how to resume this bake.
    pub(super) fn resume_command(&self) -> String {
        let mut words: Vec<String> =
            env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy())).collect();
        if !words.iter().any(|word| word == "--resume") {
            words.push("--resume".to_owned());
        }
        format!("{} has the frames; resume with: drystone {}", self.path.display(), words.join(" "))
    }

    /// Deletes the journal, unless it has more than the `taken` steps of this bake.
    pub(super) fn discard(self, taken: usize) {
        if self.journal.is_some() && self.found <= taken {
            drop(self.journal);
            // A failure is harmless: the outputs have all frames of the journal.
            let _ = fs::remove_file(&self.path);
        }
    }

    fn refused(&self, error: &io::Error) -> Failure {
        match error.kind() {
            ErrorKind::InvalidData => self.wrong(&format!("{error}; move it away or delete it")),
            _ => Failure::File(cannot_write(&self.path, error)),
        }
    }

    fn wrong(&self, what: &str) -> Failure {
        Failure::Input(format!("{}: {what}", self.path.display()))
    }
}

fn cannot_write(path: &Path, error: &io::Error) -> String {
    Failure::cannot_write(path, error).to_string()
}

/// Quotes a word for a shell.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=./,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}
