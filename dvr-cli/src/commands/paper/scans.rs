//! The table of many views against scans: reconstructions of photographs, and surfaces of other programs' points.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;
use dvr_core::dataset::{ReadOptions, digest_of_scene};
use dvr_core::files::{Claim, FolderKind, OutputFolder, check_beside_data, write_bytes_atomically};
use dvr_core::metrics::dtu::DtuReference;
use dvr_core::record::{Digest, RecordKey};
use dvr_report::{Page, Section, table};
use dvr_train::Observer;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::call::Caller;
use crate::args::{NamedCloud, PaperArgs};
use crate::commands::eval_dtu::named_scan;
use crate::commands::kept_row::{Kept, Standing, keep, kept};
use crate::commands::provenance::{origin, record_key};
use crate::progress::Progress;

/// What is written beside the runs.
const FILES: [&str; 3] = ["table.md", "table.csv", "report.html"];

/// How much of a surface is cut away, by the depth of its octree: what the publication compares.
const TRIMS: [u32; 3] = [0, 5, 7];

/// What makes the surface of a row.
#[derive(Clone, Debug, PartialEq)]
enum Maker {
    /// `dvr train --method METHOD`.
    Method(&'static str),
    /// `dvr points2mesh` of our own stereo depth maps.
    OwnPoints { trim: u32 },
    /// `dvr points2mesh` of another program's points.
    Cloud { name: String, file: PathBuf, trim: u32 },
}

/// Methods that have a row each, with the CPU minutes that a scene of 64 to 800 pixels takes at most.
const METHODS: [(&str, f64); 3] = [("hull", 0.5), ("classic", 3.0), ("grid", 2.0)];

/// CPU minutes of a surface of points.
const POISSON: f64 = 1.5;

/// What a surface is measured by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Judge {
    /// DTU's protocol and scans, in millimetres.
    Dtu,
    /// The true surface, in edges of the object cube.
    Truth,
    /// Verified points, of which only the distance to the surface is known, in the units of the files.
    Points,
}

/// The figures of a row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Figures {
    judge: Judge,
    /// Mean distance of the surface to the scan; unknown of points.
    accuracy: Option<f64>,
    /// Mean distance of the scan, or of the points, to the surface.
    completeness: f64,
    /// Wall seconds of what made the surface.
    seconds: f64,
}

/// A row of one scene.
struct Row {
    scene: PathBuf,
    /// The name of the scene's folder.
    title: String,
    /// The number of DTU's scan, where it is judged by one.
    scan: Option<u32>,
    /// Verified points in its folder, where they are asked for.
    points: Option<PathBuf>,
    maker: Maker,
}

/// What the scenes' files, and those of the scans, are.
struct Contents {
    scene: Digest,
    scan: Option<Digest>,
}

impl Maker {
    /// Its name in tables and of folders.
    fn name(&self) -> String {
        match self {
            Self::Method(method) => (*method).to_owned(),
            Self::OwnPoints { trim } => format!("stereo-poisson-{trim}"),
            Self::Cloud { name, trim, .. } => format!("{name}-{trim}"),
        }
    }

    fn title(&self) -> String {
        match self {
            Self::Method("hull") => "visual hull".into(),
            Self::Method("classic") => "DVR, the paper's network".into(),
            Self::Method("grid") => "dvr, the default".into(),
            Self::Method(other) => (*other).to_owned(),
            Self::OwnPoints { trim } => format!("dvr's stereo + sPSR, trimmed at {trim}"),
            Self::Cloud { name, trim, .. } => format!("{name} + sPSR, trimmed at {trim}"),
        }
    }

    fn minutes(&self) -> f64 {
        match self {
            Self::Method(method) => {
                METHODS.iter().find(|(name, _)| name == method).map_or(0.0, |(_, minutes)| *minutes)
            }
            Self::OwnPoints { .. } | Self::Cloud { .. } => POISSON,
        }
    }
}

/// Makes the table, or says what that takes.
pub fn run(args: &PaperArgs, cancellation: &Cancellation) -> Result<ExitCode> {
    if args.steps.is_some() || args.encoder.is_some() || args.by_heart.is_some() {
        bail!("--steps, --encoder and --by-heart are for --table shapenet");
    }
    if args.seeds != 1 {
        bail!("--table dtu is made of one seed; compare seeds with `dvr bench --seeds {}`", args.seeds);
    }
    let rows: Vec<Row> =
        args.data.iter().map(|scene| rows_of(args, scene)).collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
    let is_twice = |(i, row): &(usize, &Row)| rows[..*i].iter().any(|other| other.folder() == row.folder());
    if let Some((_, twice)) = rows.iter().enumerate().find(is_twice) {
        bail!("two rows are called {}: give scenes, and clouds, different names", twice.folder());
    }
    if let Some(name) = args.points.as_ref().filter(|_| rows.iter().all(|row| row.points.is_none())) {
        bail!("--points {}: none of the scenes has a file of this name in its folder", name.display());
    }
    for scene in &args.data {
        check_beside_data(&args.out, scene)?;
    }
    if args.plan {
        for row in &rows {
            println!("{:<32}{:>6.1}  {}", row.folder(), row.maker.minutes(), row.maker.title());
        }
        println!("about {:.0} CPU minutes", rows.iter().map(|row| row.maker.minutes()).sum::<f64>());
        return Ok(ExitCode::SUCCESS);
    }
    let _writing = OutputFolder::claim(&args.out, FolderKind::PaperTable, Claim::NewOrContinue, &FILES)?;
    let mut progress = Progress::new();
    progress.phase("reading the scenes", args.data.len());
    let mut contents: BTreeMap<&Path, Contents> = BTreeMap::new();
    for (i, scene) in args.data.iter().enumerate() {
        let scan = match (&args.reference, rows.iter().find(|row| row.scene == *scene).and_then(|row| row.scan)) {
            (Some(folder), Some(scan)) => {
                let files = DtuReference::files(folder, scan);
                let digests =
                    files.iter().map(|file| Digest::of_file(file)).collect::<std::result::Result<Vec<_>, _>>()?;
                Some(Digest::of_all(&digests))
            }
            _ => None,
        };
        contents.insert(scene, Contents { scene: digest_of_scene(scene, &ReadOptions::default(), None)?, scan });
        progress.progress(i + 1, &scene_title(scene));
    }
    let rows: Vec<(Row, RecordKey)> = rows
        .into_iter()
        .map(|row| {
            let key = row.key(args, &contents[row.scene.as_path()])?;
            Ok((row, key))
        })
        .collect::<Result<_>>()?;
    let mut standing = Standing::default();
    for (row, key) in &rows {
        standing.count(&row.folder(), &kept::<Figures>(&row.record(args, "figures"), key)?);
    }
    eprintln!("surfaces: {standing}");
    progress.phase("rows", rows.len());
    let mut made = Vec::new();
    for (i, (row, key)) in rows.iter().enumerate() {
        let figures = row.make(args, key, cancellation, &mut |said| progress.progress(i, said));
        if cancellation.is_cancelled() {
            eprintln!("finished rows are kept in {}; the same command continues", args.out.display());
            cancellation.check()?;
        }
        if let Err(error) = &figures {
            progress.note(&format!("failed: {error:#}"));
        }
        made.push((row, key, figures.map_err(|error| format!("{error:#}"))));
        progress.progress(i + 1, &row.folder());
    }
    write_table(args, &made)?;
    Ok(if made.iter().all(|(.., figures)| figures.is_ok()) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The rows of a scene: those that were asked for.
fn rows_of(args: &PaperArgs, scene: &Path) -> Result<Vec<Row>> {
    let title = scene_title(scene);
    let number = named_scan(Path::new(&title));
    let scan = match &args.reference {
        None => None,
        Some(folder) => Some(scan_of(folder, number).with_context(|| scene.display().to_string())?),
    };
    let methods = METHODS.iter().map(|(name, _)| Maker::Method(name));
    let own = TRIMS.iter().map(|&trim| Maker::OwnPoints { trim });
    let mut all: Vec<Maker> = methods.chain(own).collect();
    for NamedCloud { name, file } in &args.clouds {
        let number = match number.or(scan) {
            Some(number) => format!("{number:03}"),
            None if file.contains("{scan}") => {
                bail!("--cloud {name}={file}: the name of {} has no number behind `scan`", scene.display())
            }
            None => String::new(),
        };
        let file = PathBuf::from(file.replace("{scene}", &title).replace("{scan}", &number));
        all.extend(TRIMS.iter().map(|&trim| Maker::Cloud { name: name.clone(), file: file.clone(), trim }));
    }
    if let Some(unknown) = args.rows.iter().find(|row| !all.iter().any(|maker| maker.name() == **row)) {
        let known: Vec<String> = all.iter().map(Maker::name).collect();
        bail!("--rows {unknown}: there is no such row; the rows are {}", known.join(", "));
    }
    all.retain(|maker| args.rows.is_empty() || args.rows.contains(&maker.name()));
    for maker in &all {
        if let Maker::Cloud { file, .. } = maker
            && !file.is_file()
        {
            bail!("{}: there is no such file (--cloud, for {})", file.display(), scene.display());
        }
    }
    let folder = if scene.is_file() { scene.parent().unwrap_or(Path::new("")) } else { scene };
    let points = args.points.as_ref().map(|name| folder.join(name)).filter(|file| file.is_file());
    let row = |maker| Row { scene: scene.to_owned(), title: title.clone(), scan, points: points.clone(), maker };
    Ok(all.into_iter().map(row).collect())
}

/// The scan of a scene whose name has this number, if any.
fn scan_of(folder: &Path, number: Option<u32>) -> Result<u32> {
    let scans = DtuReference::scans(folder);
    match (number, &scans[..]) {
        (Some(number), _) if scans.contains(&number) => Ok(number),
        (None, [only]) => Ok(*only),
        (Some(number), _) => bail!("--reference {} has no scan {number}", folder.display()),
        (None, _) => bail!(
            "its name has no number behind `scan`, and --reference {} has {} scans",
            folder.display(),
            scans.len()
        ),
    }
}

/// The name of a scene's folder.
fn scene_title(scene: &Path) -> String {
    let whole = scene.canonicalize().unwrap_or_else(|_| scene.to_owned());
    let folder = if whole.is_file() { whole.parent().unwrap_or(&whole) } else { &whole };
    folder.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}

impl Row {
    fn folder(&self) -> String {
        format!("{}.{}", self.title, self.maker.name())
    }

    /// What the row is made of.
    fn key(&self, args: &PaperArgs, contents: &Contents) -> Result<RecordKey> {
        let cloud = self.cloud()?;
        // The scene's digest has the points themselves.
        let points = self.points.as_ref().and(args.points.as_ref());
        let settings = json!({"row": self.maker.name(), "cloud": cloud, "scan": contents.scan, "points": points});
        record_key(contents.scene.clone(), &settings, "cpu")
    }

    /// The key of the surface alone, whatever it is judged by.
    fn surface_key(&self, key: &RecordKey) -> Result<RecordKey> {
        let settings = Digest::of_json(&json!({"surface": self.maker.name(), "cloud": self.cloud()?}));
        Ok(RecordKey { settings, ..key.clone() })
    }

    /// The contents of another program's points.
    fn cloud(&self) -> Result<Option<Digest>> {
        match &self.maker {
            Maker::Cloud { file, .. } => Ok(Some(Digest::of_file(file)?)),
            Maker::Method(_) | Maker::OwnPoints { .. } => Ok(None),
        }
    }

    fn record(&self, args: &PaperArgs, what: &str) -> PathBuf {
        args.out.join("runs").join(format!("{}.{what}.json", self.folder()))
    }

    /// The surface, made where it is not there; and the wall seconds that it took.
    fn surface(
        &self,
        args: &PaperArgs,
        key: &RecordKey,
        caller: &Caller<'_>,
        hear: &mut dyn FnMut(&str),
    ) -> Result<(PathBuf, f64)> {
        let runs = args.out.join("runs");
        std::fs::create_dir_all(&runs).with_context(|| runs.display().to_string())?;
        let subject = match &self.maker {
            Maker::Method(_) => runs.join(self.folder()),
            Maker::OwnPoints { .. } | Maker::Cloud { .. } => runs.join(format!("{}.ply", self.folder())),
        };
        let (record, key) = (self.record(args, "surface"), self.surface_key(key)?);
        if let Kept::Row(seconds) = kept::<f64>(&record, &key)?
            && subject.exists()
        {
            return Ok((subject, seconds));
        }
        let mut arguments: Vec<OsString> = match &self.maker {
            Maker::Method(method) => {
                let own = ["--method", method, "--no-report", "--overwrite"].map(OsString::from);
                ["train".into(), self.scene.clone().into()].into_iter().chain(own).collect()
            }
            Maker::OwnPoints { trim } => surface_of(&self.scene, *trim),
            Maker::Cloud { file, trim, .. } => surface_of(file, *trim),
        };
        arguments.extend(["--out".into(), subject.clone().into()]);
        let begun = Instant::now();
        caller.call(arguments, hear)?;
        let seconds = keep(&record, &key, begun.elapsed().as_secs_f64())?;
        Ok((subject, seconds))
    }

    /// Makes the surface and measures it, where that is not done.
    fn make(
        &self,
        args: &PaperArgs,
        key: &RecordKey,
        cancellation: &Cancellation,
        hear: &mut dyn FnMut(&str),
    ) -> Result<Figures> {
        let record = self.record(args, "figures");
        if let Kept::Row(figures) = kept(&record, key)? {
            return Ok(figures);
        }
        let name = self.folder();
        let caller = Caller { name: &name, cancellation };
        let (subject, seconds) = self.surface(args, key, &caller, hear)?;
        let json = self.record(args, "eval");
        let mut arguments: Vec<OsString> = vec!["eval".into(), subject.into(), "--no-views".into()];
        arguments.extend(["--data".into(), self.scene.clone().into()]);
        arguments.extend(["--overwrite".into(), "--json".into(), json.clone().into()]);
        if let (Some(reference), Some(scan)) = (&args.reference, self.scan) {
            arguments.extend(["--protocol".into(), "dtu".into(), "--reference".into(), reference.clone().into()]);
            arguments.extend(["--scan".into(), scan.to_string().into()]);
        }
        if let Some(points) = &self.points {
            arguments.extend(["--points".into(), points.clone().into()]);
        }
        caller.call(arguments, hear)?;
        let text = std::fs::read_to_string(&json).with_context(|| json.display().to_string())?;
        let report: Value = serde_json::from_str(&text).with_context(|| json.display().to_string())?;
        let figures = figures_of(&report, args.reference.is_some(), seconds).with_context(|| match &args.reference {
            Some(reference) => format!("{}: no distances to the scan of {}", json.display(), reference.display()),
            None => format!(
                "{}: the surface is empty, or the scene has neither a true surface nor verified points; DTU's evaluation data \
                 are given with --reference",
                self.scene.display()
            ),
        })?;
        keep(&record, key, figures)
    }
}

fn surface_of(points: &Path, trim: u32) -> Vec<OsString> {
    ["points2mesh".into(), points.into(), "--overwrite".into(), "--trim".into(), trim.to_string().into()].into()
}

/// What `dvr eval --json` says, by the protocol where it was asked for, else by the best judge that there was.
fn figures_of(report: &Value, by_protocol: bool, seconds: f64) -> Option<Figures> {
    if by_protocol {
        let dtu = &report["dtu"];
        let completeness = dtu["completeness"]["mean"].as_f64()?;
        return Some(Figures { judge: Judge::Dtu, accuracy: dtu["accuracy"]["mean"].as_f64(), completeness, seconds });
    }
    let truth = &report["shape"]["surface"];
    if let Some(completeness) = truth["completeness"].as_f64() {
        return Some(Figures { judge: Judge::Truth, accuracy: truth["accuracy"].as_f64(), completeness, seconds });
    }
    let completeness = report["points"]["distances"]["mean"].as_f64()?;
    Some(Figures { judge: Judge::Points, accuracy: None, completeness, seconds })
}

impl Judge {
    const fn about(self) -> &'static str {
        match self {
            Self::Dtu => "By the protocol of DTU, mm",
            Self::Truth => "By the true surface, edges of the object cube",
            Self::Points => "By verified points, units of the files: their mean distance to the surface",
        }
    }
}

/// A row with what came of it.
type Made<'a> = (&'a Row, &'a RecordKey, std::result::Result<Figures, String>);

const HEADS: [&str; 6] = ["scene", "surface", "accuracy", "completeness", "mean of both", "seconds"];

fn cells(row: &Row, figures: &Figures) -> Vec<String> {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.4}"));
    let both = figures.accuracy.map(|accuracy| 0.5 * (accuracy + figures.completeness));
    let seconds = format!("{:.0}", figures.seconds);
    let (accuracy, completeness) = (number(figures.accuracy), number(Some(figures.completeness)));
    vec![row.title.clone(), row.maker.title(), accuracy, completeness, number(both), seconds]
}

/// Writes and prints the table: one for each judge.
fn write_table(args: &PaperArgs, made: &[Made<'_>]) -> Result<()> {
    let mut by_judge: BTreeMap<Judge, Vec<Vec<String>>> = BTreeMap::new();
    let mut failures = Vec::new();
    let mut keys = Vec::new();
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_record(["scene", "row", "judge", "accuracy", "completeness", "seconds"])?;
    for (row, key, figures) in made {
        match figures {
            Ok(figures) => {
                by_judge.entry(figures.judge).or_default().push(cells(row, figures));
                keys.push(*key);
                let accuracy = figures.accuracy.map_or_else(String::new, |value| value.to_string());
                let judge = serde_json::to_value(figures.judge)?;
                csv.write_record([
                    row.title.clone(),
                    row.maker.name(),
                    judge.as_str().unwrap_or_default().to_owned(),
                    accuracy,
                    figures.completeness.to_string(),
                    figures.seconds.to_string(),
                ])?;
            }
            Err(problem) => failures.push(format!("{}: {problem}", row.folder())),
        }
    }
    let origin = origin(keys.into_iter().map(Some));
    let mut text = format!("{origin}.\n");
    let mut sections = Vec::new();
    for (judge, rows) in &by_judge {
        let _ = writeln!(text, "\n{}.\n\n| {} |\n|{}", judge.about(), HEADS.join(" | "), "---|".repeat(HEADS.len()));
        for row in rows {
            let _ = writeln!(text, "| {} |", row.join(" | "));
        }
        sections.push(Section::new(judge.about(), format!("<div class=\"wide\">{}</div>", table(&HEADS, rows))));
    }
    for failure in &failures {
        let _ = writeln!(text, "\n- failed: {failure}");
    }
    if !failures.is_empty() {
        let rows: Vec<Vec<String>> = failures.iter().map(|failure| vec![failure.clone()]).collect();
        sections.push(Section::new("Failed", table(&["what the commands said"], &rows)));
    }
    let page = Page {
        title: "Surfaces of many views".into(),
        subtitle: origin,
        sections,
        footer: "This file is complete: it loads nothing from the network.".into(),
    };
    write_bytes_atomically(&args.out.join("table.md"), text.as_bytes())?;
    write_bytes_atomically(&args.out.join("table.csv"), &csv.into_inner()?)?;
    write_bytes_atomically(&args.out.join("report.html"), page.to_html().as_bytes())?;
    println!("{text}");
    FILES.iter().for_each(|name| eprintln!("wrote {}", args.out.join(name).display()));
    Ok(())
}

#[cfg(test)]
mod tests {
    use dvr_core::VerifiedPoints;
    use dvr_core::metrics::points::{PointsSettings, score_points};
    use glam::DVec3;

    use super::*;

    #[test]
    fn the_best_judge_that_was_had_stands() {
        let mesh = dvr_core::mesh::shapes::icosphere(2, 1.0);
        let points = VerifiedPoints { points: vec![DVec3::new(0.0, 0.0, 1.5)], ..VerifiedPoints::default() };
        let score = score_points(&mesh, &points, &[], &PointsSettings::default()).unwrap();
        let points = json!({"points": score, "shape": {"surface": null}, "dtu": null});
        let found = figures_of(&points, false, 1.0).unwrap();
        assert_eq!((found.judge, found.accuracy), (Judge::Points, None));
        assert!((0.5..0.6).contains(&found.completeness), "{found:?}");
        let mut all = points;
        all["shape"]["surface"] = json!({"accuracy": 0.1, "completeness": 0.2});
        assert_eq!(figures_of(&all, false, 1.0).unwrap().judge, Judge::Truth);
        assert!(figures_of(&all, true, 1.0).is_none(), "the protocol was asked for");
        all["dtu"] = json!({"accuracy": {"mean": 1.0}, "completeness": {"mean": 2.0}});
        let found = figures_of(&all, true, 1.0).unwrap();
        assert_eq!((found.judge, found.accuracy, found.completeness), (Judge::Dtu, Some(1.0), 2.0));
        assert!(figures_of(&json!({}), false, 1.0).is_none());
    }
}
