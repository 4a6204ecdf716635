//! Witness points of a cage: places inside the model at which local stress is measured. CVB, section 4.

use glam::{DVec2, DVec3};

use crate::mesh::Bounds;
use crate::volume::{Solid, lossless_origin};

/// Points of a cubic grid that are inside the body with its vertices at `points` (#vertices × 3), bottom to top, line by line: at least `count`, or none where
/// the body has no volume, or is so thin that the grid would have more than [`LINES`] lines. Inside is what the surface and its caps wind round other than 0
/// times.
pub(crate) fn inside(solid: &Solid, points: &[DVec3], count: usize) -> Vec<DVec3> {
    /// Grids that are tried. More: time; fewer: bodies whose volume says little of their inside have too few.
    const GRIDS: usize = 16;

    /// Each is finer than the last by this factor at least, and at most by the other. Nearer to 1: more grids, and fewer points than needed; farther: more points than
    /// are asked for.
    const FINER: [f64; 2] = [0.96, 0.5];
    let (origin, points) = (lossless_origin(points), solid.points_with_apexes(points));
    let Some(bounds) = Bounds::of(&points) else { return Vec::new() };
    let size = bounds.size();
    let volume = solid.volume(&points[..solid.vertex_count()]).abs();
    let mut spacing = (volume / count.max(1) as f64).cbrt();
    for _ in 0..GRIDS {
        if spacing * spacing * LINES < size.x * size.y || spacing == 0.0 {
            break;
        }
        let found = on_grid(solid, &points, bounds, spacing);
        if found.len() >= count {
            return found.into_iter().map(|p| p + origin).collect();
        }
        let needed = (found.len() as f64 / count as f64).cbrt();
        spacing *= (FINER[0] * needed).max(FINER[1]);
    }
    Vec::new()
}

/// The most lines of a grid. More: memory, 24 bytes for each time that one goes through the surface; fewer: thin bodies have no points.
const LINES: f64 = 4e6;

/// Where a line along z goes through the surface, and how it winds there.
struct Crossing {
    line: usize,
    z: f64,
    /// Winding numbers change by this from below to above.
    change: i32,
}

fn on_grid(solid: &Solid, points: &[DVec3], bounds: Bounds, spacing: f64) -> Vec<DVec3> {
    /// Where the grid begins, in spacings: numbers that have little to do with the vertices of models, so that lines miss their edges.
    const OFFSET: DVec3 = DVec3::new(0.414_213_562, 0.732_050_808, 0.236_067_977);
    let first = bounds.min + OFFSET * spacing;
    let along = |from: f64, to: f64| ((to - from) / spacing).max(0.0).ceil() as usize;
    let [columns, lines] = [0, 1].map(|x| along(first[x], bounds.max[x]));
    let mut crossings = Vec::new();
    for triangle in solid.all_triangles() {
        let corners = triangle.map(|v| points[v as usize]);
        let flat = corners.map(DVec3::truncate);
        let doubled = (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]);
        if doubled == 0.0 {
            continue;
        }
        let range = |x: usize, count: usize| {
            let [low, high] = [f64::min, f64::max].map(|of| flat.iter().map(|p| p[x]).reduce(of).unwrap_or_default());
            along(first[x], low).min(count)..along(first[x], high).min(count)
        };
        for j in range(1, lines) {
            for i in range(0, columns) {
                let at = first.truncate() + DVec2::new(i as f64, j as f64) * spacing;
                let weights = [0, 1, 2].map(|k| (flat[(k + 1) % 3] - at).perp_dot(flat[(k + 2) % 3] - at) / doubled);
                if weights.iter().all(|w| *w >= 0.0) {
                    let z = weights.iter().zip(corners).map(|(w, p)| w * p.z).sum();
                    crossings.push(Crossing { line: j * columns + i, z, change: if doubled > 0.0 { -1 } else { 1 } });
                }
            }
        }
    }
    crossings.sort_by(|a, b| a.line.cmp(&b.line).then(a.z.total_cmp(&b.z)));
    let mut inside = Vec::new();
    for line in crossings.chunk_by(|a, b| a.line == b.line) {
        // A line through an edge may count it twice, or not at all.
        if line.iter().map(|crossing| crossing.change).sum::<i32>() != 0 {
            continue;
        }
        let (i, j) = (line[0].line % columns, line[0].line / columns);
        let mut winding = 0;
        for pair in line.windows(2) {
            winding += pair[0].change;
            if winding != 0 {
                let place = |k: usize| first + DVec3::new(i as f64, j as f64, k as f64) * spacing;
                inside.extend((along(first.z, pair[0].z)..along(first.z, pair[1].z)).map(place));
            }
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::shapes;
    use crate::topology::topology;
    use crate::volume::OpenBoundaries;

    fn solid(mesh: &Mesh) -> Solid {
        Solid::new(mesh, &topology(mesh), OpenBoundaries::Refuse).unwrap()
    }

    /// A torus about z, far away: all are in the tube, and their mean is its centre.
    #[test]
    fn they_are_inside_and_spread_evenly() {
        let far = DVec3::new(1e3, -2e3, 500.0);
        let mesh = shapes::uv_torus(2.0, 0.5, 96, 48);
        let mesh = mesh.with_points(mesh.points().iter().map(|p| *p + far).collect()).unwrap();
        let found = inside(&solid(&mesh), mesh.points(), 2000);
        assert!((2000..2600).contains(&found.len()), "{}", found.len());
        for p in &found {
            let p = *p - far;
            let tube = (p.truncate().length() - 2.0).hypot(p.z);
            assert!(tube < 0.502, "{p}"); // chords of the inner circle are in the hole
        }
        let mean = found.iter().sum::<DVec3>() / found.len() as f64;
        assert!((mean - far).length() < 0.05, "{}", mean - far);
    }

    /// Of a hollow ball none are in the hollow: the shells wind the other way.
    #[test]
    fn cavities_have_none() {
        let hollow = shapes::hollow_sphere(3, 0.8);
        let found = inside(&solid(&hollow), hollow.points(), 300);
        assert!(found.len() >= 300 && found.iter().all(|p| p.length() > 0.78 && p.length() < 1.0));
    }

    /// Tilted plates: down to a millionth of their length in thickness they have points, and where they would take too many lines, none.
    #[test]
    fn thin_bodies_have_points_or_none() {
        for (thickness, has_points) in [(1e-3, true), (1e-6, true), (1e-13, false)] {
            let plate = shapes::plate(DVec3::new(1.0, 1.0, thickness), [2, 2]);
            let tilt = glam::DMat3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 0.7);
            let plate = plate.with_points(plate.points().iter().map(|p| tilt * *p).collect()).unwrap();
            let found = inside(&solid(&plate), plate.points(), 50);
            assert!(
                if has_points { (50..200).contains(&found.len()) } else { found.is_empty() },
                "{thickness}: {}",
                found.len()
            );
            let middle = tilt.transpose() * plate.bounds().unwrap().center();
            for p in &found {
                let off = tilt.transpose() * *p - middle;
                assert!(
                    off.abs().cmple(DVec3::new(0.5, 0.5, 0.5 * thickness) * (1.0 + 1e-6)).all(),
                    "{thickness}: {off}"
                );
            }
        }
    }

    #[test]
    fn flat_bodies_have_none() {
        let flat = shapes::cube(2);
        let flat = flat.with_points(flat.points().iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect()).unwrap();
        assert_eq!(inside(&solid(&flat), flat.points(), 100), []);
    }
}
