//! A second opinion on a correction: dense matrices, its own volume, gradient, metric and points, and no call to the library but for W,
//! the matrix of an energy and the origin from which coordinates are taken.
//!
//! Lengths are in a power of two near the extent of the pose, so nothing overflows and nothing is rounded on the way.

pub mod case;
pub mod dense;
mod metric;
mod refused;

use case::Case;
use dense::{Decomposed, Twice};
use glam::DVec3;
use isochor::{Bounds, Components, CorrectError, Correction, Method, Status, displaced};
use metric::Space;

/// Points are met to this fraction of the extent, volumes to this fraction of themselves: the promises.
const POINT: f64 = 1e-12;
const VOLUME: f64 = 1e-13;

pub struct Judge<'a> {
    case: &'a Case,
    unit: f64,
    origin: DVec3,
    /// Posed vertices less the origin, in units: exact.
    near: Vec<DVec3>,
    extent: f64,
    weights: Vec<Vec<(usize, f64)>>,
    controls: usize,
    /// Component and corners of each triangle; from #vertices on a corner is the apex.
    triangles: Vec<(usize, [usize; 3])>,
    /// The vertices of the one boundary that a model of these may have.
    rim: Vec<usize>,
    components: usize,
    coordinates: Space,
    goals: Vec<Goal>,
    /// By how much each point is to move, in units.
    moves: Vec<DVec3>,
}

#[derive(Clone)]
struct Goal {
    /// 0 or 1 for each component.
    members: Vec<f64>,
    target: f64,
}

/// Controls moved by δ, and vertices, in units.
#[derive(Clone)]
struct Place {
    delta: Vec<DVec3>,
    vertices: Vec<DVec3>,
}

/// ∇V of a goal.
struct Slope {
    /// By controls (#controls × 3).
    controls: Vec<DVec3>,
    /// Σ |∂V/∂p|, and Σ |∂V/∂p| |p|.
    spread: f64,
    moment: f64,
}

type Verdict = Result<&'static str, String>;

/// `Err` with what is said, unless `holds`.
fn ensure(holds: bool, said: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(said()) }
}

impl<'a> Judge<'a> {
    pub fn new(case: &'a Case) -> Self {
        let bounds = Bounds::of(&case.posed).unwrap();
        let (unit, origin) = (bounds.extent().log2().round().exp2(), bounds.lossless_origin());
        let near: Vec<DVec3> = case.posed.iter().map(|p| (*p - origin) / unit).collect();
        let (triangles, rim, components) = surface(case);
        let controls = case.binding.control_count();
        let members = |these: &Components| match these {
            Components::All => vec![1.0; components],
            Components::These(these) => (0..components).map(|c| f64::from(u8::from(these.contains(&c)))).collect(),
        };
        let volumes = &case.wanted.volumes;
        Self {
            unit,
            origin,
            near,
            extent: bounds.extent() / unit,
            weights: (0..case.posed.len()).map(|v| case.binding.weights(v)).collect(),
            controls,
            triangles,
            rim,
            components,
            coordinates: Space::along(&DVec3::AXES, &case.mobility(), case.options.energy.as_ref()),
            goals: volumes
                .iter()
                .map(|goal| Goal { members: members(&goal.components), target: goal.volume / unit / unit / unit })
                .collect(),
            moves: case.wanted.points.iter().map(|p| (p.target - p.position) / unit).collect(),
            case,
        }
    }

    /// What the answer is called where it is right, or what is wrong with it.
    pub fn verdict(&self, answer: &Result<Correction, CorrectError>) -> Verdict {
        match answer {
            Ok(corrected) => self.met(corrected),
            Err(CorrectError::Impossible { goal, reason, .. }) => self.refused(*goal, reason),
            Err(CorrectError::Target { target }) if *target == 0.0 => Ok("bad target"),
            Err(other) => Err(format!("refused as bad input: {other}")),
        }
    }

    /// Checks what has been met.
    fn met(&self, corrected: &Correction) -> Verdict {
        let delta: Vec<DVec3> = corrected.displacement.iter().map(|d| *d / self.unit).collect();
        ensure(delta.len() == self.controls && delta.iter().all(|d| d.is_finite()), || "δ is no displacement".into())?;
        for (i, (m, d)) in self.case.mobility().iter().zip(&corrected.displacement).enumerate() {
            let is_still = (0..3).all(|a| m[a] > 0.0 || d[a].to_bits() == 0);
            ensure(is_still, || format!("pinned control {i} moves by {d}"))?;
        }
        // X + W δ without rounding, and what rounding its coordinates may do to a volume.
        let exact = self.exactly(&delta);
        let vertices: Vec<DVec3> = exact.iter().map(|p| DVec3::from_array(p.map(Twice::value))).collect();
        let volumes = self.volumes(&exact);
        let reach = delta.iter().map(|d| d.length()).fold(self.extent, f64::max);
        let place = Place { vertices, delta };
        let far = 4.0 * f64::EPSILON * self.origin.length() / self.unit;
        for (v, (p, q)) in place.vertices.iter().zip(&corrected.vertices).enumerate() {
            let off = (*p - (*q - self.origin) / self.unit).length();
            ensure(off <= 1e-14 * reach + far, || format!("vertex {v} is {off:e} off X + W δ"))?;
        }
        let returned: Vec<[Twice; 3]> =
            corrected.vertices.iter().map(|p| ((*p - self.origin) / self.unit).to_array().map(Twice::from)).collect();
        let returned = self.volumes(&returned);
        for (g, goal) in self.goals.iter().enumerate() {
            let rounding = 4.0 * f64::EPSILON * self.slope(goal, &place.vertices).moment / goal.target.abs();
            let error = (goal.of(&volumes) / goal.target - 1.0).abs();
            ensure(error <= VOLUME + rounding, || format!("volume {g} of X + W δ is {error:e} off ({rounding:e})"))?;
            let error = (goal.of(&returned) / goal.target - 1.0).abs();
            let is_near = self.origin == DVec3::ZERO;
            ensure(!is_near || error <= VOLUME, || format!("volume {g} of the vertices is {error:e} off"))?;
        }
        ensure(corrected.relative_error <= VOLUME, || format!("it says {:e}", corrected.relative_error))?;
        for (k, (point, by)) in self.case.wanted.points.iter().zip(&self.moves).enumerate() {
            let along = |a: usize| {
                let sum = |sum: Twice, (c, w): &(usize, f64)| sum + Twice::from(*w) * Twice::from(place.delta[*c][a]);
                (Twice::from(by[a]) - point.weights.iter().fold(Twice::default(), sum)).value()
            };
            let off = DVec3::new(along(0), along(1), along(2)).length();
            ensure(off <= POINT * self.extent, || format!("point {k} is {off:e} off"))?;
        }
        ensure(corrected.point_error <= POINT, || format!("it says points are {:e} off", corrected.point_error))?;
        match &self.case.options.method {
            _ if corrected.status == Status::AlreadyMet => {
                ensure(place.delta.iter().all(|d| *d == DVec3::ZERO), || "already met, and moved".into())?;
                return Ok("already met");
            }
            Method::Axes { directions, .. } => {
                for d in &place.delta {
                    let across = across(directions, *d).length();
                    ensure(across <= 1e-13 * d.length(), || format!("a control moves {across:e} off the axes"))?;
                }
            }
            Method::Nearest => {
                let residual = self.residual(&place);
                let said = corrected.residual.unwrap_or(f64::NAN);
                ensure(corrected.status == Status::Exact, || format!("not nearest: {residual:e}, it says {said:e}"))?;
                // Energies have a floor of 1e-6: rounding is multiplied by up to 1e6.
                let limit = if self.case.options.energy.is_some() { 1e-7 } else { 1e-10 };
                ensure(residual <= limit, || format!("residual {residual:e}, it says {said:e}"))?;
            }
            Method::Gradient => {}
        }
        Ok("exact")
    }

    /// `‖δ − R Rᵀ (Σ μ ∇V + Σ ν w)‖∞` in extents, for the best μ and ν.
    fn residual(&self, place: &Place) -> f64 {
        let space = &self.coordinates;
        let mut rows: Vec<Vec<f64>> =
            self.goals.iter().map(|goal| space.pulled(&self.slope(goal, &place.vertices).controls)).collect();
        rows.extend(self.point_rows(space));
        let mut rest = space.coordinates_of(&place.delta);
        Decomposed::of(&rows).project(&mut rest);
        space.displacement(&rest).iter().map(|d| d.abs().max_element()).fold(0.0, f64::max) / self.extent
    }

    /// The rows of the points: along each axis of the space in turn.
    fn point_rows(&self, space: &Space) -> Vec<Vec<f64>> {
        let row = |(point, along): (&isochor::PointTarget, usize)| {
            let mut weights = vec![0.0; self.controls];
            point.weights.iter().for_each(|(c, w)| weights[*c] += w);
            space.pulled_along(along, &weights)
        };
        let points = &self.case.wanted.points;
        (0..space.axis_count()).flat_map(|along| points.iter().map(move |p| (p, along))).map(row).collect()
    }

    /// X + W δ in doubled precision.
    fn exactly(&self, delta: &[DVec3]) -> Vec<[Twice; 3]> {
        let vertex = |(p, weights): (&DVec3, &Vec<(usize, f64)>)| {
            [0, 1, 2].map(|a| {
                let add = |sum: Twice, (c, w): &(usize, f64)| sum + Twice::from(*w) * Twice::from(delta[*c][a]);
                weights.iter().fold(Twice::from(p[a]), add)
            })
        };
        self.near.iter().zip(&self.weights).map(vertex).collect()
    }

    fn place(&self, delta: Vec<DVec3>) -> Place {
        let by: Vec<DVec3> = self.weights.iter().map(|w| w.iter().map(|(c, w)| *w * delta[*c]).sum()).collect();
        Place { vertices: displaced(&self.near, &by), delta }
    }

    /// Volumes of the components: `Σ det / 6` in doubled precision.
    fn volumes(&self, vertices: &[[Twice; 3]]) -> Vec<f64> {
        let mut apex = [Twice::default(); 3];
        for a in 0..3 {
            let sum = self.rim.iter().fold(Twice::default(), |sum, v| sum + vertices[*v][a]);
            apex[a] = Twice::from(sum.value() / self.rim.len().max(1) as f64);
        }
        let corner = |v: usize| if v < vertices.len() { vertices[v] } else { apex };
        let mut sums = vec![Twice::default(); self.components];
        for (component, triangle) in &self.triangles {
            let [p, q, r] = triangle.map(corner);
            let minor = |a: usize, b: usize| q[a] * r[b] - q[b] * r[a];
            sums[*component] = sums[*component] + p[0] * minor(1, 2) + p[1] * minor(2, 0) + p[2] * minor(0, 1);
        }
        sums.into_iter().map(|sum| sum.value() / 6.0).collect()
    }

    fn volumes_at(&self, place: &Place) -> Vec<f64> {
        let vertices: Vec<[Twice; 3]> = place.vertices.iter().map(|p| p.to_array().map(Twice::from)).collect();
        self.volumes(&vertices)
    }

    /// ∇V of a goal.
    fn slope(&self, goal: &Goal, vertices: &[DVec3]) -> Slope {
        let apex = self.rim.iter().map(|v| vertices[*v]).sum::<DVec3>() / self.rim.len().max(1) as f64;
        let corner = |v: usize| if v < vertices.len() { vertices[v] } else { apex };
        let mut by_vertex = vec![DVec3::ZERO; vertices.len() + 1];
        for (component, [a, b, c]) in &self.triangles {
            let (p, q, r) = (corner(*a), corner(*b), corner(*c));
            let share = goal.members[*component] * (q - p).cross(r - p) / 6.0;
            [a, b, c].into_iter().for_each(|v| by_vertex[*v] += share);
        }
        let of_apex = by_vertex.pop().unwrap() / self.rim.len().max(1) as f64;
        self.rim.iter().for_each(|v| by_vertex[*v] += of_apex);
        let mut controls = vec![DVec3::ZERO; self.controls];
        for (weights, g) in self.weights.iter().zip(&by_vertex) {
            weights.iter().for_each(|(c, w)| controls[*c] += *w * *g);
        }
        Slope {
            controls,
            spread: by_vertex.iter().map(|g| g.length()).sum(),
            moment: by_vertex.iter().zip(vertices).map(|(g, p)| g.length() * p.length()).sum(),
        }
    }

    /// That ∇V is right: along single coordinates volumes are affine, so differences of volumes are exact.
    pub fn gradient_error(&self) -> f64 {
        let place = self.place(vec![DVec3::ZERO; self.controls]);
        let mut worst = 0.0;
        for goal in &self.goals {
            let slope = self.slope(goal, &place.vertices);
            for c in 0..self.controls {
                for a in 0..3 {
                    let at = |by: f64| {
                        let mut delta = place.delta.clone();
                        delta[c][a] = by;
                        goal.of(&self.volumes_at(&self.place(delta)))
                    };
                    let off = ((at(1.0) - at(-1.0)) / 2.0 - slope.controls[c][a]).abs();
                    worst = f64::max(worst, off / slope.spread);
                }
            }
        }
        worst
    }
}

impl Goal {
    fn of(&self, volumes: &[f64]) -> f64 {
        dense::dot(&self.members, volumes)
    }
}

/// What of `v` is across all `directions`.
fn across(directions: &[DVec3], v: DVec3) -> DVec3 {
    let size = v.abs().max_element();
    if size > 1.0 {
        return size * across(directions, v / size); // its square may leave the range of numbers
    }
    let rows: Vec<Vec<f64>> = directions.iter().map(|d| d.to_array().to_vec()).collect();
    let mut rest = v.to_array().to_vec();
    Decomposed::of(&rows).project(&mut rest);
    DVec3::new(rest[0], rest[1], rest[2])
}

/// Triangles with their components, the vertices of the boundary, and the number of components.
type Surface = (Vec<(usize, [usize; 3])>, Vec<usize>, usize);

fn surface(case: &Case) -> Surface {
    let n = case.mesh.points().len();
    let mut root: Vec<usize> = (0..n).collect();
    fn find(root: &[usize], mut v: usize) -> usize {
        while root[v] != v {
            v = root[v];
        }
        v
    }
    let mut edges = std::collections::BTreeSet::new();
    for face in case.mesh.faces().iter() {
        for k in 0..face.len() {
            let (a, b) = (face[k] as usize, face[(k + 1) % face.len()] as usize);
            let (i, j) = (find(&root, a), find(&root, b));
            root[i.max(j)] = i.min(j);
            edges.insert((a, b));
        }
    }
    let mut names: Vec<usize> = Vec::new();
    let mut triangles = Vec::new();
    for face in case.mesh.faces().iter() {
        let component = find(&root, face[0] as usize);
        let name = names.iter().position(|name| *name == component).unwrap_or_else(|| {
            names.push(component);
            names.len() - 1
        });
        for k in 1..face.len() - 1 {
            triangles.push((name, [0, k, k + 1].map(|i| face[i] as usize)));
        }
    }
    let open: Vec<(usize, usize)> = edges.iter().filter(|(a, b)| !edges.contains(&(*b, *a))).copied().collect();
    triangles.extend(open.iter().map(|(a, b)| (0, [*b, *a, n])));
    let mut rim: Vec<usize> = open.iter().flat_map(|(a, b)| [*a, *b]).collect();
    rim.sort_unstable();
    rim.dedup();
    (triangles, rim, names.len())
}
