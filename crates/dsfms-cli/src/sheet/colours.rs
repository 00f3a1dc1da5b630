//! The colours of paper.

use super::Ink;

/// Text and axes.
pub const INK: [u8; 3] = [29, 33, 38];
const GRID: [u8; 3] = [217, 221, 226];
const BAR: [u8; 3] = [143, 163, 184];
const ACCENT: [u8; 3] = [163, 61, 47];

/// The colour of an ink on paper.
pub fn of(ink: Ink) -> [u8; 3] {
    match ink {
        Ink::Text => INK,
        Ink::Grid => GRID,
        Ink::Line(k) | Ink::Marker(k) => series(k),
        // As the page shows it: see-through by three tenths, on white.
        Ink::Whisker(k) => series(k).map(|c| (0.7 * f64::from(c) + 0.3 * 255.0).round() as u8),
        Ink::Bar(strong) => {
            if strong {
                ACCENT
            } else {
                BAR
            }
        }
        Ink::Status("ok") => [31, 107, 69],
        Ink::Status("degraded") => [138, 83, 0],
        Ink::Status(_) => [161, 32, 26],
        Ink::Rgb(colour) => colour,
    }
}

/// Colour `k` of a cycle that colour-blind eyes tell apart (Okabe and Ito).
pub fn series(k: usize) -> [u8; 3] {
    const CYCLE: [[u8; 3]; 7] = [
        [0, 114, 178],
        [213, 94, 0],
        [0, 158, 115],
        [204, 121, 167],
        [230, 159, 0],
        [86, 180, 233],
        [90, 90, 90],
    ];
    CYCLE[k % CYCLE.len()]
}

/// From blue (−1) over white to red (1).
pub fn diverging(t: f64) -> [u8; 3] {
    const BLUE: [f64; 3] = [33.0, 102.0, 172.0];
    const WHITE: [f64; 3] = [247.0, 247.0, 247.0];
    const RED: [f64; 3] = [178.0, 24.0, 43.0];
    let (end, u) = if t < 0.0 { (BLUE, -t) } else { (RED, t) };
    let u = u.clamp(0.0, 1.0);
    std::array::from_fn(|c| ((1.0 - u) * WHITE[c] + u * end[c]) as u8)
}

/// The next 1, 1.5, 2, 3, 4, 5, 6 or 8 times a power of ten.
pub fn round_up(v: f64) -> f64 {
    let decade = 10f64.powf(v.log10().floor());
    let step = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]
        .into_iter()
        .find(|s| s * decade >= v * (1.0 - 1e-9));
    step.unwrap_or(10.0) * decade
}

/// A length of 1, 2 or 5 times a power of ten that is at most `largest` (positive).
pub fn round_down(largest: f64) -> f64 {
    let power = 10.0_f64.powf(largest.log10().floor());
    [5.0, 2.0, 1.0].iter().map(|m| m * power).find(|v| *v <= largest).unwrap_or(power)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_axes_are_round() {
        for (v, top) in
            [(0.7, 0.8), (1.0, 1.0), (1.1, 1.5), (3.2, 4.0), (45.0, 50.0), (81.0, 100.0)]
        {
            assert!((round_up(v) - top).abs() < 1e-9 * top, "{v}");
        }
        for (largest, round) in [(0.3, 0.2), (1.0, 1.0), (7.3, 5.0), (99.0, 50.0)] {
            assert!((round_down(largest) - round).abs() < 1e-12 * round);
        }
    }
}
