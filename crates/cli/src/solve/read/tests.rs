//! Tests with arbitrary problem files: each is read or refused.

use std::path::Path;

use super::read;

#[path = "../../../../bake/tests/suite/common/mutation.rs"]
mod mutation;

const MATRIX: &str = r#"{"format": "csc", "rows": 3, "cols": 3, "colptr": [0, 1, 2, 3],
                         "rowidx": [0, 1, 2], "values": [1, 2, 3]}"#;

/// Returns one problem of each format.
fn corpus() -> Vec<Vec<u8>> {
    let forms = [
        r#"{"name": "a", "dim": 3, "nc": 1, "mu": [0.5], "q": [-1, 0, 0], "W": MATRIX}"#,
        r#"{"dim": 3, "mu": 0.5, "global": {"w": [0, 0, 0], "f": [1, 2, 3], "M": MATRIX, "H": MATRIX}}"#,
        r#"{"q": [-1, 2], "M_rows": [[2, 1], [1, 2]]}"#,
        r#"{"q": [-1, 2, 3], "M": MATRIX}"#,
        r#"{"dim": 3, "mu": 0.5, "M": MATRIX, "J": MATRIX, "v_star": [0, -1, 0], "t": [0, 0, 0],
            "eps": [0.1, 0.1, 0.1], "gamma_0": [1, 0, 0]}"#,
    ];
    forms.map(|form| form.replace("MATRIX", MATRIX).into_bytes()).to_vec()
}

#[test]
fn any_problem_is_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("input.json");
    let one = |input: &[u8]| {
        std::fs::write(&path, input).unwrap();
        let _ = read(&path);
    };
    for (form, input) in corpus().into_iter().enumerate() {
        one(&input);
        assert!(read(&path).is_ok(), "form {form}: {:?}", read(&path).err());
    }
    let faults = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/corpus");
    for entry in std::fs::read_dir(faults).into_iter().flatten() {
        mutation::try_one("problem", &std::fs::read(entry.unwrap().path()).unwrap(), one);
    }
    mutation::fuzz("problem", &corpus(), true, one);
}

/// A short file that claims a large matrix takes little memory.
#[test]
fn memory_grows_with_the_data_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.json");
    let many = |item: &str| vec![item; 300_000].join(",");
    let text = format!("{{\"q\": [{}], \"M_rows\": [{}]}}", many("0"), many("[]"));
    std::fs::write(&path, text).unwrap();
    let error = read(&path).unwrap_err();
    assert!(error.to_string().contains("accepted: 300000"), "{error}");
}
