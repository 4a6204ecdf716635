//! What is shown: poses of one model, side by side or one after the other.

use std::borrow::Cow;

use glam::DVec3;
use isochor::{Course, DragPlane, Faces, Mesh, NetDrawing, Outcome, PosedCage, PosedLattice, Sheet, stress_angles};

/// Poses of one model.
#[derive(Clone, Debug)]
pub struct Show<'a> {
    /// The faces of all poses, counter-clockwise seen from outside where volumes are positive.
    pub faces: &'a Faces,
    /// The poses, in the order in which they are shown. At least one.
    pub poses: Vec<ShownPose<'a>>,
}

/// A pose and what is said of it.
#[derive(Clone, Debug)]
pub struct ShownPose<'a> {
    /// Such as "rest", "deformed", "corrected".
    pub name: String,
    /// Positions (#vertices × 3), model coordinates.
    pub points: Cow<'a, [DVec3]>,
    /// The control points, where a lattice deforms the model; else grid lines of the surface along which it lies.
    pub lattice: Option<ShownLattice<'a>>,
    /// The volume of the pose, outward orientation; none where the model bounds no body.
    pub volume: Option<f64>,
    /// Local volume change against rest (#vertices): 1 where a small piece keeps its volume, 0.5 where half of it is left.
    pub volume_change: Option<Cow<'a, [f64]>>,
    /// Local stress against rest (#vertices), in radians: 0 where a small piece is turned and scaled only, π where it is turned
    /// inside out.
    pub stress: Option<Cow<'a, [f64]>>,
}

/// The control points of a lattice; or the points of a grid, as a lattice of one layer, of which pictures show the lines alone.
#[derive(Clone, Debug)]
pub struct ShownLattice<'a> {
    /// Control points along u, v, w. Flat index: `(i · size[1] + j) · size[2] + k`.
    pub size: [usize; 3],
    /// Positions (#controls × 3), model coordinates.
    pub controls: Cow<'a, [DVec3]>,
    /// Lines that are drawn instead of the lattice's edges, springs or edges of a cage, and which control points are held.
    pub net: Option<Cow<'a, NetDrawing>>,
    /// Drag planes of vertices of a cage.
    pub planes: Vec<DragPlane>,
}

impl ShownLattice<'static> {
    /// Grid lines of a flattened sheet, at height 0: a lattice of one layer.
    #[must_use]
    pub fn of_sheet(sheet: &Sheet) -> Self {
        Self::of_grid(sheet, sheet.flat().iter().map(|p| p.extend(0.0)).collect())
    }

    /// The same lines on its surface.
    #[must_use]
    pub fn of_surface(sheet: &Sheet) -> Self {
        let [m, n] = sheet.cells();
        let point = |(i, j)| {
            let parameters = sheet.parameters(i, j);
            sheet.surface().jet(parameters.x, parameters.y).point
        };
        Self::of_grid(sheet, (0..=m).flat_map(|i| (0..=n).map(move |j| (i, j))).map(point).collect())
    }

    fn of_grid(sheet: &Sheet, points: Vec<DVec3>) -> Self {
        let [m, n] = sheet.cells();
        Self { size: [m + 1, n + 1, 1], controls: points.into(), net: None, planes: Vec::new() }
    }
}

impl<'a> Show<'a> {
    /// A job's model at rest, deformed, and corrected. Without deformation: at rest alone; without correction: no third pose.
    #[must_use]
    pub fn of_job(mesh: &'a Mesh, outcome: &'a Outcome, course: Option<&'a Course>) -> Self {
        let row = outcome.report.volume.as_ref().map(|volume| volume.overall);
        let rest = ShownPose {
            name: "rest".into(),
            // A model along a surface is at rest where it was placed on the flattened sheet.
            points: outcome.sheet().map_or(mesh.points(), |sheet| sheet.placed.points()).into(),
            lattice: None,
            volume: row.map(|row| row.rest),
            volume_change: None,
            stress: None,
        };
        let mut show = Self { faces: mesh.faces(), poses: vec![rest] };
        let Some(course) = course else { return show };
        let controls = Controls::of(outcome);
        let sheet = outcome.sheet().map(|drawing| drawing.sheet());
        let lattice = |positions: &'a [DVec3]| match &controls {
            Some(c) => Some(ShownLattice {
                size: c.size,
                controls: positions.into(),
                net: outcome.net().map(Cow::Borrowed),
                planes: Vec::new(),
            }),
            None => sheet.map(ShownLattice::of_surface),
        };
        let planes = || outcome.report.cage.iter().flat_map(|cage| &cage.planes).map(|row| row.plane).collect();
        // A lattice round a model that went along a surface was never at rest with it.
        show.poses[0].lattice = match sheet {
            Some(sheet) => Some(ShownLattice::of_sheet(sheet)),
            None => controls.as_ref().and_then(|c| lattice(c.rest)),
        };
        show.poses.push(ShownPose {
            name: "deformed".into(),
            points: (&course.posed[..]).into(),
            lattice: lattice(&course.posed_controls),
            volume: row.map(|row| row.posed),
            volume_change: Some((&course.posed_change[..]).into()),
            stress: None,
        });
        if outcome.report.correction.method != "none" {
            show.poses.push(ShownPose {
                name: "corrected".into(),
                points: (&outcome.points[..]).into(),
                lattice: lattice(controls.as_ref().map_or(&[], |c| c.posed)),
                volume: row.map(|row| row.corrected),
                volume_change: Some((&course.corrected_change[..]).into()),
                stress: None,
            });
        }
        if let Some(last) = show.poses.last_mut().and_then(|pose| pose.lattice.as_mut()) {
            last.planes = planes();
        }
        show
    }

    /// The show [of a job](Show::of_job) with local stress, deformed and corrected, which pictures coloured by it need.
    #[must_use]
    pub fn with_stress(mut self, outcome: &Outcome) -> Self {
        for (index, pose) in self.poses.iter_mut().enumerate() {
            let jacobians = match index {
                0 => None,
                1 => outcome.posed_jacobians(),
                _ => outcome.jacobians(),
            };
            pose.stress = jacobians.map(|jacobians| stress_angles(&jacobians).into());
        }
        self
    }
}

/// The controls of an outcome, of a lattice or a cage.
struct Controls<'a> {
    size: [usize; 3],
    rest: &'a [DVec3],
    posed: &'a [DVec3],
}

impl<'a> Controls<'a> {
    fn of(outcome: &'a Outcome) -> Option<Self> {
        let of_cage =
            |cage: &'a PosedCage| Self { size: [1, 1, cage.posed.len()], rest: cage.mesh.points(), posed: &cage.posed };
        let of_lattice = |c: &'a PosedLattice| Self { size: c.lattice.size(), rest: &c.rest, posed: &c.posed };
        outcome.controls.as_ref().map(of_lattice).or(outcome.cage.as_ref().map(of_cage))
    }
}

impl ShownLattice<'static> {
    /// The lattice or cage of an outcome in the end; `None` where there is neither.
    #[must_use]
    pub fn of_outcome(outcome: &Outcome) -> Option<Self> {
        let controls = Controls::of(outcome)?;
        Some(Self {
            size: controls.size,
            controls: controls.posed.to_vec().into(),
            net: outcome.net().cloned().map(Cow::Owned),
            planes: outcome.report.cage.iter().flat_map(|cage| &cage.planes).map(|row| row.plane).collect(),
        })
    }
}
