//! [`VertexTrack`]: the places of the vertices of a mesh over time.

use std::fmt;

use schemars::JsonSchema;
use serde::Serialize;

/// Triangles whose area is less than this fraction of their squared sides have none. \[1\]
const FLAT: f64 = 1e-9;

/// Places of the vertices of a mesh over time: on straight lines between two times, held before the
/// first and after the last. Contacts on the mesh have the velocity of its surface.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "VertexTrack")]
pub struct VertexTrack {
    /// Times in ascending order, at least one. \[s\]
    pub times: Vec<f64>,
    /// Points for each time, as many and in the same order as the vertices of the mesh. \[m\]
    pub points: Vec<Vec<[f64; 3]>>,
}

/// Why a [`VertexTrack`] is refused.
#[derive(Clone, Debug, PartialEq)]
pub enum VertexTrackFault {
    /// There are no times, or not one list of points for each.
    Lists {
        /// Number of times.
        times: usize,
        /// Number of lists of points.
        points: usize,
    },
    /// A time is not above the one before, or not finite.
    Time {
        /// Its index.
        index: usize,
        /// Its value. \[s\]
        value: f64,
    },
    /// There are not as many points as vertices at a time.
    Count {
        /// Index of the time.
        index: usize,
        /// Number of vertices.
        expected: usize,
        /// Number of points.
        found: usize,
    },
    /// A coordinate is not finite.
    NotFinite {
        /// Index of the time.
        index: usize,
        /// Index of the point.
        point: usize,
    },
    /// A triangle has no area.
    Flat {
        /// Index of the triangle.
        triangle: usize,
        /// The time. \[s\]
        time: f64,
    },
}

impl fmt::Display for VertexTrackFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lists { times, points } => write!(
                f,
                "has {times} times and {points} lists of points; accepted: at least one time, and \
                 one list for each"
            ),
            Self::Time { index, value } => write!(
                f,
                "has {value} as time {index} [s]; accepted: finite times, each above the one before"
            ),
            Self::Count { index, expected, found } => write!(
                f,
                "has {found} points at time {index}; accepted: {expected}, the number of vertices"
            ),
            Self::NotFinite { index, point } => write!(
                f,
                "has point {point} at time {index} with a coordinate that is not finite; accepted: \
                 finite numbers"
            ),
            Self::Flat { triangle, time } => write!(
                f,
                "leaves triangle {triangle} without area at {time} s; accepted: triangles with an \
                 area at all times, or a mesh without this triangle"
            ),
        }
    }
}

type Vec3 = [f64; 3];

impl VertexTrack {
    /// Returns the points at `time` \[s\].
    ///
    /// # Panics
    /// If the track has no times, or not one list of points for each.
    pub fn at(&self, time: f64) -> Vec<Vec3> {
        let after = self.times.partition_point(|&key| key <= time);
        let i = after.saturating_sub(1);
        let j = after.min(self.times.len() - 1);
        let span = self.times[j] - self.times[i];
        let t = if span > 0.0 { (time - self.times[i]) / span } else { 0.0 };
        if t == 0.0 {
            return self.points[i].clone();
        }
        let between =
            |(p, q): (&Vec3, &Vec3)| [0, 1, 2].map(|axis| p[axis] + (q[axis] - p[axis]) * t);
        self.points[i].iter().zip(&self.points[j]).map(between).collect()
    }

    /// Returns the longest path of a point within `step` \[s\], and the index of the time at which
    /// it begins. \[m\]
    pub fn longest(&self, step: f64) -> (f64, usize) {
        let mut longest = (0.0, 0);
        for (index, (keys, times)) in self.points.windows(2).zip(self.times.windows(2)).enumerate()
        {
            let ([from, to], [start, end]) = (keys, times) else { continue };
            let part = (step / (end - start)).min(1.0);
            for (p, q) in from.iter().zip(to) {
                let path = length(minus(*q, *p)) * part;
                if path > longest.0 {
                    longest = (path, index);
                }
            }
        }
        longest
    }

    /// Refuses a track that does not fit a mesh.
    ///
    /// # Errors
    /// The lists do not fit each other or the mesh, a number is not finite, times do not ascend, or
    /// a triangle has no area at some time.
    pub fn check(&self, vertices: usize, triangles: &[[u32; 3]]) -> Result<(), VertexTrackFault> {
        let (times, points) = (self.times.len(), self.points.len());
        if times == 0 || times != points {
            return Err(VertexTrackFault::Lists { times, points });
        }
        let mut last = f64::NEG_INFINITY;
        for (index, (&value, points)) in self.times.iter().zip(&self.points).enumerate() {
            if !(value.is_finite() && value > last) {
                return Err(VertexTrackFault::Time { index, value });
            }
            last = value;
            let found = points.len();
            if found != vertices {
                return Err(VertexTrackFault::Count { index, expected: vertices, found });
            }
            let strange = |point: &Vec3| point.iter().any(|x| !x.is_finite());
            if let Some(point) = points.iter().position(strange) {
                return Err(VertexTrackFault::NotFinite { index, point });
            }
        }
        self.check_areas(triangles)
    }

    /// Refuses triangles that have no area at some time.
    fn check_areas(&self, triangles: &[[u32; 3]]) -> Result<(), VertexTrackFault> {
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(time) = self.flat(*corners) {
                return Err(VertexTrackFault::Flat { triangle, time });
            }
        }
        Ok(())
    }

    /// Returns the first time at which the triangle with these corners has no area, if there is
    /// one. \[s\]
    pub(crate) fn flat(&self, corners: [u32; 3]) -> Option<f64> {
        let at = |key: usize| {
            let points = &self.points[key];
            corners.map(|corner| points.get(corner as usize).copied().unwrap_or_default())
        };
        self.times.iter().enumerate().find_map(|(index, start)| {
            let next = (index + 1).min(self.times.len() - 1);
            let part = flat_at(at(index), at(next))?;
            Some(start + part * (self.times[next] - start))
        })
    }

    /// Returns the track between two times \[s\], with keys at both.
    ///
    /// # Panics
    /// Those of [`at`](Self::at).
    pub fn between(&self, [start, end]: [f64; 2]) -> Self {
        let inside = self.times.iter().copied().filter(|time| start < *time && *time < end);
        let mut times: Vec<f64> = [start].into_iter().chain(inside).chain([end]).collect();
        times.dedup();
        Self { points: times.iter().map(|time| self.at(*time)).collect(), times }
    }
}

/// Returns the part of the way between two places of a triangle at which it first has no area.
///
/// Its normal is a parabola in the part of the way. It vanishes only at a root of each coordinate.
fn flat_at(from: [Vec3; 3], to: [Vec3; 3]) -> Option<f64> {
    let sides = |part: f64| {
        let [a, b, c] = [0, 1, 2]
            .map(|i| [0, 1, 2].map(|axis| from[i][axis] + (to[i][axis] - from[i][axis]) * part));
        [minus(b, a), minus(c, a)]
    };
    let normal = |part: f64| {
        let [u, v] = sides(part);
        cross(u, v)
    };
    let is_flat = |part: &f64| {
        let [u, v] = sides(*part);
        length(cross(u, v)) <= FLAT * (dot(u, u) + dot(v, v))
    };
    let [start, middle, end] = [0.0, 0.5, 1.0].map(normal);
    let mut parts = vec![0.0, 1.0];
    for axis in 0..3 {
        // c + b t + a t^2 through the three values.
        let (c, half, all) = (start[axis], middle[axis], end[axis]);
        let a = 2.0 * (all - 2.0 * half + c);
        let b = all - c - a;
        if a != 0.0 {
            // The vertex stands for a double root that rounding has lifted.
            let (vertex, root) = (-0.5 * b / a, (b * b - 4.0 * a * c).max(0.0).sqrt() / (2.0 * a));
            parts.extend([vertex - root, vertex, vertex + root]);
        } else if b != 0.0 {
            parts.push(-c / b);
        }
    }
    parts.retain(|part| (0.0..=1.0).contains(part));
    parts.sort_unstable_by(f64::total_cmp);
    parts.into_iter().find(is_flat)
}

fn minus(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [Vec3; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];

    fn track(keys: &[[Vec3; 3]]) -> VertexTrack {
        let times = (0..keys.len()).map(|i| 0.5 * i as f64).collect();
        VertexTrack { times, points: keys.iter().map(|key| key.to_vec()).collect() }
    }

    fn check(track: &VertexTrack) -> Result<(), VertexTrackFault> {
        track.check(3, &[[0, 1, 2]])
    }

    /// Points are on straight lines between times, and held outside of them.
    #[test]
    fn points_are_on_straight_lines() {
        let raised = CORNERS.map(|[x, y, z]| [2.0 * x, y + 1.0, z]);
        let track = track(&[CORNERS, raised]);
        assert_eq!(check(&track), Ok(()));
        assert_eq!(track.at(-1.0), CORNERS);
        assert_eq!(track.at(9.0), raised);
        assert_eq!(track.at(0.125)[1], [1.25, 0.25, 0.0]);
        let (path, index) = track.longest(0.25);
        assert!((path - 0.5 * 2f64.sqrt()).abs() < 1e-12 && index == 0, "{path} m");
    }

    /// A triangle that turns over by straight lines has no area half way, although it has one at
    /// both ends.
    #[test]
    fn a_triangle_without_area_is_found_between_times() {
        let turned = [CORNERS[0], CORNERS[1], [0.0, 0.0, -3.0]];
        let fault = check(&track(&[CORNERS, turned]));
        let Err(VertexTrackFault::Flat { triangle: 0, time }) = fault else { panic!("{fault:?}") };
        assert!((time - 0.125).abs() < 1e-12, "{time} s");
        // It shrinks to a point, and grows again on the other side: a double root.
        let mirrored = CORNERS.map(|corner| corner.map(|x| -x));
        let fault = check(&track(&[CORNERS, mirrored]));
        let Err(VertexTrackFault::Flat { time, .. }) = fault else { panic!("{fault:?}") };
        assert!((time - 0.25).abs() < 1e-6, "{time} s");
    }

    /// Lists that do not fit, times that do not ascend, and numbers that are not finite are named.
    #[test]
    fn what_does_not_fit_is_named() {
        let good = track(&[CORNERS, CORNERS]);
        let changed = |change: &dyn Fn(&mut VertexTrack)| {
            let mut track = good.clone();
            change(&mut track);
            check(&track).unwrap_err()
        };
        let lists = VertexTrackFault::Lists { times: 1, points: 2 };
        assert_eq!(changed(&|track| track.times.truncate(1)), lists);
        let time = VertexTrackFault::Time { index: 1, value: 0.0 };
        assert_eq!(changed(&|track| track.times[1] = 0.0), time);
        let count = VertexTrackFault::Count { index: 1, expected: 3, found: 2 };
        assert_eq!(changed(&|track| track.points[1].truncate(2)), count);
        let strange = VertexTrackFault::NotFinite { index: 0, point: 2 };
        assert_eq!(changed(&|track| track.points[0][2][1] = f64::NAN), strange);
    }
}
