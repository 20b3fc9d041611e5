//! One value of a scene file together with where it stands, so that every error names file, object and
//! field.
//!
//! The file is walked by hand rather than derived, because a derived parser says at which byte it gave
//! up, and whoever draws a scene needs to know at which chair.

use serde_json::{Map, Value};

use super::SceneError;

/// Farthest coordinate a scene may use, metres. Chosen: within it `f32` rays are exact to 0.1 mm.
pub(crate) const COORDINATE_M_MAX: f64 = 1000.0;

/// A value of the file and the path that leads to it.
#[derive(Clone)]
pub(crate) struct Node<'a> {
    file: &'a str,
    object: Option<String>,
    path: String,
    value: &'a Value,
}

impl<'a> Node<'a> {
    /// The whole file.
    pub(crate) fn root(file: &'a str, value: &'a Value) -> Self {
        Node { file, object: None, path: String::new(), value }
    }

    /// The same value, told as part of the object `id`: from here on paths start anew.
    pub(crate) fn of_object(&self, id: &str) -> Self {
        Node { object: Some(id.to_owned()), path: String::new(), ..self.clone() }
    }

    /// An error about this value.
    pub(crate) fn fail(&self, reason: impl ToString) -> SceneError {
        SceneError::Field {
            file: self.file.to_owned(),
            object: self.object.clone(),
            field: if self.path.is_empty() { "(all of it)".into() } else { self.path.clone() },
            reason: reason.to_string(),
        }
    }

    /// The value under `key`; `None` when it is absent or null.
    pub(crate) fn find(&self, key: &str) -> Result<Option<Node<'a>>, SceneError> {
        let map = self.map()?;
        Ok(map.get(key).filter(|v| !v.is_null()).map(|value| Node {
            path: if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) },
            value,
            ..self.clone()
        }))
    }

    /// The value under `key`, which must be there.
    pub(crate) fn get(&self, key: &str) -> Result<Node<'a>, SceneError> {
        self.find(key)?.ok_or_else(|| self.fail(format_args!("`{key}` is missing")))
    }

    /// The text under `key`, or the empty text.
    pub(crate) fn text_or_empty(&self, key: &str) -> Result<String, SceneError> {
        self.find(key)?.map_or_else(|| Ok(String::new()), |n| n.text(20_000))
    }

    /// The object's members.
    pub(crate) fn map(&self) -> Result<&'a Map<String, Value>, SceneError> {
        self.value.as_object().ok_or_else(|| self.fail(format_args!("is {}, must be an object", self.sort())))
    }

    /// The keys that are not in `known`, kept as they are.
    pub(crate) fn others(&self, known: &[&str]) -> Result<Map<String, Value>, SceneError> {
        let strange = |(key, _): &(&String, &Value)| !known.contains(&key.as_str());
        Ok(self.map()?.iter().filter(strange).map(|(k, v)| (k.clone(), v.clone())).collect())
    }

    /// The text, of 1 to `n_chars_max` characters.
    pub(crate) fn text(&self, n_chars_max: usize) -> Result<String, SceneError> {
        let text =
            self.value.as_str().ok_or_else(|| self.fail(format_args!("is {}, must be text", self.sort())))?;
        let n_chars = text.chars().count();
        if n_chars > n_chars_max {
            return Err(self.fail(format_args!("has {n_chars} characters, at most {n_chars_max}")));
        }
        Ok(text.to_owned())
    }

    /// The text, which must not be empty.
    pub(crate) fn name(&self) -> Result<String, SceneError> {
        let text = self.text(rules::rule::NAME_CHARS_MAX)?;
        if text.trim().is_empty() {
            return Err(self.fail("is empty, must be at least one character"));
        }
        Ok(text)
    }

    /// The number, within `low..=high`.
    pub(crate) fn number(&self, low: f64, high: f64) -> Result<f64, SceneError> {
        let value = self
            .value
            .as_f64()
            .ok_or_else(|| self.fail(format_args!("is {}, must be a number", self.sort())))?;
        if !(low..=high).contains(&value) {
            return Err(self.fail(format_args!("is {value}, must be within {low} to {high}")));
        }
        Ok(value)
    }

    /// A coordinate, metres.
    pub(crate) fn coordinate(&self) -> Result<f64, SceneError> {
        self.number(-COORDINATE_M_MAX, COORDINATE_M_MAX)
    }

    /// The elements of a list of at most `n_max`.
    pub(crate) fn items(&self, n_max: usize) -> Result<Vec<Node<'a>>, SceneError> {
        let list = self
            .value
            .as_array()
            .ok_or_else(|| self.fail(format_args!("is {}, must be a list", self.sort())))?;
        if list.len() > n_max {
            return Err(self.fail(format_args!("has {} elements, at most {n_max}", list.len())));
        }
        let item = |(idx, value)| Node { path: format!("{}[{idx}]", self.path), value, ..self.clone() };
        Ok(list.iter().enumerate().map(item).collect())
    }

    /// The elements of the list under `key`; none when it is absent.
    pub(crate) fn items_of(&self, key: &str, n_max: usize) -> Result<Vec<Node<'a>>, SceneError> {
        self.find(key)?.map_or_else(|| Ok(Vec::new()), |n| n.items(n_max))
    }

    /// Exactly `N` coordinates.
    pub(crate) fn coordinates<const N: usize>(&self) -> Result<[f64; N], SceneError> {
        let items = self.items(usize::MAX)?;
        let values = items.iter().map(Node::coordinate).collect::<Result<Vec<f64>, _>>()?;
        <[f64; N]>::try_from(values)
            .map_err(|v| self.fail(format_args!("has {} numbers, must have {N}", v.len())))
    }

    /// The value as it stands in the file.
    pub(crate) fn value(&self) -> &'a Value {
        self.value
    }

    fn sort(&self) -> &'static str {
        match self.value {
            Value::Null => "null",
            Value::Bool(_) => "a truth value",
            Value::Number(_) => "a number",
            Value::String(_) => "text",
            Value::Array(_) => "a list",
            Value::Object(_) => "an object",
        }
    }
}
