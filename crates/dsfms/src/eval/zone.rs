//! The deformed zone: the part of the organ that moved most.

use crate::geometry::{Point3, align_rigid};

/// Share of the largest displacement from which a vertex belongs to the zone.
const ZONE_SHARE: f64 = 0.5;
/// Displacements up to this share of the surface's extent are no deformation: an empty zone.
const STILL: f64 = 1e-3;

/// Vertices displaced by at least half of the largest displacement among the visible ones (among
/// all, where visibility is not known). Empty where nothing moved by more than a thousandth of
/// `extent`, the diagonal of the surface's bounding box.
pub fn deformed_zone(displacement: &[f64], visible: Option<&[bool]>, extent: f64) -> Vec<bool> {
    let seen = |i: &usize| visible.is_none_or(|v| v[*i]);
    let largest = (0..displacement.len()).filter(seen).map(|i| displacement[i]).fold(0.0, f64::max);
    let still = largest <= STILL * extent;
    displacement.iter().map(|&d| !still && d >= ZONE_SHARE * largest).collect()
}

/// Distance of every vertex from its place in the rest surface, after the rest surface was moved
/// rigidly onto the part of the deformed one that moved least: six refits, each to the closer half
/// of the vertices. `None` for fewer than three vertices, or lists of different lengths.
pub fn displacement_from_rest(rest: &[Point3], deformed: &[Point3]) -> Option<Vec<f64>> {
    let mut motion = align_rigid(rest, deformed)?;
    for _ in 0..6 {
        let mut order: Vec<usize> = (0..rest.len()).collect();
        let distance = |&i: &usize| (motion * rest[i] - deformed[i]).norm();
        order.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        order.truncate((rest.len() / 2).max(3));
        let pick = |points: &[Point3]| order.iter().map(|&i| points[i]).collect::<Vec<_>>();
        match align_rigid(&pick(rest), &pick(deformed)) {
            Some(refit) => motion = refit,
            None => break,
        }
    }
    Some(rest.iter().zip(deformed).map(|(r, d)| (motion * r - d).norm()).collect())
}

/// Diagonal of the bounding box.
pub fn extent(points: &[Point3]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let (low, high) =
        points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    (high - low).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Isometry, Vector3};

    #[test]
    fn half_of_the_largest_visible_displacement() {
        let d = [0.0, 1.9, 2.0, 4.0, 9.0];
        let visible = [true, true, true, true, false];
        assert_eq!(deformed_zone(&d, Some(&visible), 50.0), [false, false, true, true, true]);
        assert_eq!(deformed_zone(&d, None, 50.0), [false, false, false, false, true]);
        assert_eq!(deformed_zone(&[0.01; 3], None, 50.0), [false; 3]);
    }

    #[test]
    fn displacement_ignores_a_rigid_motion() {
        let rest: Vec<Point3> = (0..40)
            .map(|i| Point3::new(f64::from(i % 8), f64::from(i / 8), f64::from(i * i % 7)))
            .collect();
        let motion = Isometry::new(Vector3::new(3.0, -1.0, 40.0), Vector3::new(0.2, 0.5, -0.1));
        let mut deformed: Vec<Point3> = rest.iter().map(|p| motion * p).collect();
        deformed[7].z += 2.0;
        let d = displacement_from_rest(&rest, &deformed).unwrap();
        assert!((d[7] - 2.0).abs() < 1e-9);
        assert!(d.iter().enumerate().all(|(i, &d)| i == 7 || d < 1e-9));
    }

    #[test]
    fn extent_is_the_diagonal() {
        assert_eq!(extent(&[Point3::origin(), Point3::new(3.0, 4.0, 0.0)]), 5.0);
    }
}
