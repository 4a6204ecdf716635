//! File formats of models.

use std::path::Path;

use crate::ReadError;

/// A file format that a [`Document`](crate::Document) can be read from and written to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Format {
    /// Wavefront OBJ, text.
    Obj,
    /// Polygon file format (Stanford), ascii or binary of either byte order.
    Ply,
    /// Stereolithography facets, ascii or binary.
    Stl,
    /// Geomview's object file format, text.
    Off,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::Obj, Self::Ply, Self::Stl, Self::Off];

    /// The format that the file name extension of `path` stands for, upper or lower case.
    ///
    /// # Errors
    ///
    /// No extension, or one of no known format.
    pub fn from_path(path: &Path) -> Result<Self, ReadError> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        Self::ALL.into_iter().find(|f| f.name() == extension).ok_or_else(|| {
            let what = match extension.as_str() {
                "" => "the file name has no extension to tell the format".to_owned(),
                other => format!("'.{other}' is not a format that can be read or written"),
            };
            ReadError::new(what).with_hint("name the file .obj, .ply, .stl or .off").in_file(path)
        })
    }

    /// Its usual file name extension: `"obj"`, `"ply"`, `"stl"` or `"off"`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Obj => "obj",
            Self::Ply => "ply",
            Self::Stl => "stl",
            Self::Off => "off",
        }
    }

    /// The format that the first bytes look like, whatever the file is called.
    pub(crate) fn of_bytes(bytes: &[u8]) -> Option<Self> {
        if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            Some(Self::Ply)
        } else if crate::stl::looks_like(bytes) {
            Some(Self::Stl)
        } else if crate::off::looks_like(bytes) {
            Some(Self::Off)
        } else {
            None
        }
    }
}
