//! Which pairs of vertices meet in a residual block.

/// Which blocks of the lower triangle of a symmetric matrix over vertices can be non-zero.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pattern {
    vertices: usize,
    /// First block of every block column, and the block count last.
    columns: Vec<usize>,
    /// Block row of every block, ascending in a column, the diagonal first.
    rows: Vec<u32>,
}

impl Pattern {
    /// Blocks for every pair of vertices that share a stencil.
    pub fn new<'a>(vertices: usize, stencils: impl Iterator<Item = &'a [u32]>) -> Self {
        let stencils: Vec<&[u32]> = stencils.collect();
        let (first, uses) = incidence(vertices, &stencils);
        let (mut columns, mut rows) = (Vec::with_capacity(vertices + 1), Vec::new());
        let mut seen = vec![u32::MAX; vertices];
        columns.push(0);
        for column in 0..vertices as u32 {
            let start = rows.len();
            rows.push(column);
            let around = &uses[first[column as usize]..first[column as usize + 1]];
            for &row in around.iter().flat_map(|&s| stencils[s as usize]) {
                if row > column && seen[row as usize] != column {
                    seen[row as usize] = column;
                    rows.push(row);
                }
            }
            rows[start..].sort_unstable();
            columns.push(rows.len());
        }
        Self { vertices, columns, rows }
    }

    /// The blocks of either.
    pub fn union(&self, other: &Self) -> Self {
        let pairs = |p: &Self| -> Vec<[u32; 2]> { p.iter().map(|(r, c)| [r, c]).collect() };
        let (mine, theirs) = (pairs(self), pairs(other));
        Self::new(self.vertices, mine.iter().chain(&theirs).map(|pair| &pair[..]))
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.vertices
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no block.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Row and column of every block, column after column.
    pub fn iter(&self) -> impl Iterator<Item = (u32, u32)> {
        (0..self.vertices).flat_map(move |column| {
            self.column(column).1.iter().map(move |&row| (row, column as u32))
        })
    }

    /// First block and block rows of a column.
    pub fn column(&self, column: usize) -> (usize, &[u32]) {
        let range = self.columns[column]..self.columns[column + 1];
        (range.start, &self.rows[range])
    }

    /// Index of the block of two vertices, whichever is larger; `None` where it is always zero.
    pub fn find(&self, a: u32, b: u32) -> Option<usize> {
        let (row, column) = (a.max(b), a.min(b) as usize);
        let range = *self.columns.get(column)?..*self.columns.get(column + 1)?;
        self.rows[range.clone()].binary_search(&row).ok().map(|k| range.start + k)
    }
}

/// The stencils around every vertex, as a start for each and one list.
fn incidence(vertices: usize, stencils: &[&[u32]]) -> (Vec<usize>, Vec<u32>) {
    let mut first = vec![0; vertices + 1];
    stencils.iter().flat_map(|s| *s).for_each(|&v| first[v as usize + 1] += 1);
    for v in 0..vertices {
        first[v + 1] += first[v];
    }
    let (mut next, mut uses) = (first.clone(), vec![0; first[vertices]]);
    for (s, stencil) in stencils.iter().enumerate() {
        for &v in *stencil {
            uses[next[v as usize]] = s as u32;
            next[v as usize] += 1;
        }
    }
    (first, uses)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_two_stencils_by_hand() {
        let stencils: [&[u32]; 2] = [&[2, 0], &[1, 2, 3]];
        let pattern = Pattern::new(4, stencils.into_iter());
        let blocks: Vec<_> = pattern.iter().collect();
        assert_eq!(blocks, [(0, 0), (2, 0), (1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (3, 3)]);
        assert_eq!(pattern.find(0, 2), Some(1));
        assert_eq!(pattern.find(0, 3), None);
        let other: [&[u32]; 1] = [&[0, 3]];
        let union = pattern.union(&Pattern::new(4, other.into_iter()));
        assert_eq!(union.len(), pattern.len() + 1);
        assert!(union.find(3, 0).is_some());
    }
}
