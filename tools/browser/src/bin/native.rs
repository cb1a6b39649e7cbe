//! Prints the hashes that the module has to return: `native STEPS SCENE...`. Two for each scene,
//! with the real-time preset and certified.

use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let steps = arguments.next().ok_or("usage: native STEPS SCENE...")?.parse()?;
    for scene in arguments {
        let text = std::fs::read_to_string(&scene)?;
        for certified in [false, true] {
            println!("{:016x}", browser::hash_of(&text, certified, steps)?);
        }
    }
    Ok(())
}
