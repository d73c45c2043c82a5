//! The report: written by every run, of several runs side by side, working in a browser.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::read_mesh;
use dvr_tests::test_with;

/// What no report may weigh.
const MAX_BYTES: u64 = 10_000_000;

/// Trains the grid method for a moment.
fn train(tiny: &Tiny, run: &str, more: &[&str]) {
    let (scene, out) = (tiny.scene(), tiny.path(run));
    let mut args = vec!["train", text(&scene), "--out", text(&out), "--resolution", "32", "--steps", "40"];
    args.extend(["--set", "capacity={\"cells\":32}"]);
    args.extend(more);
    succeeds(&dvr(&args));
}

#[test]
fn a_run_writes_a_self_contained_page() {
    let tiny = Tiny::new();
    train(&tiny, "run", &["--seed", "5"]);
    let page = tiny.path("run/report.html");
    assert!(std::fs::metadata(&page).unwrap().len() < MAX_BYTES);
    let html = std::fs::read_to_string(&page).unwrap();
    for part in [
        "watertight",
        "No face of the mesh intersects another.",
        "Loss in training",
        "data:image/jpeg;base64,",
        "<canvas",
        "32 cells",
        "seed",
        "silhouette IoU",
    ] {
        assert!(html.contains(part), "{part}");
    }
    for outside in ["src=\"http", "href=\"http", "url(http"] {
        assert!(!html.contains(outside), "{outside}");
    }
    // The vertices say how well they were seen, and a ring that was photographed from all sides was.
    let seen = read_mesh(tiny.path("run/mesh.ply")).unwrap().mesh.observations.unwrap();
    let observed = seen.iter().filter(|observation| observation.views > 1 && observation.confidence > 0.3).count();
    assert!(observed * 2 > seen.len(), "{observed} of {}", seen.len());

    // Made again it is the same, whether or not the scene is where it was; the views need it.
    succeeds(&dvr(&["report", text(&tiny.path("run"))]));
    assert!(std::fs::read_to_string(&page).unwrap() == html, "the same page");
    std::fs::rename(tiny.path("rings"), tiny.path("moved")).unwrap();
    let other = tiny.path("other.html");
    let output = dvr(&["report", text(&tiny.path("run")), "--out", text(&other)]);
    succeeds(&output);
    assert!(String::from_utf8_lossy(&output.stderr).contains("no views in the report"));
    assert!(!std::fs::read_to_string(&other).unwrap().contains("class=\"compare\""));
    let moved = tiny.path("moved/torus");
    succeeds(&dvr(&["report", text(&tiny.path("run")), "--out", text(&other), "--overwrite", "--data", text(&moved)]));
    assert!(std::fs::read_to_string(&other).unwrap().contains("class=\"compare\""));

    refuses(&dvr(&["report", text(&tiny.path("nowhere"))]), &["nowhere"]);
    refuses(&dvr(&["report", text(&tiny.path("run")), "--data", "nowhere"]), &["nowhere"]);
}

#[test]
fn no_report_writes_no_page() {
    let tiny = Tiny::new();
    train(&tiny, "run", &["--no-report"]);
    assert!(tiny.path("run/mesh.ply").is_file() && !tiny.path("run/report.html").exists());
}

/// Clicks through the page and says to the console what happened.
const VISITOR: &str = r#"<script>
const errors = [];
addEventListener("error", (event) => errors.push(event.message));
addEventListener("unhandledrejection", (event) => errors.push(String(event.reason)));
addEventListener("load", async () => {
  const said = {};
  try {
    const find = (selector) => document.querySelector(selector);
    const viewer = find(".viewer").viewer;
    await viewer.ready;
    said.state = find(".viewer").dataset.state;
    said.message = !find(".message").hidden;
    if (viewer.gl) {
      const object = () => {
        viewer.drawNow();
        const [width, height] = [viewer.canvas.width, viewer.canvas.height];
        const pixels = new Uint8Array(4 * width * height);
        viewer.gl.readPixels(0, 0, width, height, viewer.gl.RGBA, viewer.gl.UNSIGNED_BYTE, pixels);
        let count = 0;
        let sum = 0;
        for (let i = 0; i < pixels.length; i += 4) { if (pixels[i + 3] > 0) { count++; sum = (sum * 31 + pixels[i] + 7 * pixels[i + 1]) % 65521; } }
        return [count / (width * height), sum];
      };
      const [share, colors] = object();
      find("[data-mode=confidence]").click();
      const [, confidence] = object();
      viewer.rotate(80, 20);
      const [, turned] = object();
      said.share = share;
      said.modeChanged = colors !== confidence && find(".viewer").dataset.shown === "confidence" && !find(".legend").hidden;
      said.turned = turned !== confidence;
    }
    find(".compare input").value = 20;
    find(".compare input").dispatchEvent(new Event("input"));
    said.slider = find(".compare").style.getPropertyValue("--at");
    const pictures = [...document.querySelectorAll(".view:not([hidden]) img")];
    await Promise.all(pictures.map((picture) => picture.decode()));
    said.pictures = pictures.length;
    find("[data-tab='1']").click();
    said.tab = !find("[data-panel='1']").hidden && find("[data-panel='0']").hidden && Boolean(find("[data-panel='1'] .viewer").viewer);
    said.charts = document.querySelectorAll(".chart svg").length;
  } catch (error) {
    errors.push(String(error));
  }
  said.errors = errors;
  console.log("VISITOR " + JSON.stringify(said));
});
</script>"#;

#[test_with(browser)]
fn two_runs_side_by_side_work_in_a_browser() {
    let tiny = Tiny::new();
    train(&tiny, "a", &[]);
    train(&tiny, "b", &["--seed", "1"]);
    let page = tiny.path("both.html");
    succeeds(&dvr(&["report", text(&tiny.path("a")), text(&tiny.path("b")), "--out", text(&page)]));
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("Side by side") && html.contains("2 runs side by side"));
    let browser = dvr_tests::browser();
    let visited = tiny.path("visited.html");
    std::fs::write(&visited, html.replace("</head>", &format!("{VISITOR}</head>"))).unwrap();

    let gl = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
    let said = visit(&browser, &visited, &gl);
    assert_eq!(said["errors"], serde_json::json!([]), "{said}");
    assert!(said["charts"].as_u64() >= Some(3) && said["slider"] == "20%" && said["tab"] == true, "{said}");
    assert!(said["pictures"].as_u64() >= Some(5), "{said}");
    assert!(said["state"] == "ready" && said["message"] == false, "{said}");
    let share = said["share"].as_f64().unwrap();
    assert!((0.05..0.9).contains(&share), "the object fills {share} of the canvas");
    assert!(said["modeChanged"] == true && said["turned"] == true, "{said}");

    let said = visit(&browser, &visited, &["--disable-3d-apis"]);
    assert_eq!(said["errors"], serde_json::json!([]), "{said}");
    assert!(said["message"] == true && said["state"] == "message" && said["tab"] == true, "{said}");
}

/// Opens a page and gives what the visitor said. The browser's console must hold no error until then.
fn visit(browser: &Path, page: &Path, flags: &[&str]) -> serde_json::Value {
    let profile = tempfile::tempdir().unwrap();
    let log = profile.path().join("log");
    let mut child = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--enable-logging=stderr", "--window-size=1000,800"])
        // Without it some versions end as soon as the page is loaded.
        .arg("--remote-debugging-port=0")
        .arg(format!("--user-data-dir={}", profile.path().join("profile").display()))
        .args(flags)
        .arg(format!("file://{}", page.display()))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&log).unwrap())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let (said, log) = loop {
        let ended = child.try_wait().unwrap().is_some();
        let log = String::from_utf8_lossy(&std::fs::read(&log).unwrap()).into_owned();
        let said = log.split("\"VISITOR ").nth(1).and_then(|rest| Some(rest.split_once("\", source:")?.0.to_owned()));
        // A browser that hangs must not hang the tests.
        if said.is_some() || ended || start.elapsed() > Duration::from_secs(300) {
            break (said, log);
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    // It may have ended by itself.
    let _ = child.kill();
    child.wait().unwrap();
    let complaint =
        |line: &&str| line.contains("CONSOLE") && !line.contains("INFO:CONSOLE") || line.contains("Uncaught");
    let complaints: Vec<&str> = log.lines().filter(complaint).collect();
    assert!(complaints.is_empty(), "{complaints:?}");
    serde_json::from_str(&said.unwrap_or_else(|| panic!("the visitor said nothing:\n{log}"))).unwrap()
}
