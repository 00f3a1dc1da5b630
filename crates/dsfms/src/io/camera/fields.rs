//! Numbers out of JSON values, with errors that name the field.

use super::super::error::InputError;
use serde_json::{Map, Value};
use std::path::Path;

/// Most names that an error lists.
const MOST_NAMED: usize = 12;

/// An object of a file, with the name under which errors speak of its fields.
pub(super) struct Fields<'a> {
    pub(super) path: &'a Path,
    prefix: String,
    map: &'a Map<String, Value>,
}

impl<'a> Fields<'a> {
    /// The object itself, or an error that calls it `name`.
    pub(super) fn new(path: &'a Path, name: &str, value: &'a Value) -> Result<Self, InputError> {
        let prefix = if name.is_empty() { String::new() } else { format!("{name}.") };
        match value.as_object() {
            Some(map) => Ok(Self { path, prefix, map }),
            None if name.is_empty() => {
                Err(InputError::format(path, "expected an object { \"fx\": …, … }"))
            }
            None => Err(InputError::field(path, name, "expected an object { … }")),
        }
    }

    /// A field that is there and not null.
    pub(super) fn get(&self, key: &str) -> Option<&'a Value> {
        self.map.get(key).filter(|value| !value.is_null())
    }

    /// The first of several names that is there.
    pub(super) fn first(&self, keys: &[&'static str]) -> Option<(&'static str, &'a Value)> {
        keys.iter().find_map(|&key| Some((key, self.get(key)?)))
    }

    pub(super) fn keys(&self) -> impl Iterator<Item = (&'a String, &'a Value)> {
        self.map.iter()
    }

    /// An error about one field.
    pub(super) fn error(&self, key: &str, problem: impl Into<String>) -> InputError {
        InputError::field(self.path, format!("{}{key}", self.prefix), problem)
    }

    /// An error about a field whose name is nearly one of `known`, or, where `strict`, that is none
    /// of them and no text (a remark): what it says would be lost.
    pub(super) fn check_names(&self, known: &[&str], strict: bool) -> Result<(), InputError> {
        for (key, value) in self.map {
            if known.contains(&key.as_str()) {
                continue;
            }
            if let Some(near) = known.iter().find(|k| k.len() >= 5 && one_slip(k, key)) {
                return Err(self.error(key, format!("is not known; did you mean {near:?}?")));
            }
            if strict && !value.is_string() && !value.is_null() {
                let problem =
                    format!("is not known; expected {} (a text is a remark)", known.join(", "));
                return Err(self.error(key, problem));
            }
        }
        Ok(())
    }

    /// A required finite number.
    pub(super) fn number(&self, key: &str) -> Result<f64, InputError> {
        match self.map.get(key) {
            Some(value) => number(value).map_err(|problem| self.error(key, problem)),
            None => Err(self.error(key, self.missing(key))),
        }
    }

    /// A finite number; the default when the field is not there. Null is no number.
    pub(super) fn number_or(&self, key: &str, default: f64) -> Result<f64, InputError> {
        if self.map.contains_key(key) { self.number(key) } else { Ok(default) }
    }

    /// A required positive whole number.
    pub(super) fn count(&self, key: &str) -> Result<usize, InputError> {
        let value = self.number(key)?;
        if value >= 1.0 && value.fract() == 0.0 && value < 1e6 {
            return Ok(value as usize);
        }
        Err(self.error(key, format!("is {value}; expected a positive whole number of px")))
    }

    /// "is missing", with the fields that are there: a misspelt one shows.
    fn missing(&self, key: &str) -> String {
        let near = self.map.keys().find(|k| k.eq_ignore_ascii_case(key));
        match near {
            Some(near) => format!("is missing; did you mean to write {near:?} as {key:?}?"),
            None => {
                let found: Vec<_> = self.map.keys().map(String::as_str).take(MOST_NAMED).collect();
                let more = if self.map.len() > MOST_NAMED { ", …" } else { "" };
                format!("is missing; found only {}{more}", found.join(", "))
            }
        }
    }
}

/// Whether two names differ by one letter more, fewer, another, or two in the wrong order, in any
/// case.
fn one_slip(a: &str, b: &str) -> bool {
    let [a, b] = [a, b].map(|s| s.to_lowercase().into_bytes());
    let first = a.iter().zip(&b).take_while(|(a, b)| a == b).count();
    let (a, b) = (&a[first..], &b[first..]);
    let rest = |s: &[u8], skip: usize| s.get(skip..).map(<[u8]>::to_vec);
    let swapped = a.len() > 1 && b.len() > 1 && a[0] == b[1] && a[1] == b[0];
    [(0, 1), (1, 0), (1, 1)]
        .into_iter()
        .any(|(i, j)| rest(a, i).is_some() && rest(a, i) == rest(b, j))
        || swapped && a[2..] == b[2..]
        || a.is_empty() && b.is_empty()
}

/// A finite number, also one that is written as a text (P2ILF), or what is wrong.
pub(super) fn number(value: &Value) -> Result<f64, String> {
    let texted = || value.as_str()?.trim().parse().ok();
    match value.as_f64().or_else(texted) {
        Some(number) if number.is_finite() => Ok(number),
        Some(number) => Err(format!("is {number}; expected a finite number")),
        None => Err(format!("is {value}; expected a finite number")),
    }
}

/// Every number in nested lists, row by row.
pub(super) fn flat_numbers(value: &Value) -> Result<Vec<f64>, String> {
    match value {
        Value::Array(items) => {
            let lists: Result<Vec<_>, _> = items.iter().map(flat_numbers).collect();
            Ok(lists?.concat())
        }
        value => Ok(vec![number(value)?]),
    }
}

/// Unsigned decimal numbers in a free text, in order, each with the text behind it.
pub(super) fn numbers_in(text: &str) -> Vec<(f64, &str)> {
    let mut out = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        rest = &rest[start..];
        let plain = |c: char| !(c.is_ascii_digit() || c == '.');
        let end = rest.find(plain).unwrap_or(rest.len());
        let digits = rest[..end].trim_end_matches('.');
        let after = &rest[end..];
        if let Ok(value) = digits.parse() {
            out.push((value, after));
        }
        rest = after;
    }
    out
}
