//! A random small request, named by a number.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use isochor::shapes::{cube, icosphere, plate, uv_torus};
use isochor::{
    Basis, Binding, Bounds, Components, CorrectOptions, Energy, Faces, Frame, Lattice, Mesh, Method, OpenBoundaries,
    Outside, PointTarget, Solid, VolumeGoal, Wanted, displaced, topology,
};

use crate::bodies::three_bodies;
use crate::random::Random;

pub struct Case {
    pub mesh: Mesh,
    pub solid: Solid,
    pub binding: Binding,
    /// Posed vertices.
    pub posed: Vec<DVec3>,
    pub wanted: Wanted,
    pub options: CorrectOptions,
    /// What it is made of, in words.
    pub story: String,
}

impl Random {
    fn below(&mut self, n: usize) -> usize {
        (self.within(0.0, n as f64) as usize).min(n - 1)
    }

    fn chance(&mut self, p: f64) -> bool {
        self.within(0.0, 1.0) < p
    }

    fn rotation(&mut self) -> DMat3 {
        let axis = (self.vector() + DVec3::splat(1e-3)).normalize();
        DMat3::from_axis_angle(axis, self.within(0.0, TAU))
    }
}

impl Case {
    pub fn new(seed: u64) -> Self {
        let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
        random.vector();
        let random = &mut random;
        let (mesh, shape) = model(random);
        let (mesh, place) = placed(random, &mesh);
        let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Cap).unwrap();
        let (lattice, outside, kind) = lattice(random, &mesh);
        let binding = lattice.bind(mesh.points(), outside).unwrap();
        let (displacement, pose) = pose(random, &lattice, &mesh);
        let posed = displaced(mesh.points(), &binding.apply(&displacement));
        let (mobility, pins) = mobility(random, &lattice);
        let (points, places) = points(random, &binding, &posed, mobility.as_deref());
        let (volumes, goals) = goals(random, &solid, mesh.points(), &posed, points.is_empty());
        let (method, way) = method(random);
        let energy = match random.below(10) {
            0 => Some(Energy::surface(&binding).unwrap()),
            1 => Some(Energy::edges(&lattice).unwrap()),
            2 => Some(Energy::bending(&lattice).unwrap()),
            _ => None,
        };
        let cost = if energy.is_some() { ", energy" } else { "" };
        let story = format!("{shape}{place}, {kind}, {pose}, {pins}, {places}, {goals}, {way}{cost}");
        let (wanted, options) = (Wanted { volumes, points }, CorrectOptions { method, mobility, energy });
        Self { mesh, solid, binding, posed, wanted, options, story }
    }

    pub fn mobility(&self) -> Vec<DVec3> {
        self.options.mobility.clone().unwrap_or_else(|| vec![DVec3::ONE; self.binding.control_count()])
    }
}

fn bumpy(random: &mut Random, mesh: &Mesh) -> Mesh {
    let (k, size) = (3.0 * random.vector(), random.within(0.0, 0.3));
    mesh.with_points(mesh.points().iter().map(|p| *p * (1.0 + size * k.dot(*p).sin())).collect()).unwrap()
}

fn model(random: &mut Random) -> (Mesh, &'static str) {
    match random.below(13) {
        0..3 => (bumpy(random, &icosphere(1)), "blob"),
        3..6 => (three_bodies(), "three bodies"),
        6..8 => (uv_torus(1.0, random.within(0.2, 0.6), 12, 7), "torus"),
        8 => (cube(2 + random.below(2)), "cube"),
        9..11 => (plate(DVec3::new(1.0, random.within(0.5, 1.0), 0.01), [4, 3]), "plate"),
        11 => (opened(&bumpy(random, &icosphere(2)), random.within(-0.3, 0.6)), "open shape"),
        // So thin that rounding may show.
        _ => (plate(DVec3::new(1.0, 1.0, 10f64.powf(random.within(-13.0, -8.0))), [1, 1 + random.below(2)]), "foil"),
    }
}

/// The faces below `height`.
fn opened(mesh: &Mesh, height: f64) -> Mesh {
    let mut place = vec![u32::MAX; mesh.points().len()];
    let mut points = Vec::new();
    let mut faces = Faces::new();
    for face in mesh.faces().iter().filter(|f| f.iter().all(|v| mesh.points()[*v as usize].z < height)) {
        let corners: Vec<u32> = face
            .iter()
            .map(|v| {
                let place = &mut place[*v as usize];
                if *place == u32::MAX {
                    *place = points.len() as u32;
                    points.push(mesh.points()[*v as usize]);
                }
                *place
            })
            .collect();
        faces.push(&corners);
    }
    Mesh::new(points, faces).unwrap()
}

/// Rotated, scaled, moved by up to 1e4 extents.
fn placed(random: &mut Random, mesh: &Mesh) -> (Mesh, String) {
    let rotation = if random.chance(0.6) { random.rotation() } else { DMat3::IDENTITY };
    let scale = match random.below(50) {
        0 => 1e82,
        1 => 10f64.powf(random.within(-60.0, 60.0)),
        2..15 => 10f64.powf(random.within(-3.0, 3.0)),
        _ => 1.0,
    };
    let distance = if random.chance(0.4) { 10f64.powf(random.within(-1.0, 4.0)) } else { 0.0 };
    let offset = random.vector() * distance;
    let points = mesh.points().iter().map(|p| scale * (rotation * *p + offset)).collect();
    (mesh.with_points(points).unwrap(), format!(" × {scale:.1e} at {distance:.0e}"))
}

fn lattice(random: &mut Random, mesh: &Mesh) -> (Lattice, Outside, String) {
    let bases = [0; 3].map(|_| {
        let size = 2 + random.below(4);
        let degree = 1 + random.below(3.min(size - 1));
        match random.below(3) {
            0 => Basis::uniform(size, degree),
            1 => Basis::clamped(size, degree),
            _ => Basis::bernstein(size),
        }
        .unwrap()
    });
    let bounds = mesh.bounds().unwrap();
    let mut frame = Frame::fitted(bounds, random.within(0.0, 0.1)).unwrap();
    let is_sheared = random.chance(0.2);
    if is_sheared {
        let skew = |random: &mut Random| 0.3 * random.vector();
        let by = DMat3::from_cols(DVec3::X + skew(random), DVec3::Y + skew(random), DVec3::Z + skew(random));
        let middle = frame.origin + 0.5 * frame.axes.iter().sum::<DVec3>();
        frame.axes = frame.axes.map(|a| by * a * 1.6);
        frame.origin = middle - 0.5 * frame.axes.iter().sum::<DVec3>();
    }
    let is_part = random.chance(0.2);
    if is_part {
        let beyond = if random.chance(0.08) { 2.0 } else { random.within(-0.3, 0.6) };
        frame.origin += frame.axes[random.below(3)] * beyond;
    }
    let outside = if !is_part && random.chance(0.1) { Outside::Extend } else { Outside::Keep };
    let lattice = Lattice::new(bases, frame).unwrap();
    let degrees = [0, 1, 2].map(|a| lattice.bases()[a].degree());
    let kind = format!(
        "lattice {:?} of degrees {degrees:?}{}{}",
        lattice.size(),
        if is_sheared { " sheared" } else { "" },
        if is_part { " in part" } else { "" }
    );
    (lattice, outside, kind)
}

/// What the controls are moved by.
fn pose(random: &mut Random, lattice: &Lattice, mesh: &Mesh) -> (Vec<DVec3>, &'static str) {
    let rest = lattice.rest();
    let bounds = mesh.bounds().unwrap();
    let (middle, extent) = (bounds.center(), bounds.extent());
    match random.below(4) {
        0 => (vec![DVec3::ZERO; rest.len()], "at rest"),
        1 => {
            let size = random.within(0.0, 0.25) * extent;
            (rest.iter().map(|_| size * random.vector()).collect(), "random")
        }
        2 => {
            let (frame, turn) = (random.rotation(), random.within(-2.0, 2.0));
            let twisted = |c: &DVec3| {
                let p = frame.transpose() * (*c - middle);
                frame * (DMat3::from_rotation_z(turn * p.z / extent) * p) + middle - *c
            };
            (rest.iter().map(twisted).collect(), "twisted")
        }
        _ => {
            let (direction, by) = (random.rotation() * DVec3::X, random.within(-0.2, 0.8));
            (rest.iter().map(|c| -by * direction * direction.dot(*c - middle)).collect(), "squashed")
        }
    }
}

fn mobility(random: &mut Random, lattice: &Lattice) -> (Option<Vec<DVec3>>, &'static str) {
    let count = lattice.control_count();
    let mut m: Vec<DVec3> = (0..count).map(|_| DVec3::from_array([0; 3].map(|_| random.within(0.05, 3.0)))).collect();
    let kind = match random.below(20) {
        0..7 => return (None, "free"),
        7..10 => "mobilities",
        10..13 => {
            let (axis, layers) = (random.below(3), random.chance(0.4));
            let last = lattice.size()[axis] - 1;
            for (c, m) in m.iter_mut().enumerate() {
                let i = lattice.node(c)[axis];
                if i == 0 || (layers && i == last) {
                    *m = DVec3::ZERO;
                }
            }
            "a layer pinned"
        }
        13..15 => {
            let axis = random.below(3);
            m.iter_mut().for_each(|m| m[axis] = 0.0);
            "a coordinate pinned"
        }
        15..17 => {
            m.iter_mut().for_each(|m| (0..3).for_each(|a| m[a] *= f64::from(u8::from(random.chance(0.6)))));
            "some pinned"
        }
        17..19 => {
            let kept = [0; 3].map(|_| (random.below(count), random.below(3)));
            let kept = &kept[..1 + random.below(3)];
            for (c, m) in m.iter_mut().enumerate() {
                (0..3).filter(|a| !kept.contains(&(c, *a))).for_each(|a| m[a] = 0.0);
            }
            "almost all pinned"
        }
        _ if random.chance(0.3) => {
            m.fill(DVec3::ZERO);
            "all pinned"
        }
        _ => {
            let scale = 10f64.powf(random.within(-8.0, 8.0));
            m.iter_mut().for_each(|m| *m *= scale);
            "scaled mobilities"
        }
    };
    (Some(m), kind)
}

fn points(
    random: &mut Random,
    binding: &Binding,
    posed: &[DVec3],
    mobility: Option<&[DVec3]>,
) -> (Vec<PointTarget>, String) {
    let extent = Bounds::of(posed).unwrap().extent();
    let count = if random.chance(0.6) { 0 } else { random.below(5) };
    let mut points: Vec<PointTarget> = (0..count)
        .map(|_| {
            let v = random.below(posed.len());
            let by = match random.below(5) {
                0 => DVec3::ZERO,
                1 => extent * random.within(-0.2, 0.2) * DVec3::AXES[random.below(3)],
                _ => 0.2 * extent * random.vector(),
            };
            PointTarget { weights: binding.weights(v), position: posed[v], target: posed[v] + by }
        })
        .collect();
    let mut kind = format!("{count} points");
    if count > 0 && random.chance(0.05) {
        points[0].target = 10f64.powf(random.within(110.0, 200.0)) * DVec3::ONE;
        kind += ", one far away";
    }
    if count > 0 && random.chance(0.15) {
        points.push(points[random.below(count)].clone());
        kind += " and one again";
    }
    if count > 0 && random.chance(0.1) {
        let mut other = points[random.below(count)].clone();
        other.target += 0.05 * extent * random.vector();
        points.push(other);
        kind += " and one elsewhere";
    }
    // A vertex that follows pinned controls alone, where there is one.
    let is_pinned = |v: usize| mobility.is_some_and(|m| binding.weights(v).iter().all(|(c, _)| m[*c] == DVec3::ZERO));
    if count > 0
        && random.chance(0.3)
        && let Some(v) = (0..posed.len()).find(|v| is_pinned(*v))
    {
        let by = if random.chance(0.5) { DVec3::ZERO } else { 0.1 * extent * random.vector() };
        points.push(PointTarget { weights: binding.weights(v), position: posed[v], target: posed[v] + by });
        kind += " and a pinned one";
    }
    (points, kind)
}

fn goals(
    random: &mut Random,
    solid: &Solid,
    rest: &[DVec3],
    posed: &[DVec3],
    is_free: bool,
) -> (Vec<VolumeGoal>, &'static str) {
    let of = solid.volumes(if random.chance(0.5) { rest } else { posed });
    let now = solid.volumes(posed);
    let factor = |random: &mut Random| match random.below(12) {
        0 => 1.0,
        1..5 => random.within(0.95, 1.05),
        _ => random.within(0.5, 1.5),
    };
    let one = |components: &[usize], random: &mut Random| {
        let components = components.to_vec();
        let volume = components.iter().map(|c| of.components[*c]).sum::<f64>() * factor(random);
        VolumeGoal { components: Components::These(components), volume }
    };
    let whole = |volume: f64| VolumeGoal { components: Components::All, volume };
    let count = solid.component_count();
    if !is_free && random.chance(0.1) {
        return (Vec::new(), "no volume");
    }
    if count == 1 || random.chance(0.25) {
        return match random.below(16) {
            0 => (vec![whole(now.total)], "as it is"),
            1 => {
                let volume = of.total * factor(random);
                (vec![whole(volume), whole(volume)], "the whole twice")
            }
            2 => {
                let volume = of.total * factor(random);
                (vec![whole(volume), whole(volume * random.within(0.9, 1.1))], "two wholes")
            }
            _ => (vec![whole(of.total * factor(random))], "whole"),
        };
    }
    let mut each: Vec<VolumeGoal> = (0..count).map(|c| one(&[c], random)).collect();
    match random.below(6) {
        0 => (vec![one(&[0, 1], random)], "one group"),
        1 => (vec![one(&[0, 1], random), one(&[2], random)], "groups"),
        2 => (vec![one(&[2, 0], random), one(&[1], random)], "groups"),
        3 => (each, "each"),
        4 => {
            let sum = each.iter().map(|goal| goal.volume).sum::<f64>();
            each.push(whole(sum));
            (each, "each and the whole")
        }
        _ if random.chance(0.4) => {
            let sum = each.iter().map(|goal| goal.volume).sum::<f64>();
            each.push(whole(sum * random.within(0.9, 1.1)));
            (each, "each and another whole")
        }
        _ => {
            each.truncate(2);
            (each, "two of three")
        }
    }
}

fn method(random: &mut Random) -> (Method, String) {
    let directions = match random.below(9) {
        0..3 => return (Method::Nearest, "nearest".into()),
        3..5 => return (Method::Gradient, "gradient".into()),
        5 => {
            let mut left = vec![0, 1, 2];
            [0; 3].map(|_| DVec3::AXES[left.remove(random.below(left.len()))]).to_vec()
        }
        6 => (0..1 + random.below(5)).map(|_| DVec3::AXES[random.below(3)]).collect(),
        7 => vec![DVec3::AXES[random.below(3)] * random.within(0.5, 2.0)],
        _ => (0..1 + random.below(3)).map(|_| random.vector()).collect(),
    };
    let shares = random.chance(0.3).then(|| directions.iter().map(|_| random.within(0.0, 2.0)).collect());
    let shared = if shares.is_some() { " in shares" } else { "" };
    (Method::Axes { directions: directions.clone(), shares }, format!("axes {directions:.2?}{shared}"))
}
