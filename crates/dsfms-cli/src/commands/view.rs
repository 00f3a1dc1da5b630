//! `dsfms view`: the page of a report, template or mesh, from this machine to its own browser.

use crate::exit::Outcome;
use crate::report::folder::Source;
use anyhow::Context;
use clap::Args;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, UNIX_EPOCH};

const EXAMPLES: &str = "\
Examples:
  dsfms view out
  dsfms view organ.template
  dsfms view out/frame_003.ply --no-open

Serves one page on 127.0.0.1 under an address that nobody can guess, until Ctrl-C. The page is made
again when the files change, so a running `dsfms track` can be watched: who looks at its last frame
goes on to the newest.";

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
const LONGEST_REQUEST: u64 = 16384;
/// A browser may open a connection and say nothing.
const PATIENCE: Duration = Duration::from_secs(10);

/// Run the command; it ends with the process.
pub fn run(args: &ViewArgs) -> anyhow::Result<Outcome> {
    // A mistake in the path is said here and not in the browser.
    Source::of(&args.path)?.html()?;
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, args.port)).with_context(|| {
        format!("port {} of 127.0.0.1 cannot be used; leave --port out", args.port)
    })?;
    let root = format!("/{}/", token());
    let url = format!("http://{}{root}", listener.local_addr()?);
    super::to_stdout(&format!("{url}\nCtrl-C stops it\n"))?;
    std::io::stdout().flush()?;
    if !args.no_open {
        open(&url);
    }
    for stream in listener.incoming().flatten() {
        let (path, root) = (args.path.clone(), root.clone());
        // A browser that went away is no concern of the next one.
        std::thread::spawn(move || answer(stream, &path, &root).ok());
    }
    Ok(Outcome::Ok)
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

fn answer(mut stream: TcpStream, path: &std::path::Path, root: &str) -> anyhow::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let Some(target) = request(&stream)? else {
        return respond(&mut stream, "405 Method Not Allowed", "text/plain", "");
    };
    let source = Source::of(path);
    let version = version(&source);
    let html = match target.strip_prefix(root) {
        Some("") => source.and_then(|s| s.html()),
        Some("version") => return respond(&mut stream, "200 OK", "text/plain", &version),
        _ => return respond(&mut stream, "404 Not Found", "text/plain", "not here\n"),
    };
    match html {
        Ok(html) => {
            respond(&mut stream, "200 OK", "text/html; charset=utf-8", &live(&html, &version))
        }
        Err(error) => {
            let text = crate::exit::describe(&error);
            respond(&mut stream, "500 Internal Server Error", "text/plain; charset=utf-8", &text)
        }
    }
}

/// The target of a GET request.
fn request(stream: &TcpStream) -> anyhow::Result<Option<String>> {
    let mut reader = BufReader::new(stream.take(LONGEST_REQUEST));
    let mut first = String::new();
    reader.read_line(&mut first)?;
    // The headers say nothing that matters, but must be read before the answer.
    let mut line = String::new();
    while reader.read_line(&mut line)? > 2 {
        line.clear();
    }
    let mut words = first.split_whitespace();
    Ok((words.next() == Some("GET")).then(|| words.next().unwrap_or_default().to_string()))
}

fn version(source: &anyhow::Result<Source>) -> String {
    let changed = source.as_ref().ok().and_then(Source::changed);
    let since = changed.and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    since.map_or(0, |d| d.as_millis()).to_string()
}

/// The page that takes over what changes in its files, in place where that can be done. A report
/// itself may not connect to anything; here it may ask this server.
fn live(html: &str, version: &str) -> String {
    let script = format!(
        "<script>(() => {{ let shown = \"{version}\", busy = false;\
         const ask = async (path) => (await fetch(path)).text();\
         const look = async () => {{ const now = await ask(\"version\"); if (now === shown) return;\
         const page = new DOMParser().parseFromString(await ask(\"\"), \"text/html\");\
         if (window.dsfms && dsfms.update(page)) shown = now; else location.reload(); }};\
         setInterval(() => {{ if (busy) return; busy = true;\
         look().catch(() => {{}}).finally(() => {{ busy = false; }}); }}, 1000); }})();</script></body>"
    );
    html.replacen("default-src 'none';", "default-src 'none'; connect-src 'self';", 1)
        .replacen("</body>", &script, 1)
}

fn respond(stream: &mut TcpStream, status: &str, kind: &str, body: &str) -> anyhow::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\r\n",
        body.len()
    )?;
    stream.write_all(body.as_bytes())?;
    Ok(stream.flush()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_differ() {
        let (a, b) = (token(), token());
        assert!(a != b && a.len() == 32 && a.chars().all(|c| c.is_ascii_hexdigit()), "{a} {b}");
    }

    #[test]
    fn only_the_served_page_may_connect() {
        let page = "<meta content=\"default-src 'none'; img-src data:\"><body></body>";
        let served = live(page, "7");
        assert!(served.contains("connect-src 'self'") && served.contains("\"7\""), "{served}");
    }

    #[test]
    fn the_token_opens_the_page_and_nothing_else_does() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("report.html");
        std::fs::write(&page, "<body>here</body>").unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let server = std::thread::spawn(move || {
            for _ in 0..3 {
                answer(listener.accept().unwrap().0, &page, "/secret/").unwrap();
            }
        });
        let ask = |line: &str| {
            let mut stream = TcpStream::connect(address).unwrap();
            write!(stream, "{line} HTTP/1.1\r\nHost: x\r\n\r\n").unwrap();
            let mut text = String::new();
            stream.read_to_string(&mut text).unwrap();
            text
        };
        assert!(ask("GET /secret/").contains("here"));
        assert!(ask("GET /").starts_with("HTTP/1.1 404"));
        assert!(ask("POST /secret/").starts_with("HTTP/1.1 405"));
        server.join().unwrap();
    }
}
