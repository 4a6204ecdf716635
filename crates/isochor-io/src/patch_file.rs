//! Files of patches, whichever they are: JSON, OBJ or Newell's format, told apart by how they begin.

use isochor::Patch;

use crate::newell::patches_from_newell;
use crate::obj_patches::patches_from_obj;
use crate::patch_json::patch_from_json;
use crate::{Place, ReadError};

/// All patches of a file: a brace begins JSON, a number Newell's format, anything else OBJ.
///
/// # Errors
///
/// Those of [`patch_from_json`], [`patches_from_newell`], [`patches_from_obj`]; JSON that is not UTF-8.
pub fn patches_from_bytes(bytes: &[u8]) -> Result<Vec<Patch>, ReadError> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    match text.iter().find(|b| !b.is_ascii_whitespace()) {
        None => Err(ReadError::new("an empty file").with_hint("export the surface again")),
        Some(b'{') => {
            let text = std::str::from_utf8(text).map_err(|error| {
                let error = ReadError::new("JSON that is not UTF-8").at(Place::Byte(error.valid_up_to()));
                error.with_hint("save the file as UTF-8")
            })?;
            patch_from_json(text).map(|patch| vec![patch])
        }
        Some(b'0'..=b'9') => patches_from_newell(text),
        Some(_) => patches_from_obj(bytes),
    }
}

/// The patch with the given `number`, from 0 in the order of the file, or the only one.
///
/// # Errors
///
/// As [`patches_from_bytes`]; a number beyond the file; none where there are several patches.
pub fn patch_from_bytes(bytes: &[u8], number: Option<usize>) -> Result<Patch, ReadError> {
    let mut patches = patches_from_bytes(bytes)?;
    let count = patches.len();
    match number {
        None if count == 1 => Ok(patches.swap_remove(0)),
        None => Err(ReadError::new(format!("{count} patches")).with_hint(format!("choose one: 0 to {}", count - 1))),
        Some(number) if number < count => Ok(patches.swap_remove(number)),
        Some(number) => {
            let error = ReadError::new(format!("there is no patch {number}"));
            Err(error.with_hint(format!("patches have the numbers 0 to {}", count - 1)))
        }
    }
}
