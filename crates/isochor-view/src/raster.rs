//! Which triangle is seen where: a depth buffer over samples, several to a pixel.
//!
//! Corners are snapped to a grid of 1/256 sample; from there on, whether a sample is covered is decided in whole
//! numbers, so that triangles with a common edge cover each sample between them exactly once (the top-left rule), and
//! no platform decides otherwise. Depth is 1/w, the inverse distance along the line of sight: it is linear on the
//! screen. Of equal depths the first triangle stays.
//!
//! The picture is cut into bands of rows. Triangles are sorted into bands chunk by chunk, and each band is drawn by one
//! thread with the chunks in order: the same bits for any number of threads.

use std::ops::Range;

use glam::DVec3;

use crate::{camera::Camera, parallel};

/// Samples along each side of a pixel. Larger: smoother edges; smaller: time, which is proportional to its square.
pub(crate) const SAMPLES: usize = 3;

/// Rows of pixels in a band. Larger: triangles are sorted into fewer bands; smaller: better balance between threads.
pub(crate) const BAND: usize = 32;

/// Positions on the screen are multiples of 1/GRID samples. Larger: edges are straighter; smaller: products need fewer
/// bits.
const GRID: f64 = 256.0;

/// Coordinates on the screen beyond this many samples are cut off. Larger: products would not fit into 64 bits;
/// smaller: it would cut what is seen.
const GUARD: f64 = (1 << 20) as f64;

/// What is nearer to the eye than this is cut off, in the camera's units. Larger: what is close is missing; smaller:
/// places on the screen have no precision.
const NEAR: f64 = 1e-4;

/// Triangles that are sorted at once. Larger: less overhead; smaller: better balance between threads.
const CHUNK: usize = 16_384;

/// No triangle.
pub(crate) const NOTHING: u32 = u32::MAX;

/// From places seen by a camera to samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Screen {
    /// Size of the panel in pixels.
    pub(crate) size: [usize; 2],
    /// Its middle, in samples from the left and the top.
    middle: [f64; 2],
    /// Samples per unit of x/w.
    scale: f64,
}

/// A place on the screen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    /// From the left and from the top, in samples.
    pub(crate) place: [f64; 2],
    /// 1/w.
    pub(crate) inverse: f64,
}

/// A corner, snapped.
#[derive(Clone, Copy, Debug)]
struct Corner {
    x: i32,
    y: i32,
    /// 1/w; negative where the triangle must be cut, not a number where the corner has no place.
    inverse: f32,
}

impl Screen {
    pub(crate) fn new(camera: &Camera, size: [usize; 2]) -> Self {
        let samples = size.map(|side| (side * SAMPLES) as f64);
        Self {
            size,
            middle: samples.map(|side| side / 2.0),
            scale: samples[0].min(samples[1]) / 2.0 / camera.tangent(),
        }
    }

    /// Samples in a row.
    pub(crate) fn row(&self) -> usize {
        self.size[0] * SAMPLES
    }

    /// Number of bands.
    pub(crate) fn bands(&self) -> usize {
        self.size[1].div_ceil(BAND)
    }

    /// Rows of samples of a band.
    pub(crate) fn rows(&self, band: usize) -> Range<usize> {
        band * BAND * SAMPLES..((band + 1) * BAND).min(self.size[1]) * SAMPLES
    }

    /// The line of sight through a place, in samples from the left and the top, with z = −1.
    pub(crate) fn sight(&self, [x, y]: [f64; 2]) -> DVec3 {
        DVec3::new((x - self.middle[0]) / self.scale, (self.middle[1] - y) / self.scale, -1.0)
    }

    /// Where a place seen from the eye is on the screen. `None` where it is not before the eye, or too far aside.
    pub(crate) fn spot(&self, seen: DVec3) -> Option<Spot> {
        let inverse = -1.0 / seen.z;
        let place = [self.middle[0] + seen.x * inverse * self.scale, self.middle[1] - seen.y * inverse * self.scale];
        (seen.z <= -NEAR && place.iter().all(|x| x.abs() <= GUARD)).then_some(Spot { place, inverse })
    }

    /// The part of a segment that has a place on the screen.
    pub(crate) fn segment(&self, from: DVec3, to: DVec3) -> Option<[Spot; 2]> {
        let cut = self.cut(vec![from, to], false);
        let spots: Vec<Spot> = cut.iter().filter_map(|p| self.spot(*p)).collect();
        match spots[..] {
            [a, b, ..] => Some([a, b]),
            _ => None,
        }
    }

    /// The part of a polygon (closed) or path that is before the eye and not too far aside (Sutherland, Hodgman).
    fn cut(&self, mut corners: Vec<DVec3>, is_closed: bool) -> Vec<DVec3> {
        // Positive where a place is inside, linear. A little inside of what `spot` asks for, because of rounding.
        let limit = GUARD * (1.0 - 1e-9);
        let reach = |p: &DVec3, axis: usize| [p.x, -p.y][axis] * self.scale;
        let insides: [&dyn Fn(&DVec3) -> f64; 5] = [
            &|p| -p.z - NEAR * (1.0 + 1e-9),
            &|p| reach(p, 0) - (limit + self.middle[0]) * p.z,
            &|p| -reach(p, 0) - (limit - self.middle[0]) * p.z,
            &|p| reach(p, 1) - (limit + self.middle[1]) * p.z,
            &|p| -reach(p, 1) - (limit - self.middle[1]) * p.z,
        ];
        for inside in insides {
            let mut kept = Vec::with_capacity(corners.len() + 1);
            for (i, p) in corners.iter().enumerate() {
                if i > 0 || is_closed {
                    let last = corners[(i + corners.len() - 1) % corners.len()];
                    let (a, b) = (inside(&last), inside(p));
                    if (a >= 0.0) != (b >= 0.0) {
                        kept.push(last + (*p - last) * (a / (a - b)));
                    }
                }
                if inside(p) >= 0.0 {
                    kept.push(*p);
                }
            }
            corners = kept;
        }
        corners
    }

    fn corner(&self, seen: DVec3) -> Corner {
        let snapped = |x: f64| (x * GRID).round() as i32;
        match self.spot(seen) {
            Some(Spot { place, inverse }) => {
                Corner { x: snapped(place[0]), y: snapped(place[1]), inverse: inverse as f32 }
            }
            None if seen.is_finite() => Corner { x: 0, y: 0, inverse: -1.0 },
            None => Corner { x: 0, y: 0, inverse: f32::NAN },
        }
    }
}

/// Triangles, seen from the eye and sorted into the bands of a screen.
pub(crate) struct Raster<'a> {
    pub(crate) screen: Screen,
    pub(crate) triangles: &'a [[u32; 3]],
    /// Vertices seen from the eye.
    pub(crate) seen: &'a [DVec3],
    /// For each chunk of triangles and each band the pieces that may be seen there.
    bins: Vec<Vec<Vec<Piece>>>,
}

/// A triangle, or a part of one that was cut. With its corners, so that they need not be looked up again all over memory.
#[derive(Clone, Copy, Debug)]
struct Piece {
    triangle: u32,
    corners: [Corner; 3],
}

/// What is seen in a band, row after row.
pub(crate) struct Depths {
    /// 1/w of the nearest triangle, 0 where there is none.
    pub(crate) inverse: Vec<f32>,
    /// Its index, or [`NOTHING`].
    pub(crate) triangle: Vec<u32>,
}

impl<'a> Raster<'a> {
    /// Sorts `triangles` over vertices that are `seen` from the eye.
    pub(crate) fn new(screen: Screen, triangles: &'a [[u32; 3]], seen: &'a [DVec3]) -> Self {
        let corners = parallel::collect(seen.len(), |v| screen.corner(seen[v]));
        let mut raster = Self { screen, triangles, seen, bins: Vec::new() };
        raster.bins = parallel::map_chunks(triangles.len(), CHUNK, |range| {
            let mut bins = vec![Vec::new(); screen.bands()];
            for t in range {
                raster.pieces(t, triangles[t].map(|v| corners[v as usize]), |corners| {
                    if let Some((_, [top, bottom])) = raster.covered(&corners) {
                        let piece = Piece { triangle: t as u32, corners };
                        let bands = top / (BAND * SAMPLES)..=bottom / (BAND * SAMPLES);
                        bins[bands].iter_mut().for_each(|bin| bin.push(piece));
                    }
                });
            }
            bins
        });
        raster
    }

    /// Calls `f` with the corners of the parts of a triangle that have a place on the screen: mostly its own `corners`.
    fn pieces(&self, t: usize, corners: [Corner; 3], mut f: impl FnMut([Corner; 3])) {
        if corners.iter().all(|c| c.inverse > 0.0) {
            return f(corners);
        }
        if corners.iter().any(|c| c.inverse.is_nan()) || self.is_behind(t) {
            return;
        }
        let cut = self.screen.cut(self.triangles[t].map(|v| self.seen[v as usize]).to_vec(), true);
        let corners: Vec<Corner> = cut.iter().map(|p| self.screen.corner(*p)).filter(|c| c.inverse > 0.0).collect();
        (2..corners.len()).for_each(|k| f([corners[0], corners[k - 1], corners[k]]));
    }

    fn is_behind(&self, t: usize) -> bool {
        self.triangles[t].iter().all(|&v| self.seen[v as usize].z > -NEAR)
    }

    /// First and last column and row of the samples whose centres are in the box of a triangle and on the screen.
    fn covered(&self, corners: &[Corner; 3]) -> Option<([usize; 2], [usize; 2])> {
        let range = |positions: [i32; 3], side: usize| {
            let (low, high) = (positions.iter().min()?, positions.iter().max()?);
            // Sample i has its centre at 256 i + 128.
            let first = (low + 127).div_euclid(256).max(0);
            let last = (high - 128).div_euclid(256).min((side * SAMPLES) as i32 - 1);
            (first <= last).then_some([first as usize, last as usize])
        };
        let columns = range(corners.map(|c| c.x), self.screen.size[0])?;
        Some((columns, range(corners.map(|c| c.y), self.screen.size[1])?))
    }

    /// What is seen in a band.
    pub(crate) fn depths(&self, band: usize) -> Depths {
        let rows = self.screen.rows(band);
        let samples = rows.len() * self.screen.row();
        let mut depths = Depths { inverse: vec![0.0; samples], triangle: vec![NOTHING; samples] };
        for piece in self.bins.iter().flat_map(|bins| &bins[band]) {
            self.draw(piece, &rows, &mut depths);
        }
        depths
    }

    /// Draws a piece into the rows of a band.
    fn draw(&self, Piece { triangle, corners }: &Piece, rows: &Range<usize>, depths: &mut Depths) {
        let Some((columns, [top, bottom])) = self.covered(corners) else { return };
        let cross = |a: &Corner, b: &Corner, c: &Corner| {
            let [abx, aby] = [i64::from(b.x) - i64::from(a.x), i64::from(b.y) - i64::from(a.y)];
            let [acx, acy] = [i64::from(c.x) - i64::from(a.x), i64::from(c.y) - i64::from(a.y)];
            abx * acy - aby * acx
        };
        let area = cross(&corners[0], &corners[1], &corners[2]);
        if area == 0 {
            return;
        }
        // Clockwise on the screen, whose y points down.
        let [a, b, c] = if area > 0 { *corners } else { [corners[0], corners[2], corners[1]] };
        let start =
            Corner { x: columns[0] as i32 * 256 + 128, y: top.max(rows.start) as i32 * 256 + 128, inverse: 0.0 };
        // Opposite to each corner: the value of the edge's function at the first sample, and its steps to the right and
        // down. Samples on an edge belong to the triangle whose left or upper edge it is.
        let edge = |from: &Corner, to: &Corner| {
            let [dx, dy] = [i64::from(to.x) - i64::from(from.x), i64::from(to.y) - i64::from(from.y)];
            let is_ours = dy < 0 || (dy == 0 && dx > 0);
            (cross(from, to, &start), i64::from(!is_ours), -dy * 256, dx * 256)
        };
        let edges = [edge(&b, &c), edge(&c, &a), edge(&a, &b)];
        let inverse_area = 1.0 / area.abs() as f64;
        let weights = [a, b, c].map(|corner| f64::from(corner.inverse) * inverse_area);
        let step = (0..3).map(|i| edges[i].2 as f64 * weights[i]).sum::<f64>();
        for y in top.max(rows.start)..=bottom.min(rows.end.wrapping_sub(1)) {
            let down = (y - top.max(rows.start)) as i64;
            let mut values = edges.map(|(first, _, _, step)| first + down * step);
            let first_inverse = (0..3).map(|i| values[i] as f64 * weights[i]).sum::<f64>();
            let row = (y - rows.start) * self.screen.row();
            let mut was_inside = false;
            for x in columns[0]..=columns[1] {
                if (0..3).all(|i| values[i] >= edges[i].1) {
                    was_inside = true;
                    let inverse = (first_inverse + (x - columns[0]) as f64 * step) as f32;
                    if inverse > depths.inverse[row + x] {
                        depths.inverse[row + x] = inverse;
                        depths.triangle[row + x] = *triangle;
                    }
                } else if was_inside {
                    break;
                }
                (0..3).for_each(|i| values[i] += edges[i].2);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [100, 80];

    /// An eye at the origin that looks along y, z up.
    fn eye() -> Camera {
        Camera::looking(DVec3::ZERO, DVec3::Y, DVec3::Z)
    }

    /// The triangle that is seen at each sample, row after row.
    fn drawn(points: &[DVec3], triangles: &[[u32; 3]]) -> Vec<u32> {
        let seen: Vec<DVec3> = points.iter().map(|p| eye().seen(*p)).collect();
        let raster = Raster::new(Screen::new(&eye(), SIZE), triangles, &seen);
        (0..raster.screen.bands()).flat_map(|band| raster.depths(band).triangle).collect()
    }

    fn count(seen: &[u32], triangle: u32) -> usize {
        seen.iter().filter(|t| **t == triangle).count()
    }

    /// A place at distance 2 that is seen so many samples from the left and the top.
    fn place([x, y]: [f64; 2]) -> DVec3 {
        let sight = Screen::new(&eye(), SIZE).sight([x, y]);
        DVec3::new(sight.x, 1.0, sight.y) * 2.0
    }

    #[test]
    fn a_triangle_covers_its_area() {
        // As many sample centres are inside as the area has samples, up to half the length of the border (and of the
        // snapping).
        for corners in [
            [[10.0, 10.0], [200.0, 40.0], [90.0, 200.0]],
            [[3.3, 230.1], [290.7, 3.9], [150.0, 120.0]],
            [[100.2, 100.7], [130.4, 101.9], [131.3, 140.8]],
        ] {
            let [a, b, c]: [[f64; 2]; 3] = corners;
            let area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() / 2.0;
            let side = |a: [f64; 2], b: [f64; 2]| ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt();
            let border = side(a, b) + side(b, c) + side(c, a);
            let seen = drawn(&corners.map(place), &[[0, 1, 2]]);
            assert!((count(&seen, 0) as f64 - area).abs() <= border / 2.0, "{} for {area}", count(&seen, 0));
            // Either side, any first corner.
            for turned in [[1, 2, 0], [2, 1, 0]] {
                assert_eq!(drawn(&corners.map(place), &[turned]), seen);
            }
        }
    }

    #[test]
    fn triangles_with_a_common_edge_share_no_sample_and_leave_none_out() {
        // A fan round a point on a sample's centre, its rim outside of the screen.
        let middle = [150.5, 120.5];
        let rim = (0..17).map(|k| {
            let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 17.0).sin_cos();
            place([middle[0] + 400.0 * cos, middle[1] + 400.0 * sin])
        });
        let points: Vec<DVec3> = rim.chain([place(middle)]).collect();
        let fan: Vec<[u32; 3]> = (0..17).map(|k| [17, k, (k + 1) % 17]).collect();
        let all = drawn(&points, &fan);
        assert_eq!(all.len(), SIZE[0] * SIZE[1] * SAMPLES * SAMPLES);
        assert_eq!(count(&all, NOTHING), 0);
        let alone: usize = fan.iter().map(|t| count(&drawn(&points, &[*t]), 0)).sum();
        assert_eq!(alone, all.len());
    }

    #[test]
    fn the_nearer_triangle_is_seen() {
        let near = [[50.0, 50.0], [250.0, 60.0], [120.0, 220.0]].map(place);
        let far = [[80.0, 20.0], [280.0, 200.0], [40.0, 180.0]].map(|p| place(p) * 1.5);
        let points: Vec<DVec3> = near.into_iter().chain(far).collect();
        let (near_only, far_only) = (drawn(&points, &[[0, 1, 2]]), drawn(&points, &[[3, 4, 5]]));
        let seen = drawn(&points, &[[0, 1, 2], [3, 4, 5]]);
        for (sample, seen) in seen.iter().enumerate() {
            let expected = match (near_only[sample], far_only[sample]) {
                (0, _) => 0,
                (_, 0) => 1,
                _ => NOTHING,
            };
            assert_eq!(*seen, expected, "sample {sample}");
        }
        // In the other order the same.
        let swapped = drawn(&points, &[[3, 4, 5], [0, 1, 2]]);
        assert!(seen.iter().zip(&swapped).all(|(a, b)| *a == NOTHING && *b == NOTHING || a + b == 1));
    }

    #[test]
    fn triangles_that_pass_through_each_other_part_where_they_meet() {
        // The first goes from distance 2 at the left to 4 at the right, the second the other way round: they meet in
        // the middle.
        let strip = |left: f64, right: f64| {
            [[0.0, -100.0], [0.0, 340.0], [300.0, -100.0], [300.0, 340.0]]
                .map(|p| place(p) * if p[0] == 0.0 { left } else { right })
        };
        let points: Vec<DVec3> = strip(1.0, 2.0).into_iter().chain(strip(2.0, 1.0)).collect();
        let seen = drawn(&points, &[[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7]]);
        for (sample, triangle) in seen.iter().enumerate() {
            let x = sample % (SIZE[0] * SAMPLES);
            if x.abs_diff(150) > 1 {
                assert_eq!(*triangle / 2, u32::from(x > 150), "column {x}");
            }
        }
    }

    #[test]
    fn a_floor_that_passes_under_the_eye_fills_the_picture_up_to_the_horizon() {
        let far = 1e6;
        let points = [[-far, -far], [far, -far], [far, far], [-far, far]].map(|[x, y]| DVec3::new(x, y, -1.0));
        let seen = drawn(&points, &[[0, 1, 2], [0, 2, 3]]);
        let row = SIZE[0] * SAMPLES;
        for (sample, triangle) in seen.iter().enumerate() {
            assert_eq!(*triangle == NOTHING, sample / row < SIZE[1] * SAMPLES / 2, "row {}", sample / row);
        }
    }

    #[test]
    fn what_is_behind_the_eye_is_not_seen() {
        let behind = [[0.0, 0.0], [300.0, 0.0], [0.0, 240.0]].map(|p| -place(p));
        assert_eq!(count(&drawn(&behind, &[[0, 1, 2]]), 0), 0);
    }

    #[test]
    fn triangles_without_area_or_place_are_not_seen() {
        let nan = DVec3::new(f64::NAN, 1.0, 0.0);
        let points =
            [place([10.0, 10.0]), place([200.0, 100.0]), place([105.0, 55.0]), nan, DVec3::splat(f64::INFINITY)];
        for corners in [[0, 0, 1], [0, 1, 2], [1, 1, 1], [0, 1, 3], [0, 1, 4], [3, 3, 4]] {
            assert_eq!(count(&drawn(&points, &[corners]), 0), 0, "{corners:?}");
        }
    }
}
