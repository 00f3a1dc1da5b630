//! Rust files as text, without their tests.

#![allow(dead_code, reason = "no test file needs all of it")]

use std::fs;
use std::path::{Path, PathBuf};

/// How an item begins that only tests have.
const TEST: [&str; 2] = ["#[cfg(test)]", "#[cfg(all(test,"];

/// Every file of a folder but those that are declared for tests alone.
pub fn sources(folder: &Path) -> Vec<PathBuf> {
    let all = files(folder);
    let tests: Vec<PathBuf> = all.iter().flat_map(|path| test_modules(path)).collect();
    let is_test = |path: &Path| tests.iter().any(|test| path.with_extension("").starts_with(test));
    all.into_iter().filter(|path| !is_test(path)).collect()
}

/// A file without comments and tests.
pub fn code(text: &str) -> String {
    let code = without_tests(text);
    code.lines().filter(|l| !l.trim_start().starts_with("//")).map(|l| format!("{l}\n")).collect()
}

/// A file without its modules and single items for tests; what follows them is kept.
pub fn without_tests(text: &str) -> String {
    let (mut kept, mut at) = (String::new(), 0);
    while at < text.len() {
        let rest = &text[at..];
        if starts_test(rest) {
            at += item(rest);
        } else {
            kept.push_str(&rest[..token(rest)]);
            at += token(rest);
        }
    }
    kept
}

fn starts_test(text: &str) -> bool {
    TEST.iter().any(|test| text.starts_with(test))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let (folders, files): (Vec<_>, Vec<_>) = entries.partition(|p| p.is_dir());
    let inner = folders.iter().flat_map(|folder| self::files(folder));
    files.into_iter().filter(|p| p.extension().is_some_and(|e| e == "rs")).chain(inner).collect()
}

/// The modules that a file declares by `#[cfg(test)] mod x;`, as paths without `.rs`.
fn test_modules(path: &Path) -> Vec<PathBuf> {
    let own = path.with_extension("");
    let holds_room = own.ends_with("mod") || own.ends_with("lib") || own.ends_with("main");
    let folder = if holds_room { own.parent().unwrap() } else { &own };
    let text = fs::read_to_string(path).unwrap();
    let named = |(at, _): (usize, &str)| {
        let declared = text[at..at + item(&text[at..])].strip_suffix(';')?;
        let (_, name) = declared.rsplit_once("mod ").filter(|(before, _)| !before.contains('{'))?;
        Some(folder.join(name))
    };
    TEST.iter().flat_map(|test| text.match_indices(test)).filter_map(named).collect()
}

/// Length of the item that a text begins with, its attributes included.
fn item(text: &str) -> usize {
    let (mut at, mut depth) = (0, 0);
    while at < text.len() {
        let word = &text[at..at + token(&text[at..])];
        depth += i32::from(["(", "[", "{"].contains(&word));
        depth -= i32::from([")", "]", "}"].contains(&word));
        if depth < 0 {
            // What surrounds it ends.
            return at;
        }
        at += word.len();
        if depth == 0 && ["}", ";"].contains(&word) {
            break;
        }
    }
    at
}

/// Length of the comment, the text, the letter between quotes or else of the one letter that a text
/// begins with.
fn token(text: &str) -> usize {
    let up_to = |end: &str, from: usize| {
        text[from..].find(end).map_or(text.len(), |found| from + found + end.len())
    };
    let hashes = text[1.min(text.len())..].chars().take_while(|c| *c == '#').count();
    let first = text.chars().next().map_or(0, char::len_utf8);
    match &text[..first] {
        "/" if text.starts_with("//") => text.find('\n').unwrap_or(text.len()),
        "/" if text.starts_with("/*") => up_to("*/", 2),
        "r" if text[1 + hashes..].starts_with('"') => {
            up_to(&format!("\"{}", "#".repeat(hashes)), hashes + 2)
        }
        "\"" => quoted(text, '"'),
        "'" if text[1..].starts_with('\\') => quoted(text, '\''),
        // Else it is a lifetime.
        "'" if text[1..].chars().nth(1) == Some('\'') => quoted(text, '\''),
        _ => first,
    }
}

/// Length of a text between quotes, in which `\` escapes.
fn quoted(text: &str, quote: char) -> usize {
    let mut escaped = false;
    let ends = |(at, c): &(usize, char)| {
        let ends = *at > 0 && *c == quote && !escaped;
        escaped = *c == '\\' && !escaped;
        ends
    };
    text.char_indices().find(ends).map_or(text.len(), |(at, _)| at + 1)
}
