//! As much of HTTP as one page needs: bounded requests, for this server and from its own page
//! alone.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

/// Longest head of a request that is read, bytes.
const LONGEST_HEAD: usize = 16384;
/// Longest body.
pub const LONGEST_BODY: usize = 1 << 20;
/// A browser may open a connection and say nothing; a request must be whole by then.
pub const PATIENCE: Duration = Duration::from_secs(10);
/// An answer must have been taken by then.
const LONGEST_ANSWER: Duration = Duration::from_secs(120);
/// What a client still sends is read for so long after the answer.
const LINGER: Duration = Duration::from_secs(1);
/// Bytes written between two looks at the clock.
const CHUNK: usize = 1 << 16;

/// The head of a request, as far as it matters, and what came with it of the body.
#[derive(Debug)]
pub struct Request {
    pub method: String,
    pub target: String,
    headers: Vec<(String, String)>,
    begun: Vec<u8>,
}

impl Request {
    /// Read a head, which must be whole by `end` however it dribbles in.
    pub fn read(stream: &TcpStream, end: Instant) -> anyhow::Result<Self> {
        let mut bytes: Vec<u8> = Vec::new();
        let head = loop {
            if let Some(at) = bytes.windows(4).position(|w| w == b"\r\n\r\n") {
                break at;
            }
            anyhow::ensure!(bytes.len() <= LONGEST_HEAD, "a long request");
            more(stream, end, &mut bytes)?;
        };
        let text = String::from_utf8_lossy(&bytes[..head]).into_owned();
        let mut lines = text.split("\r\n");
        let mut words = lines.next().unwrap_or_default().split_whitespace();
        let mut word = || words.next().unwrap_or_default().to_owned();
        let (method, target) = (word(), word());
        let header = |line: &str| {
            let (name, value) = line.split_once(':')?;
            Some((name.to_ascii_lowercase(), value.trim().to_owned()))
        };
        let headers = lines.filter_map(header).collect();
        Ok(Self { method, target, headers, begun: bytes.split_off(head + 4) })
    }

    /// Every value of a header; its name in small letters.
    fn all(&self, name: &str) -> Vec<&str> {
        self.headers
            .iter()
            .filter(|(own, _)| own == name)
            .map(|(_, value)| value.as_str())
            .collect()
    }

    /// Whether it says once for whom it is, and that this is this server. A page of elsewhere whose
    /// name was made to point here says its own name.
    pub fn is_for(&self, port: u16) -> bool {
        let own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        matches!(self.all("host")[..], [host] if own.iter().any(|own| own.eq_ignore_ascii_case(host)))
    }

    /// Whether it comes from a page of this server: what a page of elsewhere sends says where it
    /// comes from, and that it is JSON only after this server was asked, which does not allow it.
    pub fn is_own(&self, port: u16) -> bool {
        let own = [format!("http://127.0.0.1:{port}"), format!("http://localhost:{port}")];
        let from = self.all("origin");
        from.iter().all(|from| own.iter().any(|own| own.eq_ignore_ascii_case(from)))
            && matches!(self.all("content-type")[..], [kind] if kind.starts_with("application/json"))
    }

    /// The body, whole by `end`, or the status to answer with instead.
    pub fn body(mut self, stream: &TcpStream, end: Instant) -> Result<String, &'static str> {
        let length = match self.all("content-length")[..] {
            [one] => one.parse::<usize>().map_err(|_| "400 Bad Request")?,
            _ => return Err("411 Length Required"),
        };
        if length > LONGEST_BODY {
            return Err("413 Content Too Large");
        }
        while self.begun.len() < length {
            more(stream, end, &mut self.begun).map_err(|_| "408 Request Timeout")?;
        }
        self.begun.truncate(length);
        String::from_utf8(self.begun).map_err(|_| "400 Bad Request")
    }
}

/// Some bytes more.
fn more(stream: &TcpStream, end: Instant, bytes: &mut Vec<u8>) -> anyhow::Result<()> {
    let mut chunk = [0; 2048];
    let left = end.saturating_duration_since(Instant::now());
    anyhow::ensure!(!left.is_zero(), "a slow request");
    stream.set_read_timeout(Some(left))?;
    let mut stream = stream;
    let count = stream.read(&mut chunk)?;
    anyhow::ensure!(count > 0, "the connection ended within the request");
    bytes.extend(&chunk[..count]);
    Ok(())
}

/// An answer.
#[derive(Debug)]
pub struct Answer {
    pub status: &'static str,
    pub kind: &'static str,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn new(status: &'static str, kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self { status, kind, body: body.into() }
    }

    pub fn ok(kind: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self::new("200 OK", kind, body)
    }

    pub fn text(status: &'static str, body: impl Into<Vec<u8>>) -> Self {
        Self::new(status, "text/plain; charset=utf-8", body)
    }

    /// Send it.
    pub fn send(&self, stream: &mut TcpStream) -> anyhow::Result<()> {
        let head = format!(
            "HTTP/1.1 {}\r\nContent-Type: {}\r\nContent-Length: {}\r\nConnection: close\r\n\
             Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\r\n",
            self.status,
            self.kind,
            self.body.len()
        );
        let end = Instant::now() + LONGEST_ANSWER;
        for part in head.as_bytes().chunks(CHUNK).chain(self.body.chunks(CHUNK)) {
            let left = end.saturating_duration_since(Instant::now());
            anyhow::ensure!(!left.is_zero(), "slow reader");
            stream.set_write_timeout(Some(left.min(PATIENCE)))?;
            stream.write_all(part)?;
        }
        stream.flush()?;
        // What is left unread would make the system reset the connection, and the answer with it.
        stream.shutdown(Shutdown::Write)?;
        let (end, mut taken, mut rest) = (Instant::now() + LINGER, 0, Vec::new());
        while taken <= LONGEST_BODY && more(stream, end, &mut rest).is_ok() {
            taken += rest.len();
            rest.clear();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{Ipv4Addr, TcpListener};

    fn pair() -> (TcpStream, TcpStream) {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let sender = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        (sender, listener.accept().unwrap().0)
    }

    /// A sender that dribbles is cut off although it never pauses for long.
    #[test]
    fn slow_senders_are_cut_off() {
        let (mut sender, stream) = pair();
        let dribble = std::thread::spawn(move || {
            for _ in 0..200 {
                if sender.write_all(b"G").is_err() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        let begin = Instant::now();
        assert!(Request::read(&stream, begin + Duration::from_millis(300)).is_err());
        assert!(begin.elapsed() < Duration::from_secs(3), "{:?}", begin.elapsed());
        drop(stream);
        dribble.join().unwrap();
        let (mut sender, stream) = pair();
        sender.write_all(&[b'x'; 20_000]).unwrap();
        assert!(Request::read(&stream, Instant::now() + PATIENCE).is_err(), "a long request");
    }

    fn body(head: &str, content: &[u8]) -> Result<String, &'static str> {
        let (mut sender, stream) = pair();
        sender.write_all(format!("POST / HTTP/1.1\r\n{head}\r\n").as_bytes()).unwrap();
        sender.write_all(content).unwrap();
        let request = Request::read(&stream, Instant::now() + PATIENCE).unwrap();
        request.body(&stream, Instant::now() + Duration::from_millis(300))
    }

    #[test]
    fn bodies_are_as_long_as_they_say_and_no_longer_than_allowed() {
        assert_eq!(body("Content-Length: 4\r\n", b"{}\n and more"), Ok("{}\n ".into()));
        assert_eq!(body("Content-Length: 0\r\n", b""), Ok(String::new()));
        assert_eq!(body("", b"{}"), Err("411 Length Required"));
        assert_eq!(body("Transfer-Encoding: chunked\r\n", b"2\r\n{}"), Err("411 Length Required"));
        let twice = "Content-Length: 2\r\nContent-Length: 3\r\n";
        assert_eq!(body(twice, b"{} "), Err("411 Length Required"));
        assert_eq!(body("Content-Length: -1\r\n", b"{}"), Err("400 Bad Request"));
        assert_eq!(body("Content-Length: 2\r\n", b"\xff\xff"), Err("400 Bad Request"));
        let long = format!("Content-Length: {}\r\n", LONGEST_BODY + 1);
        assert_eq!(body(&long, b"{"), Err("413 Content Too Large"));
        assert_eq!(body("Content-Length: 9\r\n", b"{}"), Err("408 Request Timeout"));
    }

    #[test]
    fn only_json_of_the_own_page_is_taken() {
        let from = |head: &str| {
            let (mut sender, stream) = pair();
            sender.write_all(format!("POST / HTTP/1.1\r\n{head}\r\n").as_bytes()).unwrap();
            Request::read(&stream, Instant::now() + PATIENCE).unwrap().is_own(80)
        };
        let json = "Content-Type: application/json\r\n";
        assert!(from(json) && from(&format!("{json}Origin: http://127.0.0.1:80\r\n")));
        assert!(from(&format!("{json}origin: http://localhost:80\r\n")));
        assert!(!from("") && !from("Content-Type: text/plain\r\n"));
        for origin in ["https://evil.example", "null", "http://127.0.0.1:81"] {
            assert!(!from(&format!("{json}Origin: {origin}\r\n")), "{origin}");
        }
    }
}
