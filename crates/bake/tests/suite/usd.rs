//! Tests of reading OpenUSD with UsdPhysics, and of writing scenes that read back unchanged.

#![allow(clippy::result_large_err)]

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::counting::largest;
use crate::common::worked;
use drystone::StepSettings;
use drystone_bake::recording::{self, JointRecording, Recording, Sampling};
use drystone_bake::{Drystone, build, read};
use drystone_scene::export::usd::StageWriter;
use drystone_scene::{
    Body, Breaking, Combine, Joint, JointFrame, Motion, Read, Rotation, Scene, SceneError,
    ShapeKind, usd,
};

/// Head of a stage in meters with +y up.
const HEAD: &str = "#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = \"Y\"\n)\n";

/// Writes files into one folder and reads the last of them as a scene.
fn read_all(files: &[(&str, &str)]) -> Result<Read, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let mut last = folder.path().to_owned();
    for (name, text) in files {
        last = folder.path().join(name);
        fs::create_dir_all(last.parent().unwrap()).unwrap();
        fs::write(&last, text).unwrap();
    }
    read(&last)
}

fn text(text: &str) -> Result<Read, SceneError> {
    read_all(&[("scene.usda", text)])
}

/// Reads prims in meters with +y up, and returns the scene and its warnings.
fn prims(prims: &str) -> (Scene, String) {
    let read = text(&format!("{HEAD}{prims}")).unwrap_or_else(|error| panic!("{error}"));
    let warnings: Vec<_> = read.warnings.iter().map(ToString::to_string).collect();
    (read.scene, warnings.join("\n"))
}

/// Reads a stage of one body that gives no warning.
fn body(text: &str) -> Body {
    let (scene, warnings) = prims(text);
    assert_eq!((scene.bodies.len(), warnings.as_str()), (1, ""));
    scene.bodies[0].clone()
}

/// Returns a dynamic sphere of radius 1 m with these attributes.
fn ball(attributes: &str) -> String {
    format!(
        "def Sphere \"Ball\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\", \
         \"PhysicsCollisionAPI\", \"PhysicsMassAPI\"]) {{ {attributes} }}\n"
    )
}

/// Returns a static collider of this type with these attributes.
fn collider(kind: &str, attributes: &str) -> String {
    format!(
        "def {kind} \"Shape\" (prepend apiSchemas = [\"PhysicsCollisionAPI\"]) {{ {attributes} }}\n"
    )
}

fn near(a: &[f64], b: &[f64]) {
    let close =
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * (1.0 + b.abs()));
    assert!(close, "{a:?} is not {b:?}");
}

/// Rotates a vector by the rotation of a body.
fn turned(rotation: Rotation, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let Rotation::Quaternion([a, b, c, w]) = rotation else { panic!() };
    let t = [2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)];
    [
        x + w * t[0] + b * t[2] - c * t[1],
        y + w * t[1] + c * t[0] - a * t[2],
        z + w * t[2] + a * t[1] - b * t[0],
    ]
}

/// Units and the up axis of a stage become meters, kilograms, radians and +y, within 1e-6.
#[test]
fn units_and_axes_become_meters_with_y_up() {
    let stage =
        "#usda 1.0\n(\n metersPerUnit = 0.01\n kilogramsPerUnit = 0.001\n upAxis = \"Z\"\n)\n";
    let ball = ball(
        "double radius = 50\n double3 xformOp:translate = (100, 200, 300)\n float physics:mass = \
         2000\n\
         vector3f physics:velocity = (0, 0, 100)\n vector3f physics:angularVelocity = (0, 0, 180)\n\
         uniform token[] xformOpOrder = [\"xformOp:translate\"]",
    );
    let scene = "def PhysicsScene \"S\" {\n float physics:gravityMagnitude = 981\n}\n";
    let read = text(&format!("{stage}{scene}{ball}")).unwrap();
    assert_eq!(read.warnings, []);
    let body = &read.scene.bodies[0];
    near(&read.scene.gravity, &[0.0, -9.81, 0.0]);
    near(&body.position, &[1.0, 3.0, -2.0]);
    near(&body.linear_velocity, &[0.0, 1.0, 0.0]);
    near(&body.angular_velocity, &[0.0, std::f64::consts::PI, 0.0]);
    near(&[body.mass.mass.unwrap()], &[2.0]);
    near(&turned(body.rotation, [0.0, 0.0, 1.0]), &[0.0, 1.0, 0.0]);
    let ShapeKind::Sphere { radius } = body.shapes[0].kind else { panic!() };
    near(&[radius], &[0.5]);
    // A stage without units has OpenUSD's defaults: centimeters and +y up.
    let read = text(&format!("#usda 1.0\n{ball}")).unwrap();
    assert!(read.warnings[0].message.contains("centimeter"), "{:?}", read.warnings);
    near(&read.scene.bodies[0].position, &[1.0, 2.0, 3.0]);
}

/// Gravity is 9.81 m/s^2 along -y unless the physics scene states a direction or a magnitude.
#[test]
fn gravity_is_that_of_the_earth_unless_the_scene_says_so() {
    let gravity = |attributes: &str| {
        let scene = format!("def PhysicsScene \"S\" {{ {attributes} }}\n");
        prims(&format!("{scene}{}", ball(""))).0.gravity
    };
    near(&gravity(""), &[0.0, -9.81, 0.0]);
    let earth =
        "vector3f physics:gravityDirection = (0, 0, 0)\nfloat physics:gravityMagnitude = -inf";
    near(&gravity(earth), &[0.0, -9.81, 0.0]);
    let side = "vector3f physics:gravityDirection = (3, 0, 0)\nfloat physics:gravityMagnitude = 2";
    near(&gravity(side), &[2.0, 0.0, 0.0]);
    near(&gravity("float physics:gravityMagnitude = 0"), &[0.0; 3]);
    near(&prims(&ball("")).0.gravity, &[0.0, -9.81, 0.0]);
}

/// The flags of a body make it dynamic, kinematic or static, or let it start asleep. Disabled colliders give
/// a warning.
#[test]
fn flags_set_the_motion_of_bodies() {
    let motion = |attributes: &str| body(&ball(attributes)).motion;
    assert_eq!(motion(""), Motion::Dynamic);
    assert_eq!(motion("bool physics:kinematicEnabled = 1"), Motion::Kinematic);
    assert_eq!(motion("bool physics:rigidBodyEnabled = false"), Motion::Static);
    assert_eq!(body(&collider("Cube", "")).motion, Motion::Static);
    assert!(body(&ball("bool physics:startsAsleep = true")).start_asleep);
    let off = ball("bool physics:collisionEnabled = 0");
    assert!(prims(&off).1.contains("it has no collider that acts"));
}

/// Velocities are given in the space of the prim: its parent's rotation and scale act on them.
#[test]
fn velocities_follow_the_parent() {
    let inner = ball(
        "vector3f physics:velocity = (1, 0, 0)\nvector3f physics:angularVelocity = (90, 0, 0)",
    );
    let body = body(&format!(
        "def Xform \"P\" {{\n double xformOp:rotateZ = 90\n float3 xformOp:scale = (2, 2, 2)\n\
         uniform token[] xformOpOrder = [\"xformOp:rotateZ\", \"xformOp:scale\"]\n{inner}}}"
    ));
    near(&body.linear_velocity, &[0.0, 2.0, 0.0]);
    near(&body.angular_velocity, &[0.0, std::f64::consts::FRAC_PI_2, 0.0]);
}

/// A collider belongs to the nearest body above it. A body below another one is independent of it,
/// with a warning unless it resets its transform.
#[test]
fn colliders_belong_to_the_nearest_body_above() {
    let collider = |name: &str, x: f64| {
        format!(
            "def Cube \"{name}\" (prepend apiSchemas = [\"PhysicsCollisionAPI\"]) {{\n\
             double3 xformOp:translate = ({x}, 0, 0)\n\
             uniform token[] xformOpOrder = [\"xformOp:translate\"]\n}}\n"
        )
    };
    let nested = |reset: &str| {
        format!(
            "def Xform \"Outer\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\"]) {{\n\
             double3 xformOp:translate = (0, 5, 0)\n\
             uniform token[] xformOpOrder = [\"xformOp:translate\"]\n{}\
             def Scope \"Group\" {{ {} }}\n\
             def Xform \"Inner\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\"]) {{\n\
             double3 xformOp:translate = (0, 1, 0)\n\
             uniform token[] xformOpOrder = [{reset}\"xformOp:translate\"]\n{}}}\n}}\n{}",
            collider("A", 1.0),
            collider("B", 2.0),
            collider("C", 3.0),
            collider("D", 4.0),
        )
    };
    let (scene, told) = prims(&nested(""));
    let found: Vec<_> =
        scene.bodies.iter().map(|b| (b.name.as_deref().unwrap(), b.shapes.len())).collect();
    assert_eq!(found, [("Outer", 2), ("Inner", 1), ("D", 1)]);
    near(&scene.bodies[0].shapes[1].position, &[2.0, 0.0, 0.0]);
    near(&scene.bodies[1].position, &[0.0, 6.0, 0.0]);
    assert!(told.contains("the one above does not carry it"), "{told}");
    let (scene, told) = prims(&nested("\"!resetXformStack!\", "));
    near(&scene.bodies[1].position, &[0.0, 1.0, 0.0]);
    assert_eq!(told, "");
}

/// Each USD shape becomes the matching shape along its axis, z by default. A cone becomes a hull
/// and a torus does not collide, both with a warning.
#[test]
fn shapes_have_the_sizes_and_axes_of_usd() {
    let shape = |kind: &str, attributes: &str| body(&collider(kind, attributes)).shapes[0].clone();
    assert_eq!(shape("Sphere", "").kind, ShapeKind::Sphere { radius: 1.0 });
    assert_eq!(
        shape("Cube", "double size = 3").kind,
        ShapeKind::Box { half_extents: vec![1.5; 3] }
    );
    let capsule =
        |axis: &str| shape("Capsule", &format!("{axis}\ndouble height = 4\ndouble radius = 0.5"));
    for (axis, up) in [
        ("", [0.0, 0.0, 1.0]),
        ("uniform token axis = \"X\"", [1.0, 0.0, 0.0]),
        ("uniform token axis = \"Y\"", [0.0, 1.0, 0.0]),
    ] {
        let shape = capsule(axis);
        assert_eq!(shape.kind, ShapeKind::Capsule { radius: 0.5, half_height: 2.0 });
        near(&turned(shape.rotation, [0.0, 1.0, 0.0]), &up);
    }
    let cylinder = shape("Cylinder", "");
    assert_eq!(cylinder.kind, ShapeKind::Cylinder { radius: 1.0, half_height: 1.0 });
    let plane = shape("Plane", "");
    assert_eq!(plane.kind, ShapeKind::Halfspace { normal: vec![0.0, 1.0, 0.0] });
    near(&turned(plane.rotation, [0.0, 1.0, 0.0]), &[0.0, 0.0, 1.0]);
    let (scene, told) = prims(&collider("Cone", ""));
    assert!(matches!(scene.bodies[0].shapes[0].kind, ShapeKind::ConvexHull { .. }));
    assert!(told.contains("a convex hull of sampled points stands for it"), "{told}");
    assert!(prims(&collider("Torus", "")).1.contains("a Torus does not collide"));
}

/// A scale acts on the size of the shape. A scale that the shape cannot have and scale 0 give a
/// warning.
#[test]
fn scales_reach_the_shapes() {
    let scaled = |kind: &str, scale: &str| {
        let attributes = format!(
            "float3 xformOp:scale = {scale}\nuniform token[] xformOpOrder = [\"xformOp:scale\"]"
        );
        prims(&collider(kind, &attributes))
    };
    let (scene, told) = scaled("Cube", "(1, 2, 3)");
    assert_eq!(
        scene.bodies[0].shapes[0].kind,
        ShapeKind::Box { half_extents: vec![1.0, 2.0, 3.0] }
    );
    assert_eq!(told, "");
    // Equal scales along x and y keep the cylinder round about its axis z.
    let (scene, told) = scaled("Cylinder", "(2, 2, 3)");
    let expected = ShapeKind::Cylinder { radius: 2.0, half_height: 3.0 };
    assert_eq!((&scene.bodies[0].shapes[0].kind, told.as_str()), (&expected, ""));
    assert!(scaled("Sphere", "(1, 2, 3)").1.contains("its scale is not even"));
    assert!(scaled("Sphere", "(0, 0, 0)").1.contains("scale 0"));
}

/// Matrices, pivots with their inverse and Euler angles give the expected poses within 1e-6.
#[test]
fn transforms_are_made_of_all_kinds_of_steps() {
    let place = |ops: &str, order: &str| {
        body(&ball(&format!("{ops}\nuniform token[] xformOpOrder = [{order}]")))
    };
    let matrix =
        "matrix4d xformOp:transform = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (1, 2, 3, 1))";
    let by_matrix = place(matrix, "\"xformOp:transform\"");
    near(&by_matrix.position, &[1.0, 2.0, 3.0]);
    near(&turned(by_matrix.rotation, [1.0, 0.0, 0.0]), &[0.0, 1.0, 0.0]);
    let pivot = "double3 xformOp:translate:pivot = (1, 0, 0)\nfloat xformOp:rotateZ = 90";
    let order =
        "\"xformOp:translate:pivot\", \"xformOp:rotateZ\", \"!invert!xformOp:translate:pivot\"";
    near(&place(pivot, order).position, &[1.0, -1.0, 0.0]);
    // Rotates about x first, then about z.
    let euler = place("float3 xformOp:rotateXYZ = (90, 0, 90)", "\"xformOp:rotateXYZ\"");
    near(&turned(euler.rotation, [0.0, 1.0, 0.0]), &[0.0, 0.0, 1.0]);
    near(&turned(euler.rotation, [1.0, 0.0, 0.0]), &[0.0, 1.0, 0.0]);
}

/// A tetrahedron whose center is away from the origin.
const MESH: &str = "point3f[] points = [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 4)]\n\
    int[] faceVertexCounts = [3, 3, 3, 3]\n\
    int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]\n";

/// A mesh becomes the shape that its approximation names: mesh, hull, box or sphere. An unknown
/// approximation gives a warning.
#[test]
fn the_approximation_sets_the_collider_of_a_mesh() {
    let mesh = |approximation: &str, dynamic: bool| {
        let bodies = if dynamic { "\"PhysicsRigidBodyAPI\", " } else { "" };
        let (scene, told) = prims(&format!(
            "def Mesh \"M\" (prepend apiSchemas = [{bodies}\"PhysicsCollisionAPI\", \
             \"PhysicsMeshCollisionAPI\"]) {{\n{MESH}\
             uniform token physics:approximation = \"{approximation}\"\n}}"
        ));
        (scene.bodies[0].shapes[0].kind.clone(), told)
    };
    let (none, told) = mesh("none", false);
    assert!(matches!(&none, ShapeKind::Trimesh { triangles, .. } if triangles.len() == 4));
    assert_eq!(told, "");
    assert!(matches!(mesh("meshSimplification", false).0, ShapeKind::Trimesh { .. }));
    let (hull, told) = mesh("none", true);
    assert!(
        matches!(&hull, ShapeKind::Trimesh { triangles, .. } if triangles.len() == 4),
        "{told}"
    );
    let hull = mesh("convexHull", true);
    assert!(matches!(hull.0, ShapeKind::ConvexHull { .. }) && hull.1.is_empty());
    assert!(matches!(mesh("convexDecomposition", true).0, ShapeKind::Trimesh { .. }));
    let (cube, _) = mesh("boundingCube", true);
    assert!(matches!(&cube, ShapeKind::ConvexHull { points } if points.len() == 8
        && points.contains(&vec![2.0, 2.0, 4.0])));
    assert!(matches!(mesh("boundingSphere", true).0, ShapeKind::ConvexHull { .. }));
    assert!(mesh("sdf", false).1.contains("approximation 'sdf' is unknown"));
    // A left-handed face of four corners becomes two triangles of opposite orientation.
    let quad = "point3f[] points = [(0,0,0), (1,0,0), (1,1,0), (0,1,0)]\nint[] faceVertexCounts = \
     [4]\n\
                int[] faceVertexIndices = [0, 1, 2, 3]\nuniform token orientation = \"leftHanded\"";
    let ShapeKind::Trimesh { triangles, .. } = &body(&collider("Mesh", quad)).shapes[0].kind else {
        panic!()
    };
    assert_eq!(triangles, &[[0, 2, 1], [0, 3, 2]]);
}

/// The mass of the body comes first, then mass and density of the collider, density of the body and
/// density of the material.
#[test]
fn masses_go_by_precedence() {
    let two = |body: &str, first: &str, second: &str| {
        let part = |name: &str, x: f64, attributes: &str| {
            format!(
                "def Cube \"{name}\" (prepend apiSchemas = [\"PhysicsCollisionAPI\", \
                 \"PhysicsMassAPI\"]) {{\n double size = 1\n{attributes}\n\
                 double3 xformOp:translate = ({x}, 0, 0)\n\
                 uniform token[] xformOpOrder = [\"xformOp:translate\"]\n}}\n"
            )
        };
        let (scene, _) = prims(&format!(
            "def Material \"Stone\" (prepend apiSchemas = [\"PhysicsMaterialAPI\"]) {{\n\
             float physics:density = 2000\n}}\n\
             def Xform \"Body\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\", \"PhysicsMassAPI\"]) {{\n\
             {body}\n{}{}}}",
            part("A", -1.0, first),
            part("B", 1.0, second),
        ));
        let mass = build(&scene, StepSettings::realtime()).unwrap().masses()[0];
        (scene.bodies[0].mass.clone(), mass)
    };
    let stone = "rel material:binding = </Stone>";
    let mass = |body: &str, first: &str, second: &str| two(body, first, second).1;
    near(&[mass("", "", "")], &[2000.0]);
    near(&[mass(stone, "", "")], &[4000.0]);
    near(&[mass(&format!("{stone}\nfloat physics:density = 500"), "", "")], &[1000.0]);
    near(&[mass("float physics:density = 500", "float physics:density = 100", "")], &[600.0]);
    near(&[mass("", "float physics:mass = 7", "float physics:density = 3")], &[10.0]);
    let whole = "float physics:mass = 5\nfloat physics:density = 500";
    near(&[mass(whole, "float physics:mass = 7", "")], &[5.0]);
    // A mass or density of 0 counts as not given.
    near(&[mass("float physics:mass = 0\nfloat physics:density = 0", "", "")], &[2000.0]);
    // The center of mass lies toward the denser collider.
    let (uneven, total) = two("", "float physics:density = 3000", "float physics:density = 1000");
    near(&[total], &[4000.0]);
    near(&uneven.center.unwrap(), &[-0.5, 0.0, 0.0]);
    let own = "point3f physics:centerOfMass = (0, 1, 0)\nfloat3 physics:diagonalInertia = (1, 2, \
     2)\n\
               quatf physics:principalAxes = (0, 1, 0, 0)";
    let (own, _) = two(own, "", "");
    assert_eq!(own.center, Some(vec![0.0, 1.0, 0.0]));
    assert_eq!(own.inertia, Some(vec![1.0, 2.0, 2.0]));
    assert_eq!(own.inertia_rotation, Some([1.0, 0.0, 0.0, 0.0]));
    let none = "point3f physics:centerOfMass = (-inf, -inf, -inf)\n\
                float3 physics:diagonalInertia = (0, 0, 0)\nquatf physics:principalAxes = (0, 0, \
                0, 0)";
    let (none, _) = two(none, "", "");
    assert_eq!((none.center, none.inertia), (None, None));
}

/// A prim inherits bindings from above, and a binding for physics precedes a general one. Unequal
/// frictions and restitutions above 1 give a warning.
#[test]
fn materials_are_inherited_and_those_for_physics_come_first() {
    let material = |name: &str, friction: f64| {
        format!(
            "def Material \"{name}\" (prepend apiSchemas = [\"PhysicsMaterialAPI\"]) {{\n\
             float physics:dynamicFriction = {friction}\nfloat physics:staticFriction = {friction}\n\
             float physics:restitution = 0.25\n}}\n"
        )
    };
    let look = "def Material \"Look\" {\n}\n";
    let friction = |above: &str, own: &str| {
        let (scene, told) = prims(&format!(
            "{look}{}{}def Scope \"Top\" {{\n{above}\n{}}}",
            material("Ice", 0.01),
            material("Rubber", 2.0),
            collider("Cube", own)
        ));
        assert_eq!(told, "");
        scene.bodies[0].shapes[0].material.clone()
    };
    assert_eq!(friction("", "").friction, 0.5);
    assert_eq!(friction("rel material:binding = </Ice>", "").friction, 0.01);
    let own = friction("rel material:binding = </Ice>", "rel material:binding = </Rubber>");
    assert_eq!((own.friction, own.restitution), (2.0, 0.25));
    let physics = "rel material:binding:physics = </Ice>";
    assert_eq!(friction(physics, "rel material:binding = </Look>").friction, 0.01);
    assert_eq!(friction("", "rel material:binding = </Look>").friction, 0.5);
    let (_, told) = prims(&format!(
        "def Material \"M\" (prepend apiSchemas = [\"PhysicsMaterialAPI\"]) {{\n\
         float physics:dynamicFriction = 0.1\nfloat physics:staticFriction = 0.2\n\
         float physics:restitution = 1.5\n}}\n{}",
        collider("Cube", "rel material:binding:physics = </M>")
    ));
    assert!(told.contains("0.1 acts") && told.contains("restitution 1.5 is taken as 1"), "{told}");
}

/// Returns which of the bodies A, B, C and D collide, in the order AB AC AD BC BD CD.
fn meets(groups: &str) -> [bool; 6] {
    let one = |name: &str| {
        format!("def Cube \"{name}\" (prepend apiSchemas = [\"PhysicsCollisionAPI\"]) {{\n}}\n")
    };
    let all = ["A", "B", "C"].map(one).concat();
    let pairs = if groups.contains("filteredPairs") { groups } else { "" };
    let others = if pairs.is_empty() { groups } else { "" };
    let (scene, _) = prims(&format!(
        "{all}def Cube \"D\" (prepend apiSchemas = [\"PhysicsCollisionAPI\", \
         \"PhysicsFilteredPairsAPI\"]) {{\n{pairs}\n}}\n{others}"
    ));
    let filters: Vec<_> = scene.bodies.iter().map(|body| body.shapes[0].filter).collect();
    [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)].map(|(i, j)| filters[i].collides(&filters[j]))
}

fn group(name: &str, members: &str, rest: &str) -> String {
    format!(
        "def PhysicsCollisionGroup \"{name}\" (prepend apiSchemas = \
         [\"CollectionAPI:colliders\"]) {{\n\
         rel collection:colliders:includes = [{members}]\n{rest}\n}}\n"
    )
}

/// Filtered pairs and collision groups, also merged and inverted ones, decide which bodies collide.
#[test]
fn groups_and_pairs_keep_apart() {
    const F: bool = false;
    const T: bool = true;
    assert_eq!(meets(""), [T; 6]);
    assert_eq!(meets("rel physics:filteredPairs = [</A>, </C>]"), [T, T, F, T, T, F]);
    let plain = |rest: &str| {
        group("G", "</A>, </B>", "rel physics:filteredGroups = </H>") + &group("H", "</C>", rest)
    };
    assert_eq!(meets(&plain("")), [T, F, T, F, T, T]);
    // Members of a group that filters itself do not collide with each other.
    let own = group("G", "</A>, </B>", "rel physics:filteredGroups = </G>");
    assert_eq!(meets(&own), [F, T, T, T, T, T]);
    // Groups with the same merge group count as one.
    let merged =
        group("G", "</A>", "string physics:mergeGroup = \"m\"\nrel physics:filteredGroups = </K>")
            + &group("H", "</B>", "string physics:mergeGroup = \"m\"")
            + &group("K", "</C>", "");
    assert_eq!(meets(&merged), [T, F, T, F, T, T]);
    // An inverted filter: the group collides only with the groups that it names.
    let inverted = group(
        "G",
        "</A>",
        "rel physics:filteredGroups = </H>\nbool physics:invertFilteredGroups = 1",
    ) + &group("H", "</B>", "");
    assert_eq!(meets(&inverted), [T, F, F, T, T, T]);
    // A is in two groups, one of which is filtered.
    let both = group("G", "</A>, </B>", "rel physics:filteredGroups = </H>")
        + &group("H", "</C>", "")
        + &group("K", "</A>", "");
    assert_eq!(meets(&both), [T, F, T, F, T, T]);
}

/// Returns a body that moves 1 m along x from time code 10 to time code 34.
fn moving(attributes: &str) -> String {
    ball(&format!(
        "{attributes}\ndouble3 xformOp:translate.timeSamples = {{ 10: (0, 0, 0), 34: (1, 0, 0) }}\n\
         uniform token[] xformOpOrder = [\"xformOp:translate\"]"
    ))
}

/// Animations move kinematic bodies, in seconds from the start of the stage. The animation of a
/// dynamic body gives a warning and is not played.
#[test]
fn animations_move_kinematic_bodies() {
    let stage = HEAD.replace(")\n", "    startTimeCode = 10\n    timeCodesPerSecond = 24\n)\n");
    let read = text(&format!("{stage}{}", moving("bool physics:kinematicEnabled = true"))).unwrap();
    assert_eq!(read.warnings, []);
    let track = &read.scene.bodies[0].track;
    assert_eq!(track.times, [0.0, 1.0]);
    assert_eq!(track.positions, [vec![0.0; 3], vec![1.0, 0.0, 0.0]]);
    let (scene, told) = prims(&moving(""));
    assert!(scene.bodies[0].track.times.is_empty());
    assert!(told.contains("its animation is not played"), "{told}");
    // A body on a rotating arm is sampled 60 times per second.
    let (scene, _) = prims(&format!(
        "def Xform \"Arm\" {{\n float xformOp:rotateZ.timeSamples = {{ 0: 0, 24: 90 }}\n\
         uniform token[] xformOpOrder = [\"xformOp:rotateZ\"]\n{}}}",
        collider(
            "Cube",
            "double3 xformOp:translate = (1, 0, 0)\nuniform token[] xformOpOrder = \
             [\"xformOp:translate\"]"
        )
    ));
    let body = &scene.bodies[0];
    assert_eq!((body.motion, body.track.times.len()), (Motion::Kinematic, 61));
    let half = std::f64::consts::FRAC_1_SQRT_2;
    near(&body.track.positions[30], &[half, half, 0.0]);
}

/// A single time sample is a constant, as many programs write it for bodies at rest. A kinematic
/// body follows it from any start and has no velocity of its own.
#[test]
fn a_single_sample_is_a_constant_pose() {
    const ORDER: &str = "uniform token[] xformOpOrder = [\"xformOp:translate\"]";
    let sample = "double3 xformOp:translate.timeSamples = { 10: (1, 2, 3) }\n";
    let default = "double3 xformOp:translate = (4, 5, 6)\n";
    let fixed = body(&collider("Cube", &format!("{sample}{ORDER}")));
    assert_eq!((fixed.motion, fixed.position), (Motion::Static, vec![1.0, 2.0, 3.0]));
    let free = body(&ball(&format!("{sample}{ORDER}")));
    assert_eq!((free.motion, free.position), (Motion::Dynamic, vec![1.0, 2.0, 3.0]));
    // A kinematic body moves to its only key, whatever its start and its stated velocity.
    let speed = "vector3f physics:velocity = (7, 0, 0)\nbool physics:kinematicEnabled = true\n";
    for (default, start) in [("", [1.0, 2.0, 3.0]), (default, [4.0, 5.0, 6.0])] {
        let held = body(&ball(&format!("{speed}{default}{sample}{ORDER}")));
        assert_eq!((held.motion, held.position), (Motion::Kinematic, start.to_vec()));
        assert_eq!(held.track.positions, [[1.0, 2.0, 3.0]]);
        assert_eq!(held.linear_velocity, [0.0; 3]);
    }
    // A constant scale adds no keys.
    let scaled = moving("bool physics:kinematicEnabled = true").replace(
        "[\"xformOp:translate\"]",
        "[\"xformOp:translate\", \"xformOp:scale\"]\nfloat3 xformOp:scale.timeSamples = { 10: (2, \
         2, 2) }",
    );
    assert_eq!(body(&scaled).track.times.len(), 2);
}

/// A stage of 10 000 bodies in one group, or in ten that filter each other, is read in 5 s of
/// processor time.
#[test]
fn large_groups_are_read_fast() {
    let cube = |i: usize| {
        format!(
            "def Xform \"B{i}\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\"]) {{\n\
             def Cube \"C\" (prepend apiSchemas = [\"PhysicsCollisionAPI\"]) {{\n}}\n}}\n"
        )
    };
    let members: Vec<_> = (0..10_000).map(|i| format!("</B{i}>")).collect();
    let cubes: String = (0..members.len()).map(cube).collect();
    let ten: String = (0..10)
        .map(|i| {
            let members: Vec<_> = members.iter().skip(i).step_by(10).cloned().collect();
            let next = (i + 1) % 10;
            group(
                &format!("G{i}"),
                &members.join(", "),
                &format!(
                    "rel physics:filteredGroups = </G{next}>\n\
                     rel physics:filteredPairs = [</B{i}>, </B{next}>]"
                ),
            )
        })
        .collect();
    for groups in [group("G", &members.join(", "), ""), ten] {
        let text = format!("{cubes}{groups}");
        let took = worked(|| assert_eq!(prims(&text).0.bodies.len(), members.len()));
        println!("{} bodies in groups: {took:.2} s", members.len());
        assert!(took < 5.0, "{took:.2} s");
    }
}

/// Sublayers, references, payloads, inherits, variants and overs are composed in OpenUSD's order of
/// strength. Inactive prims are left out.
#[test]
fn layers_are_composed() {
    let brick = "#usda 1.0\n(\n defaultPrim = \"Brick\"\n)\ndef Xform \"Brick\" (\n\
        prepend apiSchemas = [\"PhysicsRigidBodyAPI\", \"PhysicsMassAPI\"]\n\
        variants = { string size = \"small\" }\n prepend variantSets = \"size\"\n) {\n\
        float physics:density = 1800\n\
        def Material \"Clay\" (prepend apiSchemas = [\"PhysicsMaterialAPI\"]) {\n\
          float physics:dynamicFriction = 0.7\n }\n\
        def Cube \"Shape\" (prepend apiSchemas = [\"PhysicsCollisionAPI\"]) {\n\
          rel material:binding:physics = </Brick/Clay>\n }\n\
        variantSet \"size\" = {\n \"small\" {\n over \"Shape\" { double size = 1\n }\n }\n \"large\" {\n over \"Shape\" { double size = 4\n }\n }\n }\n}\n";
    let base = "#usda 1.0\ndef Cube \"Floor\" (prepend apiSchemas = [\"PhysicsCollisionAPI\"]) \
     {\n double size = 9\n}\n\
        class \"_Light\" {\n float physics:density = 5\n}\n";
    let scene = "#usda 1.0\n(\n metersPerUnit = 1\n subLayers = [@./base.usda@]\n)\n\
        def \"One\" (prepend references = @sub/brick.usda@) {\n}\n\
        def \"Two\" (\n prepend references = @./sub/brick.usda@</Brick>\n inherits = </_Light>\n\
          variants = { string size = \"large\" }\n) {\n\
          double3 xformOp:translate = (0, 3, 0)\n uniform token[] xformOpOrder = \
          [\"xformOp:translate\"]\n}\n\
        def \"Three\" (prepend references = </Two> active = false) {\n}\n\
        over \"Floor\" { double size = 7\n }\n over \"Nothing\" {\n }\n\
        def \"Four\" (instanceable = true prepend payload = @sub/brick.usda@) {\n}\n";
    let files = [("sub/brick.usda", brick), ("base.usda", base), ("scene.usda", scene)];
    let read = read_all(&files).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read.warnings, []);
    let size = |body: &Body| match &body.shapes[0].kind {
        ShapeKind::Box { half_extents } => 2.0 * half_extents[0],
        other => panic!("{other:?}"),
    };
    let found: Vec<_> = read
        .scene
        .bodies
        .iter()
        .map(|b| {
            (b.name.as_deref().unwrap(), size(b), b.mass.density, b.shapes[0].material.friction)
        })
        .collect();
    let clay = Some(1800.0);
    assert_eq!(
        found,
        [
            ("Floor", 7.0, None, 0.5),
            ("One", 1.0, clay, 0.7),
            // Inherits are stronger than references.
            ("Two", 4.0, Some(5.0), 0.7),
            ("Four", 1.0, clay, 0.7),
        ]
    );
    near(&read.scene.bodies[2].position, &[0.0, 3.0, 0.0]);
}

/// Joints of types that UsdPhysics does not have and instances are not simulated and give a warning
/// each; a stage without physics is refused.
#[test]
fn data_that_is_not_simulated_gives_warnings() {
    let (scene, told) = prims(&format!(
        "{}def GearPhysicsJoint \"Hinge\" {{\n rel physics:body0 = </Ball>\n}}\n\
         def PointInstancer \"Many\" {{\n}}\n",
        ball("")
    ));
    assert_eq!((scene.bodies.len(), scene.joints.len()), (1, 0));
    for part in ["</Hinge>: the joint is not simulated", "instances"] {
        assert!(told.contains(part), "{told}");
    }
    let error = text(&format!("{HEAD}def Cube \"C\" {{\n}}\n")).unwrap_err();
    assert_eq!(error.item, "OpenUSD without physics");
}

/// Reads wrong files and returns the error from its position on: one line, within 10 s, no
/// allocation above 16 MiB plus 64 times the input.
fn refused(files: &[(&str, &str)]) -> String {
    let start = Instant::now();
    let mut message = String::new();
    let size: usize = files.iter().map(|(_, text)| text.len()).sum();
    let most = largest(|| message = read_all(files).unwrap_err().to_string());
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}: {message}", start.elapsed());
    assert!(most < (16 << 20) + 64 * size, "{most} bytes: {message}");
    assert_eq!(message.lines().count(), 1, "{message}");
    message[message.find(".usda").map_or(0, |at| at + 5)..].to_owned()
}

/// An error names the line, the prim, the value and the accepted values.
#[test]
fn errors_name_place_value_and_what_is_accepted() {
    for (attributes, expected) in [
        (
            "float physics:mass = -1",
            ":8:23: physics:mass of </Ball> is -1.0; accepted: a number from 0.0",
        ),
        ("float physics:mass = nan", "physics:mass of </Ball> is NaN; accepted"),
        ("float physics:mass = (1, 2)", "physics:mass is (1.0, 2.0); accepted for float: a number"),
        ("vector3f physics:velocity = (1, 2)", "accepted for vector3f: 3 numbers in parentheses"),
        (
            "double3 physics:velocity = (1, inf, 0)",
            "physics:velocity of </Ball> is (1.0, inf, 0.0); accepted",
        ),
        ("double radius = 1e300", "radius of </Ball> is 1e300; accepted: a number from 1e-9 to"),
        ("double radius = \"big\"", "radius is \"big\"; accepted"),
        ("bool physics:kinematicEnabled = \"maybe\"", "accepted: true, false, 1 or 0"),
        ("double radius = 1..2", "a number is 1..2; accepted: 1, -2.5, 3e-4"),
        (
            "uniform token[] xformOpOrder = [\"xformOp:bend\"]",
            "accepted: xformOp: and one of translate",
        ),
    ] {
        let message = refused(&[(
            "scene.usda",
            &format!("{HEAD}def \"X\" {{\n}}\n{}", ball(&format!("\n{attributes}\n"))),
        )]);
        assert!(message.contains(expected) || message.contains(&expected[6..]), "{message}");
        assert!(message.starts_with(":9:") || message.starts_with(":8:"), "{message}");
    }
    let quaternion =
        "quatd xformOp:orient = (2, 0, 0, 0)\nuniform token[] xformOpOrder = [\"xformOp:orient\"]";
    let message = refused(&[("scene.usda", &format!("{HEAD}{}", ball(quaternion)))]);
    assert!(message.contains("a quaternion (w, x, y, z) of length 1"), "{message}");
    let mesh = MESH.replace("2, 3]", "2, 4]");
    let message = refused(&[("scene.usda", &format!("{HEAD}{}", collider("Mesh", &mesh)))]);
    assert!(message.contains("faceVertexIndices of </Shape> is 4; accepted: below 4"), "{message}");
    let message = refused(&[("scene.usda", &HEAD.replace("\"Y\"", "\"W\""))]);
    assert!(message.contains("upAxis is \"W\"; accepted: \"Y\", \"Z\""), "{message}");
}

/// Files that are no text stage, are incomplete or nest deeper than 64 levels are refused with a
/// message of one line.
#[test]
fn files_that_are_not_stages_are_refused() {
    let ball = ball("");
    for (text, expected) in [
        (String::new(), "the first line is not '#usda 1.0'"),
        (
            "PXR-USDC and more".to_owned(),
            "the first line is binary; accepted: OpenUSD in text form",
        ),
        (format!("{HEAD}{}", &ball[..ball.len() - 3]), "is the end of the file"),
        (format!("{HEAD}def \"A\" {{\n string a = \"b\n}}\n"), "a text is without end"),
        (format!("{HEAD}def \"A/B\" {{\n}}\n"), "the name of a prim is \"A/B\""),
        (format!("{HEAD}def \"A\" {{\n}}\ndef \"A\" {{\n}}\n"), "each name once"),
        (format!("{HEAD}{}", "def \"A\" {\n".repeat(100_000)), "the depth is more than 64"),
        (
            format!("{HEAD}def \"A\" {{\n int[] a = {}", "[".repeat(100_000)),
            "the depth is more than 64",
        ),
        (
            format!("{HEAD}def \"A\" {{\n float3 a = ({}", "1, ".repeat(100_000)),
            "more than 16 numbers",
        ),
        (
            format!("{HEAD}def \"A\" {{\n int[] a = [{}", "1, ".repeat(1_000_000)),
            "is the end of the file",
        ),
    ] {
        let message = refused(&[("scene.usda", &text)]);
        assert!(message.contains(expected), "{message}");
    }
}

/// References out of the folder, cycles, exponential growth and chains of more than 64 references
/// are refused.
#[test]
fn cyclic_references_and_paths_out_of_the_folder_are_refused() {
    let one = |metadata: &str| format!("{HEAD}def \"A\" ({metadata}) {{\n}}\n{}", ball(""));
    let refused_one = |metadata: &str| refused(&[("scene.usda", &one(metadata))]);
    for path in ["../out.usda", "/etc/passwd", "http://x/y.usda", "C:\\\\a.usda"] {
        let message = refused_one(&format!("references = @{path}@"));
        assert!(
            message.contains("a relative path to a file inside the folder"),
            "{path}: {message}"
        );
        assert!(message.starts_with(":6:23: the path of a file is @"), "{message}");
    }
    assert!(refused_one("references = @gone.usda@").contains("could not be read"));
    assert!(refused_one("references = </Gone>").contains("</Gone>; accepted: an existing prim"));
    for ring in ["references = </A>", "inherits = </A>", "references = @scene.usda@</A>"] {
        assert!(refused_one(ring).contains("references without cycles"), "{ring}");
    }
    let below = format!("{HEAD}def \"A\" {{\n def \"B\" (references = </A>) {{\n }}\n}}\n");
    assert!(refused(&[("scene.usda", &below)]).contains("more than"));
    let pair = [
        ("b.usda", "#usda 1.0\n(subLayers = [@scene.usda@])\n"),
        ("scene.usda", "#usda 1.0\n(subLayers = [@b.usda@])\n"),
    ];
    assert!(refused(&pair).contains("references without cycles"));
    // Each prim references the one before it twice: 2^40 prims.
    let mut bomb = format!("{HEAD}def \"P0\" {{\n}}\n");
    for i in 1..=40 {
        let before = i - 1;
        bomb += &format!(
            "def \"P{i}\" {{\n def \"a\" (references = </P{before}>) {{\n }}\n\
             def \"b\" (references = </P{before}>) {{\n }}\n}}\n"
        );
    }
    assert!(refused(&[("scene.usda", &bomb)]).contains("up to 100 for each that is written"));
    let mut chain = format!("{HEAD}def \"P0\" {{\n}}\n");
    for i in 1..=5000 {
        chain += &format!("def \"P{i}\" (references = </P{}>) {{\n}}\n", i - 1);
    }
    assert!(refused(&[("scene.usda", &chain)]).contains("up to 64 deep"));
}

/// Returns the state hashes after each of the first ten steps.
fn steps(scene: &Scene) -> Vec<u64> {
    let settings = drystone_bake::settings(scene, StepSettings::realtime()).unwrap();
    let mut world = build(scene, settings).unwrap();
    let step = |_| {
        world.step(scene.time_step).unwrap();
        world.state_hash()
    };
    (0..10).map(step).collect()
}

/// Writes a scene as a stage and reads it back.
fn back(scene: &Scene) -> Read {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("there.usda");
    StageWriter::new(scene, &drystone_bake::Drystone).unwrap().write(&path).unwrap();
    usd::read(&path, &Drystone).unwrap_or_else(|error| panic!("{error}"))
}

/// Asserts that two scenes and their first ten steps are equal. Angular velocities, which a stage
/// states in degrees, are equal in single precision.
fn same(scene: &Scene, other: &Scene) {
    let rounded = |scene: &Scene| {
        let mut scene = scene.clone();
        for speed in scene.bodies.iter_mut().flat_map(|body| &mut body.angular_velocity) {
            *speed = f64::from(*speed as f32);
        }
        scene
    };
    let (a, b) = (rounded(scene), rounded(other));
    for (a, b) in a.bodies.iter().zip(&b.bodies) {
        assert_eq!(a, b);
    }
    assert_eq!(a, b);
    assert_eq!(steps(scene), steps(other));
}

/// Every 3D example scene survives writing and reading as a stage with the same bits in ten steps;
/// 2D scenes are refused.
#[test]
fn example_scenes_come_back_with_the_same_bits() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let mut count = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|kind| kind == "py") {
            continue;
        }
        let scene = read(&path).unwrap().scene;
        if scene.dimension == 2 {
            assert!(
                StageWriter::new(&scene, &drystone_bake::Drystone)
                    .is_err_and(|why| why.contains("2D"))
            );
            continue;
        }
        println!("{}", path.display());
        let there = back(&scene);
        assert_eq!(there.warnings, [], "{}", path.display());
        same(&scene, &there.scene);
        count += 1;
    }
    assert!(count >= 9, "{count}");
}

/// Every property of a scene survives writing and reading as a stage, without warnings.
#[test]
fn all_data_of_a_scene_comes_back() {
    let scene = r#"
name = "all \"of\" it"
gravity = [0.1, -1.62, 0.3]
time_step = 0.01
steps = 17
solver = { substeps = 3 }
[[bodies]]
name = "floor"
motion = "static"
shapes = [{ type = "halfspace", normal = [0, 1, 0] }, { type = "halfspace", normal = [0.6, 0.8, 0], position = [-4, 0.1, 0], rotation = [0, 0.6, 0, 0.8] }]
collision = { systems = ["floor"] }
[[bodies]]
position = [0.1, 2, -0.0]
rotation = [0.5, -0.5, 0.5, 0.5]
mass = "inf"
inertia = [1.1, 2, "inf"]
inertia_rotation = [0, 0.6, 0, 0.8]
center_of_mass = [0, 0.1, 0]
linear_velocity = [1.1, 2, 3]
angular_velocity = [3.3, 2.2, 1.1]
friction_combine = "minimum"
restitution_combine = "multiply"
shapes = [
  { type = "capsule", radius = 0.1, half_height = 0.3, position = [0.1, 0.2, 0.3], rotation = [0, 0.6, 0, 0.8] },
  { type = "cylinder", radius = 0.2, half_height = 0.1, friction = 0.123 },
  { type = "box", half_extents = [0.1, 0.2, 0.3], rotation = [0, 0.6, 0, 0.8] },
  { type = "convex_hull", points = [[0, 0, 0], [1.1, 0, 0], [0, 1.1, 0], [0, 0, 1.1]] },
]
[[bodies]]
name = "Würfel\t1"
position = [0, 9, 0]
gravity_factor = 0.5
density = 300.3
restitution = 0.5
force = [0.1, -2, 3.3]
start_asleep = true
collision = { systems = ["a", "b"], not_collides_with = ["floor"] }
shapes = [{ type = "sphere", radius = 0.1 }]
[[bodies]]
name = "thrown"
linear_velocity = [0, 1.1, 0]
shapes = [{ type = "sphere", radius = 0.1 }]
track = [{ time = 0, position = [0, 0.1, 7] }, { time = 1.7, position = [1, 0, 7] }]
[[bodies]]
name = "Würfel 1"
motion = "kinematic"
position = [3, 3, 0]
angular_velocity = [0, 1, 0]
collision = { collides_with = ["a"] }
shapes = [{ type = "trimesh", vertices = [[0, 0, 0], [1.1, 0, 0], [0, 0, 1.1]], triangles = [[0, 2, 1]] }]
[[bodies]]
name = "Materials"
motion = "kinematic"
position = [0, 0, 7]
track = [{ time = 0.5, position = [0, 0.1, 7] }, { time = 1.7, position = [1, 0, 7], rotation = [0, 0.6, 0, 0.8] }]
shapes = []
[[bodies]]
name = "held where it is"
motion = "kinematic"
track = [{ time = 0.5, position = [0, 0, 0] }]
shapes = []
[[bodies]]
name = "held elsewhere"
motion = "kinematic"
track = [{ time = 0.5, position = [0, 1, 0], rotation = [0, 0.6, 0, 0.8] }]
shapes = []
"#;
    let scene = drystone_bake::read_toml(Path::new("all.toml"), scene).unwrap().scene;
    let there = back(&scene);
    assert_eq!(there.warnings, []);
    same(&scene, &there.scene);
    let nothing = drystone_bake::read_json(Path::new("empty.json"), "{}").unwrap().scene;
    assert_eq!(back(&nothing).scene, nothing);
}

/// 2D scenes and moving half-spaces are not written as a stage but refused.
#[test]
fn scenes_that_a_stage_cannot_hold_are_refused() {
    let refused = |text: &str| {
        let scene = drystone_bake::read_toml(Path::new("x.toml"), text).unwrap().scene;
        StageWriter::new(&scene, &drystone_bake::Drystone).err().unwrap()
    };
    assert!(refused("dimension = 2").contains("is a scene in 2D"));
    let moving =
        "[[bodies]]\nmotion = \"kinematic\"\nshapes = [{type = \"halfspace\", normal = [0, 1, 0]}]";
    assert!(refused(moving).contains("body 0 moves a half-space"));
}

/// A bake is read as the scene it was made of, with its combine modes and joints; a warning says that
/// the animation is not played.
#[test]
fn a_bake_is_read_as_its_scene() {
    let scene = "[[bodies]]\nname = \"ball\"\nposition = [0, 2, 0]\ndensity = 500\nshapes = \
     [{type = \"sphere\", radius = 0.5}]";
    let mut scene = drystone_bake::read_toml(Path::new("x.toml"), scene).unwrap().scene;
    let frame = JointFrame { position: vec![0.0, 1.0, 0.0], rotation: Rotation::identity(3) };
    scene.joints.push(Joint {
        name: Some("hook".to_owned()),
        bodies: [Some(0), None],
        frames: [frame.clone(), frame],
        axes: Vec::new(),
        breaking: Breaking::default(),
        collide: false,
        enabled: true,
    });
    let poses =
        (0..3).flat_map(|i| [0.0, 2.0 - 0.1 * i as f32 * i as f32, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let recording =
        Recording { dimension: 3, bodies: 1, frame_time: 0.1, start: 0, poses: poses.collect() };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bake.usda");
    recording::usda::write(
        &path,
        &scene,
        &recording,
        &JointRecording::default(),
        &Sampling::default(),
    )
    .unwrap();
    let read = usd::read(&path, &Drystone).unwrap();
    assert_eq!(read.scene.bodies, scene.bodies);
    assert_eq!(read.scene.joints, scene.joints);
    assert!(read.warnings[0].message.contains("its animation is not played"));
    assert_eq!(read.scene.bodies[0].shapes[0].material.friction_combine, Combine::GeometricMean);
}

/// Keys of a stage, interpolated as its reader does, are within 1.01 times the tolerance plus 1e-6
/// \[m, rad\] of each frame. A larger tolerance takes fewer keys.
#[test]
fn keys_are_as_close_as_asked() {
    let scene = "[[bodies]]\nmotion = \"kinematic\"\nshapes = [{type = \"sphere\", radius = 0.5}]";
    let scene = drystone_bake::read_toml(Path::new("x.toml"), scene).unwrap().scene;
    let pose = |frame: usize| {
        let t = frame as f32 * 0.02;
        let (sin, cos) = (0.4 * t * t).sin_cos();
        [t.cos(), 2.0 - 0.3 * t * t, 0.0, 0.0, sin, 0.0, cos]
    };
    let whole = Recording {
        dimension: 3,
        bodies: 1,
        frame_time: 0.02,
        start: 0,
        poses: (0..200).flat_map(pose).collect(),
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("keys.usda");
    let mut counts = Vec::new();
    for tolerance in [1e-5, 1e-3, 1e-1] {
        for recording in [whole.piece(50..=150), whole.clone()] {
            recording::usda::write(
                &path,
                &scene,
                &recording,
                &JointRecording::default(),
                &Sampling::within(tolerance),
            )
            .unwrap();
            let read = usd::read(&path, &Drystone).unwrap();
            let track = &read.scene.bodies[0].track;
            // The time of the stage starts at its first frame.
            let start = recording.times().next().unwrap();
            for (frame, time) in recording.times().enumerate() {
                let (position, rotation) = track.at(time - start);
                let pose: Vec<_> = recording.pose(frame, 0).iter().map(|x| f64::from(*x)).collect();
                let apart = |a: &[f64], b: &[f64]| {
                    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
                };
                let off = apart(&position, &pose[..3]);
                assert!(off < 1.01 * tolerance + 1e-6, "frame {frame}: {off} m");
                let Rotation::Quaternion(turn) = rotation else { panic!("{rotation:?}") };
                let off = 2.0 * apart(&turn, &pose[3..]);
                assert!(off < 1.01 * tolerance + 1e-6, "frame {frame}: {off} rad");
            }
            counts.push(track.times.len());
        }
    }
    println!("{counts:?} keys");
    assert!(counts[1] > counts[3] && counts[3] > counts[5], "{counts:?}");
}
