//! The body of a job: what its request asks of volumes, as signed goals, and what became of them, in the request's own terms.
//!
//! Requests speak of outward volumes, of parts and of capacities, all positive; goals are sums of signed volumes of components.

use glam::DVec3;

use crate::correct::CorrectError;
use crate::goals::{Components, VolumeGoal};
use crate::health::ComponentHealth;
use crate::job::{Amount, PartTarget, VolumeTarget};
use crate::outcome::JobError;
use crate::report::{PartRow, VolumeReport, VolumeRow};
use crate::shells::Role;
use crate::tolerances;
use crate::volume::{Solid, Volumes};

/// A body and its volumes at rest.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    pub(crate) solid: Solid,
    pub(crate) rest: Volumes,
    /// −1 where the model is inside out, else 1.
    orientation: f64,
    /// What each component is to the others.
    roles: Vec<Role>,
}

/// A volume that is asked for, and how to speak of it.
#[derive(Clone, Debug)]
pub(crate) struct Wish {
    pub(crate) goal: VolumeGoal,
    /// Such as "the capacity"; `None`: the volume of the whole model, asked for as such.
    name: Option<String>,
    /// Where the request asks for it.
    place: String,
    /// What makes it positive: 1 or −1.
    sign: f64,
}

impl Wish {
    /// An error of a correction that was to fulfil `wishes`, in the words of the request.
    pub(crate) fn error_of(wishes: &[Self], error: CorrectError) -> JobError {
        let CorrectError::Impossible { goal: Some(goal), .. } = error else { return JobError::Correct(error) };
        let Self { name, place, sign, .. } = &wishes[goal];
        match (error.oriented(*sign), name) {
            (CorrectError::Impossible { target, volume, reason, .. }, Some(name)) => {
                JobError::Volume { name: name.clone(), place: place.clone(), target, volume, reason }
            }
            (error, _) => JobError::Correct(error),
        }
    }
}

impl Body {
    pub(crate) fn new(solid: Solid, rest: Volumes, components: &[ComponentHealth]) -> Self {
        let roles = components.iter().map(|component| component.role.clone()).collect();
        Self { solid, orientation: sign(rest.total), rest, roles }
    }

    /// The volumes that are wanted of the body, whose pose has the volumes `posed`. What is left out is said in `warnings`.
    pub(crate) fn wishes(
        &self,
        wanted: &VolumeTarget,
        posed: &Volumes,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<Wish>, JobError> {
        match wanted {
            VolumeTarget::Each(amount) => {
                let (empty, full): (Vec<usize>, Vec<usize>) =
                    (0..self.roles.len()).partition(|&c| self.roles[c] == Role::Nothing);
                if full.is_empty() {
                    return Err(JobError::NoVolume { volume: self.rest.total });
                }
                if let Some(first) = empty.first() {
                    let count = empty.len();
                    warnings.push(format!(
                        "Components that enclose no volume keep none: {count}, the first of them component {first}."
                    ));
                }
                Ok(full.into_iter().map(|c| self.wish(self.goal(vec![c], *amount), None, "")).collect())
            }
            VolumeTarget::Parts(parts) => {
                if parts.is_empty() {
                    let problem = "has an empty list of parts: it needs at least one { components, volume }".into();
                    return Err(JobError::Value { key: "preserve.volume", problem });
                }
                let wish =
                    |(index, part)| Ok(self.wish(self.part_goal(index, part)?, None, &format!(".parts[{index}]")));
                parts.iter().enumerate().map(wish).collect()
            }
            VolumeTarget::Hollow { material, capacity } => {
                let of_role = |is: fn(&Role) -> bool| (0..self.roles.len()).filter(move |&c| is(&self.roles[c]));
                let cavities: Vec<usize> = of_role(|role| matches!(role, Role::Cavity { .. })).collect();
                if cavities.is_empty() {
                    return Err(JobError::NoCavities { inward: of_role(|role| *role == Role::Inward).next() });
                }
                let wish = |components, amount, name: &str| {
                    self.wish(self.goal(components, amount), Some(format!("the {name}")), &format!(".{name}"))
                };
                let material = material.map(|amount| wish((0..self.roles.len()).collect(), amount, "material"));
                let capacity = capacity.map(|amount| wish(cavities, amount, "capacity"));
                Ok(material.into_iter().chain(capacity).collect())
            }
            one => {
                let volume = self.target_volume(one, posed)? * self.orientation;
                let goal = VolumeGoal { components: Components::All, volume };
                Ok(vec![Wish { goal, name: None, place: "preserve.volume".into(), sign: self.orientation }])
            }
        }
    }

    /// One of several wishes, at `place` of the key of volumes. Without a name it is called by its components.
    fn wish(&self, goal: VolumeGoal, name: Option<String>, place: &str) -> Wish {
        /// More components than anybody reads.
        const MOST_NAMED: usize = 5;
        let name = name.unwrap_or_else(|| match &goal.components {
            Components::All => "the volume of all components".into(),
            Components::These(these) => {
                let is_capacity = these.iter().all(|&c| matches!(self.roles[c], Role::Cavity { .. }));
                let what = if is_capacity { "capacity" } else { "volume" };
                let components = if these.len() == 1 { "component" } else { "components" };
                let named: Vec<String> = these.iter().take(MOST_NAMED).map(usize::to_string).collect();
                let more = if these.len() > MOST_NAMED { ", …" } else { "" };
                format!("the {what} of {components} {}{more}", named.join(", "))
            }
        });
        let sign = sign(goal.of(&self.rest));
        Wish { goal, name: Some(name), place: format!("preserve.volume{place}"), sign }
    }

    /// What the pose has of its wishes and what it shall have, relative to rest; of several their sizes together.
    pub(crate) fn relative_sizes(&self, wishes: &[Wish], posed: &Volumes) -> (f64, f64) {
        let size = |of: &dyn Fn(&VolumeGoal) -> f64| -> f64 { wishes.iter().map(|w| of(&w.goal) * w.sign).sum() };
        let rest = size(&|goal| goal.of(&self.rest));
        (size(&|goal| goal.of(posed)) / rest, size(&|goal| goal.volume) / rest)
    }

    /// The goal of a part, checked.
    fn part_goal(&self, index: usize, part: &PartTarget) -> Result<VolumeGoal, JobError> {
        let wrong = |what: String| {
            Err(JobError::Value { key: "preserve.volume", problem: format!("has a part, parts[{index}], {what}") })
        };
        let count = self.roles.len();
        if let Some(&component) = part.components.iter().find(|&&c| c >= count) {
            let place = format!("preserve.volume.parts[{index}]");
            return Err(JobError::MissingComponent { place, component, components: count });
        }
        let mut components = part.components.clone();
        components.sort_unstable();
        if components.is_empty() {
            return wrong("without components".into());
        }
        if let Some(twice) = components.windows(2).find(|pair| pair[0] == pair[1]) {
            return wrong(format!("that names component {} twice", twice[0]));
        }
        // Of components that enclose a volume each, the sum may still be rounding noise.
        let full = components.iter().filter(|&&c| self.roles[c] != Role::Nothing).map(|&c| self.rest.components[c]);
        let (sum, size) = full.fold((0.0, 0.0), |(sum, size), v: f64| (sum + v, size + v.abs()));
        if sum.abs() <= tolerances::NO_VOLUME * size {
            return wrong(format!("whose components {components:?} enclose no volume together"));
        }
        Ok(self.goal(components, part.volume))
    }

    /// The goal that `components`, ascending, get `amount` of what they hold at rest.
    fn goal(&self, components: Vec<usize>, amount: Amount) -> VolumeGoal {
        let components =
            if components.len() == self.roles.len() { Components::All } else { Components::These(components) };
        let goal = VolumeGoal { components, volume: 1.0 };
        let rest = goal.of(&self.rest);
        VolumeGoal { volume: amount.of(rest.abs()) * sign(rest), ..goal }
    }

    /// What is reported of the volumes of a pose that was not to be corrected.
    pub(crate) fn free_rows(&self, posed: &[DVec3]) -> VolumeReport {
        let posed = self.solid.volumes(posed);
        self.rows(&posed, &posed, &[])
    }

    /// The report's rows, oriented outwards; parts positive.
    pub(crate) fn rows(&self, posed: &Volumes, corrected: &Volumes, goals: &[VolumeGoal]) -> VolumeReport {
        let row = |volume: &dyn Fn(&Volumes) -> f64, sign: f64| VolumeRow {
            rest: volume(&self.rest) * sign,
            posed: volume(posed) * sign,
            target: None,
            corrected: volume(corrected) * sign,
            written: None,
            relative_error: None,
        };
        let count = self.roles.len();
        let mut overall = row(&|volumes| volumes.total, self.orientation);
        let mut components: Vec<VolumeRow> =
            (0..count).map(|c| row(&|volumes| volumes.components[c], self.orientation)).collect();
        let mut parts = Vec::new();
        let is_of_parts = goals.len() > 1 || goals.iter().any(|goal| goal.components != Components::All);
        for goal @ VolumeGoal { components: which, volume } in goals {
            let list = match which {
                Components::All => (0..count).collect(),
                Components::These(list) => list.clone(),
            };
            if *which == Components::All {
                overall.aim(volume * self.orientation);
            }
            if let [only] = list[..] {
                components[only].aim(volume * self.orientation);
            }
            if is_of_parts {
                let sign = sign(goal.of(&self.rest));
                let mut part = PartRow { components: list, row: row(&|volumes| goal.of(volumes), sign) };
                part.row.aim(volume * sign);
                parts.push(part);
            }
        }
        VolumeReport { overall, components, parts }
    }

    /// The volume of the whole model that is wanted, whose pose has the volumes `posed`; outward orientation.
    fn target_volume(&self, wanted: &VolumeTarget, posed: &Volumes) -> Result<f64, JobError> {
        let (rest, posed) = (self.rest.total * self.orientation, posed.total * self.orientation);
        match wanted {
            VolumeTarget::Amount(amount) => Ok(amount.of(rest)),
            VolumeTarget::Range { min, max } => {
                let low = min.map_or(f64::NEG_INFINITY, |amount| amount.of(rest));
                let high = max.map_or(f64::INFINITY, |amount| amount.of(rest));
                if low > high {
                    let problem = format!("is a range from {low} to {high}: min must not exceed max");
                    return Err(JobError::Value { key: "preserve.volume", problem });
                }
                Ok(posed.clamp(low, high))
            }
            VolumeTarget::Free => Ok(posed),
            _ => Ok(rest),
        }
    }

    /// Adds to the rows what volumes the written points have (#vertices × 3).
    pub(crate) fn add_written(&self, rows: &mut VolumeReport, points: &[DVec3]) {
        let written = self.solid.volumes(points);
        rows.overall.written = Some(written.total * self.orientation);
        for (row, volume) in rows.components.iter_mut().zip(&written.components) {
            row.written = Some(volume * self.orientation);
        }
        for PartRow { components, row } in &mut rows.parts {
            let sum = |volumes: &Volumes| components.iter().map(|&c| volumes.components[c]).sum::<f64>();
            row.written = Some(sum(&written) * sign(sum(&self.rest)));
        }
    }
}

/// −1 for negative volumes, else 1.
fn sign(volume: f64) -> f64 {
    if volume < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::correct::Reason;
    use crate::health::{Health, Source};
    use crate::mesh::{Faces, Mesh};
    use crate::shapes;
    use crate::topology::topology;

    const PERCENT: fn(f64) -> Amount = Amount::Percent;

    /// Models one after the other: scaled, moved, and turned inside out where asked.
    fn together(pieces: &[(&Mesh, f64, DVec3, bool)]) -> Mesh {
        let (mut points, mut faces) = (Vec::new(), Faces::new());
        for (mesh, scale, shift, inward) in pieces {
            let first = points.len() as u32;
            points.extend(mesh.points().iter().map(|p| *p * *scale + *shift));
            for face in mesh.faces().iter() {
                let mut corners: Vec<u32> = face.iter().map(|v| v + first).collect();
                if *inward {
                    corners[1..].reverse();
                }
                faces.push(&corners);
            }
        }
        Mesh::new(points, faces).unwrap()
    }

    /// A cube of side 4 with cavities of sides 2 and 1, and a cube of side 1 beside it: 64 − 8 − 1 + 1.
    fn model(inside_out: bool) -> Mesh {
        let cube = shapes::cube(2);
        let flip = |inward: bool| inward != inside_out;
        together(&[
            (&cube, 4.0, DVec3::ZERO, flip(false)),
            (&cube, 2.0, DVec3::splat(0.5), flip(true)),
            (&cube, 1.0, DVec3::splat(2.75), flip(true)),
            (&cube, 1.0, DVec3::X * 6.0, flip(false)),
        ])
    }

    fn body(mesh: &Mesh) -> Body {
        let (health, solid) = Health::of(mesh, &topology(mesh), &Source::of(mesh));
        Body::new(solid.unwrap(), health.volume.unwrap(), &health.roles)
    }

    fn goals(mesh: &Mesh, wanted: &VolumeTarget) -> Result<Vec<VolumeGoal>, JobError> {
        let body = body(mesh);
        let wishes = body.wishes(wanted, &body.rest, &mut Vec::new())?;
        Ok(wishes.into_iter().map(|wish| wish.goal).collect())
    }

    fn these(components: &[usize], volume: f64) -> VolumeGoal {
        VolumeGoal { components: Components::These(components.to_vec()), volume }
    }

    fn part(components: &[usize], volume: Amount) -> PartTarget {
        PartTarget { components: components.to_vec(), volume }
    }

    fn all(volume: f64) -> VolumeGoal {
        VolumeGoal { components: Components::All, volume }
    }

    #[test]
    fn each_component_gets_its_own_volume_with_its_sign() {
        for (inside_out, s) in [(false, 1.0), (true, -1.0)] {
            let mesh = model(inside_out);
            let of = |amount| goals(&mesh, &VolumeTarget::Each(amount)).unwrap();
            let rest = [64.0 * s, -8.0 * s, -s, s];
            assert_eq!(of(PERCENT(100.0)), [0, 1, 2, 3].map(|c| these(&[c], rest[c])));
            assert_eq!(of(PERCENT(150.0)), [0, 1, 2, 3].map(|c| these(&[c], 1.5 * rest[c])));
            assert_eq!(of(Amount::Absolute(3.0)), [0, 1, 2, 3].map(|c| these(&[c], 3.0 * rest[c].signum())));
        }
        assert_eq!(goals(&shapes::cube(1), &VolumeTarget::Each(PERCENT(110.0))), Ok(vec![all(1.1)]));
    }

    #[test]
    fn components_without_volume_are_left_out_with_a_warning() {
        let cube = shapes::cube(1);
        let sheet = together(&[(&cube, 1.0, DVec3::X * 3.0, false)]);
        let flat: Vec<DVec3> = sheet.points().iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
        let flat = sheet.with_points(flat).unwrap();
        let mesh = together(&[
            (&cube, 1.0, DVec3::ZERO, false),
            (&flat, 1.0, DVec3::ZERO, false),
            (&flat, 1.0, DVec3::Y * 3.0, false),
            (&cube, 2.0, DVec3::Z * 3.0, false),
        ]);
        // Welding leaves of a flat cube a sheet with its faces doubled.
        let body = body(&mesh);
        assert_eq!(body.roles, [Role::Solid, Role::Nothing, Role::Nothing, Role::Solid]);
        let mut warnings = Vec::new();
        let each = VolumeTarget::Each(PERCENT(100.0));
        let wishes = body.wishes(&each, &body.rest, &mut warnings).unwrap();
        let found: Vec<VolumeGoal> = wishes.iter().map(|wish| wish.goal.clone()).collect();
        assert_eq!(found, [these(&[0], 1.0), these(&[3], 8.0)]);
        // The second of them is component 3.
        assert_eq!(message(&wishes, 1), ("the volume of component 3".into(), "preserve.volume".into(), 9.0, 8.0, 7.0));
        assert_eq!(warnings, ["Components that enclose no volume keep none: 2, the first of them component 1."]);
        let nothing = goals(&flat, &each);
        assert!(matches!(nothing, Err(JobError::NoVolume { .. })), "{nothing:?}");
        let one = goals(&mesh, &VolumeTarget::Parts(vec![part(&[1, 2], PERCENT(100.0))])).unwrap_err();
        assert!(one.to_string().contains("enclose no volume") && !one.is_unreachable(), "{one}");
    }

    /// How it is said that a wish cannot be fulfilled: name, place, target, volume and what follows.
    fn message(wishes: &[Wish], goal: usize) -> (String, String, f64, f64, f64) {
        let s = wishes[goal].sign;
        let reason = Reason::Follows { follows: 7.0 * s };
        let error = CorrectError::Impossible { goal: Some(goal), target: 9.0 * s, volume: 8.0 * s, reason };
        match Wish::error_of(wishes, error) {
            JobError::Volume { name, place, target, volume, reason: Reason::Follows { follows } } => {
                (name, place, target, volume, follows)
            }
            other => panic!("{other}"),
        }
    }

    #[test]
    fn errors_speak_of_positive_volumes_in_the_words_of_the_request() {
        for inside_out in [false, true] {
            let body = body(&model(inside_out));
            let wishes = |wanted: &VolumeTarget| body.wishes(wanted, &body.rest, &mut Vec::new()).unwrap();
            let all = PERCENT(100.0);
            let each = wishes(&VolumeTarget::Each(all));
            let hollow = wishes(&VolumeTarget::Hollow { material: Some(all), capacity: Some(all) });
            let parts = [&[0, 3][..], &[1], &[2, 1], &[0, 1], &[3, 2, 1, 0]].map(|c| part(c, all));
            let parts = wishes(&VolumeTarget::Parts(parts.into()));
            for (wishes, goal, name, place) in [
                (&each, 1, "the capacity of component 1", "preserve.volume"),
                (&each, 3, "the volume of component 3", "preserve.volume"),
                (&hollow, 0, "the material", "preserve.volume.material"),
                (&hollow, 1, "the capacity", "preserve.volume.capacity"),
                (&parts, 0, "the volume of components 0, 3", "preserve.volume.parts[0]"),
                (&parts, 1, "the capacity of component 1", "preserve.volume.parts[1]"),
                (&parts, 2, "the capacity of components 1, 2", "preserve.volume.parts[2]"),
                (&parts, 3, "the volume of components 0, 1", "preserve.volume.parts[3]"),
                (&parts, 4, "the volume of all components", "preserve.volume.parts[4]"),
            ] {
                assert_eq!(message(wishes, goal), (name.into(), place.into(), 9.0, 8.0, 7.0));
            }
        }
    }

    #[test]
    fn parts_are_signed_sums_and_cavities_count_positive() {
        for (inside_out, s) in [(false, 1.0), (true, -1.0)] {
            let mesh = model(inside_out);
            let parts = vec![
                part(&[3, 0], PERCENT(100.0)),
                part(&[1, 2], PERCENT(200.0)),
                part(&[1], Amount::Absolute(5.0)),
                part(&[0, 1], PERCENT(50.0)),
                part(&[0, 1, 2, 3], PERCENT(100.0)),
                part(&[1], PERCENT(100.0)),
            ];
            let found = goals(&mesh, &VolumeTarget::Parts(parts)).unwrap();
            let expected = [
                these(&[0, 3], 65.0 * s),
                these(&[1, 2], -18.0 * s),
                these(&[1], -5.0 * s),
                these(&[0, 1], 28.0 * s),
                all(56.0 * s),
                these(&[1], -8.0 * s),
            ];
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn parts_that_name_nothing_are_refused() {
        let mesh = model(false);
        let refused = |parts: &[PartTarget]| goals(&mesh, &VolumeTarget::Parts(parts.to_vec())).unwrap_err();
        for (parts, code, fragment) in [
            (vec![], "value", "at least one"),
            (vec![part(&[], PERCENT(100.0))], "value", "parts[0], without components"),
            (vec![part(&[0], PERCENT(100.0)), part(&[4], PERCENT(100.0))], "missing-component", "has 4 (0 to 3)"),
            (vec![part(&[2, 0, 2], PERCENT(100.0))], "value", "component 2 twice"),
            (vec![part(&[2, 3], Amount::Absolute(1.0))], "value", "enclose no volume together"),
        ] {
            let error = refused(&parts);
            assert!(error.to_string().contains(fragment) && error.code() == code, "{error}");
            assert!(!error.is_unreachable() && error.place().starts_with("preserve.volume"), "{error}");
        }
    }

    #[test]
    fn material_and_capacity_are_of_models_with_cavities() {
        for (inside_out, s) in [(false, 1.0), (true, -1.0)] {
            let mesh = model(inside_out);
            let of = |material, capacity| goals(&mesh, &VolumeTarget::Hollow { material, capacity }).unwrap();
            let both = of(Some(PERCENT(100.0)), Some(PERCENT(110.0)));
            assert_eq!(both, [all(56.0 * s), these(&[1, 2], -9.0 * 110.0 / 100.0 * s)]);
            assert_eq!(of(None, Some(Amount::Absolute(4.0))), [these(&[1, 2], -4.0 * s)]);
            assert_eq!(of(Some(Amount::Absolute(4.0)), None), [all(4.0 * s)]);
        }
        let hollow = VolumeTarget::Hollow { material: None, capacity: Some(PERCENT(100.0)) };
        assert_eq!(goals(&shapes::cube(1), &hollow), Err(JobError::NoCavities { inward: None }));
        let cube = shapes::cube(1);
        let beside = together(&[(&cube, 3.0, DVec3::ZERO, false), (&cube, 1.0, DVec3::X * 5.0, true)]);
        let refused = goals(&beside, &hollow).unwrap_err();
        assert_eq!(refused, JobError::NoCavities { inward: Some(1) });
        assert!(!refused.is_unreachable() && refused.hint().contains("isochor info"));
    }

    #[test]
    fn rows_say_what_was_asked_of_the_whole_of_components_and_of_parts() {
        for (inside_out, s) in [(false, 1.0), (true, -1.0)] {
            let body = body(&model(inside_out));
            let volumes =
                |v: [f64; 4]| Volumes { total: s * v.iter().sum::<f64>(), components: v.map(|v| s * v).to_vec() };
            let (posed, end) = (volumes([60.0, -6.0, -2.0, 1.0]), volumes([66.0, -9.0, -1.0, 2.0]));
            let goals = [all(58.0 * s), these(&[1, 2], -10.0 * s), these(&[3], 1.0 * s)];
            let report = body.rows(&posed, &end, &goals);
            let row = |rest, posed, target: f64, corrected: f64| VolumeRow {
                rest,
                posed,
                target: Some(target),
                corrected,
                written: None,
                relative_error: Some((corrected / target - 1.0).abs()),
            };
            assert_eq!(report.overall, row(56.0, 53.0, 58.0, 58.0));
            assert_eq!(report.components[3], row(1.0, 1.0, 1.0, 2.0));
            assert_eq!((report.components[1].rest, report.components[1].target), (-8.0, None));
            let parts: Vec<(Vec<usize>, VolumeRow)> = report.parts.into_iter().map(|p| (p.components, p.row)).collect();
            let expected = vec![
                (vec![0, 1, 2, 3], row(56.0, 53.0, 58.0, 58.0)),
                (vec![1, 2], row(9.0, 8.0, 10.0, 10.0)),
                (vec![3], row(1.0, 1.0, 1.0, 2.0)),
            ];
            assert_eq!(parts, expected);
            assert!(body.rows(&posed, &end, &goals[..1]).parts.is_empty());
            assert_eq!(body.rows(&posed, &end, &goals[1..2]).parts.len(), 1);
        }
    }
}
