//! Loads that reports and recordings state for joints that break.

use std::path::Path;

use drystone::StepSettings;
use drystone_bake::recording::JointRecording;
use drystone_bake::recording::joints::{JointFrame, JointLayout};
use drystone_bake::{build, read_toml};

/// Steps a scene until its only joint breaks. Returns force and torque of the report, and those of
/// the recording in that frame.
fn broken(text: &str, settings: &StepSettings) -> Option<[[f64; 2]; 2]> {
    let scene = read_toml(Path::new("scene.toml"), text).unwrap().scene;
    let mut world = build(&scene, settings.clone()).unwrap();
    let mut frames = vec![JointFrame::of(&world, &scene)];
    for _ in 0..(2.0 / scene.time_step) as usize {
        let report = world.step(scene.time_step).unwrap();
        frames.push(JointFrame::of(&world, &scene));
        if let [broken] = report.broken.as_slice() {
            let steps = vec![Vec::new(); frames.len() - 2];
            let steps = steps.iter().chain([&report.broken]).map(Vec::as_slice);
            let recording = JointRecording::new(JointLayout::of(&scene), &frames, steps);
            let [.., force, torque] = *recording.loads else { panic!("no loads") };
            let recorded = [force, torque].map(f64::from);
            return Some([[broken.force, broken.torque], recorded]);
        }
    }
    None
}

/// The load of a joint that broke is at least its strength, in the report and in the recording.
/// This holds for all lengths of steps and numbers of substeps. It is no larger than the whole blow
/// within 1/240 s.
#[test]
fn a_joint_breaks_by_no_less_than_its_strength() {
    let presets = [StepSettings::realtime(), StepSettings::quality(), StepSettings::certified()];
    let mut count = 0;
    for (rate, settings) in [24, 60, 240].into_iter().flat_map(|r| presets.clone().map(|s| (r, s)))
    {
        let time_step = 1.0 / f64::from(rate);
        for strength in [10.5, 50.0, 200.0, 400.0, 600.0] {
            // A ball of 1 kg falls by 0.5 m until its rope is taut.
            let rope = format!(
                "time_step = {time_step}\n[[bodies]]\nname = \"a\"\nmass = 1\n\
                 shapes = [{{ type = \"sphere\", radius = 0.1 }}]\n\
                 [[joints]]\ntype = \"rope\"\nbodies = [\"a\"]\n\
                 anchors = [[0, 0, 0], [0, 0, 0]]\nlength = 0.5\n\
                 breaking = {{ force = {strength} }}\n"
            );
            let found = broken(&rope, &settings);
            // Few substeps spread the blow over more time, and a strong joint holds.
            let Some([told, recorded]) = found else { continue };
            count += 1;
            let most = 3.2 * 240.0 + 20.0;
            assert!((strength..most).contains(&told[0]), "{rate} {strength}: {told:?}");
            assert!((told[0] - recorded[0]).abs() < 1e-4 * told[0], "{told:?} {recorded:?}");
        }
        for strength in [5.5, 30.0, 100.0] {
            // A ball falls on the end of a bar of 1 m that is fixed to the world.
            let bar = format!(
                "time_step = {time_step}\n[[bodies]]\nname = \"bar\"\nmass = 1\n\
                 position = [0.5, 0, 0]\n\
                 shapes = [{{ type = \"box\", half_extents = [0.5, 0.05, 0.1] }}]\n\
                 [[bodies]]\nposition = [0.9, 0.6, 0]\nmass = 2\n\
                 shapes = [{{ type = \"sphere\", radius = 0.1 }}]\n\
                 [[joints]]\ntype = \"fixed\"\nbodies = [\"bar\"]\nanchor = [0, 0, 0]\n\
                 breaking = {{ torque = {strength} }}\n"
            );
            let found = broken(&bar, &settings);
            let Some([told, recorded]) = found else { continue };
            count += 1;
            assert!(told[1] >= strength, "{rate} {strength}: {told:?}");
            assert!((told[1] - recorded[1]).abs() < 1e-4 * told[1], "{told:?} {recorded:?}");
        }
    }
    assert!(count > 50, "{count} joints broke");
}
