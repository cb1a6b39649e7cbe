//! Mass of a body, stated on it or computed from its colliders.
//!
//! A mass on the body takes precedence over the masses of its colliders. A mass takes precedence
//! over a density, and the density of a collider over that of its body. The density of a material
//! is the weakest.

use super::super::description::{Mass, Motion, Shape};
use super::super::engine::Weight;
use super::super::error::{SceneError, Warning};
use super::super::graph::math::{self, Quat};
use super::super::graph::{FAR, HEAVY, LIGHT, TURN_SLACK};
use super::prims::Prim;
use super::stage::Stage;

/// Density if none is stated. \[kg/m^3\]
const DENSITY: f64 = 1000.0;

/// A collider of a body.
pub(super) struct ColliderMass<'s> {
    pub(super) prim: usize,
    pub(super) shape: &'s Shape,
    /// Density of its material. \[kg/m^3\]
    pub(super) density: Option<f64>,
}

/// Computes the mass of a body with these colliders. `scale` maps the space of the body's prim to
/// the body's frame.
pub(super) fn of(
    stage: &Stage<'_>,
    body: usize,
    parts: &[ColliderMass<'_>],
    motion: Motion,
    scale: math::Mat3,
    warnings: &mut Vec<Warning>,
) -> Result<Mass, SceneError> {
    let Some(prim) = stage.prim(body) else { return Ok(Mass::default()) };
    let mut mass = own(stage, prim, scale)?;
    let mut weights = Vec::new();
    let mut densities: Vec<Option<f64>> = Vec::new();
    for part in parts {
        let total = stage.prim(part.prim).map(|p| weight(stage, p)).transpose()?.flatten();
        let mut density = None;
        for (index, above) in stage.up(part.prim) {
            density = density.or(density_of(stage, above)?);
            if index == body {
                break;
            }
        }
        let density = density.or(part.density);
        // A mass on the body's own prim is that of the whole body, which `own` has read.
        let own = total.filter(|_| part.prim != body);
        weights.push(own.map_or(Weight::Density(density.unwrap_or(DENSITY)), Weight::Mass));
        densities.push(density);
    }
    let uneven = weights.iter().any(|weight| Some(weight) != weights.first());
    let masses = mass.mass.is_none() && weights.iter().any(|w| matches!(w, Weight::Mass(_)));
    if !uneven && !masses {
        if mass.mass.is_none() {
            mass.density = densities.first().copied().flatten();
        }
        return Ok(mass);
    }
    if motion != Motion::Dynamic {
        return Ok(mass);
    }
    let shapes = parts.iter().zip(&weights).map(|(part, weight)| (part.shape, *weight));
    let solid = match stage.engine.solid(&shapes.collect::<Vec<_>>()) {
        Ok(solid) => solid,
        Err(why) => {
            stage.warn(prim, why, warnings);
            return Ok(mass);
        }
    };
    let (moments, turn) = math::principal(solid.inertia);
    let total = mass.mass.unwrap_or(solid.mass);
    let factor = if total.is_finite() && solid.mass > 0.0 { total / solid.mass } else { 1.0 };
    mass.mass = Some(total);
    mass.center = mass.center.or(Some(solid.center.to_vec()));
    if mass.inertia.is_none() && total.is_finite() {
        mass.inertia = Some(moments.iter().map(|moment| moment * factor).collect());
        mass.inertia_rotation = Some(turn);
    }
    Ok(mass)
}

/// Reads the mass of a prim; 0 counts as absent. \[kg\]
fn weight(stage: &Stage<'_>, prim: &Prim) -> Result<Option<f64>, SceneError> {
    let unit = stage.units.kilograms;
    let mass = stage.number(prim, "physics:mass", 0.0, HEAVY)?;
    let mass = mass.filter(|mass| *mass > 0.0).map(|mass| mass * unit);
    if mass.is_some_and(|mass| mass < LIGHT) {
        return Err(stage.refuse(prim, "physics:mass", &format!("0, or from {LIGHT:e} kg")));
    }
    Ok(mass)
}

fn density_of(stage: &Stage<'_>, prim: &Prim) -> Result<Option<f64>, SceneError> {
    let density = stage.number(prim, "physics:density", 0.0, HEAVY)?;
    Ok(density.filter(|density| *density > 0.0).map(|density| density * stage.units.density()))
}

/// Reads the mass properties stated on the body itself.
fn own(stage: &Stage<'_>, prim: &Prim, scale: math::Mat3) -> Result<Mass, SceneError> {
    const CENTER: &str = "physics:centerOfMass";
    const MOMENTS: &str = "physics:diagonalInertia";
    const AXES: &str = "physics:principalAxes";
    let units = stage.units;
    let mut mass = Mass { mass: weight(stage, prim)?, ..Mass::default() };
    // A component of -inf means that the colliders decide.
    if let Some(center) = stage.any_vector::<3>(prim, CENTER)?
        && center.iter().all(|x| *x != f64::NEG_INFINITY)
    {
        if !center.iter().all(|x| x.abs() <= FAR) {
            return Err(stage.refuse(prim, CENTER, &format!("coordinates up to {FAR:e}, or -inf")));
        }
        let center = if scale == math::IDENTITY { center } else { math::apply(scale, center) };
        mass.center = Some(center.to_vec());
    }
    if let Some(moments) = stage.any_vector::<3>(prim, MOMENTS)?
        && moments != [0.0; 3]
    {
        if !moments.iter().all(|moment| (LIGHT..=HEAVY).contains(moment)) {
            let accepted = format!("0, 0, 0, or three moments from {LIGHT:e} to {HEAVY:e}");
            return Err(stage.refuse(prim, MOMENTS, &accepted));
        }
        let unit = units.kilograms * units.meters.powi(2);
        mass.inertia = Some(moments.iter().map(|moment| moment * unit).collect());
    }
    if let Some([w, x, y, z]) = stage.any_vector::<4>(prim, AXES)?
        && [w, x, y, z] != [0.0; 4]
    {
        let turn: Quat = [x, y, z, w];
        let length = math::quat_dot(turn, turn).sqrt();
        match math::quat_as_written(turn) {
            Some(unit) if (length - 1.0).abs() <= TURN_SLACK => {
                mass.inertia_rotation = mass.inertia.is_some().then_some(unit);
            }
            _ => return Err(stage.refuse(prim, AXES, "0, 0, 0, 0, or a quaternion of length 1")),
        }
    }
    endless(stage, prim, &mut mass)?;
    Ok(mass)
}

/// Reads infinite masses and moments, which UsdPhysics cannot express, from custom attributes.
fn endless(stage: &Stage<'_>, prim: &Prim, mass: &mut Mass) -> Result<(), SceneError> {
    if stage.number(prim, "drystone:mass", LIGHT, f64::INFINITY)? == Some(f64::INFINITY)
        && mass.mass.is_none()
    {
        mass.mass = Some(f64::INFINITY);
    }
    const OWN: &str = "drystone:diagonalInertia";
    if let Some(moments) = stage.any_vector::<3>(prim, OWN)?
        && mass.inertia.is_none()
    {
        if !moments.iter().all(|moment| *moment >= LIGHT) {
            return Err(stage.refuse(prim, OWN, &format!("three moments from {LIGHT:e}")));
        }
        mass.inertia = Some(moments.to_vec());
        if let Some([w, x, y, z]) = stage.vector::<4>(prim, "drystone:principalAxes", 1.0)? {
            mass.inertia_rotation = Some([x, y, z, w]);
        }
    }
    Ok(())
}
