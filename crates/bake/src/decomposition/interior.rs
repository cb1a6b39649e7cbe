//! Point queries on a closed surface: inside or outside, and distance ([`Interior`]).

use parry3d::math::Vector;
use parry3d::query::PointQuery;
use parry3d::shape::TriMesh;

use drystone_scene::solid_mesh::{Corner, GRID, SolidMesh, normal, unit};

/// Columns run at odd multiples of 2^-(`GRID` + `FINER`), so that no column hits a corner.
const FINER: u32 = 5;

/// A closed surface with an index for point queries.
pub(super) struct Interior<'s> {
    surface: &'s SolidMesh,
    /// Triangles that the columns along y of each bin may hit.
    bins: Vec<Vec<u32>>,
    /// Number of bins along each axis.
    across: usize,
    mesh: Option<TriMesh>,
}

/// An interval of a column, lower end first.
pub(super) type Stretch = [f64; 2];

impl<'s> Interior<'s> {
    pub(super) fn new(surface: &'s SolidMesh) -> Self {
        let across = ((surface.triangles.len() as f64).sqrt() as usize).clamp(8, 256);
        let mut bins = vec![Vec::new(); across * across];
        for triangle in 0..surface.triangles.len() {
            let corners = surface.corners_of(triangle).map(unit);
            let span = |i: usize| {
                let at = |pick: fn(f64, f64) -> f64| corners.map(|p| p[i]).into_iter().reduce(pick);
                [at(f64::min), at(f64::max)].map(|x| bin(x.unwrap_or(0.0), across))
            };
            let ([x0, x1], [z0, z1]) = (span(0), span(2));
            for x in x0..=x1 {
                for z in z0..=z1 {
                    bins[x * across + z].push(triangle as u32);
                }
            }
        }
        let points = surface.corners.iter().map(|corner| point(unit(*corner))).collect();
        Self { surface, bins, across, mesh: TriMesh::new(points, surface.triangles.clone()).ok() }
    }

    /// Finds the crossings of a column along y with the surface, lowest first: height, and 1 where
    /// the column enters or -1 where it leaves.
    fn crossings(&self, x: f64, z: f64, out: &mut Vec<(f64, i32)>) {
        out.clear();
        let fine = f64::from(1 << (GRID + FINER));
        let [px, pz] = [x, z].map(|x| (x * fine).floor() as i64 | 1);
        let [column, row] = [px, pz].map(|x| bin(x as f64 / fine, self.across));
        for &triangle in &self.bins[column * self.across + row] {
            let corners = self.surface.corners_of(triangle as usize);
            let up = normal(corners)[1];
            // Counter-clockwise in the plane of z and x.
            let [a, b, c] = match up {
                0 => continue,
                1.. => corners,
                _ => [corners[0], corners[2], corners[1]],
            };
            let side = |a: Corner, b: Corner| {
                let fine = |x: i32| i64::from(x) << FINER;
                let ([az, ax], [bz, bx]) = ([fine(a[2]), fine(a[0])], [fine(b[2]), fine(b[0])]);
                let area = (bz - az) * (px - ax) - (bx - ax) * (pz - az);
                // A column through a shared edge crosses exactly one of the two triangles.
                let inside = area > 0 || area == 0 && (bz, bx) > (az, ax);
                inside.then_some(area as f64)
            };
            let (Some(of_c), Some(of_a), Some(of_b)) = (side(a, b), side(b, c), side(c, a)) else {
                continue;
            };
            let total = of_a + of_b + of_c;
            let [a, b, c] = [a, b, c].map(|p| unit(p)[1]);
            out.push(((a * of_a + b * of_b + c * of_c) / total, if up < 0 { 1 } else { -1 }));
        }
        out.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    }

    /// Returns true if a point is inside the surface.
    pub(super) fn contains(&self, [x, y, z]: [f64; 3], memory: &mut Vec<(f64, i32)>) -> bool {
        self.crossings(x, z, memory);
        memory.iter().take_while(|crossing| crossing.0 < y).map(|crossing| crossing.1).sum::<i32>()
            > 0
    }

    /// Finds the intervals of a column along y that are inside the surface, lowest first.
    pub(super) fn column(
        &self,
        x: f64,
        z: f64,
        memory: &mut Vec<(f64, i32)>,
        out: &mut Vec<Stretch>,
    ) {
        self.crossings(x, z, memory);
        out.clear();
        let (mut depth, mut from) = (0, 0.0);
        for &(y, step) in memory.iter() {
            if depth <= 0 && depth + step > 0 {
                from = y;
            }
            if depth > 0 && depth + step <= 0 && y > from {
                out.push([from, y]);
            }
            depth += step;
        }
    }

    /// Returns the distance of a point from the surface.
    pub(super) fn distance(&self, at: [f64; 3]) -> f64 {
        let at = point(at);
        let nearest = self.mesh.as_ref().map(|mesh| mesh.project_local_point(at, false).point);
        nearest.map_or(0.0, |nearest| f64::from((nearest - at).length()))
    }

    /// Returns the distance of a point outside from the surface; 0 inside.
    pub(super) fn excess(&self, at: [f64; 3], memory: &mut Vec<(f64, i32)>) -> f64 {
        if self.contains(at, memory) { 0.0 } else { self.distance(at) }
    }
}

fn bin(x: f64, across: usize) -> usize {
    (((x + 0.5) * across as f64).max(0.0) as usize).min(across - 1)
}

pub(super) fn point(at: [f64; 3]) -> Vector {
    Vector::from(at.map(|x| x as f32))
}
