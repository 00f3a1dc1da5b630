//! The log of `-v`, on standard error: what was decided, and with which figures.

use crate::exit::Usage;
use crate::progress::ProgressKind;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::layer;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::registry;
use tracing_subscriber::util::SubscriberInitExt;

/// Names what is logged: `debug`, or `dsfms::sfm=debug,dsfms=info`.
const VARIABLE: &str = "RUST_LOG";

/// Start the log that `-v`, or else the environment, asks for. Whether there is one.
pub fn start(verbose: u8, progress: ProgressKind) -> anyhow::Result<bool> {
    let asked = std::env::var(VARIABLE).unwrap_or_default();
    let Some(targets) = targets(verbose, &asked)? else { return Ok(false) };
    let layer = layer().with_writer(std::io::stderr).with_target(true);
    let base = registry().with(targets);
    // Another log, where there is one, stays.
    let _ = match progress {
        ProgressKind::Json => base.with(layer.json()).try_init(),
        _ => base.with(layer.without_time().with_ansi(false)).try_init(),
    };
    Ok(true)
}

/// What is logged; the environment says it more exactly than a number of `v` does.
fn targets(verbose: u8, asked: &str) -> anyhow::Result<Option<Targets>> {
    if !asked.trim().is_empty() {
        let targets = asked.parse::<Targets>().map_err(|error| {
            Usage(format!(
                "{VARIABLE}={asked}: {error}; expected a level (info, debug, trace), or targets with levels \
                 as in dsfms::sfm=debug"
            ))
        })?;
        return Ok(Some(targets));
    }
    let level = match verbose {
        0 => return Ok(None),
        1 => LevelFilter::INFO,
        2 => LevelFilter::DEBUG,
        _ => LevelFilter::TRACE,
    };
    Ok(Some(Targets::new().with_target("dsfms", level)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_goes_before_the_number_of_v() {
        let enabled = |verbose, asked: &str, level| {
            let found = targets(verbose, asked).unwrap();
            found.is_some_and(|t| t.would_enable("dsfms::sfm", &level))
        };
        let [info, debug] =
            [LevelFilter::INFO, LevelFilter::DEBUG].map(|level| level.into_level().unwrap());
        assert!(!enabled(0, "", info) && enabled(1, "", info) && !enabled(1, "", debug));
        assert!(enabled(2, "", debug) && enabled(0, "dsfms=debug", debug));
        assert!(!enabled(2, "dsfms=info", debug) && !enabled(2, "other=debug", info));
        assert!(targets(0, "dsfms=loud").unwrap_err().to_string().contains("expected"));
    }
}
