//! Deviation of convex pieces from a surface, measured along columns.

use parry3d::query::PointQuery;
use parry3d::shape::Triangle;

use super::Deviation;
use super::interior::{Interior, Stretch, point};
use super::pieces::{Hull, dot};
use drystone_scene::solid_mesh::{SolidMesh, unit};

/// Distance between columns, and minimum distance of points on them. \[size\]
const STEP: f64 = 1.0 / 128.0;
/// Distances up to this count as zero, because of rounding. \[size\]
const NEAR: f64 = 1e-6;

/// A piece with its planes and its bounding box.
struct BoundedPiece<'h> {
    hull: &'h Hull,
    planes: Vec<([f64; 3], f64)>,
    bounds: [[f64; 3]; 2],
}

impl BoundedPiece<'_> {
    /// Returns the interval of a column along y that is inside the piece.
    fn column(&self, x: f64, z: f64) -> Option<Stretch> {
        let [low, high] = self.bounds;
        if x < low[0] || x > high[0] || z < low[2] || z > high[2] {
            return None;
        }
        let [mut from, mut to] = [low[1], high[1]];
        for ([nx, ny, nz], offset) in &self.planes {
            let rest = offset - nx * x - nz * z;
            if *ny > 1e-9 {
                to = to.min(rest / ny);
            } else if *ny < -1e-9 {
                from = from.max(rest / ny);
            } else if rest < 0.0 {
                return None;
            }
        }
        (from < to).then_some([from, to])
    }

    /// Returns a lower bound of the distance of a point from the piece; at most 0 inside.
    fn at_least(&self, at: [f64; 3]) -> f64 {
        self.planes
            .iter()
            .fold(f64::NEG_INFINITY, |most, (normal, offset)| most.max(dot(*normal, at) - offset))
    }

    /// Returns the distance of a point outside the piece.
    fn distance(&self, at: [f64; 3]) -> f64 {
        let near = |triangle| {
            let [a, b, c] = self.hull.corners(triangle).map(point);
            f64::from(Triangle::new(a, b, c).distance_to_local_point(point(at), true))
        };
        self.hull.triangles.iter().map(near).fold(f64::INFINITY, f64::min)
    }
}

/// Returns the distance of a point from the nearest piece; 0 inside.
fn apart(parts: &[BoundedPiece<'_>], at: [f64; 3]) -> f64 {
    let mut nearest = f64::INFINITY;
    for part in parts {
        let least = part.at_least(at);
        if least <= NEAR {
            return 0.0;
        }
        if least < nearest {
            nearest = part.distance(at).min(nearest);
        }
    }
    nearest
}

/// Measures the deviation of pieces from a surface: lengths as fractions of its size, volumes as
/// fractions of its volume.
pub(super) fn measure(surface: &SolidMesh, interior: &Interior<'_>, pieces: &[Hull]) -> Deviation {
    let part = |hull| BoundedPiece { hull, planes: hull.planes(), bounds: hull.bounds() };
    let parts: Vec<_> = pieces.iter().map(part).collect();
    let mut memory = Vec::new();
    let outward = |hull: &Hull| hull.excess(interior, f64::INFINITY, &mut Vec::new()).0;
    let mut out = Deviation {
        outward: pieces.iter().map(outward).fold(0.0, f64::max),
        ..Deviation::default()
    };
    for corner in &surface.corners {
        out.inward = apart(&parts, unit(*corner)).max(out.inward);
    }
    let (mut solid, mut added, mut lost) = (0.0, 0.0, 0.0);
    let (mut inside, mut union) = (Vec::new(), Vec::new());
    let count = (1.0 / STEP) as i32;
    let places = || (0..count).map(|i| (f64::from(i) + 0.5) * STEP - 0.5);
    for x in places() {
        for z in places() {
            interior.column(x, z, &mut memory, &mut inside);
            union.clear();
            union.extend(parts.iter().filter_map(|part| part.column(x, z)));
            unite(&mut union);
            solid += length(&inside);
            let beyond = without(&union, &inside);
            added += length(&beyond);
            let distance = |y| interior.distance([x, y, z]);
            beyond.iter().for_each(|stretch| farthest(*stretch, distance, &mut out.outward));
            let missing = without(&inside, &union);
            lost += length(&missing);
            let distance = |y| apart(&parts, [x, y, z]);
            missing.iter().for_each(|stretch| farthest(*stretch, distance, &mut out.inward));
        }
    }
    if solid > 0.0 {
        (out.added, out.lost) = (added / solid, lost / solid);
    }
    out
}

/// Raises `most` to the largest distance on an interval. The distance changes by at most the path
/// along the column. The step is therefore longer where the distance is far below `most`.
fn farthest([from, to]: Stretch, distance: impl Fn(f64) -> f64, most: &mut f64) {
    let mut at = (from + 0.5 * STEP).min(0.5 * (from + to));
    while at < to {
        let here = distance(at);
        *most = here.max(*most);
        at += STEP.max(*most - here);
    }
}

/// Joins intervals that overlap or touch.
fn unite(stretches: &mut Vec<Stretch>) {
    stretches.sort_by(|a, b| a[0].total_cmp(&b[0]));
    stretches.dedup_by(|next, last| {
        let joins = next[0] <= last[1] + NEAR;
        if joins {
            last[1] = last[1].max(next[1]);
        }
        joins
    });
}

/// Returns the parts of `some` that are in none of `others`; both are sorted and disjoint.
fn without(some: &[Stretch], others: &[Stretch]) -> Vec<Stretch> {
    let mut out = Vec::new();
    for &[mut from, to] in some {
        for &[low, high] in others {
            if high <= from || low >= to {
                continue;
            }
            if low > from + NEAR {
                out.push([from, low]);
            }
            from = from.max(high);
        }
        if to > from + NEAR {
            out.push([from, to]);
        }
    }
    out
}

fn length(stretches: &[Stretch]) -> f64 {
    stretches.iter().map(|[from, to]| to - from).sum()
}
