//! Writes a recording as a layer over the stage that its scene was read from.
//!
//! The layer has the stage as its sublayer, and opinions about prims that the simulation moves.
//! Everything else, such as materials and textures, stays that of the stage.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use std::fs;
use std::io;
use std::path::Path;

use super::clock::Clock;
use super::parallel::each_of;
use super::pose::{Pose, pose_at};
use super::sampling::{Track, tracks};
use super::usda::{break_prim, follow, joints_must_fit, mixed, turned};
use super::{JointRecording, Recording, Sampling};
use drystone_scene::export::usd::{PrimWriter, StageHead, tuple, write_stage};
use drystone_scene::graph::math::{self, Mat3, Quat, Vec3};
use drystone_scene::graph::transform::{Affine, split};
use drystone_scene::usd::StageSource;
use drystone_scene::{Body, Motion, Place, Scene, Warning};

/// Relative difference below which two scales are the same.
const SAME: f64 = 1e-9;

/// Writes `recording` as a layer over the stage `source` that `scene` was read from.
///
/// Each prim of a body that the stage itself does not move gets a transform of its own, which gives
/// it the recorded pose whatever the prims above it do. Its scale stays. The transform operations
/// of the stage stay too, but no longer act. A dynamic body becomes kinematic, so that programs
/// with physics play the animation. The attribute `jointEnabled` of a joint that breaks has time
/// samples.
///
/// Units and axes are those of the stage. So are time codes per second, if it states them. Returns
/// warnings about instances that had to become prims of their own.
///
/// # Errors
/// If the recording does not belong to the scene or is not finite, a scale of 0 hides the motion of
/// a body, or the file cannot be written. An existing file then stays unchanged.
pub fn write(
    path: &Path,
    (scene, source): (&Scene, &StageSource),
    recording: &Recording,
    joints: &JointRecording,
    options: &Sampling,
) -> io::Result<Vec<Warning>> {
    recording.must_have(source.bodies.len(), 3)?;
    joints_must_fit(joints, source.joints.len())?;
    let clock = Clock::new(recording, Some(source), options);
    let layer = Layer { source, recording, clock };
    let written = (0..source.bodies.len()).filter(|body| source.bodies[*body].is_written);
    let written: Vec<usize> = written.filter(|_| !layer.clock.times.is_empty()).collect();
    let motions = each_of(written.len(), |index| layer.motion(written[index], options))?;
    let mut root = PrimWriter::over("");
    for path in &source.instances {
        root.over_at(path).metadata.push("instanceable = false".to_owned());
    }
    let codes = layer.clock.codes();
    for (body, motion) in written.iter().zip(&motions) {
        let prim = root.over_at(&source.bodies[*body].path);
        play(prim, &scene.bodies[*body]);
        motion.write(prim, source.bodies[*body].reset, &codes);
    }
    for (path, broken) in source.joints.iter().zip(&joints.broken) {
        if let (Some(frame), Some(first)) = (broken, codes.first()) {
            let code = layer.clock.code(*frame as f64 * recording.frame_time);
            break_prim(root.over_at(path), Some(code), Some(*first));
        }
    }
    let sublayer = relative(&source.file, path)?;
    let head = StageHead {
        ends: layer.clock.ends(),
        frames: layer.clock.rate,
        codes: layer.clock.rate,
        units: source.units,
        default_prim: source.default_prim.as_deref(),
        sublayer: Some(&sublayer),
    };
    write_stage(path, &head, &root.children)?;
    let opened = |path: &String| Warning {
        place: Place::File,
        message: format!(
            "<{path}>: it has bodies or joints, so it is not an instance in the layer any more"
        ),
    };
    Ok(source.instances.iter().map(opened).collect())
}

/// Lets the animation move a body that a simulation would move otherwise.
fn play(prim: &mut PrimWriter, body: &Body) {
    if body.motion == Motion::Dynamic {
        prim.set("bool physics:kinematicEnabled", 1);
        if !body.track.times.is_empty() {
            prim.set("custom bool drystone:released", 0);
        }
    }
}

/// The layer of a recording.
struct Layer<'a> {
    source: &'a StageSource,
    recording: &'a Recording,
    clock: Clock,
}

/// Motion of a prim relative to its parent.
enum LocalMotion {
    /// Translation, rotation and what a constant linear map does before them.
    Rigid { positions: Track<3>, rotations: Track<4>, rest: Mat3 },
    /// Any map, at each sample. A parent that distorts requires it.
    Maps(Vec<Affine>),
}

impl Layer<'_> {
    fn motion(&self, body: usize, options: &Sampling) -> io::Result<LocalMotion> {
        let (own, times) = (&self.source.bodies[body], &self.clock.times);
        let parents: Vec<Affine> = times.iter().map(|time| self.parent(body, *time)).collect();
        if parents.iter().any(|parent| math::inverse(parent.linear).is_none()) {
            let what = format!("a scale of 0 above <{}> hides its motion", own.path);
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
        let scales: Option<Vec<f64>> =
            parents.iter().map(|parent| Some(rigid(parent.linear)?.1)).collect();
        let scale = scales.as_deref().and_then(constant);
        let Some(scale) = scale else {
            let maps = times.iter().zip(&parents);
            let maps = maps.map(|(time, parent)| local(parent, &self.world(body, *time).0));
            return Ok(LocalMotion::Maps(maps.collect()));
        };
        let unit = scale * self.source.units.meters;
        let options =
            Sampling { position_tolerance: options.position_tolerance / unit, ..*options };
        let pose = |time: f64| {
            let parent = self.parent(body, time);
            let turn = rigid(parent.linear).map_or(math::NO_TURN, |(turn, _)| turn);
            let (world, world_turn) = self.world(body, time);
            let rotation = math::quat_mul(math::conjugate(turn), world_turn);
            Pose { position: local(&parent, &world).shift, rotation }
        };
        let (positions, rotations) = tracks(times, pose, mixed, &options, body)?;
        let rest = own.rest.map(|column| math::scale(column, 1.0 / scale));
        Ok(LocalMotion::Rigid { positions, rotations, rest })
    }

    /// Returns the map from the parent of a body's prim to the stage.
    fn parent(&self, body: usize, time: f64) -> Affine {
        let own = &self.source.bodies[body];
        let above = own.above(self.code_of_stage(time));
        own.carrier.map_or(above, |carrier| self.world(carrier, time).0.after(&above))
    }

    /// Returns the map from a body's prim to the stage, and its rotation.
    fn world(&self, body: usize, time: f64) -> (Affine, Quat) {
        let Pose { position, rotation } = pose_at(self.recording, body, time);
        let units = self.source.units;
        let turn = units.turn_to_stage(rotation);
        let linear = math::mul(math::rotation(turn), self.source.bodies[body].rest);
        (Affine { linear, shift: units.to_stage(position) }, turn)
    }

    /// Returns the time code in the stage itself.
    fn code_of_stage(&self, time: f64) -> f64 {
        self.source.units.start + time * self.source.units.rate
    }
}

/// Returns the map `world` relative to a parent, which has an inverse.
fn local(parent: &Affine, world: &Affine) -> Affine {
    let inverse = math::inverse(parent.linear).unwrap_or([[f64::NAN; 3]; 3]);
    Affine {
        linear: math::mul(inverse, world.linear),
        shift: math::apply(inverse, math::sub(world.shift, parent.shift)),
    }
}

/// Returns the rotation and the scale of a map that consists of these only.
fn rigid(linear: Mat3) -> Option<(Quat, f64)> {
    if linear == math::IDENTITY {
        return Some((math::NO_TURN, 1.0));
    }
    let (turn, sizes, shear) = split(linear)?;
    let scale = constant(&sizes)?;
    (shear < SAME && scale > 0.0).then_some((turn, scale))
}

/// Returns the first of some numbers, if the others equal it.
fn constant(numbers: &[f64]) -> Option<f64> {
    let first = *numbers.first()?;
    numbers.iter().all(|x| (x - first).abs() <= SAME * first.abs()).then_some(first)
}

impl LocalMotion {
    /// Sets the transform of a prim, which is relative to the stage if `reset`.
    fn write(&self, prim: &mut PrimWriter, reset: bool, codes: &[f64]) {
        const MAP: &str = "xformOp:transform:drystone";
        let mut order = Vec::new();
        if reset {
            order.push("!resetXformStack!");
        }
        match self {
            Self::Rigid { positions, rotations, rest } => {
                order.extend(["xformOp:translate:drystone", "xformOp:orient:drystone"]);
                let (place, turn) =
                    ("double3 xformOp:translate:drystone", "quatd xformOp:orient:drystone");
                follow(prim, place, codes, positions, |x| tuple(&x));
                follow(prim, turn, codes, rotations, turned);
                if let Some(scale) = diagonal(rest) {
                    if scale != [1.0; 3] {
                        order.push("xformOp:scale:drystone");
                        prim.set("double3 xformOp:scale:drystone", tuple(&scale));
                    }
                } else {
                    order.push(MAP);
                    let map = Affine { linear: *rest, shift: [0.0; 3] };
                    prim.set(format!("matrix4d {MAP}"), matrix(&map));
                }
            }
            Self::Maps(maps) => {
                order.push(MAP);
                let is_constant = maps.windows(2).all(|pair| pair[0] == pair[1]);
                let samples = codes.iter().copied().zip(maps.iter().map(matrix));
                let samples = samples.filter(|_| !is_constant);
                prim.follow(&format!("matrix4d {MAP}"), samples, maps.first().map(matrix));
            }
        }
        let order: Vec<_> = order.iter().map(|name| format!("\"{name}\"")).collect();
        prim.set("uniform token[] xformOpOrder", format!("[{}]", order.join(", ")));
    }
}

/// Returns the diagonal of a map, rounded to 12 digits, if it has no other entries.
fn diagonal(linear: &Mat3) -> Option<Vec3> {
    const DIGITS: f64 = 1e12;
    let [[x, a, b], [c, y, d], [e, f, z]] = *linear;
    let largest = [x, y, z].iter().fold(0.0_f64, |most, size| most.max(size.abs()));
    let is_diagonal = [a, b, c, d, e, f].iter().all(|other| other.abs() * DIGITS <= largest);
    is_diagonal.then(|| [x, y, z].map(|size| (size * DIGITS).round() / DIGITS))
}

/// Formats a map as a matrix of OpenUSD, which multiplies row vectors.
fn matrix(map: &Affine) -> String {
    let [a, b, c] = map.linear;
    let row = |[x, y, z]: Vec3, last: f64| tuple(&[x, y, z, last]);
    tuple(&[row(a, 0.0), row(b, 0.0), row(c, 0.0), row(map.shift, 1.0)])
}

/// Returns the path of a file as the layer at `layer` names it: relative to the folder of the
/// layer, with forward slashes. It is absolute if they have no folder in common.
fn relative(file: &Path, layer: &Path) -> io::Result<String> {
    let folder = |path: &Path| {
        let above = path.parent().filter(|above| !above.as_os_str().is_empty());
        fs::canonicalize(above.unwrap_or(Path::new(".")))
    };
    let (to, from) = (folder(file)?, folder(layer)?);
    let to = to.join(file.file_name().unwrap_or_default());
    let pair = to.components().zip(from.components());
    let common = pair.take_while(|(a, b)| a == b).count();
    if to.to_str().is_none() {
        let what = format!("the path of {} is not Unicode; rename it", file.display());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    if common == 0 {
        return Ok(to.to_string_lossy().replace('\\', "/"));
    }
    let up = from.components().skip(common).map(|_| "..".into());
    let down = to.components().skip(common).map(|part| part.as_os_str().to_string_lossy());
    let path = up.chain(down).collect::<Vec<_>>().join("/");
    Ok(if path.starts_with("../") { path } else { format!("./{path}") })
}

#[cfg(test)]
mod tests;
