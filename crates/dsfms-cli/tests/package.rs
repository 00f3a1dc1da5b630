//! What `cargo package` makes of the crates is whole: licences, the README, no invented address.
//! The image of the Dockerfile gets all that it names.

use std::path::Path;
use std::process::Command;

#[test]
fn packages_carry_licences_and_readme() {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    for name in ["dsfms", "dsfms-cli"] {
        let done = Command::new(env!("CARGO"))
            .current_dir(root)
            .args(["package", "--list", "--allow-dirty", "--offline", "-p", name])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&done.stdout).into_owned();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let files: Vec<&str> = text.lines().collect();
        for file in ["LICENSE-MIT", "LICENSE-APACHE", "README.md", "Cargo.lock"] {
            assert!(files.contains(&file), "{name} lacks {file}: {text}");
        }
    }
    let manifest = std::fs::read_to_string(format!("{root}/Cargo.toml")).unwrap();
    assert!(!manifest.contains("example.invalid") && manifest.contains("keywords"));
}

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn read(name: &str) -> String {
    std::fs::read_to_string(format!("{ROOT}/{name}")).unwrap()
}

/// The instructions of the Dockerfile, continued lines joined.
fn instructions() -> Vec<String> {
    let joined = read("Dockerfile").replace("\\\n", " ");
    let lines = joined.lines().map(|l| l.split_whitespace().collect::<Vec<_>>().join(" "));
    lines.filter(|l| !l.is_empty() && !l.starts_with('#')).collect()
}

/// `scripts/check_image.sh` builds it where buildah and debootstrap are; this needs neither.
#[test]
fn the_image_finds_what_it_names_and_runs_for_an_ordinary_user() {
    let all = instructions();
    let of = |word: &str| -> Vec<&str> {
        all.iter().filter_map(|l| l.strip_prefix(word)?.strip_prefix(' ')).collect()
    };
    // Both stages are of one Debian, and the compiler is the one that the workspace asks for.
    let [build, run] = of("FROM")[..] else { panic!("two stages: {all:?}") };
    let rust = read("Cargo.toml");
    let rust =
        rust.lines().find_map(|l| l.strip_prefix("rust-version = ")).unwrap().trim_matches('"');
    let debian = run.strip_prefix("debian:").unwrap();
    let other = debian.strip_suffix("-slim").unwrap();
    assert_eq!(build, format!("rust:{rust}-slim-{other} AS build"));
    // What the second stage takes from the source is in the context.
    let ignored = read(".dockerignore");
    let ignored: Vec<&str> = ignored.lines().collect();
    assert!(ignored.contains(&"target") && ignored.contains(&".git"));
    let sources: Vec<&str> = of("COPY")
        .iter()
        .flat_map(|l| l.split(' '))
        .filter_map(|w| w.strip_prefix("/source/"))
        .collect();
    assert!(sources.len() >= 6, "{sources:?}");
    for source in sources.iter().filter(|s| !s.starts_with("target/")) {
        assert!(Path::new(ROOT).join(source).is_file(), "{source} is not there");
        let first = source.split('/').next().unwrap();
        assert!(!ignored.contains(&first), "{source} is not in the context");
    }
    // The command is the one of the release archive, and its program is taken.
    let command = "cargo build --release --locked -p dsfms-cli";
    assert!(of("RUN").iter().any(|l| l.ends_with(command)), "{all:?}");
    assert!(read("scripts/make_release.sh").contains(command));
    assert!(sources.contains(&"target/release/dsfms"), "{sources:?}");
    let made = |user: &str| all.iter().any(|l| l.starts_with("RUN useradd") && l.ends_with(user));
    assert!(of("USER").last().is_some_and(|user| *user != "root" && made(user)), "{all:?}");
    assert_eq!(of("ENTRYPOINT"), ["[\"dsfms\"]"]);
}

/// The manifests of what travels are whole: no example, bench or crate lies in what is left out.
#[test]
fn the_context_of_the_image_is_a_workspace() {
    let listed = Command::new("git").current_dir(ROOT).args(["ls-files", "-z"]).output();
    let Some(listed) = listed.ok().filter(|l| l.status.success()) else { return };
    let ignored = read(".dockerignore");
    let folder = tempfile::tempdir().unwrap();
    for file in String::from_utf8(listed.stdout).unwrap().split_terminator('\0') {
        let left_out = ignored.lines().any(|i| file == i || file.starts_with(&format!("{i}/")));
        let (from, to) = (Path::new(ROOT).join(file), folder.path().join(file));
        if !left_out && from.is_file() && !to.starts_with(folder.path().join("docs")) {
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            // Manifests and the names of files are all that is looked at.
            match file.ends_with(".toml") || file.ends_with(".lock") {
                true => drop(std::fs::copy(from, to).unwrap()),
                false => std::fs::write(to, "").unwrap(),
            }
        }
    }
    let done = Command::new(env!("CARGO"))
        .current_dir(folder.path())
        .args(["metadata", "--format-version", "1", "--locked", "--offline", "--no-deps"])
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}
