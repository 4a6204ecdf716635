//! Fits a shape to target points while its volume stays exact: gradient descent on the posed controls, through the correction.
//!
//! Each step corrects the pose, measures how far some vertices are from where they should be, and takes the gradient of that back
//! through the correction with `Sensitivity::transposed`: one more solution of about the cost of the correction, however many
//! controls there are.
//!
//! `cargo run --release -p isochor --example sensitivity`

use glam::DVec3;
use isochor::{
    Basis, CorrectOptions, Corrector, Effect, Frame, Lattice, OpenBoundaries, Outside, Solid, Wanted, displaced,
    shapes, topology,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ball = shapes::icosphere(4);
    let solid = Solid::new(&ball, &topology(&ball), OpenBoundaries::Refuse)?;
    let volume = solid.volume(ball.points());
    let lattice = Lattice::new(
        [Basis::clamped(5, 3)?, Basis::clamped(5, 3)?, Basis::clamped(5, 3)?],
        Frame::fitted(ball.bounds().ok_or("a ball has vertices")?, 0.1)?,
    )?;
    let binding = lattice.bind(ball.points(), Outside::Refuse)?;
    let corrector = Corrector::new(&solid, &binding, &CorrectOptions::default())?;
    let wanted = Wanted::volume(volume);

    // Vertices of the upper half, and where they should be: on an ellipsoid. Below, the shape is free.
    let targets: Vec<(usize, DVec3)> = ball
        .points()
        .iter()
        .enumerate()
        .filter(|(_, p)| p.z > 0.0)
        .map(|(v, p)| (v, *p * DVec3::new(1.2, 0.8, 1.3)))
        .collect();

    let mut displacement = vec![DVec3::ZERO; lattice.control_count()];
    let mut rate = 0.5;
    let mut last = f64::INFINITY;
    let mut kept = displacement.clone();
    let mut gradient = displacement.clone();
    for step in 0..=40 {
        let posed = displaced(ball.points(), &binding.apply(&displacement));
        let sensitivity = corrector.sensitivity(&posed, &wanted)?;
        let correction = sensitivity.correction();
        assert!(correction.relative_error <= 1e-13);

        // The objective Σ |x − target|² / 2 of the corrected vertices, and its gradient by them.
        let mut by_vertices = vec![DVec3::ZERO; ball.points().len()];
        targets.iter().for_each(|&(v, target)| by_vertices[v] = correction.vertices[v] - target);
        let objective = 0.5 * by_vertices.iter().map(|d| d.length_squared()).sum::<f64>();
        let mean = (2.0 * objective / targets.len() as f64).sqrt();
        if step % 5 == 0 {
            println!("step {step:2}: {mean:.6} from the targets, volume off by {:.1e}", correction.relative_error);
        }
        if objective < last {
            // Back through the correction: the gradient by the posed controls.
            let effect = Effect { controls: vec![DVec3::ZERO; displacement.len()], vertices: by_vertices };
            gradient = sensitivity.transposed(&effect).controls;
            (kept, last) = (displacement, objective);
            rate *= 1.5;
        } else {
            rate *= 0.25;
        }
        let scale = rate / targets.len() as f64;
        displacement = kept.iter().zip(&gradient).map(|(c, g)| *c - scale * *g).collect();
    }
    Ok(())
}
