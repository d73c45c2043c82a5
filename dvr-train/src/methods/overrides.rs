//! Configurations of which some values are replaced.

use dvr_core::number_range::{NumberRange, check_numbers};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::error::{Error, Result};

/// A configuration as JSON without the keys that mean nothing to a method; keys are dotted.
pub(crate) fn visible<T: Serialize>(config: &T, hidden: &[&str]) -> Result<Value> {
    let mut value = serde_json::to_value(config).map_err(|e| Error::BadConfig { problem: e.to_string() })?;
    for key in hidden {
        let (parents, name) = key.rsplit_once('.').map_or((Vec::new(), *key), |(p, n)| (p.split('.').collect(), n));
        let parent = parents.iter().try_fold(&mut value, |value, parent| value.get_mut(*parent));
        parent.and_then(Value::as_object_mut).and_then(|fields| fields.remove(name));
    }
    Ok(value)
}

/// A configuration with some values replaced by those of a JSON object, which may not name `hidden` keys; every number
/// is in its range.
pub(crate) fn overridden<T: Serialize + for<'de> Deserialize<'de>>(
    config: &T,
    overrides: &Value,
    hidden: &[&str],
    ranges: &[NumberRange],
) -> Result<T> {
    let bad = |e: serde_json::Error| Error::BadConfig { problem: e.to_string() };
    let mut value = visible(config, hidden)?;
    overlay(&mut value, overrides, "")?;
    check_numbers(&value, ranges)?;
    let whole = serde_json::to_value(config).map_err(bad)?;
    for key in hidden {
        restore(&mut value, &whole, &key.split('.').collect::<Vec<_>>());
    }
    serde_json::from_value(value).map_err(bad)
}

/// Puts the value at `path` in `whole` back into `value`.
fn restore(value: &mut Value, whole: &Value, path: &[&str]) {
    let ([first, rest @ ..], Some(fields)) = (path, value.as_object_mut()) else { return };
    match (rest, whole.get(first)) {
        (_, None) => {}
        ([], Some(found)) => {
            fields.insert((*first).to_owned(), found.clone());
        }
        (rest, Some(found)) => {
            restore(fields.entry((*first).to_owned()).or_insert_with(|| Value::Object(Map::new())), found, rest);
        }
    }
}

/// Lays the values of `over` on `base`; objects are merged key by key, anything else is replaced.
fn overlay(base: &mut Value, over: &Value, path: &str) -> Result<()> {
    let (Some(fields), Some(over)) = (base.as_object_mut(), over.as_object()) else {
        *base = over.clone();
        return Ok(());
    };
    // An enum is replaced whole, since its fields depend on its variant: `slope` by its tag, `capacity` by its only
    // key.
    let is_other_variant = fields.len() == 1 && over.len() == 1 && !over.keys().any(|key| fields.contains_key(key));
    if over.contains_key("kind") || (is_other_variant && !path.is_empty()) {
        *base = Value::Object(over.clone());
        return Ok(());
    }
    for (key, value) in over {
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        let known = fields.keys().cloned().collect::<Vec<_>>();
        match fields.get_mut(key) {
            None => return Err(Error::UnknownKey { key: path, known }),
            Some(inner) => overlay(inner, value, &path)?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use dvr_core::number_range::whole;
    use serde_json::json;

    use super::*;

    #[test]
    fn hidden_keys_are_neither_shown_nor_taken_and_keep_their_values() {
        let hidden = ["model", "hull.steps"];
        let ranges = [whole("rays", 1, 64), whole("hull.resolution", 1, 64)];
        let config = json!({"model": {"width": 77}, "hull": {"steps": 5, "resolution": 64}, "rays": 8});
        let shown = visible(&config, &hidden).unwrap();
        assert_eq!(shown, json!({"hull": {"resolution": 64}, "rays": 8}));
        let changed = overridden(&config, &json!({"rays": 64, "hull": {"resolution": 32}}), &hidden, &ranges).unwrap();
        assert_eq!(changed, json!({"model": {"width": 77}, "hull": {"steps": 5, "resolution": 32}, "rays": 64}));
        let refused = overridden(&config, &json!({"model": {}}), &hidden, &ranges);
        assert!(matches!(refused, Err(Error::UnknownKey { key, .. }) if key == "model"));
        let refused = overridden(&config, &json!({"rays": -1}), &hidden, &ranges);
        assert!(matches!(refused, Err(Error::OutOfRange(wrong)) if wrong.key == "rays" && wrong.value == "-1"));
        assert_eq!(overridden(&config, &shown, &hidden, &ranges).unwrap(), config);
    }
}
