//! Bundle adjustment on the problems that ceres-solver ships for libmv: one shared camera, poses
//! and points free, the first camera held, squared errors.
//!
//!     cargo run --release --example bundle_adjustment -- PROBLEM.bin... BUNDLER.out...
//!
//! Of Bundler's models (`.out`) the tracks, poses and points are taken, and every view has a focal
//! length and two distortions of its own, as Bundler has them; its cost is that of the file.
//! `--shared`: one camera for all views, with its centre refined too.
//!
//! Prints the cost `½ Σ ‖Π(X) − x‖²` before and after, steps and seconds; a peer's costs of the
//! same files come from `docs/peers/bundle_adjustment.py`.

use dsfms::camera::{Camera, CameraModel, Lens};
use dsfms::geometry::{Isometry, Point2, Point3};
use dsfms::sfm::RefineIntrinsics;
use dsfms::sfm::bundle::{Bundle, BundleObservation, BundleOptions, adjust};
use dsfms::solver::Loss;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
use std::collections::BTreeMap;
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    println!("| problem | cameras, points, sightings | cost before | after | rms px | steps | s |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let (flags, paths): (Vec<_>, Vec<_>) =
        std::env::args().skip(1).partition(|argument| argument.starts_with("--"));
    let shared = flags.iter().any(|flag| flag == "--shared");
    for path in paths {
        let bundler = path.ends_with(".out");
        let (mut bundle, reference) = if bundler {
            let model = read_bundler(&std::fs::read_to_string(&path)?, shared);
            model.map(|(bundle, cost)| (bundle, Some(cost))).ok_or("not a Bundler model")?
        } else {
            (read(&std::fs::read(&path)?).ok_or("the file ends too early")?, None)
        };
        let options = BundleOptions {
            refine: RefineIntrinsics {
                focal: bundler,
                centre: bundler && shared,
                distortion: bundler,
                second_distortion: bundler,
            },
            loss: Loss::Squared,
            max_steps: 200,
            cost_tolerance: 1e-10,
            prior_scale: f64::INFINITY,
        };
        let began = Instant::now();
        let summary = adjust(&mut bundle, &options)?;
        // Ours is a sum without the half.
        let reprojection = &summary.terms[0];
        let before = reference.unwrap_or(0.5 * reprojection.before);
        let after = 0.5 * reprojection.after;
        let counts = [bundle.poses.len(), bundle.points.len(), bundle.observations.len()];
        let rms = (2.0 * after / counts[2] as f64).sqrt();
        println!(
            "| {} | {counts:?} | {before:.6e} | {after:.6e} | {rms:.4} | {} | {:.2} |",
            path.rsplit('/').next().unwrap_or(&path),
            summary.iterations + summary.refused,
            began.elapsed().as_secs_f64()
        );
    }
    Ok(())
}

/// Little-endian: `vP` (pixels), focal length, principal point, five distortion coefficients, then
/// counted cameras (number, R by columns, t), points (number, X) and sightings (camera, point, x,
/// y).
fn read(bytes: &[u8]) -> Option<Bundle> {
    let mut words = bytes.get(2..)?.chunks_exact(4).map(|w| [w[0], w[1], w[2], w[3]]);
    let floats = |n: usize, words: &mut dyn Iterator<Item = [u8; 4]>| -> Option<Vec<f64>> {
        (0..n).map(|_| Some(f64::from(f32::from_le_bytes(words.next()?)))).collect()
    };
    let int = |words: &mut dyn Iterator<Item = [u8; 4]>| -> Option<u32> {
        Some(u32::from_le_bytes(words.next()?))
    };
    let k = floats(8, &mut words)?;
    let size = [k[1], k[2]].map(|c| (2.0 * c) as usize);
    let lens = Lens::BrownConrady { k: [k[3], k[4], k[5]], p: [k[6], k[7]] };
    let camera = CameraModel { size, focal: [k[0]; 2], centre: [k[1], k[2]], lens };
    let (mut poses, mut points) = (Vec::new(), Vec::new());
    let (mut view_of, mut point_of) = (BTreeMap::new(), BTreeMap::new());
    for view in 0..int(&mut words)? as usize {
        view_of.insert(int(&mut words)?, view);
        let r = Matrix3::from_column_slice(&floats(9, &mut words)?);
        let t = floats(3, &mut words)?;
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&r));
        poses.push(Isometry::from_parts(Translation3::new(t[0], t[1], t[2]), rotation));
    }
    for point in 0..int(&mut words)? as usize {
        point_of.insert(int(&mut words)?, point);
        let x = floats(3, &mut words)?;
        points.push(Point3::new(x[0], x[1], x[2]));
    }
    let mut observations = Vec::new();
    for _ in 0..int(&mut words)? {
        let (view, point) = (view_of.get(&int(&mut words)?), point_of.get(&int(&mut words)?));
        let x = floats(2, &mut words)?;
        if let (Some(&view), Some(&point)) = (view, point) {
            let pixel = Point2::new(x[0], x[1]);
            observations.push(BundleObservation { view, point, pixel, sigma_px: 1.0 });
        }
    }
    Some(bundle(vec![camera], poses, points, observations))
}

/// One camera for all views, or one for each; the first view holds the frame.
fn bundle(
    cameras: Vec<CameraModel>,
    poses: Vec<Isometry>,
    points: Vec<Point3>,
    observations: Vec<BundleObservation>,
) -> Bundle {
    let camera_of = (0..poses.len()).map(|v| v.min(cameras.len() - 1)).collect();
    let fixed = (0..poses.len()).map(|v| v == 0).collect();
    Bundle { priors: cameras.clone(), cameras, camera_of, poses, fixed, points, observations }
}

/// Bundler 0.3: cameras look along −z with y up; pixels count from the middle of the image. The
/// second value is the cost of the model as it is.
fn read_bundler(text: &str, shared: bool) -> Option<(Bundle, f64)> {
    let body = text.split_once('\n')?.1;
    let mut words = body.split_whitespace().map(|w| w.parse::<f64>().ok());
    let mut next = move || words.next().flatten();
    let (views, points) = (next()? as usize, next()? as usize);
    let mut own = Vec::new();
    for _ in 0..views {
        let numbers = (0..15).map(|_| next()).collect::<Option<Vec<f64>>>()?;
        own.push(numbers);
    }
    let pose = |c: &Vec<f64>| {
        let flip = Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, -1.0, -1.0));
        let r = flip * Matrix3::from_row_slice(&c[3..12]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&r));
        Isometry::from_parts(Translation3::new(c[12], -c[13], -c[14]), rotation)
    };
    let mean = |k: usize| own.iter().map(|c| c[k]).sum::<f64>() / views as f64;
    // Room for the pixels of any image; only the middle matters.
    let centre = [1e4; 2];
    let of = |f: f64, k1: f64, k2: f64| {
        let lens = Lens::BrownConrady { k: [k1, k2, 0.0], p: [0.0; 2] };
        CameraModel { size: [20_000; 2], focal: [f; 2], centre, lens }
    };
    let cameras = if shared {
        vec![of(mean(0), mean(1), mean(2))]
    } else {
        own.iter().map(|c| of(c[0], c[1], c[2])).collect()
    };
    let poses: Vec<Isometry> = own.iter().map(pose).collect();
    let (mut observations, mut positions, mut cost) = (Vec::new(), Vec::new(), 0.0);
    for point in 0..points {
        let position = Point3::new(next()?, next()?, next()?);
        (0..3).try_for_each(|_| next().map(|_| ()))?;
        for _ in 0..next()? as usize {
            let (view, _, x, y) = (next()? as usize, next()?, next()?, next()?);
            let pixel = Point2::new(centre[0] + x, centre[1] - y);
            observations.push(BundleObservation { view, point, pixel, sigma_px: 1.0 });
            let c = own.get(view)?;
            let seen = of(c[0], c[1], c[2]).project(&(poses[view] * position))?;
            cost += 0.5 * (seen.pixel - pixel).norm_squared();
        }
        positions.push(position);
    }
    Some((bundle(cameras, poses, positions, observations), cost))
}
