//! Corners at one place welded to one vertex.

use glam::DVec3;

/// Slots of an empty table; a power of two. It doubles before half of it is full.
const FIRST_SLOTS: usize = 1024;
const FREE: u32 = u32::MAX;

/// Vertices numbered by the first appearance of their position. Positions are one where their bits are; 0 is −0.
pub(crate) struct Weld {
    points: Vec<DVec3>,
    /// Open addressing: vertex indices at the hash of their position or behind it.
    slots: Vec<u32>,
}

impl Weld {
    pub(crate) fn new() -> Self {
        Self { points: Vec::new(), slots: vec![FREE; FIRST_SLOTS] }
    }

    /// Index of the vertex at `position`, a new one where none was there. At most `u32::MAX` − 1 vertices.
    pub(crate) fn vertex(&mut self, position: DVec3) -> u32 {
        let slot = self.slot(position);
        if self.slots[slot] != FREE {
            return self.slots[slot];
        }
        let vertex = self.points.len() as u32;
        self.slots[slot] = vertex;
        self.points.push(position);
        if self.points.len() * 2 > self.slots.len() {
            self.grow();
        }
        vertex
    }

    /// The points of all vertices.
    pub(crate) fn into_points(self) -> Vec<DVec3> {
        self.points
    }

    /// Where `position` stands in the table or would stand.
    fn slot(&self, position: DVec3) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = (hash(position) >> (64 - self.slots.len().trailing_zeros())) as usize;
        // Coordinates are finite: equal numbers are bit-equal, but for the sign of 0.
        while self.slots[slot] != FREE && self.points[self.slots[slot] as usize] != position {
            slot = (slot + 1) & mask;
        }
        slot
    }

    fn grow(&mut self) {
        self.slots = vec![FREE; self.slots.len() * 2];
        for vertex in 0..self.points.len() {
            let slot = self.slot(self.points[vertex]);
            self.slots[slot] = vertex as u32;
        }
    }
}

/// Multiply and fold, once for each coordinate (odd constants of evenly spread bits). Its high bits are the good ones.
fn hash(p: DVec3) -> u64 {
    let folded = [p.x, p.y, p.z].iter().fold(0, |h: u64, x| {
        let mixed = (h ^ (x + 0.0).to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed ^ (mixed >> 32)
    });
    folded.wrapping_mul(0xd6e8_feb8_6659_fd93)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_by_first_appearance_and_welds_both_zeros() {
        let mut weld = Weld::new();
        let places = [DVec3::ZERO, DVec3::X, DVec3::new(-0.0, 0.0, -0.0), DVec3::Y, DVec3::X];
        assert_eq!(places.map(|p| weld.vertex(p)), [0, 1, 0, 2, 1]);
        assert_eq!(weld.into_points(), [DVec3::ZERO, DVec3::X, DVec3::Y]);
    }

    #[test]
    fn many_vertices_keep_their_numbers_while_the_table_grows() {
        let mut weld = Weld::new();
        let place = |i: u32| DVec3::new(f64::from(i % 50), f64::from(i / 50 % 50), f64::from(i / 2500) * 1e-3);
        for _ in 0..2 {
            for i in 0..20_000 {
                assert_eq!(weld.vertex(place(i)), i);
            }
        }
    }
}
