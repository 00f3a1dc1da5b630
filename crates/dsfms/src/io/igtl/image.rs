//! IMAGE, as video comes in.

use super::IgtlError;

/// Bytes before the pixels.
const HEAD: usize = 72;

/// Size and pixels of the content of an IMAGE message: one picture of 8 bits a channel, grey, RGB
/// or RGBA, its first row on top. Axes of one pixel are left out: grey pictures of some senders are
/// 1 x width x height.
///
/// # Errors
/// Other numbers or channels, a volume, part of a picture, or pixels that are missing or too many.
pub fn picture(content: &[u8]) -> Result<([usize; 2], Vec<[u8; 3]>), IgtlError> {
    let wrong = |reason: String| Err(IgtlError::Content(reason));
    let Some((head, pixels)) = content.split_at_checked(HEAD) else {
        return wrong(format!("an IMAGE of {} bytes has no room for its head", content.len()));
    };
    let short = |at: usize| usize::from(u16::from_be_bytes([head[at], head[at + 1]]));
    let [components, scalar] = [head[2], head[3]];
    if scalar != 3 || !matches!(components, 1 | 3 | 4) {
        return wrong(format!(
            "an IMAGE of {components} component(s) of type {scalar}; 1, 3 or 4 of type 3 (unsigned bytes) are expected"
        ));
    }
    let size = [short(6), short(8), short(10)];
    if [60, 62, 64].map(short) != [0; 3] || [66, 68, 70].map(short) != size {
        return wrong("part of an IMAGE; whole pictures are expected".into());
    }
    let long: Vec<usize> = size.into_iter().filter(|n| *n != 1).collect();
    let &[w, h] = long.as_slice() else {
        return wrong(format!("an IMAGE of {size:?}; a picture with two sides is expected"));
    };
    let (channels, count) = (usize::from(components), w * h);
    if count == 0 || pixels.len() != count * channels {
        let bytes = pixels.len();
        return wrong(format!(
            "an IMAGE of {w} x {h} px and {channels} channel(s) has {bytes} bytes"
        ));
    }
    let rgb = |p: &[u8]| if channels == 1 { [p[0]; 3] } else { [p[0], p[1], p[2]] };
    Ok(([w, h], pixels.chunks_exact(channels).map(rgb).collect()))
}
