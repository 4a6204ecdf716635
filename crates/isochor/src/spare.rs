//! Arrays whose memory is used again: fresh memory of a large mesh costs as much as a sweep over it.

use std::ops::Deref;
use std::sync::{Arc, Mutex};

use glam::DVec3;

/// Memory of arrays that are no longer needed, for those to come. Clones share it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Spare<T = DVec3>(Arc<Mutex<Vec<Vec<T>>>>);

/// Items, as one vector per vertex, in memory that goes back to where it came from.
#[derive(Clone, Debug)]
pub(crate) struct Array<T = DVec3> {
    items: Vec<T>,
    spare: Spare<T>,
}

impl<T> Spare<T> {
    /// An array of any length and content.
    pub(crate) fn array(&self) -> Array<T> {
        let items = self.0.lock().ok().and_then(|mut arrays| arrays.pop()).unwrap_or_default();
        Array { items, spare: Self(Arc::clone(&self.0)) }
    }

    /// Gives the memory of arrays that are no longer needed back to the system.
    pub(crate) fn clear(&self) {
        if let Ok(mut arrays) = self.0.lock() {
            arrays.clear();
        }
    }
}

impl<T: Default> Array<T> {
    /// These, with memory for others of their own.
    pub(crate) fn of(items: Vec<T>) -> Self {
        Self { items, spare: Spare::default() }
    }
}

impl<T> Array<T> {
    /// Where its memory goes.
    pub(crate) fn spare(&self) -> &Spare<T> {
        &self.spare
    }

    /// To be filled.
    pub(crate) fn memory(&mut self) -> &mut Vec<T> {
        &mut self.items
    }
}

impl<T> Deref for Array<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.items
    }
}

impl<T> Drop for Array<T> {
    fn drop(&mut self) {
        if let Ok(mut arrays) = self.spare.0.lock() {
            arrays.push(std::mem::take(&mut self.items));
        }
    }
}
