//! The table `solver`: step settings by name that override a base.

use serde_json::{Map, Value};

use drystone::StepSettings;
use drystone_scene::format::nearest_known;
use drystone_scene::{Place, Scene, SceneError, SettingFault};

/// Names of [`ImpactLaw`](drystone::ImpactLaw), the only setting whose value is a word.
const IMPACT_LAWS: [&str; 3] = ["newton", "poisson", "reflections"];

/// Returns `base` with the settings of `table` in place of its own. A table with `substeps` but
/// without `max_substeps` sets both to that number.
pub(crate) fn merge(
    table: &Map<String, Value>,
    base: StepSettings,
) -> Result<StepSettings, SettingFault> {
    let mut merged = base;
    for (key, value) in table {
        merged = set(merged, key, value)?;
    }
    if table.contains_key("substeps") && !table.contains_key("max_substeps") {
        merged.max_substeps = merged.substeps;
    }
    Ok(merged)
}

fn set(settings: StepSettings, key: &str, value: &Value) -> Result<StepSettings, SettingFault> {
    let fault = |unknown, accepted| SettingFault { key: key.to_owned(), unknown, accepted };
    let Ok(Value::Object(mut all)) = serde_json::to_value(&settings) else {
        return Err(fault(false, "settings that can be written".to_owned()));
    };
    if !all.contains_key(key) {
        let known: Vec<_> = all.keys().collect();
        return Err(fault(true, nearest_known(key, &known)));
    }
    if let Some((_, min, max)) = StepSettings::RANGES.iter().find(|(name, ..)| *name == key) {
        let whole = all.get(key).is_some_and(Value::is_u64);
        let fits =
            value.as_f64().is_some_and(|x| *min <= x && x <= *max) && (!whole || value.is_u64());
        if !fits {
            let kind = if whole { "a whole number" } else { "a number" };
            return Err(fault(false, format!("accepted: {kind} from {min} to {max}")));
        }
    }
    let accepted = if all.get(key).is_some_and(Value::is_boolean) {
        "accepted: true or false".to_owned()
    } else {
        format!("accepted: {}", IMPACT_LAWS.map(|law| format!("\"{law}\"")).join(", "))
    };
    all.insert(key.to_owned(), value.clone());
    serde_json::from_value(Value::Object(all)).map_err(|_| fault(false, accepted))
}

/// Returns `base` with the settings of the scene's table `solver` in place of its own.
///
/// # Errors
/// If a setting does not exist or is out of range. In a scene read by [`read`](fn@crate::read),
/// this has been checked.
pub fn settings(scene: &Scene, base: StepSettings) -> Result<StepSettings, SceneError> {
    merge(&scene.solver, base).map_err(|fault| SceneError {
        file: "scene".into(),
        place: Place::Pointer(format!("/solver/{}", fault.key)),
        item: fault.item(),
        value: scene
            .solver
            .get(&fault.key)
            .filter(|_| !fault.unknown)
            .map_or_else(String::new, Value::to_string),
        accepted: fault.accepted,
        unreadable: false,
    })
}
