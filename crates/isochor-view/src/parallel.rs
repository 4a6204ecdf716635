//! Loops whose results have the same bits for any number of threads, and without threads at all.
//!
//! Pieces depend on the length of the data only, and results come back in order.

use std::ops::Range;

#[cfg(feature = "rayon")]
use rayon::prelude::*;

/// Items per chunk where each item is cheap. Larger: less overhead per chunk; smaller: better balance between threads.
pub(crate) const CHUNK: usize = 8192;

/// `f(0), f(1), … f(count − 1)`, in order; each call may run on another thread.
pub(crate) fn map<R: Send>(count: usize, f: impl Fn(usize) -> R + Send + Sync) -> Vec<R> {
    #[cfg(feature = "rayon")]
    if count > 1 {
        return (0..count).into_par_iter().map(f).collect();
    }
    (0..count).map(f).collect()
}

/// `f` of every chunk of `0..len`, in order.
pub(crate) fn map_chunks<R: Send>(len: usize, chunk: usize, f: impl Fn(Range<usize>) -> R + Send + Sync) -> Vec<R> {
    map(len.div_ceil(chunk), |c| f(c * chunk..len.min((c + 1) * chunk)))
}

/// `[f(0), … f(len − 1)]`, computed in parallel.
pub(crate) fn collect<T: Send>(len: usize, f: impl Fn(usize) -> T + Send + Sync) -> Vec<T> {
    #[cfg(feature = "rayon")]
    if len > CHUNK {
        return (0..len).into_par_iter().with_min_len(CHUNK).map(f).collect();
    }
    (0..len).map(f).collect()
}

/// `a()` and `b()`, each perhaps on a thread of its own.
pub(crate) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    #[cfg(feature = "rayon")]
    return rayon::join(a, b);
    #[cfg(not(feature = "rayon"))]
    (a(), b())
}
