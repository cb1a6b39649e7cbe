//! Which manifolds share no body, and so can be visited side by side.

use crate::lanes::WIDTH;

/// Colors at most; what fits none of them comes after, one by one.
const COLORS: usize = 64;

/// Manifolds of one color are sorted by their number of points, up to this many.
const BINS: usize = 8;

/// A manifold as colors see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Outline {
    /// [`u32::MAX`] for one that cannot be moved: it may have many manifolds of a color.
    bodies: [u32; 2],
    points: u32,
}

/// Places for manifolds in blocks of [`WIDTH`] lanes: no two of a block move the same body.
#[derive(Clone, Debug, Default)]
pub struct Coloring {
    /// The place of each manifold: its block times [`WIDTH`] plus its lane. A block is filled from
    /// lane 0 on; blocks come color after color, in a color by number of points, then in the order
    /// of the manifolds.
    pub places: Vec<u32>,
    /// The blocks of each color; what fits in none has one of its own.
    pub colors: Vec<std::ops::Range<u32>>,
    /// Points of the longest manifold of each block.
    pub points: Vec<u32>,
    outlines: Vec<Outline>,
    /// Those of the call before.
    before: Vec<Outline>,
    used: Vec<u64>,
}

impl Coloring {
    /// Colors manifolds, given by their bodies and number of points, greedily in their order: each
    /// takes the first color that neither of its bodies has. `moves` tells whether a body can be
    /// moved; the others may have many manifolds of a color. Depends on nothing but its arguments.
    pub fn assign(
        &mut self,
        bodies: usize,
        manifolds: impl Iterator<Item = ([u32; 2], u32)>,
        moves: impl Fn(u32) -> bool,
    ) {
        std::mem::swap(&mut self.outlines, &mut self.before);
        self.outlines.clear();
        self.outlines.extend(manifolds.map(|(bodies, points)| Outline {
            bodies: bodies.map(|body| if moves(body) { body } else { u32::MAX }),
            points,
        }));
        // What rests keeps its places.
        if self.outlines == self.before {
            return;
        }
        self.used.clear();
        self.used.resize(bodies, 0);
        self.places.clear();
        let mut counts = [0u32; COLORS * BINS];
        let mut alone = 0;
        // First the kind of each manifold: its color and bin.
        for &Outline { bodies, points } in &self.outlines {
            let [a, b] = bodies.map(|body| self.used.get(body as usize).copied().unwrap_or(0));
            let color = (a | b).trailing_ones() as usize;
            if color == COLORS {
                self.places.push((COLORS * BINS + alone) as u32);
                alone += 1;
                continue;
            }
            for body in bodies {
                if let Some(used) = self.used.get_mut(body as usize) {
                    *used |= 1 << color;
                }
            }
            let kind = color * BINS + (points as usize).min(BINS - 1);
            counts[kind] += 1;
            self.places.push(kind as u32);
        }
        // Then where each kind begins, a new color in a new block.
        let mut next = [0u32; COLORS * BINS];
        let mut end = 0;
        self.colors.clear();
        for (next, counts) in next.chunks_mut(BINS).zip(counts.chunks(BINS)) {
            let first = end / WIDTH as u32;
            for (next, count) in next.iter_mut().zip(counts) {
                *next = end;
                end += count;
            }
            end = end.next_multiple_of(WIDTH as u32);
            if end / WIDTH as u32 > first {
                self.colors.push(first..end / WIDTH as u32);
            }
        }
        let after = end / WIDTH as u32;
        self.colors.extend((0..alone as u32).map(|i| after + i..after + i + 1));
        self.points.clear();
        self.points.resize(end as usize / WIDTH + alone, 0);
        for (place, &Outline { points, .. }) in self.places.iter_mut().zip(&self.outlines) {
            let kind = *place as usize;
            *place = match next.get_mut(kind) {
                Some(next) => {
                    *next += 1;
                    *next - 1
                }
                None => end + ((kind - COLORS * BINS) * WIDTH) as u32,
            };
            let longest = &mut self.points[*place as usize / WIDTH];
            *longest = points.max(*longest);
        }
    }

    /// How many points each manifold has.
    pub(crate) fn counts(&self) -> impl ExactSizeIterator<Item = u32> {
        self.outlines.iter().map(|outline| outline.points)
    }
}
