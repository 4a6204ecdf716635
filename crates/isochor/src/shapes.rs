//! Closed solids of known volume, for tests, examples and pictures.
//!
//! Faces are counter-clockwise seen from outside, and vertices are shared: there is one at each place. Volumes are those of
//! the polygonal solids themselves, not of the smooth shapes they stand for.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::DVec3;

use crate::mesh::{Faces, Mesh};

/// The unit cube [0, 1]³ with `n` × `n` squares on each side: 6n² + 2 vertices, 6n² faces, volume 1.
///
/// # Panics
///
/// Panics where `n` is 0.
#[must_use]
pub fn cube(n: usize) -> Mesh {
    block(DVec3::ONE, [n; 3])
}

/// The thin box [0, size.x] × [0, size.y] × [0, size.z] with `n[0]` × `n[1]` rectangles above and below and one row of them
/// round its rim: 2 (n₀ + 1) (n₁ + 1) vertices, volume x·y·z.
///
/// # Panics
///
/// Panics where a side is not positive and finite, or a number of rectangles is 0.
#[must_use]
pub fn plate(size: DVec3, n: [usize; 2]) -> Mesh {
    block(size, [n[0], n[1], 1])
}

/// The box [0, size.x] × [0, size.y] × [0, size.z], divided into `n` parts along x, y, z.
fn block(size: DVec3, n: [usize; 3]) -> Mesh {
    assert!(n.iter().all(|n| *n > 0), "a box needs at least one rectangle along every side, not {n:?}");
    for side in size.to_array() {
        assert_length("side of a box", side);
    }
    let mut vertices = HashMap::new();
    let mut points = Vec::new();
    let mut faces = Faces::new();
    for axis in 0..3 {
        let (across, up) = ((axis + 1) % 3, (axis + 2) % 3);
        for (end, far) in [(0, false), (n[axis], true)] {
            for a in 0..n[across] {
                for b in 0..n[up] {
                    let mut corner = |a: usize, b: usize| {
                        let mut node = [end; 3];
                        (node[across], node[up]) = (a, b);
                        *vertices.entry(node).or_insert_with(|| {
                            let fraction = |d: usize| node[d] as f64 / n[d] as f64;
                            points.push(size * DVec3::new(fraction(0), fraction(1), fraction(2)));
                            points.len() as u32 - 1
                        })
                    };
                    let mut face = [corner(a, b), corner(a + 1, b), corner(a + 1, b + 1), corner(a, b + 1)];
                    if !far {
                        face.reverse();
                    }
                    faces.push(&face);
                }
            }
        }
    }
    solid(points, faces)
}

/// The icosahedron inscribed in the unit sphere, its triangles divided into four `levels` times, with all vertices on the
/// sphere: 10·4^levels + 2 vertices, 20·4^levels triangles. Its volume tends to 4π/3 from below; that of level 0 is
/// `5 (3 + √5) a³ / 12` with the edge length `a = 4 / √(10 + 2√5)`.
///
/// # Panics
///
/// Panics where `levels` is more than 12: such a sphere has over 300 million triangles.
#[must_use]
pub fn icosphere(levels: usize) -> Mesh {
    assert!(levels <= 12, "an icosphere has at most 12 levels, not {levels}");
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    // Three golden rectangles: (0, ±1, ±φ) and its cyclic permutations.
    let mut points = Vec::new();
    for axis in 0..3 {
        for (one, phi) in [(-1.0, -golden), (1.0, -golden), (-1.0, golden), (1.0, golden)] {
            let mut p = DVec3::ZERO;
            (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (one, phi);
            points.push(p.normalize());
        }
    }
    // Its triangles are the triples of vertices at edge length from each other: 2 / |(0, 1, φ)|.
    let edge = 2.0 / DVec3::new(0.0, 1.0, golden).length();
    let near = |a: usize, b: usize| points[a].distance(points[b]) < 1.1 * edge;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for a in 0..12 {
        for b in (a + 1..12).filter(|b| near(a, *b)) {
            for c in (b + 1..12).filter(|c| near(a, *c) && near(b, *c)) {
                let outside = points[a].dot(points[b].cross(points[c])) > 0.0;
                triangles.push(if outside { [a, b, c] } else { [a, c, b] }.map(|v| v as u32));
            }
        }
    }
    for _ in 0..levels {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let divided = triangles.iter().flat_map(|&[a, b, c]| {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        });
        triangles = divided.collect();
    }
    solid(points, triangles.iter().collect())
}

/// [`icosphere`] with a cavity: the same mesh at `inner` times its size, inside out. Two components; its volume is
/// 1 − inner³ times that of the icosphere.
///
/// # Panics
///
/// Panics where `inner` is not between 0 and 1, or `levels` is more than 12.
#[must_use]
pub fn hollow_sphere(levels: usize, inner: f64) -> Mesh {
    assert!(inner > 0.0 && inner < 1.0, "the cavity has a radius between 0 and 1, not {inner}");
    let outer = icosphere(levels);
    let cavity = outer.points().iter().map(|p| inner * p).collect();
    hollowed(&outer, &solid(cavity, outer.faces().clone()))
}

/// `outer` with the cavity `inner`, whose faces are turned inwards, each fanned from the same corner as before.
fn hollowed(outer: &Mesh, inner: &Mesh) -> Mesh {
    let first = outer.points().len() as u32;
    let mut faces = outer.faces().clone();
    for face in inner.faces().iter() {
        let corners = face[..1].iter().chain(face[1..].iter().rev());
        faces.push(&corners.map(|v| v + first).collect::<Vec<_>>());
    }
    solid([outer.points(), inner.points()].concat(), faces)
}

/// [`icosphere`] with two ears, round the directions of vertices 2 and 3, (0, ∓1, φ)/|(0, 1, φ)| with the golden ratio φ: each of its
/// points, in direction d, is at the distance `1 + 0.6 Σ exp(40 (d·e − 1))` from the centre, the sum over the directions e of
/// the ears. One component. Its volume tends to `∫ (distance)³/3` over the sphere, from below as that of the icosphere does.
///
/// # Panics
///
/// Panics where `levels` is more than 12.
#[must_use]
pub fn eared_ball(levels: usize) -> Mesh {
    /// Their length, and one over their width squared.
    const EARS: (f64, f64) = (0.6, 40.0);
    let ball = icosphere(levels);
    let ears = [ball.points()[2], ball.points()[3]];
    let ear = |d: DVec3, e: DVec3| EARS.0 * (EARS.1 * (d.dot(e) - 1.0)).exp();
    let points = ball.points().iter().map(|d| *d * (1.0 + ears.iter().map(|e| ear(*d, *e)).sum::<f64>())).collect();
    solid(points, ball.faces().clone())
}

/// A straight chain along the x-axis of so many `links`, each an [`uv_torus`] of radii 1 and 0.2, its centre 1.5 from that of the
/// one before and turned by a right angle about the x-axis against it. The links are the components, in order; they do not touch.
///
/// # Panics
///
/// Panics where `links` is 0, or `nu` or `nv` is less than 3.
#[must_use]
pub fn chain(links: usize, nu: usize, nv: usize) -> Mesh {
    assert!(links > 0, "a chain needs at least 1 link");
    let link = uv_torus(1.0, 0.2, nu, nv);
    let count = link.points().len();
    let mut points = Vec::with_capacity(links * count);
    let mut faces = Faces::with_capacity(links * link.faces().len(), 3 * links * link.faces().len());
    for k in 0..links {
        let turned = |p: &DVec3| if k % 2 == 0 { *p } else { DVec3::new(p.x, -p.z, p.y) };
        points.extend(link.points().iter().map(|p| turned(p) + 1.5 * k as f64 * DVec3::X));
        for face in link.faces().iter() {
            faces.push(&face.iter().map(|v| v + (k * count) as u32).collect::<Vec<_>>());
        }
    }
    solid(points, faces)
}

/// A torus round the z-axis: `nu` sections round it, each a regular polygon of `nv` corners. nu·nv vertices, 2·nu·nv
/// triangles, genus 1. `major` is the distance of the sections' centres from the axis, `minor` that of their corners from
/// their centres. Volume: `nu sin(2π/nu) · nv/2 sin(2π/nv) · major · minor²`.
///
/// # Panics
///
/// Panics unless 0 < minor < major, both finite, and `nu` and `nv` are at least 3.
#[must_use]
pub fn uv_torus(major: f64, minor: f64, nu: usize, nv: usize) -> Mesh {
    assert_length("radius of a torus", major);
    assert!(minor > 0.0 && minor < major, "the minor radius is between 0 and {major}, not {minor}");
    assert!(nu >= 3 && nv >= 3, "a torus needs at least 3 sections of 3 corners, not {nu} of {nv}");
    let mut points = Vec::with_capacity(nu * nv);
    let mut faces = Faces::with_capacity(2 * nu * nv, 6 * nu * nv);
    for u in 0..nu {
        for v in 0..nv {
            let (height, out) = angle(v, nv).sin_cos();
            points.push(round_z(major + minor * out, minor * height, angle(u, nu)));
            let corner = |du: usize, dv: usize| ((u + du) % nu * nv + (v + dv) % nv) as u32;
            faces.push(&[corner(0, 0), corner(1, 0), corner(1, 1)]);
            faces.push(&[corner(0, 0), corner(1, 1), corner(0, 1)]);
        }
    }
    solid(points, faces)
}

/// A cylinder round the z-axis from z = 0 to `height`: an upright prism over a regular polygon of `segments` corners at
/// `radius`, with `rings` rows of rectangles and two caps of triangles. segments · (rings + 1) + 2 vertices; volume
/// `segments/2 sin(2π/segments) · radius² · height`.
///
/// # Panics
///
/// Panics where a length is not positive and finite, `segments` is less than 3, or `rings` is 0.
#[must_use]
pub fn cylinder(radius: f64, height: f64, segments: usize, rings: usize) -> Mesh {
    assert!(rings > 0, "a cylinder needs at least 1 ring");
    assert_length("radius of a cylinder", radius);
    assert_length("height of a cylinder", height);
    let profile: Vec<[f64; 2]> = (0..=rings).map(|r| [radius, height * (r as f64 / rings as f64)]).collect();
    revolved(&profile, segments)
}

/// A bottle without cavity, round the z-axis from z = 0 to 3: a body of radius 0.8 up to z = 1.5, shoulders, and from
/// z = 2.25 on a neck of radius 0.3. The radius of the shoulders is `0.8 − 0.5 t² (3 − 2t)`, `t = (z − 1.5) / 0.75`.
/// `rings` rows of trapezoids of equal height and two caps of triangles; segments · (rings + 1) + 2 vertices. Volume:
/// `segments/2 sin(2π/segments) Σ h (ρ² + ρσ + σ²) / 3` over the rows, of height h and with radii ρ and σ at their ends.
///
/// # Panics
///
/// Panics where `segments` is less than 3 or `rings` is 0.
#[must_use]
pub fn bottle(segments: usize, rings: usize) -> Mesh {
    revolved(&bottle_profile(rings), segments)
}

/// [`bottle`] as a closed shell of a thickness `wall`: a second component, inside out, is its cavity. Each ring of the bottle,
/// of radius ρ at height z, has a ring of radius ρ − wall at height `1.5 + (z − 1.5) (1 − 2 wall/3)` within, so floor and lid
/// are `wall` thick, and sides are so at their corners, measured across the axis. Twice the vertices and faces of the bottle. Capacity:
/// `segments/2 sin(2π/segments) Σ h (ρ² + ρσ + σ²) / 3` over the inner rows; the volume is that of the bottle less the capacity.
///
/// # Panics
///
/// Panics where `wall` is not between 0 and 0.3, the radius of the neck, `segments` is less than 3 or `rings` is 0.
#[must_use]
pub fn hollow_bottle(segments: usize, rings: usize, wall: f64) -> Mesh {
    assert!(wall > 0.0 && wall < 0.3, "the wall of a bottle is between 0 and 0.3 thick, not {wall}");
    let profile = bottle_profile(rings);
    let inner: Vec<[f64; 2]> =
        profile.iter().map(|[radius, z]| [radius - wall, 1.5 + (z - 1.5) * (1.0 - 2.0 * wall / 3.0)]).collect();
    hollowed(&revolved(&profile, segments), &revolved(&inner, segments))
}

/// The rings of [`bottle`], each [radius, z].
fn bottle_profile(rings: usize) -> Vec<[f64; 2]> {
    assert!(rings > 0, "a bottle needs at least 1 ring");
    let ring = |r: usize| {
        let z = 3.0 * (r as f64 / rings as f64);
        let t = ((z - 1.5) / 0.75).clamp(0.0, 1.0);
        [0.8 - 0.5 * t * t * (3.0 - 2.0 * t), z]
    };
    (0..=rings).map(ring).collect()
}

/// The solid round the z-axis between the rings of `profile`, each [radius, z], z ascending.
fn revolved(profile: &[[f64; 2]], segments: usize) -> Mesh {
    assert!(segments >= 3, "a solid of revolution needs at least 3 segments, not {segments}");
    let mut points = Vec::with_capacity(profile.len() * segments + 2);
    let mut faces = Faces::with_capacity(segments * (profile.len() + 1), segments * (4 * profile.len() + 2));
    for [radius, z] in profile {
        points.extend((0..segments).map(|s| round_z(*radius, *z, angle(s, segments))));
    }
    let (low, high) = (points.len() as u32, points.len() as u32 + 1);
    points.extend([profile[0], profile[profile.len() - 1]].map(|[_, z]| DVec3::Z * z));
    let corner = |ring: usize, s: usize| (ring * segments + s % segments) as u32;
    for ring in 1..profile.len() {
        for s in 0..segments {
            faces.push(&[corner(ring - 1, s), corner(ring - 1, s + 1), corner(ring, s + 1), corner(ring, s)]);
        }
    }
    for s in 0..segments {
        faces.push(&[low, corner(0, s + 1), corner(0, s)]);
        faces.push(&[high, corner(profile.len() - 1, s), corner(profile.len() - 1, s + 1)]);
    }
    solid(points, faces)
}

fn angle(part: usize, parts: usize) -> f64 {
    TAU * (part as f64 / parts as f64)
}

fn round_z(radius: f64, z: f64, angle: f64) -> DVec3 {
    let (sin, cos) = angle.sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}

fn assert_length(what: &str, length: f64) {
    assert!(length > 0.0 && length.is_finite(), "the {what} must be positive and finite, not {length}");
}

fn solid(points: Vec<DVec3>, faces: Faces) -> Mesh {
    Mesh::new(points, faces).expect("finite points and faces that name them")
}
