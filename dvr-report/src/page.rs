//! The page: one HTML file with its style and its scripts inside.

use std::fmt::Write;

use crate::chart::CHART_STYLE;
use crate::html::escape;

/// Style and scripts of every page.
const STYLE: &str = include_str!("../assets/report.css");
const SCRIPT: &str = include_str!("../assets/report.js");
const VIEWER: &str = include_str!("../assets/viewer.js");
const DECODER: &str = include_str!("../assets/mesh.js");
const GLB: &str = include_str!("../assets/glb.js");

/// The mark in the browser's tab: a small cube.
const ICON: &str = "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E%3Cpath d='M8 \
                    1l6 3.5v7L8 15l-6-3.5v-7z' \
                    fill='%232563d9'/%3E%3Cpath d='M8 8v7M8 8l6-3.5M8 8L2 4.5' stroke='%23fff' \
                    stroke-width='1.2'/%3E%3C/svg%3E";

/// A part of a page with a heading.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Section {
    /// The heading.
    pub title: String,
    /// What is below it, as HTML: text from outside must have gone through `html::escape`.
    pub html: String,
}

impl Section {
    /// A section of HTML.
    pub fn new(title: impl Into<String>, html: impl Into<String>) -> Self {
        Self { title: title.into(), html: html.into() }
    }
}

/// A self-contained page.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Page {
    /// Heading, and the title of the browser's tab.
    pub title: String,
    /// A line below the heading, plain text.
    pub subtitle: String,
    /// What the page holds; those with a title have a link at its top.
    pub sections: Vec<Section>,
    /// The last line, plain text: what made the page.
    pub footer: String,
}

impl Page {
    /// The whole file.
    pub fn to_html(&self) -> String {
        let mut links = String::new();
        let mut body = String::new();
        for (i, section) in self.sections.iter().enumerate() {
            if section.title.is_empty() {
                let _ = writeln!(body, "<section>{}</section>", section.html);
                continue;
            }
            let title = escape(&section.title);
            let _ = write!(links, "<a href=\"#s{i}\">{title}</a>");
            let _ = writeln!(body, "<section id=\"s{i}\"><h2>{title}</h2>{}</section>", section.html);
        }
        let (title, subtitle) = (escape(&self.title), escape(&self.subtitle));
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n\
             <link rel=\"icon\" href=\"{ICON}\">\n<style>\n{STYLE}{CHART_STYLE}</style>\n</head>\n<body>\n\
             <header><div><h1>{title}</h1><p>{subtitle}</p></div><nav>{links}</nav></header>\n<main>\n{body}</main>\n\
             <footer>{}</footer>\n<script>\n{DECODER}{GLB}{VIEWER}{SCRIPT}</script>\n</body>\n</html>\n",
            escape(&self.footer)
        )
    }
}

/// A table of text: the heads, then the rows. The first column is text, the others are numbers.
pub fn table(heads: &[&str], rows: &[Vec<String>]) -> String {
    let mut html = String::from("<div class=\"scroll\"><table><thead><tr>");
    heads.iter().for_each(|head| html += &format!("<th>{}</th>", escape(head)));
    html += "</tr></thead><tbody>";
    for row in rows {
        html += "<tr>";
        row.iter().for_each(|cell| html += &format!("<td>{}</td>", escape(cell)));
        html += "</tr>";
    }
    html + "</tbody></table></div>"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_asks_nothing_of_the_network_and_escapes_its_text() {
        let page = Page {
            title: "<b>mug</b>".into(),
            sections: vec![Section::new("a & b", table(&["run"], &[vec!["<i>".into()]]))],
            ..Page::default()
        };
        let html = page.to_html();
        assert!(html.contains("<title>&lt;b&gt;mug&lt;/b&gt;</title>") && html.contains("a &amp; b"));
        assert!(html.contains("<td>&lt;i&gt;</td>"));
        for outside in ["src=\"http", "href=\"http", "url(http", "@import", "fetch(\"http"] {
            assert!(!html.contains(outside), "{outside}");
        }
        assert!(html.len() < 60_000, "an empty page weighs {} bytes", html.len());
    }
}
