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
    /// Whether these are those of the Bernstein polynomials themselves.
    is_bernstein: bool,
}

impl Pieces {
    pub(crate) fn of(basis: &Basis) -> Self {
        let degree = basis.degree();
        let breaks = basis.breaks();
        let mut pieces =
            Self { degree, breaks: Vec::new(), starts: Vec::new(), coefficients: Vec::new(), is_bernstein: false };
        pieces.push_tangent(basis, 0.0);
        for ends in breaks.windows(2) {
            let start = pieces.pushed(degree + 1, |i, row| {
                basis.polar_row(ends[0], |step| if step <= i { ends[1] } else { ends[0] }, row)
            });
            pieces.starts.push(start);
        }
        pieces.push_tangent(basis, 1.0);
        let is_unit = |(k, c): (usize, &f64)| *c == f64::from(k / (degree + 1) == k % (degree + 1));
        let is_bernstein = breaks.len() == 2 && pieces.coefficients(1).iter().enumerate().all(is_unit);
        Self { breaks, is_bernstein, ..pieces }
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

    /// Whether there are no knots inside the domain.
    pub(crate) fn is_single(&self) -> bool {
        self.breaks.len() == 2
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

    /// The functions that do not vanish at `u`, in the domain, with their derivatives of orders below N: an element of `rows` (p + 1) for
    /// each function; `scratch` holds as many. Returns the index of the first function.
    ///
    /// Inlined, so that rows of a length that the caller knows become loops of that length.
    #[inline(always)]
    pub(crate) fn derivatives<const N: usize>(&self, u: f64, rows: &mut [[f64; N]], scratch: &mut [[f64; N]]) -> usize {
        let (piece, t) = self.place(u);
        let span = usize::from(piece) - 1;
        let rate = 1.0 / (self.breaks[span + 1] - self.breaks[span]);
        if self.is_bernstein {
            bernstein_derivatives(t, rate, rows);
            return 0;
        }
        bernstein_derivatives(t, rate, scratch);
        rows.fill([0.0; N]);
        for (beta, of_beta) in scratch.iter().zip(self.coefficients(piece).chunks_exact(rows.len())) {
            for (sums, c) in rows.iter_mut().zip(of_beta) {
                sums.iter_mut().zip(beta).for_each(|(sum, beta)| *sum += beta * c);
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

/// The Bernstein polynomials of degree `rows.len() − 1` at t with their derivatives of orders below N by a parameter in which t runs
/// `rate` times faster. The k-th derivatives are differences of the polynomials of k degrees less.
#[inline(always)]
fn bernstein_derivatives<const N: usize>(t: f64, rate: f64, rows: &mut [[f64; N]]) {
    let (degree, s) = (rows.len() - 1, 1.0 - t);
    rows.fill([0.0; N]);
    rows[0][0] = 1.0;
    for j in 0..=degree {
        // Here the values are the polynomials of degree j.
        let order = degree - j;
        if 0 < order && order < N {
            rows[..=j].iter_mut().for_each(|row| row[order] = row[0]);
        }
        if j < degree {
            let mut saved = 0.0;
            for row in &mut rows[..=j] {
                let old = row[0];
                row[0] = saved + s * old;
                saved = t * old;
            }
            rows[j + 1][0] = saved;
        }
    }
    for order in 1..N.min(degree + 1) {
        for m in degree - order + 1..=degree {
            // From degree m − 1 to m.
            let factor = m as f64 * rate;
            let mut saved = 0.0;
            for row in &mut rows[..=m] {
                let new = factor * row[order];
                row[order] = saved - new;
                saved = new;
            }
        }
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
