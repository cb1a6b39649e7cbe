//! Conversion of a scene's bodies to those of a world.

use std::array::from_fn;

use drystone::geometry::{Frame, Geometry, MassProperties};
use drystone::{
    Body, Collider, Combine, Filter, Inertia, Material, SurfaceVelocity, Vector, Velocity,
};
use drystone_scene::{self as scene, Motion, Rotation};
use drystone_solver::SymmetricMatrix;

use crate::decomposition::Decompositions;
use crate::error::BuildError;
use crate::forms::{FromScene, Pieces, floats, place, times};

/// Name of a body, or its index.
pub(crate) fn name(body: &scene::Body, index: usize) -> String {
    body.name.clone().unwrap_or_else(|| format!("body {index}"))
}

/// Converts a body of a scene to a body of a world.
pub(crate) fn body_of<G: FromScene<L, A>, const L: usize, const A: usize>(
    body: &scene::Body,
    index: usize,
    known: &mut Decompositions,
) -> Result<Body<G, L, A>, BuildError> {
    let density = body.mass.density.unwrap_or(1000.0) as f32;
    let mut colliders = Vec::with_capacity(body.shapes.len());
    let mut solid = MassProperties::ZERO;
    for (number, shape) in body.shapes.iter().enumerate() {
        let wrong = |reason| BuildError::Shape { body: name(body, index), shape: number, reason };
        let pose = place::<G, L, A>(&shape.position, &shape.rotation);
        let dynamic = body.motion == Motion::Dynamic;
        let pieces = if dynamic { G::pieces(&shape.kind, known).map_err(wrong)? } else { None };
        let (forms, pose, own) = match pieces {
            Some(Pieces { shapes, center, solid }) => {
                let middle = G::pose(Vector(floats(&center)), &[]);
                let own = times(solid, density).placed(&G::frame(&pose));
                (shapes, G::compose(&pose, &middle), own)
            }
            None => {
                let form = G::shape(&shape.kind).map_err(wrong)?;
                let own = G::mass(&form, density).placed(&G::frame(&pose));
                (vec![form], pose, own)
            }
        };
        solid = solid.joined(&own);
        colliders.extend(forms.into_iter().map(|form| Collider {
            shape: form,
            pose,
            density,
            material: material(&shape.material),
            surface_velocity: shape.surface_velocity.as_ref().map(surface_motion),
            filter: filter(shape.filter),
            user_data: 0,
        }));
    }
    Ok(Body {
        motion: motion_of(body),
        pose: place::<G, L, A>(&body.position, &body.rotation),
        velocity: Velocity {
            linear: Vector(floats(&body.linear_velocity)),
            angular: Vector(floats(&body.angular_velocity)),
        },
        inertia: (body.motion == Motion::Dynamic).then(|| inertia::<G, L, A>(body, solid)),
        gravity_factor: body.gravity_factor as f32,
        damping: [body.linear_damping as f32, body.angular_damping as f32],
        surface_velocity: body.surface_velocity.as_ref().map(surface_motion),
        colliders,
        user_data: 0,
    })
}

/// Returns the motion of a body in a world. A static body whose meshes deform moves, as a kinematic
/// one at rest does.
fn motion_of(body: &scene::Body) -> drystone::Motion {
    let deforms = body.shapes.iter().any(|shape| shape.kind.vertex_track().is_some());
    match body.motion {
        Motion::Static if deforms => drystone::Motion::Kinematic,
        other => motion(other),
    }
}

/// Converts the motion of a body.
pub fn motion(motion: Motion) -> drystone::Motion {
    match motion {
        Motion::Dynamic => drystone::Motion::Dynamic,
        Motion::Static => drystone::Motion::Static,
        Motion::Kinematic => drystone::Motion::Kinematic,
    }
}

/// Converts the surface properties of a shape.
pub fn material(of: &scene::Material) -> Material {
    let scene::Material {
        friction,
        restitution,
        rolling_resistance,
        spinning_resistance,
        friction_combine,
        restitution_combine,
    } = *of;
    Material {
        friction,
        restitution,
        rolling_resistance,
        spinning_resistance,
        friction_combine: combine(friction_combine),
        restitution_combine: combine(restitution_combine),
    }
}

/// Converts a rule that combines two coefficients.
pub fn combine(rule: scene::Combine) -> Combine {
    match rule {
        scene::Combine::Average => Combine::Average,
        scene::Combine::Minimum => Combine::Minimum,
        scene::Combine::Maximum => Combine::Maximum,
        scene::Combine::Multiply => Combine::Multiply,
        scene::Combine::GeometricMean => Combine::GeometricMean,
    }
}

/// Converts a collision filter.
pub fn filter(of: scene::Filter) -> Filter {
    let scene::Filter { systems, collides_with, collides_with_unnamed } = of;
    Filter { systems, collides_with, collides_with_unnamed }
}

/// Converts the velocity of a surface.
pub(crate) fn surface_motion<const L: usize, const A: usize>(
    motion: &scene::SurfaceVelocity,
) -> SurfaceVelocity<L, A> {
    SurfaceVelocity {
        linear: Vector(floats(&motion.linear)),
        angular: Vector(floats(&motion.angular)),
        local: motion.local,
    }
}

/// Returns mass, center and moments of a body. Values that the body does not state are those of its
/// shapes; their moments are scaled to a stated mass.
fn inertia<G: Geometry<L, A>, const L: usize, const A: usize>(
    body: &scene::Body,
    mut solid: MassProperties<L, A>,
) -> Inertia<L, A> {
    if let Some(mass) = body.mass.mass.filter(|mass| mass.is_finite()) {
        let scale = if solid.mass > 0.0 { mass as f32 / solid.mass } else { 0.0 };
        solid.mass = mass as f32;
        for row in &mut solid.inertia.0 {
            *row = *row * scale;
        }
    }
    if let Some(center) = &body.mass.center {
        solid.center = Vector(floats(center));
    }
    let mut inertia = Inertia::of(&solid);
    if body.mass.mass.is_some_and(f64::is_infinite) {
        inertia = Inertia { center: solid.center, ..Inertia::FIXED };
    }
    if let Some(moments) = &body.mass.inertia {
        let principal = |f: fn(f64) -> f64| {
            let diagonal = Vector(from_fn(|i| f(moments.get(i).copied().unwrap_or(0.0)) as f32));
            let rotation = body.mass.inertia_rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
            let frame: Frame<L> = G::frame(&place::<G, L, A>(&[], &Rotation::Quaternion(rotation)));
            frame.tensor(SymmetricMatrix::diagonal(diagonal))
        };
        inertia.moments = principal(|moment| if moment.is_finite() { moment } else { 0.0 });
        inertia.inverse_moments =
            principal(|moment| if moment.is_finite() && moment > 0.0 { 1.0 / moment } else { 0.0 });
    }
    inertia
}
