//! The commit that is built, for `--version`; nothing where there is no repository.

use std::process::Command;

fn git(arguments: &[&str]) -> Option<String> {
    let done = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(done.stdout).ok()?;
    done.status.success().then(|| text.trim().to_owned()).filter(|text| !text.is_empty())
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=DSFMS_BUILD_COMMIT");
    for path in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", path]) {
            println!("cargo::rerun-if-changed={path}");
        }
    }
    // A build outside of the repository (a container, an archive) is told by its caller.
    let given = std::env::var("DSFMS_BUILD_COMMIT").ok().filter(|text| !text.is_empty());
    let commit = given.or_else(|| git(&["rev-parse", "--short=12", "HEAD"]));
    let text = commit.map_or(String::new(), |commit| format!(" ({commit})"));
    println!("cargo::rustc-env=DSFMS_COMMIT={text}");
}
