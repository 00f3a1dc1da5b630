//! Where the panels of a plate lie: every column as wide and every line as high as what it holds,
//! without holes.

/// What stands in a cell of a plate: which surface, which look.
pub type Cell = [usize; 2];

/// Cells in lines, before sizes are known.
#[derive(Clone, Debug, PartialEq)]
pub struct Arrangement {
    pub lines: Vec<Vec<Cell>>,
    pub kind: ArrangementKind,
}

/// What runs across.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrangementKind {
    /// Columns are surfaces, lines are looks.
    Surfaces,
    /// Columns are looks, lines are surfaces.
    Looks,
    /// Columns are views, lines are layers of the only surface.
    Views,
    /// Every panel has its own title.
    Turntable,
}

/// Millimetres or whatever the sheet has: room for the words around the panels.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    /// Left of the lines.
    pub left: f64,
    /// Above the first line.
    pub above: f64,
    /// Under every panel.
    pub under: f64,
    /// Between columns and between lines.
    pub gap: f64,
}

/// A plate with sizes.
#[derive(Clone, Debug)]
pub struct Layout {
    pub arrangement: Arrangement,
    /// Left ends of the cells, one list a line.
    pub lefts: Vec<Vec<f64>>,
    pub widths: Vec<Vec<f64>>,
    pub tops: Vec<f64>,
    pub heights: Vec<f64>,
    /// Of the sheet per length unit.
    pub scale: f64,
    /// Right end of the widest line, lower end of the last.
    pub size: [f64; 2],
}

/// Surfaces side by side.
pub fn surfaces_across(surfaces: usize, looks: usize) -> Arrangement {
    let line = |look| (0..surfaces).map(|s| [s, look]).collect();
    Arrangement { lines: (0..looks).map(line).collect(), kind: ArrangementKind::Surfaces }
}

/// Looks side by side.
pub fn looks_across(surfaces: usize, looks: usize) -> Arrangement {
    let line = |s| (0..looks).map(|look| [s, look]).collect();
    Arrangement { lines: (0..surfaces).map(line).collect(), kind: ArrangementKind::Looks }
}

/// Of one surface: views side by side, layers under each other.
pub fn views_across(layers: usize, views: usize) -> Arrangement {
    let line = |layer| (0..views).map(|v| [0, layer * views + v]).collect();
    Arrangement { lines: (0..layers).map(line).collect(), kind: ArrangementKind::Views }
}

/// Layers of `views` each, all around: every layer of every surface in lines of one length, or in
/// lines that differ by one panel where the number has no divisor.
pub fn turntable(surfaces: usize, layers: usize, views: usize) -> Arrangement {
    let lines = match views.div_ceil(9) {
        1 => 1,
        least => (least..=views.div_ceil(4)).find(|n| views.is_multiple_of(*n)).unwrap_or(least),
    };
    let ends: Vec<usize> = (0..=lines).map(|k| (k * views).div_ceil(lines)).collect();
    let mut all = Vec::new();
    for (s, layer) in (0..surfaces).flat_map(|s| (0..layers).map(move |l| (s, l))) {
        for ends in ends.windows(2) {
            all.push((ends[0]..ends[1]).map(|v| [s, layer * views + v]).collect());
        }
    }
    Arrangement { lines: all, kind: ArrangementKind::Turntable }
}

impl Arrangement {
    /// The largest that fits `most`; `sizes` are those of the looks, in length units.
    pub fn fitted(self, sizes: &[[f64; 2]], most: [f64; 2], room: Room) -> Layout {
        let wide = |cell: &Cell| sizes[cell[1]][0];
        let high = |line: &Vec<Cell>| line.iter().map(|c| sizes[c[1]][1]).fold(0.0, f64::max);
        let columns = self.lines.iter().map(Vec::len).max().unwrap_or(0);
        let column =
            |k: usize| self.lines.iter().filter_map(|l| l.get(k)).map(wide).fold(0.0, f64::max);
        let columns: Vec<f64> = (0..columns).map(column).collect();
        let lines: Vec<f64> = self.lines.iter().map(high).collect();
        let gaps = |n: usize| room.gap * n.saturating_sub(1) as f64;
        let free = [
            most[0] - room.left - gaps(columns.len()),
            most[1] - room.above - gaps(lines.len()) - room.under * lines.len() as f64,
        ];
        let total = [columns.iter().sum::<f64>(), lines.iter().sum::<f64>()];
        let scale = (free[0] / total[0].max(1e-12)).min(free[1] / total[1].max(1e-12)).max(1e-12);
        let right = room.left + scale * total[0] + gaps(columns.len());
        let mut layout = Layout {
            lefts: Vec::new(),
            widths: Vec::new(),
            tops: Vec::new(),
            heights: lines.iter().map(|h| h * scale).collect(),
            scale,
            size: [right, 0.0],
            arrangement: self,
        };
        let mut y = room.above;
        for (line, high) in layout.arrangement.lines.iter().zip(&lines) {
            let widths: Vec<f64> = columns[..line.len()].iter().map(|w| w * scale).collect();
            let taken = widths.iter().sum::<f64>() + gaps(widths.len());
            // A shorter line stands in the middle.
            let mut x = room.left + 0.5 * (right - room.left - taken);
            let left = |w: &f64| {
                let left = x;
                x += w + room.gap;
                left
            };
            layout.lefts.push(widths.iter().map(left).collect());
            layout.widths.push(widths);
            layout.tops.push(y);
            y += high * scale + room.under + room.gap;
        }
        layout.size[1] = y - room.gap;
        layout
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: Room = Room { left: 10.0, above: 5.0, under: 0.0, gap: 2.0 };

    #[test]
    fn a_turntable_has_no_holes() {
        for (views, lines) in
            [(4, 1), (6, 1), (8, 1), (9, 1), (10, 2), (12, 2), (16, 2), (24, 3), (36, 4)]
        {
            let all = turntable(1, 1, views).lines;
            assert_eq!(all.len(), lines, "{views}");
            assert!(all.iter().all(|l| l.len() == views / lines), "{views}: {all:?}");
        }
        // A prime: lines that differ by one.
        let lengths: Vec<usize> = turntable(1, 1, 11).lines.iter().map(Vec::len).collect();
        assert_eq!(lengths, [6, 5]);
        // Layers are not broken over lines.
        let two = turntable(1, 2, 8).lines;
        assert_eq!(two.len(), 2);
        assert!(two[1].iter().all(|c| c[1] >= 8));
    }

    #[test]
    fn columns_are_as_wide_as_what_they_hold() {
        let sizes = [[4.0, 2.0], [1.0, 2.0]];
        let layout = looks_across(2, 2).fitted(&sizes, [62.0, 500.0], ROOM);
        assert_eq!((layout.scale, layout.size), (10.0, [62.0, 47.0]));
        assert_eq!(layout.lefts, vec![vec![10.0, 52.0]; 2]);
        assert_eq!((layout.tops, layout.heights), (vec![5.0, 27.0], vec![20.0; 2]));
        // The height may be what is scarce.
        assert_eq!(looks_across(2, 2).fitted(&sizes, [62.0, 27.0], ROOM).scale, 5.0);
    }
}
