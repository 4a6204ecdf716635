//! What a job did, as data: the same report for the command line, scripts and programs.

use glam::DVec3;

use crate::augmented::LevelReport;
use crate::cage_binding::CageReport;
use crate::correct::{Correction, Method, Status};
use crate::drag_plane::DragPlane;
use crate::health::Health;
use crate::least_stress::LeastStressReport;
use crate::local_stress::StressReport;
use crate::stretch::FlattenReport;
use crate::wrap::WrapFolds;

/// The report of one job.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Report {
    /// Version of the library that made it.
    pub version: String,
    /// The model as it was read.
    pub model: Health,
    /// What became of its volume. Absent where the model bounds no body, which only jobs with free volume accept.
    pub volume: Option<VolumeReport>,
    /// What the correction did.
    pub correction: CorrectionReport,
    /// What became of the surface that the model was laid along; absent in other jobs.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub surface: Option<SurfaceReport>,
    /// How the nodes settled, with the method "elastic"; absent with others.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub elastic: Option<ElasticReport>,
    /// The cage and its coordinates; absent in jobs without one.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub cage: Option<CageJobReport>,
    /// Whether foldings were looked for: "off".
    pub folds: String,
    /// How long each stage took, in the order in which they ran.
    pub timings_ms: Timings,
    /// The most memory that the process held until then, in bytes, with all that it did before. Programs fill it in that know it.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub peak_memory: Option<u64>,
    /// What the user should know, one sentence each.
    pub warnings: Vec<String>,
}

/// How a cage carried the model.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CageJobReport {
    /// How good its coordinates are.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub binding: CageReport,
    /// Local stress at the model's vertices in the end, where it was asked for.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub stress: Option<StressReport>,
    /// What the objective "stress" brought.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub least_stress: Option<LeastStressReport>,
    /// The drag planes that were asked for, of the cage in the end.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub planes: Vec<DragPlaneReport>,
}

/// The drag plane of a vertex of a cage.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct DragPlaneReport {
    /// The vertex.
    pub vertex: usize,
    /// Its plane, model coordinates.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub plane: DragPlane,
}

/// How a model was laid along a surface.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SurfaceReport {
    /// Cells of the flattened grid along s and t.
    pub cells: [usize; 2],
    /// Grid steps over which lengths were kept.
    pub reach: usize,
    /// The factor with which the model was placed.
    pub scale: f64,
    /// Vertices added on edges.
    pub edge_points: usize,
    /// Vertices added within faces.
    pub face_points: usize,
    /// Where the model folds; absent where it does not.
    pub folds: Option<WrapFolds>,
    /// The factor of all heights that restored the volume, with the method "height".
    pub height_scale: Option<f64>,
    /// How well the surface was flattened.
    pub flattening: FlattenReport,
}

/// How the nodes of an elastic lattice settled.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ElasticReport {
    /// Which nodes springs connect: "26", "14", "14-kuhn".
    pub net: String,
    /// "newton" or "augmented-lagrangian".
    pub solver: String,
    /// "settled", or "approximate" for the solver "augmented-lagrangian", whose volume is corrected exactly at last.
    pub status: String,
    /// Where volumes came from: "form", "mesh", or "coarse" (a coarse mesh that was tilted to the fine one).
    pub evaluation: String,
    /// Springs.
    pub springs: usize,
    /// Nodes of which no coordinate may move.
    pub held: usize,
    /// Nodes that settled.
    pub free: usize,
    /// Steps of the solver.
    pub steps: usize,
    /// Evaluations of the whole mesh.
    pub evaluations: usize,
    /// Energy of the springs where the edits put the nodes.
    pub energy_posed: f64,
    /// The same in the end.
    pub energy: f64,
    /// Of each wanted volume the pressure that keeps it: dE/dV.
    pub pressures: Vec<f64>,
    /// The largest force that nothing balances, in forces that stretch a spring by its own length.
    pub residual: f64,
    /// The centre of mass at rest, posed and in the end, model coordinates, where it was asked for.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub center_of_mass: Option<[[f64; 3]; 3]>,
    /// How far the inertia tensor is from what was wanted, relative to its largest entry, where it was asked for.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub inertia_error: Option<f64>,
    /// What happened on each level of the solver "augmented-lagrangian", the coarsest first.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub levels: Vec<LevelReport>,
}

/// The report of a film: of one job for each of its frames.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FilmReport {
    /// Version of the library that made it.
    pub version: String,
    /// The model as it was read.
    pub model: Health,
    /// What became of it, frame after frame.
    pub frames: Vec<FrameReport>,
}

/// The report of one frame: that of its job, less what all frames share.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FrameReport {
    /// When, from 0 to 1.
    pub time: f64,
    /// As in [`Report`].
    pub volume: Option<VolumeReport>,
    /// As in [`Report`].
    pub correction: CorrectionReport,
    /// As in [`Report`].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub surface: Option<SurfaceReport>,
    /// As in [`Report`].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub elastic: Option<ElasticReport>,
    /// As in [`Report`].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub cage: Option<CageJobReport>,
    /// As in [`Report`].
    pub timings_ms: Timings,
    /// As in [`Report`].
    pub warnings: Vec<String>,
}

impl FrameReport {
    /// The report of the job at `time`.
    #[must_use]
    pub fn of(time: f64, report: Report) -> Self {
        let Report { volume, correction, surface, elastic, cage, timings_ms, warnings, .. } = report;
        Self { time, volume, correction, surface, elastic, cage, timings_ms, warnings }
    }
}

/// Volumes in the model's unit cubed, caps included, **outward orientation**: positive for inside-out models too.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct VolumeReport {
    /// Of the whole model.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub overall: VolumeRow,
    /// Of each component, in the order of its first face; a cavity is negative.
    pub components: Vec<VolumeRow>,
    /// Where volumes of parts of the model were asked for: each of them, in the order in which they were asked for, cavities
    /// counted positive.
    pub parts: Vec<PartRow>,
}

/// The volume of some components together.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PartRow {
    /// The components.
    pub components: Vec<usize>,
    /// Their volume: what they hold, if they are cavities.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub row: VolumeRow,
}

/// The volume of a body on its way through a job.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct VolumeRow {
    /// As read.
    pub rest: f64,
    /// After the edits.
    pub posed: f64,
    /// What was asked of it; none where it is free.
    pub target: Option<f64>,
    /// After the correction: f64, in a frame near the model.
    #[cfg_attr(feature = "serde", serde(rename = "final"))]
    pub corrected: f64,
    /// Measured again from the numbers in the output file.
    pub written: Option<f64>,
    /// `|final − target| / |target|`.
    pub relative_error: Option<f64>,
}

impl VolumeRow {
    /// Adds what was asked of it.
    pub(crate) fn aim(&mut self, target: f64) {
        self.target = Some(target);
        self.relative_error = Some(((self.corrected - target) / target).abs());
    }
}

/// What the correction did. Displacements are those of the vertices, model units; relative ones in extents.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CorrectionReport {
    /// "nearest", "gradient", "axes", "height", "elastic", or "none" where the volume was free.
    pub method: String,
    /// What was kept small: "controls", "surface", "edges", "bending", "springs", or "none" where the volume was free.
    pub objective: String,
    /// How it ended: "exact", "already-met", "preview" (approximate), or "not-asked".
    pub status: String,
    /// Exact steps taken.
    pub iterations: usize,
    /// How far "nearest" is from its condition, in extents; none for other methods.
    pub residual: Option<f64>,
    /// How far the point that misses most is from its place, in extents; 0 without points.
    pub point_error: f64,
    /// Farthest that the correction moved a vertex.
    pub max_displacement: f64,
    /// The same, in extents.
    pub max_displacement_relative: f64,
    /// Root mean square over the vertices.
    pub rms_displacement: f64,
    /// The same, in extents.
    pub rms_displacement_relative: f64,
}

impl CorrectionReport {
    /// Of a job with free volume.
    pub(crate) fn not_asked() -> Self {
        Self { method: "none".into(), objective: "none".into(), status: "not-asked".into(), ..Self::default() }
    }

    /// Of heights that were scaled from the vertices `before` to `after` (each #vertices × 3).
    pub(crate) fn of_heights(before: &[DVec3], after: &[DVec3], extent: f64) -> Self {
        let is_met = before == after;
        Self {
            method: "height".into(),
            objective: "none".into(),
            status: if is_met { "already-met" } else { "exact" }.into(),
            iterations: usize::from(!is_met),
            ..Self::default()
        }
        .moved(before, after, extent)
    }

    /// Of nodes that settled in `steps` from the posed vertices `before` to `after` (each #vertices × 3).
    pub(crate) fn of_springs(
        correction: &Correction,
        steps: usize,
        before: &[DVec3],
        after: &[DVec3],
        extent: f64,
    ) -> Self {
        Self {
            method: "elastic".into(),
            objective: "springs".into(),
            status: if before == after { "already-met" } else { "exact" }.into(),
            iterations: steps + correction.steps,
            point_error: correction.point_error,
            ..Self::default()
        }
        .moved(before, after, extent)
    }

    /// With the lengths of the ways from `before` to `after`.
    fn moved(self, before: &[DVec3], after: &[DVec3], extent: f64) -> Self {
        let squared = || before.iter().zip(after).map(|(a, b)| a.distance_squared(*b));
        let max_displacement = squared().fold(0.0, f64::max).sqrt();
        let rms_displacement = (squared().sum::<f64>() / before.len() as f64).sqrt();
        Self {
            max_displacement,
            max_displacement_relative: max_displacement / extent,
            rms_displacement,
            rms_displacement_relative: rms_displacement / extent,
            ..self
        }
    }

    /// Of a correction of the posed vertices `before` (#vertices × 3), less its objective.
    pub(crate) fn of(correction: &Correction, method: &Method, before: &[DVec3], extent: f64) -> Self {
        let method = match method {
            Method::Gradient => "gradient",
            Method::Nearest => "nearest",
            Method::Axes { .. } => "axes",
        };
        let status = match correction.status {
            Status::AlreadyMet => "already-met",
            Status::Exact => "exact",
            Status::NotNearest => "not-converged",
            Status::Preview => "preview",
        };
        Self {
            method: method.into(),
            objective: String::new(),
            status: status.into(),
            iterations: correction.steps,
            residual: correction.residual,
            point_error: correction.point_error,
            ..Self::default()
        }
        .moved(before, &correction.vertices, extent)
    }
}

/// Milliseconds by stage, in the order in which stages ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timings(pub Vec<(String, f64)>);

#[cfg(feature = "serde")]
impl serde::Serialize for Timings {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(stage, ms)| (stage, ms)))
    }
}

/// Times stages that follow one another.
pub struct Stopwatch {
    /// Where the platform has no clock (browsers), nothing is recorded.
    #[cfg(not(target_family = "wasm"))]
    since: std::time::Instant,
    timings: Timings,
}

impl Stopwatch {
    /// Starts now.
    #[must_use]
    pub fn start() -> Self {
        Self {
            #[cfg(not(target_family = "wasm"))]
            since: std::time::Instant::now(),
            timings: Timings::default(),
        }
    }

    /// Ends the stage that began at the start or at the last call.
    pub fn lap(&mut self, stage: &str) {
        #[cfg(not(target_family = "wasm"))]
        {
            let now = std::time::Instant::now();
            self.timings.0.push((stage.into(), (now - self.since).as_secs_f64() * 1e3));
            self.since = now;
        }
        #[cfg(target_family = "wasm")]
        let _ = stage;
    }

    /// What was recorded.
    #[must_use]
    pub fn timings(self) -> Timings {
        self.timings
    }
}
