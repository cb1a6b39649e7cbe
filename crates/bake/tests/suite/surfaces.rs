//! Tests of surface velocities, damping and resistance in scenes: read, written and simulated.

use std::fs;
use std::path::PathBuf;

use drystone::StepSettings;
use drystone_bake::build;
use drystone_scene::export::gltf::Physics;
use drystone_scene::export::usd::StageWriter;
use drystone_scene::{Read, Scene};

fn presets() -> [StepSettings; 3] {
    [StepSettings::quality(), StepSettings::certified(), StepSettings::realtime()]
}

/// Surface motion, resistance and damping give the same bits on two threads and after a checkpoint.
#[test]
fn threads_and_checkpoints_keep_the_bits() {
    let text = r#"
[[bodies]]
motion = "static"
surface_velocity = { linear = [0.3, 0, 0], angular = [0, 0.5, 0] }
shapes = [{ type = "box", half_extents = [5, 0.5, 5] }]
"#;
    let mut text = text.to_owned();
    for i in 0..30 {
        let at = [0.3 * f64::from(i % 5), 0.7 + 0.3 * f64::from(i / 5), 0.02 * f64::from(i)];
        text += &format!(
            "[[bodies]]\nposition = {at:?}\nlinear_damping = 0.1\nrolling_resistance = 0.002\n\
             spinning_resistance = 0.001\nshapes = [{{ type = \"sphere\", radius = 0.1 }}]\n"
        );
    }
    let scene = own(&text).scene;
    for settings in &presets() {
        let mut one = build(&scene, settings.clone()).unwrap();
        let mut two = build(&scene, settings.clone()).unwrap();
        two.set_threads(2);
        let mut resumed = build(&scene, settings.clone()).unwrap();
        for step in 0..60 {
            one.step(1.0 / 60.0).unwrap();
            two.step(1.0 / 60.0).unwrap();
            if step == 29 {
                resumed.restore(&one.checkpoint()).unwrap();
            } else if step > 29 {
                resumed.step(1.0 / 60.0).unwrap();
                assert_eq!(one.state_hash(), resumed.state_hash(), "step {step}");
            }
        }
        assert_eq!(one.state_hash(), two.state_hash());
    }
}

fn own(text: &str) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.toml");
    fs::write(&file, text).unwrap();
    drystone_bake::read(&file).unwrap()
}

fn read_as(name: &str, text: &str) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let file: PathBuf = folder.path().join(name);
    fs::write(&file, text).unwrap();
    drystone_bake::read(&file).unwrap()
}

const ALL: &str = r#"
[materials.rubber]
friction = 0.9
rolling_resistance = 0.0125
spinning_resistance = 0.003

[[bodies]]
name = "belt"
motion = "kinematic"
position = [0.1, 0.2, 0.3]
rotation = [0.1, 0.7, 0.1, 0.7]
surface_velocity = [1.1, 0.2, -0.3]
shapes = [
    { type = "box", half_extents = [2, 0.1, 1] },
    { type = "cylinder", radius = 0.1, half_height = 1, position = [2, 0, 0], rotation = [0.7071067811865476, 0, 0, 0.7071067811865476], surface_velocity = { angular = [0, 12.3, 0.1] } },
]

[[bodies]]
name = "table"
motion = "static"
surface_velocity = { linear = [0.1, 0, 0], angular = [0, 0.123456789, 0], local = false }
shapes = [{ type = "box", half_extents = [2, 0.1, 1] }]

[[bodies]]
name = "ball"
position = [0, 1, 0]
linear_damping = 0.123
angular_damping = 0.456
material = "rubber"
shapes = [{ type = "sphere", radius = 0.1 }]
"#;

/// Prints the surfaces, damping and shapes of a scene, with surface velocities in single precision
/// as simulated.
fn single(scene: &Scene) -> String {
    let of = |motion: &Option<drystone_scene::SurfaceVelocity>| {
        motion.as_ref().map(|of| {
            let single = |x: &[f64]| x.iter().map(|x| *x as f32).collect::<Vec<_>>();
            (single(&of.linear), single(&of.angular), of.local)
        })
    };
    let bodies: Vec<_> = scene
        .bodies
        .iter()
        .map(|body| {
            let shapes: Vec<_> = body
                .shapes
                .iter()
                .map(|shape| {
                    let of_surface = of(&shape.surface_velocity);
                    (shape.material.clone(), of_surface, shape.kind.clone())
                })
                .collect();
            let damping = [body.linear_damping, body.angular_damping];
            (body.name.clone(), damping, of(&body.surface_velocity), shapes)
        })
        .collect();
    format!("{bodies:#?}")
}

/// A scene written as glTF and as OpenUSD reads back with the same surfaces and damping, and with
/// the same bits after 30 steps.
#[test]
fn surfaces_and_damping_come_back_from_all_formats() {
    let read = own(ALL);
    assert!(read.warnings.is_empty(), "{:?}", read.warnings);
    let folder = tempfile::tempdir().unwrap();
    let stage = folder.path().join("scene.usda");
    StageWriter::new(&read.scene, &drystone_bake::Drystone).unwrap().write(&stage).unwrap();
    let masses = build(&read.scene, StepSettings::quality()).unwrap().masses();
    let gltf = folder.path().join("scene.gltf");
    Physics::new(&read.scene, &masses, &drystone_bake::Drystone)
        .unwrap()
        .write_gltf(&gltf)
        .unwrap();
    for file in [stage, gltf] {
        let back = drystone_bake::read(&file).unwrap();
        assert!(back.warnings.is_empty(), "{:?}", back.warnings);
        assert_eq!(single(&read.scene), single(&back.scene), "{}", file.display());
        let hash = |scene: &Scene| {
            let mut world = build(scene, StepSettings::quality()).unwrap();
            (0..30).for_each(|_| drop(world.step(1.0 / 60.0).unwrap()));
            world.state_hash()
        };
        assert_eq!(hash(&read.scene), hash(&back.scene), "{}", file.display());
    }
}

fn warned(read: &Read, parts: &[&str]) -> bool {
    let said = |message: &str| parts.iter().all(|part| message.contains(part));
    read.warnings.iter().any(|warning| said(&warning.message))
}

/// Surface velocities, damping and disabled gravity in PhysX's schemas are read, in centimeters and
/// with z up. Attributes that are not read give a warning.
#[test]
fn surfaces_of_physx_schemas_are_read() {
    let text = r#"#usda 1.0
( defaultPrim = "World" metersPerUnit = 0.01 upAxis = "Z" )
def Xform "World" {
  def PhysicsScene "scene" { }
  def Cube "belt" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysxSurfaceVelocityAPI"] ) {
    double size = 10
    bool physics:kinematicEnabled = 1
    vector3f physxSurfaceVelocity:surfaceVelocity = (0, 100, 0)
    vector3f physxSurfaceVelocity:surfaceAngularVelocity = (0, 0, 90)
    bool physxSurfaceVelocity:surfaceVelocityLocalSpace = LOCAL
    float3 xformOp:rotateXYZ = (0, 0, 90)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
  }
  def Sphere "ball" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysxRigidBodyAPI"] ) {
    double3 xformOp:translate = (0, 0, 500)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    float physxRigidBody:linearDamping = 0.25
    bool physxRigidBody:disableGravity = 1
    float physxRigidBody:maxLinearVelocity = 100
    int physxRigidBody:solverPositionIterationCount = 8
  }
}
"#;
    let local = read_as("local.usda", &text.replace("LOCAL", "1"));
    let [belt, ball] = local.scene.bodies.as_slice() else { panic!("{:?}", local.scene) };
    let motion = belt.surface_velocity.as_ref().unwrap();
    assert_eq!(motion.linear, [0.0, 1.0, 0.0]);
    assert_eq!(motion.angular[2] as f32, std::f32::consts::FRAC_PI_2);
    assert_eq!((ball.linear_damping, ball.angular_damping, ball.gravity_factor), (0.25, 0.05, 0.0));
    assert!(warned(&local, &["physxRigidBody:maxLinearVelocity is not read", "1 prim"]));
    assert!(warned(&local, &["another engine", "solverPositionIterationCount (1 prim)"]));
    let world = read_as("world.usda", &text.replace("LOCAL", "0"));
    let motion = world.scene.bodies[0].surface_velocity.as_ref().unwrap();
    // The stage's y axis is -z of the scene, its z axis is y.
    assert_eq!(motion.linear, [0.0, 0.0, -1.0]);
    assert!(motion.angular[1] > 1.5 && !motion.local);
}

/// Each attribute or schema that is not read gives one warning with its number of prims. Joints of
/// any type name give one, too.
#[test]
fn unread_data_of_stages_gives_warnings() {
    let body = |name: &str| {
        format!(
            r#"
  def Sphere "{name}" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysxForceAPI"] ) {{
    float physics:dragCoefficient = 1
    vector3f physxForce:force = (1, 0, 0)
    vector3f physxSurfaceVelocity:surfaceVelocity = (1, 0, 0)
    token visibility = "inherited"
  }}
"#
        )
    };
    let text = format!(
        "#usda 1.0\n( metersPerUnit = 1 upAxis = \"Y\" )\ndef Xform \"World\" {{\n  def PhysicsScene \"scene\" {{ }}\n\
         {}{}{}\n  def DistancePhysicsJoint \"rope\" {{ rel physics:body0 = </World/a> }}\n  \
         def PhysicsRevoluteJoint \"hinge\" {{ float physics:lowerLimit = 1 }}\n  \
         def PhysxPhysicsGearJoint \"gear\" {{ }}\n}}\n",
        body("a"),
        body("b"),
        body("c")
    );
    let read = read_as("strange.usda", &text);
    assert!(warned(&read, &["rope", "not simulated", "DistancePhysicsJoint is not a type"]));
    assert!(warned(&read, &["hinge", "the joint is left out"]));
    assert!(warned(&read, &["gear", "not simulated", "PhysxPhysicsGearJoint"]));
    for name in ["physics:dragCoefficient", "physxForce:force", "PhysxForceAPI"] {
        assert!(warned(&read, &[name, "3 prims"]), "{name}: {:?}", read.warnings);
        let all = read.warnings.iter().filter(|of| of.message.contains(&format!("{name} ")));
        assert_eq!(all.count(), 1, "{name}");
    }
    assert!(warned(&read, &["surface velocity does not act without PhysxSurfaceVelocityAPI"]));
    assert!(!warned(&read, &["visibility"]) && !warned(&read, &["lowerLimit"]));
}

/// Each unknown property or extension of a glTF file gives one warning with its number of
/// occurrences. Known extensions of physics that are not simulated are named.
#[test]
fn unread_data_of_gltf_gives_warnings() {
    let node = r#"{ "extensions": {
        "KHR_physics_rigid_bodies": {
            "motion": { "mass": 1, "linearDamping": 0.5, "extensions": { "EXT_wind": {} } },
            "collider": { "geometry": { "shape": 0 } } },
        "OMI_physics_drag": { "drag": 1 } } }"#;
    let text = format!(
        r#"{{ "asset": {{ "version": "2.0" }}, "scene": 0, "scenes": [{{ "nodes": [0, 1] }}],
        "extensionsUsed": ["KHR_physics_rigid_bodies", "KHR_implicit_shapes", "OMI_physics_drag"],
        "extensions": {{ "KHR_implicit_shapes": {{ "shapes": [
            {{ "type": "sphere", "sphere": {{ "radius": 1, "roundness": 2 }} }}] }} }},
        "nodes": [{node}, {node}] }}"#
    );
    let read = read_as("strange.gltf", &text);
    for (what, times) in [
        ("'linearDamping' is not a property of motion", 2),
        ("the extension EXT_wind of motion", 2),
        ("the extension OMI_physics_drag of nodes", 2),
        ("'roundness' is not a property of sphere", 1),
    ] {
        let all: Vec<_> = read.warnings.iter().filter(|of| of.message.contains(what)).collect();
        assert_eq!(all.len(), 1, "{what}: {:?}", read.warnings);
        assert_eq!(all[0].message.contains("2 times"), times == 2, "{what}");
    }
    assert!(warned(&read, &["OMI_physics_drag is not simulated"]));
}

/// In Drystone's own format, wrong values of surfaces and damping are refused with what is
/// accepted. Values without effect give a warning.
#[test]
fn surfaces_in_the_own_format() {
    let refused = |line: &str| {
        let text = format!("[[bodies]]\n{line}\nshapes = [{{ type = \"sphere\", radius = 1 }}]\n");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.toml");
        fs::write(&file, text).unwrap();
        drystone_bake::read(&file).unwrap_err().to_string()
    };
    assert!(refused("surface_velocity = [1, 2]").contains("3 numbers"));
    assert!(refused("surface_velocity = { lineal = [1, 2, 3] }").contains("'linear'"));
    assert!(refused("surface_velocity = { local = 1 }").contains("true or false"));
    assert!(refused("linear_damping = -1").contains("linear_damping"));
    assert!(refused("rolling_resistance = -1").contains("rolling_resistance"));
    let idle = own("[[bodies]]\nmotion = \"static\"\nlinear_damping = 1\nfriction = 0\n\
         surface_velocity = [1, 0, 0]\nshapes = [{ type = \"sphere\", radius = 1 }]\n");
    assert!(warned(&idle, &["linear_damping", "does not act"]));
    assert!(warned(&idle, &["surface_velocity", "does not act"]));
    let flat = own("dimension = 2\n[[bodies]]\nmotion = \"static\"\n\
         surface_velocity = { angular = 2 }\nshapes = [{ type = \"sphere\", radius = 1 }]\n");
    assert_eq!(flat.scene.bodies[0].surface_velocity.as_ref().unwrap().angular, [2.0]);
}
