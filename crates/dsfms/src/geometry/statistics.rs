//! Order statistics that every stage needs.

/// The upper median; reorders `values`. `None` of nothing.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    let found =
        (middle < values.len()).then(|| values.select_nth_unstable_by(middle, f64::total_cmp));
    found.map(|(_, &mut median, _)| median)
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
    fn one_outlier_moves_neither() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0]), Some(4.0));
        assert_eq!(median(&mut []), None);
        let (centre, spread) = centre_and_spread(&mut [1.0, 2.0, 3.0, 4.0, 1e9]);
        assert_eq!((centre, spread), (3.0, 1.4826));
    }
}
