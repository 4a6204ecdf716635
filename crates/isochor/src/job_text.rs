//! Jobs as TOML and JSON text.

use crate::film::Film;
use crate::job::Job;

/// Why a text is no job.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}{}", .nearest.as_ref().map(|n| format!(" (did you mean `{n}`?)")).unwrap_or_default())]
pub struct JobTextError {
    /// What is wrong, with the offending key or value.
    pub what: String,
    /// Line, from 1.
    pub line: Option<usize>,
    /// Column, from 1.
    pub column: Option<usize>,
    /// The known key that is most like an unknown one.
    pub nearest: Option<String>,
}

impl Job {
    /// Reads a job from TOML.
    ///
    /// # Errors
    ///
    /// Text that is not TOML, unknown keys (named with the nearest known one), values of the wrong kind. A text with `frames` is a
    /// [`Film`], and an error here.
    pub fn from_toml(text: &str) -> Result<Self, JobTextError> {
        Film::from_toml(text)?.single()
    }

    /// Reads a job from JSON.
    ///
    /// # Errors
    ///
    /// As [`Job::from_toml`].
    pub fn from_json(text: &str) -> Result<Self, JobTextError> {
        Film::from_json(text)?.single()
    }
}

impl JobTextError {
    pub(crate) fn new(what: &str, line: Option<usize>, column: Option<usize>) -> Self {
        Self { what: what.trim().into(), line, column, nearest: nearest(what) }
    }

    pub(crate) fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        let place = error.span().map(|span| Self::place(text, span.start));
        Self::new(error.message(), place.map(|[line, _]| line), place.map(|[_, column]| column))
    }

    pub(crate) fn of_json(error: &serde_json::Error) -> Self {
        let what = error.to_string();
        let what = what.split(" at line ").next().unwrap_or(&what);
        Self::new(what, Some(error.line()), Some(error.column()))
    }

    /// Line and column, from 1, of a byte of `text`.
    pub(crate) fn place(text: &str, byte: usize) -> [usize; 2] {
        let before = &text[..byte];
        [before.matches('\n').count() + 1, before.chars().rev().take_while(|c| *c != '\n').count() + 1]
    }
}

/// The known name most like the unknown one in a message such as "unknown field `a`, expected one of `b`, `c`".
fn nearest(message: &str) -> Option<String> {
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let (unknown, known) = names.split_first()?;
    let likeness = |name: &str| strsim::jaro_winkler(unknown, name);
    let best = known.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
    (message.contains("unknown") && likeness(best) > 0.7).then(|| (*best).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::{Amount, PartTarget, Preserve, VolumeTarget};

    fn volume(text: &str) -> Result<VolumeTarget, JobTextError> {
        Job::from_toml(&format!("[preserve]\nvolume = {text}")).map(|job| job.preserve.volume)
    }

    #[test]
    fn volumes_in_all_their_forms() {
        assert_eq!(volume("\"rest\""), Ok(VolumeTarget::Rest));
        assert_eq!(volume("\"free\""), Ok(VolumeTarget::Free));
        assert_eq!(volume("\"120%\""), Ok(VolumeTarget::Amount(Amount::Percent(120.0))));
        assert_eq!(volume("0.25"), Ok(VolumeTarget::Amount(Amount::Absolute(0.25))));
        assert_eq!(volume("2"), Ok(VolumeTarget::Amount(Amount::Absolute(2.0))));
        let range = VolumeTarget::Range { min: Some(Amount::Percent(95.0)), max: Some(Amount::Absolute(3.0)) };
        assert_eq!(volume("{ min = \"95%\", max = 3.0 }"), Ok(range.clone()));
        assert_eq!("95%..3".parse(), Ok(range));
        for bad in ["-1", "0", "\"-5%\"", "nan", "\"much\"", "{}", "{ least = 1 }", "[1]"] {
            assert!(volume(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn several_volumes_in_all_their_forms() {
        let percent = Amount::Percent;
        assert_eq!(volume("\"each\""), Ok(VolumeTarget::Each(percent(100.0))));
        assert_eq!(volume("{ each = \"110%\" }"), Ok(VolumeTarget::Each(percent(110.0))));
        assert_eq!("each=0.5".parse(), Ok(VolumeTarget::Each(Amount::Absolute(0.5))));
        let part = |components: &[usize], volume| PartTarget { components: components.to_vec(), volume };
        assert_eq!(
            volume("{ parts = [{ components = [0, 2], volume = \"110%\" }, { components = [0], volume = 2 }] }"),
            Ok(VolumeTarget::Parts(vec![part(&[0, 2], percent(110.0)), part(&[0], Amount::Absolute(2.0))]))
        );
        let hollow = |material, capacity| Ok(VolumeTarget::Hollow { material, capacity });
        let both = hollow(Some(percent(100.0)), Some(percent(110.0)));
        assert_eq!(volume("{ material = \"100%\", capacity = \"110%\" }"), both);
        assert_eq!(volume("\"material=100%,capacity=110%\""), both);
        assert_eq!(volume("\" capacity = 110% , material = 100% \""), both);
        assert_eq!(volume("{ material = 3 }"), hollow(Some(Amount::Absolute(3.0)), None));
        assert_eq!("capacity=3".parse().map_err(|_| ()), hollow(None, Some(Amount::Absolute(3.0))).map_err(|_| ()));
        let json = r#"{ "preserve": { "volume": { "parts": [{ "components": [1], "volume": 0.5 }] } } }"#;
        let parts = VolumeTarget::Parts(vec![part(&[1], Amount::Absolute(0.5))]);
        assert_eq!(Job::from_json(json).map(|job| job.preserve.volume), Ok(parts));
        let json = |volume: &str| Job::from_json(&format!("{{ \"preserve\": {{ \"volume\": {volume} }} }}"));
        assert_eq!(json("2").map(|job| job.preserve.volume), Ok(VolumeTarget::Amount(Amount::Absolute(2.0))));
        for (bad, fragment) in [
            ("{ each = 0 }", "more than 0"),
            ("{ each = \"much\" }", "more than 0"),
            ("{ each = 1, min = 2 }", "{ min, each }"),
            ("{ each = 1, capacity = 2 }", "one of these"),
            ("{ parts = 1 }", "expected a sequence"),
            ("{ parts = [{ components = [0] }] }", "missing field `volume`"),
            ("{ parts = [{ components = [-1], volume = 1 }] }", "-1"),
            ("{ parts = [{ components = 0, volume = 1 }] }", "expected a sequence"),
            ("{ parts = [{ componets = [0], volume = 1 }] }", "did you mean `components`?"),
            ("{ materials = 1 }", "did you mean `material`?"),
            ("{}", "{ min, max }"),
            ("\"each=\"", "more than 0"),
            ("\"each=1,each=1\"", "cannot be"),
            ("\"each=1,capacity=1\"", "cannot be"),
            ("\"capacity\"", "cannot be"),
            ("\"volume=1\"", "cannot be"),
            ("true", "\"each\""),
        ] {
            let error = volume(bad).unwrap_err();
            assert!(error.to_string().contains(fragment), "{bad}: {error}");
            assert_eq!(error.line, Some(2), "{bad}");
        }
    }

    #[test]
    fn unknown_keys_name_the_nearest_and_the_place() {
        let error = Job::from_toml("model = \"a.obj\"\n[lattice]\ndegre = 3\n").unwrap_err();
        assert_eq!((error.line, error.nearest.as_deref()), (Some(3), Some("degree")));
        assert!(error.what.contains("degre"), "{error}");
        let error = Job::from_json("{\n \"presrve\": {}}").unwrap_err();
        assert_eq!((error.line, error.nearest.as_deref()), (Some(2), Some("preserve")));
        let error = Job::from_toml("[[edit]]\ntwsit = { axis = \"z\", degrees = 9 }").unwrap_err();
        assert_eq!(error.nearest.as_deref(), Some("twist"));
    }

    #[test]
    fn lists_that_are_too_long_or_too_short_are_refused() {
        for bad in [
            "origin = [0, 0, 0, 9]",
            "origin = [0, 0]",
            "axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1, 5]]",
            "axes = [[1, 0, 0], [0, 1, 0]]",
            "size = [4, 4, 4, 4]",
        ] {
            assert!(Job::from_toml(&format!("[lattice]\n{bad}")).is_err(), "{bad}");
        }
        assert!(Job::from_toml("[lattice]\norigin = [0, 0, 1]\naxes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]").is_ok());
    }

    #[test]
    fn an_empty_job_preserves_the_volume() {
        let job = Job::from_toml("").unwrap();
        assert_eq!(job, Job::default());
        assert_eq!(job.preserve, Preserve { volume: VolumeTarget::Rest, ..Preserve::default() });
    }
}
