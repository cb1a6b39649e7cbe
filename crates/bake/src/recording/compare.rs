//! Compares two recordings of the same bodies.

use super::Recording;
use super::pose::{angle, distance, frame_pose};

/// Difference between two poses of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Index of the frame, from 0.
    pub frame: usize,
    /// Index of the body.
    pub body: usize,
    /// Distance between both positions; not finite if one of them is not. \[m\]
    pub distance: f64,
    /// Angle between both rotations. \[rad\]
    pub angle: f64,
}

/// Returns all poses that differ in any bit, frame by frame. Frames and bodies that only one
/// recording has are left out.
pub fn differences<'a>(
    a: &'a Recording,
    b: &'a Recording,
) -> impl Iterator<Item = Difference> + 'a {
    let bodies = a.bodies.min(b.bodies);
    let places =
        (0..a.frames().min(b.frames())).flat_map(move |f| (0..bodies).map(move |b| (f, b)));
    let bits = |pose: &[f32]| pose.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    places.filter(move |&(frame, body)| bits(a.pose(frame, body)) != bits(b.pose(frame, body))).map(
        move |(frame, body)| {
            let [from, to] = [a, b].map(|recording| frame_pose(recording, frame, body));
            Difference {
                frame,
                body,
                distance: distance(from.position, to.position),
                angle: angle(from.rotation, to.rotation),
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording(poses: Vec<f32>) -> Recording {
        Recording { dimension: 2, bodies: 2, frame_time: 0.5, start: 0, poses }
    }

    #[test]
    fn a_difference_has_its_place_and_size() {
        let poses: Vec<f32> = (0..18).map(|i| i as f32).collect();
        let a = recording(poses.clone());
        assert_eq!(differences(&a, &a).count(), 0);
        let mut other = poses.clone();
        (other[9], other[10], other[17]) = (9.0 + 3.0, 10.0 + 4.0, 17.25);
        let found: Vec<_> = differences(&a, &recording(other)).collect();
        let places: Vec<_> = found.iter().map(|of| (of.frame, of.body)).collect();
        assert_eq!(places, [(1, 1), (2, 1)]);
        assert!((found[0].distance - 5.0).abs() < 1e-12 && found[0].angle < 1e-12);
        assert!(found[1].distance == 0.0 && (found[1].angle - 0.25).abs() < 1e-6);
        let shorter = recording(poses[..6].to_vec());
        assert_eq!(differences(&a, &shorter).count(), 0);
    }

    #[test]
    fn the_sign_of_zero_and_nan_are_differences() {
        let (a, b) = (recording(vec![0.0; 6]), recording(vec![-0.0; 6]));
        assert_eq!(differences(&a, &b).count(), 2);
        let lost = recording(vec![f32::NAN; 6]);
        assert_eq!(differences(&lost, &lost).count(), 0);
        assert!(differences(&a, &lost).all(|of| !of.distance.is_finite()));
    }
}
