//! Files are written whole or not at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use tempfile::TempPath;

use crate::failure::Failure;

/// The text of a file.
pub fn text(path: &Path) -> Result<String, Failure> {
    std::fs::read_to_string(path).map_err(|error| {
        Failure::file(path, format!("cannot be read: {error}"), "check the path; the file must be UTF-8 text")
    })
}

/// The bytes of a file.
pub fn bytes(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).map_err(|error| Failure::file(path, format!("cannot be read: {error}"), "check the path"))
}

/// Whether two paths name the same file, through links and whether or not it exists yet.
pub fn are_same(a: &Path, b: &Path) -> bool {
    let place = |path: &Path| {
        std::fs::canonicalize(path).ok().or_else(|| {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            Some(std::fs::canonicalize(folder).ok()?.join(path.file_name()?))
        })
    };
    a == b || place(a).is_some_and(|a| Some(a) == place(b))
}

/// Files written beside their destinations, to be renamed together.
#[derive(Default)]
pub struct Pending {
    /// Closed, for there may be more of them than a process may hold open.
    files: Vec<(TempPath, PathBuf)>,
}

impl Pending {
    /// Writes `bytes` beside `destination`. Nothing is to be seen of it until [`Pending::commit`].
    pub fn add(&mut self, destination: &Path, bytes: &[u8]) -> Result<(), Failure> {
        let failed = |error: std::io::Error| {
            let hint = "check that the folder exists, that it may be written to, and that the disk is not full";
            Failure::file(destination, format!("cannot be written: {error}"), hint)
        };
        // A link keeps pointing to the file that is replaced.
        let target = std::fs::canonicalize(destination).unwrap_or_else(|_| match std::fs::read_link(destination) {
            Ok(link) => destination.parent().unwrap_or(Path::new("")).join(link),
            Err(_) => destination.to_path_buf(),
        });
        if target.is_dir() {
            return Err(Failure::file(destination, "is a folder", "name a file in it"));
        }
        let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            let what = format!("the folder {} does not exist", folder.display());
            return Err(Failure::file(destination, what, "make the folder first, or choose another place"));
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(".isochor-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666)); // less the umask, as any new file
        }
        let mut file = builder.tempfile_in(folder).map_err(failed)?;
        file.write_all(bytes).map_err(failed)?;
        if let Ok(replaced) = std::fs::metadata(&target) {
            file.as_file().set_permissions(replaced.permissions()).map_err(failed)?;
        }
        self.files.push((file.into_temp_path(), target));
        Ok(())
    }

    /// Renames all files to their destinations.
    pub fn commit(self) -> Result<(), Failure> {
        for (file, target) in self.files {
            file.persist(&target).map_err(|error| {
                Failure::file(
                    &target,
                    format!("cannot be replaced: {}", error.error),
                    "check the permissions of the folder",
                )
            })?;
        }
        Ok(())
    }
}
