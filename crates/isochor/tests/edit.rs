//! Edits against their formulas.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DVec3};
use isochor::{
    Axis, Bend, Bounds, ControlSpace, Drag, Edit, EditError, Factors, LengthUnit, Move, Noise, Posed, PosedError,
    PosedPoint, PosedTo, Rotate, RotationAxis, Scale, SelectError, Selector, SignedAxis, Stretch, Taper, Twist,
};
use proptest::prelude::*;

/// The lattice box of all tests: 2 × 3 × 4 round (0, 0.5, 1), so that ranges and centres are easily told apart.
const LOW: DVec3 = DVec3::new(-1.0, -1.0, -1.0);
const HIGH: DVec3 = DVec3::new(1.0, 2.0, 3.0);
const CENTER: DVec3 = DVec3::new(0.0, 0.5, 1.0);
/// Where it lies in the file.
const ORIGIN: DVec3 = DVec3::new(100.0, 200.0, -300.0);
const SIZE: [usize; 3] = [3, 4, 5];
const EXTENT: f64 = 8.0;

fn rest() -> Vec<DVec3> {
    let node = |c: usize| DVec3::new((c / 20) as f64 / 2.0, (c / 5 % 4) as f64 / 3.0, (c % 5) as f64 / 4.0);
    (0..60).map(|c| LOW + (HIGH - LOW) * node(c)).collect()
}

fn space(rest: &[DVec3]) -> ControlSpace<'_> {
    let bounds = Bounds { min: LOW, max: HIGH };
    ControlSpace { rest, size: SIZE, bounds, extent: EXTENT, origin: ORIGIN, vertices: None, solid: None }
}

fn applied(edits: &[Edit]) -> Result<Vec<DVec3>, EditError> {
    let rest = rest();
    let mut controls = rest.clone();
    for edit in edits {
        edit.apply(&mut controls, &space(&rest))?;
    }
    Ok(controls)
}

/// Where an edit takes a single position, for any position.
fn image(edit: &Edit, p: DVec3) -> DVec3 {
    let rest = rest();
    let mut controls = vec![p; rest.len()];
    edit.apply(&mut controls, &space(&rest)).unwrap();
    assert!(controls.iter().all(|q| *q == controls[0]));
    controls[0]
}

fn assert_near(found: DVec3, expected: DVec3, tolerance: f64) {
    assert!(found.distance(expected) <= tolerance, "{found} instead of {expected}");
}

fn twist(degrees: f64) -> Twist {
    Twist { axis: Axis::Z, degrees, ..Twist::default() }
}

fn bend(axis: Axis, degrees: f64) -> Bend {
    Bend { axis, degrees, ..Bend::default() }
}

/// Every kind of edit that is the identity.
fn identities() -> Vec<Edit> {
    vec![
        Edit::Twist(Twist::default()),
        Edit::Bend(Bend::default()),
        Edit::Taper(Taper::default()),
        Edit::Stretch(Stretch::default()),
        Edit::Move(Move::default()),
        Edit::Rotate(Rotate::default()),
        Edit::Scale(Scale::default()),
        Edit::Noise(Noise::default()),
        Edit::Posed(Posed { to: PosedTo::Points(vec![]), nodes: Selector::All }),
        Edit::Drag(Drag::default()),
    ]
}

#[test]
fn identities_keep_the_bits() {
    let p = DVec3::new(0.1, 0.2, 0.3) / 7.0;
    for edit in identities() {
        assert_eq!(image(&edit, p), p, "{}", edit.name());
    }
    assert_eq!(image(&Edit::Rotate(Rotate { degrees: -720.0, ..Rotate::default() }), p), p);
}

#[test]
fn twist_turns_the_high_end_by_its_angle() {
    // By 90° about the line x = 0, y = 0.5: (x, y) → (0.5 − y, 0.5 + x), right-handed.
    let edit = Edit::Twist(twist(90.0));
    assert_near(image(&edit, HIGH), DVec3::new(-1.5, 1.5, 3.0), 1e-15);
    assert_eq!(image(&edit, LOW), LOW);
    // Half-way up: 45°. A box below: −90°.
    let half = 0.5_f64.sqrt();
    assert_near(image(&edit, DVec3::new(1.0, 0.5, 1.0)), DVec3::new(half, 0.5 + half, 1.0), 1e-15);
    assert_near(image(&edit, DVec3::new(1.0, 0.5, -5.0)), DVec3::new(0.0, -0.5, -5.0), 1e-15);
}

#[test]
fn twist_has_a_range_and_a_center() {
    // 90° between z = 0 (a quarter) and z = 2 (three quarters), about the line through x = 1, y = 2.
    let center = Some(ORIGIN + DVec3::new(1.0, 2.0, 77.0));
    let edit = Edit::Twist(Twist { range: Some([0.25, 0.75]), center, ..twist(90.0) });
    assert_eq!(image(&edit, DVec3::new(-1.0, 2.0, 0.0)), DVec3::new(-1.0, 2.0, 0.0));
    assert_near(image(&edit, DVec3::new(-1.0, 2.0, 2.0)), DVec3::new(1.0, 0.0, 2.0), 1e-15);
    assert_near(image(&edit, DVec3::new(-1.0, 2.0, -2.0)), DVec3::new(1.0, 4.0, -2.0), 1e-15);
    // The other way round: from three quarters down to a quarter.
    let down = Edit::Twist(Twist { range: Some([0.75, 0.25]), center, ..twist(90.0) });
    assert_near(image(&down, DVec3::new(-1.0, 2.0, 0.0)), DVec3::new(1.0, 0.0, 0.0), 1e-15);
    assert_eq!(image(&down, DVec3::new(-1.0, 2.0, 2.0)), DVec3::new(-1.0, 2.0, 2.0));
}

#[test]
fn bend_makes_an_arc() {
    // The line x = 0, y = 0.5 of length 4 becomes a quarter circle towards x (next after z): radius 8/π.
    let edit = Edit::Bend(bend(Axis::Z, 90.0));
    let r = 4.0 / FRAC_PI_2;
    assert_near(image(&edit, DVec3::new(0.0, 0.5, 3.0)), DVec3::new(r, 0.5, -1.0 + r), 1e-15);
    // Offset ξ to the inside: an arc of radius R − ξ round the same centre. The third coordinate stays.
    assert_near(image(&edit, DVec3::new(0.7, 1.7, 3.0)), DVec3::new(r, 1.7, -1.0 + r - 0.7), 2e-15);
    assert_near(image(&edit, DVec3::new(0.7, 1.7, -1.0)), DVec3::new(0.7, 1.7, -1.0), 2e-15);
    // Below the range the arc goes on: a quarter circle below s = 0.
    assert_near(image(&edit, DVec3::new(0.0, 0.5, -5.0)), DVec3::new(r, 0.5, -1.0 - r), 2e-15);
}

#[test]
fn bend_towards_the_other_side_mirrors() {
    let mirrored = |p: DVec3| p * DVec3::new(-1.0, 1.0, 1.0);
    let p = DVec3::new(0.3, 0.1, 2.5);
    let minus = Edit::Bend(Bend { towards: Some(SignedAxis::MinusX), ..bend(Axis::Z, 70.0) });
    let plus = Edit::Bend(Bend { towards: Some(SignedAxis::X), ..bend(Axis::Z, 70.0) });
    let back = Edit::Bend(bend(Axis::Z, -70.0));
    assert_eq!(image(&plus, p), image(&Edit::Bend(bend(Axis::Z, 70.0)), p));
    assert_near(image(&minus, mirrored(p)), mirrored(image(&plus, p)), 1e-15);
    assert_near(image(&minus, p), image(&back, p), 1e-15);
    // A range that runs downwards: the mirror image in z = 1, the middle of the box.
    let down = Edit::Bend(Bend { range: Some([1.0, 0.0]), ..bend(Axis::Z, 70.0) });
    let flipped = |p: DVec3| DVec3::new(p.x, p.y, 2.0 - p.z);
    assert_near(image(&down, flipped(p)), flipped(image(&plus, p)), 1e-15);
}

#[test]
fn bend_goes_to_the_identity_with_its_angle() {
    // t′ − t = −ξ φ − t φ²/6 + …, ξ′ − ξ = t φ/2 − ξ φ²/2 + …, the next terms of third order.
    let p = DVec3::new(0.7, 0.4, 1.9);
    let (xi, t) = (0.7, 2.9);
    for exponent in 0..=20 {
        let theta = 0.1 * 0.1_f64.powi(exponent);
        let phi = theta * t / 4.0;
        let along = -xi * phi - t * phi * phi / 6.0;
        let across = t * phi / 2.0 - xi * phi * phi / 2.0;
        let moved = image(&Edit::Bend(bend(Axis::Z, theta.to_degrees())), p) - p;
        assert_near(moved, DVec3::new(across, 0.0, along), 1e-15 + phi.powi(3));
    }
    assert_eq!(image(&Edit::Bend(bend(Axis::Z, 1e-300)), p), p);
    assert_eq!(image(&Edit::Bend(bend(Axis::Z, f64::MIN_POSITIVE)), p), p);
}

#[test]
fn taper_scales_cross_sections() {
    let edit = Edit::Taper(Taper { scale: 0.5, ..Taper::default() });
    assert_eq!(image(&edit, HIGH), DVec3::new(0.5, 1.25, 3.0));
    assert_eq!(image(&edit, LOW), LOW);
    assert_eq!(image(&edit, DVec3::new(1.0, 2.0, 1.0)), DVec3::new(0.75, 1.625, 1.0));
    // Not clamped: 0 one box above, mirrored beyond.
    assert_eq!(image(&edit, DVec3::new(1.0, 2.0, 7.0)), DVec3::new(0.0, 0.5, 7.0));
    let along_x = Edit::Taper(Taper { axis: Axis::X, scale: 3.0, center: Some(ORIGIN), ..Taper::default() });
    assert_eq!(image(&along_x, HIGH), DVec3::new(1.0, 6.0, 9.0));
}

#[test]
fn stretch_scales_one_coordinate() {
    let edit = Edit::Stretch(Stretch { axis: Axis::Y, scale: 3.0, ..Stretch::default() });
    assert_eq!(image(&edit, HIGH), DVec3::new(1.0, 5.0, 3.0));
    let about = Some(ORIGIN + LOW);
    let edit = Edit::Stretch(Stretch { axis: Axis::Y, scale: 3.0, center: about, ..Stretch::default() });
    assert_eq!(image(&edit, HIGH), DVec3::new(1.0, 8.0, 3.0));
}

#[test]
fn move_knows_two_units() {
    let by = DVec3::new(1.0, -2.0, 0.5);
    let model = Edit::Move(Move { by, ..Move::default() });
    assert_eq!(image(&model, HIGH), HIGH + by);
    let extents = Edit::Move(Move { by, unit: LengthUnit::Extent, ..Move::default() });
    assert_eq!(image(&extents, HIGH), HIGH + by * EXTENT);
}

#[test]
fn rotate_follows_the_right_hand_rule() {
    // About the middle of the box, by 90°: from it to HIGH is (1, 1.5, 2).
    for (axis, expected) in [
        (Axis::X, DVec3::new(1.0, -2.0, 1.5)),
        (Axis::Y, DVec3::new(2.0, 1.5, -1.0)),
        (Axis::Z, DVec3::new(-1.5, 1.0, 2.0)),
    ] {
        let coordinate = Rotate { axis: RotationAxis::Coordinate(axis), degrees: 90.0, ..Rotate::default() };
        assert_near(image(&Edit::Rotate(coordinate.clone()), HIGH), CENTER + expected, 1e-15);
        for length in [1.0, 1e-300, 5e-324, 1e300] {
            let vector = RotationAxis::Vector(axis.direction() * length);
            assert_near(
                image(&Edit::Rotate(Rotate { axis: vector, ..coordinate.clone() }), HIGH),
                CENTER + expected,
                1e-15,
            );
        }
    }
    // By 120° about the diagonal: x → y → z → x.
    let diagonal = RotationAxis::Vector(DVec3::ONE);
    let edit = Edit::Rotate(Rotate { axis: diagonal, degrees: 120.0, center: Some(ORIGIN), ..Rotate::default() });
    assert_near(image(&edit, DVec3::new(1.0, 2.0, 3.0)), DVec3::new(3.0, 1.0, 2.0), 2e-15);
}

#[test]
fn scale_scales_about_its_center() {
    let edit = Edit::Scale(Scale { by: Factors::Uniform(2.0), ..Scale::default() });
    assert_eq!(image(&edit, HIGH), DVec3::new(2.0, 3.5, 5.0));
    let by = Factors::PerAxis(DVec3::new(2.0, 0.0, -1.0));
    let edit = Edit::Scale(Scale { by, center: Some(ORIGIN), ..Scale::default() });
    assert_eq!(image(&edit, HIGH), DVec3::new(2.0, 0.0, -3.0));
}

#[test]
fn edits_compose_in_order() {
    let rotate = Edit::Rotate(Rotate { degrees: 90.0, center: Some(ORIGIN), ..Rotate::default() });
    let by = Edit::Move(Move { by: DVec3::X, ..Move::default() });
    let rest = rest();
    let [moved_last, moved_first] =
        [applied(&[rotate.clone(), by.clone()]), applied(&[by, rotate])].map(Result::unwrap);
    for (c, p) in rest.iter().enumerate() {
        assert_near(moved_last[c], DVec3::new(-p.y + 1.0, p.x, p.z), 1e-15);
        assert_near(moved_first[c], DVec3::new(-p.y, p.x + 1.0, p.z), 1e-15);
    }
    // The second twist sees z as the first stretch left it, but its range is that of the rest box.
    let stretched = Edit::Stretch(Stretch { scale: 2.0, center: Some(ORIGIN + LOW), ..Stretch::default() });
    let both = applied(&[stretched, Edit::Twist(twist(90.0))]).unwrap();
    assert_near(both[59], DVec3::new(-1.0, -1.0, 7.0), 2e-15); // (1, 2, 3) → (1, 2, 7), s = 2: half a turn
}

#[test]
fn weights_blend() {
    let sphere = Selector::Sphere { center: ORIGIN + LOW, radius: 0.5, falloff: 4.0 };
    let by = DVec3::new(1.0, 2.0, 3.0);
    let rest = rest();
    let weights = sphere.weights(&space(&rest)).unwrap();
    assert!(weights.contains(&0.0) && weights.contains(&1.0) && weights.iter().any(|w| *w > 0.0 && *w < 1.0));
    let moved = applied(&[Edit::Move(Move { by, nodes: sphere, ..Move::default() })]).unwrap();
    for ((p, q), w) in rest.iter().zip(&moved).zip(weights) {
        assert_near(*q, p + w * by, 1e-15);
        assert!(w > 0.0 || p == q);
    }
}

#[test]
fn nodes_limit_every_edit() {
    let plane: Selector = "k=4".parse().unwrap();
    let nodes = || plane.clone();
    let rest = rest();
    let lattice = rest.chunks(20).map(|s| s.chunks(5).map(|row| row.iter().map(|p| p + ORIGIN + 1.0).collect()));
    let edits = [
        Edit::Twist(Twist { nodes: nodes(), ..twist(10.0) }),
        Edit::Bend(Bend { nodes: nodes(), ..bend(Axis::Z, 10.0) }),
        Edit::Taper(Taper { scale: 2.0, nodes: nodes(), ..Taper::default() }),
        Edit::Stretch(Stretch { scale: 2.0, nodes: nodes(), ..Stretch::default() }),
        Edit::Move(Move { by: DVec3::ONE, nodes: nodes(), ..Move::default() }),
        Edit::Rotate(Rotate { degrees: 10.0, nodes: nodes(), ..Rotate::default() }),
        Edit::Scale(Scale { by: Factors::Uniform(2.0), nodes: nodes(), ..Scale::default() }),
        Edit::Noise(Noise { amplitude: 0.1, nodes: nodes(), ..Noise::default() }),
        Edit::Posed(Posed { to: PosedTo::Lattice(lattice.map(Iterator::collect).collect()), nodes: nodes() }),
    ];
    for edit in edits {
        assert_eq!(edit.nodes(), &plane);
        for (c, (p, q)) in rest.iter().zip(applied(std::slice::from_ref(&edit)).unwrap()).enumerate() {
            assert_eq!(*p != q, c % 5 == 4, "{} at {c}", edit.name());
        }
    }
}

/// PCG XSL-RR 128/64 by its definition (O'Neill 2014, section 6.3): `state ← state · a + increment`, output
/// `rotate_right(high ⊕ low, state >> 122)`, seeded by two steps round the addition of the seed.
fn pcg(seed: u64) -> impl FnMut() -> u64 {
    const A: u128 = 47_026_247_687_942_121_848_144_207_491_837_523_525; // 2549297995355413924·2⁶⁴ + 4865540595714422341
    const INCREMENT: u128 = 0x0a02_bdbf_7bb3_c0a7_ac28_fa16_a64a_bf96 << 1 | 1;
    let step = |state: u128| state.wrapping_mul(A).wrapping_add(INCREMENT);
    let mut state = step(u128::from(seed).wrapping_add(INCREMENT));
    move || {
        state = step(state);
        ((state >> 64) as u64 ^ state as u64).rotate_right((state >> 122) as u32)
    }
}

#[test]
fn noise_is_the_same_everywhere() {
    for seed in [0, 1, 42, u64::MAX] {
        let mut output = pcg(seed);
        let mut uniform = || (output() / 4096) as f64 / 2.0_f64.powi(51) + 0.5 / 2.0_f64.powi(51) - 1.0;
        let noise = Noise { amplitude: 0.25, seed, ..Noise::default() };
        let moved = applied(&[Edit::Noise(noise.clone())]).unwrap();
        let model = Noise { amplitude: 0.25 * EXTENT, unit: LengthUnit::Model, ..noise.clone() };
        assert_eq!(applied(&[Edit::Noise(model)]).unwrap(), moved);
        // Drawn for all control points, selected or not.
        let some = applied(&[Edit::Noise(Noise { nodes: "i=1 k=0,2".parse().unwrap(), ..noise })]).unwrap();
        for (c, (p, q)) in rest().iter().zip(&moved).enumerate() {
            let by = DVec3::from_array([uniform(), uniform(), uniform()]) * (0.25 * EXTENT);
            assert_eq!(*q, p + by);
            assert!(by.abs().max_element() < 0.25 * EXTENT);
            let selected = c / 20 == 1 && [0, 2].contains(&(c % 5));
            assert_eq!(some[c], if selected { *q } else { *p });
        }
    }
}

#[test]
fn posed_points_go_where_they_are_put() {
    let to = DVec3::new(101.5, 203.25, -299.5);
    let points = vec![PosedPoint { node: [2, 3, 4], to }, PosedPoint { node: [0, 0, 1], to: -to }];
    let twisted = applied(&[Edit::Twist(twist(30.0))]).unwrap();
    let posed = Edit::Posed(Posed { to: PosedTo::Points(points), nodes: Selector::All });
    let moved = applied(&[Edit::Twist(twist(30.0)), posed]).unwrap();
    for c in 0..60 {
        let expected = match c {
            59 => to - ORIGIN,
            1 => -to - ORIGIN,
            _ => twisted[c],
        };
        assert_eq!(moved[c], expected);
    }
}

#[test]
fn posing_at_rest_is_rest_bit_for_bit() {
    // Model coordinates are rounded to the grid of numbers near 1e9, coarser than the lattice itself.
    let rest: Vec<DVec3> = rest().iter().map(|p| p / 3.0).collect();
    let far = ControlSpace { origin: DVec3::new(1e9, -1e9, 0.0), ..space(&rest) };
    let slices = rest.chunks(20).map(|s| s.chunks(5).map(|row| row.iter().map(|p| p + far.origin).collect()).collect());
    let posed = Edit::Posed(Posed { to: PosedTo::Lattice(slices.collect()), nodes: Selector::All });
    let mut controls = vec![DVec3::ZERO; 60];
    posed.apply(&mut controls, &far).unwrap();
    assert_eq!(controls, rest);
    assert!(rest.iter().any(|p| p + far.origin - far.origin != *p));
}

#[test]
fn wrong_edits_say_what_is_wrong() {
    let nan = f64::NAN;
    let far = Some(DVec3::new(0.0, f64::NEG_INFINITY, 0.0));
    let point = |node, to| PosedPoint { node, to };
    let points = |points: Vec<PosedPoint>| Edit::Posed(Posed { to: PosedTo::Points(points), nodes: Selector::All });
    let lattice = |size: [usize; 3]| {
        let lattice = vec![vec![vec![DVec3::ZERO; size[2]]; size[1]]; size[0]];
        Edit::Posed(Posed { to: PosedTo::Lattice(lattice), nodes: Selector::All })
    };
    let mut ragged = vec![vec![vec![DVec3::ZERO; 5]; 4]; 3];
    ragged[1][2].pop();
    let ragged = Edit::Posed(Posed { to: PosedTo::Lattice(ragged), nodes: Selector::All });
    let cases = [
        (Edit::Twist(twist(nan)), "twist: degrees is NaN: it must be finite"),
        (Edit::Twist(Twist { center: far, ..twist(1.0) }), "twist: center is -inf: it must be finite"),
        (Edit::Twist(Twist { range: Some([0.0, nan]), ..twist(1.0) }), "twist: range is NaN: it must be finite"),
        (
            Edit::Twist(Twist { range: Some([0.5, 0.5]), ..twist(1.0) }),
            "twist: the range [0.5, 0.5] along z of the lattice box (there 4 long) has no length: its ends must differ",
        ),
        (
            Edit::Twist(Twist { nodes: "k=5".parse().unwrap(), ..twist(1.0) }),
            "twist: nodes: k = 5 is beyond the lattice: it has 5 control points there, k = 0 to 4",
        ),
        (
            Edit::Move(Move { nodes: Selector::List(vec![]), ..Move::default() }),
            "move: nodes: no control point is selected by a list of 0 control points",
        ),
        (
            Edit::Bend(Bend { towards: Some(SignedAxis::MinusY), ..bend(Axis::Y, 1.0) }),
            "bend: the axis y cannot be bent towards itself: `towards` must be another axis",
        ),
        (Edit::Bend(bend(Axis::X, f64::INFINITY)), "bend: degrees is inf: it must be finite"),
        (Edit::Taper(Taper { scale: nan, ..Taper::default() }), "taper: scale is NaN: it must be finite"),
        (Edit::Stretch(Stretch { scale: nan, ..Stretch::default() }), "stretch: scale is NaN: it must be finite"),
        (Edit::Move(Move { by: DVec3::NAN, ..Move::default() }), "move: by is NaN: it must be finite"),
        (
            Edit::Rotate(Rotate { axis: RotationAxis::Vector(DVec3::ZERO), ..Rotate::default() }),
            "rotate: the axis [0, 0, 0] has no direction",
        ),
        (
            Edit::Rotate(Rotate { axis: RotationAxis::Vector(DVec3::INFINITY), ..Rotate::default() }),
            "rotate: axis is inf: it must be finite",
        ),
        (Edit::Scale(Scale { by: Factors::Uniform(nan), ..Scale::default() }), "scale: by is NaN: it must be finite"),
        (Edit::Noise(Noise { amplitude: nan, ..Noise::default() }), "noise: amplitude is NaN: it must be finite"),
        (
            points(vec![point([0; 3], DVec3::ZERO), point([1, 4, 0], DVec3::ZERO)]),
            "posed: points[1]: j = 4 is beyond the lattice: it has 4 control points there, j = 0 to 3",
        ),
        (
            points(vec![point([0, 1, 2], DVec3::ZERO), point([0, 1, 2], DVec3::ZERO)]),
            "posed: points[1] is node [0, 1, 2], which an earlier point has posed already",
        ),
        (
            points(vec![point([0; 3], DVec3::X * nan)]),
            "posed: points[0].to is (NaN, NaN, NaN): coordinates must be finite",
        ),
        (lattice([2, 4, 5]), "posed: lattice has 2 entries, expected 3: the lattice has 3 × 4 × 5 control points"),
        (lattice([3, 5, 4]), "posed: lattice[0] has 5 entries, expected 4: the lattice has 3 × 4 × 5 control points"),
        (ragged, "posed: lattice[1][2] has 4 entries, expected 5: the lattice has 3 × 4 × 5 control points"),
        (
            Edit::Scale(Scale { by: Factors::Uniform(1e308), center: Some(ORIGIN * 1e3), ..Scale::default() }),
            "scale: control point [0, 0, 0] would move out of the range of numbers",
        ),
    ];
    for (edit, message) in cases {
        let rest = rest();
        let mut controls = rest.clone();
        assert_eq!(edit.apply(&mut controls, &space(&rest)).unwrap_err().to_string(), message);
        assert_eq!(controls, rest, "untouched after {message}");
    }
}

#[test]
fn a_flat_box_has_no_range() {
    let rest = vec![DVec3::ZERO; 60];
    let flat = ControlSpace { bounds: Bounds { min: LOW, max: DVec3::new(1.0, 2.0, -1.0) }, ..space(&rest) };
    let error = Edit::Twist(twist(1.0)).apply(&mut rest.clone(), &flat).unwrap_err();
    assert_eq!(error, EditError::Range { edit: "twist", axis: 'z', range: [0.0, 1.0], side: 0.0 });
}

#[test]
fn extreme_numbers_do_not_panic() {
    for big in [f64::MAX, -f64::MAX, 1e200, 1e-320, 5e-324] {
        let vector = DVec3::splat(big);
        for edit in [
            Edit::Twist(twist(big)),
            Edit::Twist(Twist { range: Some([0.0, big]), ..twist(big) }),
            Edit::Twist(Twist { center: Some(vector), ..twist(90.0) }),
            Edit::Bend(bend(Axis::Z, big)),
            Edit::Bend(Bend { range: Some([big, 0.5]), ..bend(Axis::Z, big) }),
            Edit::Taper(Taper { scale: big, center: Some(vector), ..Taper::default() }),
            Edit::Stretch(Stretch { scale: big, ..Stretch::default() }),
            Edit::Move(Move { by: vector, unit: LengthUnit::Extent, nodes: Selector::All }),
            Edit::Rotate(Rotate { axis: RotationAxis::Vector(vector), degrees: big, ..Rotate::default() }),
            Edit::Noise(Noise { amplitude: big, ..Noise::default() }),
        ] {
            let controls = applied(&[edit]);
            assert!(controls.map_or(true, |controls| controls.iter().all(|p| p.is_finite())));
        }
    }
}

/// An error of one module inside another's.
#[test]
fn errors_keep_their_source() {
    let points = vec![PosedPoint { node: [3, 0, 0], to: DVec3::ZERO }];
    let error = applied(&[Edit::Posed(Posed { to: PosedTo::Points(points), nodes: Selector::All })]).unwrap_err();
    let source = SelectError::Index { axis: 'i', index: 3, size: 3 };
    assert_eq!(error, EditError::Posed(PosedError::Missing { point: 0, source }));
}

prop_compose! {
    fn position()(x in -5.0..5.0, y in -5.0..5.0, z in -5.0..5.0) -> DVec3 {
        DVec3::new(x, y, z)
    }
}

fn axis() -> impl Strategy<Value = Axis> {
    prop_oneof![Just(Axis::X), Just(Axis::Y), Just(Axis::Z)]
}

proptest! {
    #[test]
    fn twist_keeps_heights_and_distances_from_the_axis(axis in axis(), degrees in -1000.0..1000.0, p in position()) {
        let q = image(&Edit::Twist(Twist { axis, degrees, ..Twist::default() }), p);
        let from_axis = |p: DVec3| (p - CENTER).reject_from(axis.direction()).length();
        prop_assert_eq!(q[axis.index()], p[axis.index()]);
        prop_assert!((from_axis(q) - from_axis(p)).abs() < 1e-14);
    }

    #[test]
    fn rotate_keeps_distances_and_orientation(
        vector in position(),
        degrees in -1000.0..1000.0,
        center in position(),
        p in prop::array::uniform4(position()),
    ) {
        prop_assume!(vector.length() > 1e-3);
        let axis = RotationAxis::Vector(vector);
        let edit = Edit::Rotate(Rotate { axis, degrees, center: Some(ORIGIN + center), ..Rotate::default() });
        let q = p.map(|p| image(&edit, p));
        let edges = |p: [DVec3; 4]| [p[1] - p[0], p[2] - p[0], p[3] - p[0]];
        for (a, b) in edges(p).iter().zip(edges(q)) {
            prop_assert!((a.length() - b.length()).abs() < 5e-14);
        }
        let volume = |[a, b, c]: [DVec3; 3]| DMat3::from_cols(a, b, c).determinant();
        prop_assert!((volume(edges(p)) - volume(edges(q))).abs() < 1e-11);
        // Points of the axis stay.
        prop_assert!(image(&edit, center + vector).distance(center + vector) < 1e-13);
    }

    #[test]
    fn bend_keeps_lengths_along_its_center_line(
        (axis, towards) in (axis(), any::<bool>()).prop_map(|(a, skip)| (a, if skip { a.next().next() } else { a.next() })),
        degrees in -400.0..400.0_f64,
        low in 0.0..0.4_f64,
        high in 0.6..1.0_f64,
        s in prop::array::uniform2(-0.5..1.5_f64),
        xi in -1.0..1.0_f64,
    ) {
        let signed = [SignedAxis::X, SignedAxis::Y, SignedAxis::Z][towards.index()];
        let (a, b) = (axis.direction(), towards.direction());
        let edit = Edit::Bend(Bend { towards: Some(signed), range: Some([low, high]), ..bend(axis, degrees) });
        let side = (HIGH - LOW)[axis.index()];
        let length = (high - low) * side;
        let on_line = |s: f64| CENTER.reject_from(a) + a * (LOW[axis.index()] + (low + s * (high - low)) * side);
        // Two points of an arc of radius R, Δφ apart along it, are 2R sin(Δφ/2) apart: arc length is kept.
        let theta = degrees * PI / 180.0;
        let (phi, arc) = (theta * (s[1] - s[0]), length * (s[1] - s[0]));
        let chord = if phi == 0.0 { arc.abs() } else { (2.0 * (arc / phi) * (phi / 2.0).sin()).abs() };
        let q = s.map(|s| image(&edit, on_line(s)));
        prop_assert!((q[0].distance(q[1]) - chord).abs() < 2e-14);
        // Cross-sections stay straight, at right angles to the arc: turned by θ s.
        for (s, q) in s.iter().zip(q) {
            let (sin, cos) = (theta * s).sin_cos();
            prop_assert!((image(&edit, on_line(*s) + b * xi) - q).distance(xi * (cos * b - sin * a)) < 2e-14);
        }
        // The end's tangent is turned by `degrees`, from the axis to `towards`.
        let h = 1e-4;
        let tangent = (image(&edit, on_line(1.0 + h)) - image(&edit, on_line(1.0 - h))) / (2.0 * h * length);
        let (sin, cos) = theta.sin_cos();
        prop_assert!(tangent.distance(cos * a + sin * b) < 1e-6);
    }

    #[test]
    fn twist_and_back_is_the_identity(degrees in -500.0..500.0, p in position()) {
        let there = image(&Edit::Twist(twist(degrees)), p);
        prop_assert!(image(&Edit::Twist(twist(-degrees)), there).distance(p) < 1e-14);
    }
}

#[cfg(feature = "serde")]
mod written {
    use isochor::PointRequest;

    use super::*;

    #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Job {
        edit: Vec<Edit>,
    }

    fn read(edit: &str) -> Result<Edit, String> {
        let job = toml::from_str::<Job>(&format!("[[edit]]\n{edit}\n"));
        job.map(|mut job| job.edit.remove(0)).map_err(|e| e.message().to_owned())
    }

    #[test]
    fn all_forms_are_read_and_written() {
        let xyz = DVec3::new(1.0, 2.5, -3.0);
        let plane: Selector = "k=5".parse().unwrap();
        let cases = [
            ("twist = { axis = \"z\", degrees = 90 }", Edit::Twist(twist(90.0))),
            (
                "twist = { axis = \"x\", degrees = -4.5, range = [0, 0.5], center = [1, 2.5, -3], nodes = { k = 5 } }",
                Edit::Twist(Twist {
                    axis: Axis::X,
                    degrees: -4.5,
                    range: Some([0.0, 0.5]),
                    center: Some(xyz),
                    nodes: plane.clone(),
                }),
            ),
            ("bend = { axis = \"y\", degrees = 45 }", Edit::Bend(bend(Axis::Y, 45.0))),
            (
                "bend = { axis = \"y\", degrees = 45, towards = \"-x\", range = [0.25, 0.5] }",
                Edit::Bend(Bend { towards: Some(SignedAxis::MinusX), range: Some([0.25, 0.5]), ..bend(Axis::Y, 45.0) }),
            ),
            (
                "taper = { axis = \"z\", scale = 0.5, nodes = \"all\" }",
                Edit::Taper(Taper { scale: 0.5, ..Taper::default() }),
            ),
            (
                "stretch = { axis = \"z\", scale = 2, center = [1, 2.5, -3] }",
                Edit::Stretch(Stretch { scale: 2.0, center: Some(xyz), ..Stretch::default() }),
            ),
            ("move = { by = [1, 2.5, -3] }", Edit::Move(Move { by: xyz, ..Move::default() })),
            (
                "move = { nodes = { k = 5 }, by = [1, 2.5, -3], unit = \"extent\" }",
                Edit::Move(Move { by: xyz, unit: LengthUnit::Extent, nodes: plane }),
            ),
            (
                "rotate = { axis = \"y\", degrees = 30 }",
                Edit::Rotate(Rotate { axis: RotationAxis::Coordinate(Axis::Y), degrees: 30.0, ..Rotate::default() }),
            ),
            (
                "rotate = { axis = [1, 2.5, -3], degrees = 30 }",
                Edit::Rotate(Rotate { axis: RotationAxis::Vector(xyz), degrees: 30.0, ..Rotate::default() }),
            ),
            ("scale = { by = 2 }", Edit::Scale(Scale { by: Factors::Uniform(2.0), ..Scale::default() })),
            ("scale = { by = [1, 2.5, -3] }", Edit::Scale(Scale { by: Factors::PerAxis(xyz), ..Scale::default() })),
            ("noise = { amplitude = 0.1 }", Edit::Noise(Noise { amplitude: 0.1, ..Noise::default() })),
            (
                "noise = { amplitude = 0.1, seed = 7, unit = \"model\" }",
                Edit::Noise(Noise { amplitude: 0.1, seed: 7, unit: LengthUnit::Model, ..Noise::default() }),
            ),
            (
                "posed = { points = [{ node = [0, 1, 2], to = [1, 2.5, -3] }] }",
                Edit::Posed(Posed {
                    to: PosedTo::Points(vec![PosedPoint { node: [0, 1, 2], to: xyz }]),
                    nodes: Selector::All,
                }),
            ),
            (
                "drag = { vertex = 7, to = [1, 2.5, -3] }",
                Edit::Drag(Drag { points: vec![PointRequest { vertex: 7, to: xyz }], nodes: Selector::All }),
            ),
            (
                "drag = { points = [{ vertex = 7, to = [1, 2.5, -3] }, { vertex = 8, to = [0, 0, 0] }], nodes = \"k=5\" }",
                Edit::Drag(Drag {
                    points: vec![PointRequest { vertex: 7, to: xyz }, PointRequest { vertex: 8, to: DVec3::ZERO }],
                    nodes: "k=5".parse().unwrap(),
                }),
            ),
            (
                "posed = { lattice = [[[[1, 2.5, -3], [0, 0, 0]]]] }",
                Edit::Posed(Posed { to: PosedTo::Lattice(vec![vec![vec![xyz, DVec3::ZERO]]]), nodes: Selector::All }),
            ),
        ];
        for (toml, edit) in cases {
            assert_eq!(read(toml).as_ref(), Ok(&edit), "{toml}");
            let job = Job { edit: vec![edit] };
            let toml = toml::to_string(&job).unwrap();
            assert_eq!(toml::from_str::<Job>(&toml).unwrap(), job, "{toml}");
            let json = serde_json::to_string(&job).unwrap();
            assert_eq!(serde_json::from_str::<Job>(&json).unwrap(), job, "{json}");
        }
    }

    #[test]
    fn edits_are_read_in_order() {
        let job = "[[edit]]\ntwist = { axis = \"z\", degrees = 90 }\n[[edit]]\nmove = { by = [0, 0, 1] }\n";
        let names = toml::from_str::<Job>(job).unwrap().edit.iter().map(Edit::name).collect::<Vec<_>>();
        assert_eq!(names, ["twist", "move"]);
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        for (toml, expected) in [
            ("twirl = { axis = \"z\" }", "unknown variant `twirl`, expected one of `twist`, `bend`"),
            ("twist = { axis = \"z\", degree = 90 }", "unknown field `degree`, expected one of `axis`, `degrees`"),
            ("twist = { axis = \"z\" }", "missing field `degrees`"),
            ("twist = { axis = \"w\", degrees = 90 }", "unknown variant `w`, expected one of `x`, `y`, `z`"),
            ("twist = { axis = \"z\", degrees = \"a lot\" }", "invalid type: string \"a lot\", expected f64"),
            ("twist = { axis = \"z\", degrees = 1, range = [0] }", "invalid length 1, expected a list of 2"),
            ("twist = { axis = \"z\", degrees = 1, center = [0, 0, 0, 0] }", "invalid length 4, expected a list of 3"),
            ("twist = { axis = \"z\", degrees = 1, center = 0 }", "invalid type: integer `0`, expected a list of 3"),
            ("twist = { axis = \"z\", degrees = 1, nodes = { l = 0 } }", "unknown field `l`, expected one of `i`, `j`"),
            ("bend = { axis = \"z\", degrees = 1, towards = \"up\" }", "unknown variant `up`, expected one of `x`"),
            ("move = { by = [0, 1] }", "invalid length 2, expected a list of 3"),
            ("move = { by = [0, 1, 2, 3] }", "invalid length 4, expected a list of 3"),
            ("move = { by = [0, 1, 2], unit = \"mm\" }", "unknown variant `mm`, expected `extent` or `model`"),
            ("rotate = { axis = \"q\", degrees = 1 }", "`axis` must be \"x\", \"y\", \"z\" or a vector [x, y, z]"),
            (
                "rotate = { axis = [1, 2, 3, 4], degrees = 1 }",
                "`axis` must be \"x\", \"y\", \"z\" or a vector [x, y, z]",
            ),
            ("scale = { by = \"x\" }", "`by` must be a number or three of them: [x, y, z]"),
            ("scale = { by = [1, 2] }", "`by` must be a number or three of them: [x, y, z]"),
            ("noise = { amplitude = 1, seed = -1 }", "invalid value: integer `-1`, expected u64"),
            ("posed = { }", "posed has neither `points` nor `lattice`: it needs one of them"),
            ("posed = { points = [], lattice = [] }", "posed has both `points` and `lattice`"),
            ("posed = { points = [{ node = [0, 0], to = [0, 0, 0] }] }", "invalid length 2, expected a list of 3"),
            ("posed = { lattice = [[[[0, 0]]]] }", "invalid length 2, expected a list of 3"),
            ("drag = { }", "drag has neither `vertex` and `to` nor `points`: it needs one of them"),
            ("drag = { vertex = 1 }", "drag has `vertex` but no `to`, the place where it goes"),
            ("drag = { to = [0, 0, 0] }", "drag has `to` but no `vertex` that goes there"),
            ("drag = { vertex = 1, to = [0, 0, 0], points = [] }", "drag has both `points` and `vertex` or `to`"),
            ("drag = { vertex = -1, to = [0, 0, 0] }", "invalid value: integer `-1`, expected usize"),
            ("drag = { vertex = 1, to = [0, 0] }", "invalid length 2, expected a list of 3"),
            ("drag = { points = [{ vertex = 1, by = [0, 0, 0] }] }", "unknown field `by`, expected `vertex` or `to`"),
            ("posed = { point = [] }", "unknown field `point`, expected one of `points`, `lattice`, `nodes`"),
        ] {
            let error = read(toml).unwrap_err();
            assert!(error.contains(expected), "{toml}: {error}");
        }
        // An entry is one edit.
        assert!(read("").is_err());
        assert!(read("scale = { by = 1 }\nmove = { by = [0, 0, 0] }").is_err());
    }

    #[test]
    fn the_examples_of_the_page_are_jobs() {
        let page = include_str!("../../../docs/edit.md");
        let examples: Vec<&str> = page.split("```toml").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
        assert!(examples.len() > 9);
        for example in examples {
            toml::from_str::<Job>(example).unwrap();
        }
    }
}
