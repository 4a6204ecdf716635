//! What a refined mesh adds to an OBJ text.
//!
//! Indices of OBJ are places in the text: new lines stand behind the last old one of their kind, so that no index from 1 on means anything
//! else, and behind every statement that counts back and stays, so that it still counts to the same line. Faces that were split are written
//! with indices from 1 on; they may name lines that stand behind them.

use std::collections::HashMap;
use std::io::Write;
use std::ops::Range;

use glam::DVec3;

use crate::document::Change;
use crate::mix::Mix;
use crate::normal::mixed_direction;
use crate::number::{finite, integer, push_shortest};
use crate::obj::{Layout, NO_NORMAL, resolved, words};
use crate::refined::Refined;
use crate::splice::Splice;
use crate::words::{Words, line_break};
use crate::{NumberType, WriteError};

/// What a corner names, in the order in which it does so.
const KINDS: [(&str, &str); 3] = [("v", "vertex"), ("vt", "texture coordinate"), ("vn", "normal")];
const VERTEX: usize = 0;
const TEXTURE: usize = 1;
const NORMAL: usize = 2;

/// Marks a corner without a texture coordinate or normal.
const NONE: u32 = NO_NORMAL;

/// Numbers behind the position of a vertex that are mixed: a weight, a colour, and one more.
const MOST_NUMBERS: usize = 4;

/// The numbers of a line, and how many.
type Numbers = ([f64; MOST_NUMBERS], usize);

/// Lines and faces that are added to a text.
pub(crate) struct Additions<'a> {
    bytes: &'a [u8],
    refined: &'a Refined<'a>,
    /// Where lines of each kind are added: at the end of a line, before its line break.
    places: [usize; 3],
    /// The lines of each kind, each with a line break before it.
    lines: [Vec<u8>; 3],
    /// The corners of the pieces of all faces that were split, as text, piece after piece.
    text: Vec<u8>,
    /// Where the text of each piece begins, and one behind the last (#pieces + 1).
    starts: Vec<usize>,
    /// Which kinds of added lines each piece names.
    names: Vec<[bool; 3]>,
    /// Face of the mesh, and piece, that come next in the text.
    next: (usize, usize),
    /// Number of split faces that name lines behind them.
    early: usize,
    warnings: Vec<String>,
}

impl<'a> Additions<'a> {
    pub(crate) fn new(
        layout: &'a Layout,
        bytes: &'a [u8],
        change: &'a Change<'a>,
        refined: &'a Refined<'a>,
    ) -> Result<Self, WriteError> {
        let survey = Survey::of(layout, bytes, change, refined);
        let mut mixer = Mixer::new(layout, change, &survey);
        for (vertex, mix) in (refined.old_vertices()..).zip(refined.added()) {
            mixer.add_vertex(change.stored[vertex], &mix);
        }
        let (mut text, mut starts, mut names) = (Vec::new(), vec![0], Vec::new());
        let mut first_corner = 0;
        for (f, face) in change.mesh.faces().iter().enumerate() {
            if !refined.keeps(f) {
                for piece in refined.pieces(f) {
                    let mut named = [false; 3];
                    for (vertex, mix) in piece.corners() {
                        let corner = mixer.corner(vertex, mix, first_corner);
                        for kind in 0..3 {
                            named[kind] |= corner[kind].is_some_and(|k| k >= survey.counts[kind] as u64);
                        }
                        push_corner(&mut text, corner);
                    }
                    starts.push(text.len());
                    names.push(named);
                }
            }
            first_corner += face.len();
        }
        survey.check(mixer.added)?;
        let warnings = mixer.warnings();
        let (places, lines) = (survey.places, mixer.lines);
        Ok(Self { bytes, refined, places, lines, text, starts, names, next: (0, 0), early: 0, warnings })
    }

    /// Writes what was made of the face whose statement starts with `keyword`; `words` stands behind that.
    pub(crate) fn replace_face(&mut self, splice: &mut Splice, keyword: Range<usize>, words: &mut Words) {
        let (mut end, mut corners) = (keyword.end, 0);
        while let Some(word) = words.next_in_line() {
            (end, corners) = (word.end, corners + 1);
        }
        if corners < 3 {
            return;
        }
        let (face, first) = self.next;
        self.next.0 += 1;
        if self.refined.keeps(face) {
            return;
        }
        let all = first..first + self.refined.pieces(face).len();
        self.next.1 = all.end;
        let is_early = |kind| self.names[all.clone()].iter().any(|named| named[kind]) && end < self.places[kind];
        self.early += usize::from((0..3).any(is_early));
        // The keyword stays before the first piece, and comes again before each other one.
        let mut at = if all.is_empty() { keyword.start } else { keyword.end };
        for piece in all.clone() {
            if piece > first {
                splice.replace(at..end, line_break(self.bytes));
                splice.replace(end..end, &self.bytes[keyword.clone()]);
                at = end;
            }
            splice.replace(at..end, &self.text[self.starts[piece]..self.starts[piece + 1]]);
            at = end;
        }
        splice.replace(at..end, &[]);
    }

    /// Adds the lines that belong to the end of the line at `at`.
    pub(crate) fn add_lines(&self, splice: &mut Splice, at: usize) {
        for (place, lines) in self.places.iter().zip(&self.lines) {
            if *place != at || lines.is_empty() {
                continue;
            }
            // A backslash at the end of the text would join the next line.
            if self.bytes.get(at).is_none() && self.bytes.ends_with(b"\\") {
                splice.replace(at..at, line_break(self.bytes));
            }
            splice.replace(at..at, lines);
        }
    }

    pub(crate) fn warnings(self) -> Vec<String> {
        let early = (self.early > 0).then(|| {
            let n = self.early;
            format!("Split faces that name added lines behind them, which some programs cannot read: {n}.")
        });
        self.warnings.into_iter().chain(early).collect()
    }
}

/// Appends a corner `i`, `i/j`, `i//k` or `i/j/k`, of indices from 0.
fn push_corner(text: &mut Vec<u8>, [vertex, texture, normal]: [Option<u64>; 3]) {
    let fields = match (texture, normal) {
        (None, None) => &[vertex][..],
        (_, None) => &[vertex, texture],
        _ => &[vertex, texture, normal],
    };
    for (index, before) in fields.iter().zip([b' ', b'/', b'/']) {
        text.push(before);
        if let Some(k) = index {
            // Writing to a vector cannot fail.
            let _ = write!(text, "{}", k + 1);
        }
    }
}

/// Where things stand that additions need.
struct Survey<'a> {
    bytes: &'a [u8],
    /// Number of lines of each kind in the whole file.
    counts: [usize; 3],
    /// Where the numbers of each line of a kind begin.
    lines: [Vec<usize>; 3],
    /// Texture coordinate at each corner of the mesh.
    textures: Vec<u32>,
    places: [usize; 3],
    /// The lowest index of each kind beyond all lines that a statement names that stays, from 1, and its line.
    stray: [Option<(u64, usize)>; 3],
}

impl<'a> Survey<'a> {
    fn of(layout: &Layout, bytes: &'a [u8], change: &Change, refined: &Refined) -> Self {
        let counts = [refined.old_vertices(), layout.textures, layout.normals];
        let textures = Vec::with_capacity(change.mesh.faces().corners().len());
        let (places, stray) = ([0; 3], [None; 3]);
        let mut survey = Self { bytes, counts, lines: Default::default(), textures, places, stray };
        let mut words = words(bytes);
        let (mut face, mut corners) = (0, Vec::new());
        while !words.is_done() {
            let keyword = words.next_in_line().map(|word| &bytes[word]).unwrap_or_default();
            let mut counts_back = [false; 3];
            if let Some(kind) = KINDS.iter().position(|kind| kind.0.as_bytes() == keyword) {
                survey.lines[kind].push(words.at());
                survey.places[kind] = words.line_end();
            } else if matches!(keyword, b"f" | b"fo" | b"l" | b"p") {
                corners.clear();
                let line = words.line();
                corners.extend(std::iter::from_fn(|| words.next_in_line()));
                let is_face = keyword.starts_with(b"f") && corners.len() >= 3;
                if is_face {
                    let before = survey.lines[TEXTURE].len();
                    survey.textures.extend(corners.iter().map(|word| texture(&bytes[word.clone()], before, layout)));
                }
                if !is_face || refined.keeps(face) {
                    corners.iter().for_each(|word| survey.name(word.clone(), line, &mut counts_back));
                }
                face += usize::from(is_face);
            } else if matches!(keyword, b"curv" | b"surf") {
                // Parameters and indices are mixed; to stand behind a line that does not count back does no harm.
                counts_back = [std::iter::from_fn(|| words.next_in_line()).any(|word| bytes[word].contains(&b'-')); 3];
            }
            let end = words.line_end();
            for (place, _) in survey.places.iter_mut().zip(counts_back).filter(|(_, back)| *back) {
                *place = end;
            }
            words.end_line();
        }
        survey
    }

    /// Notes what the corner at `word` names that does not exist, and which kinds it counts back.
    fn name(&mut self, word: Range<usize>, line: usize, counts_back: &mut [bool; 3]) {
        let fields = self.bytes[word].split(|b| *b == b'/').take(3);
        for (kind, index) in fields.enumerate().filter_map(|(kind, field)| Some((kind, integer(field)?))) {
            counts_back[kind] |= index < 0;
            let is_lower = self.stray[kind].is_none_or(|(lowest, _)| (index as u64) < lowest);
            if index > 0 && index as u64 > self.counts[kind] as u64 && is_lower {
                self.stray[kind] = Some((index as u64, line));
            }
        }
    }

    /// Refuses added lines that something already names.
    fn check(&self, added: [usize; 3]) -> Result<(), WriteError> {
        for kind in 0..3 {
            let (count, thing) = (self.counts[kind], KINDS[kind].1);
            match self.stray[kind] {
                Some((index, line)) if index <= (count + added[kind]) as u64 => {
                    return Err(WriteError::StrayIndex { line, thing, index, count });
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// The numbers of line `k` of a kind, without the first `skipped`, at most so many. `None` where one is no finite number.
    fn numbers(&self, kind: usize, k: u32, skipped: usize, most: usize) -> Option<Numbers> {
        let mut words = Words::obj(self.bytes);
        words.skip(self.lines[kind][k as usize]);
        let mut numbers = ([0.0; MOST_NUMBERS], 0);
        for word in std::iter::from_fn(|| words.next_in_line()).skip(skipped).take(most) {
            numbers.0[numbers.1] = finite(&self.bytes[word]).ok()?;
            numbers.1 += 1;
        }
        Some(numbers)
    }
}

/// Index from 0 of the texture coordinate of a corner, where so many stand before it.
fn texture(word: &[u8], before: usize, layout: &Layout) -> u32 {
    let index = word.split(|b| *b == b'/').nth(TEXTURE).and_then(integer);
    let index = index.and_then(|index| resolved(index, before)).filter(|k| *k < layout.textures as u64);
    index.and_then(|k| u32::try_from(k).ok()).unwrap_or(NONE)
}

/// Makes added lines.
struct Mixer<'a> {
    layout: &'a Layout,
    change: &'a Change<'a>,
    survey: &'a Survey<'a>,
    lines: [Vec<u8>; 3],
    /// Number of lines.
    added: [usize; 3],
    /// Added texture coordinates and normals by their count and bits.
    known: [HashMap<(usize, [u64; 3]), u64>; 3],
    /// Number of vertices without the numbers that some of their old ones have.
    colourless: usize,
    /// Number of corners without what some of their old ones have, by kind.
    bare: [usize; 3],
    /// Number of corners that got what the heaviest of their old ones has, because it cannot be mixed, by kind.
    unmixed: [usize; 3],
}

impl<'a> Mixer<'a> {
    fn new(layout: &'a Layout, change: &'a Change<'a>, survey: &'a Survey<'a>) -> Self {
        Self {
            layout,
            change,
            survey,
            lines: Default::default(),
            added: [0; 3],
            known: Default::default(),
            colourless: 0,
            bare: [0; 3],
            unmixed: [0; 3],
        }
    }

    fn add_line(&mut self, kind: usize, numbers: impl IntoIterator<Item = f64>) -> u64 {
        let line = &mut self.lines[kind];
        line.extend_from_slice(line_break(self.survey.bytes));
        line.extend_from_slice(KINDS[kind].0.as_bytes());
        for x in numbers {
            line.push(b' ');
            push_shortest(line, x, NumberType::F64);
        }
        self.added[kind] += 1;
        (self.survey.counts[kind] + self.added[kind] - 1) as u64
    }

    /// As [`Mixer::add_line`], but bit-equal numbers share one line.
    fn shared_line(&mut self, kind: usize, numbers: &[f64]) -> u64 {
        let mut bits = [0; 3];
        bits.iter_mut().zip(numbers).for_each(|(bits, x)| *bits = x.to_bits());
        let key = (numbers.len(), bits);
        if let Some(&line) = self.known[kind].get(&key) {
            return line;
        }
        let line = self.add_line(kind, numbers.iter().copied());
        self.known[kind].insert(key, line);
        line
    }

    fn add_vertex(&mut self, point: DVec3, mix: &Mix) {
        let (tail, len) = self.mixed_tail(mix);
        self.add_line(VERTEX, point.to_array().into_iter().chain(tail.into_iter().take(len)));
    }

    /// What stands behind the position: a weight, a colour, or nothing.
    fn mixed_tail(&mut self, mix: &Mix) -> Numbers {
        let tails = mix.parts().iter().map(|&(v, _)| self.survey.numbers(VERTEX, v, 3, MOST_NUMBERS));
        let tails: Vec<_> = tails.collect();
        match mixed(mix, &tails, |lens| lens.iter().all(|len| *len == lens[0])) {
            Some(tail) => tail,
            None => {
                self.colourless += 1;
                Numbers::default()
            }
        }
    }

    /// Indices from 0 of what a corner names at `vertex`, mixed of corners of an old face whose first is `first` of the mesh.
    fn corner(&mut self, vertex: u32, mix: Mix, first: usize) -> [Option<u64>; 3] {
        let of_old = |all: &[u32]| mix.relabelled(|k| all.get(first + k as usize).copied().unwrap_or(NONE));
        let texture = self.texture(&of_old(&self.survey.textures));
        let normal = self.normal(vertex, &mix, &of_old(&self.layout.corner_normals));
        [Some(u64::from(vertex)), texture, normal]
    }

    /// The only one of `mix`: none, or one. `None` where a line must be mixed.
    fn settled(&mut self, kind: usize, mix: &Mix) -> Option<Option<u64>> {
        if let Some(only) = mix.only() {
            return Some((only != NONE).then_some(u64::from(only)));
        }
        if mix.parts().iter().any(|part| part.0 == NONE) {
            self.bare[kind] += 1;
            return Some(None);
        }
        None
    }

    fn texture(&mut self, mix: &Mix) -> Option<u64> {
        if let Some(settled) = self.settled(TEXTURE, mix) {
            return settled;
        }
        let all = mix.parts().iter().map(|&(k, _)| self.survey.numbers(TEXTURE, k, 0, 3)).collect::<Vec<_>>();
        // What is left out is 0.
        Some(match mixed(mix, &all, |lens| lens.iter().all(|len| *len > 0)) {
            Some((numbers, len)) => self.shared_line(TEXTURE, &numbers[..len]),
            None => {
                self.unmixed[TEXTURE] += 1;
                u64::from(mix.heaviest())
            }
        })
    }

    /// The normal of a corner that is `corners` of an old face, which have the normals `mix`.
    fn normal(&mut self, vertex: u32, corners: &Mix, mix: &Mix) -> Option<u64> {
        let jacobian = self.change.jacobians.map(|jacobians| &jacobians[vertex as usize]);
        let is_carried_apart = jacobian.is_some() && corners.only().is_none();
        let is_there = mix.parts().iter().all(|part| part.0 != NONE);
        let settled = if is_carried_apart && is_there { None } else { self.settled(NORMAL, mix) };
        if let Some(settled) = settled {
            return settled;
        }
        let all = mix.parts().iter().map(|&(k, _)| match self.survey.numbers(NORMAL, k, 0, 3) {
            Some((n, 3)) => Some(DVec3::new(n[0], n[1], n[2])),
            _ => None,
        });
        let all: Option<Vec<_>> = all.collect();
        let place = |k: u32| mix.parts().iter().position(|part| part.0 == k).unwrap_or_default();
        Some(match all.and_then(|all| mixed_direction(mix, |k| all[place(k)], jacobian)) {
            Some(normal) => self.shared_line(NORMAL, &normal.to_array()),
            None => {
                self.unmixed[NORMAL] += 1;
                u64::from(mix.heaviest())
            }
        })
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.colourless > 0 {
            let n = self.colourless;
            warnings.push(format!(
                "Added vertices without colours, because their old vertices differ in having them: {n}."
            ));
        }
        for kind in [TEXTURE, NORMAL] {
            let (thing, bare, unmixed) = (KINDS[kind].1, self.bare[kind], self.unmixed[kind]);
            if bare > 0 {
                warnings.push(format!("Added corners without a {thing}, because an old corner has none: {bare}."));
            }
            if unmixed > 0 {
                warnings.push(format!(
                    "Added corners with the {thing} of the nearest old corner, because it cannot be mixed: {unmixed}."
                ));
            }
        }
        warnings
    }
}

/// Numbers of the parts of a mix, mixed, as many as the most of one part. `None` where some are not known, or `fit` says that their counts
/// do not fit.
fn mixed(mix: &Mix, all: &[Option<Numbers>], fit: impl Fn(&[usize]) -> bool) -> Option<Numbers> {
    let all: Vec<Numbers> = all.iter().copied().collect::<Option<_>>()?;
    let lens: Vec<usize> = all.iter().map(|numbers| numbers.1).collect();
    if !fit(&lens) {
        return None;
    }
    let place = |k: u32| mix.parts().iter().position(|part| part.0 == k).unwrap_or_default();
    let mut numbers = ([0.0; MOST_NUMBERS], lens.iter().copied().max().unwrap_or_default());
    for n in 0..numbers.1 {
        numbers.0[n] = mix.value(|k| all[place(k)].0[n])?;
    }
    Some(numbers)
}
