//! Warnings about physics on a stage that is not simulated or not read. Unknown names are reported
//! once each, with the number of prims that have them.

use std::collections::BTreeMap;

use super::super::error::Warning;
use super::joints;
use super::stage::Stage;

/// API schemas that are read, or reported elsewhere.
const SCHEMAS: [&str; 9] = [
    "PhysicsArticulationRootAPI",
    "PhysicsCollisionAPI",
    "PhysicsFilteredPairsAPI",
    "PhysicsMassAPI",
    "PhysicsMaterialAPI",
    "PhysicsMeshCollisionAPI",
    "PhysicsRigidBodyAPI",
    "PhysxRigidBodyAPI",
    "PhysxSurfaceVelocityAPI",
];

/// Properties that are read, or have no meaning in a stage with one scene.
const PROPERTIES: [&str; 29] = [
    "physics:angularVelocity",
    "physics:approximation",
    "physics:centerOfMass",
    "physics:collisionEnabled",
    "physics:density",
    "physics:diagonalInertia",
    "physics:dynamicFriction",
    "physics:filteredGroups",
    "physics:filteredPairs",
    "physics:gravityDirection",
    "physics:gravityMagnitude",
    "physics:invertFilteredGroups",
    "physics:kinematicEnabled",
    "physics:mass",
    "physics:mergeGroup",
    "physics:principalAxes",
    "physics:restitution",
    "physics:rigidBodyEnabled",
    "physics:simulationOwner",
    "physics:startsAsleep",
    "physics:staticFriction",
    "physics:velocity",
    "physxRigidBody:angularDamping",
    "physxRigidBody:disableGravity",
    "physxRigidBody:linearDamping",
    "physxSurfaceVelocity:surfaceAngularVelocity",
    "physxSurfaceVelocity:surfaceVelocity",
    "physxSurfaceVelocity:surfaceVelocityEnabled",
    "physxSurfaceVelocity:surfaceVelocityLocalSpace",
];

/// Properties of a mesh that follows a skeleton or blend shapes.
const SKINNED: [&str; 2] = ["primvars:skel:jointIndices", "skel:blendShapes"];

/// Physics types that are read.
const TYPES: [&str; 2] = ["PhysicsScene", "PhysicsCollisionGroup"];

/// Returns true if a name belongs to UsdPhysics or to the schema of a physics engine.
fn is_physical(name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    ["physics", "physx", "mjc", "newton"].iter().any(|of| lower.starts_with(of))
}

/// Returns true if a property tunes the numerics of another engine, and does not describe physics.
fn is_tuning(name: &str) -> bool {
    const OF_BODIES: [&str; 11] = [
        "contactSlopCoefficient",
        "enableCCD",
        "enableSpeculativeCCD",
        "maxDepenetrationVelocity",
        "cfmScale",
        "retainAccelerations",
        "sleepThreshold",
        "solveContact",
        "solverPositionIterationCount",
        "solverVelocityIterationCount",
        "stabilizationThreshold",
    ];
    const OF_COLLIDERS: [&str; 2] = ["contactOffset", "autoMeshSimplification"];
    match name.split_once(':') {
        Some(("physxScene", _)) | None => name.starts_with("physxScene"),
        Some(("physxRigidBody", of)) => OF_BODIES.contains(&of),
        Some(("physxCollision", of)) => OF_COLLIDERS.contains(&of),
        Some((cooking, _)) => {
            cooking.starts_with("physx")
                && (cooking.ends_with("Collision") && cooking != "physxCollision")
        }
    }
}

/// Number of prims with an unread name, and the index of the first of them.
type Count = (usize, usize);

/// Warns about physics that is not simulated or not read. `of_joints` are names that were not read,
/// each with the index of a joint of UsdPhysics.
pub(super) fn name(
    stage: &Stage<'_>,
    of_joints: Vec<(usize, String)>,
    warnings: &mut Vec<Warning>,
) {
    let mut strange: BTreeMap<String, Count> = BTreeMap::new();
    let mut tuning: BTreeMap<String, Count> = BTreeMap::new();
    let count = |to: &mut BTreeMap<String, Count>, index: usize, what: String| {
        let of = to.entry(what).or_insert((0, index));
        of.0 = of.0.saturating_add(1);
    };
    for (index, name) in of_joints {
        let base = name.split(':').next().unwrap_or(&name);
        let is_named = name.contains(":physics:") || name.starts_with("drystone:");
        if !(is_named || is_physical(&name)) || SCHEMAS.contains(&base) {
            continue;
        }
        count(if is_tuning(&name) { &mut tuning } else { &mut strange }, index, name);
    }
    for (index, prim) in stage.prims.iter().enumerate() {
        if joints::is_known(prim) {
            continue;
        }
        if prim.kind.ends_with("Joint") {
            let what = "the joint is not simulated: nothing holds the bodies together";
            let kind = &prim.kind;
            stage.warn(prim, format!("{what}. {kind} is not a type of UsdPhysics."), warnings);
            continue;
        }
        let has = |schema: &str| prim.schemas.contains(schema);
        if has("PhysxSurfaceVelocityAPI")
            && !has("PhysicsRigidBodyAPI")
            && !has("PhysicsCollisionAPI")
        {
            let what = "its surface velocity does not act: it is neither a body nor a collider";
            stage.warn(prim, what, warnings);
        }
        let follows = |name: &&str| prim.properties.contains_key(*name);
        if has("PhysicsCollisionAPI") && SKINNED.iter().any(follows) {
            let what = "its mesh does not follow a skeleton or blend shapes: give its points time \
                        samples";
            stage.warn(prim, what, warnings);
        }
        if prim.kind == "PointInstancer" {
            stage.warn(prim, "its instances are not simulated", warnings);
        }
        let kind = prim.kind.as_str();
        let is_type = |name: &str| is_physical(name) || name.contains("Physics");
        if is_type(kind) && !TYPES.contains(&kind) {
            count(&mut strange, index, format!("the type {kind}"));
        }
        for schema in &prim.schemas {
            let base = schema.split(':').next().unwrap_or(schema);
            if is_physical(base) && !SCHEMAS.contains(&base) {
                count(&mut strange, index, base.to_owned());
            }
        }
        for (name, property) in &prim.properties {
            let says = property.value().is_some() || !property.targets.is_empty();
            if !says || !is_physical(name) || PROPERTIES.contains(&name.as_str()) {
                continue;
            }
            count(if is_tuning(name) { &mut tuning } else { &mut strange }, index, name.clone());
        }
    }
    for (what, (count, first)) in &strange {
        if let Some(prim) = stage.prim(*first) {
            let of = prims(*count);
            stage.warn(prim, format!("{what} is not read, and does not act ({of})"), warnings);
        }
    }
    let first = tuning.values().map(|(_, first)| *first).min();
    if let Some(prim) = first.and_then(|first| stage.prim(first)) {
        let named: Vec<_> =
            tuning.iter().map(|(name, (count, _))| format!("{name} ({})", prims(*count))).collect();
        let what = "settings of another engine's solver are not read";
        stage.warn(prim, format!("{what}: {}", named.join(", ")), warnings);
    }
}

fn prims(count: usize) -> String {
    if count == 1 { "1 prim".to_owned() } else { format!("{count} prims") }
}
