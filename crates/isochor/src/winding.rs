//! How often a cage winds round points: the sum of the solid angles under which they see its triangles, over 4 π (as in [`crate::shells`], of
//! many points in few triangles).

use std::f64::consts::PI;

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f64x4};
use glam::DVec3;

use crate::cage::Cage;
use crate::elementary;
use crate::mean_value::{cross, dot, places, towards};
use crate::parallel;

/// Points that are taken at a time.
const LANES: usize = 4;

/// The winding number of each point: whole away from the cage, 1 inside most, 0 outside. On the cage it is something between.
pub(crate) fn winding_numbers(cage: &Cage, points: &[DVec3]) -> Vec<f64> {
    /// Points per chunk: enough to pay for what is set up for each.
    const CHUNK: usize = 256;
    let mut numbers = vec![0.0; points.len()];
    parallel::for_each_chunk(&mut numbers, CHUNK, |first, numbers| {
        let points = &points[first..first + numbers.len()];
        dispatch!(Level::new(), simd => fill(simd, cage, points, numbers));
    });
    numbers
}

#[inline(always)]
fn fill<S: Simd>(simd: S, cage: &Cage, points: &[DVec3], numbers: &mut [f64]) {
    let zero = f64x4::splat(simd, 0.0);
    let mut corners = vec![([zero; 3], zero); cage.vertices().len()];
    for (points, numbers) in points.chunks(LANES).zip(numbers.chunks_mut(LANES)) {
        let place = places(simd, points);
        for (corner, v) in corners.iter_mut().zip(cage.vertices()) {
            let to = towards(simd, *v, place);
            *corner = (to, dot(to, to).sqrt());
        }
        let mut sum = zero;
        for [i, j, k] in cage.triangles() {
            let [(a, la), (b, lb), (c, lc)] = [corners[*i as usize], corners[*j as usize], corners[*k as usize]];
            let denominator = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
            sum += elementary::atan2(simd, dot(a, cross(b, c)), denominator); // half of the angle
        }
        let sums: [f64; LANES] = sum.into();
        numbers.iter_mut().zip(sums).for_each(|(number, sum)| *number = sum / (2.0 * PI));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    #[test]
    fn a_sphere_winds_once_round_what_is_inside() {
        let cage = Cage::new(shapes::icosphere(1)).unwrap();
        let points: Vec<DVec3> = (0..31).map(|i| DVec3::new(0.1 * f64::from(i), 0.05, -0.03)).collect();
        for (p, number) in points.iter().zip(winding_numbers(&cage, &points)) {
            let expected = if cage.contains(*p) { 1.0 } else { 0.0 };
            assert!((number - expected).abs() <= 1e-14, "{p}: {number}");
        }
    }
}
