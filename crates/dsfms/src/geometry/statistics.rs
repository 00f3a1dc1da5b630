//! Order statistics that every stage needs.

/// The upper median; reorders `values`. `None` of nothing.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    let found =
        (middle < values.len()).then(|| values.select_nth_unstable_by(middle, f64::total_cmp));
    found.map(|(_, &mut median, _)| median)
}

/// Indices of the `count` nearest of `others`, the nearest first; of two as near, the earlier.
pub fn nearest(
    count: usize,
    others: impl Iterator<Item = usize>,
    distance: impl Fn(usize) -> f64,
) -> Vec<usize> {
    let mut found: Vec<(f64, usize)> = Vec::with_capacity(count + 1);
    for other in others {
        let away = distance(other);
        if found.len() < count || found.last().is_some_and(|last| away < last.0) {
            let place = found.partition_point(|f| f.0 <= away);
            found.insert(place, (away, other));
            found.truncate(count);
        }
    }
    found.into_iter().map(|f| f.1).collect()
}

/// Median, and the standard deviation of a normal distribution with the same median absolute
/// deviation; reorders `values`. Both 0 of nothing.
pub fn centre_and_spread(values: &mut [f64]) -> (f64, f64) {
    let centre = median(values).unwrap_or(0.0);
    let mut deviations: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
    (centre, 1.4826 * median(&mut deviations).unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_come_in_order() {
        let places = [5.0_f64, 1.0, 4.0, 1.0, 9.0];
        let away = |i: usize| places[i].abs();
        assert_eq!(nearest(3, 0..5, away), [1, 3, 2]);
        assert_eq!(nearest(9, [4, 0].into_iter(), away), [0, 4]);
        assert!(nearest(0, 0..5, away).is_empty());
    }

    #[test]
    fn one_outlier_moves_neither() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0]), Some(4.0));
        assert_eq!(median(&mut []), None);
        let (centre, spread) = centre_and_spread(&mut [1.0, 2.0, 3.0, 4.0, 1e9]);
        assert_eq!((centre, spread), (3.0, 1.4826));
    }
}
