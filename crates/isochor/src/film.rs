//! Films: a job whose numbers change from frame to frame, as TOML or JSON text.
//!
//! ```toml
//! frames = 36
//! [[edit]]
//! twist = { axis = "z", degrees = { keys = [[0, 0], [0.5, 180], [1, 0]], ease = "smooth" } }
//! [preserve]
//! volume = { keys = [[0, "100%"], [1, "120%"]] }
//! ```
//!
//! In `[[edit]]`, `[preserve]`, `[surface]`, `[elastic]` and `[cage]` a table with `keys` stands for a value that is a function of time: a number, a
//! percentage, or a list of these of any depth. Between keys (t, a) and (u, b), at a time s,
//!
//!   (1 − w) a + w b,   w = (s − t)/(u − t) (linear),   w² (3 − 2w) of it (smooth),   0 (step),
//!
//! entry by entry; before the first and after the last key, their values. A value at a key, or between equal ones, is the one that is
//! written there, digit by digit, so whole numbers stay whole.
//!
//! Frame f of n has the time f/(n − 1), so that the first and the last key are shown; in a `loop` it has f/n, so that a film that
//! begins as it ends does not show this twice.
//!
//! Keys are replaced in the parsed text, before it becomes a [`Job`]: whatever a job can hold can be keyed, and errors keep their places.

use std::ops::{Range, RangeInclusive};

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

use crate::job::Job;
use crate::job_text::JobTextError;

/// A job for every frame. A text without `frames` is a film of one frame, at time 0, and has no keys.
#[derive(Clone, Debug)]
pub struct Film {
    text: Text,
    frames: usize,
    /// Where `frames` stands: line and column.
    frames_place: [Option<usize>; 2],
    is_loop: bool,
    /// In the order in which [`replace_keys`] comes to them.
    keyed: Vec<Keyed>,
}

/// What frames are read from.
#[derive(Clone, Debug)]
enum Text {
    /// As it was given.
    Toml(String),
    /// A single job as it was given.
    Json(String),
    /// The TOML that says the same as a film in JSON: places in it mean nothing to its author.
    FromJson(String),
}

/// How many frames a film has. More would be minutes of pictures: a slip of the finger.
const FRAMES: RangeInclusive<i64> = 2..=10_000;

impl Film {
    /// Reads a film or a single job from TOML.
    ///
    /// # Errors
    ///
    /// Text that is not TOML, bad `frames`, `loop` and keys, keys without `frames`. What is no job otherwise shows in [`Film::job`].
    pub fn from_toml(text: &str) -> Result<Self, JobTextError> {
        Self::new(Text::Toml(text.into()), text)
    }

    /// Reads a film or a single job from JSON.
    ///
    /// # Errors
    ///
    /// As [`Film::from_toml`]. Errors in films have no line, but name the key.
    pub fn from_json(text: &str) -> Result<Self, JobTextError> {
        let mut value: serde_json::Value = serde_json::from_str(text).map_err(|e| JobTextError::of_json(&e))?;
        let is_film = ["frames", "loop"].iter().any(|key| value.get(key).is_some());
        drop_nulls(&mut value);
        match toml::to_string(&value) {
            Ok(toml) if is_film => Self::new(Text::FromJson(toml.clone()), &toml),
            Ok(toml) => Self::new(Text::Json(text.into()), &toml),
            Err(error) if is_film => Err(JobTextError::new(&error.to_string(), None, None)),
            // No table, or a number beyond those of TOML: there is nothing to replace, and the job says what is wrong.
            Err(_) => Self::new(Text::Json(text.into()), ""),
        }
    }

    fn new(text: Text, toml: &str) -> Result<Self, JobTextError> {
        let table = DeTable::parse(toml).map_err(|error| JobTextError::of_toml(toml, &error))?;
        let mut reader = Reader { text: matches!(text, Text::Toml(_)).then_some(toml), keyed: Vec::new() };
        let table = table.get_ref();
        let (mut frames, mut frames_place) = (1, [None; 2]);
        if let Some((key, value)) = table.get_key_value("frames") {
            frames_place = reader.place(key.span());
            let number = integer(value.get_ref()).filter(|n| FRAMES.contains(n));
            frames = number.and_then(|n| usize::try_from(n).ok()).ok_or_else(|| {
                let what = format!(
                    "frames must be a whole number from {} to {}; leave it out for a single model",
                    FRAMES.start(),
                    FRAMES.end()
                );
                reader.error(&what, value.span())
            })?;
        }
        let is_loop = match table.get_key_value("loop") {
            None => false,
            Some((key, _)) if frames == 1 => {
                return Err(reader.error("loop is for films: add frames = 36, or leave it out", key.span()));
            }
            Some((_, value)) => {
                let is_loop = value.get_ref().as_bool();
                is_loop.ok_or_else(|| reader.error("loop must be true or false", value.span()))?
            }
        };
        for (key, value) in table {
            let key = key.get_ref();
            reader.find_keys(
                value,
                key,
                matches!(key.as_ref(), "edit" | "preserve" | "surface" | "elastic" | "cage"),
            )?;
        }
        let Reader { keyed, .. } = &reader;
        if let (1, Some(Keyed { path, span, .. })) = (frames, keyed.first()) {
            let what =
                format!("{path} has keys, but the job has no frames: add frames = 36 at the top, or give one value");
            return Err(reader.error(&what, span.clone()));
        }
        Ok(Self { text, frames, frames_place, is_loop, keyed: reader.keyed })
    }

    /// How many frames it has: 1 for a text without `frames`, else 2 to 10,000.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// When `frame` is, from 0 to 1.
    #[must_use]
    pub fn time(&self, frame: usize) -> f64 {
        match (self.frames, self.is_loop) {
            (1, _) => 0.0,
            (frames, true) => frame as f64 / frames as f64,
            (frames, false) => frame as f64 / (frames - 1) as f64,
        }
    }

    /// The job of `frame`.
    ///
    /// # Errors
    ///
    /// Unknown keys (named with the nearest known one), values of the wrong kind; those of keys are named by their path.
    ///
    /// # Panics
    ///
    /// Panics where there is no such frame.
    pub fn job(&self, frame: usize) -> Result<Job, JobTextError> {
        assert!(frame < self.frames, "a film of {} frames has no frame {frame}", self.frames);
        let text = match &self.text {
            Text::Toml(text) if self.frames == 1 => return toml_job(text),
            Text::Json(text) => return serde_json::from_str(text).map_err(|error| JobTextError::of_json(&error)),
            Text::Toml(text) | Text::FromJson(text) => text,
        };
        let time = self.time(frame);
        let values: Vec<String> = self.keyed.iter().map(|keyed| keyed.at(time)).collect();
        let table = DeTable::parse(text).map_err(|error| JobTextError::of_toml(text, &error))?;
        let (span, mut table) = (table.span(), table.into_inner());
        table.remove("frames");
        table.remove("loop");
        let mut replacements = self.keyed.iter().zip(&values);
        for (_, value) in table.iter_mut() {
            replace_keys(value, &mut replacements);
        }
        Job::deserialize(Deserializer::from(Spanned::new(span, table))).map_err(|error| {
            let is_in = |keyed: &&Keyed| {
                let Range { start, end } = keyed.span;
                error.span().is_some_and(|span| start <= span.start && span.end <= end)
            };
            let mut found = JobTextError::of_toml(text, &error);
            if let Some(Keyed { path, .. }) = self.keyed.iter().find(is_in) {
                found.what = format!("{path} at time {time}: {}", found.what);
            }
            if matches!(self.text, Text::FromJson(_)) {
                (found.line, found.column) = (None, None);
            }
            found
        })
    }

    /// The job of a text without `frames`.
    ///
    /// # Errors
    ///
    /// As [`Film::job`]; a text with `frames`.
    pub(crate) fn single(&self) -> Result<Job, JobTextError> {
        let [line, column] = self.frames_place;
        match self.frames {
            1 => self.job(0),
            frames => {
                let what =
                    format!("this is a film of {frames} frames, not one job: read it as a film, or leave frames out");
                Err(JobTextError::new(&what, line, column))
            }
        }
    }
}

fn toml_job(text: &str) -> Result<Job, JobTextError> {
    toml::from_str(text).map_err(|error| JobTextError::of_toml(text, &error))
}

/// TOML has no null; in a job it means what a missing key means.
fn drop_nulls(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Object(entries) => {
            entries.retain(|_, value| !value.is_null());
            entries.values_mut().for_each(drop_nulls);
        }
        serde_json::Value::Array(entries) => entries.iter_mut().for_each(drop_nulls),
        _ => {}
    }
}

fn integer(value: &DeValue) -> Option<i64> {
    let number = value.as_integer()?;
    i64::from_str_radix(number.as_str(), number.radix()).ok()
}

/// Puts the values of one time where keys were.
fn replace_keys<'a>(value: &mut Spanned<DeValue<'a>>, values: &mut impl Iterator<Item = (&'a Keyed, &'a String)>) {
    match value.get_mut() {
        DeValue::Table(table) if table.contains_key("keys") => {
            let (keyed, text) = values.next().expect("as many values as tables with keys");
            let mut parsed = DeValue::parse(text).expect("values are written as TOML has them").into_inner();
            place_at(&mut parsed, &keyed.span);
            *value = Spanned::new(keyed.span.clone(), parsed);
        }
        DeValue::Table(table) => table.iter_mut().for_each(|(_, value)| replace_keys(value, values)),
        DeValue::Array(list) => list.iter_mut().for_each(|value| replace_keys(value, values)),
        _ => {}
    }
}

/// Says of all entries of a list that they stand at `span`.
fn place_at(value: &mut DeValue, span: &Range<usize>) {
    if let DeValue::Array(list) = value {
        for entry in list.iter_mut() {
            place_at(entry.get_mut(), span);
            let inner = std::mem::replace(entry.get_mut(), DeValue::Boolean(false));
            *entry = Spanned::new(span.clone(), inner);
        }
    }
}

/// Finds keys and what is wrong with them.
struct Reader<'a> {
    /// The text of its author, if it is the one that is read.
    text: Option<&'a str>,
    keyed: Vec<Keyed>,
}

impl Reader<'_> {
    fn place(&self, span: Range<usize>) -> [Option<usize>; 2] {
        self.text.map_or([None; 2], |text| JobTextError::place(text, span.start).map(Some))
    }

    fn error(&self, what: &str, span: Range<usize>) -> JobTextError {
        let [line, column] = self.place(span);
        JobTextError::new(what, line, column)
    }

    /// Reads all keys in `value`, which stands at `path`; they are errors where there may be none.
    fn find_keys(&mut self, value: &Spanned<DeValue>, path: &str, may_have_keys: bool) -> Result<(), JobTextError> {
        match value.get_ref() {
            DeValue::Table(table) if table.contains_key("keys") => {
                if !may_have_keys {
                    let what = format!(
                        "{path} cannot change with time: keys are for values in [[edit]], [preserve], [surface], [elastic] and [cage]"
                    );
                    return Err(self.error(&what, value.span()));
                }
                let keyed = self.keyed(table, path, value.span())?;
                self.keyed.push(keyed);
                Ok(())
            }
            DeValue::Table(table) => table.iter().try_for_each(|(key, value)| {
                self.find_keys(value, &format!("{path}.{}", key.get_ref()), may_have_keys)
            }),
            DeValue::Array(list) => list
                .iter()
                .enumerate()
                .try_for_each(|(i, value)| self.find_keys(value, &format!("{path}[{i}]"), may_have_keys)),
            _ => Ok(()),
        }
    }

    fn keyed(&self, table: &DeTable, path: &str, span: Range<usize>) -> Result<Keyed, JobTextError> {
        let mut ease = Ease::Linear;
        for (key, value) in table {
            match key.get_ref().as_ref() {
                "keys" => {}
                "ease" => {
                    let word = value.get_ref().as_str().unwrap_or_default();
                    ease = match word {
                        "linear" => Ease::Linear,
                        "smooth" => Ease::Smooth,
                        "step" => Ease::Step,
                        _ => {
                            let what =
                                format!("{path}: unknown ease `{word}`, expected one of `linear`, `smooth`, `step`");
                            return Err(self.error(&what, value.span()));
                        }
                    };
                }
                other => {
                    let what = format!("{path}: unknown field `{other}`, expected `keys` or `ease`");
                    return Err(self.error(&what, key.span()));
                }
            }
        }
        let all = &table["keys"];
        let list = all.get_ref().as_array().filter(|list| list.len() >= 2);
        let list = list.ok_or_else(|| {
            let what =
                format!("{path}: keys must be a list of two keys [time, value] or more, such as [[0, 0], [1, 90]]");
            self.error(&what, all.span())
        })?;
        let mut keys: Vec<(f64, Value)> = Vec::with_capacity(list.len());
        for (i, entry) in list.iter().enumerate() {
            let failed = |what: &str| self.error(&format!("{path}: keys[{i}] {what}"), entry.span());
            let key = entry.get_ref().as_array().filter(|key| key.len() == 2);
            let key = key.ok_or_else(|| failed("must be a list [time, value]"))?;
            let time = Value::of(key[0].get_ref());
            let Some(Value::Number { value: time, .. }) = time.filter(|time| time.is_time()) else {
                return Err(failed("must begin with a time from 0 (the first frame) to 1 (the last)"));
            };
            let value = Value::of(key[1].get_ref());
            let value = value.ok_or_else(|| {
                failed("must end with a finite number, a percentage such as \"120%\", or a list of these")
            })?;
            if let Some((before, first)) = keys.last() {
                if time <= *before {
                    return Err(failed(&format!(
                        "is at time {time}, not after {before} of the key before: order them by time"
                    )));
                }
                if !value.is_like(first) {
                    return Err(failed(
                        "is of another kind than the key before: all values must be numbers, all percentages, or lists of one length",
                    ));
                }
            }
            keys.push((time, value));
        }
        Ok(Keyed { path: path.into(), span, keys, ease })
    }
}

/// A value as a function of time.
#[derive(Clone, Debug)]
struct Keyed {
    /// Where it stands in the job, such as `edit[0].twist.degrees`.
    path: String,
    /// Where it stands in the text.
    span: Range<usize>,
    /// Times, ascending, and values of one kind; two or more.
    keys: Vec<(f64, Value)>,
    ease: Ease,
}

/// What happens between keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ease {
    Linear,
    Smooth,
    Step,
}

impl Keyed {
    /// The value at `time`, as TOML.
    fn at(&self, time: f64) -> String {
        let next = self.keys.iter().position(|(key, _)| *key > time).unwrap_or(self.keys.len());
        let (start, value) = &self.keys[next.saturating_sub(1)];
        let Some((end, after)) = self.keys.get(next).filter(|_| next > 0) else { return value.text() };
        let w = (time - start) / (end - start);
        match self.ease {
            Ease::Step => value.text(),
            Ease::Linear => value.between(after, w),
            Ease::Smooth => value.between(after, w * w * (3.0 - 2.0 * w)),
        }
    }
}

/// The value of a key.
#[derive(Clone, Debug)]
enum Value {
    /// Finite, and as it was written.
    Number {
        value: f64,
        text: String,
    },
    /// The same before a per cent sign.
    Percent {
        value: f64,
        text: String,
    },
    List(Vec<Value>),
}

impl Value {
    fn of(value: &DeValue) -> Option<Self> {
        let finite = |value: f64| Some(value).filter(|value| value.is_finite());
        match value {
            DeValue::Integer(number) => {
                let value = i64::from_str_radix(number.as_str(), number.radix()).ok()?;
                Some(Self::Number { value: value as f64, text: value.to_string() })
            }
            DeValue::Float(number) => {
                Some(Self::Number { value: finite(number.as_str().parse().ok()?)?, text: number.as_str().into() })
            }
            DeValue::String(text) => {
                let number = text.trim().strip_suffix('%')?.trim();
                Some(Self::Percent { value: finite(number.parse().ok()?)?, text: number.into() })
            }
            DeValue::Array(list) => {
                list.iter().map(|entry| Self::of(entry.get_ref())).collect::<Option<_>>().map(Self::List)
            }
            DeValue::Boolean(_) | DeValue::Datetime(_) | DeValue::Table(_) => None,
        }
    }

    fn is_time(&self) -> bool {
        matches!(self, Self::Number { value, .. } if (0.0..=1.0).contains(value))
    }

    /// Whether there is something between both.
    fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Number { .. }, Self::Number { .. }) | (Self::Percent { .. }, Self::Percent { .. }) => true,
            (Self::List(a), Self::List(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.is_like(b)),
            _ => false,
        }
    }

    /// It as TOML.
    fn text(&self) -> String {
        self.between(self, 0.0)
    }

    /// `(1 − w)` of it and w of `other`, which is like it, as TOML; itself as it was written where both are equal or w is 0.
    fn between(&self, other: &Self, w: f64) -> String {
        let mixed = |a: f64, text: &str, b: f64| match w {
            _ if a == b => text.to_owned(),
            0.0 => text.to_owned(),
            _ => format!("{:?}", (1.0 - w) * a + w * b),
        };
        match (self, other) {
            (Self::Number { value: a, text }, Self::Number { value: b, .. }) => mixed(*a, text, *b),
            (Self::Percent { value: a, text }, Self::Percent { value: b, .. }) => {
                format!("\"{}%\"", mixed(*a, text, *b))
            }
            (Self::List(a), Self::List(b)) => {
                let entries: Vec<String> = a.iter().zip(b).map(|(a, b)| a.between(b, w)).collect();
                format!("[{}]", entries.join(", "))
            }
            _ => unreachable!("values of one key are alike"),
        }
    }
}
