//! Lengths of curves: `σ(u) = ∫₀ᵘ |Q C′(v)| dv`, Q the projection along a direction.
//!
//! Where |Q C′| is smooth, Gauss quadrature with n nodes converges like `ρ^(−2n)`. Every polynomial piece is halved
//! until one rule over a part and one over each of its halves agree; then a rule over the beginning of a part is as
//! good, and gives σ anywhere. Near a cusp |Q C′| is not smooth; parts shrink towards it until what they hold of the
//! length does not count.

use glam::DVec3;

use crate::curve::Curve;
use crate::gauss::gauss_legendre;

/// Nodes of a rule. More: fewer parts, but each value of σ takes as many evaluations of the curve; fewer: many more
/// parts.
const NODES: usize = 16;

/// A part is fine where its rule and those of its halves, which are better by many digits, agree to this fraction of
/// the length, or of the extent if that is larger. Larger: lengths have fewer digits; smaller: rounding is halved for
/// ever.
const AGREE: f64 = 2e-14;

/// Halvings of a piece at most: near a cusp the parts then are 1e-12 of it, and hold 1e-24 of its length. More: nothing
/// is gained; fewer: cusps show.
const HALVINGS: u32 = 40;

/// A curve's lengths, tabulated.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ArcLength {
    /// Unit vector; lengths across it count.
    direction: DVec3,
    /// Nodes in [0, 1] and weights that sum to 1.
    rule: Vec<[f64; 2]>,
    /// Ends of the parts: 0 first, 1 last.
    breaks: Vec<f64>,
    /// σ there.
    lengths: Vec<f64>,
}

impl ArcLength {
    /// Lengths of `curve`, projected along the unit vector `direction`.
    pub(crate) fn across(curve: &Curve, direction: DVec3) -> Self {
        let mut table = Self { direction, rule: gauss_legendre(NODES), breaks: vec![0.0], lengths: vec![0.0] };
        let pieces = curve.breaks();
        let rough: f64 = pieces.windows(2).map(|ends| table.integral(curve, [ends[0], ends[1]])).sum();
        let near = AGREE * rough.max(curve.extent());
        for ends in pieces.windows(2) {
            // Parts to do, the next one last.
            let mut parts = vec![([ends[0], ends[1]], HALVINGS)];
            while let Some(([from, to], halvings)) = parts.pop() {
                let middle = from + (to - from) / 2.0;
                let halves = [[from, middle], [middle, to]];
                let lengths = halves.map(|half| table.integral(curve, half));
                let whole = table.integral(curve, [from, to]);
                if halvings == 0 || (whole - lengths[0] - lengths[1]).abs() <= near {
                    let before = table.lengths[table.lengths.len() - 1];
                    table.breaks.push(to);
                    table.lengths.push(before + (lengths[0] + lengths[1]));
                } else {
                    parts.extend([(halves[1], halvings - 1), (halves[0], halvings - 1)]);
                }
            }
        }
        table
    }

    /// σ(1).
    pub(crate) fn total(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// σ(u), u anywhere: beyond its ends the curve goes on, straight or round.
    pub(crate) fn at(&self, curve: &Curve, u: f64) -> f64 {
        if curve.closes() && !(0.0..=1.0).contains(&u) {
            return u.floor() * self.total() + self.at(curve, u - u.floor());
        }
        let end = u.clamp(0.0, 1.0);
        if u != end {
            return self.at(curve, end) + (u - end) * self.speed(curve, end);
        }
        let part = self.breaks[1..self.breaks.len() - 1].partition_point(|b| *b <= u);
        if u == self.breaks[part + 1] {
            return self.lengths[part + 1];
        }
        self.lengths[part] + self.integral(curve, [self.breaks[part], u])
    }

    fn speed(&self, curve: &Curve, u: f64) -> f64 {
        let first = curve.jet(u).first;
        (first - self.direction.dot(first) * self.direction).length()
    }

    fn integral(&self, curve: &Curve, [from, to]: [f64; 2]) -> f64 {
        let width = to - from;
        width * self.rule.iter().map(|[x, weight]| weight * self.speed(curve, from + width * x)).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bspline::Basis;

    /// Rational and far from an even speed: u = 1/2 is not at half the angle of other weights.
    #[test]
    fn a_circular_arc_as_a_rational_curve() {
        let controls = vec![DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y];
        let curve = Curve::new(Basis::bernstein(3).unwrap(), controls, Some(vec![1.0, 1.0, 2.0])).unwrap();
        let lengths = ArcLength::across(&curve, DVec3::Z);
        assert!((lengths.total() - std::f64::consts::FRAC_PI_2).abs() < 2e-15);
        for u in [0.01, 0.3, 0.77] {
            let point = curve.jet(u).point;
            assert!((lengths.at(&curve, u) - libm::atan2(point.y, point.x)).abs() < 4e-15, "{u}");
        }
    }

    /// y = x² from 0 to a is a/2 √(1 + 4 a²) + arsinh(2 a)/4 long.
    #[test]
    fn a_parabola_and_its_projection() {
        let a: f64 = 3.0;
        let controls = vec![DVec3::ZERO, DVec3::new(a / 2.0, 0.0, 5.0), DVec3::new(a, a * a, -7.0)];
        let curve = Curve::new(Basis::bernstein(3).unwrap(), controls, None).unwrap();
        let length = |a: f64| a / 2.0 * (1.0 + 4.0 * a * a).sqrt() + libm::asinh(2.0 * a) / 4.0;
        let lengths = ArcLength::across(&curve, DVec3::Z);
        for u in [0.25, 0.5, 1.0] {
            assert!((lengths.at(&curve, u) / length(u * a) - 1.0).abs() < 1e-14, "{u}");
        }
        let beyond = lengths.at(&curve, 1.5) - lengths.total();
        assert!((beyond - 0.5 * a * (1.0 + 4.0 * a * a).sqrt()).abs() < 1e-13);
        // Along x only y² + z² counts: |(2 a² u, C′_z)|, from the points in the plane alone.
        let flat: Vec<DVec3> = curve.controls().iter().map(|p| DVec3::new(0.0, p.y, p.z)).collect();
        let flat = Curve::new(Basis::bernstein(3).unwrap(), flat, None).unwrap();
        let [along_x, in_plane] = [ArcLength::across(&curve, DVec3::X), ArcLength::across(&flat, DVec3::X)];
        assert!((along_x.total() - in_plane.total()).abs() < 1e-13);
    }

    /// The semicubical parabola (u², u³) for u from −1/2 to 1/2, cusp in the middle: twice ((4 + 9 u²)^(3/2) − 8)/27.
    #[test]
    fn a_cusp() {
        let power = |u: f64| DVec3::new(u * u, u * u * u, 0.0);
        // Polar forms: (ab + bc + ca)/3 and abc.
        let polar = |a: f64, b: f64, c: f64| DVec3::new((a * b + b * c + c * a) / 3.0, a * b * c, 0.0);
        let [p, q] = [-0.5, 0.5];
        let controls = vec![polar(p, p, p), polar(p, p, q), polar(p, q, q), polar(q, q, q)];
        let curve = Curve::new(Basis::bernstein(4).unwrap(), controls, None).unwrap();
        assert!(curve.jet(0.75).point.distance(power(0.25)) < 1e-16);
        let exact = 2.0 * ((4.0_f64 + 9.0 * 0.25).powf(1.5) - 8.0) / 27.0;
        let lengths = ArcLength::across(&curve, DVec3::Z);
        assert!((lengths.total() / exact - 1.0).abs() < 1e-13);
    }

    #[test]
    fn a_polyline_is_as_long_as_its_sides() {
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 3.0, 0.0), DVec3::new(1.0, 3.0, 5.0)];
        let curve = Curve::polyline(points).unwrap();
        assert!((ArcLength::across(&curve, DVec3::Z).total() - 4.0).abs() < 1e-14);
        assert!((ArcLength::across(&curve, DVec3::X).total() - 8.0).abs() < 1e-14);
    }
}
