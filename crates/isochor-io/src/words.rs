//! Text cut into lines and words, with the place of each.
//!
//! Lines end with LF, CR LF or a lone CR, in any mixture. Words are separated by blanks. Nothing is copied and no text
//! encoding is assumed.

use std::ops::Range;

use crate::{Place, ReadError};

/// What a byte is for the division into words.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Word,
    Blank,
    Break,
    /// Starts a comment up to the end of the line.
    Comment,
    /// Joins the next line where a line break follows at once.
    Join,
}

const fn kinds(comments: bool, joins: bool) -> [Kind; 256] {
    let mut kinds = [Kind::Word; 256];
    kinds[b' ' as usize] = Kind::Blank;
    kinds[b'\t' as usize] = Kind::Blank;
    kinds[0x0b] = Kind::Blank;
    kinds[0x0c] = Kind::Blank;
    kinds[b'\n' as usize] = Kind::Break;
    kinds[b'\r' as usize] = Kind::Break;
    if comments {
        kinds[b'#' as usize] = Kind::Comment;
    }
    if joins {
        kinds[b'\\' as usize] = Kind::Join;
    }
    kinds
}

static PLAIN: [Kind; 256] = kinds(false, false);
static COMMENTED: [Kind; 256] = kinds(true, false);
static OBJ: [Kind; 256] = kinds(true, true);

/// Refuses bytes that no text has; `format` is the name of what it should be.
pub(crate) fn refuse_binary(bytes: &[u8], format: &str) -> Result<(), ReadError> {
    let Some(offset) = bytes.iter().position(|&b| b == 0) else { return Ok(()) };
    let error = ReadError::new(format!("a NUL byte: the file is binary data, not {format} text"));
    let utf16 = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
    let hint = if utf16 { "it looks like UTF-16 text: save it as UTF-8" } else { "export the model again" };
    Err(error.with_hint(hint).at(Place::Byte(offset)))
}

/// Number of the line, counted from 1, that offset `at` stands in.
pub(crate) fn line_of(bytes: &[u8], at: usize) -> usize {
    let breaks = (0..at).filter(|&i| match bytes[i] {
        b'\n' => true,
        b'\r' => bytes.get(i + 1) != Some(&b'\n'),
        _ => false,
    });
    1 + breaks.count()
}

/// The first line break of a text, LF where it has none.
pub(crate) fn line_break(bytes: &[u8]) -> &[u8] {
    match bytes.iter().position(|b| matches!(b, b'\n' | b'\r')) {
        Some(at) if bytes[at..].starts_with(b"\r\n") => b"\r\n",
        Some(at) => &bytes[at..=at],
        None => b"\n",
    }
}

/// A walk through the words of a text.
#[derive(Clone)]
pub(crate) struct Words<'a> {
    bytes: &'a [u8],
    kinds: &'static [Kind; 256],
    at: usize,
    line: usize,
}

impl<'a> Words<'a> {
    /// The words of `bytes` from offset `at`, which stands in line `line`.
    pub(crate) fn plain(bytes: &'a [u8], at: usize, line: usize) -> Self {
        Self { bytes, kinds: &PLAIN, at, line }
    }

    /// As [`Words::plain`], with `#` comments.
    pub(crate) fn commented(bytes: &'a [u8], at: usize, line: usize) -> Self {
        Self { bytes, kinds: &COMMENTED, at, line }
    }

    /// As [`Words::plain`] from the start of `bytes`, with `#` comments and lines joined by `\`.
    pub(crate) fn obj(bytes: &'a [u8]) -> Self {
        Self { bytes, kinds: &OBJ, at: 0, line: 1 }
    }

    /// Offset of the next byte to look at.
    pub(crate) fn at(&self) -> usize {
        self.at
    }

    /// Number of the current line, counted from 1.
    pub(crate) fn line(&self) -> usize {
        self.line
    }

    /// Whether the whole text was walked.
    pub(crate) fn is_done(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// Steps over `bytes` bytes that are no text.
    pub(crate) fn skip(&mut self, bytes: usize) {
        self.at += bytes;
    }

    fn kind(&self) -> Option<Kind> {
        self.bytes.get(self.at).map(|&b| self.kinds[b as usize])
    }

    /// Whether the backslash here joins the next line.
    fn joins(&self) -> bool {
        matches!(self.bytes.get(self.at + 1), Some(b'\n' | b'\r'))
    }

    fn step_over_break(&mut self) {
        let two = self.bytes[self.at] == b'\r' && self.bytes.get(self.at + 1) == Some(&b'\n');
        self.at += if two { 2 } else { 1 };
        self.line += 1;
    }

    /// Span of the next word of this line. `None` at its end.
    #[inline]
    pub(crate) fn next_in_line(&mut self) -> Option<Range<usize>> {
        loop {
            match self.kind()? {
                Kind::Blank => self.at += 1,
                Kind::Join if self.joins() => {
                    self.at += 1;
                    self.step_over_break();
                }
                Kind::Word | Kind::Join => break,
                Kind::Break | Kind::Comment => return None,
            }
        }
        let start = self.at;
        while let Some(kind) = self.kind() {
            match kind {
                Kind::Word => {}
                Kind::Join if !self.joins() => {}
                _ => break,
            }
            self.at += 1;
        }
        Some(start..self.at)
    }

    /// Span of the word so many behind the next one in this line, empty where there is none. The walk stays where it is.
    pub(crate) fn nth_in_line(&self, n: usize) -> Range<usize> {
        let mut ahead = self.clone();
        std::iter::from_fn(|| ahead.next_in_line()).nth(n).unwrap_or_default()
    }

    /// Steps to the line break of this line, or the end of the text, and says where that is.
    pub(crate) fn line_end(&mut self) -> usize {
        while self.next_in_line().is_some() {}
        self.step_over_comment();
        self.at
    }

    /// Steps to the line break behind a comment. It is not joined with the next line: it is more often a path that ends with a backslash.
    fn step_over_comment(&mut self) {
        while self.kind().is_some_and(|k| k != Kind::Break) {
            self.at += 1;
        }
    }

    /// Steps to the start of the next line.
    pub(crate) fn end_line(&mut self) {
        self.line_end();
        if !self.is_done() {
            self.step_over_break();
        }
    }

    /// Steps over blank lines, comments and blanks. Whether a word follows.
    pub(crate) fn skip_blank_lines(&mut self) -> bool {
        loop {
            match self.kind() {
                None => return false,
                Some(Kind::Blank) => self.at += 1,
                Some(Kind::Break) => self.step_over_break(),
                Some(Kind::Comment) => self.step_over_comment(),
                Some(Kind::Word | Kind::Join) => return true,
            }
        }
    }

    /// Span of the next word of this line or a later one. `None` at the end of the text.
    pub(crate) fn next(&mut self) -> Option<Range<usize>> {
        if self.skip_blank_lines() { self.next_in_line() } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8], mut words: Words) -> Vec<(usize, Vec<String>)> {
        let mut all = Vec::new();
        while !words.is_done() {
            let line = words.line();
            let mut row = Vec::new();
            while let Some(span) = words.next_in_line() {
                row.push(String::from_utf8_lossy(&text[span]).into_owned());
            }
            all.push((line, row));
            words.end_line();
        }
        all
    }

    fn row(line: usize, words: &str) -> (usize, Vec<String>) {
        (line, words.split_whitespace().map(str::to_owned).collect())
    }

    #[test]
    fn every_line_end_counts_one_line() {
        let text = b"a b\nc\r\nd\re\n\r\n\rf";
        let want = [row(1, "a b"), row(2, "c"), row(3, "d"), row(4, "e"), row(5, ""), row(6, ""), row(7, "f")];
        assert_eq!(lines(text, Words::plain(text, 0, 1)), want);
    }

    #[test]
    fn obj_comments_and_joined_lines() {
        let text = b"f 1 \\\n 2 3\\\r\n4 # c \\\nv 1\\2#x\n#\\\nend\\";
        let want = [row(1, "f 1 2 3 4"), row(4, "v 1\\2"), row(5, ""), row(6, "end\\")];
        assert_eq!(lines(text, Words::obj(text)), want);
    }

    #[test]
    fn the_end_of_a_line_stands_behind_comments_and_joined_lines() {
        let text = b"f 1 \\\n2 # c\r\nend";
        let mut words = Words::obj(text);
        assert_eq!((words.nth_in_line(2), words.nth_in_line(3), words.at()), (6..7, 0..0, 0));
        assert_eq!(words.line_end(), 11);
        words.end_line();
        assert_eq!((words.at(), words.line(), words.line_end()), (13, 3, 16));
    }

    #[test]
    fn the_first_line_break() {
        for (text, found) in [("a\r\nb\n", "\r\n"), ("a\rb\n", "\r"), ("\n\r", "\n"), ("a", "\n"), ("a\r", "\r")] {
            assert_eq!(line_break(text.as_bytes()), found.as_bytes(), "{text:?}");
        }
    }

    #[test]
    fn words_across_lines() {
        let text = b"  a\n\n b\r\tc \n";
        let mut words = Words::plain(text, 0, 1);
        let mut seen = Vec::new();
        while let Some(span) = words.next() {
            seen.push((text[span][0], words.line()));
        }
        assert_eq!(seen, [(b'a', 1), (b'b', 3), (b'c', 4)]);
    }

    #[test]
    fn words_across_comments() {
        let text = b"# x\n a#y\r\n#\n\n b\\\nc # z";
        let mut words = Words::commented(text, 0, 1);
        let mut seen = Vec::new();
        while let Some(span) = words.next() {
            seen.push((&text[span], words.line()));
        }
        assert_eq!(seen, [(&b"a"[..], 2), (b"b\\", 5), (b"c", 6)]);
    }
}
