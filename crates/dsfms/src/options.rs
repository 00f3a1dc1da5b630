//! What all options share: a check that names the field, and a TOML file of the defaults with the
//! documentation of every field.

use serde::Serialize;
use serde::de::{DeserializeOwned, Error};
use std::fmt::Write;

/// An option out of its bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("option {field} must be {expected}")]
pub struct OptionError {
    /// Name of the field, with the tables it stands in.
    pub field: &'static str,
    /// The bounds.
    pub expected: &'static str,
}

/// The first check that fails: name of the field, whether it is good, the bounds.
pub(crate) fn check(checks: &[(&'static str, bool, &'static str)]) -> Result<(), OptionError> {
    match checks.iter().find(|(_, good, _)| !good) {
        Some(&(field, _, expected)) => Err(OptionError { field, expected }),
        None => Ok(()),
    }
}

/// Whether a weight, a bound or a rate is a number from 0.
pub(crate) fn from_zero(values: &[f64]) -> bool {
    values.iter().all(|v| *v >= 0.0 && v.is_finite())
}

/// Whether a noise or a scale, which is divided by, is a number above 0.
pub(crate) fn positive(values: &[f64]) -> bool {
    values.iter().all(|v| *v > 0.0 && v.is_finite())
}

/// Whether a blur is a part of the image's diagonal from 0: of more than a quarter nothing is left.
pub(crate) fn blurs(values: &[f64]) -> bool {
    values.iter().all(|v| (0.0..=0.25).contains(v))
}

/// Whether no field is "not a number": no comparison with it holds, so that a limit would be none.
pub(crate) fn numbers<T: Serialize>(options: &T) -> bool {
    fn number(value: &toml::Value) -> bool {
        match value {
            toml::Value::Float(x) => !x.is_nan(),
            toml::Value::Array(values) => values.iter().all(number),
            toml::Value::Table(table) => table.values().all(number),
            _ => true,
        }
    }
    toml::Value::try_from(options).is_ok_and(|value| number(&value))
}

/// A field of an options file that stood elsewhere in earlier versions.
pub(crate) enum Moved {
    /// From where, to where.
    To(&'static str, &'static str),
    /// The same for a number that is multiplied by this, since it is stated in other units.
    Scaled(&'static str, &'static str, f64),
    /// A number that is in these other fields: only its former default is read.
    In(&'static str, &'static str, f64),
}

/// `base` with what a TOML text names; the fields of `moved`, which stood in the table `below`
/// (`""`: the root), are also read from where they stood.
pub(crate) fn read<T: Serialize + DeserializeOwned>(
    base: &T,
    text: &str,
    below: &str,
    moved: &[Moved],
) -> Result<T, toml::de::Error> {
    let mut named: toml::Table = toml::from_str(text)?;
    let inner = match below {
        "" => Some(&mut named),
        below => named.get_mut(below).and_then(toml::Value::as_table_mut),
    };
    let carried = inner.map(|table| carry_over(table, moved)).transpose()?;
    if carried != Some(true) {
        // By itself first: its errors tell the line.
        toml::from_str::<T>(text)?;
    }
    let mut all = toml::Table::try_from(base).map_err(Error::custom)?;
    lay_over(&mut all, named);
    all.try_into()
}

/// Put fields where they stand; whether there were any elsewhere.
fn carry_over(named: &mut toml::Table, moved: &[Moved]) -> Result<bool, toml::de::Error> {
    let mut any = false;
    for field in moved {
        let (Moved::To(from, to) | Moved::Scaled(from, to, _) | Moved::In(from, to, _)) = field;
        let within = to.strip_prefix(from).is_some_and(|rest| rest.starts_with('.'));
        let Some(value) = take(named, from, within) else { continue };
        any = true;
        let number = value.as_float().or(value.as_integer().map(|i| i as f64));
        let value = match (field, number) {
            (Moved::Scaled(.., times), Some(number)) => (times * number).into(),
            (Moved::In(.., known), Some(number)) if *known == number => continue,
            (Moved::In(..), _) => return Err(Error::custom(format!("{from} is part of {to}"))),
            _ => value,
        };
        let mut keys: Vec<&str> = to.split('.').collect();
        let last = keys.pop().unwrap_or(to);
        let table = keys.iter().try_fold(&mut *named, |table, key| {
            let inner = table.entry(*key).or_insert_with(|| toml::Table::new().into());
            inner.as_table_mut()
        });
        let table = table.ok_or_else(|| Error::custom(format!("{from} is {to} instead")))?;
        if *table.entry(last).or_insert_with(|| value.clone()) != value {
            return Err(Error::custom(format!("{from} is {to} instead, and both are given")));
        }
    }
    Ok(any)
}

/// Remove the field at a path; where it stands `within` that now, a table is the new one.
fn take(table: &mut toml::Table, path: &str, within: bool) -> Option<toml::Value> {
    match path.split_once('.') {
        Some((key, below)) => take(table.get_mut(key)?.as_table_mut()?, below, within),
        None if within && table.get(path)?.is_table() => None,
        None => table.remove(path),
    }
}

/// Replace what another table names, table by table.
fn lay_over(under: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (under.get_mut(&key), value) {
            (Some(toml::Value::Table(under)), toml::Value::Table(over)) => lay_over(under, over),
            (_, value) => {
                under.insert(key, value);
            }
        }
    }
}

/// A table of an options file: its path (`""` for the root), and the source text and name of the
/// struct behind it, whose comments explain its fields.
pub(crate) type Documented = (&'static str, &'static str, &'static str);

/// The same tables where their options stand in a table of others (`""`: the root).
pub(crate) fn below(
    table: &str,
    tables: &[Documented],
) -> Vec<(String, &'static str, &'static str)> {
    let path = |own: &str| match (table, own) {
        ("", path) | (path, "") => path.to_owned(),
        (table, own) => format!("{table}.{own}"),
    };
    tables.iter().map(|&(own, source, name)| (path(own), source, name)).collect()
}

/// A TOML file of options, every field under its documentation; what is not set is commented out.
pub(crate) fn commented<T: Serialize>(
    options: &T,
    tables: &[(impl AsRef<str>, &str, &str)],
) -> String {
    let values = toml::Table::try_from(options).unwrap_or_default();
    let mut text = String::new();
    for (path, source, name) in tables {
        let path = path.as_ref();
        let mut keys = path.split('.').filter(|key| !key.is_empty());
        let table = keys.try_fold(&values, |table, key| table.get(key)?.as_table());
        let Some(table) = table else { continue };
        if !path.is_empty() {
            let _ = writeln!(text, "[{path}]");
        }
        for (docs, field) in fields(source, name) {
            let below = if path.is_empty() { field.to_owned() } else { format!("{path}.{field}") };
            if tables.iter().any(|(table, ..)| table.as_ref() == below) {
                continue;
            }
            docs.iter().for_each(|line| text += &format!("# {line}\n"));
            text += &match table.get(field) {
                Some(value) => format!("{field} = {value}\n"),
                None => format!("# {field} = (not set)\n"),
            };
        }
        text.push('\n');
    }
    text.trim_end().to_owned() + "\n"
}

/// The public fields of a struct in a source text, in order, each with its documentation.
fn fields<'s>(source: &'s str, name: &str) -> Vec<(Vec<&'s str>, &'s str)> {
    let start = format!("pub struct {name} {{");
    let lines = source.lines().skip_while(|line| *line != start).skip(1);
    let (mut found, mut docs) = (Vec::new(), Vec::new());
    for line in lines.take_while(|line| *line != "}").map(str::trim) {
        if let Some(doc) = line.strip_prefix("///") {
            docs.push(doc.trim());
        } else if let Some((field, _)) =
            line.strip_prefix("pub ").and_then(|line| line.split_once(':'))
        {
            found.push((std::mem::take(&mut docs), field));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize)]
    struct Outer {
        weight: f64,
        limit: Option<f64>,
        inner: Inner,
    }

    #[derive(Serialize)]
    struct Inner {
        on: bool,
    }

    const SOURCE: &str = "\
pub struct Outer {
    /// How heavy,
    /// kg.
    pub weight: f64,
    /// The most.
    #[serde(default)]
    pub limit: Option<f64>,
    /// A part.
    pub inner: Inner,
}
pub struct Inner {
    /// Whether.
    pub on: bool,
}
";

    #[test]
    fn fields_are_written_under_their_documentation() {
        let outer = Outer { weight: 2.5, limit: None, inner: Inner { on: true } };
        let text = commented(&outer, &[("", SOURCE, "Outer"), ("inner", SOURCE, "Inner")]);
        let expected = "# How heavy,\n# kg.\nweight = 2.5\n# The most.\n# limit = (not set)\n\n\
                        [inner]\n# Whether.\non = true\n";
        assert_eq!(text, expected);
    }

    #[derive(Debug, PartialEq, Serialize, serde::Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Moving {
        deep: Deep,
    }

    impl Default for Moving {
        fn default() -> Self {
            Self { deep: Deep { weight: 1.0, kind: "a".into(), count: 3 } }
        }
    }

    #[derive(Debug, Default, PartialEq, Serialize, serde::Deserialize)]
    #[serde(deny_unknown_fields, default)]
    struct Deep {
        weight: f64,
        kind: String,
        count: usize,
    }

    #[test]
    fn fields_are_read_from_where_they_stood_and_others_keep_their_value() {
        let moved = [
            Moved::To("deep", "deep.kind"),
            Moved::Scaled("deep.tons", "deep.weight", 10.0),
            Moved::In("deep.per", "deep.weight", 300.0),
        ];
        let read = |text: &str| read(&Moving::default(), text, "", &moved);
        let deep = |text: &str| read(text).unwrap().deep;
        assert_eq!(deep(""), Moving::default().deep);
        // A table that is named in part, at its own place.
        assert_eq!(deep("[deep]\nkind = \"b\"").kind, "b");
        assert_eq!(deep("[deep]\nkind = \"b\"").weight, 1.0);
        assert_eq!(deep("deep = \"b\"").kind, "b");
        assert_eq!(deep("[deep]\ntons = 2").weight, 20.0);
        assert_eq!(deep("[deep]\ntons = 2\nweight = 20.0").weight, 20.0);
        assert_eq!(deep("[deep]\nper = 300").count, 3);
        let refused = |text: &str| read(text).unwrap_err().to_string();
        assert!(refused("[deep]\nper = 200").contains("deep.per is part of deep.weight"));
        let both = refused("[deep]\ntons = 2\nweight = 5.0");
        assert!(both.contains("deep.tons is deep.weight instead"), "{both}");
        assert!(refused("[deep]\nother = 2").contains("line 2"));
    }

    #[test]
    fn the_first_failing_check_is_named() {
        assert_eq!(check(&[("a", true, "x")]), Ok(()));
        let error = check(&[("a", true, "x"), ("b", false, "positive"), ("c", false, "y")]);
        assert_eq!(error.unwrap_err().to_string(), "option b must be positive");
        assert!(!positive(&[1.0, 0.0]) && !from_zero(&[f64::NAN]) && from_zero(&[0.0]));
    }
}
