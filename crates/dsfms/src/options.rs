//! What all options share: a check that names the field, and a TOML file of the defaults with the
//! documentation of every field.

use serde::Serialize;
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

/// A table of an options file: its path (`""` for the root), and the source text and name of the struct
/// behind it, whose comments explain its fields.
pub(crate) type Documented = (&'static str, &'static str, &'static str);

/// A TOML file of options, every field under its documentation; what is not set is commented out.
pub(crate) fn commented<T: Serialize>(options: &T, tables: &[Documented]) -> String {
    let values = toml::Table::try_from(options).unwrap_or_default();
    let mut text = String::new();
    for &(path, source, name) in tables {
        let mut keys = path.split('.').filter(|key| !key.is_empty());
        let table = keys.try_fold(&values, |table, key| table.get(key)?.as_table());
        let Some(table) = table else { continue };
        if !path.is_empty() {
            let _ = writeln!(text, "[{path}]");
        }
        for (docs, field) in fields(source, name) {
            let below = if path.is_empty() { field.to_owned() } else { format!("{path}.{field}") };
            if tables.iter().any(|(table, ..)| *table == below) {
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

    #[test]
    fn the_first_failing_check_is_named() {
        assert_eq!(check(&[("a", true, "x")]), Ok(()));
        let error = check(&[("a", true, "x"), ("b", false, "positive"), ("c", false, "y")]);
        assert_eq!(error.unwrap_err().to_string(), "option b must be positive");
        assert!(!positive(&[1.0, 0.0]) && !from_zero(&[f64::NAN]) && from_zero(&[0.0]));
    }
}
