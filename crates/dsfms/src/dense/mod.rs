//! Multi-view stereo: from posed frames to an open surface of what they saw.
//!
//! ```text
//! posed frames ─► depth_maps ─► surface
//!                 one a frame   truncated signed distances ─► smooth field ─► tetrahedra ─► mesh
//! ```
//!
//! The light moves with the camera and highlights move over the tissue, so images are compared by
//! zero-mean normalised cross-correlation, on the best few of several views, with saturated pixels
//! and a ring around them left out. Each depth map is found by PatchMatch with slanted planes
//! (Galliani, Lasinger, Schindler 2015; Xu and Tao 2019), polished by Gauss-Newton on the images at
//! twice the resolution, checked against the other depth maps, and smoothed with the inverse of its
//! own variance as weight. Lengths are those of the poses.

mod cells;
mod clean;
mod consistency;
mod contour;
mod depth_map;
mod error;
mod exchange;
mod fit;
mod grid;
mod handles;
mod holes;
mod labels;
mod lanes;
mod looks;
mod neighbours;
mod observe;
mod options;
mod others;
mod patchmatch;
mod plane;
#[cfg(test)]
mod plates;
mod polish;
mod rim;
mod score;
mod seeds;
mod smooth;
mod surface;
#[cfg(test)]
mod tests;
mod tetrahedra;
mod view;
mod volume;

pub use cells::Colours;
pub use contour::outlines;
pub use depth_map::DepthMap;
pub use error::DenseError;
pub use labels::{Border, Labelling, Parting};
pub use options::DenseOptions;
pub use others::overlap;
pub use seeds::Seeds;
pub use surface::{DenseSurface, VertexSupport, surface};

pub use crate::camera::PosedFrame;

use crate::geometry::{Isometry, Point3};
use plane::Field;
use rayon::prelude::*;
use view::StereoPyramid;

/// The frames worth a depth map: all of few, else those that lie farthest apart, in order; see
/// [`DenseOptions::max_frames`]. `sparse` as in [`depth_maps`].
pub fn worthwhile<'a>(
    views: &[PosedFrame<'a>],
    sparse: &[Point3],
    options: &DenseOptions,
) -> Vec<PosedFrame<'a>> {
    let poses: Vec<Isometry> = views.iter().map(|v| v.pose).collect();
    neighbours::spread(&poses, sparse, options.max_frames).iter().map(|&i| views[i]).collect()
}

/// One depth map a frame, in the order of `views`.
///
/// `sparse` are points of the scene in the world frame, as triangulated by structure from motion;
/// they bound the depth and help to choose which frames are compared. Without them a wide range is
/// searched, which is slower to converge and less robust. `progress` is told `(done, total)`.
///
/// # Errors
/// An option out of range, fewer than two frames, images or masks of another size than their
/// camera, or no depth.
pub fn depth_maps(
    views: &[PosedFrame],
    sparse: &[Point3],
    options: &DenseOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<DepthMap>, DenseError> {
    options.validate()?;
    if views.len() < 2 {
        return Err(DenseError::TooFewFrames { found: views.len() });
    }
    let scale = view::working_scale(views, options.max_pixels);
    let pyramids =
        views.par_iter().map(|v| StereoPyramid::new(v, scale)).collect::<Result<Vec<_>, _>>()?;
    let sources = neighbours::select(&pyramids, sparse, options);
    let total = views.len();
    let ranges: Vec<[f64; 2]> = sources
        .iter()
        .enumerate()
        .map(|(i, others)| neighbours::depth_range(&pyramids, i, others, sparse))
        .collect();
    let mut fields: Vec<Field> = Vec::with_capacity(total);
    for (i, others) in sources.iter().enumerate() {
        fields.push(search(&pyramids, i, others, ranges[i], options));
        progress(i + 1, 2 * total);
    }
    // Offers of all frames come from before any was taken: the order of the frames has no part.
    let offers: Vec<_> = (0..total)
        .into_par_iter()
        .map(|i| exchange::offers(&pyramids, &fields, i, &sources[i]))
        .collect();
    for (i, field) in fields.iter_mut().enumerate() {
        let coarse = score::Pairs::new(&pyramids, i, &sources[i], 1);
        patchmatch::accept(&coarse, field, &offers[i], ranges[i], options);
        let fine = score::Pairs::new(&pyramids, i, &sources[i], 0);
        polish::run(&fine, field, ranges[i], options);
        progress(total + i + 1, 2 * total);
    }
    let agreement = consistency::check(&pyramids, &fields, options);
    let maps: Vec<DepthMap> = (0..total)
        .into_par_iter()
        .map(|i| smooth::depth_map(&pyramids[i], &fields[i], &agreement[i], options))
        .collect();
    if maps.iter().all(|m| m.confidence.iter().all(|&c| c == 0.0)) {
        return Err(DenseError::NoDepth { frames: total });
    }
    Ok(maps)
}

/// PatchMatch from the coarsest level to the grid.
fn search(
    pyramids: &[StereoPyramid],
    reference: usize,
    sources: &[usize],
    range: [f64; 2],
    options: &DenseOptions,
) -> Field {
    let seed = options.seed ^ (reference as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut field: Option<Field> = None;
    for (level, &iterations) in
        [(3, &options.iterations[0]), (2, &options.iterations[1]), (1, &options.iterations[2])]
    {
        let pairs = score::Pairs::new(pyramids, reference, sources, level);
        let start = match field {
            Some(coarse) => coarse.upsampled(pairs.reference.size),
            None => patchmatch::random_field(&pairs, range, seed),
        };
        field =
            Some(patchmatch::run(&pairs, start, range, iterations, seed ^ level as u64, options));
    }
    field.unwrap_or_default()
}
