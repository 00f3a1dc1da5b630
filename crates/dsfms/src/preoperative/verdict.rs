//! What is refused, and what is doubted.

use crate::options::OptionError;
use serde::Serialize;

/// Another pose that fits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Alternative {
    /// Turn from the pose that was found, degrees.
    pub turn_deg: f64,
    /// Root mean square distance of the template's points between the two, mm.
    pub apart_mm: f64,
    /// Its scale over that of the pose that was found.
    pub scale: f64,
    /// Mean loss of the template's points, 0 to 1, as that of the pose that was found.
    pub misfit: f64,
}

/// Why a preoperative surface is not registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PreoperativeError {
    /// An option out of its range.
    #[error(transparent)]
    Option(#[from] OptionError),
    /// A surface without faces or extent.
    #[error("the {0} surface has no extent")]
    Flat(&'static str),
    /// A similarity has seven unknowns.
    #[error(
        "{found} landmark pairs; at least 3 that are not in one line are needed, or none at all"
    )]
    TooFewPairs {
        /// Given.
        found: usize,
    },
    /// A turn about the line stays open.
    #[error("the landmarks that agree lie nearly on one line; pick another far from it")]
    Collinear,
    /// No similarity explains most of the pairs.
    #[error(
        "the landmark pairs disagree: only {agree} of {of} fit one similarity within {limit:.0} mm; check their \
         order, names, units and axes (LPS or RAS)"
    )]
    PairsDisagree {
        /// Pairs that agree.
        agree: usize,
        /// All pairs.
        of: usize,
        /// Within this distance, mm.
        limit: f64,
    },
    /// The search found nothing.
    #[error("no pose lays the template on the preoperative surface; give landmark pairs")]
    NoPose,
    /// Too little of the template lies on the preoperative surface.
    #[error(
        "only {:.0} % of the template lies on the preoperative surface, {:.0} % are needed; is it the same organ, \
         and its outer surface?", 100.0 * share, 100.0 * needed
    )]
    Overlap {
        /// Share of the template's area.
        share: f64,
        /// Needed.
        needed: f64,
    },
    /// The surface slides along itself.
    #[error(
        "the template fits the preoperative surface along {motion} (condition {condition:.1e}, {needed:.0e} is needed): \
         the part that it shows is too round or too small to tell; give landmark pairs"
    )]
    Slides {
        /// Smallest eigenvalue.
        condition: f64,
        /// Needed.
        needed: f64,
        /// Of what kind.
        motion: &'static str,
    },
    /// Other poses fit as well.
    #[error(
        "{} other pose(s) fit as well, the nearest {:.0}° and {:.0} mm away: the surfaces alone cannot tell; give \
         {} landmark pairs", others.len(), others[0].turn_deg, others[0].apart_mm,
        if *landmarks { "more" } else { "three or more" }
    )]
    Ambiguous {
        /// The other poses, at least one.
        others: Vec<Alternative>,
        /// Whether there are landmarks already.
        landmarks: bool,
    },
}

/// Why a registration is not fully believed.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Doubt {
    /// Pairs that do not fit the others were left out.
    WrongPairs {
        /// Their names.
        names: Vec<String>,
    },
    /// Only landmarks hold a motion along which the surface slides.
    HeldByLandmarks {
        /// Smallest eigenvalue of the surface's system.
        condition: f64,
        /// Of what kind.
        motion: &'static str,
    },
    /// Elsewhere the surface fits much better, but the landmarks do not.
    BetterElsewhere {
        /// There.
        pose: Alternative,
    },
    /// The scale is as far from 1 as it may be.
    ScaleAtBound {
        /// Scale, mm per mm.
        scale: f64,
    },
    /// The surface bends as far as it may.
    LargeDeformation {
        /// Largest displacement, mm.
        largest_mm: f64,
        /// Bound, mm.
        bound_mm: f64,
    },
    /// No landmark speaks, and no similarity lays the surfaces on each other.
    FitsOnlyBent {
        /// Residual of the similarity, mm.
        rms_mm: f64,
        /// Noise of the template's surface, mm.
        noise_mm: f64,
    },
    /// Part of the template has no partner.
    LittleOverlap {
        /// Share of the template's area.
        share: f64,
    },
    /// A target may be far off.
    Uncertain {
        /// Name of the structure.
        name: String,
        /// Expected error, mm.
        expected_mm: f64,
        /// Bound, mm.
        bound_mm: f64,
    },
}

impl std::fmt::Display for Doubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::WrongPairs { names } => {
                write!(
                    f,
                    "landmark pairs that do not fit the others were left out: {}",
                    names.join(", ")
                )
            }
            Self::HeldByLandmarks { condition, motion } => write!(
                f,
                "the surface leaves {motion} open (condition {condition:.1e}); only the landmarks hold it"
            ),
            Self::BetterElsewhere { pose } => write!(
                f,
                "the surface fits better elsewhere ({:.0}°, {:.0} mm away), where the landmarks do not",
                pose.turn_deg, pose.apart_mm
            ),
            Self::ScaleAtBound { scale } => {
                write!(f, "the scale is at its bound ({scale:.3}): is the template's unit right?")
            }
            Self::LargeDeformation { largest_mm, bound_mm } => write!(
                f,
                "the surface bends by up to {largest_mm:.1} mm, the bound is {bound_mm:.1} mm"
            ),
            Self::FitsOnlyBent { rms_mm, noise_mm } => write!(
                f,
                "without landmarks, and with {rms_mm:.1} mm left by the similarity (noise {noise_mm:.1} mm): the organ \
                 has bent, and place and scale may be those of another fit"
            ),
            Self::LittleOverlap { share } => {
                write!(
                    f,
                    "only {:.0} % of the template lies on the preoperative surface",
                    100.0 * share
                )
            }
            Self::Uncertain { name, expected_mm, bound_mm } => write!(
                f,
                "{name} may be {expected_mm:.1} mm off (expected), more than {bound_mm:.1} mm"
            ),
        }
    }
}
