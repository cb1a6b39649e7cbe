//! Conversion of a scene's shapes to the shapes of a dimension, and their mass properties.

use std::array::from_fn;

use drystone::Dimension;
use drystone::geometry::particles::SphereShape;
use drystone::geometry::{Geometry, MassProperties, Particles, Rigid2, Rigid3, mass_within};
use drystone_scene::{Rotation, Shape, ShapeKind, Solid, Weight};
use drystone_solver::Vector;

use crate::decomposition::Decompositions;

/// Conversion of a scene's shape to a shape of this dimension.
pub(crate) trait FromScene<const L: usize, const A: usize>: Dimension<L, A> {
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str>;

    /// Returns the convex pieces that replace a shape on a dynamic body; `None` if none are needed.
    fn pieces(
        _kind: &ShapeKind,
        _known: &mut Decompositions,
    ) -> Result<Option<Pieces<Self, L, A>>, &'static str>
    where
        Self: Sized,
    {
        Ok(None)
    }
}

/// Convex pieces of a mesh.
pub(crate) struct Pieces<G: Geometry<L, A>, const L: usize, const A: usize> {
    /// Pieces relative to `center`.
    pub(crate) shapes: Vec<G::Shape>,
    /// Center of the pieces in the frame of the mesh. \[m\]
    pub(crate) center: Vec<f64>,
    /// Mass properties of the mesh at density 1. Those of the pieces would count overlaps twice.
    pub(crate) solid: MassProperties<L, A>,
}

/// Converts numbers to a vector; missing components are 0.
pub(crate) fn floats<const L: usize>(of: &[f64]) -> [f32; L] {
    from_fn(|i| of.get(i).copied().unwrap_or(0.0) as f32)
}

/// Converts the shapes that parry2d and parry3d build in the same way.
macro_rules! parry_shape {
    ($parry:ident, $kind:expr, $l:literal, $box:expr, $hull:expr, $rest:expr) => {{
        use $parry::math::Vector as V;
        use $parry::shape::SharedShape;
        match $kind {
            ShapeKind::Sphere { radius } => Ok(SharedShape::ball(*radius as f32)),
            ShapeKind::Box { half_extents } => Ok($box(floats::<$l>(half_extents))),
            ShapeKind::Capsule { radius, half_height } => {
                Ok(SharedShape::capsule_y(*half_height as f32, *radius as f32))
            }
            ShapeKind::Halfspace { normal } => {
                Ok(SharedShape::halfspace(V::from(floats::<$l>(normal)).normalize()))
            }
            ShapeKind::ConvexHull { points } => {
                let points: Vec<V> = points.iter().map(|p| V::from(floats::<$l>(p))).collect();
                $hull(&points)
            }
            other => $rest(other),
        }
    }};
}

impl FromScene<2, 1> for Rigid2 {
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str> {
        parry_shape!(
            parry2d,
            kind,
            2,
            |[x, y]: [f32; 2]| SharedShape::cuboid(x, y),
            |points: &[V]| SharedShape::convex_hull(points)
                .filter(|hull| hull.mass_properties(1.0).mass() > 0.0)
                .ok_or(
                    "a hull of these points has no area; give points that do not lie on one line"
                ),
            |_: &ShapeKind| Err(
                "is not a shape of 2D; use sphere, box, capsule, convex_hull or halfspace"
            )
        )
    }
}

impl FromScene<3, 3> for Rigid3 {
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str> {
        parry_shape!(
            parry3d,
            kind,
            3,
            |[x, y, z]: [f32; 3]| SharedShape::cuboid(x, y, z),
            drystone::geometry::convex_shape,
            |other: &ShapeKind| match other {
                ShapeKind::Cylinder { radius, half_height } => {
                    Ok(SharedShape::cylinder(*half_height as f32, *radius as f32))
                }
                // Merged vertices could not move apart.
                ShapeKind::Trimesh { triangles, vertex_track: Some(track), .. } => {
                    let vertices = track.at(0.0).iter().map(|v| V::from(floats::<3>(v))).collect();
                    SharedShape::trimesh(vertices, triangles.clone())
                        .map_err(|_| "has no usable triangle")
                }
                ShapeKind::Trimesh { vertices, triangles, .. } => {
                    use parry3d::shape::TriMeshFlags;
                    let vertices = vertices.iter().map(|v| V::from(floats::<3>(v))).collect();
                    // Without this flag, a body that slides over a flat mesh catches on inner
                    // edges.
                    let flags = TriMeshFlags::FIX_INTERNAL_EDGES
                        | TriMeshFlags::MERGE_DUPLICATE_VERTICES
                        | TriMeshFlags::DELETE_DEGENERATE_TRIANGLES;
                    SharedShape::trimesh_with_flags(vertices, triangles.clone(), flags)
                        .map_err(|_| "has no usable triangle")
                }
                _ => Err("is not a shape of 3D"),
            }
        )
    }

    fn pieces(
        kind: &ShapeKind,
        known: &mut Decompositions,
    ) -> Result<Option<Pieces<Self, 3, 3>>, &'static str> {
        use parry3d::math::Vector as V;
        let ShapeKind::Trimesh { vertices, triangles, .. } = kind else { return Ok(None) };
        const OPEN: &str =
            "a mesh that is not closed has no volume to move; close it, or use its convex hull";
        let Some(found) = known.of_shape(kind) else { return Ok(None) };
        let found = found.map_err(|_| OPEN)?;
        let hull = |piece: &crate::decomposition::ConvexPiece| {
            let from = |p: &[f64; 3]| from_fn::<f32, 3, _>(|i| (p[i] - found.center[i]) as f32);
            let points: Vec<V> = piece.points.iter().map(|p| V::from(from(p))).collect();
            parry3d::shape::SharedShape::convex_hull(&points)
        };
        let shapes: Vec<_> = found.pieces.iter().filter_map(hull).collect();
        if shapes.is_empty() {
            return Err(OPEN);
        }
        let solid = solid(vertices, triangles);
        Ok(Some(Pieces { shapes, center: found.center.to_vec(), solid }))
    }
}

impl<const L: usize> FromScene<L, 0> for Particles
where
    Self: Dimension<L, 0> + Geometry<L, 0, Shape = SphereShape<L>>,
{
    fn shape(kind: &ShapeKind) -> Result<Self::Shape, &'static str> {
        match kind {
            ShapeKind::Sphere { radius } => Ok(SphereShape::Sphere { radius: *radius as f32 }),
            ShapeKind::Halfspace { normal } => {
                let normal = Vector(floats::<L>(normal));
                Ok(SphereShape::Halfspace { normal: normal * (1.0 / normal.length()) })
            }
            _ => Err("is not a particle; use sphere or halfspace"),
        }
    }
}

/// Returns the mass properties at density 1 of the volume inside a closed mesh. Triangles may face
/// either side.
fn solid(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> MassProperties<3, 3> {
    let points: Vec<_> = vertices.iter().map(|p| floats::<3>(p).into()).collect();
    let outwards = mass_within(&points, triangles, 1.0);
    if outwards.mass > 0.0 {
        return outwards;
    }
    let turned: Vec<_> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    mass_within(&points, &turned, 1.0)
}

/// Converts a pose of a scene.
pub(crate) fn place<G: Geometry<L, A>, const L: usize, const A: usize>(
    position: &[f64],
    rotation: &Rotation,
) -> G::Pose {
    match rotation {
        Rotation::Angle(angle) => G::pose(Vector(floats(position)), &[*angle as f32]),
        Rotation::Quaternion(q) => G::pose(Vector(floats(position)), &q.map(|x| x as f32)),
    }
}

/// Multiplies the density by `factor`.
pub(crate) fn times<const L: usize, const A: usize>(
    mut solid: MassProperties<L, A>,
    factor: f32,
) -> MassProperties<L, A> {
    solid.mass *= factor;
    solid.inertia.0 = solid.inertia.0.map(|row| row * factor);
    solid
}

/// Returns the mass properties of a 3D body whose shapes have different densities; `None` if they
/// have no volume.
pub(crate) fn compound(parts: &[(&Shape, Weight)]) -> Option<Solid> {
    let mut solid = MassProperties::<3, 3>::ZERO;
    for &(shape, weight) in parts {
        let mut own = match &shape.kind {
            ShapeKind::Trimesh { vertices, triangles, .. } => self::solid(vertices, triangles),
            kind => Rigid3::mass(&<Rigid3 as FromScene<3, 3>>::shape(kind).ok()?, 1.0),
        };
        let factor = match weight {
            Weight::Density(density) => density as f32,
            Weight::Mass(mass) => mass as f32 / own.mass,
        };
        own = times(own, factor);
        let pose = place::<Rigid3, 3, 3>(&shape.position, &shape.rotation);
        solid = solid.joined(&own.placed(&Rigid3::frame(&pose)));
    }
    let sound = solid.mass > 0.0 && solid.mass.is_finite();
    sound.then(|| Solid {
        mass: f64::from(solid.mass),
        center: solid.center.0.map(f64::from),
        inertia: solid.inertia.0.map(|row| row.0.map(f64::from)),
    })
}
