//! The bar of a colour scale, with ticks and labels; and which nodes are held.

use crate::color_scale::{ColorScale, NO_VALUE, Quantity, Tick};
use crate::image::{Image, Rgb};
use crate::panel::{CONTROLS, HELD};
use crate::text::Lettering;

/// Free room between labels, in heights of a line. Larger: fewer labels; smaller: they run into each other.
const LABEL_GAP: f32 = 0.4;

/// Where a legend is and how large.
pub(crate) struct Legend<'a> {
    pub(crate) scale: &'a ColorScale,
    pub(crate) lettering: Lettering,
    /// Whether some vertices have no place on the scale.
    pub(crate) with_no_value: bool,
    /// Colour of frame and ticks.
    pub(crate) frame: Rgb,
}

impl Legend<'_> {
    /// Its height in pixels.
    pub(crate) fn height(lettering: &Lettering) -> f32 {
        3.2 * lettering.height
    }

    /// Draws it, `width` pixels wide, its upper edge's middle at `middle`, `top`.
    pub(crate) fn draw(&self, image: &mut Image, [middle, top]: [f32; 2], width: f32) {
        let line = self.lettering.height;
        let name = match self.scale.quantity() {
            Quantity::VolumeChange => "local volume change",
            Quantity::Displacement => "displacement in percent of the extent",
            Quantity::Stress => "local stress",
        };
        self.lettering.write_centered(image, name, [middle, top], width);
        let [left, right] = [(middle - width / 2.0).round() as isize, (middle + width / 2.0).round() as isize];
        let [high, low] = [(top + 1.15 * line).round() as isize, (top + 1.8 * line).round() as isize];
        let tick_length = (line * 0.2).round().max(2.0) as isize;
        image.fill([left - 1, high - 1], [right + 1, low + 1], self.frame);
        for x in left..right {
            let place = (x - left) as f64 / (right - left - 1).max(1) as f64;
            image.fill([x, high], [x + 1, low], self.scale.color_at(place));
        }
        let ticks = self.scale.ticks();
        let at = |tick: &Tick| left as f32 + 0.5 + tick.at as f32 * (right - left - 1) as f32;
        for tick in &ticks {
            let x = at(tick).floor() as isize;
            image.fill([x, low], [x + 1, low + tick_length], self.frame);
        }
        let ranges = ticks.iter().map(|tick| {
            let half = self.lettering.width(&tick.label) / 2.0;
            [at(tick) - half, at(tick) + half]
        });
        for (tick, is_labelled) in ticks.iter().zip(apart(&ranges.collect::<Vec<_>>(), line * LABEL_GAP)) {
            if is_labelled {
                let below = low as f32 + tick_length as f32;
                self.lettering.write_centered(image, &tick.label, [at(tick), below], f32::INFINITY);
            }
        }
        if self.with_no_value {
            let start = right + line.round() as isize;
            let end = start + (low - high);
            image.fill([start - 1, high - 1], [end + 1, low + 1], self.frame);
            image.fill([start, high], [end, low], NO_VALUE);
            let beside = [end as f32 + line * 0.3, (high + low) as f32 / 2.0 - line / 2.0];
            let meaning = match self.scale.quantity() {
                // A piece whose volume changed by a negative factor has no logarithm, and its stress is beyond a right angle.
                Quantity::VolumeChange | Quantity::Stress => "inside out",
                Quantity::Displacement => "no value",
            };
            self.lettering.write(image, meaning, beside);
        }
    }
}

/// What the colours of nodes with springs say, in a line: a square and a word each.
pub(crate) struct NodeKey {
    pub(crate) lettering: Lettering,
}

impl NodeKey {
    const ENTRIES: [(&'static str, Rgb); 2] = [("held", HELD), ("free", CONTROLS)];

    /// Its height in pixels.
    pub(crate) fn height(lettering: &Lettering) -> f32 {
        1.4 * lettering.height
    }

    /// Draws it, its upper edge's middle at `middle`, `top`.
    pub(crate) fn draw(&self, image: &mut Image, [middle, top]: [f32; 2]) {
        let line = self.lettering.height;
        let (side, gap) = (0.6 * line, 1.2 * line);
        let widths = Self::ENTRIES.map(|(word, _)| 1.5 * side + self.lettering.width(word));
        let mut left = middle - (widths[0] + gap + widths[1]) / 2.0;
        for ((word, color), width) in Self::ENTRIES.into_iter().zip(widths) {
            let corner = [left, top + (line - side) / 2.0].map(|x| x.round() as isize);
            image.fill(corner, corner.map(|x| x + side.round() as isize), color);
            self.lettering.write(image, word, [left + 1.5 * side, top]);
            left += width + gap;
        }
    }
}

/// Which of some ranges in a row may be shown so that all are `gap` apart: the middle one, and from there outwards what
/// does not touch.
fn apart(ranges: &[[f32; 2]], gap: f32) -> Vec<bool> {
    let mut shown = vec![false; ranges.len()];
    let middle = ranges.len() / 2;
    let Some(&[mut low, mut high]) = ranges.get(middle) else { return shown };
    shown[middle] = true;
    for i in middle + 1..ranges.len() {
        if ranges[i][0] >= high + gap {
            shown[i] = true;
            high = ranges[i][1];
        }
    }
    for i in (0..middle).rev() {
        if ranges[i][1] <= low - gap {
            shown[i] = true;
            low = ranges[i][0];
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_keep_apart() {
        let ranges = [[0.0, 10.0], [8.0, 18.0], [20.0, 30.0], [31.0, 41.0], [42.0, 52.0]];
        assert_eq!(apart(&ranges, 3.0), [true, false, true, false, true]);
        assert_eq!(apart(&ranges, 0.5), [false, true, true, true, true]);
        assert_eq!(apart(&[], 1.0), [false; 0]);
    }
}
