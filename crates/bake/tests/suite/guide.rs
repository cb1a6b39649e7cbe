//! Tests that the guide's pages on settings and on the findings of `check` agree with the code.

use std::collections::BTreeMap;
use std::path::Path;

use drystone::StepSettings;
use drystone_bake::check::{FindingKind, check};
use drystone_scene::json_schema;
use serde_json::Value;

const SETTINGS: &str = include_str!("../../../../guide/src/settings.md");
const TROUBLES: &str = include_str!("../../../../guide/src/troubleshooting.md");

/// Returns name and text of each section whose heading, of this level, is a name in code quotes.
fn sections(page: &str, level: &str) -> Vec<(String, String)> {
    let heading = format!("\n{level} `");
    let parts = page.split(&heading[..]).skip(1);
    let section = |part: &str| {
        let (name, text) = part.split_once("`\n").unwrap();
        let end = text.find("\n# ").unwrap_or(text.len());
        (name.to_owned(), text[..end].to_owned())
    };
    parts.map(section).collect()
}

/// Returns the rows of the table of settings: the name and the other cells.
fn rows() -> BTreeMap<String, Vec<String>> {
    let cells = |line: &str| -> Vec<String> {
        line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
    };
    let row = |line: &str| {
        let mut cells = cells(line);
        let link = cells.remove(0);
        let name = link.split('`').nth(1).unwrap().to_owned();
        assert_eq!(link, format!("[`{name}`](#{name})"));
        (name, cells)
    };
    SETTINGS.lines().filter(|line| line.starts_with("| [`")).map(row).collect()
}

fn fields(settings: &StepSettings) -> serde_json::Map<String, Value> {
    serde_json::to_value(settings).unwrap().as_object().unwrap().clone()
}

/// Returns the accepted range from the error of a scene with this setting.
fn refusal(name: &str, value: &str) -> String {
    let text = format!(r#"{{"solver": {{"{name}": {value}}}}}"#);
    drystone_bake::read_json(Path::new("scene.json"), &text).unwrap_err().accepted
}

/// The table states the unit, the values in the three presets and the range of each setting as the
/// code has them.
#[test]
fn every_setting_has_its_unit_its_presets_and_its_range() {
    let presets = [StepSettings::certified(), StepSettings::quality(), StepSettings::realtime()]
        .map(|of| fields(&of));
    let schema = json_schema();
    let described = &schema["$defs"]["StepSettings"]["properties"];
    let rows = rows();
    let names: Vec<_> = presets[0].keys().collect();
    assert_eq!(rows.keys().collect::<Vec<_>>(), names);
    for (name, cells) in &rows {
        let [unit, values @ .., accepted] = &cells[..] else { panic!("{name}: {cells:?}") };
        let description = described[name]["description"].as_str().unwrap();
        let stated = description.strip_suffix(']').and_then(|text| text.rsplit_once('['));
        assert_eq!(unit, stated.map_or("", |(_, unit)| unit), "unit of {name}");
        for (preset, shown) in presets.iter().zip(values) {
            let right = match &preset[name] {
                Value::Number(number) => {
                    number.as_f64().map(|x| x as f32) == shown.parse::<f32>().ok()
                }
                Value::String(word) => word == shown,
                Value::Bool(on) => shown.parse() == Ok(*on),
                _ => false,
            };
            assert!(right, "{name}: {shown}, not {}", preset[name]);
        }
        assert_eq!(refusal(name, "-1"), format!("accepted: {accepted}"), "range of {name}");
    }
}

/// Each setting has a section of its own.
#[test]
fn every_setting_has_a_section() {
    let mut names: Vec<_> = sections(SETTINGS, "###").into_iter().map(|(name, _)| name).collect();
    names.sort();
    assert_eq!(names, fields(&StepSettings::quality()).keys().cloned().collect::<Vec<_>>());
}

/// Each kind of finding has an entry with advice and a scene in which `check` finds it.
#[test]
fn every_finding_has_an_entry_with_a_scene_that_has_it() {
    let kinds = FindingKind::ALL.map(|kind| serde_json::to_value(kind).unwrap());
    let kinds: Vec<_> = kinds.iter().map(|kind| kind.as_str().unwrap()).collect();
    let entries = sections(TROUBLES, "##");
    let names: Vec<_> = entries.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, kinds);
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in &entries {
        let (language, block) = text.split_once("\n```").unwrap().1.split_once('\n').unwrap();
        let file = folder.path().join(format!("{name}.{language}"));
        std::fs::write(&file, block.split("```").next().unwrap()).unwrap();
        let read = drystone_bake::read(&file).unwrap();
        let found = check(&read, &StepSettings::certified()).unwrap();
        let found: Vec<_> = found.iter().map(|of| serde_json::to_value(of.kind).unwrap()).collect();
        assert!(found.contains(&Value::from(name.as_str())), "{name}: {found:?}");
        assert!(text.contains("**Do:**"), "{name} says nothing of what to do");
    }
}
