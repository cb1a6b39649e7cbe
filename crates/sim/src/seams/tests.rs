use super::*;

/// Returns which of some changes stand. Each is given as its manifold, the manifold of its plane,
/// and whether it is slight.
fn standing(changes: &[(u32, u32, bool)]) -> Vec<bool> {
    let closing = Approaching { pair: 0, manifold: 0 };
    let separating =
        SeparatingAxis { axis: Vector([1.0, 0.0]), gap: 0.0, levels: [[0.0; 2]; MAX_POINTS] };
    let change = |&(manifold, plane, slight): &(u32, u32, bool)| AxisChange {
        closing,
        manifold,
        plane,
        side: 0,
        separating,
        slight,
    };
    let mut resolver = SeamResolver::<2>::default();
    resolver.changes.extend(changes.iter().map(change));
    resolver.stands.resize(changes.len(), None);
    (0..changes.len()).map(|at| resolver.stands(at)).collect()
}

/// A manifold gives way to one that keeps its axis, or nearly does, but not to one that gives way.
/// The first of two that would give way to each other does.
#[test]
fn manifolds_do_not_give_way_to_those_that_give_way() {
    assert_eq!(standing(&[(1, 0, false), (2, 1, false)]), [true, false]);
    assert_eq!(standing(&[(1, 0, false), (2, 1, false), (3, 2, false)]), [true, false, true]);
    assert_eq!(standing(&[(1, 2, false), (2, 1, false)]), [true, false]);
    assert_eq!(standing(&[(1, 0, true), (2, 1, false)]), [true, true]);
    assert_eq!(standing(&[(1, END, false), (2, END, false)]), [true, true]);
}
