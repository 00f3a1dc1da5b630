//! `dsfms view`: the page of a report, template or mesh, from this machine to its own browser.

mod browser;
mod http;
mod live;
mod organ;

use crate::exit::Outcome;
use crate::report::embed::escape;
use crate::report::folder::PathContent;
use crate::stdout::to_stdout;
use anyhow::Context;
use clap::Args;
use http::{Answer, PATIENCE, Request};
use live::{Watched, WatchedContent, live};
use organ::Desk;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::Write;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
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
long clip every frame is there; they are sent when they are looked at.

Of a template whose organ was told from the frames, \"Organ\" leads to a page
where strokes over the organ, and over what is not, give another outline in
seconds. \"Save\" writes them to TEMPLATE/organ_scribbles.json, from which
`dsfms template --organ-scribbles` builds that template.";

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

/// Connections at a time; more are closed unanswered.
const MOST_CONNECTIONS: usize = 32;

/// Run the command; it ends with the process.
pub fn run(args: &ViewArgs) -> anyhow::Result<Outcome> {
    // A mistake in the path is said here and not in the browser.
    PathContent::of(&args.path)?.html()?;
    let (listener, root) = bound(args.port, "--port")?;
    let url = format!("http://{}{root}", listener.local_addr()?);
    to_stdout(&format!("{url}\nCtrl-C stops it\n"))?;
    std::io::stdout().flush()?;
    crate::interrupt::advise("the page is no longer served");
    if !args.no_open {
        browser::open(&url);
    }
    serve(&listener, &Served::of(&args.path), &root);
    Ok(Outcome::Ok)
}

/// Serve the page of an output folder that a run of this process fills, until the process ends.
/// Returns its address.
pub fn serve_running(output: &Path, port: u16) -> anyhow::Result<String> {
    let (listener, root) = bound(port, "--view-port")?;
    let url = format!("http://{}{root}", listener.local_addr()?);
    let served = Served { watched: Watched::running(output), desk: Desk::of(output) };
    std::thread::spawn(move || serve(&listener, &served, &root));
    // Over ssh the browser is on the other side.
    if std::env::var_os("SSH_CONNECTION").is_none() {
        browser::open(&url);
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
fn serve(listener: &TcpListener, served: &Served, root: &str) {
    let open = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        let Ok(stream) = stream else {
            // Without file descriptors, say: the connections that are open end by themselves.
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        let place = Connection(open.clone());
        if open.fetch_add(1, Ordering::SeqCst) >= MOST_CONNECTIONS {
            continue;
        }
        let (served, root) = (served.clone(), root.to_owned());
        std::thread::spawn(move || {
            let _place = place;
            // A browser that went away is no concern of the next one.
            answer(stream, &served, &root).ok();
        });
    }
}

/// One of the connections, until it is dropped.
struct Connection(Arc<AtomicUsize>);

impl Drop for Connection {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

/// 128 bits from the operating system, by way of the keys of the standard hasher.
fn token() -> String {
    let word = || RandomState::new().build_hasher().finish();
    format!("{:016x}{:016x}", word(), word())
}

/// The page of a run that has no frame yet; it asks again by itself.
const WAITING: &str = "<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\">\
    <meta http-equiv=\"refresh\" content=\"1\"><title>dsfms</title><body>{{words}}</body></html>";

/// The page while there is nothing to show: a command that begins has nothing yet, one that begins
/// anew takes away what an older run left. It asks again by itself.
fn waiting(running: bool, error: &anyhow::Error) -> Answer {
    let words = match running {
        true => "No frame yet.".to_owned(),
        false => escape(&crate::exit::describe(error)),
    };
    Answer::ok("text/html; charset=utf-8", WAITING.replace("{{words}}", &words))
}

/// What is served: a page that follows its files, and the organ's page of a template.
#[derive(Clone)]
struct Served {
    watched: Watched,
    desk: Desk,
}

impl Served {
    fn of(path: &Path) -> Self {
        Self { watched: Watched::new(path), desk: Desk::of(path) }
    }
}

fn answer(mut stream: TcpStream, served: &Served, root: &str) -> anyhow::Result<()> {
    let port = stream.local_addr()?.port();
    let end = Instant::now() + PATIENCE;
    let request = Request::read(&stream, end)?;
    let found = if !request.is_for(port) {
        Ok(Answer::text("421 Misdirected Request", "not here\n"))
    } else {
        let wanted = request.target.strip_prefix(root).map(str::to_owned);
        match (request.method.as_str(), wanted) {
            ("GET", Some(wanted)) => got(served, &wanted),
            ("POST", Some(wanted)) if request.is_own(port) => {
                posted(served, &wanted, request, &stream, end)
            }
            ("GET" | "POST", None) => Ok(missing()),
            _ => Ok(Answer::text("405 Method Not Allowed", "")),
        }
    };
    let failed = |error| Answer::text("500 Internal Server Error", crate::exit::describe(&error));
    found.unwrap_or_else(failed).send(&mut stream)
}

fn missing() -> Answer {
    Answer::text("404 Not Found", "not here\n")
}

fn got(served: &Served, wanted: &str) -> anyhow::Result<Answer> {
    if let Some(rest) = wanted.strip_prefix("organ") {
        return Ok(served.desk.get(rest)?.unwrap_or_else(missing));
    }
    let Some(wanted) = Asked::of(wanted) else { return Ok(missing()) };
    let found = served.watched.look();
    match (found.and_then(|look| wanted.body(&look, served.desk.is_there())), wanted) {
        (Err(error), Asked::Page) => Ok(waiting(served.watched.runs(), &error)),
        // Between two runs there is nothing to show, and nothing new.
        (Err(_), Asked::Version) => Ok(Answer::ok("text/plain", served.watched.last_version())),
        (found, _) => Ok(found?.map_or_else(missing, |(kind, body)| Answer::ok(kind, body))),
    }
}

fn posted(
    served: &Served,
    wanted: &str,
    request: Request,
    stream: &TcpStream,
    end: Instant,
) -> anyhow::Result<Answer> {
    let Some(rest) = wanted.strip_prefix("organ") else { return Ok(missing()) };
    match request.body(stream, end) {
        Ok(body) => Ok(served.desk.post(rest, &body)?.unwrap_or_else(missing)),
        Err(status) => Ok(Answer::text(status, "")),
    }
}

/// What can be asked for under the root.
enum Asked<'a> {
    Page,
    Version,
    Frame(&'a str),
}

impl<'a> Asked<'a> {
    fn of(target: &'a str) -> Option<Self> {
        match target {
            "" => Some(Self::Page),
            "version" => Some(Self::Version),
            // The name only picks one of the frames that the source lists.
            other => other.strip_prefix("frame/").map(Self::Frame),
        }
    }

    /// Its type and text; `None` where the source has no such frame.
    fn body(
        &self,
        look: &WatchedContent,
        organ: bool,
    ) -> anyhow::Result<Option<(&'static str, String)>> {
        Ok(match self {
            Self::Page => {
                let page = live(&look.source.html()?, &look.version, organ);
                Some(("text/html; charset=utf-8", page))
            }
            Self::Version => Some(("text/plain", look.version.clone())),
            Self::Frame(name) => {
                look.source.frame(name)?.map(|json| ("application/json; charset=utf-8", json))
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn tokens_differ() {
        let (a, b) = (token(), token());
        assert!(a != b && a.len() == 32 && a.chars().all(|c| c.is_ascii_hexdigit()), "{a} {b}");
    }

    #[test]
    fn a_page_whose_files_are_gone_for_a_moment_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("report.html");
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let served = Served::of(folder.path());
        std::thread::spawn(move || serve(&listener, &served, "/secret/"));
        let get = || {
            let mut stream = TcpStream::connect(address).unwrap();
            write!(stream, "GET /secret/ HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).unwrap();
            text
        };
        let gone = get();
        assert!(gone.starts_with("HTTP/1.1 200") && gone.contains("refresh"), "{gone}");
        assert!(gone.contains("holds no report.html"), "{gone}");
        std::fs::write(&page, "<body>here</body>").unwrap();
        assert!(get().contains("here"));
    }

    #[test]
    fn the_token_opens_the_page_and_nothing_else_does() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("report.html");
        std::fs::write(&page, "<body>here</body>").unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || serve(&listener, &Served::of(&page), "/secret/"));
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

    #[test]
    fn the_organ_is_drawn_by_its_own_page_alone() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("report.html"), "<body>here</body>").unwrap();
        let scene = folder.path().join(crate::commands::template::scene::SCENE);
        organ::tests::scene().write(&scene).unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let path = folder.path().to_path_buf();
        std::thread::spawn(move || serve(&listener, &Served::of(&path), "/secret/"));
        let ask = |line: &str, head: &str, body: &str| {
            let mut stream = TcpStream::connect(address).unwrap();
            let length = format!("Content-Length: {}\r\n", body.len());
            write!(stream, "{line} HTTP/1.1\r\nHost: {address}\r\n{length}{head}\r\n{body}")
                .unwrap();
            let mut text = Vec::new();
            stream.read_to_end(&mut text).unwrap();
            String::from_utf8_lossy(&text).into_owned()
        };
        assert!(
            ask("GET /secret/", "", "").contains("\"true\" === \"true\""),
            "the page leads to it"
        );
        assert!(ask("GET /secret/organ", "", "").contains("<canvas"));
        assert!(ask("GET /secret/organ/photo/0", "", "").contains("image/jpeg"));
        let (json, none) = ("Content-Type: application/json\r\n", "{\"strokes\": []}");
        let part = ask("POST /secret/organ/part", json, none);
        assert!(part.starts_with("HTTP/1.1 200") && part.contains("\"runs\""), "{part}");
        // Without the token, as a form of elsewhere would send it, from elsewhere, to what takes
        // nothing.
        assert!(ask("POST /organ/part", json, none).starts_with("HTTP/1.1 404"));
        let form = "Content-Type: text/plain\r\n";
        assert!(ask("POST /secret/organ/part", form, none).starts_with("HTTP/1.1 405"));
        let evil = format!("{json}Origin: https://evil.example\r\n");
        assert!(ask("POST /secret/organ/save", &evil, none).starts_with("HTTP/1.1 405"));
        for odd in ["POST /secret/", "POST /secret/organ", "POST /secret/organ/scene"] {
            assert!(ask(odd, json, none).starts_with("HTTP/1.1 404"), "{odd}");
        }
        assert!(ask("PUT /secret/organ/save", json, none).starts_with("HTTP/1.1 405"));
        let mut stream = TcpStream::connect(address).unwrap();
        let head = format!("{json}Content-Length: {}\r\n", http::LONGEST_BODY + 1);
        write!(stream, "POST /secret/organ/save HTTP/1.1\r\nHost: {address}\r\n{head}\r\n")
            .unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        assert!(text.starts_with("HTTP/1.1 413"), "{text}");
        assert!(!folder.path().join("organ_scribbles.json").exists());
    }

    #[test]
    fn connections_are_bounded_and_come_free_again() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("report.html");
        std::fs::write(&page, "<body>here</body>").unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || serve(&listener, &Served::of(&page), "/secret/"));
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
