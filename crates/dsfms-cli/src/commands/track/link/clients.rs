//! Who listens: each client on threads of its own, so that none can slow the tracker or another.

use super::super::queue::{Full, Queue};
use dsfms::io::igtl::{IgtlError, read};
use std::io::{ErrorKind, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// All messages of a frame.
pub type Bundle = Arc<Vec<u8>>;

/// Frames that wait for a client at most; the oldest gives way.
const WAITING: usize = 4;

/// Clients at a time.
const MOST: usize = 8;

/// A client that takes nothing for so long is gone.
const STUCK: Duration = Duration::from_secs(5);

/// Between two tries to reach a receiver.
const AGAIN: Duration = Duration::from_millis(500);

/// Time for clients to take the last frames when the run ends.
const LEAVE: Duration = Duration::from_secs(2);

/// Things said that nobody has read yet, at most.
const MOST_NEWS: usize = 100;

/// The clients of a run.
#[derive(Default)]
pub struct Clients {
    list: Mutex<Vec<Arc<Queue<Bundle>>>>,
    news: Mutex<Vec<String>>,
    ended: AtomicBool,
}

/// A poisoned lock only means that another thread panicked; lists are whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Clients {
    /// Take clients at an address; which one it is, where the system chose the port.
    pub fn listen(self: &Arc<Self>, address: SocketAddr) -> std::io::Result<SocketAddr> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let clients = self.clone();
        std::thread::spawn(move || {
            while !clients.ended.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((stream, _)) => {
                        let clients = clients.clone();
                        std::thread::spawn(move || clients.serve(&stream));
                    }
                    // Too many open files, for one.
                    Err(_) => std::thread::sleep(AGAIN),
                }
            }
        });
        Ok(address)
    }

    /// Send to a receiver that waits at `HOST:PORT`, whenever it is there.
    pub fn connect(self: &Arc<Self>, address: String) {
        let clients = self.clone();
        std::thread::spawn(move || {
            let mut said = false;
            while !clients.ended.load(Ordering::Relaxed) {
                match reach(&address) {
                    Ok(stream) => {
                        said = false;
                        clients.serve(&stream);
                    }
                    Err(error) if !said => {
                        clients.say(format!("{address} is not there yet: {error}"));
                        said = true;
                    }
                    Err(_) => {}
                }
                std::thread::sleep(AGAIN);
            }
        });
    }

    /// Whether anybody listens.
    pub fn any(&self) -> bool {
        !lock(&self.list).is_empty()
    }

    /// Give every client the messages of a frame. Returns at once.
    pub fn send(&self, bundle: &Bundle) {
        for queue in lock(&self.list).iter() {
            queue.push(bundle.clone());
        }
    }

    /// Who came and went since this was last asked.
    pub fn news(&self) -> Vec<String> {
        std::mem::take(&mut *lock(&self.news))
    }

    /// No more frames; clients get what waits for them, if they take it soon.
    pub fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
        lock(&self.list).iter().for_each(|queue| queue.end());
        let start = Instant::now();
        while self.any() && start.elapsed() < LEAVE {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn say(&self, text: String) {
        let mut news = lock(&self.news);
        if news.len() < MOST_NEWS {
            news.push(text);
        }
    }

    /// Send to one client until it or the run ends.
    fn serve(self: &Arc<Self>, stream: &TcpStream) {
        let name = stream.peer_addr().map_or("a client".into(), |address| address.to_string());
        let queue = Queue::new(WAITING, Full::DropOldest);
        {
            let mut list = lock(&self.list);
            if self.ended.load(Ordering::Relaxed) {
                return;
            }
            if list.len() >= MOST {
                self.say(format!("{name} is refused: {MOST} clients are there already"));
                return;
            }
            list.push(queue.clone());
        }
        self.say(format!("{name} is there"));
        let (mut sent, mut left_out) = (0, 0);
        let ended = self.hear(stream, &queue, &name).and_then(|()| {
            // Small messages are not held back to be sent with others.
            stream.set_nodelay(true)?;
            stream.set_write_timeout(Some(STUCK))?;
            let mut stream = stream;
            while let Some((bundle, dropped)) = queue.pop() {
                left_out += dropped;
                stream.write_all(&bundle)?;
                sent += 1;
            }
            Ok(())
        });
        let why = match &ended {
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                format!(" (it took nothing for {} s)", STUCK.as_secs())
            }
            _ => String::new(),
        };
        // What it sent and nobody read yet must not take back what was sent to it.
        let how = if ended.is_ok() { Shutdown::Write } else { Shutdown::Both };
        let _ = stream.shutdown(how);
        lock(&self.list).retain(|other| !Arc::ptr_eq(other, &queue));
        self.say(format!("{name} is gone{why}: {sent} frame(s) sent, {left_out} left out"));
    }

    /// Read past whatever a client sends, on a thread of its own: its queue ends with its stream.
    fn hear(
        self: &Arc<Self>,
        stream: &TcpStream,
        queue: &Arc<Queue<Bundle>>,
        name: &str,
    ) -> std::io::Result<()> {
        let mut stream = stream.try_clone()?;
        let (clients, queue, name) = (self.clone(), queue.clone(), name.to_owned());
        std::thread::spawn(move || {
            // Nothing is wanted, so that it returns at the end or at what is no message.
            let ended = read(&mut stream, |_| false);
            if let Err(error @ (IgtlError::Version(_) | IgtlError::TooLong(_))) = ended {
                clients.say(format!("{name} sends what is no message: {error}"));
            }
            queue.end();
            let _ = stream.shutdown(Shutdown::Both);
        });
        Ok(())
    }
}

/// Connect to `HOST:PORT`.
pub fn reach(address: &str) -> std::io::Result<TcpStream> {
    let mut last = std::io::Error::new(ErrorKind::NotFound, "no such host");
    for place in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&place, Duration::from_secs(2)) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::io::igtl::{Head, string};
    use std::io::Read;

    fn server() -> (Arc<Clients>, SocketAddr) {
        let clients = Arc::new(Clients::default());
        let address = clients.listen("127.0.0.1:0".parse().unwrap()).unwrap();
        (clients, address)
    }

    /// Wait, at most 10 s.
    fn until(what: &str, holds: impl Fn() -> bool) {
        let start = Instant::now();
        while !holds() {
            assert!(start.elapsed() < Duration::from_secs(10), "{what}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn count(clients: &Clients) -> usize {
        lock(&clients.list).len()
    }

    fn numbered(k: usize) -> Bundle {
        Arc::new(string(Head { device: "n", time: None }, &k.to_string()))
    }

    /// The number in the next message.
    fn next(stream: &mut TcpStream) -> usize {
        let found = read(stream, |_| true).unwrap().unwrap();
        std::str::from_utf8(&found.content[4..]).unwrap().parse().unwrap()
    }

    fn client(clients: &Clients, address: SocketAddr) -> TcpStream {
        let before = count(clients);
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        until("the client is known", || count(clients) == before + 1);
        stream
    }

    #[test]
    fn a_client_that_comes_and_goes_loses_the_frames_in_between_and_no_others() {
        let (clients, address) = server();
        let mut stays = client(&clients, address);
        let mut goes = client(&clients, address);
        let send = |k: usize, readers: &mut [&mut TcpStream]| {
            clients.send(&numbered(k));
            for reader in readers {
                assert_eq!(next(reader), k);
            }
        };
        (0..5).for_each(|k| send(k, &mut [&mut stays, &mut goes]));
        drop(goes);
        until("it is gone", || count(&clients) == 1);
        (5..9).for_each(|k| send(k, &mut [&mut stays]));
        let mut back = client(&clients, address);
        (9..12).for_each(|k| send(k, &mut [&mut stays, &mut back]));
        // The last ones are sent before the stream ends.
        (12..15).for_each(|k| clients.send(&numbered(k)));
        clients.end();
        assert_eq!((12..15).map(|_| next(&mut back)).collect::<Vec<_>>(), [12, 13, 14]);
        assert!(read(&mut back, |_| true).unwrap().is_none(), "a clean end");
        let news = clients.news().join("\n");
        assert!(news.contains("is gone: 5 frame(s) sent, 0 left out"), "{news}");
    }

    #[test]
    fn a_client_that_takes_nothing_neither_blocks_nor_fills_memory() {
        let (clients, address) = server();
        let slow = client(&clients, address);
        let mut quick = client(&clients, address);
        let big = Arc::new(string(Head { device: "n", time: None }, &"x".repeat(60_000)));
        let start = Instant::now();
        // 120 MB, far more than the system keeps for a connection.
        for _ in 0..2000 {
            clients.send(&big);
        }
        assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
        let waiting = Arc::strong_count(&big);
        assert!(waiting <= 2 * (WAITING + 1) + 1, "{waiting} copies are kept");
        // The other still gets what is sent now.
        let reader = std::thread::spawn(move || {
            while read(&mut quick, |_| true).unwrap().unwrap().content.len() > 100 {}
            quick
        });
        until("the rest is read", || lock(&clients.list)[1].is_empty());
        clients.send(&numbered(7));
        reader.join().unwrap();
        drop(slow);
    }

    #[test]
    fn what_is_no_message_closes_that_client_alone() {
        let (clients, address) = server();
        let mut good = client(&clients, address);
        let message = string(Head { device: "a", time: None }, "hello");
        let mut long = message.clone();
        long[42] = 0x80;
        for bad in [
            b"GET / HTTP/1.1\r\nHost: somebody.example\r\nAccept: everything\r\n\r\n".to_vec(),
            long,
        ] {
            let mut stream = client(&clients, address);
            stream.write_all(&bad).unwrap();
            until("it is closed", || count(&clients) == 1);
            assert!(clients.news().join("\n").contains("no message"));
            assert!(!matches!(stream.read(&mut [0; 1]), Ok(1..)));
        }
        // Half a message, a wrong checksum and an unknown type do not.
        let mut wrong = message.clone();
        wrong[50] ^= 1;
        let mut unknown = message.clone();
        unknown[2..5].copy_from_slice(b"XYZ");
        for fine in [&message[..30], &wrong[..], &unknown[..]] {
            let mut stream = client(&clients, address);
            stream.write_all(fine).unwrap();
            clients.send(&numbered(1));
            assert_eq!((next(&mut stream), next(&mut good)), (1, 1));
            drop(stream);
            until("it is gone", || count(&clients) == 1);
        }
    }

    #[test]
    fn the_ninth_is_refused_and_a_receiver_is_sought_until_it_is_there() {
        let (clients, address) = server();
        let all: Vec<TcpStream> = (0..MOST).map(|_| client(&clients, address)).collect();
        let mut ninth = TcpStream::connect(address).unwrap();
        ninth.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        assert_eq!(ninth.read(&mut [0; 1]).unwrap(), 0, "closed");
        assert!(clients.news().join("\n").contains("refused"));
        drop(all);
        // A port that nobody listens at until later.
        let place = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let sender = Arc::new(Clients::default());
        sender.connect(place.to_string());
        until("it is said", || !lock(&sender.news).is_empty());
        let receiver = TcpListener::bind(place).unwrap();
        let (mut stream, _) = receiver.accept().unwrap();
        until("it is known", || sender.any());
        sender.send(&numbered(3));
        assert_eq!(next(&mut stream), 3);
        drop(stream);
        let (mut stream, _) = receiver.accept().unwrap();
        until("it is known again", || sender.any());
        sender.send(&numbered(4));
        assert_eq!(next(&mut stream), 4);
    }
}
