//! Whether a mesh is a cage round a model, found without regard to how it was made.

use glam::DVec3;

use crate::buckets::Buckets;
use crate::intersection::{Facet, is_improper};
use crate::local_frame::LocalFrame;
use crate::mesh::{Bounds, Mesh, fan};
use crate::parallel;
use crate::point_tree::PointTree;
use crate::shells::half_solid_angle;
use crate::tolerances;
use crate::topology::topology;
use crate::volume::{OpenBoundaries, Solid};

/// What a cage is, and what is wrong with it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CageCheck {
    /// Vertices of the cage.
    pub vertices: usize,
    /// Its faces.
    pub faces: usize,
    /// Its connected pieces.
    pub components: usize,
    /// Its volume, in cubic units of the model; `None` where it is not closed.
    pub volume: Option<f64>,
    /// The least distance of a vertex of the model from the cage, in units of the model; `None` for a cage without faces or a model without vertices.
    pub least_distance: Option<f64>,
    /// Whatever is wrong; none for a cage.
    pub faults: Vec<CageFault>,
}

/// What makes a mesh no cage round a model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum CageFault {
    /// Faces that are no triangles.
    #[error("face {face} of the cage has {corners} corners")]
    NoTriangle {
        /// The first of them.
        face: usize,
        /// Its corners.
        corners: usize,
    },
    /// A triangle whose corners are on a line, as rounding goes.
    #[error("face {face} of the cage has no area")]
    NoArea {
        /// The first of them.
        face: usize,
    },
    /// Edges with one face only, or no faces at all.
    #[error("the cage is open: {edges} edges have one face")]
    Open {
        /// How many.
        edges: usize,
    },
    /// Faces that meet in an edge and are wound oppositely.
    #[error("faces of the cage are wound inconsistently along {edges} edges")]
    Inconsistent {
        /// How many edges.
        edges: usize,
    },
    /// Edges of more than two faces, or vertices of more than one fan.
    #[error("the cage is no surface at {edges} edges and {vertices} vertices, where more faces meet")]
    NonManifold {
        /// Edges with more than two faces.
        edges: usize,
        /// Vertices with more than one fan.
        vertices: usize,
    },
    /// A component that is wound inward, or encloses nothing.
    #[error("component {component} of the cage has volume {volume:e}: it does not face outward")]
    Inward {
        /// The first of them.
        component: usize,
        /// Its signed volume.
        volume: f64,
    },
    /// Faces that touch or cross.
    #[error("{pairs} pairs of faces of the cage meet where they should not, first {} and {}", .first[0], .first[1])]
    Crossing {
        /// How many pairs.
        pairs: usize,
        /// The first of them.
        first: [usize; 2],
    },
    /// A vertex of the model round which the cage does not wind once.
    #[error("vertex {vertex} of the model is not inside the cage: it does not wind round it once")]
    Outside {
        /// The first of them.
        vertex: usize,
    },
    /// A vertex of the model that is too near.
    #[error("a vertex of the model is at {distance:e} from the cage, and should be at {wanted:e}")]
    TooNear {
        /// The least distance.
        distance: f64,
        /// What was wanted.
        wanted: f64,
    },
}

impl CageCheck {
    /// Whether `cage` is a cage round the vertices of `mesh`: triangles with area, closed, two-manifold, wound outward, without faces that touch or cross where
    /// they are not neighbours (exactly), round every vertex once, and at least `distance` away from it (in units of the model).
    #[must_use]
    pub fn of(cage: &Mesh, mesh: &Mesh, distance: f64) -> Self {
        let mut faults = Vec::new();
        let is_triangle = |face: &&[u32]| face.len() == 3;
        if let Some((face, corners)) = cage.faces().iter().enumerate().find(|(_, face)| !is_triangle(face)) {
            faults.push(CageFault::NoTriangle { face, corners: corners.len() });
        }
        let volume = surface_faults(cage, &mut faults);
        let usable = cage.bounds().filter(|bounds| tolerances::EXTENTS.contains(&bounds.extent()));
        let bounds = usable.unwrap_or(Bounds { min: DVec3::ZERO, max: DVec3::ONE });
        let frame = LocalFrame::of(bounds);
        let corners: Vec<DVec3> = cage.points().iter().map(|p| frame.local(*p)).collect();
        let facets: Vec<Facet> = cage
            .faces()
            .iter()
            .flat_map(fan)
            .map(|vertices| Facet { vertices, corners: vertices.map(|v| corners[v as usize]) })
            .collect();
        let is_flat = |f: &Facet| {
            let (ab, ac) = (f.corners[1] - f.corners[0], f.corners[2] - f.corners[0]);
            ab.cross(ac).length() <= tolerances::FLAT_FRAME * ab.length() * ac.length()
        };
        match facets.iter().position(is_flat) {
            Some(face) => faults.push(CageFault::NoArea { face }),
            None => faults.extend(crossing(&facets, &corners)),
        }

        let points: Vec<DVec3> = mesh.points().iter().map(|p| frame.local(*p)).collect();
        let tree = PointTree::new(points.clone());
        let distances = parallel::map(facets.len(), |f| tree.distance(&facets[f].corners, f64::INFINITY));
        let least = distances.into_iter().fold(f64::INFINITY, f64::min);
        faults.extend(outside(&facets, &points, least).map(|vertex| CageFault::Outside { vertex }));
        let least = least * frame.unit;
        if least < distance {
            faults.push(CageFault::TooNear { distance: least, wanted: distance });
        }
        Self {
            vertices: cage.points().len(),
            faces: cage.faces().len(),
            components: topology(cage).components,
            volume,
            least_distance: least.is_finite().then_some(least),
            faults,
        }
    }
}

/// Adds what is wrong with a mesh as a surface; its volume, if it is closed.
fn surface_faults(cage: &Mesh, faults: &mut Vec<CageFault>) -> Option<f64> {
    let topology = topology(cage);
    if topology.boundary_edges > 0 || topology.components == 0 {
        faults.push(CageFault::Open { edges: topology.boundary_edges });
    }
    if topology.inconsistent_edges > 0 {
        faults.push(CageFault::Inconsistent { edges: topology.inconsistent_edges });
    }
    let [edges, vertices] = [topology.nonmanifold_edges, topology.nonmanifold_vertices];
    if edges + vertices > 0 {
        faults.push(CageFault::NonManifold { edges, vertices });
    }
    let volumes = Solid::new(cage, &topology, OpenBoundaries::Refuse).ok()?.volumes(cage.points());
    let inward = volumes.components.iter().enumerate().find(|(_, volume)| **volume <= 0.0);
    faults.extend(inward.map(|(component, volume)| CageFault::Inward { component, volume: *volume }));
    Some(volumes.total)
}

/// The pairs of faces that meet where they should not.
fn crossing(facets: &[Facet], points: &[DVec3]) -> Option<CageFault> {
    let mut buckets = Buckets::over(points);
    for (f, facet) in facets.iter().enumerate() {
        buckets.insert(f as u32, facet.corners);
    }
    let of_face = |f: usize| {
        let mut others: Vec<usize> = buckets.near(facets[f].corners).map(|g| g as usize).filter(|g| *g > f).collect();
        others.sort_unstable();
        others.dedup();
        others.retain(|g| is_improper(&facets[f], &facets[*g]));
        others
    };
    let pairs: Vec<Vec<usize>> = parallel::map(facets.len(), of_face);
    let first = pairs.iter().enumerate().find_map(|(f, others)| others.first().map(|g| [f, *g]))?;
    Some(CageFault::Crossing { pairs: pairs.iter().map(Vec::len).sum(), first })
}

/// The first point that the surface does not wind round once. No point is nearer to it than `least`, so in a ball of that radius all answers are the same.
fn outside(facets: &[Facet], points: &[DVec3], least: f64) -> Option<usize> {
    let is_inside = |p: DVec3| {
        let half_angles: Option<f64> = facets.iter().map(|f| half_solid_angle(f.corners.map(|c| c - p))).sum();
        half_angles.is_some_and(|sum| (sum / (2.0 * std::f64::consts::PI) - 1.0).abs() <= tolerances::WINDING)
    };
    let firsts = parallel::map_chunks(points.len(), parallel::CHUNK, |range| {
        let mut middle = None;
        range.into_iter().find(|i| {
            let p = points[*i];
            if middle.is_some_and(|m: DVec3| p.distance(m) < least) {
                return false;
            }
            middle = Some(p);
            !is_inside(p)
        })
    });
    firsts.into_iter().flatten().next()
}
