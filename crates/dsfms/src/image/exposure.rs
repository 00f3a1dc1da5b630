//! Saturated pixels and the haloes around them, judged on encoded values.

use super::Mask;
use super::frame::Frame;

/// Encoded value from which a channel counts as saturated. Not 255: lossy coding and the limited
/// range of video spread a clipped 255 over a few values below it.
pub const SATURATED: u8 = 250;

/// `true` where all three encoded channels are at or above [`SATURATED`]: the white core of a
/// highlight. (One clipped channel is common on red tissue and no highlight.)
pub fn saturation(frame: &Frame) -> Mask {
    let white = |p: &[u8; 3]| p.iter().all(|&v| v >= SATURATED);
    Mask { size: frame.size, data: frame.rgb.iter().map(white).collect() }
}

/// The ring of `radius` px around the saturated cores, the cores left out: not saturated, yet
/// brighter than Lambert's law allows.
pub fn halo(saturation: &Mask, radius: f64) -> Mask {
    saturation.dilate(radius).minus(saturation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_white_pixel_and_its_ring() {
        let mut rgb = vec![[255, 80, 70]; 11 * 11];
        rgb[5 * 11 + 5] = [252, 250, 255];
        let core = saturation(&Frame { name: "f".into(), size: [11, 11], rgb });
        assert_eq!(core.data.iter().filter(|v| **v).count(), 1);
        let ring = halo(&core, 2.0);
        assert!(ring.at(7, 5) && ring.at(4, 4) && !ring.at(5, 5) && !ring.at(7, 7));
    }
}
