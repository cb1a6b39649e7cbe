//! Writes a scene in Drystone's own format; values equal to their defaults are omitted.

mod defaults;
mod joint;

use serde_json::Value;

use self::defaults::{number_unless, rotation_document, rotation_unless, unless};
use self::joint::joint_document;
use super::description::{
    BodiesAs, Body, Combine, Filter, Material, Motion, Rotation, Scene, Shape, SurfaceVelocity,
    Track, WorldTrack,
};
use super::document::values::Unbounded;
use super::document::{
    BodyDocument, CollisionDocument, InertiaDocument, KeyDocument, SceneDocument, ShapeDocument,
    SpinDocument, SurfaceDocument, SurfaceMotionDocument, SurfaceVelocityDocument,
    WorldKeyDocument,
};
use super::format::surface::default_material;
use super::format::{GRAVITY, TIME_STEP};
use super::joint::Joint;

/// Returns the scene as JSON. Reading it gives the same scene.
pub fn to_json(scene: &Scene) -> String {
    // Serialization cannot fail: a document has only text keys and finite numbers.
    serde_json::to_string_pretty(&document(scene)).unwrap_or_default() + "\n"
}

/// Returns the scene without its bodies, its joints and its name, as one line of JSON.
pub(crate) fn own_words(scene: &Scene) -> String {
    let none = Scene { bodies: Vec::new(), joints: Vec::new(), name: None, ..scene.clone() };
    serde_json::to_string(&document(&none)).unwrap_or_default()
}

/// Returns a joint without name, bodies and frames as JSON of the own format.
pub(crate) fn own_joint(joint: &Joint) -> Value {
    let mut own = serde_json::to_value(joint_document(joint, &[], 3)).unwrap_or_default();
    if let Some(own) = own.as_object_mut() {
        ["name", "bodies", "frames", "collide"].iter().for_each(|key| _ = own.remove(*key));
    }
    own
}

/// Returns the scene as TOML. Reading it gives the same scene.
pub fn to_toml(scene: &Scene) -> String {
    toml::to_string(&document(scene)).unwrap_or_default()
}

fn document(scene: &Scene) -> SceneDocument {
    let particles = scene.bodies_as == BodiesAs::Particles;
    let mut gravity = vec![0.0; scene.dimension];
    gravity[1] = GRAVITY;
    SceneDocument {
        name: scene.name.clone(),
        dimension: (scene.dimension != 3).then_some(scene.dimension),
        gravity: unless(&scene.gravity, &gravity),
        time_step: (scene.time_step != TIME_STEP).then_some(scene.time_step),
        track: world_keys(scene),
        steps: scene.steps,
        bodies_as: particles.then_some(BodiesAs::Particles),
        solver: scene.solver.clone(),
        bodies: scene.bodies.iter().map(|body| body_document(body, scene)).collect(),
        joints: scene
            .joints
            .iter()
            .map(|joint| joint_document(joint, &scene.bodies, scene.dimension))
            .collect(),
        ..SceneDocument::default()
    }
}

fn body_document(body: &Body, scene: &Scene) -> BodyDocument {
    let dimension = scene.dimension;
    let zero = vec![0.0; dimension];
    let default = default_material(scene.bodies_as == BodiesAs::Particles);
    let material = common(body, |shape| &shape.material).unwrap_or(&default);
    let filter = common(body, |shape| &shape.filter).copied().unwrap_or_default();
    BodyDocument {
        name: body.name.clone(),
        motion: (body.motion != Motion::default()).then_some(body.motion),
        position: unless(&body.position, &zero),
        rotation: rotation_unless(body.rotation, Rotation::identity(dimension)),
        linear_velocity: unless(&body.linear_velocity, &zero),
        angular_velocity: spin(&body.angular_velocity),
        gravity_factor: (body.gravity_factor != 1.0).then_some(body.gravity_factor),
        linear_damping: number_unless(body.linear_damping, 0.0),
        angular_damping: number_unless(body.angular_damping, 0.0),
        force: unless(&body.force, &zero),
        start_asleep: body.start_asleep.then_some(true),
        surface_velocity: body.surface_velocity.as_ref().map(surface_velocity),
        density: body.mass.density,
        mass: body.mass.mass.map(Unbounded::Number),
        center_of_mass: body.mass.center.clone(),
        inertia: body.mass.inertia.as_deref().map(inertia),
        inertia_rotation: body.mass.inertia_rotation,
        material: None,
        surface: surface(material, &default),
        collision: collision(filter, Filter::default()),
        shapes: body
            .shapes
            .iter()
            .map(|s| shape_document(s, material, filter, dimension))
            .collect(),
        track: keys(&body.track),
        extras: None,
    }
}

/// Returns the value that all shapes of a body share, if there is one. It is written once, on the
/// body.
fn common<T: PartialEq>(body: &Body, of: impl Fn(&Shape) -> &T) -> Option<&T> {
    let first = of(body.shapes.first()?);
    body.shapes.iter().all(|shape| of(shape) == first).then_some(first)
}

fn shape_document(
    shape: &Shape,
    material: &Material,
    filter: Filter,
    dimension: usize,
) -> ShapeDocument {
    ShapeDocument {
        kind: shape.kind.clone(),
        position: unless(&shape.position, &vec![0.0; dimension]),
        rotation: rotation_unless(shape.rotation, Rotation::identity(dimension)),
        surface: surface(&shape.material, material),
        surface_velocity: shape.surface_velocity.as_ref().map(surface_velocity),
        collision: collision(shape.filter, filter),
        extras: None,
    }
}

/// Writes a purely linear, local surface velocity as a vector, any other as a table.
fn surface_velocity(motion: &SurfaceVelocity) -> SurfaceVelocityDocument {
    let SurfaceVelocity { linear, angular, local } = motion;
    let turning = spin(angular);
    if turning.is_none() && *local {
        return SurfaceVelocityDocument::Linear(linear.clone());
    }
    SurfaceVelocityDocument::Table(SurfaceMotionDocument {
        linear: unless(linear, &vec![0.0; linear.len()]),
        angular: turning,
        local: (!local).then_some(false),
    })
}

fn spin(velocity: &[f64]) -> Option<SpinDocument> {
    let moving = unless(velocity, &vec![0.0; velocity.len()])?;
    Some(match moving.as_slice() {
        [number] => SpinDocument::Number(*number),
        _ => SpinDocument::Vector(moving),
    })
}

fn inertia(moments: &[f64]) -> InertiaDocument {
    match moments {
        [number] => InertiaDocument::Number(Unbounded::Number(*number)),
        _ => InertiaDocument::Principal(moments.iter().copied().map(Unbounded::Number).collect()),
    }
}

fn surface(material: &Material, default: &Material) -> SurfaceDocument {
    let combine = |x: Combine, y: Combine| (x != y).then_some(x);
    SurfaceDocument {
        friction: number_unless(material.friction, default.friction),
        restitution: number_unless(material.restitution, default.restitution),
        rolling_resistance: number_unless(material.rolling_resistance, default.rolling_resistance),
        spinning_resistance: number_unless(
            material.spinning_resistance,
            default.spinning_resistance,
        ),
        friction_combine: combine(material.friction_combine, default.friction_combine),
        restitution_combine: combine(material.restitution_combine, default.restitution_combine),
    }
}

/// Names each system by its bit number; the reader takes such names as the numbers themselves.
fn collision(filter: Filter, default: Filter) -> Option<CollisionDocument> {
    let names = |mask: u64| -> Vec<String> {
        (0..64).filter(|bit| mask & (1 << bit) != 0).map(|bit: u32| bit.to_string()).collect()
    };
    let all_but = filter.collides_with_unnamed;
    // A shape that collides with everything must say so if its body does not.
    let listed = filter.collides_with != u64::MAX || !all_but;
    (filter != default).then(|| CollisionDocument {
        systems: names(filter.systems),
        collides_with: (!all_but).then(|| names(filter.collides_with)),
        not_collides_with: (all_but && listed).then(|| names(!filter.collides_with)),
    })
}

fn world_keys(scene: &Scene) -> Vec<WorldKeyDocument> {
    let WorldTrack { times, speeds, gravities } = &scene.track;
    let key = |(time, (speed, gravity)): (&f64, (&f64, &Vec<f64>))| WorldKeyDocument {
        time: *time,
        speed: number_unless(*speed, 1.0),
        gravity: unless(gravity, &scene.gravity),
    };
    times.iter().zip(speeds.iter().zip(gravities)).map(key).collect()
}

fn keys(track: &Track) -> Vec<KeyDocument> {
    let poses = track.positions.iter().zip(&track.rotations);
    let key = |(time, (position, rotation)): (&f64, (&Vec<f64>, &Rotation))| KeyDocument {
        time: *time,
        position: Some(position.clone()),
        rotation: Some(rotation_document(*rotation)),
    };
    track.times.iter().zip(poses).map(key).collect()
}

#[cfg(test)]
pub(crate) mod tests;
