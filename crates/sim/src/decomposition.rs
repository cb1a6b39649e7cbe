//! Convex pieces that stand for a concave mesh, and how far they are from it.
//!
//! A body collides as convex shapes. [`decompose`] cuts a closed mesh by planes until the exact hull of what is
//! in each part stays within [`DecompositionOptions::accuracy`] of the mesh, and joins parts as long as their common
//! hull does. It measures what came of it: [`Deviation`].
//!
//! All work is done on the mesh at unit size, with corners on a grid of 2^-20 of its size. So a mug of 1 mm
//! and one of 10 m have the same pieces, and so has one that was moved.

mod cache;
mod cuts;
mod deviation;
mod interior;
mod pieces;
mod surface;

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use cache::Decompositions;

/// Raised whenever the same mesh gets other pieces, so that stored ones are not taken for them.
const ALGORITHM: u32 = 1;

/// How closely pieces follow a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(rename = "Decomposition")]
pub struct DecompositionOptions {
    /// Distance by which pieces may reach out of the mesh, as a fraction of its largest extent.
    /// 0.001..0.2; 0.01 if absent. \[1\]
    #[schemars(range(min = 0.001, max = 0.2))]
    pub accuracy: f64,
    /// Most pieces. Where they do not suffice, the accuracy is missed, and the deviation tells.
    /// 1..256; 64 if absent.
    #[schemars(range(min = 1, max = 256))]
    pub pieces: u32,
}

impl Default for DecompositionOptions {
    fn default() -> Self {
        Self { accuracy: 0.01, pieces: 64 }
    }
}

impl DecompositionOptions {
    /// Smallest and largest [`accuracy`](Self::accuracy).
    pub const ACCURACY: [f64; 2] = [0.001, 0.2];
    /// Smallest and largest number of [`pieces`](Self::pieces).
    pub const PIECES: [u32; 2] = [1, 256];

    /// The same within what is accepted.
    fn clamped(self) -> Self {
        let [low, high] = Self::ACCURACY;
        let accuracy = if self.accuracy >= low { self.accuracy.min(high) } else { low };
        let pieces = self.pieces.clamp(Self::PIECES[0], Self::PIECES[1]);
        Self { accuracy, pieces }
    }
}

/// A convex piece of a mesh, in its frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Corners. \[m\]
    pub points: Vec<[f64; 3]>,
    /// Its surface, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// How far pieces are from their mesh.
///
/// Measured at points 1/128 of the size of the mesh apart, along columns and on the faces of the pieces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Deviation {
    /// Farthest that the pieces reach out of the mesh: hollows narrower than twice this may be closed. \[m\]
    pub outward: f64,
    /// Farthest that a point of the mesh is from all pieces. \[m\]
    pub inward: f64,
    /// Volume of the pieces outside of the mesh, as a fraction of that of the mesh. \[1\]
    pub added: f64,
    /// Volume of the mesh outside of the pieces, as a fraction of it. \[1\]
    pub lost: f64,
}

/// What [`decompose`] makes of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Decomposition {
    /// Convex pieces; they touch, and may overlap.
    pub pieces: Vec<Piece>,
    /// How far they are from the mesh.
    pub deviation: Deviation,
    /// Middle of the box around the mesh. \[m\]
    pub center: [f64; 3],
    /// Largest extent of the mesh. \[m\]
    pub size: f64,
}

impl Decomposition {
    /// Whether the pieces are as near to the mesh as the options ask for.
    pub fn is_accurate(&self, options: &DecompositionOptions) -> bool {
        self.deviation.outward.max(self.deviation.inward) <= options.accuracy * self.size
    }
}

/// Why a mesh encloses no volume that could be decomposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotSolid {
    /// A coordinate is NaN or infinite, or an index is that of no vertex.
    #[error("a coordinate is not finite, or an index is that of no vertex")]
    Invalid,
    /// The mesh has holes.
    #[error("the mesh is open: {edges} edges have no second triangle")]
    Open {
        /// Edges with an odd number of triangles.
        edges: usize,
    },
    /// Neighboring triangles face opposite sides.
    #[error("the mesh looks both ways: at {edges} edges two neighbors face opposite sides")]
    Turned {
        /// How many such edges there are.
        edges: usize,
    },
    /// All is in one plane.
    #[error("the mesh encloses no volume")]
    Flat,
    /// No pieces with a volume were found.
    #[error("no convex pieces with a volume were found")]
    Failed,
}

/// Cuts a closed mesh into convex pieces.
///
/// Triangles may face outwards or all inwards; vertices at one place count as one. Shells may cross: what is
/// inside of any is solid. Takes 0.1 to 2 s; the same mesh gives the same pieces.
///
/// ```
/// use drystone::{DecompositionOptions, decompose};
///
/// // An angle bracket: an L of 2 m, 1 m deep.
/// let outline = [[0.0, 0.0], [2.0, 0.0], [2.0, 0.5], [0.5, 0.5], [0.5, 2.0], [0.0, 2.0]];
/// let vertices: Vec<_> =
///     [0.0, 1.0].iter().flat_map(|z| outline.map(|[x, y]| [x, y, *z])).collect();
/// let mut triangles = vec![[0, 3, 2], [0, 2, 1], [0, 4, 3], [0, 5, 4]];
/// triangles.extend([[6, 8, 9], [6, 7, 8], [6, 9, 10], [6, 10, 11]]);
/// for i in 0..6 {
///     let j = (i + 1) % 6;
///     triangles.extend([[i, j, j + 6], [i, j + 6, i + 6]]);
/// }
/// let bracket = decompose(&vertices, &triangles, &DecompositionOptions::default())?;
/// assert_eq!(bracket.pieces.len(), 2);
/// assert!(bracket.deviation.outward < 1e-3);
/// # Ok::<(), drystone::NotSolid>(())
/// ```
///
/// # Errors
/// The mesh encloses no volume: [`NotSolid`].
pub fn decompose(
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
    options: &DecompositionOptions,
) -> Result<Decomposition, NotSolid> {
    Decompositions::default().of(vertices, triangles, options)
}

/// Whether [`decompose`] would take a mesh.
///
/// # Errors
/// The mesh encloses no volume: [`NotSolid`].
pub fn is_solid(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(), NotSolid> {
    surface::Surface::new(vertices, triangles).map(drop)
}

/// The pieces of a mesh at unit size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Unit {
    pieces: Vec<pieces::Hull>,
    /// As fractions of the size.
    deviation: Deviation,
}

impl Unit {
    fn of(surface: &surface::Surface, options: &DecompositionOptions) -> Result<Self, NotSolid> {
        let interior = interior::Interior::new(surface);
        let measured = |pieces: Vec<pieces::Hull>| {
            let deviation = deviation::measure(surface, &interior, &pieces);
            Self { pieces, deviation }
        };
        if let Some(hull) = pieces::whole(surface, &interior, options.accuracy) {
            return Ok(measured(vec![hull]));
        }
        let found = pieces::find(surface, &interior, options);
        if found.is_empty() { Err(NotSolid::Failed) } else { Ok(measured(found)) }
    }

    /// The same at the place and size of a mesh.
    fn at(self: Arc<Self>, center: [f64; 3], size: f64) -> Decomposition {
        let place = |p: &[f32; 3]| std::array::from_fn(|i| center[i] + size * f64::from(p[i]));
        let piece = |hull: &pieces::Hull| Piece {
            points: hull.points.iter().map(place).collect(),
            triangles: hull.triangles.clone(),
        };
        let Deviation { outward, inward, added, lost } = self.deviation;
        Decomposition {
            pieces: self.pieces.iter().map(piece).collect(),
            deviation: Deviation { outward: outward * size, inward: inward * size, added, lost },
            center,
            size,
        }
    }
}
