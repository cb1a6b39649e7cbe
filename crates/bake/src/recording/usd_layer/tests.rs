use super::*;

/// Layers name their stage relative to their own folder, wherever either lies.
#[test]
fn the_stage_is_named_from_the_folder_of_the_layer() {
    let folder = tempfile::tempdir().unwrap();
    let at = |path: &str| folder.path().join(path);
    for path in ["a/b", "c"] {
        fs::create_dir_all(at(path)).unwrap();
    }
    for (stage, layer, expected) in [
        ("a/s.usda", "a/l.usda", "./s.usda"),
        ("a/b/s.usda", "a/l.usda", "./b/s.usda"),
        ("a/s.usda", "a/b/l.usda", "../s.usda"),
        ("a/b/s.usda", "c/l.usda", "../a/b/s.usda"),
    ] {
        assert_eq!(relative(&at(stage), &at(layer)).unwrap(), expected, "{stage} in {layer}");
    }
}

/// A scale with rotation is rigid; a mirror, a shear and different scales are not.
#[test]
fn maps_are_split_where_they_can_be() {
    let turn = [0.0, 0.6, 0.0, 0.8];
    let scaled = |sizes: Vec3| math::mul(math::rotation(turn), math::diagonal(sizes));
    let (found, scale) = rigid(scaled([2.0; 3])).unwrap();
    assert!((scale - 2.0).abs() < 1e-12 && math::quat_dot(found, turn).abs() > 1.0 - 1e-12);
    assert_eq!(rigid(scaled([-2.0; 3])), None);
    assert_eq!(rigid(scaled([1.0, 2.0, 1.0])), None);
    assert_eq!(diagonal(&math::diagonal([1.0, 2.0, -0.5])), Some([1.0, 2.0, -0.5]));
    assert_eq!(diagonal(&scaled([1.0; 3])), None);
}
