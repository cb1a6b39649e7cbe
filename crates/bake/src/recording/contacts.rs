//! [`ContactRecording`]: contacts over time, as a cloud of points for dust and sound.
//!
//! A frame has one point for each pair of colliders that pushed each other in the step that led to
//! it, at the mean of their contact points, weighted by impulses.

use std::io;
use std::path::Path;

use super::clock::Clock;
use super::{Recording, Sampling};
use crate::any_world::PairImpulses;
use drystone_scene::export::usd::{PrimWriter, StageHead, list, tuple, write_stage};
use drystone_scene::usd::{StageSource, StageUnits};

/// Width of a point whose impulse is 1 N s, in the stage. \[m\]
const WIDTH: f64 = 0.02;

/// Contacts at the frames of a recording.
#[derive(Clone, Copy, Debug)]
pub struct ContactRecording<'a> {
    /// Number of dimensions: 2 or 3.
    pub dimension: usize,
    /// Time between two frames. \[s\]
    pub frame_time: f64,
    /// Number of the first frame.
    pub start: usize,
    /// Contacts of the step that led to each frame; none for the initial state.
    pub frames: &'a [PairImpulses],
}

impl ContactRecording<'_> {
    /// Returns the times of the frames. \[s\]
    pub fn times(&self) -> impl ExactSizeIterator<Item = f64> {
        let (start, frame_time) = (self.start, self.frame_time);
        (0..self.frames.len()).map(move |frame| start.saturating_add(frame) as f64 * frame_time)
    }
}

/// Writes contacts as a stage with one prim of type `Points`, with a time sample for each frame of
/// a recording. Contacts of steps between two frames are those of the later one.
///
/// Units, axes and times are those of the stage that the scene was read from, else meters with +y
/// up. Impulses are in N s and speeds in m/s. The width of
/// a point grows with the cube root of its impulse.
///
/// # Errors
/// Those of [`write_whole`](drystone_scene::write_whole).
pub fn write_usda(
    path: &Path,
    contacts: &ContactRecording<'_>,
    recording: &Recording,
    source: Option<&StageSource>,
    options: &Sampling,
) -> io::Result<()> {
    let clock = Clock::new(recording, source, options);
    let units = source.map_or(StageUnits::METERS, |source| source.units);
    let period = options.stride(recording.frame_time) * recording.frame_time;
    let mut prim = points();
    let mut cloud = Cloud { units, dimension: contacts.dimension, samples: Default::default() };
    for time in &clock.times {
        cloud.add(clock.code(*time), &within(contacts, [time - period, *time]));
    }
    for (attribute, samples) in ATTRIBUTES.iter().zip(cloud.samples) {
        prim.follow(attribute, samples.into_iter(), None);
    }
    let mut world = PrimWriter::new("Xform", "World");
    world.children.push(prim);
    let (ends, rate) = (clock.ends(), clock.rate);
    let head = StageHead { ends, frames: rate, codes: rate, units, ..StageHead::default() };
    write_stage(path, &head, &[world])
}

/// Attributes with a sample per frame.
const ATTRIBUTES: [&str; 8] = [
    "float3[] extent",
    "point3f[] points",
    "normal3f[] normals",
    "float[] widths",
    "float[] primvars:impulse",
    "float[] primvars:speed",
    "int[] primvars:bodyA",
    "int[] primvars:bodyB",
];

/// Returns the prim without its samples.
fn points() -> PrimWriter {
    let mut prim = PrimWriter::new("Points", "Contacts");
    for attribute in &ATTRIBUTES[1..] {
        prim.set(*attribute, "[] (\n            interpolation = \"vertex\"\n        )");
    }
    prim
}

/// Returns the contacts of the steps after the first of these times, up to the second. \[s\]
fn within(contacts: &ContactRecording<'_>, [after, to]: [f64; 2]) -> PairImpulses {
    // Times of frames are products of the frame time, which may round to either side.
    let number = |time: f64| (time / contacts.frame_time + 1e-6).floor() + 1.0;
    let place = |time| (number(time).max(0.0) as usize).saturating_sub(contacts.start);
    let end = place(to).min(contacts.frames.len());
    let mut all = PairImpulses::default();
    contacts.frames[place(after).min(end)..end].iter().for_each(|frame| all.append(frame));
    all
}

/// Samples of the attributes, by time code.
struct Cloud {
    units: StageUnits,
    dimension: usize,
    samples: [Vec<(f64, String)>; ATTRIBUTES.len()],
}

impl Cloud {
    fn add(&mut self, code: f64, contacts: &PairImpulses) {
        let units = self.units;
        let vectors = |numbers: &[f32]| -> Vec<[f64; 3]> {
            let of = |one: &[f32]| std::array::from_fn(|i| one.get(i).map_or(0.0, |x| (*x).into()));
            numbers.chunks(self.dimension).map(of).collect()
        };
        let points = vectors(&contacts.points).into_iter().map(|p| units.to_stage(p));
        let points: Vec<_> = points.map(|p| p.map(|x| x as f32)).collect();
        let normals = vectors(&contacts.normals).into_iter().map(|n| units.direction_to_stage(n));
        let widths: Vec<_> = contacts.impulses.iter().map(|impulse| self.width(*impulse)).collect();
        let [low, high] = extent(&points, &widths);
        let bodies = |side: usize| list(contacts.bodies.iter().map(|pair| pair[side]));
        let texts = [
            // The corners of an empty box are too large for whole numbers.
            list([low, high].iter().map(|p| tuple(&p.map(|x| format!("{x:e}"))))),
            list(points.iter().map(|p| tuple(p))),
            list(normals.map(|n| tuple(&n.map(|x| x as f32)))),
            list(widths.iter()),
            list(contacts.impulses.iter()),
            list(contacts.speeds.iter()),
            bodies(0),
            bodies(1),
        ];
        for (samples, text) in self.samples.iter_mut().zip(texts) {
            samples.push((code, text));
        }
    }

    /// Returns the width of a point with this impulse \[N s\].
    fn width(&self, impulse: f32) -> f32 {
        (WIDTH * libm::cbrt(f64::from(impulse)) / self.units.meters) as f32
    }
}

/// Returns the corners of the box around points of these widths; of an empty box without points.
fn extent(points: &[[f32; 3]], widths: &[f32]) -> [[f32; 3]; 2] {
    let empty = [[f32::MAX; 3], [-f32::MAX; 3]];
    points.iter().zip(widths).fold(empty, |[low, high], (point, width)| {
        let half = 0.5 * width;
        [
            std::array::from_fn(|i| low[i].min(point[i] - half)),
            std::array::from_fn(|i| high[i].max(point[i] + half)),
        ]
    })
}
