//! Tests of reading joints of UsdPhysics, and of writing them.

#![allow(
    clippy::unwrap_used,
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    clippy::result_large_err
)]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, FRAC_PI_6, PI};
use std::path::Path;

use proptest::collection::{btree_map, vec};
use proptest::option;
use proptest::prelude::*;

use crate::description::{Body, Motion, Rotation, Scene, ShapeKind};
use crate::engine::NoEngine;
use crate::error::SceneError;
use crate::export::usd::StageWriter;
use crate::format::read_json;
use crate::joint::{Breaking, Coordinate, Drive, Joint, JointAxis, JointFrame, Softness};
use crate::read::Read;
use crate::usd::coordinates::place_of;
use crate::usd::read;

const INF: f64 = f64::INFINITY;

/// Reads a stage with these units, bodies A, B and C of 1 m, and the prims after them.
fn stage(units: &str, prims: &str) -> Result<Read, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.usda");
    let bodies: String = ["A", "B", "C"].map(|name| body(name, "", "")).concat();
    std::fs::write(&path, format!("#usda 1.0\n(\n{units}\n)\n{bodies}{prims}")).unwrap();
    read(&path, &NoEngine)
}

/// Returns a dynamic body with a transform and prims below its sphere.
fn body(name: &str, transform: &str, below: &str) -> String {
    format!(
        "def Sphere \"{name}\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\", \
         \"PhysicsCollisionAPI\"]) {{\n{transform}\n{below}\n}}\n"
    )
}

/// Returns a transform made of these operations, each with its type and value.
fn transform(steps: &[(&str, &str, &str)]) -> String {
    let values: Vec<_> = steps
        .iter()
        .map(|(kind, name, value)| format!("{kind} xformOp:{name} = {value}"))
        .collect();
    let order: Vec<_> = steps.iter().map(|(_, name, _)| format!("\"xformOp:{name}\"")).collect();
    format!("{}\nuniform token[] xformOpOrder = [{}]", values.join("\n"), order.join(", "))
}

const METERS: &str = "metersPerUnit = 1\nupAxis = \"Y\"";

/// Returns a joint between A (body 0) and B (body 1).
fn joint(kind: &str, schemas: &[&str], attributes: &str) -> String {
    let schemas: Vec<_> = schemas.iter().map(|name| format!("\"{name}\"")).collect();
    let schemas = match schemas.as_slice() {
        [] => String::new(),
        some => format!("(prepend apiSchemas = [{}])", some.join(", ")),
    };
    format!(
        "def Physics{kind}Joint \"J\" {schemas} {{\nrel physics:body0 = </A>\n\
         rel physics:body1 = </B>\n{attributes}\n}}\n"
    )
}

/// Reads a stage with one joint and returns it and the warnings.
fn told(prims: &str) -> (Joint, String) {
    let read = stage(METERS, prims).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read.scene.joints.len(), 1, "{:?}", read.warnings);
    let warnings: Vec<_> = read.warnings.iter().map(ToString::to_string).collect();
    (read.scene.joints[0].clone(), warnings.join("\n"))
}

/// Reads a stage with one joint that gives no warning.
fn quiet(prims: &str) -> Joint {
    let (joint, warnings) = told(prims);
    assert_eq!(warnings, "");
    joint
}

fn refused(prims: &str) -> String {
    let text = stage(METERS, prims).unwrap_err().to_string();
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

/// Returns coordinates and limits of a joint.
fn limits(joint: &Joint) -> Vec<(Coordinate, Option<[f64; 2]>)> {
    joint.axes.iter().map(|axis| (axis.coordinate, axis.limits)).collect()
}

fn locks(coordinates: &[Coordinate]) -> Vec<(Coordinate, Option<[f64; 2]>)> {
    coordinates.iter().map(|coordinate| (*coordinate, Some([0.0; 2]))).collect()
}

const POINT: [Coordinate; 3] =
    [Coordinate::Linear(0), Coordinate::Linear(1), Coordinate::Linear(2)];
const TURN: [Coordinate; 3] = [Coordinate::Twist, Coordinate::Swing(1), Coordinate::Swing(2)];

fn near(a: &[f64], b: &[f64]) {
    let close = a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    assert!(close, "{a:?} is not {b:?}");
}

/// Rotates a vector by a rotation.
fn turned(rotation: Rotation, vector: [f64; 3]) -> Vec<f64> {
    crate::graph::math::turn(rotation.quaternion(), vector).to_vec()
}

/// Each type has its locks; the axis that it leaves has the limits, in radians.
#[test]
fn types_have_their_locks_and_limits() {
    let fixed = quiet(&joint("Fixed", &[], ""));
    assert_eq!(limits(&fixed), [locks(&POINT), locks(&TURN)].concat());
    assert_eq!((fixed.bodies, fixed.name.as_deref()), ([Some(1), Some(0)], Some("J")));
    assert!(!fixed.collide && fixed.enabled);
    assert_eq!(fixed.breaking, Breaking::default());

    let bounds = "float physics:lowerLimit = -90\nfloat physics:upperLimit = 720";
    let hinge = limits(&quiet(&joint("Revolute", &[], bounds)));
    assert_eq!(hinge[3], (Coordinate::Twist, Some([-FRAC_PI_2, 4.0 * PI])));
    assert_eq!((&hinge[..3], &hinge[4..]), (&locks(&POINT)[..], &locks(&TURN[1..])[..]));
    let slider = limits(&quiet(&joint("Prismatic", &[], bounds)));
    assert_eq!(slider[0], (Coordinate::Linear(0), Some([-90.0, 720.0])));
    assert_eq!(slider[1..], [locks(&POINT[1..]), locks(&TURN)].concat());

    // One bound, none, and FLT_MAX in place of infinity.
    let one = limits(&quiet(&joint("Revolute", &[], "float physics:upperLimit = 0")));
    assert_eq!(one[3], (Coordinate::Twist, Some([-INF, 0.0])));
    for none in ["", "float physics:lowerLimit = -inf\nfloat physics:upperLimit = 3.4028235e38"] {
        assert_eq!(limits(&quiet(&joint("Revolute", &[], none))).len(), 5);
    }
    assert!(
        refused(&joint(
            "Prismatic",
            &[],
            "float physics:upperLimit = 1\nfloat physics:lowerLimit = 2"
        ))
        .contains("physics:upperLimit of </J> is 1.0; accepted: at least physics:lowerLimit")
    );
}

/// A ball has the cone of its angles: round, elliptic, along one axis, or none.
#[test]
fn a_ball_has_a_cone() {
    let cone = |zero: &str, one: &str| {
        let attributes = format!(
            "float physics:coneAngle0Limit = {zero}\nfloat physics:coneAngle1Limit = {one}"
        );
        let found = limits(&quiet(&joint("Spherical", &[], &attributes)));
        assert_eq!(found[..3], locks(&POINT));
        found[3..].to_vec()
    };
    assert_eq!(cone("-1", "-1"), []);
    assert_eq!(cone("inf", "-1"), []);
    assert_eq!(cone("45", "45"), [(Coordinate::Cone, Some([0.0, FRAC_PI_4]))]);
    // The first angle inclines x towards y, by rotation about z.
    let ellipse = Coordinate::EllipticCone([60.0_f64.to_radians(), 30.0_f64.to_radians()]);
    assert_eq!(cone("30", "60"), [(ellipse, Some([0.0, 1.0]))]);
    let angle = 30.0_f64.to_radians();
    assert_eq!(cone("30", "-1"), [(Coordinate::Swing(2), Some([-angle, angle]))]);
    assert_eq!(cone("0", "0"), locks(&TURN[1..]));
    let flat = [(Coordinate::Swing(1), Some([-angle, angle])), locks(&TURN[2..])[0]];
    assert_eq!(cone("0", "30"), flat);
    assert!(refused(&joint("Spherical", &[], "float physics:coneAngle0Limit = 200")).contains(
        "physics:coneAngle0Limit of </J> is 200.0; accepted: a number from -180.0 to 180.0"
    ));
}

/// A distance has a least and a most, where negative ones are none.
#[test]
fn a_distance_has_two_limits() {
    let distance = |attributes: &str| limits(&quiet(&joint("Distance", &[], attributes)));
    let both = "float physics:minDistance = 0.5\nfloat physics:maxDistance = 2";
    assert_eq!(distance(both), [(Coordinate::Distance, Some([0.5, 2.0]))]);
    let rope = "float physics:minDistance = -1\nfloat physics:maxDistance = 2";
    assert_eq!(distance(rope), [(Coordinate::Distance, Some([-INF, 2.0]))]);
    assert_eq!(distance(""), []);
    assert!(
        refused(&joint("Distance", &[], &both.replace("0.5", "3")))
            .contains("at least physics:min")
    );
}

/// An axis other than X becomes x of the frame, exactly.
#[test]
fn the_axis_of_the_joint_becomes_x() {
    for (axis, [x, y, z]) in [
        ("X", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        ("Y", [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        ("Z", [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    ] {
        let schemas = ["PhysicsDriveAPI:angular"];
        let attributes = format!(
            "uniform token physics:axis = \"{axis}\"\nfloat physics:lowerLimit = -180\n\
             float drive:angular:physics:targetVelocity = 180"
        );
        let hinge = quiet(&joint("Revolute", &schemas, &attributes));
        for frame in &hinge.frames {
            assert_eq!(turned(frame.rotation, [1.0, 0.0, 0.0]), x);
            assert_eq!(turned(frame.rotation, [0.0, 1.0, 0.0]), y);
            assert_eq!(turned(frame.rotation, [0.0, 0.0, 1.0]), z);
        }
        let twist = &hinge.axes[3];
        assert_eq!((twist.coordinate, twist.limits), (Coordinate::Twist, Some([-PI, INF])));
        assert_eq!(twist.drives[0].velocity, PI);
        assert_eq!(hinge.axes.len(), 6);
    }
    let wrong = joint("Revolute", &[], "uniform token physics:axis = \"W\"");
    assert!(
        refused(&wrong).contains("physics:axis of </J> is \"W\"; accepted: \"X\", \"Y\", \"Z\"")
    );
}

/// A general joint has the limits and drives of its schemas. A low limit above the high one locks.
/// Attributes without their schema do not act, and are named.
#[test]
fn schemas_limit_and_drive_a_general_joint() {
    let attributes = "float limit:transX:physics:low = 1\nfloat limit:transX:physics:high = -1\n\
        float limit:transY:physics:low = -2\nfloat limit:transY:physics:high = inf\n\
        float limit:transZ:physics:low = 3\nfloat limit:transZ:physics:high = 3\n\
        float limit:rotX:physics:low = -30\nfloat limit:rotX:physics:high = 60\n\
        float limit:distance:physics:high = 4\nfloat limit:rotY:physics:high = 5";
    let schemas = ["transX", "transY", "transZ", "rotX", "distance"]
        .map(|of| format!("PhysicsLimitAPI:{of}"));
    let (general, told) = told(&joint("", &schemas.each_ref().map(String::as_str), attributes));
    let expected = [
        (Coordinate::Linear(0), Some([0.0; 2])),
        (Coordinate::Linear(1), Some([-2.0, INF])),
        (Coordinate::Linear(2), Some([3.0; 2])),
        (Coordinate::Distance, Some([-INF, 4.0])),
        (Coordinate::Twist, Some([-30.0, 60.0].map(f64::to_radians))),
    ];
    assert_eq!(limits(&general), expected);
    assert!(
        told.contains("limit:rotY:physics:high is not read, and does not act (1 prim)"),
        "{told}"
    );
    assert_eq!(told.lines().count(), 1, "{told}");
}

/// If two rotations of a general joint are locked, the third one becomes the twist.
#[test]
fn a_general_joint_that_turns_about_one_axis_is_a_hinge() {
    let schemas = ["PhysicsLimitAPI:rotX", "PhysicsLimitAPI:rotY", "PhysicsLimitAPI:transZ"];
    let locked = |name: &str| {
        format!("float limit:{name}:physics:low = 1\nfloat limit:{name}:physics:high = -1\n")
    };
    let attributes = ["rotX", "rotY", "transZ"].map(locked).concat();
    let drive = format!("{attributes}float drive:rotZ:physics:stiffness = 1");
    let hinge = quiet(&joint("", &[&schemas[..], &["PhysicsDriveAPI:rotZ"]].concat(), &drive));
    assert_eq!(turned(hinge.frames[0].rotation, [1.0, 0.0, 0.0]), [0.0, 0.0, 1.0]);
    assert_eq!(limits(&hinge)[..2], [locks(&POINT[..1]), vec![(Coordinate::Twist, None)]].concat());
    assert_eq!(limits(&hinge)[2..], locks(&TURN[1..]));
    // Several wide rotations have no definition in UsdPhysics.
    let wide = "float limit:rotX:physics:high = 10\nfloat limit:rotY:physics:high = 190";
    let (_, told) = told(&joint("", &schemas[..2], wide));
    assert!(told.contains("several rotations have limits or drives"), "{told}");
    assert!(told.contains("beyond 180 degrees does not act"), "{told}");
}

/// Drives convert degrees, lengths and masses; those of acceleration have no mass.
#[test]
fn drives_are_in_si_units() {
    let attributes = |token: &str, kind: &str| {
        let drive = format!("drive:{token}:physics");
        format!(
            "uniform token {drive}:type = \"{kind}\"\nfloat {drive}:targetPosition = 180\n\
             float {drive}:targetVelocity = -90\nfloat {drive}:stiffness = 7\n\
             float {drive}:damping = 3\nfloat {drive}:maxForce = 11\n\
             float physics:breakForce = 5\nfloat physics:breakTorque = 6"
        )
    };
    let units = "metersPerUnit = 0.01\nkilogramsPerUnit = 1000\nupAxis = \"Y\"";
    let of = |kind: &str, token: &str, drive: &str| {
        let schema = format!("PhysicsDriveAPI:{token}");
        let read = stage(units, &joint(kind, &[&schema], &attributes(token, drive))).unwrap();
        assert_eq!(read.warnings, []);
        let joint = &read.scene.joints[0];
        near(&[joint.breaking.force.unwrap(), joint.breaking.torque.unwrap()], &[50.0, 0.6]);
        let drive = joint.axes.iter().find_map(|axis| axis.drives.first()).unwrap();
        let Drive { position, velocity, stiffness, damping, max_force, acceleration } = *drive;
        (acceleration, [position, velocity, stiffness, damping, max_force])
    };
    let degree = 180.0 / PI;
    let (acceleration, drive) = of("Prismatic", "linear", "force");
    near(&drive, &[1.8, -0.9, 7000.0, 3000.0, 110.0]);
    assert!(!acceleration);
    let (acceleration, drive) = of("Prismatic", "linear", "acceleration");
    near(&drive, &[1.8, -0.9, 7.0, 3.0, 110.0]);
    assert!(acceleration);
    let drive = of("Revolute", "angular", "force").1;
    near(&drive, &[PI, -FRAC_PI_2, 0.7 * degree, 0.3 * degree, 1.1]);
    let drive = of("", "rotX", "acceleration").1;
    near(&drive, &[PI, -FRAC_PI_2, 7.0 * degree, 3.0 * degree, 1.1]);
    let wrong =
        joint("Revolute", &["PhysicsDriveAPI:angular"], "float drive:angular:physics:damping = -1");
    assert!(refused(&wrong).contains("drive:angular:physics:damping of </J> is -1.0; accepted"));
    // The schema of another type does not act.
    let (_, told) = told(&joint("Revolute", &["PhysicsDriveAPI:linear"], ""));
    assert!(told.contains("PhysicsDriveAPI:linear is not read"), "{told}");
}

/// Positions scale with the prim that is named, which may lie below the body. A prim that is no body
/// is the world.
#[test]
fn frames_follow_the_named_prim() {
    let scaled = transform(&[
        ("double3", "translate", "(10, 0, 0)"),
        ("double", "rotateZ", "90"),
        ("float3", "scale", "(3, 3, 3)"),
    ]);
    let child =
        transform(&[("double3", "translate", "(0, 1, 0)"), ("float3", "scale", "(2, 2, 2)")]);
    let child = format!("def Xform \"Tip\" {{\n{child}\n}}\n");
    let place =
        transform(&[("double3", "translate", "(1, 2, 3)"), ("float3", "scale", "(4, 4, 4)")]);
    let prims = format!(
        "{}def Xform \"Place\" {{\n{place}\n}}\ndef PhysicsFixedJoint \"J\" {{\n\
         rel physics:body0 = </Place>\nrel physics:body1 = </Body/Tip>\n\
         point3f physics:localPos0 = (1, 0, 0)\npoint3f physics:localPos1 = (1, 0, 0)\n\
         quatf physics:localRot0 = (0, 1, 0, 0)\n{}\n}}\n",
        body("Body", &scaled, &child),
        transform(&[("double3", "translate", "(5, 5, 5)")]),
    );
    let fixed = quiet(&prims);
    assert_eq!(fixed.bodies, [Some(3), None]);
    near(&fixed.frames[0].position, &[6.0, 3.0, 0.0]);
    near(&fixed.frames[1].position, &[5.0, 2.0, 3.0]);
    assert_eq!(fixed.frames[1].rotation, Rotation::Quaternion([1.0, 0.0, 0.0, 0.0]));
    // Without a target, the frame is in the world, and turns with the axis that points up.
    let world = "def PhysicsFixedJoint \"J\" {\nrel physics:body1 = </A>\n\
        point3f physics:localPos0 = (1, 2, 3)\npoint3f physics:localPos1 = (1, 2, 3)\n}\n";
    let read = stage("metersPerUnit = 0.1\nupAxis = \"Z\"", world).unwrap();
    let fixed = &read.scene.joints[0];
    assert_eq!(fixed.bodies, [Some(0), None]);
    near(&fixed.frames[0].position, &[0.1, 0.2, 0.3]);
    near(&fixed.frames[1].position, &[0.1, 0.3, -0.2]);
    near(&turned(fixed.frames[1].rotation, [0.0, 0.0, 1.0]), &[0.0, 1.0, 0.0]);
}

/// Flags and loads are read; the schema of articulations changes nothing.
#[test]
fn flags_and_loads_are_read() {
    let attributes = "bool physics:jointEnabled = false\nbool physics:collisionEnabled = true\n\
        uniform bool physics:excludeFromArticulation = true\nfloat physics:breakForce = 8\n\
        float physics:breakTorque = 3.4028235e38\ncustom double drystone:breakImpulse = 2";
    let fixed = quiet(&joint("Fixed", &["PhysicsArticulationRootAPI"], attributes));
    assert!(fixed.collide && !fixed.enabled);
    let breaking = Breaking { force: Some(8.0), torque: None, impulse: Some(2.0) };
    assert_eq!(fixed.breaking, breaking);
    let sampled = "bool physics:jointEnabled.timeSamples = { 0: 1, 24: 0 }";
    let (fixed, told) = told(&joint("Fixed", &[], sampled));
    assert!(fixed.enabled && told.contains("physics:jointEnabled changes with time"), "{told}");
}

/// A joint of a body to itself and mirrored prims are refused. Joints that hold nothing are left
/// out, with a warning.
#[test]
fn joints_without_two_bodies_are_refused_or_left_out() {
    let fixed = |zero: &str, one: &str| {
        format!(
            "def PhysicsFixedJoint \"J\" {{\nrel physics:body0 = {zero}\nrel physics:body1 = {one}\n}}\n"
        )
    };
    let twice = refused(&fixed("</A>", "</A>"));
    assert!(twice.contains("physics:body1 of </J> is </A>, as is physics:body0 </A>"), "{twice}");
    let mirror = body("M", &transform(&[("float3", "scale", "(1, -1, 1)")]), "");
    let mirrored = refused(&format!("{mirror}{}", fixed("</A>", "</M>")));
    assert!(
        mirrored.contains("physics:body1 of </J> is </M>; accepted: a prim whose scale"),
        "{mirrored}"
    );
    let bare = "def Xform \"Bare\" (prepend apiSchemas = [\"PhysicsRigidBodyAPI\"]) {\n}\n";
    for (zero, one, expected) in [
        ("</Gone>", "</A>", "physics:body0 </Gone> does not exist"),
        ("</A>", "</Bare>", "its body </Bare> is not simulated"),
        ("[]", "[]", "both of its bodies are the world"),
    ] {
        let read = stage(METERS, &format!("{bare}{}", fixed(zero, one))).unwrap();
        let told: Vec<_> = read.warnings.iter().map(ToString::to_string).collect();
        assert!(told.iter().any(|told| told.contains(expected)), "{told:?}");
        assert_eq!(read.scene.joints, []);
    }
    let (_, told) = told(&fixed("[</A>, </C>]", "</B>"));
    assert!(told.contains("physics:body0: only the first of its prims counts"), "{told}");
}

/// Filtered pairs keep the shapes of bodies apart that a joint lets collide.
#[test]
fn filtered_pairs_hold_between_bodies_with_joints() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.usda");
    let a = body("A", "rel physics:filteredPairs = </B>", "")
        .replace("\"PhysicsCollisionAPI\"", "\"PhysicsCollisionAPI\", \"PhysicsFilteredPairsAPI\"");
    let others = [body("B", "", ""), body("C", "", "")].concat();
    let hinge = joint("Revolute", &[], "bool physics:collisionEnabled = 1");
    std::fs::write(&path, format!("#usda 1.0\n(\n{METERS}\n)\n{a}{others}{hinge}")).unwrap();
    let read = read(&path, &NoEngine).unwrap();
    assert_eq!(read.warnings, []);
    assert!(read.scene.joints[0].collide);
    let filters: Vec<_> = read.scene.bodies.iter().map(|body| body.shapes[0].filter).collect();
    assert!(!filters[0].collides(&filters[1]));
    assert!(filters[0].collides(&filters[2]) && filters[1].collides(&filters[2]));
}

/// Own attributes add what UsdPhysics lacks. Exact values count only while they agree with those of
/// UsdPhysics. Unknown names are refused or named.
#[test]
fn own_attributes_add_to_usd_physics() {
    let attributes = |degrees: f64| {
        format!(
            "float physics:lowerLimit = {degrees}\ncustom double drystone:limit:rotX:low = {}\n\
             custom double drystone:friction:rotX = 0.25\n\
             custom double drystone:limit:transX:stiffness = 100\n\
             custom double drystone:friction:transW = 1",
            -FRAC_PI_6
        )
    };
    let (hinge, warnings) = told(&joint("Revolute", &[], &attributes(-30.0)));
    assert_eq!(hinge.axes[3].limits, Some([-FRAC_PI_6, INF]));
    assert_eq!(hinge.axes[3].friction, 0.25);
    assert_eq!(hinge.axes[0].softness, Some(Softness { stiffness: 100.0, damping: 0.0 }));
    assert!(warnings.contains("drystone:friction:transW is not read"), "{warnings}");
    let (hinge, _) = told(&joint("Revolute", &[], &attributes(-31.0)));
    assert_eq!(hinge.axes[3].limits, Some([-31.0_f64.to_radians(), INF]));
    let wrong = joint("Revolute", &[], "custom token[] drystone:axes = [\"rotW\"]");
    assert!(
        refused(&wrong)
            .contains("drystone:axes of </J> is [\"rotW\"]; accepted: names out of transX")
    );
    let without = joint("", &[], "custom token[] drystone:axes = [\"gear\"]");
    assert!(refused(&without).contains("drystone:gear:ratio of </J>; accepted: a number from"));
}

/// The public examples of UsdPhysics have the joints that they describe.
#[test]
fn public_joints_are_read() {
    let Some(root) = std::env::var_os("DRYSTONE_DATA") else {
        eprintln!("skipped: DRYSTONE_DATA is not set");
        return;
    };
    let folder = "usd_physics/openusd/pxr/usd/usdPhysics/examples";
    let folder = Path::new(&root).join(folder);
    let found = read(&folder.join("usdPhysicsJoints.usda"), &NoEngine).unwrap();
    let [driven] = found.scene.joints.as_slice() else { panic!("{:?}", found.scene.joints) };
    // Body b is the static box, whose scale of 0.1, 1, 0.1 makes 60 cm of the 60 along y.
    assert_eq!(driven.bodies, [Some(1), Some(0)]);
    near(&driven.frames[0].position, &[0.0, -0.6, 0.0]);
    near(&driven.frames[1].position, &[0.0, 0.6, 0.0]);
    near(&turned(driven.frames[1].rotation, [1.0, 0.0, 0.0]), &[0.0, 0.0, 1.0]);
    let drive = driven.axes.iter().find(|axis| axis.coordinate == Coordinate::Twist).unwrap();
    assert_eq!(drive.limits, None);
    near(&[drive.drives[0].velocity], &[10.0_f64.to_radians()]);
    near(&[drive.drives[0].damping], &[9999.0_f64.to_degrees() * 1e-4]);
    assert_eq!(driven.axes.iter().filter(|axis| axis.limits == Some([0.0; 2])).count(), 5);
    // Its type is that of no schema.
    let odd = read(&folder.join("usdPhysicsDistanceJoint.usda"), &NoEngine).unwrap();
    assert_eq!(odd.scene.joints, []);
    let told =
        odd.warnings.iter().any(|told| told.message.contains("DistancePhysicsJoint is not a type"));
    assert!(told, "{:?}", odd.warnings);
}

/// Returns a scene of three balls with these joints.
fn scene(joints: Vec<Joint>) -> Scene {
    let mut scene = read_json(Path::new("empty.json"), "{}").unwrap().scene;
    let ball =
        |x: f64| Body::new(Motion::Dynamic, [x, 0.0, 0.0], ShapeKind::Sphere { radius: 0.5 });
    scene.bodies = [0.0, 1.5, 3.0].map(ball).to_vec();
    scene.joints = joints;
    scene
}

/// Writes a scene as a stage and reads it again, without warnings.
fn back(scene: &Scene) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("there.usda");
    StageWriter::new(scene, &NoEngine).unwrap().write(&path).unwrap();
    let read = read(&path, &NoEngine).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read.warnings, []);
    read.scene
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(1.0), -10.0..10.0, -1e-3..1e-3]
}

fn positive() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), 0.0..1e6, 0.0..1.0]
}

fn bounds() -> impl Strategy<Value = [f64; 2]> {
    let pair = (number(), number()).prop_map(|(x, y)| [x.min(y), x.max(y)]);
    prop_oneof![
        Just([0.0; 2]),
        number().prop_map(|x| [x; 2]),
        number().prop_map(|x| [x, INF]),
        number().prop_map(|x| [-INF, x]),
        Just([-INF, INF]),
        (0.0..PI).prop_map(|x| [0.0, x]),
        Just([0.0, 1.0]),
        pair,
    ]
}

fn drives() -> impl Strategy<Value = Vec<Drive>> {
    let damping = prop_oneof![positive(), Just(INF)];
    let force = prop_oneof![positive(), Just(INF)];
    let numbers = (number(), number(), positive(), damping, force, any::<bool>());
    let drive =
        numbers.prop_map(|(position, velocity, stiffness, damping, max_force, acceleration)| {
            Drive { position, velocity, stiffness, damping, max_force, acceleration }
        });
    prop_oneof![3 => Just(Vec::new()), 1 => vec(drive, 1..4)]
}

fn coordinate() -> impl Strategy<Value = Coordinate> {
    let angle = 0.01..PI;
    let points = [[number(), number(), number()], [number(), number(), number()]];
    prop_oneof![
        (0..3_usize).prop_map(Coordinate::Linear),
        (0..3_usize).prop_map(Coordinate::Radial),
        Just(Coordinate::Distance),
        Just(Coordinate::Twist),
        (1..3_usize).prop_map(Coordinate::Swing),
        Just(Coordinate::Cone),
        [angle.clone(), angle].prop_map(Coordinate::EllipticCone),
        Just(Coordinate::Rotation),
        (0..3_usize).prop_map(Coordinate::Cardan),
        number().prop_map(|ratio| Coordinate::Gear { ratio }),
        number().prop_map(|radius| Coordinate::Rack { radius }),
        number().prop_map(|pitch| Coordinate::Screw { pitch }),
        (points, number()).prop_map(|(points, ratio)| Coordinate::Pulley { points, ratio }),
    ]
}

fn axis() -> impl Strategy<Value = JointAxis> {
    let softness = (positive(), positive());
    let softness = softness.prop_map(|(stiffness, damping)| Softness { stiffness, damping });
    let some = prop_oneof![2 => Just(None), 1 => softness.prop_map(Some)];
    let friction = prop_oneof![2 => Just(0.0), 1 => positive()];
    let parts = (coordinate(), option::of(bounds()), some, drives(), friction);
    parts.prop_map(|(coordinate, limits, softness, drives, friction)| JointAxis {
        coordinate,
        limits,
        softness,
        drives,
        friction,
    })
}

/// Returns axes as the types of UsdPhysics have them, with others in any order.
fn axes() -> impl Strategy<Value = Vec<JointAxis>> {
    let more = btree_map(0..9_usize, axis(), 0..6);
    let locked = prop_oneof![
        Just(Vec::new()),
        Just(POINT.to_vec()),
        Just([&POINT[..], &TURN[..]].concat()),
        Just([&POINT[..], &TURN[1..]].concat()),
        Just([&POINT[1..], &TURN[..]].concat()),
        Just(TURN[..2].to_vec()),
    ];
    (locked, more, any::<bool>()).prop_map(|(locked, more, sorted)| {
        let lock = |coordinate: Coordinate| JointAxis {
            coordinate,
            limits: Some([0.0; 2]),
            softness: None,
            drives: Vec::new(),
            friction: 0.0,
        };
        let mut all: Vec<JointAxis> = locked.into_iter().map(lock).collect();
        for axis in more.into_values() {
            let place = place_of(&axis.coordinate);
            if all.iter().all(|other| place_of(&other.coordinate) != place) {
                all.push(axis);
            }
        }
        if sorted {
            all.sort_by_key(|axis| place_of(&axis.coordinate));
        }
        all
    })
}

fn frame() -> impl Strategy<Value = JointFrame> {
    let turn = prop_oneof![
        Just([0.0, 0.0, 0.0, 1.0]),
        [-1.0..1.0, -1.0..1.0, -1.0..1.0, 0.1..1.0]
            .prop_filter_map("too short", crate::graph::math::quat_unit)
    ];
    (vec(number(), 3), turn)
        .prop_map(|(position, turn)| JointFrame { position, rotation: Rotation::Quaternion(turn) })
}

fn joints() -> impl Strategy<Value = Joint> {
    let name = prop_oneof![Just(None), "[ a-zé\"]{1,5}".prop_map(Some)];
    let pairs = [[Some(0), Some(1)], [Some(2), Some(1)], [None, Some(0)], [Some(1), None]];
    let loads = (option::of(positive()), option::of(positive()), option::of(positive()));
    let parts = (name, prop::sample::select(pairs.to_vec()), [frame(), frame()], axes(), loads);
    (parts, any::<[bool; 2]>()).prop_map(|(parts, [collide, enabled])| {
        let (name, bodies, frames, axes, (force, torque, impulse)) = parts;
        let breaking = Breaking { force, torque, impulse };
        Joint { name, bodies, frames, axes, breaking, collide, enabled }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Any joint comes back from a stage with the same bits.
    #[test]
    fn joints_come_back_from_a_stage(joint in joints()) {
        let scene = scene(vec![joint]);
        prop_assert_eq!(back(&scene), scene);
    }
}

/// Joints with the same or no names, and scenes of many, come back.
#[test]
fn names_of_joints_come_back() {
    let frame = JointFrame { position: vec![0.0; 3], rotation: Rotation::identity(3) };
    let named = |name: Option<&str>| Joint {
        name: name.map(str::to_owned),
        bodies: [Some(0), Some(1)],
        frames: [frame.clone(), frame.clone()],
        axes: Vec::new(),
        breaking: Breaking::default(),
        collide: false,
        enabled: true,
    };
    let names = [Some("door"), None, Some("door hinge"), Some("door_hinge"), None, Some("7")];
    let scene = scene(names.map(named).to_vec());
    assert_eq!(back(&scene), scene);
    // Two axes with a coordinate of the same name cannot be told apart.
    let mut wrong = scene;
    let gear = |ratio: f64| JointAxis {
        coordinate: Coordinate::Gear { ratio },
        limits: None,
        softness: None,
        drives: Vec::new(),
        friction: 0.0,
    };
    wrong.joints[0].axes = vec![gear(1.0), gear(2.0)];
    let why = StageWriter::new(&wrong, &NoEngine).err().unwrap();
    assert!(why.contains("joint 'door' has two axes with the coordinate gear"), "{why}");
}
