//! Convex pieces of a surface: hulls are cut, joined and simplified.

use std::collections::{BTreeMap, BTreeSet};

use parry3d::math::Vector;
use parry3d::transformation::try_convex_hull;
use serde::{Deserialize, Serialize};

use super::interior::{Interior, point};
use drystone_scene::DecompositionOptions;
use drystone_scene::solid_mesh::{SolidMesh, unit};

/// Maximum size of the cells that faces are sampled in. \[size\]
const SPACING: f64 = 1.0 / 64.0;
/// Cell size for hulls that are only compared. \[size\]
const ROUGHLY: f64 = 1.0 / 16.0;
/// Simplification drops corners that are beyond the hull by less than this fraction of the
/// accuracy. \[1\]
const SIMPLER: f64 = 0.125;
/// Maximum number of corners of a simplified hull.
const CORNERS: usize = 128;
/// A mesh counts as convex, and keeps all corners, if its hull exceeds it by at most this. \[size\]
const CONVEX: f64 = 1e-5;

/// The excess of hulls over the surface is measured up to this multiple of the accuracy. \[1\]
pub(super) const FAR: f64 = 8.0;

pub(super) type Memory = Vec<(f64, i32)>;

/// A convex hull at unit size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Hull {
    pub(super) points: Vec<[f32; 3]>,
    /// Counter-clockwise seen from outside.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Hull {
    /// Returns the convex hull of points; `None` if they span no volume.
    pub(super) fn of(points: &[Vector]) -> Option<Self> {
        let mut points: Vec<[f32; 3]> =
            points.iter().map(|p| p.to_array().map(|x| x + 0.0)).collect();
        // The hull of nearly equal or nearly coplanar points may fail: retry on coarser grids.
        for grid in [1 << 22, 1 << 16, 1 << 13, 1 << 11] {
            let round = |x: f32| (x * grid as f32).round() / grid as f32;
            points.iter_mut().for_each(|point| *point = point.map(round));
            points.sort_by(|a, b| {
                a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2]))
            });
            points.dedup();
            let vectors: Vec<_> = points.iter().map(|p| Vector::from(*p)).collect();
            let Ok((points, triangles)) = try_convex_hull(&vectors) else { continue };
            let points: Vec<_> = points.iter().map(|p| p.to_array()).collect();
            let hull = Self { points, triangles };
            if hull.volume() > 1e-10 {
                return Some(hull);
            }
        }
        None
    }

    pub(super) fn corners(&self, triangle: &[u32; 3]) -> [[f64; 3]; 3] {
        triangle.map(|corner| self.points[corner as usize].map(f64::from))
    }

    /// Returns the unit normal of each face, and its distance from the origin.
    pub(super) fn planes(&self) -> Vec<([f64; 3], f64)> {
        let plane = |triangle| {
            let corners = self.corners(triangle);
            let area = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
            let length = dot(area, area).sqrt();
            let normal = area.map(|x| x / length);
            (length > 1e-12).then(|| (normal, dot(normal, corners[0])))
        };
        self.triangles.iter().filter_map(plane).collect()
    }

    pub(super) fn bounds(&self) -> [[f64; 3]; 2] {
        let all = |pick: fn(f64, f64) -> f64| {
            std::array::from_fn(|i| {
                self.points.iter().map(|p| f64::from(p[i])).reduce(pick).unwrap_or(0.0)
            })
        };
        [all(f64::min), all(f64::max)]
    }

    fn vectors(&self) -> impl Iterator<Item = Vector> {
        self.points.iter().map(|p| Vector::from(*p))
    }

    /// Returns true if all coordinates are finite and all indices are in range.
    pub(super) fn is_sound(&self) -> bool {
        let known = |corner: &u32| (*corner as usize) < self.points.len();
        self.triangles.iter().flatten().all(known)
            && self.points.iter().flatten().all(|x| x.is_finite())
    }

    pub(super) fn volume(&self) -> f64 {
        let origin = self.points.first().map_or([0.0; 3], |p| p.map(f64::from));
        let part = |triangle| {
            let [a, b, c] = self.corners(triangle).map(|p| sub(p, origin));
            dot(a, cross(b, c)) / 6.0
        };
        self.triangles.iter().map(part).sum()
    }

    /// Returns the largest distance by which the hull extends beyond the surface, and that point.
    /// Stops early once the distance exceeds `limit`. \[size\]
    pub(super) fn excess(
        &self,
        interior: &Interior<'_>,
        limit: f64,
        memory: &mut Memory,
    ) -> (f64, [f64; 3]) {
        self.excess_at(interior, SPACING, 2.0, limit, memory)
    }

    /// Returns the excess measured with coarse samples and without a limit.
    pub(super) fn reach(&self, interior: &Interior<'_>, memory: &mut Memory) -> (f64, [f64; 3]) {
        self.excess_at(interior, ROUGHLY, 1.0, f64::INFINITY, memory)
    }

    /// Returns the excess at sample points: the centers of cells of size `spacing` on each face,
    /// the middle of the hull, and points halfway between. Each side of a face has at least `least`
    /// cells.
    fn excess_at(
        &self,
        interior: &Interior<'_>,
        spacing: f64,
        least: f64,
        limit: f64,
        memory: &mut Memory,
    ) -> (f64, [f64; 3]) {
        let [low, high] = self.bounds();
        let middle = std::array::from_fn(|i| 0.5 * (low[i] + high[i]));
        let mut most = (0.0_f64, middle);
        let mut look = |at: [f64; 3]| {
            let excess = interior.excess(at, memory);
            if excess > most.0 {
                most = (excess, at);
            }
            most.0 > limit
        };
        if look(middle) {
            return most;
        }
        for triangle in &self.triangles {
            let corners = self.corners(triangle);
            // Rows of cells along the longest side.
            let side = |i: usize| sub(corners[(i + 1) % 3], corners[i]);
            let square = |i: usize| dot(side(i), side(i));
            let first = (1..3).fold(0, |best, i| if square(i) > square(best) { i } else { best });
            let [base, rise] = [side(first), side((first + 1) % 3)];
            let (length, normal) = (square(first).sqrt(), cross(base, rise));
            let height = dot(normal, normal).sqrt() / length.max(1e-12);
            let parts = |length: f64| (length / spacing).ceil().max(least);
            let rows = parts(height);
            for row in 0..rows as usize {
                let t = (row as f64 + 1.0 / 3.0) / rows;
                let across = parts(length * (1.0 - t));
                for column in 0..across as usize {
                    let s = (column as f64 + 0.5) / across * (1.0 - t);
                    let [from, top] = [corners[first], corners[(first + 2) % 3]];
                    let at: [f64; 3] =
                        std::array::from_fn(|k| from[k] * (1.0 - t) + top[k] * t + base[k] * s);
                    let between = std::array::from_fn(|k| 0.5 * (at[k] + middle[k]));
                    if look(at) || (row + column) % 2 == 0 && look(between) {
                        return most;
                    }
                }
            }
        }
        most
    }

    /// Returns the hull of a subset of the corners. None of the other corners is farther from it
    /// than `near`, unless that takes more than [`CORNERS`] corners. \[size\]
    fn simplified(&self, near: f64) -> Self {
        let all: Vec<Vector> = self.vectors().collect();
        let mut kept: BTreeSet<usize> = BTreeSet::new();
        for i in 0..3 {
            let along = |a: &usize, b: &usize| all[*a][i].total_cmp(&all[*b][i]);
            kept.extend((0..all.len()).min_by(along));
            kept.extend((0..all.len()).max_by(along));
        }
        loop {
            let points: Vec<Vector> = kept.iter().map(|i| all[*i]).collect();
            let Some(hull) = Self::of(&points) else {
                // The extreme corners along the axes are coplanar.
                return self.clone();
            };
            let mut beyond: Vec<(f64, usize)> = Vec::new();
            for (normal, offset) in hull.planes() {
                let height = |i: usize| dot(normal, all[i].to_array().map(f64::from)) - offset;
                let heights = (0..all.len()).map(|i| (height(i), i));
                let farthest = heights
                    .fold((near, usize::MAX), |best, of| if of.0 > best.0 { of } else { best });
                if farthest.1 != usize::MAX {
                    beyond.push(farthest);
                }
            }
            beyond.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let before = kept.len();
            for (_, corner) in beyond {
                if kept.len() < CORNERS {
                    kept.insert(corner);
                }
            }
            if kept.len() == before {
                return hull;
            }
        }
    }
}

/// Returns the hull of the whole surface if it stays within the accuracy.
pub(super) fn whole(surface: &SolidMesh, interior: &Interior<'_>, accuracy: f64) -> Option<Hull> {
    let points: Vec<_> = surface.corners.iter().map(|corner| point(unit(*corner))).collect();
    let hull = Hull::of(&points)?;
    let excess = hull.excess(interior, accuracy, &mut Memory::new()).0;
    match excess {
        ..=CONVEX => Some(hull),
        _ if excess <= accuracy => Some(hull.simplified(SIMPLER * accuracy)),
        _ => None,
    }
}

/// Returns the pieces of a surface; empty if cutting it fails.
pub(super) fn find(
    surface: &SolidMesh,
    interior: &Interior<'_>,
    options: &DecompositionOptions,
) -> Vec<Hull> {
    let leaves = super::cuts::leaves(surface, interior, options);
    let joined = join(leaves, interior, options.accuracy, options.pieces as usize);
    joined.iter().map(|hull| hull.simplified(SIMPLER * options.accuracy)).collect()
}

/// Joins hulls that touch as long as their common hull stays within `accuracy` of the surface,
/// least excess first. Then joins further hulls as long as there are more than `most`.
fn join(leaves: Vec<Hull>, interior: &Interior<'_>, accuracy: f64, most: usize) -> Vec<Hull> {
    let mut memory = Memory::new();
    let mut parts: Vec<Option<Hull>> = leaves.into_iter().map(Some).collect();
    let mut costs: BTreeMap<[usize; 2], f64> = BTreeMap::new();
    let limit = FAR * accuracy;
    let mut cost = |parts: &[Option<Hull>], [i, j]: [usize; 2], anywhere: bool| {
        let (one, other) = (parts[i].as_ref()?, parts[j].as_ref()?);
        let touching = touch(one.bounds(), other.bounds());
        let both = (touching || anywhere).then(|| joined(one, other))??;
        let excess = both.excess(interior, limit, &mut memory).0;
        let grown = both.volume() - one.volume() - other.volume();
        Some(if excess > limit { limit + grown.max(0.0) } else { excess })
    };
    for i in 0..parts.len() {
        for j in i + 1..parts.len() {
            if let Some(cost) = cost(&parts, [i, j], false) {
                costs.insert([i, j], cost);
            }
        }
    }
    loop {
        let count = parts.iter().flatten().count();
        let best =
            costs.iter().min_by(|a, b| a.1.total_cmp(b.1)).map(|(pair, cost)| (*pair, *cost));
        let Some(([i, j], least)) = best else {
            if count <= most {
                break;
            }
            // The rest does not touch, but is too many: allow any pair.
            let all = (0..parts.len()).flat_map(|i| (i + 1..parts.len()).map(move |j| [i, j]));
            costs = all.filter_map(|pair| Some((pair, cost(&parts, pair, true)?))).collect();
            if costs.is_empty() {
                break;
            }
            continue;
        };
        if least > accuracy && count <= most {
            break;
        }
        let both = parts[i].as_ref().zip(parts[j].as_ref()).and_then(|(a, b)| joined(a, b));
        costs.retain(|pair, _| !pair.contains(&i) && !pair.contains(&j));
        parts[i] = both;
        parts[j] = None;
        for other in (0..parts.len()).filter(|other| *other != i) {
            let pair = [i.min(other), i.max(other)];
            if let Some(cost) = cost(&parts, pair, false) {
                costs.insert(pair, cost);
            }
        }
    }
    parts.into_iter().flatten().collect()
}

fn joined(one: &Hull, other: &Hull) -> Option<Hull> {
    let points: Vec<Vector> = one.vectors().chain(other.vectors()).collect();
    Hull::of(&points)
}

/// Returns true if two boxes touch or overlap.
fn touch([low, high]: [[f64; 3]; 2], [from, to]: [[f64; 3]; 2]) -> bool {
    const SLACK: f64 = 1e-3;
    (0..3).all(|i| low[i] <= to[i] + SLACK && from[i] <= high[i] + SLACK)
}

pub(super) fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
