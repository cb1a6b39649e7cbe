//! [`Velocities`]: velocities of bodies over time, beside the poses of a
//! [`Recording`](super::Recording).
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::arithmetic_side_effects
    )
)]

use std::ops::RangeInclusive;

/// Velocities of all bodies over time. Empty if they are unknown.
///
/// The linear velocity is that of the center of mass, as in scenes. It is not that of the body's
/// origin, whose position the pose states. Both velocities are in world axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Velocities {
    /// Numbers by frame, body and component: vx vy vz wx wy wz in 3D, vx vy w in 2D.
    /// \[m/s, rad/s\]
    pub numbers: Vec<f32>,
}

impl Velocities {
    /// Returns how many numbers the velocity of a body has.
    pub fn stride(dimension: usize) -> usize {
        if dimension == 3 { 6 } else { 3 }
    }

    /// Joins linear and angular velocities, which are as many.
    pub fn join(dimension: usize, linear: &[f32], angular: &[f32]) -> Self {
        let of = (linear.chunks(dimension.max(1)), angular.chunks(Self::turning(dimension)));
        let numbers = of.0.zip(of.1).flat_map(|(v, w)| v.iter().chain(w)).copied().collect();
        Self { numbers }
    }

    /// Returns how many numbers an angular velocity has.
    pub(super) fn turning(dimension: usize) -> usize {
        if dimension == 3 { 3 } else { 1 }
    }

    /// Returns the velocities of the centers of mass, by frame, body and component. \[m/s\]
    pub fn linear(&self, dimension: usize) -> impl Iterator<Item = f32> {
        let all = self.numbers.chunks(Self::stride(dimension));
        all.flat_map(move |numbers| numbers.iter().take(dimension)).copied()
    }

    /// Returns the angular velocities, by frame, body and component. \[rad/s\]
    pub fn angular(&self, dimension: usize) -> impl Iterator<Item = f32> {
        let all = self.numbers.chunks(Self::stride(dimension));
        all.flat_map(move |numbers| numbers.iter().skip(dimension)).copied()
    }

    /// Returns the frames at these places, each of `frame` numbers; none if they are unknown.
    #[must_use]
    pub fn piece(&self, places: &RangeInclusive<usize>, frame: usize) -> Self {
        let end = places.end().saturating_add(1).saturating_mul(frame);
        let numbers = self.numbers.get(places.start().saturating_mul(frame)..end);
        Self { numbers: numbers.unwrap_or_default().to_vec() }
    }
}
