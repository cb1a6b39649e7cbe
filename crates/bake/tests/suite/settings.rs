//! Tests that the settings of a scene's table `solver` are those of a world.

use std::collections::BTreeMap;

use drystone::StepSettings;
use drystone_scene::json_schema;
use serde_json::Value;

/// Returns the comments of the fields of `StepSettings` in a source, by the names of the fields.
fn words(source: &str) -> BTreeMap<String, String> {
    let (_, after) = source.split_once("struct StepSettings {\n").unwrap();
    let (fields, _) = after.split_once("\n}\n").unwrap();
    let (mut all, mut comment) = (BTreeMap::new(), String::new());
    for line in fields.lines().map(str::trim) {
        if let Some(words) = line.strip_prefix("///") {
            comment += words;
        } else if let Some((name, _)) = line.trim_start_matches("pub ").split_once(": ") {
            all.insert(name.to_owned(), std::mem::take(&mut comment));
        }
    }
    all
}

/// The schema has the settings of a world with their defaults, and the sources have the same words
/// for each.
#[test]
fn the_schema_has_the_settings_of_a_world() {
    let schema = json_schema();
    let described = schema["$defs"]["StepSettings"]["properties"].as_object().unwrap();
    let defaults = described.iter().map(|(name, of)| (name.clone(), of["default"].clone()));
    let defaults = Value::Object(defaults.collect());
    assert_eq!(defaults, serde_json::to_value(StepSettings::default()).unwrap());
    let world = words(include_str!("../../../sim/src/settings.rs"));
    assert_eq!(world.len(), described.len());
    assert_eq!(words(include_str!("../../../scene/src/solver.rs")), world);
}
