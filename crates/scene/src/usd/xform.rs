//! Transforms of prims, at the default time and over time.

use super::super::error::SceneError;
use super::super::graph::math::{self, Mat3, Quat, Vec3};
use super::super::graph::transform::{Affine, split};
use super::super::graph::{FAR, TURN_SLACK};
use super::layer::Value;
use super::prims::Prim;
use super::stage::Stage;

/// Kind of a transform operation.
#[derive(Clone, Copy, Debug, PartialEq)]
enum XformKind {
    Translate,
    Scale,
    /// Rotation about these axes in turn. \[degree\]
    Rotate(&'static [usize]),
    Orient,
    Matrix,
}

const KINDS: [(&str, XformKind); 13] = [
    ("translate", XformKind::Translate),
    ("scale", XformKind::Scale),
    ("orient", XformKind::Orient),
    ("transform", XformKind::Matrix),
    ("rotateX", XformKind::Rotate(&[0])),
    ("rotateY", XformKind::Rotate(&[1])),
    ("rotateZ", XformKind::Rotate(&[2])),
    ("rotateXYZ", XformKind::Rotate(&[0, 1, 2])),
    ("rotateXZY", XformKind::Rotate(&[0, 2, 1])),
    ("rotateYXZ", XformKind::Rotate(&[1, 0, 2])),
    ("rotateYZX", XformKind::Rotate(&[1, 2, 0])),
    ("rotateZXY", XformKind::Rotate(&[2, 0, 1])),
    ("rotateZYX", XformKind::Rotate(&[2, 1, 0])),
];

/// One transform operation; its numbers are padded with zeros.
#[derive(Clone, Debug)]
struct Op {
    kind: XformKind,
    inverse: bool,
    rest: [f64; 16],
    /// Values by time code.
    samples: Vec<(f64, [f64; 16])>,
}

/// Transform of a prim relative to its parent.
#[derive(Clone, Debug, Default)]
pub(super) struct Transform {
    ops: Vec<Op>,
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
    pub(super) fn read(stage: &Stage<'_>, prim: &Prim) -> Result<Self, SceneError> {
        const ORDER: &str = "xformOpOrder";
        let names: &[String] = match stage.value(prim, ORDER) {
            None => &[],
            Some(Value::Texts(names)) => names,
            Some(Value::Numbers(none)) if none.is_empty() => &[],
            Some(_) => return Err(stage.refuse(prim, ORDER, "a list of names")),
        };
        let mut transform = Self::default();
        for name in names {
            if name == "!resetXformStack!" {
                transform = Self { ops: Vec::new(), reset: true };
                continue;
            }
            let (inverse, name) = match name.strip_prefix("!invert!") {
                Some(name) => (true, name),
                None => (false, name.as_str()),
            };
            let kind = name.strip_prefix("xformOp:").and_then(|rest| rest.split(':').next());
            let found = KINDS.iter().find(|(known, _)| Some(*known) == kind);
            let Some((_, kind)) = found else {
                let known: Vec<_> = KINDS.iter().map(|(known, _)| *known).collect();
                let accepted = format!("xformOp: and one of {}", known.join(", "));
                return Err(stage.refuse(prim, ORDER, &accepted));
            };
            // An operation without a value is ignored.
            if let Some(op) = Op::read(stage, prim, name, *kind, inverse)? {
                transform.ops.push(op);
            }
        }
        let pose = transform.at(None);
        let numbers = pose.map.linear.iter().flatten().chain(&pose.map.shift);
        if !numbers.copied().all(|x| x.abs() <= FAR) {
            return Err(stage.refuse(
                prim,
                ORDER,
                &format!("coordinates and scales up to {FAR:e}"),
            ));
        }
        Ok(transform)
    }

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
    fn read(
        stage: &Stage<'_>,
        prim: &Prim,
        name: &str,
        kind: XformKind,
        inverse: bool,
    ) -> Result<Option<Self>, SceneError> {
        let Some(rest) = stage.value(prim, name) else { return Ok(None) };
        let width = match kind {
            XformKind::Rotate([_]) => 1,
            XformKind::Translate | XformKind::Scale | XformKind::Rotate(_) => 3,
            XformKind::Orient => 4,
            XformKind::Matrix => 16,
        };
        let padded = |value: &Value| -> Option<[f64; 16]> {
            let numbers = match value {
                Value::Number(x) if width == 1 => std::slice::from_ref(x),
                Value::Tuple(numbers) if numbers.len() == width => numbers.as_slice(),
                _ => return None,
            };
            let mut all = [0.0; 16];
            all.iter_mut().zip(numbers).for_each(|(to, from)| *to = *from);
            if !all.iter().all(|x| x.abs() <= FAR) {
                return None;
            }
            match kind {
                XformKind::Orient => {
                    let [w, x, y, z, ..] = all;
                    let length = math::quat_dot([x, y, z, w], [x, y, z, w]).sqrt();
                    ((length - 1.0).abs() <= TURN_SLACK).then_some(all)
                }
                XformKind::Matrix => {
                    let (affine, last) = matrix(&all);
                    (last == [0.0, 0.0, 0.0, 1.0] && split(affine.linear).is_some()).then_some(all)
                }
                _ => Some(all),
            }
        };
        let accepted = || match kind {
            XformKind::Orient => "a quaternion (w, x, y, z) of length 1".to_owned(),
            XformKind::Matrix => {
                "a matrix of translation, rotation and scale, with the last column \
                             0, 0, 0, 1"
                    .to_owned()
            }
            _ => format!("{width} numbers up to {FAR:e}"),
        };
        let refuse = || stage.refuse(prim, name, &accepted());
        let rest = padded(rest).ok_or_else(refuse)?;
        let mut samples = Vec::new();
        let sampled = prim.properties.get(name).and_then(|p| p.samples.as_ref());
        for (code, value) in sampled.into_iter().flatten() {
            if *value != Value::Blocked {
                samples.push((*code, padded(value).ok_or_else(refuse)?));
            }
        }
        Ok(Some(Self { kind, inverse, rest, samples }))
    }

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
fn matrix(numbers: &[f64; 16]) -> (Affine, [f64; 4]) {
    let [a0, a1, a2, a3, b0, b1, b2, b3, c0, c1, c2, c3, t0, t1, t2, t3] = *numbers;
    let linear: [Vec3; 3] = [[a0, a1, a2], [b0, b1, b2], [c0, c1, c2]];
    (Affine { linear, shift: [t0, t1, t2] }, [a3, b3, c3, t3])
}
