//! Variants: methods with some settings changed.

use clap::ValueEnum;

use super::method::MethodName;

/// A method with some settings changed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Its name in tables.
    pub name: String,
    /// The method.
    pub method: String,
    /// `KEY=VALUE`, as `--set` takes them.
    pub settings: Vec<String>,
}

impl Variant {
    /// Methods with their own settings, then variants.
    pub fn all(methods: &[MethodName], variants: &[Self]) -> Vec<Self> {
        let name = |method: &MethodName| method.to_possible_value().map(|value| value.get_name().to_owned());
        let methods = methods.iter().filter_map(name);
        let methods = methods.map(|name| Self { method: name.clone(), name, settings: Vec::new() });
        methods.chain(variants.iter().cloned()).collect()
    }
}

/// Reads `name:key=value,key=value`; the key `method` names the method, `grid` by default. Commas within brackets belong
/// to the value.
pub(super) fn parse_variant(text: &str) -> Result<Variant, String> {
    let error = || format!("{text:?} is not a variant; write NAME:KEY=VALUE, e.g. smooth:losses.smoothness.weight=9");
    let (name, settings) = text.split_once(':').ok_or_else(error)?;
    let mut settings = split_settings(settings);
    let sound = !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || "-_".contains(c));
    if !sound || settings.iter().any(|setting| !setting.contains('=')) {
        return Err(error());
    }
    let is_method = |setting: &String| setting.starts_with("method=");
    let method = match settings.iter().position(is_method) {
        Some(place) => settings.remove(place)["method=".len()..].to_owned(),
        None => "grid".to_owned(),
    };
    if <MethodName as ValueEnum>::from_str(&method, false).is_err() {
        return Err(format!(
            "{text:?}: there is no method {method:?}; the methods are hull, grid, network and classic"
        ));
    }
    Ok(Variant { name: name.to_owned(), method, settings })
}

/// Splits at commas outside of brackets.
fn split_settings(text: &str) -> Vec<String> {
    let mut depth = 0usize;
    let mut parts = vec![String::new()];
    for c in text.chars() {
        match c {
            '{' | '[' => depth += 1,
            '}' | ']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        match (c, depth, parts.last_mut()) {
            (',', 0, _) => parts.push(String::new()),
            (c, _, Some(part)) => part.push(c),
            _ => {}
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variant_has_a_name_a_method_and_settings() {
        let variant = parse_variant("rough:losses.smoothness.weight=0,rays=99").unwrap();
        assert_eq!((variant.name.as_str(), variant.method.as_str(), variant.settings.len()), ("rough", "grid", 2));
        let variant = parse_variant(r#"few:method=classic,march=[{"from_percent":0,"samples":16}],rays=9"#).unwrap();
        assert_eq!((variant.method.as_str(), variant.settings.len()), ("classic", 2), "{variant:?}");
        assert!(parse_variant("few:method=quick").is_err_and(|problem| problem.contains("no method")));
        assert!(parse_variant("rough").is_err() && parse_variant("a/b:x=1").is_err() && parse_variant("a:b").is_err());
    }
}
