//! The geometry of a page's 3D view, as the viewer reads it.
//!
//! A JSON object: `triangles` (u32, three each), `edges` (u8 for each triangle: bit k is set where the side after corner k is an
//! edge of a face; null where all are), `up`, `unit`, `center`, `scale`, and `poses` with `points` (f32, three per vertex), `change`
//! (f32 per vertex, or null) and `lattice` (or null): `size`, `controls`, and of nodes that settle `springs` (u32, two ends each) and `held`
//! (u8 for each node: 1 where it is held), else null. Arrays are little-endian in base64.
//!
//! Positions p are stored as `(p − center) / unit` rounded to f32, `center` the middle of all poses and `unit` the power of
//! two at or above half their extent. So a model far from the origin does not shake, one of extent 1e-30 can be drawn, and
//! dividing costs no digits.
//!
//! Only vertices that a triangle names are stored, and of those that coincide in all poses one. What then is larger than [`MOST_BYTES`],
//! or has more than [`MOST_TRIANGLES`], is simplified: one list of triangles over the same vertices serves all poses.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;
use isochor::{Axis, Bounds, Faces, Mesh, NetKind, coarse_triangles, fan};
use serde_json::{Value, json};

use crate::show::{Show, ShownLattice, ShownPose};

/// More triangles: nothing that a screen could show; fewer: outlines become polygons on large screens.
pub const MOST_TRIANGLES: usize = 150_000;

/// Bytes of all arrays before base64, which adds a third. More: pages too large to send; fewer: loose triangles,
/// which share no vertices, and shows of many poses are simplified where others of as many triangles are not.
pub const MOST_BYTES: usize = 6_000_000;

/// Ends of the colour scale: the least that holds [`SHOWN_CHANGES`] of all local volume changes is taken.
const SCALES: [f64; 7] = [1.01, 1.05, 1.25, 1.5, 2.0, 4.0, 8.0];

/// Part of all local changes within the colour scale. More: one spoilt vertex makes all others pale; less: much is of one colour.
const SHOWN_CHANGES: f64 = 0.98;

/// What the viewer gets, and what the page says of it.
pub struct Geometry {
    pub json: String,
    /// Triangles of the model, and those embedded.
    pub triangles: [usize; 2],
    /// Faces that are left out because a corner is not finite in some pose.
    pub left_out: usize,
    /// The local volume change at the end of the colour scale; none where no pose has changes.
    pub scale: Option<f64>,
    pub has_lattice: bool,
    pub net: Option<NetKind>,
}

impl Geometry {
    /// Of what is shown, `up` above.
    ///
    /// # Panics
    ///
    /// Panics where poses have different numbers of points, or other arrays do not fit them, or a face names a missing vertex.
    pub fn of(show: &Show, up: Axis) -> Self {
        let vertices = show.poses.first().map_or(0, |pose| pose.points.len());
        for pose in &show.poses {
            assert_eq!(pose.points.len(), vertices, "points of the pose {:?} and of the first", pose.name);
            if let Some(change) = &pose.volume_change {
                assert_eq!(change.len(), vertices, "local volume changes and points of the pose {:?}", pose.name);
            }
            if let Some(lattice) = &pose.lattice {
                let [u, v, w] = lattice.size;
                let count = lattice.controls.len();
                assert_eq!(count, u * v * w, "control points of the pose {:?}", pose.name);
                if let Some(net) = &lattice.net {
                    assert_eq!(net.is_held.len(), count, "nodes that are held or not, of the pose {:?}", pose.name);
                    let is_node = |end: &u32| (*end as usize) < count;
                    assert!(net.ends.as_flattened().iter().all(is_node), "ends of lines of the pose {:?}", pose.name);
                }
            }
        }
        let is_shown: Vec<bool> =
            (0..vertices).map(|v| show.poses.iter().all(|pose| pose.points[v].is_finite())).collect();
        let is_whole = |face: &&[u32]| face.iter().all(|v| is_shown[*v as usize]);
        let faces: Faces = show.faces.iter().filter(is_whole).filter(|face| face.len() >= 3).collect();
        let frame = Fitted::new(show, &faces);
        let poses: Vec<Vec<[f32; 3]>> = show.poses.iter().map(|pose| frame.near(&pose.points)).collect();

        let mut surface = Surface::of(&faces);
        let all = surface.triangles.len();
        let mut most = MOST_TRIANGLES;
        let bytes_per_vertex: usize =
            show.poses.iter().map(|pose| if pose.volume_change.is_some() { 16 } else { 12 }).sum();
        let (kept, vertices) = loop {
            if surface.triangles.len() > most {
                surface = Surface::coarse(show, faces.clone(), &is_shown, most);
            }
            let (renumbered, vertices) = compacted(&surface.triangles, &poses);
            let bytes = 12 * renumbered.len() + bytes_per_vertex * vertices.len();
            // Nine tenths of what would do if all triangles had as many bytes.
            let fewer = (0.9 * most.min(renumbered.len()) as f64 * MOST_BYTES as f64 / bytes as f64) as usize;
            if bytes <= MOST_BYTES || fewer == 0 || renumbered.len() > 2 * most {
                break (renumbered, vertices);
            }
            most = fewer;
        };

        let at_places = |change: &[f64]| -> Vec<f32> { vertices.iter().map(|v| change[*v as usize] as f32).collect() };
        let changes: Vec<Option<Vec<f32>>> =
            show.poses.iter().map(|pose| pose.volume_change.as_deref().map(at_places)).collect();
        let scale = scale(changes.iter().flatten().flatten().copied());
        let (mut has_lattice, mut kind) = (false, None);
        let mut lattice = |shown: &ShownLattice| {
            let controls = frame.near(&shown.controls);
            let is_finite = controls.as_flattened().iter().all(|x| x.is_finite());
            has_lattice |= is_finite;
            if is_finite {
                let net = shown.net.as_deref();
                kind = kind.or(net.map(|net| net.kind));
                json!({
                    "size": shown.size,
                    "controls": floats(controls.as_flattened()),
                    "springs": net.map(|net| integers(net.ends.as_flattened())),
                    "held": net.map(|net| base64(net.is_held.iter().map(|held| u8::from(*held)))),
                })
            } else {
                Value::Null
            }
        };
        let pose = |(pose, shown): (usize, &ShownPose)| {
            let points: Vec<f32> = vertices.iter().flat_map(|v| poses[pose][*v as usize]).collect();
            json!({
                "points": floats(&points),
                "change": changes[pose].as_deref().map(floats),
                "lattice": shown.lattice.as_ref().map(&mut lattice),
            })
        };
        let shown: Vec<Value> = show.poses.iter().enumerate().map(pose).collect();
        let json = json!({
            "up": up.direction().to_array(),
            "unit": frame.unit,
            "center": frame.center.to_array(),
            "scale": scale,
            "triangles": integers(kept.as_flattened()),
            "edges": surface.edges.map(|edges| base64(edges.into_iter())),
            "poses": shown,
        });
        Self {
            // Within a script element only `<` could end it.
            json: json.to_string().replace('<', "\\u003c"),
            triangles: [all, kept.len()],
            left_out: show.faces.len() - show.faces.iter().filter(is_whole).count(),
            scale,
            has_lattice,
            net: kind,
        }
    }
}

/// Triangles, and which of their sides are edges of faces, if not all are.
struct Surface {
    triangles: Vec<[u32; 3]>,
    edges: Option<Vec<u8>>,
}

impl Surface {
    fn of(faces: &Faces) -> Self {
        let triangles = faces.iter().flat_map(fan).collect();
        // Of a fan the first side is an edge in the first triangle, the last in the last.
        let sides = |face: &[u32]| {
            let last = face.len() - 3;
            (0..=last).map(move |k| 2 | u8::from(k == 0) | u8::from(k == last) << 2)
        };
        let has_polygons = faces.iter().any(|face| face.len() > 3);
        Self { triangles, edges: has_polygons.then(|| faces.iter().flat_map(sides).collect()) }
    }

    fn coarse(show: &Show, faces: Faces, is_shown: &[bool], most: usize) -> Self {
        let place = |(p, is_shown): (&DVec3, &bool)| if *is_shown { *p } else { DVec3::ZERO };
        let points = show.poses[0].points.iter().zip(is_shown).map(place).collect();
        let mesh = Mesh::new(points, faces).expect("finite points, and faces that name them");
        Self { triangles: coarse_triangles(&mesh, most), edges: None }
    }
}

/// Where all poses are, and how large.
struct Fitted {
    center: DVec3,
    unit: f64,
}

impl Fitted {
    fn new(show: &Show, faces: &Faces) -> Self {
        let named =
            |points: &[DVec3]| Bounds::of(&faces.corners().iter().map(|v| points[*v as usize]).collect::<Vec<_>>());
        let union = |a: Bounds, b: Bounds| Bounds { min: a.min.min(b.min), max: a.max.max(b.max) };
        let Some(Bounds { min, max }) = show.poses.iter().filter_map(|pose| named(&pose.points)).reduce(union) else {
            return Self { center: DVec3::ZERO, unit: 1.0 };
        };
        // Halves first: sums of very large coordinates are infinite.
        let half = (max / 2.0 - min / 2.0).max_element();
        /// Powers of two that f64 has with all its digits.
        const EXPONENTS: [f64; 2] = [-1022.0, 1023.0];
        let exponent = half.log2().ceil().clamp(EXPONENTS[0], EXPONENTS[1]);
        Self { center: min / 2.0 + max / 2.0, unit: if half > 0.0 { 2f64.powi(exponent as i32) } else { 1.0 } }
    }

    fn near(&self, points: &[DVec3]) -> Vec<[f32; 3]> {
        points.iter().map(|p| ((*p - self.center) / self.unit).as_vec3().to_array()).collect()
    }
}

/// Triangles between numbered places, and a vertex at each place: vertices that coincide in all poses are one place, numbered as
/// they are first named.
fn compacted(triangles: &[[u32; 3]], poses: &[Vec<[f32; 3]>]) -> (Vec<[u32; 3]>, Vec<u32>) {
    let vertices = poses.first().map_or(0, Vec::len);
    let mut first = vec![u32::MAX; vertices];
    triangles.as_flattened().iter().for_each(|v| first[*v as usize] = *v);
    let mut named: Vec<u32> = first.iter().copied().filter(|v| *v != u32::MAX).collect();
    let order = |a: &u32, b: &u32| {
        let of = |v: u32| poses.iter().flat_map(move |points| points[v as usize]).map(|x| x + 0.0); // −0 is 0
        of(*a).partial_cmp(of(*b)).unwrap_or(std::cmp::Ordering::Equal)
    };
    named.sort_by(|a, b| order(a, b).then(a.cmp(b)));
    for group in named.chunk_by(|a, b| order(a, b).is_eq()) {
        group.iter().for_each(|v| first[*v as usize] = group[0]);
    }
    let mut number = vec![u32::MAX; vertices];
    let mut places = Vec::new();
    let mut numbered = |v: &u32| {
        let v = first[*v as usize];
        if number[v as usize] == u32::MAX {
            number[v as usize] = places.len() as u32;
            places.push(v);
        }
        number[v as usize]
    };
    let triangles = triangles.iter().map(|t| t.each_ref().map(&mut numbered)).collect();
    (triangles, places)
}

/// End of the colour scale; none without changes.
fn scale(changes: impl Iterator<Item = f32>) -> Option<f64> {
    let mut logarithms: Vec<f64> = changes.map(|c| f64::from(c).ln().abs()).collect();
    if logarithms.is_empty() {
        return None;
    }
    logarithms.retain(|l| l.is_finite());
    logarithms.sort_by(f64::total_cmp);
    let most = logarithms.get((logarithms.len() as f64 * SHOWN_CHANGES) as usize).copied().unwrap_or(0.0);
    Some(SCALES.into_iter().find(|scale| most <= scale.ln()).unwrap_or(SCALES[SCALES.len() - 1]))
}

fn floats(values: &[f32]) -> String {
    base64(values.iter().flat_map(|x| x.to_le_bytes()))
}

fn integers(values: &[u32]) -> String {
    base64(values.iter().flat_map(|x| x.to_le_bytes()))
}

fn base64(bytes: impl Iterator<Item = u8>) -> String {
    STANDARD.encode(bytes.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_ends_where_nearly_all_changes_are_within() {
        assert_eq!(scale(std::iter::empty()), None);
        assert_eq!(scale([1.0; 100].into_iter()), Some(1.01));
        assert_eq!(scale([1.0, 0.6, 1.3].into_iter()), Some(2.0));
        assert_eq!(scale([1.0, 1e-9].into_iter()), Some(8.0));
        let one_spoilt = (0..100).map(|v| if v == 7 { 1e9 } else { 1.2 });
        assert_eq!(scale(one_spoilt), Some(1.25));
        assert_eq!(scale([-1.0, 0.0, f32::NAN, f32::INFINITY].into_iter()), Some(1.01));
    }
}
