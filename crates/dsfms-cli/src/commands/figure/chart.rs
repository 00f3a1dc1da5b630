//! `dsfms figure TABLE.csv`: columns of a table as a chart.

use super::table::Table;
use crate::chart::{Chart, Plot, Series, Span, line_chart};
use crate::exit::Usage;
use clap::{Args, ValueEnum};
use std::path::Path;

#[derive(Debug, Args)]
#[command(next_help_heading = "Chart of TABLE.csv")]
pub struct ChartArgs {
    /// Column along the axis; default the first.
    #[arg(long, value_name = "COLUMN")]
    x: Option<String>,
    /// Columns to draw.
    #[arg(long, value_name = "COLUMN", value_delimiter = ',')]
    y: Vec<String>,
    /// Columns of the ends of thin bars, one for each of --y.
    #[arg(long, value_name = "COLUMN", value_delimiter = ',', requires = "y")]
    bars: Vec<String>,
    /// Column whose values tell lines apart (methods, models).
    #[arg(long, value_name = "COLUMN", requires = "y")]
    by: Option<String>,
    /// Axes in decades.
    #[arg(long, value_enum, value_delimiter = ',', requires = "y")]
    log: Vec<Axis>,
    /// Words above the chart; default the names of the columns.
    #[arg(long, value_name = "TEXT", requires = "y")]
    title: Option<String>,
    /// Words along the axis; default the name of its column.
    #[arg(long, value_name = "TEXT", requires = "y")]
    against: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Axis {
    X,
    Y,
}

impl ChartArgs {
    /// Whether a chart is asked for.
    pub fn given(&self) -> bool {
        self.x.is_some() || !self.y.is_empty()
    }

    /// The chart of a table, and what is left out of it.
    pub fn chart(&self, path: &Path) -> anyhow::Result<(Chart, Vec<String>)> {
        let table = Table::read(path)?;
        if self.y.is_empty() {
            let text = format!("--y says what of the table is drawn; {}", table.offers());
            return Err(Usage(text).into());
        }
        if !self.bars.is_empty() && self.bars.len() != self.y.len() {
            let (bars, y) = (self.bars.len(), self.y.len());
            return Err(Usage(format!("--bars has {bars} columns, --y has {y}")).into());
        }
        let along = self.x.as_deref().unwrap_or(table.first());
        let (places, ticks) = places(&table.column(along, "--x")?);
        let left_out = self.left_out(&table, along, &ticks)?;
        let series = self.series(&table, &places)?;
        let title = self.title.clone().unwrap_or_else(|| self.y.join(", "));
        let spans = spans(&table, &places);
        let strip = match self.by {
            None => statuses(&table, &places),
            Some(_) => Vec::new(),
        };
        let plot = Plot {
            value: &title,
            against: self.against.as_deref().unwrap_or(along),
            ticks: &ticks,
            decades: self.log.contains(&Axis::Y),
            decades_along: self.log.contains(&Axis::X),
            spans: &spans,
            strip: &strip,
            ..Plot::default()
        };
        Ok((line_chart(&plot, &series), left_out))
    }

    /// What decades leave out; places that are names have none.
    fn left_out(
        &self,
        table: &Table,
        along: &str,
        names: &[String],
    ) -> anyhow::Result<Vec<String>> {
        let mut words = Vec::new();
        if self.log.contains(&Axis::X) && names.is_empty() {
            words.extend(not_positive(table, along, "--x")?);
        }
        for column in self.y.iter().filter(|_| self.log.contains(&Axis::Y)) {
            words.extend(not_positive(table, column, "--y")?);
        }
        Ok(words)
    }

    /// A line for every column of `--y`, and of it for every value of `--by`.
    fn series(&self, table: &Table, places: &[f64]) -> anyhow::Result<Vec<Series>> {
        let groups = self.by.as_deref().map(|by| table.column(by, "--by")).transpose()?;
        // One nameless group where nothing tells lines apart.
        let groups: Vec<Option<&str>> = match groups {
            Some(groups) => groups.into_iter().map(Some).collect(),
            None => vec![None; places.len()],
        };
        let mut names: Vec<Option<&str>> = Vec::new();
        for &name in &groups {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let mut series = Vec::new();
        for (k, column) in self.y.iter().enumerate() {
            let values = numbers(&table.column(column, "--y")?);
            let bars = self.bars.get(k).map(|bar| table.column(bar, "--bars")).transpose()?;
            let bars = bars.map(|ends| numbers(&ends));
            for name in &names {
                let rows: Vec<usize> = (0..values.len()).filter(|&r| groups[r] == *name).collect();
                let label = match (name, self.y.len()) {
                    (None, 1) => String::new(),
                    (None, _) => column.clone(),
                    (Some(name), 1) => (*name).to_owned(),
                    (Some(name), _) => format!("{name}, {column}"),
                };
                series.push(Series {
                    label,
                    points: rows.iter().map(|&row| (places[row], values[row])).collect(),
                    whiskers: bars.iter().flat_map(|b| rows.iter().map(|&row| b[row])).collect(),
                });
            }
        }
        let drawn = series.iter().flat_map(|s| &s.points).any(|p| p.1.is_finite());
        anyhow::ensure!(drawn, "--y {}: no number in the column", self.y.join(","));
        Ok(series)
    }
}

/// Larger numbers overflow the arithmetic of the axes.
const LARGEST: f64 = 1e100;

/// Numbers; what is none is left out of a line.
fn numbers(values: &[&str]) -> Vec<f64> {
    let number = |value: &&str| value.trim().parse().ok().filter(|v: &f64| v.abs() < LARGEST);
    values.iter().map(|value| number(value).unwrap_or(f64::NAN)).collect()
}

/// How many numbers of a column have no place on an axis in decades; an error where none has one.
fn not_positive(table: &Table, column: &str, option: &str) -> anyhow::Result<Option<String>> {
    let words = table.column(column, option)?;
    let values = numbers(&words);
    let Some(first) = values.iter().position(|v| *v <= 0.0) else { return Ok(None) };
    let (row, value) = (first + 1, words[first].trim());
    anyhow::ensure!(
        values.iter().any(|v| *v > 0.0),
        "{option} {column}: an axis in decades (--log) shows numbers above zero, and no row has one (row {row}: {value})"
    );
    let (count, all) = (values.iter().filter(|v| **v <= 0.0).count(), values.len());
    Ok(Some(format!(
        "{option} {column}: {count} of {all} rows are not above zero (the first is row {row}: {value}), and have no \
         place on an axis in decades"
    )))
}

/// Where the rows lie: at their numbers, or side by side under their names.
fn places(values: &[&str]) -> (Vec<f64>, Vec<String>) {
    let numbers = numbers(values);
    if numbers.iter().all(|v| v.is_finite()) {
        return (numbers, Vec::new());
    }
    let mut names: Vec<String> = Vec::new();
    let mut place = |value: &&str| {
        let found = names.iter().position(|name| name == value);
        found.unwrap_or_else(|| {
            names.push((*value).to_owned());
            names.len() - 1
        }) as f64
    };
    let places = values.iter().map(&mut place).collect();
    (places, names)
}

/// Runs of rows that a column `event` gives a name.
fn spans(table: &Table, places: &[f64]) -> Vec<Span> {
    let Some(events) = table.find("event") else { return Vec::new() };
    let mut spans: Vec<Span> = Vec::new();
    let mut last = "";
    for (name, &place) in events.into_iter().zip(places) {
        match spans.last_mut().filter(|_| name == last) {
            _ if name.is_empty() => {}
            Some(span) => span.ends[1] = place,
            None => spans.push(Span { name: name.to_owned(), ends: [place; 2] }),
        }
        last = name;
    }
    spans
}

/// Places and words of a column `status`.
fn statuses(table: &Table, places: &[f64]) -> Vec<(f64, String)> {
    let found = table.find("status").unwrap_or_default();
    places.iter().copied().zip(found.into_iter().map(str::to_owned)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet::svg;

    fn args(x: &str, y: &[&str]) -> ChartArgs {
        ChartArgs {
            x: Some(x.into()),
            y: y.iter().map(ToString::to_string).collect(),
            bars: Vec::new(),
            by: None,
            log: Vec::new(),
            title: None,
            against: None,
        }
    }

    fn drawn(args: &ChartArgs, text: &str) -> anyhow::Result<String> {
        let file = tempfile::NamedTempFile::with_suffix(".csv")?;
        std::fs::write(file.path(), text)?;
        svg::paper(&args.chart(file.path())?.0.paper())
    }

    #[test]
    fn numbers_beyond_a_chart_s_arithmetic_are_left_out() {
        let text = "frame,error\n0,0.5\n1,1e308\n2,-1e308\n3,0.75\n";
        let svg = drawn(&args("frame", &["error"]), text).unwrap();
        assert!(
            svg.contains("3:7.5000e-1") && !svg.contains("NaN") && !svg.contains("inf"),
            "{svg}"
        );
    }

    #[test]
    fn columns_events_and_statuses_are_drawn() {
        let text = "frame,status,error,event\n0,ok,0.5,\n1,lost,,cut\n2,ok,0.75,cut\n3,ok,0.5,\n";
        let svg = drawn(&args("frame", &["error"]), text).unwrap();
        // Four statuses in three runs and their three keys, one span.
        assert_eq!(svg.matches("<polygon").count(), 3 + 3 + 1, "{svg}");
        assert_eq!(svg.matches("<circle").count(), 3, "{svg}");
        assert!(svg.contains(">cut</text>") && svg.contains(">lost or failed</text>"), "{svg}");
    }

    #[test]
    fn groups_are_lines_and_names_stand_side_by_side() {
        let text = "case,method,mean,p90\na,x,1,2\nb,x,2,3\na,y,3,4\nb,y,4,5\n";
        let mut args = args("case", &["mean"]);
        (args.by, args.bars) = (Some("method".into()), vec!["p90".into()]);
        let svg = drawn(&args, text).unwrap();
        for word in [">x</text>", ">y</text>", ">a</text>", ">b</text>", ">case</text>"] {
            assert_eq!(svg.matches(word).count(), 1, "{word}: {svg}");
        }
    }

    #[test]
    fn decades_have_no_place_for_zero() {
        let mut args = args("frame", &["error"]);
        args.log = vec![Axis::Y];
        let file = tempfile::NamedTempFile::with_suffix(".csv").unwrap();
        let read = |text: &str| {
            std::fs::write(file.path(), text).unwrap();
            args.chart(file.path()).map(|found| found.1)
        };
        assert!(read("frame,error\n0,0.5\n1,\n").unwrap().is_empty());
        let said = read("frame,error\n0,0.5\n1,0\n2,-3\n").unwrap();
        assert!(said[0].contains("error: 2 of 3 rows") && said[0].contains("row 2: 0"), "{said:?}");
        let error = read("frame,error\n0,-1\n1,0\n").unwrap_err().to_string();
        assert!(error.contains("--y error") && error.contains("row 1: -1"), "{error}");
        args.log = vec![Axis::X];
        std::fs::write(file.path(), "frame,error\n0,1\n1,2\n").unwrap();
        assert!(args.chart(file.path()).unwrap().1[0].contains("--x frame: 1 of 2"));
    }

    #[test]
    fn what_cannot_be_drawn_is_named() {
        let text = "frame,word\n1,red\n";
        for (y, words) in [("gone", "--y gone: the columns of"), ("word", "no number")] {
            let error = drawn(&args("frame", &[y]), text).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        assert!(drawn(&args("frame", &[]), text).unwrap_err().to_string().contains("frame, word"));
    }
}
