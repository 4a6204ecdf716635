//! Lines of text in Noto Sans, which is part of the program: no fonts of the machine, so all machines show the same.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, GlyphId, PxScale, ScaleFont, point};

use crate::image::{Image, Rgb};

static REGULAR: LazyLock<FontRef<'static>> =
    LazyLock::new(|| FontRef::try_from_slice(notosans::REGULAR_TTF).expect("the embedded font is one"));
static BOLD: LazyLock<FontRef<'static>> =
    LazyLock::new(|| FontRef::try_from_slice(notosans::BOLD_TTF).expect("the embedded font is one"));

/// How text looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lettering {
    /// Height of a line in pixels.
    pub(crate) height: f32,
    pub(crate) is_bold: bool,
    pub(crate) color: Rgb,
}

impl Lettering {
    fn font(&self) -> &'static FontRef<'static> {
        if self.is_bold { &BOLD } else { &REGULAR }
    }

    /// Width of a line of text in pixels.
    pub(crate) fn width(&self, text: &str) -> f32 {
        self.glyphs(text).1
    }

    /// Glyphs with their places along the line, and the width of it.
    fn glyphs(&self, text: &str) -> (Vec<(GlyphId, f32)>, f32) {
        let font = self.font().as_scaled(PxScale::from(self.height));
        let mut last: Option<GlyphId> = None;
        let mut at = 0.0;
        let glyphs = text.chars().filter(|c| !c.is_control()).map(|c| {
            let glyph = font.glyph_id(c);
            at += last.map_or(0.0, |last| font.kern(last, glyph));
            last = Some(glyph);
            let here = at;
            at += font.h_advance(glyph);
            (glyph, here)
        });
        let glyphs: Vec<_> = glyphs.collect();
        (glyphs, at)
    }

    /// Writes a line whose upper left corner is at `left`, `top`, in pixels.
    pub(crate) fn write(&self, image: &mut Image, text: &str, [left, top]: [f32; 2]) {
        let font = self.font();
        let scale = PxScale::from(self.height);
        // Baselines between pixels blur all horizontal strokes.
        let baseline = (top + font.as_scaled(scale).ascent()).round();
        for (glyph, at) in self.glyphs(text).0 {
            let Some(outlined) = font.outline_glyph(glyph.with_scale_and_position(scale, point(left + at, baseline)))
            else {
                continue;
            };
            let corner = outlined.px_bounds().min;
            outlined.draw(|x, y, part| {
                image.cover(corner.x as isize + x as isize, corner.y as isize + y as isize, self.color, part.min(1.0));
            });
        }
    }

    /// Writes a line whose middle is at `middle`, smaller where it would be wider than `room`, and shortened where it would be too small to read.
    pub(crate) fn write_centered(&self, image: &mut Image, text: &str, [middle, top]: [f32; 2], room: f32) {
        let (lettering, text) = self.fitted(text, room);
        let lower = (self.height - lettering.height) / 2.0;
        lettering.write(image, &text, [middle - lettering.width(&text) / 2.0, top + lower]);
    }

    /// Lettering and text that are no wider than `room`.
    fn fitted(&self, text: &str, room: f32) -> (Self, String) {
        let width = self.width(text);
        if width <= room {
            return (*self, text.to_owned());
        }
        let smaller = Self { height: (self.height * room / width).max(self.height * SMALLEST), ..*self };
        let mut kept: Vec<char> = text.chars().collect();
        let shortened = |kept: &[char]| kept.iter().copied().chain(['…']).collect::<String>();
        if smaller.width(text) <= room * 1.001 {
            return (smaller, text.to_owned());
        }
        while !kept.is_empty() && smaller.width(&shortened(&kept)) > room {
            kept.pop();
        }
        let text = if kept.is_empty() { String::new() } else { shortened(&kept) };
        (smaller, text)
    }
}

/// Text shrinks to this part of its size before it is shortened. Larger: more is cut off; smaller: nobody can read it.
const SMALLEST: f32 = 0.7;

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Lettering = Lettering { height: 20.0, is_bold: false, color: [0; 3] };

    #[test]
    fn the_font_has_what_captions_need() {
        for font in [&*REGULAR, &*BOLD] {
            for c in "0123456789.,:+\u{2212}±%·×…³⁰¹²⁴⁵⁶⁷⁸⁹⁻=|()/ΔδαβγλμπσφΩ°äöüßé".chars() {
                assert_ne!(font.glyph_id(c), font.glyph_id('\u{10ffff}'), "{c} is missing");
            }
        }
    }

    #[test]
    fn long_lines_fit_their_room() {
        let text = "a name that somebody made far too long for a picture";
        for room in [1000.0, 300.0, 100.0, 20.0, 0.0] {
            let (lettering, text) = PLAIN.fitted(text, room);
            assert!(lettering.width(&text) <= room * 1.001, "{text} in {room}");
        }
        assert_eq!(PLAIN.fitted(text, 1000.0), (PLAIN, text.to_owned()));
    }

    #[test]
    fn control_characters_are_nothing() {
        assert_eq!(PLAIN.width("a\n\t\u{7}b"), PLAIN.width("ab"));
    }

    #[test]
    fn text_is_clipped_at_the_border() {
        let mut image = Image::filled(30, 10, [255; 3]);
        PLAIN.write(&mut image, "wider than thirty pixels", [-5.0, -5.0]);
        assert!(image.pixels().iter().any(|p| *p != [255; 3]));
    }
}
