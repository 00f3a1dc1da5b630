//! What the targets share: the readers are those that `cargo test --test fuzz_regressions` replays.

use std::sync::LazyLock;

#[path = "../../crates/dsfms/tests/common/targets.rs"]
pub mod targets;

/// libFuzzer ends the process on every panic; those that the library turns into errors are none.
pub fn prepare() {
    dsfms::guard::quiet_hook();
}

static CANARY: LazyLock<bool> = LazyLock::new(|| std::env::var_os("DSFMS_FUZZ_CANARY").is_some());

/// The bytes through a reader.
///
/// # Panics
/// A target of that name does not exist; or the reader has a fault.
pub fn run(name: &str, bytes: &[u8]) {
    // What run.sh asks first: does a panic end the process?
    assert!(!*CANARY, "the canary");
    let target = targets::TARGETS.iter().find(|t| t.0 == name);
    let (_, _, reader) = target.unwrap_or_else(|| panic!("no target is called {name}"));
    std::hint::black_box(reader(bytes));
}
