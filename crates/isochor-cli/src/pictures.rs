//! What is drawn of deformations.

use std::path::{Path, PathBuf};

use isochor::{ColorBy, Faces, Mesh, Outcome, ViewRequest};
use isochor_view::{
    Coloring, PictureOptions, Show, ShownLattice, ShownPose, StripOptions, View, animated_png, frames, picture, strip,
};

use crate::failure::Failure;
use crate::files::Pending;
use crate::request::{Request, Requests};

/// Sides of a pose in pixels where the request names none. More: larger files; less: details are lost.
const OF_PICTURE: [u32; 2] = [520, 520];
const OF_STRIP: [u32; 2] = [280, 280];
const OF_ANIMATION: [u32; 2] = [400, 400];

/// Frames of a film in its strip at most. More: they are small; fewer: motion is lost.
const IN_STRIP: usize = 12;

/// Vertices of all frames together that are kept for its pictures at most: 1.2 GB of memory.
const KEPT: usize = 50_000_000;

/// Poses side by side, as PNG.
pub fn of_job(show: &Show, view: &ViewRequest) -> Vec<u8> {
    let options = options(view, OF_PICTURE);
    if view.color != ColorBy::Steps {
        return picture(show, &options).png();
    }
    let mut steps = show.clone();
    for (pose, pair) in steps.poses.iter_mut().skip(1).zip(show.poses.windows(2)) {
        if let [Some(before), Some(after)] = [&pair[0].volume_change, &pair[1].volume_change] {
            pose.volume_change = Some(of_step(before, after).into());
        }
    }
    picture(&steps, &options).png()
}

/// Local volume changes (#vertices) from one pose to the next, of those of both against rest: determinants multiply.
fn of_step(before: &[f64], after: &[f64]) -> Vec<f64> {
    before.iter().zip(after).map(|(before, after)| after / before).collect()
}

/// How pictures look whose poses have this size unless the request names one.
fn options(view: &ViewRequest, size: [u32; 2]) -> PictureOptions {
    let &ViewRequest { color, lattice, up, azimuth, elevation, size: named, .. } = view;
    PictureOptions {
        panel: named.unwrap_or(size).map(|side| side as usize),
        coloring: match color {
            ColorBy::Volume | ColorBy::Steps => Coloring::VolumeChange,
            ColorBy::Displacement => Coloring::Displacement,
            ColorBy::Plain => Coloring::Plain,
        },
        with_lattice: lattice,
        view: View { azimuth, elevation, up },
        ..PictureOptions::default()
    }
}

/// The frames of a film for its pictures, and where these go.
pub struct FilmPictures {
    pub strip: Option<PathBuf>,
    pub animation: Option<PathBuf>,
    frames: usize,
    /// Of the first frame.
    faces: Option<Faces>,
    poses: Vec<ShownPose<'static>>,
}

impl FilmPictures {
    /// The pictures that a film asks for by name, or those beside its models: `out-strip.png` and `out-film.png`.
    pub fn of(requests: &Requests) -> Result<Self, Failure> {
        let first = requests.frame(0)?;
        let output = requests.output()?.filter(|_| first.job.view.film);
        let beside = |named: &Option<PathBuf>, ending: &str| {
            named.clone().or_else(|| output.as_deref().map(|output| beside(output, ending)))
        };
        let (strip, animation) = (beside(&first.picture, "strip"), beside(&first.animation, "film"));
        if let (Some(path), true) = (&strip, strip == animation) {
            return Err(Failure::file(path, "the picture would overwrite the animation", "choose another name"));
        }
        Ok(Self { strip, animation, frames: requests.frames(), faces: None, poses: Vec::new() })
    }

    /// Keeps a frame, unless there are no pictures of it.
    pub fn keep(&mut self, time: f64, request: &Request, mesh: &Mesh, outcome: &Outcome) -> Result<(), Failure> {
        let Some(path) = self.strip.as_ref().or(self.animation.as_ref()) else { return Ok(()) };
        if mesh.points().len().saturating_mul(self.frames) > KEPT {
            let what = format!(
                "{} frames of {} vertices are more than pictures are drawn of",
                self.frames,
                mesh.points().len()
            );
            return Err(Failure::file(
                path,
                what,
                "write [view] film = false and name no picture, or take fewer frames",
            ));
        }
        self.faces.get_or_insert_with(|| mesh.faces().clone());
        let change = match request.job.view.color {
            ColorBy::Volume => outcome.course().map(|course| course.corrected_change.into()),
            ColorBy::Steps => {
                outcome.course().map(|course| of_step(&course.posed_change, &course.corrected_change).into())
            }
            ColorBy::Displacement | ColorBy::Plain => None,
        };
        let lattice = outcome.controls.as_ref().filter(|_| request.job.view.lattice);
        self.poses.push(ShownPose {
            name: format!("t = {time:.2}"),
            points: outcome.points.clone().into(),
            lattice: lattice.map(|controls| ShownLattice {
                size: controls.lattice.size(),
                controls: controls.posed.clone().into(),
            }),
            volume: outcome.report.volume.as_ref().map(|volume| volume.overall.corrected),
            volume_change: change,
        });
        Ok(())
    }

    /// Draws what was kept.
    pub fn draw(self, view: &ViewRequest, pending: &mut Pending) -> Result<(), Failure> {
        let Some(faces) = &self.faces else { return Ok(()) };
        let show = Show { faces, poses: self.poses };
        if let Some(path) = &self.strip {
            let shown = IN_STRIP.min(self.frames);
            let chosen = (0..shown).map(|k| k * (self.frames - 1) / (shown - 1).max(1)).collect();
            let options = StripOptions { picture: options(view, OF_STRIP), chosen: Some(chosen), columns: None };
            pending.add(path, &strip(&show, &options).png())?;
        }
        if let Some(path) = &self.animation {
            let images = frames(&show, &options(view, OF_ANIMATION));
            let png = animated_png(&images, view.milliseconds)
                .map_err(|error| Failure::file(path, error.to_string(), "choose other frames or another size"))?;
            pending.add(path, &png)?;
        }
        Ok(())
    }
}

/// `out.ply` → `out-ending.png`.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("-{ending}.png"));
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_what_it_adds_to_the_step_before() {
        // To a half and from there to the whole: doubled. Inside out both times: turned neither way. From nothing: no finite factor.
        let steps = of_step(&[0.5, 1.0, -2.0, 0.0, 0.0], &[1.0, 1.0, -1.0, 1.0, 0.0]);
        assert_eq!(steps[..4], [2.0, 1.0, 0.5, f64::INFINITY]);
        assert!(steps[4].is_nan());
        assert_eq!(of_step(&[], &[]), [0.0; 0]);
    }
}
