//! Any other video, through an installed `ffmpeg` that writes PPM pictures into a pipe.

use super::ppm::{Ended, pictures};
use super::{DecodedPicture, VideoError};
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Stdio};

/// Demuxers of files that hold their pictures themselves. A playlist with the name of a video names other files, or
/// addresses of the network, which ffmpeg would read.
const CONTAINERS: &str = "matroska,webm,mov,mp4,m4a,3gp,3g2,mj2,avi,mpegts,mpeg,mpegvideo,flv,ogg,asf,mxf,dv,\
                          h264,hevc,m4v,mjpeg,gif,ivf,yuv4mpegpipe,nut";

/// Decode a video with `program`; `reason` says why it was not decoded directly.
pub(super) fn decode(
    program: &str,
    path: &Path,
    reason: &str,
    each: &mut dyn FnMut(usize, DecodedPicture) -> bool,
) -> Result<(), VideoError> {
    let read = |source| VideoError::Read { path: path.into(), source };
    // Into a file: a pipe that nobody empties would stop ffmpeg.
    let log = tempfile::NamedTempFile::new().map_err(read)?;
    let mut input = std::ffi::OsString::from("file:");
    input.push(path);
    let child = Command::new(program)
        .args(["-v", "error", "-nostdin", "-format_whitelist", CONTAINERS, "-i"])
        .arg(input)
        .args(["-map", "0:v:0", "-f", "image2pipe", "-c:v", "ppm", "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(log.reopen().map_err(read)?)
        .spawn();
    let Ok(mut child) = child else {
        let reason = format!("{reason}, and no ffmpeg was found");
        return Err(VideoError::Unsupported { path: path.into(), reason });
    };
    let mut index = 0;
    let mut each = |size, rgb| {
        index += 1;
        each(index - 1, DecodedPicture { size, rgb })
    };
    let pictures = child
        .stdout
        .take()
        .map_or(Ok(Ended::After(0)), |out| pictures(BufReader::new(out), &mut each));
    // Its output is closed by now: it ends by itself.
    let status = child.wait().map_err(read)?;
    match pictures {
        Ok(Ended::Enough) => Ok(()),
        Ok(Ended::After(count)) if status.success() && count > 0 => Ok(()),
        result => {
            let said = std::fs::read_to_string(log.path()).unwrap_or_default();
            let own = result.err().map(|error| error.to_string()).unwrap_or_default();
            let said = said.lines().last().unwrap_or(&own);
            let reason = format!("{reason}, and ffmpeg failed: {said}");
            Err(VideoError::Damaged { path: path.into(), reason })
        }
    }
}

#[cfg(test)]
mod tests {
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
        let decoded = |name: &str| decode("ffmpeg", &path(name), "no mp4 file", &mut |_, _| true);
        decoded("a.ts").unwrap();
        assert!(decoded("list.mkv").is_err());
    }

    #[test]
    fn without_ffmpeg_the_error_says_what_to_do() {
        let error = decode("no-such-ffmpeg", Path::new("a.mkv"), "no mp4 file", &mut |_, _| true);
        let message = error.unwrap_err().to_string();
        assert!(
            message.contains("a.mkv: no mp4 file, and no ffmpeg") && message.contains("install")
        );
    }
}
