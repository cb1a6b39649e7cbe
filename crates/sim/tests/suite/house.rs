//! The house: no file of a crate imports one that imports it, by whatever way round.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// The modules of a crate by their paths, each with those that it imports.
type House = BTreeMap<Vec<String>, Vec<Vec<String>>>;

#[test]
fn modules_depend_in_one_direction() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut arrows = 0;
    for name in ["crates/solver", "crates/sim", "crates/cli", "bench"] {
        let texts = modules(&root.join(name).join("src"), &[]);
        let house = house(&texts);
        arrows += house.values().map(Vec::len).sum::<usize>();
        for module in house.keys() {
            assert_eq!(circle(&house, module), None, "{name}");
        }
    }
    assert!(arrows > 300, "{arrows} imports were found");
}

#[test]
fn a_circle_is_found() {
    let text = |path: &str, text: &str| (vec![path.to_owned()], text.to_owned());
    let a = text("a", "use std::fs;\nuse crate::b::{C, self};\n");
    let b = text("b", "/// use crate::d::E;\nuse super::{\n    c::D,\n};\n");
    let c = text("c", "use crate::a;\n\n#[cfg(test)]\nmod tests {\n}\n");
    let from = a.0.clone();
    let house_of = |texts: [_; 3]| house(&texts.into());
    let found = circle(&house_of([a.clone(), b.clone(), c]), &from);
    assert_eq!(found.as_deref(), Some("a -> b -> c -> a"));
    let tested = text("c", "\n#[cfg(test)]\nuse crate::a;\n");
    assert_eq!(circle(&house_of([a, b, tested]), &from), None);
}

/// The modules in a folder, by their paths, without its tests.
fn modules(folder: &Path, path: &[String]) -> BTreeMap<Vec<String>, String> {
    let mut texts = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let file = entry.expect("a file").path();
        let stem = file.file_stem().expect("a name").to_string_lossy().into_owned();
        let mut own = path.to_vec();
        own.push(stem.clone());
        if file.is_dir() {
            texts.extend(modules(&file, &own));
        } else if !["lib", "main", "tests"].contains(&stem.as_str()) {
            texts.insert(own, fs::read_to_string(&file).expect("a source"));
        }
    }
    texts
}

fn house(texts: &BTreeMap<Vec<String>, String>) -> House {
    let modules: BTreeSet<_> = texts.keys().collect();
    let own = texts.iter().map(|(module, text)| (module, imports(module, text, &modules)));
    let imports: BTreeMap<_, _> = own.collect();
    let used = |(module, paths): (&&Vec<String>, &Vec<Import>)| {
        // What is only handed on is not used.
        let paths = paths.iter().filter(|import| !import.handed_on);
        let homes = paths.filter_map(|import| home(&import.path, &imports));
        ((*module).clone(), homes.filter(|home| home != *module).collect())
    };
    let own: House = imports.iter().map(used).collect();
    // Who goes into a module may come to all below it, and to what these import from elsewhere.
    let all = |module: &Vec<String>| {
        let below = own.iter().filter(|(other, _)| other.starts_with(module));
        let out = below.flat_map(|(other, used)| {
            used.iter().filter(move |used| other == module || !used.starts_with(module))
        });
        out.cloned().collect()
    };
    own.keys().map(|module| (module.clone(), all(module))).collect()
}

/// What a module imports of its crate.
struct Import {
    /// From the root.
    path: Vec<String>,
    /// Whether others may import it from there.
    handed_on: bool,
}

fn imports(module: &[String], text: &str, modules: &BTreeSet<&Vec<String>>) -> Vec<Import> {
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let lines = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let text: Vec<&str> = lines.collect();
    let mut found = Vec::new();
    for statement in text.join("\n").split(";\n") {
        let lines: Vec<&str> = statement.lines().collect();
        let Some(start) = lines.iter().rposition(|line| starts_import(line)) else { continue };
        let handed_on = lines[start].starts_with("pub");
        if let Some((_, tree)) = lines[start..].concat().split_once("use ") {
            paths(tree.trim_end_matches(';'), &mut |path| {
                let path = from_root(path, module, modules);
                found.extend(path.map(|path| Import { path, handed_on }));
            });
        }
    }
    found
}

/// Whether a line begins an import of the whole module, not of one within.
fn starts_import(line: &str) -> bool {
    line.starts_with("use ") || line.starts_with("pub") && line.contains(" use ")
}

/// Calls `found` with each path of an import, braces resolved.
fn paths(tree: &str, found: &mut dyn FnMut(&str)) {
    let Some((before, rest)) = tree.split_once('{') else { return found(tree.trim()) };
    let inner = rest.rsplit_once('}').map_or(rest, |(inner, _)| inner);
    let (mut depth, mut start) = (0, 0);
    for (at, letter) in inner.char_indices().chain([(inner.len(), ',')]) {
        match letter {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                let item = inner[start..at].trim();
                if !item.is_empty() {
                    paths(&format!("{}{item}", before.trim()), found);
                }
                start = at + 1;
            }
            _ => {}
        }
    }
}

/// A path from the root, as a module writes it; none into another crate.
fn from_root(
    path: &str,
    module: &[String],
    modules: &BTreeSet<&Vec<String>>,
) -> Option<Vec<String>> {
    let names: Vec<&str> = path.split(" as ").next()?.split("::").map(str::trim).collect();
    let mut at = module.to_vec();
    match *names.first()? {
        "crate" => at.clear(),
        "super" | "self" => {}
        child => {
            at.push(child.to_owned());
            modules.get(&at)?;
            at.pop();
        }
    }
    for name in names {
        match name {
            "crate" | "self" => {}
            "super" => drop(at.pop()),
            name => at.push(name.to_owned()),
        }
    }
    Some(at)
}

/// The module that defines what a path leads to, which others may hand on; none if the root does.
fn home(path: &[String], imports: &BTreeMap<&Vec<String>, Vec<Import>>) -> Option<Vec<String>> {
    let depth = (1..=path.len()).rev().find(|&depth| imports.contains_key(&path[..depth].to_vec()));
    let module = path[..depth?].to_vec();
    let Some(name) = path.get(module.len()) else { return Some(module) };
    let handed = imports[&module].iter().find(|import| import.path.last() == Some(name));
    handed.map_or(Some(module), |import| home(&import.path, imports))
}

/// The way from a module back to it.
fn circle(house: &House, module: &Vec<String>) -> Option<String> {
    let mut way = vec![module];
    let found = comes_back(house, &mut way, &mut BTreeSet::new());
    found.then(|| way.iter().map(|module| module.join("::")).collect::<Vec<_>>().join(" -> "))
}

/// Goes on from the end of the `way` until it is back at its beginning, past what has been `seen`.
fn comes_back<'h>(
    house: &'h House,
    way: &mut Vec<&'h Vec<String>>,
    seen: &mut BTreeSet<&'h Vec<String>>,
) -> bool {
    let at = way[way.len() - 1];
    for next in &house[at] {
        way.push(next);
        if next == way[0] || seen.insert(next) && comes_back(house, way, seen) {
            return true;
        }
        way.pop();
    }
    false
}
