//! Univariate B-spline bases, Bernstein polynomials among them.
//!
//! Basis functions are evaluated by the Cox–de Boor recurrence in the triangular form of L. Piegl, W. Tiller, *The NURBS
//! Book* (1997), algorithm A2.2, and differentiated by their equation (2.9). The Bernstein basis of degree n is the
//! B-spline basis of degree n with n + 1 functions on clamped knots without interior ones; the recurrence is then de
//! Casteljau's, so one evaluator serves both.

/// A B-spline basis on the domain [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub struct Basis {
    degree: usize,
    /// `size + degree + 1` numbers, not decreasing; the domain is from `knots[degree]` = 0 to `knots[size]` = 1.
    knots: Vec<f64>,
}

/// Why numbers make no [`Basis`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BasisError {
    /// Degree 0.
    #[error("the degree is 0: it must be at least 1")]
    DegreeZero,
    /// Too few control points for the degree.
    #[error("{size} control points are too few for degree {degree}: at least {} are needed", .degree.saturating_add(1))]
    TooFewControls {
        /// Number of control points.
        size: usize,
        /// The degree.
        degree: usize,
    },
    /// More control points along one axis than can be indexed.
    #[error("{size} control points along one axis are too many: at most {MAX_SIZE}")]
    TooManyControls {
        /// Number of control points.
        size: usize,
    },
    /// A knot is not finite or smaller than its predecessor.
    #[error("knot {index} is {value}: knots must be finite and must not decrease")]
    NotAscending {
        /// Index of the knot.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// An interior knot repeated so often that the deformation would tear.
    #[error(
        "knot {value} is repeated {count} times inside the domain: for degree {degree} at most {degree} keep it continuous"
    )]
    Discontinuous {
        /// The repeated knot.
        value: f64,
        /// How often it occurs.
        count: usize,
        /// The degree.
        degree: usize,
    },
    /// The domain is not [0, 1].
    #[error("the domain of the knots is from {low} to {high}: it must be from 0 to 1")]
    Domain {
        /// `knots[degree]`.
        low: f64,
        /// `knots[size]`.
        high: f64,
    },
}

/// Most control points along one axis. More: rows would need wider indices; fewer is never needed in practice.
pub const MAX_SIZE: usize = 1024;

impl Basis {
    /// `size` functions of degree `degree` on clamped knots: 0 and 1 repeated degree + 1 times, equidistant between.
    ///
    /// # Errors
    ///
    /// Degree 0; size not in degree + 1 ..= [`MAX_SIZE`].
    pub fn clamped(size: usize, degree: usize) -> Result<Self, BasisError> {
        check_size(size, degree)?;
        let spans = (size - degree) as f64;
        let knots = (0..=size + degree).map(|i| i.saturating_sub(degree).min(size - degree) as f64 / spans).collect();
        Ok(Self { degree, knots })
    }

    /// `size` functions of degree `degree` on uniform knots `t_i = (i − degree) / (size − degree)` (HB, section 6.2). The
    /// first and last control points lie outside the domain.
    ///
    /// # Errors
    ///
    /// As [`Basis::clamped`].
    pub fn uniform(size: usize, degree: usize) -> Result<Self, BasisError> {
        check_size(size, degree)?;
        let spans = (size - degree) as f64;
        let knots = (0..=size + degree).map(|i| (i as f64 - degree as f64) / spans).collect();
        Ok(Self { degree, knots })
    }

    /// The `size` Bernstein polynomials of degree size − 1.
    ///
    /// # Errors
    ///
    /// Size not in 2 ..= [`MAX_SIZE`].
    pub fn bernstein(size: usize) -> Result<Self, BasisError> {
        Self::clamped(size, size.saturating_sub(1))
    }

    /// The functions of degree `degree` on `knots`: size + degree + 1 numbers with the domain [0, 1] between
    /// `knots[degree]` and `knots[size]`.
    ///
    /// # Errors
    ///
    /// Degree 0; too few knots; knots that decrease, are not finite, or repeat more than `degree` times inside; another
    /// domain.
    pub fn with_knots(knots: Vec<f64>, degree: usize) -> Result<Self, BasisError> {
        let size = knots.len().saturating_sub(degree.saturating_add(1));
        check_size(size, degree)?;
        let descends = |i: &usize| !knots[*i].is_finite() || (*i > 0 && knots[*i] < knots[*i - 1]);
        if let Some(index) = (0..knots.len()).find(descends) {
            return Err(BasisError::NotAscending { index, value: knots[index] });
        }
        let (low, high) = (knots[degree], knots[size]);
        if low != 0.0 || high != 1.0 {
            return Err(BasisError::Domain { low, high });
        }
        let interior = knots.iter().filter(|&&t| t > low && t < high).copied().collect::<Vec<_>>();
        if let Some(run) = interior.chunk_by(|a, b| a == b).find(|run| run.len() > degree) {
            return Err(BasisError::Discontinuous { value: run[0], count: run.len(), degree });
        }
        Ok(Self { degree, knots })
    }

    /// Number of basis functions, and of control points.
    #[must_use]
    pub fn size(&self) -> usize {
        self.knots.len() - self.degree - 1
    }

    /// Polynomial degree.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// The full knot vector, size + degree + 1 numbers.
    #[must_use]
    pub fn knots(&self) -> &[f64] {
        &self.knots
    }

    /// The different knots of the domain, between which the functions are polynomials: 0 first, 1 last.
    pub(crate) fn breaks(&self) -> Vec<f64> {
        let mut breaks = self.knots[self.degree..=self.size()].to_vec();
        breaks.dedup();
        breaks
    }

    /// Whether this is the Bernstein basis.
    #[must_use]
    pub fn is_bernstein(&self) -> bool {
        Self::bernstein(self.size()).is_ok_and(|b| b == *self)
    }

    /// Greville abscissae, one for each control point: the mean of its `degree` inner knots. Control points there make the
    /// identity: `Σ ξ_i B_i(u) = u`.
    #[must_use]
    pub fn greville(&self) -> Vec<f64> {
        (0..self.size()).map(|i| self.knots[i + 1..=i + self.degree].iter().sum::<f64>() / self.degree as f64).collect()
    }

    /// The degree + 1 functions that do not vanish at `u`, into `values`; returns the index of the first.
    ///
    /// Beyond the domain's end u* the functions go on along their tangents: `B(u*) + B′(u*)(u − u*)`.
    ///
    /// # Panics
    ///
    /// Panics where `values` does not hold exactly degree + 1 numbers.
    pub fn row(&self, u: f64, values: &mut [f64]) -> usize {
        let inside = u.clamp(0.0, 1.0);
        let span = self.span(inside);
        self.functions(span, |_| inside, self.degree, values);
        if u != inside {
            let mut slopes = vec![0.0; self.degree + 1];
            self.derivatives(span, inside, &mut slopes);
            for (value, slope) in values.iter_mut().zip(slopes) {
                *value += slope * (u - inside);
            }
        }
        span - self.degree
    }

    /// Derivatives at `u` of the functions that [`Basis::row`] gives there, into `slopes`; returns the index of the first.
    ///
    /// # Panics
    ///
    /// Panics where `slopes` does not hold exactly degree + 1 numbers.
    pub fn row_derivative(&self, u: f64, slopes: &mut [f64]) -> usize {
        let inside = u.clamp(0.0, 1.0);
        let span = self.span(inside);
        self.derivatives(span, inside, slopes);
        span - self.degree
    }

    /// The polar forms of the functions that do not vanish in the span from `from` on, into `values`; returns the index of the first.
    /// `argument(1)`, … `argument(degree)` are the polar forms' arguments: with all of them u it is [`Basis::row`] at u.
    pub(crate) fn polar_row(&self, from: f64, argument: impl Fn(usize) -> f64, values: &mut [f64]) -> usize {
        let span = self.span(from);
        self.functions(span, argument, self.degree, values);
        span - self.degree
    }

    /// The index i with `knots[i] ≤ u < knots[i + 1]`, u in the domain; its last non-empty span at u = 1.
    fn span(&self, u: f64) -> usize {
        let domain = &self.knots[self.degree..=self.size()];
        let after = domain.partition_point(|&t| t <= u);
        let last = domain.partition_point(|&t| t < 1.0); // u = 1 belongs to the span before it
        self.degree + after.min(last) - 1
    }

    /// Piegl and Tiller, A2.2: the functions of degree `degree` over knot span `span`; step j of the recurrence is taken at `argument(j)`.
    fn functions(&self, span: usize, argument: impl Fn(usize) -> f64, degree: usize, values: &mut [f64]) {
        assert_eq!(values.len(), degree + 1, "one value for each function that does not vanish");
        let t = &self.knots;
        values[0] = 1.0;
        for j in 1..=degree {
            let (u, mut saved) = (argument(j), 0.0);
            for r in 0..j {
                let (right, left) = (t[span + r + 1] - u, u - t[span + 1 + r - j]);
                let share = values[r] / (t[span + r + 1] - t[span + 1 + r - j]);
                values[r] = saved + right * share;
                saved = left * share;
            }
            values[j] = saved;
        }
    }

    /// Piegl and Tiller, (2.9): `B′_{i,p} = p (B_{i,p−1} / (t_{i+p} − t_i) − B_{i+1,p−1} / (t_{i+p+1} − t_{i+1}))`.
    fn derivatives(&self, span: usize, u: f64, slopes: &mut [f64]) {
        assert_eq!(slopes.len(), self.degree + 1, "one slope for each function that does not vanish");
        let (p, t) = (self.degree, &self.knots);
        self.functions(span, |_| u, p - 1, &mut slopes[..p]);
        let mut saved = 0.0;
        for (r, slope) in slopes.iter_mut().enumerate() {
            let i = span - p + r;
            // The lower-degree function that starts one span later; none at the end of the row.
            let next = if r < p { p as f64 * *slope / (t[i + 1 + p] - t[i + 1]) } else { 0.0 };
            *slope = saved - next;
            saved = next;
        }
    }
}

fn check_size(size: usize, degree: usize) -> Result<(), BasisError> {
    match (size, degree) {
        (_, 0) => Err(BasisError::DegreeZero),
        _ if size <= degree => Err(BasisError::TooFewControls { size, degree }),
        _ if size > MAX_SIZE => Err(BasisError::TooManyControls { size }),
        _ => Ok(()),
    }
}
