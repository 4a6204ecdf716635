//! What a refined mesh adds to an OFF file: lines of vertices behind the old ones, faces in place of old ones.

use std::ops::Range;

use glam::DVec3;

use crate::document::Change;
use crate::mix::Mix;
use crate::normal::mixed_direction;
use crate::number::{finite, integer, push_shortest};
use crate::off::{Columns, Layout, normal_of, push_face};
use crate::refined::Refined;
use crate::splice::Splice;
use crate::words::line_break;
use crate::{NumberType, WriteError};

/// Numbers of a position.
const POSITION: usize = 3;

impl Layout {
    /// A copy of `bytes` with the change and other faces in it, and warnings.
    pub(crate) fn refined(
        &self,
        bytes: &[u8],
        change: &Change,
        refined: &Refined,
    ) -> Result<(Vec<u8>, Vec<String>), WriteError> {
        let mut splice = Splice::new(bytes);
        let faces = self.counts[1] - change.mesh.faces().len() as u64 + refined.faces() as u64;
        // Nobody reads the number of edges, but it shall not be a wrong one.
        let counts = [change.stored.len() as u64, faces, if refined.keeps_all() { self.counts[2] } else { 0 }];
        for ((word, old), new) in self.count_words.iter().zip(self.counts).zip(counts) {
            if new != old {
                splice.replace(word.clone(), new.to_string().as_bytes());
            }
        }
        let (mut rows, mut end) = (OldRows::new(bytes), 0);
        let mut warnings = self.patch_rows(bytes, change, &mut splice, |row, at| {
            rows.push(row, self.columns(row.len()).colour);
            end = at;
        });
        let mut mixer = Mixer { layout: self, rows: &rows, text: Vec::new(), unmixed: 0 };
        for (vertex, mix) in (refined.old_vertices()..).zip(refined.added()) {
            mixer.add_vertex(vertex, &mix, change);
        }
        splice.replace(end..end, &mixer.text);
        if mixer.unmixed > 0 {
            let n = mixer.unmixed;
            warnings.push(format!(
                "Added vertices with some numbers of their nearest old vertex, because they cannot be mixed: {n}."
            ));
        }
        self.replace_faces(bytes, refined, &mut splice)?;
        Ok((splice.finish(), warnings))
    }

    /// Puts new faces in place of those that were split; each has the colour of the old one.
    fn replace_faces(&self, bytes: &[u8], refined: &Refined, splice: &mut Splice) -> Result<(), WriteError> {
        let mut words = self.face_words(bytes);
        let (mut corners, mut text) = (Vec::new(), Vec::new());
        let mut face = 0;
        for _ in 0..self.faces_in_file() {
            let spans = self.next_face(bytes, &mut words, &mut corners)?;
            if corners.len() < 3 {
                continue;
            }
            face += 1;
            if refined.keeps(face - 1) {
                continue;
            }
            text.clear();
            for (k, piece) in refined.pieces(face - 1).enumerate() {
                if k > 0 {
                    text.extend_from_slice(line_break(bytes));
                }
                push_face(&mut text, piece.vertices);
                text.extend_from_slice(&bytes[spans.colour.clone()]);
            }
            splice.replace(spans.corners.start..spans.colour.end, &text);
        }
        Ok(())
    }
}

/// The words of all old vertices.
struct OldRows<'a> {
    bytes: &'a [u8],
    words: Vec<Range<usize>>,
    /// Where the words of each vertex begin, and one behind the last (#vertices + 1).
    starts: Vec<usize>,
    /// Whether all numbers of colours are whole, and some are above 1: from 0 to 255 then, not from 0 to 1.
    is_whole: bool,
    is_above_1: bool,
}

impl<'a> OldRows<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, words: Vec::new(), starts: vec![0], is_whole: true, is_above_1: false }
    }

    fn push(&mut self, row: &[Range<usize>], colour: Range<usize>) {
        for word in &row[colour] {
            let number = integer(&self.bytes[word.clone()]);
            self.is_whole &= number.is_some();
            self.is_above_1 |= number.is_some_and(|number| number > 1);
        }
        self.words.extend_from_slice(row);
        self.starts.push(self.words.len());
    }

    fn row(&self, vertex: u32) -> &[Range<usize>] {
        let vertex = vertex as usize;
        &self.words[self.starts[vertex]..self.starts[vertex + 1]]
    }

    /// The number that is word `k` of a vertex; not finite where it is none.
    fn number(&self, vertex: u32, k: usize) -> f64 {
        finite(&self.bytes[self.row(vertex)[k].clone()]).unwrap_or(f64::NAN)
    }
}

/// Makes lines of vertices.
struct Mixer<'a> {
    layout: &'a Layout,
    rows: &'a OldRows<'a>,
    /// The lines, each with a line break before it.
    text: Vec<u8>,
    /// Number of vertices with something that could not be mixed.
    unmixed: usize,
}

impl Mixer<'_> {
    fn add_vertex(&mut self, vertex: usize, mix: &Mix, change: &Change) {
        let rows = self.rows;
        let heaviest = rows.row(mix.heaviest());
        let Columns { normal: normal_at, colour, are_known } = self.layout.columns(heaviest.len());
        let are_alike = mix.parts().iter().all(|&(v, _)| rows.row(v).len() == heaviest.len());
        let jacobian = change.jacobians.map(|jacobians| &jacobians[vertex]);
        let is_one = mix.only().is_some();
        let normal = normal_at.filter(|_| !is_one || jacobian.is_some());
        let is_turned = normal.is_some();
        let normal = normal.and_then(|first| {
            let old = |v: u32| normal_of(rows.bytes, rows.row(v), first).unwrap_or(DVec3::NAN);
            mixed_direction(mix, old, jacobian)
        });
        let is_mixable = are_known && are_alike && !is_one;
        let mut is_done = (is_mixable || is_one) && (normal.is_some() || !is_turned);
        self.text.extend_from_slice(line_break(rows.bytes));
        for (k, word) in heaviest.iter().enumerate() {
            if k > 0 {
                self.text.push(b' ');
            }
            let normal_axis = normal_at.and_then(|first| k.checked_sub(first)).filter(|axis| *axis < 3);
            let number = match (k, normal_axis) {
                (0..POSITION, _) => Some(change.stored[vertex][k]),
                (_, Some(axis)) => normal.map(|normal| normal[axis]),
                _ if !is_mixable => None,
                _ => {
                    let mixed = mix.value(|v| rows.number(v, k));
                    is_done &= mixed.is_some();
                    let is_rounded = colour.contains(&k) && rows.is_whole && rows.is_above_1;
                    // Never −0.
                    mixed.map(|x| if is_rounded { x.round() + 0.0 } else { x })
                }
            };
            match number {
                Some(x) => push_shortest(&mut self.text, x, NumberType::F64),
                None => self.text.extend_from_slice(&rows.bytes[word.clone()]),
            }
        }
        self.unmixed += usize::from(!is_done);
    }
}
