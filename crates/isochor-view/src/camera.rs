//! A perspective camera, and the one that frames given points as closely as it can.
//!
//! In the coordinates of a camera that looks along −z, with t and s the tangents of half its fields of view across and
//! down, a point (x, y, z) is in the picture of an eye e where
//!
//! ```text
//! |x − e_x| ≤ t (e_z − z),   |y − e_y| ≤ s (e_z − z).
//! ```
//!
//! With A = max(x + t z), B = max(−x + t z) over all points, the first asks for `A − t e_z ≤ e_x ≤ t e_z − B`:
//! possible from `e_z = (A + B) / 2t` on, with e_x = (A − B) / 2 in the middle of what is allowed. The same for y; the
//! farther of both distances is the camera. Maxima do not depend on the order of points, so neither does a bit of the
//! camera.
//!
//! All of it is relative to the middle of the points and in units of half their extent: models of any size, anywhere.

use glam::DVec3;
use isochor::Axis;

use crate::parallel;

/// Full field of view across the shorter side of a panel, in degrees. Larger: depth is exaggerated, and what is near
/// looks larger than it is; smaller: as from far away, hardly any depth.
const FIELD: f64 = 24.0;

/// What is kept free between the points and the border of a panel, relative to half the panel. Larger: small models;
/// smaller: dots and lines touch the border.
const MARGIN: f64 = 0.03;

/// The eye is at least this far before the nearest point, in half extents. Larger: needles that point at the eye look
/// small; smaller: one point fills the picture.
const NEAREST: f64 = 0.5;

/// From where a model is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where the eye is seen from above, in degrees counter-clockwise from +x (z up), +x (y up) or +y (x up).
    pub azimuth: f64,
    /// Its height above the horizon in degrees, −90 to 90.
    pub elevation: f64,
    /// Which way is up.
    pub up: Axis,
}

impl Default for View {
    /// From the front, a little from the right and from above; z is up. The front is towards −y, or +z where y is up.
    fn default() -> Self {
        Self { azimuth: -60.0, elevation: 22.0, up: Axis::Z }
    }
}

/// An eye, where it looks, and how much it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Origin of the camera's coordinates, model coordinates.
    center: DVec3,
    /// Length of the camera's unit, model coordinates.
    unit: f64,
    right: DVec3,
    up: DVec3,
    back: DVec3,
    /// Relative to `center`, along `right`, `up`, `back`, in units.
    eye: DVec3,
    /// Tangent of half the field of view across the shorter side of a panel.
    tangent: f64,
    /// The model's upward direction along `right`, `up`, `back`.
    zenith: DVec3,
}

impl Camera {
    /// The nearest camera that has all `points` in a panel of `size` (width, height; any unit). Points that are not
    /// finite do not count. Without points, and for a single one, it looks at that place from somewhere.
    #[must_use]
    pub fn framing(points: &[&[DVec3]], view: &View, size: [f64; 2]) -> Self {
        let (right, up, back) = directions(view);
        let tangent = tangent_of_half(FIELD);
        let mut camera =
            Self { center: DVec3::ZERO, unit: 1.0, right, up, back, eye: DVec3::ZERO, tangent, zenith: up };
        camera.zenith = camera.turned(axis(view.up));

        let boxed = |most: fn(DVec3, DVec3) -> DVec3, none: f64| {
            let of_points =
                |points: &[DVec3]| points.iter().filter(|p| p.is_finite()).fold(DVec3::splat(none), |m, p| most(m, *p));
            over_chunks(points, of_points).into_iter().fold(DVec3::splat(none), most)
        };
        let (low, high) = (boxed(DVec3::min, f64::INFINITY), boxed(DVec3::max, f64::NEG_INFINITY));
        if low.is_finite() && high.is_finite() {
            // Halves first: the sum may be beyond all numbers.
            camera.center = low * 0.5 + high * 0.5;
            let half = (high * 0.5 - low * 0.5).max_element();
            camera.unit = if half > 0.0 { half.max(f64::MIN_POSITIVE) } else { 1.0 };
        }

        let [across, down] = frame(size).map(|side| side * tangent * (1.0 - MARGIN));
        let least = || [f64::NEG_INFINITY; 5];
        let most = |a: [f64; 5], b: [f64; 5]| std::array::from_fn(|i| a[i].max(b[i]));
        let reach = |p: &DVec3| {
            let p = camera.turned(camera.centered(*p));
            [p.x + across * p.z, -p.x + across * p.z, p.y + down * p.z, -p.y + down * p.z, p.z]
        };
        let of_points = |points: &[DVec3]| points.iter().filter(|p| p.is_finite()).map(reach).fold(least(), most);
        let [right_most, left_most, highest, lowest, nearest] =
            over_chunks(points, of_points).into_iter().reduce(most).filter(|m| m[4].is_finite()).unwrap_or([0.0; 5]);
        let distance = ((right_most + left_most) / (2.0 * across)).max((highest + lowest) / (2.0 * down));
        camera.eye =
            DVec3::new((right_most - left_most) / 2.0, (highest - lowest) / 2.0, distance.max(nearest + NEAREST));
        camera
    }

    /// A camera at `eye` that looks at `at`, both in model coordinates, with `up` upwards. Where `up` is along the line
    /// of sight, another direction is taken; where `at` is `eye`, it looks down.
    #[must_use]
    pub fn looking(eye: DVec3, at: DVec3, up: DVec3) -> Self {
        let away = eye - at;
        let back = away.try_normalize().unwrap_or(DVec3::Z);
        let right = up.cross(back).try_normalize().unwrap_or_else(|| back.any_orthonormal_vector());
        let unit = if away.length() > 0.0 && away.is_finite() { away.length() } else { 1.0 };
        let upwards = back.cross(right);
        let tangent = tangent_of_half(FIELD);
        let mut camera =
            Self { center: eye, unit, right, up: upwards, back, eye: DVec3::ZERO, tangent, zenith: DVec3::Y };
        camera.zenith = camera.turned(up.try_normalize().unwrap_or(upwards));
        camera
    }

    /// Where a point of the model appears in a panel of `size` (width, height): from the left and from the top, in
    /// units of `size`, whether inside the panel or not. `None` beside and behind the eye.
    #[must_use]
    pub fn projected(&self, point: DVec3, size: [f64; 2]) -> Option<[f64; 2]> {
        let seen = self.seen(point);
        let scale = size[0].min(size[1]) / 2.0 / self.tangent;
        (seen.z < 0.0)
            .then(|| [size[0] / 2.0 - seen.x / seen.z * scale, size[1] / 2.0 + seen.y / seen.z * scale])
            .filter(|place| place.iter().all(|x| x.is_finite()))
    }

    /// A point of the model seen from the eye, in the camera's units: x to the right, y up, z towards the viewer
    /// (negative before the eye).
    pub(crate) fn seen(&self, point: DVec3) -> DVec3 {
        self.turned(self.centered(point)) - self.eye
    }

    /// A point of the model relative to the middle of what is framed, in the camera's units; model directions.
    pub(crate) fn centered(&self, point: DVec3) -> DVec3 {
        (point - self.center) / self.unit
    }

    /// A direction of the model along right, up and back.
    fn turned(&self, direction: DVec3) -> DVec3 {
        DVec3::new(self.right.dot(direction), self.up.dot(direction), self.back.dot(direction))
    }

    /// Tangent of half the field of view across the shorter side of a panel.
    pub(crate) fn tangent(&self) -> f64 {
        self.tangent
    }

    /// The model's upward direction, x to the right, y up, z towards the viewer.
    pub(crate) fn zenith(&self) -> DVec3 {
        self.zenith
    }
}

/// Right, up and back of a camera, model coordinates.
fn directions(view: &View) -> (DVec3, DVec3, DVec3) {
    let finite = |degrees: f64| if degrees.is_finite() { degrees } else { 0.0 };
    let (sin_a, cos_a) = libm::sincos(finite(view.azimuth).to_radians());
    let (sin_e, cos_e) = libm::sincos(finite(view.elevation).clamp(-90.0, 90.0).to_radians());
    let right = DVec3::new(-sin_a, cos_a, 0.0);
    let up = DVec3::new(-sin_e * cos_a, -sin_e * sin_a, cos_e);
    let back = DVec3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
    // From coordinates with z up to those of the model.
    let turn = |v: DVec3| match view.up {
        Axis::X => DVec3::new(v.z, v.x, v.y),
        Axis::Y => DVec3::new(v.x, v.z, -v.y),
        Axis::Z => v,
    };
    (turn(right), turn(up), turn(back))
}

fn axis(axis: Axis) -> DVec3 {
    match axis {
        Axis::X => DVec3::X,
        Axis::Y => DVec3::Y,
        Axis::Z => DVec3::Z,
    }
}

/// Width and height in units of the shorter side.
fn frame(size: [f64; 2]) -> [f64; 2] {
    size.map(|side| side / size[0].min(size[1]))
}

fn tangent_of_half(degrees: f64) -> f64 {
    let (sin, cos) = libm::sincos(degrees.to_radians() / 2.0);
    sin / cos
}

/// `f` of chunks of all lists of points.
fn over_chunks<R: Send>(points: &[&[DVec3]], f: impl Fn(&[DVec3]) -> R + Send + Sync) -> Vec<R> {
    let of_list = |points: &&[DVec3]| parallel::map_chunks(points.len(), parallel::CHUNK, |range| f(&points[range]));
    points.iter().flat_map(of_list).collect()
}
