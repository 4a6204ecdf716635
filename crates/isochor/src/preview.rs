//! An approximate correction that costs what a coarse mesh costs.
//!
//! The same correction, of the body with fewer triangles ([`Solid::coarse`]) and with the rows of W of the vertices that these
//! name: gradients and Hessians are sums over the coarse mesh only. The displacement δ is then applied to all vertices. HB,
//! section 8: "create a coarse approximation of the model and apply the method to this approximation".
//!
//! The coarse body has another volume, V_c instead of V. What it is to reach is
//!
//! ```text
//! V_ref · V_c(X) / V(X)
//! ```
//!
//! for the pose X, at the cost of one fine volume. The error is then what the *correction* changes in V_c / V: nothing if it scales the body,
//! and else about the part of the volume that it changes times the part that lies between both surfaces. To take the volumes at
//! rest instead, V_c(P⁰) / V(P⁰), would add what the whole *deformation* has changed in this ratio; to add the deficit, V_c(X) +
//! (V_ref − V(X)), is exact only if the correction leaves the layer between the surfaces alone, and was 2 to 10 times
//! worse on all models that were measured. It is what remains where V(X) is so near 0 that there is no ratio, and where several
//! volumes are wanted, whose sums must agree.
//!
//! Points and pins hold exactly: they are conditions on the controls.
//!
//! HB = S. Hahmann, G.-P. Bonneau, S. Barbier, G. Elber, H. Hagen, *Volume-preserving FFD for programmable graphics
//! hardware*, The Visual Computer 28 (2012).

use glam::DVec3;

use crate::binding::Binding;
use crate::correct::{CorrectError, CorrectOptions, Correction, Pose, Reason, Status, Wanted, correct};
use crate::goals::VolumeGoal;
use crate::volume::Solid;

/// A coarse body with its binding, made once for all poses of a body.
#[derive(Clone, Debug)]
pub struct Preview {
    /// Over `vertices` alone.
    solid: Solid,
    binding: Binding,
    /// Which vertices of the fine body it has.
    vertices: Vec<u32>,
    /// How many the fine body has.
    of: usize,
}

impl Preview {
    /// A preview with about `triangles` triangles, those that look most like `pose` (rest, or any other).
    ///
    /// # Errors
    ///
    /// Arrays that do not fit together.
    pub fn new(pose: &Pose, triangles: usize) -> Result<Self, CorrectError> {
        let of = pose.solid.vertex_count();
        check_lengths(pose, of)?;
        let (solid, vertices) = pose.solid.coarse(pose.vertices, triangles).compacted();
        Ok(Self { solid, binding: pose.binding.rows_of(&vertices), vertices, of })
    }

    /// Number of triangles in place of all.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        self.solid.triangle_count()
    }

    /// Corrects `pose` as [`correct`] does, but on the coarse body. `pose` is of the solid and the binding that the preview was made of.
    ///
    /// All volumes and the relative error of the result are those of the fine body; its status is [`Status::Preview`] where anything
    /// moved. The residual is that of the coarse body.
    ///
    /// # Errors
    ///
    /// As [`correct`]; what is impossible is found on the coarse body.
    pub fn correct(&self, pose: &Pose, wanted: &Wanted, options: &CorrectOptions) -> Result<Correction, CorrectError> {
        check_lengths(pose, self.of)?;
        check_length("the binding's controls", pose.binding.control_count(), self.binding.control_count())?;
        let &Pose { solid, vertices, binding } = pose;
        if let Some(vertex) = vertices.iter().position(|p| !p.is_finite()) {
            return Err(CorrectError::NotFinite { vertex, position: vertices[vertex] });
        }
        if let Some([a, b]) = solid.torn_vertices(vertices) {
            return Err(CorrectError::Torn { a, b });
        }
        let few: Vec<DVec3> = self.vertices.iter().map(|v| vertices[*v as usize]).collect();
        let coarse = Pose { solid: &self.solid, vertices: &few, binding: &self.binding };
        let (before, coarse_before) = (solid.volumes(vertices), self.solid.volumes(&few));
        let relation = |goal: &VolumeGoal| match wanted.volumes.len() {
            1 => Relation::between(goal.of(&before), goal.of(&coarse_before)),
            _ => Relation { factor: 1.0, term: goal.of(&coarse_before) - goal.of(&before) },
        };
        let mut of_coarse = wanted.clone();
        for (index, goal) in of_coarse.volumes.iter_mut().enumerate() {
            if !goal.volume.is_finite() || goal.volume == 0.0 {
                return Err(CorrectError::Target { target: goal.volume });
            }
            let components = self.solid.component_count();
            goal.is_of(components).map_err(|component| CorrectError::MissingComponent {
                goal: index,
                component,
                components,
            })?;
            goal.volume = relation(goal).coarse(goal.volume);
        }
        let corrected = correct(&coarse, &of_coarse, options).map_err(|mut error| {
            if let CorrectError::Impossible { goal: Some(goal), target, volume, reason } = &mut error {
                let goal = &wanted.volumes[*goal];
                (*target, *volume) = (goal.volume, goal.of(&before));
                if let Reason::Turns { limit: of_coarse } | Reason::Follows { follows: of_coarse } = reason {
                    *of_coarse = relation(goal).fine(*of_coarse);
                }
            }
            error
        })?;

        let has_moved = corrected.status != Status::AlreadyMet;
        let moved = if has_moved { binding.displaced(vertices, &corrected.displacement) } else { vertices.to_vec() };
        let volumes = solid.volumes(&moved);
        let error = |goal: &VolumeGoal| ((goal.of(&volumes) - goal.volume) / goal.volume).abs();
        let errors: Vec<f64> = wanted.volumes.iter().map(error).collect();
        if let Some(goal) = errors.iter().position(|error| !error.is_finite()) {
            let (target, volume) = (wanted.volumes[goal].volume, wanted.volumes[goal].of(&before));
            return Err(CorrectError::Impossible { goal: Some(goal), target, volume, reason: Reason::Overflow });
        }
        let relative_error = errors.into_iter().fold(0.0, f64::max);
        let status = match corrected.status {
            Status::Exact => Status::Preview,
            other => other,
        };
        Ok(Correction {
            vertices: moved,
            volume_before: before.total,
            volume: volumes.total,
            component_volumes: volumes.components,
            relative_error,
            status,
            ..corrected
        })
    }
}

fn check_lengths(pose: &Pose, vertices: usize) -> Result<(), CorrectError> {
    check_length("the solid", pose.solid.vertex_count(), vertices)?;
    check_length("the posed vertices", pose.vertices.len(), vertices)?;
    check_length("the binding", pose.binding.vertex_count(), vertices)
}

fn check_length(what: &'static str, found: usize, expected: usize) -> Result<(), CorrectError> {
    if found == expected { Ok(()) } else { Err(CorrectError::Length { what, found, expected }) }
}

/// How coarse volumes follow fine ones: `coarse = factor · fine + term`.
struct Relation {
    factor: f64,
    term: f64,
}

impl Relation {
    /// Of a pose with these volumes.
    fn between(fine: f64, coarse: f64) -> Self {
        /// Wider: a pose that encloses next to nothing is scaled by a ratio of roundings; narrower: rough previews lose accuracy.
        const RATIOS: std::ops::RangeInclusive<f64> = 0.5..=2.0;
        match coarse / fine {
            factor if RATIOS.contains(&factor) => Self { factor, term: 0.0 },
            _ => Self { factor: 1.0, term: coarse - fine },
        }
    }

    fn coarse(&self, fine: f64) -> f64 {
        self.factor * fine + self.term
    }

    fn fine(&self, coarse: f64) -> f64 {
        (coarse - self.term) / self.factor
    }
}
