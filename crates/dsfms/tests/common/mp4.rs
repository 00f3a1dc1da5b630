//! A small H.264 encoder (every macroblock uncompressed) and mp4 writer: videos for tests, of any
//! content, whose bytes a test can damage where it wants.

#![allow(dead_code, reason = "no test file needs all of it")]

/// One coded picture.
pub enum Coded<'a> {
    /// Encoded RGB, row by row, that needs no other picture.
    Key(&'a [[u8; 3]]),
    /// The picture before once more, predicted from it.
    Repeat,
}

/// A video and where its coded pictures lie in it.
pub struct Video {
    pub bytes: Vec<u8>,
    pub samples: Vec<std::ops::Range<usize>>,
}

/// Key pictures only.
pub fn video(size: [usize; 2], pictures: &[Vec<[u8; 3]>]) -> Video {
    let coded: Vec<Coded> = pictures.iter().map(|p| Coded::Key(p)).collect();
    encode(&[(size, coded)], &[])
}

/// Pictures of one or more sizes in a row; `shift` moves when each is shown, in pictures.
pub fn encode(parts: &[([usize; 2], Vec<Coded>)], shift: &[i32]) -> Video {
    let (mut bytes, mut samples) = (boxed(b"ftyp", &[b"isom\0\0\0\x01isom"]), Vec::new());
    bytes.extend([0, 0, 0, 0]);
    bytes.extend(b"mdat");
    let start = bytes.len() - 8;
    for (k, (size, pictures)) in parts.iter().enumerate() {
        let mut number = 0;
        for (i, picture) in pictures.iter().enumerate() {
            let from = bytes.len();
            if k > 0 && i == 0 {
                bytes.extend(unit(&sps(*size)));
                bytes.extend(unit(&pps()));
            }
            number = if matches!(picture, Coded::Key(_)) { 0 } else { number + 1 };
            bytes.extend(unit(&slice(*size, picture, number, samples.len())));
            samples.push(from..bytes.len());
        }
    }
    let length = (bytes.len() - start) as u32;
    bytes[start..start + 4].copy_from_slice(&length.to_be_bytes());
    let keys: Vec<u32> = (parts.iter().flat_map(|p| &p.1).zip(1..))
        .filter_map(|(p, n)| matches!(p, Coded::Key(_)).then_some(n))
        .collect();
    bytes.extend(moov(parts[0].0, &samples, &keys, shift));
    Video { bytes, samples }
}

/// A stream with start codes as the pictures of an mp4 whose description is that of a video of
/// `size`; a unit with a slice ends its picture.
pub fn of_annex_b(size: [usize; 2], stream: &[u8]) -> Vec<u8> {
    let mut starts: Vec<usize> =
        (3..=stream.len()).filter(|&k| stream[k - 3..k] == [0, 0, 1]).collect();
    starts.push(stream.len() + 3);
    let mut bytes = [boxed(b"ftyp", &[b"isom\0\0\0\x01isom"]), b"\0\0\0\0mdat".to_vec()].concat();
    let (start, mut samples) = (bytes.len() - 8, Vec::new());
    let mut from = bytes.len();
    for bounds in starts.windows(2) {
        let nal = &stream[bounds[0]..(bounds[1] - 3).max(bounds[0])];
        bytes.extend(unit(nal));
        if nal.first().is_some_and(|head| matches!(head & 31, 1 | 5)) {
            samples.push(from..bytes.len());
            from = bytes.len();
        }
    }
    if from < bytes.len() {
        samples.push(from..bytes.len());
    }
    let length = (bytes.len() - start) as u32;
    bytes[start..start + 4].copy_from_slice(&length.to_be_bytes());
    let keys: Vec<u32> = (1..=samples.len() as u32).collect();
    bytes.extend(moov(size, &samples, &keys, &[]));
    bytes
}

/// A key picture, where one is given, and `count` samples of one byte.
pub fn tiny_samples(size: [usize; 2], first: Option<&[[u8; 3]]>, count: usize) -> Vec<u8> {
    let mut bytes = [boxed(b"ftyp", &[b"isom\0\0\0\x01isom"]), b"\0\0\0\0mdat".to_vec()].concat();
    let (start, mut samples) = (bytes.len() - 8, Vec::new());
    if let Some(picture) = first {
        bytes.extend(unit(&slice(size, &Coded::Key(picture), 0, 0)));
        samples.push(start + 8..bytes.len());
    }
    samples.extend((bytes.len()..bytes.len() + count).map(|at| at..at + 1));
    bytes.resize(bytes.len() + count, 1);
    let length = (bytes.len() - start) as u32;
    bytes[start..start + 4].copy_from_slice(&length.to_be_bytes());
    let keys: Vec<u32> = (1..=samples.len() as u32).collect();
    bytes.extend(moov(size, &samples, &keys, &[]));
    bytes
}

/// The pictures of a video with start codes, and the sets that describe it before them.
pub fn annex_b(size: [usize; 2], video: &Video) -> Vec<u8> {
    let mut stream = Vec::new();
    let mut put = |nal: &[u8]| stream.extend([&[0, 0, 0, 1], nal].concat());
    put(&sps(size));
    put(&pps());
    for sample in &video.samples {
        let mut rest = &video.bytes[sample.clone()];
        while let Some((length, after)) = rest.split_first_chunk::<4>() {
            let (nal, after) = after.split_at(u32::from_be_bytes(*length) as usize);
            put(nal);
            rest = after;
        }
    }
    stream
}

/// Ticks of a picture; 25 pictures a second.
const TICKS: u32 = 40;

fn moov(
    size: [usize; 2],
    samples: &[std::ops::Range<usize>],
    keys: &[u32],
    shift: &[i32],
) -> Vec<u8> {
    let full = |kind: &[u8; 4], words: &[u32]| {
        let words: Vec<u8> = words.iter().flat_map(|w| w.to_be_bytes()).collect();
        boxed(kind, &[&[0; 4], &words])
    };
    let count = samples.len() as u32;
    let table = |kind, head: &[u32], rows: Vec<u32>| full(kind, &[head, &rows].concat());
    let sets = [&[1, 66, 0xC0, 40, 0xFF, 0xE1][..], &set(&sps(size)), &[1], &set(&pps())].concat();
    let mut entry = vec![0; 78];
    entry[24..28].copy_from_slice(&[
        (size[0] >> 8) as u8,
        size[0] as u8,
        (size[1] >> 8) as u8,
        size[1] as u8,
    ]);
    let avc1 = boxed(b"avc1", &[&entry, &boxed(b"avcC", &[&sets])]);
    let stsd = boxed(b"stsd", &[&[0; 4], &1u32.to_be_bytes(), &avc1]);
    let rows = shift.iter().flat_map(|s| [1, (s * TICKS as i32) as u32]).collect();
    let ctts = match shift {
        [] => Vec::new(),
        _ => table(b"ctts", &[shift.len() as u32], rows),
    };
    let stbl = boxed(
        b"stbl",
        &[
            &stsd,
            &full(b"stts", &[1, count, TICKS]),
            &ctts,
            &table(b"stss", &[keys.len() as u32], keys.to_vec()),
            &full(b"stsc", &[1, 1, 1, 1]),
            &table(b"stsz", &[0, count], samples.iter().map(|s| s.len() as u32).collect()),
            &table(b"stco", &[count], samples.iter().map(|s| s.start as u32).collect()),
        ],
    );
    let hdlr = boxed(b"hdlr", &[&[0; 8], b"vide", &[0; 13]]);
    let mdhd = full(b"mdhd", &[0, 0, 25 * TICKS, count * TICKS, 0]);
    let mdia = boxed(b"mdia", &[&mdhd, &hdlr, &boxed(b"minf", &[&stbl])]);
    let tkhd = full(b"tkhd", &[0, 0, 1, 0]);
    boxed(b"moov", &[&boxed(b"trak", &[&tkhd, &mdia])])
}

pub fn boxed(kind: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let content = parts.concat();
    [&(8 + content.len() as u32).to_be_bytes()[..], kind, &content].concat()
}

/// With its length in 16 bits.
fn set(nal: &[u8]) -> Vec<u8> {
    [&(nal.len() as u16).to_be_bytes()[..], nal].concat()
}

/// With its length in 32 bits.
fn unit(nal: &[u8]) -> Vec<u8> {
    [&(nal.len() as u32).to_be_bytes()[..], nal].concat()
}

#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    free: u32,
}

impl Bits {
    fn put(&mut self, value: u32, count: u32) -> &mut Self {
        for i in (0..count).rev() {
            if self.free == 0 {
                self.bytes.push(0);
                self.free = 8;
            }
            self.free -= 1;
            *self.bytes.last_mut().unwrap() |= ((value >> i & 1) as u8) << self.free;
        }
        self
    }

    /// Exp-Golomb.
    fn ue(&mut self, value: u32) -> &mut Self {
        let bits = 32 - (value + 1).leading_zeros();
        self.put(0, bits - 1).put(value + 1, bits)
    }

    fn align(&mut self) {
        self.free = 0;
    }

    /// The unit with its header, trailing bits and emulation prevention.
    fn nal(&mut self, header: u8) -> Vec<u8> {
        self.put(1, 1);
        let mut out = vec![header];
        let mut zeros = 0;
        for &b in &self.bytes {
            if zeros >= 2 && b <= 3 {
                out.push(3);
                zeros = 0;
            }
            zeros = if b == 0 { zeros + 1 } else { 0 };
            out.push(b);
        }
        out
    }
}

fn blocks(size: [usize; 2]) -> [usize; 2] {
    size.map(|n| n.div_ceil(16))
}

fn sps(size: [usize; 2]) -> Vec<u8> {
    let [w, h] = blocks(size);
    let mut bits = Bits::default();
    bits.put(66, 8).put(0xC0, 8).put(40, 8);
    // Eight bits of frame number, pictures shown as they are coded, one reference.
    bits.ue(0).ue(4).ue(2).ue(1).put(0, 1);
    bits.ue(w as u32 - 1).ue(h as u32 - 1).put(1, 1).put(1, 1);
    let crop = [(16 * w - size[0]) / 2, (16 * h - size[1]) / 2].map(|n| n as u32);
    bits.put(1, 1).ue(0).ue(crop[0]).ue(0).ue(crop[1]);
    bits.put(0, 1).nal(0x67)
}

fn pps() -> Vec<u8> {
    let mut bits = Bits::default();
    bits.ue(0).ue(0).put(0, 2).ue(0).ue(0).ue(0).put(0, 3).ue(0).ue(0).ue(0);
    bits.put(0b100, 3).nal(0x68)
}

fn slice(size: [usize; 2], picture: &Coded, number: u32, id: usize) -> Vec<u8> {
    let [w, h] = blocks(size);
    let mut bits = Bits::default();
    match picture {
        Coded::Repeat => {
            bits.ue(0).ue(5).ue(0).put(number, 8).put(0, 3).ue(0).ue(1);
            bits.ue((w * h) as u32).nal(0x41)
        }
        Coded::Key(rgb) => {
            bits.ue(0).ue(7).ue(0).put(0, 8).ue(id as u32 % 2).put(0, 2).ue(0).ue(1);
            for block in 0..w * h {
                bits.ue(25).align();
                samples(size, rgb, [16 * (block % w), 16 * (block / w)], &mut bits.bytes);
            }
            bits.nal(0x65)
        }
    }
}

/// Luma and chroma of a macroblock; beyond the border the last pixel goes on.
fn samples(size: [usize; 2], rgb: &[[u8; 3]], [x0, y0]: [usize; 2], out: &mut Vec<u8>) {
    let at =
        |x: usize, y: usize| rgb[y.min(size[1] - 1) * size[0] + x.min(size[0] - 1)].map(f64::from);
    let byte = |v: f64| v.round().clamp(0.0, 255.0) as u8;
    for i in 0..256 {
        let [r, g, b] = at(x0 + i % 16, y0 + i / 16);
        out.push(byte(16.0 + 219.0 / 255.0 * (0.299 * r + 0.587 * g + 0.114 * b)));
    }
    for row in [[-0.168_736, -0.331_264, 0.5], [0.5, -0.418_688, -0.081_312]] {
        for i in 0..64 {
            let [x, y] = [x0 + 2 * (i % 8), y0 + 2 * (i / 8)];
            let four = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            let sum: f64 = four.iter().flat_map(|p| p.iter().zip(row)).map(|(v, f)| v * f).sum();
            out.push(byte(128.0 + 224.0 / 255.0 * sum / 4.0));
        }
    }
}
