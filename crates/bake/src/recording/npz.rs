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

use super::contacts::ContactRecording;
use super::joints::{AxisName, JointLayout, JointRecording, LOADS};
use super::{APART, Named, Recording, Velocities};
use drystone_scene::{self as scene, write_whole};

/// Largest accepted number of a first frame.
const LATEST: f64 = 1e9;

/// Contents of a file of arrays.
#[derive(Clone, Copy, Debug)]
pub struct Arrays<'a> {
    /// The poses.
    pub recording: &'a Recording,
    /// Velocities at its frames; empty if unknown.
    pub velocities: &'a Velocities,
    /// One name per body.
    pub names: &'a [String],
    /// Number of contact points in the step that led to each frame; empty if unknown.
    pub contacts: &'a [u32],
    /// The joints.
    pub joints: &'a JointRecording,
}

/// Writes a recording as these arrays:
///
/// - `poses`: frames × bodies × (3D: px py pz qx qy qz qw; 2D: px py angle), m and rad, `<f4`;
/// - `names`: bodies;
/// - `times`: frames, s, `<f8`;
/// - `contacts`: frames, the number of contact points in the step that led to each, `<u4`.
///
/// these, if velocities are known, in world axes:
///
/// - `linear_velocities`: frames × bodies × dimension, of the center of mass, m/s, `<f4`;
/// - `angular_velocities`: frames × bodies × 3 in 3D, frames × bodies in 2D, rad/s, `<f4`;
///
/// and these, if there are joints:
///
/// - `joint_names`: joints;
/// - `joint_axes`: axes of all joints, the name of the coordinate of each;
/// - `joint_of_axis`: axes, the index of the joint of each, `<u4`;
/// - `joint_values`: frames × axes, m or rad, `<f4`;
/// - `joint_loads`: frames × joints × (mean force and torque in the step that led to the frame), N
///   and N m, `<f4`;
/// - `joint_broken`: joints, the first frame in which each is broken, -1 for never, `<i8`.
///
/// # Errors
/// Those of [`write_whole`].
pub fn write(path: &Path, arrays: &Arrays<'_>) -> io::Result<()> {
    let Arrays { recording, velocities, names, contacts, joints } = *arrays;
    let frames = recording.frames();
    let size = [frames, recording.bodies, recording.stride()].map(|n| n as u64);
    write_whole(path, |out| {
        let mut zip = ZipWriter::new_stream(out);
        array(&mut zip, "poses", f32::default_dtype(), &size, &recording.poses)?;
        texts(&mut zip, "names", names.iter().map(String::as_str))?;
        array(&mut zip, "times", f64::default_dtype(), &[size[0]], recording.times())?;
        array(&mut zip, "contacts", u32::default_dtype(), &[contacts.len() as u64], contacts)?;
        if !velocities.numbers.is_empty() {
            write_velocities(&mut zip, velocities, recording)?;
        }
        if !joints.layout.is_empty() {
            write_joints(&mut zip, joints, size[0])?;
        }
        zip.finish()?;
        Ok(())
    })
}

fn write_velocities<W: Write + Seek>(
    zip: &mut ZipWriter<W>,
    velocities: &Velocities,
    recording: &Recording,
) -> io::Result<()> {
    let dimension = recording.dimension;
    let size = [recording.frames(), recording.bodies, dimension].map(|n| n as u64);
    let f32s = f32::default_dtype;
    array(zip, "linear_velocities", f32s(), &size, velocities.linear(dimension))?;
    // In 2D an angular velocity is one number.
    let size = if dimension == 3 { &size[..] } else { &size[..2] };
    array(zip, "angular_velocities", f32s(), size, velocities.angular(dimension))
}

/// Writes contacts over time as these arrays, whose contacts are those of all frames in turn:
///
/// - `offsets`: frames + 1; the contacts of frame f are those from `offsets[f]` to
///   `offsets[f + 1]`, without the latter, `<i8`;
/// - `times`: frames, s, `<f8`;
/// - `positions`: contacts × dimension, m, `<f4`;
/// - `normals`: contacts × dimension, unit normals from the second body towards the first, `<f4`;
/// - `impulses`: contacts, normal impulse in the step that led to the frame, N s, `<f4`;
/// - `speeds`: contacts, approach speed with the velocities before that step, m/s, `<f4`;
/// - `bodies`: contacts × 2, indices, `<i4`;
/// - `names`: bodies.
///
/// # Errors
/// Those of [`write_whole`].
pub fn write_contacts(
    path: &Path,
    contacts: &ContactRecording<'_>,
    names: &[String],
) -> io::Result<()> {
    let (frames, dimension) = (contacts.frames, contacts.dimension as u64);
    let counts = frames.iter().map(|frame| frame.impulses.len() as i64);
    let ends = counts.scan(0_i64, |end, count| {
        *end = end.saturating_add(count);
        Some(*end)
    });
    let offsets: Vec<i64> = std::iter::once(0).chain(ends).collect();
    let count = offsets.last().map_or(0, |count| *count as u64);
    let f32s = f32::default_dtype;
    write_whole(path, |out| {
        let mut zip = ZipWriter::new_stream(out);
        let size = [offsets.len() as u64];
        array(&mut zip, "offsets", i64::default_dtype(), &size, &offsets)?;
        let size = [frames.len() as u64];
        array(&mut zip, "times", f64::default_dtype(), &size, contacts.times())?;
        let all = frames.iter().flat_map(|frame| &frame.points);
        array(&mut zip, "positions", f32s(), &[count, dimension], all)?;
        let all = frames.iter().flat_map(|frame| &frame.normals);
        array(&mut zip, "normals", f32s(), &[count, dimension], all)?;
        let all = frames.iter().flat_map(|frame| &frame.impulses);
        array(&mut zip, "impulses", f32s(), &[count], all)?;
        let all = frames.iter().flat_map(|frame| &frame.speeds);
        array(&mut zip, "speeds", f32s(), &[count], all)?;
        let all = frames.iter().flat_map(|frame| frame.bodies.as_flattened());
        let all = all.map(|body| *body as i32);
        array(&mut zip, "bodies", i32::default_dtype(), &[count, 2], all)?;
        texts(&mut zip, "names", names.iter().map(String::as_str))?;
        zip.finish()?;
        Ok(())
    })
}

fn write_joints<W: Write + Seek>(
    zip: &mut ZipWriter<W>,
    joints: &JointRecording,
    frames: u64,
) -> io::Result<()> {
    let JointLayout { names, axes } = &joints.layout;
    let [count, columns] = [names.len(), axes.len()].map(|n| n as u64);
    texts(zip, "joint_names", names.iter().map(String::as_str))?;
    texts(zip, "joint_axes", axes.iter().map(|axis| axis.coordinate.as_str()))?;
    let owners = axes.iter().map(|axis| axis.joint);
    array(zip, "joint_of_axis", u32::default_dtype(), &[columns], owners)?;
    array(zip, "joint_values", f32::default_dtype(), &[frames, columns], &joints.values)?;
    let size = [frames, count, LOADS as u64];
    array(zip, "joint_loads", f32::default_dtype(), &size, &joints.loads)?;
    let frame = |at: &Option<usize>| at.map_or(-1, |frame| frame as i64);
    let broken = joints.broken.iter().map(frame);
    array(zip, "joint_broken", i64::default_dtype(), &[count], broken)
}

/// Writes an array of texts, which have as much room as the longest one needs.
fn texts<'a, W: Write + Seek>(
    zip: &mut ZipWriter<W>,
    name: &str,
    texts: impl Iterator<Item = &'a str> + Clone,
) -> io::Result<()> {
    let longest = texts.clone().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
    let dtype = format!("<U{longest}").parse().map_err(io::Error::other)?;
    let count = texts.clone().count() as u64;
    array(zip, name, DType::new_scalar(dtype), &[count], texts)
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
    let joints = match zip.index_for_name("joint_names.npy") {
        Some(_) => read_joints(&mut zip, size, frames)?,
        None => JointRecording::default(),
    };
    let velocities = match zip.index_for_name("linear_velocities.npy") {
        Some(_) => read_velocities(&mut zip, size, [frames, bodies], dimension)?,
        None => Velocities::default(),
    };
    Ok(Named { recording, names, joints, velocities })
}

fn read_velocities(
    zip: &mut ZipArchive<impl Read + Seek>,
    size: u64,
    [frames, bodies]: [u64; 2],
    dimension: usize,
) -> io::Result<Velocities> {
    let (linear, linear_shape) = load::<f32>(zip, size, "linear_velocities")?;
    let (angular, angular_shape) = load::<f32>(zip, size, "angular_velocities")?;
    let linear_fits = linear_shape == [frames, bodies, dimension as u64];
    let angular_fits = match dimension {
        3 => angular_shape == [frames, bodies, 3],
        _ => angular_shape == [frames, bodies],
    };
    if linear_fits && angular_fits {
        return Ok(Velocities::join(dimension, &linear, &angular));
    }
    let turning = if dimension == 3 { " × 3" } else { "" };
    Err(io::Error::new(
        io::ErrorKind::InvalidData,
        format!(
            "linear_velocities are {linear_shape:?} and angular_velocities {angular_shape:?}; \
             accepted: {frames} × {bodies} × {dimension} and {frames} × {bodies}{turning}"
        ),
    ))
}

fn read_joints(
    zip: &mut ZipArchive<impl Read + Seek>,
    size: u64,
    frames: u64,
) -> io::Result<JointRecording> {
    let (names, _) = load::<String>(zip, size, "joint_names")?;
    let (coordinates, _) = load::<String>(zip, size, "joint_axes")?;
    let (owners, _) = load::<u32>(zip, size, "joint_of_axis")?;
    let (values, values_shape) = load::<f32>(zip, size, "joint_values")?;
    let (loads, loads_shape) = load::<f32>(zip, size, "joint_loads")?;
    let (broken, _) = load::<i64>(zip, size, "joint_broken")?;
    let [count, columns] = [names.len(), coordinates.len()].map(|n| n as u64);
    let fits = owners.len() == coordinates.len()
        && broken.len() == names.len()
        && owners.iter().all(|joint| u64::from(*joint) < count)
        && values_shape == [frames, columns]
        && loads_shape == [frames, count, LOADS as u64];
    if !fits {
        return Err(io::Error::new(
            io::ErrorKind::InvalidData,
            format!(
                "the arrays of joints do not fit each other; accepted: joint_values {frames} × \
                 {columns} and joint_loads {frames} × {count} × {LOADS}, for {count} joints of \
                 {columns} axes"
            ),
        ));
    }
    let axis = |(joint, coordinate)| AxisName { joint, coordinate };
    let axes = owners.into_iter().zip(coordinates).map(axis).collect();
    let broken = broken.iter().map(|frame| usize::try_from(*frame).ok()).collect();
    Ok(JointRecording { layout: JointLayout { names, axes }, values, loads, broken })
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
        let names = vec!["ball".to_owned(), "Würfel 2".to_owned()];
        let (joints, velocities) = (JointRecording::default(), Velocities::default());
        Named { recording, names, joints, velocities }
    }

    /// The same with velocities.
    fn moving(frames: usize) -> Named {
        let numbers = (0..frames * 6).map(|i| i as f32 / 5.0).collect();
        Named { velocities: Velocities { numbers }, ..named(frames) }
    }

    /// A hinge without an axis and one with two, which breaks before frame 2.
    fn jointed(frames: usize) -> Named {
        let axis = |name: &str| AxisName { joint: 1, coordinate: name.to_owned() };
        let layout = JointLayout {
            names: vec!["Tür".to_owned(), "joint 1".to_owned()],
            axes: vec![axis("x"), axis("twist")],
        };
        let numbers = |count: usize| (0..count).map(|i| i as f32 / 7.0).collect();
        let (values, loads) = (numbers(2 * frames), numbers(4 * frames));
        let joints = JointRecording { layout, values, loads, broken: vec![None, Some(2)] };
        Named { joints, ..named(frames) }
    }

    fn write_named(path: &Path, named: &Named, contacts: &[u32]) {
        let Named { recording, names, joints, velocities } = named;
        write(path, &Arrays { recording, velocities, names, contacts, joints }).unwrap();
    }

    /// Velocities are read as written, in 2D and 3D, and those of another number of frames refused.
    #[test]
    fn velocities_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.npz");
        write_named(&path, &moving(3), &[]);
        assert_eq!(read(&path).unwrap(), moving(3));
        let mut zip = ZipArchive::new(std::fs::File::open(&path).unwrap()).unwrap();
        let mut of = |name: &str| load::<f32>(&mut zip, 1 << 20, name).unwrap();
        let (linear, shape) = of("linear_velocities");
        assert_eq!((&linear[..4], shape), (&[0.0, 0.2, 0.6, 0.8][..], vec![3, 2, 2]));
        let (angular, shape) = of("angular_velocities");
        assert_eq!((&angular[..2], shape), (&[0.4, 1.0][..], vec![3, 2]));
        let mut space = moving(2);
        space.recording = Recording { dimension: 3, bodies: 1, ..space.recording };
        space.recording.poses = (0..14).map(|i| i as f32).collect();
        space.names.pop();
        write_named(&path, &space, &[]);
        assert_eq!(read(&path).unwrap(), space);
        let short = Named { velocities: moving(2).velocities, ..named(3) };
        let message = {
            let Named { recording, names, joints, velocities } = &short;
            let all = Arrays { recording, velocities, names, contacts: &[], joints };
            write(&path, &all).unwrap_err().to_string()
        };
        assert!(!message.is_empty());
    }

    #[test]
    fn joints_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.npz");
        write_named(&path, &jointed(3), &[0, 4, 5]);
        assert_eq!(read(&path).unwrap(), jointed(3));
        let mut wrong = jointed(3);
        wrong.joints.layout.axes.pop();
        wrong.joints.values.truncate(3);
        wrong.joints.layout.axes[0].joint = 2;
        write_named(&path, &wrong, &[]);
        let message = read(&path).unwrap_err().to_string();
        assert!(
            message.contains("accepted: joint_values 3 × 1 and joint_loads 3 × 2"),
            "{message}"
        );
        // Without joints there are no further arrays.
        write_named(&path, &named(3), &[]);
        let zip = ZipArchive::new(std::fs::File::open(&path).unwrap()).unwrap();
        assert_eq!(zip.len(), 4);
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
