//! The model that a command works on: a file, or a built-in shape.

use std::path::{Path, PathBuf};

use isochor::{ShapeName, ShapeNameError, Source};
use isochor_io::{Document, Format, NumberType};

use crate::failure::Failure;
use crate::files;

/// A model by its name.
#[derive(Clone, Debug)]
pub enum Model {
    /// One in a file, in the format of its extension.
    File { path: PathBuf, format: Format },
    /// `shape:NAME`.
    Shape(ShapeName),
}

impl Model {
    /// Whether a name is that of a built-in shape, if there is no such file.
    pub fn is_shape(name: &Path) -> bool {
        name.to_str().is_some_and(|name| name.starts_with(ShapeName::PREFIX))
    }

    /// The model that a path or the name of a shape means. Files that exist come first.
    pub fn named(name: &Path) -> Result<Self, Failure> {
        let failed = |error: ShapeNameError| {
            let hint = match &error {
                ShapeNameError::Unknown { nearest, .. } => {
                    format!("did you mean shape:{nearest}? isochor help lists all shapes")
                }
                ShapeNameError::Number { name, .. } => format!("leave the number out for the usual one: shape:{name}"),
            };
            Failure::usage(name.display().to_string(), error.to_string(), hint)
        };
        match name.to_str() {
            Some(text) if Self::is_shape(name) && !name.exists() => text.parse().map(Self::Shape).map_err(failed),
            _ => {
                let format = Format::from_path(name).map_err(|error| Failure::read(name, &error))?;
                Ok(Self::File { path: name.into(), format })
            }
        }
    }

    /// What people call it: the name of its file, or of the shape.
    pub fn name(&self) -> String {
        match self {
            Self::File { path, .. } => path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
            Self::Shape(shape) => shape.to_string(),
        }
    }

    /// The model as a file that is to be written in `output` format: its own for files, for shapes that of the output, with 64-bit
    /// floats. STL holds neither those nor shared vertices, so there the shape is converted at the end like any other model.
    pub fn document(&self, output: Format) -> Result<Document, Failure> {
        match self {
            Self::File { path, format } => {
                Document::parse(files::bytes(path)?, *format).map_err(|error| Failure::read(path, &error))
            }
            Self::Shape(shape) => {
                let format = if output == Format::Stl { Format::Ply } else { output };
                Document::from_mesh(&shape.mesh(), format, NumberType::F64)
                    .map_err(|error| Failure::write(Path::new(&shape.to_string()), &error))
            }
        }
    }

    /// What its document says about itself.
    pub fn source(&self, document: &Document) -> Source {
        let format = match self {
            Self::File { .. } => document.format().name(),
            Self::Shape(_) => "shape",
        };
        Source {
            format: format.into(),
            vertices: document.vertices_in_file(),
            faces: document.faces_in_file(),
            warnings: document.warnings().to_vec(),
        }
    }
}
