//! Landmarks picked on both surfaces: a similarity in closed form (Umeyama 1991) that survives
//! wrong pairs.

use super::options::ScaleRule;
use super::verdict::PreoperativeError;
use crate::geometry::{Point3, Similarity, Vector3, align_rigid, align_similarity, scatter};
use crate::sfm::random::Random;
use nalgebra::Translation3;

/// The same place on both surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkPair {
    /// As the user calls it.
    pub name: String,
    /// On the preoperative surface, mm.
    pub ct: Point3,
    /// On the template, in its unit.
    pub template: Point3,
}

/// What the landmarks say.
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkFit {
    /// `ct_from_template`.
    pub similarity: Similarity,
    /// Which pairs agree with it.
    pub agree: Vec<bool>,
    /// Distance of every pair under it, mm.
    pub residuals: Vec<f64>,
    /// Distance of every agreeing pair under the similarity of the others, mm; `None` of fewer than
    /// four.
    pub left_out: Vec<Option<f64>>,
}

/// Triples that are tried one by one; of more, so many are drawn.
const MOST_TRIPLES: usize = 3000;
/// A pair agrees within so many standard deviations.
const AGREE: f64 = 3.0;
/// Spread of points across their line, of that along it, below which they are taken for collinear.
const COLLINEAR: f64 = 0.05;
/// Share of the pairs that must agree.
const MAJORITY: f64 = 0.5;

/// The similarity that most pairs agree with, at the scale that `rule` allows. `sigma`: standard
/// deviation of a pair, mm.
///
/// # Errors
/// Fewer than three pairs, collinear ones, or pairs that disagree.
#[doc(alias("Umeyama", "RANSAC", "fiducial registration"))]
pub fn fit_landmarks(
    pairs: &[LandmarkPair],
    rule: ScaleRule,
    sigma: f64,
    seed: u64,
) -> Result<LandmarkFit, PreoperativeError> {
    let count = pairs.len();
    if count < 3 {
        return Err(PreoperativeError::TooFewPairs { found: count });
    }
    let all: Vec<&LandmarkPair> = pairs.iter().collect();
    if flatness(all.iter().map(|p| p.ct)) < COLLINEAR
        || flatness(all.iter().map(|p| p.template)) < COLLINEAR
    {
        return Err(PreoperativeError::Collinear);
    }
    let limit = AGREE * sigma;
    let best = triples(count, seed)
        .into_iter()
        .filter_map(|triple| {
            let some: Vec<&LandmarkPair> = triple.iter().map(|&i| &pairs[i]).collect();
            let found = closed_form(&some, rule)?;
            Some((truncated(pairs, &found, limit), found))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, mut similarity) = best.ok_or(PreoperativeError::Collinear)?;
    let mut agree = agreeing(pairs, &similarity, limit);
    // A few refits on whoever agrees.
    for _ in 0..5 {
        let some: Vec<&LandmarkPair> = chosen(pairs, &agree);
        let Some(refit) = closed_form(&some, rule) else { break };
        similarity = refit;
        let next = agreeing(pairs, &similarity, limit);
        if next == agree {
            break;
        }
        agree = next;
    }
    let agreeing = agree.iter().filter(|a| **a).count();
    if agreeing < 3 || (agreeing as f64) <= MAJORITY * count as f64 {
        let disagree = PreoperativeError::PairsDisagree { agree: agreeing, of: count, limit };
        return Err(disagree);
    }
    let some = chosen(pairs, &agree);
    if flatness(some.iter().map(|p| p.ct)) < COLLINEAR {
        return Err(PreoperativeError::Collinear);
    }
    let residuals = pairs.iter().map(|p| distance(&similarity, p)).collect();
    let left_out = left_out(pairs, &agree, rule);
    Ok(LandmarkFit { similarity, agree, residuals, left_out })
}

fn chosen<'p>(pairs: &'p [LandmarkPair], agree: &[bool]) -> Vec<&'p LandmarkPair> {
    pairs.iter().zip(agree).filter(|(_, a)| **a).map(|(p, _)| p).collect()
}

fn distance(similarity: &Similarity, pair: &LandmarkPair) -> f64 {
    (similarity * pair.template - pair.ct).norm()
}

fn agreeing(pairs: &[LandmarkPair], similarity: &Similarity, limit: f64) -> Vec<bool> {
    pairs.iter().map(|p| distance(similarity, p) <= limit).collect()
}

/// Sum of squares, each at most that of the limit (MSAC, Torr and Zisserman 2000).
fn truncated(pairs: &[LandmarkPair], similarity: &Similarity, limit: f64) -> f64 {
    pairs.iter().map(|p| distance(similarity, p).min(limit).powi(2)).sum()
}

fn closed_form(pairs: &[&LandmarkPair], rule: ScaleRule) -> Option<Similarity> {
    let from: Vec<Point3> = pairs.iter().map(|p| p.template).collect();
    let to: Vec<Point3> = pairs.iter().map(|p| p.ct).collect();
    if pairs.len() < 3 || flatness(from.iter().copied()) < COLLINEAR {
        return None;
    }
    let free = align_similarity(&from, &to)?;
    let [low, high] = rule.bounds();
    if (low..=high).contains(&free.scaling()) {
        return Some(free);
    }
    // At the nearest bound the rotation is that of the rigid fit, about the middles.
    let scale = free.scaling().clamp(low, high);
    let middle =
        |points: &[Point3]| points.iter().map(|p| p.coords).sum::<Vector3>() / points.len() as f64;
    let rotation = align_rigid(&from, &to)?.rotation;
    let shift = middle(&to) - scale * (rotation * middle(&from));
    Some(Similarity::from_parts(Translation3::from(shift), rotation, scale))
}

fn left_out(pairs: &[LandmarkPair], agree: &[bool], rule: ScaleRule) -> Vec<Option<f64>> {
    let without = |i: usize| {
        let others = pairs.iter().enumerate().filter(|(j, _)| *j != i && agree[*j]);
        let others: Vec<&LandmarkPair> = others.map(|(_, p)| p).collect();
        Some(distance(&closed_form(&others, rule)?, &pairs[i]))
    };
    (0..pairs.len()).map(|i| if agree[i] { without(i) } else { None }).collect()
}

/// Second over first root of the eigenvalues of the spread: 0 for points on a line.
pub(super) fn flatness(points: impl Iterator<Item = Point3> + Clone) -> f64 {
    let mut values = scatter(points).1.symmetric_eigenvalues();
    values.as_mut_slice().sort_unstable_by(|a, b| b.total_cmp(a));
    if values[0] > 0.0 { (values[1].max(0.0) / values[0]).sqrt() } else { 0.0 }
}

fn triples(count: usize, seed: u64) -> Vec<[usize; 3]> {
    let all = count * (count - 1) * (count - 2) / 6;
    if all > MOST_TRIPLES {
        let mut random = Random::new(seed, 23);
        return (0..MOST_TRIPLES).map(|_| random.sample::<3>(count)).collect();
    }
    let pairs = (0..count).flat_map(|i| (i + 1..count).map(move |j| [i, j]));
    pairs.flat_map(|[i, j]| (j + 1..count).map(move |k| [i, j, k])).collect()
}
