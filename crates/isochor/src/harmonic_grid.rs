//! A grid of cubic cells over a cage: which nodes are inside, and where lines along axes cross the cage.
//!
//! Whether a segment along an axis crosses a triangle is decided by exact signs (the crate `robust`), and no point is on a triangle, an edge
//! or a corner: each counts as moved by (ε, ε², ε³) with an infinitely small ε > 0 (H. Edelsbrunner, E. P. Mücke, *Simulation of
//! simplicity*, 1990; here only points move). So from a point inside each way along axes ends at another one inside or meets the cage, whatever
//! lies on what; only places of crossings are rounded.
//!
//! *Between nodes* a value is a mean of ends of arms, as Shortley and Weller's discretisation of Laplace's equation has it: from a point six arms
//! go along the axes, to the cage or to a face of the cell; there four to the cage or an edge; there two to the cage or a node. With
//! lengths a and b of the arms along an axis, their ends count as `b : a` and the axis as `1 / (a b)`. That is linear between nodes of an edge,
//! trilinear in cells that the cage does not touch, exact for linear functions everywhere, and never takes what is behind the cage;
//! weights are positive, and near the cage its own values prevail. It jumps where an arm begins to pass a reflex edge of the cage.

use glam::DVec3;
use robust::{Coord, Coord3D, orient2d, orient3d};

use crate::cage::Cage;
use crate::closest::closest_on_triangle;
use crate::{parallel, tolerances};

/// Cells list triangles that are nearer to them than this, in cells. More: triangles that they do not touch; less: rounding hides some, and
/// [`tolerances::INSIDE`] reaches beyond.
const MARGIN: f64 = 1e-3;

/// Arms are at least this long, in cells. More: points next to the cage take less than its values; less: places of crossings are rounded to that,
/// and some arms have no length at all.
pub(crate) const LEAST_ARM: f64 = 1e-12;

/// A grid, and the cage in it.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    /// Of its nodes, along x, y and z; ascending.
    planes: [Vec<f64>; 3],
    /// Edge length of a cell.
    step: f64,
    /// Points that are nearer to the cage are on it.
    tolerance: f64,
    triangles: Vec<Triangle>,
    /// For each cell where its triangles begin in `listed`, and the end.
    starts: Vec<u32>,
    listed: Vec<u32>,
    /// How often the cage winds round each node.
    windings: Vec<i32>,
}

/// A cell, or the node at its lower corner.
pub(crate) type Place = [usize; 3];

/// Where a segment meets the cage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    pub(crate) triangle: u32,
    /// Barycentric coordinates in it.
    pub(crate) weights: [f64; 3],
    /// Coordinate along the segment's axis.
    pub(crate) at: f64,
    /// Whether the segment leaves the cage there.
    is_leaving: bool,
}

/// What the value at a point is made of. The weights of all have the sum 1.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mixture {
    /// Weights of the corners of the cell: bit `axis` of the index is set for the upper ones.
    pub(crate) corners: [f64; 8],
    /// Places on the cage with their weights.
    pub(crate) hits: Vec<(Hit, f64)>,
}

/// Where a way along an axis ends.
pub(crate) enum End {
    /// On the cage.
    Cage(Hit),
    /// Inside, in a cell.
    Inside(Place, DVec3),
}

/// A triangle of the cage.
#[derive(Clone, Debug)]
struct Triangle {
    corners: [DVec3; 3],
    low: DVec3,
    high: DVec3,
    /// Whether what is moved by (ε, ε², ε³) from its plane is on the side of its normal.
    is_moved_above: bool,
}

impl Triangle {
    fn new(corners: [DVec3; 3]) -> Self {
        let [a, b, c] = corners;
        let normal = [0, 1, 2].map(|axis| orient2d(seen(a, axis), seen(b, axis), seen(c, axis)));
        let is_moved_above = normal.into_iter().find(|n| *n != 0.0).is_some_and(|n| n > 0.0);
        Self { corners, low: a.min(b).min(c), high: a.max(b).max(c), is_moved_above }
    }

    /// Whether `p` is on the side of the normal.
    fn is_below(&self, p: DVec3) -> bool {
        let [a, b, c] = self.corners.map(|p| Coord3D { x: p.x, y: p.y, z: p.z });
        let below = orient3d(a, b, c, Coord3D { x: p.x, y: p.y, z: p.z });
        if below == 0.0 { !self.is_moved_above } else { below > 0.0 }
    }

    /// Barycentric coordinates of where the line through `p` along `axis` meets it.
    fn pierced(&self, p: DVec3, axis: usize) -> Option<[f64; 3]> {
        let [a, b, c] = self.corners;
        let turns = [turn(b, c, p, axis), turn(c, a, p, axis), turn(a, b, p, axis)];
        if !(turns.iter().all(|t| t.sign > 0.0) || turns.iter().all(|t| t.sign < 0.0)) {
            return None;
        }
        let sum: f64 = turns.iter().map(|t| t.area).sum();
        Some(turns.map(|t| t.area / sum))
    }

    /// Where the segment from `from` along `axis` to the coordinate `to` meets it.
    fn hit(&self, triangle: u32, from: DVec3, axis: usize, to: f64) -> Option<Hit> {
        let mut end = from;
        end[axis] = to;
        if from.max(end).cmplt(self.low).any() || from.min(end).cmpgt(self.high).any() {
            return None;
        }
        let weights = self.pierced(from, axis)?;
        let is_leaving = self.is_below(from);
        if is_leaving != self.is_below(end) {
            let at: f64 = weights.iter().zip(self.corners).map(|(w, c)| w * c[axis]).sum();
            return Some(Hit { triangle, weights, at: at.clamp(from[axis].min(to), from[axis].max(to)), is_leaving });
        }
        None
    }
}

/// A point seen against an axis.
fn seen(p: DVec3, axis: usize) -> Coord<f64> {
    Coord { x: p[(axis + 1) % 3], y: p[(axis + 2) % 3] }
}

/// How a point lies beside a directed line.
struct Turn {
    /// Twice the area of the triangle of both.
    area: f64,
    /// Of the sign of the area that there is once the point has moved by (ε, ε², ε³); 0 for no line.
    sign: f64,
}

/// How `p` lies beside the line from a to b, seen against an axis.
fn turn(a: DVec3, b: DVec3, p: DVec3, axis: usize) -> Turn {
    let [a, b, p] = [a, b, p].map(|q| seen(q, axis));
    let area = orient2d(a, b, p);
    let (along, up) = (b.x - a.x, b.y - a.y);
    // Moved by (δ, δ') p gains the area `along δ' − up δ`. Seen against y, where x is the second coordinate, δ' is the larger one.
    let [first, second] = if axis == 1 { [along, -up] } else { [-up, along] };
    let sign = [area, first, second].into_iter().find(|s| *s != 0.0).unwrap_or(0.0);
    Turn { area, sign }
}

impl Grid {
    /// Over a cage, with so many cells along its longest side. `None` where coordinates are too coarse for cells so small.
    pub(crate) fn new(cage: &Cage, resolution: usize) -> Option<Self> {
        let triangles: Vec<Triangle> = (0..cage.triangles().len()).map(|t| Triangle::new(cage.corners(t))).collect();
        let low = triangles.iter().fold(DVec3::INFINITY, |low, t| low.min(t.low));
        let high = triangles.iter().fold(DVec3::NEG_INFINITY, |high, t| high.max(t.high));
        let (middle, size) = (low + (high - low) / 2.0, high - low);
        let step = size.max_element() / resolution as f64;
        let planes = [0, 1, 2].map(|axis| {
            // At least a quarter of a cell remains on both sides, and half a cell where faces are whole numbers of cells apart.
            let cells = (size[axis] / step).round() as usize + 1;
            (0..=cells).map(|i| middle[axis] + (i as f64 - cells as f64 / 2.0) * step).collect::<Vec<f64>>()
        });
        let is_resolved = |planes: &Vec<f64>| planes.windows(2).all(|pair| pair[1] - pair[0] > step / 2.0);
        if !planes.iter().all(is_resolved) {
            return None;
        }
        let tolerance = tolerances::INSIDE * cage.extent();
        let mut grid =
            Self { planes, step, tolerance, triangles, starts: Vec::new(), listed: Vec::new(), windings: Vec::new() };
        grid.list_triangles();
        grid.wind();
        Some(grid)
    }

    /// Edge length of a cell.
    pub(crate) fn step(&self) -> f64 {
        self.step
    }

    /// Cells along the axes.
    fn cells(&self) -> Place {
        [0, 1, 2].map(|axis| self.planes[axis].len() - 1)
    }

    /// Number of nodes.
    pub(crate) fn node_count(&self) -> usize {
        self.planes.iter().map(Vec::len).product()
    }

    /// The index of a node.
    pub(crate) fn index(&self, [i, j, k]: Place) -> usize {
        (i * self.planes[1].len() + j) * self.planes[2].len() + k
    }

    /// The node with an index.
    pub(crate) fn node(&self, index: usize) -> Place {
        let [_, v, w] = [0, 1, 2].map(|axis| self.planes[axis].len());
        [index / (v * w), index / w % v, index % w]
    }

    /// Where a node is.
    pub(crate) fn position(&self, node: Place) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|axis| self.planes[axis][node[axis]]))
    }

    /// Whether the cage winds round a node.
    pub(crate) fn is_inside(&self, index: usize) -> bool {
        self.windings[index] >= 1
    }

    /// The cell in which a point is.
    pub(crate) fn cell(&self, p: DVec3) -> Option<Place> {
        let cells = self.cells();
        let along = |axis: usize| {
            let after = self.planes[axis].partition_point(|plane| *plane <= p[axis]);
            after.checked_sub(1).filter(|i| *i < cells[axis])
        };
        Some([along(0)?, along(1)?, along(2)?])
    }

    /// Finds out which triangles cells touch.
    fn list_triangles(&mut self) {
        let (cells, half) = (self.cells(), DVec3::splat((0.5 + MARGIN) * self.step));
        let origin = self.position([0; 3]);
        let touched = parallel::map(self.triangles.len(), |t| {
            let Triangle { corners: [a, b, c], low, high, .. } = self.triangles[t];
            let normal = (b - a).cross(c - a).normalize_or_zero();
            let index = |p: f64, axis: usize| (p / self.step).max(0.0).min((cells[axis] - 1) as f64) as usize;
            let [us, vs, ws] = [0, 1, 2].map(|axis| {
                let margin = MARGIN * self.step;
                index(low[axis] - origin[axis] - margin, axis)..=index(high[axis] - origin[axis] + margin, axis)
            });
            let mut touched = Vec::new();
            for u in us {
                for v in vs.clone() {
                    for w in ws.clone() {
                        let middle = self.position([u, v, w]) + self.step / 2.0;
                        if normal.dot(middle - a).abs() <= normal.abs().dot(half) {
                            touched.push(((u * cells[1] + v) * cells[2] + w) as u32);
                        }
                    }
                }
            }
            touched
        });
        let mut starts = vec![0_u32; cells.iter().product::<usize>() + 1];
        touched.iter().flatten().for_each(|cell| starts[*cell as usize + 1] += 1);
        (1..starts.len()).for_each(|cell| starts[cell] += starts[cell - 1]);
        let mut next = starts.clone();
        let mut listed = vec![0; starts[starts.len() - 1] as usize];
        for (t, cells) in touched.iter().enumerate() {
            for cell in cells {
                listed[next[*cell as usize] as usize] = t as u32;
                next[*cell as usize] += 1;
            }
        }
        (self.starts, self.listed) = (starts, listed);
    }

    /// Finds out how often the cage winds round nodes: from none outside along lines.
    fn wind(&mut self) {
        let lines = self.planes[0].len() * self.planes[1].len();
        let cells = self.cells();
        let windings = parallel::map(lines, |line| {
            let [i, j] = [line / self.planes[1].len(), line % self.planes[1].len()];
            let mut winding = 0;
            let mut along = vec![0];
            for k in 0..cells[2] {
                let cell = [i.min(cells[0] - 1), j.min(cells[1] - 1), k];
                winding += self.gained(cell, self.position([i, j, k]), 2, self.planes[2][k + 1]);
                along.push(winding);
            }
            along
        });
        self.windings = windings.concat();
    }

    /// The triangles that a cell touches.
    fn listed(&self, [u, v, w]: Place) -> &[u32] {
        let cells = self.cells();
        let cell = (u * cells[1] + v) * cells[2] + w;
        &self.listed[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }

    fn hits(&self, cell: Place, from: DVec3, axis: usize, to: f64) -> impl Iterator<Item = Hit> {
        self.listed(cell).iter().filter_map(move |t| self.triangles[*t as usize].hit(*t, from, axis, to))
    }

    /// By how much the winding number grows along a segment in a cell.
    fn gained(&self, cell: Place, from: DVec3, axis: usize, to: f64) -> i32 {
        self.hits(cell, from, axis, to).map(|hit| if hit.is_leaving { -1 } else { 1 }).sum()
    }

    /// Where the segment in a cell, from `from` along `axis` to the coordinate `to`, meets the cage first.
    pub(crate) fn first_hit(&self, cell: Place, from: DVec3, axis: usize, to: f64) -> Option<Hit> {
        let way = |hit: &Hit| (hit.at - from[axis]).abs();
        self.hits(cell, from, axis, to).min_by(|a, b| way(a).total_cmp(&way(b)))
    }

    /// Where the cage cuts the arm from a node inside to the next one along an axis, and the length that remains, in cells.
    pub(crate) fn cut_arm(&self, node: Place, axis: usize, is_up: bool) -> Option<(Hit, f64)> {
        let (mut cell, mut next) = (node, node);
        if is_up {
            next[axis] += 1;
        } else {
            next[axis] -= 1;
            cell[axis] -= 1;
        }
        let from = self.position(node);
        let hit = self.first_hit(cell, from, axis, self.planes[axis][next[axis]])?;
        Some((hit, ((hit.at - from[axis]).abs() / self.step).max(LEAST_ARM)))
    }

    /// How often the cage winds round a point in a cell.
    pub(crate) fn winding(&self, cell: Place, p: DVec3) -> i32 {
        let (mut at, mut gained) = (p, 0);
        for axis in 0..3 {
            let plane = self.planes[axis][cell[axis]];
            gained += self.gained(cell, at, axis, plane);
            at[axis] = plane;
        }
        self.windings[self.index(cell)] - gained
    }

    /// The point of the cage that is at a point in a cell, up to [`tolerances::INSIDE`] of its extent: triangle, barycentric coordinates.
    pub(crate) fn touched(&self, cell: Place, p: DVec3) -> Option<(u32, [f64; 3])> {
        let near = self.listed(cell).iter().filter_map(|t| {
            let Triangle { corners, low, high, .. } = self.triangles[*t as usize];
            if (p + self.tolerance).cmplt(low).any() || (p - self.tolerance).cmpgt(high).any() {
                return None;
            }
            let weights = closest_on_triangle(p, corners);
            let at: DVec3 = weights.iter().zip(corners).map(|(w, c)| *w * c).sum();
            let distance = at.distance(p);
            (distance <= self.tolerance).then_some((*t, weights, distance))
        });
        near.min_by(|a, b| a.2.total_cmp(&b.2)).map(|(t, weights, _)| (t, weights))
    }

    /// The way from a point inside, in a cell, along `axis` over the length `by`, which may be negative, or to the cage; and its length.
    pub(crate) fn walk(&self, mut cell: Place, from: DVec3, axis: usize, by: f64) -> (End, f64) {
        let (to, is_up) = (from[axis] + by, by > 0.0);
        let mut at = from;
        loop {
            let plane = self.planes[axis][cell[axis] + usize::from(is_up)];
            let is_last = if is_up { to <= plane } else { to >= plane };
            let end = if is_last { to } else { plane };
            if let Some(hit) = self.first_hit(cell, at, axis, end) {
                return (End::Cage(hit), (hit.at - from[axis]).abs().max(LEAST_ARM * self.step));
            }
            at[axis] = end;
            if is_last {
                return (End::Inside(cell, at), by.abs());
            }
            // The cage closes before the grid ends.
            cell[axis] = if is_up { cell[axis] + 1 } else { cell[axis] - 1 };
        }
    }

    /// What the value at a point inside is made of, which is in a cell.
    pub(crate) fn mixture(&self, cell: Place, p: DVec3) -> Mixture {
        let mut mixture = Mixture::default();
        if self.listed(cell).is_empty() {
            let [x, y, z] = [0, 1, 2].map(|axis| {
                let [low, high] = [0, 1].map(|far| self.planes[axis][cell[axis] + far]);
                let upper = (p[axis] - low) / (high - low);
                [1.0 - upper, upper]
            });
            mixture.corners = std::array::from_fn(|corner| x[corner & 1] * y[corner >> 1 & 1] * z[corner >> 2]);
        } else {
            self.mix(cell, p, [None; 3], 1.0, &mut mixture);
        }
        mixture
    }

    /// Adds what the value at a point is made of, times `weight`; `sides` tells on which side of the cell it is.
    fn mix(&self, cell: Place, p: DVec3, sides: [Option<usize>; 3], weight: f64, mixture: &mut Mixture) {
        let [Some(x), Some(y), Some(z)] = sides else {
            let ends = |axis: usize| {
                [0, 1].map(|far| {
                    let plane = self.planes[axis][cell[axis] + far];
                    let hit = self.first_hit(cell, p, axis, plane);
                    let to = hit.map_or(plane, |hit| hit.at);
                    (hit, plane, ((to - p[axis]).abs() / self.step).max(LEAST_ARM))
                })
            };
            let arms = [0, 1, 2].map(|axis| sides[axis].is_none().then(|| ends(axis)));
            let nearness = |[a, b]: &[(_, _, f64); 2]| 1.0 / (a.2 * b.2);
            let sum: f64 = arms.iter().flatten().map(nearness).sum();
            for (axis, ends) in arms.iter().enumerate() {
                let Some(ends) = ends else { continue };
                let whole = weight * nearness(ends) / sum / (ends[0].2 + ends[1].2);
                for (far, (hit, plane, _)) in ends.iter().enumerate() {
                    let part = whole * ends[1 - far].2;
                    if let Some(hit) = hit {
                        mixture.hits.push((*hit, part));
                        continue;
                    }
                    let (mut end, mut sides) = (p, sides);
                    end[axis] = *plane;
                    sides[axis] = Some(far);
                    self.mix(cell, end, sides, part, mixture);
                }
            }
            return;
        };
        mixture.corners[x + 2 * y + 4 * z] += weight;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Faces, Mesh};

    /// Vertices where the axes end; in a grid of 3 cells they, its edges and the middle of it are on lines and nodes.
    fn octahedron() -> Cage {
        let corners = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
        let mut faces = Faces::new();
        for [x, y, z] in (0..8_u32).map(|k| [k & 1, 2 + (k >> 1 & 1), 4 + (k >> 2)]) {
            let is_even = (x + y + z) % 2 == 0;
            faces.push(&if is_even { [x, y, z] } else { [x, z, y] });
        }
        Cage::new(Mesh::new(corners.to_vec(), faces).unwrap()).unwrap()
    }

    #[test]
    fn lines_through_edges_and_corners_cross_once() {
        let grid = Grid::new(&octahedron(), 3).unwrap();
        assert!(grid.planes.iter().all(|planes| planes.contains(&0.0)));
        for index in 0..grid.node_count() {
            let node = grid.node(index);
            let norm: f64 = grid.position(node).abs().to_array().iter().sum();
            assert_eq!(grid.windings[index], i32::from(norm < 1.0), "{node:?}");
            // The way to a neighbour crosses the cage where one of both is inside, along each axis.
            for axis in 0..3 {
                if node[axis] + 1 < grid.planes[axis].len() {
                    let mut next = node;
                    next[axis] += 1;
                    let cell = [0, 1, 2].map(|a| node[a].min(grid.cells()[a] - 1));
                    let to = grid.planes[axis][next[axis]];
                    let gained = grid.gained(cell, grid.position(node), axis, to);
                    assert_eq!(gained, grid.windings[grid.index(next)] - grid.windings[index]);
                }
            }
        }
    }

    #[test]
    fn points_on_planes_and_lines_are_inside_as_others_are() {
        let grid = Grid::new(&octahedron(), 3).unwrap();
        for k in 0..729 {
            let p = DVec3::new((k % 9) as f64, (k / 9 % 9) as f64, (k / 81) as f64) / 6.0 - 2.0 / 3.0;
            let norm = p.abs().to_array().iter().sum::<f64>();
            let cell = grid.cell(p).unwrap();
            if (norm - 1.0).abs() > 1e-9 {
                assert_eq!(grid.winding(cell, p), i32::from(norm < 1.0), "{p}");
                assert!(grid.touched(cell, p).is_none());
            } else {
                assert!(grid.touched(cell, p).is_some());
                continue;
            }
            if norm > 1.0 {
                continue;
            }
            let mixture = grid.mixture(cell, p);
            let mut at = DVec3::ZERO;
            for (corner, weight) in mixture.corners.iter().enumerate() {
                let node = [cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1), cell[2] + (corner >> 2)];
                assert!(*weight == 0.0 || grid.is_inside(grid.index(node)));
                at += *weight * grid.position(node);
            }
            for (hit, weight) in &mixture.hits {
                let corners = grid.triangles[hit.triangle as usize].corners;
                at += *weight * hit.weights.iter().zip(corners).map(|(w, c)| *w * c).sum::<DVec3>();
            }
            assert!(at.distance(p) < 1e-11, "{p} {at}");
        }
    }
}
