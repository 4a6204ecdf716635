//! Lines of text in Noto Sans, which is part of the program: no fonts of the machine, so all machines show the same.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, Glyph, GlyphId, PxScale, ScaleFont, point};

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

    /// The glyphs of a line whose left end is on the baseline at 0, and its width.
    fn glyphs(&self, text: &str) -> (Vec<Glyph>, f32) {
        let mut last: Option<(GlyphId, bool)> = None;
        let mut at = 0.0;
        let glyphs = text.chars().filter(|c| !c.is_control()).map(|c| {
            let (c, is_raised) = raised(c).map_or((c, false), |c| (c, true));
            let scale = PxScale::from(if is_raised { self.height * RAISED_SIZE } else { self.height });
            let font = self.font().as_scaled(scale);
            let id = font.glyph_id(c);
            at += last.filter(|last| last.1 == is_raised).map_or(0.0, |last| font.kern(last.0, id));
            last = Some((id, is_raised));
            let up = if is_raised { self.height * RAISED_BY } else { 0.0 };
            let glyph = id.with_scale_and_position(scale, point(at, -up));
            at += font.h_advance(id);
            glyph
        });
        let glyphs: Vec<_> = glyphs.collect();
        (glyphs, at)
    }

    /// Writes a line whose upper left corner is at `left`, `top`, in pixels.
    pub(crate) fn write(&self, image: &mut Image, text: &str, [left, top]: [f32; 2]) {
        let font = self.font();
        // Baselines between pixels blur all horizontal strokes.
        let baseline = (top + font.as_scaled(PxScale::from(self.height)).ascent()).round();
        for mut glyph in self.glyphs(text).0 {
            glyph.position += point(left, baseline);
            let Some(outlined) = font.outline_glyph(glyph) else { continue };
            let corner = outlined.px_bounds().min;
            outlined.draw(|x, y, part| {
                image.cover(corner.x as isize + x as isize, corner.y as isize + y as isize, self.color, part.min(1.0));
            });
        }
    }

    /// Writes a line whose middle is at `middle`, smaller where it would be wider than `room`, and shortened where it
    /// would be too small to read.
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

/// What is raised stands for: few fonts have all raised digits and the raised minus, and some have them in two styles.
fn raised(c: char) -> Option<char> {
    const RAISED: [(char, char); 11] = [
        ('⁻', '\u{2212}'),
        ('⁰', '0'),
        ('¹', '1'),
        ('²', '2'),
        ('³', '3'),
        ('⁴', '4'),
        ('⁵', '5'),
        ('⁶', '6'),
        ('⁷', '7'),
        ('⁸', '8'),
        ('⁹', '9'),
    ];
    RAISED.iter().find(|(raised, _)| *raised == c).map(|(_, plain)| *plain)
}

/// Size and height of what is raised, relative to a line. Larger: exponents look like factors; smaller: nobody can read
/// them.
const RAISED_SIZE: f32 = 0.66;
const RAISED_BY: f32 = 0.26;

/// Text shrinks to this part of its size before it is shortened. Larger: more is cut off; smaller: nobody can read it.
const SMALLEST: f32 = 0.7;

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Lettering = Lettering { height: 20.0, is_bold: false, color: [0; 3] };

    #[test]
    fn the_font_has_what_captions_need() {
        for font in [&*REGULAR, &*BOLD] {
            for c in "0123456789.,:+\u{2212}±%·×…=|()/ΔδαβγλμπσφΩ°äöüßé".chars() {
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
