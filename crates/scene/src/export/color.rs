//! Colors that distinguish bodies.

use crate::description::Motion;

/// Colors of dynamic bodies, by index modulo their number. \[sRGB\]
const PALETTE: [u32; 10] = [
    0x3f7cac, 0xe07a3f, 0x5aa469, 0xd1495b, 0x7d6bb0, 0xe3b23c, 0x4fb0ae, 0x9c6644, 0xd67ba8,
    0x8aa83f,
];
/// Color of static bodies. \[sRGB\]
pub(super) const STATIC: u32 = 0xb8ad9e;
const KINEMATIC: u32 = 0x46505c;

/// Returns the color of a body. \[sRGB\]
pub(super) fn color_of(body: usize, motion: Motion) -> u32 {
    match motion {
        Motion::Dynamic => PALETTE[body % PALETTE.len()],
        Motion::Static => STATIC,
        Motion::Kinematic => KINEMATIC,
    }
}

/// Returns linear red, green and blue of a color, 0..1.
pub(super) fn linear(color: u32) -> [f64; 3] {
    let [_, rgb @ ..] = color.to_be_bytes();
    rgb.map(|component| {
        let x = f64::from(component) / 255.0;
        let y = if x <= 0.04045 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) };
        (y * 1e4).round() / 1e4
    })
}
