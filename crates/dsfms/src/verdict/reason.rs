//! What speaks against a surface, with the figures it rests on.

use serde::{Deserialize, Serialize};

/// A doubt. Lengths in the template's unit, shares in `[0, 1]`, pixels of the frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Reason {
    /// No surface could be made; what the stage said.
    NoSurface {
        /// The stage's error.
        why: String,
    },
    /// The frame is not as it was taken: damaged, or predicted from one that is.
    Input {
        /// What is known of it.
        why: String,
    },
    /// A coordinate is NaN or infinite.
    NotFinite,
    /// The frame is black: `brightest` is its brightest value, of 255.
    Black {
        /// That value.
        brightest: u8,
    },
    /// No vertex is seen.
    NothingVisible,
    /// Few matches carry the surface.
    FewMatches {
        /// Distinct ones that it explains.
        kept: usize,
        /// How many are wanted.
        wanted: usize,
    },
    /// Rows that repeat one another.
    RepeatedMatches {
        /// Different places among them.
        distinct: usize,
        /// All.
        total: usize,
    },
    /// The surface explains too few of the matches.
    MatchesDisagree {
        /// Explained.
        kept: usize,
        /// All.
        total: usize,
    },
    /// The kept matches lie far from the surface.
    Residual {
        /// Median distance, px.
        px: f64,
    },
    /// The matches do not fix the pose: on a line, in one small place.
    PoseUncertain {
        /// Standard deviation of the position of nine visible vertices in ten, at most.
        length: f64,
        /// Largest standard deviation of the orientation, degrees.
        degrees: f64,
        /// `length` over the visible radius.
        share: f64,
    },
    /// The surface lies nearer or farther than any exploration frame makes plausible.
    Depth {
        /// Median depth of what is seen.
        depth: f64,
        /// Least and largest of the exploration.
        usual: [f64; 2],
    },
    /// What is seen of the organ would be next to a point in the frame.
    Tiny {
        /// Radius of the visible surface, px.
        px: f64,
    },
    /// No rigid pose comes near the matches.
    FarFromRigid {
        /// Median distance, px.
        px: f64,
    },
    /// Bent so far from any rigid pose that its depth is uncertain.
    DepthUncertain {
        /// Of the visible radius.
        share: f64,
    },
    /// Few textured places can be compared.
    FewPlaces {
        /// Their number.
        places: usize,
    },
    /// Few of the textured places look like the template.
    Unlike {
        /// Share of them that do.
        share: f64,
    },
    /// The texture is not the template's, or lies elsewhere.
    Structure {
        /// Median correlation with the prediction.
        correlation: f64,
        /// That of the exploration frames, or what is expected without any.
        usual: f64,
    },
    /// The texture is fainter than predicted: blur, smoke, a film on the lens.
    Faint {
        /// Strength of the texture.
        contrast: f64,
        /// That of the exploration frames.
        usual: f64,
    },
    /// Brightness is farther from the prediction than usual.
    Brightness {
        /// Residual over the usual one.
        times: f64,
    },
    /// Little of the predicted silhouette shows the organ.
    Covered {
        /// Share that does.
        shown: f64,
    },
    /// Little of the predicted silhouette can be compared with the frame at all.
    Uncompared {
        /// Share that can.
        share: f64,
    },
    /// A part of the visible surface where the image shows something else than the template there.
    RegionContradicted(Part),
    /// A part of the visible surface of which nothing in the frame speaks.
    RegionUnobserved(Part),
    /// Nothing could be used for shading; the surface is motion's.
    NoShading,
    /// The exposure is far from the template's.
    Gain {
        /// Relative to the template's.
        gain: f64,
    },
    /// Edges change their length much.
    Strain {
        /// Change that one edge in twenty exceeds.
        share: f64,
    },
    /// Faces are turned over.
    Folded {
        /// Their number.
        faces: usize,
        /// Share of the visible area.
        share: f64,
    },
    /// The shape jumped from one frame to the next.
    Jump {
        /// Of its radius.
        share: f64,
    },
    /// The camera is not the template's, and the matches do not tell which is right.
    CameraUnconfirmed {
        /// Largest difference of their sightlines, px.
        apart_px: f64,
    },
    /// The matches fit the template's camera and not the one given.
    CameraContradicted {
        /// Largest difference of their sightlines, px.
        apart_px: f64,
        /// Median distance of the matches from the pose under the given camera, px.
        given_px: f64,
        /// The same under the template's.
        own_px: f64,
    },
}

/// A connected part of the visible surface, as it lies in the frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Of the visible area.
    pub share: f64,
    /// Centre in the frame, px.
    pub centre_px: [f64; 2],
    /// Radius in the frame, px (root mean square distance from the centre).
    pub radius_px: f64,
}
