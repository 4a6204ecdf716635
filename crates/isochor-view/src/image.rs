//! Images: rows of pixels, and the PNG files they make.

/// Red, green and blue as files hold them (sRGB).
pub type Rgb = [u8; 3];

/// The longest side of an image in pixels. Larger: one picture takes gigabytes; smaller: posters are cut.
pub const MAX_SIDE: usize = 32_768;

/// Rows of pixels, from the top. At least one pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Vec<Rgb>,
}

impl Image {
    /// An image of one colour. Sides below 1 and above [`MAX_SIDE`] are brought there.
    #[must_use]
    pub fn filled(width: usize, height: usize, color: Rgb) -> Self {
        let [width, height] = [width, height].map(|side| side.clamp(1, MAX_SIDE));
        Self { width, height, pixels: vec![color; width * height] }
    }

    /// Pixels in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels (width · height), row after row from the top.
    #[must_use]
    pub fn pixels(&self) -> &[Rgb] {
        &self.pixels
    }

    /// The pixel `x` from the left and `y` from the top.
    ///
    /// # Panics
    ///
    /// Panics where there is no such pixel.
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> Rgb {
        assert!(x < self.width, "x is {x}, but a row has {} pixels", self.width);
        self.pixels[y * self.width + x]
    }

    /// The image as a PNG file, 8 bits for each of red, green and blue.
    #[must_use]
    pub fn png(&self) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = self.encoder(&mut file);
        encoder.set_compression(png::Compression::Balanced);
        let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(self.pixels.as_flattened()));
        written.expect("an image has at least one pixel, and memory takes all bytes");
        file
    }

    /// An encoder for images of this size.
    pub(crate) fn encoder<'a>(&self, file: &'a mut Vec<u8>) -> png::Encoder<'a, &'a mut Vec<u8>> {
        let side = |pixels: usize| u32::try_from(pixels).expect("sides are at most MAX_SIDE");
        let mut encoder = png::Encoder::new(file, side(self.width), side(self.height));
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder
    }

    /// Lays `color` over a pixel, of which it covers a part (0 to 1). Nothing happens outside.
    pub(crate) fn cover(&mut self, x: isize, y: isize, color: Rgb, part: f32) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < self.width && y < self.height {
            let pixel = &mut self.pixels[y * self.width + x];
            let mixed =
                |under: u8, over: u8| (f32::from(under) + (f32::from(over) - f32::from(under)) * part).round() as u8;
            *pixel = std::array::from_fn(|i| mixed(pixel[i], color[i]));
        }
    }

    /// Fills the pixels from `from` up to but without `to`, as far as there are such.
    pub(crate) fn fill(&mut self, from: [isize; 2], to: [isize; 2], color: Rgb) {
        let within = |at: isize, side: usize| usize::try_from(at).unwrap_or(0).min(side);
        let (left, right) = (within(from[0], self.width), within(to[0], self.width));
        for y in within(from[1], self.height)..within(to[1], self.height) {
            if left < right {
                self.pixels[y * self.width + left..y * self.width + right].fill(color);
            }
        }
    }

    /// Puts another image in, its first pixel at `x`, `y`, as far as there is room.
    pub(crate) fn put(&mut self, other: &Self, x: usize, y: usize) {
        let columns = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let to = (y + row) * self.width + x;
            self.pixels[to..to + columns]
                .copy_from_slice(&other.pixels[row * other.width..row * other.width + columns]);
        }
    }

    /// The image of rows of pixels, `width` each; at least one row.
    pub(crate) fn of_rows(width: usize, pixels: Vec<Rgb>) -> Self {
        Self { width, height: pixels.len() / width, pixels }
    }
}
