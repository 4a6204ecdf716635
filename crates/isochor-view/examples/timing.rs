//! How long the picture of a large model takes: three poses of a stone of 873,620 faces, coloured by local
//! volume change.
//!
//! `RAYON_NUM_THREADS=2 cargo run --release -p isochor-view --example timing`

use std::time::Instant;

use glam::DVec3;
use isochor::shapes;
use isochor_view::{Coloring, PictureOptions, Show, ShownLattice, ShownPose, picture};

/// Pictures that are timed; the shortest time counts.
const ROUNDS: usize = 7;

/// Control points along each axis.
const CONTROLS: usize = 5;

fn main() {
    let mesh = shapes::stone(436_812);
    let bounds = mesh.bounds().expect("a stone has vertices");
    let grid = (0..CONTROLS.pow(3)).map(|c| [c / CONTROLS.pow(2), c / CONTROLS % CONTROLS, c % CONTROLS]);
    let fraction = |c: [usize; 3]| DVec3::from_array(c.map(|c| c as f64 / (CONTROLS - 1) as f64));
    let controls: Vec<DVec3> = grid.map(|c| bounds.min + fraction(c) * bounds.size()).collect();
    let squashes = [("rest", 1.0), ("deformed", 0.6), ("corrected", 0.8)];
    let poses = squashes.map(|(name, squash)| {
        // A twist of half a radian to either side.
        let moved = |p: &DVec3| {
            let (sin, cos) = (0.5 * p.z).sin_cos();
            DVec3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, squash * p.z)
        };
        let posed = |rest: &[DVec3]| rest.iter().map(moved).collect::<Vec<_>>();
        ShownPose {
            name: name.into(),
            points: posed(mesh.points()).into(),
            lattice: Some(ShownLattice {
                size: [CONTROLS; 3],
                controls: posed(&controls).into(),
                net: None,
                planes: Vec::new(),
            }),
            volume: Some(0.3 * squash),
            volume_change: Some(mesh.points().iter().map(|p| squash * (1.0 + 0.15 * p.x)).collect()),
            stress: None,
        }
    });
    let show = Show { faces: mesh.faces(), poses: poses.into() };
    let options = PictureOptions { coloring: Coloring::VolumeChange, ..PictureOptions::default() };
    let times = (0..ROUNDS).map(|_| {
        let start = Instant::now();
        let image = picture(&show, &options);
        let drawn = start.elapsed();
        let bytes = image.png().len();
        let all = start.elapsed();
        println!("drawn in {drawn:.2?}, with PNG of {bytes} bytes {all:.2?}");
        all
    });
    println!("{} faces, {} poses: {:.2?}", mesh.faces().len(), show.poses.len(), times.min().unwrap_or_default());
    if let Some(path) = std::env::args().nth(1) {
        std::fs::write(path, picture(&show, &options).png()).expect("the picture can be written");
    }
}
