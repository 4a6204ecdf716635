//! Lines and dots with soft borders, in front of a surface or, fainter, behind it.
//!
//! Each sample keeps the strongest of all strokes over it. So strokes may be drawn in any order, and where lines meet
//! they are no darker than one line.

use glam::DVec3;

use crate::raster::{Depths, SAMPLES, Screen, Spot};

/// A stroke this much behind the surface still counts as before it, in inverse distances relative to the surface's.
/// Larger: hidden lines show through edges; smaller: lines on a surface break up.
const ON_SURFACE: f64 = 2e-3;

/// A line, or a dot where both ends are the same.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stroke {
    ends: [Spot; 2],
    /// Half the width, in samples.
    radius: f64,
    strength: f32,
}

impl Stroke {
    /// A line between places seen from the eye, `width` pixels wide, of `strength` 0 to 1. `None` where it has no place
    /// on the screen.
    pub(crate) fn line(screen: &Screen, ends: [DVec3; 2], width: f64, strength: f32) -> Option<Self> {
        let ends = screen.segment(ends[0], ends[1])?;
        Some(Self { ends, radius: width / 2.0 * SAMPLES as f64, strength })
    }

    /// A dot.
    pub(crate) fn dot(screen: &Screen, at: DVec3, width: f64, strength: f32) -> Option<Self> {
        let spot = screen.spot(at)?;
        Some(Self { ends: [spot; 2], radius: width / 2.0 * SAMPLES as f64, strength })
    }
}

/// Draws the `strokes` of a band: strengths (0 to 1) of its samples, row after row. Behind the surface strokes have the
/// part `hidden` of their strength.
pub(crate) fn strengths(screen: &Screen, band: usize, strokes: &[Stroke], depths: &Depths, hidden: f32) -> Vec<f32> {
    let rows = screen.rows(band);
    let mut strengths = vec![0.0; rows.len() * screen.row()];
    for Stroke { ends: [a, b], radius, strength } in strokes {
        // Half a sample beyond the radius there is no ink.
        let reach = radius + 0.5;
        let range = |from: f64, to: f64, first: usize, end: usize| {
            let low = (from.min(to) - reach).floor().clamp(first as f64, end as f64);
            let high = (from.max(to) + reach).ceil().clamp(first as f64, end as f64);
            low as usize..high as usize
        };
        let along = [b.place[0] - a.place[0], b.place[1] - a.place[1]];
        let squared = along[0] * along[0] + along[1] * along[1];
        for y in range(a.place[1], b.place[1], rows.start, rows.end) {
            // The part of the line that is near this row.
            let down = y as f64 + 0.5 - a.place[1];
            let (mut from, mut to) = (0.0, 1.0);
            if along[1] != 0.0 {
                let [s, t] = [(down - reach) / along[1], (down + reach) / along[1]];
                (from, to) = (s.min(t).clamp(0.0, 1.0), s.max(t).clamp(0.0, 1.0));
            }
            let [left, right] = [a.place[0] + along[0] * from, a.place[0] + along[0] * to];
            for x in range(left, right, 0, screen.row()) {
                let across = x as f64 + 0.5 - a.place[0];
                let part =
                    if squared > 0.0 { ((across * along[0] + down * along[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
                let [dx, dy] = [across - along[0] * part, down - along[1] * part];
                let ink = (reach - (dx * dx + dy * dy).sqrt()).clamp(0.0, 1.0) as f32 * strength;
                if ink > 0.0 {
                    let sample = (y - rows.start) * screen.row() + x;
                    let inverse = a.inverse + (b.inverse - a.inverse) * part;
                    let is_before = inverse >= f64::from(depths.inverse[sample]) * (1.0 - ON_SURFACE);
                    let ink = if is_before { ink } else { ink * hidden };
                    strengths[sample] = ink.max(strengths[sample]);
                }
            }
        }
    }
    strengths
}
