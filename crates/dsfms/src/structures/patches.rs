//! Vertices grouped into patches of about the same size.

use crate::geometry::Point3;

/// At most `count` groups around vertices spread by farthest-point sampling; every vertex belongs
/// to the nearest of them. Groups are never empty.
pub(crate) fn patches(points: &[Point3], count: usize) -> Vec<Vec<u32>> {
    let mut seeds = Vec::new();
    let mut nearest = vec![(f64::INFINITY, 0u32); points.len()];
    let mut next = (!points.is_empty()).then_some(0);
    while let Some(seed) = next.filter(|_| seeds.len() < count) {
        let place = seeds.len() as u32;
        seeds.push(seed);
        for (p, near) in points.iter().zip(&mut nearest) {
            let d = (p - points[seed]).norm_squared();
            if d < near.0 {
                *near = (d, place);
            }
        }
        let farthest = (0..points.len()).max_by(|&a, &b| nearest[a].0.total_cmp(&nearest[b].0));
        // Copies of one point make one group.
        next = farthest.filter(|&v| nearest[v].0 > 0.0);
    }
    let mut groups = vec![Vec::new(); seeds.len()];
    for (v, (_, place)) in (0..).zip(&nearest) {
        groups[*place as usize].push(v);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_vertex_is_in_one_group() {
        let points: Vec<Point3> = (0..40).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        let groups = patches(&points, 5);
        assert_eq!(groups.len(), 5);
        let mut all: Vec<u32> = groups.concat();
        all.sort_unstable();
        assert_eq!(all, (0..40).collect::<Vec<u32>>());
        assert!(groups.iter().all(|g| (4..=12).contains(&g.len())), "{groups:?}");
    }

    #[test]
    fn copies_of_a_point_are_one_group() {
        assert_eq!(patches(&[Point3::origin(); 3], 5).len(), 1);
        assert!(patches(&[], 5).is_empty());
    }
}
