//! The audit of bakes whose motion is made up, so that it is known what it has to find.

use std::fs;

use drystone::StepSettings;
use drystone::audit::{Audit, audit};
use drystone::recording::Recording;
use drystone::scene::{self, Scene};

fn scene(text: &str) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    fs::write(&path, text).unwrap();
    scene::read(&path).unwrap().scene
}

/// A bake in which all bodies are where they start, but for the last one, which is at these places.
fn bake(scene: &Scene, places: &[[f32; 3]]) -> Audit {
    let mut recording = Recording {
        dimension: 3,
        bodies: scene.bodies.len(),
        frame_time: scene.time_step,
        start: 0,
        poses: Vec::new(),
    };
    let (_, others) = scene.bodies.split_last().unwrap();
    for place in places {
        for body in others {
            recording.poses.extend(body.position.iter().map(|x| *x as f32));
            recording.poses.extend([0.0, 0.0, 0.0, 1.0]);
        }
        recording.poses.extend(place.iter().chain(&[0.0, 0.0, 0.0, 1.0]));
    }
    audit(scene, &recording, &StepSettings::certified(), &[])
}

/// A square mesh of four by four meters, and a cube of 0.2 m over it.
const SHEET: &str = r#"
[[bodies]]
name = "sheet"
motion = "static"

[[bodies.shapes]]
type = "trimesh"
vertices = [[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2]]
triangles = [[0, 2, 1], [0, 3, 2]]

[[bodies]]
name = "cube"
position = [0, 0.1, 0]
shapes = [{ type = "box", half_extents = [0.1, 0.1, 0.1] }]
"#;

#[test]
fn what_rests_is_clean() {
    let found = bake(&scene(SHEET), &[[0.0, 0.0999, 0.0]; 100]);
    assert!(found.is_clean(), "{found:?}");
    let deepest = found.deepest.unwrap();
    assert_eq!(deepest.bodies, [0, 1]);
    assert!((deepest.depth - 1e-4).abs() < 1e-6, "{deepest:?}");
    assert_eq!((found.frames, found.followed), (64, 99));
}

#[test]
fn what_sinks_in_slowly_stands_inside_and_then_went_through() {
    let sinking: Vec<_> = (0..300).map(|i| [0.3, 0.1 - 0.002 * i as f32, 0.1]).collect();
    let found = bake(&scene(SHEET), &sinking);
    assert_eq!(found.passed.len(), 1, "{found:?}");
    // Its center is below after 51 frames.
    assert!((50..=52).contains(&found.passed[0].frame), "{found:?}");
    assert_eq!(found.inside.len(), 1, "{found:?}");
    assert!(found.inside[0].depth > 0.09, "{found:?}");
    assert_eq!(found.left, [1]);
}

#[test]
fn what_jumps_through_within_a_frame_went_through() {
    let found = bake(&scene(SHEET), &[[0.0, 2.0, 0.0], [0.1, 1.0, 0.0], [0.1, -3.0, 0.0]]);
    assert_eq!((found.passed.len(), found.passed[0].frame), (1, 2), "{found:?}");
    let around = [[0.0, 2.0, 0.0], [5.0, 1.0, 0.0], [5.0, -0.2, 0.0], [0.0, -0.3, 0.0]];
    assert!(bake(&scene(SHEET), &around).passed.is_empty());
}

#[test]
fn overlap_at_the_start_is_told_and_accepted() {
    let found = bake(&scene(SHEET), &[[0.0, 0.05, 0.0], [0.0, 0.06, 0.0], [0.0, 0.1, 0.0]]);
    assert!(found.is_clean(), "{found:?}");
    assert!((found.start.unwrap().depth - 0.05).abs() < 1e-6);
}

#[test]
fn nothing_is_found_in_nothing() {
    let empty = scene("bodies = []");
    let recording =
        Recording { dimension: 3, bodies: 0, frame_time: 0.1, start: 0, poses: Vec::new() };
    assert_eq!(audit(&empty, &recording, &StepSettings::certified(), &[]), Audit::default());
}
