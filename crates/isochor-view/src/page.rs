//! A report as one page that opens anywhere: numbers, pictures, and the model to turn by hand.
//!
//! Everything is in the page: styles, pictures, geometry, the program of the 3D view. A content security policy forbids it to ask
//! anybody for anything, and lets run that one program only, named by its SHA-256. All text from outside is escaped by `maud`,
//! which knows no other way.

use std::fmt::Write as _;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use isochor::{Axis, ComponentHealth, Health, NetKind, PartRow, Report, Role, Verdict, VolumeReport, VolumeRow};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

use crate::digits::{change, count, number, short_number, signed_percent, significant, size};
use crate::geometry::Geometry;
use crate::request;
use crate::show::Show;

/// Rows of a table that are shown at once. More: what follows is far away; fewer: models of a few parts need a click.
const ROWS_SHOWN: usize = 20;

/// Rows of a table in the page at all: a model of a million loose triangles has as many components. More: larger pages; fewer: the JSON
/// report is needed earlier.
const ROWS_HELD: usize = 2000;

const STYLE: &str = include_str!("page.css");
const VIEWER: &str = include_str!("viewer/viewer.min.js");

/// What a page holds.
#[derive(Clone, Debug)]
pub struct Page<'a> {
    /// Its title, such as the model's name.
    pub title: String,
    /// The request as it was given: a job file's text, the command line, or both.
    pub job: Option<String>,
    /// What was done.
    pub report: &'a Report,
    /// Pictures, in order.
    pub pictures: Vec<Figure>,
    /// What the 3D view shows.
    pub show: Option<&'a Show<'a>>,
    /// Which way is up in the 3D view.
    pub up: Axis,
}

/// A picture on a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Figure {
    /// What it shows.
    pub caption: String,
    /// A PNG file, animated or not.
    pub png: Vec<u8>,
}

/// The page as an HTML document that needs no other file.
///
/// # Panics
///
/// Panics where the arrays of the show do not fit together: poses with different numbers of points, local changes or control points,
/// springs or nodes of other numbers, a face that names a missing vertex. Faces with a corner that is not finite in some pose are left out, and the page says so.
#[must_use]
pub fn page(contents: &Page) -> String {
    let Page { title, job, report, pictures, show, up } = contents;
    let geometry = show.filter(|show| !show.poses.is_empty()).map(|show| (show, Geometry::of(show, *up)));
    let script = geometry.as_ref().map(|_| VIEWER);
    document(
        title,
        script,
        html! {
            header {
                p.kicker { "Isochor report" }
                h1 { (title) }
                (headline(report))
            }
            main {
                (warnings(&report.warnings))
                @if let Some(volume) = &report.volume {
                    section { h2 { "Volume" } (volume_chart(&volume.overall)) }
                }
                @if let Some((show, geometry)) = &geometry {
                    section.wide { h2 { "Model" } (viewer(show, geometry, !pictures.is_empty())) }
                }
                @if !pictures.is_empty() {
                    section.wide {
                        h2 { "Pictures" }
                        @for Figure { caption, png } in pictures {
                            figure {
                                img alt=(caption) src=(format!("data:image/png;base64,{}", STANDARD.encode(png)));
                                figcaption { (caption) }
                            }
                        }
                    }
                }
                @if let Some(job) = job { (request(job)) }
                @if let Some(volume) = &report.volume {
                    (parts(volume, &report.model.roles))
                    (components(volume, &report.model.roles))
                }
                div.columns { (correction(report)) (timings(report)) }
                (health(&report.model))
            }
            footer { p {
                "Made by isochor " (report.version) ". Volumes are in the cube of the model’s unit, positive outwards. Rest a pointer on a \
                 number to see all its digits. This page needs no network and uses none."
            } }
            @if let Some((_, geometry)) = &geometry {
                script type="application/json" id="geometry" { (PreEscaped(&geometry.json)) }
            }
        },
    )
}

/// A whole document with the house's style. `script` runs at its end, and nothing else does.
pub(crate) fn document(title: &str, script: Option<&str>, body: Markup) -> String {
    let program = script.map_or_else(
        || "'none'".into(),
        |script| format!("'sha256-{}'", STANDARD.encode(Sha256::digest(script.as_bytes()))),
    );
    // Pictures beside the page are for index pages; from a page of its own kind nothing is asked for.
    let images = if script.is_some() { "data:" } else { "'self' file: data:" };
    let policy = format!(
        "default-src 'none'; script-src {program}; style-src 'unsafe-inline'; img-src {images}; base-uri 'none'; form-action 'none'"
    );
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy);
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta name="generator" content="isochor";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                (body)
                @if let Some(script) = script { script { (PreEscaped(script)) } }
            }
        }
    }
    .into_string()
}

/// How it went, in a sentence.
fn headline(report: &Report) -> Markup {
    let errors = report.volume.iter().flat_map(|volume| {
        std::iter::once(&volume.overall).chain(&volume.components).chain(volume.parts.iter().map(|part| &part.row))
    });
    let worst = errors.filter_map(|row| row.relative_error).reduce(f64::max);
    let (class, word, sentence) = match report.correction.status.as_str() {
        "exact" => ("good", "exact", "The volume was restored exactly."),
        "already-met" => ("good", "exact", "The deformation has the wanted volume already."),
        "not-converged" => ("fair", "exact, not nearest", "The volume is exact, but a smaller correction may exist."),
        "preview" => ("fair", "approximate", "This is a preview: the volume is approximate."),
        _ => ("plain", "free", "The volume was left free."),
    };
    html! {
        p.headline {
            span class={ "badge " (class) } { (word) }
            " " (sentence)
            @if let Some(worst) = worst { " Relative error " (size(worst)) "." }
        }
    }
}

fn warnings(warnings: &[String]) -> Markup {
    html! {
        @if !warnings.is_empty() {
            section.warnings {
                h2 { (warnings.len()) @if warnings.len() == 1 { " warning" } @else { " warnings" } }
                ul { @for warning in warnings.iter().take(ROWS_SHOWN) { li { (warning) } } }
                @if warnings.len() > ROWS_SHOWN {
                    details {
                        summary { (warnings.len() - ROWS_SHOWN) " more" }
                        ul { @for warning in warnings.iter().skip(ROWS_SHOWN).take(ROWS_HELD) { li { (warning) } } }
                    }
                }
            }
        }
    }
}

/// The volume on its way, as bars.
fn volume_chart(row: &VolumeRow) -> Markup {
    let stages = [
        ("rest", Some(row.rest)),
        ("deformed", Some(row.posed)),
        ("final", Some(row.corrected)),
        ("written", row.written),
    ];
    let most = stages.iter().filter_map(|stage| stage.1).chain(row.target).map(f64::abs).fold(0.0, f64::max);
    let part = |volume: f64| if most > 0.0 { (100.0 * volume.abs() / most).clamp(0.0, 100.0) } else { 0.0 };
    html! {
        div.chart {
            @for (name, volume) in stages {
                @if let Some(volume) = volume {
                    div.bar {
                        span.name { (name) }
                        span.track {
                            span.fill style=(format!("width:{:.2}%", part(volume))) {}
                            @if let Some(target) = row.target {
                                span.target style=(format!("left:{:.2}%", part(target))) {}
                            }
                        }
                        span.value { (number(volume)) }
                        span.change { @if name != "rest" { (change(volume, row.rest)) } }
                    }
                }
            }
        }
        @if let Some(target) = row.target {
            p.note {
                span.target-key {} " wanted: " (short_number(target)) " (" (change(target, row.rest)) ")"
                @if let Some(error) = row.relative_error { "; relative error of the result " (size(error)) }
                @if let Some(written) = row.written {
                    ", of the written file " (size(((written - target) / target).abs()))
                }
                "."
            }
        }
    }
}

/// Canvas, buttons, legend. The program of the view finds them by their data attributes.
fn viewer(show: &Show, geometry: &Geometry, has_pictures: bool) -> Markup {
    let rest = show.poses[0].volume;
    let says = |name: &str, volume: Option<f64>| {
        let mut text = name.to_owned();
        if let Some(volume) = volume {
            let _ = write!(text, ": volume {}", significant(volume));
            let percent = rest.map_or(f64::NAN, |rest| 100.0 * (volume / rest - 1.0));
            if percent.is_finite() {
                let _ = write!(text, " ({})", signed_percent(percent));
            }
        }
        text
    };
    let toggle = |name: &str, label: &str, on: bool| {
        let key = &label[..1];
        html! {
            button type="button" disabled data-toggle=(name) aria-pressed=(on) title={ "key " (key) } { (label) }
        }
    };
    let [of, shown] = geometry.triangles;
    html! {
        figure.viewer data-viewer data-state="waiting" {
            div.stage {
                canvas tabindex="0" role="img" aria-label="The model in three dimensions. Arrow keys turn it, plus and minus zoom." {}
                p.message {
                    "This browser has no WebGL, so the model cannot be turned here. "
                    @if has_pictures { "The pictures below show it." } @else { "All numbers are below." }
                }
                noscript { p.message { "The model can be turned where scripts may run." } }
            }
            @if let Some(scale) = geometry.scale { (legend(scale)) }
            div.buttons {
                @if show.poses.len() > 1 {
                    div role="group" aria-label="Pose" {
                        @for (index, pose) in show.poses.iter().enumerate() {
                            button type="button" disabled data-pose=(index) data-says=(says(&pose.name, pose.volume))
                                aria-pressed=(index + 1 == show.poses.len()) title={ "key " (index + 1) } { (pose.name) }
                        }
                    }
                }
                div role="group" aria-label="View" {
                    @if geometry.has_lattice { (toggle("lattice", "Lattice", true)) }
                    @if geometry.scale.is_some() { (toggle("colour", "Colour", true)) }
                    (toggle("wireframe", "Wireframe", false))
                    (toggle("smooth", "Smooth", true))
                    button type="button" disabled data-home title="key 0" { "Reset" }
                }
            }
            figcaption {
                output data-said aria-live="polite" {}
                span.hint {
                    "Drag to turn, drag with the right button or two fingers to move, pinch to zoom, or click and use the wheel."
                    span.keys {
                        " Keys: arrows, + and −, 0, 1 to " (show.poses.len().min(9)) ", and the first letters of the buttons."
                    }
                }
                @if let Some(kind) = geometry.net {
                    span.hint {
                        @match kind {
                            NetKind::Springs => "Lines are springs. Nodes in ",
                            NetKind::Cage => "Lines are edges of the cage. Vertices in ",
                        }
                        "" span.held-key { "orange" } " are held, the others are free."
                    }
                }
                @if shown < of {
                    span.hint {
                        "The view has " (count(shown)) " of the model’s " (count(of)) " triangles; all numbers are of the whole model."
                    }
                }
                @if geometry.left_out > 0 {
                    span.hint { (count(geometry.left_out)) " faces with infinite or undefined coordinates are not shown." }
                }
            }
        }
    }
}

/// Ends and middle of the colours of local volume changes.
fn legend(scale: f64) -> Markup {
    let percent = |factor: f64| {
        let percent = (100.0 * (factor - 1.0)).round();
        format!("{}{}\u{202f}%", if percent < 0.0 { "−" } else { "+" }, percent.abs())
    };
    html! {
        div.legend data-legend hidden {
            span.label { "local volume" }
            span.ramp {}
            span.ends { span { (percent(1.0 / scale)) } span { "as at rest" } span { (percent(scale)) } }
        }
    }
}

fn request(job: &str) -> Markup {
    let phrases = request::phrases(job);
    html! {
        section {
            h2 { "What was asked" }
            @if !phrases.is_empty() { ul.phrases { @for phrase in phrases { li { (phrase) } } } }
            pre tabindex="0" { code { (job) } }
        }
    }
}

fn parts(volume: &VolumeReport, roles: &[ComponentHealth]) -> Markup {
    let is_component = |part: &PartRow| part.components.len() == 1 && part_role(&part.components, roles).is_empty();
    if volume.components.len() > 1 && volume.parts.iter().all(is_component) {
        return html! {}; // the table of components says the same
    }
    let named = volume.parts.iter().take(ROWS_HELD).map(|PartRow { components, row }| Row {
        name: ranges(components),
        role: part_role(components, roles),
        volumes: row,
    });
    let rows: Vec<Row> = named.collect();
    with_missing(rows_section("Parts", "components", &rows), volume.parts.len() - rows.len())
}

fn components(volume: &VolumeReport, roles: &[ComponentHealth]) -> Markup {
    // One component is the whole.
    let several = if volume.components.len() > 1 { &volume.components[..] } else { &[] };
    let role = |c: usize| roles.get(c).map_or("", |health| role(&health.role));
    let row = |(c, volumes)| Row { name: format!("{c}"), role: role(c), volumes };
    let rows: Vec<Row> = several.iter().enumerate().take(ROWS_HELD).map(row).collect();
    with_missing(rows_section("Components", "component", &rows), several.len() - rows.len())
}

/// A table with a note on what is missing in it.
fn with_missing(table: Markup, missing: usize) -> Markup {
    html! {
        (table)
        @if missing > 0 { p.note { "And " (count(missing)) " more, which the JSON report lists." } }
    }
}

fn role(role: &Role) -> &'static str {
    match role {
        Role::Solid => "solid",
        Role::Shell(_) => "shell",
        Role::Cavity { .. } => "cavity",
        Role::Inward => "inward",
        Role::Nothing => "encloses nothing",
    }
}

fn part_role(components: &[usize], roles: &[ComponentHealth]) -> &'static str {
    let is_cavity = |c: &usize| roles.get(*c).is_some_and(|health| matches!(health.role, Role::Cavity { .. }));
    let has_cavities = (0..roles.len()).any(|c| is_cavity(&c));
    match components {
        [] => "",
        all if all.iter().all(is_cavity) => "capacity",
        all if has_cavities && all.len() == roles.len() => "material",
        _ => "",
    }
}

/// Numbers as ranges: "0–3, 7".
fn ranges(numbers: &[usize]) -> String {
    /// Longer lists end in dots.
    const SHOWN: usize = 12;
    let mut sorted = numbers.to_vec();
    sorted.sort_unstable();
    let runs: Vec<&[usize]> = sorted.chunk_by(|a, b| a + 1 == *b).collect();
    let run = |run: &&[usize]| match run {
        [one] => one.to_string(),
        [first, .., last] => format!("{first}–{last}"),
        [] => String::new(),
    };
    let mut text = runs.iter().take(SHOWN).map(run).collect::<Vec<_>>().join(", ");
    if runs.len() > SHOWN {
        text += ", …";
    }
    text
}

/// What a table says of some components together.
struct Row<'a> {
    name: String,
    role: &'static str,
    volumes: &'a VolumeRow,
}

/// A table of volumes; nothing without rows.
fn rows_section(title: &str, name: &str, rows: &[Row]) -> Markup {
    let has_role = rows.iter().any(|row| !matches!(row.role, "" | "solid"));
    let has_target = rows.iter().any(|row| row.volumes.target.is_some());
    let has_written = rows.iter().any(|row| row.volumes.written.is_some());
    let optional = |value: Option<f64>, markup: fn(f64) -> Markup| value.map_or_else(|| html! { "–" }, markup);
    let table = |rows: &[Row]| {
        html! {
            div.scroll tabindex="0" { table {
                thead { tr {
                    th scope="col" { (name) }
                    @if has_role { th.text scope="col" { "role" } }
                    th scope="col" { "rest" }
                    th scope="col" { "deformed" }
                    @if has_target { th scope="col" { "wanted" } }
                    th scope="col" { "final" }
                    @if has_written { th scope="col" { "written" } }
                    th scope="col" { "change" }
                    @if has_target { th scope="col" { "relative error" } }
                } }
                tbody { @for Row { name, role, volumes } in rows { tr {
                    th scope="row" { (name) }
                    @if has_role { td.text { (role) } }
                    td { (number(volumes.rest)) }
                    td { (number(volumes.posed)) }
                    @if has_target { td { (optional(volumes.target, number)) } }
                    td { (number(volumes.corrected)) }
                    @if has_written { td { (optional(volumes.written, number)) } }
                    td { (change(volumes.corrected, volumes.rest)) }
                    @if has_target { td { (optional(volumes.relative_error, size)) } }
                } } }
            } }
        }
    };
    html! {
        @if !rows.is_empty() {
            section.wide {
                h2 { (title) " " span.count { (count(rows.len())) } }
                (table(&rows[..rows.len().min(ROWS_SHOWN)]))
                @if rows.len() > ROWS_SHOWN {
                    p.note { "The first " (ROWS_SHOWN) " of " (count(rows.len())) " are shown." }
                    details {
                        summary { "Show the other " (count(rows.len() - ROWS_SHOWN)) }
                        (table(&rows[ROWS_SHOWN..]))
                    }
                }
            }
        }
    }
}

fn correction(report: &Report) -> Markup {
    let correction = &report.correction;
    let length = |length: f64, relative: f64| {
        html! { (short_number(length)) " (" span title=(format!("{:?}", 100.0 * relative)) { (significant(100.0 * relative)) "\u{202f}%" } " of the extent)" }
    };
    html! {
        section {
            h2 { "Correction" }
            dl {
                dt { "method" } dd { (correction.method) }
                dt { "kept small" } dd { (correction.objective) }
                dt { "status" } dd { (correction.status) }
                dt { "steps" } dd { (count(correction.iterations)) }
                dt { "largest move" } dd { (length(correction.max_displacement, correction.max_displacement_relative)) }
                dt { "root mean square" } dd { (length(correction.rms_displacement, correction.rms_displacement_relative)) }
                @if let Some(residual) = correction.residual { dt { "residual" } dd { (size(residual)) " extents" } }
                dt { "error of points" } dd { (size(correction.point_error)) " extents" }
                dt { "foldings looked for" } dd { (report.folds) }
            }
        }
    }
}

fn timings(report: &Report) -> Markup {
    let stages = &report.timings_ms.0;
    let most = stages.iter().map(|stage| stage.1).fold(0.0, f64::max);
    let part = |ms: f64| if most > 0.0 { (100.0 * ms / most).clamp(0.0, 100.0) } else { 0.0 };
    let total: f64 = stages.iter().map(|stage| stage.1).sum();
    html! {
        @if !stages.is_empty() {
            section {
                h2 { "Time" }
                div.chart.times {
                    @for (stage, ms) in stages {
                        div.bar {
                            span.name { (stage) }
                            span.track { span.fill style=(format!("width:{:.2}%", part(*ms))) {} }
                            span.value { (milliseconds(*ms)) }
                        }
                    }
                }
                p.note { "Together " (milliseconds(total)) "." }
            }
        }
    }
}

fn milliseconds(ms: f64) -> Markup {
    let text = match ms {
        ms if ms >= 1e4 => format!("{:.1} s", ms / 1e3),
        ms if ms >= 100.0 => format!("{ms:.0} ms"),
        ms => format!("{ms:.1} ms"),
    };
    html! { span title=(format!("{ms:?} ms")) { (text) } }
}

fn health(model: &Health) -> Markup {
    let yes = |yes: bool| if yes { "yes" } else { "no" };
    let class = match model.verdict {
        Verdict::Ok => "good",
        verdict if verdict.is_preservable() => "fair",
        _ => "poor",
    };
    let corner = |corner: &[f64; 3]| {
        html! { "(" @for (axis, x) in corner.iter().enumerate() { @if axis > 0 { ", " } (short_number(*x)) } ")" }
    };
    html! {
        section {
            h2 { "The model as it was read" }
            p { span class={ "badge " (class) } { (if model.verdict.is_preservable() { "volume defined" } else { "no volume" }) }
                " " (sentence(model.verdict)) }
            @if !model.warnings.is_empty() { ul { @for warning in model.warnings.iter().take(ROWS_SHOWN) { li { (warning) } } } }
            dl.three {
                div { dt { "format" } dd { (model.format) } }
                div { dt { "vertices" } dd { (count(model.vertices)) } }
                div { dt { "faces" } dd { (count(model.faces)) } }
                div { dt { "triangles" } dd { (count(model.triangles)) } }
                div { dt { "components" } dd { (count(model.components)) } }
                div { dt { "closed" } dd { (yes(model.closed)) } }
                div { dt { "oriented" } dd { (yes(model.oriented)) } }
                div { dt { "balanced" } dd { (yes(model.balanced)) } }
                @if let Some(genus) = model.genus { div { dt { "handles" } dd { (genus) } } }
                div { dt { "boundary edges" } dd { (count(model.boundary_edges)) } }
                div { dt { "boundary loops" } dd { (count(model.boundary_loops)) } }
                div { dt { "non-manifold edges" } dd { (count(model.nonmanifold_edges)) } }
                div { dt { "faces without area" } dd { (count(model.zero_area_faces)) } }
                div { dt { "unused vertices" } dd { (count(model.unused_vertices)) } }
                div { dt { "coincident vertices" } dd { (count(model.coincident_vertices)) } }
                div { dt { "area" } dd { (short_number(model.area)) } }
                @if let Some(volume) = &model.volume { div { dt { "signed volume" } dd { (short_number(volume.total)) } } }
                @if let Some([low, high]) = &model.bounds {
                    div { dt { "lowest corner" } dd { (corner(low)) } }
                    div { dt { "highest corner" } dd { (corner(high)) } }
                }
            }
        }
    }
}

/// The verdict as a sentence of its own.
fn sentence(verdict: Verdict) -> String {
    let text = verdict.sentence();
    let (first, rest) = text.split_at(1);
    format!("{}{rest}.", first.to_uppercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_a_row_are_ranges() {
        for (numbers, text) in [(&[][..], ""), (&[3], "3"), (&[0, 1, 2], "0–2"), (&[7, 0, 1, 2, 9], "0–2, 7, 9")] {
            assert_eq!(ranges(numbers), text);
        }
        let odd: Vec<usize> = (0..100).map(|k| 2 * k + 1).collect();
        assert!(ranges(&odd).ends_with("21, 23, …"));
    }
}
