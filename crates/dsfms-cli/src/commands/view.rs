//! `dsfms view`: the page of a report, template or mesh, from this machine to its own browser.

mod live;

use crate::exit::Outcome;
use crate::report::folder::Source;
use anyhow::Context;
use clap::Args;
use live::{Look, Watched, live};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

const EXAMPLES: &str = "\
Examples:
  dsfms view out
  dsfms view organ.template
  dsfms view out/frame_003.ply --no-open

Serves one page on 127.0.0.1 under an address that nobody can guess, until
Ctrl-C. The page is made again when the files change, so a running `dsfms
track` can be watched: who looks at its last frame goes on to the newest. Of a
long clip every frame is there; they are sent when they are looked at.";

/// Show an output folder, a template or a mesh in the browser.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct ViewArgs {
    /// Output folder, template, mesh file or report.html.
    #[arg(value_name = "PATH")]
    path: PathBuf,
    /// Only print the address.
    #[arg(long)]
    no_open: bool,
    /// Port; default any free one.
    #[arg(long, value_name = "N", default_value_t = 0)]
    port: u16,
}

/// Longest request that is read, bytes.
const LONGEST_REQUEST: usize = 16384;
/// A browser may open a connection and say nothing; a request must be whole by then.
const PATIENCE: Duration = Duration::from_secs(10);
/// An answer must have been taken by then.
const LONGEST_ANSWER: Duration = Duration::from_secs(120);
/// Connections at a time; more are closed unanswered.
const MOST_CONNECTIONS: usize = 32;

/// Run the command; it ends with the process.
pub fn run(args: &ViewArgs) -> anyhow::Result<Outcome> {
    // A mistake in the path is said here and not in the browser.
    Source::of(&args.path)?.html()?;
    let (listener, root) = bound(args.port, "--port")?;
    let url = format!("http://{}{root}", listener.local_addr()?);
    super::to_stdout(&format!("{url}\nCtrl-C stops it\n"))?;
    std::io::stdout().flush()?;
    crate::interrupt::advise("the page is no longer served");
    if !args.no_open {
        open(&url);
    }
    serve(&listener, &Watched::new(&args.path), &root);
    Ok(Outcome::Ok)
}

/// Serve the page of an output folder that a run of this process fills, until the process ends. Returns its
/// address.
pub fn serve_running(output: &Path, port: u16) -> anyhow::Result<String> {
    let (listener, root) = bound(port, "--view-port")?;
    let url = format!("http://{}{root}", listener.local_addr()?);
    let watched = Watched::running(output);
    std::thread::spawn(move || serve(&listener, &watched, &root));
    // Over ssh the browser is on the other side.
    if std::env::var_os("SSH_CONNECTION").is_none() {
        open(&url);
    }
    Ok(url)
}

/// A port of this machine alone, and a path that nobody can guess.
fn bound(port: u16, option: &str) -> anyhow::Result<(TcpListener, String)> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))
        .with_context(|| format!("port {port} of 127.0.0.1 cannot be used; leave {option} out"))?;
    Ok((listener, format!("/{}/", token())))
}

/// Answer, each connection on a thread of its own.
fn serve(listener: &TcpListener, watched: &Watched, root: &str) {
    let open = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        let Ok(stream) = stream else {
            // Without file descriptors, say: the connections that are open end by themselves.
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        let place = Place(open.clone());
        if open.fetch_add(1, Ordering::SeqCst) >= MOST_CONNECTIONS {
            continue;
        }
        let (watched, root) = (watched.clone(), root.to_owned());
        std::thread::spawn(move || {
            let _place = place;
            // A browser that went away is no concern of the next one.
            answer(stream, &watched, &root).ok();
        });
    }
}

/// One of the connections, until it is dropped.
struct Place(Arc<AtomicUsize>);

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

/// 128 bits from the operating system, by way of the keys of the standard hasher.
fn token() -> String {
    let word = || RandomState::new().build_hasher().finish();
    format!("{:016x}{:016x}", word(), word())
}

fn open(url: &str) {
    let (program, arguments): (&str, &[&str]) = match std::env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("rundll32", &["url.dll,FileProtocolHandler"]),
        _ => ("xdg-open", &[]),
    };
    // Without a desktop the printed address is enough.
    let mut browser = Command::new(program);
    let _ = browser.args(arguments).arg(url).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
}

/// A request, as far as it matters.
struct Request {
    method: String,
    target: String,
    /// Of every `Host` header.
    hosts: Vec<String>,
}

fn answer(mut stream: TcpStream, watched: &Watched, root: &str) -> anyhow::Result<()> {
    let port = stream.local_addr()?.port();
    let Request { method, target, hosts } = request(&stream, Instant::now() + PATIENCE)?;
    // A page of elsewhere whose name was made to point here says its own name.
    if !own_host(&hosts, port) {
        return respond(&mut stream, "421 Misdirected Request", "text/plain", "not here\n");
    }
    if method != "GET" {
        return respond(&mut stream, "405 Method Not Allowed", "text/plain", "");
    }
    let Some(wanted) = target.strip_prefix(root).and_then(Wanted::of) else {
        return respond(&mut stream, "404 Not Found", "text/plain", "not here\n");
    };
    match watched.look().and_then(|look| wanted.body(&look)) {
        Ok(Some((kind, body))) => respond(&mut stream, "200 OK", kind, &body),
        Ok(None) => respond(&mut stream, "404 Not Found", "text/plain", "no such frame\n"),
        Err(_) if watched.runs() && matches!(wanted, Wanted::Page) => {
            respond(&mut stream, "200 OK", "text/html; charset=utf-8", WAITING)
        }
        Err(error) => {
            let text = crate::exit::describe(&error);
            respond(&mut stream, "500 Internal Server Error", "text/plain; charset=utf-8", &text)
        }
    }
}

/// What can be asked for under the root.
enum Wanted<'a> {
    Page,
    Version,
    Frame(&'a str),
}

impl<'a> Wanted<'a> {
    fn of(target: &'a str) -> Option<Self> {
        match target {
            "" => Some(Self::Page),
            "version" => Some(Self::Version),
            // The name only picks one of the frames that the source lists.
            other => other.strip_prefix("frame/").map(Self::Frame),
        }
    }

    /// Its type and text; `None` where the source has no such frame.
    fn body(&self, look: &Look) -> anyhow::Result<Option<(&'static str, String)>> {
        Ok(match self {
            Self::Page => {
                let page = live(&look.source.html()?, &look.version);
                Some(("text/html; charset=utf-8", page))
            }
            Self::Version => Some(("text/plain", look.version.clone())),
            Self::Frame(name) => {
                look.source.frame(name)?.map(|json| ("application/json; charset=utf-8", json))
            }
        })
    }
}

/// Whether a request says once for whom it is, and that this is this server.
fn own_host(hosts: &[String], port: u16) -> bool {
    let own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    matches!(hosts, [host] if own.iter().any(|own| own.eq_ignore_ascii_case(host)))
}

/// Read a request, which must be whole by `end` however it dribbles in.
fn request(stream: &TcpStream, end: Instant) -> anyhow::Result<Request> {
    let mut bytes: Vec<u8> = Vec::new();
    let mut chunk = [0; 2048];
    while !bytes.windows(4).any(|w| w == b"\r\n\r\n") {
        let left = end.saturating_duration_since(Instant::now());
        anyhow::ensure!(!left.is_zero() && bytes.len() <= LONGEST_REQUEST, "slow or long request");
        stream.set_read_timeout(Some(left))?;
        let count = (&*stream).read(&mut chunk)?;
        anyhow::ensure!(count > 0, "the connection ended within the request");
        bytes.extend(&chunk[..count]);
    }
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.split("\r\n");
    let mut words = lines.next().unwrap_or_default().split_whitespace();
    let mut word = || words.next().unwrap_or_default().to_owned();
    let header = |line: &str| {
        let (name, value) = line.split_once(':')?;
        name.eq_ignore_ascii_case("host").then(|| value.trim().to_owned())
    };
    let (method, target) = (word(), word());
    let hosts = lines.take_while(|line| !line.is_empty()).filter_map(header).collect();
    Ok(Request { method, target, hosts })
}

fn respond(stream: &mut TcpStream, status: &str, kind: &str, body: &str) -> anyhow::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\r\n",
        body.len()
    );
    let end = Instant::now() + LONGEST_ANSWER;
    for part in head.as_bytes().chunks(CHUNK).chain(body.as_bytes().chunks(CHUNK)) {
        let left = end.saturating_duration_since(Instant::now());
        anyhow::ensure!(!left.is_zero(), "slow reader");
        stream.set_write_timeout(Some(left.min(PATIENCE)))?;
        stream.write_all(part)?;
    }
    Ok(stream.flush()?)
}

/// The page of a run that has no frame yet; it asks again by itself.
const WAITING: &str = "<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\">\
    <meta http-equiv=\"refresh\" content=\"1\"><title>dsfms track</title><body>No frame yet.</body></html>";

/// Bytes written between two looks at the clock.
const CHUNK: usize = 1 << 16;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_differ() {
        let (a, b) = (token(), token());
        assert!(a != b && a.len() == 32 && a.chars().all(|c| c.is_ascii_hexdigit()), "{a} {b}");
    }

    #[test]
    fn the_token_opens_the_page_and_nothing_else_does() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("report.html");
        std::fs::write(&page, "<body>here</body>").unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || serve(&listener, &Watched::new(&page), "/secret/"));
        let port = address.port();
        let to = |host: &str, line: &str| {
            let mut stream = TcpStream::connect(address).unwrap();
            write!(stream, "{line} HTTP/1.1\r\n{host}\r\n").unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).unwrap();
            text
        };
        let own = format!("Host: 127.0.0.1:{port}\r\n");
        assert!(to(&own, "GET /secret/").contains("here"));
        assert!(to(&format!("host: LOCALHOST:{port}\r\n"), "GET /secret/").contains("here"));
        assert!(to(&own, "GET /").starts_with("HTTP/1.1 404"));
        // Frames that nobody listed, and what is no frame.
        let odd = ["frame/", "frame/frame_001", "frame/../report.html", "frame/%2e%2e", "frame"];
        for name in odd {
            let text = to(&own, &format!("GET /secret/{name}"));
            assert!(text.starts_with("HTTP/1.1 404") && !text.contains("here<"), "{name}: {text}");
        }
        assert!(to(&own, "POST /secret/").starts_with("HTTP/1.1 405"));
        // A name that was made to point here, another port, none, two.
        let others = [
            "Host: evil.example\r\n".into(),
            format!("Host: evil.example:{port}\r\n"),
            "Host: 127.0.0.1:1\r\n".into(),
            String::new(),
            format!("{own}Host: evil.example\r\n"),
        ];
        for host in others {
            let text = to(&host, "GET /secret/");
            assert!(text.starts_with("HTTP/1.1 421") && !text.contains("<body>"), "{host}: {text}");
        }
    }

    /// A sender that dribbles is cut off although it never pauses for long.
    #[test]
    fn slow_senders_are_cut_off() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let mut sender = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let stream = listener.accept().unwrap().0;
        let dribble = std::thread::spawn(move || {
            for _ in 0..200 {
                if sender.write_all(b"G").is_err() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let begin = Instant::now();
        assert!(request(&stream, begin + Duration::from_millis(300)).is_err());
        assert!(begin.elapsed() < Duration::from_secs(3), "{:?}", begin.elapsed());
        drop(stream);
        dribble.join().unwrap();
        let mut sender = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let stream = listener.accept().unwrap().0;
        sender.write_all(&[b'x'; 20_000]).unwrap();
        assert!(request(&stream, Instant::now() + PATIENCE).is_err(), "a long request");
    }

    #[test]
    fn connections_are_bounded_and_come_free_again() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("report.html");
        std::fs::write(&page, "<body>here</body>").unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || serve(&listener, &Watched::new(&page), "/secret/"));
        let ask = || {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
            let line = format!("GET /secret/ HTTP/1.1\r\nHost: {address}\r\n\r\n");
            // Closed unanswered is what is asked for here.
            let _ = stream.write_all(line.as_bytes());
            let mut text = String::new();
            let _ = stream.read_to_string(&mut text);
            text
        };
        let idle: Vec<TcpStream> =
            (0..MOST_CONNECTIONS).map(|_| TcpStream::connect(address).unwrap()).collect();
        // The last of them has been taken when this one has been closed.
        assert!(ask().is_empty());
        drop(idle);
        let free = (0..100).any(|_| {
            std::thread::sleep(Duration::from_millis(50));
            ask().contains("here")
        });
        assert!(free);
    }
}
