//! The subset of YAML that OpenCV, ROS and PyYAML write for a calibration: nested mappings,
//! sequences in block or bracket form, and scalars. Tags (`!!opencv-matrix`), document markers and
//! comments are dropped. The result is a JSON value.

use serde_json::{Map, Value};
use std::collections::VecDeque;

/// Most levels of nesting; a calibration has four.
const MOST_DEPTH: usize = 20;
/// Most lines with content: a calibration with the board's corners of every view has thousands.
const MOST_LINES: usize = 100_000;

/// A line with content: its number in the file, its indentation and the text.
#[derive(Clone, Debug)]
struct Line {
    number: usize,
    indent: usize,
    text: String,
}

/// Parse a document; the error is the 1-based line and what is wrong with it.
pub(super) fn parse(text: &str) -> Result<Value, (usize, String)> {
    let mut lines = VecDeque::from(logical_lines(text)?);
    let value = block(&mut lines, 0, 0)?;
    match lines.front() {
        Some(line) => Err((line.number, format!("unexpected indentation at {:?}", line.text))),
        None => Ok(value),
    }
}

/// Lines without comments and markers, brackets joined to one line.
fn logical_lines(text: &str) -> Result<Vec<Line>, (usize, String)> {
    let mut lines: Vec<Line> = Vec::new();
    let mut open = 0_i64;
    for (i, raw) in text.lines().enumerate() {
        let content = raw.split(" #").next().unwrap_or_default().trim_end();
        let trimmed = content.trim_start();
        let skipped = trimmed.is_empty() || trimmed.starts_with(['#', '%']);
        if skipped || ["---", "..."].contains(&trimmed) {
            continue;
        }
        if lines.len() == MOST_LINES {
            return Err((i + 1, format!("more than {MOST_LINES} lines: no calibration")));
        }
        match lines.last_mut() {
            Some(last) if open > 0 => {
                last.text.push(' ');
                last.text.push_str(trimmed);
            }
            _ => lines.push(Line {
                number: i + 1,
                indent: content.len() - trimmed.len(),
                text: trimmed.to_owned(),
            }),
        }
        open += trimmed.matches('[').count() as i64 - trimmed.matches(']').count() as i64;
    }
    match lines.last() {
        Some(last) if open != 0 => Err((last.number, "brackets are not balanced".into())),
        _ => Ok(lines),
    }
}

/// A mapping or sequence whose lines are indented by at least `indent`.
fn block(
    lines: &mut VecDeque<Line>,
    indent: usize,
    depth: usize,
) -> Result<Value, (usize, String)> {
    let Some(first) = lines.front().cloned().filter(|line| line.indent >= indent) else {
        return Ok(Value::Null);
    };
    if depth > MOST_DEPTH {
        return Err((first.number, "nested too deeply".into()));
    }
    if first.text.starts_with("- ") || first.text == "-" {
        sequence(lines, first.indent, depth)
    } else if key_and_rest(&first.text).is_some() {
        mapping(lines, first.indent, depth)
    } else {
        lines.pop_front();
        scalar(&first.text, first.number, depth)
    }
}

fn sequence(
    lines: &mut VecDeque<Line>,
    indent: usize,
    depth: usize,
) -> Result<Value, (usize, String)> {
    let mut items = Vec::new();
    while let Some(line) = lines.front_mut().filter(|line| line.indent == indent) {
        let Some(rest) = line.text.strip_prefix('-') else { break };
        // The item is a block of its own that begins behind the dash.
        let item = rest.trim_start().to_owned();
        let inner = indent + line.text.len() - item.len();
        if item.is_empty() {
            lines.pop_front();
        } else {
            (line.indent, line.text) = (inner, item);
        }
        items.push(block(lines, indent + 1, depth + 1)?);
    }
    Ok(Value::Array(items))
}

fn mapping(
    lines: &mut VecDeque<Line>,
    indent: usize,
    depth: usize,
) -> Result<Value, (usize, String)> {
    let mut map = Map::new();
    while let Some(line) = lines.front().filter(|line| line.indent == indent).cloned() {
        let Some((key, rest)) = key_and_rest(&line.text) else {
            return Err((line.number, format!("expected `name: value`, found {:?}", line.text)));
        };
        lines.pop_front();
        let rest = without_tag(rest);
        let value = if rest.is_empty() {
            // PyYAML does not indent a sequence below its key.
            let flush =
                lines.front().is_some_and(|l| l.indent == indent && l.text.starts_with("- "));
            block(lines, if flush { indent } else { indent + 1 }, depth + 1)?
        } else {
            scalar(rest, line.number, depth)?
        };
        map.insert(key.to_owned(), value);
    }
    Ok(Value::Object(map))
}

fn key_and_rest(text: &str) -> Option<(&str, &str)> {
    if text.starts_with('[') {
        return None;
    }
    let (key, rest) = text.split_once(':')?;
    let ends = rest.is_empty() || rest.starts_with([' ', '\t', '[']);
    ends.then(|| (key.trim().trim_matches(['"', '\'']), rest.trim()))
}

fn without_tag(text: &str) -> &str {
    match text.strip_prefix('!') {
        Some(tag) => tag.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim()),
        None => text,
    }
}

/// A number, a bracketed list of values, or a string.
fn scalar(text: &str, line: usize, depth: usize) -> Result<Value, (usize, String)> {
    let text = text.trim();
    if let Some(inner) = text.strip_prefix('[') {
        if depth > MOST_DEPTH {
            return Err((line, "nested too deeply".into()));
        }
        let inner = inner.strip_suffix(']').ok_or((line, "a list does not end with ]".into()))?;
        let items = split_top(inner).into_iter().map(|item| scalar(item, line, depth + 1));
        return Ok(Value::Array(items.collect::<Result<_, _>>()?));
    }
    // OpenCV writes `1.` and `.5`, which JSON would refuse.
    let number = text.parse::<f64>().ok().and_then(serde_json::Number::from_f64);
    Ok(match (number, text) {
        (Some(number), _) => Value::Number(number),
        (None, "null" | "~" | "") => Value::Null,
        (None, "true" | "false") => Value::Bool(text == "true"),
        _ => Value::String(text.trim_matches(['"', '\'']).to_owned()),
    })
}

/// Split at the commas that are in no inner bracket; a trailing comma adds nothing.
fn split_top(text: &str) -> Vec<&str> {
    let (mut items, mut depth, mut start) = (Vec::new(), 0, 0);
    for (i, c) in text.char_indices() {
        match c {
            '[' => depth += 1,
            ']' => depth -= 1,
            ',' if depth == 0 => {
                items.push(text[start..i].trim());
                start = i + 1;
            }
            _ => {}
        }
    }
    items.push(text[start..].trim());
    items.retain(|item| !item.is_empty());
    items
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_opencv_writes() {
        let text = "%YAML:1.0\n---\nimage_width: 640\nK: !!opencv-matrix\n   rows: 1\n   cols: 3\n   dt: d\n   data: [ 5.48e+02, 0.,\n       .5 ]\n";
        let expected = json!({
            "image_width": 640.0,
            "K": { "rows": 1.0, "cols": 3.0, "dt": "d", "data": [548.0, 0.0, 0.5] }
        });
        assert_eq!(parse(text).unwrap(), expected);
    }

    #[test]
    fn what_pyyaml_writes() {
        let text = "K:\n- - 1.0\n  - 2\n- - 3\n  - .nan\nname: 'left'  # comment\nd: [[1], [2]]\n";
        let expected =
            json!({ "K": [[1.0, 2.0], [3.0, ".nan"]], "name": "left", "d": [[1.0], [2.0]] });
        assert_eq!(parse(text).unwrap(), expected);
    }

    #[test]
    fn depth_and_length_are_bounded() {
        let start = std::time::Instant::now();
        let deep = format!("a: {}{}\n", "[".repeat(60_000), "]".repeat(60_000));
        assert!(parse(&deep).unwrap_err().1.contains("too deeply"));
        let long: String = (0..150_000).map(|i| format!("key{i}: {i}\n")).collect();
        assert!(parse(&long).unwrap_err().1.contains("100000 lines"));
        let allowed: String = (0..90_000).map(|i| format!("key{i}: {i}\n")).collect();
        assert_eq!(parse(&allowed).unwrap().as_object().unwrap().len(), 90_000);
        assert!(parse(&"- ".repeat(90_000)).unwrap_err().1.contains("too deeply"));
        assert!(start.elapsed() < std::time::Duration::from_secs(10), "{:?}", start.elapsed());
    }

    #[test]
    fn errors_name_the_line() {
        assert_eq!(parse("a: 1\nb 2\n").unwrap_err().0, 2);
        assert_eq!(parse("a: [1, 2\n").unwrap_err().0, 1);
        assert!(parse("a: 1\n   b: 2\n").is_err());
    }
}
