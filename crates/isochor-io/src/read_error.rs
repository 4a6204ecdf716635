//! Why a file could not be read.

use std::borrow::Cow;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Where in a file something stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Line of a text, counted from 1.
    Line(usize),
    /// Offset in bytes from the start of the file.
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}

/// Why a file could not be read: what is wrong, where it stands and what to do.
///
/// Shown as `path: place: what (hint)`, without the parts that are not known.
#[derive(Debug)]
pub struct ReadError {
    what: String,
    hint: Option<Cow<'static, str>>,
    place: Option<Place>,
    path: Option<PathBuf>,
    source: Option<io::Error>,
}

impl ReadError {
    pub(crate) fn new(what: impl Into<String>) -> Self {
        Self { what: what.into(), hint: None, place: None, path: None, source: None }
    }

    pub(crate) fn io(path: &Path, error: io::Error) -> Self {
        let (what, hint) = match error.kind() {
            io::ErrorKind::NotFound => ("there is no such file".to_owned(), "check the path"),
            io::ErrorKind::PermissionDenied => ("reading is not permitted".to_owned(), "check the file's permissions"),
            io::ErrorKind::IsADirectory => ("this is a folder".to_owned(), "name a file in it"),
            _ => (format!("cannot be read: {error}"), "check the path and the disk"),
        };
        Self { source: Some(error), ..Self::new(what).with_hint(hint).in_file(path) }
    }

    pub(crate) fn with_hint(self, hint: impl Into<Cow<'static, str>>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    pub(crate) fn at(self, place: Place) -> Self {
        Self { place: Some(place), ..self }
    }

    pub(crate) fn at_line(self, line: usize) -> Self {
        self.at(Place::Line(line))
    }

    pub(crate) fn in_file(self, path: &Path) -> Self {
        Self { path: Some(path.to_owned()), ..self }
    }

    /// What is wrong, with the offending value.
    #[must_use]
    pub fn what(&self) -> &str {
        &self.what
    }

    /// What to do about it.
    #[must_use]
    pub fn hint(&self) -> Option<&str> {
        self.hint.as_deref()
    }

    /// Where it stands in the file.
    #[must_use]
    pub fn place(&self) -> Option<Place> {
        self.place
    }

    /// The file, where one was read.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(path) = &self.path {
            write!(f, "{}: ", path.display())?;
        }
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        write!(f, "{}", self.what)?;
        self.hint.as_ref().map_or(Ok(()), |hint| write!(f, " ({hint})"))
    }
}

impl std::error::Error for ReadError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.source.as_ref().map(|e| e as _)
    }
}
