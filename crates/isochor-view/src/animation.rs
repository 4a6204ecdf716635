//! Animated PNG files: plain PNG where they are not understood, lossless and full colour where they are.

use crate::image::Image;

/// Why frames make no animation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AnimationError {
    /// There is no frame.
    #[error("an animation needs at least one frame")]
    NoFrames,
    /// A frame has another size than the first.
    #[error("frame {frame} has {width} × {height} pixels, the first {} × {}", .first[0], .first[1])]
    OtherSize {
        /// Index of the frame.
        frame: usize,
        /// Its width in pixels.
        width: usize,
        /// Its height in pixels.
        height: usize,
        /// Width and height of the first frame.
        first: [usize; 2],
    },
}

/// Frames one after the other, each for some milliseconds, for ever.
///
/// # Errors
///
/// No frames, or frames of different sizes.
pub fn animated_png(frames: &[Image], milliseconds: u16) -> Result<Vec<u8>, AnimationError> {
    let Some(first) = frames.first() else { return Err(AnimationError::NoFrames) };
    let other = |frame: &Image| (frame.width(), frame.height()) != (first.width(), first.height());
    if let Some(frame) = frames.iter().position(other) {
        let (width, height) = (frames[frame].width(), frames[frame].height());
        return Err(AnimationError::OtherSize { frame, width, height, first: [first.width(), first.height()] });
    }
    let mut file = Vec::new();
    let mut write = || {
        let mut encoder = first.encoder(&mut file);
        encoder.set_compression(png::Compression::Balanced);
        let count = u32::try_from(frames.len()).map_err(|_| png::EncodingError::LimitsExceeded)?;
        encoder.set_animated(count, 0)?;
        encoder.set_frame_delay(milliseconds, 1000)?;
        let mut writer = encoder.write_header()?;
        frames.iter().try_for_each(|frame| writer.write_image_data(frame.pixels().as_flattened()))?;
        writer.finish()
    };
    let written: Result<(), png::EncodingError> = write();
    written.expect("frames have the size of the first, and memory takes all bytes");
    Ok(file)
}
