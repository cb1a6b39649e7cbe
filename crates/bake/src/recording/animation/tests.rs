use proptest::prelude::*;

use super::super::pose::{dot, lerp, slerp};
use super::super::sampling::thin;
use super::*;

fn recording(poses: Vec<f32>) -> Recording {
    Recording { dimension: 3, bodies: 1, frame_time: 1.0 / 60.0, start: 0, poses }
}

/// Falls and spins by more than half a turn, then stays at rest.
fn falling(frames: usize) -> Recording {
    let mut poses = Vec::new();
    for frame in 0..frames {
        let t = frame.min(60) as f32 / 60.0;
        let half = 3.0 * t;
        poses.extend([t, 10.0 - 4.9 * t * t, 0.0, half.sin(), 0.0, 0.0, half.cos()]);
    }
    recording(poses)
}

fn clip(recording: &Recording, options: &Sampling) -> (Value, Vec<u8>, bool) {
    let (mut document, mut bytes) = (json!({}), Vec::new());
    let mut gltf = GltfBuffer { document: &mut document, bytes: &mut bytes, buffer: 0 };
    let targets = [Target { node: 0, body: 0, unit: 1.0, local: &as_body }];
    let moves = append_clip(&mut gltf, "clip", recording, (&targets, &[]), options).unwrap();
    (document, bytes, moves.is_some())
}

fn floats(document: &Value, bytes: &[u8], accessor: &Value) -> Vec<f32> {
    let accessor = &document["accessors"][accessor.as_u64().unwrap() as usize];
    let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let number = |x: &Value| x.as_u64().unwrap() as usize;
    let start = number(&view["byteOffset"]) + number(&accessor["byteOffset"]);
    let parts = match accessor["type"].as_str().unwrap() {
        "SCALAR" => 1,
        "VEC3" => 3,
        _ => 4,
    };
    let data = &bytes[start..start + 4 * parts * number(&accessor["count"])];
    data.chunks(4).map(|x| f32::from_le_bytes(x.try_into().unwrap())).collect()
}

/// Returns the value of a channel at a time, as a viewer computes it.
fn play<const N: usize>(keys: &[f32], values: &[f32], time: f32) -> [f64; N] {
    let next = keys.iter().position(|key| *key >= time).unwrap_or(keys.len() - 1).max(1);
    let part = f64::from(time - keys[next - 1]) / f64::from(keys[next] - keys[next - 1]);
    let at = |i: usize| -> [f64; N] { std::array::from_fn(|k| f64::from(values[N * i + k])) };
    let (a, b) = (at(next - 1), at(next));
    if N == 4 {
        let q = slerp(std::array::from_fn(|k| a[k]), std::array::from_fn(|k| b[k]), part);
        return std::array::from_fn(|k| q[k]);
    }
    lerp(a, b, part.clamp(0.0, 1.0))
}

#[test]
fn a_clip_stays_within_its_tolerance_and_is_short() {
    let mut keys = Vec::new();
    for tolerance in [1e-5, 5e-3, 0.1] {
        let options = Sampling::within(tolerance);
        keys.push(keys_within(&falling(600), &options));
        // A piece is as accurate, at its original times.
        keys_within(&falling(600).piece(20..=50), &options);
    }
    assert!(keys[0] < 140 && keys.is_sorted_by(|a, b| a > b), "{keys:?}");
}

/// Returns the number of keys in a clip, after checking that it is within the tolerance.
fn keys_within(run: &Recording, options: &Sampling) -> usize {
    let (document, bytes, _) = clip(run, options);
    let mut count = 0;
    let samplers = document["animations"][0]["samplers"].as_array().unwrap();
    for (path, sampler) in samplers.iter().enumerate() {
        let keys = floats(&document, &bytes, &sampler["input"]);
        let values = floats(&document, &bytes, &sampler["output"]);
        count += keys.len();
        for (frame, at) in run.times().enumerate() {
            let (pose, time) = (pose_at(run, 0, at), at as f32);
            let error = if path == 0 {
                distance(play::<3>(&keys, &values, time), pose.position)
            } else {
                angle(play::<4>(&keys, &values, time), pose.rotation)
            };
            assert!(error < 1.1 * options.position_tolerance, "frame {frame}: {error}");
        }
    }
    count
}

#[test]
fn rotations_change_their_sign_nowhere() {
    let mut run = falling(60);
    run.poses.chunks_mut(14).for_each(|pose| pose[3..7].iter_mut().for_each(|x| *x = -*x));
    let (document, bytes, _) = clip(&run, &Sampling::default());
    let output = &document["animations"][0]["samplers"][1]["output"];
    let values = floats(&document, &bytes, output);
    let keys: Vec<[f64; 4]> =
        values.chunks(4).map(|q| std::array::from_fn(|i| f64::from(q[i]))).collect();
    assert!(keys.windows(2).all(|pair| dot(pair[0], pair[1]) > 0.0));
}

#[test]
fn bodies_at_rest_have_no_channel() {
    let run = recording([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0].repeat(100));
    assert!(!clip(&run, &Sampling::default()).2);
}

#[test]
fn bodies_at_rest_elsewhere_get_their_pose() {
    let run = recording([1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 0.0].repeat(3));
    let mut document = json!({"nodes": [{"translation": [1.0, 2.0, 3.0]}]});
    let mut gltf = GltfBuffer { document: &mut document, bytes: &mut Vec::new(), buffer: 0 };
    let targets = [Target { node: 0, body: 0, unit: 1.0, local: &as_body }];
    let clip = append_clip(&mut gltf, "", &run, (&targets, &[]), &Sampling::default()).unwrap();
    assert_eq!(clip, None);
    let node = json!({"translation": [1.0, 2.0, 3.0], "rotation": [0.0, 1.0, 0.0, 0.0]});
    assert_eq!(document["nodes"][0], node);
}

#[test]
fn a_straight_motion_has_two_keys() {
    let poses = (0..1000).flat_map(|i| [i as f32 / 64.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let (document, ..) = clip(&recording(poses.collect()), &Sampling::default());
    assert_eq!(document["accessors"][0]["count"], 2);
    assert_eq!(document["animations"][0]["channels"].as_array().unwrap().len(), 1);
}

#[test]
fn equal_keys_are_stored_once() {
    let poses = (0..30).flat_map(|i| {
        let half = i as f32 / 100.0;
        [i as f32, 0.0, 0.0, half.sin(), 0.0, 0.0, half.cos()]
    });
    let (document, ..) = clip(
        &recording(poses.collect()),
        &Sampling { rotation_tolerance: 1e-3, ..Sampling::default() },
    );
    let samplers = &document["animations"][0]["samplers"];
    assert_eq!(samplers[0]["input"], samplers[1]["input"]);
}

#[test]
fn other_rates_have_whole_frames() {
    let run = falling(62);
    let options = Sampling { fps: Some(24.0), ..Sampling::default() };
    let times = sample_times(&run, &options);
    assert_eq!(times.len(), 25);
    assert!((times[24] - 1.0).abs() < 1e-12);
    let piece = sample_times(&run.piece(2..=8), &options);
    assert_eq!(piece, times[1..=3]);
    // A rate above the frame rate makes no difference.
    let more = Sampling { fps: Some(100.0), ..options };
    assert_eq!(sample_times(&run, &more).len(), 62);
}

#[test]
fn a_piece_has_its_frames_at_their_times() {
    let run = falling(90);
    let (piece, times) = (run.piece(30..=59), run.times().collect::<Vec<_>>());
    assert_eq!(piece.times().collect::<Vec<_>>(), times[30..=59]);
    for frame in 0..30 {
        assert_eq!(piece.pose(frame, 0), run.pose(30 + frame, 0));
        let between = times[30 + frame] + 0.3 * run.frame_time;
        let held = between.min(times[59]);
        assert_eq!(pose_at(&piece, 0, between), pose_at(&run, 0, held));
    }
    assert_eq!(piece.piece(40..=45), run.piece(40..=45));
    // A single frame without a frame time.
    let still = Recording { frame_time: 0.0, ..run.piece(7..=7) };
    assert_eq!(pose_at(&still, 0, 3.0), pose_at(&run, 0, times[7]));
}

#[test]
fn a_pose_that_is_not_finite_is_an_error() {
    let mut run = falling(3);
    run.poses[8] = f32::NAN;
    let (mut document, mut bytes) = (json!({}), Vec::new());
    let mut gltf = GltfBuffer { document: &mut document, bytes: &mut bytes, buffer: 0 };
    let targets = [Target { node: 0, body: 0, unit: 1.0, local: &as_body }];
    let error =
        append_clip(&mut gltf, "", &run, (&targets, &[]), &Sampling::default()).unwrap_err();
    assert!(error.to_string().starts_with("the pose of body 0 at 0.0166"), "{error}");
}

proptest! {
    #[test]
    fn thinning_keeps_any_track_within_its_tolerance(values in prop::collection::vec(-1.0f32..1.0, 2..60)) {
        let times: Vec<f64> = (0..values.len()).map(|i| i as f64 / 60.0).collect();
        let points: Vec<[f32; 1]> = values.iter().map(|x| [*x]).collect();
        let track = thin(&times, &points, |a, b, part, x| distance(lerp(a, b, part), x) <= 0.2);
        if !track.kept.is_empty() {
            let keys: Vec<f32> = track.kept.iter().map(|i| times[*i as usize] as f32).collect();
            let kept: Vec<f32> = track.values.as_flattened().to_vec();
            for (time, value) in times.iter().zip(&values) {
                let [x] = play::<1>(&keys, &kept, *time as f32);
                prop_assert!((x - f64::from(*value)).abs() <= 0.2 + 1e-5);
            }
        }
    }
}
