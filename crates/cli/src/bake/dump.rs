//! `--dump-step`: the contacts and joints of a step, for `drystone solve` and other programs.

use std::path::{Path, PathBuf};

use drystone::{SavedContact, SavedJoint, SavedProblem, SavedRow, StepSettings};
use drystone_bake::recording::journal::Header;
use drystone_scene::{Scene, write_whole};
use drystone_solver::assembled::{Assembly, JointRows, Matrix};
use serde::Serialize;
use serde_json::{Value, json};

use super::arguments::BakeArguments;
use super::words::counted;
use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;

/// Law of the contacts of a substep.
const CONTACTS: &str = "v = v_star + M^-1 J^T r; u = J v - t + eps r; per contact, normal first: \
                        |r_t| <= mu r_n, u + mu |u_t| n in the dual cone, and their product 0";
/// Law of the impacts of a step.
const IMPACTS: &str = "v = v_star + M^-1 J^T r; u = J v - t; per contact, normal first: r_n >= 0, \
                       u_n >= 0, r_n u_n = 0; t_n = -restitution (J v_star)_n of a contact that \
                       closes";
/// Law of the rows of joints, whose impulses also move the bodies.
const JOINT_ROWS: &str = "v = v_star + M^-1 (J^T r of contacts + J^T r of rows); per row r = \
                          clamp((max(0, t[0] - J v) + min(0, t[1] - J v)) / eps, bounds[0], \
                          bounds[1]); null is infinite";
/// Number of joints that a warning names.
const NAMED: usize = 4;
/// Meaning of the zero rows of M.
const FIXED: &str = "a fixed body has zero rows in M; M^-1 is 0 there, and the body keeps v_star";

/// Part of a step that is saved.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// The contacts and joints of the last substep, after the impacts.
    Contacts,
    /// The impacts of the step.
    Impacts,
}

/// A saved problem with the bake that it comes from.
pub(super) struct Dump<'a> {
    pub(super) scene: &'a Scene,
    pub(super) header: &'a Header,
    pub(super) step: u32,
    pub(super) part: Part,
    pub(super) saved: &'a SavedProblem,
}

/// The file as it is written. It is serialized from this type, since a JSON value in between would
/// convert each `f32` of the settings to `f64`.
#[derive(Serialize)]
struct Document<'a> {
    name: String,
    version: &'a str,
    scene_hash: &'a str,
    settings: &'a StepSettings,
    law: &'static str,
    fixed_bodies: &'static str,
    units: Value,
    step: u32,
    dt: f64,
    dim: usize,
    nc: usize,
    bodies: Vec<Value>,
    contacts: Vec<Value>,
    #[serde(rename = "M")]
    mass: Value,
    #[serde(rename = "J")]
    jacobian: Value,
    v_star: &'a [f64],
    t: &'a [f64],
    eps: &'a [f64],
    mu: &'a [f64],
    gamma_0: &'a [f64],
    #[serde(skip_serializing_if = "Option::is_none")]
    joint_rows: Option<Value>,
}

/// Checks that the run has the step to save.
pub(super) fn step(step: Option<u32>, steps: u32) -> Result<Option<u32>, Failure> {
    match step {
        Some(step) if step > steps => {
            Err(Failure::Input(format!("--dump-step is {step}; accepted: 1 to {steps}")))
        }
        _ => Ok(step),
    }
}

/// Returns the files of the problem: those requested, or one beside the first output.
pub(super) fn files(arguments: &BakeArguments) -> Result<Vec<PathBuf>, Failure> {
    let Some(step) = arguments.dump_step else { return Ok(Vec::new()) };
    for path in &arguments.dump {
        match extension(path).as_str() {
            "json" => {}
            "hdf5" if cfg!(feature = "fclib") => {}
            "hdf5" => {
                let path = path.display();
                return Err(Failure::Input(format!(
                    "{path}: this build writes no FCLIB files; build it with --features fclib, or \
                     write .json"
                )));
            }
            _ => return Err(wrong_extension("--dump", path, ".json, .hdf5")),
        }
    }
    if !arguments.dump.is_empty() {
        return Ok(arguments.dump.clone());
    }
    let beside = arguments.output.first().or(arguments.report.as_ref());
    let beside = beside.unwrap_or(&arguments.scene).as_os_str().to_owned();
    let mut file = beside;
    let part = if arguments.dump_impacts { ".impacts" } else { "" };
    file.push(format!(".step-{step}{part}.json"));
    Ok(vec![file.into()])
}

impl Dump<'_> {
    /// Writes the files. Returns them, with warnings about what they leave out.
    pub(super) fn write(&self, files: &[PathBuf]) -> Result<(Vec<PathBuf>, Vec<String>), Failure> {
        for path in files {
            self.write_one(path)?;
        }
        let without_joints = files.iter().filter_map(|path| self.without_joints(path));
        let warnings = self.warning().into_iter().chain(without_joints).collect();
        Ok((files.to_vec(), warnings))
    }

    /// Returns a warning if a file has no rows of joints although the step has some.
    fn without_joints(&self, path: &Path) -> Option<String> {
        let why = match (self.part, extension(path).as_str()) {
            (Part::Impacts, _) => "impacts are resolved in turns with joints",
            (_, "hdf5") => "FCLIB's format has contacts alone",
            _ => return None,
        };
        let joints = &self.saved.joints;
        if joints.is_empty() {
            return None;
        }
        let rows = joints.iter().map(|joint| joint.rows.len()).sum();
        let first = joints.iter().take(NAMED);
        let names: Vec<_> =
            first.map(|joint| self.scene.joint_name_of(joint.joint as usize)).collect();
        let more = match joints.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        Some(format!(
            "{}: {why}: {} of {} left out: {}{more}",
            path.display(),
            counted(rows, "row"),
            counted(joints.len(), "joint"),
            names.join(", ")
        ))
    }

    fn write_one(&self, path: &Path) -> Result<(), Failure> {
        #[cfg(feature = "fclib")]
        if extension(path) == "hdf5" {
            return crate::fclib::write(path, &self.title(), self.assembly());
        }
        write_whole(path, |out| {
            serde_json::to_writer(&mut *out, &self.document())?;
            out.write_all(b"\n")
        })
        .map_err(|error| Failure::cannot_write(path, &error))
    }

    fn assembly(&self) -> &Assembly {
        match self.part {
            Part::Contacts => &self.saved.assembly,
            Part::Impacts => &self.saved.impacts,
        }
    }

    /// Returns a warning if the file has less than its reader expects.
    fn warning(&self) -> Option<String> {
        let step = self.step;
        let bounced = || {
            let contacts = self.saved.contacts.iter().zip(&self.saved.assembly.friction);
            contacts.filter(|(contact, _)| contact.impact > 0.0)
        };
        match (self.part, bounced().count()) {
            (Part::Contacts, 0) => None,
            (Part::Impacts, 0) => Some(format!("no contact bounced in step {step}")),
            (Part::Impacts, _) => None,
            (Part::Contacts, count) => {
                let leaning = match bounced().filter(|(_, mu)| **mu > 0.0).count() {
                    0 => String::new(),
                    leaning => format!(", and on which the friction of {leaning} may lean"),
                };
                Some(format!(
                    "{count} of the contacts saved in step {step} bounced: v_star is after the \
                     impacts, which --dump-impacts saves{leaning}"
                ))
            }
        }
    }

    fn title(&self) -> String {
        let part = if self.part == Part::Impacts { "impacts of " } else { "" };
        format!("{}, {part}step {}", self.scene.name.as_deref().unwrap_or("scene"), self.step)
    }

    fn document(&self) -> Document<'_> {
        let (of, saved) = (self.assembly(), self.saved);
        let names = self.scene.names();
        let body = |(body, name): (usize, &String)| {
            let first = saved.width * body;
            let mut rows = first..first + saved.width;
            let is_fixed = rows.all(|row| of.mass.get(row, row).is_none_or(|&m| m == 0.0));
            json!({ "name": name, "first": first, "fixed": is_fixed })
        };
        let contact = |contact: &SavedContact| {
            json!({
                "bodies": contact.bodies,
                "names": contact.bodies.map(|body| names.get(body as usize)),
                "point": contact.point,
                "normal": contact.frame.first(),
                "frame": contact.frame,
                "restitution": contact.restitution,
                "impact": contact.impact,
            })
        };
        Document {
            name: self.title(),
            version: &self.header.version,
            scene_hash: &self.header.scene,
            settings: &self.header.settings,
            law: if self.part == Part::Impacts { IMPACTS } else { CONTACTS },
            fixed_bodies: FIXED,
            units: units(),
            step: self.step,
            dt: saved.substep,
            dim: of.dimension,
            nc: of.friction.len(),
            bodies: names.iter().enumerate().map(body).collect(),
            contacts: saved.contacts.iter().map(contact).collect(),
            mass: by_columns(&of.mass),
            jacobian: by_columns(&of.jacobian),
            v_star: &of.velocities,
            t: &of.targets,
            eps: &of.compliance,
            mu: &of.friction,
            gamma_0: &of.guess,
            joint_rows: (!of.rows.laws.is_empty()).then(|| self.joint_rows(&of.rows)),
        }
    }

    /// Returns the rows of joints, and what each is.
    fn joint_rows(&self, rows: &JointRows) -> Value {
        let (bodies, names) = (self.scene.names(), self.scene.joint_names());
        let joint = |joint: &SavedJoint| {
            let name = |body: Option<u32>| body.and_then(|body| bodies.get(body as usize));
            json!({
                "name": names.get(joint.joint as usize),
                "joint": joint.joint,
                "bodies": joint.bodies,
                "names": joint.bodies.map(name),
                "point": joint.point,
                "rows": joint.rows.len(),
            })
        };
        let row = |row: SavedRow, joint: &SavedJoint| {
            let joint = self.scene.joints.get(joint.joint as usize);
            let axis = joint.and_then(|joint| joint.axes.get(row.axis));
            json!({
                "coordinate": axis.map(|axis| axis.coordinate.name()),
                "kind": row.kind.name(),
            })
        };
        let joints = &self.saved.joints;
        let each = joints.iter().flat_map(|joint| joint.rows.iter().map(move |own| (own, joint)));
        json!({
            "law": JOINT_ROWS,
            "units": {
                "J": "1, m", "bounds": "N s, N m s", "eps": "1/kg, 1/(kg m^2)",
                "gamma_0": "N s, N m s", "point": "m", "t": "m/s, rad/s",
            },
            "joints": joints.iter().map(joint).collect::<Vec<_>>(),
            "rows": each.map(|(own, joint)| row(*own, joint)).collect::<Vec<_>>(),
            "J": by_columns(&rows.jacobian),
            "t": rows.laws.iter().map(|law| law.targets).collect::<Vec<_>>(),
            "bounds": rows.laws.iter().map(|law| law.bounds).collect::<Vec<_>>(),
            "eps": rows.laws.iter().map(|law| law.compliance).collect::<Vec<_>>(),
            "gamma_0": rows.guess,
        })
    }
}

fn units() -> Value {
    json!({
        "J": "1, m", "M": "kg, kg m^2", "dt": "s", "eps": "1/kg", "gamma_0": "N s",
        "impact": "N s", "mu": "1", "point": "m", "restitution": "1", "t": "m/s",
        "v_star": "m/s, rad/s",
    })
}

/// Converts a sparse matrix to the format that `drystone solve` reads.
fn by_columns(matrix: &Matrix) -> Value {
    let rows = 0..matrix.nrows();
    let mut entries: Vec<(usize, usize, f64)> = rows
        .flat_map(|i| {
            matrix.col_idx_of_row(i).zip(matrix.val_of_row(i)).map(move |(j, &x)| (j, i, x))
        })
        .collect();
    entries.sort_unstable_by_key(|&(column, row, _)| (column, row));
    let starts = (0..=matrix.ncols()).map(|j| entries.partition_point(|entry| entry.0 < j));
    json!({
        "format": "csc",
        "rows": matrix.nrows(),
        "cols": matrix.ncols(),
        "colptr": starts.collect::<Vec<_>>(),
        "rowidx": entries.iter().map(|entry| entry.1).collect::<Vec<_>>(),
        "values": entries.iter().map(|entry| entry.2).collect::<Vec<_>>(),
    })
}
