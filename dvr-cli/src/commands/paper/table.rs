//! The table of single pictures, as Markdown, CSV and a page.

use std::collections::BTreeSet;
use std::fmt::Write;

use anyhow::Result;
use dvr_report::chart::median;
use dvr_report::{Page, Section, jpeg, table};
use image::RgbImage;

use super::row::{Made, Trained};
use super::systems::{Group, SOURCES, System};

/// A system and what its seeds came to.
pub struct Line {
    pub system: &'static System,
    pub made: Vec<Made>,
    /// What the seeds said that failed.
    pub failures: Vec<String>,
}

/// All lines.
pub struct Table {
    pub lines: Vec<Line>,
    /// How many objects were learned by heart, where the table is of these.
    pub by_heart: Option<usize>,
}

/// A figure: its key in summaries, its head, its factor, its decimals.
type Column = (&'static str, &'static str, f64, usize);

/// The figures of the table. Papers print Chamfer-L1 times ten.
const COLUMNS: [Column; 5] = [
    ("chamfer_l1", "Chamfer-L1 (x10)", 10.0, 3),
    ("normal_consistency", "normals", 1.0, 3),
    ("f_score_0.01", "F-score at .01", 1.0, 3),
    ("volume_iou", "volume IoU", 1.0, 3),
    ("silhouette_iou", "silhouette IoU", 1.0, 3),
];

impl Line {
    /// The means of categories of a figure, of each seed.
    fn values(&self, key: &str) -> Vec<f64> {
        self.made.iter().filter_map(|made| made.summary.mean_of_categories.figures.get(key).copied()).collect()
    }

    /// Objects that were measured, and all.
    fn objects(&self) -> Option<(usize, usize)> {
        let mean = &self.made.first()?.summary.mean_of_objects;
        Some((mean.objects, mean.objects + mean.unmeasured))
    }

    fn cells(&self) -> Vec<String> {
        let System { group, title, published, .. } = self.system;
        let figure = |&(key, _, factor, decimals): &Column| {
            let scaled = self.values(key).into_iter().map(|value| factor * value).collect();
            if self.made.is_empty() { "failed".to_owned() } else { with_range(scaled, decimals) }
        };
        let minutes = self.made.iter().filter_map(|made| Some(made.trained.as_ref()?.cpu_seconds / 60.0)).collect();
        let steps = self.made.first().and_then(|made| made.trained.as_ref()).map_or(0, |trained| trained.steps);
        let objects = self.objects().map_or_else(String::new, |(measured, all)| match all - measured {
            0 => measured.to_string(),
            _ => format!("{measured} of {all}"),
        });
        let published = published.map_or_else(String::new, |(value, source)| format!("{value:.3}{}", source.mark()));
        let steps = if steps > 0 { steps.to_string() } else { String::new() };
        [group.name().to_owned(), (*title).to_owned(), objects, steps, with_range(minutes, 1)]
            .into_iter()
            .chain(COLUMNS.iter().map(figure))
            .chain([published])
            .collect()
    }
}

/// The median, and the range where there is one.
fn with_range(mut values: Vec<f64>, decimals: usize) -> String {
    values.sort_by(f64::total_cmp);
    match values[..] {
        [] => String::new(),
        [one] => format!("{one:.decimals$}"),
        [low, .., high] => format!("{:.decimals$} ({low:.decimals$}-{high:.decimals$})", median(&values)),
    }
}

impl Table {
    fn heads() -> Vec<&'static str> {
        let first = ["from", "system", "objects", "steps", "training, CPU min"];
        first.into_iter().chain(COLUMNS.iter().map(|column| column.1)).chain(["published"]).collect()
    }

    /// Where the figures come from.
    fn origins(&self) -> String {
        let made = self.lines.iter().flat_map(|line| &line.made);
        let all: BTreeSet<&str> = made.flat_map(|made| &made.summary.origins).map(String::as_str).collect();
        all.into_iter().collect::<Vec<_>>().join("; ")
    }

    /// What is measured.
    fn about(&self) -> String {
        let of = match self.by_heart {
            Some(count) => format!("{count} objects that were trained on"),
            None => "Objects that training never saw".to_owned(),
        };
        let seeds = self.lines.iter().map(|line| line.made.len()).max().unwrap_or(0);
        let seeds = if seeds > 1 { format!("median of {seeds} seeds (range)") } else { "one seed".to_owned() };
        format!("{of}, one picture each; means of categories, {seeds}")
    }

    /// The order of the systems of a group by Chamfer-L1, here and as published.
    fn orders(&self) -> Vec<String> {
        let of = |group: Group| -> Option<String> {
            let lines: Vec<&Line> = self.lines.iter().filter(|line| line.system.group == group).collect();
            let mut here: Vec<(f64, &str)> = Vec::new();
            let mut published: Vec<(f64, &str)> = Vec::new();
            for line in lines {
                let mut values = line.values("chamfer_l1");
                values.sort_by(f64::total_cmp);
                if let (Some((figure, _)), false) = (line.system.published, values.is_empty()) {
                    here.push((median(&values), line.system.row));
                    published.push((figure, line.system.row));
                }
            }
            if here.len() < 2 {
                return None;
            }
            let named = |mut all: Vec<(f64, &str)>| {
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                all.into_iter().map(|(_, row)| row).collect::<Vec<_>>().join(", ")
            };
            let (here, published) = (named(here), named(published));
            let name = group.name();
            Some(match here == published {
                true => format!("{name}: {here}, from best to worst by Chamfer-L1, as published."),
                false => format!("{name}: {here}, from best to worst by Chamfer-L1; as published {published}."),
            })
        };
        [Group::Pictures, Group::DepthMaps, Group::Shapes].into_iter().filter_map(of).collect()
    }

    /// Markdown.
    pub fn markdown(&self) -> String {
        let heads = Self::heads();
        let mut text = format!("{}. {}.\n\n| {} |\n", self.origins(), self.about(), heads.join(" | "));
        let _ = writeln!(text, "|{}", "---|".repeat(heads.len()));
        for line in &self.lines {
            let _ = writeln!(text, "| {} |", line.cells().join(" | "));
        }
        let _ = writeln!(text, "\n{SOURCES}");
        for order in self.orders() {
            let _ = write!(text, "\n- {order}");
        }
        for line in &self.lines {
            for failure in &line.failures {
                let _ = write!(text, "\n- failed: {failure}");
            }
        }
        text + "\n"
    }

    /// A row for each system, seed and category, in full precision, lengths in edges of the object cube.
    ///
    /// # Errors
    /// When it cannot be written as CSV.
    pub fn csv(&self) -> Result<String> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let first = ["row", "from", "seed", "steps", "training_seconds", "training_cpu_seconds", "parameters"];
        let first = first.into_iter().chain(["category", "objects"]);
        let keys = COLUMNS.iter().map(|column| column.0);
        writer.write_record(first.chain(keys).chain(["published_chamfer_l1_x10"]))?;
        for line in &self.lines {
            for (seed, made) in line.made.iter().enumerate() {
                let training = match &made.trained {
                    Some(Trained { steps, seconds, cpu_seconds, parameters }) => {
                        [steps.to_string(), seconds.to_string(), cpu_seconds.to_string(), parameters.to_string()]
                    }
                    None => [const { String::new() }; 4],
                };
                let all = made.summary.categories.iter().map(|(name, score)| (name.as_str(), score));
                let mean = [("mean of categories", &made.summary.mean_of_categories)];
                for (category, score) in all.chain(mean) {
                    let start = [line.system.row, line.system.group.name(), &seed.to_string()].map(str::to_owned);
                    let start = start.into_iter().chain(training.clone());
                    let start = start.chain([category.to_owned(), score.objects.to_string()]);
                    let figure = |column: &Column| score.figures.get(column.0).map_or(String::new(), f64::to_string);
                    let published = line.system.published.map_or(String::new(), |(value, _)| value.to_string());
                    writer.write_record(start.chain(COLUMNS.iter().map(figure)).chain([published]))?;
                }
            }
        }
        Ok(String::from_utf8(writer.into_inner()?)?)
    }

    /// The page.
    ///
    /// # Errors
    /// When the pictures cannot be encoded.
    pub fn page(&self, pictures: Option<&RgbImage>) -> Result<String> {
        let rows: Vec<Vec<String>> = self.lines.iter().map(Line::cells).collect();
        let orders: String = self.orders().iter().map(|order| format!("<li>{order}</li>")).collect();
        let figures = format!(
            "<p>{}.</p><div class=\"wide\">{}</div><p>{SOURCES}</p><ul>{orders}</ul>",
            self.about(),
            table(&Self::heads(), &rows)
        );
        let mut sections = vec![Section::new("Figures", figures)];
        if let Some(pictures) = pictures {
            let shown = self.lines.iter().filter(|line| line.made.iter().any(|made| made.trained.is_some()));
            let shown = shown.filter(|line| line.failures.is_empty()).map(|line| line.system.title);
            let names: Vec<&str> = ["the picture"].into_iter().chain(shown).collect();
            let html = format!(
                "<p>From top to bottom: {}; shapes as normals.</p><div class=\"wide\"><img alt=\"Shapes of the same pictures by all systems\" \
                 src=\"{}\" style=\"max-width:100%\"></div>",
                names.join(", "),
                jpeg(pictures)?
            );
            sections.push(Section::new("The same pictures", html));
        }
        let page = Page {
            title: "A shape from a single picture".into(),
            subtitle: self.origins(),
            sections,
            footer: "This file is complete: it loads nothing from the network.".into(),
        };
        Ok(page.to_html())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use dvr_core::Split;
    use dvr_train::{MeanScore, Measurement, Summary};

    use super::super::systems::SYSTEMS;
    use super::*;

    fn made(chamfer: f64) -> Made {
        let figures = BTreeMap::from([("chamfer_l1".to_owned(), chamfer)]);
        let mean = MeanScore { objects: 3, unmeasured: 1, figures };
        let summary = Summary {
            measurement: Measurement::new("a".into(), 5, Split::Test, 0, 64, 4),
            categories: BTreeMap::from([("chair".to_owned(), mean.clone())]),
            mean_of_categories: mean.clone(),
            mean_of_objects: mean,
            origins: BTreeSet::from(["a machine".to_owned()]),
        };
        Made { trained: Some(Trained { steps: 5, seconds: 40.0, cpu_seconds: 90.0, parameters: 7 }), summary }
    }

    #[test]
    fn a_table_has_medians_ranges_published_figures_and_orders() {
        let line = |row: &str, chamfers: &[f64]| Line {
            system: SYSTEMS.iter().find(|system| system.row == row).unwrap(),
            made: chamfers.iter().map(|&chamfer| made(chamfer)).collect(),
            failures: if chamfers.is_empty() { vec!["dvr train of drc.0: no <memory>".into()] } else { Vec::new() },
        };
        let lines = vec![line("drc", &[]), line("softras", &[0.05, 0.07, 0.06]), line("dvr", &[0.08])];
        let table = Table { lines, by_heart: None };
        let text = table.markdown();
        assert!(text.contains("| 3 of 4 | 5 | 1.5 (1.5-1.5) | 0.600 (0.500-0.700) |"), "{text}");
        assert!(
            text.contains("2D: softras, dvr, from best to worst by Chamfer-L1; as published dvr, softras."),
            "{text}"
        );
        assert!(text.contains("| failed | failed |") && text.contains("- failed: dvr train of drc.0"), "{text}");
        assert!(text.contains("| 0.239 |") && text.contains("| 0.553 (a) |"), "{text}");
        let csv = table.csv().unwrap();
        assert_eq!(csv.lines().count(), 1 + 4 * 2, "{csv}");
        assert!(csv.contains("softras,2D,1,5,40,90,7,chair,3,0.07,,,,,0.266"), "{csv}");
        let page = table.page(Some(&RgbImage::new(8, 8))).unwrap();
        assert!(page.contains("data:image/jpeg;base64,") && page.contains("SoftRas"));
    }
}
