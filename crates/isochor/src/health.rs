//! Health of a model: what it is, its volumes, and whether they can be preserved.

use crate::mesh::{Bounds, Mesh, fan};
use crate::parallel;
use crate::shells::{Role, roles};
use crate::topology::Topology;
use crate::volume::{OpenBoundaries, Solid, SolidError, Volumes};

/// What a mesh was read from; a mesh made in memory has [`Source::of`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Source {
    /// Name of the file format, or "memory".
    pub format: String,
    /// Vertices as in the file: corners count singly in STL.
    pub vertices: usize,
    /// Faces as in the file.
    pub faces: usize,
    /// What the reader noticed.
    pub warnings: Vec<String>,
}

impl Source {
    /// A mesh that was made in memory.
    #[must_use]
    pub fn of(mesh: &Mesh) -> Self {
        let (vertices, faces) = (mesh.points().len(), mesh.faces().len());
        Self { format: "memory".into(), vertices, faces, warnings: Vec::new() }
    }
}

/// What a model is. Topology is taken after welding bit-equal positions; see [`Topology`].
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Health {
    /// Name of the file format.
    pub format: String,
    /// Vertices as in the file.
    pub vertices: usize,
    /// Faces as in the file.
    pub faces: usize,
    /// Triangles after fanning polygons from their first corner.
    pub triangles: usize,
    /// Pieces that hang together through edges.
    pub components: usize,
    /// Edges with one face.
    pub boundary_edges: usize,
    /// Connected pieces of boundary edges.
    pub boundary_loops: usize,
    /// Edges with more than two faces.
    pub nonmanifold_edges: usize,
    /// Every edge has exactly two faces.
    pub closed: bool,
    /// Every edge with two faces is run once in each direction.
    pub oriented: bool,
    /// Every edge is run equally often in both directions: all that a volume needs.
    pub balanced: bool,
    /// Faces without area.
    pub zero_area_faces: usize,
    /// Vertices that no face names.
    pub unused_vertices: usize,
    /// Vertices whose place another vertex of the file has too.
    pub coincident_vertices: usize,
    /// Handles, summed over components; only of closed, two-manifold, oriented models.
    pub genus: Option<i64>,
    /// Lowest and highest corner of the bounding box; none without vertices.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Surface area without virtual caps, in the model's unit squared.
    pub area: f64,
    /// Signed volumes, virtual caps included, in the model's unit cubed: positive where faces are counter-clockwise seen
    /// from outside. None where the model bounds no body.
    pub volume: Option<Volumes>,
    /// What each component is to the others, in the order of [`Volumes::components`]; empty where the model bounds no body.
    pub roles: Vec<ComponentHealth>,
    /// Whether the volume can be preserved.
    pub verdict: Verdict,
    /// What a user should know, one sentence each.
    pub warnings: Vec<String>,
}

/// A component of a model.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ComponentHealth {
    /// Its signed volume.
    pub volume: f64,
    /// What it is to the others.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub role: Role,
    /// What the cavities of a shell hold together, positive.
    pub capacity: Option<f64>,
    /// The volume of a shell less its cavities, positive unless they overlap.
    pub material: Option<f64>,
}

/// Whether, and how, the volume of a model can be preserved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "kebab-case"))]
pub enum Verdict {
    /// Balanced and wound outwards: its volume can be preserved.
    Ok,
    /// Balanced but wound inwards: its volume can be preserved; targets refer to the outward orientation.
    InsideOut,
    /// Open: its volume can be preserved with virtual caps over its boundaries.
    Capped,
    /// It encloses no volume: a flat or doubled sheet.
    NoVolume,
    /// Faces are wound inconsistently, or there is no consistent winding: inside and outside are not defined.
    Inconsistent,
    /// There are no faces.
    NoFaces,
    /// The model is too small or too large for volumes in f64.
    Extent,
}

impl Verdict {
    /// Whether a volume is defined and can be preserved.
    #[must_use]
    pub fn is_preservable(self) -> bool {
        matches!(self, Self::Ok | Self::InsideOut | Self::Capped)
    }

    /// One sentence for people.
    #[must_use]
    pub fn sentence(self) -> &'static str {
        match self {
            Self::Ok => "its volume is well defined and can be preserved exactly",
            Self::InsideOut => "it is wound inside out; its volume can be preserved exactly, measured outwards",
            Self::Capped => "it is open; its volume can be preserved exactly with virtual caps over the openings",
            Self::NoVolume => "it encloses no volume, so there is none to preserve",
            Self::Inconsistent => "its faces are wound inconsistently, so it has no volume to preserve",
            Self::NoFaces => "it has no faces, so it has no volume to preserve",
            Self::Extent => "it is too small or too large for its volume to be measured",
        }
    }
}

impl Health {
    /// The health of `mesh` with its `topology`, and the body it bounds, or why it bounds none. What is wrong with a model is
    /// part of its health, not an error.
    pub fn of(mesh: &Mesh, topology: &Topology, source: &Source) -> (Self, Result<Solid, SolidError>) {
        let solid = Solid::new(mesh, topology, OpenBoundaries::Cap);
        let (area, zero_area_faces) = areas(mesh);
        let (verdict, volumes, mut warnings) = match &solid {
            Ok(solid) => judged(mesh, topology, solid),
            Err(error) => (refused(error), None, vec![format!("{error}.")]),
        };
        let roles = match (&solid, &volumes) {
            (Ok(solid), Some(volumes)) => roles_of_components(solid, mesh, volumes),
            _ => Vec::new(),
        };
        warnings.splice(0..0, source.warnings.iter().cloned());
        if topology.collapsed_faces > 0 {
            warnings.push(format!("{} faces have fewer than three distinct corners.", topology.collapsed_faces));
        }
        if let Some([a, b]) = topology.first_nonmanifold_edge {
            let count = topology.nonmanifold_edges;
            warnings.push(format!("Edges with more than two faces: {count}, the first from vertex {a} to vertex {b}."));
        }
        let welded_by_reader = source.vertices.saturating_sub(mesh.points().len());
        let health = Self {
            format: source.format.clone(),
            vertices: source.vertices,
            faces: source.faces,
            triangles: mesh.faces().corners().len() - 2 * mesh.faces().len(),
            components: topology.components,
            boundary_edges: topology.boundary_edges,
            boundary_loops: topology.boundary_loops,
            nonmanifold_edges: topology.nonmanifold_edges,
            closed: topology.is_closed(),
            oriented: topology.is_oriented(),
            balanced: topology.is_balanced(),
            zero_area_faces,
            unused_vertices: topology.unused_vertices,
            coincident_vertices: topology.coincident_vertices + welded_by_reader,
            genus: topology.genus(),
            bounds: mesh.bounds().map(|Bounds { min, max }| [min.to_array(), max.to_array()]),
            area,
            volume: volumes,
            roles,
            verdict,
            warnings,
        };
        (health, solid)
    }
}

fn refused(error: &SolidError) -> Verdict {
    match error {
        SolidError::NoFaces => Verdict::NoFaces,
        SolidError::Extent { .. } => Verdict::Extent,
        SolidError::Winding { .. } | SolidError::Open { .. } => Verdict::Inconsistent,
    }
}

/// The verdict on a mesh that bounds a body.
fn judged(mesh: &Mesh, topology: &Topology, solid: &Solid) -> (Verdict, Option<Volumes>, Vec<String>) {
    let volumes = solid.volumes(mesh.points());
    let mut warnings = Vec::new();
    if solid.cap_count() > 0 {
        warnings.push(format!(
            "The model is open: {} edges without counterpart ({} boundary edges in {} loops). Volumes include {} virtual \
             caps, which are never written.",
            topology.unbalanced.len(),
            topology.boundary_edges,
            topology.boundary_loops,
            solid.cap_count(),
        ));
    }
    let mut verdict = if solid.cap_count() > 0 { Verdict::Capped } else { Verdict::Ok };
    if solid.encloses_nothing(mesh.points(), volumes.total) {
        warnings.push("The model encloses no volume.".into());
        verdict = Verdict::NoVolume;
    } else if volumes.total < 0.0 {
        warnings
            .push("The model is inside out: faces are wound inwards. Targets refer to the outward orientation.".into());
        if verdict == Verdict::Ok {
            verdict = Verdict::InsideOut;
        }
    }
    (verdict, Some(volumes), warnings)
}

fn roles_of_components(solid: &Solid, mesh: &Mesh, volumes: &Volumes) -> Vec<ComponentHealth> {
    let component = |(role, &volume): (Role, &f64)| {
        let shell = if let Role::Shell(shell) = &role { Some(shell) } else { None };
        let (capacity, material) = (shell.map(|s| s.capacity(volumes)), shell.map(|s| s.material(volumes)));
        ComponentHealth { volume, role, capacity, material }
    };
    roles(solid, mesh.points(), volumes).into_iter().zip(&volumes.components).map(component).collect()
}

/// The area of all faces, and how many have none beyond the rounding of their corners.
fn areas(mesh: &Mesh) -> (f64, usize) {
    /// Faces whose areas are kept at once. More: memory; fewer: threads wait for one another.
    const KEPT: usize = 64 * parallel::CHUNK;
    let (points, faces) = (mesh.points(), mesh.faces());
    let area = |f: usize| {
        let (mut doubled, mut longest) = (0.0, 0.0f64);
        for t in fan(faces.face(f)) {
            let [a, b, c] = t.map(|v| points[v as usize]);
            doubled += (b - a).cross(c - a).length();
            longest = longest.max((b - a).length_squared()).max((c - a).length_squared());
        }
        (doubled / 2.0, doubled <= f64::EPSILON * longest)
    };
    let (mut total, mut without) = (0.0, 0);
    for first in (0..faces.len()).step_by(KEPT) {
        for (area, is_zero) in parallel::collect(KEPT.min(faces.len() - first), |f| area(first + f)) {
            total += area;
            without += usize::from(is_zero);
        }
    }
    (total, without)
}
