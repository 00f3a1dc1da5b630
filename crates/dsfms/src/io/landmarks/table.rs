//! Landmarks as CSV with a header, columns found by name.

use super::super::error::InputError;
use super::mark::{Mark, MarkPlace, PickedPair};
use crate::geometry::Point3;
use std::path::Path;

/// Rows with their line numbers; the header's names in lower case.
struct Table<'t> {
    names: Vec<String>,
    rows: Vec<(usize, Vec<&'t str>)>,
}

impl<'t> Table<'t> {
    fn of(path: &Path, text: &'t str) -> Result<Self, InputError> {
        let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let words = |line: &'t str| line.split(',').map(|w| w.trim().trim_matches('"')).collect();
        let header: Vec<&str> = lines.next().map(|(_, line)| words(line)).unwrap_or_default();
        let names: Vec<String> = header.iter().map(|w| w.to_lowercase()).collect();
        let mut rows = Vec::new();
        for (number, line) in lines {
            let row: Vec<&str> = words(line);
            if row.len() != names.len() {
                let problem = format!("{} values, but the header has {}", row.len(), names.len());
                return Err(InputError::line(path, number, problem));
            }
            rows.push((number, row));
        }
        Ok(Self { names, rows })
    }

    fn column(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|n| n == name)
    }

    /// The columns of a place whose names begin with `prefix`.
    fn place(&self, prefix: &str) -> Option<PlaceColumns> {
        let xyz = ["x", "y", "z"].map(|axis| self.column(&format!("{prefix}{axis}")));
        match (xyz, self.column(&format!("{prefix}vertex"))) {
            ([Some(x), Some(y), Some(z)], _) => Some(PlaceColumns::Point([x, y, z])),
            (_, Some(vertex)) => Some(PlaceColumns::Vertex(vertex)),
            _ => None,
        }
    }

    fn name(&self, row: &[&str], number: usize) -> String {
        let given = ["name", "label"].iter().find_map(|n| self.column(n)).map(|c| row[c]);
        given.filter(|n| !n.is_empty()).map_or_else(|| number.to_string(), str::to_owned)
    }
}

enum PlaceColumns {
    Point([usize; 3]),
    Vertex(usize),
}

impl PlaceColumns {
    fn read(&self, row: &[&str]) -> Result<MarkPlace, String> {
        match self {
            Self::Vertex(column) => row[*column]
                .parse()
                .map(MarkPlace::Vertex)
                .map_err(|_| format!("{:?} is no vertex number", row[*column])),
            Self::Point(columns) => {
                let number = |c: usize| finite(row[c]);
                let [x, y, z] = columns.map(number);
                Ok(MarkPlace::Point(Point3::new(x?, y?, z?)))
            }
        }
    }
}

pub(super) fn finite(word: &str) -> Result<f64, String> {
    match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("{word:?}; expected a finite number")),
    }
}

pub(super) fn pairs(path: &Path, text: &str) -> Result<Vec<PickedPair>, InputError> {
    let table = Table::of(path, text)?;
    let columns = |prefix: &str| {
        table.place(prefix).ok_or_else(|| {
            let problem = format!(
                "no columns {prefix}x,{prefix}y,{prefix}z or {prefix}vertex; expected a header as \
                 name,ct_x,ct_y,ct_z,template_x,template_y,template_z or name,ct_vertex,template_vertex, found {}",
                table.names.join(",")
            );
            InputError::format(path, problem)
        })
    };
    let (ct, template) = (columns("ct_")?, columns("template_")?);
    let pair = |(k, (number, row)): (usize, &(usize, Vec<&str>))| {
        let place = |columns: &PlaceColumns| {
            columns.read(row).map_err(|problem| InputError::line(path, *number, problem))
        };
        Ok(PickedPair {
            name: table.name(row, k + 1),
            ct: place(&ct)?,
            template: place(&template)?,
        })
    };
    table.rows.iter().enumerate().map(pair).collect()
}

/// Points of one surface: `x,y,z` or `vertex`, and `name` or `label`.
pub(super) fn marks(path: &Path, text: &str) -> Result<Vec<Mark>, InputError> {
    let table = Table::of(path, text)?;
    let columns = table.place("").ok_or_else(|| {
        let found = table.names.join(",");
        let problem = format!("expected a header as name,x,y,z or name,vertex, found {found}");
        InputError::format(path, problem)
    })?;
    let mark = |(k, (number, row)): (usize, &(usize, Vec<&str>))| {
        let place =
            columns.read(row).map_err(|problem| InputError::line(path, *number, problem))?;
        Ok(Mark { name: table.name(row, k + 1), place })
    };
    table.rows.iter().enumerate().map(mark).collect()
}
