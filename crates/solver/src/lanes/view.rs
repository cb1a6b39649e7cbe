//! The stored lanes of a system, viewed in lanes of another type.
#![allow(unsafe_code)]

use super::block::Block;
use super::{KernelLanes, Portable};
use crate::{Contact, InverseMass, Manifold, Mobility, SurfaceEffects, Vector, Velocity};

/// A type made of lanes, which can be viewed in lanes of another type.
///
/// # Safety
/// `In<V>` is this type with its lanes replaced by `V`, and its layout is fixed (`repr(C)`).
pub(super) unsafe trait MadeOfLanes {
    /// The same in lanes of type `V`.
    type In<V: KernelLanes>;
}

/// Implements [`MadeOfLanes`] for types with the parameters `<lanes, sizes>`.
macro_rules! made_of_lanes {
    ($($name:ident<$($size:ident),*>)*) => {$(
        // SAFETY: the type is `repr(C)`, and lanes have the same layout.
        unsafe impl<S: KernelLanes, $(const $size: usize),*> MadeOfLanes for $name<S, $($size),*> {
            type In<V: KernelLanes> = $name<V, $($size),*>;
        }
    )*};
}

made_of_lanes!(
    Vector<N> Contact<L> Manifold<L> InverseMass<L, A> Mobility<L, A> SurfaceEffects<L, A>
    Velocity<L, A> Block<L, A>
);

// SAFETY: arrays have a fixed layout.
unsafe impl<T: MadeOfLanes, const N: usize> MadeOfLanes for [T; N] {
    type In<V: KernelLanes> = [T::In<V>; N];
}

// SAFETY: lanes have the same layout.
unsafe impl MadeOfLanes for Portable {
    type In<V: KernelLanes> = V;
}

/// Views a value in lanes of type `V`.
#[inline(always)]
pub(super) fn view<V: KernelLanes, T: MadeOfLanes>(of: &T) -> &T::In<V> {
    const { assert!(size_of::<T>() == size_of::<T::In<V>>()) };
    const { assert!(align_of::<T>() == align_of::<T::In<V>>()) };
    // SAFETY: both types have the same layout, and all bit patterns of lanes are valid.
    unsafe { &*std::ptr::from_ref(of).cast() }
}

/// Views a slice in lanes of type `V`.
#[inline(always)]
pub(super) fn view_all<V: KernelLanes, T: MadeOfLanes>(of: &[T]) -> &[T::In<V>] {
    const { assert!(size_of::<T>() == size_of::<T::In<V>>()) };
    const { assert!(align_of::<T>() == align_of::<T::In<V>>()) };
    // SAFETY: as in `view`.
    unsafe { std::slice::from_raw_parts(of.as_ptr().cast(), of.len()) }
}

/// Views a value in lanes of type `V`, to change it.
#[inline(always)]
pub(super) fn view_mut<V: KernelLanes, T: MadeOfLanes>(of: &mut T) -> &mut T::In<V> {
    &mut view_all_mut(std::slice::from_mut(of))[0]
}

/// Views a slice in lanes of type `V`, to change it.
#[inline(always)]
pub(super) fn view_all_mut<V: KernelLanes, T: MadeOfLanes>(of: &mut [T]) -> &mut [T::In<V>] {
    const { assert!(size_of::<T>() == size_of::<T::In<V>>()) };
    const { assert!(align_of::<T>() == align_of::<T::In<V>>()) };
    // SAFETY: as in `view`.
    unsafe { std::slice::from_raw_parts_mut(of.as_mut_ptr().cast(), of.len()) }
}
