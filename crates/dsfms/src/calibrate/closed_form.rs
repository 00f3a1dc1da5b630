//! Intrinsics and poses without a guess, from homographies (Zhang 2000, §3.1), no distortion yet.

use super::board::{BoardCorner, on_board};
use super::homography::homography;
use super::target::Board;
use crate::camera::{BrownConrady, Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, Vector2, Vector3};
use nalgebra::{Matrix3, Rotation3, SMatrix, SymmetricEigen, Translation3, UnitQuaternion};

/// Where refinement starts.
pub(super) struct StartingCamera {
    pub camera: CameraModel,
    /// `camera_from_board` per view.
    pub poses: Vec<Isometry>,
}

/// The better of two closed forms: Zhang's, and one with the principal point in the middle of the
/// image and square pixels, which holds where few images or strong distortion upset the first.
/// `None` where neither gives a camera.
pub(super) fn start(
    size: [usize; 2],
    views: &[&[BoardCorner]],
    board: &Board,
) -> Option<StartingCamera> {
    let scale = size[0].max(size[1]) as f64;
    let middle = size.map(|n| 0.5 * (n as f64 - 1.0));
    let unit = |p: &Point2| Point2::new((p.x - middle[0]) / scale, (p.y - middle[1]) / scale);
    let homographies: Option<Vec<Matrix3<f64>>> = views
        .iter()
        .map(|view| {
            let plane: Vec<Point2> = view.iter().map(|c| on_board(c, board)).collect();
            let image: Vec<Point2> = view.iter().map(|c| unit(&c.pixel)).collect();
            homography(&plane, &image)
        })
        .collect();
    let homographies = homographies?;
    let guesses = [zhang(&homographies), centred(&homographies)];
    let candidates = guesses.into_iter().flatten().filter_map(|[fx, fy, cx, cy]| {
        let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
        let poses: Option<Vec<Isometry>> = homographies.iter().map(|h| pose(&k, h)).collect();
        let camera = CameraModel {
            size,
            focal: [fx * scale, fy * scale],
            centre: [cx * scale + middle[0], cy * scale + middle[1]],
            lens: BrownConrady::default().into(),
        };
        camera.validate().ok()?;
        let start = StartingCamera { camera, poses: poses? };
        Some((cost(&start, views, board)?, start))
    });
    candidates.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, start)| start)
}

/// fx, fy, cx, cy from `h₁ᵀBh₂ = 0`, `h₁ᵀBh₁ = h₂ᵀBh₂` with `B = K⁻ᵀK⁻¹` and no skew.
fn zhang(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    let mut normal = SMatrix::<f64, 5, 5>::zeros();
    for h in homographies {
        let (a, b) = (h.column(0).into_owned(), h.column(1).into_owned());
        for row in [products(&a, &b), products(&a, &a) - products(&b, &b)] {
            normal += row * row.transpose();
        }
    }
    let eigen = SymmetricEigen::new(normal);
    let b = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let b = b * b[0].signum();
    // B11, B22, B13, B23, B33.
    let [b11, b22, b13, b23, b33] = [b[0], b[1], b[2], b[3], b[4]];
    let (cx, cy) = (-b13 / b11, -b23 / b22);
    let lambda = b33 - b13 * b13 / b11 - b23 * b23 / b22;
    plausible([(lambda / b11).sqrt(), (lambda / b22).sqrt(), cx, cy])
}

/// The row of `aᵀBb` for B11, B22, B13, B23, B33.
fn products(a: &Vector3, b: &Vector3) -> SMatrix<f64, 5, 1> {
    SMatrix::<f64, 5, 1>::new(
        a.x * b.x,
        a.y * b.y,
        a.x * b.z + a.z * b.x,
        a.y * b.z + a.z * b.y,
        a.z * b.z,
    )
}

/// One focal length, the principal point in the middle: `s = 1/f²` from the same equations.
fn centred(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    let (mut upper, mut lower) = (0.0, 0.0);
    for h in homographies {
        let (a, b) = (h.column(0), h.column(1));
        let pairs = [
            (a.x * b.x + a.y * b.y, a.z * b.z),
            (a.x * a.x + a.y * a.y - b.x * b.x - b.y * b.y, a.z * a.z - b.z * b.z),
        ];
        for (slope, constant) in pairs {
            upper -= slope * constant;
            lower += slope * slope;
        }
    }
    let f = (upper / lower).sqrt().recip();
    plausible([f, f, 0.0, 0.0])
}

/// Focal lengths and centre in units of the longer image side, centre from its middle.
fn plausible(k: [f64; 4]) -> Option<[f64; 4]> {
    let focal = k[..2].iter().all(|f| (0.1..50.0).contains(f));
    let centre = k[2..].iter().all(|c| c.abs() < 0.5);
    (focal && centre).then_some(k)
}

/// `[r₁ r₂ t] ~ K⁻¹H`, the board in front of the camera.
fn pose(k: &Matrix3<f64>, h: &Matrix3<f64>) -> Option<Isometry> {
    let m = k.try_inverse()? * h;
    let scale = 2.0 / (m.column(0).norm() + m.column(1).norm()) * m[(2, 2)].signum();
    let (a, b, t): (Vector3, Vector3, Vector3) =
        (m.column(0) * scale, m.column(1) * scale, m.column(2) * scale);
    let svd = Matrix3::from_columns(&[a, b, a.cross(&b)]).svd(true, true);
    let rotation = Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?);
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    Some(Isometry::from_parts(Translation3::from(t), rotation))
}

/// Sum of squared residuals; `None` where a corner lies behind the camera.
fn cost(start: &StartingCamera, views: &[&[BoardCorner]], board: &Board) -> Option<f64> {
    let mut sum = 0.0;
    for (pose, view) in start.poses.iter().zip(views) {
        for corner in *view {
            let p = on_board(corner, board);
            let projected = start.camera.project(&(pose * Point3::new(p.x, p.y, 0.0)))?.pixel;
            sum += Vector2::norm_squared(&(projected - corner.pixel));
        }
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{board, camera, poses};
    use super::*;
    use crate::camera::Lens;

    fn corners(camera: &CameraModel) -> Vec<Vec<BoardCorner>> {
        let view = |pose: &Isometry| {
            (0..35)
                .map(|i| {
                    let grid = [i % 7, i / 7];
                    let p = Point3::new(3.0 * grid[0] as f64, 3.0 * grid[1] as f64, 0.0);
                    BoardCorner { grid, pixel: camera.project(&(pose * p)).unwrap().pixel }
                })
                .collect()
        };
        poses().iter().map(view).collect()
    }

    #[test]
    fn exact_without_distortion() {
        let truth = CameraModel { lens: Lens::Pinhole, ..camera() };
        let views = corners(&truth);
        let views: Vec<&[BoardCorner]> = views.iter().map(Vec::as_slice).collect();
        let found = start(truth.size, &views, &board()).unwrap();
        for k in 0..2 {
            assert!((found.camera.focal[k] - truth.focal[k]).abs() < 1e-6);
            assert!((found.camera.centre[k] - truth.centre[k]).abs() < 1e-6);
        }
        for (p, q) in found.poses.iter().zip(poses()) {
            assert!((p.translation.vector - q.translation.vector).norm() < 1e-6);
            assert!(p.rotation.angle_to(&q.rotation) < 1e-7);
        }
    }

    #[test]
    fn the_centred_form_gives_the_focal_length() {
        let truth = CameraModel {
            focal: [240.0; 2],
            centre: [129.5, 99.5],
            lens: Lens::Pinhole,
            ..camera()
        };
        let h: Vec<Matrix3<f64>> = poses()
            .iter()
            .map(|p| {
                let r = p.rotation.to_rotation_matrix();
                let m = Matrix3::from_columns(&[
                    r.matrix().column(0).into_owned(),
                    r.matrix().column(1).into_owned(),
                    p.translation.vector,
                ]);
                let unit =
                    Matrix3::new(240.0 / 260.0, 0.0, 0.0, 0.0, 240.0 / 260.0, 0.0, 0.0, 0.0, 1.0);
                unit * m
            })
            .collect();
        assert!((centred(&h).unwrap()[0] * 260.0 - truth.focal[0]).abs() < 1e-9);
    }
}
