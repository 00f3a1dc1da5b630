//! Frames that come by network or from a device.

use super::args::TrackArgs;
use super::capture::Capture;
use super::input::{FrameTaker, is_address, is_igtl};
use super::link::{place, reach};
use crate::exit::Usage;
use anyhow::Context;
use dsfms::image::Frame;
use dsfms::io::igtl::{Header, IgtlError, picture, read};
use std::io::BufReader;
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// A server that cannot be reached for so long is gone.
const GONE: Duration = Duration::from_secs(5);

/// A server that sends nothing for so long is asked anew.
const SILENT: Duration = Duration::from_secs(5);

/// Between two tries to reach it.
const AGAIN: Duration = Duration::from_millis(200);

/// A source that is no file.
#[derive(Clone, Debug)]
pub enum Stream {
    /// Pictures of an OpenIGTLink server at `HOST:PORT`; of the first device that sends some, where
    /// no name is given.
    Igtl { place: String, device: Option<String> },
    /// What an installed ffmpeg reads.
    Ffmpeg(Capture),
}

impl Stream {
    /// What the arguments name; `None` for files and standard input.
    pub fn of(args: &TrackArgs) -> anyhow::Result<Option<Self>> {
        if let Some(device) = &args.device {
            return Ok(Some(Self::Ffmpeg(Capture::device(device, args)?)));
        }
        let Some(address) = args.input.iter().find(|input| is_address(input)) else {
            return Ok(None);
        };
        if args.input.len() > 1 {
            return Err(
                Usage(format!("{} stands alone, not beside files", address.display())).into()
            );
        }
        let text = address.to_string_lossy();
        let igtl = is_igtl(address);
        Ok(Some(if igtl { Self::parse(&text)? } else { Self::Ffmpeg(Capture::address(&text)) }))
    }

    /// Nobody wants more; what runs for it ends.
    pub fn stop(&self) {
        if let Self::Ffmpeg(capture) = self {
            capture.stop();
        }
    }

    fn parse(address: &str) -> Result<Self, Usage> {
        let rest = address.trim_start_matches("igtl://");
        let (at, device) = rest.split_once('/').unwrap_or((rest, ""));
        let place = place(at).map_err(|why| Usage(format!("{address}: {why}")))?;
        Ok(Self::Igtl { place, device: (!device.is_empty()).then(|| device.to_owned()) })
    }

    /// Hand over frame after frame, until the source is gone or nobody wants more.
    pub(super) fn read(&self, reader: &mut impl FrameTaker) -> anyhow::Result<()> {
        match self {
            Self::Igtl { place, device } => igtl(place, device.clone(), reader),
            Self::Ffmpeg(capture) => capture.read(reader),
        }
    }
}

fn igtl(
    place: &str,
    mut device: Option<String>,
    reader: &mut impl FrameTaker,
) -> anyhow::Result<()> {
    let mut reached = Instant::now();
    loop {
        match reach(place) {
            Ok(stream) => {
                if !messages(stream, &mut device, reader)? {
                    return Ok(());
                }
                reached = Instant::now();
            }
            Err(_) if reached.elapsed() < GONE => {}
            // It went, as every source does some time.
            Err(_) if reader.seen() > 0 => return Ok(()),
            Err(error) => {
                return Err(error).with_context(|| {
                    format!("igtl://{place} cannot be reached; start the server first")
                });
            }
        }
        std::thread::sleep(AGAIN);
    }
}

/// The pictures of one connection; `false` where nobody wants more.
fn messages(
    stream: TcpStream,
    device: &mut Option<String>,
    reader: &mut impl FrameTaker,
) -> anyhow::Result<bool> {
    stream.set_read_timeout(Some(SILENT))?;
    let mut stream = BufReader::with_capacity(1 << 16, stream);
    loop {
        let wanted = |header: &Header| {
            header.kind == "IMAGE" && device.as_ref().is_none_or(|name| *name == header.device)
        };
        let found = match read(&mut stream, wanted) {
            Ok(None) => return Ok(true),
            Ok(Some(message)) => {
                device.get_or_insert(message.header.device);
                reader.made_at(message.header.time);
                picture(&message.content)
            }
            Err(error) => Err(error),
        };
        let name = reader.name();
        let (more, ended) = match found {
            Ok((size, rgb)) => (reader.take(Frame { name, size, rgb }), false),
            Err(error) => (reader.lose(name, why(&error)), error.fatal()),
        };
        if !more || ended {
            return Ok(more);
        }
    }
}

fn why(error: &IgtlError) -> String {
    use std::io::ErrorKind::{TimedOut, WouldBlock};
    match error {
        IgtlError::Stream(error) if matches!(error.kind(), TimedOut | WouldBlock) => {
            format!("nothing comes from the source for {} s", SILENT.as_secs())
        }
        error => format!("OpenIGTLink: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn an_address_has_a_port_and_perhaps_a_device() {
        let of = |text: &str| match Stream::parse(text).unwrap() {
            Stream::Igtl { place, device } => (place, device),
            Stream::Ffmpeg(_) => unreachable!(),
        };
        assert_eq!(of("igtl://localhost:1/Video"), ("localhost:1".into(), Some("Video".into())));
        assert_eq!(of("igtl://10.0.0.1:1"), ("10.0.0.1:1".into(), None));
        assert_eq!(of("igtl://a:1/"), ("a:1".into(), None));
        for wrong in ["igtl://", "igtl://host", "igtl:///Video", "igtl://host:x/Video"] {
            assert!(Stream::parse(wrong).is_err(), "{wrong}");
        }
        assert!(is_address(Path::new("igtl://a:1")) && !is_address(Path::new("clip.mp4")));
    }
}
