//! What `cargo package` makes of the crates is whole: licences, the README, no invented address.

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
