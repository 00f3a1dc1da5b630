//! `docs/requirements.md` names tests that exist, and leaves no requirement without one unsaid; and
//! what it says of connections is so.

#[path = "common/source.rs"]
mod source;

use source::{sources, without_tests};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// One row of a table.
struct Requirement {
    id: String,
    /// `file::function`, as written.
    tests: Vec<String>,
    /// What stands in its last column.
    shown: String,
}

/// `P-4.1`: a capital, a hyphen, numbers.
fn is_id(cell: &str) -> bool {
    let Some((letter, number)) = cell.split_once('-') else { return false };
    letter.len() == 1
        && letter.chars().all(|c| c.is_ascii_uppercase())
        && number.split('.').all(|n| !n.is_empty() && n.chars().all(|c| c.is_ascii_digit()))
}

fn requirements(text: &str) -> Vec<Requirement> {
    let rows = text.lines().filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |"));
    rows.filter(|row| !row.starts_with("id |") && !row.starts_with("---"))
        .map(|row| {
            let cells: Vec<&str> = row.split(" | ").collect();
            let [id, _, shown] = cells[..] else { panic!("expected three columns: {row}") };
            assert!(is_id(id), "{id:?} is no identifier");
            // What stands between backticks and names a function; options do too, without.
            let tests = shown.split('`').skip(1).step_by(2).filter(|t| t.contains("::"));
            let tests = tests.map(str::to_owned).collect();
            Requirement { id: id.into(), tests, shown: shown.into() }
        })
        .collect()
}

fn file_of(short: &str) -> PathBuf {
    let (folder, rest) = short.split_once('/').unwrap_or_else(|| panic!("{short}"));
    let package = match folder {
        "src" | "tests" => format!("crates/dsfms/{folder}"),
        "cli" => "crates/dsfms-cli".into(),
        "python" => "crates/dsfms-python".into(),
        other => panic!("{short}: no package is called {other}"),
    };
    root().join(package).join(rest)
}

/// Whether a file has a test of that name: the function, and the attribute above it.
fn has_test(text: &str, name: &str) -> bool {
    let [rust, python] = [format!("fn {name}("), format!("def {name}(")];
    let mut is_test = false;
    for line in text.lines().map(str::trim) {
        if line.starts_with(&python) {
            return name.starts_with("test_");
        }
        if line.starts_with(&rust) {
            return is_test;
        }
        is_test = line == "#[test]" || (is_test && (line.starts_with("#[") || line.is_empty()));
    }
    false
}

#[test]
fn every_requirement_has_its_tests_and_they_exist() {
    let text = fs::read_to_string(root().join("docs/requirements.md")).unwrap();
    let all = requirements(&text);
    assert!(all.len() > 80, "only {} requirements were found", all.len());
    let (mut seen, mut wrong) = (BTreeSet::new(), Vec::new());
    for Requirement { id, tests, shown } in &all {
        if !seen.insert(id) {
            wrong.push(format!("{id} is there twice"));
        }
        if tests.is_empty() && !shown.contains("not tested") {
            wrong.push(format!("{id} has no test and does not say so"));
        }
        for test in tests {
            let (file, name) = test.split_once("::").unwrap();
            match fs::read_to_string(file_of(file)) {
                Ok(text) if has_test(&text, name) => {}
                Ok(_) => wrong.push(format!("{id}: {file} has no test {name}")),
                Err(error) => wrong.push(format!("{id}: {file}: {error}")),
            }
        }
    }
    // Every equation and every section from 3 to 8 of the paper.
    for section in 3..=8 {
        let prefix = format!("P-{section}.");
        assert!(all.iter().any(|r| r.id.starts_with(&prefix)), "nothing of section {section}");
    }
    for equation in ["Eq. 1", "Eq. 2", "Eq. 3", "Eq. 4"] {
        assert!(text.contains(equation), "{equation}");
    }
    assert!(wrong.is_empty(), "docs/requirements.md:\n{}", wrong.join("\n"));
}

#[test]
fn the_reader_of_the_page_sees_what_is_wrong() {
    let page = "| id | requirement | shown by |\n| --- | --- | --- |\n\
        | A-1 | one | `src/a.rs::x`, *`cli/b.rs::y`* |\n| A-1 | two | a promise |\n";
    let all = requirements(page);
    assert_eq!(all.len(), 2);
    assert_eq!(all[0].tests, ["src/a.rs::x", "cli/b.rs::y"]);
    assert!(all[1].tests.is_empty() && all[0].id == all[1].id);
    assert!(is_id("P-4.12") && !is_id("P4") && !is_id("p-1") && !is_id("P-"));
    let code = "#[test]\nfn a() {}\nfn b() {}\n    #[test]\n    #[ignore = \"x\"]\n    fn c() {}\n";
    assert!(has_test(code, "a") && has_test(code, "c"));
    assert!(!has_test(code, "b") && !has_test(code, "d"));
    assert!(has_test("def test_x(a):\n", "test_x") && !has_test("def x(a):\n", "x"));
}

/// Sockets are named in the viewer and in the OpenIGTLink of `track`, and no package that speaks
/// HTTP is linked.
#[test]
fn connections_are_opened_where_they_are_promised() {
    let with_sockets = |package: &str| -> BTreeSet<String> {
        let folder = root().join(package).join("src");
        let files = sources(&folder).into_iter().filter(|path| {
            let code = without_tests(&fs::read_to_string(path).unwrap());
            ["TcpStream", "TcpListener", "UdpSocket", "UnixStream", "std::net"]
                .iter()
                .any(|word| code.contains(word))
        });
        let name = |path: PathBuf| path.strip_prefix(&folder).unwrap().display().to_string();
        files.map(name).collect()
    };
    assert_eq!(with_sockets("crates/dsfms"), BTreeSet::new());
    let program = with_sockets("crates/dsfms-cli");
    let view = ["commands/view.rs", "commands/view/http.rs"];
    let promised =
        |file: &String| view.contains(&file.as_str()) || file.starts_with("commands/track/");
    assert!(program.iter().all(promised) && program.len() >= 2, "{program:?}");
    let lock = fs::read_to_string(root().join("Cargo.lock")).unwrap();
    for package in
        ["reqwest", "hyper", "ureq", "curl", "isahc", "attohttpc", "native-tls", "rustls"]
    {
        assert!(!lock.contains(&format!("name = \"{package}\"")), "{package} is linked");
    }
}
