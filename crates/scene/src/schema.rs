//! The JSON Schema of Drystone's own scene format.

use serde_json::Value;

use super::document::SceneDocument;

/// Returns the JSON Schema (draft 2020-12) of the format, for editors and other programs.
///
/// It covers keys and types. Only [`read`](super::read) checks ranges that depend on other values.
pub fn json_schema() -> Value {
    let mut schema = schemars::schema_for!(SceneDocument).to_value();
    remove_null(&mut schema);
    plain(&mut schema);
    schema
}

/// Removes the backslashes by which doc comments escape the brackets around units.
fn plain(schema: &mut Value) {
    match schema {
        Value::Object(object) => {
            if let Some(Value::String(text)) = object.get_mut("description") {
                *text = text.replace("\\[", "[").replace("\\]", "]");
            }
            object.values_mut().for_each(plain);
        }
        Value::Array(items) => items.iter_mut().for_each(plain),
        _ => {}
    }
}

/// Removes null as a type: an absent value is omitted, and null is not accepted for it.
fn remove_null(schema: &mut Value) {
    let null = |value: &Value| value == "null" || value.get("type").is_some_and(|t| t == "null");
    if let Value::Object(object) = &mut *schema {
        for key in ["type", "anyOf"] {
            let Some(Value::Array(choices)) = object.get_mut(key) else { continue };
            choices.retain(|choice| !null(choice));
            let [only] = choices.as_slice() else { continue };
            let only = only.clone();
            object.remove(key);
            match only {
                Value::Object(inner) => object.extend(inner),
                name => _ = object.insert(key.to_owned(), name),
            }
        }
        object.values_mut().for_each(remove_null);
    } else if let Value::Array(items) = schema {
        items.iter_mut().for_each(remove_null);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::format::SCENE_KEYS;
    use crate::format::body::{BODY_KEYS, KEY_KEYS};
    use crate::format::joint::axis::{AXIS_KEYS, DRIVE_KEYS, MOTOR_KEYS, SPRING_KEYS};
    use crate::format::joint::coordinate::{NAMES, PARAMETRIC};
    use crate::format::joint::frames::FRAME_KEYS;
    use crate::format::joint::{BREAKING_KEYS, JOINT_KEYS};
    use crate::format::shape::{DECOMPOSITION_KEYS, SHAPE_KEYS, VERTEX_TRACK_KEYS};
    use crate::format::surface::{COLLISION_KEYS, COMBINE, MATERIAL_KEYS, SURFACE_VELOCITY_KEYS};

    fn keys_of(schema: &Value) -> BTreeSet<&str> {
        let properties = schema.get("properties").and_then(Value::as_object);
        properties.into_iter().flatten().map(|(key, _)| key.as_str()).collect()
    }

    fn set<'a>(keys: &[&'a str]) -> BTreeSet<&'a str> {
        keys.iter().copied().collect()
    }

    #[test]
    fn the_schema_has_the_keys_that_are_read() {
        let schema = json_schema();
        let of = |name: &str| keys_of(&schema["$defs"][name]);
        assert_eq!(keys_of(&schema), set(SCENE_KEYS));
        assert_eq!(of("Body"), set(BODY_KEYS));
        assert_eq!(of("Key"), set(KEY_KEYS));
        assert_eq!(of("Material"), set(MATERIAL_KEYS));
        assert_eq!(of("Collision"), set(COLLISION_KEYS));
        assert_eq!(of("SurfaceMotion"), set(SURFACE_VELOCITY_KEYS));
        assert_eq!(of("Decomposition"), set(DECOMPOSITION_KEYS));
        assert_eq!(of("VertexTrack"), set(VERTEX_TRACK_KEYS));
        assert_eq!(of("Frame"), set(FRAME_KEYS));
        assert_eq!(of("Breaking"), set(BREAKING_KEYS));
        assert_eq!(of("Axis"), set(AXIS_KEYS));
        assert_eq!(of("Spring"), set(SPRING_KEYS));
        assert_eq!(of("Motor"), set(MOTOR_KEYS));
        assert_eq!(of("Drive"), set(DRIVE_KEYS));
        let parametric = ["EllipticCone", "Gear", "Rack", "Screw", "Pulley"];
        for (name, (_, keys)) in parametric.into_iter().zip(PARAMETRIC) {
            assert_eq!(of(name), set(keys), "{name}");
        }
    }

    /// Asserts that a table of the schema has exactly these types, with these keys.
    fn assert_types(table: &Value, types: &[(&str, &[&str])]) {
        let variants = table["oneOf"].as_array().unwrap();
        assert_eq!(variants.len(), types.len());
        for (variant, (name, keys)) in variants.iter().zip(types) {
            assert_eq!(variant["properties"]["type"]["const"], *name);
            let all: BTreeSet<_> = keys_of(table).union(&keys_of(variant)).copied().collect();
            assert_eq!(all, set(keys), "{name}");
        }
    }

    #[test]
    fn the_schema_has_the_shapes_that_are_read() {
        assert_types(&json_schema()["$defs"]["Shape"], &SHAPE_KEYS);
    }

    #[test]
    fn the_schema_has_the_joints_that_are_read() {
        assert_types(&json_schema()["$defs"]["Joint"], &JOINT_KEYS);
    }

    /// The type "general" has every coordinate, in their order.
    #[test]
    fn general_joints_have_every_coordinate() {
        let (_, keys) = JOINT_KEYS.iter().find(|(name, _)| *name == "general").unwrap();
        let names: Vec<_> = keys.iter().filter(|key| NAMES.contains(key)).collect();
        assert_eq!(names, NAMES.iter().collect::<Vec<_>>());
    }

    #[test]
    fn the_schema_has_the_combinations_that_are_read() {
        let schema = json_schema();
        let variants = schema["$defs"]["Combine"]["oneOf"].as_array().unwrap();
        let names: Vec<_> = variants.iter().map(|v| v["const"].as_str().unwrap()).collect();
        assert_eq!(names, COMBINE.map(|(name, _)| name));
    }

    #[test]
    fn null_is_not_a_value() {
        assert!(!json_schema().to_string().contains("\"null\""));
    }

    #[test]
    fn units_are_written_plainly() {
        assert!(json_schema().to_string().contains("[m]"));
        assert!(!json_schema().to_string().contains("\\["));
    }

    #[test]
    fn keys_with_defaults_are_optional() {
        let schema = json_schema();
        assert_eq!(schema.get("required"), None);
        assert_eq!(schema["$defs"]["Body"].get("required"), None);
        assert_eq!(schema["$defs"]["Key"]["required"], serde_json::json!(["time"]));
    }
}
