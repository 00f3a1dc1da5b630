//! The normal matrix renumbered for little fill: one ordering of the vertices serves every
//! factorisation over them.

use super::cholesky::CholeskyError;
use super::pattern::Pattern;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMat;
use faer::sparse::linalg::amd;

/// No block.
pub(super) const NONE: u32 = u32::MAX;

/// One block of the renumbered lower triangle and where its parts are kept.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    /// Row in the new numbering.
    pub row: u32,
    /// Block of the general part, or [`NONE`].
    pub near: u32,
    /// Block of the isotropic part, or [`NONE`].
    pub smooth: u32,
    /// Whether the block is the transpose of the one kept.
    pub flipped: bool,
}

/// The union of two patterns under an approximate minimum degree ordering.
pub(super) struct Ordered {
    /// Old number of every new vertex.
    pub order: Vec<u32>,
    /// First entry of every new column, and the count last.
    pub columns: Vec<usize>,
    /// Entries, rows ascending in a column.
    pub entries: Vec<Entry>,
}

impl Ordered {
    pub(super) fn new(near: &Pattern, smooth: &Pattern) -> Result<Self, CholeskyError> {
        let union = near.union(smooth);
        let order = minimum_degree(&union)?;
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(new, &old)| place[old as usize] = new as u32);
        let mut columns = vec![0; order.len() + 1];
        let placed: Vec<(u32, Entry)> = union
            .iter()
            .map(|(r, c)| {
                let (i, j) = (place[r as usize], place[c as usize]);
                let kept = |p: &Pattern| p.find(r, c).map_or(NONE, |k| k as u32);
                let flipped = i < j;
                let entry =
                    Entry { row: i.max(j), near: kept(near), smooth: kept(smooth), flipped };
                columns[i.min(j) as usize + 1] += 1;
                (i.min(j), entry)
            })
            .collect();
        for j in 0..order.len() {
            columns[j + 1] += columns[j];
        }
        let empty = Entry { row: 0, near: NONE, smooth: NONE, flipped: false };
        let (mut next, mut entries) = (columns.clone(), vec![empty; placed.len()]);
        for (column, entry) in placed {
            entries[next[column as usize]] = entry;
            next[column as usize] += 1;
        }
        for j in 0..order.len() {
            entries[columns[j]..columns[j + 1]].sort_unstable_by_key(|e| e.row);
        }
        Ok(Self { order, columns, entries })
    }

    /// Number of vertices.
    pub(super) fn len(&self) -> usize {
        self.order.len()
    }

    /// Entries of a column, the diagonal first.
    pub(super) fn column(&self, j: usize) -> &[Entry] {
        &self.entries[self.columns[j]..self.columns[j + 1]]
    }

    /// Column pointers and row indices of the scalar lower triangle with `size` unknowns a vertex.
    pub(super) fn scalar(&self, size: usize) -> (Vec<usize>, Vec<usize>) {
        let (mut col_ptr, mut row_idx) = (vec![0], Vec::new());
        for j in 0..self.len() {
            for c in 0..size {
                for entry in self.column(j) {
                    let row = entry.row as usize;
                    row_idx.extend((if row == j { c } else { 0 }..size).map(|r| size * row + r));
                }
                col_ptr.push(row_idx.len());
            }
        }
        (col_ptr, row_idx)
    }
}

/// Approximate minimum degree ordering: the old number of every new vertex.
fn minimum_degree(pattern: &Pattern) -> Result<Vec<u32>, CholeskyError> {
    let n = pattern.vertices();
    let (mut col_ptr, mut row_idx) = (vec![0; n + 1], Vec::with_capacity(pattern.len()));
    for (row, column) in pattern.iter() {
        row_idx.push(row as usize);
        col_ptr[column as usize + 1] = row_idx.len();
    }
    let nnz = row_idx.len();
    let matrix = SymbolicSparseColMat::new_checked(n, n, col_ptr, None, row_idx);
    let (mut order, mut place) = (vec![0usize; n], vec![0usize; n]);
    let scratch = amd::order_maybe_unsorted_scratch::<usize>(n, nnz);
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| CholeskyError::Symbolic)?;
    amd::order_maybe_unsorted(
        &mut order,
        &mut place,
        matrix.as_ref(),
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .map_err(|_| CholeskyError::Symbolic)?;
    Ok(order.into_iter().map(|v| v as u32).collect())
}
