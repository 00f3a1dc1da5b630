//! Any other video, through an installed `ffmpeg` that writes PPM pictures into a pipe.

use super::error::VideoError;
use super::frame::DecodedPicture;
use super::passthrough::passthrough;
use super::ppm::{Ended, pictures};
use super::watched::Watched;
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Demuxers of files that hold their pictures themselves. A playlist with the name of a video names
/// other files, or addresses of the network, which ffmpeg would read.
const CONTAINERS: &str = "matroska,webm,mov,mp4,m4a,3gp,3g2,mj2,avi,mpegts,mpeg,mpegvideo,flv,ogg,asf,mxf,dv,\
                          h264,hevc,m4v,mjpeg,gif,ivf,yuv4mpegpipe,nut";

/// Decode a video with `program`, which is ended where nothing comes from it for longer than
/// `silence`; `reason` says why it was not decoded directly.
pub(super) fn decode(
    (program, silence): (&str, Duration),
    path: &Path,
    reason: &str,
    each: &mut dyn FnMut(usize, DecodedPicture) -> bool,
) -> Result<(), VideoError> {
    let read = |source| VideoError::Read { path: path.into(), source };
    // Into a file: a pipe that nobody empties would stop ffmpeg.
    let log = tempfile::NamedTempFile::new().map_err(read)?;
    let mut input = std::ffi::OsString::from("file:");
    input.push(path);
    let mut command = Command::new(program);
    command
        .args(["-v", "error", "-nostdin", "-format_whitelist", CONTAINERS, "-i"])
        .arg(input)
        // Frames as they are: an even rate would fill a gap in the time stamps with any number of
        // copies.
        .args(["-map", "0:v:0"])
        .args(passthrough(program, silence))
        .args(["-f", "image2pipe", "-c:v", "ppm", "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(log.reopen().map_err(read)?);
    let Ok(child) = Watched::spawn(&mut command, silence) else {
        let reason = format!("{reason}, and no ffmpeg was found");
        return Err(VideoError::Unsupported { path: path.into(), reason });
    };
    let mut index = 0;
    let mut each = |size, rgb| {
        index += 1;
        each(index - 1, DecodedPicture { size, rgb })
    };
    let pictures =
        child.output().map_or(Ok(Ended::After(0)), |out| pictures(BufReader::new(out), &mut each));
    if matches!(pictures, Ok(Ended::Enough)) {
        // Dropped, it ends.
        return Ok(());
    }
    let damaged = |what: String| {
        let reason = format!("{reason}, and ffmpeg {what}");
        Err(VideoError::Damaged { path: path.into(), reason })
    };
    let Some(status) = child.finish().map_err(read)? else {
        return damaged(format!("gave nothing for {} s and was ended", silence.as_secs()));
    };
    match pictures {
        Ok(Ended::After(count)) if status.success() && count > 0 => Ok(()),
        result => {
            let said = std::fs::read_to_string(log.path()).unwrap_or_default();
            let own = result.err().map(|error| error.to_string()).unwrap_or_default();
            damaged(format!("failed: {}", said.lines().last().unwrap_or(&own)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::watched::SILENCE;
    use super::*;

    #[test]
    fn a_playlist_of_other_files_is_no_video() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let made = Command::new("ffmpeg")
            .args(["-v", "error", "-f", "lavfi", "-i", "testsrc=size=64x48:duration=1"])
            .arg(path("a.ts"))
            .status();
        if !made.is_ok_and(|status| status.success()) {
            eprintln!(
                "!! SKIPPED  no ffmpeg (Debian: apt install ffmpeg): playlists are NOT tested"
            );
            return;
        }
        let list = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\na.ts\n#EXT-X-ENDLIST\n";
        std::fs::write(path("list.mkv"), list).unwrap();
        let decoded =
            |name: &str| decode(("ffmpeg", SILENCE), &path(name), "no mp4 file", &mut |_, _| true);
        decoded("a.ts").unwrap();
        assert!(decoded("list.mkv").is_err());
    }

    #[test]
    fn a_gap_in_the_time_stamps_is_no_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gap.mkv");
        let made = Command::new("ffmpeg")
            .args(["-v", "error", "-f", "lavfi", "-i", "testsrc=size=64x48:duration=0.2"])
            .args(["-vf", "setpts=N*600/TB", "-c:v", "mjpeg"])
            .args(passthrough("ffmpeg", SILENCE))
            .arg(&path)
            .status();
        if !made.is_ok_and(|status| status.success()) {
            eprintln!("!! SKIPPED  no ffmpeg (Debian: apt install ffmpeg): gaps are NOT tested");
            return;
        }
        let mut given = 0;
        let each = &mut |_, _| {
            given += 1;
            true
        };
        decode(("ffmpeg", SILENCE), &path, "no mp4 file", each).unwrap();
        assert_eq!(given, 5);
    }

    #[test]
    fn without_ffmpeg_the_error_says_what_to_do() {
        let none = ("no-such-ffmpeg", SILENCE);
        let error = decode(none, Path::new("a.mkv"), "no mp4 file", &mut |_, _| true);
        let message = error.unwrap_err().to_string();
        assert!(
            message.contains("a.mkv: no mp4 file, and no ffmpeg") && message.contains("install")
        );
    }

    #[cfg(unix)]
    #[test]
    fn a_silent_ffmpeg_is_ended_and_named() {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("ffmpeg");
        let text = r"printf 'P6\n1 1\n255\nabc'; exec sleep 100";
        // Written by another process: one that is started while this one holds it open could not be
        // run.
        let made = Command::new("sh")
            .args(["-c", r#"printf '#!/bin/sh\n%s\n' "$2" > "$1" && chmod +x "$1""#, "sh"])
            .arg(&program)
            .arg(text)
            .status();
        assert!(made.unwrap().success());
        let program = (program.to_str().unwrap(), Duration::from_secs(1));
        let mut given = 0;
        let error = decode(program, Path::new("a.mkv"), "no mp4 file", &mut |number, _| {
            given = number + 1;
            true
        });
        let message = error.unwrap_err().to_string();
        assert!(message.contains("a.mkv") && message.contains("nothing for 1 s"), "{message}");
        assert_eq!(given, 1);
        // Nobody waits for one whose pictures are no longer wanted.
        decode((program.0, SILENCE), Path::new("a.mkv"), "no mp4 file", &mut |_, _| false).unwrap();
    }
}
