//! Directions of L-BFGS: `−H g`, with H, near the inverse of a function's second derivative, from remembered steps.
//!
//! J. Nocedal, S. J. Wright, *Numerical Optimization*, 2nd edition, 2006, algorithm 7.4.

use std::collections::VecDeque;

use crate::rows::add;

/// The last steps.
pub(crate) struct Memory {
    steps: VecDeque<Step>,
    most: usize,
}

/// A remembered step: s, y and 1/sᵀy.
struct Step {
    moved: Vec<f64>,
    turned: Vec<f64>,
    inverse: f64,
}

impl Memory {
    /// Of `most` steps. More: each direction takes longer; fewer: more steps.
    pub(crate) fn new(most: usize) -> Self {
        Self { steps: VecDeque::with_capacity(most), most }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    pub(crate) fn clear(&mut self) {
        self.steps.clear();
    }

    /// Remembers a step, the change of the gradient along it, and the product of both, which must be positive.
    pub(crate) fn push(&mut self, moved: Vec<f64>, turned: Vec<f64>, curvature: f64) {
        if self.steps.len() == self.most {
            self.steps.pop_front();
        }
        self.steps.push_back(Step { moved, turned, inverse: 1.0 / curvature });
    }

    /// `−H g`, H₀ being `size` times what `times` does.
    pub(crate) fn direction(&self, gradient: &[f64], times: impl Fn(&[f64]) -> Vec<f64>, size: f64) -> Vec<f64> {
        let mut q = gradient.to_vec();
        let mut shares = Vec::with_capacity(self.steps.len());
        for step in self.steps.iter().rev() {
            let share = step.inverse * dot(&step.moved, &q);
            add(&mut q, -share, &step.turned);
            shares.push(share);
        }
        let mut r = times(&q);
        r.iter_mut().for_each(|r| *r *= size);
        for (step, share) in self.steps.iter().zip(shares.into_iter().rev()) {
            let back = step.inverse * dot(&step.turned, &r);
            add(&mut r, share - back, &step.moved);
        }
        r.iter_mut().for_each(|r| *r = -*r);
        r
    }
}

/// a · b, in eight sums that do not wait for one another.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    const SUMS: usize = 8;
    let mut sums = [0.0; SUMS];
    let (a, b) = (a.chunks_exact(SUMS), b.chunks_exact(SUMS));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        for k in 0..SUMS {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along steps that are conjugate, as many as there are unknowns, H is the inverse of a quadratic function's second derivative, whatever H₀ is.
    #[test]
    fn conjugate_steps_tell_all_of_a_quadratic_function() {
        // A = diag(1 … 11), whose axes are conjugate.
        const N: usize = 11;
        let mut memory = Memory::new(N);
        for k in 0..N {
            let axis: Vec<f64> = (0..N).map(|i| if i == k { 0.5 } else { 0.0 }).collect();
            let turned: Vec<f64> = axis.iter().map(|x| (k + 1) as f64 * x).collect();
            let curvature = dot(&axis, &turned);
            memory.push(axis, turned, curvature);
        }
        let gradient: Vec<f64> = (0..N).map(|k| (3 * k) as f64 - 7.0).collect();
        let direction = memory.direction(&gradient, <[f64]>::to_vec, 4.0);
        for (k, (found, g)) in direction.iter().zip(&gradient).enumerate() {
            assert!((found + g / (k + 1) as f64).abs() <= 1e-14, "{k}: {found}");
        }
        // One more pushes the first out, and along its axis H₀ is left.
        memory.push(
            vec![0.0, 0.5].into_iter().chain([0.0; N - 2]).collect(),
            vec![0.0, 1.0].into_iter().chain([0.0; N - 2]).collect(),
            0.5,
        );
        assert!((memory.direction(&gradient, <[f64]>::to_vec, 4.0)[0] - 28.0).abs() <= 1e-13);
    }

    #[test]
    fn products_are_whole() {
        let a: Vec<f64> = (0..29).map(f64::from).collect();
        assert_eq!(dot(&a, &a), 28.0 * 29.0 * 57.0 / 6.0);
        assert_eq!(dot(&[], &[]), 0.0);
    }
}
