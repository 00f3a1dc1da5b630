//! Values as text inside the page: base64, pictures as data URIs, numbers in 16 bits.

use dsfms::geometry::{Point2, Point3};
use dsfms::image::{ColorImage, Frame};
pub use dsfms::io::base64::base64;
use image::{ImageEncoder, RgbImage};
use serde::Serialize;

/// Longest side of an embedded photograph, px.
const LONGEST_SIDE: u32 = 960;
const JPEG_QUALITY: u8 = 82;
/// The largest code; one more stands for "no value".
const CODES: f64 = 65534.0;

/// Points in 16 bits a coordinate: `origin + step * code`.
#[derive(Clone, Debug, Serialize)]
pub struct Cloud {
    origin: [f64; 3],
    step: f64,
    codes: String,
}

impl Cloud {
    /// Pack points; the error is at most half of 1/65534 of their extent.
    pub fn of(points: &[Point3]) -> Self {
        let fold = |f: fn(f64, f64) -> f64, start: f64| {
            [0, 1, 2].map(|c| points.iter().map(|p| p[c]).fold(start, f))
        };
        let low = fold(f64::min, f64::INFINITY);
        let high = fold(f64::max, f64::NEG_INFINITY);
        let extent = (0..3).map(|c| high[c] - low[c]).fold(0.0, f64::max);
        let step = if extent > 0.0 { extent / CODES } else { 1.0 };
        let code = |(p, c): (&Point3, usize)| ((p[c] - low[c]) / step).round() as u16;
        let codes = points.iter().flat_map(|p| (0..3).map(move |c| (p, c))).map(code);
        Self { origin: low.map(|v| if v.is_finite() { v } else { 0.0 }), step, codes: words(codes) }
    }
}

/// One number per item in 16 bits: `low + step * code`.
#[derive(Clone, Debug, Serialize)]
pub struct Numbers {
    low: f64,
    step: f64,
    codes: String,
}

impl Numbers {
    /// Pack numbers; what is not finite has no value.
    pub fn of(values: &[f64]) -> Self {
        let finite = || values.iter().copied().filter(|v| v.is_finite());
        let low = finite().fold(f64::INFINITY, f64::min);
        let high = finite().fold(f64::NEG_INFINITY, f64::max);
        let low = if low.is_finite() { low } else { 0.0 };
        let step = if high > low { (high - low) / CODES } else { 1.0 };
        let code =
            |&v: &f64| if v.is_finite() { ((v - low) / step).round() as u16 } else { u16::MAX };
        Self { low, step, codes: words(values.iter().map(code)) }
    }
}

/// Pixels in 16 bits a coordinate: from one image size before the image to one after it; codes of
/// 65535 where there is none.
pub fn pixels(size: [usize; 2], pixels: &[Option<Point2>]) -> String {
    let code = |p: &Option<Point2>| {
        [0, 1].map(|c| {
            let n = size[c] as f64;
            let inside = p.filter(|p| (0..2).all(|c| (p[c] / size[c] as f64 - 0.5).abs() < 1.5));
            inside.map_or(u16::MAX, |p| ((p[c] + n) / (3.0 * n) * CODES).round() as u16)
        })
    };
    words(pixels.iter().flat_map(code))
}

/// Little-endian 16 bits in base64.
pub fn words(values: impl Iterator<Item = u16>) -> String {
    base64(&values.flat_map(u16::to_le_bytes).collect::<Vec<_>>())
}

/// Faces as little-endian 32 bits in base64.
pub fn faces(faces: &[[u32; 3]]) -> String {
    base64(&faces.iter().flatten().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
}

/// One byte per flag in base64.
pub fn flags(values: &[bool]) -> String {
    base64(&values.iter().map(|&v| u8::from(v)).collect::<Vec<_>>())
}

/// A frame as a data URI, made smaller where it is large.
pub fn photograph(frame: &Frame) -> anyhow::Result<String> {
    jpeg(&filtered(frame, LONGEST_SIDE))
}

/// A frame as a data URI, no side longer than `side` px, for pictures of a running report: means of
/// blocks of pixels where these make up the frame, which cost less than a filter.
pub fn thumbnail(frame: &Frame, side: u32) -> anyhow::Result<String> {
    jpeg(&reduced(frame, side))
}

fn reduced(frame: &Frame, side: u32) -> RgbImage {
    let longest = frame.size[0].max(frame.size[1]);
    let (side_px, by) = (side as usize, longest / side as usize);
    let whole = by > 1 && by * side_px == longest && frame.size.iter().all(|n| n % by == 0);
    if whole { block_means(frame, by) } else { filtered(frame, side) }
}

/// The frame, by a filter where a side is longer than `side` px.
fn filtered(frame: &Frame, side: u32) -> RgbImage {
    let picture = crate::draw::picture(frame);
    let (w, h) = picture.dimensions();
    let longest = w.max(h);
    if longest <= side {
        return picture;
    }
    let scaled = |n: u32| (n * side / longest).max(1);
    let filter = image::imageops::FilterType::Triangle;
    image::imageops::resize(&picture, scaled(w), scaled(h), filter)
}

/// Means of blocks of `by` times `by` pixels, which divides both sides of the frame.
fn block_means(frame: &Frame, by: usize) -> RgbImage {
    let [w, h] = frame.size.map(|n| n / by);
    let count = (by * by) as u32;
    let mut bytes = Vec::with_capacity(3 * w * h);
    let mut sums = vec![[0_u32; 3]; w];
    for rows in frame.rgb.chunks_exact(by * frame.size[0]) {
        sums.fill([0; 3]);
        for row in rows.chunks_exact(frame.size[0]) {
            for (sum, block) in sums.iter_mut().zip(row.chunks_exact(by)) {
                for pixel in block {
                    (0..3).for_each(|c| sum[c] += u32::from(pixel[c]));
                }
            }
        }
        bytes.extend(sums.iter().flatten().map(|sum| ((sum + count / 2) / count) as u8));
    }
    RgbImage::from_raw(w as u32, h as u32, bytes).expect("three bytes for every block")
}

/// A picture as a data URI.
pub fn jpeg(picture: &RgbImage) -> anyhow::Result<String> {
    let bytes = jpeg_bytes(picture, JPEG_QUALITY)?;
    Ok(format!("data:image/jpeg;base64,{}", base64(&bytes)))
}

/// The bytes of a JPEG file; `quality` from 1 to 100.
pub fn jpeg_bytes(picture: &RgbImage, quality: u8) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let (w, h) = picture.dimensions();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality).write_image(
        picture,
        w,
        h,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

/// Linear light as an sRGB picture, its brightest hundredth at white.
pub fn displayed(linear: &ColorImage) -> RgbImage {
    let mut peaks: Vec<f32> =
        linear.data.iter().map(|p| p[0].max(p[1]).max(p[2])).filter(|&v| v > 0.0).collect();
    peaks.sort_by(f32::total_cmp);
    let white = peaks.get(peaks.len() * 99 / 100).copied().unwrap_or(1.0);
    let encode = |v: f32| {
        let v = (v / white).clamp(0.0, 1.0);
        let e = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (255.0 * e).round() as u8
    };
    let [w, h] = linear.size;
    RgbImage::from_fn(w as u32, h as u32, |x, y| {
        image::Rgb(linear.data[y as usize * w + x as usize].map(encode))
    })
}

/// Text that cannot be taken for markup.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_break_the_page() {
        assert_eq!(escape("<a href=\"x\">&"), "&lt;a href=&quot;x&quot;&gt;&amp;");
    }

    /// Red counts the pixels.
    fn counted([w, h]: [usize; 2]) -> Frame {
        let rgb = (0..w * h).map(|i| [i as u8, 100, (i % w) as u8]).collect();
        Frame { name: "f".into(), size: [w, h], rgb }
    }

    #[test]
    fn a_block_is_the_mean_of_its_pixels() {
        let small = reduced(&counted([6, 4]), 3);
        assert_eq!(small.dimensions(), (3, 2));
        // Of 0, 1, 6, 7 and of 16, 17, 22, 23.
        assert_eq!((small.get_pixel(0, 0).0, small.get_pixel(2, 1).0), ([4, 100, 1], [20, 100, 5]));
    }

    #[test]
    fn a_frame_that_blocks_do_not_make_up_keeps_its_longest_side() {
        for (size, side, expected) in
            [([720, 576], 640, (640, 512)), ([8, 3], 4, (4, 1)), ([5, 4], 5, (5, 4))]
        {
            assert_eq!(reduced(&counted(size), side).dimensions(), expected);
        }
    }

    #[test]
    fn a_cloud_keeps_its_corners() {
        let points = [Point3::new(-1.0, 2.0, 3.0), Point3::new(9.0, 2.0, 4.0)];
        let cloud = Cloud::of(&points);
        assert_eq!(cloud.origin, [-1.0, 2.0, 3.0]);
        assert!((cloud.step * CODES - 10.0).abs() < 1e-12);
        // Codes 0, 0, 0, 65534, 0, 6553.
        assert_eq!(cloud.codes, base64(&[0, 0, 0, 0, 0, 0, 0xfe, 0xff, 0, 0, 0x99, 0x19]));
        assert_eq!(Cloud::of(&[]).step, 1.0);
    }

    #[test]
    fn numbers_without_a_value_are_told_apart() {
        let n = Numbers::of(&[1.0, f64::NAN, 3.0]);
        assert_eq!(n.codes, base64(&[0, 0, 0xff, 0xff, 0xfe, 0xff]));
    }
}
