//! Conversion of scene shapes to parry: in 2D and 3D, in single and double precision.

/// One set of conversions. The four builds of parry are four crates with the same names.
macro_rules! shapes {
    ($name:ident: $($parry:ident)::+, $real:ident, $l:literal, $turn:expr, $cuboid:expr, $other:expr) => {
        pub(crate) mod $name {
            use drystone_scene::{Rotation, ShapeKind};
            use $($parry)::+::math::{Pose, Rotation as Turn, Vector};
            use $($parry)::+::shape::SharedShape;

            /// Converts a vector; missing components are 0.
            pub(crate) fn vector(of: &[f64]) -> Vector {
                let axes: [$real; $l] =
                    std::array::from_fn(|i| of.get(i).copied().unwrap_or(0.0) as $real);
                axes.into()
            }

            /// Converts a pose.
            pub(crate) fn pose(position: &[f64], rotation: &Rotation) -> Pose {
                let turn: fn(&Rotation) -> Turn = $turn;
                Pose::from_parts(vector(position), turn(rotation))
            }

            /// Converts a shape, or returns why that is impossible.
            pub(crate) fn shape(kind: &ShapeKind) -> Result<SharedShape, &'static str> {
                let cuboid: fn(Vector) -> SharedShape = $cuboid;
                let other: fn(&ShapeKind) -> Result<SharedShape, &'static str> = $other;
                match kind {
                    ShapeKind::Sphere { radius } => Ok(SharedShape::ball(*radius as $real)),
                    ShapeKind::Box { half_extents } => Ok(cuboid(vector(half_extents))),
                    ShapeKind::Capsule { radius, half_height } => {
                        Ok(SharedShape::capsule_y(*half_height as $real, *radius as $real))
                    }
                    ShapeKind::Halfspace { normal } => {
                        Ok(SharedShape::halfspace(vector(normal).normalize()))
                    }
                    ShapeKind::ConvexHull { points } => {
                        let points: Vec<Vector> = points.iter().map(|p| vector(p)).collect();
                        SharedShape::convex_hull(&points).ok_or("a hull without volume")
                    }
                    kind => other(kind),
                }
            }
        }
    };
}

macro_rules! flat {
    ($name:ident: $($parry:ident)::+, $real:ident) => {
        shapes!(
            $name: $($parry)::+, $real, 2,
            |rotation| match rotation {
                Rotation::Angle(angle) => Turn::from_angle(*angle as $real),
                Rotation::Quaternion(_) => Turn::IDENTITY,
            },
            |half| SharedShape::cuboid(half.x, half.y),
            |_| Err("not a shape of the plane")
        );
    };
}

macro_rules! space {
    ($name:ident: $($parry:ident)::+, $real:ident) => {
        shapes!(
            $name: $($parry)::+, $real, 3,
            |rotation| match rotation {
                Rotation::Quaternion(q) => {
                    let [x, y, z, w] = q.map(|x| x as $real);
                    Turn::from_xyzw(x, y, z, w).normalize()
                }
                Rotation::Angle(_) => Turn::IDENTITY,
            },
            |half| SharedShape::cuboid(half.x, half.y, half.z),
            |kind| match kind {
                ShapeKind::Cylinder { radius, half_height } => {
                    Ok(SharedShape::cylinder(*half_height as $real, *radius as $real))
                }
                ShapeKind::Trimesh { vertices, triangles, .. } => {
                    let vertices = vertices.iter().map(|v| vector(v)).collect();
                    SharedShape::trimesh(vertices, triangles.clone())
                        .map_err(|_| "a mesh without a usable triangle")
                }
                _ => Err("not a shape of space"),
            }
        );
    };
}

flat!(flat: rapier2d::parry, f32);
space!(space: rapier3d::parry, f32);
flat!(exact_flat: parry2d_f64, f64);
space!(exact_space: parry3d_f64, f64);
