//! Messages that we send. Numbers are written highest byte first.

use super::header::{Head, message, put_text};
use crate::geometry::{Isometry, Point3};
use crate::image::Frame;

/// Codes of STATUS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum StatusCode {
    /// All is well.
    Ok = 1,
    /// Something is wrong that has no code of its own.
    UnknownError = 2,
    /// What is sought is not there.
    NotFound = 4,
}

/// TRANSFORM: three columns of the rotation, then the translation.
pub fn transform(head: Head, isometry: &Isometry) -> Vec<u8> {
    let matrix = isometry.to_homogeneous();
    message("TRANSFORM", head, |out| {
        for column in 0..4 {
            (0..3).for_each(|row| put(out, matrix[(row, column)] as f32));
        }
    })
}

/// STATUS: code, number and name of our own, and a text that ends with a zero byte.
pub fn status(head: Head, code: StatusCode, own: i64, name: &str, text: &str) -> Vec<u8> {
    message("STATUS", head, |out| {
        out.extend((code as u16).to_be_bytes());
        out.extend(own.to_be_bytes());
        put_text(out, name, 20);
        out.extend(text.bytes().filter(|b| *b != 0));
        out.push(0);
    })
}

/// STRING: UTF-8 of at most 65,535 bytes; what goes beyond is cut off.
pub fn string(head: Head, text: &str) -> Vec<u8> {
    // Numbers of character sets (IANA).
    const ASCII: u16 = 3;
    const UTF_8: u16 = 106;
    let end = (0..=text.len().min(usize::from(u16::MAX))).rev().find(|k| text.is_char_boundary(*k));
    let text = &text[..end.unwrap_or(0)];
    message("STRING", head, |out| {
        out.extend(if text.is_ascii() { ASCII } else { UTF_8 }.to_be_bytes());
        out.extend((text.len() as u16).to_be_bytes());
        out.extend(text.bytes());
    })
}

/// POLYDATA: a surface of triangles, each vertex with numbers under names (`(name, a number per
/// vertex)`). No points at all is a valid message: what the receiver shows vanishes.
///
/// Topology is in every message, since receivers (3D Slicer) build a new surface of each.
pub fn surface(
    head: Head,
    points: &[Point3],
    faces: &[[u32; 3]],
    scalars: &[(&str, Vec<f32>)],
) -> Vec<u8> {
    message("POLYDATA", head, |out| {
        let (points_n, faces_n) = (points.len() as u32, faces.len() as u32);
        // Points; then number and bytes of vertices, lines, polygons and strips; attributes.
        let counts = [points_n, 0, 0, 0, 0, faces_n, 16 * faces_n, 0, 0, scalars.len() as u32];
        out.reserve(12 * points.len() + 16 * faces.len() + 64);
        counts.iter().for_each(|n| out.extend(n.to_be_bytes()));
        for point in points {
            point.iter().for_each(|c| put(out, *c as f32));
        }
        for face in faces {
            [3].iter().chain(face).for_each(|v| out.extend(v.to_be_bytes()));
        }
        for (_, values) in scalars {
            // A scalar of the points, of one component.
            out.extend([0, 1]);
            out.extend((values.len() as u32).to_be_bytes());
        }
        let names = out.len();
        for (name, _) in scalars {
            out.extend(name.bytes());
            out.push(0);
        }
        if !(out.len() - names).is_multiple_of(2) {
            out.push(0);
        }
        scalars.iter().flat_map(|s| &s.1).for_each(|v| put(out, *v));
    })
}

/// Where a picture lies in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImagePlacement {
    /// From a pixel to the next in its row, to the next in its column, and across the picture.
    pub axes: [[f32; 3]; 3],
    /// Centre of the picture.
    pub centre: [f32; 3],
}

/// IMAGE: RGB of 8 bits, row by row from the top. Sides are at most 65,535 px.
pub fn image(head: Head, frame: &Frame, plane: &ImagePlacement) -> Vec<u8> {
    message("IMAGE", head, |out| {
        // Version 1, three components of unsigned bytes, little endian, axes taken as they are.
        out.reserve(72 + 3 * frame.rgb.len());
        out.extend([0, 1, 3, 3, 2, 1]);
        let size = [frame.size[0] as u16, frame.size[1] as u16, 1];
        size.iter().for_each(|n| out.extend(n.to_be_bytes()));
        plane.axes.iter().chain([&plane.centre]).flatten().for_each(|v| put(out, *v));
        // The part that is sent is the whole.
        [0; 3].iter().chain(&size).for_each(|n| out.extend(n.to_be_bytes()));
        out.extend_from_slice(frame.rgb.as_flattened());
    })
}

fn put(out: &mut Vec<u8>, value: f32) {
    out.extend(value.to_be_bytes());
}
