//! Headers of PLY files: what elements follow, and what each of their rows holds.

use std::ops::Range;

use crate::number::quoted;
use crate::words::Words;
use crate::{NumberType, ReadError};

/// How the body of a PLY file is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// Type of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one such number in a binary file.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The largest number of an integer type; infinite for floats.
    pub(crate) fn largest(self) -> f64 {
        match self {
            Self::I8 => f64::from(i8::MAX),
            Self::U8 => f64::from(u8::MAX),
            Self::I16 => f64::from(i16::MAX),
            Self::U16 => f64::from(u16::MAX),
            Self::I32 => f64::from(i32::MAX),
            Self::U32 => f64::from(u32::MAX),
            Self::F32 | Self::F64 => f64::INFINITY,
        }
    }

    pub(crate) fn number_type(self) -> NumberType {
        match self {
            Self::F32 => NumberType::F32,
            Self::F64 => NumberType::F64,
            _ => NumberType::Integer,
        }
    }
}

/// What one property of a row is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Number(Scalar),
    /// A count of the first type, then as many numbers of the second.
    List(Scalar, Scalar),
}

#[derive(Clone, Debug)]
pub(crate) struct Property {
    pub(crate) name: Vec<u8>,
    pub(crate) kind: Kind,
    /// Where the word for the type of a number stands; for lists the word `list`.
    pub(crate) type_word: Range<usize>,
}

impl Property {
    /// Bytes that it takes at least in a row of a binary file.
    fn least_size(&self) -> usize {
        match self.kind {
            Kind::Number(scalar) | Kind::List(scalar, _) => scalar.size(),
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Element {
    pub(crate) name: Vec<u8>,
    /// Number of rows announced.
    pub(crate) rows: u64,
    /// Where that number stands.
    pub(crate) rows_word: Range<usize>,
    pub(crate) properties: Vec<Property>,
    /// Line of the header that announces it.
    pub(crate) line: usize,
}

impl Element {
    /// Position among the properties. `None` where there is no such property.
    pub(crate) fn property(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name.as_bytes())
    }

    /// Bytes that a row takes at least.
    pub(crate) fn least_row_size(&self, encoding: Encoding) -> usize {
        match encoding {
            // A digit for each number, and a blank or line end behind it.
            Encoding::Text => 2 * self.properties.len(),
            _ => self.properties.iter().map(Property::least_size).sum(),
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Header {
    pub(crate) encoding: Encoding,
    pub(crate) elements: Vec<Element>,
    /// Where the body starts, and in which line where it is text.
    pub(crate) body: (usize, usize),
}

/// Reads the header up to and with `end_header`.
pub(crate) fn parse(bytes: &[u8]) -> Result<Header, ReadError> {
    let mut words = Words::plain(bytes, 0, 1);
    if !bytes.starts_with(b"ply") || row(&mut words, bytes) != [b"ply"] {
        return Err(ReadError::new("the file does not start with the line 'ply'")
            .with_hint("it is no PLY file, or its first line is missing")
            .at_line(1));
    }
    // Old files end all lines with a lone CR; then a LF behind the header belongs to the body.
    let lone_cr = bytes[words.at()..].first() == Some(&b'\r') && bytes[words.at()..].get(1) != Some(&b'\n');
    words.end_line();
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let line = words.line();
        if words.is_done() {
            return Err(ReadError::new("the header has no 'end_header'").with_hint("the file is cut").at_line(line));
        }
        let start = words.clone();
        let columns = row(&mut words, bytes);
        match columns.as_slice() {
            [] | [b"comment" | b"obj_info", ..] => {}
            [b"format", name, version] => encoding = Some(format(name, version).map_err(|e| e.at_line(line))?),
            [b"element", name, count] => {
                let rows = rows(count).map_err(|e| e.at_line(line))?;
                if elements.iter().any(|e| e.name == *name) {
                    return Err(twice("element", name).at_line(line));
                }
                let rows_word = start.nth_in_line(2);
                elements.push(Element { name: name.to_vec(), rows, rows_word, properties: Vec::new(), line });
            }
            [b"property", ..] => {
                let property = property(&columns, start.nth_in_line(1)).map_err(|e| e.at_line(line))?;
                let Some(element) = elements.last_mut() else {
                    let error = ReadError::new("a property before any element");
                    return Err(error.with_hint("put 'element' lines before their properties").at_line(line));
                };
                if element.properties.iter().any(|p| p.name == property.name) {
                    return Err(twice("property", &property.name).at_line(line));
                }
                element.properties.push(property);
            }
            [b"end_header"] => {
                let encoding = encoding.ok_or_else(|| {
                    ReadError::new("the header has no 'format' line")
                        .with_hint("name the format, as in 'format ascii 1.0'")
                })?;
                let body = if lone_cr && bytes.get(words.at()) == Some(&b'\r') && encoding != Encoding::Text {
                    (words.at() + 1, line + 1)
                } else {
                    words.end_line();
                    (words.at(), words.line())
                };
                return Ok(Header { encoding, elements, body });
            }
            [first, ..] => {
                return Err(ReadError::new(format!(
                    "the header line that starts with {} is not understood",
                    quoted(first)
                ))
                .with_hint("expected: format, comment, element NAME COUNT, property TYPE NAME, end_header")
                .at_line(line));
            }
        }
        words.end_line();
    }
}

/// Words of one line; the walk stops at its end.
fn row<'a>(words: &mut Words, bytes: &'a [u8]) -> Vec<&'a [u8]> {
    std::iter::from_fn(|| words.next_in_line()).map(|span| &bytes[span]).collect()
}

fn twice(thing: &str, name: &[u8]) -> ReadError {
    ReadError::new(format!("{thing} {} is announced twice", quoted(name))).with_hint("rename one of the two")
}

fn format(name: &[u8], version: &[u8]) -> Result<Encoding, ReadError> {
    let encoding = match name {
        b"ascii" => Encoding::Text,
        b"binary_little_endian" => Encoding::LittleEndian,
        b"binary_big_endian" => Encoding::BigEndian,
        _ => {
            return Err(ReadError::new(format!("the format {} is unknown", quoted(name)))
                .with_hint("known are ascii, binary_little_endian and binary_big_endian"));
        }
    };
    if version != b"1.0" {
        return Err(
            ReadError::new(format!("the format version {} is unknown", quoted(version))).with_hint("known is 1.0")
        );
    }
    Ok(encoding)
}

fn rows(count: &[u8]) -> Result<u64, ReadError> {
    let text = std::str::from_utf8(count).unwrap_or_default();
    text.parse().map_err(|_| {
        let hint = if text.starts_with('-') { "a count cannot be negative" } else { "write a whole number" };
        ReadError::new(format!("the count {} of an element cannot be used", quoted(count))).with_hint(hint)
    })
}

/// The property of the header line `columns`, whose second word stands at `type_word`.
fn property(columns: &[&[u8]], type_word: Range<usize>) -> Result<Property, ReadError> {
    match columns {
        [_, b"list", count, item, name] => {
            let count_type = scalar(count)?;
            if matches!(count_type, Scalar::F32 | Scalar::F64) {
                return Err(ReadError::new(format!("the list {} has the count type {}", quoted(name), quoted(count)))
                    .with_hint("count with an integer type"));
            }
            Ok(Property { name: name.to_vec(), kind: Kind::List(count_type, scalar(item)?), type_word })
        }
        [_, kind, name] if *kind != b"list" => {
            Ok(Property { name: name.to_vec(), kind: Kind::Number(scalar(kind)?), type_word })
        }
        _ => Err(ReadError::new("a property line that is not understood")
            .with_hint("write 'property TYPE NAME' or 'property list COUNT_TYPE TYPE NAME'")),
    }
}

fn scalar(name: &[u8]) -> Result<Scalar, ReadError> {
    Scalar::named(name).ok_or_else(|| {
        ReadError::new(format!("the property type {} is unknown", quoted(name)))
            .with_hint("known are char, uchar, short, ushort, int, uint, float, double and int8 to float64")
    })
}
