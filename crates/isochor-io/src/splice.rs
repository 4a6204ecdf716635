//! A copy of some bytes with a few spans replaced.

use std::ops::Range;

/// Copies `source` while replacing spans of it, front to back.
pub(crate) struct Splice<'a> {
    source: &'a [u8],
    copied: usize,
    out: Vec<u8>,
}

impl<'a> Splice<'a> {
    pub(crate) fn new(source: &'a [u8]) -> Self {
        Self { source, copied: 0, out: Vec::with_capacity(source.len()) }
    }

    /// A copy of the bytes at `span` only; places count in the whole `source`.
    pub(crate) fn of_part(source: &'a [u8], span: Range<usize>) -> Self {
        Self { copied: span.start, out: Vec::with_capacity(span.len()), source: &source[..span.end] }
    }

    /// Writes `bytes` in place of `span`, which lies behind all spans replaced before.
    pub(crate) fn replace(&mut self, span: Range<usize>, bytes: &[u8]) {
        debug_assert!(self.copied <= span.start && span.start <= span.end);
        self.out.extend_from_slice(&self.source[self.copied..span.start]);
        self.out.extend_from_slice(bytes);
        self.copied = span.end;
    }

    /// The copy, with what is left of the source.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        self.out.extend_from_slice(&self.source[self.copied..]);
        self.out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_spans_of_other_lengths_and_keeps_the_rest() {
        let mut splice = Splice::new(b"one two three");
        splice.replace(0..3, b"1");
        splice.replace(4..4, b"and ");
        splice.replace(8..13, b"thirty-three");
        assert_eq!(splice.finish(), b"1 and two thirty-three");
        let mut part = Splice::of_part(b"one two three", 4..7);
        part.replace(5..6, b"WW");
        assert_eq!(part.finish(), b"tWWo");
    }
}
