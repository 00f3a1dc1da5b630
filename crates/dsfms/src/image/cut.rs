//! The minimum cut between two terminals (Boykov, Kolmogorov 2004): the least of an energy of two
//! labels.
//!
//! `E(x) = Σ_p cost_p(x_p) + Σ_(p,q) w_pq [x_p ≠ x_q]`, costs and weights whole numbers, so that
//! the cut is exact. Two trees grow from the terminals over arcs with capacity left. Where they
//! meet, a path carries what it can; what hung on the arcs that are full then is adopted by its own
//! tree or set free.

use std::collections::VecDeque;

/// A graph whose nodes take one of two labels.
pub(crate) struct Graph {
    /// Arc `2e` leads along edge `e`, arc `2e + 1` back.
    head: Vec<u32>,
    weight: Vec<i32>,
    /// Arcs of node `v`: `arcs[first[v]..first[v + 1]]`.
    first: Vec<u32>,
    arcs: Vec<u32>,
}

/// What a node hangs on.
#[derive(Clone, Copy, PartialEq)]
enum Parent {
    Terminal,
    /// The arc that leads to the parent.
    Arc(u32),
    None,
}

impl Graph {
    /// Nodes and what different labels of two of them cost.
    pub(crate) fn new(nodes: usize, edges: impl Iterator<Item = (u32, u32, i32)>) -> Self {
        let (mut head, mut weight) = (Vec::new(), Vec::new());
        for (p, q, cost) in edges {
            head.extend([q, p]);
            weight.extend([cost; 2]);
        }
        let mut first = vec![0u32; nodes + 1];
        // The tail of an arc is the head of its sister.
        head.iter().for_each(|&v| first[v as usize + 1] += 1);
        (0..nodes).for_each(|v| first[v + 1] += first[v]);
        let (mut next, mut arcs) = (first.clone(), vec![0u32; head.len()]);
        for arc in 0..head.len() {
            let tail = head[arc ^ 1] as usize;
            arcs[next[tail] as usize] = arc as u32;
            next[tail] += 1;
        }
        Self { head, weight, first, arcs }
    }

    /// The labels of least energy; of equal ones those with fewest `true`. `favour`: what the label
    /// `true` saves at each node, less what `false` does.
    pub(crate) fn labels(&self, favour: Vec<i32>) -> Vec<bool> {
        let mut flow = Flow::new(self, favour);
        while let Some(arc) = flow.grow() {
            flow.augment(arc);
            flow.adopt();
        }
        flow.tree.iter().map(|&t| t == Some(true)).collect()
    }
}

struct Flow<'a> {
    graph: &'a Graph,
    /// What is left of the nodes' favour and of the arcs' weight.
    favour: Vec<i32>,
    left: Vec<i32>,
    /// The tree that a node belongs to: `true` that of the source.
    tree: Vec<Option<bool>>,
    parent: Vec<Parent>,
    /// Steps to the terminal, and when that was known.
    distance: Vec<(u32, u32)>,
    now: u32,
    active: VecDeque<u32>,
    queued: Vec<bool>,
    orphans: Vec<u32>,
}

impl<'a> Flow<'a> {
    fn new(graph: &'a Graph, favour: Vec<i32>) -> Self {
        let n = favour.len();
        let tree: Vec<Option<bool>> = favour.iter().map(|&f| (f != 0).then_some(f > 0)).collect();
        let parent = tree.iter().map(|t| t.map_or(Parent::None, |_| Parent::Terminal)).collect();
        let active = (0..n as u32).filter(|&v| tree[v as usize].is_some()).collect();
        let queued = tree.iter().map(Option::is_some).collect();
        let (distance, orphans) = (vec![(1, 0); n], Vec::new());
        let left = graph.weight.clone();
        Self { graph, favour, left, tree, parent, distance, now: 0, active, queued, orphans }
    }

    fn arcs_of(&self, v: u32) -> &'a [u32] {
        let first = &self.graph.first;
        &self.graph.arcs[first[v as usize] as usize..first[v as usize + 1] as usize]
    }

    /// What an arc out of a node can still carry in the direction of its tree's flow.
    fn open(&self, source: bool, arc: u32) -> bool {
        self.left[(if source { arc } else { arc ^ 1 }) as usize] > 0
    }

    fn wake(&mut self, v: u32) {
        if !std::mem::replace(&mut self.queued[v as usize], true) {
            self.active.push_back(v);
        }
    }

    /// Grow the trees until they meet: the arc from the source's to the sink's.
    fn grow(&mut self) -> Option<u32> {
        while let Some(&p) = self.active.front() {
            if let Some(source) = self.tree[p as usize] {
                for &arc in self.arcs_of(p) {
                    if !self.open(source, arc) {
                        continue;
                    }
                    let q = self.graph.head[arc as usize];
                    let (steps, when) = self.distance[p as usize];
                    match self.tree[q as usize] {
                        None => {
                            self.tree[q as usize] = Some(source);
                            self.parent[q as usize] = Parent::Arc(arc ^ 1);
                            self.distance[q as usize] = (steps + 1, when);
                            self.wake(q);
                        }
                        Some(other) if other != source => {
                            return Some(if source { arc } else { arc ^ 1 });
                        }
                        Some(_) => {}
                    }
                }
            }
            self.active.pop_front();
            self.queued[p as usize] = false;
        }
        None
    }

    /// Send what the path over an arc between the trees can carry.
    fn augment(&mut self, arc: u32) {
        let ends =
            [(true, self.graph.head[(arc ^ 1) as usize]), (false, self.graph.head[arc as usize])];
        let mut most = self.left[arc as usize];
        for (source, end) in ends {
            let mut v = end;
            while let Parent::Arc(up) = self.parent[v as usize] {
                most = most.min(self.left[(if source { up ^ 1 } else { up }) as usize]);
                v = self.graph.head[up as usize];
            }
            most = most.min(self.favour[v as usize].abs());
        }
        self.carry(arc, most);
        self.now += 1;
        for (source, end) in ends {
            let mut v = end;
            while let Parent::Arc(up) = self.parent[v as usize] {
                let along = if source { up ^ 1 } else { up };
                self.carry(along, most);
                if self.left[along as usize] == 0 {
                    self.orphan(v);
                }
                v = self.graph.head[up as usize];
            }
            let favour = &mut self.favour[v as usize];
            *favour -= favour.signum() * most;
            if *favour == 0 {
                self.orphan(v);
            }
        }
    }

    fn carry(&mut self, arc: u32, flow: i32) {
        self.left[arc as usize] -= flow;
        self.left[(arc ^ 1) as usize] += flow;
    }

    fn orphan(&mut self, v: u32) {
        self.parent[v as usize] = Parent::None;
        self.orphans.push(v);
    }

    /// Find new parents for the orphans, nearest to the terminal first; set free what finds none.
    fn adopt(&mut self) {
        while let Some(v) = self.orphans.pop() {
            let Some(source) = self.tree[v as usize] else { continue };
            let mut best: Option<(u32, u32)> = None;
            for &arc in self.arcs_of(v) {
                let q = self.graph.head[arc as usize];
                if self.tree[q as usize] == Some(source)
                    && self.open(source, arc ^ 1)
                    && let Some(steps) = self.steps(q)
                    && best.is_none_or(|(least, _)| steps < least)
                {
                    best = Some((steps, arc));
                }
            }
            match best {
                Some((steps, arc)) => {
                    self.parent[v as usize] = Parent::Arc(arc);
                    self.distance[v as usize] = (steps + 1, self.now);
                }
                None => self.set_free(v, source),
            }
        }
    }

    /// Steps from a node to its terminal; `None` where it hangs on an orphan.
    fn steps(&mut self, q: u32) -> Option<u32> {
        let (mut v, mut walked) = (q, 0);
        let total = loop {
            let (steps, when) = self.distance[v as usize];
            match self.parent[v as usize] {
                Parent::None => return None,
                _ if when == self.now => break walked + steps,
                Parent::Terminal => break walked + 1,
                Parent::Arc(up) => {
                    v = self.graph.head[up as usize];
                    walked += 1;
                }
            }
        };
        // What was walked is known now.
        let (mut v, mut steps) = (q, total);
        while self.distance[v as usize].1 != self.now {
            self.distance[v as usize] = (steps, self.now);
            let Parent::Arc(up) = self.parent[v as usize] else { break };
            v = self.graph.head[up as usize];
            steps -= 1;
        }
        Some(total)
    }

    fn set_free(&mut self, v: u32, source: bool) {
        for &arc in self.arcs_of(v) {
            let q = self.graph.head[arc as usize];
            if self.tree[q as usize] != Some(source) {
                continue;
            }
            if self.open(source, arc ^ 1) {
                self.wake(q);
            }
            if self.parent[q as usize] == Parent::Arc(arc ^ 1) {
                self.orphan(q);
            }
        }
        self.tree[v as usize] = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn energy(favour: &[i32], edges: &[(u32, u32, i32)], labels: &[bool]) -> i32 {
        let own: i32 = favour.iter().zip(labels).map(|(f, l)| if *l { -f } else { 0 }).sum();
        let cut = |&&(p, q, _): &&(u32, u32, i32)| labels[p as usize] != labels[q as usize];
        own + edges.iter().filter(cut).map(|e| e.2).sum::<i32>()
    }

    fn solved(favour: &[i32], edges: &[(u32, u32, i32)]) -> Vec<bool> {
        Graph::new(favour.len(), edges.iter().copied()).labels(favour.to_vec())
    }

    #[test]
    fn a_chain_is_cut_at_its_weakest_link() {
        let edges = [(0, 1, 5), (1, 2, 2), (2, 3, 5)];
        assert_eq!(solved(&[9, 0, 0, -9], &edges), [true, true, false, false]);
        // Too strong a chain follows the stronger end.
        let edges = [(0, 1, 50), (1, 2, 50), (2, 3, 50)];
        assert_eq!(solved(&[9, 0, 0, -8], &edges), [true; 4]);
        assert_eq!(solved(&[9, 0, 0, -10], &edges), [false; 4]);
    }

    #[test]
    fn no_labels_of_small_graphs_cost_less() {
        let mut state = 7u64;
        let mut draw = |n: u64| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % n
        };
        for _ in 0..300 {
            let n = 2 + draw(9) as usize;
            let favour: Vec<i32> = (0..n).map(|_| draw(21) as i32 - 10).collect();
            let edges: Vec<(u32, u32, i32)> = (0..3 * n)
                .map(|_| (draw(n as u64) as u32, draw(n as u64) as u32, draw(8) as i32))
                .filter(|e| e.0 != e.1)
                .collect();
            let found = energy(&favour, &edges, &solved(&favour, &edges));
            let all =
                (0..1usize << n).map(|bits| (0..n).map(|v| bits >> v & 1 == 1).collect::<Vec<_>>());
            let least = all.map(|labels| energy(&favour, &edges, &labels)).min().unwrap();
            assert_eq!(found, least, "{favour:?} {edges:?}");
        }
    }
}
