//! What is drawn of deformations.

use std::path::{Path, PathBuf};

use isochor::{ColorBy, Faces, Mesh, Outcome, ViewRequest, stress_angles};
use isochor_view::{
    Coloring, MAX_SIDE, PictureOptions, Show, ShownLattice, ShownPose, StripOptions, View, animated_png, frames,
    picture, strip,
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

/// Vertices of all frames together that are kept for its pictures at most. More: memory, 1.6 GB with what colours say; fewer: films
/// of scanned models have no pictures.
const KEPT: usize = 50_000_000;

/// Pixels of all frames together in one of its pictures at most. More: memory, 1.2 GB; fewer: long films have no animation.
const DRAWN: usize = 400_000_000;

/// Poses of a job side by side, as PNG.
pub fn of_job(show: &Show, outcome: &Outcome, view: &ViewRequest) -> Vec<u8> {
    let options = options(view, OF_PICTURE);
    match view.color {
        ColorBy::Volume | ColorBy::Displacement | ColorBy::Plain => picture(show, &options).png(),
        ColorBy::Steps => picture(&in_steps(show), &options).png(),
        ColorBy::Stress => picture(&show.clone().with_stress(outcome), &options).png(),
    }
}

/// With local volume changes from each pose to the next.
fn in_steps<'a>(show: &Show<'a>) -> Show<'a> {
    let mut steps = show.clone();
    for (pose, pair) in steps.poses.iter_mut().skip(1).zip(show.poses.windows(2)) {
        if let [Some(before), Some(after)] = [&pair[0].volume_change, &pair[1].volume_change] {
            pose.volume_change = Some(of_step(before, after).into());
        }
    }
    steps
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
            ColorBy::Stress => Coloring::Stress,
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
    /// The pictures of a film, before there is any frame.
    pub fn of(requests: &Requests) -> Result<Self, Failure> {
        let Request { job, picture: strip, animation, .. } = requests.frame(0)?;
        let frames = requests.frames();
        if let Some(path) = &animation {
            check_pixels(path, frames, options(&job.view, OF_ANIMATION).panel)?;
        }
        if let Some(path) = &strip {
            check_pixels(path, frames.min(IN_STRIP), options(&job.view, OF_STRIP).panel)?;
        }
        Ok(Self { strip, animation, frames, faces: None, poses: Vec::new() })
    }

    /// Keeps a frame, unless there are no pictures of it.
    pub fn keep(&mut self, time: f64, request: &Request, mesh: &Mesh, outcome: &Outcome) -> Result<(), Failure> {
        let Some(path) = self.strip.as_ref().or(self.animation.as_ref()) else { return Ok(()) };
        check_vertices(path, self.frames, mesh.points().len())?;
        let faces = outcome.divided().map_or(mesh.faces(), |(mesh, _)| mesh.faces());
        if self.faces.get_or_insert_with(|| faces.clone()) != faces {
            let what = "the frames have different faces, since the model is divided otherwise in each";
            return Err(Failure::file(
                path,
                what,
                "write [surface] refine = \"off\", or [view] film = false and name no picture",
            ));
        }
        let color = request.job.view.color;
        let change = match color {
            ColorBy::Volume => outcome.course().map(|course| course.corrected_change.into()),
            ColorBy::Steps => {
                outcome.course().map(|course| of_step(&course.posed_change, &course.corrected_change).into())
            }
            ColorBy::Displacement | ColorBy::Stress | ColorBy::Plain => None,
        };
        let jacobians = if color == ColorBy::Stress { outcome.jacobians() } else { None };
        let of_surface = || outcome.sheet().map(|drawing| ShownLattice::of_surface(drawing.sheet()));
        let lattice = ShownLattice::of_outcome(outcome).or_else(of_surface);
        self.poses.push(ShownPose {
            name: format!("t = {time:.2}"),
            points: outcome.points.clone().into(),
            lattice: lattice.filter(|_| request.job.view.lattice),
            volume: outcome.report.volume.as_ref().map(|volume| volume.overall.corrected),
            volume_change: change,
            stress: jacobians.map(|jacobians| stress_angles(&jacobians).into()),
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
            let picture = options(view, OF_STRIP);
            let columns = fitting_columns(picture.panel[0]);
            let options = StripOptions { picture, chosen: Some(chosen), columns };
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

/// Panels of this width in a row of a strip, where the usual five would be wider than an image can be.
fn fitting_columns(width: usize) -> Option<usize> {
    // With the gaps between them: a thirtieth of a wide panel each, and two at the ends.
    let fitting = MAX_SIDE / (width + width / 16);
    (fitting < 5).then_some(fitting)
}

/// Refuses pictures of more vertices than are kept.
fn check_vertices(path: &Path, frames: usize, vertices: usize) -> Result<(), Failure> {
    if vertices.saturating_mul(frames) <= KEPT {
        return Ok(());
    }
    let what = format!("{frames} frames of {vertices} vertices are more than pictures are drawn of");
    Err(Failure::file(path, what, "write [view] film = false and name no picture, or take fewer frames"))
}

/// Refuses pictures of more pixels than are drawn.
fn check_pixels(path: &Path, frames: usize, [width, height]: [usize; 2]) -> Result<(), Failure> {
    if width.saturating_mul(height).saturating_mul(frames) <= DRAWN {
        return Ok(());
    }
    let what = format!("{frames} frames of {width} × {height} pixels are more than are drawn in one picture");
    let hint = "choose a smaller [view] size, take fewer frames, or write [view] film = false and name no picture";
    Err(Failure::file(path, what, hint))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_vertices_than_are_kept_are_refused_by_number() {
        let path = Path::new("out-strip.png");
        for (frames, vertices) in [(2, KEPT / 2), (KEPT, 1), (10_000, 0)] {
            assert!(check_vertices(path, frames, vertices).is_ok(), "{frames} × {vertices}");
        }
        for (frames, vertices) in [(2, KEPT / 2 + 1), (KEPT, 2), (usize::MAX, usize::MAX)] {
            let failure = check_vertices(path, frames, vertices).unwrap_err();
            assert_eq!((failure.exit, &failure.place[..]), (2, "out-strip.png"));
            assert!(failure.what.starts_with(&format!("{frames} frames of {vertices} vertices")), "{}", failure.what);
        }
    }

    #[test]
    fn more_pixels_than_are_drawn_are_refused_by_number() {
        let path = Path::new("out-film.png");
        assert!(check_pixels(path, 1000, OF_ANIMATION.map(|side| side as usize)).is_ok());
        assert!(check_pixels(path, DRAWN, [1, 1]).is_ok());
        for (frames, size) in [(DRAWN + 1, [1, 1]), (36, [8192, 8192]), (usize::MAX, [2, 2])] {
            let failure = check_pixels(path, frames, size).unwrap_err();
            assert_eq!((failure.exit, &failure.place[..]), (2, "out-film.png"));
            let [width, height] = size;
            let expected = format!("{frames} frames of {width} × {height} pixels");
            assert!(failure.what.starts_with(&expected), "{}", failure.what);
        }
    }

    #[test]
    fn a_step_is_what_it_adds_to_the_step_before() {
        // To a half and from there to the whole: doubled. Inside out both times: turned neither way. From nothing: no finite factor.
        let steps = of_step(&[0.5, 1.0, -2.0, 0.0, 0.0], &[1.0, 1.0, -1.0, 1.0, 0.0]);
        assert_eq!(steps[..4], [2.0, 1.0, 0.5, f64::INFINITY]);
        assert!(steps[4].is_nan());
        assert_eq!(of_step(&[], &[]), [0.0; 0]);
    }
}
