//! Loops over fixed chunks: the same bits for any number of threads, and without threads at all.
//!
//! Chunk borders depend on the length of the data only, and partial results come back in chunk order.

use std::ops::Range;

#[cfg(feature = "rayon")]
use rayon::prelude::*;

/// Items per chunk where each item is cheap. Larger: less overhead per chunk; smaller: better balance between threads.
pub(crate) const CHUNK: usize = 8192;

/// Items per chunk of `len` where even one item takes long, as a triangle or a row of weights does: threads share the work on small bodies too.
pub(crate) fn chunk(len: usize) -> usize {
    /// Fewer: the sums that each chunk has of its own take as long as its items.
    const LEAST: usize = 1024;
    /// Chunks from which on more bring no better balance.
    const ENOUGH: usize = 8;
    /// Items that one thread has done before another one is awake.
    const TOO_FEW: usize = 4096;
    if len <= TOO_FEW { TOO_FEW } else { (len / ENOUGH).clamp(LEAST, CHUNK) }
}

/// Most partial sums of products over vertices. More: better balance between many threads; fewer: less memory.
pub(crate) const PARTS: usize = 32;

/// `f` of every chunk of `0..len`, in order.
pub(crate) fn map_chunks<R: Send>(len: usize, chunk: usize, f: impl Fn(Range<usize>) -> R + Send + Sync) -> Vec<R> {
    map(len.div_ceil(chunk), |c| f(c * chunk..len.min((c + 1) * chunk)))
}

/// `f(0), f(1), … f(count − 1)`, in order; each call may run on another thread.
pub(crate) fn map<R: Send>(count: usize, f: impl Fn(usize) -> R + Send + Sync) -> Vec<R> {
    // One call is not worth waking other threads for.
    #[cfg(feature = "rayon")]
    if count > 1 {
        return (0..count).into_par_iter().map(f).collect();
    }
    (0..count).map(f).collect()
}

/// `[f(0), … f(len − 1)]`, computed in parallel.
pub(crate) fn collect<T: Send>(len: usize, f: impl Fn(usize) -> T + Send + Sync) -> Vec<T> {
    #[cfg(feature = "rayon")]
    if len > CHUNK {
        return (0..len).into_par_iter().with_min_len(CHUNK).map(f).collect();
    }
    (0..len).map(f).collect()
}

/// [`collect`] in the memory of `out`, where it holds as many items already.
pub(crate) fn fill<T: Send>(out: &mut Vec<T>, len: usize, f: impl Fn(usize) -> T + Send + Sync) {
    if out.len() != len {
        *out = collect(len, f);
        return;
    }
    for_each_chunk(out, CHUNK, |first, part| part.iter_mut().enumerate().for_each(|(i, x)| *x = f(first + i)));
}

/// Makes `out` hold `len` items of any value, in its own memory where it holds as many already.
pub(crate) fn resize<T: Copy + Default + Send>(out: &mut Vec<T>, len: usize) {
    if out.len() != len {
        *out = collect(len, |_| T::default());
    }
}

/// Calls `f(first, part)` for every part of `out` of length `chunk`, with the index of its first item.
pub(crate) fn for_each_chunk<T: Send>(out: &mut [T], chunk: usize, f: impl Fn(usize, &mut [T]) + Send + Sync) {
    #[cfg(feature = "rayon")]
    if out.len() > chunk {
        return out.par_chunks_mut(chunk).enumerate().for_each(|(c, part)| f(c * chunk, part));
    }
    out.chunks_mut(chunk).enumerate().for_each(|(c, part)| f(c * chunk, part));
}

/// `f(first, part)` of every part of `out` of length `chunk`, in order.
pub(crate) fn map_parts<T: Send, R: Send>(
    out: &mut [T],
    chunk: usize,
    f: impl Fn(usize, &mut [T]) -> R + Send + Sync,
) -> Vec<R> {
    #[cfg(feature = "rayon")]
    if out.len() > chunk {
        return out.par_chunks_mut(chunk).enumerate().map(|(c, part)| f(c * chunk, part)).collect();
    }
    out.chunks_mut(chunk).enumerate().map(|(c, part)| f(c * chunk, part)).collect()
}

/// Calls `f(first, parts)` for the parts of equal indices of four arrays of one length.
pub(crate) fn for_each_chunk_of_four<A: Send, B: Send>(
    a: &mut [A],
    [b, c, d]: &mut [Vec<B>; 3],
    f: impl Fn(usize, &mut [A], [&mut [B]; 3]) + Send + Sync,
) {
    #[cfg(feature = "rayon")]
    if a.len() > CHUNK {
        let rest = b.par_chunks_mut(CHUNK).zip(c.par_chunks_mut(CHUNK)).zip(d.par_chunks_mut(CHUNK));
        let all = a.par_chunks_mut(CHUNK).zip(rest).enumerate();
        return all.for_each(|(k, (a, ((b, c), d)))| f(k * CHUNK, a, [b, c, d]));
    }
    f(0, a, [b, c, d]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_bodies_are_shared_and_smaller_ones_are_not() {
        assert!((1..=4096).all(|len| len <= chunk(len)));
        assert_eq!([5_000, 10_000, 65_536, 1_000_000].map(chunk), [1024, 1250, 8192, 8192]);
    }
}
