//! Tests of `drystone decompose`: pieces of meshes, and refusals by name.

use std::fs;

use serde_json::{Value, json};

use crate::common::Place;

/// Returns a scene with an angle bracket of 2 m, 1 m deep: dynamic, and static.
fn brackets() -> Value {
    let outline = [[0.0, 0.0], [2.0, 0.0], [2.0, 0.5], [0.5, 0.5], [0.5, 2.0], [0.0, 2.0]];
    let vertices: Vec<_> =
        [0.0, 1.0].iter().flat_map(|z| outline.map(|[x, y]| [x, y, *z])).collect();
    let mut triangles = vec![[0, 3, 2], [0, 2, 1], [0, 4, 3], [0, 5, 4]];
    triangles.extend([[6, 8, 9], [6, 7, 8], [6, 9, 10], [6, 10, 11]]);
    for i in 0..6 {
        let j = (i + 1) % 6;
        triangles.extend([[i, j, j + 6], [i, j + 6, i + 6]]);
    }
    let shape = json!({ "type": "trimesh", "vertices": vertices, "triangles": triangles });
    json!({ "bodies": [
        { "name": "still", "motion": "static", "shapes": [shape] },
        { "name": "ball", "shapes": [{ "type": "sphere", "radius": 1 }] },
        { "name": "bracket", "shapes": [{ "type": "sphere", "radius": 0.1 }, shape] },
    ] })
}

/// Only meshes of dynamic bodies have pieces. Two hulls are a bracket, and fill its volume.
#[test]
fn pieces_of_a_mesh_are_written() {
    let place = Place::new("");
    fs::write(place.path("scene.json"), brackets().to_string()).unwrap();
    let said = place.succeeds(&["decompose", "scene.json", "-o", "pieces.json"]);
    assert_eq!(said, "wrote        pieces.json (2 pieces)\n");
    let found: Value =
        serde_json::from_slice(&fs::read(place.path("pieces.json")).unwrap()).unwrap();
    let meshes = found["meshes"].as_array().unwrap();
    assert_eq!(meshes.len(), 1);
    assert_eq!((&meshes[0]["body"], &meshes[0]["shape"]), (&json!("bracket"), &json!(1)));
    assert!(meshes[0]["outward"].as_f64().unwrap() < 1e-3);
    let pieces = meshes[0]["pieces"].as_array().unwrap();
    let volume: f64 = pieces.iter().map(volume).sum();
    assert!((volume - 1.75).abs() < 1e-3, "{volume}");
}

/// Returns the volume of a piece. \[m^3\]
fn volume(piece: &Value) -> f64 {
    let points: Vec<[f64; 3]> = serde_json::from_value(piece["points"].clone()).unwrap();
    let triangles: Vec<[usize; 3]> = serde_json::from_value(piece["triangles"].clone()).unwrap();
    let of = |[i, j, k]: [usize; 3]| {
        let [a, b, c] = [points[i], points[j], points[k]];
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    triangles.into_iter().map(of).sum::<f64>() / 6.0
}

#[test]
fn wrong_pieces_are_refused_by_name() {
    let place = Place::new("");
    fs::write(place.path("scene.json"), brackets().to_string()).unwrap();
    let refused = place.fails(2, &["decompose", "scene.json", "-o", "pieces.toml"]);
    assert!(refused.contains("the format of OUT is \".toml\"; accepted: .json"), "{refused}");
    let refused = place.fails(2, &["decompose", "scene.json", "-o", "scene.json"]);
    assert!(refused.contains("the output is the input"), "{refused}");
}
