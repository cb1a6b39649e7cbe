//! Vectors of the audit, in `f64`.

pub(super) type Vec3 = [f64; 3];

pub(super) fn add(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] + b[i])
}

pub(super) fn minus(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(super) fn dot(a: Vec3, b: Vec3) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

pub(super) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

pub(super) fn norm(v: Vec3) -> f64 {
    dot(v, v).sqrt()
}

pub(super) fn scaled(v: Vec3, by: f64) -> Vec3 {
    v.map(|x| x * by)
}

/// Returns `None` for a zero vector, and for one that is not finite.
pub(super) fn unit(v: Vec3) -> Option<Vec3> {
    // Scaling first keeps squares from underflow.
    let most = v.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let v = scaled(v, 1.0 / most);
    let length = norm(v);
    (most > 0.0 && length.is_finite()).then(|| scaled(v, 1.0 / length))
}

/// Returns two unit vectors that are orthogonal to the unit vector `n` and to each other.
pub(super) fn tangents(n: Vec3) -> [Vec3; 2] {
    let least = (0..3).min_by(|&i, &j| n[i].abs().total_cmp(&n[j].abs())).unwrap_or(0);
    let axis = std::array::from_fn(|i| if i == least { 1.0 } else { 0.0 });
    let first = unit(cross(n, axis)).unwrap_or(axis);
    [first, cross(n, first)]
}
