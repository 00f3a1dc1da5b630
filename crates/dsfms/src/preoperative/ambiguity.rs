//! Poses that the surfaces cannot tell from the one that was found.

use super::align::Aligned;
use super::landmarks::LandmarkPair;
use super::starts::{apart, misfit_at};
use super::target::{SurfaceSample, extent};
use super::uncertainty::difference;
use super::verdict::Alternative;
use crate::geometry::{Point3, Similarity};

/// Farther than this share of the template's size is elsewhere.
const FAR: f64 = 0.2;
/// As good: a misfit at most this much larger, in proportion and in all. Fifty independent places
/// tell no smaller difference.
const AS_GOOD: [f64; 2] = [1.3, 0.02];
/// Landmarks allow a pose within so many standard deviations.
const ALLOWED: f64 = 3.0;

/// Of `others` those that are elsewhere, as good as `best`, and allowed by the landmarks (standard
/// deviation `sigma`, mm).
pub(super) fn alternatives(
    best: &Aligned,
    others: &[Aligned],
    samples: &[SurfaceSample],
    landmarks: &[LandmarkPair],
    sigma: f64,
) -> Vec<Alternative> {
    let bound = AS_GOOD[0] * best.misfit + AS_GOOD[1];
    let as_good = |other: &&Aligned| misfit_at(other, best.cut) <= bound;
    let allowed = |other: &&Aligned| {
        landmarks.is_empty() || landmark_rms(&other.similarity, landmarks) <= ALLOWED * sigma
    };
    elsewhere(best, others, samples)
        .filter(as_good)
        .filter(allowed)
        .map(|o| told(best, o, samples))
        .collect()
}

/// The pose elsewhere that fits much better, whatever the landmarks say.
pub(super) fn better(
    best: &Aligned,
    others: &[Aligned],
    samples: &[SurfaceSample],
) -> Option<Alternative> {
    const MUCH: f64 = 0.7;
    let found = elsewhere(best, others, samples)
        .min_by(|a, b| misfit_at(a, best.cut).total_cmp(&misfit_at(b, best.cut)))?;
    (misfit_at(found, best.cut) < MUCH * best.misfit - AS_GOOD[1])
        .then(|| told(best, found, samples))
}

fn elsewhere<'a>(
    best: &'a Aligned,
    others: &'a [Aligned],
    samples: &'a [SurfaceSample],
) -> impl Iterator<Item = &'a Aligned> {
    let (_, size) = extent(samples.iter().map(|s| &s.point));
    let far = FAR * size * best.similarity.scaling();
    others.iter().filter(move |o| apart(&best.similarity, &o.similarity, samples) > far)
}

fn told(best: &Aligned, other: &Aligned, samples: &[SurfaceSample]) -> Alternative {
    let (middle, _): (Point3, f64) = extent(samples.iter().map(|s| &s.point));
    let (turn_deg, _) = difference(&best.similarity, &other.similarity, &middle);
    Alternative {
        turn_deg,
        apart_mm: apart(&best.similarity, &other.similarity, samples),
        scale: other.similarity.scaling() / best.similarity.scaling(),
        misfit: misfit_at(other, best.cut),
    }
}

/// Root mean square distance of the pairs, mm.
pub(super) fn landmark_rms(pose: &Similarity, landmarks: &[LandmarkPair]) -> f64 {
    let square = |l: &LandmarkPair| (pose * l.template - l.ct).norm_squared();
    (landmarks.iter().map(square).sum::<f64>() / landmarks.len().max(1) as f64).sqrt()
}
