//! Contact problems in FCLIB's HDF5 format (Acary, Bremond, Huber 2014). Feature `fclib`.
//!
//! `fclib_local` holds W, q and mu of u = W r + q. `fclib_global` holds M, H, f, w and mu of M v =
//! f + H r, u = H^T v + w. A matrix is stored by columns (`nz` = -1), by rows (-2), or as `nz`
//! triplets. Problems are written in the local form, since the global form has no compliance.

// A read returns at most one error, so its size does not matter.
#![allow(clippy::result_large_err)]

use std::path::Path;

use drystone_scene::{Place, SceneError, write_whole};
use drystone_solver::assembled::{
    Assembly, Bodies, JointRows, Matrix, Problem, ProblemError, from_entries,
};
use hdf5_pure::{File, FileBuilder, GroupBuilder};

use crate::failure::Failure;

/// Maximum number of rows that are read.
const MOST: usize = 1_000_000;

/// Reads a local or a global problem.
pub(crate) fn read(path: &Path) -> Result<Problem, SceneError> {
    let file = File::open(path).map_err(|error| SceneError {
        unreadable: true,
        ..refused(path, "/", format!("cannot be read as HDF5: {error}"), "")
    })?;
    let file = Source { path, file };
    let (group, local) = match file.file.group("fclib_local") {
        Ok(_) => ("fclib_local", true),
        Err(_) => ("fclib_global", false),
    };
    let spaces = file.integers(&format!("{group}/spacedim"))?;
    let d = match spaces[..] {
        [d @ (2 | 3)] => d as usize,
        _ => {
            return Err(refused(path, &format!("{group}/spacedim"), format!("{spaces:?}"), "2, 3"));
        }
    };
    let vector = |name: &str| file.numbers(&format!("{group}/vectors/{name}"));
    let matrix = |name: &str| file.matrix(&format!("{group}/{name}"));
    let friction = vector("mu")?;
    let problem = if local {
        Problem::new(d, friction, matrix("W")?, vector("q")?)
    } else {
        let bodies = Bodies {
            mass: matrix("M")?,
            directions: matrix("H")?,
            momentum: vector("f")?,
            given: vector("w")?,
        };
        Problem::from_bodies(d, friction, bodies)
    };
    problem.map_err(|error| file.invalid_problem(group, &error))
}

fn refused(path: &Path, place: &str, value: String, accepted: &str) -> SceneError {
    SceneError {
        file: path.to_owned(),
        place: Place::Pointer(place.to_owned()),
        item: place.rsplit('/').next().unwrap_or_default().to_owned(),
        value,
        accepted: format!("accepted: {accepted}"),
        unreadable: false,
    }
}

struct Source<'a> {
    path: &'a Path,
    file: File,
}

impl Source<'_> {
    fn missing(&self, place: &str, error: &hdf5_pure::Error) -> SceneError {
        refused(self.path, place, error.to_string(), "a problem of fclib_local or fclib_global")
    }

    fn invalid_problem(&self, place: &str, error: &ProblemError) -> SceneError {
        refused(self.path, place, error.to_string(), "matrices that fit together")
    }

    fn numbers(&self, place: &str) -> Result<Vec<f64>, SceneError> {
        let read = self.file.dataset(place).and_then(|data| data.read_f64());
        read.map_err(|error| self.missing(place, &error))
    }

    fn integers(&self, place: &str) -> Result<Vec<i32>, SceneError> {
        let read = self.file.dataset(place).and_then(|data| data.read_i32());
        read.map_err(|error| self.missing(place, &error))
    }

    fn matrix(&self, place: &str) -> Result<Matrix, SceneError> {
        let list = |name: &str| self.integers(&format!("{place}/{name}"));
        let wrong = |name: &str, accepted: &str| {
            refused(self.path, &format!("{place}/{name}"), "does not fit".to_owned(), accepted)
        };
        let size = |name: &str| match list(name)?[..] {
            [n] if (0..=MOST as i32).contains(&n) => Ok(n as usize),
            _ => Err(wrong(name, &format!("one number from 0 to {MOST}"))),
        };
        let (rows, columns) = (size("m")?, size("n")?);
        let storage = *list("nz")?.first().ok_or_else(|| wrong("nz", "-2, -1 or more"))?;
        let (p, i, x) = (list("p")?, list("i")?, self.numbers(&format!("{place}/x"))?);
        let majors = match storage {
            -2 => unfold(&p, rows, x.len()),
            -1 => unfold(&p, columns, x.len()),
            _ => p.iter().map(|&p| usize::try_from(p).ok()).collect(),
        };
        let majors = majors.ok_or_else(|| wrong("p", "numbers from 0 in order"))?;
        let minors: Option<Vec<usize>> = i.iter().map(|&i| usize::try_from(i).ok()).collect();
        let minors = minors.ok_or_else(|| wrong("i", "numbers from 0"))?;
        if majors.len() > x.len() || minors.len() < majors.len() {
            return Err(wrong("i", "as many as there are entries"));
        }
        let pairs = majors.into_iter().zip(minors).zip(x);
        // In triplets `p` holds the column, as in matrices by columns.
        let entry =
            |((major, minor), x)| if storage == -2 { (major, minor, x) } else { (minor, major, x) };
        let entries: Vec<_> = pairs.map(entry).collect();
        from_entries(rows, columns, &entries).map_err(|error| self.invalid_problem(place, &error))
    }
}

/// Returns the row of each entry, given the start of each row.
fn unfold(starts: &[i32], rows: usize, entries: usize) -> Option<Vec<usize>> {
    let ordered = starts.windows(2).all(|pair| pair[0] <= pair[1]);
    let last = usize::try_from(*starts.last()?).ok()?;
    if starts.len() != rows + 1 || starts[0] != 0 || !ordered || last > entries {
        return None;
    }
    let row = |i: usize| (starts[i]..starts[i + 1]).map(move |_| i);
    Some((0..rows).flat_map(row).collect())
}

/// Writes W, q and mu of the contacts, and the guess. The format has no rows of joints.
pub(crate) fn write(path: &Path, title: &str, assembly: &Assembly) -> Result<(), Failure> {
    let failed =
        |why: String| Failure::File(format!("{}: cannot be written: {why}", path.display()));
    let rows = JointRows::none(assembly.velocities.len());
    let contacts = rows.map(|rows| Assembly { rows, ..assembly.clone() });
    let problem = contacts.and_then(|contacts| contacts.problem_in_space());
    let problem = problem.map_err(|error| failed(error.to_string()))?;
    let mut file = FileBuilder::new();
    let mut local = file.create_group("fclib_local");
    local.create_dataset("spacedim").with_i32_data(&[problem.dimension() as i32]);
    let mut w = local.create_group("W");
    write_matrix(&mut w, problem.matrix()).map_err(|error| failed(error.to_string()))?;
    local.add_group(w.finish());
    let mut vectors = local.create_group("vectors");
    vectors.create_dataset("q").with_f64_data(problem.offset());
    vectors.create_dataset("mu").with_f64_data(problem.friction());
    local.add_group(vectors.finish());
    file.add_group(local.finish());
    let mut guesses = file.create_group("guesses");
    guesses.create_dataset("number_of_guesses").with_i32_data(&[1]);
    let mut guess = guesses.create_group("1");
    guess.create_dataset("u").with_f64_data(&problem.velocities(&assembly.guess));
    guess.create_dataset("r").with_f64_data(&assembly.guess);
    guesses.add_group(guess.finish());
    file.add_group(guesses.finish());
    file.set_attr("title", hdf5_pure::AttrValue::AsciiString(ascii(title)));
    let bytes = file.finish().map_err(|error| failed(error.to_string()))?;
    write_whole(path, |out| out.write_all(&bytes))
        .map_err(|error| Failure::cannot_write(path, &error))
}

fn ascii(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii() { c } else { '?' }).collect()
}

/// Writes a matrix by rows; FCLIB uses 32-bit indices.
fn write_matrix(
    group: &mut GroupBuilder,
    matrix: &Matrix,
) -> Result<(), std::num::TryFromIntError> {
    let (mut starts, mut columns, mut values) = (vec![0], Vec::new(), Vec::new());
    for row in 0..matrix.nrows() {
        for (j, &x) in matrix.col_idx_of_row(row).zip(matrix.val_of_row(row)) {
            columns.push(i32::try_from(j)?);
            values.push(x);
        }
        starts.push(i32::try_from(columns.len())?);
    }
    for (name, value) in [("m", matrix.nrows()), ("n", matrix.ncols()), ("nzmax", values.len())] {
        group.create_dataset(name).with_i32_data(&[i32::try_from(value)?]);
    }
    group.create_dataset("nz").with_i32_data(&[-2]);
    group.create_dataset("p").with_i32_data(&starts);
    group.create_dataset("i").with_i32_data(&columns);
    group.create_dataset("x").with_f64_data(&values);
    Ok(())
}
