//! Tests of `drystone solve`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::{Value, json};
use tempfile::TempDir;

struct Place {
    folder: TempDir,
}

impl Place {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, problem: &Value) {
        fs::write(self.path(name), problem.to_string()).unwrap();
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_drystone"));
        command.current_dir(self.folder.path()).arg("solve").args(arguments).output().unwrap()
    }

    fn ends(&self, code: i32, arguments: &[&str]) -> (String, String) {
        let output = self.run(arguments);
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        let (out, err) = (text(output.stdout), text(output.stderr));
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {err}");
        (out, err)
    }

    /// Returns the message that refuses a problem.
    fn refused(&self, problem: &Value) -> String {
        self.write("bad.json", problem);
        self.ends(2, &["bad.json"]).1
    }

    fn result(&self) -> Value {
        serde_json::from_slice(&fs::read(self.path("result.json")).unwrap()).unwrap()
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

fn diagonal(n: usize, value: f64) -> Value {
    json!({
        "format": "csc",
        "rows": n,
        "cols": n,
        "colptr": (0..=n).collect::<Vec<_>>(),
        "rowidx": (0..n).collect::<Vec<_>>(),
        "values": vec![value; n],
    })
}

/// A cube of 0.5 kg that is pushed over the ground and slides.
fn sliding() -> Value {
    json!({ "name": "cube", "dim": 3, "nc": 1, "mu": [0.6], "q": [-2, 3, 4], "W": diagonal(3, 2.0) })
}

#[test]
fn a_complementarity_problem_is_solved() {
    let place = Place::new();
    place.write("p.json", &json!({ "name": "pair", "M_rows": [[2, 1], [1, 2]], "q": [-5, -6] }));
    let (text, _) = place.ends(0, &["p.json", "-o", "result.json"]);
    assert!(text.contains("pair: 2 contacts without friction") && text.contains("converged"));
    // Small problems are printed: W, q, z and u.
    let printed: Vec<Vec<_>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
    for line in [&["W", "2", "1"][..], &["1", "2"], &["q", "-5", "-6"], &["z", "1.3333", "2.3333"]]
    {
        assert!(printed.iter().any(|own| own == line), "{line:?} in {text}");
    }
    let result = place.result();
    let keys: Vec<_> = result.as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "attempts",
        "certificate",
        "history",
        "iterations",
        "method",
        "name",
        "reason",
        "residual",
        "status",
        "time_ms",
        "u",
        "units",
        "version",
        "z",
    ];
    assert_eq!(keys, expected);
    let z = numbers(&result["z"]);
    assert!((z[0] - 4.0 / 3.0).abs() < 1e-8 && (z[1] - 7.0 / 3.0).abs() < 1e-8, "{z:?}");
    assert!(numbers(&result["u"]).iter().all(|u| u.abs() < 1e-8));
    assert_eq!((&result["name"], &result["status"]), (&json!("pair"), &json!("converged")));
    // A matrix by columns.
    place.write("s.json", &json!({ "M": diagonal(3, 4.0), "q": [-4, 1, -2] }));
    let (text, _) = place.ends(0, &["s.json", "-o", "result.json", "--method", "lemke"]);
    assert!(text.contains("s: 3 contacts") && text.contains("lemke"));
    assert_eq!(numbers(&place.result()["z"]), [1.0, 0.0, 0.5]);
}

#[test]
fn friction_from_matrices_and_from_bodies() {
    let place = Place::new();
    place.write("w.json", &sliding());
    // The same cube given by its mass: M v = f + H r, u = H^T v.
    place.write(
        "global.json",
        &json!({ "dim": 3, "mu": 0.6, "global": {
            "M": diagonal(3, 0.5), "H": diagonal(3, 1.0), "f": [-1, 1.5, 2], "w": [0, 0, 0],
        } }),
    );
    for file in ["w.json", "global.json"] {
        for method in ["auto", "gauss-seidel", "proximal"] {
            place.ends(0, &[file, "--method", method, "-o", "result.json", "-q"]);
            let result = place.result();
            let r = numbers(&result["r"]);
            for (r, answer) in r.iter().zip([1.0, -0.36, -0.48]) {
                assert!((r - answer).abs() < 1e-8, "{file} {method}: {r} is not {answer}");
            }
            assert!(result["certificate"]["cone_violation"].as_f64().unwrap() < 1e-12);
            assert!(result["residual"].as_f64().unwrap() <= 1e-9);
        }
    }
}

#[test]
fn problems_without_a_solution_are_reported() {
    let place = Place::new();
    place.write("jam.json", &json!({ "M_rows": [[1, -1], [-1, 1]], "q": [-1, -1] }));
    let (text, error) = place.ends(3, &["jam.json", "-o", "result.json"]);
    assert!(text.contains("infeasible") && text.contains("2 of the contacts"), "{text}");
    assert!(error.contains("proves that there is no solution"), "{error}");
    let result = place.result();
    assert_eq!(result["status"], "infeasible");
    assert_eq!(numbers(&result["certificate"]["self_stress"]["weights"]), [1.0, 1.0]);
    // Too few iterations: the problem is not solved, and the residual shows the remaining error.
    place.write(
        "chain.json",
        &json!({ "M_rows": [[2, -1, 0], [-1, 2, -1], [0, -1, 2]], "q": [-1, -1, -1] }),
    );
    let arguments =
        ["chain.json", "--budget", "2", "--method", "gauss-seidel", "-o", "result.json"];
    let (_, error) = place.ends(3, &arguments);
    assert!(error.contains("not solved, residual"), "{error}");
    assert_eq!(place.result()["status"], "budget");
    assert!(place.result()["residual"].as_f64().unwrap() > 1e-3);
}

#[test]
fn methods_are_drawn_on_one_picture() {
    let place = Place::new();
    place.write(
        "chain.json",
        &json!({ "name": "a < b", "M_rows": [[2, -1], [-1, 2]], "q": [-1, -1] }),
    );
    let (text, _) = place.ends(0, &["chain.json", "--compare", "--history", "plot.svg"]);
    let svg = fs::read_to_string(place.path("plot.svg")).unwrap();
    let methods = ["auto", "gauss-seidel", "proximal", "newton", "lemke", "enumeration"];
    for method in methods {
        assert!(svg.contains(&format!(">{method}</text>")), "{method}");
        assert!(text.contains(method), "{method}");
    }
    assert_eq!(svg.matches("<polyline").count(), 14, "over iterations and over time");
    assert!(svg.contains(">iterations</text>") && svg.contains(">time in ms</text>"));
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && svg.contains("a &lt; b"));
    assert!(!svg.contains("NaN") && !svg.contains("inf\""));
    let left = fs::read_dir(place.folder.path()).unwrap().count();
    assert_eq!(left, 2, "nothing temporary is left");
}

/// The interior-point method has a residual for each iteration when its history is drawn.
#[test]
fn the_interior_point_method_has_a_history() {
    let place = Place::new();
    place.write("chain.json", &json!({ "M_rows": [[2, -1], [-1, 2]], "q": [-1, -1] }));
    let method = ["chain.json", "--method", "interior-point", "--history", "plot.svg"];
    place.ends(0, &[&method[..], &["-o", "result.json"]].concat());
    let result = place.result();
    let (history, last) = (&result["history"], result["iterations"].as_u64().unwrap());
    let iterations: Vec<u64> =
        history["iteration"].as_array().unwrap().iter().map(|i| i.as_u64().unwrap()).collect();
    assert!(last > 2 && iterations == (0..=last).collect::<Vec<_>>(), "{iterations:?} of {last}");
    let residuals = numbers(&history["residual"]);
    assert!(numbers(&history["time_ms"]).is_sorted(), "{history}");
    let middle = residuals[residuals.len() / 2];
    assert!(residuals[0] > middle && middle > residuals[last as usize], "{residuals:?}");
}

/// A result has the keys that other programs need, and the times of its history increase.
#[test]
fn a_result_has_its_history_over_time() {
    let place = Place::new();
    place.write("chain.json", &json!({ "M_rows": [[2, -1], [-1, 2]], "q": [-1, -1] }));
    place.ends(0, &["chain.json", "-o", "result.json"]);
    let result = place.result();
    for key in ["name", "status", "method", "z", "u", "residual", "certificate", "iterations"] {
        assert!(!result[key].is_null(), "{key}: {result}");
    }
    let times = numbers(&result["history"]["time_ms"]);
    assert_eq!(times.len(), numbers(&result["history"]["residual"]).len());
    assert!(times.len() > 2 && times.is_sorted(), "{times:?}");
    let whole = result["time_ms"].as_f64().unwrap();
    assert!(times[0] >= 0.0 && times[times.len() - 1] <= whole, "{times:?} of {whole}");
}

/// FCLIB's own files give the same problems as the JSON of the collection.
#[cfg(feature = "fclib")]
#[test]
fn files_of_fclib_are_read() {
    let Some(data) = std::env::var_os("DRYSTONE_DATA").map(PathBuf::from) else {
        eprintln!("SKIPPED: DRYSTONE_DATA does not name the benchmark data");
        return;
    };
    let place = Place::new();
    let folder = data.join("contact_problems");
    for name in ["Box_Stacks-i0122-82-5", "Capsules-i125-1213", "LMGC_GFC3D-i00501-4-00000"] {
        let both = [("fclib_hdf5", "hdf5"), ("json", "json")].map(|(kind, extension)| {
            let file = folder.join(kind).join(format!("{name}.{extension}"));
            let file = file.to_str().unwrap();
            place.ends(0, &[file, "--method", "proximal", "-o", "result.json"]);
            let result = place.result();
            (numbers(&result["u"]), result["residual"].as_f64().unwrap())
        });
        assert_eq!(both[0].0.len(), both[1].0.len(), "{name}");
        assert!(both[0].1 <= 1e-9 && both[1].1 <= 1e-9, "{name}");
    }
    fs::write(place.path("bad.hdf5"), "no HDF5").unwrap();
    let (_, message) = place.ends(4, &["bad.hdf5"]);
    assert!(
        message.contains("bad.hdf5") && message.contains("cannot be read as HDF5"),
        "{message}"
    );
}

#[test]
fn errors_name_file_place_value_and_range() {
    let place = Place::new();
    let message = place.refused(&json!({ "bodies": [], "gravity": [] }));
    assert!(
        message.contains("bad.json: the problem is made of bodies, gravity; accepted: q"),
        "{message}"
    );
    let with = |key: &str, value: Value| {
        let mut problem = sliding();
        problem[key] = value;
        place.refused(&problem)
    };
    let message = with("dim", json!(4));
    assert!(message.contains("bad.json at /dim: 'dim' is 4; accepted: 1, 2 or 3"), "{message}");
    let message = with("mu", json!([-0.1]));
    assert!(message.contains("at /mu/0: '0' is -0.1; accepted: a number from 0"), "{message}");
    let message = with("q", json!([1, 2]));
    assert!(message.contains("at /q: ") && message.contains("a multiple of 3"), "{message}");
    let message = with("q", json!([1, "two", 3]));
    assert!(message.contains("at /q/1: '1' is \"two\"; accepted: a number"), "{message}");
    let message = with("nc", json!(7));
    assert!(message.contains("at /nc: 'nc' is 7; accepted: 1,"), "{message}");
    let mut w = diagonal(3, 2.0);
    w["rowidx"][2] = json!(3);
    let message = with("W", w);
    assert!(message.contains("at /W/rowidx/2: '2' is 3; accepted: 0 to 2"), "{message}");
    let mut w = diagonal(3, 2.0);
    w["colptr"] = json!([0, 2, 1, 3]);
    assert!(with("W", w).contains("at /W/colptr/2: '2' is 1; accepted: 2 to 3"));
    let message = place.refused(&json!({ "M_rows": [[1, 2], [3]], "q": [1, 1] }));
    assert!(message.contains("at /M_rows/1: the number of entries is 1; accepted: 2"), "{message}");
    let message = place.refused(&json!({ "A": 1 }));
    assert!(message.contains("accepted: q with one of W, global, M, M_rows"), "{message}");
    let singular = json!({ "dim": 1, "mu": [0], "global": {
        "M": diagonal(1, 0.0), "H": diagonal(1, 1.0), "f": [0], "w": [0],
    } });
    assert!(place.refused(&singular).contains("the mass matrix is singular"));
    fs::write(place.path("bad.json"), "{\n  \"q\": [1,}").unwrap();
    let message = place.ends(2, &["bad.json"]).1;
    assert!(message.contains("bad.json:2:11:"), "{message}");
    assert!(place.ends(4, &["missing.json"]).1.contains("missing.json: cannot be read"));
    place.write("p.json", &sliding());
    assert!(place.ends(2, &["p.json", "--method", "magic"]).1.contains("gauss-seidel"));
    assert!(place.ends(2, &["p.json", "--method", "lemke"]).1.contains("knows no friction"));
    assert!(place.ends(2, &["p.json", "-o", "out.txt"]).1.contains(".json files only"));
    place.ends(4, &["p.json", "-o", "nowhere/out.json"]);
}

/// Every problem of the collections is solved or refused by the command.
#[test]
fn collected_problems_are_solved_or_refused_truthfully() {
    let Some(root) = std::env::var_os("DRYSTONE_DATA") else {
        eprintln!("skipped: DRYSTONE_DATA is not set");
        return;
    };
    let place = Place::new();
    let mut seen = 0;
    for folder in ["lcp/json", "lcp/from_contact", "contact_problems/json"] {
        for entry in fs::read_dir(Path::new(&root).join(folder)).unwrap() {
            let path = entry.unwrap().path();
            let problem: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
            let code = if problem["linear_feasible"] == false { 3 } else { 0 };
            place.ends(code, &[path.to_str().unwrap(), "-o", "result.json", "-q"]);
            let result = place.result();
            assert_eq!(result["name"], problem["name"]);
            assert_eq!(result["status"], if code == 0 { "converged" } else { "infeasible" });
            seen += 1;
        }
    }
    assert_eq!(seen, 69);
}
