//! HML's four examples, section 5.2: a body at all levels of detail in a Bernstein lattice, and which of its nodes are moved and held.
//!
//! The paper states lattices, triangles and, in words, what moves, but not how far: amounts are chosen here. As in the paper the torus is sampled, and
//! the club is simplified; so is what stands in for the cow, which is not part of this project.

use glam::{BVec3, DQuat, DVec3};
use isochor::{
    Basis, Binding, Bounds, Components, ElasticModel, ElasticOptions, ElasticSolver, ElasticWanted, Evaluation, Frame,
    Lattice, LevelOptions, Levels, Mesh, Net, OpenBoundaries, Outside, ParametricSolid, Solid, Springs, Stiffness,
    VolumeGoal, shapes, topology,
};

use crate::paper::{self, ElasticTimes};

/// `shapes::dolphin(n)` has 2 n (2 n + 1) triangles: 5,852, 48 more than HML's cow; with one less it would be 254 fewer.
const DOLPHIN_SEGMENTS: usize = 38;

/// The torus once more, with as many triangles as the paper's largest example.
const FINE: usize = 65_536;

/// An example.
pub struct Example {
    pub title: Title,
    /// Nodes of the lattice along each axis.
    pub size: [usize; 3],
    /// The coarsest first, the body itself last.
    details: Vec<Detail>,
    /// The nodes at rest (#nodes × 3).
    rest: Vec<DVec3>,
    springs: Springs,
    /// Where nodes are held (#nodes); `None`: they may move.
    held: Vec<Option<DVec3>>,
}

/// What an example is.
pub struct Title {
    /// Its row of the paper's table 1; `None` where the paper has none.
    pub paper: Option<ElasticTimes>,
    pub name: &'static str,
    /// The body, and what is done to it.
    pub about: &'static str,
}

/// A level of detail in the lattice.
struct Detail {
    solid: Solid,
    points: Vec<DVec3>,
    binding: Binding,
}

/// All of them: one for each of [`paper::ELASTIC_TIMES`], then the fine torus.
pub fn examples() -> Vec<Example> {
    let [compression, stretch, club, cow] = paper::ELASTIC_TIMES;
    vec![
        torus_compression(Some(compression), compression.example, compression.triangles),
        torus_stretch(stretch),
        club_compression(club),
        dolphin_bending(cow),
        torus_compression(None, "Torus compression, finer", FINE),
    ]
}

fn torus_compression(paper: Option<ElasticTimes>, name: &'static str, triangles: usize) -> Example {
    let about =
        "a torus of the radii 1 and 0.4; its upper and lower 3 × 3 nodes are moved 40 % of the way to the middle";
    let held = |[_, _, k]: [usize; 3], rest: DVec3| (k != 1).then_some(DVec3 { z: 0.6 * rest.z, ..rest });
    Example::new(Title { paper, name, about }, &torus(triangles), [3; 3], held)
}

fn torus_stretch(paper: ElasticTimes) -> Example {
    let about = "the same torus; both ends along x, each of two layers of 2 × 2 nodes, are moved outwards to one and a half of its length";
    let held = |[i, _, _]: [usize; 3], rest: DVec3| (i != 2).then(|| rest + DVec3::X * 0.7_f64.copysign(rest.x));
    Example::new(Title { paper: Some(paper), name: paper.example, about }, &torus(paper.triangles), [5, 2, 2], held)
}

fn club_compression(paper: ElasticTimes) -> Example {
    let about =
        "a club; the two layers of 2 × 2 nodes at its thick end, on the left, are moved 40 % of the way to its axis";
    let held = |[i, _, _]: [usize; 3], rest: DVec3| (i < 2).then(|| DVec3::new(rest.x, 0.6 * rest.y, 0.6 * rest.z));
    let mesh = ParametricSolid::club().sampled(paper.triangles).expect("a mesh of that size");
    Example::of_mesh(Title { paper: Some(paper), name: paper.example, about }, &mesh, held)
}

fn dolphin_bending(paper: ElasticTimes) -> Example {
    let about = "a dolphin stands in for the cow; the layers of 2 × 2 nodes at its nose and its flukes are turned downwards by 40° about its middle";
    let mesh = shapes::dolphin(DOLPHIN_SEGMENTS);
    let middle = mesh.bounds().expect("a dolphin has vertices").center();
    let held = |[i, _, _]: [usize; 3], rest: DVec3| {
        let turn = DQuat::from_rotation_y(40_f64.to_radians().copysign(rest.x - middle.x));
        (i == 0 || i == 4).then(|| middle + turn * (rest - middle))
    };
    Example::of_mesh(Title { paper: Some(paper), name: paper.example, about }, &mesh, held)
}

/// HML's torus.
fn torus(triangles: usize) -> Levels<'static> {
    let torus = ParametricSolid::torus(1.0, 0.4).expect("a torus");
    Levels::of_samples(&torus, triangles, &LevelOptions::default()).expect("meshes of these sizes")
}

impl Example {
    /// Of a body in `size` nodes, of which `held` says by index and place at rest where they are held.
    fn new(title: Title, levels: &Levels, size: [usize; 3], held: impl Fn([usize; 3], DVec3) -> Option<DVec3>) -> Self {
        let levels = levels.as_slice();
        let bounds = Bounds::of(&levels[levels.len() - 1].points).expect("a body has vertices");
        let bases = size.map(|nodes| Basis::bernstein(nodes).expect("two nodes or more"));
        let frame = Frame::fitted(bounds, 0.0).expect("a body has an extent");
        let lattice = Lattice::new(bases, frame).expect("the body's box");
        let detail = |level: &isochor::Level| Detail {
            solid: level.solid.clone().into_owned(),
            points: level.points.to_vec(),
            binding: lattice.bind(&level.points, Outside::Refuse).expect("levels have vertices in the body's box"),
        };
        let rest = lattice.rest();
        Self {
            title,
            size,
            details: levels.iter().map(detail).collect(),
            springs: Springs::of(&lattice, Net::TwentySix, Stiffness::default()).expect("nodes that are apart"),
            held: rest.iter().enumerate().map(|(node, at)| held(lattice.node(node), *at)).collect(),
            rest,
        }
    }

    /// Of a mesh along x in 5 × 2 × 2 nodes.
    fn of_mesh(title: Title, mesh: &Mesh, held: impl Fn([usize; 3], DVec3) -> Option<DVec3>) -> Self {
        let solid = Solid::new(mesh, &topology(mesh), OpenBoundaries::Refuse).expect("a closed mesh");
        let levels = Levels::of_mesh(&solid, mesh.points(), &LevelOptions::default());
        Self::new(title, &levels, [5, 2, 2], held)
    }

    /// The body itself.
    pub fn model(&self) -> ElasticModel<'_> {
        self.model_of(&self.details[self.details.len() - 1])
    }

    /// What stands for it, the coarsest first.
    pub fn coarser(&self) -> Vec<ElasticModel<'_>> {
        self.details[..self.details.len() - 1].iter().map(|detail| self.model_of(detail)).collect()
    }

    fn model_of<'a>(&'a self, Detail { solid, points, binding }: &'a Detail) -> ElasticModel<'a> {
        ElasticModel { solid, binding, points, rest: &self.rest, springs: &self.springs }
    }

    /// The volume at rest.
    pub fn wanted(&self) -> ElasticWanted {
        let ElasticModel { solid, points, .. } = self.model();
        let goal = VolumeGoal { components: Components::All, volume: solid.volume(points) };
        ElasticWanted { volumes: vec![goal], ..ElasticWanted::default() }
    }

    pub fn options(&self, solver: ElasticSolver, evaluation: Evaluation) -> ElasticOptions {
        let is_free = self.held.iter().map(|held| BVec3::splat(held.is_none())).collect();
        ElasticOptions { is_free: Some(is_free), solver, evaluation }
    }

    /// Nodes that are held.
    pub fn held_count(&self) -> usize {
        self.held.iter().flatten().count()
    }

    /// The held nodes, `share` of their way from rest.
    pub fn handles(&self, share: f64) -> Vec<(usize, DVec3)> {
        let handle = |(node, held): (usize, &Option<DVec3>)| Some((node, self.rest[node].lerp((*held)?, share)));
        self.held.iter().enumerate().filter_map(handle).collect()
    }

    /// Where all nodes start (#nodes × 3): held where they are held, and else at rest.
    pub fn start(&self) -> Vec<DVec3> {
        self.held.iter().zip(&self.rest).map(|(held, rest)| held.unwrap_or(*rest)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_have_the_triangles_of_the_paper_or_nearest_to_them() {
        // A sphere of 2m × m cells has two at each of 2m (m − 1) inner ones, and one at each of its poles: 4 m (m − 1); 16,640 for m = 65, and 16,256
        // for m = 64.
        let expected = [4_096, 65_536, 16_640, 5_852, 65_536];
        let triangles = |example: &Example| example.model().solid.triangle_count();
        assert_eq!(examples().iter().map(triangles).collect::<Vec<_>>(), expected);
        for n in [DOLPHIN_SEGMENTS - 1, DOLPHIN_SEGMENTS + 1] {
            assert!((2 * n * (2 * n + 1)).abs_diff(paper::ELASTIC_TIMES[3].triangles) > 48, "{n}");
        }
    }
}
