//! The nearest of some hundreds of points, without a tree: sorted along one axis, only those between
//! which and the point lies less than the distance of what is found are looked at.

/// Points in order of their first coordinate.
#[doc(alias("kd-tree", "k nearest neighbours"))]
#[derive(Clone, Debug)]
pub struct Neighbours<const D: usize> {
    points: Vec<[f64; D]>,
    order: Vec<usize>,
    /// Where every point stands in the order.
    place: Vec<usize>,
}

impl<const D: usize> Neighbours<D> {
    /// Of these points.
    pub fn of(points: Vec<[f64; D]>) -> Self {
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|&a, &b| points[a][0].total_cmp(&points[b][0]));
        let mut place = vec![0; points.len()];
        order.iter().enumerate().for_each(|(at, &i)| place[i] = at);
        Self { points, order, place }
    }

    /// Indices of the `count` points nearest to point `i`, the nearest first; of two as near, the
    /// earlier.
    pub fn nearest(&self, i: usize, count: usize) -> Vec<usize> {
        let mut found: Vec<(f64, usize)> = Vec::with_capacity(count + 1);
        let at = &self.points[i];
        let along = |other: usize| (self.points[other][0] - at[0]).powi(2);
        let (mut before, mut after) = self.order.split_at(self.place[i]);
        after = &after[1..];
        loop {
            let other = match (before, after) {
                ([rest @ .., b], [a, ..]) if along(*b) < along(*a) => {
                    before = rest;
                    *b
                }
                (_, [a, rest @ ..]) => {
                    after = rest;
                    *a
                }
                ([rest @ .., b], []) => {
                    before = rest;
                    *b
                }
                ([], []) => break,
            };
            let farthest = found.last().map_or(f64::NEG_INFINITY, |f| f.0);
            if found.len() >= count && along(other) > farthest {
                break;
            }
            let away: f64 = (0..D).map(|k| (self.points[other][k] - at[k]).powi(2)).sum();
            let place = found.partition_point(|f| *f < (away, other));
            found.insert(place, (away, other));
            found.truncate(count);
        }
        found.into_iter().map(|f| f.1).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_come_in_order() {
        let points = Neighbours::of([5.0, 1.0, 4.0, 1.0, 9.0, 0.0].map(|x| [x]).to_vec());
        assert_eq!(points.nearest(5, 3), [1, 3, 2]);
        assert_eq!(points.nearest(4, 9), [0, 2, 1, 3, 5]);
        assert!(points.nearest(0, 0).is_empty());
        assert!(Neighbours::of(vec![[1.0, 2.0]]).nearest(0, 4).is_empty());
    }

    #[test]
    fn they_are_those_of_a_search_through_all() {
        let points: Vec<[f64; 2]> =
            (0..60).map(|i| [f64::from(i * 37 % 11), f64::from(i * 23 % 13)]).collect();
        let sorted = Neighbours::of(points.clone());
        for i in 0..60 {
            let away = |j: &usize| {
                let d = [points[*j][0] - points[i][0], points[*j][1] - points[i][1]];
                (d[0] * d[0] + d[1] * d[1]) as u32
            };
            let mut all: Vec<usize> = (0..60).filter(|&j| j != i).collect();
            all.sort_by_key(away);
            assert_eq!(sorted.nearest(i, 8), all[..8]);
        }
    }
}
