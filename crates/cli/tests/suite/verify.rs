//! Tests of `drystone verify`, and of the hashes of `drystone bake --report`.

use std::fs;
use std::path::Path;

use crate::common::{Place, SCENE};
use serde_json::Value;

#[test]
fn the_same_bake_is_the_same_and_another_differs_from_a_frame_and_body_on() {
    let place = Place::new(SCENE);
    let pushed = SCENE.replace("[0.1, 1.2, 0]", "[0.1, 1.2, 0]\nangular_velocity = [0, 0, 1e-3]");
    fs::write(place.path("pushed.toml"), pushed).unwrap();
    for (scene, out, threads) in
        [("scene.toml", "a", "1"), ("scene.toml", "b", "2"), ("pushed.toml", "c", "1")]
    {
        let (poses, report) = (format!("{out}.poses"), format!("{out}.json"));
        let outputs = ["-o", &poses, "--report", &report, "--threads", threads, "-q"];
        place.succeeds(&[&["bake", scene], &outputs[..]].concat());
    }
    let same = place.succeeds(&["verify", "a.poses", "b.poses"]);
    assert!(same.starts_with("same ") && same.contains("a.poses and b.poses"), "{same}");

    let arguments = ["verify", "a.poses", "c.poses", "--scene", "scene.toml"];
    let output = place.run(&arguments);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("first        frame 1 (0.017 s): 'ball' by 0.000e0 mm"), "{text}");
    // A thousandth of a radian per second, for a sixtieth of a second.
    assert!(text.contains("and 1.667e-5 rad\n"), "{text}");
    let without = place.run(&arguments[..3]);
    assert_eq!(without.status.code(), Some(1));
    assert!(String::from_utf8(without.stdout).unwrap().contains("--scene"));

    let hashes = |name: &str| -> Vec<String> {
        let report: Value = serde_json::from_slice(&fs::read(place.path(name)).unwrap()).unwrap();
        let steps = report["per_step"].as_array().unwrap().iter();
        steps.map(|step| step["state"].as_str().unwrap().to_owned()).collect()
    };
    let (a, b, c) = (hashes("a.json"), hashes("b.json"), hashes("c.json"));
    assert_eq!(a, b, "one thread and two");
    assert!(a[0].len() == 16 && a[0] != a[1] && a[0] != c[0]);
}

#[test]
fn a_shorter_bake_differs_and_one_of_another_scene_is_refused() {
    let place = Place::new(SCENE);
    for (steps, out) in [("10", "long.poses"), ("7", "short.poses")] {
        place.succeeds(&["bake", "scene.toml", "-o", out, "--steps", steps, "-q"]);
    }
    let output = place.run(&["verify", "long.poses", "short.poses", "--scene", "scene.toml"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.ends_with("frames       11 and 8\n") && !text.contains("first"), "{text}");

    let five = format!("bodies = [{}]", ["{motion = \"static\"}"; 5].join(","));
    fs::write(place.path("five.toml"), five).unwrap();
    let other = ["verify", "long.poses", "short.poses", "--scene", "five.toml"];
    let message = place.fails(2, &other);
    assert!(message.contains("5 bodies in 3D"), "{message}");
    fs::write(place.path("a.glb"), "other").unwrap();
    let message = place.fails(2, &["verify", "long.poses", "a.glb", "--scene", "scene.toml"]);
    assert!(
        message
            .contains("a.glb: the format of a bake is \".glb\"; accepted: .npz, .poses, .journal"),
        "{message}"
    );
    assert!(place.fails(4, &["verify", "gone.poses", "long.poses"]).contains("gone.poses"));
}

/// Debug and release builds bake the same bits.
#[test]
fn a_release_build_bakes_the_same_bits() {
    let Some(release) = std::env::var_os("DRYSTONE_RELEASE") else {
        eprintln!("SKIPPED: DRYSTONE_RELEASE names no release build of drystone");
        return;
    };
    let place = Place::new(SCENE);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    for scene in ["arch.json", "billiards.toml", "particles.json", "stones.json", "wall_2d.json"] {
        let scene = folder.join(scene).into_os_string().into_string().unwrap();
        for way in [&[][..], &["--realtime"]] {
            let bake = |out| [&["bake", &scene, "--steps", "50", "-q", "-o", out], way].concat();
            place.succeeds(&bake("own.poses"));
            let output = place.run_build(&release, &bake("release.poses"));
            assert!(output.status.success(), "{output:?}");
            let [own, other] =
                ["own.poses", "release.poses"].map(|name| fs::read(place.path(name)).unwrap());
            assert!(own == other, "{scene} {way:?}");
        }
    }
}
