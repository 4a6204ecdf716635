//! What a prepared correction allocates: nothing that grows with the mesh but what it returns.

use glam::DVec3;
use isochor::{
    Basis, CorrectOptions, Corrector, Frame, Lattice, Method, OpenBoundaries, Outside, Solid, Wanted, displaced,
    shapes, topology,
};

#[global_allocator]
static ALLOCATOR: dhat::Alloc = dhat::Alloc;

#[test]
fn a_prepared_correction_allocates_its_result_and_little_else() {
    let mesh = shapes::stone(400_000);
    let frame = Frame::fitted(mesh.bounds().unwrap(), 0.0).unwrap();
    let lattice = Lattice::new([0; 3].map(|_| Basis::uniform(5, 3).unwrap()), frame).unwrap();
    let binding = lattice.bind(mesh.points(), Outside::Keep).unwrap();
    let solid = Solid::new(&mesh, &topology(&mesh), OpenBoundaries::Refuse).unwrap();
    let squash: Vec<DVec3> = lattice.rest().iter().map(|c| DVec3::new(0.1 * c.y * c.z, 0.0, -0.3 * c.z)).collect();
    let posed = displaced(mesh.points(), &binding.apply(&squash));
    let wanted = Wanted::volume(solid.volume(mesh.points()));
    let result = 24 * mesh.points().len() as u64;
    for method in [Method::Gradient, Method::xyz()] {
        let options = CorrectOptions { method: method.clone(), ..CorrectOptions::default() };
        let corrector = Corrector::new(&solid, &binding, &options).unwrap();
        let first = corrector.correct(&posed, &wanted).unwrap();
        let profiler = dhat::Profiler::builder().testing().build();
        let second = corrector.correct(&posed, &wanted).unwrap();
        let bytes = dhat::HeapStats::get().total_bytes;
        drop(profiler);
        assert_eq!(first, second);
        // A few working arrays of a chunk of vertices for each thread, and the controls' partial sums.
        assert!(bytes >= result, "{method:?}: {bytes} bytes, and the result has {result}");
        assert!(bytes <= 3 * result, "{method:?}: {bytes} bytes, and the result has {result}");
    }
}
