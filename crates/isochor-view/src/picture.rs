//! Pictures: poses side by side or in rows, with captions and a scale, all with one camera.

use std::borrow::Cow;
use std::ops::Range;

use glam::DVec3;
use isochor::{Bounds, NetDrawing, NetKind};

use crate::camera::{Camera, View};
use crate::color_scale::{ColorScale, Quantity};
use crate::image::{Image, Rgb};
use crate::legend::{Legend, NodeKey};
use crate::panel::{Panel, is_inside_out, plane_lines};
use crate::show::{Show, ShownLattice, ShownPose};
use crate::surface::Surface;
use crate::text::Lettering;
use crate::{number, parallel};

/// What colours say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coloring {
    /// Nothing.
    #[default]
    Plain,
    /// Local volume changes, where poses have them.
    VolumeChange,
    /// How far vertices are from where they are in the first pose, which stays plain.
    Displacement,
    /// Local stress, where poses have it.
    Stress,
}

impl Coloring {
    /// What is coloured; `None`: nothing.
    fn quantity(self) -> Option<Quantity> {
        match self {
            Self::Plain => None,
            Self::VolumeChange => Some(Quantity::VolumeChange),
            Self::Displacement => Some(Quantity::Displacement),
            Self::Stress => Some(Quantity::Stress),
        }
    }
}

/// How a picture looks.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureOptions {
    /// Width and height of a pose in pixels, without its caption. Rows that are empty in all poses are cut off, unless
    /// there is a `camera`.
    pub panel: [usize; 2],
    /// Colour of the page; captions are dark on light pages and light on dark ones.
    pub background: Rgb,
    /// What colours say.
    pub coloring: Coloring,
    /// Whether lattices are drawn.
    pub with_lattice: bool,
    /// From where the model is seen.
    pub view: View,
    /// The camera; `None`: the nearest one in direction of `view` that has all poses in its picture.
    pub camera: Option<Camera>,
    /// A line above the picture.
    pub title: Option<String>,
}

impl Default for PictureOptions {
    /// Panels of 520 × 520 pixels on white, plain, with lattices, from the front, without a title.
    fn default() -> Self {
        Self {
            panel: [520, 520],
            background: [255; 3],
            coloring: Coloring::default(),
            with_lattice: true,
            view: View::default(),
            camera: None,
            title: None,
        }
    }
}

/// Which poses a strip shows, and how.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StripOptions {
    /// As for pictures.
    pub picture: PictureOptions,
    /// Indices of the poses that are shown; `None`: all. Those that do not exist are left out.
    pub chosen: Option<Vec<usize>>,
    /// Panels in a row; `None`: as many as make it about twice as wide as high.
    pub columns: Option<usize>,
}

/// All poses side by side, each with its lattice and below it its name, its volume, and by how much that differs from
/// the volume of the first pose.
///
/// Points that are not finite are left out, with the faces and lines that end there. What would be beyond
/// [`MAX_SIDE`](crate::MAX_SIDE) pixels is cut off.
#[must_use]
pub fn picture(show: &Show, options: &PictureOptions) -> Image {
    let all: Vec<usize> = (0..show.poses.len()).collect();
    Scene::new(show, options).sheet(&all, all.len().max(1), &named)
}

/// Poses of a sequence in rows, numbered from 1, with their volumes.
#[must_use]
pub fn strip(show: &Show, options: &StripOptions) -> Image {
    let all = || (0..show.poses.len()).collect();
    let mut chosen: Vec<usize> = options.chosen.clone().unwrap_or_else(all);
    chosen.retain(|&pose| pose < show.poses.len());
    let about_twice = |n: usize| (1..=n).find(|columns| columns * columns >= 2 * n).unwrap_or(n);
    let columns = options.columns.unwrap_or_else(|| about_twice(chosen.len())).clamp(1, chosen.len().max(1));
    let numbered = |index: usize, pose: &ShownPose| match &pose.name[..] {
        "" => format!("{}", index + 1),
        name => format!("{} · {name}", index + 1),
    };
    Scene::new(show, &options.picture).sheet(&chosen, columns, &numbered)
}

/// Each pose as a picture of its own, all with one camera and one scale: frames of an animation, of equal size.
#[must_use]
pub fn frames(show: &Show, options: &PictureOptions) -> Vec<Image> {
    let scene = Scene::new(show, options);
    (0..show.poses.len()).map(|pose| scene.sheet(&[pose], 1, &named)).collect()
}

fn named(_index: usize, pose: &ShownPose) -> String {
    pose.name.clone()
}

/// Of the logarithms of volume changes, of displacements and of angles this part is within the scale. Larger: a few
/// folds at sharp corners take all colours; smaller: large changes look alike.
const WITHIN: f64 = 0.98;

/// Scales of volume changes end at one of these factors.
const FACTORS: [f64; 18] = [
    1.001,
    1.002,
    1.005,
    1.01,
    1.02,
    1.05,
    1.1,
    1.2,
    1.5,
    2.0,
    3.0,
    4.0,
    8.0,
    10.0,
    100.0,
    1000.0,
    10_000.0,
    1_000_000.0,
];

/// What all panels have in common.
struct Scene<'a> {
    show: &'a Show<'a>,
    options: &'a PictureOptions,
    surface: Surface,
    camera: Camera,
    is_inside_out: bool,
    scale: Option<ColorScale>,
    /// Whether some value has no place on the scale.
    with_no_value: bool,
    size: [usize; 2],
    /// Rows of pixels of a panel in which something is drawn in some pose.
    rows: Range<usize>,
}

impl<'a> Scene<'a> {
    fn new(show: &'a Show<'a>, options: &'a PictureOptions) -> Self {
        let size = options.panel.map(|side| side.clamp(1, MAX_PANEL));
        let vertices = show.poses.iter().map(|pose| pose.points.len()).min().unwrap_or(0);
        let rest = show.poses.first().map_or(&[][..], |pose| &pose.points[..]);
        let lattices = show.poses.iter().filter(|_| options.with_lattice).filter_map(|pose| pose.lattice.as_ref());
        let controls = lattices.clone().map(|lattice| &lattice.controls[..]);
        let planes: Vec<DVec3> = lattices.flat_map(plane_lines).flatten().collect();
        let posed = show.poses.iter().map(|pose| &pose.points[..]);
        let points: Vec<&[DVec3]> = posed.chain(controls).chain([&planes[..]]).collect();
        let framing = || Camera::framing(&points, &options.view, size.map(|side| side as f64));
        let (surface, camera) =
            parallel::both(|| Surface::new(show.faces, rest, vertices), || options.camera.unwrap_or_else(framing));
        let is_inside_out = is_inside_out(&surface, rest, &camera);
        let rows = if options.camera.is_some() { 0..size[1] } else { used_rows(&points, &camera, size) };
        let (scale, with_no_value) = (None, false);
        let mut scene = Self { show, options, surface, camera, is_inside_out, scale, with_no_value, size, rows };
        (scene.scale, scene.with_no_value) = scene.fitted_scale();
        scene
    }

    /// What is coloured of a pose: a value per vertex. `None` where it is plain.
    fn values(&self, pose: usize) -> Option<Vec<f64>> {
        let vertices = self.surface.vertices();
        let of_all = |values: &Option<Cow<[f64]>>| values.as_deref()?.get(..vertices).map(<[f64]>::to_vec);
        match self.options.coloring {
            Coloring::Plain => None,
            Coloring::VolumeChange => of_all(&self.show.poses[pose].volume_change),
            Coloring::Stress => of_all(&self.show.poses[pose].stress),
            Coloring::Displacement if pose == 0 => None,
            Coloring::Displacement => {
                let [rest, posed] = [0, pose].map(|pose| &self.show.poses[pose].points[..]);
                let finite: Vec<DVec3> = rest.iter().copied().filter(|p| p.is_finite()).collect();
                let extent = Bounds::of(&finite)?.extent();
                let extent = if extent > 0.0 { extent } else { 1.0 };
                Some(parallel::collect(vertices, |v| ((posed[v] - rest[v]) / extent).length()))
            }
        }
    }

    /// A scale for all poses, and whether a value has no place on it. `None` where nothing is coloured.
    fn fitted_scale(&self) -> (Option<ColorScale>, bool) {
        let Some(quantity) = self.options.coloring.quantity() else { return (None, false) };
        let (mut largest, mut with_no_value, mut is_colored) = (0.0f64, false, false);
        for values in (0..self.show.poses.len()).filter_map(|pose| self.values(pose)) {
            is_colored = true;
            let mut sizes = parallel::collect(values.len(), |v| quantity.even(values[v]).map_or(f64::NAN, f64::abs));
            sizes.retain(|size| size.is_finite());
            with_no_value |= sizes.len() < values.len();
            let within = ((sizes.len() as f64 * WITHIN) as usize).min(sizes.len().saturating_sub(1));
            if !sizes.is_empty() {
                largest = largest.max(*sizes.select_nth_unstable_by(within, f64::total_cmp).1);
            }
        }
        let scale = match quantity {
            Quantity::VolumeChange => {
                let factor = libm::exp(largest.min(1e3)) * (1.0 - 1e-9);
                let factor = FACTORS.into_iter().find(|f| *f >= factor).unwrap_or(FACTORS[FACTORS.len() - 1]);
                ColorScale::volume_change(factor)
            }
            Quantity::Displacement => ColorScale::displacement(largest),
            Quantity::Stress => ColorScale::stress(largest),
        };
        (is_colored.then_some(scale), with_no_value)
    }

    /// What is drawn of the lattice of a pose.
    fn lattice(&self, pose: usize) -> Option<&ShownLattice<'a>> {
        self.show.poses[pose].lattice.as_ref().filter(|_| self.options.with_lattice)
    }

    /// The picture of a pose, without words.
    fn panel(&self, pose: usize) -> Image {
        let points = &self.show.poses[pose].points;
        let values = self.values(pose);
        let places = self.scale.zip(values).map(|(scale, values)| {
            (parallel::collect(values.len(), |v| scale.place(values[v]).unwrap_or(f64::NAN)), scale)
        });
        let panel = Panel {
            surface: &self.surface,
            points,
            colored: places.as_ref().map(|(places, scale)| (&places[..], *scale)),
            lattice: self.lattice(pose),
            camera: &self.camera,
            size: self.size,
            rows: self.rows.clone(),
            background: self.options.background,
            is_inside_out: self.is_inside_out,
        };
        panel.image()
    }

    /// Poses in rows of `columns` panels.
    fn sheet(&self, poses: &[usize], columns: usize, name: &dyn Fn(usize, &ShownPose) -> String) -> Image {
        let page = Page::new(self.options, self.size);
        let rows = poses.len().div_ceil(columns).max(1);
        let [across, down] = [self.size[0] + page.gap, self.rows.len() + page.caption];
        let title = if self.options.title.is_some() { page.title } else { 0 };
        let is_keyed = |net: &NetDrawing| net.kind == NetKind::Springs || net.is_held.contains(&true);
        let nets = poses.iter().filter_map(|pose| self.lattice(*pose)?.net.as_deref());
        let has_key = nets.into_iter().any(is_keyed);
        let key = if has_key { page.key } else { 0 };
        let legend = if self.scale.is_some() { page.legend } else { 0 };
        let width = 2 * page.margin + columns * across - page.gap;
        let height = 2 * page.margin + title + rows * down + key + legend;
        let mut image = Image::filled(width, height, self.options.background);
        let middle = width as f32 / 2.0;
        if let Some(title) = &self.options.title {
            let room = (width - page.margin) as f32;
            page.heading.write_centered(&mut image, title, [middle, page.margin as f32], room);
        }
        let first = self.show.poses.first().and_then(|pose| pose.volume);
        for (place, &index) in poses.iter().enumerate() {
            let pose = &self.show.poses[index];
            let (x, y) = (page.margin + place % columns * across, page.margin + title + place / columns * down);
            image.put(&self.panel(index), x, y);
            let middle = x as f32 + self.size[0] as f32 / 2.0;
            let mut below = (y + self.rows.len()) as f32 + page.plain.height * 0.2;
            page.name.write_centered(&mut image, &name(index, pose), [middle, below], self.size[0] as f32);
            below += page.name.height;
            let volume = volume_text(pose.volume, first.filter(|_| index > 0));
            page.plain.write_centered(&mut image, &volume, [middle, below], self.size[0] as f32);
        }
        let below = page.margin + title + rows * down;
        if has_key {
            NodeKey { lettering: page.plain }.draw(&mut image, [middle, below as f32]);
        }
        if let Some(scale) = &self.scale {
            let legend =
                Legend { scale, lettering: page.plain, with_no_value: self.with_no_value, frame: page.plain.color };
            legend.draw(&mut image, [middle, (below + key) as f32], page.bar.min(width as f32 * 0.7));
        }
        image
    }
}

/// The rows of a panel in which points appear, with a border; all of them where there are no points.
fn used_rows(points: &[&[DVec3]], camera: &Camera, size: [usize; 2]) -> Range<usize> {
    let [width, height] = size.map(|side| side as f64);
    let least = [f64::INFINITY, f64::NEG_INFINITY];
    let both = |[low, high]: [f64; 2], [l, h]: [f64; 2]| [low.min(l), high.max(h)];
    let of_list = |points: &&[DVec3]| {
        parallel::map_chunks(points.len(), parallel::CHUNK, |range| {
            let rows = points[range].iter().filter_map(|p| camera.projected(*p, [width, height])).map(|[_, y]| [y, y]);
            rows.fold(least, both)
        })
    };
    let [top, bottom] = points.iter().flat_map(of_list).fold(least, both);
    if top > bottom {
        return 0..size[1];
    }
    let border = BORDER * width.min(height);
    let middle = (top + bottom) / 2.0;
    let half = ((bottom - top) / 2.0 + border).max(LOWEST * height / 2.0);
    let row = |y: f64| y.clamp(0.0, height) as usize;
    let first = row((middle - half).floor()).min(size[1] - 1);
    first..row((middle + half).ceil()).max(first + 1)
}

/// What is kept free above and below the points, relative to the shorter side of a panel. Larger: empty paper; smaller:
/// captions touch the model.
const BORDER: f64 = 0.025;

/// Panels keep at least this part of their height. Larger: empty paper round flat models; smaller: pictures like
/// ribbons.
const LOWEST: f64 = 0.25;

/// The volume of a pose, and its change: "V = 0.04175   −39.16 %".
fn volume_text(volume: Option<f64>, first: Option<f64>) -> String {
    let Some(volume) = volume else { return String::new() };
    let change = first.and_then(|first| number::change(volume, first));
    let text = format!("V = {}", number::short(volume));
    change.map_or(text.clone(), |change| format!("{text}   {change}"))
}

/// Sizes of all that is not the model, in pixels.
struct Page {
    margin: usize,
    gap: usize,
    title: usize,
    caption: usize,
    key: usize,
    legend: usize,
    bar: f32,
    heading: Lettering,
    name: Lettering,
    plain: Lettering,
}

impl Page {
    fn new(options: &PictureOptions, size: [usize; 2]) -> Self {
        // Text grows with the panels, but it is always large enough to read.
        let em = (size[0].min(size[1]) as f32 / 26.0).max(13.0);
        let [r, g, b] = options.background.map(f32::from);
        let is_light = 0.3 * r + 0.59 * g + 0.11 * b > 127.0;
        let (strong, quiet) = if is_light { ([24, 28, 36], [74, 80, 92]) } else { ([240; 3], [190, 194, 202]) };
        let lettering =
            |height: f32, is_bold: bool, color: Rgb| Lettering { height: (height * em).round(), is_bold, color };
        let plain = lettering(1.0, false, quiet);
        let pixels = |ems: f32| (ems * em).round() as usize;
        Self {
            margin: pixels(0.8),
            gap: pixels(0.8),
            title: pixels(2.0),
            caption: pixels(2.8),
            key: NodeKey::height(&plain).round() as usize,
            legend: pixels(0.4) + Legend::height(&plain).round() as usize,
            bar: 22.0 * em,
            heading: lettering(1.4, true, strong),
            name: lettering(1.1, true, strong),
            plain,
        }
    }
}

/// The longest side of a panel in pixels. Larger: memory for samples of a band; smaller: posters are coarse.
const MAX_PANEL: usize = 8192;
