//! Jobs whose pages are tested.

use isochor::{Course, Faces, Job, JobInput, Mesh, Outcome, Source, shapes};
use isochor_view::Show;

/// A model and what is asked.
pub struct Story {
    pub mesh: Mesh,
    pub job: &'static str,
}

/// What came of it.
pub struct Run {
    pub mesh: Mesh,
    pub outcome: Outcome,
    pub course: Option<Course>,
}

impl Story {
    pub fn twisted_cube() -> Self {
        let job = "[lattice]\nsize = 5\n[[edit]]\ntwist = { axis = \"z\", degrees = 120 }\n[preserve]\naxes = \"xy\"\n";
        Self { mesh: shapes::cube(8), job }
    }

    /// A sphere in a sphere: two volumes.
    pub fn hollow() -> Self {
        let job = "[[edit]]\ntaper = { axis = \"z\", scale = 0.6 }\n[preserve]\nvolume = { material = \"100%\", capacity = \"110%\" }\n";
        Self { mesh: shapes::hollow_sphere(3, 0.6), job }
    }

    /// A body of 24 components, each with a volume of its own.
    pub fn chain() -> Self {
        let job = "[[edit]]\nbend = { axis = \"x\", degrees = 60, towards = \"z\" }\n[preserve]\nvolume = \"each\"\n";
        Self { mesh: shapes::chain(24, 16, 8), job }
    }

    /// Two triangles wound against each other bound nothing.
    pub fn sheet() -> Self {
        let faces: Faces = [[0, 1, 2], [1, 2, 3]].iter().collect();
        let points = shapes::cube(1).points()[..4].to_vec();
        let mesh = Mesh::new(points, faces).expect("a mesh");
        Self { mesh, job: "[[edit]]\nbend = { axis = \"x\", degrees = 60 }\n[preserve]\nvolume = \"free\"\n" }
    }

    /// Nodes that settle between others that are held.
    pub fn settled() -> Self {
        let job = "[lattice]\nbasis = \"bernstein\"\nsize = 3\n[[edit]]\nscale = { by = [1, 1, 0.6], nodes = { k = [0, 2] } }\n[preserve]\nmethod = \"elastic\"\n";
        Self { mesh: shapes::cube(4), job }
    }

    pub fn all() -> Vec<Self> {
        vec![Self::twisted_cube(), Self::hollow(), Self::chain(), Self::sheet(), Self::settled()]
    }

    pub fn run(&self) -> Run {
        run(self.mesh.clone(), self.job)
    }
}

/// Runs a job.
pub fn run(mesh: Mesh, job: &str) -> Run {
    let job = Job::from_toml(job).expect("a job");
    let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
    let outcome = job.run(&input, &mut |_| {}).expect("an outcome");
    let course = outcome.course();
    Run { mesh, outcome, course }
}

impl Run {
    pub fn show(&self) -> Show<'_> {
        Show::of_job(&self.mesh, &self.outcome, self.course.as_ref())
    }
}
