//! Edges, boundary and pieces of bare faces, which need not make a [`Topology`](super::Topology)
//! yet: no edge has more than two of them.

use crate::geometry::DisjointSets;
use std::collections::BTreeMap;

/// Label of the piece of each face: the smallest face index in it.
pub(crate) fn pieces(faces: &[[u32; 3]]) -> Vec<u32> {
    let mut sets = DisjointSets::new(faces.len());
    for pair in edge_list(faces).windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        sets.join(pair[0].1, pair[1].1);
    }
    (0..faces.len() as u32).map(|f| sets.root(f)).collect()
}

/// Undirected edges with their faces, sorted.
pub(crate) fn edge_list(faces: &[[u32; 3]]) -> Vec<([u32; 2], u32)> {
    let sides = faces.iter().zip(0..).flat_map(|(&[a, b, c], f)| {
        [(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), (p.max(q), f)))
    });
    let (starts, mut ends) = by_first(sides.clone());
    let mut edges = Vec::with_capacity(ends.len());
    for (v, range) in starts.windows(2).enumerate() {
        let around = &mut ends[range[0]..range[1]];
        around.sort_unstable();
        edges.extend(around.iter().map(|&(w, f)| ([v as u32, w], f)));
    }
    edges
}

/// Directed edges `[from, to]` with a face on one side only, sorted.
pub(crate) fn boundary_edges(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let directed = faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let (starts, ends) = by_first(directed.clone());
    let from = |v: u32| match starts.get(v as usize..v as usize + 2) {
        Some(range) => &ends[range[0]..range[1]],
        None => &[],
    };
    let mut alone: Vec<[u32; 2]> =
        directed.filter(|(a, b)| !from(*b).contains(a)).map(|(a, b)| [a, b]).collect();
    alone.sort_unstable();
    alone
}

/// Boundary loops in the direction of their faces, each begun at its smallest vertex. Expects one
/// fan a vertex; [`boundary_loops`](super::boundary::boundary_loops) takes any surface.
pub(crate) fn simple_loops(faces: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let mut next: BTreeMap<u32, u32> = boundary_edges(faces).iter().map(|e| (e[0], e[1])).collect();
    let mut loops = Vec::new();
    while let Some((&start, _)) = next.first_key_value() {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(to) = next.remove(&at) {
            ring.push(at);
            at = to;
        }
        loops.push(ring);
    }
    loops
}

/// Pairs gathered by their first (a counting sort): where those of each begin, and the seconds. A
/// surface has few edges at a vertex, so that looking through them is faster than a sorted list of
/// all.
fn by_first<T: Copy + Default>(
    pairs: impl Iterator<Item = (u32, T)> + Clone,
) -> (Vec<usize>, Vec<T>) {
    let count = pairs.clone().map(|(v, _)| v as usize + 1).max().unwrap_or(0);
    let mut starts = vec![0; count + 1];
    pairs.clone().for_each(|(v, _)| starts[v as usize + 1] += 1);
    (0..count).for_each(|v| starts[v + 1] += starts[v]);
    let mut next = starts.clone();
    let mut seconds = vec![T::default(); starts[count]];
    for (v, second) in pairs {
        seconds[next[v as usize]] = second;
        next[v as usize] += 1;
    }
    (starts, seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_sorted_with_their_faces() {
        let edges = edge_list(&[[2, 1, 3], [0, 1, 2]]);
        let expected =
            [([0, 1], 1), ([0, 2], 1), ([1, 2], 0), ([1, 2], 1), ([1, 3], 0), ([2, 3], 0)];
        assert_eq!(edges, expected);
        assert!(edge_list(&[]).is_empty() && boundary_edges(&[]).is_empty());
    }

    #[test]
    fn boundary_of_two_triangles() {
        assert_eq!(boundary_edges(&[[0, 1, 2], [2, 1, 3]]), vec![[0, 1], [1, 3], [2, 0], [3, 2]]);
    }
}
