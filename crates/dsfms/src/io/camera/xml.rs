//! OpenCV's `.xml` storage as the value that its YAML would give.

use serde_json::{Map, Value};

/// Deepest element.
const MOST_DEPTH: usize = 16;

/// The content of `opencv_storage`; or the 1-based line and what is wrong there.
pub(super) fn parse(text: &str) -> Result<Value, (usize, String)> {
    let mut reader = XmlReader { text, at: 0 };
    // Elements that are open: name, members, text.
    let mut open: Vec<(String, Map<String, Value>, String)> = Vec::new();
    loop {
        let content = reader.until('<')?;
        if let Some((_, _, own)) = open.last_mut() {
            own.push_str(content);
        }
        let tag = match reader.comment() {
            true => continue,
            false => reader.until('>')?,
        };
        if tag.starts_with(['?', '!']) {
            continue;
        }
        let closed = tag.strip_prefix('/');
        let name =
            closed.unwrap_or(tag).split([' ', '\t', '\n', '\r', '/']).next().unwrap_or_default();
        if closed.is_none() {
            if open.len() == MOST_DEPTH {
                return Err(reader.problem("its elements are nested too deeply"));
            }
            open.push((name.into(), Map::new(), String::new()));
            if !tag.ends_with('/') {
                continue;
            }
        }
        let Some((own, members, text)) = open.pop().filter(|(own, ..)| own == name) else {
            return Err(reader.problem(&format!("</{name}> closes nothing")));
        };
        let value = if members.is_empty() { leaf(&own, &text) } else { Value::Object(members) };
        match open.last_mut() {
            Some((_, parent, _)) => drop(parent.insert(own, value)),
            None if own == "opencv_storage" => return Ok(value),
            None => return Err(reader.problem(&format!("<{own}> is not <opencv_storage>"))),
        }
    }
}

/// A number, a list of numbers, or a text. The `data` of a matrix is always a list.
fn leaf(name: &str, text: &str) -> Value {
    let text = text.trim();
    let numbers: Option<Vec<f64>> = text
        .split_whitespace()
        .map(|word| word.parse().ok().filter(|n: &f64| n.is_finite()))
        .collect();
    match numbers {
        Some(list) if list.len() == 1 && name != "data" => list[0].into(),
        Some(list) if !list.is_empty() => list.into(),
        _ => text.trim_matches('"').into(),
    }
}

struct XmlReader<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> XmlReader<'a> {
    fn problem(&self, problem: &str) -> (usize, String) {
        (1 + self.text[..self.at].matches('\n').count(), problem.into())
    }

    /// What stands before the next `end`, which is passed.
    fn until(&mut self, end: char) -> Result<&'a str, (usize, String)> {
        let rest = &self.text[self.at..];
        let length = rest.find(end).ok_or_else(|| {
            self.problem(&format!("ends before '{end}'; copy or export it again"))
        })?;
        self.at += length + 1;
        Ok(&rest[..length])
    }

    /// Whether a comment begins here; it is passed.
    fn comment(&mut self) -> bool {
        let rest = &self.text[self.at..];
        let end = rest.strip_prefix("!--").and_then(|rest| rest.find("-->"));
        self.at += end.map_or(0, |end| end + 6);
        end.is_some()
    }
}
