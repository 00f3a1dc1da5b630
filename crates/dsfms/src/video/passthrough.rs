//! How ffmpeg is told to give every picture once and no copies: `-fps_mode passthrough`, or
//! `-vsync passthrough` where it is older than 5.1, the first that knows the former.

use super::watched::Watched;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Bytes of what `-version` says that are read.
const SAID: u64 = 256;

/// The option and its value, for the ffmpeg that is started as `program`, which is asked for its
/// version; the newer one where it does not say it within `silence`.
pub fn passthrough(program: &str, silence: Duration) -> [&'static str; 2] {
    let said = said(program, silence).unwrap_or_default();
    [if is_old(&said) { "-vsync" } else { "-fps_mode" }, "passthrough"]
}

/// The first line that it says of its version.
fn said(program: &str, silence: Duration) -> Option<String> {
    let mut command = Command::new(program);
    command.arg("-version").stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let child = Watched::spawn(&mut command, silence).ok()?;
    let mut line = String::new();
    BufReader::new(child.output()?.take(SAID)).read_line(&mut line).ok()?;
    Some(line)
}

/// Whether `ffmpeg version 4.4.2 …` or `n4.4` is one before 5.1; a build without a number is not.
fn is_old(said: &str) -> bool {
    let version = said.split_whitespace().nth(2).unwrap_or_default();
    let mut numbers = version.trim_start_matches('n').split(|c: char| !c.is_ascii_digit());
    let mut number = || numbers.next()?.parse::<u32>().ok();
    number().is_some_and(|major| (major, number().unwrap_or(0)) < (5, 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn releases_before_5_1_have_the_old_option() {
        let old = |version: &str| is_old(&format!("ffmpeg version {version} Copyright (c) 2000"));
        for version in ["4.4.2-0ubuntu0.22.04.1", "n4.4", "5.0", "5", "3.4.11"] {
            assert!(old(version), "{version}");
        }
        for version in ["5.1.9-0+deb12u1", "n7.1", "8.0", "10.2", "N-109542-g1bf1c9a2f8", "git"] {
            assert!(!old(version), "{version}");
        }
        assert!(!is_old(""));
    }

    #[test]
    fn a_program_that_is_not_there_is_taken_for_a_new_one() {
        let found = passthrough("no-such-ffmpeg", Duration::from_secs(1));
        assert_eq!(found, ["-fps_mode", "passthrough"]);
    }
}
