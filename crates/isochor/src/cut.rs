//! A polygon cut along ways through it, and cut up into triangles.
//!
//! Corners are numbers with a place in a plane. Cutting goes by numbers: a way between two corners of a polygon makes two of it, whatever places
//! say, so all pieces together have the border of the polygon, and every other edge once in each direction. Places only choose
//! between ways that are all possible.

use glam::DVec2;

/// Polygons with corners at places in a plane, counter-clockwise.
#[derive(Debug)]
pub(crate) struct Cut<'a> {
    places: &'a [DVec2],
    polygons: Vec<Vec<u32>>,
    /// Whether a corner is in a polygon.
    is_placed: Vec<bool>,
}

/// The cross product of (q − p) and (r − p), over the sum of the squared sides: √3/12 · 2 for the best triangle, 0 for a flat one.
fn roundness(p: DVec2, q: DVec2, r: DVec2) -> f64 {
    let sides = p.distance_squared(q) + q.distance_squared(r) + r.distance_squared(p);
    let area = (q - p).perp_dot(r - p);
    if sides > 0.0 { area / sides } else { 0.0 }
}

/// A corner of a quadrilateral that is less round than this is straight. Larger: more quadrilaterals become triangles; smaller: some
/// quadrilaterals are triangles but for a bend that nobody sees.
const STRAIGHT: f64 = 1e-3;

impl<'a> Cut<'a> {
    /// The polygon with the corners `round`, numbers of `places`.
    pub(crate) fn new(places: &'a [DVec2], round: Vec<u32>) -> Self {
        let mut is_placed = vec![false; places.len()];
        round.iter().for_each(|k| is_placed[*k as usize] = true);
        Self { places, polygons: vec![round], is_placed }
    }

    /// Cuts along `way`, from a corner of a polygon to a corner of a polygon, over corners of polygons or new ones.
    pub(crate) fn along(&mut self, way: &[u32]) {
        let mut start = 0;
        for end in 1..way.len() {
            if self.is_placed[way[end] as usize] {
                self.between(&way[start..=end]);
                start = end;
            }
        }
    }

    /// Cuts along a way between two corners of one polygon over new ones. A way that is an edge already cuts nothing.
    fn between(&mut self, way: &[u32]) {
        let [first, last] = [way[0], way[way.len() - 1]];
        let candidates = self.polygons.iter().enumerate().filter_map(|(k, polygon)| {
            let at = |corner: u32| polygon.iter().position(|c| *c == corner);
            at(first).zip(at(last)).filter(|(i, j)| i != j).map(|(i, j)| (k, i, j))
        });
        let candidates: Vec<(usize, usize, usize)> = candidates.collect();
        let is_edge = |(k, i, j): &(usize, usize, usize)| {
            let n = self.polygons[*k].len();
            (i + 1) % n == *j || (j + 1) % n == *i
        };
        if way.len() == 2 && candidates.iter().any(is_edge) {
            return;
        }
        let into = self.place(way[1]) - self.place(first);
        let best = candidates.into_iter().map(|(k, i, j)| (k, i, j, self.depth(&self.polygons[k], i, into)));
        let Some((k, i, j, _)) = best.reduce(|best, other| if other.3 > best.3 { other } else { best }) else { return };
        let polygon = std::mem::take(&mut self.polygons[k]);
        let from = |i: usize, j: usize| {
            let n = polygon.len();
            (0..=(j + n - i) % n).map(move |s| (i + s) % n).map(|s| polygon[s]).collect::<Vec<u32>>()
        };
        let inner = &way[1..way.len() - 1];
        let mut left = from(j, i); // last … first, then along the way
        left.extend(inner);
        let mut right = from(i, j);
        right.extend(inner.iter().rev());
        inner.iter().for_each(|c| self.is_placed[*c as usize] = true);
        self.polygons[k] = left;
        self.polygons.push(right);
    }

    fn place(&self, corner: u32) -> DVec2 {
        self.places[corner as usize]
    }

    /// How clearly a direction leads into a polygon at its i-th corner: sine of the lesser angle to the sides there, negative outside.
    fn depth(&self, polygon: &[u32], i: usize, into: DVec2) -> f64 {
        let n = polygon.len();
        let at = self.place(polygon[i]);
        let unit = |v: DVec2| v.try_normalize().unwrap_or(DVec2::ZERO);
        let next = unit(self.place(polygon[(i + 1) % n]) - at);
        let previous = unit(self.place(polygon[(i + n - 1) % n]) - at);
        let into = unit(into);
        let (from_next, to_previous) = (next.perp_dot(into), into.perp_dot(previous));
        if next.perp_dot(previous) >= 0.0 { from_next.min(to_previous) } else { from_next.max(to_previous) }
    }

    /// The pieces: quadrilaterals that bulge everywhere, and triangles. No new edge joins two corners that `share` a line.
    pub(crate) fn pieces(self, share: impl Fn(u32, u32) -> bool) -> Vec<Vec<u32>> {
        let mut pieces = Vec::new();
        for polygon in &self.polygons {
            self.triangulate(polygon, &share, &mut pieces);
        }
        pieces
    }

    fn triangulate(&self, polygon: &[u32], share: &impl Fn(u32, u32) -> bool, pieces: &mut Vec<Vec<u32>>) {
        let mut rest = polygon.to_vec();
        let ear = |rest: &[u32], k: usize| {
            let n = rest.len();
            [rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]]
        };
        let round = |[p, q, r]: [u32; 3]| roundness(self.place(p), self.place(q), self.place(r));
        if rest.len() == 4 && (0..4).all(|k| round(ear(&rest, k)) > STRAIGHT) {
            pieces.push(rest);
            return;
        }
        while rest.len() > 3 {
            // The best ear of those that are possible; of those that are not, where there is no other.
            let rank = |k: usize| {
                let [p, q, r] = ear(&rest, k);
                let roundness = round([p, q, r]);
                let holds = |c: &u32| {
                    let x = self.place(*c);
                    ![p, q, r].contains(c)
                        && [[p, q], [q, r], [r, p]].iter().all(|[from, to]| {
                            (self.place(*to) - self.place(*from)).perp_dot(x - self.place(*from)) > 0.0
                        })
                };
                let is_free = roundness > 0.0 && !rest.iter().any(holds);
                (!share(p, r), is_free, roundness)
            };
            let ranks: Vec<(bool, bool, f64)> = (0..rest.len()).map(rank).collect();
            let compared = |x: &usize, y: &usize| {
                let (a, b) = (ranks[*x], ranks[*y]);
                (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)).then(y.cmp(x))
            };
            let best = (0..rest.len()).max_by(compared).expect("a polygon has corners");
            pieces.push(ear(&rest, best).to_vec());
            rest.remove(best);
        }
        pieces.push(rest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directed edges that have no opposite.
    fn open_edges(pieces: &[Vec<u32>]) -> Vec<[u32; 2]> {
        let edges: Vec<[u32; 2]> =
            pieces.iter().flat_map(|p| (0..p.len()).map(|k| [p[k], p[(k + 1) % p.len()]])).collect();
        let mut open: Vec<[u32; 2]> = edges.iter().filter(|[a, b]| !edges.contains(&[*b, *a])).copied().collect();
        open.sort_unstable();
        open
    }

    /// ```text
    /// 3---6---2
    /// |   |   |
    /// 7---8---5
    /// |   |   |
    /// 0---4---1
    /// ```
    fn square() -> Vec<DVec2> {
        [[0, 0], [2, 0], [2, 2], [0, 2], [1, 0], [2, 1], [1, 2], [0, 1], [1, 1]]
            .map(|[x, y]| DVec2::new(f64::from(x), f64::from(y)))
            .into()
    }

    const ROUND: [u32; 8] = [0, 4, 1, 5, 2, 6, 3, 7];

    #[test]
    fn two_ways_that_cross_make_four_squares() {
        let places = square();
        let mut cut = Cut::new(&places, ROUND.to_vec());
        cut.along(&[4, 8, 6]);
        cut.along(&[7, 8, 5]);
        let pieces = cut.pieces(|_, _| false);
        assert_eq!(pieces.len(), 4);
        assert!(pieces.iter().all(|p| p.len() == 4 && p.contains(&8)));
        let mut border: Vec<[u32; 2]> = (0..8).map(|k| [ROUND[k], ROUND[(k + 1) % 8]]).collect();
        border.sort_unstable();
        assert_eq!(open_edges(&pieces), border);
    }

    #[test]
    fn a_way_along_an_edge_cuts_nothing() {
        let places = square();
        let mut cut = Cut::new(&places, ROUND.to_vec());
        cut.along(&[4, 1]);
        assert_eq!(cut.polygons.len(), 1);
        cut.along(&[4, 8, 6]);
        cut.along(&[4, 8, 6]);
        assert_eq!(cut.polygons.len(), 2);
    }

    #[test]
    fn corners_on_one_line_are_not_joined() {
        let places = square();
        let sides = |k: u32| [[0, 3], [0, 1], [1, 2], [2, 3], [0, 0], [1, 1], [2, 2], [3, 3]][k as usize];
        let cut = Cut::new(&places, ROUND.to_vec());
        let pieces = cut.pieces(|a, b| sides(a).iter().any(|s| sides(b).contains(s)));
        assert_eq!(pieces.len(), 6);
        for piece in &pieces {
            let [p, q, r] = [piece[0], piece[1], piece[2]].map(|k| places[k as usize]);
            assert!((q - p).perp_dot(r - p) > 0.0, "{piece:?}");
        }
    }
}
