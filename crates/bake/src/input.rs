//! Checks of bodies that a program describes. Those that a file describes have been checked by the
//! reader already, and pass.

use std::array::from_fn;

use drystone::InputError;
use drystone_scene::{
    Body, Mass, Motion, Rotation, ShapeKind, SurfaceVelocity, Track, spans_space,
};

use crate::convert::name;
use crate::error::BuildError;
use crate::world_kind::WorldKind;

type Checked = Result<(), InputError>;

/// Rejects a list of the wrong length.
pub(crate) fn check_count(item: &str, found: usize, expected: usize) -> Checked {
    let item = || format!("the number of entries of {item}");
    within(item, found as f64, [expected as f64; 2])
}

fn within(item: impl FnOnce() -> String, value: f64, [least, most]: [f64; 2]) -> Checked {
    if least <= value && value <= most {
        return Ok(());
    }
    Err(InputError::OutOfRange { item: item(), value, accepted: [least, most] })
}

/// Returns how many numbers an angular velocity has.
fn spin(dimension: usize) -> usize {
    if dimension == 3 { 3 } else { 1 }
}

/// Rejects a surface velocity with a wrong number of components.
pub(crate) fn check_surface(velocity: &SurfaceVelocity, dimension: usize) -> Checked {
    check_count("the linear surface velocity", velocity.linear.len(), dimension)?;
    check_count("the angular surface velocity", velocity.angular.len(), spin(dimension))
}

/// Rejects what the conversion to a world would misread: lists of the wrong length, shapes without
/// a size, masses and tracks that are not numbers. The world checks the ranges of all numbers.
pub(crate) fn check_body(body: &Body, index: usize, kind: WorldKind) -> Result<(), BuildError> {
    let refused = |error| BuildError::Body { body: name(body, index), error };
    check_lists(body, kind.dimension()).map_err(refused)?;
    for (number, shape) in body.shapes.iter().enumerate() {
        let wrong = |reason| BuildError::Shape { body: name(body, index), shape: number, reason };
        check_shape(&shape.kind, kind.dimension()).map_err(wrong)?;
        check_vertex_track(&shape.kind, body.motion).map_err(wrong)?;
    }
    let is_particle = kind.has_particles() && body.motion == Motion::Dynamic;
    if is_particle { check_particle(body).map_err(refused) } else { Ok(()) }
}

fn check_lists(body: &Body, dimension: usize) -> Checked {
    check_count("the position", body.position.len(), dimension)?;
    check_rotation("the rotation", &body.rotation, dimension)?;
    check_count("the linear velocity", body.linear_velocity.len(), dimension)?;
    check_count("the angular velocity", body.angular_velocity.len(), spin(dimension))?;
    check_count("the force", body.force.len(), dimension)?;
    check_mass(&body.mass, dimension)?;
    for shape in &body.shapes {
        check_count("the position of a shape", shape.position.len(), dimension)?;
        check_rotation("the rotation of a shape", &shape.rotation, dimension)?;
    }
    let own = body.shapes.iter().map(|shape| &shape.surface_velocity);
    let surfaces = own.chain([&body.surface_velocity]).flatten();
    surfaces.into_iter().try_for_each(|velocity| check_surface(velocity, dimension))?;
    check_track(&body.track, body.motion, dimension)
}

fn check_rotation(item: &str, rotation: &Rotation, dimension: usize) -> Checked {
    let found = match rotation {
        Rotation::Angle(_) => 1,
        Rotation::Quaternion(_) => 4,
    };
    check_count(item, found, if dimension == 3 { 4 } else { 1 })
}

fn check_mass(mass: &Mass, dimension: usize) -> Checked {
    let above_zero = |item: &str, value: f64| {
        within(|| item.to_owned(), value, [f64::MIN_POSITIVE, f64::INFINITY])
    };
    if let Some(mass) = mass.mass {
        above_zero("the mass [kg]", mass)?;
    }
    if let Some(center) = &mass.center {
        check_count("the center of mass", center.len(), dimension)?;
    }
    let Some(moments) = &mass.inertia else { return Ok(()) };
    check_count("the inertia", moments.len(), spin(dimension))?;
    moments.iter().try_for_each(|moment| above_zero("the moment of inertia [kg m^2]", *moment))
}

fn check_track(track: &Track, motion: Motion, dimension: usize) -> Checked {
    let keys = track.times.len();
    if motion == Motion::Static {
        check_count("the track of a static body", keys, 0)?;
    }
    check_count("the positions of the track", track.positions.len(), keys)?;
    check_count("the rotations of the track", track.rotations.len(), keys)?;
    let mut earliest = f64::MIN;
    for ((time, position), rotation) in
        track.times.iter().zip(&track.positions).zip(&track.rotations)
    {
        let later = || "a time of the track [s]".to_owned();
        within(later, *time, [earliest, f64::MAX])?;
        earliest = time.next_up();
        check_count("a position of the track", position.len(), dimension)?;
        check_rotation("a rotation of the track", rotation, dimension)?;
        let numbers = position.iter().copied().chain(rotation.quaternion());
        let finite = || "a number of the track".to_owned();
        numbers.into_iter().try_for_each(|x| within(finite, x, [f64::MIN, f64::MAX]))?;
    }
    Ok(())
}

/// Rejects a shape that cannot be made.
fn check_shape(kind: &ShapeKind, dimension: usize) -> Result<(), &'static str> {
    let is_size = |size: &f64| *size > 0.0 && size.is_finite();
    let is_vector = |of: &[f64]| of.len() == dimension && of.iter().all(|x| x.is_finite());
    const SIZE: &str = "has a size that is not accepted; give finite sizes above 0";
    let (is_right, reason) = match kind {
        ShapeKind::Sphere { radius } => (is_size(radius), SIZE),
        ShapeKind::Box { half_extents } => {
            (is_vector(half_extents) && half_extents.iter().all(is_size), SIZE)
        }
        ShapeKind::Capsule { radius, half_height } => {
            (is_size(radius) && (is_size(half_height) || *half_height == 0.0), SIZE)
        }
        ShapeKind::Cylinder { radius, half_height } => {
            (is_size(radius) && is_size(half_height), SIZE)
        }
        ShapeKind::Halfspace { normal } => (
            is_vector(normal) && normal.iter().any(|x| *x != 0.0),
            "has a normal that is not accepted; give a finite vector that is not zero",
        ),
        // Hulls in space are checked where they are made.
        ShapeKind::ConvexHull { points } => (
            points.iter().all(|point| is_vector(point)) && (dimension == 3 || spans_space(points)),
            "has points that are not accepted; give finite ones that are not all in one line",
        ),
        ShapeKind::Trimesh { vertices, triangles, .. } => {
            let is_there = |corner: &u32| (*corner as usize) < vertices.len();
            (
                vertices.iter().flatten().all(|x| x.is_finite())
                    && triangles.iter().flatten().all(is_there)
                    && triangles.iter().any(|of| has_area(of.map(|i| vertices[i as usize]))),
                "has vertices or triangles that are not accepted; give finite numbers, indices of \
                 vertices, and a triangle with an area",
            )
        }
    };
    if is_right { Ok(()) } else { Err(reason) }
}

/// Rejects places of vertices that do not fit their mesh.
fn check_vertex_track(kind: &ShapeKind, motion: Motion) -> Result<(), &'static str> {
    let ShapeKind::Trimesh { vertices, triangles, vertex_track: Some(track), .. } = kind else {
        return Ok(());
    };
    if motion == Motion::Dynamic {
        return Err("has a vertex track on a dynamic body; make the body static or kinematic");
    }
    track.check(vertices.len(), triangles).map_err(|_| {
        "has a vertex track that is not accepted; give times that ascend, as many finite points as \
         vertices for each, and triangles with an area at all times"
    })
}

/// Returns true if the corners of a triangle are not all in one line.
fn has_area([a, b, c]: [[f64; 3]; 3]) -> bool {
    let [u, v]: [[f64; 3]; 2] = [b, c].map(|p| from_fn(|i| p[i] - a[i]));
    (0..3).any(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        u[j] * v[k] != u[k] * v[j]
    })
}

/// Rejects a particle that is not a single sphere about its position, or has friction or spin.
fn check_particle(body: &Body) -> Checked {
    check_count("the shapes of a particle", body.shapes.len(), 1)?;
    let zero = |item: &str, value: f64| within(|| item.to_owned(), value, [0.0; 2]);
    for shape in &body.shapes {
        zero("the friction of a particle [1]", shape.material.friction)?;
        let mut position = shape.position.iter();
        position.try_for_each(|x| zero("the position of a particle in its body [m]", *x))?;
    }
    let mut spin = body.angular_velocity.iter();
    spin.try_for_each(|x| zero("the angular velocity of a particle [rad/s]", *x))
}
