//! Bodies of PLY files: rows of numbers, as text or binary.

use std::ops::Range;

use crate::number::{finite, integer, push_shortest, quoted};
use crate::ply_header::{Element, Encoding, Header, Kind, Scalar};
use crate::words::Words;
use crate::{Place, ReadError};

/// A walk through the numbers of a body.
pub(crate) struct Body<'a> {
    bytes: &'a [u8],
    walk: Walk<'a>,
    /// Number of rows with more numbers than the header announces that were read past, and what is wrong with the first.
    surplus: Option<(usize, ReadError)>,
}

enum Walk<'a> {
    Text(Words<'a>),
    Binary { at: usize, big: bool },
}

impl<'a> Body<'a> {
    /// From `start`: an offset, and the number of its line where the body is text.
    pub(crate) fn new(bytes: &'a [u8], encoding: Encoding, start: (usize, usize)) -> Self {
        let walk = match encoding {
            Encoding::Text => Walk::Text(Words::plain(bytes, start.0, start.1)),
            Encoding::LittleEndian => Walk::Binary { at: start.0, big: false },
            Encoding::BigEndian => Walk::Binary { at: start.0, big: true },
        };
        Self { bytes, walk, surplus: None }
    }

    /// Where the walk is: an offset, and the number of its line where the body is text.
    pub(crate) fn position(&self) -> (usize, usize) {
        match &self.walk {
            Walk::Text(words) => (words.at(), words.line()),
            Walk::Binary { at, .. } => (*at, 0),
        }
    }

    /// Where the walk is, for a message.
    pub(crate) fn place(&self) -> Place {
        match &self.walk {
            Walk::Text(words) => Place::Line(words.line()),
            Walk::Binary { at, .. } => Place::Byte(*at),
        }
    }

    /// Refuses an element that announces more rows than the bytes left can hold.
    pub(crate) fn check_room(&self, element: &Element, header: &Header) -> Result<(), ReadError> {
        let left = self.bytes.len().saturating_sub(self.position().0) as u64;
        let row = element.least_row_size(header.encoding) as u64;
        // The last line of a text may lack its end.
        let room = if header.encoding == Encoding::Text { left + 1 } else { left };
        if element.rows.checked_mul(row).is_some_and(|size| size <= room) {
            return Ok(());
        }
        let (rows, name) = (element.rows, quoted(&element.name));
        Err(ReadError::new(format!(
            "{rows} rows of {name} are announced, at least {row} bytes each, but only {left} bytes are left"
        ))
        .with_hint("the file is cut, or a count in the header is wrong")
        .at_line(element.line))
    }

    /// Steps to the first number of the next row.
    pub(crate) fn begin_row(&mut self, element: &Element) -> Result<(), ReadError> {
        let Walk::Text(words) = &mut self.walk else { return Ok(()) };
        if words.skip_blank_lines() {
            return Ok(());
        }
        let (rows, name) = (element.rows, quoted(&element.name));
        Err(ReadError::new(format!("the text ends before the last of {rows} rows of {name}"))
            .with_hint("the file is cut, or a count in the header is wrong")
            .at(self.place()))
    }

    /// Steps over the end of a row that does not hold coordinates. Some programs write more numbers there than their
    /// header announces; [`Body::end`] says whether that is well.
    pub(crate) fn end_loose_row(&mut self, element: &Element) {
        if let Err(error) = self.end_row(element) {
            let (rows, first) = self.surplus.take().unwrap_or((0, error));
            self.surplus = Some((rows + 1, first));
            if let Walk::Text(words) = &mut self.walk {
                words.end_line();
            }
        }
    }

    /// Steps over the end of a row, where nothing more may stand.
    pub(crate) fn end_row(&mut self, element: &Element) -> Result<(), ReadError> {
        let Walk::Text(words) = &mut self.walk else { return Ok(()) };
        if let Some(word) = words.next_in_line() {
            let (number, name) = (quoted(&self.bytes[word]), quoted(&element.name));
            return Err(ReadError::new(format!("{number} is one number too many for a row of {name}"))
                .with_hint("each row is one line with the numbers that the header announces")
                .at(self.place()));
        }
        words.end_line();
        Ok(())
    }

    /// Span of the next number, which has type `scalar`.
    #[inline]
    pub(crate) fn span(&mut self, scalar: Scalar) -> Result<Range<usize>, ReadError> {
        match &mut self.walk {
            Walk::Text(words) => match words.next_in_line() {
                Some(span) => Ok(span),
                None => Err(ReadError::new("a row with too few numbers")
                    .with_hint("each row is one line with the numbers that the header announces")
                    .at(self.place())),
            },
            Walk::Binary { at, .. } => {
                let span = *at..*at + scalar.size();
                if span.end > self.bytes.len() {
                    return Err(self.cut());
                }
                *at = span.end;
                Ok(span)
            }
        }
    }

    fn cut(&self) -> ReadError {
        ReadError::new("the file ends within a row")
            .with_hint("the file is cut, or a count in the header is wrong")
            .at(self.place())
    }

    /// The finite number at `span`, which was the last one walked over.
    #[inline]
    pub(crate) fn finite(&self, span: Range<usize>, scalar: Scalar) -> Result<f64, ReadError> {
        let place = match &self.walk {
            Walk::Text(words) => {
                let word = &self.bytes[span];
                let line = words.line();
                if !matches!(scalar, Scalar::F32 | Scalar::F64) && integer(word).is_none() {
                    let error = ReadError::new(format!("{} is not an integer", quoted(word)));
                    return Err(error.with_hint("the header announces an integer type").at_line(line));
                }
                return finite(word).map_err(|error| error.at_line(line));
            }
            Walk::Binary { .. } => Place::Byte(span.start),
        };
        let x = match scalar {
            Scalar::F32 => f64::from(f32::from_bits(self.bits(span) as u32)),
            Scalar::F64 => f64::from_bits(self.bits(span)),
            _ => self.signed(span, scalar) as f64,
        };
        if x.is_finite() {
            Ok(x)
        } else {
            Err(ReadError::new(format!("{x} is not a finite number")).with_hint("repair the coordinate").at(place))
        }
    }

    /// The next number, an integer.
    #[inline]
    fn integer(&mut self, scalar: Scalar) -> Result<i64, ReadError> {
        let span = self.span(scalar)?;
        match &self.walk {
            Walk::Text(_) => integer(&self.bytes[span.clone()]).ok_or_else(|| {
                ReadError::new(format!("{} is not an integer", quoted(&self.bytes[span])))
                    .with_hint("counts and indices are whole numbers")
                    .at(self.place())
            }),
            Walk::Binary { .. } => Ok(self.signed(span, scalar)),
        }
    }

    /// The 1, 2, 4 or 8 bytes at `span` as one number.
    #[inline]
    fn bits(&self, span: Range<usize>) -> u64 {
        let big = matches!(self.walk, Walk::Binary { big: true, .. });
        match self.bytes[span] {
            [a] => u64::from(a),
            [a, b] if big => u64::from(u16::from_be_bytes([a, b])),
            [a, b] => u64::from(u16::from_le_bytes([a, b])),
            [a, b, c, d] if big => u64::from(u32::from_be_bytes([a, b, c, d])),
            [a, b, c, d] => u64::from(u32::from_le_bytes([a, b, c, d])),
            [a, b, c, d, e, f, g, h] if big => u64::from_be_bytes([a, b, c, d, e, f, g, h]),
            [a, b, c, d, e, f, g, h] => u64::from_le_bytes([a, b, c, d, e, f, g, h]),
            _ => 0,
        }
    }

    /// The integer of type `scalar` at `span`.
    #[inline]
    fn signed(&self, span: Range<usize>, scalar: Scalar) -> i64 {
        let bits = self.bits(span);
        match scalar {
            Scalar::I8 => i64::from(bits as i8),
            Scalar::I16 => i64::from(bits as i16),
            Scalar::I32 => i64::from(bits as i32),
            _ => bits as i64,
        }
    }

    /// Number of items of the next list.
    #[inline]
    fn list_len(&mut self, count: Scalar, item: Scalar) -> Result<usize, ReadError> {
        let place = self.place();
        let len = self.integer(count)?;
        let left = self.bytes.len() - self.position().0;
        let size = if matches!(self.walk, Walk::Text(_)) { 1 } else { item.size() };
        match usize::try_from(len) {
            Ok(len) if len.checked_mul(size).is_some_and(|bytes| bytes <= left) => Ok(len),
            Ok(len) => Err(ReadError::new(format!("a list of {len} numbers, but only {left} bytes are left"))
                .with_hint("the file is cut or damaged")
                .at(place)),
            Err(_) => {
                Err(ReadError::new(format!("a list of {len} numbers")).with_hint("the file is damaged").at(place))
            }
        }
    }

    /// Span of the next property, and of all that belongs to it where it is a list.
    pub(crate) fn property(&mut self, kind: Kind) -> Result<Range<usize>, ReadError> {
        if let Kind::Number(scalar) = kind {
            return self.span(scalar);
        }
        let start = match &self.walk {
            Walk::Text(words) => words.nth_in_line(0).start,
            Walk::Binary { at, .. } => *at,
        };
        self.skip(kind)?;
        Ok(start..self.position().0)
    }

    /// Spans of the items of the list at `span`, in place of what `items` held.
    pub(crate) fn items(
        &self,
        span: Range<usize>,
        count: Scalar,
        item: Scalar,
        items: &mut Vec<Range<usize>>,
    ) -> Result<(), ReadError> {
        items.clear();
        let mut walk = self.again(span.start);
        for _ in 0..walk.list_len(count, item)? {
            items.push(walk.span(item)?);
        }
        Ok(())
    }

    /// Another walk, from `at` on. It does not know its line.
    pub(crate) fn again(&self, at: usize) -> Self {
        let walk = match self.walk {
            Walk::Text(_) => Walk::Text(Words::plain(self.bytes, at, 1)),
            Walk::Binary { big, .. } => Walk::Binary { at, big },
        };
        Self { bytes: self.bytes, walk, surplus: None }
    }

    /// Steps to the end of a row, before the line break where it is text, and says where that is.
    pub(crate) fn row_end(&mut self) -> usize {
        match &mut self.walk {
            Walk::Text(words) => words.line_end(),
            Walk::Binary { at, .. } => *at,
        }
    }

    /// The next list, of integers, in place of what `items` held.
    #[inline]
    pub(crate) fn list(&mut self, count: Scalar, item: Scalar, items: &mut Vec<i64>) -> Result<(), ReadError> {
        items.clear();
        let len = self.list_len(count, item)?;
        if let Walk::Binary { at, .. } = &mut self.walk {
            let start = *at;
            *at += len * item.size();
            items.extend((start..*at).step_by(item.size()).map(|at| self.signed(at..at + item.size(), item)));
            return Ok(());
        }
        for _ in 0..len {
            items.push(self.integer(item)?);
        }
        Ok(())
    }

    /// Steps over the next property.
    #[inline]
    pub(crate) fn skip(&mut self, kind: Kind) -> Result<(), ReadError> {
        match kind {
            Kind::Number(scalar) => self.span(scalar).map(drop),
            Kind::List(count, item) => {
                let len = self.list_len(count, item)?;
                match &mut self.walk {
                    Walk::Binary { at, .. } => *at += len * item.size(),
                    Walk::Text(_) => {
                        for _ in 0..len {
                            self.span(item)?;
                        }
                    }
                }
                Ok(())
            }
        }
    }

    /// Steps over all rows of an element.
    pub(crate) fn skip_element(&mut self, element: &Element) -> Result<(), ReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        for _ in 0..element.rows {
            self.begin_row(element)?;
            for property in &element.properties {
                self.skip(property.kind)?;
            }
            self.end_loose_row(element);
        }
        Ok(())
    }

    /// Number of bytes behind the walk.
    pub(crate) fn bytes_ahead(&self) -> usize {
        self.ahead().len()
    }

    /// The bytes behind the walk.
    pub(crate) fn ahead(&self) -> &'a [u8] {
        &self.bytes[self.position().0..]
    }

    /// Steps over so many bytes of a binary body, which were read otherwise.
    pub(crate) fn step_over(&mut self, len: usize) {
        if let Walk::Binary { at, .. } = &mut self.walk {
            *at += len;
        }
    }

    /// Ends the walk behind the last row, with warnings. Surplus numbers *and* surplus rows mean that a count is wrong
    /// and rows of one element were read as those of another.
    pub(crate) fn end(mut self) -> Result<Vec<String>, ReadError> {
        if let Walk::Text(words) = &mut self.walk {
            words.skip_blank_lines();
        }
        let left = self.bytes_ahead();
        let mut warnings = Vec::new();
        if let Some((rows, first)) = self.surplus {
            if left > 0 {
                return Err(first);
            }
            let place = first.place().map(|place| format!(", the first in {place}")).unwrap_or_default();
            warnings.push(format!("Rows with more numbers than the header announces: {rows}{place}."));
        }
        if left > 0 {
            warnings.push(format!("Bytes behind the last row, kept but not read: {left}."));
        }
        Ok(warnings)
    }

    /// Appends `x` as a number of type `scalar` to `out` in the encoding of the body. For an integer type it is one in its range.
    pub(crate) fn encode(&self, x: f64, scalar: Scalar, out: &mut Vec<u8>) {
        let Walk::Binary { big, .. } = self.walk else {
            push_shortest(out, x, scalar.number_type());
            return;
        };
        let start = out.len();
        match scalar {
            Scalar::I8 => out.extend_from_slice(&(x as i8).to_le_bytes()),
            Scalar::U8 => out.push(x as u8),
            Scalar::I16 => out.extend_from_slice(&(x as i16).to_le_bytes()),
            Scalar::U16 => out.extend_from_slice(&(x as u16).to_le_bytes()),
            Scalar::I32 => out.extend_from_slice(&(x as i32).to_le_bytes()),
            Scalar::U32 => out.extend_from_slice(&(x as u32).to_le_bytes()),
            Scalar::F32 => out.extend_from_slice(&(x as f32).to_le_bytes()),
            Scalar::F64 => out.extend_from_slice(&x.to_le_bytes()),
        }
        if big {
            out[start..].reverse();
        }
    }

    /// Whether the body is text.
    pub(crate) fn is_text(&self) -> bool {
        matches!(self.walk, Walk::Text(_))
    }
}
