//! [`Cursor`]: a position in the document with checked access to its values.

use std::fmt;
use std::path::Path;

use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};

use super::super::error::{Place, SceneError};

/// Longest excerpt of an offending value in an error. \[character\]
const SHOWN: usize = 60;

/// A value of the document with its position.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    pub(super) value: &'a Value,
    pub(super) pointer: String,
    file: &'a Path,
}

impl<'a> Cursor<'a> {
    pub(super) fn root(value: &'a Value, file: &'a Path) -> Self {
        Self { value, pointer: String::new(), file }
    }

    fn child(&self, token: &str, value: &'a Value) -> Self {
        let token = token.replace('~', "~0").replace('/', "~1");
        Self { value, pointer: format!("{}/{token}", self.pointer), file: self.file }
    }

    /// Returns the name of the value in messages: its key, or the key of its array with an index.
    pub(super) fn name(&self) -> String {
        let mut tokens = self.pointer.rsplit('/');
        let last = tokens.next().unwrap_or_default();
        if last.is_empty() {
            return "document".into();
        }
        if last.bytes().all(|c| c.is_ascii_digit()) {
            return format!("{}[{last}]", tokens.next().unwrap_or_default());
        }
        last.replace("~1", "/").replace("~0", "~")
    }

    /// Returns an error about this value.
    pub(super) fn error(&self, accepted: impl Into<String>) -> SceneError {
        let shown = match self.value {
            Value::Object(_) => String::new(),
            other => other.to_string(),
        };
        self.report(self.name(), shown, accepted)
    }

    /// Returns an error about this value under another name and without showing the value.
    pub(super) fn fault(&self, item: impl Into<String>, accepted: impl Into<String>) -> SceneError {
        self.report(item.into(), String::new(), accepted)
    }

    fn report(&self, item: String, value: String, accepted: impl Into<String>) -> SceneError {
        let value = if value.chars().count() > SHOWN {
            value.chars().take(SHOWN).chain("...".chars()).collect()
        } else {
            value
        };
        SceneError {
            file: self.file.to_path_buf(),
            place: self.place(),
            item,
            value,
            accepted: accepted.into(),
            unreadable: false,
        }
    }

    pub(super) fn place(&self) -> Place {
        if self.pointer.is_empty() { Place::File } else { Place::Pointer(self.pointer.clone()) }
    }

    pub(super) fn object(&self) -> Result<&'a Map<String, Value>, SceneError> {
        self.value.as_object().ok_or_else(|| self.error("an object is accepted"))
    }

    /// Returns the member `key`, if there is one.
    ///
    /// # Errors
    /// If the value is not an object.
    pub(super) fn get(&self, key: &str) -> Result<Option<Self>, SceneError> {
        Ok(self.object()?.get(key).map(|value| self.child(key, value)))
    }

    pub(super) fn require(&self, key: &str) -> Result<Self, SceneError> {
        self.get(key)?.ok_or_else(|| {
            self.fault(format!("{} without '{key}'", self.name()), format!("'{key}' is required"))
        })
    }

    /// Returns a member of `extensions`, if there is one.
    pub(super) fn extension(&self, name: &str) -> Result<Option<Self>, SceneError> {
        match self.get("extensions")? {
            Some(extensions) => extensions.get(name),
            None => Ok(None),
        }
    }

    /// Returns Drystone's own data on this object, `extras.drystone`, if there is any.
    pub(super) fn own(&self) -> Result<Option<Self>, SceneError> {
        // Extras of other programs may have any type.
        match self.get("extras")?.filter(|extras| extras.value.is_object()) {
            Some(extras) => Ok(extras.get("drystone")?.filter(|own| own.value.is_object())),
            None => Ok(None),
        }
    }

    pub(super) fn items(&self) -> Result<Vec<Self>, SceneError> {
        let array = self.value.as_array().ok_or_else(|| self.error("an array is accepted"))?;
        Ok(array.iter().enumerate().map(|(i, v)| self.child(&i.to_string(), v)).collect())
    }

    /// Returns the items of the member `key`; no items if it is absent.
    pub(super) fn list(&self, key: &str) -> Result<Vec<Self>, SceneError> {
        self.get(key)?.map_or_else(|| Ok(Vec::new()), |list| list.items())
    }

    /// Returns a whole number; the JSON may write it as a float.
    pub(super) fn integer(&self) -> Result<u64, SceneError> {
        const EXACT: f64 = 9_007_199_254_740_992.0;
        let whole = self.value.as_u64().or_else(|| {
            let number = self.value.as_f64()?;
            (number.fract() == 0.0 && (0.0..=EXACT).contains(&number)).then_some(number as u64)
        });
        whole.ok_or_else(|| self.error("a whole number of at least 0 is accepted"))
    }

    /// Returns an index into a list of `count` items called `what`.
    pub(super) fn index(&self, count: usize, what: &str) -> Result<usize, SceneError> {
        let index = self.integer()?;
        usize::try_from(index).ok().filter(|i| *i < count).ok_or_else(|| {
            let accepted = match count {
                0 => format!("the file has no {what}"),
                1 => format!("0 is accepted: the file has one of {what}"),
                n => format!("0..{} is accepted: the file has {n} {what}", n.saturating_sub(1)),
            };
            self.error(accepted)
        })
    }

    /// Returns a number of magnitude up to `limit`.
    pub(super) fn number(&self, limit: f64) -> Result<f64, SceneError> {
        let number = self.value.as_f64().ok_or_else(|| self.error("a number is accepted"))?;
        if number.abs() <= limit {
            Ok(number)
        } else {
            Err(self.error(format!("{:e} to {limit:e} is accepted", -limit)))
        }
    }

    /// Returns a number from `low` to `high`.
    pub(super) fn within(&self, low: f64, high: f64) -> Result<f64, SceneError> {
        let number = self.value.as_f64().ok_or_else(|| self.error("a number is accepted"))?;
        if (low..=high).contains(&number) {
            Ok(number)
        } else {
            Err(self.error(format!("{low:?} to {high:e} is accepted")))
        }
    }

    /// Returns an array of exactly `N` numbers of magnitude up to `limit`.
    pub(super) fn numbers<const N: usize>(&self, limit: f64) -> Result<[f64; N], SceneError> {
        let items = self.items()?;
        let numbers =
            items.iter().map(|item| item.number(limit)).collect::<Result<Vec<f64>, _>>()?;
        numbers.try_into().map_err(|_| self.error(format!("{N} numbers are accepted")))
    }

    pub(super) fn boolean(&self) -> Result<bool, SceneError> {
        self.value.as_bool().ok_or_else(|| self.error("true or false is accepted"))
    }

    pub(super) fn text(&self) -> Result<&'a str, SceneError> {
        self.value.as_str().ok_or_else(|| self.error("a text is accepted"))
    }

    /// Returns the keys of this object that are not in `known`, except `extensions` and `extras`.
    pub(super) fn unknown(&self, known: &[&str]) -> Vec<&'a str> {
        let keys = self.value.as_object().into_iter().flat_map(|map| map.keys());
        keys.map(String::as_str)
            .filter(|key| !known.contains(key) && !matches!(*key, "extensions" | "extras"))
            .collect()
    }
}

/// Parses a document and refuses duplicate keys, as glTF requires. Otherwise the last one would
/// silently win.
pub(super) fn parse(bytes: &[u8]) -> Result<Value, serde_json::Error> {
    serde_json::from_slice(bytes).map(|Distinct(value)| value)
}

/// Returns the message of an error without line and column, which its position already states.
pub(super) fn reason(error: &serde_json::Error) -> String {
    let text = error.to_string();
    text.split(" at line ").next().unwrap_or(&text).to_string()
}

struct Distinct(Value);

impl<'de> Deserialize<'de> for Distinct {
    fn deserialize<D: Deserializer<'de>>(parser: D) -> Result<Self, D::Error> {
        parser.deserialize_any(DistinctVisitor).map(Self)
    }
}

struct DistinctVisitor;

impl<'de> Visitor<'de> for DistinctVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a value")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E>(self, text: &str) -> Result<Value, E> {
        Ok(text.into())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut values = Vec::new();
        while let Some(Distinct(value)) = items.next_element()? {
            values.push(value);
        }
        Ok(values.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(key) = map.next_key::<String>()? {
            if object.contains_key(&key) {
                return Err(A::Error::custom(format!("duplicate key {key:?}")));
            }
            let Distinct(value) = map.next_value()?;
            object.insert(key, value);
        }
        Ok(object.into())
    }
}
