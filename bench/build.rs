//! Versions of the engines, and a check that those in C are not built with their assertions.

use std::env;
use std::fs;

const ENGINES: [&str; 5] = ["rapier2d", "rapier3d", "boxdd-sys", "boxddd-sys", "oxijolt-sys"];

fn main() {
    println!("cargo:rerun-if-changed=Cargo.lock");
    println!("cargo:rerun-if-env-changed=CFLAGS");
    let lock = fs::read_to_string("Cargo.lock").unwrap_or_default();
    for engine in ENGINES {
        let version = lock
            .split("[[package]]")
            .find(|package| package.contains(&format!("name = \"{engine}\"\n")))
            .and_then(|package| package.split("version = \"").nth(1))
            .and_then(|rest| rest.split('"').next())
            .unwrap_or("of unknown version");
        let name = engine.to_uppercase().replace('-', "_");
        println!("cargo:rustc-env=VERSION_{name}={engine} {version}");
    }
    let in_c =
        ["CARGO_FEATURE_BOX2D", "CARGO_FEATURE_BOX3D"].map(|name| env::var_os(name).is_some());
    let flags = env::var("CFLAGS").unwrap_or_default();
    if in_c.contains(&true) && !flags.contains("-DNDEBUG") {
        println!(
            "cargo::error=Box2D and Box3D would be built with their assertions, which is not fair: \
             run cargo in the folder bench, whose .cargo/config.toml sets CFLAGS; a CFLAGS of your \
             own needs -DNDEBUG"
        );
    }
}
