//! A page that leads to the results of several jobs.

use maud::{Markup, html};
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};

use crate::page::document;

/// One job on an index page.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IndexEntry {
    /// Its name.
    pub title: String,
    /// What it shows, in a sentence.
    pub sentence: String,
    /// Path of a picture, relative to the index page.
    pub picture: Option<String>,
    /// What became of the volume, one line each.
    pub lines: Vec<String>,
    /// Files: what they are, and their paths relative to the index page. The first is where title and picture lead.
    pub files: Vec<(String, String)>,
}

/// An index page in the style of [`page`](crate::page()). Pictures and files are linked, not embedded: they stand beside it.
#[must_use]
pub fn index(title: &str, entries: &[IndexEntry]) -> String {
    document(
        title,
        None,
        html! {
            header { p.kicker { "Isochor" } h1 { (title) } }
            main {
                @if entries.is_empty() { p { "Nothing is here yet." } }
                div.gallery { @for entry in entries { (card(entry)) } }
            }
            footer { p { "Pages and pictures here need no network and use none." } }
        },
    )
}

fn card(entry: &IndexEntry) -> Markup {
    let IndexEntry { title, sentence, picture, lines, files } = entry;
    let main = files.first().map(|(_, path)| link(path));
    let picture = picture.as_ref().map(|path| html! { img loading="lazy" alt=(sentence) src=(link(path)); });
    html! {
        article {
            @if let Some(picture) = picture {
                @if let Some(main) = &main { a href=(main) { (picture) } } @else { (picture) }
            }
            h2 { @if let Some(main) = &main { a href=(main) { (title) } } @else { (title) } }
            p { (sentence) }
            @if !lines.is_empty() { pre { code { (lines.join("\n")) } } }
            @if !files.is_empty() {
                ul.files { @for (what, path) in files { li { a href=(link(path)) { (what) } } } }
            }
        }
    }
}

/// A relative path as a link: whatever it holds, it stays a path.
fn link(path: &str) -> String {
    const KEPT: &AsciiSet = &NON_ALPHANUMERIC.remove(b'/').remove(b'-').remove(b'_').remove(b'.').remove(b'~');
    format!("./{}", utf8_percent_encode(path, KEPT))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_paths_whatever_they_hold() {
        for (path, expected) in [
            ("ball.html", "./ball.html"),
            ("a folder/50 %?#.png", "./a%20folder/50%20%25%3F%23.png"),
            ("javascript:alert(1)", "./javascript%3Aalert%281%29"),
            ("\"><b>", "./%22%3E%3Cb%3E"),
            ("ö", "./%C3%B6"),
        ] {
            assert_eq!(link(path), expected);
        }
    }
}
