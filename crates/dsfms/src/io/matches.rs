//! Matches between template and frame: CSV with the columns `face,b1,b2,b3,x,y` (0-based face of
//! the template, barycentrics, px), found by name; further columns are ignored, rows with
//! `visible` 0 skipped.

use super::error::{InputError, read_text, write_text};
use super::names::{files_in, frame_number, name_of, stem_of};
use crate::geometry::Point2;
use crate::register::Match;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const COLUMNS: [&str; 6] = ["face", "b1", "b2", "b3", "x", "y"];
/// Barycentrics must sum to 1 within this, and may be negative by as much.
const BARYCENTRIC_TOLERANCE: f64 = 1e-3;

/// The match file of a frame: `source` itself when it is a file; in a folder the CSV with the
/// frame's stem, else the only one with its number.
///
/// # Errors
/// No such file, or several.
pub fn find_matches(source: &Path, frame: &str) -> Result<PathBuf, InputError> {
    if source.is_file() {
        return Ok(source.into());
    }
    let files = files_in(source, &["csv"])?;
    if let Some(exact) = files.iter().find(|path| stem_of(path) == frame) {
        return Ok(exact.clone());
    }
    let number = frame_number(frame);
    let with_number = |path: &&PathBuf| number.is_some() && holds_number(&stem_of(path), number);
    let candidates: Vec<&PathBuf> = files.iter().filter(with_number).collect();
    match candidates.as_slice() {
        [path] => Ok(path.to_path_buf()),
        [] => {
            let also = number.map(|n| format!(", or one CSV whose name holds the number {n}"));
            Err(InputError::NoPartner {
                path: source.into(),
                what: "match file",
                frame: frame.into(),
                expected: format!("{frame}.csv{}", also.unwrap_or_default()),
            })
        }
        several => Err(InputError::Ambiguous {
            path: source.into(),
            what: "match file",
            frame: frame.into(),
            candidates: several.iter().map(|path| name_of(path)).collect(),
        }),
    }
}

/// All match files: `source` itself when it is a file, else the CSV files of the folder in natural
/// order.
///
/// # Errors
/// A path that does not exist, a folder without CSV files.
pub fn all_matches(source: &Path) -> Result<Vec<PathBuf>, InputError> {
    if source.is_file() {
        return Ok(vec![source.into()]);
    }
    let files = files_in(source, &["csv"])?;
    match files.is_empty() {
        true => Err(InputError::format(source, "holds no match file; expected one CSV a frame")),
        false => Ok(files),
    }
}

/// Whether the last or the first number of a stem is the frame's: `frame_001_sparse25` is of
/// frame 1, as is `run25_frame_001`.
fn holds_number(stem: &str, number: Option<u64>) -> bool {
    let end = |c: char| !c.is_ascii_digit();
    let first = stem.find(|c: char| c.is_ascii_digit()).map(|at| &stem[at..]);
    let first = first.map(|rest| &rest[..rest.find(end).unwrap_or(rest.len())]);
    frame_number(stem) == number || first.and_then(|digits| digits.parse().ok()) == number
}

/// Read matches onto a template of `faces` faces, in a frame of `size` px. Pixels may lie up to
/// half an image outside the frame.
///
/// ```
/// use dsfms::io::matches::{read_matches, write_matches};
/// use dsfms::synth::Case;
///
/// let case = Case::example(1);
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("matches.csv");
/// write_matches(&path, &case.matches)?;
/// let faces = case.template.mesh.topology.faces.len();
/// assert_eq!(read_matches(&path, faces, case.camera.size)?, case.matches);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A file that cannot be read, a missing column, a face that does not exist, no match at all.
pub fn read_matches(path: &Path, faces: usize, size: [usize; 2]) -> Result<Vec<Match>, InputError> {
    let text = read_text(path)?;
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (number, header) = lines.next().unwrap_or((1, ""));
    let columns =
        Columns::find(header).map_err(|problem| InputError::line(path, number, problem))?;
    let mut matches = Vec::new();
    for (number, line) in lines {
        let row = columns
            .row(line, faces, size)
            .map_err(|problem| InputError::line(path, number, problem))?;
        matches.extend(row);
    }
    if matches.is_empty() {
        return Err(InputError::format(path, "holds no match (no rows, or none visible)"));
    }
    Ok(matches)
}

/// Write matches as [`read_matches`] reads them, every digit kept.
///
/// # Errors
/// A file that cannot be written.
pub fn write_matches(path: &Path, matches: &[Match]) -> Result<(), InputError> {
    let mut text = COLUMNS.join(",") + "\n";
    for m in matches {
        let [b1, b2, b3] = m.barycentric;
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{},{b1},{b2},{b3},{},{}", m.face, m.pixel.x, m.pixel.y);
    }
    write_text(path, &text)
}

/// Where the columns stand.
struct Columns {
    places: [usize; 6],
    visible: Option<usize>,
    count: usize,
}

impl Columns {
    fn find(header: &str) -> Result<Self, String> {
        let unquoted = |word: &str| word.trim().trim_matches('"').to_lowercase();
        let names: Vec<String> = header.split(',').map(unquoted).collect();
        let place = |name: &str| names.iter().position(|n| n == name);
        let missing: Vec<&str> = COLUMNS.into_iter().filter(|c| place(c).is_none()).collect();
        if !missing.is_empty() {
            return Err(format!(
                "column {} is missing; expected a header with {}, found {}",
                missing.join(", "),
                COLUMNS.join(","),
                names.join(",")
            ));
        }
        let places = COLUMNS.map(|name| place(name).unwrap_or_default());
        Ok(Self { places, visible: place("visible"), count: names.len() })
    }

    /// The match of a row; `None` when it is not visible.
    fn row(&self, line: &str, faces: usize, size: [usize; 2]) -> Result<Option<Match>, String> {
        let words: Vec<&str> = line.split(',').map(str::trim).collect();
        if words.len() != self.count {
            return Err(format!("{} values, but the header has {}", words.len(), self.count));
        }
        if self.visible.is_some_and(|at| hidden(words[at])) {
            return Ok(None);
        }
        let number = |column: usize| match words[self.places[column]].parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => {
                let (name, word) = (COLUMNS[column], words[self.places[column]]);
                Err(format!("{name} is {word:?}; expected a finite number"))
            }
        };
        let barycentric = [number(1)?, number(2)?, number(3)?];
        check_barycentric(&barycentric)?;
        let pixel = Point2::new(number(4)?, number(5)?);
        check_pixel(&pixel, size)?;
        Ok(Some(Match { face: face(number(0)?, faces)?, barycentric, pixel }))
    }
}

fn hidden(word: &str) -> bool {
    word.parse::<f64>().is_ok_and(|v| v == 0.0) || word.eq_ignore_ascii_case("false")
}

fn face(value: f64, faces: usize) -> Result<u32, String> {
    if value >= 0.0 && value.fract() == 0.0 && value < faces as f64 {
        return Ok(value as u32);
    }
    let last = faces.saturating_sub(1);
    Err(format!("face {value} is not in the template; expected a whole number from 0 to {last}"))
}

fn check_barycentric(b: &[f64; 3]) -> Result<(), String> {
    let sum: f64 = b.iter().sum();
    if (sum - 1.0).abs() > BARYCENTRIC_TOLERANCE {
        return Err(format!("b1 + b2 + b3 is {sum}, expected 1"));
    }
    match b.iter().find(|v| **v < -BARYCENTRIC_TOLERANCE) {
        Some(v) => Err(format!("a barycentric coordinate is {v}; expected none below 0")),
        None => Ok(()),
    }
}

fn check_pixel(p: &Point2, [w, h]: [usize; 2]) -> Result<(), String> {
    let near = |v: f64, n: usize| v > -0.5 * n as f64 && v < 1.5 * n as f64;
    if near(p.x, w) && near(p.y, h) {
        return Ok(());
    }
    Err(format!("pixel ({}, {}) lies far outside the {w}x{h} px frame", p.x, p.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Match>, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frame_001.csv");
        std::fs::write(&path, text).unwrap();
        read_matches(&path, 10, [640, 480]).map_err(|error| {
            assert!(error.to_string().contains("frame_001.csv"));
            error.to_string()
        })
    }

    #[test]
    fn columns_by_name_and_hidden_rows() {
        let text = " y, x ,b3,b2,b1,face,point_id,visible\n20.5,10.25,0.2,0.3,0.5,7,a,1\n1,1,0,0,1,3,b,0\n";
        let expected =
            Match { face: 7, barycentric: [0.5, 0.3, 0.2], pixel: Point2::new(10.25, 20.5) };
        assert_eq!(read(text).unwrap(), [expected]);
    }

    #[test]
    fn written_matches_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.csv");
        let third = 1.0 / 3.0;
        let m = Match { face: 3, barycentric: [third; 3], pixel: Point2::new(0.1 + 0.2, 1e-7) };
        write_matches(&path, &[m, m]).unwrap();
        assert_eq!(read_matches(&path, 4, [640, 480]).unwrap(), [m, m]);
    }

    #[test]
    fn bad_rows_are_named() {
        let row = |row: &str| format!("face,b1,b2,b3,x,y\n0,1,0,0,5,5\n{row}\n");
        for (text, words) in [
            (row("10,1,0,0,5,5"), "line 3: face 10 is not in the template"),
            (row("-1,1,0,0,5,5"), "face -1"),
            (row("1.5,1,0,0,5,5"), "face 1.5"),
            (row("1,nan,0,0,5,5"), "b1 is \"nan\""),
            (row("1,1,0,0,,5"), "x is \"\""),
            (row("1,0.5,0.2,0,5,5"), "b1 + b2 + b3 is 0.7"),
            (row("1,1.5,-0.5,0,5,5"), "-0.5"),
            (row("1,1,0,0,5,5000"), "far outside the 640x480 px frame"),
            (row("1,1,0,0,5"), "5 values, but the header has 6"),
            ("face,b1,b2,x,y\n".into(), "column b3 is missing"),
            ("1,1,0,0,5,5\n".into(), "line 1: column face, b1"),
            ("face,b1,b2,b3,x,y\n".into(), "no rows"),
            ("\n".into(), "empty"),
        ] {
            let message = read(&text).unwrap_err();
            assert!(message.contains(words), "{message:?} lacks {words:?}");
        }
    }

    #[test]
    fn the_file_of_a_frame() {
        let dir = tempfile::tempdir().unwrap();
        let touch = |name: &str| std::fs::write(dir.path().join(name), "x").unwrap();
        ["frame_001.csv", "frame_001_sparse25.csv", "frame_002_sparse25.csv"]
            .into_iter()
            .for_each(touch);
        let found = |frame: &str| find_matches(dir.path(), frame).map(|path| name_of(&path));
        assert_eq!(found("frame_001").unwrap(), "frame_001.csv");
        assert_eq!(found("frame_002").unwrap(), "frame_002_sparse25.csv");
        assert_eq!(found("deformed_2").unwrap(), "frame_002_sparse25.csv");
        assert!(matches!(found("img_001"), Err(InputError::Ambiguous { .. })));
        assert!(matches!(found("frame_003"), Err(InputError::NoPartner { .. })));
        let file = dir.path().join("frame_001.csv");
        assert_eq!(find_matches(&file, "whatever").unwrap(), file);
    }
}
