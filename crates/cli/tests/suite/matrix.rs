//! Tests of `drystone matrix`.

use std::fs;

use crate::common::{Place, example};

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
    assert!(
        svg.contains("scene, step 3: 8 contacts") && svg.contains(">p&lt;0 – p&lt;1  "),
        "{svg}"
    );
    let plain = ["#ffffff", "#444444", "#555555", "#000000", "#cc0000"]
        .map(|gray| format!("fill=\"{gray}\""));
    let filled = svg.lines().filter(|line| line.contains("fill=\"#"));
    let colored = filled.filter(|line| !plain.iter().any(|gray| line.contains(gray))).count();
    // Each particle has two off-diagonal entries and a disc; the contacts of the two walls have an
    // entry each.
    assert_eq!(colored, 7 * 2 + 2 + 7, "{svg}");
    assert_eq!(svg.matches("fill=\"#555555\"").count(), 6, "contacts of two that can be moved");
}

/// The notes' two pairs: A = diag(1.33, 1) and b = (3, 3), with the names and the normals.
#[test]
fn a_small_matrix_shows_its_numbers() {
    let place = Place::new("");
    let scene = example("notes/two_pairs.toml");
    place.succeeds(&["matrix", &scene, "--step", "6", "-o", "a.svg"]);
    let svg = fs::read_to_string(place.path("a.svg")).unwrap();
    for (text, times) in [("1.33", 1), ("b [m/s]", 1), ("A – B  1", 1), ("C – D  2", 1)] {
        assert_eq!(svg.matches(&format!(">{text}</text>")).count(), times, "{text}: {svg}");
    }
    let numbers = |text: &str| svg.matches(&format!("{text}</text>")).count();
    assert_eq!((numbers("#ffffff\" text-anchor=\"middle\">1"), numbers(">3")), (1, 2), "{svg}");
    assert_eq!(svg.matches("<line").count(), 4 + 2, "bodies and normals");
    // More than 16 contacts have no room for numbers.
    let place = Place::new(&row(16));
    place.succeeds(&["matrix", "scene.toml", "-o", "a.svg"]);
    let svg = fs::read_to_string(place.path("a.svg")).unwrap();
    assert!(!svg.contains("b [m/s]") && !svg.contains("#cc0000\"/>"), "{svg}");
}

#[test]
fn scenes_without_a_picture_are_refused() {
    let place = Place::new("");
    let message = place.fails(2, &["matrix", "scene.toml", "-o", "a.svg"]);
    assert!(message.contains("contacts"), "{message}");
    assert!(place.fails(2, &["matrix", "scene.toml", "-o", "a.png"]).contains("accepted: .svg"));
    assert_eq!(place.files(), ["scene.toml"]);
}
