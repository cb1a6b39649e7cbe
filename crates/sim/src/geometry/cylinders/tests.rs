use super::*;
use crate::geometry::random::Random;
use crate::geometry::solid::Cuboid;

/// A function of a direction: a support function, or the gap along an axis from b to a. \[m\]
type Separates<'a> = &'a dyn Fn([f64; 3]) -> f64;

fn wide(of: Vec3) -> [f64; 3] {
    of.0.map(f64::from)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

/// Returns the extent of a cylinder along a unit vector, from the origin, in double precision.
fn extent(of: &PosedCylinder, n: [f64; 3]) -> f64 {
    let along = dot(wide(of.axis), n);
    let across: [f64; 3] = std::array::from_fn(|i| n[i] - along * wide(of.axis)[i]);
    let around =
        f64::from(of.half) * along.abs() + f64::from(of.radius) * dot(across, across).sqrt();
    dot(wide(of.center), n) + around
}

/// Searches the largest gap along any axis. Where it is positive, there is a single maximum.
fn most(separates: Separates<'_>) -> f64 {
    let unit = |n: [f64; 3]| n.map(|x| x / dot(n, n).sqrt());
    let mut best = (f64::NEG_INFINITY, [1.0, 0.0, 0.0]);
    for i in 0..100 {
        let z = (i as f64 + 0.5) / 50.0 - 1.0;
        let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
        let n = [(1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z];
        if separates(n) > best.0 {
            best = (separates(n), n);
        }
    }
    // Random directions can follow ridges.
    let (mut random, mut step) = (Random(1), 0.2);
    while step > 1e-8 {
        let start = best.0;
        for _ in 0..20 {
            let way = wide(random.vector());
            let n = unit(std::array::from_fn(|i| best.1[i] + step * way[i]));
            if separates(n) > best.0 {
                best = (separates(n), n);
            }
        }
        if best.0 == start {
            step *= 0.7;
        }
    }
    best.0
}

fn placed(random: &mut Random, sizes: [f32; 2], spread: f32) -> PosedCylinder {
    let axes = loop {
        let (x, y) = (random.vector(), random.vector());
        let z: Vec3 = moment(x, y);
        if z.length() > 0.1 {
            let (x, z) = (x * (1.0 / x.length()), z * (1.0 / z.length()));
            break [x, moment(z, x), z];
        }
    };
    let frame = Frame { position: random.vector() * spread, axes };
    Cylinder { radius: sizes[0], half_height: sizes[1] }.placed(&frame)
}

/// Aligns a cylinder with an axis of the world, with a small lean, as resting bodies are.
fn settled(random: &mut Random, of: PosedCylinder) -> PosedCylinder {
    let i = (random.number().abs() * 3.0) as usize % 3;
    let lean = 10.0f32.powf(-3.5 + 3.0 * random.number());
    let axis = Vector(std::array::from_fn(|j| f32::from(i == j))) + random.vector() * lean;
    let axis = axis * (1.0 / axis.length());
    let side = of.side - axis * axis.dot(of.side);
    PosedCylinder { axis, side: side * (1.0 / side.length()), ..of }
}

/// Checks a contact against the exact shapes. Its points are on both surfaces, no gap is smaller
/// than reported, and the deepest point is as deep as the overlap.
fn check(
    what: &str,
    [a, b]: [Separates<'_>; 2],
    (gap, touch): (f32, &ContactManifold<3>),
    size: f32,
    prediction: f32,
) -> [bool; 2] {
    let exact = most(&|n| -a(n.map(|x| -x)) - b(n)) as f32;
    let close = 1e-4 * size + 2e-3 * prediction;
    let searched = 3e-3 * size;
    for point in &touch.points {
        let own = touch.normal.dot(point.on_a - point.on_b);
        assert!((own - point.gap).abs() < 1e-5 * size, "{what}: {own} and {point:?}");
        assert!(point.gap <= prediction, "{what}: {point:?}");
        for (surface, on, sign) in [(a, point.on_a, -1.0), (b, point.on_b, 1.0)] {
            let normal = wide(touch.normal).map(|x| x * sign);
            let out = most(&|n| dot(n, wide(on)) - surface(n)) as f32;
            let inside = -(dot(normal, wide(on)) - surface(normal)) as f32;
            // Points of a leaning shape may be farther behind the surface than the deepest, but not
            // outside.
            assert!(
                out < 3e-4 * size + (-point.gap).max(0.0),
                "{what}: {out} outside, {inside} behind, {point:?} {touch:?}"
            );
        }
    }
    if touch.points.is_empty() {
        assert!(exact > prediction - searched, "{what}: {exact} apart, and nothing touches");
        return [false, false];
    }
    assert!((touch.normal.length() - 1.0).abs() < 1e-5, "{what}: {:?}", touch.normal);
    // The deepest pair of points is no farther apart than the gap along the normal, so no nearer
    // pair exists.
    let deepest = touch.points.iter().map(|point| point.gap).fold(f32::INFINITY, f32::min);
    let separated = -a(wide(-touch.normal)) - b(wide(touch.normal));
    let far = (f64::from(deepest) - separated) as f32;
    let overlap = (-exact).max(0.0);
    let deep = overlap > 0.01 * size;
    assert!(deep || far < close + 0.5 * overlap, "{what}: {deepest}, not {separated}; {touch:?}");
    assert!(deep || gap <= deepest + close, "{what}: {gap} and {deepest}; {touch:?}");
    // Another axis may have nearly the least overlap; where the overlap is shallow, it is not much
    // deeper.
    let most = if !deep { 1.5 * overlap + searched } else { f32::INFINITY };
    assert!(deepest > -most, "{what}: {deepest} of {exact}");
    [true, touch.points.len() > 1]
}

const SIZES: [[f32; 2]; 5] = [[0.3, 0.4], [0.5, 0.01], [0.02, 1.0], [0.4, 0.4], [1.0, 0.1]];

fn count(turns: usize, mut one: impl FnMut(usize, &mut Random) -> [bool; 2]) {
    let mut random = Random(9);
    let (mut near, mut several) = (0, 0);
    for turn in 0..turns {
        let [touches, more] = one(turn, &mut random);
        near += usize::from(touches);
        several += usize::from(more);
    }
    assert!(near > turns / 10 && several > turns / 50, "{near} and {several} of {turns}");
}

#[test]
fn contacts_with_boxes_are_exact() {
    let mut clipper = Clipper::default();
    count(300, |turn, random| {
        let sizes = SIZES[turn % 5];
        let mut cylinder = placed(random, sizes, 1.2);
        if turn % 2 == 0 {
            cylinder = settled(random, cylinder);
        }
        let half = [[0.4, 0.3, 0.5], [1.0, 0.02, 0.7]][turn / 5 % 2];
        let cuboid = Cuboid(Vector(half));
        let around = |n: [f64; 3]| (0..3).map(|i| f64::from(half[i]) * n[i].abs()).sum::<f64>();
        let mut touch = ContactManifold::default();
        let gap = on_solid(&cylinder, &cuboid, 0.1, None, &mut clipper, &mut touch);
        let size = cylinder.size() + 0.7;
        let what = format!("{turn}: {cylinder:?}");
        check(&what, [&|n| extent(&cylinder, n), &around], (gap, &touch), size, 0.1)
    });
}

#[test]
fn contacts_with_rounded_shapes_are_exact() {
    count(300, |turn, random| {
        let mut cylinder = placed(random, SIZES[turn % 5], 0.9);
        if turn % 2 == 0 {
            cylinder = settled(random, cylinder);
        }
        let half = if turn / 5 % 3 == 0 { 0.0 } else { 0.4 };
        let ends = [Vector([0.0, -half, 0.0]), Vector([0.0, half, 0.0])];
        let round = RoundedCore { ends, radius: 0.2 };
        let around = |n: [f64; 3]| f64::from(half) * n[1].abs() + 0.2 * dot(n, n).sqrt();
        let mut touch = ContactManifold::default();
        let gap = on_round(&cylinder, &round, 0.1, &mut touch);
        let what = format!("{turn}: {cylinder:?} and {round:?}");
        check(&what, [&|n| extent(&cylinder, n), &around], (gap, &touch), 1.0, 0.1)
    });
}

#[test]
fn contacts_between_cylinders_are_exact() {
    count(300, |turn, random| {
        let [mut a, mut b] = [turn % 5, turn / 5 % 5].map(|of| placed(random, SIZES[of], 0.9));
        if turn % 2 == 0 {
            a = settled(random, a);
            b = settled(random, b);
        }
        let mut touch = ContactManifold::default();
        let gap = between(&a, &b, 0.1, None, &mut touch);
        let what = format!("{turn}: {a:?} and {b:?}");
        let size = a.size() + b.size();
        check(&what, [&|n| extent(&a, n), &|n| extent(&b, n)], (gap, &touch), size, 0.1)
    });
}

/// A leaning coin touches a plane at its deepest point, which keeps its feature all the way around.
/// A lying cylinder touches below its axis with both ends.
#[test]
fn the_deepest_point_is_exact_and_keeps_its_feature() {
    let plane = Plane { point: Vector::ZERO, normal: Vector([0.0, 1.0, 0.0]) };
    let mut before = None;
    for degree in 0..720 {
        let (sin, cos) = (degree as f32).to_radians().sin_cos();
        let (tilt, up) = 0.3f32.sin_cos();
        // The coin leans towards (cos, sin); its `side` does not follow.
        let axis = Vector([tilt * cos, up, tilt * sin]);
        let side = Vector([up, -tilt * cos, 0.0]);
        let side = side * (1.0 / side.length());
        let center = Vector([3.0, 0.01 * up + 0.1 * tilt, 1.0]);
        let coin = PosedCylinder { center, axis, side, radius: 0.1, half: 0.01 };
        let mut touch = ContactManifold::default();
        let gap = on_plane(&coin, &plane, 0.001, before, &mut touch);
        // With two points beside the deepest, on which it comes down as it wobbles.
        assert!(gap.abs() < 1e-6 && touch.points.len() == 3, "{degree}: {gap} {touch:?}");
        let name = touch.points[0].feature;
        assert!(before.is_none_or(|before| before == name), "{degree}: {before:?} and {name}");
        before = Some(name);
        let lowest = center + axis * -0.01 + Vector([up * cos, -tilt, up * sin]) * 0.1;
        assert!((touch.points[0].on_a - lowest).length() < 1e-6, "{degree}: {touch:?}");
    }
    for angle in [0.0f32, 0.7, 2.0] {
        let (side, axis) = (Vector([angle.cos(), angle.sin(), 0.0]), Vector([0.0, 0.0, 1.0]));
        let log =
            PosedCylinder { center: Vector([0.0, 0.1, 0.0]), axis, side, radius: 0.1, half: 0.5 };
        let mut touch = ContactManifold::default();
        on_plane(&log, &plane, 0.001, None, &mut touch);
        assert_eq!(touch.points.len(), 2);
        assert!(touch.points.iter().all(|point| point.on_a[0] == 0.0 && point.gap == 0.0));
    }
}

/// If a cylinder stands over the edge of a box, its cap is clipped at the edge.
#[test]
fn a_cap_over_an_edge_is_clipped() {
    let (mut clipper, mut touch) = (Clipper::default(), ContactManifold::default());
    let frame = Frame { position: Vector([0.95, 0.6, 0.0]), ..Frame::IDENTITY };
    let can = Cylinder { radius: 0.1, half_height: 0.1 }.placed(&frame);
    on_solid(&can, &Cuboid(Vector([1.0, 0.5, 1.0])), 0.02, None, &mut clipper, &mut touch);
    assert_eq!(touch.points.len(), 4);
    let extent = |i: usize| {
        let all = touch.points.iter().map(|point| point.on_a[i]);
        all.clone().fold(f32::MIN, f32::max) - all.fold(f32::MAX, f32::min)
    };
    assert!(extent(0) > 0.14 && extent(2) > 0.17, "{:?}", touch.points);
}
