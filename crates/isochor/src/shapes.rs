//! Closed solids of known volume, for tests, examples and pictures.
//!
//! Faces are counter-clockwise seen from outside, and vertices are shared: there is one at each place. Volumes are those of
//! the polygonal solids themselves, not of the smooth shapes they stand for.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec2, DVec3};

use crate::mesh::{Faces, Mesh};
use crate::parametric_solid::ParametricSolid;

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

/// The box [0, 2] × [0, 1] × [0, 0.8] with bosses on its sides, 4 along x and 2 along y and z, so that one sees what becomes
/// of it: with `n` × `n` quads on each side, 6n² + 2 vertices. At fractions u and v of a side with p and q bosses it stands
/// out by `0.06 sin²(p π u) sin²(q π v)`. The sum of sin² over equal parts is half their number, so the volume is that of the
/// box and 0.015 times the area of its sides: `1.6 + 0.015 · 8.8`.
///
/// # Panics
///
/// Panics where `n` is less than 5: bosses need more parts than there are of them.
#[must_use]
pub fn embossed_box(n: usize) -> Mesh {
    const SIZE: DVec3 = DVec3::new(2.0, 1.0, 0.8);
    const BOSSES: DVec3 = DVec3::new(4.0, 2.0, 2.0);
    const HEIGHT: f64 = 0.06;
    assert!(n >= 5, "an embossed box needs at least 5 quads along every side, not {n}");
    let smooth = block(SIZE, [n; 3]);
    let wave = |p: DVec3, axis: usize| libm::sin(PI * BOSSES[axis] * (p[axis] / SIZE[axis])).powi(2);
    let embossed = |p: &DVec3| {
        let mut moved = *p;
        for axis in 0..3 {
            let height = HEIGHT * wave(*p, (axis + 1) % 3) * wave(*p, (axis + 2) % 3);
            if p[axis] == 0.0 {
                moved[axis] -= height;
            } else if p[axis] == SIZE[axis] {
                moved[axis] += height;
            }
        }
        moved
    };
    solid(smooth.points().iter().map(embossed).collect(), smooth.faces().clone())
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
    let ear = |d: DVec3, e: DVec3| EARS.0 * libm::exp(EARS.1 * (d.dot(e) - 1.0));
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
            let (height, out) = libm::sincos(angle(v, nv));
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

/// A screwdriver round the z-axis from z = 0 to 3: a flat blade, a shaft, and a handle with 8 flutes. `2n` rows of quads of
/// equal height round `n` corners each, and two caps of triangles; n (2n + 1) + 2 vertices. Corner s of the ring at height z
/// is at `(a ρ cos φ, b ρ sin φ)`, `φ = 2π s/n`, `ρ = 1 + f cos 8φ`; a, b and f go in smooth steps along z. The area of a
/// ring is `n/2 sin(2π/n) a b (1 + f²/2 cos(16π/n))`, unless n divides 16.
///
/// # Panics
///
/// Panics where `n` is less than 3.
#[must_use]
pub fn screwdriver(n: usize) -> Mesh {
    assert!(n >= 3, "a screwdriver needs at least 3 segments, not {n}");
    let ring = |row: usize| {
        let z = 3.0 * (row as f64 / (2 * n) as f64);
        // From the blade to the shaft, on to the handle, and its round end.
        let (shaft, handle, end) = (step(z, 0.0, 0.6), step(z, 1.55, 1.75), step(z, 2.7, 3.0));
        let round = 0.22 * handle - 0.08 * end;
        let (a, b) = (0.16 - 0.08 * shaft + round, 0.025 + 0.055 * shaft + round);
        let flutes = 0.08 * step(z, 1.65, 1.9) * (1.0 - end);
        let corner = move |s: usize| {
            let angle = angle(s, n);
            let (sin, cos) = libm::sincos(angle);
            let rho = 1.0 + flutes * libm::cos(8.0 * angle);
            DVec3::new(a * rho * cos, b * rho * sin, z)
        };
        (0..n).map(corner).collect()
    };
    lofted(&(0..=2 * n).map(ring).collect::<Vec<Vec<DVec3>>>())
}

/// A dolphin from its nose at x = 0 to its flukes at x = 3, swimming along −x, its back up along z: `2n` rows of quads of equal length
/// round `n` corners each, and two caps of triangles; n (2n + 1) + 2 vertices. Corner s of the ring at x is at
/// `(x, a ρ cos φ, b ρ sin φ)`, `φ = 2π s/n`, with `ρ = 1 + f sin²⁴ φ` on the back, where the fin is, and 1 below; a, b and f go in smooth
/// steps along x. As n grows the volume tends to `∫ a b ∫ ρ²/2 dφ dx`.
///
/// # Panics
///
/// Panics where `n` is less than 3.
#[must_use]
pub fn dolphin(n: usize) -> Mesh {
    assert!(n >= 3, "a dolphin needs at least 3 segments, not {n}");
    let ring = |row: usize| {
        let x = 3.0 * (row as f64 / (2 * n) as f64);
        let [a, b, f] = dolphin_section(x);
        let corner = move |s: usize| {
            let (sin, cos) = libm::sincos(angle(s, n));
            let cubed = sin.max(0.0) * sin * sin;
            let sixth = cubed * cubed;
            let rho = 1.0 + f * sixth * sixth * sixth * sixth;
            DVec3::new(a * rho * cos, b * rho * sin, x)
        };
        (0..n).map(corner).collect()
    };
    let upright = lofted(&(0..=2 * n).map(ring).collect::<Vec<Vec<DVec3>>>());
    solid(upright.points().iter().map(|p| DVec3::new(p.z, p.x, p.y)).collect(), upright.faces().clone())
}

/// Half width, half height, and height of the fin over it, of [`dolphin`] at x.
fn dolphin_section(x: f64) -> [f64; 3] {
    // An elliptic head, which grows thin towards the tail, where the flukes are.
    let head = (x / 1.05).min(1.0);
    let body = 0.08 + 0.92 * (head * (2.0 - head)).sqrt();
    let (tail, flukes) = (step(x, 1.2, 2.6), step(x, 2.55, 2.9));
    let fin = step(x, 1.1, 1.5) * (1.0 - step(x, 1.5, 1.7));
    [0.34 * body * (1.0 - 0.82 * tail) + 0.45 * flukes, 0.38 * body * (1.0 - 0.82 * tail) - 0.04 * flukes, 0.8 * fin]
}

/// HML's rounded club, [`ParametricSolid::club`], as a mesh of at least so many triangles: 4m (m − 1) with 2m (m − 1) + 2 vertices, m the least that
/// will do, and at least 5. The volume tends to that of the smooth club with the reciprocal of the number of triangles.
///
/// # Panics
///
/// Panics where there are more triangles than can be numbered.
#[must_use]
pub fn club(triangles: usize) -> Mesh {
    ParametricSolid::club().sampled(triangles).expect("a number of triangles")
}

/// 0 up to `from`, 1 from `to` on, and `t² (3 − 2t)` between.
fn step(z: f64, from: f64, to: f64) -> f64 {
    let t = ((z - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A round stone with bumps, in as many vertices as one likes: at the direction (x, y, z) its surface is at the distance
/// `∛(1 + 0.5 sin 3x cos 2y + 0.3 sin 4z)`. Rings round the z-axis between two poles, with triangles of about one size and shape:
/// 2 · `vertices` − 4 of them.
///
/// What is added to 1 is odd, so it cancels in `∫ r³ / 3` over the sphere: the volume tends to 4π/3 with the reciprocal of the number
/// of vertices.
///
/// # Panics
///
/// Panics where `vertices` is less than 5: two poles and a ring of three.
#[must_use]
pub fn stone(vertices: usize) -> Mesh {
    assert!(vertices >= 5, "a stone needs at least 5 vertices, not {vertices}");
    let in_rings = vertices - 2;
    // Where triangles are equilateral, there are 2 √3 / π vertices for the square of the number of strips between rings.
    let strips = (in_rings as f64 * PI / (2.0 * 3.0_f64.sqrt())).sqrt().round() as usize;
    let rings = strips.saturating_sub(1).clamp(1, in_rings / 3);
    let polar = |ring: usize| PI * ((ring + 1) as f64 / (rings + 1) as f64);
    // Three vertices for every ring, and the others by circumference: what all rings up to one have, rounded down.
    let others = in_rings - 3 * rings;
    let circumferences: f64 = (0..rings).map(|ring| polar(ring).sin()).sum();
    let (mut sum, mut shared_out) = (0.0, 0);
    let sizes: Vec<usize> = (0..rings)
        .map(|ring| {
            sum += polar(ring).sin() / circumferences;
            let so_far = if ring + 1 == rings { others } else { others.min((others as f64 * sum) as usize) };
            3 + so_far - std::mem::replace(&mut shared_out, so_far)
        })
        .collect();

    let surface = |direction: DVec3| {
        let DVec3 { x, y, z } = direction;
        direction * (1.0 + 0.5 * (3.0 * x).sin() * (2.0 * y).cos() + 0.3 * (4.0 * z).sin()).cbrt()
    };
    // Every other ring is turned by half a segment.
    let turn = |ring: usize| (ring % 2) as f64 / 2.0;
    let mut points = vec![surface(-DVec3::Z)];
    for (ring, &size) in sizes.iter().enumerate() {
        let (sin, cos) = polar(ring).sin_cos();
        points.extend((0..size).map(|s| surface(round_z(sin, -cos, TAU * ((s as f64 + turn(ring)) / size as f64)))));
    }
    points.push(surface(DVec3::Z));

    let mut faces = Faces::with_capacity(2 * vertices - 4, 3 * (2 * vertices - 4));
    let mut push = |corners: [usize; 3]| faces.push(&corners.map(|v| v as u32));
    let mut first = 1;
    (0..sizes[0]).for_each(|s| push([0, first + (s + 1) % sizes[0], first + s]));
    for ring in 1..rings {
        let (below, above) = (sizes[ring - 1], sizes[ring]);
        let next = first + below;
        let (mut i, mut j) = (0, 0);
        while i < below || j < above {
            let (low, high) = (first + i % below, next + j % above);
            // The corner that comes next round the axis.
            let angle = |corner: usize, ring: usize, size: usize| (corner as f64 + 1.0 + turn(ring)) / size as f64;
            if j == above || (i < below && angle(i, ring - 1, below) <= angle(j, ring, above)) {
                i += 1;
                push([low, first + i % below, high]);
            } else {
                j += 1;
                push([low, next + j % above, high]);
            }
        }
        first = next;
    }
    let size = sizes[rings - 1];
    (0..size).for_each(|s| push([first + size, first + s, first + (s + 1) % size]));
    solid(points, faces)
}

/// A cup with a handle, one closed surface of genus 1: round the z-axis from z = 0 to 1.6, of radius `0.65 + 0.1 z` at height
/// z, with a wall 0.08 and a floor 0.1 thick; the handle, towards +x, is a tube of elliptic sections (half axes 0.1 and 0.08)
/// whose centres lie on half a circle of radius 0.4. The wall has `24n` segments, 8n rows without and within, and the ends of
/// the tube take the place of n × n of its quads each.
///
/// Its volume is that of the cup without handle, frusta of 24n sides, and of the tube, which tends to `0.4 π · 0.1 · 0.08 π` but for
/// its first and last section, where it becomes a square patch of the wall.
///
/// # Panics
///
/// Panics where `n` is 0.
#[must_use]
pub fn cup(n: usize) -> Mesh {
    const HEIGHT: f64 = 1.6;
    const WALL: f64 = 0.08;
    const FLOOR: f64 = 0.1;
    /// Half axes of the handle's sections, along y and across; the radius of the circle of their centres.
    const HANDLE: [f64; 3] = [0.1, 0.08, 0.4];
    assert!(n > 0, "a cup needs at least 1 quad at each end of its handle");
    let (segments, rows) = (24 * n, 8 * n);
    let radius = |z: f64| 0.65 + 0.1 * z;
    // Up the outer wall, over the rim, and down the inner one.
    let part = |r: usize| r as f64 / rows as f64;
    let outer = (0..=rows).map(|r| [radius(HEIGHT * part(r)), HEIGHT * part(r)]);
    let inner = (0..=rows).rev().map(|r| {
        let z = FLOOR + (HEIGHT - FLOOR) * part(r);
        [radius(z) - WALL, z]
    });
    let body = revolved(&outer.chain(inner).collect::<Vec<_>>(), segments);
    // The handle's plane is the middle of the first n segments.
    let turn = DMat3::from_rotation_z(-angle(n, segments) / 2.0);
    let mut points: Vec<DVec3> = body.points().iter().map(|p| turn * *p).collect();

    // Rows of the wall where the handle begins and ends. Their quads are the first faces of the body, row after row.
    let (above, below) = (6 * n, 2 * n);
    let is_joint = |face: usize| {
        let (row, segment) = (face / segments, face % segments);
        segment < n && [above, below].iter().any(|first| (*first..first + n).contains(&row))
    };
    let mut faces = Faces::new();
    for (_, face) in body.faces().iter().enumerate().filter(|(f, _)| !is_joint(*f)) {
        faces.push(face);
    }

    // Round the square [0, n]², counter-clockwise as seen from outside above.
    let square: Vec<[usize; 2]> = (0..n)
        .map(|i| [i, 0])
        .chain((0..n).map(|i| [n, i]))
        .chain((0..n).map(|i| [n - i, n]))
        .chain((0..n).map(|i| [0, n - i]))
        .collect();
    let wall = |row: usize, segment: usize| (row * segments + segment) as u32;
    let sections = 8 * n;
    let middle = [above, below].map(|first| HEIGHT * (first as f64 + n as f64 / 2.0) / rows as f64);
    let mut before: Vec<u32> = square.iter().map(|[u, v]| wall(above + v, *u)).collect();
    for section in 1..=sections {
        let next: Vec<u32> = if section == sections {
            square.iter().map(|[u, v]| wall(below + n - v, *u)).collect()
        } else {
            let (sin, cos) = libm::sincos(PI * (section as f64 / sections as f64));
            let radial = DVec3::new(sin, 0.0, cos);
            let height = f64::midpoint(middle[0], middle[1]);
            let foot = radius(height + HANDLE[2] * cos);
            let center = DVec3::new(foot, 0.0, height) + HANDLE[2] * radial;
            let corner = |[u, v]: &[usize; 2]| {
                let from_middle = |i: usize| i as f64 - n as f64 / 2.0;
                let out = DVec2::new(from_middle(*u), from_middle(*v)).normalize();
                center + HANDLE[0] * out.x * DVec3::Y + HANDLE[1] * out.y * radial
            };
            let first = points.len() as u32;
            points.extend(square.iter().map(corner));
            (first..points.len() as u32).collect()
        };
        for i in 0..square.len() {
            let j = (i + 1) % square.len();
            faces.push(&[before[i], before[j], next[j], next[i]]);
        }
        before = next;
    }
    without_unused(&points, &faces)
}

/// The solid with these faces, its unused vertices left out.
fn without_unused(points: &[DVec3], faces: &Faces) -> Mesh {
    let mut is_used = vec![false; points.len()];
    faces.iter().flatten().for_each(|v| is_used[*v as usize] = true);
    let mut count = 0;
    let number = |used: &bool| {
        count += u32::from(*used);
        count.saturating_sub(1)
    };
    let numbers: Vec<u32> = is_used.iter().map(number).collect();
    let kept = points.iter().zip(&is_used).filter(|(_, used)| **used).map(|(p, _)| *p).collect();
    let mut renumbered = Faces::new();
    for face in faces.iter() {
        renumbered.push(&face.iter().map(|v| numbers[*v as usize]).collect::<Vec<_>>());
    }
    solid(kept, renumbered)
}

/// The solid round the z-axis between the rings of `profile`, each [radius, z], from below.
fn revolved(profile: &[[f64; 2]], segments: usize) -> Mesh {
    assert!(segments >= 3, "a solid of revolution needs at least 3 segments, not {segments}");
    let ring = |[radius, z]: &[f64; 2]| (0..segments).map(|s| round_z(*radius, *z, angle(s, segments))).collect();
    lofted(&profile.iter().map(ring).collect::<Vec<Vec<DVec3>>>())
}

/// The solid between rings of as many corners each, counter-clockwise seen from above, with caps round the z-axis at both ends.
fn lofted(rings: &[Vec<DVec3>]) -> Mesh {
    let segments = rings[0].len();
    let mut points = rings.concat();
    let mut faces = Faces::with_capacity(segments * (rings.len() + 1), segments * (4 * rings.len() + 2));
    let (low, high) = (points.len() as u32, points.len() as u32 + 1);
    points.extend([rings[0][0], rings[rings.len() - 1][0]].map(|p| DVec3::Z * p.z));
    let corner = |ring: usize, s: usize| (ring * segments + s % segments) as u32;
    for ring in 1..rings.len() {
        for s in 0..segments {
            faces.push(&[corner(ring - 1, s), corner(ring - 1, s + 1), corner(ring, s + 1), corner(ring, s)]);
        }
    }
    for s in 0..segments {
        faces.push(&[low, corner(0, s + 1), corner(0, s)]);
        faces.push(&[high, corner(rings.len() - 1, s), corner(rings.len() - 1, s + 1)]);
    }
    solid(points, faces)
}

fn angle(part: usize, parts: usize) -> f64 {
    TAU * (part as f64 / parts as f64)
}

fn round_z(radius: f64, z: f64, angle: f64) -> DVec3 {
    let (sin, cos) = libm::sincos(angle);
    DVec3::new(radius * cos, radius * sin, z)
}

fn assert_length(what: &str, length: f64) {
    assert!(length > 0.0 && length.is_finite(), "the {what} must be positive and finite, not {length}");
}

fn solid(points: Vec<DVec3>, faces: Faces) -> Mesh {
    Mesh::new(points, faces).expect("finite points and faces that name them")
}
