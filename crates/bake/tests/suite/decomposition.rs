//! Tests of the convex decomposition of concave meshes: hollows, deviation, cache, and motion of
//! the bodies.

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;

use drystone::StepSettings;
use drystone_bake::check::{FindingKind, check, decompositions};
use drystone_bake::{Decomposition, Decompositions, build, decompose};
use drystone_scene::{
    Body, DecompositionOptions, Motion, NotSolid, Scene, Shape, ShapeKind, to_json,
};

type Mesh = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// Returns a torus about y.
fn torus(radius: f64, tube: f64, around: u32, across: u32) -> Mesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..around {
        for j in 0..across {
            let [a, b] = [(i, around), (j, across)].map(|(k, n)| TAU * f64::from(k) / f64::from(n));
            let far = radius + tube * b.cos();
            vertices.push([far * a.cos(), tube * b.sin(), far * a.sin()]);
            let id = |i: u32, j: u32| (i % around) * across + j % across;
            let [p, q, r, s] = [id(i, j), id(i + 1, j), id(i + 1, j + 1), id(i, j + 1)];
            triangles.extend([[p, s, r], [p, r, q]]);
        }
    }
    (vertices, triangles)
}

/// Revolves a profile of distances from the y axis and heights. It starts and ends on the axis.
fn lathe(profile: &[[f64; 2]], around: u32) -> Mesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let mut rings: Vec<Vec<u32>> = Vec::new();
    for &[radius, y] in profile {
        let start = vertices.len() as u32;
        let count = if radius == 0.0 { 1 } else { around };
        for i in 0..count {
            let a = TAU * f64::from(i) / f64::from(around);
            vertices.push([radius * a.cos(), y, radius * a.sin()]);
        }
        rings.push((0..around).map(|i| start + i % count).collect());
    }
    for pair in rings.windows(2) {
        for i in 0..around as usize {
            let j = (i + 1) % around as usize;
            let [p, q, r, s] = [pair[0][i], pair[0][j], pair[1][j], pair[1][i]];
            triangles.extend([[p, s, q], [q, s, r]]);
        }
    }
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    (vertices, triangles)
}

/// Returns a cup of 9 cm with a wall of 3 mm.
fn cup() -> Mesh {
    lathe(&[[0.0, 0.0], [0.04, 0.0], [0.04, 0.09], [0.037, 0.09], [0.037, 0.003], [0.0, 0.003]], 32)
}

fn pieces(mesh: &Mesh) -> Decomposition {
    decompose(&mesh.0, &mesh.1, &DecompositionOptions::default()).unwrap()
}

fn scaled(mesh: &Mesh, scale: f64) -> Mesh {
    (mesh.0.iter().map(|p| p.map(|x| x * scale)).collect(), mesh.1.clone())
}

/// Returns true if a point is in a piece.
fn is_inside(found: &Decomposition, at: [f64; 3]) -> bool {
    found.pieces.iter().any(|piece| {
        piece.triangles.iter().all(|corners| {
            let [a, b, c] = corners.map(|corner| piece.points[corner as usize]);
            let [u, v, w]: [[f64; 3]; 3] = [b, c, at].map(|p| std::array::from_fn(|i| p[i] - a[i]));
            let normal =
                [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            (0..3).map(|i| normal[i] * w[i]).sum::<f64>() <= 0.0
        })
    })
}

fn is_convex(found: &Decomposition) -> bool {
    let off = |piece: &drystone_bake::decomposition::ConvexPiece| {
        let alone = Decomposition { pieces: vec![piece.clone()], ..found.clone() };
        let middle: [f64; 3] = std::array::from_fn(|i| {
            piece.points.iter().map(|p| p[i]).sum::<f64>() / piece.points.len() as f64
        });
        let inwards = |p: &[f64; 3]| std::array::from_fn(|i| p[i] + 1e-3 * (middle[i] - p[i]));
        !piece.points.iter().all(|p| is_inside(&alone, inwards(p)))
    };
    !found.pieces.iter().any(off)
}

fn scene(bodies: Vec<Body>) -> Scene {
    let mut scene = drystone_bake::read_json("none".as_ref(), "{}").unwrap().scene;
    scene.bodies = bodies;
    scene
}

/// Reads a body in Drystone's own format.
fn body(text: &str) -> Body {
    let whole = format!("[[bodies]]\n{text}");
    drystone_bake::read_toml("none".as_ref(), &whole).unwrap().scene.bodies.remove(0)
}

/// Returns a body with this mesh as its shape.
fn meshed(mesh: &Mesh, motion: Motion, place: [f64; 3]) -> Body {
    let mut of = body("shapes = [{ type = \"sphere\", radius = 1 }]");
    let kind = ShapeKind::Trimesh {
        vertices: mesh.0.clone(),
        triangles: mesh.1.clone(),
        decomposition: None,
        vertex_track: None,
    };
    of.shapes = vec![Shape { kind, ..of.shapes[0].clone() }];
    Body { motion, position: place.to_vec(), ..of }
}

/// The pieces of a cup and a ring are convex, fewer than 40 and within the accuracy, and leave the
/// hollows empty.
#[test]
fn a_cup_and_a_ring_are_hollow_within_the_accuracy() {
    let ring = pieces(&torus(1.0, 0.3, 32, 16));
    let cup = pieces(&cup());
    for (found, holes) in [(&ring, [0.0, 0.0, 0.0]), (&cup, [0.0, 0.05, 0.0])] {
        assert!(found.is_accurate(&DecompositionOptions::default()), "{:?}", found.deviation);
        assert!(found.pieces.len() < 40, "{} pieces", found.pieces.len());
        assert!(!is_inside(found, holes));
        assert!(is_convex(found));
    }
    assert!(is_inside(&ring, [1.0, 0.0, 0.0]) && is_inside(&cup, [0.0385, 0.05, 0.0]));
    // The pieces cover the whole wall.
    assert!(cup.deviation.lost < 0.01 && cup.deviation.inward < 0.002 * cup.size);
}

/// The deviation of an L-shaped prism is the true one. With two pieces it is 0. A single hull adds
/// 1/6 of the volume, within 0.005, and is off by up to 0.25 m, within 1 cm.
#[test]
fn the_deviation_is_the_true_one() {
    // An L of 1 m, whose hull fills a triangle with legs of 0.5 m over the notch.
    let outline = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.5], [0.5, 0.5], [0.5, 1.0], [0.0, 1.0]];
    let vertices: Vec<_> =
        [0.0, 1.0].iter().flat_map(|z| outline.map(|[x, y]| [x, y, *z])).collect();
    let mut triangles = vec![[0, 3, 2], [0, 2, 1], [0, 4, 3], [0, 5, 4]];
    triangles.extend([[6, 8, 9], [6, 7, 8], [6, 9, 10], [6, 10, 11]]);
    for i in 0..6 {
        let j = (i + 1) % 6;
        triangles.extend([[i, j, j + 6], [i, j + 6, i + 6]]);
    }
    let two = decompose(&vertices, &triangles, &DecompositionOptions::default()).unwrap();
    assert_eq!(two.pieces.len(), 2);
    assert!(two.deviation.outward < 1e-5 && two.deviation.added < 1e-5, "{:?}", two.deviation);
    let options = DecompositionOptions { pieces: 1, ..DecompositionOptions::default() };
    let one = decompose(&vertices, &triangles, &options).unwrap().deviation;
    assert!((one.added - 0.125 / 0.75).abs() < 0.005, "{one:?}");
    // The farthest point is the middle of the slope, 0.25 m from both walls.
    assert!((one.outward - 0.25).abs() < 0.01 && one.lost < 1e-4, "{one:?}");
}

/// A cup that is scaled or moved has as many pieces, and the same relative deviation within 1e-9.
#[test]
fn equal_meshes_of_all_sizes_and_places_have_equal_pieces() {
    let cup = cup();
    let one = pieces(&cup);
    let moved: Vec<_> = cup.0.iter().map(|p| [p[0] + 0.5, p[1] - 0.25, p[2] + 2.0]).collect();
    for (mesh, scale) in
        [(scaled(&cup, 0.0125), 0.0125), (scaled(&cup, 110.0), 110.0), ((moved, cup.1), 1.0)]
    {
        let other = pieces(&mesh);
        assert_eq!(other.pieces.len(), one.pieces.len());
        assert!((other.deviation.outward / scale - one.deviation.outward).abs() < 1e-9);
        assert!((other.size / scale - one.size).abs() < 1e-12);
    }
}

/// A decomposition has the same bits each time and from the cache. Damaged files in the cache are
/// replaced.
#[test]
fn the_same_bits_each_time_and_from_the_cache() {
    let ring = torus(1.0, 0.3, 24, 12);
    let options = DecompositionOptions::default();
    let fresh = decompose(&ring.0, &ring.1, &options).unwrap();
    assert_eq!(fresh, decompose(&ring.0, &ring.1, &options).unwrap());
    let folder = tempfile::tempdir().unwrap();
    let below = folder.path().join("made/when/needed");
    let of = || Decompositions::in_folder(&below).of(&ring.0, &ring.1, &options).unwrap();
    assert_eq!(of(), fresh);
    let file = fs::read_dir(&below).unwrap().next().unwrap().unwrap().path();
    let stored = fs::read(&file).unwrap();
    assert_eq!(of(), fresh);
    // A damaged file is recomputed.
    for damaged in [&[][..], &stored[..stored.len() / 2], &[7; 300]] {
        fs::write(&file, damaged).unwrap();
        assert_eq!(of(), fresh);
        assert_eq!(fs::read(&file).unwrap(), stored);
    }
    assert_eq!(fs::read_dir(&below).unwrap().count(), 1);
    // A folder that cannot be written is left alone.
    let barred = Decompositions::in_folder(&file).of(&ring.0, &ring.1, &options).unwrap();
    assert_eq!(barred, fresh);
}

/// Open, flat and invalid meshes, and those with a reversed triangle, are refused with the reason.
#[test]
fn meshes_without_volume_are_refused() {
    let (vertices, mut triangles) = cup();
    let options = DecompositionOptions::default();
    let of = |vertices: &[[f64; 3]], triangles: &[[u32; 3]]| {
        decompose(vertices, triangles, &options).unwrap_err()
    };
    triangles[0].swap(1, 2);
    assert!(matches!(of(&vertices, &triangles), NotSolid::Turned { edges: 1.. }));
    let open = &triangles[1..];
    assert_eq!(of(&vertices, open), NotSolid::Open { edges: 3 });
    assert_eq!(of(&vertices, &[[0, 1, 999_999]]), NotSolid::Invalid);
    assert_eq!(of(&[[f64::NAN; 3]; 3], &[[0, 1, 2]]), NotSolid::Invalid);
    assert_eq!(of(&[], &[]), NotSolid::Flat);
    let sheet = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(of(&sheet, &[[0, 1, 2], [0, 2, 1]]), NotSolid::Flat);
}

/// Meshes that are inside out, have separate vertices for each triangle or consist of crossing
/// shells are solid.
#[test]
fn meshes_as_written_by_programs_are_solid() {
    let cup = cup();
    let one = pieces(&cup);
    let turned = (cup.0.clone(), cup.1.iter().map(|[a, b, c]| [*a, *c, *b]).collect());
    assert_eq!(pieces(&turned).pieces.len(), one.pieces.len());
    let alone: Mesh = (
        cup.1.as_flattened().iter().map(|i| cup.0[*i as usize]).collect(),
        (0..cup.1.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    );
    assert_eq!(pieces(&alone).pieces.len(), one.pieces.len());
    // A handle that reaches into the wall.
    let (mut vertices, mut triangles) = cup;
    let handle = torus(0.025, 0.005, 16, 8);
    let base = vertices.len() as u32;
    vertices.extend(handle.0.iter().map(|[x, y, z]| [x + 0.045, 0.045 + z, *y]));
    triangles.extend(handle.1.iter().map(|[a, b, c]| [a + base, c + base, b + base]));
    let mug = pieces(&(vertices, triangles));
    assert!(!is_inside(&mug, [0.0, 0.05, 0.0]) && !is_inside(&mug, [0.052, 0.045, 0.0]));
    assert!(is_inside(&mug, [0.07, 0.045, 0.0]));
}

/// A body has the mass of its mesh within 1e-5. The volume of a ring is 2 pi^2 R r^2, with 64 x 32
/// corners a little less, by up to 2 %.
#[test]
fn a_body_weighs_what_its_mesh_does() {
    let ring = torus(1.0, 0.3, 64, 32);
    let volume: f64 = {
        let corner = |i: u32| ring.0[i as usize];
        let part = |t: &[u32; 3]| {
            let [a, b, c] = t.map(corner);
            a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        };
        ring.1.iter().map(part).sum::<f64>() / 6.0
    };
    assert!((volume / (TAU * TAU / 2.0 * 0.09) - 1.0).abs() < 0.02);
    let of = meshed(&ring, Motion::Dynamic, [0.0; 3]);
    let world = build(&scene(vec![of]), StepSettings::certified()).unwrap();
    assert!((world.masses()[0] / (1000.0 * volume.abs()) - 1.0).abs() < 1e-5);
}

fn height(world: &drystone_bake::AnyWorld, body: usize) -> f32 {
    let mut poses = Vec::new();
    world.write_poses(&mut poses);
    poses[7 * body + 1]
}

/// A ring falls around a rod onto the floor, within 3 cm, and a cup holds a marble, within 2 mm.
#[test]
fn hollows_hold_bodies_and_holes_let_them_through() {
    let rod = body(
        "motion = \"static\"\nposition = [0, 1, 0]\n\
         shapes = [{ type = \"box\", half_extents = [0.2, 1, 0.2] }]",
    );
    let floor =
        body("motion = \"static\"\nshapes = [{ type = \"halfspace\", normal = [0, 1, 0] }]");
    let ring = meshed(&torus(1.0, 0.3, 24, 12), Motion::Dynamic, [0.0, 1.5, 0.0]);
    let mut world =
        build(&scene(vec![floor.clone(), rod, ring]), StepSettings::realtime()).unwrap();
    for _ in 0..90 {
        world.step(1.0 / 60.0).unwrap();
    }
    let end = height(&world, 2);
    assert!((end - 0.3).abs() < 0.03, "the ring lies at {end} m");

    let cup = meshed(&cup(), Motion::Dynamic, [0.0; 3]);
    let marble = body("position = [0, 0.03, 0]\nshapes = [{ type = \"sphere\", radius = 0.01 }]");
    let mut world = build(&scene(vec![floor, cup, marble]), StepSettings::realtime()).unwrap();
    for _ in 0..60 {
        world.step(1.0 / 60.0).unwrap();
    }
    let [cup, marble] = [1, 2].map(|body| height(&world, body));
    assert!(cup.abs() < 1e-3 && (marble - 0.013).abs() < 2e-3, "cup {cup} m, marble {marble} m");
}

/// Drystone's own format keeps a mesh and the options of its decomposition. Options out of range
/// and open meshes are refused.
#[test]
fn the_own_format_keeps_the_mesh_and_its_decomposition_options() {
    let mut of = meshed(&cup(), Motion::Dynamic, [0.0; 3]);
    let ShapeKind::Trimesh { decomposition, .. } = &mut of.shapes[0].kind else { panic!() };
    *decomposition = Some(DecompositionOptions { accuracy: 0.02, pieces: 30 });
    let scene = scene(vec![of]);
    let text = to_json(&scene);
    assert_eq!(drystone_bake::read_json("none".as_ref(), &text).unwrap().scene, scene);

    let refused = |from: &str, to: &str| {
        let text = text.replace(from, to);
        drystone_bake::read_json("s.json".as_ref(), &text).unwrap_err().to_string()
    };
    let mut said = String::new();
    let _ = writeln!(said, "{}", refused("0.02", "0.3"));
    let _ = writeln!(said, "{}", refused("30", "0"));
    assert!(said.contains("accuracy of the decomposition") && said.contains("0.001"), "{said}");
    assert!(said.contains("1..256"), "{said}");
    // Without one triangle the mesh is open.
    let mut open = scene.clone();
    let ShapeKind::Trimesh { triangles, .. } = &mut open.bodies[0].shapes[0].kind else { panic!() };
    triangles.pop();
    let error =
        drystone_bake::read_json("s.json".as_ref(), &to_json(&open)).unwrap_err().to_string();
    assert!(error.contains("closed mesh") && error.contains("3 edges"), "{error}");
}

/// A decomposition with too few pieces is a finding of `check`, and one with enough is not.
#[test]
fn check_reports_pieces_that_deviate() {
    let mut of = meshed(&cup(), Motion::Dynamic, [0.0; 3]);
    let few = DecompositionOptions { pieces: 4, ..DecompositionOptions::default() };
    let ShapeKind::Trimesh { decomposition, .. } = &mut of.shapes[0].kind else { panic!() };
    *decomposition = Some(few);
    let scene = scene(vec![of]);
    let read = drystone_bake::read_json("none".as_ref(), &to_json(&scene)).unwrap();
    let findings = check(&read, &StepSettings::certified()).unwrap();
    let found =
        findings.iter().find(|of| of.kind == FindingKind::Decomposition).expect("a finding");
    assert!(found.value > found.limit && found.what.contains("4 convex pieces"), "{found:?}");
    // With enough pieces the decomposition is reported, but is no finding.
    let mut fine = scene;
    fine.bodies[0] = meshed(&cup(), Motion::Dynamic, [0.0; 3]);
    let words = decompositions(&fine, &mut Decompositions::default());
    assert!(words.len() == 1 && words[0].value <= words[0].limit, "{words:?}");
}
