//! Animations read back frame by frame.

use isochor::shapes;
use isochor_view::{AnimationError, Image, PictureOptions, Show, ShownPose, animated_png, picture};

/// A picture that says which frame it is.
fn image(frame: u8, width: usize, height: usize) -> Image {
    let mesh = shapes::cube(1);
    let pose = ShownPose {
        name: format!("frame {frame}"),
        points: mesh.points().into(),
        lattice: None,
        volume: None,
        volume_change: None,
        stress: None,
    };
    let show = Show { faces: mesh.faces(), poses: vec![pose] };
    picture(&show, &PictureOptions { panel: [width, height], ..PictureOptions::default() })
}

#[test]
fn an_animation_has_its_frames() {
    for count in [1, 2, 5] {
        let frames: Vec<Image> = (0..count).map(|frame| image(frame, 60, 40)).collect();
        let file = animated_png(&frames, 40).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&file)).read_info().unwrap();
        let control = *reader.info().animation_control().unwrap();
        // Zero plays: for ever.
        assert_eq!((control.num_frames, control.num_plays), (u32::from(count), 0));
        for (index, frame) in frames.iter().enumerate() {
            let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut bytes).unwrap();
            assert_eq!(bytes, frame.pixels().as_flattened(), "frame {index} of {count}");
            let shown = reader.info().frame_control().unwrap();
            assert_eq!((shown.delay_num, shown.delay_den), (40, 1000));
        }
    }
}

#[test]
fn no_frames_and_frames_of_different_sizes_are_errors() {
    assert_eq!(animated_png(&[], 40), Err(AnimationError::NoFrames));
    let [first, other] = [image(0, 60, 40), image(1, 61, 40)];
    let first_size = [first.width(), first.height()];
    let (width, height) = (other.width(), other.height());
    let error = animated_png(&[first.clone(), first, other], 40).unwrap_err();
    assert_eq!(error, AnimationError::OtherSize { frame: 2, width, height, first: first_size });
    assert!(error.to_string().contains("frame 2"), "{error}");
}
