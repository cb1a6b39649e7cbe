//! `drystone matrix`: draws which contacts and rows of joints are coupled.

mod draw;

use std::collections::BTreeSet;
use std::path::PathBuf;

use drystone::{RowKind, SavedContact, SavedJoint, SavedProblem, SavedRow, StepSettings};
use drystone_bake::{Decompositions, build_with};
use drystone_scene::{Motion, Scene, write_whole};
use drystone_solver::assembled::{Assembly, Problem};

use crate::extension::{extension, wrong_extension};
use crate::failure::Failure;
use crate::files::refuse_overwrite;
use crate::print;
use draw::{Entry, Picture, Point, Row};

/// Maximum number of contacts and rows of joints in a picture.
const MOST: usize = 1500;

/// Draw the matrix A = J M^-1 J^T of a step beside its contacts and joints.
///
/// Each contact has one row and one column, and so has each row of a joint. The entry of two is not
/// zero if they share a dynamic body, and has the color of that body. Up to 16 are shown with the
/// normals of contacts, the entries of A between normals [1/kg] and rows, and b = t - J v* [m/s].
/// If a contact bounced in the step, b of contacts is that of the impacts.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct MatrixArguments {
    /// Scene to simulate: .toml, .json, .gltf, .glb or .usda
    scene: PathBuf,

    /// Draw the last substep of this step, from 1
    #[arg(long, value_name = "N", default_value_t = 1)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    step: u32,

    /// Write the picture to this file: .svg
    #[arg(short, long, value_name = "A.svg")]
    output: PathBuf,
}

const EXAMPLES: &str = "\
Examples:
  drystone matrix scenes/arch.json --step 60 -o arch.svg
      draws a band: each stone touches the next
  drystone matrix scenes/billiards.toml --step 80 -o break.svg
      draws the rack in the break

Exit codes: 0 done, 2 wrong input or usage, 3 the simulation diverged, 4 a file cannot be read or
written.";

/// Runs the command.
pub(crate) fn run(arguments: &MatrixArguments) -> Result<(), Failure> {
    let MatrixArguments { scene: file, step, output } = arguments;
    if extension(output) != "svg" {
        return Err(wrong_extension("--output", output, ".svg"));
    }
    refuse_overwrite(output, [file.as_path()])?;
    let scene = drystone_bake::read(file)?.scene;
    let (saved, poses) = simulate(arguments, &scene)?;
    let (count, rows) = (saved.contacts.len(), saved.assembly.rows.laws.len());
    if !(1..=MOST).contains(&(count + rows)) {
        return Err(Failure::Input(format!(
            "{}: step {step} has {count} contacts and {rows} rows of joints; accepted: 1 to {MOST} \
             in all; choose another --step or a smaller scene",
            file.display()
        )));
    }
    let name = scene.name.as_deref().unwrap_or("scene");
    let contacts = if count == 1 { "contact" } else { "contacts" };
    let joints = match rows {
        0 => String::new(),
        1 => " and 1 row of a joint".to_owned(),
        many => format!(" and {many} rows of joints"),
    };
    let title = format!("{name}, step {step}: {count} {contacts}{joints}");
    let svg = draw::svg(&picture(title, &scene, &saved, &poses)?);
    write_whole(output, |out| out.write_all(svg.as_bytes()))
        .map_err(|error| Failure::cannot_write(output, &error))?;
    print(&format!("wrote        {}\n", output.display()))
}

/// Simulates up to the step, and returns its contacts and joints and the poses after it.
fn simulate(
    arguments: &MatrixArguments,
    scene: &Scene,
) -> Result<(SavedProblem, Vec<f32>), Failure> {
    let file = arguments.scene.display();
    let settings = drystone_bake::settings(scene, StepSettings::certified())?;
    let mut world = build_with(scene, settings, &mut Decompositions::of_user())
        .map_err(|error| Failure::Input(format!("{file}: {error}")))?;
    for step in 0..arguments.step {
        world.save_systems(step + 1 == arguments.step);
        world.step_scene(scene, step as usize)?;
    }
    let saved = world.saved().transpose();
    let saved = saved.map_err(|error| Failure::Diverged(format!("{file}: {error}")))?;
    let mut poses = Vec::new();
    world.write_poses(&mut poses);
    let none =
        || Failure::Input(format!("{file}: step {} has no contacts and joints", arguments.step));
    Ok((saved.ok_or_else(none)?, poses))
}

fn picture(
    title: String,
    scene: &Scene,
    saved: &SavedProblem,
    poses: &[f32],
) -> Result<Picture, Failure> {
    let wrong = |error| Failure::Diverged(format!("the matrix: {error}"));
    let rigid = |assembly: &Assembly| {
        let mut assembly = assembly.clone();
        assembly.compliance.fill(0.0);
        assembly.rows.laws.iter_mut().for_each(|law| law.compliance = 0.0);
        assembly.problem_in_space().map_err(wrong)
    };
    let problem = rigid(&saved.assembly)?;
    let moves = |body: u32| {
        scene.bodies.get(body as usize).is_some_and(|body| body.motion == Motion::Dynamic)
    };
    let view = View::of(saved);
    let bounced = saved.contacts.iter().any(|contact| contact.impact > 0.0);
    let impacts = if bounced { Some(rigid(&saved.impacts)?) } else { None };
    let of_contacts = impacts.as_ref().unwrap_or(&problem);
    let (offsets, _) = of_contacts.split_rows(of_contacts.offset());
    let contact = |(contact, q): (&SavedContact, &f64)| Row {
        bodies: contact.bodies.map(Some),
        joint: None,
        point: view.flat(&contact.point),
        normal: contact.frame.first().map(|normal| view.flat(normal)),
        b: -q,
    };
    let contacts = saved.contacts.iter().zip(offsets.iter().step_by(problem.dimension()));
    let (_, offsets) = problem.split_rows(problem.offset());
    let joints =
        saved.joints.iter().flat_map(|joint| joint.rows.iter().map(move |row| (joint, row)));
    let joint = |((joint, row), q): ((&SavedJoint, &SavedRow), &f64)| Row {
        bodies: joint.bodies,
        joint: Some((joint.joint, row_name(scene, joint, row))),
        point: view.flat(&joint.point),
        normal: None,
        b: -q,
    };
    let rows: Vec<_> = contacts.map(contact).chain(joints.zip(offsets).map(joint)).collect();
    let stride = if scene.dimension == 3 { 7 } else { 3 };
    let bodies = scene.names().into_iter().enumerate().zip(poses.chunks(stride));
    Ok(Picture {
        title,
        entries: entries(&problem, &rows, moves),
        rows,
        bodies: bodies
            .map(|((body, name), pose)| {
                let place: Vec<f64> = pose.iter().map(|x| f64::from(*x)).collect();
                (name, moves(body as u32).then(|| view.flat(&place)))
            })
            .collect(),
    })
}

/// Names a row of a joint: the joint, its coordinate and what the row does.
fn row_name(scene: &Scene, joint: &SavedJoint, row: &SavedRow) -> String {
    let index = joint.joint as usize;
    let name = scene.joint_names().get(index).cloned().unwrap_or_default();
    let axis = scene.joints.get(index).and_then(|joint| joint.axes.get(row.axis));
    let coordinate = axis.map_or("", |axis| axis.coordinate.name());
    match row.kind {
        RowKind::Lock => format!("{name} {coordinate}"),
        kind => format!("{name} {coordinate} {}", kind.name()),
    }
}

/// Returns the nonzero blocks of A, each with its entry between normals and rows of joints.
fn entries(problem: &Problem, rows: &[Row], moves: impl Fn(u32) -> bool) -> Vec<Entry> {
    let (matrix, d) = (problem.matrix(), problem.dimension());
    let (contacts, unknowns) = (problem.contacts(), d * problem.contacts());
    let place = |i: usize| if i < unknowns { i / d } else { contacts + i - unknowns };
    let first = |i: usize| if i < contacts { d * i } else { unknowns + i - contacts };
    let shared = |i: usize, j: usize| -> Vec<u32> {
        let (a, b) = (rows[i].bodies, rows[j].bodies);
        let both = a.into_iter().flatten().filter(|body| b.contains(&Some(*body)));
        both.filter(|body| moves(*body)).collect()
    };
    let blocks: BTreeSet<[usize; 2]> = (0..matrix.nrows())
        .flat_map(|row| {
            let entries = matrix.col_idx_of_row(row).zip(matrix.val_of_row(row));
            let nonzero = entries.filter(|(_, x)| **x != 0.0);
            nonzero.map(move |(column, _)| [place(row), place(column)])
        })
        .collect();
    let entry = |[row, column]: [usize; 2]| {
        let body = match shared(row, column).as_slice() {
            [body] => Some(*body),
            _ => None,
        };
        let value = matrix.get(first(row), first(column)).copied().unwrap_or(0.0);
        Entry { row, column, value, body }
    };
    blocks.into_iter().map(entry).collect()
}

/// Projection from space to the picture: from the front, the side or above, along the axis in which
/// the contacts and joints spread least.
struct View {
    /// Axis and sign of the horizontal and the vertical direction.
    axes: [(usize, f64); 2],
}

impl View {
    fn of(saved: &SavedProblem) -> Self {
        let spread = |axis: usize| {
            let contacts = saved.contacts.iter().map(|contact| &contact.point);
            let points = contacts.chain(saved.joints.iter().map(|joint| &joint.point));
            let along = points.filter_map(|point| point.get(axis));
            let bounds = |(low, high): (f64, f64), x: &f64| (low.min(*x), high.max(*x));
            let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), bounds);
            high - low
        };
        let deep = [2, 0, 1].into_iter().min_by(|&a, &b| spread(a).total_cmp(&spread(b)));
        let axes = match deep {
            Some(0) => [(2, -1.0), (1, 1.0)],
            Some(1) => [(0, 1.0), (2, -1.0)],
            _ => [(0, 1.0), (1, 1.0)],
        };
        Self { axes }
    }

    fn flat(&self, point: &[f64]) -> Point {
        self.axes.map(|(axis, sign)| sign * point.get(axis).copied().unwrap_or(0.0))
    }
}
