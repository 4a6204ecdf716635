//! Pictures: the same for any number of threads, one camera for all poses, and something sane for whatever comes.

use std::borrow::Cow;
use std::f64::consts::PI;

use glam::DVec3;
use isochor::{CageInput, Faces, Job, JobInput, Mesh, NetDrawing, NetKind, Source, shapes};
use isochor_view::{
    Camera, ColorScale, Coloring, Image, NO_VALUE, PictureOptions, Rgb, Show, ShownLattice, ShownPose, StripOptions,
    frames, picture, strip,
};

const WHITE: Rgb = [255; 3];

fn pose(points: &[DVec3]) -> ShownPose<'_> {
    ShownPose {
        name: "rest".into(),
        points: points.into(),
        lattice: None,
        volume: None,
        volume_change: None,
        stress: None,
    }
}

fn show<'a>(faces: &'a Faces, points: &'a [DVec3]) -> Show<'a> {
    Show { faces, poses: vec![pose(points)] }
}

/// Panels of a few pixels, without words, so that all ink is the model's.
fn small() -> PictureOptions {
    PictureOptions { panel: [96, 80], ..PictureOptions::default() }
}

/// A picture of points and faces without a word.
fn mute(faces: &Faces, points: &[DVec3]) -> Image {
    let mut show = show(faces, points);
    show.poses[0].name = String::new();
    picture(&show, &small())
}

fn inked(image: &Image) -> usize {
    image.pixels().iter().filter(|p| **p != WHITE).count()
}

/// The lattice of a box with so many control points.
fn lattice(size: [usize; 3], low: DVec3, high: DVec3) -> ShownLattice<'static> {
    let part = |i: usize, n: usize| if n > 1 { i as f64 / (n - 1) as f64 } else { 0.5 };
    let nodes = (0..size[0] * size[1] * size[2]).map(|c| {
        let at = [c / (size[1] * size[2]), c / size[2] % size[1], c % size[2]];
        low + (high - low) * DVec3::from_array(std::array::from_fn(|axis| part(at[axis], size[axis])))
    });
    ShownLattice { size, controls: nodes.collect(), net: None, planes: Vec::new() }
}

/// Poses of a deformed ball, with all that a pose can have.
fn with_job<R>(mesh: &Mesh, f: impl FnOnce(&Show) -> R) -> R {
    let job = "
        [lattice]
        size = [4, 4, 4]
        [[edit]]
        twist = { axis = 'z', degrees = 90 }
        [[edit]]
        stretch = { axis = 'z', scale = 0.6 }
        [preserve]
        volume = '100%'
    ";
    let input = JobInput { mesh, source: &Source::of(mesh), lattice: None, surface: None, cage: None };
    let outcome = Job::from_toml(job).unwrap().run(&input, &mut |_stage| {}).unwrap();
    let course = outcome.course();
    f(&Show::of_job(mesh, &outcome, course.as_ref()).with_stress(&outcome))
}

fn block(image: &Image, [left, top]: [usize; 2], [width, height]: [usize; 2]) -> Vec<Rgb> {
    (top..top + height).flat_map(|y| (left..left + width).map(move |x| image.pixel(x, y))).collect()
}

#[test]
fn bits_do_not_depend_on_the_number_of_threads() {
    let mesh = shapes::eared_ball(4);
    with_job(&mesh, |show| {
        for coloring in [Coloring::Plain, Coloring::VolumeChange, Coloring::Displacement, Coloring::Stress] {
            let options = PictureOptions { panel: [200, 180], coloring, ..PictureOptions::default() };
            let drawn = |threads: usize| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| picture(show, &options))
            };
            let one = drawn(1);
            assert!(inked(&one) > 10_000);
            for threads in [2, 7] {
                assert_eq!(drawn(threads), one, "{threads} threads, {coloring:?}");
            }
        }
    });
}

#[test]
fn a_png_file_holds_the_pixels() {
    let image = mute(shapes::icosphere(2).faces(), shapes::icosphere(2).points());
    let file = image.png();
    let mut reader = png::Decoder::new(std::io::Cursor::new(&file)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.width as usize, info.height as usize), (image.width(), image.height()));
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    assert_eq!(bytes, image.pixels().as_flattened());
}

#[test]
fn a_picture_shows_a_triangle_of_its_area() {
    // From distance 10 the half height of a picture is 10 tan 12°.
    let scale = 200.0 / (10.0 * 12.0f64.to_radians().tan());
    let points = [DVec3::new(-1.0, 0.0, -1.0), DVec3::new(1.0, 0.0, -0.5), DVec3::new(0.2, 0.0, 1.2)];
    let faces: Faces = [[0, 1, 2]].iter().collect();
    let camera = Some(Camera::looking(DVec3::new(0.0, -10.0, 0.0), DVec3::ZERO, DVec3::Z));
    let options = PictureOptions { panel: [400, 400], camera, ..PictureOptions::default() };
    let mut show = show(&faces, &points);
    show.poses[0].name = String::new();
    let image = picture(&show, &options);
    let [a, b] = [points[1] - points[0], points[2] - points[0]];
    let area = (a.x * b.z - a.z * b.x) / 2.0 * scale * scale;
    let border = (a.length() + b.length() + (b - a).length()) * scale;
    // Pixels that are partly covered count as well.
    let inked = inked(&image) as f64;
    assert!(area <= inked && inked <= area + border, "{inked} pixels for {area}");
    // Shares of covered pixels sum up to the area. Light adds up in squares of what files hold.
    let light = |p: &Rgb| (f64::from(p[0]) / 255.0).powi(2);
    let darkest = image.pixels().iter().map(light).fold(1.0, f64::min);
    let covered: f64 = image.pixels().iter().map(|p| (1.0 - light(p)) / (1.0 - darkest)).sum();
    assert!((covered / area - 1.0).abs() < 0.02, "{covered} of {area}");
}

#[test]
fn all_poses_have_one_camera() {
    let mesh = shapes::icosphere(3);
    with_job(&mesh, |show| {
        let options = PictureOptions { coloring: Coloring::VolumeChange, ..small() };
        let frames = frames(show, &options);
        assert_eq!(frames.len(), 3);
        let picture = picture(show, &options);
        let strip = strip(show, &StripOptions { picture: options, chosen: Some(vec![2, 0, 9]), columns: Some(1) });
        // The margin is 13 · 0.8 pixels, between panels as well; captions have other words, so panels alone are
        // compared.
        let (margin, panel) = (10, [96, 50]);
        for (pose, frame) in frames.iter().enumerate() {
            assert_eq!((frame.width(), frame.height()), (frames[0].width(), frames[0].height()));
            let alone = block(frame, [margin, margin], panel);
            assert!(alone.iter().any(|p| *p != WHITE));
            assert_eq!(block(&picture, [margin + pose * (96 + margin), margin], panel), alone, "pose {pose}");
        }
        assert_eq!(block(&strip, [margin, margin], panel), block(&frames[2], [margin, margin], panel));
        assert_eq!(strip.width(), frames[0].width());
    });
}

#[test]
fn sizes_compare() {
    // A ball of half the size covers a quarter of the area, up to the difference of its distances (perspective) and its
    // outline.
    let mesh = shapes::icosphere(4);
    let half: Vec<DVec3> = mesh.points().iter().map(|p| *p * 0.5).collect();
    let mut show = show(mesh.faces(), mesh.points());
    show.poses.push(pose(&half));
    show.poses.iter_mut().for_each(|pose| pose.name.clear());
    let [large, small] = &frames(&show, &PictureOptions::default())[..] else { panic!("two poses") };
    let ratio = inked(small) as f64 / inked(large) as f64;
    assert!((ratio - 0.25).abs() < 0.02, "{ratio}");
}

#[test]
fn models_of_any_size_and_place_look_the_same() {
    // Powers of two, so that the coordinates are exactly those of the same shape.
    let mesh = shapes::cube(4);
    let image = mute(mesh.faces(), mesh.points());
    let far = f64::from(1 << 20);
    for (scale, shift) in
        [(2f64.powi(-900), 0.0), (2f64.powi(900), 0.0), (1.0, far), (1.0, -far), (2f64.powi(-20), 1.0)]
    {
        let points: Vec<DVec3> = mesh.points().iter().map(|p| *p * scale + shift).collect();
        assert_eq!(mute(mesh.faces(), &points), image, "{scale} {shift}");
    }
}

#[test]
fn inside_out_models_show_their_outside() {
    let mesh = shapes::icosphere(3);
    let turned: Faces = mesh.faces().iter().map(|f| [f[0], f[2], f[1]]).collect::<Vec<_>>().iter().collect();
    let [sound, turned] = [mesh.faces(), &turned].map(|faces| mute(faces, mesh.points()));
    let apart = |(a, b): (&Rgb, &Rgb)| (0..3).map(|i| a[i].abs_diff(b[i])).max();
    assert!(sound.pixels().iter().zip(turned.pixels()).filter_map(apart).all(|d| d <= 1));
}

#[test]
fn the_inside_of_an_open_model_has_another_tint() {
    // A box without its lid, from above: the inside is warm (red over blue), outside of closed models never.
    let cube = shapes::cube(2);
    let is_lid = |face: &&[u32]| face.iter().all(|&v| cube.points()[v as usize].z == 1.0);
    let open: Faces = cube.faces().iter().filter(|face| !is_lid(face)).collect();
    let warm = |image: &Image| image.pixels().iter().filter(|p| p[0] > p[2].saturating_add(20)).count();
    assert_eq!(warm(&mute(cube.faces(), cube.points())), 0);
    assert!(warm(&mute(&open, cube.points())) > 300);
}

#[test]
fn colours_are_those_of_the_scale() {
    let mesh = shapes::icosphere(3);
    let mut show = show(mesh.faces(), mesh.points());
    let reds = |image: &Image| image.pixels().iter().filter(|p| p[0] > p[2].saturating_add(40)).count();
    let blues = |image: &Image| image.pixels().iter().filter(|p| p[2] > p[0].saturating_add(40)).count();
    let options = PictureOptions { coloring: Coloring::VolumeChange, ..small() };
    let mut of = |change: f64| {
        show.poses[0].volume_change = Some(Cow::Owned(vec![change; mesh.points().len()]));
        picture(&show, &options)
    };
    let (lost, kept, gained) = (of(0.5), of(1.0), of(2.0));
    // The bar has both colours in each of them.
    assert!(blues(&lost) > 1000 + reds(&lost) && reds(&gained) > 1000 + blues(&gained));
    assert!(blues(&kept).abs_diff(reds(&kept)) < 300);
    let no_values = [f64::NAN, f64::INFINITY, -1.0].map(|change| {
        let image = of(change);
        assert!(image.pixels().contains(&NO_VALUE), "the legend shows it");
        image
    });
    assert_eq!(no_values[0], no_values[1]);
    assert_eq!(no_values[0], no_values[2]);
}

/// The pixel in the middle of the first panel, as light: in squares of what files hold.
fn middle(image: &Image) -> DVec3 {
    light(image.pixel(10 + 96 / 2, image.height() / 3))
}

fn light(color: Rgb) -> DVec3 {
    DVec3::from_array(color.map(|c| (f64::from(c) / 255.0).powi(2)))
}

/// A show of a cube, its front before the viewer, in poses of these stresses in radians.
fn with_front<R>(stresses: &[f64], f: impl FnOnce(&Show, &PictureOptions) -> R) -> R {
    let cube = shapes::cube(2);
    let mut show = show(cube.faces(), cube.points());
    show.poses = vec![pose(cube.points()); stresses.len()];
    for (pose, stress) in show.poses.iter_mut().zip(stresses) {
        pose.stress = Some(Cow::Owned(vec![*stress; cube.points().len()]));
    }
    let camera = Some(Camera::looking(DVec3::new(0.5, -4.0, 0.5), DVec3::new(0.5, 0.0, 0.5), DVec3::Z));
    f(&show, &PictureOptions { coloring: Coloring::Stress, camera, ..small() })
}

#[test]
fn stress_has_the_colours_of_one_scale_for_all_poses() {
    // θ of stretches of 1, 0.7 and 0.4, a quarter and the half of it; and pieces that are inside out.
    let theta = (2.0 * 0.4f64.sqrt() / 1.4).acos();
    let stresses = [theta, theta / 4.0, theta / 2.0, 0.0, PI];
    let scale = ColorScale::stress(theta);
    let images = with_front(&stresses, frames);
    // Light from a surface is its colour times what falls on it, and a highlight, alike in all poses: from the first pose.
    let (base, seen) = (light(scale.color_at(1.0)), middle(&images[0]));
    let falling = (seen.x - seen.z) / (base.x - base.z);
    let highlight = seen - base * falling;
    assert!(falling > 0.6 && (highlight - DVec3::splat(highlight.x)).abs().max_element() < 0.01, "{seen}");
    for (stress, image) in stresses.iter().zip(&images) {
        let expected = light(scale.color(*stress)) * falling + highlight;
        assert!((middle(image) - expected).abs().max_element() < 0.02, "{stress}: {} {expected}", middle(image));
        assert!(image.pixels().contains(&NO_VALUE), "all poses have the legend, which shows what is inside out");
        // And the ends of the scale.
        assert!([0.0, 1.0].map(|place| scale.color_at(place)).iter().all(|end| image.pixels().contains(end)));
    }
    let sound = with_front(&stresses[..4], frames);
    assert!(sound.iter().all(|image| !image.pixels().contains(&NO_VALUE)));
    // A right angle, of flat pieces, has its place.
    assert!(!with_front(&[PI / 2.0], picture).pixels().contains(&NO_VALUE));
}

/// A stretch by 1, 1.5 and 0.6 has the angle arccos(2√(ac)/(a+c)) everywhere, by a lattice as by a cage; a turn with a uniform scale has none, and a
/// reflection turns inside out.
#[test]
fn jobs_have_the_stress_of_their_maps() {
    let mesh = shapes::icosphere(2);
    let cage = CageInput {
        mesh: shapes::cube(1).with_points(shapes::cube(1).points().iter().map(|p| *p * 4.0 - 2.0).collect()).unwrap(),
        posed: None,
        weights: None,
    };
    let stretch = (2.0 * (1.5f64 * 0.6).sqrt() / 2.1).acos();
    for (edits, expected, tolerance) in [
        ("[[edit]]\nscale = { by = [1, 1.5, 0.6] }\n", stretch, 1e-12),
        ("[[edit]]\nscale = { by = 1.7 }\n[[edit]]\nrotate = { axis = [1, 2, 2], degrees = 70 }\n", 0.0, 1e-12),
        ("[[edit]]\nscale = { by = [1, -1.5, 0.6] }\n", PI, 0.0),
    ] {
        for section in ["[lattice]\nsize = 4\n", "[cage]\nfile = 'cage.obj'\n"] {
            let job = format!("{section}{edits}[preserve]\nvolume = 'free'\n");
            let source = Source::of(&mesh);
            let input = JobInput { mesh: &mesh, source: &source, lattice: None, surface: None, cage: Some(&cage) };
            let outcome = Job::from_toml(&job).unwrap().run(&input, &mut |_stage| {}).unwrap();
            let course = outcome.course();
            let show = Show::of_job(&mesh, &outcome, course.as_ref());
            assert!(show.poses.iter().all(|pose| pose.stress.is_none()), "nothing is computed that is not asked for");
            let show = show.with_stress(&outcome);
            let [rest, deformed] = &show.poses[..] else { panic!("two poses of {job}") };
            assert!(rest.stress.is_none());
            let stress = deformed.stress.as_deref().unwrap();
            assert_eq!(stress.len(), mesh.points().len());
            assert!(stress.iter().all(|angle| (angle - expected).abs() <= tolerance), "{job}: {stress:?}");
        }
    }
}

#[test]
fn without_values_the_model_is_plain_and_has_no_bar() {
    let mesh = shapes::icosphere(2);
    let show = show(mesh.faces(), mesh.points());
    let plain = picture(&show, &small());
    for coloring in [Coloring::VolumeChange, Coloring::Displacement, Coloring::Stress] {
        assert_eq!(picture(&show, &PictureOptions { coloring, ..small() }), plain);
    }
    // Too few values are none.
    let mut short = show.clone();
    short.poses[0].volume_change = Some(Cow::Owned(vec![1.0; 3]));
    short.poses[0].stress = short.poses[0].volume_change.clone();
    for coloring in [Coloring::VolumeChange, Coloring::Stress] {
        assert_eq!(picture(&short, &PictureOptions { coloring, ..small() }), plain);
    }
}

#[test]
fn a_model_that_does_not_move_has_a_scale() {
    let mesh = shapes::icosphere(2);
    let mut show = show(mesh.faces(), mesh.points());
    show.poses.push(pose(mesh.points()));
    assert!(inked(&picture(&show, &PictureOptions { coloring: Coloring::Displacement, ..small() })) > 0);
}

#[test]
fn hidden_lines_are_fainter() {
    // A lattice inside of a ball: without the ball all of it is seen, with it nothing is before the surface.
    let ball = shapes::icosphere(3);
    let drawn = |faces: &Faces, with_lattice: bool| {
        let mut show = show(faces, ball.points());
        show.poses[0].lattice = Some(lattice([3, 3, 3], DVec3::splat(-0.2), DVec3::splat(0.2)));
        picture(&show, &PictureOptions { with_lattice, ..PictureOptions::default() })
    };
    // By how much a lattice darkens a pixel at most.
    let darkening = |faces: &Faces| {
        let [with, without] = [true, false].map(|with_lattice| drawn(faces, with_lattice));
        let pairs = with.pixels().iter().zip(without.pixels());
        pairs.map(|(with, without)| i32::from(without[0]) - i32::from(with[0])).max().unwrap()
    };
    let (open, hidden) = (darkening(&Faces::new()), darkening(ball.faces()));
    assert!(5 < hidden && 2 * hidden < open, "{hidden} of {open}");
}

#[test]
fn lattices_of_every_size_are_drawn() {
    let mesh = shapes::cube(2);
    for size in [[2, 2, 2], [2, 3, 4], [1, 1, 1], [1, 2, 1], [5, 5, 5], [12, 12, 12]] {
        let mut show = show(mesh.faces(), mesh.points());
        let bare = picture(&show, &small());
        show.poses[0].lattice = Some(lattice(size, DVec3::splat(-0.2), DVec3::splat(1.2)));
        assert!(picture(&show, &small()) != bare, "{size:?}");
        assert_eq!(picture(&show, &PictureOptions { with_lattice: false, ..small() }), bare, "{size:?}");
    }
}

#[test]
fn of_grids_the_lines_are_drawn() {
    let faces = Faces::new();
    // Control points are blue, lines are nearly grey.
    let blue = |size: [usize; 3]| {
        let mut show = show(&faces, &[]);
        show.poses[0].lattice = Some(lattice(size, DVec3::ZERO, DVec3::ONE));
        let image = picture(&show, &PictureOptions::default());
        let blue = image.pixels().iter().filter(|[r, _, b]| i32::from(*b) - i32::from(*r) > 70).count();
        [blue, inked(&image)]
    };
    let ([of_grid, lines], [of_lattice, _]) = (blue([4, 5, 1]), blue([4, 5, 2]));
    assert!(of_grid == 0 && lines > 500 && of_lattice > 50, "{of_grid} of {lines}, {of_lattice}");
}

/// The sheet of a half cylinder of radius 1, rolled out, and the half cylinder.
#[test]
fn models_along_surfaces_are_shown_with_the_grid_of_the_surface() {
    let mesh = shapes::plate(DVec3::new(1.0, 1.0, 0.1), [1, 1]);
    let shown = |more: &str, f: &dyn Fn(&Show)| {
        let job = format!(
            "[surface]\nkind = 'cylinder'\nradius = 1\nheight = 2\nangles = [0, 180]\ngrid = [6, 4]\n[preserve]\n{more}"
        );
        let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
        let outcome = Job::from_toml(&job).unwrap().run(&input, &mut |_stage| {}).unwrap();
        let course = outcome.course();
        f(&Show::of_job(outcome.divided().unwrap().0, &outcome, course.as_ref()));
    };
    shown("", &|show| {
        let grids: Vec<&ShownLattice> = show.poses.iter().map(|pose| pose.lattice.as_ref().unwrap()).collect();
        assert_eq!(grids.len(), 3);
        for (k, grid) in grids.iter().enumerate() {
            assert_eq!((grid.size, grid.controls.len()), ([7, 5, 1], 35));
            for (c, p) in grid.controls.iter().enumerate() {
                let (along, up) = ((c / 5) as f64 / 6.0, (c % 5) as f64 / 4.0);
                let (sin, cos) = (PI * along).sin_cos();
                let expected = match k {
                    0 => DVec3::new(PI * (along - 0.5), 2.0 * up - 1.0, 0.0),
                    _ => DVec3::new(cos, sin, 2.0 * up),
                };
                assert!(p.distance(expected) < 1e-6, "pose {k}: {p} instead of {expected}");
            }
        }
    });
    // A lattice round the model on the surface is shown there instead.
    shown("method = 'nearest'", &|show| {
        let sizes: Vec<[usize; 3]> = show.poses.iter().map(|pose| pose.lattice.as_ref().unwrap().size).collect();
        assert!(sizes[0] == [7, 5, 1] && sizes[1..].iter().all(|size| size[2] > 1), "{sizes:?}");
    });
}

/// A lattice with springs along its diagonal and to its second node, the nodes of `held` held.
fn with_springs(held: &[usize]) -> ShownLattice<'static> {
    let lattice = lattice([2, 2, 2], DVec3::ZERO, DVec3::ONE);
    let springs = NetDrawing {
        kind: NetKind::Springs,
        ends: vec![[0, 7], [0, 1]],
        is_held: (0..8).map(|c| held.contains(&c)).collect(),
    };
    ShownLattice { net: Some(Cow::Owned(springs)), ..lattice }
}

#[test]
fn springs_are_drawn_instead_of_edges_and_held_nodes_differ() {
    let faces = Faces::new();
    let drawn = |lattice: ShownLattice<'static>| {
        let mut show = show(&faces, &[]);
        show.poses[0].lattice = Some(lattice);
        let with = picture(&show, &PictureOptions::default());
        show.poses[0].lattice.as_mut().unwrap().controls.to_mut()[0] = DVec3::NAN;
        (with, picture(&show, &PictureOptions::default()))
    };
    // Without its first node no spring is left, and there are seven dots. With it: the two springs, whose lines are pale.
    let is_line = |[r, g, b]: &Rgb| r.abs_diff(*b) < 60 && *r < 250 && *g < 250;
    let rows = |image: &Image| image.pixels().len() * 9 / 10; // without the key at the bottom
    let lines = |image: &Image| image.pixels()[..rows(image)].iter().filter(|p| is_line(p)).count();
    let (springs, without) = drawn(with_springs(&[]));
    let (edges, _) = drawn(lattice([2, 2, 2], DVec3::ZERO, DVec3::ONE));
    assert!(lines(&without) < lines(&springs) && 2 * lines(&springs) < lines(&edges));
    // Held nodes are orange, free ones are blue, in the key as well.
    let count = |held: &[usize], is_of_color: fn(i32, i32) -> bool| {
        let (image, _) = drawn(with_springs(held));
        image.pixels().iter().filter(|[r, _, b]| is_of_color(i32::from(*r), i32::from(*b))).count()
    };
    let orange: fn(i32, i32) -> bool = |r, b| r - b > 90;
    let blue: fn(i32, i32) -> bool = |r, b| b - r > 60;
    let [none, four, all] =
        [&[][..], &[0, 1, 2, 3], &[0, 1, 2, 3, 4, 5, 6, 7]].map(|held| [count(held, orange), count(held, blue)]);
    assert!(0 < none[0] && none[0] < four[0] && four[0] < all[0], "{none:?} {four:?} {all:?}");
    assert!(none[1] > four[1] && four[1] > all[1] && all[1] > 0, "{none:?} {four:?} {all:?}");
    // Without lattices there is no key.
    let mut show = show(&faces, &[]);
    let plain = PictureOptions { with_lattice: false, ..PictureOptions::default() };
    let bare = picture(&show, &plain);
    show.poses[0].lattice = Some(with_springs(&[0]));
    assert_eq!(picture(&show, &plain), bare);
}

#[test]
fn jobs_whose_nodes_settle_are_shown_with_their_springs() {
    let mesh = shapes::cube(2);
    let job = "[lattice]\nbasis = 'bernstein'\nsize = 3\n[[edit]]\nscale = { by = [1, 1, 0.6], nodes = { k = [0, 2] } }\n[preserve]\nmethod = 'elastic'\n";
    let input = JobInput { mesh: &mesh, source: &Source::of(&mesh), lattice: None, surface: None, cage: None };
    let outcome = Job::from_toml(job).unwrap().run(&input, &mut |_stage| {}).unwrap();
    let course = outcome.course();
    let show = Show::of_job(&mesh, &outcome, course.as_ref());
    assert_eq!(show.poses.len(), 3);
    for pose in &show.poses {
        let springs = pose.lattice.as_ref().unwrap().net.as_ref().unwrap();
        // 3 · 18 edges, 6 · 12 diagonals of faces and 4 · 8 of cells; the lower and the upper nodes were edited.
        assert_eq!(springs.ends.len(), 158);
        assert!(springs.is_held.iter().enumerate().all(|(node, held)| *held == (node % 3 != 1)));
    }
}

#[test]
fn of_crowded_lattices_the_sides_are_drawn() {
    // The same picture whether the control points inside have places or not: they are not drawn.
    let mesh = shapes::cube(2);
    let size = [11, 4, 4];
    let whole = lattice(size, DVec3::splat(-0.2), DVec3::splat(1.2));
    let is_inner = |c: usize| (0..3).all(|a| (1..size[a] - 1).contains(&[c / 16, c / 4 % 4, c % 4][a]));
    let hollow = whole.controls.iter().enumerate().map(|(c, p)| if is_inner(c) { DVec3::NAN } else { *p });
    let hollow = ShownLattice { size, controls: hollow.collect(), net: None, planes: Vec::new() };
    let drawn = |lattice: ShownLattice<'static>| {
        let mut show = show(mesh.faces(), mesh.points());
        show.poses[0].lattice = Some(lattice);
        picture(&show, &small())
    };
    assert_eq!(drawn(whole), drawn(hollow));
}

#[test]
fn lattices_that_lie_or_are_broken_do_no_harm() {
    let mesh = shapes::cube(2);
    for (size, controls) in [
        ([3, 3, 3], vec![DVec3::ZERO; 4]),
        ([0, 3, 3], vec![DVec3::ONE]),
        ([2, 2, 2], vec![DVec3::NAN; 8]),
        ([2, 1, 1], vec![DVec3::ZERO, DVec3::INFINITY]),
        ([usize::MAX; 3], vec![DVec3::ZERO, DVec3::ONE]),
    ] {
        let mut show = show(mesh.faces(), mesh.points());
        let springs =
            NetDrawing { kind: NetKind::Springs, ends: vec![[0, 1], [7, u32::MAX], [1, 1]], is_held: vec![true] };
        for springs in [None, Some(Cow::Owned(springs))] {
            show.poses[0].lattice =
                Some(ShownLattice { size, controls: controls.clone().into(), net: springs, planes: Vec::new() });
            assert!(inked(&picture(&show, &small())) > 500, "{size:?}");
        }
    }
}

#[test]
fn points_without_a_place_are_left_out_with_their_faces() {
    let mesh = shapes::icosphere(2);
    let image = mute(mesh.faces(), mesh.points());
    let next = mesh.points().len() as u32;
    let mut faces = mesh.faces().clone();
    faces.push(&[0, 1, next]);
    faces.push(&[next, next + 1, next + 2]);
    let mut points = mesh.points().to_vec();
    points.extend([DVec3::NAN, DVec3::splat(f64::INFINITY), DVec3::new(0.0, f64::NEG_INFINITY, f64::NAN)]);
    assert_eq!(mute(&faces, &points), image);
}

#[test]
fn faces_without_area_leave_no_trace() {
    let mesh = shapes::icosphere(2);
    let mut faces = mesh.faces().clone();
    [[0, 0, 1], [2, 2, 2], [3, 4, 3]].iter().for_each(|face| faces.push(face));
    assert_eq!(mute(&faces, mesh.points()), mute(mesh.faces(), mesh.points()));
}

#[test]
fn faces_that_name_no_vertex_are_left_out() {
    let mesh = shapes::icosphere(2);
    let mut faces = mesh.faces().clone();
    faces.push(&[0, 1, u32::MAX]);
    faces.push(&[0, 1]);
    faces.push(&[]);
    assert_eq!(mute(&faces, mesh.points()), mute(mesh.faces(), mesh.points()));
}

#[test]
fn nothing_to_draw_is_an_empty_page() {
    let none = Faces::new();
    let point = [DVec3::new(1e6, 1.0, -3.0)];
    let line: Faces = [[0, 1, 1]].iter().collect();
    for (faces, points) in
        [(&none, &[][..]), (&none, &point), (&line, &[DVec3::ZERO, DVec3::X]), (&line, &[DVec3::NAN, DVec3::NAN])]
    {
        for coloring in [Coloring::Plain, Coloring::VolumeChange, Coloring::Displacement, Coloring::Stress] {
            let mut show = show(faces, points);
            show.poses.push(pose(points));
            show.poses.iter_mut().for_each(|pose| {
                pose.name.clear();
                pose.volume_change = Some(Cow::Owned(vec![1.0; points.len()]));
                pose.stress = pose.volume_change.clone();
            });
            let options = PictureOptions { coloring, ..small() };
            let image = picture(&show, &options);
            // Nothing but the bar below.
            let upper = block(&image, [0, 0], [image.width(), 60.min(image.height())]);
            assert!(coloring != Coloring::Plain || inked(&image) == 0);
            assert!(image.width() > 2 * 96 && upper.len() == image.width() * 60.min(image.height()));
        }
    }
}

#[test]
fn a_show_without_poses_is_a_page() {
    let faces = Faces::new();
    let show = Show { faces: &faces, poses: Vec::new() };
    let titled = PictureOptions { title: Some("nothing".into()), ..small() };
    assert_eq!(inked(&picture(&show, &small())), 0);
    assert!(inked(&picture(&show, &titled)) > 0);
    assert_eq!(inked(&strip(&show, &StripOptions { picture: small(), ..StripOptions::default() })), 0);
    assert_eq!(frames(&show, &small()), []);
}

#[test]
fn poses_of_different_length_show_what_all_of_them_have() {
    let mesh = shapes::icosphere(2);
    let more: Vec<DVec3> = mesh.points().iter().copied().chain([DVec3::ZERO; 5]).collect();
    let mut show = show(mesh.faces(), &more);
    let alone = picture(&show, &small());
    show.poses.push(pose(mesh.points()));
    assert_eq!(frames(&show, &small()), [alone.clone(), alone]);
    // Faces that the last pose has no vertices for are seen in none.
    show.poses.push(pose(&mesh.points()[..40]));
    show.poses.push(pose(&[]));
    for coloring in [Coloring::Plain, Coloring::VolumeChange, Coloring::Displacement, Coloring::Stress] {
        assert!(frames(&show, &PictureOptions { coloring, ..small() }).windows(2).all(|pair| pair[0] == pair[1]));
    }
}

#[test]
fn the_eye_may_be_anywhere() {
    let mesh = shapes::cube(3);
    for eye in
        [DVec3::splat(0.5), DVec3::new(0.5, 0.5, 1.0), DVec3::ZERO, DVec3::splat(1e9), DVec3::splat(1e-9), DVec3::NAN]
    {
        let camera = Some(Camera::looking(eye, DVec3::new(0.5, 0.5, 0.0), DVec3::Z));
        let mut show = show(mesh.faces(), mesh.points());
        show.poses[0].lattice = Some(lattice([3, 3, 3], DVec3::ZERO, DVec3::ONE));
        let image = picture(&show, &PictureOptions { camera, ..small() });
        if eye == DVec3::splat(0.5) {
            // From the inside of a closed box there is no way out.
            let panel = block(&image, [10, 10], [96, 80]);
            assert!(panel.iter().all(|p| *p != WHITE));
        }
    }
}

#[test]
fn panels_of_any_size_are_drawn() {
    let mesh = shapes::cube(1);
    let show = show(mesh.faces(), mesh.points());
    for panel in [[0, 0], [1, 1], [3, 200], [200, 3], [33, 65]] {
        let image = picture(&show, &PictureOptions { panel, title: Some("a title".into()), ..small() });
        assert!(image.width() >= panel[0] && image.pixels().len() == image.width() * image.height(), "{panel:?}");
    }
}

#[test]
fn captions_say_names_and_volumes() {
    // Words are pixels here: whatever is said more is more ink, and what is not known is not said.
    let mesh = shapes::icosphere(1);
    let ink = |name: &str, volume: Option<f64>| {
        let mut show = show(mesh.faces(), mesh.points());
        show.poses[0].name = name.into();
        show.poses[0].volume = volume;
        inked(&picture(&show, &small()))
    };
    let bare = ink("", None);
    assert!(ink("deformed", None) > bare);
    assert!(ink("", Some(0.0417)) > bare);
    assert!(ink("deformed", Some(0.0417)) > ink("deformed", None));
    for volume in [f64::NAN, f64::INFINITY, 0.0, -1.0, 1e300] {
        assert!(ink("", Some(volume)) > bare, "{volume}");
    }
    // A change needs two volumes.
    let of = |volumes: [Option<f64>; 2]| {
        let mut show = show(mesh.faces(), mesh.points());
        show.poses.push(pose(mesh.points()));
        show.poses.iter_mut().zip(volumes).for_each(|(pose, volume)| pose.volume = volume);
        inked(&frames(&show, &small())[1])
    };
    assert!(of([Some(1.0), Some(2.0)]) > of([None, Some(2.0)]));
    assert!(of([None, Some(2.0)]) > of([Some(1.0), None]));
}

#[test]
fn names_of_any_kind_are_written() {
    let mesh = shapes::cube(1);
    for name in ["", "δ → Ω", "\u{0}\u{7}\n", "漢字 🐇", &"long ".repeat(1000)] {
        let mut show = show(mesh.faces(), mesh.points());
        show.poses[0].name = name.into();
        assert_eq!(picture(&show, &small()).width(), picture(&show, &small()).width());
    }
}

#[test]
fn dark_pages_have_light_words() {
    let mesh = shapes::cube(1);
    let image = picture(&show(mesh.faces(), mesh.points()), &PictureOptions { background: [16, 18, 24], ..small() });
    let below = block(&image, [0, image.height() - 50], [image.width(), 50]);
    assert!(below.iter().any(|p| p[0] > 200));
}

#[test]
fn strips_have_rows_and_columns() {
    let mesh = shapes::cube(1);
    let mut show = show(mesh.faces(), mesh.points());
    show.poses = vec![pose(mesh.points()); 8];
    let size = |columns: Option<usize>, chosen: Option<Vec<usize>>| {
        let image = strip(&show, &StripOptions { picture: small(), chosen, columns });
        [image.width(), image.height()]
    };
    let [one, row] = [size(Some(1), Some(vec![0])), size(Some(8), None)];
    let step = [(row[0] - one[0]) / 7, size(Some(1), Some(vec![0, 1]))[1] - one[1]];
    let of = |columns: usize, rows: usize| [one[0] + (columns - 1) * step[0], one[1] + (rows - 1) * step[1]];
    assert_eq!(size(Some(3), None), of(3, 3));
    assert_eq!(size(None, None), of(4, 2));
    assert_eq!(size(Some(0), None), of(1, 8));
    assert_eq!(size(Some(100), None), of(8, 1));
    assert_eq!(size(None, Some(vec![7, 3, 3, 99])), of(3, 1));
}
