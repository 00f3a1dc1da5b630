//! From the luma and chroma of video to encoded RGB.

/// How a stream codes colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    /// ITU-R BT.709 coefficients, else BT.601.
    pub(super) bt709: bool,
    /// Luma over 0 to 255, else 16 to 235.
    pub(super) full_range: bool,
}

impl Coding {
    /// From H.264's `matrix_coefficients`; where the stream leaves it open (2), by size as players
    /// do: high definition is BT.709.
    pub(super) fn new(matrix: u8, full_range: bool, size: [usize; 2]) -> Self {
        let bt709 = match matrix {
            1 => true,
            4..=7 => false,
            _ => size[0] >= 1280 || size[1] >= 720,
        };
        Self { bt709, full_range }
    }

    /// Factors of luma, of Cr in red, of Cb and Cr in green, of Cb in blue, in 1/65536, and the
    /// level of black.
    pub(super) fn factors(self) -> Factors {
        let (kr, kb) = if self.bt709 { (0.2126, 0.0722) } else { (0.299, 0.114) };
        let kg = 1.0 - kr - kb;
        let (luma, chroma) =
            if self.full_range { (1.0, 1.0) } else { (255.0 / 219.0, 255.0 / 224.0) };
        let fixed = |v: f64| (v * 65536.0).round() as i32;
        Factors {
            black: if self.full_range { 0 } else { 16 },
            luma: fixed(luma),
            red_cr: fixed(chroma * 2.0 * (1.0 - kr)),
            green_cb: fixed(-chroma * 2.0 * (1.0 - kb) * kb / kg),
            green_cr: fixed(-chroma * 2.0 * (1.0 - kr) * kr / kg),
            blue_cb: fixed(chroma * 2.0 * (1.0 - kb)),
        }
    }
}

/// Conversion in 16-bit fixed point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Factors {
    black: i32,
    luma: i32,
    red_cr: i32,
    green_cb: i32,
    green_cr: i32,
    blue_cb: i32,
}

impl Factors {
    /// Encoded RGB of one pixel.
    pub(super) fn rgb(&self, y: u8, cb: u8, cr: u8) -> [u8; 3] {
        let (cb, cr) = (cb as i32 - 128, cr as i32 - 128);
        let base = (y as i32 - self.black) * self.luma + 32768;
        let clamp = |v: i32| (v >> 16).clamp(0, 255) as u8;
        [
            clamp(base + self.red_cr * cr),
            clamp(base + self.green_cb * cb + self.green_cr * cr),
            clamp(base + self.blue_cb * cb),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_white_and_the_primaries() {
        let limited = Coding::new(1, false, [1280, 720]).factors();
        assert_eq!(limited.rgb(16, 128, 128), [0; 3]);
        assert_eq!(limited.rgb(235, 128, 128), [255; 3]);
        // BT.709 red: Y = 16 + 219·0.2126, Cb = 128 − 224·0.2126/1.8556, Cr = 240.
        let red = limited.rgb(63, 102, 240);
        assert!(red[0] >= 254 && red[1] <= 1 && red[2] <= 1, "{red:?}");
        let full = Coding::new(6, true, [1280, 720]).factors();
        assert_eq!(full.rgb(255, 128, 128), [255; 3]);
        assert_eq!(full.rgb(77, 128, 128), [77; 3]);
        // BT.601 blue: Y = 29, Cb = 255, Cr = 107.
        let blue = full.rgb(29, 255, 107);
        assert!(blue[2] >= 253 && blue[0] <= 1 && blue[1] <= 1, "{blue:?}");
        assert!(
            !Coding::new(2, false, [640, 480]).bt709 && Coding::new(2, false, [1920, 1080]).bt709
        );
    }
}
