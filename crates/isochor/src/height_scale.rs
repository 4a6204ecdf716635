//! The volume of a model along a surface, brought back by a common factor of its heights.
//!
//! With feet S_v, normals and faces fixed, vertices are `p(λ) = S + λ h n`, and the volume is exactly a cubic in λ:
//!
//! ```text
//! V(λ) = T(S, S, S) + 3 T(S, S, d) λ + 3 T(S, d, d) λ² + T(d, d, d) λ³,   d = h n,                  (1)
//! ```
//!
//! T the symmetric trilinear form with V(x) = T(x, x, x) ([`crate::volume`]). Wanted is the root λ > 0 nearest 1 of V(λ) = V_ref. It
//! is found between the places where (1) turns, and polished by Newton's method with measured volumes, which are those of the rounded vertices.
//!
//! CO keeps no volume; this is ours.

use glam::DVec3;

use crate::parallel;
use crate::tolerances;
use crate::volume::Solid;

/// Heights that give a model along a surface its volume.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightScale {
    /// The factor λ of all heights; 1 where the volume was right.
    pub scale: f64,
    /// The vertices foot + λ offset (#vertices × 3).
    pub vertices: Vec<DVec3>,
    /// Their signed volume.
    pub volume: f64,
    /// |volume − wanted| / |wanted|, at most [`tolerances::VOLUME`].
    pub relative_error: f64,
}

/// Why no factor of the heights gives the volume.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HeightScaleError {
    /// A volume that is nothing to aim at.
    #[error("the wanted volume is {wanted}: it must be finite and not 0")]
    Wanted {
        /// The signed volume.
        wanted: f64,
    },
    /// The heights do not change the volume.
    #[error("the volume is {volume} whatever the heights are, so they cannot make it {wanted}")]
    Constant {
        /// It.
        volume: f64,
        /// The signed volume that is wanted.
        wanted: f64,
    },
    /// No factor > 0.
    #[error(
        "no factor of the heights gives the volume {wanted}: factors above 0 reach those from {low} to {high}; change the volume, the place of the model, \
         or the surface"
    )]
    Unreachable {
        /// The signed volume that is wanted.
        wanted: f64,
        /// The least signed volume that is reached or approached; may be −∞.
        low: f64,
        /// The largest; may be ∞.
        high: f64,
    },
    /// The rounding of coordinates is larger than what is asked for.
    #[error(
        "with heights times {scale} the volume is {wanted} but for a part of {relative_error:e}: the model is too thin for the precision of its \
         coordinates"
    )]
    Rounding {
        /// The factor.
        scale: f64,
        /// The signed volume that is wanted.
        wanted: f64,
        /// What is missing, relative to it.
        relative_error: f64,
    },
}

/// The factor of the heights at which the body `solid` with vertices `feet + λ offsets` (each #vertices × 3, near the origin for full
/// precision) has the signed volume `wanted`.
///
/// # Errors
///
/// A wanted volume of 0; none that heights change; none within reach; coordinates too coarse for it.
///
/// # Panics
///
/// Panics where the number of feet or offsets is not the number of vertices of the solid.
pub fn scaled_heights(
    solid: &Solid,
    feet: &[DVec3],
    offsets: &[DVec3],
    wanted: f64,
) -> Result<HeightScale, HeightScaleError> {
    /// Newton's steps. They end by themselves; more would only be reached at a double root, where each halves what is missing.
    const STEPS: usize = 50;
    if !(wanted.is_finite() && wanted != 0.0) {
        return Err(HeightScaleError::Wanted { wanted });
    }
    let at = |scale: f64| {
        let vertices = parallel::collect(feet.len(), |v| feet[v] + scale * offsets[v]);
        let volume = solid.volume(&vertices);
        HeightScale { scale, vertices, volume, relative_error: ((volume - wanted) / wanted).abs() }
    };
    let unscaled = at(1.0);
    if unscaled.relative_error <= tolerances::VOLUME_ROUNDING {
        return Ok(unscaled);
    }
    let cubic = Cubic::of(solid, feet, offsets);
    let mut best = at(cubic.root(wanted)?);
    for _ in 0..STEPS {
        if best.relative_error <= tolerances::VOLUME_ROUNDING {
            break;
        }
        let step = (wanted - best.volume) / cubic.slope(best.scale); // infinite where it turns
        let next = at(best.scale + step);
        if !(next.scale > 0.0 && next.relative_error < best.relative_error) {
            break;
        }
        best = next;
    }
    if best.relative_error > tolerances::VOLUME {
        let HeightScale { scale, relative_error, .. } = best;
        return Err(HeightScaleError::Rounding { scale, wanted, relative_error });
    }
    Ok(best)
}

/// `c₀ + c₁ λ + c₂ λ² + c₃ λ³`.
#[derive(Clone, Copy, Debug)]
struct Cubic([f64; 4]);

impl Cubic {
    /// (1). Coefficients below the rounding of their summed terms are 0: they are noise, and noise far from 1 looks like a root.
    fn of(solid: &Solid, feet: &[DVec3], offsets: &[DVec3]) -> Self {
        /// Roundings in a term. More: small true coefficients are dropped; less: noise is kept.
        const ROUNDINGS: f64 = 16.0 * f64::EPSILON;
        let significant = |(sum, magnitude): (f64, f64)| if sum.abs() <= ROUNDINGS * magnitude { 0.0 } else { sum };
        let gradient = solid.volume_gradient(feet);
        let products = parallel::map_chunks(feet.len(), parallel::CHUNK, |range| {
            let terms = gradient[range.clone()].iter().zip(&offsets[range]).map(|(g, d)| *g * *d);
            let add = |(sum, all): (DVec3, DVec3), term: DVec3| (sum + term, all + term.abs());
            terms.fold((DVec3::ZERO, DVec3::ZERO), add)
        });
        let linear = products
            .iter()
            .fold((0.0, 0.0), |(sum, all), part| (sum + part.0.element_sum(), all + part.1.element_sum()));
        let [square, cube] = solid.bends(feet, offsets, |_| true).map(significant);
        Self([solid.volume(feet), significant(linear), square, cube])
    }

    fn value(self, x: f64) -> f64 {
        let [c0, c1, c2, c3] = self.0;
        c0 + x * (c1 + x * (c2 + x * c3))
    }

    fn slope(self, x: f64) -> f64 {
        let [_, c1, c2, c3] = self.0;
        c1 + x * (2.0 * c2 + x * 3.0 * c3)
    }

    /// The x > 0 at which it turns, ascending.
    fn turns(self) -> Vec<f64> {
        let [_, c1, c2, c3] = self.0;
        let discriminant = c2 * c2 - 3.0 * c1 * c3;
        if discriminant < 0.0 {
            return Vec::new();
        }
        // Both roots of c₁ + 2 c₂ x + 3 c₃ x² without cancellation.
        let q = -(c2 + discriminant.sqrt().copysign(c2));
        let mut turns: Vec<f64> = [q / (3.0 * c3), c1 / q].into_iter().filter(|x| *x > 0.0 && x.is_finite()).collect();
        turns.sort_by(f64::total_cmp);
        turns.dedup();
        turns
    }

    /// The root of `value = wanted` above 0 that is nearest 1.
    fn root(self, wanted: f64) -> Result<f64, HeightScaleError> {
        /// Roundings of a value at a turn. More: volumes just out of reach pass for a double root; fewer: those just within do not.
        const ROUNDINGS: f64 = 16.0 * f64::EPSILON;
        let [c0, c1, c2, c3] = self.0;
        let Some(lead) = [c3, c2, c1].into_iter().find(|c| *c != 0.0) else {
            return Err(HeightScaleError::Constant { volume: c0, wanted });
        };
        let turns = self.turns();
        let size = |x: f64| c0.abs() + x * (c1.abs() + x * (c2.abs() + x * c3.abs())) + wanted.abs();
        let touches = turns.iter().copied().filter(|x| (self.value(*x) - wanted).abs() <= ROUNDINGS * size(*x));
        let mut roots: Vec<f64> = touches.collect();
        let mut start = 0.0;
        for end in turns.iter().copied().chain([f64::INFINITY]) {
            roots.extend(self.root_between(start, end, wanted));
            start = end;
        }
        let nearest = roots.into_iter().min_by(|a, b| (a - 1.0).abs().total_cmp(&(b - 1.0).abs()).then(a.total_cmp(b)));
        nearest.ok_or_else(|| {
            let ends = turns.iter().map(|x| self.value(*x)).chain([c0, f64::INFINITY.copysign(lead)]);
            let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            HeightScaleError::Unreachable { wanted, low, high }
        })
    }

    /// The root between two places, 0 or ends excluded, between which it does not turn.
    fn root_between(self, start: f64, end: f64, wanted: f64) -> Option<f64> {
        let is_below = |x: f64| self.value(x) < wanted;
        let (mut low, mut high) = (start, end);
        if high == f64::INFINITY {
            high = f64::max(1.0, 2.0 * low);
            while is_below(high) == is_below(low) {
                high *= 2.0;
                if !self.value(high).is_finite() {
                    return None;
                }
            }
        }
        let first = is_below(low);
        if first == is_below(high) || (low == 0.0 && self.value(0.0) == wanted) {
            return None;
        }
        // Newton, kept between by bisection; 200 halvings pass through all of f64's range.
        let mut x = if low < 1.0 && 1.0 < high { 1.0 } else { low + (high - low) / 2.0 };
        for _ in 0..200 {
            let excess = self.value(x) - wanted;
            if excess == 0.0 {
                break;
            }
            if is_below(x) == first {
                low = x;
            } else {
                high = x;
            }
            let newton = x - excess / self.slope(x);
            let next = if newton > low && newton < high { newton } else { low + (high - low) / 2.0 };
            if next == x || next == low || next == high {
                break;
            }
            x = next;
        }
        Some(x).filter(|x| *x > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_of_polynomials_that_are_products() {
        // (x − 1/2)(x − 3)(x + 2) = x³ − 3/2 x² − 11/2 x + 3
        let cubic = Cubic([3.0, -5.5, -1.5, 1.0]);
        assert!((cubic.root(0.0).unwrap() - 0.5).abs() < 1e-15);
        // x (5/2 − x) takes 1 at 1/2 and 2; x (2 − x) takes 1 at 1 only, and nothing above.
        assert!((Cubic([0.0, 2.5, -1.0, 0.0]).root(1.0).unwrap() - 0.5).abs() < 1e-15);
        let square = Cubic([0.0, 2.0, -1.0, 0.0]);
        assert_eq!(square.root(1.0), Ok(1.0));
        assert_eq!(
            square.root(1.5),
            Err(HeightScaleError::Unreachable { wanted: 1.5, low: f64::NEG_INFINITY, high: 1.0 })
        );
        assert_eq!(Cubic([0.0, 2.0, 0.0, 0.0]).root(5.0), Ok(2.5));
        assert_eq!(
            Cubic([0.0, 2.0, 0.0, 0.0]).root(-5.0),
            Err(HeightScaleError::Unreachable { wanted: -5.0, low: 0.0, high: f64::INFINITY })
        );
        assert_eq!(Cubic([3.0, 0.0, 0.0, 0.0]).root(5.0), Err(HeightScaleError::Constant { volume: 3.0, wanted: 5.0 }));
        // (1 + x)³ without a turn: 64 at 3.
        assert!((Cubic([1.0, 3.0, 3.0, 1.0]).root(64.0).unwrap() - 3.0).abs() < 1e-14);
    }
}
