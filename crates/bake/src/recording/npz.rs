//! Writes and reads recordings as NumPy arrays in one `.npz`.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::io::{self, BufReader, Read, Seek, Write};
use std::path::Path;

use npyz::{AutoSerialize, DType, Deserialize, NpyFile, Serialize, WriterBuilder as _};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use super::{APART, Named, Recording};
use drystone_scene::{self as scene, write_whole};

/// Largest accepted number of a first frame.
const LATEST: f64 = 1e9;

/// Writes a recording as these arrays:
///
/// - `poses`: frames × bodies × (3D: px py pz qx qy qz qw; 2D: px py angle), m and rad, `<f4`;
/// - `names`: bodies;
/// - `times`: frames, s, `<f8`;
/// - `contacts`: frames, the number of contact points in the step that led to each, `<u4`.
///
/// # Errors
/// Those of [`write_whole`].
pub fn write(
    path: &Path,
    recording: &Recording,
    names: &[String],
    contacts: &[u32],
) -> io::Result<()> {
    let frames = recording.frames();
    let size = [frames, recording.bodies, recording.stride()].map(|n| n as u64);
    let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(1);
    let text = format!("<U{longest}").parse().map_err(io::Error::other)?;
    write_whole(path, |out| {
        let mut zip = ZipWriter::new_stream(out);
        array(&mut zip, "poses", f32::default_dtype(), &size, &recording.poses)?;
        array(&mut zip, "names", DType::new_scalar(text), &[names.len() as u64], names)?;
        array(&mut zip, "times", f64::default_dtype(), &[size[0]], recording.times())?;
        array(&mut zip, "contacts", u32::default_dtype(), &[contacts.len() as u64], contacts)?;
        zip.finish()?;
        Ok(())
    })
}

fn array<W: Write + Seek, T: Serialize>(
    zip: &mut ZipWriter<W>,
    name: &str,
    dtype: DType,
    shape: &[u64],
    values: impl IntoIterator<Item = T>,
) -> io::Result<()> {
    // Poses hardly compress. A size beyond 4 GiB is only known once it is written.
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    zip.start_file(format!("{name}.npy"), stored.large_file(true))?;
    let mut npy = npyz::WriteOptions::new().dtype(dtype).shape(shape).writer(zip).begin_nd()?;
    npy.extend(values)?;
    npy.finish()
}

/// Reads a recording written by [`write`](fn@write), or by another program in the same format.
///
/// # Errors
/// If the file cannot be read or is no recording. The message says which array is wrong and what is
/// accepted.
pub fn read(path: &Path) -> io::Result<Named> {
    let file = scene::open(path)?;
    let size = file.metadata()?.len();
    let mut zip = ZipArchive::new(BufReader::new(file))?;
    let (poses, shape) = load::<f32>(&mut zip, size, "poses")?;
    let (names, _) = load::<String>(&mut zip, size, "names")?;
    let (times, _) = load::<f64>(&mut zip, size, "times")?;
    let refuse = |text: String| Err(io::Error::new(io::ErrorKind::InvalidData, text));
    let &[frames, bodies, stride] = shape.as_slice() else {
        return refuse(format!("poses has {} dimensions; accepted: 3", shape.len()));
    };
    let dimension = match stride {
        3 => 2,
        7 => 3,
        _ => return refuse(format!("a pose has {stride} numbers; accepted: 3 (2D), 7 (3D)")),
    };
    if (names.len() as u64, times.len() as u64) != (bodies, frames) {
        let sizes = format!("{} names and {} times", names.len(), times.len());
        return refuse(format!(
            "{sizes}; accepted: one for each of {bodies} bodies, {frames} frames"
        ));
    }
    let (frame_time, start) = match times.as_slice() {
        // The difference of two late times has rounding errors. The second time over its frame
        // number is more exact.
        [first, second, ..] => {
            let start = (first / (second - first)).round();
            (second / (start + 1.0), start)
        }
        // A single frame does not determine the frame time.
        _ => (0.0, 0.0),
    };
    if times.len() > 1 && !APART.contains(&frame_time) {
        let [low, high] = [APART.start(), APART.end()];
        return refuse(format!("times is {frame_time} s apart; accepted: {low:e} to {high:e} s"));
    }
    if !(0.0..=LATEST).contains(&start) {
        return refuse(format!("times begins at frame {start}; accepted: 0 to {LATEST}"));
    }
    let start = start as usize;
    let recording = Recording { dimension, bodies: names.len(), frame_time, start, poses };
    Ok(Named { recording, names })
}

/// Reads an array in C order from an archive of `size` bytes: its numbers and its shape.
fn load<T: Deserialize>(
    zip: &mut ZipArchive<impl Read + Seek>,
    size: u64,
    name: &str,
) -> io::Result<(Vec<T>, Vec<u64>)> {
    let wrong = |why: &dyn std::fmt::Display| {
        io::Error::new(io::ErrorKind::InvalidData, format!("array {name}: {why}"))
    };
    let mut file = zip.by_name(&format!("{name}.npy")).map_err(|error| wrong(&error))?;
    // Arrays are stored uncompressed: none is larger than its archive.
    let room = file.size().min(size);
    let mut start = [0; 12];
    file.read_exact(&mut start)?;
    let [.., major, _, a, b, c, d] = start;
    let header =
        if major < 2 { u32::from_le_bytes([a, b, 0, 0]) } else { u32::from_le_bytes([a, b, c, d]) };
    if u64::from(header) > room {
        return Err(wrong(&format!("has a header of {header} bytes")));
    }
    let npy = NpyFile::new(start.as_slice().chain(&mut file))?;
    let (shape, order) = (npy.shape().to_vec(), npy.order());
    if order == npyz::Order::Fortran && shape.len() > 1 {
        return Err(wrong(&"is in the order of Fortran; accepted: that of C"));
    }
    // Checked before allocating: a header can state any size.
    let entry = npy.dtype().num_bytes().unwrap_or(usize::MAX) as u64;
    if npy.len().saturating_mul(entry.max(1)) > room {
        return Err(wrong(&format!("has {} entries of {entry} bytes", npy.len())));
    }
    let data = npy.data::<T>().map_err(|error| wrong(&error))?;
    let data = data.collect::<io::Result<_>>()?;
    // The checksum is verified only at the end, which reading the numbers does not reach.
    let rest = io::copy(&mut file, &mut io::sink()).map_err(|error| wrong(&error))?;
    if rest > 0 {
        return Err(wrong(&format!("is followed by {rest} bytes")));
    }
    Ok((data, shape))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(frames: usize) -> Named {
        let poses = (0..frames * 6).map(|i| i as f32 / 3.0).collect();
        let recording = Recording { dimension: 2, bodies: 2, frame_time: 0.5, start: 0, poses };
        Named { recording, names: vec!["ball".to_owned(), "Würfel 2".to_owned()] }
    }

    fn write_named(path: &Path, Named { recording, names }: &Named, contacts: &[u32]) {
        write(path, recording, names, contacts).unwrap();
    }

    #[test]
    fn reading_what_was_written_gives_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.npz");
        write_named(&path, &named(3), &[0, 4, 5]);
        assert_eq!(read(&path).unwrap(), named(3));
        let mut zip = ZipArchive::new(std::fs::File::open(&path).unwrap()).unwrap();
        assert_eq!(
            load::<f64>(&mut zip, 1 << 20, "times").unwrap(),
            (vec![0.0, 0.5, 1.0], vec![3])
        );
        assert_eq!(load::<u32>(&mut zip, 1 << 20, "contacts").unwrap(), (vec![0, 4, 5], vec![3]));
    }

    #[test]
    fn files_that_are_not_recordings_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.npz");
        let refused = |named: &Named, why: &str| {
            write_named(&path, named, &[]);
            let message = read(&path).unwrap_err().to_string();
            assert!(message.contains(why), "{message}");
        };
        refused(&Named { names: vec!["one".to_owned()], ..named(2) }, "1 names and 2 times");
        let timed = |frame_time: f64, start: usize| {
            let recording = Recording { frame_time, start, ..named(2).recording };
            Named { recording, ..named(2) }
        };
        for wrong in [0.0, -0.5, f64::NAN, f64::INFINITY, 1e7] {
            refused(&timed(wrong, 0), "s apart; accepted: 1e-9 to 1e6 s");
        }
        refused(&timed(0.5, 1 << 40), "times begins at frame 1099511627776; accepted: 0 to");
        write_named(&path, &timed(1.0 / 60.0, 1234), &[]);
        assert_eq!(read(&path).unwrap().recording.start, 1234);
        write_named(&path, &named(2), &[]);
        let whole = std::fs::read(&path).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(read(&path).is_err(), "{length} of {} bytes", whole.len());
        }
        for byte in 0..whole.len() {
            let mut broken = whole.clone();
            broken[byte] ^= 0xff;
            std::fs::write(&path, broken).unwrap();
            // Neither a panic nor other numbers.
            if let Ok(same) = read(&path) {
                assert_eq!(same, named(2), "byte {byte}");
            }
        }
    }
}
