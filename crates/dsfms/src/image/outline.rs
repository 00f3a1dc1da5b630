//! The outline of an organ in a frame.

use super::distance::{distance_to, signed_distance};
use super::{Mask, Plane};
use crate::geometry::Point2;

/// An outline is not known within this of an instrument or the image's border, px.
const MARGIN: f64 = 3.0;

/// Where an organ ends in a frame, as its mask says.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Signed distance to it, px: negative on the organ, of which what an instrument covers counts
    /// as a part.
    pub distance: Plane,
    /// Distance to the nearest pixel where it is not known, as at an instrument, px.
    unknown: Option<Plane>,
    /// Whether the rim of an open surface may not lie outside of it.
    pub(crate) holds_rims: bool,
}

impl Outline {
    /// Of masks of one size; `organ` is `true` where the organ is the first surface hit.
    pub fn new(organ: &Mask, instrument: Option<&Mask>) -> Self {
        let whole = instrument.map_or_else(|| organ.clone(), |tool| organ.or(tool));
        Self {
            distance: signed_distance(&whole),
            unknown: instrument.map(distance_to),
            holds_rims: true,
        }
    }

    /// Of a mask that is not believed near the `unknown` pixels. It holds no rims: where the
    /// surface was reconstructed to is not where colours change, and what holds it on one side only
    /// shrinks it by the noise of the outline.
    pub(crate) fn known_off(organ: &Mask, unknown: &Mask) -> Self {
        Self {
            distance: signed_distance(organ),
            unknown: Some(distance_to(unknown)),
            holds_rims: false,
        }
    }

    /// Whether the part of the outline nearest to `p` (px) is one that was seen: not at an
    /// instrument, the image's border or where colours do not tell.
    pub fn known_at(&self, p: &Point2) -> bool {
        let Some((distance, _)) = self.distance.sample(p) else { return false };
        let reach = distance.abs() + MARGIN;
        let [w, h] = self.distance.size.map(|s| s as f64 - 1.0);
        let border = p.x.min(p.y).min(w - p.x).min(h - p.y);
        let unknown =
            self.unknown.as_ref().and_then(|d| d.sample(p)).map_or(f64::INFINITY, |d| d.0);
        reach < border.min(unknown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_not_known_at_an_instrument_or_the_border() {
        let size = [80, 60];
        let disc = |x: f64, y: f64, r: f64| Mask {
            size,
            data: (0..80 * 60)
                .map(|i| ((i % 80) as f64 - x).hypot((i / 80) as f64 - y) <= r)
                .collect(),
        };
        let (tool, organ) = (disc(62.0, 30.0, 8.0), disc(40.0, 30.0, 20.0));
        let seen = organ.minus(&tool);
        let outline = Outline::new(&seen, Some(&tool));
        let at = |x: f64, y: f64| Point2::new(x, y);
        // Half a px of rounding where the outline was seen, the far side of the tool where not.
        assert!((outline.distance.sample(&at(15.0, 30.0)).unwrap().0 - 4.5).abs() < 1.0);
        assert!(outline.known_at(&at(22.0, 30.0)) && outline.known_at(&at(40.0, 48.0)));
        assert!(!outline.known_at(&at(61.0, 30.0)) && !outline.known_at(&at(55.0, 30.0)));
        assert!(!outline.known_at(&at(1.0, 30.0)) && !outline.known_at(&at(-5.0, 30.0)));
    }
}
