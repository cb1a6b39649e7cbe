use std::fs;

use super::*;
use crate::recording::joints::{AxisName, JointMiss};

fn header() -> Header {
    Header {
        version: "0.1.0".to_owned(),
        scene: "00ff".to_owned(),
        settings: StepSettings::certified(),
        dimension: 2,
        frame_time: 1.0 / 60.0,
        names: vec!["ball".to_owned(), "Würfel 2".to_owned()],
        joints: JointLayout {
            names: vec!["Tür".to_owned()],
            axes: vec![AxisName { joint: 0, coordinate: "twist".to_owned() }],
        },
        extras: Extras { velocities: true, contacts: true },
    }
}

fn contacts(frame: usize) -> PairImpulses {
    let numbers = vec![frame as f32; 2 * frame];
    PairImpulses {
        bodies: vec![[1, 0]; frame],
        points: numbers.clone(),
        normals: numbers,
        impulses: vec![0.5; frame],
        speeds: vec![0.25; frame],
    }
}

/// Appends a frame with velocities and contacts.
fn append(journal: &mut Journal, step: Option<&Step>, number: usize) {
    let (poses, joints, contacts) = (poses(number), joints(number), contacts(number));
    let velocities: Vec<_> = poses.iter().map(|x| -x).collect();
    let state =
        FrameState { poses: &poses, joints: &joints, velocities: &velocities, contacts: &contacts };
    journal.frame(step, &state).unwrap();
}

fn joints(frame: usize) -> JointFrame {
    let worst = [None, (frame > 0).then_some(JointMiss { joint: 0, by: 1e-5 })];
    JointFrame { values: vec![frame as f32], loads: vec![3.0, 0.5], worst }
}

fn step(state: u64) -> Step {
    let measure = Measure { residual: f64::INFINITY, ..Measure::default() };
    Step { time: Duration::from_micros(state), report: StepReport::default(), measure, state }
}

fn poses(frame: usize) -> Vec<f32> {
    (0..6).map(|i| (6 * frame + i) as f32 / 3.0).collect()
}

/// Writes four frames, with a checkpoint after the third. Returns the offset at which each record
/// ends.
fn write(path: &Path) -> Vec<u64> {
    let mut journal = Journal::create(path, &header()).unwrap();
    let mut ends = vec![MAGIC.len() as u64, journal.size()];
    for frame in 0..4 {
        append(&mut journal, (frame > 0).then(|| step(frame as u64)).as_ref(), frame);
        ends.push(journal.size());
        if frame == 2 {
            journal.checkpoint(b"state").unwrap();
            ends.push(journal.size());
        }
    }
    ends
}

fn whole() -> (tempfile::TempDir, PathBuf, Vec<u64>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.glb.journal");
    let ends = write(&path);
    (folder, path, ends)
}

#[test]
fn reading_what_was_written_gives_the_same() {
    let (_folder, path, _) = whole();
    let contents = read(&path).unwrap();
    assert_eq!(contents.header, header());
    assert_eq!(contents.steps, [step(1), step(2), step(3)]);
    assert_eq!(contents.joints, [0, 1, 2, 3].map(joints));
    let all: Vec<f32> = (0..4).flat_map(poses).collect();
    assert_eq!(contents.recording.poses, all);
    assert_eq!(contents.velocities.numbers, all.iter().map(|x| -x).collect::<Vec<_>>());
    assert_eq!(contents.contacts, [0, 1, 2, 3].map(contacts));
    assert_eq!(contents.recording.frames(), 4);
    let (mut journal, contents) = Journal::resume(&path).unwrap().unwrap();
    let [mark] = contents.checkpoints[..] else { panic!("one checkpoint") };
    assert_eq!((mark.step, journal.state_at(mark).unwrap()), (2, b"state".to_vec()));
    append(&mut journal, Some(&step(4)), 4);
    assert_eq!(read(&path).unwrap().steps.len(), 4);
}

/// A journal cut off anywhere keeps its whole records, and continues from there.
#[test]
fn a_torn_record_is_cut_off() {
    let (_folder, path, ends) = whole();
    let bytes = fs::read(&path).unwrap();
    for cut in 0..bytes.len() {
        fs::write(&path, &bytes[..cut]).unwrap();
        let records = ends.iter().filter(|end| **end <= cut as u64).count();
        // The first line, the header and the initial state.
        let Some((mut journal, contents)) = Journal::resume(&path).unwrap() else {
            assert!(records < 3, "{cut}");
            Journal::create(&path, &header()).unwrap();
            continue;
        };
        let frames = [0, 0, 0, 1, 2, 3, 3, 4][records];
        assert_eq!(contents.recording.poses.len(), 6 * frames, "{cut}");
        assert_eq!(fs::metadata(&path).unwrap().len(), ends[records - 1], "{cut}");
        append(&mut journal, Some(&step(9)), 9);
        assert_eq!(read(&path).unwrap().recording.poses.len(), 6 * (frames + 1), "{cut}");
    }
}

/// A flipped bit ends the journal before its record, or makes it unreadable.
#[test]
fn a_flipped_bit_is_detected() {
    let (_folder, path, ends) = whole();
    let (bytes, good) = (fs::read(&path).unwrap(), read(&path).unwrap());
    for place in 0..bytes.len() {
        let mut turned = bytes.clone();
        turned[place] ^= 1 << (place % 8);
        fs::write(&path, &turned).unwrap();
        let records = ends.iter().filter(|end| **end <= place as u64).count();
        let Ok(found) = read(&path) else {
            assert!(records < 2, "{place}");
            continue;
        };
        assert!(found.steps.len() < good.steps.len(), "{place}");
        assert!(good.steps.starts_with(&found.steps) && found.header == good.header, "{place}");
    }
}

/// A record from another offset does not count.
#[test]
fn records_do_not_move() {
    let (_folder, path, ends) = whole();
    let mut bytes = fs::read(&path).unwrap();
    // The second frame, twice.
    let second = bytes[ends[2] as usize..ends[3] as usize].to_vec();
    bytes.truncate(ends[3] as usize);
    bytes.extend(second);
    fs::write(&path, &bytes).unwrap();
    assert_eq!(read(&path).unwrap().steps.len(), 1);
}

#[test]
fn one_writes_and_others_read() {
    let (_folder, path, _) = whole();
    let (_journal, _) = Journal::resume(&path).unwrap().unwrap();
    for error in [
        Journal::resume(&path).map(|_| ()).unwrap_err(),
        Journal::create(&path, &header()).map(|_| ()).unwrap_err(),
    ] {
        assert!(error.to_string().contains("another bake writes to it"), "{error}");
    }
    assert_eq!(read(&path).unwrap().steps.len(), 3);
}

#[test]
fn files_that_are_not_journals_are_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("letters.journal");
    assert!(Journal::resume(&path).unwrap().is_none());
    fs::write(&path, "Dear diary").unwrap();
    for error in [
        read(&path).map(|_| ()).unwrap_err(),
        Journal::resume(&path).map(|_| ()).unwrap_err(),
        Journal::create(&path, &header()).map(|_| ()).unwrap_err(),
    ] {
        assert!(error.to_string().contains("not a journal"), "{error}");
    }
    assert_eq!(fs::read(&path).unwrap(), b"Dear diary");
}

#[test]
fn a_difference_is_named() {
    let own = header();
    assert_eq!(own.difference(&header()), None);
    let mut other = header();
    other.scene = "01ff".to_owned();
    assert!(own.difference(&other).unwrap().contains("another scene"));
    other.settings.substeps = 9;
    assert_eq!(own.difference(&other).unwrap(), "it was baked with substeps 8, not 9");
    other.version = "0.2.0".to_owned();
    assert_eq!(own.difference(&other).unwrap(), "it has version 0.1.0; accepted: 0.2.0");
}
