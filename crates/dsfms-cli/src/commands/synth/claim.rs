//! Whose folder it is.

use crate::exit::Usage;
use crate::outputs::{check_folder, prepare_folder, write_json};
use crate::place::mark;
use anyhow::Context;
use dsfms::guard;
use std::path::Path;

/// A folder belongs to one run, whose parameters lie in it and are its mark.
pub struct Claim<'a> {
    pub name: &'a str,
    pub parameters: serde_json::Value,
    /// What a folder of other parameters holds.
    pub other: &'a str,
}

impl Claim<'_> {
    /// Refuse, before anything is written, a folder of another run, or one with what has `ours` for
    /// a name and is of no run: it would be replaced, or taken for a part of this one. Else mark
    /// the folder.
    pub fn take(&self, folder: &Path, ours: impl Fn(&str) -> bool) -> anyhow::Result<()> {
        let Self { name, parameters, other } = self;
        let path = folder.join(name);
        if path.exists() {
            let text = guard::read_text_at_most(&path, guard::MOST_JSON_BYTES)
                .with_context(|| format!("{}: cannot be read", path.display()))?;
            let old = serde_json::from_str::<serde_json::Value>(&text);
            if old.is_ok_and(|old| old == *parameters) {
                return prepare_folder(folder);
            }
            return Err(Usage(format!(
                "{} holds {other} (see {name} in it); choose another folder or remove it",
                folder.display()
            ))
            .into());
        }
        if let Some(found) = mark::names(folder)?.iter().find(|found| ours(found)) {
            anyhow::bail!(
                "{} already holds {found}, and no {name} that says it is of an older run; choose another folder \
                 with -o, or empty this one",
                folder.display()
            );
        }
        check_folder(folder)?;
        prepare_folder(folder)?;
        write_json(&path, parameters)
    }
}
