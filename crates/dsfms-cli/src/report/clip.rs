//! Every frame of a long clip as a file of its own, `OUT/view/frame_NNN.json`: the page holds a
//! part of them, `dsfms view` sends the others when they are looked at.

use super::data::ShownFrame;
use super::embed;
use crate::outputs::write_text;
use anyhow::Context;
use dsfms::guard;
use dsfms::image::Frame;
use dsfms::io::names::natural_order;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;

/// The folder in the output folder.
const FOLDER: &str = "view";
/// Frames that a page has from the start: they say which layers there are and how far values reach.
const HERE: usize = 8;
/// Longest side of an image, px.
const LONGEST_SIDE: u32 = 640;
/// Frames that wait to be written; then who brings more waits too.
const WAITING: usize = 8;

/// Write a frame beside the page.
pub fn write(output: &Path, frame: &ShownFrame) -> anyhow::Result<()> {
    let folder = output.join(FOLDER);
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("{} cannot be made", folder.display()))?;
    write_text(&folder.join(format!("{}.json", frame.name)), &serde_json::to_string(frame)?)
}

/// Writes frames on a thread of its own: pictures take some milliseconds.
pub struct Writer {
    send: SyncSender<(Frame, ShownFrame)>,
    thread: JoinHandle<anyhow::Result<()>>,
}

impl Writer {
    pub fn start(output: PathBuf) -> Self {
        let (send, receive) = sync_channel::<(Frame, ShownFrame)>(WAITING);
        let thread = std::thread::spawn(move || {
            for (frame, mut shown) in receive {
                shown.image = Some(embed::thumbnail(&frame, LONGEST_SIDE)?);
                write(&output, &shown)?;
            }
            Ok(())
        });
        Self { send, thread }
    }

    /// A frame without its picture, and the picture.
    pub fn add(&self, frame: &Frame, shown: ShownFrame) {
        // Where the thread ended, its error is told at the end.
        let _ = self.send.send((frame.clone(), shown));
    }

    /// Everything is written, or the first error.
    pub fn finish(self) -> anyhow::Result<()> {
        drop(self.send);
        self.thread.join().unwrap_or_else(|_| Err(anyhow::anyhow!("the writer of frames ended")))
    }
}

fn folder(page: &Path) -> PathBuf {
    page.with_file_name(FOLDER)
}

/// Names of the frames beside a page, in order.
pub fn names(page: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(folder(page)) else { return Vec::new() };
    let name = |e: std::fs::DirEntry| {
        let name = e.file_name().to_string_lossy().strip_suffix(".json")?.to_owned();
        is_frame(&name).then_some(name)
    };
    let mut found: Vec<String> = entries.flatten().filter_map(name).collect();
    found.sort_by(|a, b| natural_order(a, b));
    found
}

/// `frame_` and digits: a name that leads nowhere else.
fn is_frame(name: &str) -> bool {
    let digits = name.strip_prefix("frame_").unwrap_or_default();
    !digits.is_empty() && digits.len() <= 20 && digits.bytes().all(|b| b.is_ascii_digit())
}

/// The frame of a name beside a page.
pub fn read(page: &Path, name: &str) -> anyhow::Result<Option<String>> {
    let path = folder(page).join(format!("{name}.json"));
    if !is_frame(name) || !path.is_file() {
        return Ok(None);
    }
    let text = guard::read_text(&path);
    text.map(Some).with_context(|| format!("cannot read {}", path.display()))
}

/// Places of the frames of which a page has more than the name.
pub fn here(count: usize) -> Vec<usize> {
    let shown = count.min(HERE);
    (0..shown).map(|k| k * (count - 1).max(1) / (shown - 1).max(1)).collect()
}

const BEFORE: &str = "<script type=\"application/json\" id=\"data\">";

/// The page with all frames by name and few in full; as it is where it holds all of them, or is
/// none of ours.
pub fn streamed(html: String, names: &[String]) -> String {
    replaced(&html, names).unwrap_or(html)
}

fn replaced(html: &str, names: &[String]) -> Option<String> {
    let start = html.find(BEFORE)? + BEFORE.len();
    let end = start + html[start..].find("</script>")?;
    let mut data: serde_json::Value = serde_json::from_str(&html[start..end]).ok()?;
    let frames = std::mem::take(data.get_mut("frames")?.as_array_mut()?);
    if frames.len() >= names.len() {
        return None;
    }
    let own = |frame: &serde_json::Value| frame["name"].as_str().unwrap_or_default().to_owned();
    let kept: Vec<serde_json::Value> =
        here(frames.len()).into_iter().map(|i| frames[i].clone()).collect();
    let mut kept: HashMap<String, serde_json::Value> =
        kept.into_iter().map(|frame| (own(&frame), frame)).collect();
    if !names.iter().any(|name| kept.contains_key(name)) {
        return None;
    }
    let named =
        |name: &String| kept.remove(name).unwrap_or_else(|| serde_json::json!({ "name": name }));
    data["frames"] = names.iter().map(named).collect();
    data["stream"] = true.into();
    // Inside a script element nothing but its end tag is markup.
    let text = serde_json::to_string(&data).ok()?.replace('<', "\\u003c");
    Some([&html[..start], &text, &html[end..]].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_names_all_frames_and_holds_few() {
        let frames: Vec<_> = (0..20)
            .map(|k| serde_json::json!({ "name": format!("frame_{:03}", 3 * k), "surfaces": [] }))
            .collect();
        let data = serde_json::json!({ "unit": "mm", "frames": frames }).to_string();
        let html = format!("<p>{BEFORE}{data}</script></p>");
        let names: Vec<String> = (0..60).map(|k| format!("frame_{k:03}")).collect();
        let page = streamed(html.clone(), &names);
        let start = page.find(BEFORE).unwrap() + BEFORE.len();
        let end = page.find("</script>").unwrap();
        let data: serde_json::Value = serde_json::from_str(&page[start..end]).unwrap();
        let shown = data["frames"].as_array().unwrap();
        assert_eq!((shown.len(), data["stream"].as_bool()), (60, Some(true)));
        let whole = shown.iter().filter(|f| f.get("surfaces").is_some()).count();
        assert_eq!((whole, shown[59]["name"].as_str()), (HERE, Some("frame_059")));
        assert!(page.starts_with("<p>") && page.ends_with("</p>"));
        // All of them are there already; no page of ours.
        assert_eq!(streamed(html.clone(), &names[..20]), html);
        assert_eq!(streamed("<body>".into(), &names), "<body>");
    }

    #[test]
    fn only_frames_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("report.html");
        std::fs::write(folder.path().join("secret.json"), "secret").unwrap();
        write(folder.path(), &ShownFrame::named("frame_010")).unwrap();
        write(folder.path(), &ShownFrame::named("frame_9")).unwrap();
        assert_eq!(names(&page), ["frame_9", "frame_010"]);
        assert!(read(&page, "frame_010").unwrap().unwrap().contains("\"frame_010\""));
        for name in ["frame_011", "../secret", "secret", "frame_", "", "frame_010.json", "/etc/x"] {
            assert!(read(&page, name).unwrap().is_none(), "{name}");
        }
    }
}
