//! [`Transform`]: the transform of a prim relative to its parent, at the default time and over time.

use crate::graph::math::{self, Mat3, Quat, Vec3};
use crate::graph::transform::{Affine, split};

/// Kind of a transform operation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum XformKind {
    Translate,
    Scale,
    /// Rotation about these axes in turn. \[degree\]
    Rotate(&'static [usize]),
    Orient,
    Matrix,
}

/// One transform operation; its numbers are padded with zeros.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Op {
    pub(super) kind: XformKind,
    pub(super) inverse: bool,
    pub(super) rest: [f64; 16],
    /// Values by time code.
    pub(super) samples: Vec<(f64, [f64; 16])>,
}

/// Transform of a prim relative to its parent.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Transform {
    pub(super) ops: Vec<Op>,
    /// True if the transform is relative to the world (`!resetXformStack!`).
    pub(super) reset: bool,
}

/// A transform at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    pub(super) map: Affine,
    /// Rotation, not distorted by any scale.
    pub(super) turn: Quat,
    /// Linear part of the map without the rotation.
    pub(super) scale: Mat3,
}

impl Pose {
    pub(super) const REST: Self =
        Self { map: Affine::IDENTITY, turn: math::NO_TURN, scale: math::IDENTITY };

    /// Returns `self` after `inner`. If one of them is the identity, the other is taken without
    /// rounding.
    pub(super) fn after(&self, inner: &Self) -> Self {
        let linear = match (self.map.linear, inner.map.linear) {
            (math::IDENTITY, linear) | (linear, math::IDENTITY) => linear,
            (a, b) => math::mul(a, b),
        };
        let shift = match (self.map.linear, self.map.shift, inner.map.shift) {
            (_, shift, [0.0, 0.0, 0.0]) | (math::IDENTITY, [0.0, 0.0, 0.0], shift) => shift,
            (linear, shift, inner) => math::add(math::apply(linear, inner), shift),
        };
        let turn = match (self.turn, inner.turn) {
            (math::NO_TURN, turn) | (turn, math::NO_TURN) => turn,
            (a, b) => math::quat_unit(math::quat_mul(a, b)).unwrap_or(math::NO_TURN),
        };
        let scale = if self.scale == math::IDENTITY {
            inner.scale
        } else {
            math::mul(math::transpose(math::rotation(turn)), linear)
        };
        Self { map: Affine { linear, shift }, turn, scale }
    }

    pub(super) fn turned(turn: Quat) -> Self {
        let linear = if turn == math::NO_TURN { math::IDENTITY } else { math::rotation(turn) };
        Self { map: Affine { linear, shift: [0.0; 3] }, turn, scale: math::IDENTITY }
    }

    fn inverted(self) -> Option<Self> {
        let linear = math::inverse(self.map.linear)?;
        let shift = math::scale(math::apply(linear, self.map.shift), -1.0);
        let turn = math::conjugate(self.turn);
        let rigid = self.scale == math::IDENTITY;
        let scale = if rigid {
            math::IDENTITY
        } else {
            math::mul(math::transpose(math::rotation(turn)), linear)
        };
        Some(Self { map: Affine { linear, shift }, turn, scale })
    }
}

impl Transform {
    /// Returns the transform at a time code, or the default one without a code.
    pub(super) fn at(&self, code: Option<f64>) -> Pose {
        let steps = self.ops.iter().map(|op| op.at(code));
        steps.fold(Pose::REST, |pose, step| pose.after(&step))
    }

    /// Returns true if any sample differs from the default value.
    pub(super) fn moves(&self) -> bool {
        self.ops.iter().any(Op::moves)
    }

    /// Returns true if any operation has time samples.
    pub(super) fn has_keys(&self) -> bool {
        self.codes().next().is_some()
    }

    /// Returns true if a track through the keys gives the exact poses between them.
    pub(super) fn straight(&self) -> bool {
        let plain = |op: &Op| matches!(op.kind, XformKind::Translate | XformKind::Orient);
        let mut turned = false;
        self.ops.iter().all(|op| {
            // A translation inside a rotation that changes moves along an arc.
            let swings = turned && op.kind == XformKind::Translate;
            turned |= op.kind == XformKind::Orient && op.moves();
            !op.moves() && !swings || plain(op) && !swings && !op.inverse
        })
    }

    pub(super) fn codes(&self) -> impl Iterator<Item = f64> {
        self.ops.iter().flat_map(|op| op.samples.iter().map(|(code, _)| *code))
    }
}

impl Op {
    fn moves(&self) -> bool {
        self.samples.iter().any(|(_, value)| *value != self.rest)
    }

    fn at(&self, code: Option<f64>) -> Pose {
        let numbers = code.map_or(self.rest, |code| self.sample(code));
        let [a, b, c, d, ..] = numbers;
        let pose = match self.kind {
            XformKind::Translate => {
                Pose { map: Affine { linear: math::IDENTITY, shift: [a, b, c] }, ..Pose::REST }
            }
            XformKind::Scale => Pose {
                map: Affine { linear: math::diagonal([a, b, c]), shift: [0.0; 3] },
                turn: math::NO_TURN,
                scale: math::diagonal([a, b, c]),
            },
            XformKind::Orient => {
                Pose::turned(math::quat_as_written([b, c, d, a]).unwrap_or(math::NO_TURN))
            }
            XformKind::Rotate(axes) => {
                let angles = axes.iter().map(|axis| {
                    if axes.len() == 1 { a } else { numbers.get(*axis).copied().unwrap_or(0.0) }
                });
                axes.iter().zip(angles).fold(Pose::REST, |pose, (axis, angle)| {
                    let (sin, cos) =
                        (libm::sin(angle.to_radians() / 2.0), libm::cos(angle.to_radians() / 2.0));
                    let mut turn = [0.0, 0.0, 0.0, cos];
                    if let Some(part) = turn.get_mut(*axis) {
                        *part = sin;
                    }
                    Pose::turned(turn).after(&pose)
                })
            }
            XformKind::Matrix => {
                let (map, _) = matrix(&numbers);
                let (turn, size, shear) =
                    split(map.linear).unwrap_or((math::NO_TURN, [1.0; 3], 0.0));
                let rigid = shear < 1e-9 && size.iter().all(|s| (s - 1.0).abs() < 1e-9);
                let scale = if rigid {
                    math::IDENTITY
                } else {
                    math::mul(math::transpose(math::rotation(turn)), map.linear)
                };
                Pose { map, turn, scale }
            }
        };
        if self.inverse { pose.inverted().unwrap_or(Pose::REST) } else { pose }
    }

    /// Interpolates linearly between samples; held before the first and after the last.
    fn sample(&self, code: f64) -> [f64; 16] {
        let after = self.samples.partition_point(|(at, _)| *at <= code);
        let Some(before) = after.checked_sub(1) else {
            return self.samples.first().map_or(self.rest, |(_, value)| *value);
        };
        let Some((t0, a)) = self.samples.get(before) else { return self.rest };
        let Some((t1, b)) = self.samples.get(after) else { return *a };
        let t = (code - t0) / (t1 - t0);
        if t == 0.0 {
            return *a;
        }
        let mut mixed = [0.0; 16];
        if self.kind == XformKind::Orient {
            let ([aw, ax, ay, az, ..], [bw, bx, by, bz, ..]) = (a, b);
            let [x, y, z, w] = math::slerp([*ax, *ay, *az, *aw], [*bx, *by, *bz, *bw], t);
            mixed.iter_mut().zip([w, x, y, z]).for_each(|(to, from)| *to = from);
            return mixed;
        }
        for (to, (a, b)) in mixed.iter_mut().zip(a.iter().zip(b)) {
            *to = a + (b - a) * t;
        }
        mixed
    }
}

/// Splits a matrix in USD's convention (row vectors times matrix) into the affine map and the last
/// column.
pub(super) fn matrix(numbers: &[f64; 16]) -> (Affine, [f64; 4]) {
    let [a0, a1, a2, a3, b0, b1, b2, b3, c0, c1, c2, c3, t0, t1, t2, t3] = *numbers;
    let linear: [Vec3; 3] = [[a0, a1, a2], [b0, b1, b2], [c0, c1, c2]];
    (Affine { linear, shift: [t0, t1, t2] }, [a3, b3, c3, t3])
}
