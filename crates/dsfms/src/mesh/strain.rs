//! How far a deformed surface is stretched against its rest shape.

use super::Topology;
use crate::geometry::{Point3, area};

/// The two principal stretches of a triangle, largest first; 1 = as long as at rest. `None` where
/// the triangle has no area at rest.
pub(crate) fn principal_stretches(rest: [&Point3; 3], now: [&Point3; 3]) -> Option<[f64; 2]> {
    let [e, g] = [rest[1] - rest[0], rest[2] - rest[0]];
    let [d, h] = [now[1] - now[0], now[2] - now[0]];
    let length = e.norm();
    let along = g.dot(&e) / length;
    let across = (g.norm_squared() - along * along).max(0.0).sqrt();
    if length.is_nan() || length <= 0.0 || across <= 1e-12 * length {
        return None;
    }
    // The columns of the deformation gradient in orthonormal axes of the triangle at rest.
    let u = d / length;
    let w = (h - u * along) / across;
    let (a, b, c) = (u.norm_squared(), u.dot(&w), w.norm_squared());
    let (mean, gap) = (0.5 * (a + c), (0.25 * (a - c).powi(2) + b * b).sqrt());
    Some([(mean + gap).sqrt(), (mean - gap).max(0.0).sqrt()])
}

/// Per face the principal stretch that differs most from 1, minus 1; NaN for a face without area
/// at rest.
pub fn face_strains(topology: &Topology, rest: &[Point3], now: &[Point3]) -> Vec<f64> {
    let strain = |face: &[u32; 3]| {
        let corners = |p: &'_ [Point3]| face.map(|v| p[v as usize]);
        let (a, b) = (corners(rest), corners(now));
        let found = principal_stretches(a.each_ref(), b.each_ref())?;
        let [large, small] = found.map(|s| s - 1.0);
        Some(if large.abs() >= small.abs() { large } else { small })
    };
    topology.faces.iter().map(|f| strain(f).unwrap_or(f64::NAN)).collect()
}

/// Per vertex the mean of its faces' values, weighted by their area at rest; NaN without a face.
pub fn vertex_means(topology: &Topology, rest: &[Point3], faces: &[f64]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); topology.vertex_count];
    for (face, &value) in topology.faces.iter().zip(faces).filter(|(_, v)| v.is_finite()) {
        let [a, b, c] = face.map(|v| &rest[v as usize]);
        let weight = area(a, b, c);
        for &v in face {
            sums[v as usize].0 += weight * value;
            sums[v as usize].1 += weight;
        }
    }
    sums.into_iter().map(|(sum, weight)| sum / weight).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Isometry, Vector3};

    fn triangle() -> [Point3; 3] {
        [Point3::origin(), Point3::new(2.0, 0.0, 0.0), Point3::new(0.5, 1.5, 0.0)]
    }

    #[test]
    fn a_stretched_and_moved_triangle_by_hand() {
        let pose = Isometry::new(Vector3::new(3.0, 1.0, 9.0), Vector3::new(0.4, 0.9, -0.3));
        let rest = triangle();
        // A tenth longer along x, a fifth shorter along y.
        let now = rest.map(|p| pose * Point3::new(1.1 * p.x, 0.8 * p.y, 0.0));
        let [large, small] = principal_stretches(rest.each_ref(), now.each_ref()).unwrap();
        assert!((large - 1.1).abs() < 1e-12 && (small - 0.8).abs() < 1e-12, "{large} {small}");
        let topology = Topology::new(3, vec![[0, 1, 2]]).unwrap();
        let strain = face_strains(&topology, &rest, &now);
        assert!((strain[0] + 0.2).abs() < 1e-12);
        assert!((vertex_means(&topology, &rest, &strain)[2] + 0.2).abs() < 1e-12);
    }

    #[test]
    fn vertices_take_the_mean_by_area() {
        let p = |x: f64, y: f64| Point3::new(x, y, 0.0);
        // Areas 1/2 and 3/2.
        let rest = [p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0), p(-3.0, 0.0)];
        let topology = Topology::new(4, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let means = vertex_means(&topology, &rest, &[0.4, 0.8]);
        for (mean, expected) in means.iter().zip([0.7, 0.4, 0.7, 0.8]) {
            assert!((mean - expected).abs() < 1e-12, "{means:?}");
        }
    }

    #[test]
    fn a_sliver_has_no_strain() {
        let flat = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(2.0, 0.0, 0.0)];
        let now = triangle();
        assert_eq!(principal_stretches(flat.each_ref(), now.each_ref()), None);
    }
}
