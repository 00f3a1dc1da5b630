//! One triangle: area, normal, barycentric coordinates.

use super::{Point2, Point3, Vector3};

/// `(b − a) × (c − a)`: twice the area along the outward normal of a counter-clockwise triangle.
pub fn area_normal(a: &Point3, b: &Point3, c: &Point3) -> Vector3 {
    (b - a).cross(&(c - a))
}

/// Unit normal (right-hand rule), `None` where the triangle has no area.
pub fn normal(a: &Point3, b: &Point3, c: &Point3) -> Option<Vector3> {
    area_normal(a, b, c).try_normalize(0.0)
}

/// Area in squared length units.
pub fn area(a: &Point3, b: &Point3, c: &Point3) -> f64 {
    0.5 * area_normal(a, b, c).norm()
}

/// Area of a triangle of the plane, positive if counter-clockwise.
pub(crate) fn signed_area(uv: &[Point2; 3]) -> f64 {
    let (p, q) = (uv[1] - uv[0], uv[2] - uv[0]);
    0.5 * (p.x * q.y - p.y * q.x)
}

/// The point `w₀a + w₁b + w₂c`.
pub fn point_at(corners: [&Point3; 3], weights: [f64; 3]) -> Point3 {
    let [a, b, c] = corners;
    Point3::from(a.coords * weights[0] + b.coords * weights[1] + c.coords * weights[2])
}

/// Barycentric coordinates of the orthogonal projection of `p` on the plane of the triangle;
/// `None` where the triangle has no area.
pub fn barycentric(p: &Point3, corners: [&Point3; 3]) -> Option<[f64; 3]> {
    let [a, b, c] = corners;
    let n = area_normal(a, b, c);
    let n2 = n.norm_squared();
    if n2 <= 0.0 {
        return None;
    }
    let w0 = area_normal(p, b, c).dot(&n) / n2;
    let w1 = area_normal(a, p, c).dot(&n) / n2;
    Some([w0, w1, 1.0 - w0 - w1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_triangle_by_hand() {
        let (a, b, c) = (Point3::origin(), Point3::new(2.0, 0.0, 0.0), Point3::new(0.0, 3.0, 0.0));
        assert_eq!(area(&a, &b, &c), 3.0);
        assert_eq!(normal(&a, &b, &c), Some(Vector3::z()));
        assert_eq!(normal(&a, &b, &b), None);
    }

    #[test]
    fn barycentric_inverts_point_at() {
        let (a, b, c) =
            (Point3::new(0.1, 0.2, 1.0), Point3::new(2.0, -0.3, 1.5), Point3::new(0.4, 1.7, 0.2));
        let w = [0.2, 0.5, 0.3];
        let back = barycentric(&point_at([&a, &b, &c], w), [&a, &b, &c]).unwrap();
        for k in 0..3 {
            assert!((back[k] - w[k]).abs() < 1e-12);
        }
    }
}
