//! What the served page has more than a report: it follows its files and asks for frames.

use crate::report::folder::PathContent;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, UNIX_EPOCH};

const SCRIPT: &str = include_str!("../../../assets/live.js");
/// The script comes before the viewer's, which starts with the frames it gives.
const BEFORE: &str = "<script type=\"application/json\" id=\"data\">";
/// A folder of thousands of frames is looked through once in this time.
const FRESH: Duration = Duration::from_millis(700);
/// A command that begins anew takes away the page of its last run, and writes frames before the
/// next page: so long the open page waits for it in place of a page made of those frames.
const BETWEEN: Duration = Duration::from_secs(20);

/// A path, and what it held when it was last looked at.
#[derive(Clone)]
pub struct Watched {
    path: PathBuf,
    last: Arc<Mutex<Option<WatchedContent>>>,
    running: bool,
}

/// What a path held.
#[derive(Clone)]
pub struct WatchedContent {
    when: Instant,
    pub source: Arc<PathContent>,
    /// Another one when something changed.
    pub version: String,
}

impl Watched {
    pub fn new(path: &Path) -> Self {
        Self { path: path.into(), last: Arc::default(), running: false }
    }

    /// An output folder that is being filled, and may hold nothing yet.
    pub fn running(path: &Path) -> Self {
        Self { running: true, ..Self::new(path) }
    }

    /// Whether it is being filled.
    pub fn runs(&self) -> bool {
        self.running
    }

    /// The version of the last look; 0 before the first.
    pub fn last_version(&self) -> String {
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().map_or_else(|| "0".into(), |look| look.version.clone())
    }

    pub fn look(&self) -> anyhow::Result<WatchedContent> {
        // A poisoned lock only means that another thread panicked.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(look) = last.as_ref().filter(|look| look.when.elapsed() < FRESH) {
            return Ok(look.clone());
        }
        let source = Arc::new(PathContent::of(&self.path)?);
        let was_page = last.as_ref().filter(|l| matches!(*l.source, PathContent::Report(_)));
        if was_page.is_some_and(|l| l.when.elapsed() < BETWEEN)
            && !matches!(*source, PathContent::Report(_))
        {
            anyhow::bail!("{} has frames and no page yet", self.path.display());
        }
        let version = version(&source);
        Ok(last.insert(WatchedContent { when: Instant::now(), source, version }).clone())
    }
}

fn version(source: &PathContent) -> String {
    let since = source.changed().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    since.map_or(0, |d| d.as_millis()).to_string()
}

/// The page that takes over what changes in its files, and leads to the organ's where there is one.
pub fn live(html: &str, version: &str, organ: bool) -> String {
    let script = SCRIPT.replace("{{version}}", version).replace("{{organ}}", &organ.to_string());
    let script = format!("<script>\n{script}</script>\n");
    let (place, with) = match html.contains(BEFORE) {
        true => (BEFORE, script + BEFORE),
        false => ("</body>", script + "</body>"),
    };
    html.replacen("default-src 'none';", "default-src 'none'; connect-src 'self';", 1)
        .replacen(place, &with, 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_served_page_may_connect() {
        let page = "<meta content=\"default-src 'none'; img-src data:\"><body></body>";
        let served = live(page, "7", false);
        assert!(served.contains("connect-src 'self'") && served.contains("\"7\""), "{served}");
        assert!(served.contains("\"false\" === \"true\""), "no organ to draw: {served}");
    }

    #[test]
    fn the_page_of_a_run_that_begins_anew_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let (page, frame) =
            (folder.path().join("report.html"), folder.path().join("frame_001.ply"));
        std::fs::write(&page, "").unwrap();
        let watched = Watched::new(folder.path());
        assert!(matches!(*watched.look().unwrap().source, PathContent::Report(_)));
        std::fs::remove_file(&page).unwrap();
        std::fs::write(&frame, "").unwrap();
        std::thread::sleep(FRESH);
        let before = watched.last_version();
        assert!(watched.look().is_err(), "a page of frames would take the place of the report");
        assert_eq!(watched.last_version(), before);
        std::fs::write(&page, "").unwrap();
        assert!(matches!(*watched.look().unwrap().source, PathContent::Report(_)));
        // Who comes to frames alone sees them.
        std::fs::remove_file(&page).unwrap();
        let come = Watched::new(folder.path()).look().unwrap();
        assert!(matches!(*come.source, PathContent::Meshes(_)));
    }

    #[test]
    fn frames_can_be_asked_for_before_the_viewer_starts() {
        let served = live(&format!("<body>{BEFORE}{{}}</script></body>"), "7", true);
        let at = |text: &str| served.find(text).unwrap();
        assert!(at("dsfmsLive") < at(BEFORE), "{served}");
    }
}
