//! Tracks: features of several frames that are taken for the same point.

use super::matching::DescriptorMatch;
use crate::geometry::DisjointSets;

/// A feature of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Member {
    /// Index of the frame.
    pub view: u32,
    /// Index of the feature in that frame.
    pub feature: u32,
}

/// Matches between two frames; `a < b` are frame indices.
#[derive(Clone, Debug)]
pub struct PairMatches {
    /// First frame.
    pub a: usize,
    /// Second frame.
    pub b: usize,
    /// Matched features.
    pub matches: Vec<DescriptorMatch>,
}

/// Join matches into tracks, most alike first; a match that would put two features of one frame
/// into a track is dropped. Tracks have at least two members, sorted by view.
pub(crate) fn build_tracks(feature_counts: &[usize], pairs: &[PairMatches]) -> Vec<Vec<Member>> {
    let first: Vec<usize> = feature_counts
        .iter()
        .scan(0, |sum, n| {
            *sum += n;
            Some(*sum - n)
        })
        .collect();
    let mut edges: Vec<(f32, usize, usize)> = pairs
        .iter()
        .flat_map(|p| {
            let (a, b) = (first[p.a], first[p.b]);
            p.matches.iter().map(move |m| (m.distance, a + m.a as usize, b + m.b as usize))
        })
        .collect();
    edges.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let mut sets = Sets::new(feature_counts);
    for (_, i, j) in edges {
        sets.join(i, j);
    }
    let mut tracks: Vec<Vec<Member>> = sets.members.into_iter().filter(|m| m.len() >= 2).collect();
    tracks.iter_mut().for_each(|t| t.sort_unstable());
    tracks.sort_unstable();
    tracks
}

/// The tracks so far: disjoint sets of features, each set knowing its members.
struct Sets {
    sets: DisjointSets,
    /// At the root of each set.
    members: Vec<Vec<Member>>,
}

impl Sets {
    fn new(feature_counts: &[usize]) -> Self {
        let member = |(view, &n): (usize, &usize)| {
            (0..n).map(move |f| vec![Member { view: view as u32, feature: f as u32 }])
        };
        let members: Vec<_> = feature_counts.iter().enumerate().flat_map(member).collect();
        Self { sets: DisjointSets::new(members.len()), members }
    }

    /// Unite two sets unless they share a view.
    fn join(&mut self, i: usize, j: usize) {
        let [i, j] = [i, j].map(|k| self.sets.root(k as u32) as usize);
        let shares =
            |a: &[Member], b: &[Member]| a.iter().any(|m| b.iter().any(|n| n.view == m.view));
        if i == j || shares(&self.members[i], &self.members[j]) {
            return;
        }
        self.sets.join(i as u32, j as u32);
        let moved = std::mem::take(&mut self.members[i.max(j)]);
        self.members[i.min(j)].extend(moved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(a: usize, b: usize, matches: &[(u32, u32, f32)]) -> PairMatches {
        let matches =
            matches.iter().map(|&(a, b, distance)| DescriptorMatch { a, b, distance }).collect();
        PairMatches { a, b, matches }
    }

    #[test]
    fn the_weaker_of_two_contradicting_matches_is_dropped() {
        // Feature 0 of frames 0, 1, 2 form a chain; the last match would add feature 1 of frame 0.
        let pairs =
            [pair(0, 1, &[(0, 0, 0.1)]), pair(1, 2, &[(0, 0, 0.2)]), pair(0, 2, &[(1, 0, 0.3)])];
        let tracks = build_tracks(&[2, 1, 1], &pairs);
        let member = |view, feature| Member { view, feature };
        assert_eq!(tracks, [vec![member(0, 0), member(1, 0), member(2, 0)]]);
    }
}
