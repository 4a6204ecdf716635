//! A job in words, for people who did not write it.

use glam::DVec3;
use isochor::{
    Amount, Axis, CenterOfMass, Continuity, Edit, ElasticRequest, Factors, Hold, Inertia, Job, LengthUnit, MethodKind,
    Net, Objective, RotationAxis, SignedAxis, VolumeTarget,
};

use crate::digits::significant;

/// The job of a job file, TOML or JSON, as short phrases: the lattice, its edits in order, what is preserved. Nothing where the text is no
/// job.
pub fn phrases(text: &str) -> Vec<String> {
    let Ok(job) = Job::from_toml(text).or_else(|_| Job::from_json(text)) else { return Vec::new() };
    let mut phrases = Vec::new();
    if let Some(size) = job.lattice.as_ref().and_then(|lattice| lattice.size) {
        let [u, v, w] = size.each();
        phrases.push(format!("a lattice of {u} × {v} × {w} control points"));
    }
    if let Some(cage) = &job.cage {
        phrases.push(format!("a cage with {} coordinates", cage.coordinates.name()));
    }
    phrases.extend(job.edit.iter().map(edit));
    phrases.push(volume(&job.preserve.volume));
    let preserve = &job.preserve;
    if preserve.method == Some(MethodKind::Elastic) {
        phrases.extend(elastic(&job.elastic.clone().unwrap_or_default()));
    }
    match preserve.objective {
        Objective::Controls => {}
        other => phrases.push(format!("the correction keeps “{}” small", other.name())),
    }
    if preserve.pin.is_some() {
        phrases.push("some control points are pinned".into());
    }
    if let Some(falloff) = preserve.falloff {
        phrases.push(format!("the correction stays near vertex {}", falloff.vertex));
    }
    match preserve.points.len() {
        0 => {}
        1 => phrases.push("one vertex comes to an exact place".into()),
        points => phrases.push(format!("{points} vertices come to exact places")),
    }
    phrases
}

/// How nodes settle.
fn elastic(request: &ElasticRequest) -> Vec<String> {
    let net = match request.net {
        Net::TwentySix => "springs along edges and all diagonals of cells",
        Net::Fourteen => "springs along edges and diagonals through cells",
        Net::FourteenKuhn => "springs along edges of tetrahedra, six in a cell",
    };
    let hold = match request.hold {
        Hold::Edited => "control points that the edits move are held, the others settle",
        Hold::Nodes(_) => "some control points are held, the others settle",
    };
    let continuity = request.continuity.map(|continuity| match continuity {
        Continuity::C0 => "the border of the lattice stays, so that nothing tears there",
        Continuity::C1 => "the border of the lattice stays, so that there are no kinks there",
        Continuity::C2 => "the border of the lattice stays, so that curvatures are continuous there",
    });
    let center = request.center_of_mass.map(|center| match center {
        CenterOfMass::Keep => "the centre of mass stays".into(),
        CenterOfMass::At(center) => format!("the centre of mass comes to {}", vector(center)),
    });
    let inertia = request.inertia.map(|inertia| match inertia {
        Inertia::Keep => "the inertia tensor stays",
        Inertia::Tensor(_) => "the inertia tensor becomes a given one",
    });
    let words = [Some(net), Some(hold), continuity].into_iter().flatten().map(String::from);
    words.chain(center).chain(inertia.map(String::from)).collect()
}

fn edit(edit: &Edit) -> String {
    match edit {
        Edit::Twist(twist) => format!("twist by {}° about {}", significant(twist.degrees), letter(twist.axis)),
        Edit::Bend(bend) => {
            let towards = bend.towards.map_or_else(String::new, |towards| format!(" towards {}", signed(towards)));
            format!("bend by {}° along {}{towards}", significant(bend.degrees), letter(bend.axis))
        }
        Edit::Taper(taper) => format!("taper to {} along {}", percent(taper.scale), letter(taper.axis)),
        Edit::Stretch(stretch) => format!("stretch to {} along {}", percent(stretch.scale), letter(stretch.axis)),
        Edit::Move(by) => format!("move by {}{}", vector(by.by), unit(by.unit)),
        Edit::Slide(by) => format!("slide at constant volume by what it allows of {}{}", vector(by.by), unit(by.unit)),
        Edit::Rotate(rotate) => {
            let axis = match rotate.axis {
                RotationAxis::Coordinate(axis) => letter(axis).into(),
                RotationAxis::Vector(axis) => vector(axis),
            };
            format!("rotate by {}° about {axis}", significant(rotate.degrees))
        }
        Edit::Scale(scale) => match scale.by {
            Factors::Uniform(factor) => format!("scale to {}", percent(factor)),
            Factors::PerAxis(factors) => format!("scale by {}", vector(factors)),
        },
        Edit::Noise(noise) => {
            format!("noise of up to {}{}, seed {}", significant(noise.amplitude), unit(noise.unit), noise.seed)
        }
        Edit::Posed(_) => "control points put at given places".into(),
        Edit::Drag(drag) if drag.points.len() == 1 => {
            format!("drag vertex {} to {}", drag.points[0].vertex, vector(drag.points[0].to))
        }
        Edit::Drag(drag) => format!("drag {} vertices to given places", drag.points.len()),
    }
}

fn volume(target: &VolumeTarget) -> String {
    match target {
        VolumeTarget::Rest => "keep the volume exactly".into(),
        VolumeTarget::Free => "let the volume go free".into(),
        VolumeTarget::Amount(wanted) => format!("bring the volume to {}", amount(*wanted)),
        VolumeTarget::Range { min, max } => match (min, max) {
            (Some(min), Some(max)) => format!("keep the volume between {} and {}", amount(*min), amount(*max)),
            (Some(min), None) => format!("keep the volume at {} or more", amount(*min)),
            (None, Some(max)) => format!("keep the volume at {} or less", amount(*max)),
            (None, None) => "let the volume go free".into(),
        },
        VolumeTarget::Each(wanted) => format!("bring every component to {}", amount(*wanted)),
        VolumeTarget::Parts(parts) => match parts.len() {
            1 => "bring one part of the model to a volume of its own".into(),
            parts => format!("bring {parts} parts of the model to volumes of their own"),
        },
        VolumeTarget::Hollow { material, capacity } => {
            let bring =
                |what: &str, wanted: &Option<Amount>| wanted.map(|wanted| format!("{what} to {}", amount(wanted)));
            let both: Vec<String> =
                [bring("the material", material), bring("the capacity", capacity)].into_iter().flatten().collect();
            format!("bring {}", both.join(" and "))
        }
    }
}

fn amount(amount: Amount) -> String {
    match amount {
        Amount::Percent(percent) => format!("{}\u{202f}% of what it was", significant(percent)),
        Amount::Absolute(volume) => significant(volume),
    }
}

fn percent(factor: f64) -> String {
    format!("{}\u{202f}%", significant(100.0 * factor))
}

fn vector(vector: DVec3) -> String {
    let [x, y, z] = vector.to_array().map(significant);
    format!("({x}, {y}, {z})")
}

fn unit(unit: LengthUnit) -> &'static str {
    match unit {
        LengthUnit::Extent => " extents",
        LengthUnit::Model => "",
    }
}

fn letter(axis: Axis) -> &'static str {
    match axis {
        Axis::X => "x",
        Axis::Y => "y",
        Axis::Z => "z",
    }
}

fn signed(axis: SignedAxis) -> &'static str {
    match axis {
        SignedAxis::X => "x",
        SignedAxis::Y => "y",
        SignedAxis::Z => "z",
        SignedAxis::MinusX => "−x",
        SignedAxis::MinusY => "−y",
        SignedAxis::MinusZ => "−z",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_told_in_order() {
        let text = "[lattice]\nsize = [6, 6, 10]\n[[edit]]\ntwist = { axis = \"z\", degrees = -90 }\n[[edit]]\ntaper = { axis = \"x\", \
                    scale = 0.7 }\n[preserve]\nvolume = \"110%\"\npin = { k = [0, 1] }\n";
        assert_eq!(
            phrases(text),
            [
                "a lattice of 6 × 6 × 10 control points",
                "twist by −90° about z",
                "taper to 70\u{202f}% along x",
                "bring the volume to 110\u{202f}% of what it was",
                "some control points are pinned",
            ]
        );
    }

    #[test]
    fn settling_is_told() {
        let job = |elastic: &str| phrases(&format!("[preserve]\nmethod = \"elastic\"\n[elastic]\n{elastic}"));
        assert_eq!(
            job(""),
            [
                "keep the volume exactly",
                "springs along edges and all diagonals of cells",
                "control points that the edits move are held, the others settle",
            ]
        );
        assert_eq!(
            job(
                "net = \"14\"\nhold = { i = [0, 4] }\ncontinuity = \"c1\"\ncenter_of_mass = [1, 0, -2]\ninertia = \"keep\""
            )[1..],
            [
                "springs along edges and diagonals through cells",
                "some control points are held, the others settle",
                "the border of the lattice stays, so that there are no kinks there",
                "the centre of mass comes to (1, 0, −2)",
                "the inertia tensor stays",
            ]
        );
        assert_eq!(job("center_of_mass = \"keep\"").last().unwrap(), "the centre of mass stays");
        assert_eq!(phrases("[preserve]\nmethod = \"nearest\""), ["keep the volume exactly"]);
    }

    #[test]
    fn json_is_told_too_and_other_text_is_not() {
        assert_eq!(phrases("{\"preserve\": {\"volume\": \"free\"}}"), ["let the volume go free"]);
        assert_eq!(phrases("<b>no job</b>"), [""; 0]);
    }
}
