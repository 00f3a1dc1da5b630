//! A light and a lens stand in a file of their own and in one line of a table; nobody else asks
//! which it is.

#[path = "common/source.rs"]
mod source;

use source::{code, sources};
use std::fs;
use std::path::{Path, PathBuf};

/// The type, the file with its table below `src`, and how the table begins.
const TABLES: [(&str, &str, &str); 2] =
    [("LightModel", "light/model.rs", "\nlights! {"), ("Lens", "camera/lens.rs", "\nlenses! {")];

#[test]
fn a_kind_is_named_in_its_line_only() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let packages = ["dsfms", "dsfms-cli", "dsfms-python"].map(|name| crates.join(name).join("src"));
    let files: Vec<PathBuf> = packages.iter().flat_map(|folder| sources(folder)).collect();
    for (name, table, begins) in TABLES {
        let table = packages[0].join(table);
        let kinds = kinds(&read(&table), begins);
        assert!(kinds.len() > 2, "no table in {}", table.display());
        for path in &files {
            let room = path.parent() == table.parent();
            let code = read(path);
            for kind in &kinds {
                let named = count(&code, &format!("{name}::{kind}"));
                let own = if room { count(&code, &format!("Self::{kind}")) } else { 0 };
                assert_eq!(named + own, 0, "{name}::{kind} in {}", path.display());
            }
        }
    }
}

/// First words of the lines of a table.
fn kinds(code: &str, begins: &str) -> Vec<String> {
    let table = code.split(begins).nth(1).unwrap_or_default().split("\n}").next().unwrap();
    let lines = table.lines().filter_map(|line| line.strip_prefix("    "));
    let lines = lines.filter(|line| line.starts_with(|c: char| c.is_ascii_uppercase()));
    lines.map(|line| line.chars().take_while(|c| c.is_alphanumeric()).collect()).collect()
}

/// Mentions of a path that does not go on.
fn count(code: &str, path: &str) -> usize {
    let goes_on = |rest: &&str| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '_');
    code.split(path).skip(1).filter(goes_on).count()
}

/// Without comments and tests, which may name what they like.
fn read(path: &Path) -> String {
    code(&fs::read_to_string(path).unwrap())
}
