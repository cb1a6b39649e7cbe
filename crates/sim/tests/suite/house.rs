//! Tests that the modules of a crate depend on each other in one direction: no file imports another
//! that imports it, directly or through others.
//!
//! A path through the crate root counts as an import of the file whose item the root re-exports. A
//! call of a method counts as an import of the file that has it, if that is not the file of its
//! type.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The modules of a crate by their paths, each with those that it imports.
type House = BTreeMap<Vec<String>, Vec<Vec<String>>>;

/// No crate has a cycle of imports, among more than 300 that are found.
#[test]
fn modules_depend_in_one_direction() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut arrows = 0;
    for name in
        ["crates/solver", "crates/sim", "crates/scene", "crates/bake", "crates/cli", "bench"]
    {
        let texts = modules(&root.join(name).join("src"), &[]);
        let house = house(&texts);
        arrows += house.values().map(Vec::len).sum::<usize>();
        let circles: Vec<_> = house.keys().filter_map(|module| circle(&house, module)).collect();
        assert_eq!(circles, [""; 0], "{name}");
    }
    assert!(arrows > 300, "{arrows} imports were found");
}

/// Scenes depend on no crate of ours and not on parry. The solver has three dependencies, all
/// optional; worlds have six, and one that is optional. The command line knows no shapes.
#[test]
fn crates_depend_on_no_more_than_they_say() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let dependencies = |name: &str| -> Vec<String> {
        let text = fs::read_to_string(root.join(name).join("Cargo.toml")).expect("a manifest");
        let (_, list) = text.split_once("\n[dependencies]\n").expect("dependencies");
        let lines = list.lines().take_while(|line| !line.starts_with('['));
        let names = lines.filter_map(|line| line.split(['.', ' ']).next());
        names.filter(|name| !name.is_empty()).map(str::to_owned).collect()
    };
    let ours = |name: &String| name.starts_with("drystone") || name.starts_with("parry");
    assert!(!dependencies("scene").iter().any(ours));
    let all = ["drystone-solver", "libm", "parry2d", "parry3d", "robust", "serde", "wide"];
    assert_eq!(dependencies("sim"), all);
    assert_eq!(dependencies("solver"), ["clarabel", "faer", "serde"]);
    assert!(!dependencies("cli").iter().any(|name| name.starts_with("parry")));
}

/// Sines come from `libm` and logarithms from the solver, since those of a platform differ in the
/// last bit. Nothing is fused. No stage of a step has a map whose order is that of hashes; shapes
/// look edges up in some.
#[test]
fn no_bit_depends_on_the_platform() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let angles = ["sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2"];
    let powers = ["powf", "exp", "exp2", "exp_m1", "ln", "ln_1p", "log", "log2", "log10", "cbrt"];
    let platform = angles.iter().chain(&powers).chain(&["mul_add"]);
    let platform: Vec<_> = platform.map(|name| format!(".{name}(")).collect();
    let mut lines = 0;
    for name in ["solver", "sim", "scene", "bake"] {
        for (module, text) in modules(&root.join(name).join("src"), &[]) {
            let stages =
                name == "solver" || name == "sim" && module.first() != Some(&"geometry".into());
            for line in untested(&text).lines() {
                // These are the numbers that a rotation consists of.
                let own = line.replace("rotation.cos()", "").replace("rotation.sin()", "");
                let platform = platform.iter().any(|call| own.contains(call));
                let hashed = stages && (own.contains("HashMap") || own.contains("HashSet"));
                assert!(!platform && !hashed, "{name}::{}: {line}", module.join("::"));
                lines += 1;
            }
        }
    }
    assert!(lines > 30_000, "{lines} lines were read");
}

/// Lanes, registers and threads alone have `unsafe` code.
#[test]
fn unsafe_code_is_in_seven_modules() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let allowed = |name: &str| -> Vec<String> {
        let texts = modules(&root.join(name).join("src"), &[]);
        let allows = texts.iter().filter(|(_, text)| text.contains("allow(unsafe_code)"));
        allows.map(|(module, _)| module.join("::")).collect()
    };
    let lanes = ["avx2", "block", "number", "sweep", "view"].map(|name| format!("lanes::{name}"));
    let others = ["registers", "thread_pool"].map(str::to_owned);
    assert_eq!(allowed("solver"), [&lanes[..], &others].concat());
    for name in ["sim", "scene", "bake", "cli"] {
        assert_eq!(allowed(name), [""; 0], "{name}");
    }
}

/// No function has more than 60 lines, except in readers of scenes and in the kernels of lanes.
#[test]
fn functions_fit_on_a_page() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut count = 0;
    for name in ["solver", "sim", "bake", "cli"] {
        for (module, text) in modules(&root.join(name).join("src"), &[]) {
            let own = without_tests(&text);
            let lines: Vec<&str> = own.lines().collect();
            for (first, line) in lines.iter().enumerate().filter(|(_, line)| is_function(line)) {
                let ends = |line: &&str| line.ends_with(['{', '}', ';']);
                let head = lines[first..].iter().position(ends).expect("the end of a signature");
                if !lines[first + head].ends_with('{') {
                    continue;
                }
                let end = format!("{}}}", &line[..line.len() - line.trim_start().len()]);
                let length = lines[first..].iter().position(|line| *line == end).expect("an end");
                count += 1;
                let is_kernel = module.first().is_some_and(|own| own == "lanes");
                assert!(length < 60 || is_kernel, "{name} {}: {line}", module.join("::"));
            }
        }
    }
    assert!(count > 1500, "{count} functions were found");
}

fn is_function(line: &str) -> bool {
    let words = line.trim_start().split(' ');
    let mut words = words.skip_while(|word| {
        word.starts_with("pub") || ["const", "unsafe", "super)", "crate)"].contains(word)
    });
    words.next() == Some("fn")
}

/// A world has at most twelve fields.
#[test]
fn a_world_has_few_fields() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/world.rs");
    let text = fs::read_to_string(path).expect("the source of worlds");
    let (_, rest) = text.split_once("pub struct World<").expect("a world");
    let (fields, _) = rest.split_once("\n}").expect("its end");
    let is_field = |line: &&str| !line.trim_start().starts_with("//") && line.contains(": ");
    let count = fields.lines().skip(1).filter(is_field).count();
    assert!((5..=12).contains(&count), "{count} fields");
}

/// The figure of a step in ARCHITECTURE.md has the stages of reports, in their order.
#[test]
fn the_figure_of_a_step_has_all_stages() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ARCHITECTURE.md");
    let text = fs::read_to_string(path).expect("the architecture");
    let (_, rest) = text.split_once("## A step").expect("a section");
    let (figure, _) = rest.split_once("poses move by").expect("a figure");
    let names = drystone::Stage::ALL.map(drystone::Stage::name);
    let words = figure.lines().filter_map(|line| {
        let mut words = line.split([' ', '|', '+', '-', '>']).filter(|word| !word.is_empty());
        words.next().filter(|word| names.contains(word))
    });
    assert_eq!(words.collect::<Vec<_>>(), names);
}

/// Every source file that ARCHITECTURE.md names is in a crate.
#[test]
fn the_map_names_files_that_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = fs::read_to_string(root.join("ARCHITECTURE.md")).expect("the architecture");
    let mut files = Vec::new();
    sources(&root.join("crates"), &mut files);
    let mut count = 0;
    for name in text.split('`').filter(|name| name.ends_with(".rs") && !name.contains('\n')) {
        let is_there = files.iter().any(|file| file.ends_with(name));
        assert!(is_there, "{name}");
        count += 1;
    }
    assert!(count > 50, "{count} files are named");
}

/// Appends all files in a folder and below it.
fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("a file").path();
        if path.is_dir() {
            sources(&path, files);
        } else {
            files.push(path);
        }
    }
}

/// A cycle of imports is found; imports in comments and tests do not count.
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
    assert_eq!(circle(&house_of([a.clone(), b.clone(), tested]), &from), None);
    let both = text("c", "#[cfg(test)]\nuse crate::{\n    e,\n};\nuse crate::a;\n");
    assert!(circle(&house_of([a, b, both]), &from).is_some(), "imports after an item for tests");
}

/// Returns the texts of the modules in a folder, by their paths, without its tests.
fn modules(folder: &Path, path: &[String]) -> BTreeMap<Vec<String>, String> {
    let mut texts = BTreeMap::new();
    for entry in fs::read_dir(folder).expect("a folder of sources") {
        let file = entry.expect("a file").path();
        let stem = file.file_stem().expect("a name").to_string_lossy().into_owned();
        let mut own = path.to_vec();
        own.push(stem.clone());
        if file.is_dir() {
            texts.extend(modules(&file, &own));
        } else if !["main", "tests"].contains(&stem.as_str()) {
            let own = if stem == "lib" { path.to_vec() } else { own };
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
        // A re-export does not count as a use.
        let paths = paths.iter().filter(|import| !import.handed_on);
        let homes = paths.filter_map(|import| home(&import.path, &imports));
        ((*module).clone(), homes.filter(|home| home != *module).collect())
    };
    let mut own: House = imports.iter().map(used).collect();
    // The root declares all modules, so it is left out.
    own.remove(&Vec::new());
    for (caller, home) in calls(texts) {
        own.get_mut(&caller).expect("a module").push(home);
    }
    // An import of a module may reach all modules below it, and what these import from elsewhere.
    let all = |module: &Vec<String>| {
        let below = own.iter().filter(|(other, _)| other.starts_with(module));
        let out = below.flat_map(|(other, used)| {
            used.iter().filter(move |used| other == module || !used.starts_with(module))
        });
        out.cloned().collect()
    };
    own.keys().map(|module| (module.clone(), all(module))).collect()
}

/// Returns pairs of a module that calls a method and the module that has it, for methods outside
/// the file of their type.
///
/// Only methods whose name is unique in the crate are counted, because calls are not resolved.
fn calls(texts: &BTreeMap<Vec<String>, String>) -> Vec<(Vec<String>, Vec<String>)> {
    let texts: Vec<_> = texts.iter().map(|(module, text)| (module, untested(text))).collect();
    let mut homes: BTreeMap<&str, Vec<(&Vec<String>, bool)>> = BTreeMap::new();
    for (module, text) in &texts {
        let mut abroad = false;
        for line in text.lines() {
            if line.starts_with("impl") {
                let of = line.rsplit_once(" for ").map_or(line, |(_, of)| of);
                let name = of.trim_start_matches("impl");
                abroad = type_of(name).is_some_and(|name| !defines(text, name)) && of == line;
            }
            let method =
                line.strip_prefix("    ").map(|line| line.trim_start_matches("pub(crate) "));
            let method = method.map(|line| line.trim_start_matches("pub(super) "));
            let method =
                method.map(|line| line.trim_start_matches("pub ").trim_start_matches("unsafe "));
            if let Some(name) = method.and_then(|line| line.strip_prefix("fn ")) {
                let end = name.find(|letter: char| !letter.is_alphanumeric() && letter != '_');
                let is_public = line.trim_start().starts_with("pub");
                let home = (*module, abroad && is_public);
                homes.entry(&name[..end.unwrap_or(name.len())]).or_default().push(home);
            }
        }
    }
    let mut found = Vec::new();
    for (name, homes) in homes {
        let [(home, true)] = homes[..] else { continue };
        let calls = |text: &str| {
            text.contains(&format!(".{name}(")) || text.contains(&format!("::{name}("))
        };
        let callers = texts.iter().filter(|(module, text)| *module != home && calls(text));
        found.extend(callers.map(|(caller, _)| ((*caller).clone(), home.clone())));
    }
    found
}

/// Returns the name of the type of an `impl`, after its generics.
fn type_of(line: &str) -> Option<&str> {
    let mut depth = 0;
    let start = line.char_indices().find(|(at, letter)| {
        depth += i32::from(*letter == '<');
        depth -= i32::from(*letter == '>' && !line[..*at].ends_with('-'));
        depth == 0 && letter.is_uppercase()
    })?;
    let name = &line[start.0..];
    Some(&name[..name.find(|letter: char| !letter.is_alphanumeric()).unwrap_or(name.len())])
}

/// Returns true if a text defines a type.
fn defines(text: &str, name: &str) -> bool {
    let ends = |at: &str| !at.starts_with(|letter: char| letter.is_alphanumeric() || letter == '_');
    let kinds = ["struct ", "enum ", "trait ", "type "];
    kinds
        .iter()
        .any(|kind| text.split(kind).skip(1).any(|at| at.strip_prefix(name).is_some_and(ends)))
}

/// Returns a text without its items for tests and without comments.
fn untested(text: &str) -> String {
    let text = without_tests(text);
    let lines = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

/// Returns a text without the items that are compiled for tests alone, wherever they are. An item
/// ends at the first line that is indented as its attribute and ends in `;`, `,` or `}`.
fn without_tests(text: &str) -> String {
    let mut lines = text.lines();
    let mut kept = Vec::new();
    while let Some(line) = lines.next() {
        if line.trim() != "#[cfg(test)]" {
            kept.push(line);
            continue;
        }
        let indent = |line: &str| line.len() - line.trim_start().len();
        let ends = |own: &&str| indent(own) == indent(line) && own.ends_with([';', ',', '}']);
        lines.by_ref().find(ends).expect("the end of an item for tests");
    }
    kept.join("\n")
}

/// An import of a module from its own crate.
struct Import {
    /// Path from the root.
    path: Vec<String>,
    /// True if it is a re-export, so that others may import it from there.
    handed_on: bool,
}

fn imports(module: &[String], text: &str, modules: &BTreeSet<&Vec<String>>) -> Vec<Import> {
    let mut found = Vec::new();
    for statement in untested(text).split(";\n") {
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

/// Returns true if a line begins an import of the whole module, not one inside an item.
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

/// Returns the path from the root of a path that a module writes, or None for another crate.
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

/// Returns the module that defines the item of a path, through re-exports, or None if the root
/// does.
fn home(path: &[String], imports: &BTreeMap<&Vec<String>, Vec<Import>>) -> Option<Vec<String>> {
    let depth = (0..=path.len()).rev().find(|&depth| imports.contains_key(&path[..depth].to_vec()));
    let module = path[..depth?].to_vec();
    let Some(name) = path.get(module.len()) else { return Some(module) };
    let handed = imports[&module].iter().find(|import| import.path.last() == Some(name));
    let own = (!module.is_empty()).then_some(module);
    handed.map_or(own, |import| home(&import.path, imports))
}

/// Returns the path of imports from a module back to itself, if there is one.
fn circle(house: &House, module: &Vec<String>) -> Option<String> {
    let mut way = vec![module];
    let found = comes_back(house, &mut way, &mut BTreeSet::new());
    found.then(|| way.iter().map(|module| module.join("::")).collect::<Vec<_>>().join(" -> "))
}

/// Extends the `way` from its end until it is back at its beginning, and skips modules already
/// `seen`.
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
