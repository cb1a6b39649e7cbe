//! `--dump-step`: the contact problem of a step, for `drystone solve` and other programs.

use std::path::{Path, PathBuf};

use drystone::{SavedContact, SavedProblem};
use drystone_scene::{Scene, write_whole};
use drystone_solver::assembled::Matrix;
use serde_json::{Value, json};

use super::arguments::BakeArguments;
use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;

/// Checks that the run has the step to save.
pub(super) fn step(step: Option<u32>, steps: u32) -> Result<Option<u32>, Failure> {
    match step {
        Some(step) if step > steps => {
            Err(Failure::Input(format!("--dump-step is {step}; accepted: 1 to {steps}")))
        }
        _ => Ok(step),
    }
}

/// Returns the files of the contact problem: those requested, or one beside the first output.
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
    file.push(format!(".step-{step}.json"));
    Ok(vec![file.into()])
}

/// Writes the files. Returns them, with a warning about what the matrices leave out.
pub(super) fn write(
    files: &[PathBuf],
    scene: &Scene,
    step: u32,
    saved: &SavedProblem,
) -> Result<(Vec<PathBuf>, Option<String>), Failure> {
    for path in files {
        write_one(path, scene, step, saved)?;
    }
    let pairs = saved.contacts.iter().zip(&saved.assembly.friction);
    let leaning = pairs.filter(|(contact, mu)| contact.impact > 0.0 && **mu > 0.0).count();
    let warning = (leaning > 0).then(|| {
        format!(
            "{leaning} of the contacts saved in step {step} bounced in that substep: their \
             friction may rest on impulses of the impact, which the matrices leave out"
        )
    });
    Ok((files.to_vec(), warning))
}

fn write_one(path: &Path, scene: &Scene, step: u32, saved: &SavedProblem) -> Result<(), Failure> {
    #[cfg(feature = "fclib")]
    if extension(path) == "hdf5" {
        return crate::fclib::write(path, &title(scene, step), &saved.assembly);
    }
    let dump = document(scene, step, saved);
    write_whole(path, |out| {
        serde_json::to_writer(&mut *out, &dump)?;
        out.write_all(b"\n")
    })
    .map_err(|error| Failure::cannot_write(path, &error))
}

fn title(scene: &Scene, step: u32) -> String {
    format!("{}, step {step}", scene.name.as_deref().unwrap_or("scene"))
}

fn document(scene: &Scene, step: u32, saved: &SavedProblem) -> Value {
    let of = &saved.assembly;
    let body = |body: usize| json!({ "name": scene.name_of(body), "first": saved.width * body });
    let contact = |contact: &SavedContact| {
        json!({
            "bodies": contact.bodies,
            "names": contact.bodies.map(|body| scene.name_of(body as usize)),
            "point": contact.point,
            "normal": contact.frame.first(),
            "frame": contact.frame,
            "impact": contact.impact,
        })
    };
    json!({
        "name": title(scene, step),
        "law": "v = v_star + M^-1 J^T r; u = J v - t + eps r; per contact, normal first: \
                |r_t| <= mu r_n, u + mu |u_t| n in the dual cone, and their product 0",
        "units": {
            "J": "1, m", "M": "kg, kg m^2", "dt": "s", "eps": "1/kg", "gamma_0": "N s",
            "impact": "N s", "mu": "1", "point": "m", "t": "m/s", "v_star": "m/s, rad/s",
        },
        "step": step,
        "dt": saved.substep,
        "dim": of.dimension,
        "nc": of.friction.len(),
        "bodies": (0..scene.bodies.len()).map(body).collect::<Vec<_>>(),
        "contacts": saved.contacts.iter().map(contact).collect::<Vec<_>>(),
        "M": by_columns(&of.mass),
        "J": by_columns(&of.jacobian),
        "v_star": of.velocities,
        "t": of.targets,
        "eps": of.compliance,
        "mu": of.friction,
        "gamma_0": of.guess,
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
