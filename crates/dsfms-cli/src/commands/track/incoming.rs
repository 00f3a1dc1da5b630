//! Frames that come by network.

use super::args::TrackArgs;
use super::link::{place, reach};
use super::source::Reader;
use crate::exit::Usage;
use anyhow::Context;
use dsfms::image::Frame;
use dsfms::io::igtl::{Header, IgtlError, picture, read};
use std::io::BufReader;
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

/// A server that cannot be reached for so long is gone.
const GONE: Duration = Duration::from_secs(5);

/// A server that sends nothing for so long is asked anew.
const SILENT: Duration = Duration::from_secs(5);

/// Between two tries to reach it.
const AGAIN: Duration = Duration::from_millis(200);

/// A source that is no file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Pictures of an OpenIGTLink server at `HOST:PORT`; of the first device that sends some, where no
    /// name is given.
    Igtl { place: String, device: Option<String> },
}

/// Whether an input names no file.
pub fn is_address(input: &Path) -> bool {
    input.to_str().is_some_and(|text| text.starts_with("igtl://"))
}

impl Stream {
    /// What the arguments name; `None` for files and standard input.
    pub fn of(args: &TrackArgs) -> anyhow::Result<Option<Self>> {
        let Some(address) = args.input.iter().find(|input| is_address(input)) else {
            return Ok(None);
        };
        if args.input.len() > 1 {
            return Err(
                Usage(format!("{} stands alone, not beside files", address.display())).into()
            );
        }
        Ok(Some(Self::parse(&address.to_string_lossy())?))
    }

    fn parse(address: &str) -> Result<Self, Usage> {
        let rest = address.trim_start_matches("igtl://");
        let (at, device) = rest.split_once('/').unwrap_or((rest, ""));
        let place = place(at).map_err(|why| Usage(format!("{address}: {why}")))?;
        Ok(Self::Igtl { place, device: (!device.is_empty()).then(|| device.to_owned()) })
    }

    /// Hand over frame after frame, until the source is gone or nobody wants more.
    pub(super) fn read(&self, reader: &mut Reader) -> anyhow::Result<()> {
        let Self::Igtl { place, device } = self;
        let mut device = device.clone();
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
                Err(_) if reader.seen > 0 => return Ok(()),
                Err(error) => {
                    return Err(error).with_context(|| {
                        format!("igtl://{place} cannot be reached; start the server first")
                    });
                }
            }
            std::thread::sleep(AGAIN);
        }
    }
}

/// The pictures of one connection; `false` where nobody wants more.
fn messages(
    stream: TcpStream,
    device: &mut Option<String>,
    reader: &mut Reader,
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
                reader.time = message.header.time;
                picture(&message.content)
            }
            Err(error) => Err(error),
        };
        let name = reader.name();
        let (more, ended) = match found {
            Ok((size, rgb)) => (reader.give(Frame { name, size, rgb }, None, None), false),
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

    #[test]
    fn an_address_has_a_port_and_perhaps_a_device() {
        let of = |text: &str| Stream::parse(text);
        let igtl = |place: &str, device: Option<&str>| Stream::Igtl {
            place: place.into(),
            device: device.map(str::to_owned),
        };
        assert_eq!(
            of("igtl://localhost:18944/Video").unwrap(),
            igtl("localhost:18944", Some("Video"))
        );
        assert_eq!(of("igtl://10.0.0.1:1").unwrap(), igtl("10.0.0.1:1", None));
        assert_eq!(of("igtl://a:1/").unwrap(), igtl("a:1", None));
        for wrong in ["igtl://", "igtl://host", "igtl:///Video", "igtl://host:x/Video"] {
            assert!(of(wrong).is_err(), "{wrong}");
        }
        assert!(is_address(Path::new("igtl://a:1")) && !is_address(Path::new("clip.mp4")));
    }
}
