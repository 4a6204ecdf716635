//! Normals for smooth shading that leave creases sharp.
//!
//! The normal of triangle t at its corner v is the sum of the area vectors of those triangles at v whose normals are
//! within the crease angle of t's. Weights by area rather than by the angle at the corner: no arc cosines, slivers say
//! little, and the large faces of technical models stay flat beside their roundings.
//!
//! At most vertices all normals are within half the crease angle of their sum, hence of one another, and one normal
//! serves all corners; the others are summed when they are needed, for triangles that are seen.

use glam::DVec3;

use crate::{parallel, surface::Surface};

/// Cosine of the crease angle, 40°. Larger angle: edges of coarse technical models blur; smaller: coarse round models
/// show their faces.
const CREASE: f64 = 0.766_044_443_118_978;

/// Cosine of half the crease angle: √((1 + CREASE) / 2).
const HALF_CREASE: f64 = 0.939_692_620_785_908_4;

/// Normals of one pose.
pub(crate) struct Normals<'a> {
    surface: &'a Surface,
    /// Area vector of each triangle; zero where it is not finite. In 32 bits: half the memory to wait for, and light
    /// needs no more.
    areas: Vec<[f32; 3]>,
    /// Unit normal at each welded vertex; zero where its triangles form a crease, or there is none.
    smooth: Vec<[f32; 3]>,
}

impl<'a> Normals<'a> {
    /// The normals of a pose (#vertices × 3, any coordinates of about size 1).
    pub(crate) fn new(surface: &'a Surface, points: &[DVec3]) -> Self {
        let area = |t: usize| {
            let [a, b, c] = surface.triangles[t].map(|v| points[v as usize]);
            narrow(Some((b - a).cross(c - a)).filter(|area| area.is_finite()).unwrap_or(DVec3::ZERO))
        };
        let areas = parallel::collect(surface.triangles.len(), area);
        let smooth = |v: usize| {
            let around = surface.around(v);
            let area = |t: &u32| wide(areas[*t as usize]);
            let sum = around.iter().map(area).sum::<DVec3>().normalize_or_zero();
            let is_crease = around.iter().map(area).any(|area| angle_exceeds(area, sum, 1.0, HALF_CREASE));
            narrow(if is_crease { DVec3::ZERO } else { sum })
        };
        let smooth = parallel::collect(surface.vertices(), smooth);
        Self { surface, areas, smooth }
    }

    /// Unit normals at the corners of triangle `t`, or zero where it has no area.
    pub(crate) fn at_corners(&self, t: usize) -> [DVec3; 3] {
        let own = wide(self.areas[t]);
        let squared = own.length_squared();
        self.surface.triangles[t].map(|v| {
            let v = self.surface.welded(v);
            if self.smooth[v] != [0.0; 3] {
                return wide(self.smooth[v]);
            }
            let near = self.surface.around(v).iter().map(|&s| wide(self.areas[s as usize]));
            let sum: DVec3 = near.filter(|area| !angle_exceeds(*area, own, squared, CREASE)).sum();
            sum.try_normalize().or(own.try_normalize()).unwrap_or(DVec3::ZERO)
        })
    }
}

fn narrow(v: DVec3) -> [f32; 3] {
    v.to_array().map(|x| x as f32)
}

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

/// Whether the angle between `a` and `b` is larger than that of cosine `cosine` > 0. `squared` is |b|².
fn angle_exceeds(a: DVec3, b: DVec3, squared: f64, cosine: f64) -> bool {
    let dot = a.dot(b);
    let limit = cosine * cosine * a.length_squared() * squared;
    dot < 0.0 || dot * dot < limit
}

#[cfg(test)]
mod tests {
    use super::*;
    use isochor::shapes;

    fn normals_of(mesh: &isochor::Mesh) -> (Surface, Vec<DVec3>) {
        let surface = Surface::new(mesh.faces(), mesh.points(), mesh.points().len());
        (surface, mesh.points().to_vec())
    }

    #[test]
    fn half_the_crease_is_half_the_crease() {
        assert!((2.0 * HALF_CREASE * HALF_CREASE - 1.0 - CREASE).abs() < 1e-15);
    }

    #[test]
    fn a_cube_has_one_normal_a_side() {
        let (surface, points) = normals_of(&shapes::cube(3));
        let normals = Normals::new(&surface, &points);
        for t in 0..surface.triangles.len() {
            let [a, b, c] = surface.triangles[t].map(|v| points[v as usize]);
            let side = (b - a).cross(c - a).normalize();
            normals.at_corners(t).iter().for_each(|n| assert!((*n - side).length() < 1e-6, "triangle {t}"));
        }
    }

    #[test]
    fn a_ball_has_radial_normals() {
        // A vertex of the icosahedron, where five equal faces meet, is exact; elsewhere O(h²) with h the length of
        // edges.
        let (surface, points) = normals_of(&shapes::icosphere(4));
        let normals = Normals::new(&surface, &points);
        for t in 0..surface.triangles.len() {
            for (v, n) in surface.triangles[t].iter().zip(normals.at_corners(t)) {
                assert!(n.dot(points[*v as usize].normalize()) > 0.9995);
            }
        }
    }

    #[test]
    fn torn_surfaces_are_smooth() {
        let mesh = shapes::icosphere(3);
        let torn: Vec<DVec3> = mesh.faces().corners().iter().map(|&v| mesh.points()[v as usize]).collect();
        let triples: Vec<[u32; 3]> = (0..torn.len() as u32 / 3).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
        let torn_surface = Surface::new(&triples.iter().collect(), &torn, torn.len());
        let whole = Surface::new(mesh.faces(), mesh.points(), mesh.points().len());
        let (torn, whole) = (Normals::new(&torn_surface, &torn), Normals::new(&whole, mesh.points()));
        (0..triples.len()).for_each(|t| assert_eq!(torn.at_corners(t), whole.at_corners(t)));
    }

    #[test]
    fn no_area_and_no_place_give_no_normal() {
        let points = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::splat(f64::NAN)];
        let surface = Surface::new(&[[0, 1, 2], [0, 1, 3]].iter().collect(), &points, 4);
        let normals = Normals::new(&surface, &points);
        (0..2).for_each(|t| assert_eq!(normals.at_corners(t), [DVec3::ZERO; 3]));
    }
}
