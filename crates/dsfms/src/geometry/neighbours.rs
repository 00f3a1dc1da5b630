//! The nearest of some hundreds of points, by a k-d tree.

/// A point with its index.
type Indexed<const D: usize> = ([f64; D], usize);

/// So few points are looked at one by one.
const LEAF: usize = 8;

/// Points as a k-d tree: the middle one parts the others along one axis, each half is parted along
/// the next.
#[doc(alias("kd-tree", "k nearest neighbours"))]
#[derive(Clone, Debug)]
pub struct Neighbours<const D: usize> {
    tree: Vec<Indexed<D>>,
    /// Where every point stands in it.
    place: Vec<usize>,
}

impl<const D: usize> Neighbours<D> {
    /// Of these points.
    pub fn of(points: Vec<[f64; D]>) -> Self {
        let mut tree: Vec<_> = points.into_iter().zip(0..).collect();
        part(&mut tree, 0);
        let mut place = vec![0; tree.len()];
        tree.iter().enumerate().for_each(|(at, point)| place[point.1] = at);
        Self { tree, place }
    }

    /// Indices of the `count` points nearest to point `i`, the nearest first; of two as near, the
    /// earlier.
    pub fn nearest(&self, i: usize, count: usize) -> Vec<usize> {
        let found = Vec::with_capacity(count + 1);
        let of = self.tree[self.place[i]];
        let mut nearest = Nearest { of, count, found, farthest: f64::INFINITY };
        if count > 0 {
            nearest.among(&self.tree, 0);
        }
        nearest.found.into_iter().map(|f| f.1).collect()
    }
}

fn part<const D: usize>(tree: &mut [Indexed<D>], axis: usize) {
    if tree.len() > LEAF {
        let middle = tree.len() / 2;
        tree.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]));
        let (before, after) = tree.split_at_mut(middle);
        part(before, (axis + 1) % D);
        part(&mut after[1..], (axis + 1) % D);
    }
}

/// The nearest of what was looked at.
struct Nearest<const D: usize> {
    of: Indexed<D>,
    count: usize,
    /// Squared distances and indices.
    found: Vec<(f64, usize)>,
    /// What is farther than this is none of them.
    farthest: f64,
}

impl<const D: usize> Nearest<D> {
    fn among(&mut self, tree: &[Indexed<D>], axis: usize) {
        if tree.len() <= LEAF {
            return tree.iter().for_each(|point| self.look_at(point));
        }
        let (before, rest) = tree.split_at(tree.len() / 2);
        let (middle, after) = (&rest[0], &rest[1..]);
        let beyond = self.of.0[axis] - middle.0[axis];
        let [own, other] = if beyond < 0.0 { [before, after] } else { [after, before] };
        self.among(own, (axis + 1) % D);
        if beyond * beyond <= self.farthest {
            self.look_at(middle);
            self.among(other, (axis + 1) % D);
        }
    }

    fn look_at(&mut self, point: &Indexed<D>) {
        let away: f64 = (0..D).map(|k| (point.0[k] - self.of.0[k]).powi(2)).sum();
        if away > self.farthest || point.1 == self.of.1 {
            return;
        }
        let place = self.found.partition_point(|f| *f < (away, point.1));
        self.found.insert(place, (away, point.1));
        self.found.truncate(self.count);
        if let Some(last) = self.found.get(self.count - 1) {
            self.farthest = last.0;
        }
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
        let tree = Neighbours::of(points.clone());
        for i in 0..60 {
            let away = |j: &usize| {
                let d = [points[*j][0] - points[i][0], points[*j][1] - points[i][1]];
                (d[0] * d[0] + d[1] * d[1]) as u32
            };
            let mut all: Vec<usize> = (0..60).filter(|&j| j != i).collect();
            all.sort_by_key(away);
            assert_eq!(tree.nearest(i, 8), all[..8]);
        }
    }
}
