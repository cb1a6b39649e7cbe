//! Reads problems of contacts and rows of joints from JSON files.

#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]
// A read returns at most one error, so its size does not matter.
#![allow(clippy::result_large_err)]

use std::io::Read as _;
use std::num::NonZero;
use std::path::Path;

use drystone_scene::{Place, SceneError};
use drystone_solver::assembled::{
    Assembly, Bodies, JointRows, Matrix, Problem, ProblemError, from_entries,
};
use drystone_solver::law::Interval;
use serde_json::Value;

/// Maximum number of unknowns that are read.
const MOST: usize = 1_000_000;

/// A problem with its name.
#[derive(Debug)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) problem: Problem,
    /// Bodies, contacts and joints of the problem, if they are known.
    pub(super) assembly: Option<Assembly>,
    /// Initial guess of the impulses, if the file has one.
    pub(super) warm: Option<Vec<f64>>,
}

/// Reads a problem; `drystone solve --help` lists the formats.
pub(super) fn read(path: &Path) -> Result<Named, SceneError> {
    let stem = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let file = File { path };
    if path.extension().is_some_and(|extension| extension == "hdf5" || extension == "h5") {
        return Ok(Named { name: stem(), problem: fclib(&file)?, assembly: None, warm: None });
    }
    let mut bytes = Vec::new();
    let whole = drystone_scene::open(path).and_then(|mut file| file.read_to_end(&mut bytes));
    whole.map_err(|error| SceneError {
        unreadable: true,
        ..file.error(Place::File, format!("cannot be read: {error}"), String::new(), "")
    })?;
    let root: Value = serde_json::from_slice(&bytes).map_err(|error| {
        let place = Place::Line { line: error.line(), column: error.column() };
        let text = error.to_string();
        let what = text.split(" at line").next().unwrap_or_default().to_owned();
        file.error(place, what, String::new(), "accepted: JSON (RFC 8259)")
    })?;
    let node = Node { file: &file, pointer: String::new(), value: &root };
    if !root.is_object() {
        return Err(
            node.wrong("an object with q and one of W, global, M, M_rows; or M, J, v_star, t, mu")
        );
    }
    let name = match root.get("name") {
        Some(Value::String(name)) => name.clone(),
        _ => stem(),
    };
    if node.find("J").is_some() {
        let assembly = assembly(&node)?;
        let problem = assembly.problem().map_err(|error| node.invalid_problem(&error))?;
        let warm = Some(assembly.warm(&problem));
        return Ok(Named { name, problem, assembly: Some(assembly), warm });
    }
    let problem = if let Some(rows) = node.find("M_rows") {
        let offset = node.get("q")?.numbers()?;
        let matrix = rows.dense(offset.len())?;
        Problem::complementarity(matrix, offset)
    } else if let Some(matrix) = node.find("M") {
        let offset = node.get("q")?.numbers()?;
        Problem::complementarity(matrix.sparse(offset.len(), offset.len())?, offset)
    } else if node.find("W").is_some() || node.find("global").is_some() {
        return Ok(Named { name, problem: contacts(&node)?, assembly: None, warm: None });
    } else {
        let found: Vec<_> = root.as_object().into_iter().flatten().map(|(key, _)| &**key).collect();
        let found = if found.is_empty() { "nothing".into() } else { found.join(", ") };
        return Err(node.refused(
            "the problem".into(),
            format!("made of {found}"),
            "accepted: q with one of W, global, M, M_rows; or M, J, v_star, t, mu",
        ));
    };
    let problem = problem.map_err(|error| node.invalid_problem(&error))?;
    Ok(Named { name, problem, assembly: None, warm: None })
}

#[cfg(feature = "fclib")]
fn fclib(file: &File<'_>) -> Result<Problem, SceneError> {
    crate::fclib::read(file.path)
}

#[cfg(not(feature = "fclib"))]
fn fclib(file: &File<'_>) -> Result<Problem, SceneError> {
    let why = "this build reads no FCLIB files; build it with --features fclib".to_owned();
    Err(file.error(Place::File, why, String::new(), "accepted: .json"))
}

/// Reads bodies, contacts and joints as `drystone bake --dump-step` saves them.
fn assembly(node: &Node<'_>) -> Result<Assembly, SceneError> {
    let d = dimension(node)?;
    let targets = node.get("t")?.numbers()?;
    let velocities = node.get("v_star")?.numbers()?;
    let (rows, columns) = (targets.len(), velocities.len());
    let friction = friction(&node.get("mu")?, rows / d)?;
    let or_zero = |key: &str| node.find(key).map_or(Ok(vec![0.0; rows]), |node| node.numbers());
    let joint_rows = match node.find("joint_rows") {
        Some(rows) => joint_rows(&rows, columns)?,
        None => JointRows::none(columns).map_err(|error| node.invalid_problem(&error))?,
    };
    Ok(Assembly {
        dimension: d.get(),
        mass: node.get("M")?.sparse(columns, columns)?,
        jacobian: node.get("J")?.sparse(rows, columns)?,
        velocities,
        compliance: or_zero("eps")?,
        guess: or_zero("gamma_0")?,
        contacts: (0..friction.len()).collect(),
        friction,
        targets,
        rows: joint_rows,
    })
}

/// Reads the rows of joints of bodies with this number of velocities.
fn joint_rows(node: &Node<'_>, columns: usize) -> Result<JointRows, SceneError> {
    let (targets, bounds) = (node.get("t")?, node.get("bounds")?);
    let count = targets.list()?.len();
    if bounds.list()?.len() != count {
        return Err(bounds.length(bounds.list()?.len(), count));
    }
    let or_zero = |key: &str| node.find(key).map_or(Ok(vec![0.0; count]), |node| node.numbers());
    let compliance = or_zero("eps")?;
    if compliance.len() != count {
        return Err(node.get("eps")?.length(compliance.len(), count));
    }
    let law = |(row, compliance): (usize, f64)| {
        let (targets, bounds) = (targets.item(row).range()?, bounds.item(row).range()?);
        Ok(Interval { targets, bounds, compliance })
    };
    Ok(JointRows {
        jacobian: node.get("J")?.sparse(count, columns)?,
        laws: compliance.into_iter().enumerate().map(law).collect::<Result<_, _>>()?,
        guess: or_zero("gamma_0")?,
        axes: (0..count).collect(),
    })
}

/// Reads the number of rows per contact.
fn dimension(node: &Node<'_>) -> Result<NonZero<usize>, SceneError> {
    let dimension = node.get("dim")?;
    match dimension.value.as_u64() {
        Some(d @ 1..=3) => NonZero::new(d as usize).ok_or_else(|| dimension.wrong("1, 2 or 3")),
        _ => Err(dimension.wrong("1, 2 or 3")),
    }
}

/// Reads a problem u = W r + q with friction.
fn contacts(node: &Node<'_>) -> Result<Problem, SceneError> {
    let d = dimension(node)?;
    let (global, given) = match node.find("W") {
        Some(_) => (None, node.get("q")?),
        None => {
            let global = node.get("global")?;
            let given = global.get("w")?;
            (Some(global), given)
        }
    };
    let offset = given.numbers()?;
    if offset.len() % d != 0 {
        let is = format!("{} entries", offset.len());
        return Err(given.refused(
            given.pointer.clone(),
            is,
            &format!("accepted: a multiple of {d}"),
        ));
    }
    let count = offset.len() / d;
    if let Some(stated) = node.find("nc")
        && stated.value.as_u64() != Some(count as u64)
    {
        return Err(stated.wrong(&format!("{count}, as many as there are contacts in q")));
    }
    let friction = friction(&node.get("mu")?, count)?;
    let problem = match global {
        None => {
            let matrix = node.get("W")?.sparse(offset.len(), offset.len())?;
            Problem::new(d.get(), friction, matrix, offset)
        }
        Some(global) => {
            let momentum = global.get("f")?.numbers()?;
            let bodies = Bodies {
                mass: global.get("M")?.sparse(momentum.len(), momentum.len())?,
                directions: global.get("H")?.sparse(momentum.len(), offset.len())?,
                momentum,
                given: offset,
            };
            Problem::from_bodies(d.get(), friction, bodies)
        }
    };
    problem.map_err(|error| node.invalid_problem(&error))
}

/// Reads friction coefficients: one number for all contacts, or one for each.
fn friction(node: &Node<'_>, count: usize) -> Result<Vec<f64>, SceneError> {
    let checked = |node: &Node<'_>| match node.value.as_f64() {
        Some(mu) if mu >= 0.0 => Ok(mu),
        _ => Err(node.wrong("a number from 0")),
    };
    let Value::Array(list) = node.value else {
        return Ok(vec![checked(node)?; count]);
    };
    if list.len() != count {
        return Err(node.length(list.len(), count));
    }
    (0..count).map(|i| checked(&node.item(i))).collect()
}

struct File<'a> {
    path: &'a Path,
}

impl File<'_> {
    fn error(&self, place: Place, item: String, value: String, accepted: &str) -> SceneError {
        let accepted = accepted.to_owned();
        SceneError { file: self.path.to_owned(), place, item, value, accepted, unreadable: false }
    }
}

/// A JSON value with its position in the file.
struct Node<'a> {
    file: &'a File<'a>,
    pointer: String,
    value: &'a Value,
}

impl<'a> Node<'a> {
    fn find(&self, key: &str) -> Option<Node<'a>> {
        let value = self.value.get(key)?;
        Some(Node { file: self.file, pointer: format!("{}/{key}", self.pointer), value })
    }

    fn get(&self, key: &str) -> Result<Node<'a>, SceneError> {
        self.find(key).ok_or_else(|| {
            let accepted = format!("accepted: an object with '{key}'");
            self.refused(format!("'{key}'"), "missing".into(), &accepted)
        })
    }

    fn item(&self, i: usize) -> Node<'a> {
        Node {
            file: self.file,
            pointer: format!("{}/{i}", self.pointer),
            value: self.value.get(i).unwrap_or(&Value::Null),
        }
    }

    fn refused(&self, item: String, value: String, accepted: &str) -> SceneError {
        let place = match self.pointer.as_str() {
            "" => Place::File,
            pointer => Place::Pointer(pointer.to_owned()),
        };
        self.file.error(place, item, value, accepted)
    }

    fn wrong(&self, accepted: &str) -> SceneError {
        let written = match self.value {
            Value::Array(list) => format!("a list of {}", list.len()),
            Value::Object(_) => "an object".to_owned(),
            other => other.to_string(),
        };
        let item = self.pointer.rsplit('/').next().unwrap_or_default();
        let item = if item.is_empty() { "the file".into() } else { format!("'{item}'") };
        self.refused(item, written, &format!("accepted: {accepted}"))
    }

    fn length(&self, is: usize, accepted: usize) -> SceneError {
        let accepted = format!("accepted: {accepted}");
        self.refused("the number of entries".into(), is.to_string(), &accepted)
    }

    /// Returns the error for parts that do not fit together.
    fn invalid_problem(&self, error: &ProblemError) -> SceneError {
        self.refused(error.to_string(), String::new(), "accepted: matrices that fit together")
    }

    fn list(&self) -> Result<&'a [Value], SceneError> {
        match self.value {
            Value::Array(list) if list.len() <= MOST => Ok(list),
            Value::Array(_) => Err(self.wrong(&format!("a list of up to {MOST}"))),
            _ => Err(self.wrong("a list")),
        }
    }

    fn numbers(&self) -> Result<Vec<f64>, SceneError> {
        let one = |(i, value): (usize, &Value)| {
            value.as_f64().filter(|x| x.is_finite()).ok_or_else(|| self.item(i).wrong("a number"))
        };
        self.entries()?.iter().enumerate().map(one).collect()
    }

    /// Reads the ends of a range; null is infinite.
    fn range(&self) -> Result<[f64; 2], SceneError> {
        let end = |i: usize, infinite: f64| match self.item(i).value {
            Value::Null => Some(infinite),
            value => value.as_f64(),
        };
        let ends = (end(0, f64::NEG_INFINITY), end(1, f64::INFINITY));
        match (self.value, ends) {
            (Value::Array(list), (Some(low), Some(high))) if list.len() == 2 => Ok([low, high]),
            _ => Err(self.wrong("a list of two numbers; null if infinite")),
        }
    }

    /// Returns the entries of a list of any length.
    fn entries(&self) -> Result<&'a [Value], SceneError> {
        self.value.as_array().map(Vec::as_slice).ok_or_else(|| self.wrong("a list"))
    }

    fn count(&self, most: usize) -> Result<usize, SceneError> {
        let count = self.value.as_u64().and_then(|count| usize::try_from(count).ok());
        count.filter(|&count| count <= most).ok_or_else(|| self.wrong(&format!("0 to {most}")))
    }

    /// Reads a matrix given as a list of rows.
    fn dense(&self, n: usize) -> Result<Matrix, SceneError> {
        let list = self.list()?;
        if list.len() != n {
            return Err(self.length(list.len(), n));
        }
        // Memory grows with the rows that are read, not with the n that is claimed.
        let mut entries = Vec::new();
        for i in 0..n {
            let row = self.item(i);
            let values = row.numbers()?;
            if values.len() != n {
                return Err(row.length(values.len(), n));
            }
            entries.extend(values.into_iter().enumerate().map(|(j, value)| (i, j, value)));
        }
        from_entries(n, n, &entries).map_err(|error| self.invalid_problem(&error))
    }

    /// Reads a sparse matrix given by columns.
    fn sparse(&self, rows: usize, columns: usize) -> Result<Matrix, SceneError> {
        if let Some(format) = self.find("format")
            && format.value != "csc"
        {
            return Err(format.wrong("\"csc\""));
        }
        for (key, accepted) in [("rows", rows), ("cols", columns)] {
            let size = self.get(key)?;
            if size.count(MOST)? != accepted {
                return Err(size.wrong(&accepted.to_string()));
            }
        }
        let (starts, places) = (self.get("colptr")?, self.get("rowidx")?);
        let values = self.get("values")?;
        let numbers = values.numbers()?;
        let count = places.entries()?.len();
        if numbers.len() != count {
            return Err(values.length(numbers.len(), count));
        }
        let bounds = columns.saturating_add(1);
        if starts.entries()?.len() != bounds {
            return Err(starts.length(starts.entries()?.len(), bounds));
        }
        let mut entries = Vec::with_capacity(count);
        let mut from = 0;
        if columns == 0 || starts.item(0).count(0).is_ok() {
            for j in 0..columns {
                let end = starts.item(j.saturating_add(1));
                let to = end.count(count)?;
                if to < from {
                    return Err(end.wrong(&format!("{from} to {count}")));
                }
                for (k, number) in numbers.iter().enumerate().take(to).skip(from) {
                    let row = places.item(k).count(rows.saturating_sub(1))?;
                    entries.push((row, j, *number));
                }
                from = to;
            }
        } else {
            return Err(starts.item(0).wrong("0"));
        }
        if from != count {
            return Err(starts.item(columns).wrong(&count.to_string()));
        }
        from_entries(rows, columns, &entries).map_err(|error| self.invalid_problem(&error))
    }
}

#[cfg(test)]
mod tests;
