//! Stand-ins for what is laid along surfaces in CO, figures 8 to 10.
//!
//! The paper shows its surfaces and its models, but gives no coordinates. Here the surfaces are bicubic Bézier patches; on the first two lies a
//! thin plate of 6 faces, on the third the [`shapes::dolphin`] whose number of faces is nearest to the paper's.

use glam::DVec3;
use isochor::{
    Basis, Height, HeightWord, Mesh, Patch, Placement, Refine, RefineWord, Sheet, Surface, Wrap, shapes, subdivide,
};

/// `shapes::dolphin(n)` has 2 n (n + 1) faces: 73,344, 321 fewer than CO's; with one more it would be 447 more.
const DOLPHIN_SEGMENTS: usize = 191;

/// A surface, and what lies on it.
pub struct StandIn {
    pub name: &'static str,
    pub surface: Surface,
    pub model: Mesh,
    placement: Placement,
    refine: Refine,
}

/// One for each of [`crate::paper::SURFACES`].
pub fn stand_ins() -> [StandIn; 3] {
    let plate = |name, surface| StandIn {
        name,
        surface,
        model: shapes::plate(DVec3::new(3.0, 3.0, 0.15), [1, 1]),
        placement: Placement::default(),
        refine: Refine::default(),
    };
    let dolphin = StandIn {
        name: "dolphin on a bend",
        surface: bend(),
        model: shapes::dolphin(DOLPHIN_SEGMENTS),
        placement: Placement { scale: 2.4, height: Height::Word(HeightWord::Middle), ..Placement::default() },
        // Its faces are smaller than the cells (CO, section 4).
        refine: Refine::Word(RefineWord::Off),
    };
    [plate("plate on a wave", wave()), plate("plate on a twisted sheet", twisted_sheet()), dolphin]
}

impl StandIn {
    /// The model on the flattened surface: x, y and height.
    pub fn placed(&self, sheet: &Sheet) -> Mesh {
        let bounds = self.model.bounds().expect("the model has vertices");
        let place = self.placement.placed(bounds, sheet).expect("the placement is finite");
        self.model.with_points(place.points(self.model.points())).expect("places are finite")
    }

    /// The `placed` model, divided where the surface curves, along the surface.
    pub fn deformed(&self, sheet: &Sheet, placed: &Mesh) -> Mesh {
        let divided = self.divided(sheet, placed);
        let wrap = Wrap::new(sheet).expect("the sheet does not fold");
        let points = wrap.points(divided.points()).expect("the model lies on the sheet");
        divided.with_points(points).expect("surfaces are finite")
    }

    fn divided(&self, sheet: &Sheet, placed: &Mesh) -> Mesh {
        match self.refine {
            Refine::Above(curvature) => {
                let extent = placed.bounds().expect("the model has vertices").extent();
                let division = subdivide(sheet, placed, curvature / extent).expect("the model can be divided");
                division.refinement.mesh(placed).expect("faces are of the model")
            }
            // Meshes share, so this copies nothing.
            Refine::Word(RefineWord::Off) => placed.clone(),
        }
    }
}

/// For figure 8.
fn wave() -> Surface {
    bicubic([4.0, 4.0], |i, _| 1.2 * [0.0, 1.0, -1.0, 0.0][i])
}

/// For figure 9.
fn twisted_sheet() -> Surface {
    bicubic([4.0, 4.0], |i, j| 0.8 * [0.0, 1.0, 1.0, 0.0][i] * [1.0, 0.5, -0.5, -1.0][j])
}

/// For figure 10.
fn bend() -> Surface {
    bicubic([8.0, 4.0], |i, j| [0.0, 1.6, 1.6, 0.0][i] * (1.0 + 0.15 * [0.0, 1.0, 1.0, 0.0][j]))
}

/// The Bézier patch over a rectangle round the origin with control points at equidistant places, i along x, and these heights.
fn bicubic(size: [f64; 2], height: impl Fn(usize, usize) -> f64) -> Surface {
    let along = |side: f64, k: usize| side * (k as f64 / 3.0 - 0.5);
    let point = |i: usize, j: usize| DVec3::new(along(size[0], i), along(size[1], j), height(i, j));
    let controls = (0..4).flat_map(|i| (0..4).map(move |j| [i, j])).map(|[i, j]| point(i, j)).collect();
    let bases = [0; 2].map(|_| Basis::bernstein(4).expect("cubic polynomials have four functions"));
    Patch::new(bases, controls, None).expect("16 points that span an area").into()
}

#[cfg(test)]
mod tests {
    use isochor::{FlattenOptions, OpenBoundaries, Solid, flatten, topology};

    use crate::paper::SURFACES;

    use super::*;

    #[test]
    fn models_have_the_faces_of_the_paper_or_nearest_to_them() {
        let [wave, twisted_sheet, bend] = stand_ins();
        let dolphin = SURFACES[2].polygons;
        let off = |mesh: &Mesh, polygons: usize| mesh.faces().len().abs_diff(polygons);
        assert_eq!([off(&wave.model, SURFACES[0].polygons), off(&twisted_sheet.model, SURFACES[1].polygons)], [0, 0]);
        assert_eq!(off(&bend.model, dolphin), 321);
        for n in [DOLPHIN_SEGMENTS - 1, DOLPHIN_SEGMENTS + 1] {
            assert!(off(&shapes::dolphin(n), dolphin) > 321, "{n}");
        }
    }

    /// Bernstein polynomials at 1/2 are 1/8, 3/8, 3/8, 1/8, and their derivatives −3/4, −3/4, 3/4, 3/4.
    #[test]
    fn surfaces_are_the_bezier_patches_of_their_control_points() {
        let close = |a: DVec3, b: DVec3| assert!(a.distance(b) < 1e-15, "{a} {b}");
        let middle = wave().jet(0.5, 0.5);
        close(middle.point, DVec3::ZERO);
        close(middle.s, DVec3::new(4.0, 0.0, 0.75 * 1.2 * -2.0));
        let middle = twisted_sheet().jet(0.5, 0.5);
        close(middle.point, DVec3::ZERO);
        close(middle.t, DVec3::new(0.0, 4.0, 0.75 * 0.8 * 0.75 * -3.0));
        close(twisted_sheet().jet(0.5, 0.0).point, DVec3::new(0.0, -2.0, 0.75 * 0.8));
        close(bend().jet(0.5, 0.5).point, DVec3::Z * (0.75 * 1.6 * (1.0 + 0.15 * 0.75)));
        close(bend().jet(0.0, 1.0).point, DVec3::new(-4.0, 2.0, 0.0));
    }

    #[test]
    fn models_lie_along_their_surfaces_without_folds_and_stay_closed() {
        for (stand_in, row) in stand_ins().iter().zip(SURFACES) {
            let options = FlattenOptions { cells: [row.cells; 2], ..FlattenOptions::default() };
            let sheet = flatten(&stand_in.surface, &options).unwrap().sheet;
            let placed = stand_in.placed(&sheet);
            let wrap = Wrap::new(&sheet).unwrap();
            let divided = stand_in.divided(&sheet, &placed);
            assert_eq!(wrap.laid(divided.points()).unwrap().folds, None, "{}", stand_in.name);
            let deformed = stand_in.deformed(&sheet, &placed);
            let solid = Solid::new(&deformed, &topology(&deformed), OpenBoundaries::Refuse).unwrap();
            assert!(solid.volume(deformed.points()) > 0.0, "{}", stand_in.name);
            let is_divided = deformed.faces().len() > placed.faces().len();
            assert_eq!(is_divided, placed.faces().len() == 6, "{}", stand_in.name);
        }
    }
}
