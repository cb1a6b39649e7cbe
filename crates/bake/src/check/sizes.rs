//! Findings about the sizes and positions of bodies.

use super::{Finding, FindingKind, length};
use drystone_scene::{Scene, Shape, ShapeKind};

/// Largest accepted extent. Larger ones are most often millimeters read as meters. \[m\]
const LARGEST: f64 = 1e3;
/// Smallest accepted thickness. Thinner bodies are close to the distances at which contacts are
/// made. \[m\]
const THINNEST: f64 = 1e-3;
/// Largest accepted distance from the origin. Farther out, positions are coarser than 0.1 mm. \[m\]
const FARTHEST: f64 = 1e3;

/// Finds bodies that are too large, too thin or too far away; one finding of each kind per body.
pub(super) fn sizes(scene: &Scene) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (index, body) in scene.bodies.iter().enumerate() {
        let name = scene.name_of(index);
        let mut found = |kind, value, limit, what: String, advice: &str| {
            findings.push(Finding::of_body(index, kind, [value, limit], what, advice));
        };
        let sides = || body.shapes.iter().filter_map(extents).flatten();
        let largest = sides().fold(0.0, f64::max);
        if largest > LARGEST {
            let (is, limit) = (length(largest), length(LARGEST));
            let what = format!("{name} is {is} large; accepted: up to {limit}");
            found(
                FindingKind::TooLarge,
                largest,
                LARGEST,
                what,
                "lengths are in meters: scale the scene",
            );
        }
        let thinnest = body.shapes.iter().filter_map(thickness).fold(f64::INFINITY, f64::min);
        if thinnest < THINNEST {
            let (is, limit) = (length(thinnest), length(THINNEST));
            let what = format!("{name} is {is} thin; accepted: from {limit}");
            let advice = "lengths are in meters: scale the scene, or make it thicker";
            found(FindingKind::TooSmall, thinnest, THINNEST, what, advice);
        }
        let far = body.position.iter().map(|x| x * x).sum::<f64>().sqrt();
        if far > FARTHEST {
            let (is, limit) = (length(far), length(FARTHEST));
            let what = format!("{name} is {is} from the origin; accepted: up to {limit}");
            found(FindingKind::TooFar, far, FARTHEST, what, "move the scene to the origin");
        }
    }
    findings
}

/// Returns the full extents along the axes of a shape; `None` for a half-space. \[m\]
pub(super) fn extents(shape: &Shape) -> Option<Vec<f64>> {
    let around = |points: &mut dyn Iterator<Item = &[f64]>| {
        let bounds = points.fold(Vec::new(), |mut bounds: Vec<[f64; 2]>, point| {
            bounds.resize(point.len(), [f64::INFINITY, f64::NEG_INFINITY]);
            for ([low, high], x) in bounds.iter_mut().zip(point) {
                (*low, *high) = (low.min(*x), high.max(*x));
            }
            bounds
        });
        bounds.into_iter().map(|[low, high]| high - low).collect()
    };
    Some(match &shape.kind {
        ShapeKind::Sphere { radius } => vec![2.0 * radius],
        ShapeKind::Box { half_extents } => half_extents.iter().map(|half| 2.0 * half).collect(),
        ShapeKind::Capsule { radius, half_height } => {
            vec![2.0 * radius, 2.0 * (radius + half_height)]
        }
        ShapeKind::Cylinder { radius, half_height } => vec![2.0 * radius, 2.0 * half_height],
        ShapeKind::ConvexHull { points } => around(&mut points.iter().map(Vec::as_slice)),
        ShapeKind::Trimesh { vertices, .. } => {
            around(&mut vertices.iter().map(<[f64; 3]>::as_slice))
        }
        ShapeKind::Halfspace { .. } => return None,
    })
}

/// Returns the least extent of a shape with a volume; `None` for meshes and half-spaces. \[m\]
pub(super) fn thickness(shape: &Shape) -> Option<f64> {
    let solid = !matches!(shape.kind, ShapeKind::Trimesh { .. });
    extents(shape).filter(|_| solid)?.into_iter().reduce(f64::min)
}
