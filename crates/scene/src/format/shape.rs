//! Reads shapes.

use super::cursor::{FieldCursor, Range, TableCursor};
use super::setup::{POSITION, Setup};
use super::surface::{SurfaceFields, read_filter, read_surface, read_surface_velocity};
use crate::description::{Filter, Motion, Rotation, Shape, ShapeKind};
use crate::error::SceneError;
use crate::solid_mesh::{DecompositionOptions, is_solid};
use crate::vertex_track::VertexTrack;

/// Keys common to all shapes, followed by those of one type.
macro_rules! keys {
    ($($key:literal),*) => {
        &[
            "type",
            "position",
            "rotation",
            "friction",
            "restitution",
            "rolling_resistance",
            "spinning_resistance",
            "friction_combine",
            "restitution_combine",
            "surface_velocity",
            "collision",
            "extras",
            $($key),*
        ]
    };
}

pub(crate) const SHAPE_KEYS: [(&str, &[&str]); 7] = [
    ("sphere", keys!("radius")),
    ("box", keys!("half_extents")),
    ("capsule", keys!("radius", "half_height")),
    ("cylinder", keys!("radius", "half_height")),
    ("convex_hull", keys!("points")),
    ("halfspace", keys!("normal")),
    ("trimesh", keys!("vertices", "triangles", "decomposition", "vertex_track")),
];
const TYPES: &str =
    "\"sphere\", \"box\", \"capsule\", \"cylinder\", \"convex_hull\", \"halfspace\", \"trimesh\"";
const ANY_KEYS: &[&str] = keys!(
    "radius",
    "half_extents",
    "half_height",
    "points",
    "normal",
    "vertices",
    "triangles",
    "decomposition",
    "vertex_track"
);

pub(crate) const DECOMPOSITION_KEYS: &[&str] = &["accuracy", "pieces"];

pub(crate) const VERTEX_TRACK_KEYS: &[&str] = &["times", "points"];

/// Returns the name of the type in scene files.
pub(super) fn type_name(kind: &ShapeKind) -> &'static str {
    match kind {
        ShapeKind::Sphere { .. } => "sphere",
        ShapeKind::Box { .. } => "box",
        ShapeKind::Capsule { .. } => "capsule",
        ShapeKind::Cylinder { .. } => "cylinder",
        ShapeKind::ConvexHull { .. } => "convex_hull",
        ShapeKind::Halfspace { .. } => "halfspace",
        ShapeKind::Trimesh { .. } => "trimesh",
    }
}

const SIZE: Range = Range::new(1e-5, 1e6, "m");

pub(super) fn read_shape(
    field: &FieldCursor<'_>,
    index: usize,
    body: &TableCursor<'_>,
    motion: Motion,
    setup: &Setup,
    surface: &SurfaceFields,
    filter: Filter,
) -> Result<Shape, SceneError> {
    let owner = body.nested(format!("shape {index}"));
    let table = field.open(ANY_KEYS, &owner)?;
    let kind = table.require("type", TYPES)?;
    let keys = kind.choice(&SHAPE_KEYS)?;
    // Only now is the type known: a radius on a box is an error.
    let table = &field.table(keys, &owner)?;
    let dimension = setup.dimension;
    Ok(Shape {
        kind: read_kind(table, &kind, motion, dimension)?,
        position: table.vector_or("position", &POSITION, vec![0.0; dimension])?,
        rotation: table
            .get("rotation")
            .map_or(Ok(Rotation::identity(dimension)), |field| field.rotation(dimension))?,
        material: read_surface(table)?.over(surface).material(setup.particles),
        surface_velocity: read_surface_velocity(table, dimension)?,
        filter: table
            .get("collision")
            .map_or(Ok(filter), |field| read_filter(&field, table, &setup.systems))?,
    })
}

fn read_kind(
    table: &TableCursor<'_>,
    kind: &FieldCursor<'_>,
    motion: Motion,
    dimension: usize,
) -> Result<ShapeKind, SceneError> {
    let size = |key| table.require(key, format_args!("a number {SIZE}"))?.real(&SIZE);
    let name = kind.text()?;
    if dimension == 2 && matches!(name, "cylinder" | "trimesh") {
        return Err(kind.refuse(format_args!("\"{name}\" in 3D only")));
    }
    if motion == Motion::Dynamic && name == "halfspace" {
        return Err(kind.refuse(format_args!("\"{name}\" on static and kinematic bodies only")));
    }
    match name {
        "sphere" => Ok(ShapeKind::Sphere { radius: size("radius")? }),
        "box" => {
            let field =
                table.require("half_extents", format_args!("{dimension} numbers {SIZE}"))?;
            Ok(ShapeKind::Box { half_extents: field.vector(dimension, &SIZE)? })
        }
        "capsule" => {
            let range = Range::new(0.0, 1e6, "m");
            let field = table.require("half_height", format_args!("a number {range}"))?;
            Ok(ShapeKind::Capsule { radius: size("radius")?, half_height: field.real(&range)? })
        }
        "cylinder" => {
            Ok(ShapeKind::Cylinder { radius: size("radius")?, half_height: size("half_height")? })
        }
        "convex_hull" => read_hull(table, dimension),
        "halfspace" => {
            let field = table.require("normal", "the outward unit normal")?;
            Ok(ShapeKind::Halfspace { normal: field.unit(dimension)? })
        }
        _ => read_trimesh(table, motion),
    }
}

fn read_hull(table: &TableCursor<'_>, dimension: usize) -> Result<ShapeKind, SceneError> {
    let (least, flat) = if dimension == 3 { (4, "plane") } else { (3, "line") };
    let accepted = format!("at least {least} points that are not all in one {flat}");
    let field = table.require("points", &accepted)?;
    let items = field.items(&accepted)?;
    let points =
        items.map(|item| item.vector(dimension, &POSITION)).collect::<Result<Vec<_>, _>>()?;
    if points.len() < least || !spans_space(&points) {
        return Err(field.refuse_value(format!("a list of {}", points.len()), accepted));
    }
    Ok(ShapeKind::ConvexHull { points })
}

/// Returns true if the points have an extent in every direction that single precision can resolve.
///
/// In each direction in turn, takes the point farthest from the span of the points taken before.
/// Its distance from that span must be larger than rounding errors.
pub fn spans_space(points: &[Vec<f64>]) -> bool {
    let Some(origin) = points.first() else {
        return false;
    };
    let magnitude = points.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
    let mut rest: Vec<Vec<f64>> =
        points.iter().map(|p| p.iter().zip(origin).map(|(a, b)| a - b).collect()).collect();
    let mut size: f64 = 0.0;
    for _ in 0..origin.len() {
        let farthest = rest.iter().max_by(|a, b| dot(a, a).total_cmp(&dot(b, b)));
        let Some(farthest) = farthest.cloned() else {
            return false;
        };
        let distance = dot(&farthest, &farthest).sqrt();
        size = size.max(distance);
        if distance < SIZE.min.max(1e-5 * size).max(1e-6 * magnitude) {
            return false;
        }
        let direction: Vec<f64> = farthest.iter().map(|x| x / distance).collect();
        for point in &mut rest {
            let along = dot(point, &direction);
            point.iter_mut().zip(&direction).for_each(|(x, d)| *x -= along * d);
        }
    }
    true
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn read_trimesh(table: &TableCursor<'_>, motion: Motion) -> Result<ShapeKind, SceneError> {
    let field = table.require("vertices", "a list of points")?;
    let vertices = field
        .items("a list of points")?
        .map(|item| read_point(&item))
        .collect::<Result<Vec<_>, _>>()?;
    let accepted = "at least one triangle: a list of 3 indices of vertices";
    let field = table.require("triangles", accepted)?;
    let triangles = field
        .items(accepted)?
        .map(|item| read_triangle(&item, vertices.len()))
        .collect::<Result<Vec<_>, _>>()?;
    let flat = triangles.iter().filter(|t| area(&vertices, t) <= 0.0).count();
    if flat == triangles.len() {
        return Err(field.refuse(format_args!("{accepted}, of which one has an area")));
    }
    if flat > 0 {
        field.warn(format_args!("include {flat} without area, which touch nothing"));
    }
    if motion == Motion::Dynamic
        && let Err(why) = is_solid(&vertices, &triangles)
    {
        let closed = "those of a closed mesh, as a dynamic body needs a volume";
        let value = format!("a list of {}", triangles.len());
        return Err(
            field.refuse_value(value, format_args!("{closed} ({why}), or \"convex_hull\" as type"))
        );
    }
    let decomposition = table.get("decomposition");
    let decomposition = decomposition.map(|field| read_decomposition(&field, table, motion));
    let decomposition = decomposition.transpose()?;
    let vertex_track = table.get("vertex_track");
    let vertex_track =
        vertex_track.map(|field| read_vertex_track(&field, table, motion, (&vertices, &triangles)));
    let vertex_track = vertex_track.transpose()?;
    Ok(ShapeKind::Trimesh { vertices, triangles, decomposition, vertex_track })
}

fn read_vertex_track(
    field: &FieldCursor<'_>,
    shape: &TableCursor<'_>,
    motion: Motion,
    (vertices, triangles): (&[[f64; 3]], &[[u32; 3]]),
) -> Result<VertexTrack, SceneError> {
    if motion == Motion::Dynamic {
        return Err(field.refuse("a vertex_track on a static or kinematic body only"));
    }
    let owner = shape.nested("the vertex_track".to_owned());
    let table = field.table(VERTEX_TRACK_KEYS, &owner)?;
    let accepted = "a list of times [s] that ascend";
    let times = table.require("times", accepted)?;
    let range = Range::new(-1e9, 1e9, "s");
    let times = times.items(accepted)?.map(|item| item.real(&range));
    let times = times.collect::<Result<Vec<_>, _>>()?;
    let accepted = "one list of points for each time";
    let points = table.require("points", accepted)?;
    let read = |key: FieldCursor<'_>| {
        key.items("a list of points")?.map(|item| read_point(&item)).collect()
    };
    let points = points.items(accepted)?.map(read).collect::<Result<Vec<Vec<_>>, _>>()?;
    let track = VertexTrack { times, points };
    match track.check(vertices.len(), triangles) {
        Ok(()) => Ok(track),
        Err(fault) => Err(field.refuse_value("a table".to_owned(), format_args!("it {fault}"))),
    }
}

fn read_point(item: &FieldCursor<'_>) -> Result<[f64; 3], SceneError> {
    item.vector(3, &POSITION).map(|v| [at(&v, 0), at(&v, 1), at(&v, 2)])
}

fn read_decomposition(
    field: &FieldCursor<'_>,
    shape: &TableCursor<'_>,
    motion: Motion,
) -> Result<DecompositionOptions, SceneError> {
    let owner = shape.nested("the decomposition".to_owned());
    let table = field.table(DECOMPOSITION_KEYS, &owner)?;
    let default = DecompositionOptions::default();
    let [low, high] = DecompositionOptions::ACCURACY;
    let [fewest, most] = DecompositionOptions::PIECES;
    let pieces =
        table.get("pieces").map_or(Ok(default.pieces), |field| match field.whole(most) {
            Ok(pieces) if pieces >= fewest => Ok(pieces),
            _ => Err(field.refuse(format_args!("a whole number {fewest}..{most}"))),
        })?;
    if motion != Motion::Dynamic {
        field.warn("does not act: the body is not dynamic, and collides with the mesh itself");
    }
    let accuracy = Range::new(low, high, "");
    Ok(DecompositionOptions {
        accuracy: table.real_or("accuracy", &accuracy, default.accuracy)?,
        pieces,
    })
}

fn read_triangle(field: &FieldCursor<'_>, vertices: usize) -> Result<[u32; 3], SceneError> {
    let max = u32::try_from(vertices).unwrap_or(u32::MAX);
    let accepted = format_args!("3 indices below {max}, the number of vertices");
    let items = field.items(accepted)?;
    let indices: Result<Vec<u32>, _> = items.map(|item| item.whole(u32::MAX)).collect();
    match indices.ok().as_deref() {
        Some(&[a, b, c]) if a < max && b < max && c < max => Ok([a, b, c]),
        _ => Err(field.refuse(accepted)),
    }
}

fn area(vertices: &[[f64; 3]], triangle: &[u32; 3]) -> f64 {
    let corners = triangle.map(|i| vertices.get(i as usize).copied().unwrap_or_default());
    let [[ax, ay, az], [bx, by, bz], [cx, cy, cz]] = corners;
    let (u, v) = ([bx - ax, by - ay, bz - az], [cx - ax, cy - ay, cz - az]);
    let ([ux, uy, uz], [vx, vy, vz]) = (u, v);
    let cross = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    dot(&cross, &cross).sqrt() / 2.0
}

fn at(vector: &[f64], i: usize) -> f64 {
    vector.get(i).copied().unwrap_or(0.0)
}
