//! [`each_of`]: the same work for every body of a recording.

use std::io;

/// Calls `make` for every number below `count`, and returns the results in order. Uses all
/// processors with the feature `threads`.
pub(super) fn each_of<T: Send>(
    count: usize,
    make: impl Fn(usize) -> io::Result<T> + Send + Sync,
) -> io::Result<Vec<T>> {
    #[cfg(feature = "threads")]
    {
        use rayon::iter::{IntoParallelIterator, ParallelIterator};
        (0..count).into_par_iter().map(make).collect()
    }
    #[cfg(not(feature = "threads"))]
    (0..count).map(make).collect()
}
