//! Meshes that enclose a volume: [`SolidMesh`], and the options of their convex decomposition.

use std::collections::HashMap;

use schemars::JsonSchema;
use serde::Serialize;

/// Accuracy and number of the convex pieces of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(rename = "Decomposition")]
pub struct DecompositionOptions {
    /// Maximum distance by which pieces may extend beyond the mesh, as a fraction of its largest
    /// extent. 0.001..0.2; 0.01 if absent. \[1\]
    #[schemars(range(min = 0.001, max = 0.2))]
    pub accuracy: f64,
    /// Maximum number of pieces. If more would be needed, the accuracy is missed, as the deviation
    /// shows. 1..256; 64 if absent.
    #[schemars(range(min = 1, max = 256))]
    pub pieces: u32,
}

impl Default for DecompositionOptions {
    fn default() -> Self {
        Self { accuracy: 0.01, pieces: 64 }
    }
}

impl DecompositionOptions {
    /// Range of [`accuracy`](Self::accuracy).
    pub const ACCURACY: [f64; 2] = [0.001, 0.2];
    /// Range of [`pieces`](Self::pieces).
    pub const PIECES: [u32; 2] = [1, 256];

    /// Returns the options clamped to their ranges.
    #[must_use]
    pub fn clamped(self) -> Self {
        let [low, high] = Self::ACCURACY;
        let accuracy = if self.accuracy >= low { self.accuracy.min(high) } else { low };
        let pieces = self.pieces.clamp(Self::PIECES[0], Self::PIECES[1]);
        Self { accuracy, pieces }
    }
}

/// Error: a mesh encloses no volume that could be decomposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotSolid {
    /// A coordinate is NaN or infinite, or a triangle has an index out of range.
    #[error("a coordinate is not finite, or an index has no vertex")]
    Invalid,
    /// The mesh has holes.
    #[error("the mesh is open: {edges} edges have no second triangle")]
    Open {
        /// Number of edges with an odd number of triangles.
        edges: usize,
    },
    /// Neighboring triangles face opposite sides.
    #[error("the mesh is not oriented: at {edges} edges two neighbors face opposite sides")]
    Turned {
        /// Number of such edges.
        edges: usize,
    },
    /// The mesh encloses no volume, such as a flat one.
    #[error("the mesh encloses no volume")]
    Flat,
    /// No pieces with a volume were found.
    #[error("no convex pieces with a volume were found")]
    Failed,
}

/// Corners are at multiples of 2^-`GRID` of the size of the mesh.
pub const GRID: u32 = 20;

/// A corner in grid steps, relative to the center of the mesh.
pub type Corner = [i32; 3];

/// A closed mesh at unit size whose triangles face outward.
pub struct SolidMesh {
    /// Corners, each once.
    pub corners: Vec<Corner>,
    /// Triangles with a nonzero area.
    pub triangles: Vec<[u32; 3]>,
    /// Center of the bounding box. \[m\]
    pub center: [f64; 3],
    /// Largest extent. \[m\]
    pub size: f64,
}

impl SolidMesh {
    /// Puts a mesh on the grid.
    ///
    /// # Errors
    /// [`NotSolid`]: the mesh encloses no volume.
    pub fn new(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self, NotSolid> {
        let known = |index: &u32| (*index as usize) < vertices.len();
        let finite = vertices.iter().flatten().all(|x| x.is_finite());
        if !finite || !triangles.iter().flatten().all(known) {
            return Err(NotSolid::Invalid);
        }
        // Vertices without a triangle do not count for the box.
        let used = || triangles.iter().flatten().map(|index| vertices[*index as usize]);
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for vertex in used() {
            for i in 0..3 {
                (low[i], high[i]) = (low[i].min(vertex[i]), high[i].max(vertex[i]));
            }
        }
        let size = (0..3).map(|i| high[i] - low[i]).fold(0.0, f64::max);
        if size <= 0.0 || !size.is_finite() {
            return Err(NotSolid::Flat);
        }
        let center: [f64; 3] = std::array::from_fn(|i| 0.5 * (low[i] + high[i]));
        let (corners, mut triangles) = on_grid(vertices, triangles, center, size);
        closed(&triangles)?;
        let whole = volume(&corners, &triangles);
        // Less than 1.6e-10 of the cube around the mesh.
        if whole.abs() < f64::from(1 << 30) {
            return Err(NotSolid::Flat);
        }
        if whole < 0.0 {
            triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        triangles
            .retain(|triangle| normal(triangle.map(|corner| corners[corner as usize])) != [0; 3]);
        Ok(Self { corners, triangles, center, size })
    }

    /// Returns the corners of a triangle, in grid steps.
    pub fn corners_of(&self, triangle: usize) -> [Corner; 3] {
        self.triangles[triangle].map(|corner| self.corners[corner as usize])
    }
}

/// Checks that a mesh is closed and encloses a volume, as a convex decomposition requires.
///
/// # Errors
/// [`NotSolid`]: the mesh encloses no volume.
pub fn is_solid(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(), NotSolid> {
    SolidMesh::new(vertices, triangles).map(drop)
}

/// Converts grid steps to unit size.
pub fn unit(corner: Corner) -> [f64; 3] {
    corner.map(|x| f64::from(x) / f64::from(1 << GRID))
}

/// Returns twice the area vector of a triangle, exactly.
pub fn normal([a, b, c]: [Corner; 3]) -> [i64; 3] {
    let [u, v]: [[i64; 3]; 2] =
        [b, c].map(|p| std::array::from_fn(|i| i64::from(p[i]) - i64::from(a[i])));
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// Rounds vertices to the grid and merges those that coincide. Drops triangles that lose a side.
fn on_grid(
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
    center: [f64; 3],
    size: f64,
) -> (Vec<Corner>, Vec<[u32; 3]>) {
    let mut places = HashMap::new();
    let mut corners: Vec<Corner> = Vec::new();
    let mut corner_of = |index: u32| {
        let vertex = vertices[index as usize];
        let corner: Corner = std::array::from_fn(|i| {
            ((vertex[i] - center[i]) / size * f64::from(1 << GRID)).round() as i32
        });
        *places.entry(corner).or_insert_with(|| {
            corners.push(corner);
            corners.len() as u32 - 1
        })
    };
    let placed: Vec<[u32; 3]> = triangles.iter().map(|of| of.map(&mut corner_of)).collect();
    let whole = placed.into_iter().filter(|[a, b, c]| a != b && b != c && c != a).collect();
    (corners, whole)
}

/// Checks that each edge is traversed as often forward as backward.
fn closed(triangles: &[[u32; 3]]) -> Result<(), NotSolid> {
    // For each edge: number of traversals, and forward minus backward traversals.
    let mut passed: HashMap<[u32; 2], (u32, i32)> = HashMap::new();
    for &[a, b, c] in triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let of = passed.entry([from.min(to), from.max(to)]).or_default();
            of.0 += 1;
            of.1 += if from < to { 1 } else { -1 };
        }
    }
    let open = passed.values().filter(|of| of.0 % 2 == 1).count();
    let turned = passed.values().filter(|of| of.0 % 2 == 0 && of.1 != 0).count();
    match (open, turned) {
        _ if passed.is_empty() => Err(NotSolid::Flat),
        (0, 0) => Ok(()),
        (0, edges) => Err(NotSolid::Turned { edges }),
        (edges, _) => Err(NotSolid::Open { edges }),
    }
}

/// Returns six times the enclosed volume, in grid cubes.
fn volume(corners: &[Corner], triangles: &[[u32; 3]]) -> f64 {
    let part = |triangle: &[u32; 3]| {
        let of = triangle.map(|corner| corners[corner as usize]);
        let area = normal(of);
        (0..3).map(|i| area[i] as f64 * f64::from(of[0][i])).sum::<f64>()
    };
    triangles.iter().map(part).sum()
}
