//! Disjoint sets of numbers (union-find with path halving).

/// The numbers `0..n`, each in one set. The root of a set is its least number.
#[derive(Clone, Debug)]
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// Every number in a set of its own.
    pub fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    /// The least number of the set that holds `i`.
    pub fn root(&mut self, i: u32) -> u32 {
        let mut i = i as usize;
        while self.0[i] as usize != i {
            self.0[i] = self.0[self.0[i] as usize];
            i = self.0[i] as usize;
        }
        i as u32
    }

    /// Unite the sets of two numbers; `false` where they were one already.
    pub fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
        a != b
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_is_named_by_its_least_number_in_whatever_order_it_is_joined() {
        for pairs in [[(4, 2), (2, 5), (0, 1)], [(2, 5), (0, 1), (5, 4)]] {
            let mut sets = DisjointSets::new(6);
            assert!(pairs.iter().all(|&(a, b)| sets.join(a, b)));
            assert!(!sets.join(5, 4), "one set already");
            assert_eq!([0, 1, 2, 3, 4, 5].map(|i| sets.root(i)), [0, 0, 2, 3, 2, 2]);
        }
    }
}
