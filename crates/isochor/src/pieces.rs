//! A basis as what it is between its knots: polynomials, one short row of them for each span.
//!
//! Over a span [a, b], with t = (u − a)/(b − a), the p + 1 functions that do not vanish are `B_r(u) = Σ_i c_ir β_i(t)`, β the Bernstein
//! polynomials of degree p. The Bézier coefficients c_ir ≥ 0 are the functions' polar forms with i arguments b and the others a, which
//! the Cox–de Boor recurrence gives when each of its steps takes an argument of its own (L. Ramshaw, *Blossoms are polar forms*, 1989).
//! Nothing cancels: all terms are positive.
//!
//! So a row takes one number and an index to store, not p + 1 numbers. Sweeps over many rows are limited by memory, and are faster so.
//!
//! Beyond the domain's ends u* the functions go on along their tangents, `B(u*) + B′(u*) t` with t = u − u*: two more pieces.

use crate::bspline::Basis;

/// The pieces of a basis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pieces {
    degree: usize,
    /// Ends of the spans that are not empty: 0 first, 1 last.
    breaks: Vec<f64>,
    /// First function of each piece that does not vanish: below the domain, in its spans, above it.
    starts: Vec<u16>,
    /// c (#pieces × (p + 1) × (p + 1)), coefficients of one β after the other. Beyond the ends: values there, slopes, and nothing.
    coefficients: Vec<f64>,
}

impl Pieces {
    pub(crate) fn of(basis: &Basis) -> Self {
        let degree = basis.degree();
        let mut breaks = basis.knots()[degree..=basis.size()].to_vec();
        breaks.dedup();
        let mut pieces = Self { degree, breaks: Vec::new(), starts: Vec::new(), coefficients: Vec::new() };
        pieces.push_tangent(basis, 0.0);
        for ends in breaks.windows(2) {
            let start = pieces.pushed(degree + 1, |i, row| {
                basis.polar_row(ends[0], |step| if step <= i { ends[1] } else { ends[0] }, row)
            });
            pieces.starts.push(start);
        }
        pieces.push_tangent(basis, 1.0);
        Self { breaks, ..pieces }
    }

    /// The piece beyond the domain's end `at`.
    fn push_tangent(&mut self, basis: &Basis, at: f64) {
        let start = self.pushed(2, |i, row| match i {
            0 => basis.row(at, row),
            _ => basis.row_derivative(at, row),
        });
        self.starts.push(start);
    }

    /// Adds the coefficients of a piece, `count` rows by `fill(i, row)`, and returns what that returns.
    fn pushed(&mut self, count: usize, fill: impl Fn(usize, &mut [f64]) -> usize) -> u16 {
        let length = self.degree + 1;
        let mut start = 0;
        for i in 0..length {
            let at = self.coefficients.len();
            self.coefficients.resize(at + length, 0.0);
            if i < count {
                start = fill(i, &mut self.coefficients[at..]);
            }
        }
        start as u16 // at most bspline::MAX_SIZE
    }

    /// Numbers per row: degree + 1.
    pub(crate) fn length(&self) -> usize {
        self.degree + 1
    }

    /// Number of pieces.
    pub(crate) fn count(&self) -> usize {
        self.starts.len()
    }

    /// The piece that holds `u` and t there. The ends of the domain are inside.
    pub(crate) fn place(&self, u: f64) -> (u16, f64) {
        if u < 0.0 {
            return (0, u);
        }
        if u > 1.0 {
            return (self.count() as u16 - 1, u - 1.0);
        }
        let interior = &self.breaks[1..self.breaks.len() - 1];
        let span = interior.partition_point(|b| *b <= u);
        let [a, b] = [self.breaks[span], self.breaks[span + 1]];
        (span as u16 + 1, (u - a) / (b - a))
    }

    /// Whether a piece is beyond the domain.
    pub(crate) fn is_tangent(&self, piece: u16) -> bool {
        piece == 0 || usize::from(piece) == self.count() - 1
    }

    /// First function of a piece that does not vanish there.
    pub(crate) fn start(&self, piece: u16) -> usize {
        usize::from(self.starts[usize::from(piece)])
    }

    /// c of a piece ((p + 1) × (p + 1)).
    pub(crate) fn coefficients(&self, piece: u16) -> &[f64] {
        let square = self.length() * self.length();
        &self.coefficients[usize::from(piece) * square..(usize::from(piece) + 1) * square]
    }

    /// The row at t of a piece; `scratch` holds as many numbers.
    pub(crate) fn row(&self, piece: u16, t: f64, row: &mut [f64], scratch: &mut [f64]) {
        if self.is_tangent(piece) {
            scratch.fill(0.0);
            (scratch[0], scratch[1]) = (1.0, t);
        } else {
            bernstein(t, scratch);
        }
        row.fill(0.0);
        for (beta, of_beta) in scratch.iter().zip(self.coefficients(piece).chunks_exact(self.length())) {
            row.iter_mut().zip(of_beta).for_each(|(sum, c)| *sum += beta * c);
        }
    }

    /// The functions that do not vanish at `u`, in the domain, with first and second derivatives: three rows in `rows`, `scratch`
    /// holds as many numbers. Returns the index of the first function.
    ///
    /// Inlined, so that rows of a length that the caller knows become loops of that length.
    #[inline(always)]
    pub(crate) fn jet_row(&self, u: f64, rows: &mut [f64], scratch: &mut [f64]) -> usize {
        let (piece, t) = self.place(u);
        let span = usize::from(piece) - 1;
        let width = self.breaks[span + 1] - self.breaks[span];
        let length = rows.len() / 3;
        bernstein_jet(t, 1.0 / width, scratch, length);
        for (row, betas) in rows.chunks_exact_mut(length).zip(scratch.chunks_exact(length)) {
            row.fill(0.0);
            for (beta, of_beta) in betas.iter().zip(self.coefficients(piece).chunks_exact(length)) {
                row.iter_mut().zip(of_beta).for_each(|(sum, c)| *sum += beta * c);
            }
        }
        self.start(piece)
    }
}

/// The Bernstein polynomials of degree `values.len() − 1` at t.
fn bernstein(t: f64, values: &mut [f64]) {
    let s = 1.0 - t;
    values[0] = 1.0;
    for j in 1..values.len() {
        let mut saved = 0.0;
        for value in &mut values[..j] {
            let old = *value;
            *value = saved + s * old;
            saved = t * old;
        }
        values[j] = saved;
    }
}

/// The Bernstein polynomials of degree `length − 1` at t with first and second derivatives by a parameter in which t runs `rate` times
/// faster: three rows in `rows`. The derivatives are differences of the polynomials of one and two degrees less.
#[inline(always)]
fn bernstein_jet(t: f64, rate: f64, rows: &mut [f64], length: usize) {
    let (values, derivatives) = rows.split_at_mut(length);
    let (first, second) = derivatives.split_at_mut(length);
    let (degree, s) = (length - 1, 1.0 - t);
    let n = degree as f64;
    second.fill(0.0);
    values[0] = 1.0;
    for j in 1..=degree {
        // Here `values[..j]` are the polynomials of degree j − 1.
        if j + 1 == degree {
            let factor = n * (n - 1.0) * rate * rate;
            for (i, value) in values[..j].iter().enumerate() {
                second[i] += factor * value;
                second[i + 1] -= 2.0 * factor * value;
                second[i + 2] += factor * value;
            }
        }
        if j == degree {
            let mut saved = 0.0;
            for (slope, value) in first.iter_mut().zip(&values[..j]) {
                let new = n * rate * value;
                *slope = saved - new;
                saved = new;
            }
            first[degree] = saved;
        }
        let mut saved = 0.0;
        for value in &mut values[..j] {
            let old = *value;
            *value = saved + s * old;
            saved = t * old;
        }
        values[j] = saved;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bases() -> Vec<Basis> {
        let knots = vec![-0.5, -0.1, 0.0, 0.3, 0.3, 0.7, 1.0, 1.0, 1.2];
        let mut bases = vec![Basis::with_knots(knots, 2).unwrap(), Basis::bernstein(8).unwrap()];
        for degree in 1..=4 {
            bases.push(Basis::uniform(9, degree).unwrap());
            bases.push(Basis::clamped(9, degree).unwrap());
        }
        bases
    }

    #[test]
    fn pieces_are_the_rows_of_the_recurrence() {
        for basis in bases() {
            let pieces = Pieces::of(&basis);
            let length = pieces.length();
            let [mut row, mut scratch, mut expected] = [0; 3].map(|_| vec![0.0; length]);
            for k in -20..=120 {
                let u = f64::from(k) / 100.0;
                let (piece, t) = pieces.place(u);
                pieces.row(piece, t, &mut row, &mut scratch);
                let start = basis.row(u, &mut expected);
                // At a knot that is repeated as often as the degree a row may start before or after it.
                assert_eq!(pieces.start(piece), start, "{u}");
                for (found, expected) in row.iter().zip(&expected) {
                    assert!((found - expected).abs() <= 4e-15 * expected.abs().max(1.0), "{found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn coefficients_are_never_negative_and_the_ends_are_exact() {
        for basis in bases() {
            let pieces = Pieces::of(&basis);
            for piece in 1..pieces.count() as u16 - 1 {
                assert!(pieces.coefficients(piece).iter().all(|c| *c >= 0.0));
            }
        }
        let basis = Basis::clamped(7, 3).unwrap();
        let pieces = Pieces::of(&basis);
        let [mut row, mut scratch] = [[0.0; 4]; 2];
        for (u, expected) in [(0.0, [1.0, 0.0, 0.0, 0.0]), (1.0, [0.0, 0.0, 0.0, 1.0])] {
            let (piece, t) = pieces.place(u);
            pieces.row(piece, t, &mut row, &mut scratch);
            assert_eq!(row, expected);
        }
    }
}
