//! Values mixed of up to three others.
//!
//! A mix Σ wᵢ vᵢ with wᵢ ≥ 0 and Σ wᵢ = 1 is taken as v₀ + Σ wᵢ (vᵢ − v₀) from the value v₀ of its heaviest part. So equal values give
//! just that value, and what is mixed never lies beyond the values by more than rounding.

/// Parts of a mix: distinct, none of weight 0, the heaviest first, of equal ones that with the lower index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Mix {
    parts: [(u32, f64); 3],
    len: usize,
}

impl Mix {
    /// The parts of `parts` that weigh anything, at least one.
    pub(crate) fn of(parts: &[(u32, f64); 3]) -> Self {
        Self { parts: *parts, len: 3 }.relabelled(|k| k)
    }

    /// The same weights of other things, which may be fewer.
    pub(crate) fn relabelled(&self, label: impl Fn(u32) -> u32) -> Self {
        let mut all = Self { parts: [(0, 0.0); 3], len: 0 };
        for &(k, weight) in self.parts[..self.len].iter().filter(|part| part.1 != 0.0) {
            let name = label(k);
            match all.parts[..all.len].iter_mut().find(|part| part.0 == name) {
                Some(part) => part.1 += weight,
                None => {
                    all.parts[all.len] = (name, weight);
                    all.len += 1;
                }
            }
        }
        all.parts[..all.len].sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        all
    }

    /// What the mix is of, the heaviest first, with the weights.
    pub(crate) fn parts(&self) -> &[(u32, f64)] {
        &self.parts[..self.len]
    }

    /// The part of most weight.
    pub(crate) fn heaviest(&self) -> u32 {
        self.parts[0].0
    }

    /// The only part. `None` where there are more.
    pub(crate) fn only(&self) -> Option<u32> {
        (self.len == 1).then(|| self.heaviest())
    }

    /// The mixed value. `None` where it is not finite.
    pub(crate) fn value(&self, value: impl Fn(u32) -> f64) -> Option<f64> {
        let first = value(self.heaviest());
        let mixed = self.parts()[1..].iter().fold(first, |sum, &(k, weight)| sum + weight * (value(k) - first));
        mixed.is_finite().then_some(mixed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_distinct_and_the_heaviest_comes_first() {
        let mix = Mix::of(&[(4, 0.25), (7, 0.5), (4, 0.25)]);
        assert_eq!(mix.parts(), [(4, 0.5), (7, 0.5)]);
        assert_eq!((mix.heaviest(), mix.only()), (4, None));
        assert_eq!(mix.relabelled(|_| 9).only(), Some(9));
        assert_eq!(Mix::of(&[(8, 0.0), (3, 1.0), (u32::MAX, 0.0)]).only(), Some(3));
    }

    /// 0.1/4 + 0.5/4 + 0.9/2 = 0.6.
    #[test]
    fn values_are_mixed_and_equal_ones_stay() {
        let mix = Mix::of(&[(0, 0.25), (1, 0.25), (2, 0.5)]);
        assert!((mix.value(|k| [0.1, 0.5, 0.9][k as usize]).unwrap() - 0.6).abs() < 1e-16);
        let third = Mix::of(&[(0, 1.0 / 3.0), (1, 1.0 / 3.0), (2, 1.0 / 3.0)]);
        assert_eq!(third.value(|_| 0.1), Some(0.1));
        assert_eq!(third.value(|k| if k == 1 { f64::NAN } else { 0.0 }), None);
        assert_eq!(mix.value(|k| if k == 2 { f64::MAX } else { -f64::MAX }), None);
    }
}
