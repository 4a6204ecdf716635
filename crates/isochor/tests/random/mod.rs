//! Random things that a number names, so that a failure can be repeated.

use glam::DVec3;

/// SplitMix64 (G. L. Steele, D. Lea, C. H. Flood, 2014).
pub struct Random(pub u64);

impl Random {
    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * (((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64)
    }

    /// In the cube [−1, 1]³.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::from_array([0; 3].map(|_| self.within(-1.0, 1.0)))
    }
}
