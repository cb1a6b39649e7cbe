//! Which manifolds share no body, and so can be visited side by side.

/// Colors at most; what fits none of them comes after, one by one.
const COLORS: usize = 64;

/// Manifolds sorted by color: no two of a color move the same body.
#[derive(Clone, Debug, Default)]
pub struct Coloring {
    /// Indices of the manifolds, color after color, in their own order within a color.
    pub order: Vec<u32>,
    /// Where each color ends in `order`. The last "colors" may hold a single manifold each.
    pub ends: Vec<u32>,
    used: Vec<u64>,
    color: Vec<u32>,
}

impl Coloring {
    /// Colors manifolds, given by their bodies, greedily in their order: each takes the first color
    /// that neither of its bodies has. `moves` tells whether a body can be moved; the others may
    /// have many manifolds of a color. Depends on nothing but its arguments.
    pub fn assign(
        &mut self,
        bodies: usize,
        manifolds: impl Iterator<Item = [u32; 2]>,
        moves: impl Fn(u32) -> bool,
    ) {
        self.used.clear();
        self.used.resize(bodies, 0);
        self.color.clear();
        let mut counts = [0u32; COLORS];
        let mut alone = 0;
        for pair in manifolds {
            let [a, b] = pair.map(|body| if moves(body) { self.used[body as usize] } else { 0 });
            let color = (a | b).trailing_ones() as usize;
            if color < COLORS {
                counts[color] += 1;
                for body in pair {
                    self.used[body as usize] |= 1 << color;
                }
                self.color.push(color as u32);
            } else {
                self.color.push(COLORS as u32 + alone);
                alone += 1;
            }
        }
        self.ends.clear();
        let mut next = [0u32; COLORS];
        let mut end = 0;
        for (count, start) in counts.iter().zip(&mut next) {
            *start = end;
            end += count;
            if *count > 0 {
                self.ends.push(end);
            }
        }
        let colored = end;
        self.ends.extend((0..alone).map(|i| colored + i + 1));
        self.order.clear();
        self.order.resize(self.color.len(), 0);
        for (index, &color) in self.color.iter().enumerate() {
            let place = match next.get_mut(color as usize) {
                Some(start) => {
                    *start += 1;
                    *start - 1
                }
                None => colored + color - COLORS as u32,
            };
            self.order[place as usize] = index as u32;
        }
    }
}
