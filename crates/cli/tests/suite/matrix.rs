//! Tests of `drystone matrix`.

use std::fs;

use crate::common::Place;

/// Makes a row of particles between two walls: contact i shares a particle with i - 1 and i + 1.
fn row(particles: usize) -> String {
    let wall = |x: f64, nx: i32| {
        format!(
            "{{motion=\"static\", position=[{x:?}, 0], shapes=[{{type=\"halfspace\", normal=[{nx}, 0]}}]}}"
        )
    };
    let particle = |i: usize| {
        format!("{{name=\"p<{i}\", position=[{i}.0, 0], shapes=[{{type=\"sphere\", radius=0.5}}]}}")
    };
    let mut bodies: Vec<_> = (0..particles).map(particle).collect();
    bodies.extend([wall(-0.5, 1), wall(particles as f64 - 0.5, -1)]);
    let head = "dimension = 2\nbodies_as = \"particles\"\ngravity = [0, 0]\n";
    format!("{head}bodies = [{}]", bodies.join(",\n"))
}

#[test]
fn a_row_of_particles_has_three_diagonals() {
    let place = Place::new(&row(7));
    place.succeeds(&["matrix", "scene.toml", "--step", "3", "-o", "a.svg"]);
    assert_eq!(place.files(), ["a.svg", "scene.toml"]);
    let svg = fs::read_to_string(place.path("a.svg")).unwrap();
    assert!(svg.contains("scene, step 3: 8 contacts") && svg.contains("'p&lt;0'"), "{svg}");
    let plain = ["#ffffff", "#444444", "#555555"].map(|gray| format!("fill=\"{gray}\""));
    let filled = svg.lines().filter(|line| line.contains("fill=\"#"));
    let colored = filled.filter(|line| !plain.iter().any(|gray| line.contains(gray))).count();
    // Each particle has two off-diagonal entries and a disc; the contacts of the two walls have an
    // entry each.
    assert_eq!(colored, 7 * 2 + 2 + 7, "{svg}");
    assert_eq!(svg.matches("fill=\"#555555\"").count(), 6, "contacts of two that can be moved");
}

#[test]
fn scenes_without_a_picture_are_refused() {
    let place = Place::new("");
    let message = place.fails(2, &["matrix", "scene.toml", "-o", "a.svg"]);
    assert!(message.contains("contacts"), "{message}");
    assert!(place.fails(2, &["matrix", "scene.toml", "-o", "a.png"]).contains("accepted: .svg"));
    assert_eq!(place.files(), ["scene.toml"]);
}
