//! A drawing on a page: its style, its numbers as CSV, and buttons to save both.

use crate::html::escape;

/// The style of all charts. A page that holds charts includes it once; [`Chart::to_svg`](super::Chart::to_svg) brings it
/// along.
pub const CHART_STYLE: &str = include_str!("../../assets/chart.css");

/// A field of a CSV file, quoted where it must be (RFC 4180).
pub(super) fn csv_field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// A drawing with its numbers, for a page.
pub(super) fn figure(title: &str, svg: &str, csv: &str) -> String {
    format!(
        "<figure class=\"chart\" data-name=\"{}\">{svg}<figcaption><button type=\"button\" \
         data-save=\"svg\">SVG</button>\
         <button type=\"button\" data-save=\"csv\">CSV</button></figcaption><template>{}</template></figure>\n",
        escape(&file_name(title)),
        escape(csv),
    )
}

/// A title as a file's name: lower case, words joined by hyphens.
pub fn file_name(title: &str) -> String {
    let mut name = String::new();
    for character in title.chars().flat_map(char::to_lowercase) {
        if character.is_ascii_alphanumeric() {
            name.push(character);
        } else if !name.ends_with('-') && !name.is_empty() {
            name.push('-');
        }
    }
    let name = name.trim_end_matches('-');
    if name.is_empty() { "chart".into() } else { name.into() }
}
