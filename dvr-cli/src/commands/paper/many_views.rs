//! The tables of many views: benchmarks of the paper's network with other settings, beside today's methods.

use std::process::ExitCode;

use anyhow::{Result, bail};
use clap::Parser;
use dvr_core::Cancellation;

use crate::args::{Cli, Command, PaperArgs};
use crate::commands::bench;

/// CPU minutes of the paper's network on one scene of 64 pixels, 600 steps; what other methods take is little beside it.
const MINUTES: f64 = 2.5;

/// What is compared.
#[derive(Clone, Copy, Debug)]
pub enum Comparison {
    /// Samples on a ray.
    Samples,
    /// Weights of the smoothness of normals.
    Smoothness,
    /// Pictures, depth maps, and both.
    Supervision,
}

/// Carries out the benchmark, or says what it is.
pub fn run(args: &PaperArgs, comparison: Comparison, cancellation: &Cancellation) -> Result<ExitCode> {
    if !args.rows.is_empty() || args.steps.is_some() || args.encoder.is_some() || args.by_heart.is_some() {
        bail!(
            "--rows, --steps, --encoder and --by-heart are for --table shapenet (--rows for dtu too); compare other settings with `dvr bench --variant`"
        );
    }
    let arguments = arguments(args, comparison);
    let runs = args.data.len() as f64 * args.seeds as f64 * trainings(comparison);
    eprintln!("dvr {}", shlex::try_join(arguments.iter().map(String::as_str)).unwrap_or_default());
    eprintln!("about {:.0} CPU minutes for scenes of 64 pixels, more for larger ones", MINUTES * runs);
    if args.plan {
        return Ok(ExitCode::SUCCESS);
    }
    let all = ["dvr".to_owned()].into_iter().chain(arguments);
    let Command::Bench(benchmark) = Cli::try_parse_from(all)?.command else { bail!("no benchmark") };
    bench::run(&benchmark, cancellation)
}

/// How many trainings of the paper's network it has for each scene and seed.
fn trainings(comparison: Comparison) -> f64 {
    match comparison {
        Comparison::Samples => 5.0,
        Comparison::Smoothness | Comparison::Supervision => 3.0,
    }
}

/// The benchmark, as arguments of the program.
fn arguments(args: &PaperArgs, comparison: Comparison) -> Vec<String> {
    let mut arguments = vec!["bench".to_owned()];
    arguments.extend(args.data.iter().map(|path| path.to_string_lossy().into_owned()));
    let mut add = |parts: &[&str]| arguments.extend(parts.iter().map(ToString::to_string));
    match comparison {
        Comparison::Samples => {
            add(&["--methods", "classic"]);
            for samples in [16, 32, 64, 128] {
                let march = format!(r#"march=[{{"from_percent":0,"samples":{samples}}}]"#);
                add(&["--variant", &format!("samples-{samples}:method=classic,{march}")]);
            }
        }
        Comparison::Smoothness => {
            add(&["--methods", "classic"]);
            for weight in ["0", "1"] {
                add(&["--variant", &format!("smooth-{weight}:method=classic,losses.normal={weight}")]);
            }
        }
        Comparison::Supervision => {
            add(&["--methods", "classic,network,grid", "--supervision", "rgb,depth,rgb+depth"]);
        }
    }
    add(&["--seeds", &args.seeds.to_string(), "--out", &args.out.to_string_lossy()]);
    arguments
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::args::PaperTable;

    #[test]
    fn every_table_of_many_views_is_a_benchmark_whose_settings_exist() {
        for comparison in [Comparison::Samples, Comparison::Smoothness, Comparison::Supervision] {
            let args = PaperArgs {
                table: PaperTable::Depth,
                data: vec![PathBuf::from("a scene"), PathBuf::from("b")],
                out: PathBuf::from("out"),
                seeds: 2,
                plan: false,
                rows: Vec::new(),
                steps: None,
                encoder: None,
                resolution: 64,
                by_heart: None,
                clouds: Vec::new(),
                reference: None,
                points: None,
            };
            let all = ["dvr".to_owned()].into_iter().chain(arguments(&args, comparison));
            let Command::Bench(benchmark) = Cli::try_parse_from(all).unwrap().command else { panic!("no benchmark") };
            assert_eq!((benchmark.scenes.len(), benchmark.seeds), (2, 2));
            for variant in benchmark.variants() {
                let settings: Vec<&str> = variant.settings.iter().flat_map(|setting| ["--set", setting]).collect();
                let train = ["dvr", "train", "a", "--out", "b", "--method", &variant.method];
                let Command::Train(train) = Cli::try_parse_from(train.into_iter().chain(settings)).unwrap().command
                else {
                    panic!("no training")
                };
                crate::commands::method_of_args::method_of_args(&train, false).unwrap().check().unwrap();
            }
        }
    }
}
