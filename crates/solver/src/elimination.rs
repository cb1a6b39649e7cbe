//! Order in which the rows of a sparse symmetric matrix are eliminated, and the fill-in.
//!
//! The next row is the one with the fewest remaining neighbors (Tinney and Walker 1967), so that a chain
//! costs as much as its length, and a wall not much more. Only indices decide the order: equal input
//! gives equal bits.

use std::collections::BTreeSet;

/// The rows in the order of their elimination.
#[derive(Debug)]
pub(crate) struct Elimination {
    /// The row that is eliminated at each step.
    pub(crate) order: Vec<u32>,
    /// The step at which each row is eliminated.
    pub(crate) place: Vec<u32>,
    /// For each step the steps after it of the rows that its row is coupled with then, in ascending
    /// order.
    pub(crate) later: Vec<Vec<u32>>,
}

impl Elimination {
    /// Orders rows with these neighbors. The lists may have duplicates, and the row itself.
    pub(crate) fn of(mut neighbors: Vec<Vec<u32>>) -> Self {
        neighbors.iter_mut().for_each(tidy);
        let groups = (0..neighbors.len() as u32).map(|row| vec![row]).collect();
        Self::of_groups(&neighbors, groups)
    }

    /// Orders rows with these neighbors, and takes those with the same ones together: contacts of a pair
    /// of bodies. That makes the order, not the elimination, cheaper.
    #[cfg(feature = "assembled")]
    pub(crate) fn of_twins(mut neighbors: Vec<Vec<u32>>) -> Self {
        for (list, row) in neighbors.iter_mut().zip(0..) {
            list.push(row);
            tidy(list);
        }
        let mut groups: Vec<Vec<u32>> = Vec::new();
        let mut known = std::collections::BTreeMap::new();
        for (list, row) in neighbors.iter().zip(0..) {
            let group = *known.entry(list).or_insert(groups.len());
            if group == groups.len() {
                groups.push(Vec::new());
            }
            groups[group].push(row);
        }
        Self::of_groups(&neighbors, groups)
    }

    /// Orders groups of rows, each of which are neighbors of each other and of the same other rows.
    fn of_groups(neighbors: &[Vec<u32>], groups: Vec<Vec<u32>>) -> Self {
        let mut group_of = vec![0; neighbors.len()];
        for (rows, group) in groups.iter().zip(0..) {
            rows.iter().for_each(|&row| group_of[row as usize] = group);
        }
        let near = groups.iter().zip(0..).map(|(rows, group)| {
            let own = neighbors[rows[0] as usize].iter().map(|&row| group_of[row as usize]);
            let mut near: Vec<u32> = own.filter(|&other| other != group).collect();
            tidy(&mut near);
            near
        });
        let weights: Vec<usize> = groups.iter().map(Vec::len).collect();
        let (group_order, columns) = eliminate(near.collect(), &weights);
        let order: Vec<u32> =
            group_order.iter().flat_map(|&group| &groups[group as usize]).copied().collect();
        let mut place = vec![0; order.len()];
        for (&row, step) in order.iter().zip(0..) {
            place[row as usize] = step;
        }
        let steps = |group: u32| groups[group as usize].iter().map(|&row| place[row as usize]);
        let mut later = Vec::with_capacity(order.len());
        for (&group, column) in group_order.iter().zip(&columns) {
            let mut after: Vec<u32> = column.iter().flat_map(|&other| steps(other)).collect();
            after.sort_unstable();
            for step in steps(group) {
                let own = steps(group).filter(|&other| other > step);
                later.push(own.chain(after.iter().copied()).collect());
            }
        }
        Self { order, place, later }
    }
}

fn tidy(list: &mut Vec<u32>) {
    list.sort_unstable();
    list.dedup();
}

/// Eliminates the rows, each time the one whose remaining neighbors weigh least, and the lowest of these.
/// Its neighbors become neighbors of each other. Returns the order, and the neighbors of each row at its
/// elimination. Lists of neighbors are in ascending order.
fn eliminate(mut neighbors: Vec<Vec<u32>>, weights: &[usize]) -> (Vec<u32>, Vec<Vec<u32>>) {
    let count = neighbors.len();
    let weigh = |list: &[u32]| list.iter().map(|&row| weights[row as usize]).sum::<usize>();
    let mut degrees: Vec<usize> = neighbors.iter().map(|list| weigh(list)).collect();
    let mut queue: BTreeSet<(usize, u32)> =
        degrees.iter().zip(0..).map(|(&degree, row)| (degree, row)).collect();
    let (mut order, mut columns) = (Vec::with_capacity(count), Vec::with_capacity(count));
    let mut merged = Vec::new();
    while let Some((_, row)) = queue.pop_first() {
        let clique = std::mem::take(&mut neighbors[row as usize]);
        for &other in &clique {
            let (list, degree) = (&mut neighbors[other as usize], &mut degrees[other as usize]);
            queue.remove(&(*degree, other));
            merged.clear();
            merge(list, &clique, |each| each != row && each != other, &mut merged);
            std::mem::swap(list, &mut merged);
            *degree = weigh(list);
            queue.insert((*degree, other));
        }
        order.push(row);
        columns.push(clique);
    }
    (order, columns)
}

/// Merges two sorted lists, and leaves out what `keep` rejects.
fn merge(a: &[u32], b: &[u32], keep: impl Fn(u32) -> bool, out: &mut Vec<u32>) {
    let (mut i, mut j) = (0, 0);
    while i < a.len() || j < b.len() {
        let next = match (a.get(i), b.get(j)) {
            (Some(&x), Some(&y)) => x.min(y),
            (Some(&x), None) => x,
            (None, Some(&y)) => y,
            (None, None) => break,
        };
        i += usize::from(a.get(i) == Some(&next));
        j += usize::from(b.get(j) == Some(&next));
        if keep(next) {
            out.push(next);
        }
    }
}
