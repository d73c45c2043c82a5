//! What is known of objects once it was read or made, as far as there is room.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Result;

/// Bytes that are kept at most; what belongs to further objects is made whenever it is needed.
const KEPT_BYTES: usize = 512 << 20;

/// Something of each object of a dataset, made when it is first asked for; about as large for each.
pub(crate) struct Kept<T>(Mutex<HashMap<usize, Arc<T>>>);

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T> Kept<T> {
    /// That of an object; `bytes` tells its size.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn of(&self, object: usize, bytes: impl Fn(&T) -> usize, make: impl FnOnce() -> Result<T>) -> Result<Arc<T>> {
        let kept = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = kept().get(&object) {
            return Ok(known.clone());
        }
        let made = Arc::new(make()?);
        let mut kept = kept();
        if (kept.len() + 1) * bytes(&made) <= KEPT_BYTES {
            kept.insert(object, made.clone());
        }
        Ok(made)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_object_is_made_once_while_there_is_room() {
        let kept = Kept::default();
        let ask = |object: usize, bytes: usize| {
            let mut made = 0;
            let value = kept.of(
                object,
                |_| bytes,
                || {
                    made += 1;
                    Ok(10 * object)
                },
            );
            assert_eq!(*value.unwrap(), 10 * object);
            made
        };
        assert_eq!([ask(1, 8), ask(1, 8), ask(2, 8)], [1, 0, 1]);
        assert_eq!([ask(3, KEPT_BYTES), ask(3, KEPT_BYTES), ask(1, 8)], [1, 1, 0]);
    }
}
