use parry3d::shape::TriMesh;

use super::*;

fn surface(vertices: &[[f32; 3]], triangles: &[[u32; 3]]) -> MeshTopology {
    let vertices = vertices.iter().map(|vertex| (*vertex).into()).collect();
    MeshTopology::of(&TriMesh::new(vertices, triangles.to_vec()).unwrap())
}

fn cube() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let corner = |i: u32| [0, 1, 2].map(|axis| (i >> axis & 1) as f32);
    let sides =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    ((0..8).map(corner).collect(), sides.into_iter().flat_map(halves).collect())
}

fn faces(surface: &MeshTopology) -> impl Iterator<Item = &MeshFace> {
    surface.faces.iter().flatten()
}

/// A closed mesh is a solid with outward normals, however its triangles are wound, unless all are
/// wound inward. Its sides are facets.
#[test]
fn a_cube_is_a_solid() {
    let (vertices, triangles) = cube();
    for turned in 0..1 << 12 {
        let turn = |(index, &[a, b, c]): (usize, &[u32; 3])| {
            if turned >> index & 1 == 1 { [a, c, b] } else { [a, b, c] }
        };
        let all: Vec<_> = triangles.iter().enumerate().map(turn).collect();
        let surface = surface(&vertices, &all);
        assert_eq!(surface.facets.len(), 6);
        let solid = turned != (1 << 12) - 1;
        for face in faces(&surface) {
            let facet = &surface.facets[face.facet as usize];
            assert_eq!(facet.solid, solid, "{turned:b}");
            let middle = facet.normal.dot(Vector([0.5; 3])) - facet.offset;
            assert!((middle + if solid { 0.5 } else { -0.5 }).abs() < 1e-6, "{turned:b}: {middle}");
            let [a, b, c] = surface.corners(face);
            let area: Vec3 = moment(b - a, c - a);
            assert!(area.dot(facet.normal) > 0.9, "wound against its facet");
        }
        if turned > 40 && solid && turned % 97 > 0 {
            continue;
        }
        // Edges of the cube admit the normals between those of their faces; diagonals admit only
        // that of the face.
        for (number, edge) in (0..).zip(&surface.edges) {
            let [from, to] = surface.ends(number);
            let across = Vector([0.5; 3]) - (from + to) * 0.5;
            let out = across * (-1.0 / across.length());
            let diagonal = edge.ends.iter().fold(0, |both, end| both ^ end).count_ones() > 1;
            assert!(surface.edge_gives(number, out), "{:?}", edge.ends);
            assert_eq!(surface.edge_gives(number, -out), diagonal && !solid, "{:?}", edge.ends);
            let leans = out + aside(&surface, number) * 0.5;
            assert_eq!(surface.edge_gives(number, leans), !diagonal, "{:?}", edge.ends);
        }
    }
}

/// Copies of triangles, as in double-sided meshes, add nothing. Vertices at one position are one.
#[test]
fn copies_add_nothing() {
    let (vertices, triangles) = cube();
    let twice: Vec<_> = triangles.iter().flat_map(|&[a, b, c]| [[a, b, c], [a, c, b]]).collect();
    let loose: Vec<_> = twice.iter().flatten().map(|&corner| vertices[corner as usize]).collect();
    let numbers: Vec<[u32; 3]> =
        (0..twice.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
    let surface = surface(&loose, &numbers);
    assert_eq!((surface.points.len(), faces(&surface).count()), (8, 12));
    assert!(surface.facets.iter().all(|facet| facet.solid));
}

/// Inside, a flat sheet of many triangles admits its two normals and no others. Its rim admits all
/// directions away from it.
#[test]
fn a_sheet_gives_its_normals() {
    let n = 6;
    let at = |i: u32| i as f32 - 3.0;
    let vertices: Vec<_> =
        (0..=n).flat_map(|i| (0..=n).map(move |j| [at(i), 0.0, at(j)])).collect();
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..n {
            let a = i * (n + 1) + j;
            let (b, c) = (a + 1, a + n + 1);
            let even = [[a, b, c], [b, c, c + 1]];
            let odd = [[a, b, c + 1], [a, c, c + 1]];
            triangles.extend(if (i + j) % 2 == 0 { even } else { odd });
        }
    }
    let surface = surface(&vertices, &triangles);
    assert_eq!(surface.facets.len(), 1);
    assert!(!surface.facets[0].solid && surface.facets[0].joined);
    let inner = faces(&surface).filter(|face| face.sharp == [false; 2]).count();
    // All but those at the rim.
    assert_eq!(inner, 32);
    let (up, aside) = (Vector([0.0, 1.0, 0.0]), Vector([0.8, 0.6, 0.0]));
    for (number, location) in (0..).zip(&surface.points) {
        let rim = location[0].abs() == 3.0 || location[2].abs() == 3.0;
        assert!(surface.vertex_gives(number, up) && surface.vertex_gives(number, -up));
        assert_eq!(surface.vertex_gives(number, aside), location[0] == 3.0, "{location:?}");
        assert_eq!(surface.vertices[number as usize].sharp, rim, "{location:?}");
    }
}

/// From above, a valley admits no normal. From below it is a ridge, and admits those between the
/// normals of its sides.
#[test]
fn a_valley_is_a_ridge_from_below() {
    let vertices = [[-1.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let surface = surface(&vertices, &[[0, 1, 3], [1, 2, 3]]);
    let valley = (0..3).find(|&edge| surface.wings(edge).len() == 2).unwrap();
    let up = Vector([0.0, 1.0, 0.0]);
    assert!(!surface.edge_gives(valley, up) && surface.edge_gives(valley, -up));
    assert!(surface.edge_gives(valley, Vector([0.6, -0.8, 0.0])));
    assert!(!surface.edge_gives(valley, Vector([0.8, -0.6, 0.0])));
    for face in faces(&surface) {
        let facet = &surface.facets[face.facet as usize];
        let k = face.edges.iter().position(|&edge| edge == valley).unwrap();
        let side = facet.normal[1].signum();
        // The sides are perpendicular.
        assert_eq!(face.beyond(k, -side), Beyond::Sharp);
        let Beyond::Rises(bend) = face.beyond(k, side) else { panic!() };
        assert!((bend - libm::tanf(std::f32::consts::FRAC_PI_8 * 2.0)).abs() < 1e-5, "{bend}");
    }
}

/// Returns a unit vector across an edge, along one of its faces.
fn aside(surface: &MeshTopology, edge: u32) -> Vec3 {
    let [from, to] = surface.ends(edge);
    let [apex, _] = surface.wings(edge)[0];
    let (along, arm) = (to - from, surface.points[apex as usize] - from);
    let across = arm - along * (arm.dot(along) / along.dot(along));
    across * (1.0 / across.length())
}

/// A Moebius strip has no inside, and neither has a cube with an inner wall.
#[test]
fn meshes_without_volume_are_sheets() {
    let count = 12;
    let vertices: Vec<_> = (0..count)
        .flat_map(|i| {
            let angle = i as f32 / count as f32 * std::f32::consts::TAU;
            [-0.3, 0.3].map(|w| {
                let radius = 1.0 + w * (0.5 * angle).cos();
                [radius * angle.cos(), w * (0.5 * angle).sin(), radius * angle.sin()]
            })
        })
        .collect();
    let mut triangles = Vec::new();
    for i in 0..count {
        let (a, b) = (2 * i, 2 * i + 1);
        let [c, d] = if i + 1 < count { [a + 2, a + 3] } else { [1, 0] };
        triangles.extend([[a, b, c], [b, d, c]]);
    }
    assert!(surface(&vertices, &triangles).facets.iter().all(|facet| !facet.solid));
    let (vertices, mut triangles) = cube();
    triangles.extend([[0, 1, 7], [0, 7, 6]]);
    assert!(surface(&vertices, &triangles).facets.iter().all(|facet| !facet.solid));
}
