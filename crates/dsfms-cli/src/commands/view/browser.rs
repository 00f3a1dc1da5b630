//! The user's own browser.

use std::process::{Command, Stdio};

/// Open an address in it. Without a desktop the printed address is enough.
pub(super) fn open(url: &str) {
    let (program, arguments): (&str, &[&str]) = match std::env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("rundll32", &["url.dll,FileProtocolHandler"]),
        _ => ("xdg-open", &[]),
    };
    let mut browser = Command::new(program);
    let _ = browser.args(arguments).arg(url).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
}
