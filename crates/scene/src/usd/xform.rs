//! Reads the transforms of prims.

use super::super::error::SceneError;
use super::super::graph::math;
use super::super::graph::transform::split;
use super::super::graph::{FAR, TURN_SLACK};
use super::layer::Value;
use super::prims::Prim;
use super::stage::Stage;
use super::transform::{Op, Transform, XformKind, matrix};

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

/// Reads the transform of a prim relative to its parent.
pub(super) fn read(stage: &Stage<'_>, prim: &Prim) -> Result<Transform, SceneError> {
    const ORDER: &str = "xformOpOrder";
    let names: &[String] = match stage.value(prim, ORDER) {
        None => &[],
        Some(Value::Texts(names)) => names,
        Some(Value::Numbers(none)) if none.is_empty() => &[],
        Some(_) => return Err(stage.refuse(prim, ORDER, "a list of names")),
    };
    let mut transform = Transform::default();
    for name in names {
        if name == "!resetXformStack!" {
            transform = Transform { ops: Vec::new(), reset: true };
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
        if let Some(op) = op(stage, prim, name, *kind, inverse)? {
            transform.ops.push(op);
        }
    }
    let pose = transform.at(None);
    let numbers = pose.map.linear.iter().flatten().chain(&pose.map.shift);
    if !numbers.copied().all(|x| x.abs() <= FAR) {
        return Err(stage.refuse(prim, ORDER, &format!("coordinates and scales up to {FAR:e}")));
    }
    Ok(transform)
}

/// Reads an operation of a prim; `None` if it has no value.
fn op(
    stage: &Stage<'_>,
    prim: &Prim,
    name: &str,
    kind: XformKind,
    inverse: bool,
) -> Result<Option<Op>, SceneError> {
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
        XformKind::Matrix => "a matrix of translation, rotation and scale, with the last column \
                         0, 0, 0, 1"
            .to_owned(),
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
    Ok(Some(Op { kind, inverse, rest, samples }))
}
