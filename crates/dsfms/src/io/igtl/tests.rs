//! Bytes worked out by hand from the protocol, checksums of the conformance data of the reference
//! implementation and of `pyigtl`, and messages that are damaged.

use super::*;
use crate::geometry::{Isometry, Point3, Vector3};
use crate::image::Frame;
use std::time::{Duration, UNIX_EPOCH};

/// Half a second after a second of 2023, as a stamp `65 53 F1 00 . 80 00 00 00`.
fn head(device: &str) -> Head<'_> {
    Head { device, time: Some(UNIX_EPOCH + Duration::new(1_700_000_000, 500_000_000)) }
}

/// A header by hand.
fn bytes(kind: &str, device: &str, crc: u64, body: &[u8]) -> Vec<u8> {
    let mut out = vec![0, 1];
    out.extend(format!("{kind:\0<12}{device:\0<20}").bytes());
    out.extend([0x65, 0x53, 0xF1, 0x00, 0x80, 0, 0, 0]);
    out.extend([0, 0, 0, 0, 0, 0, 0, body.len() as u8]);
    out.extend(crc.to_be_bytes());
    out.extend(body);
    out
}

/// 1, 2, 3 and a quarter turn about z.
fn quarter() -> Isometry {
    let axis = Vector3::z() * std::f64::consts::FRAC_PI_2;
    Isometry::new(Vector3::new(1.0, 2.0, 3.0), axis)
}

#[test]
fn a_transform_is_three_columns_and_a_translation() {
    let found = transform(head("TemplateToCamera"), &quarter());
    let body = &found[HEADER..];
    let numbers: Vec<f32> =
        body.as_chunks::<4>().0.iter().map(|b| f32::from_be_bytes(*b)).collect();
    let known = [0., 1., 0., -1., 0., 0., 0., 0., 1., 1., 2., 3.];
    assert!(
        numbers.iter().zip(known).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-6),
        "{numbers:?}"
    );
    assert_eq!(found, bytes("TRANSFORM", "TemplateToCamera", crc64(body), body));
    // Of the identity every byte is known; the checksum is pyigtl's.
    let body: Vec<u8> = [1f32, 0., 0., 0., 1., 0., 0., 0., 1., 4., 5., 6.]
        .iter()
        .flat_map(|v| v.to_be_bytes())
        .collect();
    let moved = transform(head("a"), &Isometry::translation(4.0, 5.0, 6.0));
    assert_eq!(moved, bytes("TRANSFORM", "a", 0x9DCF_2CDC_4330_373A, &body));
}

#[test]
fn a_status_has_the_checksum_of_the_reference_implementation() {
    // STATUS 15, own code 10, of its conformance data.
    let mut known = vec![0, 15, 0, 0, 0, 0, 0, 0, 0, 10];
    known.extend(b"ACTUATOR_DISABLED\0\0\0Actuator A is disabled.\0");
    assert_eq!(crc64(&known), 0x98EE_43EE_D8E4_31CF);
    let found = status(
        head("dsfms"),
        StatusCode::NotFound,
        10,
        "ACTUATOR_DISABLED",
        "Actuator A is disabled.",
    );
    known[1] = 4;
    assert_eq!(found, bytes("STATUS", "dsfms", crc64(&known), &known));
}

#[test]
fn a_string_says_its_character_set_and_length() {
    let known = bytes("STRING", "Verdict", 0xB137_5D85_5C48_397C, b"\0\x03\0\x02ok");
    assert_eq!(string(head("Verdict"), "ok"), known);
    assert_eq!(string(head("Verdict"), "µ")[HEADER..], *b"\0\x6A\0\x02\xC2\xB5");
    // Cut between characters.
    let long = string(head("Verdict"), &format!("a{}", "µ".repeat(40_000)));
    assert_eq!(long.len(), HEADER + 4 + 65_535);
    assert!(std::str::from_utf8(&long[HEADER + 4..]).is_ok());
}

fn triangle() -> Vec<Point3> {
    [[0., 0., 1.], [1., 0., 1.], [0., 1., 1.]].map(Point3::from).to_vec()
}

#[test]
fn a_surface_is_as_pyigtl_writes_it() {
    let mut body = Vec::new();
    for count in [3u32, 0, 0, 0, 0, 1, 16, 0, 0, 0] {
        body.extend(count.to_be_bytes());
    }
    for number in [0f32, 0., 1., 1., 0., 1., 0., 1., 1.] {
        body.extend(number.to_be_bytes());
    }
    for number in [3u32, 0, 1, 2] {
        body.extend(number.to_be_bytes());
    }
    let found = surface(head("Organ"), &triangle(), &[[0, 1, 2]], &[]);
    assert_eq!(found, bytes("POLYDATA", "Organ", 0x79C4_276E_FBD9_F38D, &body));
}

#[test]
fn numbers_of_vertices_follow_under_their_names() {
    let plain = surface(head("Organ"), &triangle(), &[[0, 1, 2]], &[]);
    let scalars = [("seen", vec![1.0, 0.0, 1.0]), ("mm", vec![0.5, 0.25, 2.0])];
    let found = surface(head("Organ"), &triangle(), &[[0, 1, 2]], &scalars);
    let behind = &found[plain.len()..];
    let mut known = vec![0, 1, 0, 0, 0, 3, 0, 1, 0, 0, 0, 3];
    known.extend(b"seen\0mm\0");
    for number in [1f32, 0., 1., 0.5, 0.25, 2.] {
        known.extend(number.to_be_bytes());
    }
    assert_eq!(behind, known);
    assert_eq!(found[HEADER + 36..HEADER + 40], [0, 0, 0, 2]);
    // Names of an odd length together get a byte more.
    let odd = surface(head("Organ"), &triangle(), &[[0, 1, 2]], &[("ab", vec![0.0; 3])]);
    assert_eq!(odd.len(), plain.len() + 6 + 4 + 12);
    let none = surface(head("Organ"), &[], &[], &[]);
    assert_eq!(none[HEADER..], [0; 40]);
}

fn frame() -> Frame {
    let rgb = (0..6u8).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    Frame { name: "a".into(), size: [3, 2], rgb }
}

#[test]
fn an_image_is_as_pyigtl_writes_it_and_comes_back() {
    let axes = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0]];
    let found =
        image(head("Laparoscope"), &frame(), &ImagePlacement { axes, centre: [-0.5, -1.75, 10.0] });
    let mut body = vec![0, 1, 3, 3, 2, 1, 0, 3, 0, 2, 0, 1];
    for number in [0.5f32, 0., 0., 0., 0.5, 0., 0., 0., 1., -0.5, -1.75, 10.] {
        body.extend(number.to_be_bytes());
    }
    body.extend([0, 0, 0, 0, 0, 0, 0, 3, 0, 2, 0, 1]);
    body.extend(0..18u8);
    assert_eq!(found, bytes("IMAGE", "Laparoscope", 0x2535_908A_D903_50CA, &body));
    let read = read(&mut found.as_slice(), |_| true).unwrap().unwrap();
    assert_eq!(picture(&read.content).unwrap(), (frame().size, frame().rgb));
    // Grey of some senders: 1 x width x height; and with a channel of opacity.
    let mut grey = body[..72].to_vec();
    grey[2] = 1;
    for at in [6, 66] {
        grey[at..at + 6].copy_from_slice(&[0, 1, 0, 3, 0, 2]);
    }
    grey.extend(0..6u8);
    let (size, rgb) = picture(&grey).unwrap();
    assert_eq!((size, rgb[5]), ([3, 2], [5; 3]));
    let mut rgba = body[..72].to_vec();
    rgba[2] = 4;
    rgba.extend(0..24u8);
    assert_eq!(picture(&rgba).unwrap().1[1], [4, 5, 6]);
}

#[test]
fn pictures_that_are_none_are_named() {
    let good =
        &image(head("a"), &frame(), &ImagePlacement { axes: [[0.0; 3]; 3], centre: [0.0; 3] })
            [HEADER..];
    assert!(picture(good).is_ok());
    let changed = |at: usize, value: u8| {
        let mut bytes = good.to_vec();
        bytes[at] = value;
        picture(&bytes).unwrap_err().to_string()
    };
    assert!(changed(3, 5).contains("type 5"));
    assert!(changed(2, 2).contains("2 component"));
    assert!(changed(61, 1).contains("part of"));
    assert!(changed(71, 2).contains("part of"));
    assert!(changed(6, 0xFF).contains("part of"));
    let mut volume = good.to_vec();
    (volume[11], volume[71]) = (2, 2);
    assert!(picture(&volume).unwrap_err().to_string().contains("two sides"));
    assert!(picture(&good[..good.len() - 1]).unwrap_err().to_string().contains("17 bytes"));
    assert!(picture(&good[..71]).is_err() && picture(&[]).is_err());
    let mut empty = good[..72].to_vec();
    for at in [6, 66] {
        empty[at..at + 4].fill(0);
    }
    assert!(picture(&empty).is_err(), "no pixels");
}

/// `hello` with two pieces of metadata, as pyigtl writes it in version 3.
const EXTENDED: &str = "0002535452494e470000000000004e6f7465000000000000000000000000000000006553f10080000000\
                        0000000000000032aa3a7ecf0beb92a0000c00120000000b000000070003000568656c6c6f000200030003000000\
                        0500020003000000016b657976616c75656b3276";

#[test]
fn a_stream_of_version_three_goes_on_behind_what_is_not_wanted() {
    let hex = EXTENDED.as_bytes().as_chunks::<2>().0;
    let extended: Vec<u8> = hex
        .iter()
        .map(|h| u8::from_str_radix(std::str::from_utf8(h).unwrap(), 16).unwrap())
        .collect();
    let mut stream = transform(head("a"), &quarter());
    stream.extend(bytes("NOSUCHTYPE", "b", 0, b"anything"));
    stream.extend(&extended);
    stream.extend(string(head("c"), "after"));
    let mut stream = stream.as_slice();
    let mut next = || read(&mut stream, |h| h.kind == "STRING").unwrap();
    let found = next().unwrap();
    assert_eq!((found.header.device.as_str(), found.header.version), ("Note", 2));
    assert_eq!(found.content, b"\0\x03\0\x05hello");
    assert_eq!(&next().unwrap().content[4..], b"after");
    assert!(next().is_none());
    // Sizes of the extension that do not fit.
    for (at, value) in [(0, 0xFF), (1, 11), (2, 0xFF), (4, 0xFF), (7, 0xFF)] {
        let mut body = extended[HEADER..].to_vec();
        body[at] = value;
        let mut bytes = bytes("STRING", "d", crc64(&body), &body);
        bytes[1] = 2;
        let error = read(&mut bytes.as_slice(), |_| true).unwrap_err();
        assert!(!error.fatal() && error.to_string().contains("extended header"), "{at}: {error}");
    }
}

#[test]
fn damage_is_named_and_only_what_hides_the_next_message_ends_the_stream() {
    let good = string(head("a"), "good");
    let mut wrong = good.clone();
    *wrong.last_mut().unwrap() ^= 1;
    let stream = [wrong, good.clone()].concat();
    let mut stream = stream.as_slice();
    let error = read(&mut stream, |_| true).unwrap_err();
    assert!(matches!(error, IgtlError::Crc { .. }) && !error.fatal(), "{error}");
    assert_eq!(read(&mut stream, |_| true).unwrap().unwrap().content[4..], *b"good");
    let mut long = good.clone();
    long[42] = 0x80;
    let error = read(&mut long.as_slice(), |_| true).unwrap_err();
    assert!(matches!(error, IgtlError::TooLong(n) if n == (1 << 63) + 8) && error.fatal());
    assert!(matches!(read(&mut long.as_slice(), |_| false), Err(IgtlError::TooLong(_))));
    // The largest that is read: nothing is set aside for what does not come.
    let mut lies = good.clone();
    lies[42..50].copy_from_slice(&MOST_BODY.to_be_bytes());
    let error = read(&mut lies.as_slice(), |_| true).unwrap_err();
    assert!(matches!(error, IgtlError::Half { read: 8, of: MOST_BODY }) && error.fatal());
    for end in 1..good.len() {
        for wanted in [true, false] {
            let error = read(&mut &good[..end], |_| wanted).unwrap_err();
            assert!(matches!(error, IgtlError::Half { .. }) && error.fatal(), "{end}");
        }
    }
    let error = read(&mut [0xFF; 100].as_slice(), |_| true).unwrap_err();
    assert!(matches!(error, IgtlError::Version(0xFFFF)) && error.fatal());
}
