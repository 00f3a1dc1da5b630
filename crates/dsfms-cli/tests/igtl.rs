//! `dsfms track` and OpenIGTLink on the loopback: a client of our own, a server that sends damaged
//! messages, and pyigtl in every direction.

mod clip;

use clip::{FRAMES, SIZE, Text, assert_as_files, column, frame, track};
use dsfms::io::igtl::{HEADER, Head, ImagePlacement, Received, image as picture, read, string};
use dsfms::track::shapes::read_shapes;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Where it serves, and what it says besides until it ends.
fn address(child: &mut Child) -> (String, std::thread::JoinHandle<String>) {
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let line = lines.by_ref().map(Result::unwrap).find(|l| l.contains("served at")).unwrap();
    let rest = std::thread::spawn(move || lines.map(|l| l.unwrap() + "\n").collect());
    (line.rsplit(' ').next().unwrap().to_owned(), rest)
}

/// Numbers of the frames that were taken: where a machine is slow, not all.
fn rows(out: &Path) -> Vec<usize> {
    column(out, "frame").iter().map(|n| n.parse().unwrap()).collect()
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_be_bytes(*b)).collect()
}

/// Messages with one stamp, by kind.
fn bundles(messages: Vec<Received>) -> Vec<Vec<Received>> {
    let mut bundles: Vec<Vec<Received>> = Vec::new();
    for message in messages {
        match bundles.last_mut() {
            Some(last) if last[0].header.time == message.header.time => last.push(message),
            _ => bundles.push(vec![message]),
        }
    }
    bundles
}

#[test]
fn a_client_is_told_what_the_files_hold() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut child = track(&out, "frames", &["--igtl", "0", "--realtime", "--rate", "4"]);
    let (address, said) = address(&mut child);
    assert!(address.starts_with("127.0.0.1:"), "of this machine only: {address}");
    let mut stream = TcpStream::connect(&address).unwrap();
    // Others come at the same time: one that reads nothing, one that talks nonsense.
    let _mute = TcpStream::connect(&address).unwrap();
    let mut rude = TcpStream::connect(&address).unwrap();
    rude.write_all(&[0xFF; 4096]).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut messages = Vec::new();
    while let Some(message) = read(&mut stream, |_| true).unwrap() {
        messages.push(message);
    }
    child.wait().unwrap();
    let said = said.join().unwrap();
    assert!(said.contains("no message: header version 65535"), "{said}");
    let (shapes, status) = read_shapes(&out.join("vertices.npz")).unwrap();
    let (bundles, rows) = (bundles(messages), rows(&out));
    assert!(bundles.len() + 2 >= rows.len(), "{} of {} frames", bundles.len(), rows.len());
    for bundle in &bundles {
        let of = |kind: &str| bundle.iter().find(|m| m.header.kind == kind);
        let verdict = &of("STRING").unwrap().content[4..];
        let verdict: serde_json::Value = serde_json::from_slice(verdict).unwrap();
        let k = verdict["frame"].as_u64().unwrap() as usize;
        let row = rows.iter().position(|n| *n == k).unwrap();
        let code = of("STATUS").unwrap().content[1];
        assert_eq!(code, [1, 2, 4][usize::from(status[row])], "frame {k}");
        assert_eq!(of("IMAGE").unwrap().content[72..], *frame(k).rgb.as_flattened());
        let surface = &of("POLYDATA").unwrap().content;
        assert_eq!(of("TRANSFORM").is_some(), status[row] != 2);
        if status[row] == 2 {
            assert_eq!(surface[..4], [0; 4]);
            continue;
        }
        let sent = floats(&surface[40..40 + 12 * shapes[row].len()]);
        let known: Vec<f32> =
            shapes[row].iter().flat_map(|p| [p.x, p.y, p.z]).map(|c| c as f32).collect();
        assert_eq!(sent, known, "frame {k}");
        let pose = floats(&of("TRANSFORM").unwrap().content);
        let said = |i: usize| verdict["pose"][i % 3][i / 3].as_f64().unwrap() as f32;
        assert_eq!(pose, (0..12).map(said).collect::<Vec<_>>());
    }
}

/// What a server of pictures sends, `mend` and all.
fn message(device: &str, k: usize) -> Vec<u8> {
    let plane = ImagePlacement { axes: [[0.0; 3]; 3], centre: [0.0; 3] };
    picture(Head { device, time: None }, &frame(k), &plane)
}

#[test]
fn pictures_give_what_files_give_whatever_comes_between_them() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let source = format!("igtl://{}/Video", listener.local_addr().unwrap());
    let mut child = track(&out, &source, &[]);
    let mut stream = listener.accept().unwrap().0;
    for k in 0..4 {
        stream.write_all(&message("Video", k)).unwrap();
        stream.write_all(&message("Other", 11)).unwrap();
        stream.write_all(&string(Head { device: "Video", time: None }, "?")).unwrap();
        let mut unknown = message("Video", 11);
        unknown[2..7].copy_from_slice(b"CLOUD");
        stream.write_all(&unknown).unwrap();
    }
    // 4: a wrong checksum. 5: no picture that we read. 6: a message that breaks off.
    let mut wrong = message("Video", 11);
    *wrong.last_mut().unwrap() ^= 1;
    stream.write_all(&wrong).unwrap();
    let mut deep = message("Video", 11);
    deep[HEADER + 3] = 5;
    let crc = dsfms::io::igtl::crc64(&deep[HEADER..]);
    deep[50..58].copy_from_slice(&crc.to_be_bytes());
    stream.write_all(&deep).unwrap();
    let half = message("Video", 11);
    stream.write_all(&half[..half.len() / 2]).unwrap();
    drop(stream);
    // It comes again. 7: a length of 2^63.
    let mut stream = listener.accept().unwrap().0;
    (4..8).for_each(|k| stream.write_all(&message("Video", k)).unwrap());
    let mut long = message("Video", 11);
    long[42] = 0x80;
    stream.write_all(&long).unwrap();
    // It closes that connection and comes again.
    let mut rest = Vec::new();
    let _ = stream.read_to_end(&mut rest);
    assert!(rest.is_empty());
    let mut stream = listener.accept().unwrap().0;
    (8..FRAMES).for_each(|k| stream.write_all(&message("Video", k)).unwrap());
    drop((stream, listener));
    let said = child.said();
    let lost = [4, 5, 6, 11];
    let reasons = column(&out, "reasons");
    assert_eq!(reasons.len(), FRAMES + lost.len(), "{said}");
    let names = ["checksum", "type 5", "ends within a message", "at most"];
    for (row, name) in lost.iter().zip(names) {
        assert!(reasons[*row].contains(name), "{row}: {reasons:?}");
    }
    let (mut shapes, mut status) = read_shapes(&out.join("vertices.npz")).unwrap();
    for row in lost.iter().rev() {
        assert_eq!(status.remove(*row), 2);
        shapes.remove(*row);
    }
    assert_as_files(&shapes, &status);
}

#[test]
fn a_server_that_is_not_there_and_wrong_usage_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let place = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut child = track(&out, &format!("igtl://{place}/Video"), &[]);
    let said = child.said();
    assert!(said.contains("cannot be reached"), "{said}");
    assert_eq!(child.wait().unwrap().code(), Some(1));
    for (input, arguments, expected) in [
        ("igtl://nowhere", vec![], "HOST:PORT"),
        ("igtl://localhost:1/Video", vec!["frames"], "stands alone"),
        ("frames", vec!["--igtl", "no address"], "ADDR:PORT"),
        ("frames", vec!["--igtl-connect", "18944"], "HOST:PORT"),
    ] {
        let mut child = track(&out, input, &arguments);
        let said = child.said();
        assert!(said.contains(expected), "{expected}: {said}");
        assert_eq!(child.wait().unwrap().code(), Some(64), "{said}");
    }
    // A port that somebody else has.
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let mut child = track(&out, "frames", &["--igtl", &port]);
    let said = child.said();
    assert!(said.contains("--igtl 127.0.0.1") && said.contains("in use"), "{said}");
}

/// Python with pyigtl: `DSFMS_PYTHON`, else `python3`; `None` where it is missing, which is said.
fn python(arguments: &[&str]) -> Option<Command> {
    let python = std::env::var("DSFMS_PYTHON").unwrap_or_else(|_| "python3".into());
    let there = Command::new(&python).args(["-c", "import pyigtl"]).output();
    if !there.is_ok_and(|found| found.status.success()) {
        eprintln!(
            "!! SKIPPED  {python} has no pyigtl (pip install pyigtl; DSFMS_PYTHON names another): OpenIGTLink is \
             NOT tested against it"
        );
        return None;
    }
    let mut command = Command::new(python);
    command.arg(PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/igtl_peer.py"));
    command.args(arguments).stdout(Stdio::piped());
    Some(command)
}

/// The first line that a peer says.
fn first_line(child: &mut Child) -> (String, BufReader<std::process::ChildStdout>) {
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    (line.trim().to_owned(), lines)
}

#[test]
fn pictures_of_pyigtl_give_what_files_give() {
    let folder = tempfile::tempdir().unwrap();
    let (raw, out) = (folder.path().join("raw"), folder.path().join("out"));
    let Some(mut python) = python(&["serve", raw.to_str().unwrap()]) else { return };
    std::fs::create_dir(&raw).unwrap();
    for k in 0..FRAMES {
        let path = raw.join(format!("{k:02}.{}x{}", SIZE[0], SIZE[1]));
        std::fs::write(path, frame(k).rgb.as_flattened()).unwrap();
    }
    let mut peer = python.spawn().unwrap();
    let (port, _lines) = first_line(&mut peer);
    let mut child = track(&out, &format!("igtl://127.0.0.1:{port}/Video"), &[]);
    let said = child.said();
    peer.wait().unwrap();
    let (shapes, status) = read_shapes(&out.join("vertices.npz")).unwrap();
    assert_eq!(status.len(), FRAMES, "{said}");
    assert_as_files(&shapes, &status);
}

/// What pyigtl understood of a run against what its files hold.
fn assert_understood(found: &str, out: &Path) {
    let found: Vec<serde_json::Value> = serde_json::from_str(found).unwrap();
    let (status, rows) = (column(out, "status"), rows(out));
    let mut checked = [0; 2];
    for verdict in found.iter().filter(|m| m["type"] == "STRING") {
        assert_eq!(verdict["device"], "Verdict");
        let line: serde_json::Value =
            serde_json::from_str(verdict["text"].as_str().unwrap()).unwrap();
        let k = line["frame"].as_u64().unwrap() as usize;
        let row = rows.iter().position(|n| *n == k).unwrap();
        assert_eq!(line["status"].as_str().unwrap(), status[row]);
        let beside =
            |kind: &str| found.iter().find(|m| m["type"] == kind && m["time"] == verdict["time"]);
        if let Some(pose) = beside("TRANSFORM") {
            assert_eq!(pose["device"], "TemplateToCamera");
            for (i, j) in (0..3).flat_map(|i| (0..4).map(move |j| (i, j))) {
                let [sent, known] = [&pose["matrix"][i][j], &line["pose"][i][j]];
                assert_eq!(sent.as_f64().unwrap() as f32, known.as_f64().unwrap() as f32);
            }
            checked[0] += 1;
        }
        if let Some(image) = beside("IMAGE") {
            assert_eq!(image["shape"], serde_json::json!([1, SIZE[1], SIZE[0], 3]));
            let sum: u64 = frame(k).rgb.as_flattened().iter().map(|v| u64::from(*v)).sum();
            assert_eq!(image["sum"].as_u64(), Some(sum), "frame {k}");
            checked[1] += 1;
        }
    }
    let with_surface = status.iter().filter(|s| *s != "lost").count();
    let enough = checked[0] > 0 && 2 * checked[0] >= with_surface && 2 * checked[1] >= rows.len();
    assert!(enough, "{checked:?} of {status:?}");
}

#[test]
fn a_client_of_pyigtl_understands_what_is_sent() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    if python(&[]).is_none() {
        return;
    }
    let mut child = track(&out, "frames", &["--igtl", "0", "--realtime", "--rate", "2"]);
    let (address, said) = address(&mut child);
    let peer = python(&["listen", &address]).unwrap().output().unwrap();
    child.wait().unwrap();
    said.join().unwrap();
    assert_understood(&String::from_utf8_lossy(&peer.stdout), &out);
}

#[test]
fn a_server_of_pyigtl_is_sent_to() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let Some(mut python) = python(&["receive"]) else { return };
    let mut peer = python.spawn().unwrap();
    let (port, mut lines) = first_line(&mut peer);
    let place = format!("127.0.0.1:{port}");
    let mut child = track(&out, "frames", &["--igtl-connect", &place, "--realtime", "--rate", "2"]);
    child.said();
    let mut found = String::new();
    lines.read_to_string(&mut found).unwrap();
    peer.wait().unwrap();
    assert_understood(&found, &out);
}
