use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, TAU};
use std::path::Path;

use super::*;
use crate::description::{Rotation, Scene};
use crate::format::{read_json, read_toml};
use crate::joint::{Drive, Softness};
use crate::write::to_toml;

/// Two balls: 'a' is at (1, 2, 0), and turned by 90 degrees about y; 'b' is at the origin. 'wall'
/// is static.
const BODIES: &str = "[[bodies]]\nname = \"a\"\nposition = [1, 2, 0]\n\
    rotation = [0, 0.7071067811865476, 0, 0.7071067811865476]\n\
    shapes = [{ type = \"sphere\", radius = 0.5 }]\n\
    [[bodies]]\nname = \"b\"\nshapes = [{ type = \"sphere\", radius = 0.5 }]\n\
    [[bodies]]\nname = \"wall\"\nmotion = \"static\"\n";

/// Returns a scene with these bodies and one joint with these lines, from line 13 on.
fn scene_of(lines: &str) -> String {
    format!("{BODIES}[[joints]]\n{lines}\n")
}

fn read_scene(text: &str) -> Scene {
    read_toml(Path::new("s.toml"), text).unwrap_or_else(|error| panic!("{error}\n{text}")).scene
}

/// Returns the joint with these lines between 'a' and 'b'.
fn joint(lines: &str) -> Joint {
    read_scene(&scene_of(&format!("bodies = [\"a\", \"b\"]\n{lines}"))).joints.remove(0)
}

fn error(text: &str) -> String {
    match read_toml(Path::new("s.toml"), text) {
        Ok(_) => "accepted".to_owned(),
        Err(error) => error.to_string(),
    }
}

fn warnings(text: &str) -> Vec<String> {
    let read = read_toml(Path::new("s.toml"), text).unwrap_or_else(|error| panic!("{error}"));
    read.warnings.iter().map(ToString::to_string).collect()
}

fn assert_near(a: &[f64], b: &[f64]) {
    let far = a.iter().zip(b).any(|(x, y)| (x - y).abs() > 1e-15 * (1.0 + y.abs()));
    assert!(a.len() == b.len() && !far, "{a:?} {b:?}");
}

/// Returns the coordinates of a joint that are locked, and asserts that the others hold nothing.
fn locks(joint: &Joint) -> Vec<Coordinate> {
    assert!(joint.axes.iter().all(|axis| *axis == limited(axis.coordinate, LOCKED)));
    joint.axes.iter().map(|axis| axis.coordinate).collect()
}

/// An anchor and an axis in the world give the frames of both bodies where they are.
#[test]
fn world_anchors_become_frames_in_the_bodies() {
    let joint = joint("type = \"hinge\"\nanchor = [1, 2, 3]\naxis = [0, 0, -2]");
    assert_eq!(joint.bodies, [Some(0), Some(1)]);
    let [a, b] = &joint.frames;
    // The body turns z to x, and x to -z.
    assert_near(&a.position, &[-3.0, 0.0, 0.0]);
    assert_eq!(b.position, [1.0, 2.0, 3.0]);
    assert_near(&b.rotation.quaternion(), &[0.0, FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2]);
    assert_near(&a.rotation.quaternion(), &[0.0, 0.0, 0.0, 1.0]);
    assert_eq!(locks(&joint).len(), 5);
}

/// Each type locks its own coordinates.
#[test]
fn types_lock_their_coordinates() {
    let [x, y, z] = [Linear(0), Linear(1), Linear(2)];
    let all = [
        ("fixed", "", vec![x, y, z, Twist, Swing(1), Swing(2)]),
        ("ball", "", vec![x, y, z]),
        ("hinge", "axis = [0, 1, 0]", vec![x, y, z, Swing(1), Swing(2)]),
        ("slider", "axis = [0, 1, 0]", vec![y, z, Twist, Swing(1), Swing(2)]),
        ("piston", "axis = [0, 1, 0]", vec![y, z, Swing(1), Swing(2)]),
        ("universal", "axes = [[0, 1, 0], [1, 0, 0]]", vec![x, y, z, Swing(1)]),
        ("planar", "axis = [0, 1, 0]", vec![x, Swing(1), Swing(2)]),
        ("wheel", "axis = [0, 0, 1]\nsuspension = [0, 1, 0]", vec![x, z, Swing(1), Swing(2)]),
        ("gear", "axis = [1, 0, 0]\nratio = 2", vec![Coordinate::Gear { ratio: 2.0 }]),
        (
            "rack",
            "axes = [[1, 0, 0], [0, 1, 0]]\nradius = 0.1",
            vec![Coordinate::Rack { radius: 0.1 }],
        ),
        (
            "screw",
            "axis = [0, 1, 0]\npitch = 0.01",
            vec![y, z, Swing(1), Swing(2), Coordinate::Screw { pitch: 0.01 }],
        ),
    ];
    for (name, lines, expected) in all {
        assert_eq!(locks(&joint(&format!("type = \"{name}\"\n{lines}"))), expected, "{name}");
    }
    let flat = [
        ("fixed", "", vec![x, y, Angle]),
        ("hinge", "", vec![x, y]),
        ("slider", "axis = [0, 1]", vec![y, Angle]),
        ("wheel", "suspension = [0, 1]", vec![x]),
    ];
    for (name, lines, expected) in flat {
        let joint = flat_joint(&format!("type = \"{name}\"\n{lines}"));
        assert_eq!(locks(&joint), expected, "{name}");
    }
}

/// Returns a joint in 2D of a disk at (1, 0), turned by 0.5, with the world.
fn flat_joint(lines: &str) -> Joint {
    read_scene(&format!(
        "dimension = 2\n[[bodies]]\nposition = [1, 0]\nrotation = 0.5\n\
         shapes = [{{ type = \"sphere\", radius = 0.5 }}]\n[[joints]]\nbodies = [0]\n{lines}"
    ))
    .joints
    .remove(0)
}

/// In 2D an axis is an angle: that of a slider along x, that of a suspension along y.
#[test]
fn axes_are_angles_in_the_plane() {
    let slider = flat_joint("type = \"slider\"\naxis = [0, 1]");
    assert_eq!(slider.frames[0].rotation, Rotation::Angle(FRAC_PI_2 - 0.5));
    assert_eq!(slider.frames[1].rotation, Rotation::Angle(FRAC_PI_2));
    // Without an anchor, a joint is at the origin of its body.
    assert_eq!(slider.frames[0].position, [0.0, 0.0]);
    assert_eq!(slider.frames[1].position, [1.0, 0.0]);
    let wheel = flat_joint("type = \"wheel\"\nsuspension = [0, 1]\nanchor = [2, 0]");
    assert_eq!(wheel.frames[1].rotation, Rotation::Angle(0.0));
    let (sin, cos) = (libm::sin(0.5), libm::cos(0.5));
    assert_near(&wheel.frames[0].position, &[cos, -sin]);
}

/// The joint that documents show: limits, a spring, a motor, friction and loads.
#[test]
fn a_hinge_has_all_that_it_states() {
    let joint = joint(
        "type = \"hinge\"\nname = \"door\"\nanchor = [0.5, 1, 0]\naxis = [0, 1, 0]\n\
         limits = [-1.6, 0]\nlimit_stiffness = 900\nlimit_damping = 3\n\
         spring = { stiffness = 200, damping = 4, rest = 0.1 }\n\
         motor = { velocity = 2, at_most = 10 }\nfriction = 0.2\n\
         drives = [{ velocity = 1, damping = 2, mode = \"acceleration\" }]\n\
         breaking = { force = 5000, torque = 200 }\ncollide = true\nenabled = false",
    );
    assert_eq!((joint.name.as_deref(), joint.collide, joint.enabled), (Some("door"), true, false));
    let loads = Breaking { force: Some(5000.0), torque: Some(200.0), impulse: None };
    assert_eq!(joint.breaking, loads);
    let spring = Drive {
        position: 0.1,
        velocity: 0.0,
        stiffness: 200.0,
        damping: 4.0,
        max_force: f64::INFINITY,
        acceleration: false,
    };
    let motor = Drive {
        position: 0.0,
        velocity: 2.0,
        stiffness: 0.0,
        damping: f64::INFINITY,
        max_force: 10.0,
        ..spring
    };
    let drive = Drive {
        velocity: 1.0,
        damping: 2.0,
        max_force: f64::INFINITY,
        acceleration: true,
        ..motor
    };
    let axis = joint.axes.iter().find(|axis| axis.coordinate == Twist).unwrap();
    let expected = JointAxis {
        coordinate: Twist,
        limits: Some([-1.6, 0.0]),
        softness: Some(Softness { stiffness: 900.0, damping: 3.0 }),
        drives: vec![spring, motor, drive],
        friction: 0.2,
    };
    assert_eq!(*axis, expected);
}

/// A frequency f and a damping ratio are per unit of mass: (2 pi f)^2 and 4 pi zeta f.
#[test]
fn a_frequency_is_a_stiffness_per_mass() {
    let joint = joint("type = \"spring\"\nfrequency = 2\ndamping_ratio = 0.25\nat_most = 7");
    let [axis] = joint.axes.as_slice() else { panic!("{joint:?}") };
    let rate = 2.0 * TAU;
    let expected = Drive {
        position: 5.0_f64.sqrt(),
        velocity: 0.0,
        stiffness: rate * rate,
        damping: 0.5 * rate,
        max_force: 7.0,
        acceleration: true,
    };
    assert_eq!((axis.coordinate, axis.limits), (Distance, None));
    assert_eq!(axis.drives, [expected]);
}

/// A motor with a position is a spring that may be driven.
#[test]
fn a_motor_seeks_a_position() {
    let lines = "axis = [1, 0, 0]\nmotor = { position = 0.5, stiffness = 9, velocity = 1 }";
    let joint = joint(&format!("type = \"slider\"\n{lines}"));
    let axis = joint.axes.iter().find(|axis| axis.coordinate == Linear(0)).unwrap();
    let [drive] = axis.drives.as_slice() else { panic!("{axis:?}") };
    assert_eq!((drive.position, drive.velocity), (0.5, 1.0));
    assert_eq!((drive.stiffness, drive.damping, drive.max_force), (9.0, 0.0, f64::INFINITY));
}

/// Distances, ropes and pulleys have the length that they have at the start.
#[test]
fn lengths_are_those_at_the_start() {
    let long = 5.0_f64.sqrt();
    let limits = |lines: &str| joint(lines).axes[0].limits;
    assert_eq!(limits("type = \"distance\""), Some([long, long]));
    assert_eq!(limits("type = \"distance\"\nlength = 3"), Some([3.0, 3.0]));
    assert_eq!(limits("type = \"distance\"\nlimits = [1, inf]"), Some([1.0, f64::INFINITY]));
    assert_eq!(limits("type = \"rope\""), Some([0.0, long]));
    assert_eq!(limits("type = \"rope\"\nanchors = [[0, 0, 0], [1, 0, 0]]"), Some([0.0, 2.0]));
    let points = "type = \"pulley\"\npoints = [[1, 5, 0], [0, 5, 0]]";
    assert_eq!(limits(points), Some([0.0, 8.0]));
    assert_eq!(limits(&format!("{points}\nratio = 2")), Some([0.0, 13.0]));
    assert_eq!(limits(&format!("{points}\nlength = 9")), Some([0.0, 9.0]));
    let far = "bodies = [\"a\"]\nanchors = [[0, 0, 0], [1e6, 1e6, 0]]\n";
    let message = error(&scene_of(&format!("{far}type = \"rope\"")));
    assert!(message.contains("length of joint 0 is missing; accepted: a number from 0 to 1e6 m"));
    assert_eq!(error(&scene_of(&format!("{far}type = \"rope\"\nlength = 3"))), "accepted");
    let at_once = "bodies = [\"b\", \"c\"]\ntype = \"distance\"";
    let third = "[[bodies]]\nname = \"c\"\nshapes = [{ type = \"sphere\", radius = 1 }]\n";
    let message = error(&format!("{third}{}", scene_of(at_once)));
    assert!(message.contains("length of joint 0 is missing"), "{message}");
}

/// Coordinates of a general joint: words, limits and tables, in the order that it states.
#[test]
fn general_joints_state_their_coordinates() {
    let lines = "type = \"general\"\nx = \"locked\"\ny = [-1, inf]\nz = \"free\"\ntwist = {}\n\
                 elliptic_cone = { half_angles = [0.3, 0.4] }\n\
                 gear = { ratio = 2, limits = \"free\" }\nswing_y = { friction = 2 }";
    let expected = [
        limited(Linear(0), LOCKED),
        limited(Linear(1), [-1.0, f64::INFINITY]),
        axis::free(Twist),
        JointAxis { friction: 2.0, ..axis::free(Swing(1)) },
        limited(Coordinate::EllipticCone([0.3, 0.4]), [0.0, 1.0]),
        axis::free(Coordinate::Gear { ratio: 2.0 }),
    ];
    assert_eq!(joint(lines).axes, expected);
    let names = "order = [\"gear\", \"x\", \"twist\", \"elliptic_cone\", \"swing_y\", \"y\"]";
    let [x, y, twist, swing, cone, gear] = expected;
    assert_eq!(joint(&format!("{lines}\n{names}")).axes, [gear, x, twist, cone, swing, y]);
}

/// A wheel is sprung along its suspension, driven about its axle, and steered about the suspension.
#[test]
fn a_wheel_is_sprung_driven_and_steered() {
    let joint = joint(
        "type = \"wheel\"\naxis = [0, 0, 1]\nsuspension = [0, 1, 0]\nlimits = [-0.1, 0.2]\n\
         spring = { frequency = 4, damping_ratio = 0.7 }\nmotor = { velocity = 9, at_most = 50 }\n\
         steering = [-0.6, 0.6]",
    );
    let axis = |of| joint.axes.iter().find(|axis| axis.coordinate == of).unwrap();
    assert_eq!((axis(Linear(1)).limits, axis(Linear(1)).drives.len()), (Some([-0.1, 0.2]), 1));
    assert_eq!((axis(Twist).limits, axis(Twist).drives[0].velocity), (None, 9.0));
    assert_eq!(axis(Swing(1)).limits, Some([-0.6, 0.6]));
    assert_eq!(axis(Swing(2)).limits, Some(LOCKED));
    // The frame in b has z, y and -x of the world as its axes.
    let turn = joint.frames[1].rotation.quaternion();
    assert_near(&turn, &[0.0, -FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2]);
}

/// Bodies are named, or numbered; the world is left out, or -1. JSON reads the same.
#[test]
fn bodies_are_named_or_numbered() {
    let bodies = |list: &str| {
        read_scene(&scene_of(&format!("type = \"fixed\"\nbodies = {list}"))).joints[0].bodies
    };
    assert_eq!(bodies("[\"b\"]"), [Some(1), None]);
    assert_eq!(bodies("[1, 0]"), [Some(1), Some(0)]);
    assert_eq!(bodies("[-1, \"a\"]"), [None, Some(0)]);
    let text = "{\"bodies\": [{\"shapes\": [{\"type\": \"sphere\", \"radius\": 1}]}], \
                \"joints\": [{\"type\": \"general\", \"bodies\": [0], \"x\": [\"-inf\", 0]}]}";
    let scene = read_json(Path::new("s.json"), text).unwrap().scene;
    assert_eq!(scene.joints[0].axes, [limited(Linear(0), [f64::NEG_INFINITY, 0.0])]);
}

/// Joints of particles hold positions only, and survive being written.
#[test]
fn particles_have_joints() {
    let text = "bodies_as = \"particles\"\n\
                [[bodies]]\nshapes = [{ type = \"sphere\", radius = 1 }]\n\
                [[bodies]]\nposition = [0, 3, 0]\nshapes = [{ type = \"sphere\", radius = 1 }]\n\
                [[joints]]\ntype = \"point\"\nbodies = [0]\n\
                [[joints]]\ntype = \"rope\"\nbodies = [0, 1]\n";
    let scene = read_scene(text);
    assert_eq!(locks(&scene.joints[0]), [Linear(0), Linear(1), Linear(2)]);
    assert_eq!(scene.joints[1].axes, [limited(Distance, [0.0, 3.0])]);
    assert_eq!(read_scene(&to_toml(&scene)), scene);
}

/// A joint is written as a general one, with limits alone as words and lists.
#[test]
fn joints_are_written_as_general_ones() {
    let text = scene_of("type = \"slider\"\nbodies = [\"b\"]\naxis = [1, 0, 0]\nlimits = [0, 2]");
    let written = to_toml(&read_scene(&text));
    let joint = written.split_once("[[joints]]\n").unwrap().1;
    assert_eq!(
        joint,
        "type = \"general\"\nx = [0.0, 2.0]\ny = \"locked\"\nz = \"locked\"\n\
         twist = \"locked\"\nswing_y = \"locked\"\nswing_z = \"locked\"\nbodies = [\"b\"]\n\n\
         [[joints.frames]]\n\n[[joints.frames]]\n"
    );
}

/// Returns lines that are refused, with the item, the value and what is accepted.
fn bad_lines() -> Vec<(&'static str, &'static str)> {
    vec![
        (
            "type = \"hinge\"\nbodies = [\"a\", \"a\"]\naxis = [0, 1, 0]",
            "s.toml:14:10: bodies of joint 0 is [\"a\", \"a\"]; accepted: 2 bodies that differ",
        ),
        (
            "type = \"ball\"\nname = \"j\"\nbodies = [\"wal\"]",
            "s.toml:15:11: bodies of joint 'j' is \"wal\"; accepted: the name of a body; the \
             nearest body is 'wall'",
        ),
        (
            "type = \"ball\"\nbodies = [3]",
            "s.toml:14:11: bodies of joint 0 is 3; accepted: an index below 3, the number of \
             bodies",
        ),
        (
            "type = \"ball\"\nbodies = [\"wall\"]",
            "s.toml:14:10: bodies of joint 0 is [\"wall\"]; accepted: at least one dynamic body: a \
             joint moves no others",
        ),
        (
            "type = \"ball\"\nbodies = [-1, -1]",
            "s.toml:14:10: bodies of joint 0 is [-1, -1]; accepted: at least one dynamic body: a \
             joint moves no others",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 0, 0]",
            "s.toml:15:8: axis of joint 0 is [0, 0, 0]; accepted: a direction in the world: a \
             vector that is not 0",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]",
            "s.toml:12:1: axis of joint 0 is missing; accepted: a direction in the world: a vector \
             that is not 0",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\nlimits = [1, -1]",
            "s.toml:16:10: limits of joint 0 is [1, -1]; accepted: \"locked\", \"free\", or the \
             least and the largest value, 2 numbers from -1e6 to 1e6 rad, or -inf, or inf",
        ),
        (
            "type = \"general\"\nbodies = [\"a\"]\ncone = [nan, 1]",
            "s.toml:15:8: cone of joint 0 is [nan, 1]; accepted: \"locked\", \"free\", or the \
             least and the largest value, 2 numbers from -1e6 to 1e6 rad, or -inf, or inf, the \
             second at least 0",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\npitch = 1",
            "s.toml:16:1: unknown key 'pitch' of joint 0; joints of type \"screw\" have this key",
        ),
        (
            "type = \"general\"\nbodies = [\"a\"]\nangle = \"locked\"",
            "s.toml:15:9: angle of joint 0 is \"locked\"; accepted: nothing: in 3D, the angle of a \
             hinge is twist",
        ),
        (
            "type = \"general\"\nbodies = [\"a\"]\nx = \"locked\"\norder = [\"x\", \"x\"]",
            "s.toml:16:15: order of joint 0 is \"x\"; accepted: the coordinates of the joint, each \
             once: x",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\nframes = [{}, {}]\naxis = [0, 1, 0]",
            "s.toml:16:8: axis of joint 0 is [0, 1, 0]; accepted: nothing beside frames, which \
             place the joint in the bodies",
        ),
        (
            "type = \"universal\"\nbodies = [\"a\"]\naxes = [[1, 0, 0], [1, 0, 0]]",
            "s.toml:15:8: axes of joint 0 is [[1, 0, 0], [1, 0, 0]]; accepted: 2 directions that \
             are perpendicular (within 1e-3)",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\nat_most = 3",
            "s.toml:16:1: unknown key 'at_most' of joint 0; accepted: 'motor.at_most' or \
             'spring.at_most'",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\nforce = 3",
            "s.toml:16:1: unknown key 'force' of joint 0; accepted: 'breaking.force'",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\nlimit = [0, 1]",
            "s.toml:16:1: unknown key 'limit' of joint 0; the nearest known key is 'limits'",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\n\
             spring = { frequency = 1, damping = 2 }",
            "s.toml:16:37: damping of the spring of joint 0 is 2; accepted: either frequency and \
             damping_ratio, or stiffness, damping and mode",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\nmotor = { position = 1 }",
            "s.toml:16:22: position of the motor of joint 0 is 1; accepted: a position beside a \
             stiffness or a frequency",
        ),
        (
            "type = \"gear\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\nratio = 1\nanchors = [[0, 0, 0], \
             [0, 0, 0]]",
            "s.toml:14:10: bodies of joint 0 is [\"a\"]; accepted: 2 bodies for a joint of type \
             \"gear\"",
        ),
        (
            "type = \"hinge\"\nbodies = [\"a\"]\naxis = [0, 1, 0]\nbreaking = { force = -1 }",
            "s.toml:16:22: force of breaking of joint 0 is -1; accepted: a number from 0 to 1e20 \
             N, or inf",
        ),
    ]
}

/// Each bad joint is refused with exactly the expected message.
#[test]
fn errors_name_place_item_value_and_what_is_accepted() {
    let wrong: Vec<_> = bad_lines()
        .into_iter()
        .map(|(lines, expected)| (error(&scene_of(lines)), expected))
        .filter(|(actual, expected)| actual != expected)
        .map(|(actual, _)| actual)
        .collect();
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

/// Joints that a dimension or particles do not have are refused, and so is a second name.
#[test]
fn what_a_scene_cannot_have_is_refused() {
    let flat = |lines: &str| {
        let body = "[[bodies]]\nshapes = [{ type = \"sphere\", radius = 1 }]\n";
        error(&format!("dimension = 2\n{body}[[joints]]\nbodies = [0]\n{lines}"))
    };
    assert!(flat("type = \"ball\"").ends_with("\"rack\", \"pulley\" in 2D"));
    assert!(flat("type = \"hinge\"\naxis = [0, 1]").contains("nothing in 2D"));
    assert!(flat("type = \"general\"\nz = \"locked\"").contains("nothing: in 2D"));
    assert!(flat("type = \"general\"\nradial_x = \"locked\"").contains("nothing: in 2D"));
    assert!(flat("type = \"point\"").contains("accepted: \"fixed\", \"hinge\""));
    assert_eq!(flat("type = \"hinge\""), "accepted");
    let particle = |lines: &str| {
        let body = "[[bodies]]\nshapes = [{ type = \"sphere\", radius = 1 }]\n";
        error(&format!("bodies_as = \"particles\"\n{body}[[joints]]\nbodies = [0]\n{lines}"))
    };
    assert!(particle("type = \"hinge\"").contains("in a scene of particles"));
    assert!(particle("type = \"general\"\ntwist = \"locked\"").contains("no coordinates but"));
    assert_eq!(particle("type = \"point\""), "accepted");
    let twice = "type = \"fixed\"\nname = \"j\"\nbodies = [\"a\"]\n";
    let message = error(&format!("{}[[joints]]\n{twice}", scene_of(twice)));
    assert!(message.contains("name of joint 'j' is \"j\"; accepted: a name of its own"));
}

/// Thresholds without effect, points on anchors, anchors far from their bodies and limits in
/// degrees give one warning each.
#[test]
fn joints_that_cannot_be_meant_give_warnings() {
    let hinge = "type = \"hinge\"\nbodies = [\"a\", \"b\"]\naxis = [0, 1, 0]";
    let fixed = "type = \"fixed\"\nbodies = [\"a\"]";
    let pulley = "type = \"pulley\"\nbodies = [\"a\", \"b\"]";
    let never = "does not act: it has no finite force, torque or impulse";
    for (lines, expected) in [
        (format!("{hinge}\nbreaking = {{}}"), format!("16:12: breaking of joint 0 {never}")),
        (
            format!("{hinge}\nbreaking = {{ force = \"inf\" }}"),
            format!("16:12: breaking of joint 0 {never}"),
        ),
        (
            format!("{hinge}\nbreaking = {{ force = 0, torque = 1 }}"),
            "16:22: force of breaking of joint 0 is 0: any load breaks the joint".to_owned(),
        ),
        (
            format!("{pulley}\npoints = [[1, 2, 0], [3, 5, 0]]"),
            "15:10: points of joint 0 put one on the anchor of its body, where the rope has no \
             direction"
                .to_owned(),
        ),
        (
            format!("{fixed}\nanchor = [1e6, 2, 0]"),
            "12:1: joint 0 has an anchor that is 999999 m from body 'a'".to_owned(),
        ),
        (
            format!("{hinge}\nlimits = [-90, 90]"),
            "16:10: limits of joint 0 reach 90 rad, which is 14 turns and looks like \
             degrees; angles are in radians"
                .to_owned(),
        ),
        (
            format!("{hinge}\nlimits = [\"-inf\", 45]"),
            "16:10: limits of joint 0 reach 45 rad, which is 7 turns and looks like \
             degrees; angles are in radians"
                .to_owned(),
        ),
    ] {
        assert_eq!(warnings(&scene_of(&lines)), [expected]);
    }
    for lines in [
        format!("{hinge}\nlimits = [-10, 10]"),
        format!("{hinge}\nlimits = [-31.4, 62.8]"),
        format!("{hinge}\nbreaking = {{ force = \"inf\", torque = 1 }}"),
        format!("{pulley}\npoints = [[1, 2.1, 0], [3, 5, 0]]"),
        format!("{fixed}\nanchor = [900, 2, 0]"),
    ] {
        assert_eq!(warnings(&scene_of(&lines)), [""; 0], "{lines}");
    }
}

/// A motor between bodies that start asleep waits until something wakes them.
#[test]
fn a_motor_of_sleeping_bodies_gives_a_warning() {
    let scene = |sleep: &str, velocity: f64| {
        let body = "[[bodies]]\nshapes = [{ type = \"sphere\", radius = 1 }]\n";
        let joint = "[[joints]]\ntype = \"hinge\"\nbodies = [0]\naxis = [0, 0, 1]\n";
        format!("{body}{sleep}{joint}motor = {{ velocity = {velocity} }}\n")
    };
    let expected = "4:1: joint 0 has a motor that does not act before something wakes its bodies, \
                    which start asleep";
    assert_eq!(warnings(&scene("start_asleep = true\n", 2.0)), [expected]);
    assert_eq!(warnings(&scene("start_asleep = true\n", 0.0)), [""; 0]);
    assert_eq!(warnings(&scene("", 2.0)), [""; 0]);
}

/// Far anchors, angles out of reach, and joints and limits without effect give warnings.
#[test]
fn odd_joints_give_warnings() {
    let lines = "type = \"rope\"\nbodies = [\"a\"]\nanchors = [[0, 0, 0], [2000, 2, 0]]";
    let expected = "12:1: joint 0 has anchors that are 1999 m apart at the start";
    assert_eq!(warnings(&scene_of(lines)), [expected]);
    let lines = "type = \"ball\"\nbodies = [\"a\"]\ncone = [0, 45]";
    let expected = "15:8: cone of joint 0 has a limit beyond the largest value of this angle, \
                    3.1415927 rad; angles are in radians";
    assert_eq!(warnings(&scene_of(lines)), [expected]);
    let lines = "type = \"general\"\nbodies = [\"a\"]\nname = \"j\"";
    let expected = "12:1: joint 'j' does not act: all its coordinates are free";
    assert_eq!(warnings(&scene_of(lines)), [expected]);
    let lines = "type = \"general\"\nbodies = [\"a\"]\nx = { limit_stiffness = 5 }";
    let expected = "15:25: limit_stiffness of x of joint 0 does not act: there are no limits";
    assert_eq!(warnings(&scene_of(lines)), [expected]);
    assert_eq!(warnings(&scene_of("type = \"fixed\"\nbodies = [\"a\"]")), [""; 0]);
    let line = "axis = [0, 0, 1]";
    let lines = "axes = [[0, 0, 1], [1, 0, 0]]";
    for (kind, key, along) in
        [("gear", "ratio", line), ("rack", "radius", lines), ("screw", "pitch", line)]
    {
        let of = |value: f64| {
            let joint = format!("type = \"{kind}\"\nbodies = [\"a\", \"b\"]\n{along}");
            warnings(&scene_of(&format!("{joint}\n{key} = {value:?}")))
        };
        assert!(of(0.0).iter().any(|said| said.contains(key) && said.ends_with("couples nothing")));
        assert!(!of(0.5).iter().any(|said| said.contains("couples nothing")));
    }
}

/// Each example of the page on joints is read, without a warning.
#[test]
fn the_examples_of_the_page_are_read() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/joints.md");
    let Ok(page) = std::fs::read_to_string(page) else {
        return eprintln!("skipped: a package has no docs");
    };
    let blocks = page.split("```toml\n").skip(1).filter_map(|part| part.split("```").next());
    let mut types = BTreeSet::new();
    for block in blocks {
        let text = format!("{BODIES}{block}");
        assert_eq!(warnings(&text), [""; 0], "{block}");
        let names = block.lines().filter_map(|line| line.strip_prefix("type = \""));
        types.extend(names.filter_map(|rest| rest.split('"').next()));
    }
    let all = JOINT_KEYS.iter().map(|(name, _)| *name).filter(|name| *name != "point");
    assert_eq!(types, all.collect());
}

/// Every truncation of a scene with joints is read or refused without a panic.
#[test]
fn every_truncation_is_read_or_refused() {
    let text = scene_of(
        "type = \"general\"\nbodies = [-1, \"a\"]\nframes = [{ position = [1, 2, 3] }, {}]\n\
         x = [-inf, 1]\ntwist = { limits = \"locked\", limit_stiffness = 3, friction = 1 }\n\
         pulley = { points = [[0, 0, 1], [0, 1, 0]], spring = { frequency = 2 } }\n\
         order = [\"twist\", \"x\", \"pulley\"]\nbreaking = { torque = 3 }",
    );
    assert_eq!(error(&text), "accepted");
    (0..text.len()).for_each(|end| _ = error(&text[..end]));
    let json = crate::to_json(&read_scene(&text));
    (0..json.len()).for_each(|end| _ = read_json(Path::new("s.json"), &json[..end]));
}
