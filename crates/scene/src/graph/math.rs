//! Vectors, quaternions (x, y, z, w) and 3×3 matrices (as three columns).

/// Vector.
pub type Vec3 = [f64; 3];
/// Quaternion x, y, z, w.
pub type Quat = [f64; 4];
/// Matrix, as three columns.
pub type Mat3 = [Vec3; 3];

/// Identity matrix.
pub const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// Rotation by zero.
pub const NO_TURN: Quat = [0.0, 0.0, 0.0, 1.0];

/// Returns a + b.
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Returns a - b.
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns s a.
pub fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// Returns a · b.
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns a × b.
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Returns |a|.
pub fn length(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// Returns the unit vector along `a`; `None` if its length is zero or not finite.
pub fn unit(a: Vec3) -> Option<Vec3> {
    let l = length(a);
    (l > 0.0 && l.is_finite()).then(|| scale(a, 1.0 / l))
}

/// Returns m v.
pub fn apply(m: Mat3, v: Vec3) -> Vec3 {
    add(add(scale(m[0], v[0]), scale(m[1], v[1])), scale(m[2], v[2]))
}

/// Returns a b.
pub fn mul(a: Mat3, b: Mat3) -> Mat3 {
    [apply(a, b[0]), apply(a, b[1]), apply(a, b[2])]
}

/// Returns the transpose.
pub fn transpose(m: Mat3) -> Mat3 {
    [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]]
}

/// Returns the determinant.
pub fn determinant(m: Mat3) -> f64 {
    dot(m[0], cross(m[1], m[2]))
}

/// Returns the inverse; `None` for a singular matrix.
pub fn inverse(m: Mat3) -> Option<Mat3> {
    let det = determinant(m);
    let rows = [cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])];
    let inverse = transpose(rows.map(|row| scale(row, 1.0 / det)));
    inverse.iter().flatten().all(|x| x.is_finite()).then_some(inverse)
}

/// Returns the matrix with this diagonal.
pub fn diagonal(s: Vec3) -> Mat3 {
    [[s[0], 0.0, 0.0], [0.0, s[1], 0.0], [0.0, 0.0, s[2]]]
}

/// Returns the product of two quaternions: the rotation `b`, then `a`.
pub fn quat_mul(a: Quat, b: Quat) -> Quat {
    [
        a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
        a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
        a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
        a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
    ]
}

/// Returns the conjugate: of a unit quaternion, the inverse rotation.
pub fn conjugate(q: Quat) -> Quat {
    [-q[0], -q[1], -q[2], q[3]]
}

/// Returns a · b.
pub fn quat_dot(a: Quat, b: Quat) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// Returns the unit quaternion along `q`; `None` if its length is zero or not finite.
pub fn quat_unit(q: Quat) -> Option<Quat> {
    let l = quat_dot(q, q).sqrt();
    (l > 1e-12 && l.is_finite()).then(|| q.map(|x| x / l))
}

/// Returns the product of two quaternions. If one is the identity, the other is taken with its bits.
pub fn quat_after(a: Quat, b: Quat) -> Quat {
    match (a, b) {
        (NO_TURN, turn) | (turn, NO_TURN) => turn,
        (a, b) => quat_mul(a, b),
    }
}

/// Returns the matrix of a unit quaternion.
pub fn rotation(q: Quat) -> Mat3 {
    let [x, y, z, w] = q;
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
        [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Rotates a vector by a unit quaternion.
pub fn turn(q: Quat, v: Vec3) -> Vec3 {
    apply(rotation(q), v)
}

/// Returns the unit quaternion of a rotation matrix.
pub fn from_rotation(m: Mat3) -> Quat {
    let [[m00, m10, m20], [m01, m11, m21], [m02, m12, m22]] = m;
    let trace = m00 + m11 + m22;
    let q = if trace > 0.0 {
        [m21 - m12, m02 - m20, m10 - m01, 1.0 + trace]
    } else if m00 >= m11 && m00 >= m22 {
        [1.0 + m00 - m11 - m22, m01 + m10, m02 + m20, m21 - m12]
    } else if m11 >= m22 {
        [m01 + m10, 1.0 + m11 - m00 - m22, m12 + m21, m02 - m20]
    } else {
        [m02 + m20, m12 + m21, 1.0 + m22 - m00 - m11, m10 - m01]
    };
    quat_unit(q).unwrap_or(NO_TURN)
}

/// Interpolates from `a` to `b` along the shorter arc, at `t` in 0..1.
pub fn slerp(a: Quat, b: Quat, t: f64) -> Quat {
    let d = quat_dot(a, b);
    let (b, d) = if d < 0.0 { (b.map(|x| -x), -d) } else { (b, d) };
    let (wa, wb) = if d > 0.9995 {
        (1.0 - t, t)
    } else {
        let angle = libm::acos(d.clamp(-1.0, 1.0));
        let s = libm::sin(angle);
        (libm::sin((1.0 - t) * angle) / s, libm::sin(t * angle) / s)
    };
    let [a0, a1, a2, a3] = a;
    let [b0, b1, b2, b3] = b;
    quat_unit([wa * a0 + wb * b0, wa * a1 + wb * b1, wa * a2 + wb * b2, wa * a3 + wb * b3])
        .unwrap_or(a)
}

/// Returns the unit quaternion along `q`; unchanged if its length is 1 up to rounding.
pub fn quat_as_written(q: Quat) -> Option<Quat> {
    if (quat_dot(q, q) - 1.0).abs() <= 8.0 * f64::EPSILON { Some(q) } else { quat_unit(q) }
}

/// Returns the eigenvalues of a symmetric matrix and the rotation from its principal axes, by ten
/// sweeps of Jacobi's method.
pub fn principal(matrix: Mat3) -> (Vec3, Quat) {
    let (mut m, mut axes) = (matrix, IDENTITY);
    for _ in 0..10 {
        for [p, q, r] in [[0_usize, 1, 2], [0, 2, 1], [1, 2, 0]] {
            let at = |i: usize, j: usize| m.get(j).and_then(|column| column.get(i)).copied();
            let (Some(pp), Some(qq), Some(pq)) = (at(p, p), at(q, q), at(p, q)) else { continue };
            if pq == 0.0 {
                continue;
            }
            // Rotation angle that makes this entry zero (Golub and Van Loan, 8.5.2).
            let ratio = (qq - pp) / (2.0 * pq);
            let tangent = ratio.signum() / (ratio.abs() + (1.0 + ratio * ratio).sqrt());
            let cos = 1.0 / (1.0 + tangent * tangent).sqrt();
            let sin = tangent * cos;
            let mut turn = [[0.0; 3]; 3];
            for (i, j, value) in [(p, p, cos), (q, q, cos), (p, q, sin), (q, p, -sin), (r, r, 1.0)]
            {
                if let Some(entry) = turn.get_mut(j).and_then(|column| column.get_mut(i)) {
                    *entry = value;
                }
            }
            m = mul(transpose(turn), mul(m, turn));
            axes = mul(axes, turn);
        }
    }
    ([m[0][0], m[1][1], m[2][2]], from_rotation(axes))
}

/// Returns the rotation that takes +y to a unit vector.
pub fn from_up([x, y, z]: Vec3) -> Quat {
    // For -y, any axis perpendicular to y will do.
    if y < -1.0 + 1e-9 {
        return [1.0, 0.0, 0.0, 0.0];
    }
    // The quaternion (y × n, 1 + y · n), normalized.
    let length = (2.0 * (1.0 + y)).sqrt();
    [z / length, 0.0, -x / length, (1.0 + y) / length]
}
