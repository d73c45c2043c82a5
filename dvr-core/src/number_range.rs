//! The ranges of the numbers of a configuration: one table for each, looked up by key.
//!
//! A configuration is checked as JSON, so that a value is refused before it is converted to anything: what is negative,
//! too large, not whole or no number at all is named like what is out of range. Relations between values are the
//! configurations' own business.

use std::borrow::Cow;
use std::fmt;

use serde::Serialize;
use serde_json::Value;

/// The range of one number.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberRange {
    /// The key, dotted; `[]` stands for any place of a list: `march[].samples`.
    pub key: Cow<'static, str>,
    /// What it may be.
    pub allowed: Allowed,
}

/// What a number may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Allowed {
    /// A whole number between two, both included.
    Whole(u64, u64),
    /// Any number between two, both included.
    Real(f64, f64),
    /// Any number above one, up to and including another.
    Above(f64, f64),
}

/// A whole number between two, both included.
pub const fn whole(key: &'static str, least: u64, most: u64) -> NumberRange {
    NumberRange { key: Cow::Borrowed(key), allowed: Allowed::Whole(least, most) }
}

/// Any number between two, both included.
pub const fn real(key: &'static str, least: f64, most: f64) -> NumberRange {
    NumberRange { key: Cow::Borrowed(key), allowed: Allowed::Real(least, most) }
}

/// Any number above one, up to and including another.
pub const fn above(key: &'static str, bound: f64, most: f64) -> NumberRange {
    NumberRange { key: Cow::Borrowed(key), allowed: Allowed::Above(bound, most) }
}

/// The same ranges of a configuration that lies at `parent` in another.
pub fn nested(parent: &str, ranges: &[NumberRange]) -> Vec<NumberRange> {
    let nested = |range: &NumberRange| NumberRange { key: format!("{parent}.{}", range.key).into(), ..range.clone() };
    ranges.iter().map(nested).collect()
}

impl Allowed {
    /// Whether a value of JSON is such a number.
    pub fn holds(&self, value: &Value) -> bool {
        match *self {
            Self::Whole(least, most) => value.as_u64().is_some_and(|n| (least..=most).contains(&n)),
            Self::Real(least, most) => value.as_f64().is_some_and(|x| (least..=most).contains(&x)),
            Self::Above(bound, most) => value.as_f64().is_some_and(|x| x > bound && x <= most),
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(0, u64::MAX) => write!(f, "a whole number"),
            Self::Whole(least, u64::MAX) => write!(f, "a whole number, at least {least}"),
            Self::Whole(least, most) => write!(f, "a whole number from {least} to {most}"),
            Self::Real(least, most) => write!(f, "a number from {least} to {most}"),
            Self::Above(bound, most) => write!(f, "a number above {bound}, at most {most}"),
        }
    }
}

/// A number of a configuration is not in its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{key}` is {value}, it must be {range}")]
pub struct OutOfRange {
    /// The key, as in [`NumberRange::key`].
    pub key: String,
    /// Its value, as JSON.
    pub value: String,
    /// What it may be.
    pub range: String,
}

impl OutOfRange {
    /// A value that does not go together with others, whose own range it is in.
    pub fn new(key: impl Into<String>, value: impl ToString, range: impl Into<String>) -> Self {
        Self { key: key.into(), value: value.to_string(), range: range.into() }
    }
}

/// Checks all numbers of a configuration.
///
/// # Errors
/// As [`check_numbers`].
pub fn check_config(config: &impl Serialize, ranges: &[NumberRange]) -> Result<(), OutOfRange> {
    let value = serde_json::to_value(config);
    check_numbers(&value.map_err(|e| OutOfRange::new("the configuration", e, "expressible as JSON"))?, ranges)
}

/// Checks all numbers of a configuration in JSON, whole or in part.
///
/// # Errors
/// Names the first key whose value is not in its range, and any number that has no range: every number needs one.
pub fn check_numbers(config: &Value, ranges: &[NumberRange]) -> Result<(), OutOfRange> {
    check_at(config, ranges, &mut String::new())
}

fn check_at(value: &Value, ranges: &[NumberRange], key: &mut String) -> Result<(), OutOfRange> {
    if let Some(range) = ranges.iter().find(|range| range.key == key.as_str()) {
        let refused = || {
            // A number that is not finite is null in JSON.
            let value = if value.is_null() { "not a number".to_owned() } else { value.to_string() };
            OutOfRange::new(key.clone(), value, range.allowed.to_string())
        };
        return if range.allowed.holds(value) { Ok(()) } else { Err(refused()) };
    }
    let end = key.len();
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                let dot = if end == 0 { "" } else { "." };
                key.push_str(&format!("{dot}{name}"));
                check_at(value, ranges, key)?;
                key.truncate(end);
            }
            Ok(())
        }
        Value::Array(items) => {
            key.push_str("[]");
            items.iter().try_for_each(|item| check_at(item, ranges, key))?;
            key.truncate(end);
            Ok(())
        }
        Value::Number(number) => Err(OutOfRange::new(key.clone(), number, "a key that takes numbers")),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const RANGES: [NumberRange; 4] =
        [whole("rays", 1, 8), real("share", 0.0, 1.0), above("rate", 0.0, 2.0), whole("march[].samples", 2, 9)];

    fn refused(config: Value) -> OutOfRange {
        check_numbers(&config, &RANGES).unwrap_err()
    }

    #[test]
    fn numbers_in_range_pass_at_any_depth() {
        let config =
            json!({"rays": 8, "share": 0, "rate": 2.0, "name": "x", "march": [{"samples": 2}, {"samples": 9}]});
        assert_eq!(check_numbers(&config, &RANGES), Ok(()));
        let inner = nested("inner", &RANGES);
        assert_eq!(check_numbers(&json!({"inner": config}), &inner), Ok(()));
    }

    #[test]
    fn anything_else_is_named_with_value_and_range() {
        for value in [json!(0), json!(9), json!(-1), json!(1e18), json!(2.5), json!("many"), json!(null), json!({})] {
            let found = refused(json!({"rays": value}));
            assert_eq!((found.key.as_str(), found.range.as_str()), ("rays", "a whole number from 1 to 8"), "{found}");
        }
        assert_eq!(refused(json!({"rate": 0.0})).range, "a number above 0, at most 2");
        assert_eq!(refused(json!({"share": f64::NAN})).value, "not a number");
        assert_eq!(refused(json!({"march": [{"samples": 2}, {"samples": 1}]})).key, "march[].samples");
    }

    #[test]
    fn a_number_without_a_range_is_refused() {
        assert_eq!(refused(json!({"inner": {"other": 3}})).key, "inner.other");
    }
}
