//! [`macro@test_with`], an attribute in place of `#[test]` for tests that need what a machine may lack.
//!
//! Tests use it through `dvr-test-support`, which also gives them what they need.

mod present;

use proc_macro::{Delimiter, Literal, TokenStream, TokenTree};

/// Lists, with commas, what must not be missing.
const REQUIRE: &str = "DVR_REQUIRE";

/// A test that needs something, in place of `#[test]`:
///
/// ```text
/// #[test_with(gpu)]                                      an adapter; a software adapter will do
/// #[test_with(browser)]                                  a Chromium
/// #[test_with(colmap)]                                   COLMAP
/// #[test_with(ffmpeg)]                                   ffmpeg
/// #[test_with(wait_channels)]                            a Linux that tells what threads wait for
/// #[test_with(mounts)]                                   a Linux where a test may mount a disk of its own
/// #[test_with(scene("dtu_scan65"), scene("meshes"))]     what lies in DVR_SCENES
/// #[test_with(large_fixture("resnet18_c256_fp16.pt"))]   what lies in DVR_LARGE_FIXTURES
/// ```
///
/// Where it is missing, the test is `ignored`, and the harness gives the reason and counts it. Where `DVR_REQUIRE`
/// lists it (`gpu`, `browser`, `colmap`, `ffmpeg`, `mounts`, `wait_channels`, `scenes`,
/// `large_fixtures`), the test is run all the same, and fails.
///
/// The machine is looked at when the test is compiled; a change of one of these variables compiles it again.
#[proc_macro_attribute]
pub fn test_with(needs: TokenStream, function: TokenStream) -> TokenStream {
    match ignored(needs) {
        Ok(reason) => {
            let ignore = reason.map_or_else(String::new, |reason| format!("#[ignore = {}]", Literal::string(&reason)));
            let variables = [present::SCENES, present::LARGE_FIXTURES, REQUIRE].into_iter();
            let watched = variables.chain(present::DRIVER_FILES);
            let watched = watched.map(|name| format!("const _: Option<&str> = option_env!({name:?});"));
            let mut test = parse(&watched.collect::<String>());
            test.extend(parse(&format!("#[::core::prelude::v1::test] {ignore}")));
            test.extend(function);
            test
        }
        Err(problem) => parse(&format!("::core::compile_error!({});", Literal::string(&problem))),
    }
}

/// The tokens of a text of ours.
fn parse(text: &str) -> TokenStream {
    text.parse().expect("it is Rust")
}

/// Why a test with these needs is ignored here, or `None` where it is run.
fn ignored(needs: TokenStream) -> Result<Option<String>, String> {
    let mut tokens = needs.into_iter().peekable();
    let required = std::env::var(REQUIRE).unwrap_or_default();
    let mut reason = None;
    if tokens.peek().is_none() {
        return Err("name what the test needs: `test_with(gpu)`".into());
    }
    while let Some(token) = tokens.next() {
        let need = token.to_string();
        let argument = match tokens.peek() {
            Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Parenthesis => {
                let text = group.stream().to_string();
                tokens.next();
                Some(text.trim_matches('"').to_owned())
            }
            _ => None,
        };
        let (name, found) = match (need.as_str(), argument) {
            ("gpu", None) => ("gpu", present::gpu_driver()),
            ("browser", None) => ("browser", present::browser().map(drop)),
            ("colmap", None) => ("colmap", present::program("colmap").map(drop)),
            ("ffmpeg", None) => ("ffmpeg", present::program("ffmpeg").map(drop)),
            ("mounts", None) => ("mounts", present::mounts()),
            ("wait_channels", None) => ("wait_channels", present::wait_channels()),
            ("scene", Some(part)) => ("scenes", present::below(present::SCENES, &part).map(drop)),
            ("large_fixture", Some(part)) => {
                ("large_fixtures", present::below(present::LARGE_FIXTURES, &part).map(drop))
            }
            _ => {
                return Err(format!(
                    "`{need}` is none of: gpu, browser, colmap, ffmpeg, mounts, wait_channels, scene(\"...\"), large_fixture(\"...\")"
                ));
            }
        };
        if let (Err(why), false) = (found, is_listed(&required, name)) {
            reason = reason.or(Some(why));
        }
        if tokens.next().is_some_and(|token| token.to_string() != ",") {
            return Err("needs are parted by commas".into());
        }
    }
    Ok(reason)
}

/// Whether a list with commas has a name, whole.
fn is_listed(required: &str, need: &str) -> bool {
    required.split(',').any(|name| name.trim() == need)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_required_is_listed_by_its_whole_name() {
        assert!(is_listed("gpu, scenes", "scenes") && is_listed("gpu", "gpu"));
        assert!(!is_listed("", "gpu") && !is_listed("gpus,browser", "gpu"));
    }
}
