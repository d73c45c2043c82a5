//! Reads damaged files by every reader: `fuzz-readers [--reader NAME]... [--inputs N] [--seed N] [--seconds S]`.
//!
//! Each reader runs in a process of its own that counts what it allocates. An input that panics, kills the process, or
//! takes more than a gigabyte or ten seconds is a finding: it is put into `--findings DIR`, with the command that reads
//! it again. The exit code is 1 where there are findings.

use std::path::PathBuf;
use std::process::ExitCode;

use dvr_tests::Counted;
use dvr_tests::fuzz::campaign::{Plan, reproduction, run, table};
use dvr_tests::fuzz::worker::{self, Task};
use dvr_tests::fuzz::{MEMORY_LIMIT, READERS, reader};

#[global_allocator]
static ALLOCATOR: Counted = Counted::new(MEMORY_LIMIT);

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1).peekable();
    if arguments.next_if(|first| first == "worker").is_some() {
        let name = arguments.next().unwrap_or_default();
        let options = Options::read(arguments);
        worker::run(&options.task(&name), || ALLOCATOR.peak());
        return ExitCode::SUCCESS;
    }
    campaign(Options::read(arguments))
}

fn campaign(options: Options) -> ExitCode {
    let program = std::env::current_exe().unwrap_or_else(|e| panic!("this program has no path: {e}"));
    let plan = Plan {
        program: program.clone(),
        readers: options.readers,
        seed: options.seed,
        from: options.from,
        inputs: options.inputs,
        seconds: options.seconds,
        regressions: options.regressions,
        findings: options.findings,
    };
    let rows = run(&plan, |row| {
        eprintln!("{}: {} inputs in {:.1} s", row.reader, row.total.done, row.total.seconds);
        for finding in &row.total.findings {
            eprintln!("  {finding}\n    again: {}", reproduction(&program, row, finding, plan.seed));
        }
    });
    print!("{}", table(&rows));
    let found: usize = rows.iter().map(|row| row.total.findings.len()).sum();
    if found > 0 { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}

/// What the command line says.
struct Options {
    readers: Vec<String>,
    seed: u64,
    from: u64,
    inputs: u64,
    seconds: f64,
    files: Vec<PathBuf>,
    claims: bool,
    regressions: Option<PathBuf>,
    findings: PathBuf,
    progress: PathBuf,
}

impl Options {
    fn read(mut arguments: impl Iterator<Item = String>) -> Self {
        let mut options = Self {
            readers: Vec::new(),
            seed: 1,
            from: 0,
            inputs: 1000,
            seconds: f64::INFINITY,
            files: Vec::new(),
            claims: false,
            regressions: None,
            findings: std::env::temp_dir().join("dvr-fuzz-findings"),
            progress: PathBuf::new(),
        };
        while let Some(name) = arguments.next() {
            let mut value = || arguments.next().unwrap_or_else(|| usage(&format!("{name} needs a value")));
            match name.as_str() {
                "--reader" => options.readers.push(value()),
                "--seed" => options.seed = number(&value()),
                "--from" => options.from = number(&value()),
                "--inputs" => options.inputs = number(&value()),
                "--seconds" => options.seconds = number(&value()),
                "--file" => options.files.push(value().into()),
                "--claims" => options.claims = true,
                "--regressions" => options.regressions = Some(value().into()),
                "--findings" => options.findings = value().into(),
                "--progress" => options.progress = value().into(),
                _ => usage(&format!("{name} is not known")),
            }
        }
        if let Some(unknown) = options.readers.iter().find(|name| reader(name).is_none()) {
            usage(&format!("there is no reader {unknown}"));
        }
        options
    }

    fn task(self, name: &str) -> Task {
        let reader = reader(name).unwrap_or_else(|| usage(&format!("there is no reader {name}")));
        let Self { seed, from, inputs, seconds, files, claims, findings, progress, .. } = self;
        Task { reader, seed, from, inputs, seconds, files, claims, findings, progress }
    }
}

fn number<T: std::str::FromStr>(text: &str) -> T {
    text.parse().unwrap_or_else(|_| usage(&format!("{text} is not a number")))
}

fn usage(problem: &str) -> ! {
    let names: Vec<&str> = READERS.iter().map(|reader| reader.name).collect();
    eprintln!(
        "{problem}\noptions: --reader NAME --seed N --from N --inputs N --seconds S --findings DIR --regressions DIR"
    );
    eprintln!("readers: {}", names.join(", "));
    std::process::exit(2)
}
