//! The regression, and how well it tells.

use super::Row;
use dsfms::expected_error::model::LARGEST;
use dsfms::expected_error::{COUNT, NAMES};

/// Distances to evidence never count for less than this, whatever the cases say.
const LEAST: f64 = 0.05;

fn predict(w: &[f64; COUNT], f: &[f64; COUNT]) -> f64 {
    dot(w, f).min(LARGEST).exp()
}

/// Smaller errors, of the visible radius, count as this: nobody needs to tell them apart.
const NOTHING: f64 = 1e-3;

/// Spread of what a case is off as a whole and no feature tells, of the logarithm. Nearly free (3),
/// the weights are those that tell vertices of one case apart; chosen with whole scenes and clips
/// left out of the fit (`docs/results/expected_error.md`).
const CASE: f64 = 0.5;

/// A frame in which nothing moved by more than this multiple of `features::SMALL` (a fiftieth of
/// the visible radius) has no zone.
const MOVED: f64 = 1.0;

/// Gamma regression with a logarithmic link, so that every error counts relative to its size; every
/// case counts the same, in it its zone as much as all of it, and has its own level of spread
/// [`CASE`]; weights but the constant are at least 0, those of distances [`LEAST`]. The constant is
/// such that the mean is predicted. With the multiple of the prediction that nine errors of ten
/// stay below, and that nine zones of ten do.
pub fn regress(rows: &[Row]) -> ([f64; COUNT], [f64; 2]) {
    let cases: Vec<&[Row]> = rows.chunk_by(|a, b| a.case == b.case).collect();
    let mean = rows.iter().map(|r| r.error).sum::<f64>() / rows.len().max(1) as f64;
    let shares: Vec<Vec<f64>> = cases.iter().map(|case| shares(case)).collect();
    let (mut w, mut levels) = ([0.0; COUNT], vec![0.0; cases.len()]);
    w[0] = mean.max(f64::MIN_POSITIVE).ln();
    for _ in 0..200 {
        let mut normal = [[0.0; COUNT]; COUNT];
        let mut right = [0.0; COUNT];
        for ((case, shares), level) in cases.iter().zip(&shares).zip(&mut levels) {
            let mut left = 0.0;
            for (r, weight) in case.iter().zip(shares) {
                let eta: f64 = dot(&w, &r.features);
                // Newton's step of the deviance has the weight error / prediction, bounded here.
                let step = (r.error.max(NOTHING) / (eta + *level).exp() - 1.0).min(10.0);
                left += weight * step;
                for a in 0..COUNT {
                    right[a] += weight * r.features[a] * (eta + step);
                    (0..COUNT).for_each(|b| normal[a][b] += weight * r.features[a] * r.features[b]);
                }
            }
            *level += 0.7 * (left - *level / CASE.powi(2)) / (1.0 + CASE.powi(-2));
        }
        descend(&normal, &right, &mut w);
    }
    let all: f64 = cases.iter().map(|case| case_mean(case, |r| r.error)).sum();
    let told: f64 = cases.iter().map(|case| case_mean(case, |r| predict(&w, &r.features))).sum();
    w[0] += (all / told.max(f64::MIN_POSITIVE)).max(f64::MIN_POSITIVE).ln();
    let vertices = rows.iter().map(|r| r.error / predict(&w, &r.features)).collect();
    (w, [vertices, zones(&w, rows)].map(nine_of_ten))
}

/// What nine of ten stay below.
fn nine_of_ten(mut ratios: Vec<f64>) -> f64 {
    ratios.sort_unstable_by(f64::total_cmp);
    ratios.get(ratios.len() * 9 / 10).copied().unwrap_or(1.0)
}

/// Which vertices of a frame are its zone: seen, and moved by at least half of what moved most;
/// none where nothing did.
fn zone(case: &[Row]) -> Vec<bool> {
    let column = NAMES.iter().position(|n| *n == "displacement").unwrap_or_default();
    let moved = |r: &Row| r.features[column].exp() - 1.0;
    let most = case.iter().filter(|r| r.visible).map(moved).fold(0.0, f64::max);
    case.iter().map(|r| r.visible && most > MOVED && moved(r) >= 0.5 * most).collect()
}

/// How much every vertex of a case counts, in sum 1: half for all of it, half for its zone where it
/// has one.
fn shares(case: &[Row]) -> Vec<f64> {
    let zone = zone(case);
    let inside = zone.iter().filter(|z| **z).count();
    let (all, whole) = (case.len() as f64, if inside > 0 { 2.0 } else { 1.0 });
    let share = |z: &bool| (1.0 / all + if *z { 1.0 / inside as f64 } else { 0.0 }) / whole;
    zone.iter().map(share).collect()
}

/// Of every frame that moved: error over prediction, as root mean squares over its zone. The errors
/// there go together: a frame is one draw, not many.
fn zones(w: &[f64; COUNT], rows: &[Row]) -> Vec<f64> {
    let ratio = |case: &[Row]| {
        let zone = zone(case);
        let zone = || case.iter().zip(&zone).filter(|r| *r.1).map(|r| r.0);
        let error: f64 = zone().map(|r| r.error.powi(2)).sum();
        let told: f64 = zone().map(|r| predict(w, &r.features).powi(2)).sum();
        (told > 0.0).then(|| (error / told).sqrt())
    };
    rows.chunk_by(|a, b| a.case == b.case).filter_map(ratio).collect()
}

fn dot(w: &[f64; COUNT], f: &[f64; COUNT]) -> f64 {
    w.iter().zip(f).map(|(w, f)| w * f).sum()
}

fn case_mean(case: &[Row], of: impl Fn(&Row) -> f64) -> f64 {
    case.iter().map(of).sum::<f64>() / case.len().max(1) as f64
}

/// Least squares with a little ridge and lower bounds, one coordinate after another.
fn descend(normal: &[[f64; COUNT]; COUNT], right: &[f64; COUNT], w: &mut [f64; COUNT]) {
    let ridge = 1e-4 * normal[0][0];
    for _ in 0..200 {
        for a in 0..COUNT {
            let rest: f64 = (0..COUNT).filter(|&b| b != a).map(|b| normal[a][b] * w[b]).sum();
            let free = (right[a] - rest) / (normal[a][a] + if a > 0 { ridge } else { 0.0 });
            w[a] = if a > 0 { free.max(least(a, normal)) } else { free };
        }
    }
}

fn least(feature: usize, normal: &[[f64; COUNT]; COUNT]) -> f64 {
    let used = normal[feature][feature] > 0.0;
    if used && NAMES[feature].ends_with(" distance") { LEAST } else { 0.0 }
}

/// How well predictions tell.
pub struct FitReport {
    /// Rank correlation over all vertices, mean within a frame in which something is off, the same
    /// of seen vertices.
    ranks: [f64; 4],
    /// Mean predicted and mean actual error of every tenth by prediction.
    pub deciles: Vec<[f64; 2]>,
    means: [f64; 2],
    /// Share of errors below the bound, of frames in which 80 to 95 % are, of frames whose zone is.
    covered: [f64; 3],
    /// Error over prediction of the zones: median, nine of ten, largest; share above 2.
    zones: [f64; 4],
}

impl FitReport {
    /// Head of a table of [`line`](Self::line)s.
    pub const HEAD: &str = "| model | Spearman, all | within a frame | seen, all | seen, within a frame | mean error / R | predicted / R | within the bound | zones over predicted: median, nine of ten, largest; above 2 | predicted / actual by decile |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |";

    /// Of weights and bound on rows that they were not fitted on.
    pub fn of(rows: &[Row], w: &[f64; COUNT], bound: f64) -> Self {
        let pair = |r: &Row| [predict(w, &r.features), r.error];
        let all: Vec<[f64; 2]> = rows.iter().map(pair).collect();
        let seen: Vec<[f64; 2]> = rows.iter().filter(|r| r.visible).map(pair).collect();
        let off = |case: &&[Row]| case.iter().any(|r| r.error > NOTHING);
        let frames = |of: &dyn Fn(&[&Row]) -> f64| -> f64 {
            let each = rows.chunk_by(|a, b| a.case == b.case).filter(off);
            let each: Vec<f64> = each.map(|rows| of(&rows.iter().collect::<Vec<_>>())).collect();
            each.iter().sum::<f64>() / each.len().max(1) as f64
        };
        let rank = |rows: &[&Row]| spearman(&rows.iter().map(|r| pair(r)).collect::<Vec<_>>());
        let of_seen =
            |rows: &[&Row]| rank(&rows.iter().copied().filter(|r| r.visible).collect::<Vec<_>>());
        let within = |pairs: &[[f64; 2]]| {
            let below = pairs.iter().filter(|[p, a]| *a <= bound * p).count();
            below as f64 / pairs.len().max(1) as f64
        };
        let usual = |rows: &[&Row]| {
            let share = within(&rows.iter().map(|r| pair(r)).collect::<Vec<_>>());
            f64::from(u8::from((0.8..=0.95).contains(&share)))
        };
        let zones = zones(w, rows);
        let below = |ratios: &[f64]| {
            ratios.iter().filter(|r| **r <= bound).count() as f64 / ratios.len().max(1) as f64
        };
        let twice = zones.iter().filter(|r| **r > 2.0).count() as f64;
        let mut ordered = zones.clone();
        ordered.sort_by(f64::total_cmp);
        let at = |part: usize| ordered.get(zones.len() * part / 10).copied().unwrap_or(f64::NAN);
        let largest = ordered.last().copied().unwrap_or(f64::NAN);
        let over = [at(5), at(9), largest, twice / zones.len().max(1) as f64];
        let mut sorted = all.clone();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mean = |rows: &[[f64; 2]]| {
            [0, 1].map(|k| rows.iter().map(|r| r[k]).sum::<f64>() / rows.len().max(1) as f64)
        };
        Self {
            ranks: [spearman(&all), frames(&rank), spearman(&seen), frames(&of_seen)],
            deciles: sorted.chunks(sorted.len().div_ceil(10).max(1)).map(mean).collect(),
            means: mean(&all),
            covered: [within(&all), frames(&usual), below(&zones)],
            zones: over,
        }
    }

    /// A row of the table.
    pub fn line(&self) -> String {
        let ranks = self.ranks.map(|r| format!("{r:.2}")).join(" | ");
        let [predicted, actual] = self.means;
        let deciles: Vec<String> =
            self.deciles.iter().map(|[p, a]| format!("{:.2}", p / a)).collect();
        let [all, usual, zones] = self.covered.map(|share| 100.0 * share);
        let [median, most, largest, twice] = self.zones;
        let twice = 100.0 * twice;
        format!(
            "{ranks} | {actual:.4} | {predicted:.4} | {all:.0} %; 80 to 95 % in {usual:.0} % of frames; {zones:.0} % of zones | {median:.2} {most:.2} {largest:.2}; {twice:.0} % | {}",
            deciles.join(" ")
        )
    }
}

fn spearman(pairs: &[[f64; 2]]) -> f64 {
    let ranks = |k: usize| {
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|&a, &b| pairs[a][k].total_cmp(&pairs[b][k]));
        let mut rank = vec![0.0; pairs.len()];
        order.iter().enumerate().for_each(|(r, &i)| rank[i] = r as f64);
        rank
    };
    let (a, b) = (ranks(0), ranks(1));
    let middle = 0.5 * (pairs.len() as f64 - 1.0);
    let product = |x: &[f64], y: &[f64]| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - middle) * (y - middle)).sum()
    };
    product(&a, &b) / product(&a, &a).max(f64::MIN_POSITIVE)
}
