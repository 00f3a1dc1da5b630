//! Pixels in memory: encoded frames, linear colour, one-channel planes, masks, tone curves.

use crate::geometry::Point2;

pub(crate) mod affine;
mod bilinear;
pub mod clahe;
pub mod corners;
pub(crate) mod cut;
pub mod distance;
pub mod exposure;
pub mod filter;
pub mod flow;
mod frame;
pub mod mask;
mod morphology;
pub mod names;
pub mod outline;
pub mod picture;
pub mod plane;
mod polygon;
mod reduced;
pub(crate) mod segment;
pub mod tone;
pub mod viewport;

pub(crate) use bilinear::Bilinear;
pub(crate) use clahe::clahe;
pub use exposure::{halo, saturation};
pub use frame::Frame;
pub(crate) use frame::LUMA;
pub use mask::Mask;
pub use outline::Outline;
pub use picture::Picture;
pub use plane::{ColorImage, Plane};
pub use tone::ToneCurve;
pub use viewport::{usable, viewport};

/// Diagonal of an image, px: the length that limits in the image are stated in.
pub fn diagonal([width, height]: [usize; 2]) -> f64 {
    (width as f64).hypot(height as f64)
}

/// Column and row of the pixel whose centre is nearest to a place, px; `None` beside the image.
pub(crate) fn nearest_pixel(p: &Point2, [w, h]: [usize; 2]) -> Option<[usize; 2]> {
    let (x, y) = (p.x.round(), p.y.round());
    let inside = x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64;
    inside.then_some([x as usize, y as usize])
}

/// Whether a place lies in the rectangle of the pixels' centres.
pub(crate) fn within_centres(p: &Point2, size: [usize; 2]) -> bool {
    let [w, h] = size.map(|n| n as f64 - 1.0);
    p.x >= 0.0 && p.y >= 0.0 && p.x <= w && p.y <= h
}
