//! A grid on a surface, unrolled into the plane: where flattening begins.
//!
//! An isometry keeps geodesic curvature, `k = x'' · (N × x') / |x'|³` of a curve x with any parameter. So the row in the middle of the
//! grid is drawn in the plane as the curve whose angle θ has `θ' = k |x'|`, and from each of its points a column, at the angle that it
//! has with the row on the surface. On a developable surface that is the development, up to the error of the sums, which is of
//! fourth order in the grid's steps. On others the columns are as long as they are on the surface, and the rows away from the
//! middle are not.
//!
//! M. P. do Carmo, *Differential Geometry of Curves and Surfaces*, 1976, section 4-4.

use glam::{DVec2, DVec3};

use crate::surface::Jet;

/// Which lines of the grid are drawn from the one in the middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ribs {
    /// Those along t, from the middle line along s.
    AlongT,
    /// Those along s, from the middle line along t.
    AlongS,
}

/// Speed, its derivative and θ' of a line of the grid at one point.
#[derive(Clone, Copy)]
struct Motion {
    speed: f64,
    growth: f64,
    turn: f64,
}

impl Motion {
    /// 0 turns where there is no tangent plane.
    fn of(first: DVec3, second: DVec3, normal: Option<DVec3>) -> Self {
        let speed = first.length();
        if speed == 0.0 {
            return Self { speed, growth: 0.0, turn: 0.0 };
        }
        let turn = normal.map_or(0.0, |n| second.dot(n.cross(first)) / (speed * speed));
        Self { speed, growth: first.dot(second) / speed, turn }
    }
}

/// The grid of `cells`, with the `jets` of its points, in the plane: (i, j) at `i · (cells[1] + 1) + j`.
pub(crate) fn unrolled(jets: &[Jet], cells: [usize; 2], ribs: Ribs) -> Vec<DVec2> {
    let columns = cells[1] + 1;
    let at = |i: usize, j: usize| &jets[i * columns + j];
    let along_s = |i: usize, j: usize| Motion::of(at(i, j).s, at(i, j).ss, at(i, j).normal());
    let along_t = |i: usize, j: usize| Motion::of(at(i, j).t, at(i, j).tt, at(i, j).normal());
    // From the direction of s to that of t.
    let between = |i: usize, j: usize| {
        let Jet { s, t, .. } = at(i, j);
        libm::atan2(s.cross(*t).length(), s.dot(*t))
    };
    let mut flat = vec![DVec2::ZERO; jets.len()];
    match ribs {
        Ribs::AlongT => {
            let middle = cells[1] / 2;
            let spine: Vec<Motion> = (0..=cells[0]).map(|i| along_s(i, middle)).collect();
            for (i, (start, angle)) in line(&spine, 0, DVec2::ZERO, 0.0).into_iter().enumerate() {
                let rib: Vec<Motion> = (0..=cells[1]).map(|j| along_t(i, j)).collect();
                let places = line(&rib, middle, start, angle + between(i, middle));
                places.into_iter().enumerate().for_each(|(j, (place, _))| flat[i * columns + j] = place);
            }
        }
        Ribs::AlongS => {
            let middle = cells[0] / 2;
            let spine: Vec<Motion> = (0..=cells[1]).map(|j| along_t(middle, j)).collect();
            for (j, (start, angle)) in line(&spine, 0, DVec2::ZERO, 0.0).into_iter().enumerate() {
                let rib: Vec<Motion> = (0..=cells[0]).map(|i| along_s(i, j)).collect();
                let places = line(&rib, middle, start, angle - between(middle, j));
                places.into_iter().enumerate().for_each(|(i, (place, _))| flat[i * columns + j] = place);
            }
        }
    }
    flat
}

/// Places and angles of a line with the given motions at equidistant parameters in [0, 1], of which the one with index `at` stands at `start` with the
/// direction `angle`.
fn line(motions: &[Motion], at: usize, start: DVec2, angle: f64) -> Vec<(DVec2, f64)> {
    let step = 1.0 / (motions.len() - 1) as f64;
    let turns: Vec<f64> = motions.iter().map(|m| m.turn).collect();
    let mut angles = vec![0.0];
    (1..motions.len()).for_each(|k| angles.push(angles[k - 1] + step * mean(&turns, k - 1)));
    let shift = angle - angles[at];
    angles.iter_mut().for_each(|a| *a += shift);
    let directions: Vec<DVec2> = angles.iter().map(|a| DVec2::new(libm::cos(*a), libm::sin(*a))).collect();
    let mut places = vec![DVec2::ZERO];
    for k in 1..motions.len() {
        let [first, last] = [k - 1, k].map(|k| {
            let Motion { speed, growth, turn } = motions[k];
            (speed * directions[k], growth * directions[k] + speed * turn * directions[k].perp())
        });
        // Euler and Maclaurin, with derivatives at both ends.
        let moved = step * 0.5 * (first.0 + last.0) + step * step / 12.0 * (first.1 - last.1);
        places.push(places[k - 1] + moved);
    }
    let shift = start - places[at];
    places.into_iter().zip(angles).map(|(place, angle)| (place + shift, angle)).collect()
}

/// The mean from sample k to the next, by a cubic through the four samples next to it, or the parabola or line through all where there are
/// fewer.
fn mean(f: &[f64], k: usize) -> f64 {
    let n = f.len();
    match n {
        2 => 0.5 * (f[0] + f[1]),
        3 if k == 0 => (5.0 * f[0] + 8.0 * f[1] - f[2]) / 12.0,
        3 => (5.0 * f[2] + 8.0 * f[1] - f[0]) / 12.0,
        _ if k == 0 => (9.0 * f[0] + 19.0 * f[1] - 5.0 * f[2] + f[3]) / 24.0,
        _ if k + 2 == n => (9.0 * f[n - 1] + 19.0 * f[n - 2] - 5.0 * f[n - 3] + f[n - 4]) / 24.0,
        _ => (13.0 * (f[k] + f[k + 1]) - f[k - 1] - f[k + 2]) / 24.0,
    }
}
