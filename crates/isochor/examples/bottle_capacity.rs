//! A bottle of given capacity and given amount of glass: two exact volumes at once, for a series of sizes.
//!
//! `cargo run --release -p isochor --example bottle_capacity`

use glam::DVec3;
use isochor::{
    Basis, Components, CorrectOptions, Corrector, Frame, Lattice, OpenBoundaries, Outside, Solid, VolumeGoal, Wanted,
    displaced, shapes, topology,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Two components: the outside, and the cavity, whose volume is negative.
    let bottle = shapes::hollow_bottle(96, 120, 0.05);
    let solid = Solid::new(&bottle, &topology(&bottle), OpenBoundaries::Refuse)?;
    let rest = solid.volumes(bottle.points());
    let (glass, capacity) = (rest.total, -rest.components[1]);

    let frame = Frame::fitted(bottle.bounds().ok_or("a bottle has vertices")?, 0.05)?;
    let lattice = Lattice::new([Basis::clamped(6, 3)?, Basis::clamped(6, 3)?, Basis::clamped(10, 3)?], frame)?;
    let binding = lattice.bind(bottle.points(), Outside::Refuse)?;

    // The foot stays: its controls have no mobility.
    let is_foot = |control: usize| lattice.node(control)[2] < 2;
    let mobility = (0..lattice.control_count()).map(|c| if is_foot(c) { DVec3::ZERO } else { DVec3::ONE }).collect();
    let options = CorrectOptions { mobility: Some(mobility), ..CorrectOptions::default() };
    let corrector = Corrector::new(&solid, &binding, &options)?;

    // A pose: narrower towards the top.
    let narrowed = |c: &DVec3| DVec3::new(-c.x, -c.y, 0.0) * 0.1 * c.z.max(0.0);
    let posed = displaced(bottle.points(), &binding.apply(&lattice.rest().iter().map(narrowed).collect::<Vec<_>>()));
    let before = solid.volumes(&posed);
    println!("at rest  glass {glass:.12}  capacity {capacity:.12}");
    println!("posed    glass {:.12}  capacity {:.12}", before.total, -before.components[1]);

    for percent in [90.0, 100.0, 110.0, 120.0] {
        let wanted_capacity = capacity * percent / 100.0;
        let goals = vec![
            VolumeGoal { components: Components::All, volume: glass },
            VolumeGoal { components: Components::These(vec![1]), volume: -wanted_capacity },
        ];
        let corrected = corrector.correct(&posed, &Wanted { volumes: goals, points: Vec::new() })?;
        let held = -corrected.component_volumes[1];
        println!("{percent:5} %  glass {:.12}  capacity {held:.12}, {} steps", corrected.volume, corrected.steps);
        assert!((corrected.volume / glass - 1.0).abs() <= 1e-13 && (held / wanted_capacity - 1.0).abs() <= 1e-13);
    }
    Ok(())
}
