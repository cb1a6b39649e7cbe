//! Tests of the audit on recordings with prescribed motion, so that its findings are known.

use std::fs;

use drystone::StepSettings;
use drystone_bake::audit::{Audit, audit};
use drystone_bake::recording::Recording;
use drystone_scene::Scene;

fn scene(text: &str) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    fs::write(&path, text).unwrap();
    drystone_bake::read(&path).unwrap().scene
}

/// Audits a recording in which the last body takes these positions and all others stay at their
/// start.
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

/// A square mesh of four by four meters, and a cube of 0.2 m on it.
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

/// A cube that rests with an overlap of 0.1 mm gives no finding, and the overlap is measured within
/// 0.001 mm.
#[test]
fn a_body_at_rest_has_no_finding() {
    let found = bake(&scene(SHEET), &[[0.0, 0.0999, 0.0]; 100]);
    assert!(found.is_clean(), "{found:?}");
    let deepest = found.deepest.unwrap();
    assert_eq!(deepest.bodies, [0, 1]);
    assert!((deepest.depth - 1e-4).abs() < 1e-6, "{deepest:?}");
    assert_eq!((found.frames, found.followed), (64, 99));
}

/// A cube that moves through a mesh slowly is found inside by more than 9 cm. It passes through
/// when its center does, and is below everything in the end.
#[test]
fn slow_penetration_is_found_as_overlap_and_as_passage() {
    let sinking: Vec<_> = (0..300).map(|i| [0.3, 0.1 - 0.002 * i as f32, 0.1]).collect();
    let found = bake(&scene(SHEET), &sinking);
    assert_eq!(found.passages.len(), 1, "{found:?}");
    // Its center is below after 51 frames.
    assert!((50..=52).contains(&found.passages[0].frame), "{found:?}");
    assert_eq!(found.overlaps.len(), 1, "{found:?}");
    assert!(found.overlaps[0].depth > 0.09, "{found:?}");
    assert_eq!(found.fallen, [1]);
}

/// A cube that jumps through a mesh within one frame is found, and one that goes around the mesh is
/// not.
#[test]
fn a_jump_through_a_mesh_within_a_frame_is_found() {
    let found = bake(&scene(SHEET), &[[0.0, 2.0, 0.0], [0.1, 1.0, 0.0], [0.1, -3.0, 0.0]]);
    assert_eq!((found.passages.len(), found.passages[0].frame), (1, 2), "{found:?}");
    let around = [[0.0, 2.0, 0.0], [5.0, 1.0, 0.0], [5.0, -0.2, 0.0], [0.0, -0.3, 0.0]];
    assert!(bake(&scene(SHEET), &around).passages.is_empty());
}

/// An overlap at the start is reported as such, and is no finding.
#[test]
fn overlap_at_the_start_is_reported_and_accepted() {
    let found = bake(&scene(SHEET), &[[0.0, 0.05, 0.0], [0.0, 0.06, 0.0], [0.0, 0.1, 0.0]]);
    assert!(found.is_clean(), "{found:?}");
    assert!((found.start.unwrap().depth - 0.05).abs() < 1e-6);
}

/// The audit of an empty scene finds nothing.
#[test]
fn an_empty_scene_has_no_findings() {
    let empty = scene("bodies = []");
    let recording =
        Recording { dimension: 3, bodies: 0, frame_time: 0.1, start: 0, poses: Vec::new() };
    assert_eq!(audit(&empty, &recording, &StepSettings::certified(), &[]), Audit::default());
}
