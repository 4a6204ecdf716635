//! CVB's figures 5 and 6: the angle of local stress as the largest of many directions, and a polynomial for it.
//!
//! *Figure 5.* Directions are spread evenly over the sphere, on a spiral. With s₁ ≥ s₂ ≥ s₃ > 0 and k = s₃/s₁, an angle δ away from the direction that is
//! turned most a direction is turned by less: to second order by (1 − k)/√k δ² in the plane of s₁ and s₃, by
//! (s₁ − s₂)(s₂ − s₃)/((s₁ − s₃)√(s₁s₃)) δ², a quarter of that at most, across it. N directions have an area of 4π/N each, and none is farther than the side
//! of such a square from any place; so to second order their largest angle is short by (1 − k)/√k 4π/N at most.
//!
//! *Figure 6.* The polynomial is the least-squares fit over pairs (s₁, s₃), s₁ ≥ s₃, of equally spaced stretches from 1/f to f. The paper states neither its
//! stretches nor its coefficients, so f is a factor of 2, 5, 10 and 20 here. The angle depends on s₃/s₁ alone, so the error depends on the largest ratio f²
//! alone. It grows with f: near s₃ = 0 the angle goes like √s₃, which no polynomial does.

use std::f64::consts::{PI, TAU};

use faer::linalg::solvers::{Qr, SolveLstsq};
use faer::{Col, Mat};
use glam::DVec3;
use isochor::LocalStress;

use crate::paper;

/// Directions of a simulation. More: closer to the largest angle; fewer: less time.
const DIRECTIONS: usize = 100_000;

/// Triplets of a simulation: s₁ = 1, s₃ = 1/60, 2/60, … 1. More: dots touch; fewer: steep ends have none.
const TRIPLETS: usize = 60;

/// Places of s₂ between s₃ and s₁, 0 to 1, in turns.
pub const BETWEEN: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Degree of the polynomial, in s₁ and s₃ together: the paper's.
const DEGREE: i32 = 6;

/// Stretches of fits go from 1/f to f.
const FACTORS: [f64; 4] = [2.0, 5.0, 10.0, 20.0];

/// Stretches from the least to the largest. More: the same to three digits; fewer: errors between them are not seen.
const STRETCHES: usize = 100;

/// What was computed.
#[derive(Debug, serde::Serialize)]
pub struct StressAngles {
    pub directions: usize,
    /// The paper's figure 5.
    pub simulated: Vec<SimulatedAngle>,
    /// By how much simulated angles are short at most, in degrees.
    pub largest_shortfall: f64,
    /// The average absolute error of the paper's polynomial, in degrees.
    pub paper_average_error: f64,
    /// The paper's figure 6.
    pub fits: Vec<AngleFit>,
}

/// The angle of a triplet of stretches, in degrees.
#[derive(Debug, serde::Serialize)]
pub struct SimulatedAngle {
    /// s₁ ≥ s₂ ≥ s₃ > 0.
    pub stretches: [f64; 3],
    /// The largest over all directions.
    pub simulated: f64,
    /// arccos(2 √(s₁ s₃) / (s₁ + s₃)).
    pub exact: f64,
}

/// A polynomial for the angle.
#[derive(Debug, serde::Serialize)]
pub struct AngleFit {
    /// f: stretches are from 1/f to f.
    pub factor: f64,
    /// Pairs of stretches over which it is the best.
    pub pairs: usize,
    /// Degrees. Of xⁱ yʲ, i + j ≤ 6, in the order (0, 0), (0, 1), … (0, 6), (1, 0), … (6, 0), where x and y are s₁ and s₃ brought to −1 to 1.
    pub coefficients: Vec<f64>,
    /// Absolute error over the pairs, in degrees: mean and largest.
    pub average_error: f64,
    pub largest_error: f64,
}

impl StressAngles {
    /// Of all triplets and all factors; takes some tenths of a second.
    pub fn computed() -> Self {
        let directions: Vec<DVec3> = (0..DIRECTIONS).map(direction).collect();
        let triplet = |n: usize| {
            let (s1, s3) = (1.0, (n + 1) as f64 / TRIPLETS as f64);
            let stretches = [s1, s3 + BETWEEN[n % BETWEEN.len()] * (s1 - s3), s3];
            SimulatedAngle { stretches, simulated: largest_angle(stretches, &directions), exact: angle(stretches) }
        };
        let simulated: Vec<SimulatedAngle> = (0..TRIPLETS).map(triplet).collect();
        Self {
            directions: DIRECTIONS,
            largest_shortfall: simulated.iter().map(|row| row.exact - row.simulated).fold(0.0, f64::max),
            simulated,
            paper_average_error: paper::STRESS_FIT_ERROR,
            fits: FACTORS.map(AngleFit::new).into(),
        }
    }
}

/// The n-th of [`DIRECTIONS`] on a spiral of equal areas, each turned on by the golden angle (R. Swinbank, R. J. Purser, *Fibonacci grids*, 2006).
fn direction(n: usize) -> DVec3 {
    let golden = PI * (3.0 - 5f64.sqrt());
    let z = 1.0 - (2 * n + 1) as f64 / DIRECTIONS as f64;
    let (sin, cos) = (n as f64 * golden % TAU).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

/// The largest angle between a direction g and S g, in degrees.
fn largest_angle(stretches: [f64; 3], directions: &[DVec3]) -> f64 {
    // The square of its tangent; it is below a right angle, for all stretches are positive.
    let turn = |g: &DVec3| {
        let image = DVec3::from_array(stretches) * *g;
        g.cross(image).length_squared() / g.dot(image).powi(2)
    };
    directions.iter().map(turn).fold(0.0, f64::max).sqrt().atan().to_degrees()
}

/// The same in closed form.
pub fn angle(singular_values: [f64; 3]) -> f64 {
    LocalStress { singular_values }.angle().to_degrees()
}

impl AngleFit {
    fn new(factor: f64) -> Self {
        let stretch = |n: usize| {
            let part = n as f64 / (STRETCHES - 1) as f64;
            (1.0 - part) / factor + part * factor
        };
        let pairs: Vec<[f64; 2]> =
            (0..STRETCHES).flat_map(|i| (0..=i).map(move |j| [i, j])).map(|pair| pair.map(stretch)).collect();
        let exact: Vec<f64> = pairs.iter().map(|&[s1, s3]| angle([s1, s3, s3])).collect();
        let rows: Vec<Vec<f64>> = pairs.iter().map(|pair| powers(*pair, factor)).collect();
        let matrix = Mat::from_fn(rows.len(), rows[0].len(), |row, column| rows[row][column]);
        let solution = Qr::new(matrix.as_ref()).solve_lstsq(Col::from_fn(exact.len(), |row| exact[row]));
        let mut fit = Self {
            factor,
            pairs: pairs.len(),
            coefficients: solution.iter().copied().collect(),
            average_error: 0.0,
            largest_error: 0.0,
        };
        let errors = pairs.iter().zip(&exact).map(|(pair, exact)| (fit.angle(*pair) - exact).abs());
        let (sum, largest) = errors.fold((0.0, 0.0), |(sum, most): (f64, f64), error| (sum + error, most.max(error)));
        (fit.average_error, fit.largest_error) = (sum / pairs.len() as f64, largest);
        fit
    }

    /// The polynomial of s₁ and s₃, in degrees.
    pub fn angle(&self, stretches: [f64; 2]) -> f64 {
        self.coefficients.iter().zip(powers(stretches, self.factor)).map(|(c, power)| c * power).sum()
    }
}

/// All products of powers of s₁ and s₃, brought from 1/f … f to −1 … 1.
fn powers(stretches: [f64; 2], factor: f64) -> Vec<f64> {
    let [x, y] = stretches.map(|s| (2.0 * s - factor - 1.0 / factor) / (factor - 1.0 / factor));
    (0..=DEGREE).flat_map(|i| (0..=DEGREE - i).map(move |j| x.powi(i) * y.powi(j))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_nowhere_far_apart() {
        let directions: Vec<DVec3> = (0..DIRECTIONS).map(direction).collect();
        assert!(directions.iter().all(|g| (g.length() - 1.0).abs() < 1e-12));
        let side = (2.0 * TAU / DIRECTIONS as f64).sqrt();
        // Both poles, and places all over, none of which is a direction.
        let places = (0..300).map(|n| directions[n * 331].any_orthonormal_vector()).chain([DVec3::Z, DVec3::NEG_Z]);
        for place in places {
            let nearest = directions.iter().map(|g| g.distance(place)).fold(f64::INFINITY, f64::min);
            assert!(nearest <= side, "{nearest} from {place}");
        }
    }

    /// Where a sum of squares is least its derivatives are 0: with respect to coefficients, sums of errors times powers.
    #[test]
    fn errors_are_at_right_angles_to_all_powers() {
        let fit = AngleFit::new(3.0);
        let mut sums = vec![0.0; fit.coefficients.len()];
        let (mut total, mut pairs) = (0.0, 0);
        let stretch = |n: usize| 1.0 / 3.0 + (3.0 - 1.0 / 3.0) * n as f64 / 99.0;
        for (i, j) in (0..100).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            let pair = [stretch(i), stretch(j)];
            let error = fit.angle(pair) - angle([pair[0], pair[0], pair[1]]);
            (total, pairs) = (total + error.abs(), pairs + 1);
            for (sum, power) in sums.iter_mut().zip(powers(pair, 3.0)) {
                *sum += error * power;
            }
        }
        assert_eq!((fit.pairs, pairs, sums.len()), (5050, 5050, 28));
        assert!((fit.average_error * 5050.0 / total - 1.0).abs() < 1e-9);
        assert!(sums.iter().all(|sum| sum.abs() < 1e-9 * total), "{sums:?} of {total}");
    }
}
