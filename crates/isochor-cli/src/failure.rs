//! What went wrong, for people and programs.

use isochor::{JobError, JobTextError};
use isochor_io::{LatticeFileError, ReadError, WriteError};

/// A failure that ends the command. Nothing has been written.
#[derive(Debug, serde::Serialize)]
pub struct Failure {
    /// 1: the request cannot be met; 2: bad input or usage.
    #[serde(skip)]
    pub exit: u8,
    /// A short word for programs.
    pub code: &'static str,
    /// What is wrong, with the offending value.
    pub what: String,
    /// Where: a file and a line or byte, a flag, a key of the job.
    #[serde(rename = "where")]
    pub place: String,
    /// What to do.
    pub hint: String,
}

impl Failure {
    /// Bad usage: a flag or a key with a bad value.
    pub fn usage(place: impl Into<String>, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { exit: 2, code: "usage", what: what.into(), place: place.into(), hint: hint.into() }
    }

    /// A file that cannot be read or written.
    pub fn file(path: &std::path::Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { exit: 2, code: "file", what: what.into(), place: path.display().to_string(), hint: hint.into() }
    }

    /// A model that cannot be read.
    pub fn read(path: &std::path::Path, error: &ReadError) -> Self {
        let place = error.place().map_or_else(String::new, |place| format!(", {place}"));
        Self {
            exit: 2,
            code: "read",
            what: error.what().into(),
            place: format!("{}{place}", path.display()),
            hint: error.hint().unwrap_or("repair the file, or write it again from the program it came from").into(),
        }
    }

    /// A job file that is none.
    pub fn job_text(path: &std::path::Path, error: &JobTextError) -> Self {
        let line = error.line.map_or_else(String::new, |line| format!(", line {line}"));
        let column = error.column.map_or_else(String::new, |column| format!(", column {column}"));
        let hint = match &error.nearest {
            Some(nearest) => format!("did you mean `{nearest}`?"),
            None => "the keys and values of a job are described in docs/job.md".into(),
        };
        let place = format!("{}{line}{column}", path.display());
        Self { exit: 2, code: "job", what: error.what.clone(), place, hint }
    }

    /// The same, in a frame of a film.
    pub fn at_time(self, frame: usize, time: f64) -> Self {
        Self { place: format!("{}, frame {} at time {time}", self.place, frame + 1), ..self }
    }

    /// A lattice file that is none.
    pub fn lattice_file(path: &std::path::Path, error: &LatticeFileError) -> Self {
        let line = error.line.map_or_else(String::new, |line| format!(", line {line}"));
        Self {
            exit: 2,
            code: "lattice-file",
            what: error.what.clone(),
            place: format!("{}{line}", path.display()),
            hint: "the form of lattice files is described in docs/lattice.md".into(),
        }
    }

    /// A surface file that is none, or has no such patch.
    pub fn surface_file(path: &std::path::Path, error: &ReadError) -> Self {
        Self { code: "surface-file", ..Self::read(path, error) }
    }

    /// A result that the output format cannot hold.
    pub fn write(path: &std::path::Path, error: &WriteError) -> Self {
        Self {
            exit: 2,
            code: "write",
            what: error.to_string(),
            place: path.display().to_string(),
            hint: error.hint().unwrap_or("choose another output format").into(),
        }
    }
}

impl From<JobError> for Failure {
    fn from(error: JobError) -> Self {
        Self {
            exit: if error.is_unreachable() { 1 } else { 2 },
            code: error.code(),
            what: error.to_string(),
            place: error.place(),
            hint: error.hint().into(),
        }
    }
}
