//! The texts of flags as values of a job.

use glam::DVec3;
use isochor::{
    Axis, Bend, CageRequest, Coordinates, Drag, Edit, ElasticRequest, Factors, Falloff, Job, LengthUnit, Move, Noise,
    PartTarget, PerAxis, Placement, PointRequest, Refine, RefineWord, Rotate, RotationAxis, Scale, Selector,
    SignedAxis, Stretch, SurfaceRequest, Taper, Twist,
};

use crate::failure::Failure;

/// A failure of `--flag` with the text it got and an example of what it takes.
fn refused(flag: &str, text: &str, example: &str) -> Failure {
    Failure::usage(format!("--{flag}"), format!("\"{text}\" is not understood"), format!("write for example {example}"))
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite())
}

/// Numbers with commas.
fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(number).collect()
}

fn axis(text: &str) -> Option<Axis> {
    match text.trim() {
        "x" => Some(Axis::X),
        "y" => Some(Axis::Y),
        "z" => Some(Axis::Z),
        _ => None,
    }
}

fn signed_axis(text: &str) -> Option<SignedAxis> {
    match text.trim() {
        "x" => Some(SignedAxis::X),
        "y" => Some(SignedAxis::Y),
        "z" => Some(SignedAxis::Z),
        "-x" => Some(SignedAxis::MinusX),
        "-y" => Some(SignedAxis::MinusY),
        "-z" => Some(SignedAxis::MinusZ),
        _ => None,
    }
}

/// `z=90`
fn axis_and_number(text: &str) -> Option<(Axis, f64)> {
    let (name, value) = text.split_once('=')?;
    Some((axis(name)?, number(value)?))
}

/// The edit that a flag stands for.
pub fn edit(flag: &'static str, text: &str) -> Result<Edit, Failure> {
    let (name, example) = match flag {
        "twist" | "rotate" => (flag, "z=90"),
        "bend" => (flag, "z=45 or z=45,-x"),
        "taper" | "stretch" => (flag, "z=0.5"),
        "scale" => (flag, "1.2 or 1,1,2"),
        "shift" => ("move", "k=5:0,0,-0.4"),
        "slide" => (flag, "v=3:0,0.2,0.1"),
        "noise" => (flag, "0.05 or 0.05,7"),
        "drag" => (flag, POINT),
        _ => return toml_edit(text),
    };
    let parsed = match flag {
        "twist" => {
            axis_and_number(text).map(|(axis, degrees)| Edit::Twist(Twist { axis, degrees, ..Twist::default() }))
        }
        "rotate" => axis_and_number(text).map(|(axis, degrees)| {
            let (axis, center, nodes) = (RotationAxis::Coordinate(axis), None, Selector::All);
            Edit::Rotate(Rotate { axis, degrees, center, nodes })
        }),
        "bend" => bend(text),
        "taper" => axis_and_number(text)
            .map(|(axis, scale)| Edit::Taper(Taper { axis, scale, range: None, center: None, nodes: Selector::All })),
        "stretch" => axis_and_number(text)
            .map(|(axis, scale)| Edit::Stretch(Stretch { axis, scale, center: None, nodes: Selector::All })),
        "scale" => scale(text),
        "shift" => shift(text).map(Edit::Move),
        "slide" => shift(text).map(Edit::Slide),
        "drag" => vertex_and_place(text).map(|point| Edit::Drag(Drag { points: vec![point], nodes: Selector::All })),
        _ => noise(text),
    };
    parsed.ok_or_else(|| refused(name, text, example))
}

fn bend(text: &str) -> Option<Edit> {
    let (first, towards) = match text.split_once(',') {
        Some((first, towards)) => (first, Some(signed_axis(towards)?)),
        None => (text, None),
    };
    let (axis, degrees) = axis_and_number(first)?;
    Some(Edit::Bend(Bend { axis, degrees, towards, ..Bend::default() }))
}

fn scale(text: &str) -> Option<Edit> {
    let by = match numbers(text)?[..] {
        [factor] => Factors::Uniform(factor),
        [x, y, z] => Factors::PerAxis(DVec3::new(x, y, z)),
        _ => return None,
    };
    Some(Edit::Scale(Scale { by, center: None, nodes: Selector::All }))
}

fn shift(text: &str) -> Option<Move> {
    let (nodes, by) = text.rsplit_once(':')?;
    let [x, y, z] = numbers(by)?[..] else { return None };
    Some(Move { by: DVec3::new(x, y, z), unit: LengthUnit::Extent, nodes: nodes.parse().ok()? })
}

fn noise(text: &str) -> Option<Edit> {
    let (amplitude, seed) = match text.split_once(',') {
        Some((amplitude, seed)) => (amplitude, seed.trim().parse().ok()?),
        None => (text, 0),
    };
    Some(Edit::Noise(Noise { amplitude: number(amplitude)?, seed, unit: LengthUnit::Extent, nodes: Selector::All }))
}

/// An edit as in a job file.
fn toml_edit(text: &str) -> Result<Edit, Failure> {
    let job = isochor::Job::from_toml(&format!("[[edit]]\n{text}\n"))
        .map_err(|error| Failure::usage("--edit", error.to_string(), "write it as under [[edit]] in a job file"))?;
    match <[Edit; 1]>::try_from(job.edit) {
        Ok([edit]) => Ok(edit),
        Err(_) => Err(refused("edit", text, "'twist = { axis = \"z\", degrees = 90 }'")),
    }
}

/// `6x6x6` or `6`.
pub fn lattice_size(text: &str) -> Result<PerAxis<usize>, Failure> {
    per_axis(text, 'x').ok_or_else(|| refused("lattice", text, "6x6x6"))
}

/// `3` or `3,3,2`.
pub fn degree(text: &str) -> Result<PerAxis<usize>, Failure> {
    per_axis(text, ',').ok_or_else(|| refused("degree", text, "3 or 3,3,2"))
}

fn per_axis(text: &str, separator: char) -> Option<PerAxis<usize>> {
    let values: Option<Vec<usize>> = text.split(separator).map(|n| n.trim().parse().ok()).collect();
    match values?[..] {
        [all] => Some(PerAxis::All(all)),
        [u, v, w] => Some(PerAxis::Each([u, v, w])),
        _ => None,
    }
}

/// `1,2`
pub fn shares(text: &str) -> Result<Vec<f64>, Failure> {
    numbers(text).ok_or_else(|| refused("shares", text, "1,2"))
}

/// `k=0`
pub fn pin(text: &str) -> Result<Selector, Failure> {
    text.parse().map_err(|error| Failure::usage("--pin", format!("{error}"), "write for example k=0 or \"i=0,5 k=2\""))
}

/// `-60,22`
pub fn view(text: &str) -> Result<[f64; 2], Failure> {
    let parsed = || <[f64; 2]>::try_from(numbers(text)?).ok();
    parsed().ok_or_else(|| refused("view", text, "-60,22"))
}

/// `520x520`
pub fn size(text: &str) -> Result<[u32; 2], Failure> {
    let parsed = || {
        let (width, height) = text.split_once('x')?;
        Some([width.trim().parse().ok()?, height.trim().parse().ok()?])
    };
    parsed().ok_or_else(|| refused("size", text, "520x520"))
}

/// `1204:0.3`
pub fn falloff(text: &str) -> Result<Falloff, Failure> {
    let parsed = || {
        let (vertex, radius) = text.split_once(':')?;
        Some(Falloff { vertex: vertex.trim().parse().ok()?, radius: number(radius)? })
    };
    parsed().ok_or_else(|| refused("falloff", text, "1204:0.3"))
}

const POINT: &str = "1204:0.1,0.2,0.9";

/// `1204:0.1,0.2,0.9`
pub fn point(text: &str) -> Result<PointRequest, Failure> {
    vertex_and_place(text).ok_or_else(|| refused("point", text, POINT))
}

fn vertex_and_place(text: &str) -> Option<PointRequest> {
    let (vertex, to) = text.split_once(':')?;
    let [x, y, z] = numbers(to)?[..] else { return None };
    Some(PointRequest { vertex: vertex.trim().parse().ok()?, to: DVec3::new(x, y, z) })
}

/// `0,2=110%`
pub fn part(text: &str) -> Result<PartTarget, Failure> {
    let parsed = || {
        let (components, volume) = text.split_once('=')?;
        let components = components.split(',').map(|c| c.trim().parse().ok()).collect::<Option<_>>()?;
        Some(PartTarget { components, volume: volume.parse().ok()? })
    };
    parsed().ok_or_else(|| refused("part", text, "0,2=110%"))
}

/// The surface of `cylinder:radius=1,height=2` or `teapot.txt:patch=3`, over what `job` says of flattening and placing.
pub fn surface(text: &str, job: &mut Job) -> Result<(), Failure> {
    let (name, keys) = text.split_once(':').filter(|(name, _)| name.len() > 1).unwrap_or((text, "")); // C: is a drive
    let first = if name.contains(['.', '/', '\\']) { "file" } else { "kind" };
    let separator = if keys.trim().is_empty() { "" } else { ", " };
    let toml = format!("surface = {{ {first} = {}{separator}{keys} }}", toml_string(name));
    let SurfaceRequest { grid, reach, flatten, place, refine, folds, save, sheet, .. } =
        job.surface.take().unwrap_or_default();
    let made = surface_section("surface", text, &toml)?;
    let other = SurfaceRequest::default();
    job.surface = Some(SurfaceRequest {
        grid: made.grid.or(grid),
        reach: made.reach.or(reach),
        flatten: if made.flatten == other.flatten { flatten } else { made.flatten },
        place: if made.place == other.place { place } else { made.place },
        refine: if made.refine == other.refine { refine } else { made.refine },
        folds: if made.folds == other.folds { folds } else { made.folds },
        save: made.save.clone().or(save),
        sheet: made.sheet.clone().or(sheet),
        ..made
    });
    Ok(())
}

/// `cage.obj` or `cage.obj:posed="posed.obj",coordinates="green"`, over what the job says: keys with their default values say nothing.
pub fn cage(text: &str, request: &mut Option<CageRequest>) -> Result<(), Failure> {
    let (name, keys) = text.split_once(':').filter(|(name, _)| name.len() > 1).unwrap_or((text, "")); // C: is a drive
    let separator = if keys.trim().is_empty() { "" } else { ", " };
    let toml = format!("cage = {{ file = {}{separator}{keys} }}", toml_string(name));
    let example = "posed=\"cage-posed.obj\",coordinates=\"green\"";
    let made = section("cage", text, &toml, example)?.cage.unwrap_or_default();
    let said = request.take().unwrap_or_default();
    let is_default = made.coordinates == Coordinates::default();
    *request = Some(CageRequest {
        file: made.file,
        posed: made.posed.or(said.posed),
        coordinates: if is_default { said.coordinates } else { made.coordinates },
        outside: made.outside.or(said.outside),
        blend: made.blend.or(said.blend),
        resolution: made.resolution.or(said.resolution),
        weights: made.weights.or(said.weights),
        save_weights: made.save_weights.or(said.save_weights),
        free: made.free.or(said.free),
        witnesses: made.witnesses.or(said.witnesses),
        stress: made.stress || said.stress,
        planes: made.planes.or(said.planes),
    });
    Ok(())
}

/// `at=[0.5,0.5],rotate=30`
pub fn place(text: &str) -> Result<Placement, Failure> {
    Ok(surface_section("place", text, &format!("surface = {{ place = {{ {text} }} }}"))?.place)
}

/// `hold={k=[0,2]},net="14"`, over what the job says: keys with their default values say nothing.
pub fn elastic(text: &str, request: &mut Option<ElasticRequest>) -> Result<(), Failure> {
    let example = "hold={k=[0,2]},net=\"14\"";
    let made = section("elastic", text, &format!("elastic = {{ {text} }}"), example)?.elastic.unwrap_or_default();
    let other = ElasticRequest::default();
    let said = request.take().unwrap_or_default();
    *request = Some(ElasticRequest {
        hold: if made.hold == other.hold { said.hold } else { made.hold },
        net: if made.net == other.net { said.net } else { made.net },
        solver: if made.solver == other.solver { said.solver } else { made.solver },
        levels: if made.levels == other.levels { said.levels } else { made.levels },
        stiffness: if made.stiffness == other.stiffness { said.stiffness } else { made.stiffness },
        continuity: made.continuity.or(said.continuity),
        center_of_mass: made.center_of_mass.or(said.center_of_mass),
        inertia: made.inertia.or(said.inertia),
    });
    Ok(())
}

/// `0.05` or `off`
pub fn refine(text: &str) -> Result<Refine, Failure> {
    match text.trim() {
        "off" => Ok(Refine::Word(RefineWord::Off)),
        text => number(text).map(Refine::Above).ok_or_else(|| refused("refine", text, "0.05 or off")),
    }
}

/// `32x32` or `32`
pub fn grid(text: &str) -> Result<[usize; 2], Failure> {
    let values: Option<Vec<usize>> = text.split('x').map(|n| n.trim().parse().ok()).collect();
    match values.as_deref() {
        Some([both]) => Ok([*both; 2]),
        Some([s, t]) => Ok([*s, *t]),
        _ => Err(refused("grid", text, "32x32")),
    }
}

/// The section `[surface]` of `toml`, which was made of the `text` behind a flag.
fn surface_section(flag: &str, text: &str, toml: &str) -> Result<SurfaceRequest, Failure> {
    Ok(section(flag, text, toml, "radius=1,height=2")?.surface.unwrap_or_default())
}

/// The job of `toml`, which was made of the `text` behind a flag; an example of what it takes.
fn section(flag: &str, text: &str, toml: &str, example: &str) -> Result<Job, Failure> {
    Job::from_toml(toml).map_err(|error| {
        let hint = match &error.nearest {
            Some(nearest) => format!("did you mean `{nearest}`?"),
            None => format!("write keys and values as in a job file, with commas: {example}"),
        };
        Failure::usage(format!("--{flag}"), format!("\"{text}\": {}", error.what), hint)
    })
}

fn toml_string(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}
