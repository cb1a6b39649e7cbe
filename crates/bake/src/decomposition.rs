//! Convex decomposition of concave meshes, and its deviation from the mesh.
//!
//! Dynamic bodies collide as convex shapes. [`decompose`] cuts a closed mesh by planes until the
//! exact hull of each part stays within [`DecompositionOptions::accuracy`] of the mesh. It then
//! joins parts as long as their common hull stays within it, too. It measures the result:
//! [`Deviation`].
//!
//! All work is done on the mesh at unit size, with vertices on a grid of 2^-20 of its size. The
//! pieces therefore do not depend on the position and the size of the mesh: a mug of 1 mm and one
//! of 10 m have the same pieces.

mod cache;
mod cuts;
mod deviation;
mod interior;
mod pieces;

use std::sync::Arc;

use drystone_scene::solid_mesh::SolidMesh;
use drystone_scene::{DecompositionOptions, NotSolid};
use serde::{Deserialize, Serialize};

pub use cache::Decompositions;

/// Version of the algorithm. It increases whenever a mesh would get different pieces, which
/// invalidates stored decompositions.
const ALGORITHM: u32 = 1;

/// A convex piece of a mesh, in the frame of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexPiece {
    /// Vertices. \[m\]
    pub points: Vec<[f64; 3]>,
    /// Triangles of its surface, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Deviation of convex pieces from their mesh.
///
/// Sample points are 1/128 of the size of the mesh apart along columns, and at most 1/64 on the
/// faces of the pieces.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Deviation {
    /// Maximum distance by which the pieces extend beyond the mesh. Hollows narrower than twice
    /// this distance may be closed. \[m\]
    pub outward: f64,
    /// Maximum distance of a point of the mesh from all pieces. \[m\]
    pub inward: f64,
    /// Volume of the pieces outside the mesh, as a fraction of the volume of the mesh. \[1\]
    pub added: f64,
    /// Volume of the mesh outside the pieces, as a fraction of the volume of the mesh. \[1\]
    pub lost: f64,
}

/// Convex decomposition of a mesh by [`decompose`].
#[derive(Clone, Debug, PartialEq)]
pub struct Decomposition {
    /// Convex pieces; they touch, and may overlap.
    pub pieces: Vec<ConvexPiece>,
    /// Deviation of the pieces from the mesh.
    pub deviation: Deviation,
    /// Center of the bounding box of the mesh. \[m\]
    pub center: [f64; 3],
    /// Largest extent of the mesh. \[m\]
    pub size: f64,
}

impl Decomposition {
    /// Returns true if the deviation is within the accuracy of the options.
    pub fn is_accurate(&self, options: &DecompositionOptions) -> bool {
        self.deviation.outward.max(self.deviation.inward) <= options.accuracy * self.size
    }
}

/// Cuts a closed mesh into convex pieces.
///
/// All triangles may face outward, or all inward. Vertices at the same position count as one.
/// Shells may intersect: points inside any shell are solid. Takes 0.1 to 2 s; the same mesh always
/// gives the same pieces.
///
/// ```
/// use drystone_bake::decompose;
/// use drystone_scene::DecompositionOptions;
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
/// # Ok::<(), drystone_scene::NotSolid>(())
/// ```
///
/// # Errors
/// [`NotSolid`]: the mesh encloses no volume.
pub fn decompose(
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
    options: &DecompositionOptions,
) -> Result<Decomposition, NotSolid> {
    Decompositions::default().of(vertices, triangles, options)
}

/// Pieces of a mesh at unit size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Unit {
    pieces: Vec<pieces::Hull>,
    /// Lengths as fractions of the size of the mesh.
    deviation: Deviation,
}

impl Unit {
    fn of(surface: &SolidMesh, options: &DecompositionOptions) -> Result<Self, NotSolid> {
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

    /// Scales and moves the pieces to the size and center of a mesh.
    fn at(self: Arc<Self>, center: [f64; 3], size: f64) -> Decomposition {
        let place = |p: &[f32; 3]| std::array::from_fn(|i| center[i] + size * f64::from(p[i]));
        let piece = |hull: &pieces::Hull| ConvexPiece {
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
