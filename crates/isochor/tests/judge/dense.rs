//! Dense linear algebra and sums in doubled precision, for checks of small cases. Written for the judge alone.

use std::ops::{Add, Mul, Sub};

/// A number in twice the precision of f64: `high + low`. T. J. Dekker (1971), without fused operations.
#[derive(Clone, Copy, Debug, Default)]
pub struct Twice {
    high: f64,
    low: f64,
}

impl From<f64> for Twice {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl Twice {
    pub fn value(self) -> f64 {
        self.high + self.low
    }

    fn sum_of(a: f64, b: f64) -> Self {
        let high = a + b;
        let part = high - a;
        Self { high, low: (a - (high - part)) + (b - part) }
    }

    fn product_of(a: f64, b: f64) -> Self {
        let halves = |x: f64| {
            let c = 134_217_729.0 * x;
            let top = c - (c - x);
            (top, x - top)
        };
        let high = a * b;
        let ((a1, a2), (b1, b2)) = (halves(a), halves(b));
        Self { high, low: ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2 }
    }
}

impl Add for Twice {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (s, t) = (Self::sum_of(self.high, other.high), Self::sum_of(self.low, other.low));
        let u = Self::sum_of(s.high, s.low + t.high);
        Self::sum_of(u.high, u.low + t.low)
    }
}

impl Sub for Twice {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + Self { high: -other.high, low: -other.low }
    }
}

impl Mul for Twice {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let p = Self::product_of(self.high, other.high);
        Self::sum_of(p.high, p.low + (self.high * other.low + self.low * other.high))
    }
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub fn norm(a: &[f64]) -> f64 {
    let largest = a.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    largest * a.iter().map(|x| (x / largest).powi(2)).sum::<f64>().sqrt()
}

fn add(a: &mut [f64], factor: f64, b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += factor * b);
}

/// Singular values of rows that are first scaled to length 1, by one-sided Jacobi rotations: `A = diag(lengths) V Σ Qᵀ`.
pub struct Decomposed {
    /// What each row was divided by (#rows).
    lengths: Vec<f64>,
    /// Orthonormal (#rows × #unknowns), 0 where σ is 0.
    q: Vec<Vec<f64>>,
    /// σ (#rows).
    sigma: Vec<f64>,
    /// Row k of Vᵀ (#rows × #rows).
    v: Vec<Vec<f64>>,
}

/// Singular values of unit rows below this count as 0. Larger: rows nearly alike are taken for one; smaller: rounding counts.
pub const DEPENDENT: f64 = 1e-11;

impl Decomposed {
    pub fn of(rows: &[Vec<f64>]) -> Self {
        let lengths: Vec<f64> = rows.iter().map(|row| norm(row)).map(|l| if l == 0.0 { 1.0 } else { l }).collect();
        let scaled = |(row, length): (&Vec<f64>, &f64)| row.iter().map(|x| x / length).collect::<Vec<f64>>();
        let mut q: Vec<Vec<f64>> = rows.iter().zip(&lengths).map(scaled).collect();
        let count = q.len();
        let mut v: Vec<Vec<f64>> =
            (0..count).map(|i| (0..count).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        for _ in 0..60 {
            let mut has_rotated = false;
            for i in 0..count {
                for j in i + 1..count {
                    let (a, b, c) = (dot(&q[i], &q[i]), dot(&q[j], &q[j]), dot(&q[i], &q[j]));
                    if c.abs() <= 1e-16 * (a * b).sqrt() {
                        continue;
                    }
                    has_rotated = true;
                    let zeta = (b - a) / (2.0 * c);
                    let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                    let cosine = 1.0 / tangent.hypot(1.0);
                    let sine = cosine * tangent;
                    for list in [&mut q, &mut v] {
                        let (low, high) = list.split_at_mut(j);
                        for (x, y) in low[i].iter_mut().zip(&mut high[0]) {
                            (*x, *y) = (cosine * *x - sine * *y, sine * *x + cosine * *y);
                        }
                    }
                }
            }
            if !has_rotated {
                break;
            }
        }
        let sigma: Vec<f64> = q.iter().map(|row| norm(row)).collect();
        for (row, s) in q.iter_mut().zip(&sigma) {
            row.iter_mut().for_each(|x| *x = if *s > DEPENDENT { *x / s } else { 0.0 });
        }
        Self { lengths, q, sigma, v }
    }

    /// Takes what lies in the span of the rows out of `x`.
    pub fn project(&self, x: &mut [f64]) {
        for _ in 0..2 {
            for q in &self.q {
                let part = dot(x, q);
                add(x, -part, q);
            }
        }
    }

    /// The smallest x whose products with the rows are nearest to `b`, in the scale of rows of length 1.
    pub fn least(&self, unknowns: usize, b: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; unknowns];
        for ((q, sigma), v) in self.q.iter().zip(&self.sigma).zip(&self.v) {
            if *sigma > DEPENDENT {
                let part: f64 = v.iter().zip(b).zip(&self.lengths).map(|((v, b), length)| v * b / length).sum();
                add(&mut x, part / sigma, q);
            }
        }
        x
    }
}

/// How much of `row` is not in the span of `others`, as a fraction of it.
pub fn independence(row: &[f64], others: &[Vec<f64>]) -> f64 {
    let whole = norm(row);
    if whole == 0.0 {
        return 0.0;
    }
    let mut rest: Vec<f64> = row.iter().map(|x| x / whole).collect();
    Decomposed::of(others).project(&mut rest);
    norm(&rest)
}

/// A = L Lᵀ of a symmetric positive definite matrix (n × n), row by row.
pub fn cholesky(a: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut l = vec![vec![0.0; a.len()]; a.len()];
    for i in 0..a.len() {
        for j in 0..=i {
            let rest = a[i][j] - dot(&l[i][..j], &l[j][..j]);
            l[i][j] = if i == j { rest.sqrt() } else { rest / l[j][j] };
        }
    }
    l
}

/// x with L x = b.
pub fn forward(l: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let mut x: Vec<f64> = Vec::with_capacity(b.len());
    for i in 0..b.len() {
        x.push((b[i] - dot(&l[i][..i], &x)) / l[i][i]);
    }
    x
}

/// x with Lᵀ x = b.
pub fn backward(l: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let mut x = b.to_vec();
    for i in (0..b.len()).rev() {
        x[i] /= l[i][i];
        let value = x[i];
        add(&mut x[..i], -value, &l[i][..i]);
    }
    x
}

/// The determinant, by elimination with pivots.
pub fn determinant(mut a: Vec<Vec<f64>>) -> f64 {
    let n = a.len();
    let mut product = 1.0;
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| a[*i][k].abs().total_cmp(&a[*j][k].abs())).unwrap();
        if a[pivot][k] == 0.0 {
            return 0.0;
        }
        if pivot != k {
            a.swap(pivot, k);
            product = -product;
        }
        product *= a[k][k];
        let row = a[k].clone();
        for below in &mut a[k + 1..] {
            let factor = below[k] / row[k];
            add(below, -factor, &row);
        }
    }
    product
}
