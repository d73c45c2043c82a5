//! Reads damaged files by every reader: `fuzz-readers [--reader NAME]... [--inputs N] [--seed N] [--seconds S]`.
//!
//! Each reader runs in a process of its own that counts what it allocates. An input that panics, kills the process, or
//! takes more than a gigabyte or ten seconds is a finding: it is put into `--findings DIR`, with the command that reads
//! it again. The exit code is 1 where there are findings.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};

use dvr_tests::fuzz::campaign::{Plan, reproduction, run, table};
use dvr_tests::fuzz::worker::{self, Task};
use dvr_tests::fuzz::{MEMORY_LIMIT, READERS, reader};

/// The system's allocator, counted.
struct Counted;

/// Bytes that are allocated, and the most that ever were.
static ALLOCATED: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn grow(bytes: usize) {
    let now = ALLOCATED.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
    if now > PEAK.fetch_max(now, Ordering::Relaxed) && now > MEMORY_LIMIT {
        // Nothing may be allocated to say it.
        use std::io::Write;
        let _ = std::io::stderr().write_all(b"more than 1 GiB allocated\n");
        std::process::abort();
    }
}

// SAFETY: every call is handed on to the system's allocator as it came; counting touches no memory of it.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grow(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grow(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        ALLOCATED.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        grow(size.saturating_sub(layout.size()));
        ALLOCATED.fetch_sub(layout.size().saturating_sub(size), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counted = Counted;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1).peekable();
    if arguments.next_if(|first| first == "worker").is_some() {
        let name = arguments.next().unwrap_or_default();
        let options = Options::read(arguments);
        worker::run(&options.task(&name), || PEAK.load(Ordering::Relaxed));
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
