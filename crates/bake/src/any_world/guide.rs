//! [`Guide`]: the poses, the force and the vertices that a scene prescribes for a body.

use drystone_scene::{Body, Motion, Track, VertexTrack};

/// Difference of two times that counts as none, relative to them and to 1 s. \[1\]
const SAME_TIME: f64 = 1e-9;

/// Poses that a body follows, and a force on it, as its scene prescribes.
#[derive(Clone, Debug)]
pub(super) struct Guide {
    pub(super) track: Track,
    /// True if the body is released at the end of its track.
    is_released: bool,
    /// Constant force. \[N\]
    pub(super) force: Vec<f32>,
    /// Meshes that deform.
    pub(super) meshes: Vec<MeshGuide>,
}

/// Places of the vertices of a mesh over time.
#[derive(Clone, Debug)]
pub(super) struct MeshGuide {
    /// Index of the shape in the body.
    pub(super) shape: usize,
    track: VertexTrack,
}

impl MeshGuide {
    /// Returns the vertices at `time` \[s\]. \[m\]
    pub(super) fn at(&self, time: f64) -> Vec<[f32; 3]> {
        self.track.at(time).into_iter().map(|point| point.map(|x| x as f32)).collect()
    }

    /// Returns true if vertices may move between two times. \[s\]
    pub(super) fn moves(&self, [from, to]: [f64; 2]) -> bool {
        let ends = self.track.times.first().zip(self.track.times.last());
        ends.is_some_and(|(first, last)| to > *first && from < *last)
    }
}

impl Guide {
    pub(super) fn of(body: &Body) -> Self {
        Self {
            track: body.track.clone(),
            is_released: body.motion == Motion::Dynamic,
            force: body.force.iter().map(|x| *x as f32).collect(),
            meshes: meshes(body),
        }
    }

    pub(super) fn follows(&self) -> bool {
        !self.track.times.is_empty()
    }

    pub(super) fn pushes(&self) -> bool {
        self.force.iter().any(|x| *x != 0.0)
    }

    /// Returns true if a body still follows its track at `time` \[s\].
    pub(super) fn leads(&self, time: f64) -> bool {
        let end = self.track.times.last().copied().unwrap_or(f64::NEG_INFINITY);
        self.follows() && (!self.is_released || time <= end + SAME_TIME * end.abs().max(1.0))
    }
}

/// Returns the meshes of a body that deform.
fn meshes(body: &Body) -> Vec<MeshGuide> {
    let tracks = body.shapes.iter().enumerate();
    let tracks = tracks.filter_map(|(shape, of)| Some((shape, of.kind.vertex_track()?.clone())));
    tracks.map(|(shape, track)| MeshGuide { shape, track }).collect()
}
