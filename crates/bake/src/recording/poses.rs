//! Writes and reads raw poses for measurements: little-endian f32 without a header.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::io::{self, Read as _, Write};
use std::path::Path;

use super::Recording;
use drystone_scene::{self as scene, write_whole};

/// Number of floats converted to bytes at a time.
const BLOCK: usize = 1 << 16;

/// Writes `frames x bodies x (3D: px py pz qx qy qz qw; 2D: px py angle)` as little-endian f32.
///
/// # Errors
/// Those of [`write_whole`].
pub fn write(path: &Path, recording: &Recording) -> io::Result<()> {
    write_whole(path, |out: &mut dyn Write| {
        for block in recording.poses.chunks(BLOCK) {
            let bytes: Vec<u8> = block.iter().flat_map(|x| x.to_le_bytes()).collect();
            out.write_all(&bytes)?;
        }
        Ok(())
    })
}

/// Reads a file written by [`write`](fn@write). The file itself states neither its dimension nor
/// its bodies nor the time between its frames \[s\].
///
/// # Errors
/// If the file cannot be read, or is not a whole number of frames.
pub fn read(
    path: &Path,
    dimension: usize,
    bodies: usize,
    frame_time: f64,
) -> io::Result<Recording> {
    let mut bytes = Vec::new();
    scene::open(path)?.read_to_end(&mut bytes)?;
    let mut recording = Recording { dimension, bodies, frame_time, start: 0, poses: Vec::new() };
    let frame = bodies.saturating_mul(recording.stride()).saturating_mul(size_of::<f32>());
    if bytes.len().checked_rem(frame).unwrap_or(bytes.len()) != 0 {
        let message = format!("{} bytes are not a whole number of frames of {frame}", bytes.len());
        return Err(io::Error::new(io::ErrorKind::InvalidData, message));
    }
    let (numbers, _) = bytes.as_chunks();
    recording.poses = numbers.iter().map(|x| f32::from_le_bytes(*x)).collect();
    Ok(recording)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn reading_what_was_written_gives_the_same_poses() {
        let path = tempfile::tempdir().unwrap().keep().join("run.poses");
        let poses = (0..12).map(|i| i as f32 / 3.0).collect();
        let recording = Recording { dimension: 2, bodies: 2, frame_time: 0.5, start: 0, poses };
        write(&path, &recording).unwrap();
        assert_eq!(fs::read(&path).unwrap()[4..8], (1.0f32 / 3.0).to_le_bytes());
        assert_eq!(read(&path, 2, 2, 0.5).unwrap(), recording);
        assert!(read(&path, 3, 2, 0.5).is_err());
        assert!(read(&path, 2, 0, 0.5).is_err());
        fs::remove_dir_all(path.parent().unwrap()).unwrap();
    }
}
