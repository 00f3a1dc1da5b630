//! The mark of a folder that a command of ours wrote: what has our names there may be replaced,
//! elsewhere it is the user's.

use crate::outputs::{prepare_folder, write_json};
use anyhow::Context;
use dsfms::guard;
use serde::Serialize;
use std::path::Path;

/// Says which command wrote the folder.
pub const MARK: &str = "dsfms.json";

/// It has two lines; more is no mark of ours.
const MOST_MARK_BYTES: u64 = 1 << 16;

#[derive(Serialize)]
struct Mark<'a> {
    generator: &'a str,
    command: &'a str,
}

/// Refuse, before any work, a folder that `option` names and that another command marked, or that
/// holds what has one of our names without the mark of `commands`.
pub fn check_names(
    folder: &Path,
    commands: &[&str],
    option: &str,
    ours: impl Fn(&str) -> bool,
) -> anyhow::Result<()> {
    let shown = folder.display();
    match marked_by(folder) {
        Some(other) if !is_one(&other, commands) => anyhow::bail!(
            "{shown} holds results of `dsfms {other}`, as {MARK} in it says; choose another folder with {option}"
        ),
        Some(_) => Ok(()),
        None => match names(folder)?.into_iter().find(|name| name == MARK || ours(name)) {
            Some(name) => Err(foreign(folder, &name, option)),
            None => Ok(()),
        },
    }
}

/// The error about a file or folder that no run of ours left.
pub fn foreign(folder: &Path, name: &str, option: &str) -> anyhow::Error {
    anyhow::anyhow!(
        "{} already holds {name}, and no {MARK} that says it is of an older run; choose another folder with \
         {option}, or empty this one",
        folder.display()
    )
}

/// Whether one of these commands marked the folder.
pub fn is_marked(folder: &Path, commands: &[&str]) -> bool {
    marked_by(folder).is_some_and(|command| is_one(&command, commands))
}

/// Make the folder and mark it, before anything is written into it; a mark that is there stays.
pub fn claim(folder: &Path, command: &str) -> anyhow::Result<()> {
    prepare_folder(folder)?;
    match is_marked(folder, &[command]) {
        true => Ok(()),
        false => write(folder, command),
    }
}

/// Write the mark.
pub fn write(folder: &Path, command: &str) -> anyhow::Result<()> {
    let generator = concat!("dsfms ", env!("CARGO_PKG_VERSION"));
    write_json(&folder.join(MARK), &Mark { generator, command })
}

/// Remove the files of these names that an older run left in a marked folder.
pub fn remove(folder: &Path, ours: impl Fn(&str) -> bool) -> anyhow::Result<()> {
    let files = names(folder)?.into_iter().filter(|name| ours(name)).map(|name| folder.join(name));
    files.filter(|path| !path.is_dir()).try_for_each(|path| {
        std::fs::remove_file(&path)
            .with_context(|| format!("cannot remove {} of an older run", path.display()))
    })
}

/// The command that a mark names; empty where it names none, as those of the first versions.
fn marked_by(folder: &Path) -> Option<String> {
    let text = guard::read_text_at_most(&folder.join(MARK), MOST_MARK_BYTES).ok()?;
    let mark: serde_json::Value = serde_json::from_str(&text).ok()?;
    mark.is_object().then(|| mark["command"].as_str().unwrap_or_default().to_owned())
}

fn is_one(command: &str, commands: &[&str]) -> bool {
    command.is_empty() || commands.contains(&command)
}

/// What lies directly in a folder, by name; nothing where it does not exist.
pub fn names(folder: &Path) -> anyhow::Result<Vec<String>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let unreadable = || format!("the output folder {} cannot be read", folder.display());
    let name =
        |e: std::io::Result<std::fs::DirEntry>| Ok(e?.file_name().to_string_lossy().into_owned());
    let names: std::io::Result<Vec<_>> =
        std::fs::read_dir(folder).with_context(unreadable)?.map(name).collect();
    let mut names = names.with_context(unreadable)?;
    names.sort_unstable();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::write as save;

    #[test]
    fn a_folder_belongs_to_the_command_that_marked_it() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let check = |commands: &[&str]| {
            check_names(at, commands, "-o", |n| n == "a").map_err(|e| e.to_string())
        };
        save(at.join("notes.txt"), "x").unwrap();
        check(&["demo"]).unwrap();
        save(at.join("a"), "x").unwrap();
        assert!(check(&["demo"]).unwrap_err().contains("already holds a,"));
        claim(at, "demo").unwrap();
        check(&["demo"]).unwrap();
        assert!(check(&["track"]).unwrap_err().contains("`dsfms demo`"));
        assert!(is_marked(at, &["demo"]) && !is_marked(at, &["track"]));
        // Of a version that named no command, and no mark at all.
        save(at.join(MARK), "{}").unwrap();
        check(&["track"]).unwrap();
        for text in ["", "3", "no JSON"] {
            save(at.join(MARK), text).unwrap();
            assert!(check(&["demo"]).is_err(), "{text}");
        }
    }
}
