//! Cuts a surface by planes across the axes, until the hull of each part is near the surface.
//!
//! The hull of a part is exact: the hull of the surface clipped to the box of the part, and of
//! those corners of the box that are inside the surface.

use parry3d::math::Vector;

use super::interior::{Interior, point};
use super::pieces::{FAR, Hull, Memory};
use drystone_scene::DecompositionOptions;
use drystone_scene::solid_mesh::{SolidMesh, normal, unit};

/// Maximum number of leaves: this many per allowed piece, plus a constant.
const LEAVES: [usize; 2] = [2, 32];
/// A leaf is cut until its hull exceeds the surface by at most this fraction of the accuracy. \[1\]
const NEARER: f64 = 0.75;
/// Maximum number of planes through corners of the surface that are tried across an axis.
const PLANES: usize = 16;
/// Number of planes across an axis whose harm is measured: those with the smallest hulls.
const TRIED: usize = 3;
/// A plane is good enough if it leaves less than this fraction of the harm. \[1\]
const HELPS: f64 = 0.6;
/// Minimum side length of a part. \[size\]
const THINNEST: f64 = 1e-3;
/// Corners of boxes are tested this far inside the box, since faces of the surface may coincide
/// with faces of the box. \[size\]
const INSET: f64 = 1e-5;
/// Components of the search directions are integers from -`REACH` to `REACH`. Hulls that are only
/// compared are reduced to the support points in these directions.
const REACH: i32 = 2;

type Point = [f64; 3];

/// A polygon of the surface, and its normal.
#[derive(Clone)]
struct Face {
    corners: Vec<Point>,
    normal: Point,
}

/// Part of the surface inside a box.
struct BoxPart {
    faces: Vec<Face>,
    low: Point,
    high: Point,
    hull: Option<Hull>,
    excess: f64,
}

/// Cuts a surface into parts, and returns the hulls of the parts.
pub(super) fn leaves(
    surface: &SolidMesh,
    interior: &Interior<'_>,
    options: &DecompositionOptions,
) -> Vec<Hull> {
    let face = |triangle| {
        let corners = surface.corners_of(triangle);
        let normal = normal(corners).map(|x| x as f64);
        Face { corners: corners.map(unit).to_vec(), normal }
    };
    let faces: Vec<_> = (0..surface.triangles.len()).map(face).collect();
    let mut memory = Memory::new();
    let limit = FAR * options.accuracy;
    let mut ripe = |mut part: BoxPart| {
        part.hull = Hull::of(&part.points(interior, &mut memory));
        part.excess =
            part.hull.as_ref().map_or(0.0, |hull| hull.excess(interior, limit, &mut memory).0);
        part
    };
    let mut parts = vec![ripe(BoxPart::new(faces))];
    let most = LEAVES[0] * options.pieces as usize + LEAVES[1];
    let mut uncut: Vec<BoxPart> = Vec::new();
    while parts.len() + uncut.len() < most {
        let volume = |part: &BoxPart| part.hull.as_ref().map_or(0.0, Hull::volume);
        let worst = (0..parts.len()).max_by(|a, b| {
            let (a, b) = (&parts[*a], &parts[*b]);
            a.excess
                .min(limit)
                .total_cmp(&b.excess.min(limit))
                .then(volume(a).total_cmp(&volume(b)))
        });
        let Some(worst) = worst.filter(|part| parts[*part].excess > NEARER * options.accuracy)
        else {
            break;
        };
        let part = parts.swap_remove(worst);
        match part.best_cut(interior, &mut Memory::new()) {
            Some((axis, at)) => parts.extend(part.cut(axis, at).map(&mut ripe)),
            None => uncut.push(part),
        }
    }
    parts.extend(uncut);
    parts.into_iter().filter_map(|part| part.hull).collect()
}

impl BoxPart {
    /// Makes a part with the bounding box of its faces.
    fn new(faces: Vec<Face>) -> Self {
        let all = |i: usize, pick: fn(f64, f64) -> f64| {
            faces.iter().flat_map(|face| &face.corners).map(|p| p[i]).reduce(pick).unwrap_or(0.0)
        };
        let low = std::array::from_fn(|i| all(i, f64::min));
        let high = std::array::from_fn(|i| all(i, f64::max));
        Self { faces, low, high, hull: None, excess: 0.0 }
    }

    /// Returns the corners of its faces, and the corners of its box that are inside the surface.
    fn points(&self, interior: &Interior<'_>, memory: &mut Memory) -> Vec<Vector> {
        let all = self.faces.iter().flat_map(|face| &face.corners);
        let mut points: Vec<Vector> = all.map(|at| point(*at)).collect();
        for corner in 0..8 {
            let upper = |i: usize| corner >> i & 1 == 1;
            let at: Point =
                std::array::from_fn(|i| if upper(i) { self.high[i] } else { self.low[i] });
            let inside = std::array::from_fn(|i| {
                let inset = INSET.min(0.25 * (self.high[i] - self.low[i]));
                if upper(i) { at[i] - inset } else { at[i] + inset }
            });
            if interior.contains(inside, memory) {
                points.push(point(at));
            }
        }
        points
    }

    /// Cuts the part by a plane across an axis, and returns both sides.
    fn cut(&self, axis: usize, at: f64) -> [Self; 2] {
        let side = |upper: bool| {
            let faces =
                self.faces.iter().filter_map(|face| face.clipped(axis, at, upper)).collect();
            let (mut low, mut high) = (self.low, self.high);
            if upper {
                low[axis] = at;
            } else {
                high[axis] = at;
            }
            Self { faces, low, high, hull: None, excess: 0.0 }
        };
        [false, true].map(side)
    }

    /// Returns the axis and the offset of the plane that leaves least harm. The harm of a hull is
    /// its volume times the distance by which it extends beyond the surface.
    ///
    /// Cutting a ring in half does not help at first: both halves together have the hull of the
    /// whole. If no plane is good enough, the choice is the best plane near the deepest point of
    /// the hollow, which helps in the end.
    fn best_cut(&self, interior: &Interior<'_>, memory: &mut Memory) -> Option<(usize, f64)> {
        let hull = self.hull.as_ref()?;
        let (reach, deepest) = hull.reach(interior, memory);
        let before = hull.volume() * reach;
        // Harm, axis and offset of the best plane through the hollow, and of the best plane
        // anywhere.
        let mut best: [Option<(f64, usize, f64)>; 2] = [None; 2];
        for axis in 0..3 {
            let extent = self.high[axis] - self.low[axis];
            let planes = self.planes(axis);
            let near = |at: &f64| (at - deepest[axis]).abs();
            let corner = planes.iter().copied().min_by(|a, b| near(a).total_cmp(&near(b)));
            let through = corner.filter(|at| near(at) < 0.05 * extent).unwrap_or(deepest[axis]);
            let mut cuts: Vec<(f64, f64, [Option<Hull>; 2])> = Vec::new();
            for at in planes.into_iter().chain([through]) {
                if at <= self.low[axis] + THINNEST || at >= self.high[axis] - THINNEST {
                    continue;
                }
                let hulls = self
                    .cut(axis, at)
                    .map(|part| Hull::of(&outermost(part.points(interior, memory))));
                let volumes = hulls.each_ref().map(|hull| hull.as_ref().map_or(0.0, Hull::volume));
                cuts.push((volumes[0] + volumes[1], at, hulls));
            }
            cuts.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut tried = 0;
            for (volume, at, hulls) in &cuts {
                let hollow = *at == through;
                tried += 1;
                if tried > TRIED && !hollow {
                    continue;
                }
                let harm = |hull: &Hull| hull.volume() * hull.reach(interior, memory).0;
                let harm = hulls.iter().flatten().map(harm).sum::<f64>() + 1e-3 * volume;
                for best in best.iter_mut().skip(usize::from(!hollow)) {
                    if best.is_none_or(|best| harm < best.0) {
                        *best = Some((harm, axis, *at));
                    }
                }
            }
        }
        let [hollow, any] = best;
        let best = any.filter(|best| best.0 < HELPS * before).or(hollow).or(any);
        best.map(|(_, axis, at)| (axis, at))
    }

    /// Returns the offsets of candidate planes across an axis.
    fn planes(&self, axis: usize) -> Vec<f64> {
        let (low, high) = (self.low[axis], self.high[axis]);
        let mut planes: Vec<f64> =
            self.faces.iter().flat_map(|face| &face.corners).map(|corner| corner[axis]).collect();
        planes.sort_by(f64::total_cmp);
        planes.dedup_by(|next, last| *next - *last < THINNEST);
        planes.retain(|at| *at > low + THINNEST && *at < high - THINNEST);
        if planes.len() > PLANES {
            let count = planes.len();
            planes = (0..PLANES).map(|i| planes[i * (count - 1) / (PLANES - 1)]).collect();
        } else {
            let even = [0.25, 0.5, 0.75].map(|part| low + (high - low) * part);
            planes.extend(even.iter().filter(|at| **at > low + THINNEST && **at < high - THINNEST));
        }
        planes
    }
}

impl Face {
    /// Returns the polygon on one side of a plane across an axis; `None` if it has no area there. A
    /// face in the plane belongs to the side of the solid that it bounds.
    fn clipped(&self, axis: usize, at: f64, upper: bool) -> Option<Self> {
        let sign = if upper { 1.0 } else { -1.0 };
        let height = |corner: &Point| sign * (corner[axis] - at);
        let heights = || self.corners.iter().map(height);
        let most = heights().fold(f64::NEG_INFINITY, f64::max);
        let least = heights().fold(f64::INFINITY, f64::min);
        if most == 0.0 && least == 0.0 {
            return (sign * self.normal[axis] < 0.0).then(|| self.clone());
        }
        if most <= 0.0 {
            return None;
        }
        if least >= 0.0 {
            return Some(self.clone());
        }
        let mut corners = Vec::with_capacity(self.corners.len() + 1);
        let ends = self.corners.iter().zip(self.corners.iter().cycle().skip(1));
        for (from, to) in ends {
            let (a, b) = (height(from), height(to));
            if a >= 0.0 {
                corners.push(*from);
            }
            if a * b < 0.0 {
                // Interpolate from the lower end, so that both sides get the same point.
                let [low, high, d, e] =
                    if from[axis] < to[axis] { [from, to, from, to] } else { [to, from, to, from] };
                let part = (at - d[axis]) / (e[axis] - d[axis]);
                let mut between: Point =
                    std::array::from_fn(|i| low[i] + (high[i] - low[i]) * part);
                between[axis] = at;
                corners.push(between);
            }
        }
        Some(Self { corners, normal: self.normal })
    }
}

/// Returns the support points in a fixed set of directions, or all points if they are few.
fn outermost(points: Vec<Vector>) -> Vec<Vector> {
    let across = 2 * REACH + 1;
    let count = (across * across * across) as usize;
    if points.len() <= 4 * count {
        return points;
    }
    let direction = |i: i32| {
        let along = [i % across, i / across % across, i / across / across];
        Vector::from(along.map(|x| (x - REACH) as f32))
    };
    let farthest = |i: i32| {
        let direction = direction(i);
        let by = |a: &&Vector, b: &&Vector| direction.dot(**a).total_cmp(&direction.dot(**b));
        points.iter().max_by(by).copied()
    };
    (0..count as i32).filter_map(farthest).collect()
}
