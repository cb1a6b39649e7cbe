//! [`Vector`] and [`SymmetricMatrix`] of any size, zero included, and the two products of mechanics
//! that depend on the dimension: [`moment`] (r x f) and [`spin`] (omega x r).
//!
//! They use loops, not `array::from_fn`, whose closures are not always inlined;
//! [`lanes`](crate::lanes) depends on inlining.

use std::ops::{Add, AddAssign, Index, IndexMut, Mul, Neg, Sub, SubAssign};

use crate::{Cast, Real, Scalar};

/// A column vector of `N` numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct Vector<T, const N: usize>(pub [T; N]);

impl<T: Real, const N: usize> Vector<T, N> {
    /// The zero vector.
    pub const ZERO: Self = Self([T::ZERO; N]);
    /// Start value of sums of vectors ([`Real::NEG_ZERO`]).
    pub(crate) const NEG_ZERO: Self = Self([T::NEG_ZERO; N]);

    /// Returns the scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> T {
        let mut sum = T::NEG_ZERO;
        for i in 0..N {
            sum += self.0[i] * other.0[i];
        }
        sum
    }

    /// Returns the Euclidean length.
    #[inline(always)]
    pub fn length(self) -> T {
        self.dot(self).sqrt()
    }

    /// Returns the vector where `mask` is positive, else zero.
    #[inline(always)]
    pub fn only_if(mut self, mask: T) -> Self {
        for x in &mut self.0 {
            *x = mask.choose(*x, T::ZERO);
        }
        self
    }

    /// Applies `f` to each component.
    #[inline(always)]
    pub fn map<U: Real>(self, f: impl FnMut(T) -> U) -> Vector<U, N> {
        Vector(self.0.map(f))
    }

    /// Converts one [part](Cast::part) to another number type.
    #[inline(always)]
    pub(crate) fn part<U: Real>(&self, index: usize) -> Vector<U, N>
    where
        T: Cast<U>,
    {
        let mut out = Vector::ZERO;
        for i in 0..N {
            out.0[i] = self.0[i].part(index);
        }
        out
    }
}

impl<T: Scalar, const N: usize> Vector<T, N> {
    /// Converts to another number type.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> Vector<U, N> {
        self.part(0)
    }
}

impl<T: Real, const N: usize> Default for Vector<T, N> {
    fn default() -> Self {
        Self::ZERO
    }
}

impl<T, const N: usize> From<[T; N]> for Vector<T, N> {
    fn from(components: [T; N]) -> Self {
        Self(components)
    }
}

impl<T: Real, const N: usize> Add for Vector<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] += other.0[i];
        }
        self
    }
}

impl<T: Real, const N: usize> Sub for Vector<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] -= other.0[i];
        }
        self
    }
}

impl<T: Real, const N: usize> Neg for Vector<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for x in &mut self.0 {
            *x = -*x;
        }
        self
    }
}

impl<T: Real, const N: usize> Mul<T> for Vector<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, scale: T) -> Self {
        for x in &mut self.0 {
            *x = *x * scale;
        }
        self
    }
}

impl<T: Real, const N: usize> AddAssign for Vector<T, N> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Real, const N: usize> SubAssign for Vector<T, N> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<T, const N: usize> Index<usize> for Vector<T, N> {
    type Output = T;
    #[inline(always)]
    fn index(&self, i: usize) -> &T {
        &self.0[i]
    }
}

impl<T, const N: usize> IndexMut<usize> for Vector<T, N> {
    #[inline(always)]
    fn index_mut(&mut self, i: usize) -> &mut T {
        &mut self.0[i]
    }
}

/// A symmetric `N` x `N` matrix, stored by rows. Products read only the upper triangle, so half of
/// it need not be loaded from memory.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(transparent)]
pub struct SymmetricMatrix<T, const N: usize>(pub [Vector<T, N>; N]);

impl<T: Real, const N: usize> SymmetricMatrix<T, N> {
    /// The zero matrix.
    pub const ZERO: Self = Self([Vector::ZERO; N]);

    /// Returns the matrix with these diagonal entries.
    pub fn diagonal(entries: Vector<T, N>) -> Self {
        let mut matrix = Self::ZERO;
        for i in 0..N {
            matrix.0[i][i] = entries[i];
        }
        matrix
    }

    /// Returns the entry at this row and column.
    #[inline(always)]
    pub fn entry(&self, row: usize, column: usize) -> T {
        self.0[row.min(column)][row.max(column)]
    }

    /// Returns R D R^T, where `axes` are the columns of R.
    pub fn rotated(self, axes: &[Vector<T, N>; N]) -> Self {
        let mut rows = [Vector::ZERO; N];
        for i in 0..N {
            for j in 0..N {
                rows[i][j] = axes[j][i];
            }
        }
        self.seen_from(&rows)
    }

    /// Returns F D F^T, where `axes` are the rows of F: the tensor in a frame with these axes.
    #[inline(always)]
    pub fn seen_from(self, axes: &[Vector<T, N>; N]) -> Self {
        let mut out = Self::ZERO;
        for j in 0..N {
            let along = self * axes[j];
            for i in j..N {
                let entry = axes[i].dot(along);
                out.0[i][j] = entry;
                out.0[j][i] = entry;
            }
        }
        out
    }
}

impl<T: Scalar, const N: usize> SymmetricMatrix<T, N> {
    /// Converts to another number type.
    #[inline(always)]
    pub fn cast<U: Real>(&self) -> SymmetricMatrix<U, N> {
        let mut out = SymmetricMatrix::ZERO;
        for i in 0..N {
            out.0[i] = self.0[i].cast();
        }
        out
    }
}

impl<const N: usize> SymmetricMatrix<f64, N> {
    /// Returns the inverse of a positive definite matrix (Gauss-Jordan), or `None` if it is not
    /// positive definite to the rounding of `f32`. Zero rows (locked directions) stay zero.
    pub fn inverse(&self) -> Option<Self> {
        let (mut a, mut inverse) = (*self, Self::ZERO);
        for i in 0..N {
            if a.0[i] == Vector::ZERO {
                a.0[i][i] = 1.0;
            } else {
                inverse.0[i][i] = 1.0;
            }
        }
        for i in 0..N {
            let pivot = a.0[i][i];
            if pivot <= ROUNDING * self.0[i][i] || pivot.is_nan() {
                return None;
            }
            (a.0[i], inverse.0[i]) = (a.0[i] * (1.0 / pivot), inverse.0[i] * (1.0 / pivot));
            for j in 0..N {
                if j != i {
                    let factor = a.0[j][i];
                    (a.0[j], inverse.0[j]) =
                        (a.0[j] - a.0[i] * factor, inverse.0[j] - inverse.0[i] * factor);
                }
            }
        }
        Some(inverse)
    }

    /// Returns the eigenvalues and the eigenvectors, found by Jacobi's rotations.
    pub fn eigen(&self) -> (Vector<f64, N>, [Vector<f64, N>; N]) {
        let mut a = *self;
        let mut vectors = Self::diagonal(Vector([1.0; N])).0;
        for (p, q) in (0..SWEEPS).flat_map(|_| (0..N).flat_map(|p| (p + 1..N).map(move |q| (p, q))))
        {
            let across = a.0[p][q];
            if across == 0.0 {
                continue;
            }
            let theta = 0.5 * (a.0[q][q] - a.0[p][p]) / across;
            let tangent = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            let turn = |x: Vector<f64, N>, y: Vector<f64, N>| {
                (x * cosine - y * sine, x * sine + y * cosine)
            };
            (a.0[p], a.0[q]) = turn(a.0[p], a.0[q]);
            for row in &mut a.0 {
                (row[p], row[q]) =
                    (row[p] * cosine - row[q] * sine, row[p] * sine + row[q] * cosine);
            }
            (vectors[p], vectors[q]) = turn(vectors[p], vectors[q]);
        }
        (Vector(std::array::from_fn(|i| a.0[i][i])), vectors)
    }

    /// Returns the sum of f(eigenvalue) v v^T over the eigenvectors v.
    pub fn spectral(&self, f: impl Fn(f64) -> f64) -> Self {
        let (values, vectors) = self.eigen();
        let mut out = Self::ZERO;
        for (value, along) in values.0.into_iter().zip(vectors) {
            let scale = f(value);
            if scale != 0.0 {
                for (i, row) in out.0.iter_mut().enumerate() {
                    *row += along * (along[i] * scale);
                }
            }
        }
        out
    }

    /// Returns the pseudo-inverse (Moore and Penrose). Eigenvalues that are not positive, to the
    /// rounding of `f32`, are left out.
    pub fn pseudo_inverse(&self) -> Self {
        let (values, vectors) = self.eigen();
        let largest = values.0.into_iter().fold(0.0, f64::max);
        let mut inverse = Self::ZERO;
        for (value, along) in values.0.into_iter().zip(vectors) {
            if value > ROUNDING * largest {
                for (i, row) in inverse.0.iter_mut().enumerate() {
                    *row += along * (along[i] / value);
                }
            }
        }
        inverse
    }
}

/// Pivots below this fraction of their diagonal entry, and eigenvalues below this fraction of the
/// largest, count as zero: twice the rounding of `f32`. \[1\]
const ROUNDING: f64 = 2.4e-7;

/// Sweeps of Jacobi's rotations; they converge quadratically.
const SWEEPS: usize = 6;

impl<T: Real, const N: usize> Default for SymmetricMatrix<T, N> {
    fn default() -> Self {
        Self::ZERO
    }
}

impl<T: Real, const N: usize> Mul<Vector<T, N>> for SymmetricMatrix<T, N> {
    type Output = Vector<T, N>;
    #[inline(always)]
    fn mul(self, vector: Vector<T, N>) -> Vector<T, N> {
        let mut out = Vector::NEG_ZERO;
        for i in 0..N {
            for j in 0..N {
                out.0[i] += self.entry(i, j) * vector[j];
            }
        }
        out
    }
}

/// Returns r x f: the moment \[N m s\] of an impulse `f` at the lever arm `r` \[m\].
///
/// For (L, A) = (2, 1) it is r_x f_y - r_y f_x, for (3, 3) the cross product. Bodies with `A` = 0
/// do not rotate.
#[inline(always)]
pub fn moment<T: Real, const L: usize, const A: usize>(
    r: Vector<T, L>,
    f: Vector<T, L>,
) -> Vector<T, A> {
    let mut out = Vector::ZERO;
    match (L, A) {
        (2, 1) => out.0[0] = r[0] * f[1] - r[1] * f[0],
        (3, 3) => {
            for i in 0..A {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                out.0[i] = r[j] * f[k] - r[k] * f[j];
            }
        }
        _ => {}
    }
    out
}

/// Adds r x f for an impulse of size `f` along one axis.
#[inline(always)]
pub(crate) fn add_moment<T: Real, const L: usize, const A: usize>(
    r: Vector<T, L>,
    axis: usize,
    f: T,
    sum: &mut Vector<T, A>,
) {
    match (L, A) {
        (2, 1) if axis == 0 => sum.0[0] -= r[1] * f,
        (2, 1) => sum.0[0] += r[0] * f,
        (3, 3) => {
            let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
            sum.0[next] += r[last] * f;
            sum.0[last] -= r[next] * f;
        }
        _ => {}
    }
}

/// Returns omega x r: the velocity \[m/s\] that a rotation at `omega` \[rad/s\] adds at the lever
/// arm `r` \[m\].
#[inline(always)]
pub fn spin<T: Real, const L: usize, const A: usize>(
    omega: Vector<T, A>,
    r: Vector<T, L>,
) -> Vector<T, L> {
    let mut out = Vector::ZERO;
    match (L, A) {
        (2, 1) => {
            out.0[0] = -omega[0] * r[1];
            out.0[1] = omega[0] * r[0];
        }
        (3, 3) => {
            for i in 0..L {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                out.0[i] = omega[j] * r[k] - omega[k] * r[j];
            }
        }
        _ => {}
    }
    out
}
