//! A command that is refused: its exit code, its message, and that it leaves nothing.

use super::Case;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Nothing was produced.
pub const NOTHING: i32 = 1;
/// Wrong usage.
pub const USAGE: i32 = 64;

/// A line longer than this is a page, not a message.
const LONGEST_LINE: usize = 400;

/// Every file and folder below, and the contents of the files.
fn listing(folder: &Path) -> BTreeSet<(PathBuf, Vec<u8>)> {
    let mut found = BTreeSet::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.append(&mut listing(&path));
        }
        let content = if path.is_file() { fs::read(&path).unwrap() } else { Vec::new() };
        found.insert((path, content));
    }
    found
}

/// What is wrong with a refusal: another exit code, a word that the message lacks, no single
/// message, anything that is new, changed or gone in the case's folder.
pub fn faults(case: &Case, arguments: &[&str], code: i32, words: &[&str]) -> Vec<String> {
    let before = listing(case.folder.path());
    let done = case.dsfms(arguments).write_stdin("").output().unwrap();
    let text = String::from_utf8_lossy(&done.stderr).into_owned();
    let mut wrong = Vec::new();
    if done.status.code() != Some(code) {
        wrong.push(format!("exit code {:?}, expected {code}", done.status.code()));
    }
    let lacking = words.iter().filter(|word| !text.contains(**word));
    wrong.extend(lacking.map(|word| format!("does not say {word:?}")));
    if text.contains("panicked") || text.matches("error:").count() != 1 {
        wrong.push("not one error".into());
    }
    if text.lines().any(|line| line.chars().count() > LONGEST_LINE) {
        wrong.push(format!("a line of more than {LONGEST_LINE} letters"));
    }
    let after = listing(case.folder.path());
    let changed: BTreeSet<_> = after.symmetric_difference(&before).map(|file| &file.0).collect();
    if !changed.is_empty() {
        wrong.push(format!("left or changed {changed:?}"));
    }
    if !wrong.is_empty() {
        wrong.push(text);
    }
    wrong
}

/// The command is refused with this code, a message that holds every word, and nothing left.
pub fn refused(case: &Case, arguments: &[&str], code: i32, words: &[&str]) {
    let wrong = faults(case, arguments, code, words);
    assert!(wrong.is_empty(), "{arguments:?}:\n  {}", wrong.join("\n  "));
}
