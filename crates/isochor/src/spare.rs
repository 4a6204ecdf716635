//! Arrays whose memory is used again: fresh memory of a large mesh costs as much as a sweep over it.

use std::ops::Deref;
use std::sync::{Arc, Mutex};

use glam::DVec3;

/// Memory of arrays that are no longer needed, for those to come. Clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Spare(Arc<Mutex<Vec<Vec<DVec3>>>>);

/// One vector per vertex, in memory that goes back to where it came from.
#[derive(Clone, Debug)]
pub(crate) struct Array {
    items: Vec<DVec3>,
    spare: Spare,
}

impl Spare {
    /// An array of any length and content.
    pub(crate) fn array(&self) -> Array {
        let items = self.0.lock().ok().and_then(|mut arrays| arrays.pop()).unwrap_or_default();
        Array { items, spare: self.clone() }
    }

    /// Gives the memory of arrays that are no longer needed back to the system.
    pub(crate) fn clear(&self) {
        if let Ok(mut arrays) = self.0.lock() {
            arrays.clear();
        }
    }
}

impl Array {
    /// These, with memory for others of their own.
    pub(crate) fn of(items: Vec<DVec3>) -> Self {
        Self { items, spare: Spare::default() }
    }

    /// Where its memory goes.
    pub(crate) fn spare(&self) -> &Spare {
        &self.spare
    }

    /// To be filled.
    pub(crate) fn memory(&mut self) -> &mut Vec<DVec3> {
        &mut self.items
    }
}

impl Deref for Array {
    type Target = [DVec3];

    fn deref(&self) -> &[DVec3] {
        &self.items
    }
}

impl Drop for Array {
    fn drop(&mut self) {
        if let Ok(mut arrays) = self.spare.0.lock() {
            arrays.push(std::mem::take(&mut self.items));
        }
    }
}
