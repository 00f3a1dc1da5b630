//! What tracking tells other programs while it runs, by OpenIGTLink.

mod clients;
mod messages;

use super::live::{ToldFrame, tell};
use super::queue::{Full, Queue};
use crate::exit::Usage;
use crate::progress::Reporter;
use anyhow::Context;
use clap::Args;
use clients::Clients;
pub use clients::reach;
use dsfms::camera::CameraModel;
use dsfms::geometry::Point3;
use dsfms::image::Frame;
use dsfms::pipeline::Progress;
use dsfms::template::Template;
pub use messages::Picture;
use messages::{Messages, Snapshot};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::SystemTime;

/// Frames that wait for their messages to be written at most.
const WAITING: usize = 4;

/// Where and what to tell.
#[derive(Args, Debug)]
pub struct LinkArgs {
    /// Serve surface, pose, picture and verdict of every frame by OpenIGTLink; a port alone takes
    /// clients of this machine only. Nothing is encrypted.
    #[arg(long, value_name = "[ADDR:]PORT", value_parser = address, group = "link")]
    pub igtl: Option<SocketAddr>,
    /// Send the same to an OpenIGTLink server.
    #[arg(long, value_name = "HOST:PORT", value_parser = place, group = "link")]
    pub igtl_connect: Option<String>,
    /// The picture that OpenIGTLink sends.
    #[arg(long, value_enum, default_value_t = Picture::Frame, value_name = "PICTURE", requires = "link")]
    pub igtl_image: Picture,
}

/// `18944`, `0.0.0.0:18944`, `localhost:18944`.
fn address(text: &str) -> Result<SocketAddr, String> {
    if let Ok(port) = text.parse() {
        return Ok(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port));
    }
    let found = text.to_socket_addrs().ok().and_then(|mut all| all.next());
    found.ok_or_else(|| "expected PORT or ADDR:PORT, for example 18944 or 0.0.0.0:18944".into())
}

/// `HOST:PORT`.
pub fn place(text: &str) -> Result<String, String> {
    let port = text.rsplit_once(':').filter(|(host, _)| !host.is_empty());
    match port.map(|(_, port)| port.parse::<u16>()) {
        Some(Ok(1..)) => Ok(text.into()),
        _ => Err("expected HOST:PORT, for example localhost:18944".into()),
    }
}

/// The way from the tracker to its clients; nothing on it waits.
pub struct Link {
    clients: Arc<Clients>,
    frames: Arc<Queue<Snapshot>>,
    writer: JoinHandle<()>,
    pictures: bool,
}

impl Link {
    /// Open what was asked for; `None` where nothing was.
    pub fn open(
        args: &LinkArgs,
        template: &Template,
        camera: &CameraModel,
        reporter: &Reporter,
    ) -> anyhow::Result<Option<Self>> {
        if args.igtl.is_none() && args.igtl_connect.is_none() {
            return Ok(None);
        }
        if camera.size.iter().any(|n| *n > usize::from(u16::MAX)) {
            return Err(
                Usage("OpenIGTLink sends pictures of at most 65535 px a side".into()).into()
            );
        }
        let clients = Arc::new(Clients::default());
        if let Some(address) = args.igtl {
            let address = clients.listen(address).with_context(|| format!("--igtl {address}"))?;
            reporter.say(&format!("OpenIGTLink: clients are served at {address}"));
        }
        if let Some(place) = &args.igtl_connect {
            clients.connect(place.clone());
        }
        let frames = Queue::<Snapshot>::new(WAITING, Full::DropOldest);
        let messages = Messages::new(template, camera, args.igtl_image);
        let (from, to) = (frames.clone(), clients.clone());
        let writer = std::thread::spawn(move || {
            while let Some((told, _)) = from.pop() {
                to.send(&Arc::new(messages.bundle(&told)));
            }
        });
        let pictures = args.igtl_image != Picture::None;
        Ok(Some(Self { clients, frames, writer, pictures }))
    }

    /// Tell of a frame that came at `time`; `shape` is what its files hold.
    pub fn send(
        &self,
        told: &ToldFrame,
        frame: &Frame,
        time: SystemTime,
        shape: Option<&[Point3]>,
        reporter: &Reporter,
    ) -> anyhow::Result<()> {
        self.clients.news().iter().for_each(|news| reporter.say(&format!("OpenIGTLink: {news}")));
        if !self.clients.any() {
            return Ok(());
        }
        let mut line = Vec::new();
        tell(&ToldFrame { vertices: None, ..*told }, &mut line)?;
        self.frames.push(Snapshot {
            time,
            frame: self.pictures.then(|| frame.clone()),
            tracked: told.tracked.clone(),
            shape: shape.map(<[Point3]>::to_vec),
            verdict: String::from_utf8_lossy(&line).trim_end().to_owned(),
        });
        Ok(())
    }

    /// Send what waits, and close.
    pub fn finish(self, reporter: &Reporter) {
        self.frames.end();
        if self.writer.join().is_err() {
            reporter.warn("OpenIGTLink: messages could not be written");
        }
        self.clients.end();
        self.clients.news().iter().for_each(|news| reporter.say(&format!("OpenIGTLink: {news}")));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_of_this_machine_only() {
        assert_eq!(address("18944").unwrap().to_string(), "127.0.0.1:18944");
        assert_eq!(address("0.0.0.0:18944").unwrap().to_string(), "0.0.0.0:18944");
        assert_eq!(address("[::1]:0").unwrap().to_string(), "[::1]:0");
        for wrong in ["", "65536", "nowhere", "127.0.0.1", "127.0.0.1:port"] {
            assert!(address(wrong).is_err(), "{wrong}");
        }
        assert_eq!(place("localhost:18944").unwrap(), "localhost:18944");
        for wrong in ["", "18944", ":18944", "host:0", "host:port", "host"] {
            assert!(place(wrong).is_err(), "{wrong}");
        }
    }
}
