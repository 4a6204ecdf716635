//! From the command line to checked requests: a job, or one for each frame of a film, whose files are named and do not collide.

use std::path::{Path, PathBuf};

use isochor::{
    Axis, BasisKind, ColorBy, Directions, Film, Job, JobTextError, KnotRule, Knots, LatticeRequest, MethodKind,
    MobilityKind, Objective, OpenBoundaries, Outside, Precision, Preserve, ViewRequest, VolumeTarget,
};
use isochor_io::Format;

use crate::args::{
    BasisArg, ColorArg, DeformArgs, KnotsArg, MethodArg, MobilityArg, ObjectiveArg, OpenArg, OutsideArg, PrecisionArg,
    UpArg,
};
use crate::failure::Failure;
use crate::model::Model;
use crate::{files, flags};

/// A job with its files.
#[derive(Debug)]
pub struct Request {
    pub job: Job,
    pub model: Model,
    pub output: PathBuf,
    pub output_format: Format,
    pub lattice_file: Option<PathBuf>,
    pub surface_file: Option<PathBuf>,
    pub report: Option<PathBuf>,
    pub save_controls: Option<PathBuf>,
    pub picture: Option<PathBuf>,
    pub animation: Option<PathBuf>,
    /// The surface as a mesh, and the format of that.
    pub save_surface: Option<(PathBuf, Format)>,
    /// The picture of the flattened sheet.
    pub sheet: Option<PathBuf>,
}

/// What was asked for: a single request, or one for each frame.
pub struct Requests<'a> {
    args: &'a DeformArgs,
    /// `None`: there is no job file.
    film: Option<Film>,
}

impl<'a> Requests<'a> {
    /// The requests that the flags and the job file make; flags win.
    pub fn from_args(args: &'a DeformArgs) -> Result<Self, Failure> {
        let film = args.job.as_deref().map(film_file).transpose()?;
        if args.in_place && film.as_ref().is_some_and(|film| film.frames() > 1) {
            let what = "a film has many models, which cannot all replace the one it begins with";
            return Err(Failure::usage("--in-place", what, "name the output with -o FILE"));
        }
        Ok(Self { args, film })
    }

    /// How many there are; 1 unless the job is a film.
    pub fn frames(&self) -> usize {
        self.film.as_ref().map_or(1, Film::frames)
    }

    /// When `frame` is, from 0 to 1.
    pub fn time(&self, frame: usize) -> f64 {
        self.film.as_ref().map_or(0.0, |film| film.time(frame))
    }

    /// What was asked for, as it was given: the text of the job file, the command line, or both where flags change the job.
    pub fn text(&self) -> Result<String, Failure> {
        let words = std::env::args_os().skip(1).map(|word| quoted(&word.to_string_lossy()));
        let line = || std::iter::once("isochor".to_owned()).chain(words).collect::<Vec<_>>().join(" ");
        let Some(path) = &self.args.job else { return Ok(line()) };
        let text = files::text(path)?;
        let is_changed = self.args.in_place || self.file_job(0)? != self.job(0)?;
        Ok(if is_changed { format!("{}\n\n{text}", line()) } else { text })
    }

    /// The request of `frame`. In a film, outputs have numbers, and pictures that are not named are beside them.
    pub fn frame(&self, frame: usize) -> Result<Request, Failure> {
        let mut job = self.job(frame)?;
        if self.frames() == 1 {
            if let Some(path) = &job.animation {
                let what = "only a film can be animated: the job has a single frame";
                return Err(Failure::file(path, what, "add frames = 36 to the job file, or draw a picture"));
            }
        } else {
            if let Some(path) = job.report.as_ref().filter(|path| has_extension(path, "html")) {
                let what = "a film is reported as JSON";
                return Err(Failure::file(path, what, "choose a name that ends in .json"));
            }
            if let Some(output) = job.output.as_ref().filter(|_| job.view.film) {
                job.picture.get_or_insert_with(|| beside(output, "strip"));
                job.animation.get_or_insert_with(|| beside(output, "film"));
            }
            let name = |path: &mut PathBuf| *path = numbered(path, frame + 1, self.frames());
            let of_surface = job.surface.iter_mut().flat_map(|surface| [&mut surface.save, &mut surface.sheet]);
            if let Some(cage) = job.cage.as_mut().filter(|_| frame > 0) {
                cage.save_weights = None; // all frames have the same
            }
            [&mut job.output, &mut job.save_controls].into_iter().chain(of_surface).flatten().for_each(name);
        }
        Request::from_job(job, self.args.job.as_deref(), self.args.in_place)
    }

    /// The job of `frame`, as the file and the flags say.
    fn job(&self, frame: usize) -> Result<Job, Failure> {
        let mut job = self.file_job(frame)?;
        apply_flags(&mut job, self.args)?;
        Ok(job)
    }

    /// The job of `frame`, as the file says.
    fn file_job(&self, frame: usize) -> Result<Job, Failure> {
        let (Some(film), Some(path)) = (&self.film, &self.args.job) else { return Ok(Job::default()) };
        let job = film.job(frame).map_err(|error: JobTextError| Failure::job_text(path, &error))?;
        Ok(in_working_folder(job, path))
    }
}

/// The path with a number, from 1, before its extension: `out-0001.ply`. Films of up to 9999 frames have four digits.
fn numbered(path: &Path, number: usize, of: usize) -> PathBuf {
    let digits = of.to_string().len().max(4);
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("-{number:0digits$}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// `out.ply` → `out-ending.png`.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("-{ending}.png"));
    path.with_file_name(name)
}

/// A word as it is typed: in quotes where it would be several.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| !c.is_whitespace() && !"'\"\\$&|;<>()*?#`".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

impl Request {
    /// The request of a job whose paths are relative to the working folder, read from `job_file` if from any.
    pub fn from_job(job: Job, job_file: Option<&Path>, in_place: bool) -> Result<Self, Failure> {
        let missing = |what: &str, hint: &str| Failure::usage("command line", format!("{what} is missing"), hint);
        let path = job.model.as_deref();
        let path = path.ok_or_else(|| missing("the model", "name it: isochor deform MODEL -o OUT"))?;
        let model = Model::named(path)?;
        let output = match (&model, in_place) {
            (_, false) => job.output.clone(),
            (Model::File { path, .. }, true) => Some(path.clone()),
            (Model::Shape(_), true) => {
                let what = "a built-in shape has no file that could be replaced";
                return Err(Failure::usage("--in-place", what, "name the output with -o FILE"));
            }
        };
        let output = output
            .ok_or_else(|| missing("the output", "name it with -o FILE, or replace the model with --in-place"))?;
        let (report, save_controls) = (job.report.clone(), job.save_controls.clone());
        let lattice_file = job.lattice.as_ref().and_then(|lattice| lattice.file.clone());
        let output_format = Format::from_path(&output).map_err(|error| Failure::read(&output, &error))?;
        let (picture, animation) = (job.picture.clone(), job.animation.clone());
        let surface_file = job.surface.as_ref().and_then(|surface| surface.file.clone());
        let sheet = job.surface.as_ref().and_then(|surface| surface.sheet.clone());
        let save_surface = job.surface.as_ref().and_then(|surface| surface.save.clone());
        let format_of = |path: PathBuf| match Format::from_path(&path) {
            Ok(format) => Ok((path, format)),
            Err(error) => Err(Failure::read(&path, &error)),
        };
        let save_surface = save_surface.map(format_of).transpose()?;
        let request = Self {
            job,
            model,
            output,
            output_format,
            lattice_file,
            surface_file,
            report,
            save_controls,
            picture,
            animation,
            save_surface,
            sheet,
        };
        request.check_view()?;
        request.check_paths(job_file, in_place)?;
        Ok(request)
    }

    /// Numbers of the view are those of a picture.
    fn check_view(&self) -> Result<(), Failure> {
        let ViewRequest { azimuth, elevation, size, milliseconds, .. } = self.job.view;
        let refused = |key: &str, what: String, hint: &str| Err(Failure::usage(format!("view.{key}"), what, hint));
        if !azimuth.is_finite() {
            return refused("azimuth", format!("it is {azimuth}"), "give it in degrees, such as -60");
        }
        if !(-90.0..=90.0).contains(&elevation) {
            return refused("elevation", format!("it is {elevation}"), "give it in degrees, from -90 to 90");
        }
        let sides = SMALLEST_PANEL..=LARGEST_PANEL;
        if let Some(size) = size.filter(|size| !size.iter().all(|side| sides.contains(side))) {
            let what = format!("it is {} × {} pixels", size[0], size[1]);
            return refused("size", what, &format!("sides are from {SMALLEST_PANEL} to {LARGEST_PANEL} pixels"));
        }
        if milliseconds == 0 {
            return refused("milliseconds", "it is 0".into(), "show each frame for a while, such as 80");
        }
        Ok(())
    }

    /// Inputs are never overwritten, outputs never one another.
    fn check_paths(&self, job_file: Option<&Path>, in_place: bool) -> Result<(), Failure> {
        // A lattice is saved in a format of its own, a cage as a mesh.
        let controls = if self.job.cage.is_some() { &["obj", "ply", "stl"][..] } else { &["json"] };
        let outputs = [
            ("the report", &self.report, &["json", "html"][..]),
            ("save-controls", &self.save_controls, controls),
            ("the picture", &self.picture, &["png"]),
            ("the animation", &self.animation, &["png"]),
            ("the sheet", &self.sheet, &["svg"]),
        ];
        for (what, path, extensions) in outputs {
            let Some(path) = path else { continue };
            if !extensions.iter().any(|extension| has_extension(path, extension)) {
                let names = extensions.iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(" or ");
                let what =
                    format!("{what} is written as {}", names.replace('.', "").to_uppercase().replace("OR", "or"));
                return Err(Failure::file(path, what, format!("choose a name that ends in {names}")));
            }
        }
        let mut taken: Vec<(&str, &Path)> = Vec::new();
        if let Model::File { path, .. } = &self.model {
            taken.push(("the model", path));
        }
        taken.extend(job_file.map(|path| ("the job file", path)));
        taken.extend(self.lattice_file.as_deref().map(|path| ("the lattice file", path)));
        taken.extend(self.surface_file.as_deref().map(|path| ("the surface file", path)));
        if let Some(cage) = &self.job.cage {
            let files = [("the cage", &cage.file), ("the posed cage", &cage.posed), ("the weights", &cage.weights)];
            taken.extend(files.into_iter().filter_map(|(what, path)| Some((what, path.as_deref()?))));
        }
        let written = [("the output", Some(self.output.as_path()).filter(|_| !in_place))]
            .into_iter()
            .chain([("the surface", self.save_surface.as_ref().map(|(path, _)| path.as_path()))])
            .chain([("the saved coordinates", self.job.cage.as_ref().and_then(|cage| cage.save_weights.as_deref()))])
            .chain(outputs.map(|(what, path, _)| (what, path.as_deref())));
        for (what, path) in written {
            let Some(path) = path else { continue };
            if let Some((other, _)) = taken.iter().find(|(_, taken)| files::are_same(taken, path)) {
                let hint = match *other {
                    "the model" => "choose another name, or say --in-place to replace the model",
                    _ => "choose another name",
                };
                return Err(Failure::file(path, format!("{what} would overwrite {other}"), hint));
            }
            taken.push((what, path));
        }
        Ok(())
    }
}

/// Sides of a pose in a picture, in pixels. Less: captions do not fit; more: memory.
const SMALLEST_PANEL: u32 = 64;
const LARGEST_PANEL: u32 = 8192;

/// Whether a file's name ends so, in capitals or not.
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// Reads a job file.
fn film_file(path: &Path) -> Result<Film, Failure> {
    let text = files::text(path)?;
    let parse: fn(&str) -> _ = match path.extension().and_then(|e| e.to_str()) {
        Some("toml") => Film::from_toml,
        Some("json") => Film::from_json,
        _ => return Err(Failure::file(path, "this is no job file by its name", "job files end in .toml or .json")),
    };
    parse(&text).map_err(|error| Failure::job_text(path, &error))
}

/// The job with paths relative to the working folder, read from `job_file`, to whose folder they were relative.
fn in_working_folder(mut job: Job, job_file: &Path) -> Job {
    let folder = job_file.parent().unwrap_or(Path::new(""));
    if let Some(model) = &mut job.model {
        let path = folder.join(&*model);
        if !Model::is_shape(model) || path.exists() {
            *model = path;
        }
    }
    let lattice_file = job.lattice.as_mut().and_then(|lattice| lattice.file.as_mut());
    let outputs = [&mut job.output, &mut job.report, &mut job.save_controls, &mut job.picture, &mut job.animation];
    let of_surface =
        job.surface.iter_mut().flat_map(|surface| [&mut surface.file, &mut surface.save, &mut surface.sheet]);
    let of_cage = job.cage.iter_mut().flat_map(|cage| {
        [&mut cage.file, &mut cage.posed, &mut cage.weights, &mut cage.save_weights].map(Option::as_mut)
    });
    let paths = outputs
        .map(Option::as_mut)
        .into_iter()
        .chain([lattice_file])
        .chain(of_surface.map(Option::as_mut))
        .chain(of_cage);
    for path in paths.flatten() {
        *path = folder.join(&*path);
    }
    job
}

/// Chooses a method in all directions.
fn only(preserve: &mut Preserve, method: MethodKind) {
    (preserve.method, preserve.axes, preserve.shares) = (Some(method), None, None);
}

/// Puts what flags say over what the job says; edits are appended.
fn apply_flags(job: &mut Job, args: &DeformArgs) -> Result<(), Failure> {
    let set = |slot: &mut Option<PathBuf>, flag: &Option<PathBuf>| {
        if flag.is_some() {
            slot.clone_from(flag);
        }
    };
    set(&mut job.model, &args.model);
    set(&mut job.output, &args.output);
    set(&mut job.report, &args.report);
    set(&mut job.save_controls, &args.save_controls);
    set(&mut job.picture, &args.picture);
    set(&mut job.animation, &args.animation);
    match args.precision {
        Some(PrecisionArg::File) => job.precision = Precision::File,
        Some(PrecisionArg::F64) => job.precision = Precision::F64,
        None => {}
    }
    job.portable_bits |= args.portable_bits;
    apply_view_flags(job, args)?;
    apply_surface_flags(job, args)?;
    apply_lattice_flags(job, args)?;
    if let Some(text) = &args.cage {
        flags::cage(text, &mut job.cage)?;
    }
    for (flag, text) in &args.edits_in_order {
        job.edit.push(flags::edit(flag, text)?);
    }

    let preserve = &mut job.preserve;
    if let Some(text) = &args.volume {
        preserve.volume = text
            .parse()
            .map_err(|error| Failure::usage("--volume", format!("{error}"), "write for example --volume 120%"))?;
    }
    if !args.part.is_empty() {
        if args.volume.is_some() {
            return Err(Failure::usage("--part", "contradicts --volume", "leave one of them out"));
        }
        let parts: Result<_, Failure> = args.part.iter().map(|text| flags::part(text)).collect();
        preserve.volume = VolumeTarget::Parts(parts?);
    }
    match args.preserve.as_deref() {
        Some("free") if args.volume.is_some() || !args.part.is_empty() => {
            let flag = if args.volume.is_some() { "--volume" } else { "--part" };
            return Err(Failure::usage("--preserve", format!("\"free\" contradicts {flag}"), "leave one of them out"));
        }
        Some("free") => preserve.volume = VolumeTarget::Free,
        Some("nearest") => only(preserve, MethodKind::Nearest),
        Some("gradient") => only(preserve, MethodKind::Gradient),
        Some("elastic") => only(preserve, MethodKind::Elastic),
        Some(letters) => {
            let letters = letters.to_string().try_into().map_err(|error| {
                Failure::usage(
                    "--preserve",
                    format!("{error}"),
                    "write axes such as xy, \"nearest\", \"gradient\", \"elastic\", or \"free\"",
                )
            })?;
            (preserve.method, preserve.axes) = (Some(MethodKind::Axes), Some(Directions::Letters(letters)));
        }
        None => {}
    }
    match args.method {
        Some(MethodArg::Nearest) => preserve.method = Some(MethodKind::Nearest),
        Some(MethodArg::Gradient) => preserve.method = Some(MethodKind::Gradient),
        Some(MethodArg::Axes) => preserve.method = Some(MethodKind::Axes),
        Some(MethodArg::Height) => preserve.method = Some(MethodKind::Height),
        Some(MethodArg::Elastic) => preserve.method = Some(MethodKind::Elastic),
        None => {}
    }
    if let Some(text) = &args.elastic {
        preserve.method.get_or_insert(MethodKind::Elastic);
        flags::elastic(text, &mut job.elastic)?;
    }
    match args.objective {
        Some(ObjectiveArg::Controls) => preserve.objective = Objective::Controls,
        Some(ObjectiveArg::Surface) => preserve.objective = Objective::Surface,
        Some(ObjectiveArg::Edges) => preserve.objective = Objective::Edges,
        Some(ObjectiveArg::Bending) => preserve.objective = Objective::Bending,
        Some(ObjectiveArg::Stress) => preserve.objective = Objective::Stress,
        None => {}
    }
    if let Some(text) = &args.shares {
        preserve.shares = Some(flags::shares(text)?);
    }
    if let Some(text) = &args.pin {
        preserve.pin = Some(flags::pin(text)?);
    }
    match args.mobility {
        Some(MobilityArg::Uniform) => preserve.mobility = MobilityKind::Uniform,
        Some(MobilityArg::Auto) => preserve.mobility = MobilityKind::Auto,
        None => {}
    }
    if let Some(text) = &args.falloff {
        preserve.falloff = Some(flags::falloff(text)?);
    }
    for text in &args.point {
        preserve.points.push(flags::point(text)?);
    }
    if let Some(triangles) = args.preview {
        preserve.preview = Some(triangles as usize);
    }
    match args.open {
        Some(OpenArg::Cap) => preserve.open = OpenBoundaries::Cap,
        Some(OpenArg::Refuse) => preserve.open = OpenBoundaries::Refuse,
        None => {}
    }
    Ok(())
}

fn apply_view_flags(job: &mut Job, args: &DeformArgs) -> Result<(), Failure> {
    let view = &mut job.view;
    match args.color {
        Some(ColorArg::Volume) => view.color = ColorBy::Volume,
        Some(ColorArg::Steps) => view.color = ColorBy::Steps,
        Some(ColorArg::Displacement) => view.color = ColorBy::Displacement,
        Some(ColorArg::Stress) => view.color = ColorBy::Stress,
        Some(ColorArg::Plain) => view.color = ColorBy::Plain,
        None => {}
    }
    match args.up {
        Some(UpArg::X) => view.up = Axis::X,
        Some(UpArg::Y) => view.up = Axis::Y,
        Some(UpArg::Z) => view.up = Axis::Z,
        None => {}
    }
    if let Some(text) = &args.view {
        [view.azimuth, view.elevation] = flags::view(text)?;
    }
    if let Some(text) = &args.size {
        view.size = Some(flags::size(text)?);
    }
    if args.no_lattice {
        view.lattice = false;
    }
    Ok(())
}

fn apply_surface_flags(job: &mut Job, args: &DeformArgs) -> Result<(), Failure> {
    let DeformArgs { surface, place, grid, reach, refine, save_surface, sheet, .. } = args;
    if let Some(text) = surface {
        flags::surface(text, job)?;
    }
    let others = [
        ("--place", place.is_some()),
        ("--grid", grid.is_some()),
        ("--reach", reach.is_some()),
        ("--refine", refine.is_some()),
        ("--save-surface", save_surface.is_some()),
        ("--sheet", sheet.is_some()),
    ];
    let Some(request) = &mut job.surface else {
        return match others.into_iter().find(|(_, given)| *given) {
            Some((flag, _)) => {
                let what = "there is no surface to lay the model along";
                Err(Failure::usage(flag, what, "name one: --surface cylinder:radius=1,height=2"))
            }
            None => Ok(()),
        };
    };
    if let Some(text) = place {
        request.place = flags::place(text)?;
    }
    if let Some(text) = grid {
        request.grid = Some(flags::grid(text)?);
    }
    request.reach = reach.or(request.reach);
    if let Some(text) = refine {
        request.refine = flags::refine(text)?;
    }
    request.save = save_surface.clone().or(request.save.take());
    request.sheet = sheet.clone().or(request.sheet.take());
    Ok(())
}

fn apply_lattice_flags(job: &mut Job, args: &DeformArgs) -> Result<(), Failure> {
    let DeformArgs { lattice, basis, degree, knots, margin, outside, lattice_file, .. } = args;
    let is_named = lattice.is_some() || basis.is_some() || degree.is_some() || knots.is_some() || margin.is_some();
    if !is_named && outside.is_none() && lattice_file.is_none() {
        return Ok(());
    }
    if is_named && lattice_file.is_some() {
        let what = "a lattice file says size, basis, degree, knots and box already";
        return Err(Failure::usage("--lattice-file", what, "leave the other lattice flags out"));
    }
    let request = job.lattice.get_or_insert_default();
    if let Some(file) = lattice_file {
        *request = LatticeRequest { file: Some(file.clone()), outside: request.outside, ..LatticeRequest::default() };
    }
    if let Some(text) = lattice {
        request.size = Some(flags::lattice_size(text)?);
    }
    if let Some(basis) = basis {
        request.basis = Some(match basis {
            BasisArg::Bspline => BasisKind::Bspline,
            BasisArg::Bernstein => BasisKind::Bernstein,
        });
    }
    if let Some(text) = degree {
        request.degree = Some(flags::degree(text)?);
    }
    if let Some(knots) = knots {
        request.knots = Some(Knots::All(match knots {
            KnotsArg::Clamped => KnotRule::Clamped,
            KnotsArg::Uniform => KnotRule::Uniform,
        }));
    }
    if margin.is_some() {
        request.margin = *margin;
    }
    if let Some(outside) = outside {
        request.outside = match outside {
            OutsideArg::Keep => Outside::Keep,
            OutsideArg::Extend => Outside::Extend,
            OutsideArg::Refuse => Outside::Refuse,
        };
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_have_as_many_digits_as_the_last_one_and_at_least_four() {
        for (path, number, of, expected) in [
            ("out.ply", 1, 2, "out-0001.ply"),
            ("a/b.c/out.x.ply", 36, 9999, "a/b.c/out.x-0036.ply"),
            ("out.ply", 7, 10_000, "out-00007.ply"),
            ("out.ply", 10_000, 10_000, "out-10000.ply"),
            ("out", 7, 8, "out-0007"),
        ] {
            assert_eq!(numbered(Path::new(path), number, of), Path::new(expected));
        }
    }

    #[test]
    fn pictures_of_films_are_beside_the_models() {
        for (path, expected) in [("out.ply", "out-strip.png"), ("a/b.c/x.y.obj", "a/b.c/x.y-strip.png")] {
            assert_eq!(beside(Path::new(path), "strip"), Path::new(expected));
        }
    }

    #[test]
    fn words_are_quoted_as_a_shell_wants_them() {
        for (word, expected) in [
            ("z=90", "z=90"),
            ("a b", "'a b'"),
            ("", "''"),
            ("it's", r"'it'\''s'"),
            ("shape:cube?n=6", "'shape:cube?n=6'"),
            ("twist = { axis = \"z\" }", "'twist = { axis = \"z\" }'"),
        ] {
            assert_eq!(quoted(word), expected);
        }
    }
}
