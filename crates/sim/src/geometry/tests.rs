use super::random::Random;
use super::*;

fn touch(points: impl IntoIterator<Item = ([f32; 2], f32)>) -> ContactManifold<3> {
    let point = |(number, ([x, z], gap)): (usize, ([f32; 2], f32))| {
        let on_a = Vector([x, 0.0, z]);
        let on_b = Vector([x, -gap, z]);
        ManifoldPoint { on_a, on_b, gap, feature: number as u64 }
    };
    let points = points.into_iter().enumerate().map(point).collect();
    ContactManifold { normal: Vector([0.0, 1.0, 0.0]), points, ..ContactManifold::default() }
}

/// Returns twice the area of the convex hull of four points: that of a triangle, or that of the
/// quadrilateral between two diagonals.
fn area(points: &[ManifoldPoint<3>]) -> f32 {
    let at = |i: usize| points[i].on_a;
    let double = |[a, b, c, d]: [usize; 4]| {
        across(at(b) - at(a), at(d) - at(c), Vector([0.0, 1.0, 0.0])).abs()
    };
    let triangles = [[0, 1, 0, 2], [0, 1, 0, 3], [0, 2, 0, 3], [1, 2, 1, 3]];
    let diagonals = [[0, 1, 2, 3], [0, 2, 1, 3], [0, 3, 1, 2]];
    triangles.into_iter().chain(diagonals).map(double).fold(0.0, f32::max)
}

/// A patch keeps its width, down to an aspect ratio of 1:1000, at any size.
#[test]
fn a_slender_patch_keeps_its_width() {
    for size in [1e-3, 1.0, 100.0] {
        for slender in [1.0, 0.03, 0.001] {
            let width = size * slender;
            let corners = [[0.0, 0.0], [size, 0.0], [size, width], [0.0, width]];
            // Also with points on the long sides, as clipping leaves them.
            let middles = [[0.3 * size, 0.0], [0.6 * size, width]];
            for count in 0..=2 {
                let all = corners.iter().chain(&middles[..count]);
                let mut touch = touch(all.map(|at| (*at, -1e-6 * size)));
                touch.reduce();
                assert_eq!(touch.points.len(), 4);
                let kept = area(&touch.points) / (2.0 * size * width);
                assert!(kept > 0.99, "{kept} of {size} by {width}");
            }
        }
    }
}

/// A point that rounding has split is merged.
#[test]
fn points_at_one_position_merge() {
    let mut touch = touch([([0.0, 0.0], 0.1), ([1.0, 0.0], 0.2), ([1.0, 1e-6], 0.1)]);
    touch.reduce();
    let gaps: Vec<_> = touch.points.iter().map(|point| point.gap).collect();
    assert_eq!(gaps, [0.1, 0.1]);
}

/// The deepest point of a polygon is kept, with nearly the largest area that three other points can
/// add. The same points are kept if all depths change by rounding.
#[test]
fn the_deepest_point_and_the_area_are_kept() {
    let mut random = Random(5);
    for turn in 0..2000 {
        let count = 5 + turn % 12;
        let slender = [1.0, 0.1, 0.01][turn % 3];
        let lean = [random.number() * 0.1, random.number() * 0.1];
        let leans = turn % 2 == 0;
        let corners: Vec<_> = (0..count)
            .map(|i| {
                let angle =
                    (i as f32 + 0.4 * random.number()) / count as f32 * std::f32::consts::TAU;
                let at = [angle.cos(), slender * angle.sin()];
                (at, if leans { lean[0] * at[0] + lean[1] * at[1] } else { -1e-6 })
            })
            .collect();
        let mut kept = touch(corners.clone());
        let all = kept.points.clone();
        kept.reduce();
        assert_eq!(kept.points.len(), 4);
        let deepest = |points: &[ManifoldPoint<3>]| {
            points.iter().map(|p| p.gap).fold(f32::INFINITY, f32::min)
        };
        assert!(deepest(&kept.points) <= deepest(&all) + 5e-5);
        let first = kept.points[0];
        let mut most = 0.0f32;
        for i in 0..count {
            for j in 0..i {
                for k in 0..j {
                    most = most.max(area(&[first, all[i], all[j], all[k]]));
                }
            }
        }
        let part = area(&kept.points) / most;
        assert!(part > 0.7, "{part} of the area of {count} corners");
        if !leans {
            let mut shaken = touch(corners);
            shaken.points.iter_mut().for_each(|point| point.gap += 1e-7 * random.number());
            shaken.reduce();
            let names = |touch: &ContactManifold<3>| {
                touch.points.iter().map(|p| p.feature).collect::<Vec<_>>()
            };
            assert_eq!(names(&shaken), names(&kept));
        }
    }
}
