//! The nearest of some hundreds of points, without a tree: sorted along one axis, only those
//! between which and the point lies less than the distance of what is found are looked at.

/// Points in order of their first coordinate.
#[doc(alias("kd-tree", "k nearest neighbours"))]
#[derive(Clone, Debug)]
pub struct Neighbours<const D: usize> {
    /// Points with their indices.
    sorted: Vec<([f64; D], usize)>,
    /// Where every point stands among them.
    place: Vec<usize>,
}

impl<const D: usize> Neighbours<D> {
    /// Of these points.
    pub fn of(points: Vec<[f64; D]>) -> Self {
        let mut sorted: Vec<_> = points.into_iter().zip(0..).collect();
        sorted.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]));
        let mut place = vec![0; sorted.len()];
        sorted.iter().enumerate().for_each(|(at, point)| place[point.1] = at);
        Self { sorted, place }
    }

    /// Indices of the `count` points nearest to point `i`, the nearest first; of two as near, the
    /// earlier.
    pub fn nearest(&self, i: usize, count: usize) -> Vec<usize> {
        let mut found: Vec<(f64, usize)> = Vec::with_capacity(count + 1);
        let (mut before, after) = self.sorted.split_at(self.place[i]);
        let own = after.split_first().filter(|_| count > 0);
        let Some(((at, _), mut after)) = own else { return Vec::new() };
        let along = |other: &([f64; D], usize)| (other.0[0] - at[0]).powi(2);
        // What is farther than this is none of them.
        let mut farthest = f64::INFINITY;
        loop {
            let other = match (before, after) {
                ([rest @ .., b], [a, ..]) if along(b) < along(a) => {
                    before = rest;
                    b
                }
                (_, [a, rest @ ..]) => {
                    after = rest;
                    a
                }
                ([rest @ .., b], []) => {
                    before = rest;
                    b
                }
                ([], []) => break,
            };
            if along(other) > farthest {
                break;
            }
            let away: f64 = (0..D).map(|k| (other.0[k] - at[k]).powi(2)).sum();
            if away > farthest {
                continue;
            }
            let place = found.partition_point(|f| *f < (away, other.1));
            found.insert(place, (away, other.1));
            found.truncate(count);
            if let Some(last) = found.get(count - 1) {
                farthest = last.0;
            }
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
