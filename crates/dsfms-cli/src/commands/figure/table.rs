//! A table of text with commas, as every command writes it.

use anyhow::Context;
use dsfms::guard;
use std::path::{Path, PathBuf};

/// Rows under named columns.
pub struct Table {
    path: PathBuf,
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Read a file: names in the first line, lines that begin with `#` left out.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let text =
            guard::read_text(path).with_context(|| format!("{} cannot be read", path.display()))?;
        // Spreadsheets write a mark before the text.
        Self::parse(path, text.trim_start_matches('\u{feff}'))
    }

    fn parse(path: &Path, text: &str) -> anyhow::Result<Self> {
        let name = path.display();
        let mut rows = records(text).into_iter();
        let columns = rows.next().with_context(|| format!("{name} is empty"))?;
        let rows: Vec<Vec<String>> = rows.collect();
        anyhow::ensure!(!rows.is_empty(), "{name} has no row below its header");
        if let Some(k) = rows.iter().position(|row| row.len() != columns.len()) {
            let (row, found, expected) = (k + 1, rows[k].len(), columns.len());
            anyhow::bail!(
                "{name}, row {row}: {found} fields, expected {expected} as in the header"
            );
        }
        Ok(Self { path: path.into(), columns, rows })
    }

    /// The name of the first column.
    pub fn first(&self) -> &str {
        &self.columns[0]
    }

    /// The values of a column; the error names all columns.
    pub fn column(&self, name: &str, option: &str) -> anyhow::Result<Vec<&str>> {
        match self.find(name) {
            Some(values) => Ok(values),
            None => anyhow::bail!("{option} {name}: {}", self.offers()),
        }
    }

    /// The values of a column, where there is one.
    pub fn find(&self, name: &str) -> Option<Vec<&str>> {
        let place = self.columns.iter().position(|column| column == name)?;
        Some(self.rows.iter().map(|row| row[place].as_str()).collect())
    }

    /// Which columns there are, for a message.
    pub fn offers(&self) -> String {
        format!("the columns of {} are {}", self.path.display(), self.columns.join(", "))
    }
}

/// Lines of fields; a field in quotes may hold commas, line ends and doubled quotes.
fn records(text: &str) -> Vec<Vec<String>> {
    let mut rows = Vec::new();
    let (mut row, mut field, mut quoted) = (Vec::new(), String::new(), false);
    let comments: String =
        text.lines().filter(|line| !line.starts_with('#')).flat_map(|line| [line, "\n"]).collect();
    let mut letters = comments.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if quoted && letters.next_if_eq(&'"').is_some() => field.push('"'),
            '"' => quoted = !quoted,
            ',' if !quoted => row.push(std::mem::take(&mut field)),
            '\n' if !quoted => {
                let empty = row.is_empty() && field.is_empty();
                row.push(std::mem::take(&mut field));
                let whole = std::mem::take(&mut row);
                rows.extend((!empty).then_some(whole));
            }
            other => field.push(other),
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_in_quotes_are_whole() {
        let text = "# told, aside\na,b\n1,\"x, \"\"y\"\"\"\n\n2,z\n";
        let table = Table::parse(Path::new("t.csv"), text).unwrap();
        assert_eq!(table.first(), "a");
        assert_eq!(table.find("b").unwrap(), ["x, \"y\"", "z"]);
        let error = table.column("c", "--y").unwrap_err().to_string();
        assert_eq!(error, "--y c: the columns of t.csv are a, b");
    }

    #[test]
    fn what_is_no_table_is_named() {
        for (text, word) in [("", "empty"), ("a,b\n", "no row"), ("a,b\n1\n", "row 1: 1 fields")] {
            let error = Table::parse(Path::new("t.csv"), text).err().unwrap().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
