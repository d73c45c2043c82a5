//! Evaluations on unseen objects, by category.

use crate::html::{count, escape};
use crate::page::table;
use crate::summary::RunSummary;

/// Evaluations on unseen objects, by category.
pub(super) fn evaluations(summary: &RunSummary) -> String {
    let tables = summary.evaluations.iter().map(|(split, summary)| {
        let names: Vec<&String> = summary.mean_of_objects.figures.keys().collect();
        let heads: Vec<&str> =
            ["category", "objects"].into_iter().chain(names.iter().map(|name| name.as_str())).collect();
        let means =
            [("mean of categories", &summary.mean_of_categories), ("mean of objects", &summary.mean_of_objects)];
        let categories = summary.categories.iter().map(|(name, score)| (name.as_str(), score));
        let rows: Vec<Vec<String>> = categories
            .chain(means)
            .map(|(name, score)| {
                let figure =
                    |key: &&String| score.figures.get(*key).map_or(String::new(), |value| format!("{value:.4}"));
                [name.to_owned(), count(score.objects)].into_iter().chain(names.iter().map(figure)).collect()
            })
            .collect();
        format!(
            "<h3>{} objects of the {} split</h3>{}",
            count(summary.mean_of_objects.objects),
            escape(split),
            table(&heads, &rows)
        )
    });
    tables.collect()
}
