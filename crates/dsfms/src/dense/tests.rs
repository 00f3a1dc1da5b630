//! One small scene through the whole stage: a textured bump seen by five cameras.

use super::*;
use crate::camera::CameraModel;
use crate::geometry::Vector3;
use crate::image::Frame;

const SIZE: [usize; 2] = [96, 72];

fn camera() -> CameraModel {
    CameraModel::pinhole(SIZE, [90.0, 91.0], [47.0, 36.0])
}

/// Height of the surface `z = height(x, y)`: a bump of 4 mm towards the cameras at z = 50.
fn height(x: f64, y: f64) -> f64 {
    50.0 - 4.0 * (-(x * x + y * y) / 200.0).exp()
}

/// Irregular spots, about 2 mm across, between 0.3 and 0.7.
fn texture(x: f64, y: f64) -> f64 {
    let wave = |a: f64, b: f64, c: f64| (a * x + b * y + c).sin();
    0.5 + 0.06 * (wave(2.1, 0.7, 0.0) + wave(-0.9, 1.9, 1.0) + wave(1.3, -1.6, 2.0))
        + 0.03 * wave(0.3, 0.5, 0.4)
}

fn pose(i: usize) -> Isometry {
    let centre = Point3::new(5.0 * i as f64 - 10.0, 4.0 * (i % 3) as f64 - 4.0, 0.0);
    let target = Point3::new(0.0, 0.0, 50.0);
    let z = (target - centre).normalize();
    let x = Vector3::y().cross(&z).normalize();
    let rotation =
        nalgebra::Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
    let rotation = nalgebra::UnitQuaternion::from_matrix(&rotation);
    Isometry::from_parts((rotation * -centre.coords).into(), rotation)
}

/// March each sightline to the surface; brightness falls off with distance from the camera.
fn render(i: usize) -> Frame {
    use crate::camera::Camera;
    let (camera, pose) = (camera(), pose(i));
    let origin = pose.inverse_transform_point(&Point3::origin());
    let rgb = (0..SIZE[0] * SIZE[1])
        .map(|p| {
            let pixel = crate::geometry::Point2::new((p % SIZE[0]) as f64, (p / SIZE[0]) as f64);
            let ray = pose.inverse_transform_vector(&camera.unproject(&pixel).unwrap());
            let mut t = 40.0;
            for _ in 0..30 {
                let at = origin + t * ray;
                t += (height(at.x, at.y) - at.z) / ray.z;
            }
            let at = origin + t * ray;
            [(255.0 * texture(at.x, at.y) * (50.0 / t).powi(2)) as u8; 3]
        })
        .collect();
    Frame { name: format!("frame_{i:03}"), size: SIZE, rgb }
}

fn sparse() -> Vec<Point3> {
    let at = |i: usize| (i as f64 - 4.5) * 4.0;
    (0..100)
        .map(|i| (at(i % 10), at(i / 10)))
        .map(|(x, y)| Point3::new(x, y, height(x, y)))
        .collect()
}

fn reconstruct(threads: usize) -> DenseSurface {
    let (camera, frames) = (camera(), (0..5).map(render).collect::<Vec<_>>());
    let views: Vec<PosedFrame> = frames
        .iter()
        .enumerate()
        .map(|(i, frame)| PosedFrame {
            frame,
            camera: &camera,
            pose: pose(i),
            valid: None,
            organ: None,
        })
        .collect();
    let options = DenseOptions { target_vertices: Some(2000), ..Default::default() };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let maps = depth_maps(&views, &sparse(), &options, &|_, _| {}).unwrap();
        surface(&views, &maps, &options).unwrap()
    })
}

#[test]
fn a_bump_comes_back_the_same_at_any_thread_count() {
    let one = reconstruct(1);
    let rms = |supported: bool| {
        let vertices = one.mesh.positions.iter().zip(&one.support);
        let errors: Vec<f64> = vertices
            .filter(|(_, s)| s.frames > 0 || !supported)
            .map(|(p, _)| (p.z - height(p.x, p.y)).powi(2))
            .collect();
        (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
    };
    // 0.55 mm a pixel at this distance; the rim goes on a little beyond what depth supports.
    assert!(rms(true) < 0.2, "rms {} mm", rms(true));
    assert!(rms(false) < 0.4, "rms {} mm", rms(false));
    // The error expected: about as many vertices as there should be lie within it.
    let vertices = one.mesh.positions.iter().zip(&one.support).filter(|(_, s)| s.frames > 0);
    let mut errors: Vec<f64> =
        vertices.map(|(p, s)| (p.z - height(p.x, p.y)).abs() / s.sigma).collect();
    errors.sort_by(f64::total_cmp);
    let ratio = errors[(0.683 * errors.len() as f64) as usize];
    assert!((0.5..2.0).contains(&ratio), "error over expected: {ratio}");
    let area: f64 = one.mesh.face_areas().iter().sum();
    assert!(area > 800.0, "area {area} mm²");
    let towards: usize = (0..one.mesh.topology.faces.len())
        .filter(|&f| {
            let [a, b, c] = one.mesh.corners(f);
            crate::geometry::area_normal(a, b, c).z < 0.0
        })
        .count();
    assert!(towards as f64 > 0.97 * one.mesh.topology.faces.len() as f64);
    let two = reconstruct(2);
    assert_eq!(one.mesh.positions, two.mesh.positions);
    assert_eq!(one.mesh.topology, two.mesh.topology);
}

#[test]
fn one_frame_is_too_few_and_black_frames_have_no_depth() {
    let camera = camera();
    let frame = Frame { name: "black".into(), size: SIZE, rgb: vec![[0; 3]; SIZE[0] * SIZE[1]] };
    let view =
        |i| PosedFrame { frame: &frame, camera: &camera, pose: pose(i), valid: None, organ: None };
    let run = |views: &[PosedFrame]| {
        depth_maps(views, &sparse(), &DenseOptions::default(), &|_, _| {}).unwrap_err()
    };
    assert_eq!(run(&[view(0)]), DenseError::TooFewFrames { found: 1 });
    assert_eq!(run(&[view(0), view(1), view(2)]), DenseError::NoDepth { frames: 3 });
}
