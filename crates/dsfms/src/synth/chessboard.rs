//! Pictures of a chessboard by a camera that is known: a printed board on a drape, turned to all
//! sides, under a light beside the lens that falls off. What [`crate::calibrate`] finds in them can
//! be held against the truth.
//!
//! ```
//! use dsfms::calibrate::Board;
//! use dsfms::synth::{Chessboard, ChessboardOptions};
//! let board = Board { corners: [7, 5], square: 3.0 };
//! let size = [320, 240];
//! let scene = Chessboard::new(&ChessboardOptions { board, size, pictures: 3, seed: 1 })?;
//! assert_eq!(scene.photograph(0).size, size);
//! # Ok::<_, dsfms::synth::ChessboardError>(())
//! ```

use super::random::{Random, uniform};
use super::sensor::develop;
use crate::calibrate::{Board, CalibrateError};
use crate::camera::{BrownConrady, Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3, Vector3};
use crate::image::{ColorImage, Frame};
use crate::light::{Light, LightModel, PointLight, Spot};
use nalgebra::{Translation3, Unit, UnitQuaternion};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// What is photographed.
#[derive(Clone, Debug, PartialEq)]
pub struct ChessboardOptions {
    /// The board.
    pub board: Board,
    /// Width and height of a picture, px.
    pub size: [usize; 2],
    /// Pictures.
    pub pictures: usize,
    /// Seed of camera, poses and noise.
    pub seed: u64,
}

/// Why there are no pictures.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ChessboardError {
    /// A board without a grid, or a square without a size.
    #[error(transparent)]
    Board(#[from] CalibrateError),
    /// Squares too small to be told apart.
    #[error(
        "squares of the board are {px:.1} px wide in a picture of {}x{} px; expected {LEAST_SQUARE} px or more: larger \
         pictures, or fewer corners", size[0], size[1]
    )]
    TooFine {
        /// The shortest side of a square, px.
        px: f64,
        /// Size of the pictures.
        size: [usize; 2],
    },
}

/// Shortest side of a square in a picture, px. Calibration finds every board of 12 sets of pictures
/// whose squares have 7.3 px and more, and misses some of 14 of 15 sets with smaller ones.
pub const LEAST_SQUARE: f64 = 8.0;

/// A chessboard before a known camera; its pictures can be taken in any order.
#[derive(Clone, Debug)]
pub struct Chessboard {
    /// The board.
    pub board: Board,
    /// The camera of all pictures.
    pub camera: CameraModel,
    /// `camera_from_board` of every picture, mm; the first corner is the origin, x and y run along
    /// the sides ([`Board::points`]), z away from the camera.
    pub poses: Vec<Isometry>,
    light: LightModel,
    seed: u64,
    /// Sightlines of the corners of all pixels, row by row; zero where there is none.
    rays: Vec<Vector3>,
}

/// Reflectance of what is seen, linear: paper, ink, a drape.
const COLOURS: [[f64; 3]; 3] = [[0.86, 0.85, 0.81], [0.045, 0.045, 0.05], [0.05, 0.17, 0.19]];
/// Brightest paper of a picture, linear: its exposure follows the light.
const EXPOSED: f64 = 0.8;
/// Stray light in the lens, linear.
const VEIL: f64 = 0.006;
/// Samples of a pixel along each side.
const SAMPLES: usize = 4;
/// Places of the board's middle, as parts of the image's sides from its centre.
const AIMS: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [-0.22, -0.2],
    [0.22, 0.2],
    [0.22, -0.2],
    [-0.22, 0.2],
    [-0.25, 0.0],
    [0.25, 0.0],
    [0.0, -0.22],
    [0.0, 0.22],
];

impl Chessboard {
    /// The camera and poses of a seed: a laparoscope's barrel distortion, its centre a little off
    /// the middle.
    ///
    /// # Errors
    /// A board that is none, or whose squares would be too small to be found.
    pub fn new(options: &ChessboardOptions) -> Result<Self, ChessboardError> {
        options.board.validate()?;
        let mut random = Random::new(options.seed, 0xB0A2D);
        let camera = camera(options.size, &mut random);
        let numbers = 0..options.pictures;
        let poses = numbers.map(|k| pose(&options.board, &camera, k, &mut random)).collect();
        let scene = Self::posed(options.board, camera, poses, options.seed);
        let px = scene.shortest_square();
        match px < LEAST_SQUARE {
            true => Err(ChessboardError::TooFine { px, size: options.size }),
            false => Ok(scene),
        }
    }

    /// A board before a camera of one's own; `seed` of the noise.
    pub fn posed(board: Board, camera: CameraModel, poses: Vec<Isometry>, seed: u64) -> Self {
        let depth = |pose: &Isometry| (pose * middle(&board)).z;
        let mean = poses.iter().map(depth).sum::<f64>() / poses.len().max(1) as f64;
        let light = LightModel::from(PointLight {
            positions: vec![Point3::new(1.5, -3.0, 0.0)],
            reference_distance: mean.max(1.0),
            spot: Spot::CosinePower { exponent: 2.0 },
        });
        let [w, h] = camera.size;
        let ray = |i: usize| {
            let corner = Point2::new((i % (w + 1)) as f64 - 0.5, (i / (w + 1)) as f64 - 0.5);
            camera.unproject(&corner).unwrap_or_default()
        };
        let rays = (0..(w + 1) * (h + 1)).into_par_iter().map(ray).collect();
        Self { board, camera, poses, light, seed, rays }
    }

    /// Picture `k`, named `board_NNN`; sRGB.
    ///
    /// # Panics
    /// If there is no pose `k`.
    pub fn photograph(&self, k: usize) -> Frame {
        let pose = &self.poses[k];
        let normal = -(pose.rotation * Vector3::z());
        let shade = |p: &Point3| self.light.shade(p, &normal).value;
        let lit = outline(&self.board, 1.0).map(|p| shade(&(pose * p))).fold(0.0, f64::max);
        let gain = EXPOSED / (COLOURS[0][0] * lit.max(1e-9));
        let size = self.camera.size;
        let pixel = |i: usize| {
            let corners = self.corner_rays(i);
            let albedo = self.albedo(pose, &corners);
            let ray: Vector3 = corners.iter().sum();
            let depth = normal.dot(&pose.translation.vector) / normal.dot(&ray);
            let lit = if depth.is_finite() { shade(&Point3::from(ray * depth)) } else { 0.0 };
            albedo.map(|a| (gain * lit * a + VEIL) as f32)
        };
        let data = (0..size[0] * size[1]).into_par_iter().map(pixel).collect();
        let seed = self.seed ^ ((k as u64 + 1) << 20);
        develop(format!("board_{k:03}"), &ColorImage { size, data }, seed)
    }

    /// Sightlines of a pixel's corners: above, below; left, right.
    fn corner_rays(&self, pixel: usize) -> [Vector3; 4] {
        let w = self.camera.size[0];
        let first = pixel / w * (w + 1) + pixel % w;
        [first, first + 1, first + w + 1, first + w + 2].map(|i| self.rays[i])
    }

    /// Mean reflectance of what a pixel sees.
    fn albedo(&self, pose: &Isometry, corners: &[Vector3; 4]) -> [f64; 3] {
        let inverse = pose.rotation.inverse();
        let eye = inverse * -pose.translation.vector;
        let corners = corners.map(|ray| inverse * ray);
        let mut seen = [0.0; 3];
        for k in 0..SAMPLES * SAMPLES {
            let [u, v] = [k % SAMPLES, k / SAMPLES].map(|n| (n as f64 + 0.5) / SAMPLES as f64);
            let ray = (corners[0] * (1.0 - u) + corners[1] * u) * (1.0 - v)
                + (corners[2] * (1.0 - u) + corners[3] * u) * v;
            if ray.z > 1e-9 {
                seen[self.painted(&(eye - ray * (eye.z / ray.z)))] += 1.0;
            }
        }
        let share = 1.0 / (SAMPLES * SAMPLES) as f64;
        std::array::from_fn(|c| (0..3).map(|kind| seen[kind] * share * COLOURS[kind][c]).sum())
    }

    /// Which of [`COLOURS`] a place of the board's plane has: squares within a margin of one
    /// square.
    fn painted(&self, place: &Vector3) -> usize {
        let [columns, rows] = self.board.corners.map(|n| n as f64 + 1.0);
        let [u, v] = [place.x, place.y].map(|x| x / self.board.square + 1.0);
        let inside = |m: f64| (-m..columns + m).contains(&u) && (-m..rows + m).contains(&v);
        if !inside(1.0) {
            2
        } else {
            usize::from(inside(0.0) && (u.floor() + v.floor()) as i64 % 2 == 0)
        }
    }

    /// Shortest distance of two neighbouring corners in any picture, px; 0 where one cannot be
    /// seen.
    fn shortest_square(&self) -> f64 {
        let points = self.board.points();
        let columns = self.board.corners[0];
        let shortest = |pose: &Isometry| {
            let seen = |p: &Point3| self.camera.project(&(pose * p)).map(|q| q.pixel);
            let pixels: Option<Vec<Point2>> = points.iter().map(seen).collect();
            let Some(pixels) = pixels else { return 0.0 };
            let right = (1..pixels.len()).filter(|k| k % columns > 0).map(|k| (k - 1, k));
            let below = (columns..pixels.len()).map(|k| (k - columns, k));
            right.chain(below).map(|(a, b)| (pixels[a] - pixels[b]).norm()).fold(f64::MAX, f64::min)
        };
        self.poses.iter().map(shortest).fold(f64::MAX, f64::min)
    }
}

/// Focal length 0.8 of the width within 3 %, centre off the middle by up to 2 % of a side.
fn camera(size: [usize; 2], random: &mut Random) -> CameraModel {
    let [w, h] = size.map(|s| s as f64);
    let mut about = |middle: f64, spread: f64| middle + spread * (2.0 * uniform(random) - 1.0);
    let focal = w * about(0.8, 0.024);
    let focal = [focal, focal * about(1.0, 0.003)];
    let centre = [about(0.5 * (w - 1.0), 0.02 * w), about(0.5 * (h - 1.0), 0.02 * h)];
    let k = [about(-0.22, 0.03), about(0.06, 0.01), 0.0];
    let p = [about(0.0, 0.001), about(0.0, 0.001)];
    CameraModel { size, focal, centre, lens: BrownConrady { k, p }.into() }
}

fn middle(board: &Board) -> Point3 {
    let [x, y] = board.corners.map(|n| 0.5 * (n - 1) as f64 * board.square);
    Point3::new(x, y, 0.0)
}

/// Points around the board, so many squares outside its outermost corners, mm.
fn outline(board: &Board, squares: f64) -> impl Iterator<Item = Point3> {
    const SIDE: usize = 8;
    let half = board.corners.map(|n| (0.5 * (n - 1) as f64 + squares) * board.square);
    let middle = middle(board);
    (0..4 * SIDE).map(move |k| {
        let along = 2.0 * (k % SIDE) as f64 / SIDE as f64 - 1.0;
        let [x, y] = [[along, -1.0], [1.0, along], [-along, 1.0], [-1.0, -along]][k / SIDE];
        middle + Vector3::new(x * half[0], y * half[1], 0.0)
    })
}

/// The board of picture `k`, tilted by 14 to 40 degrees and as near as it wholly fits, up to an
/// eighth farther.
fn pose(board: &Board, camera: &CameraModel, k: usize, random: &mut Random) -> Isometry {
    let mut draw = |low: f64, high: f64| low + (high - low) * uniform(random);
    // Golden turns: the tilts of any number of pictures go evenly around.
    let towards = TAU * (0.381_966 * k as f64 + draw(-0.05, 0.05));
    let axis = Unit::new_normalize(Vector3::new(towards.cos(), towards.sin(), 0.0));
    let upright = if k % 5 == 3 { 0.25 * TAU } else { 0.0 };
    let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), upright + draw(-0.3, 0.3));
    let rotation = UnitQuaternion::from_axis_angle(&axis, draw(0.25, 0.7)) * roll;
    let farther = draw(1.0, 1.125);
    let [w, h] = camera.size.map(|s| s as f64);
    let [x, y] = AIMS[k % AIMS.len()];
    let aim = Point2::new((0.5 + x) * w, (0.5 + y) * h);
    let ray = camera.unproject(&aim).unwrap_or_else(Vector3::z);
    let at = |depth: f64| {
        let translation = ray * (depth / ray.z) - rotation * middle(board).coords;
        Isometry::from_parts(Translation3::from(translation), rotation)
    };
    let fits = |depth: f64| {
        outline(board, 1.5).all(|p| {
            let seen = camera.project(&(at(depth) * p)).map(|q| q.pixel);
            seen.is_some_and(|q| (0.0..w - 1.0).contains(&q.x) && (0.0..h - 1.0).contains(&q.y))
        })
    };
    let length = board.corners.iter().sum::<usize>() as f64 * board.square;
    let (mut near, mut far) = (0.0, 20.0 * length);
    for _ in 0..40 {
        let half = 0.5 * (near + far);
        if fits(half) { far = half } else { near = half }
    }
    at(far * farther)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::{CalibrateOptions, calibrate};

    const BOARD: Board = Board { corners: [7, 5], square: 3.0 };

    fn scene(size: [usize; 2], pictures: usize) -> Chessboard {
        let options = ChessboardOptions { board: BOARD, size, pictures, seed: 2 };
        Chessboard::new(&options).unwrap()
    }

    /// Where a picture is dark and where it is bright, against the projected middles of squares.
    #[test]
    fn squares_are_where_the_camera_sees_them() {
        let scene = scene([320, 240], 4);
        for (k, pose) in scene.poses.iter().enumerate() {
            let picture = scene.photograph(k);
            for corner in scene.board.points() {
                let at = |dx: f64, dy: f64| {
                    let place = corner + Vector3::new(dx, dy, 0.0) * (0.5 * BOARD.square);
                    let seen = scene.camera.project(&(pose * place)).unwrap().pixel;
                    let [x, y] = [seen.x, seen.y].map(|c| c.round() as usize);
                    f64::from(picture.rgb[y * picture.size[0] + x][1])
                };
                let odd = (corner.x + corner.y) / BOARD.square % 2.0 > 0.5;
                let [dark, bright] = [[1.0, 1.0], [1.0, -1.0]].map(|[a, b]| at(a, b));
                let [dark, bright] = if odd { [bright, dark] } else { [dark, bright] };
                assert!(bright > 1.6 * dark, "picture {k}: dark {dark}, bright {bright}");
            }
        }
    }

    #[test]
    fn a_picture_is_a_function_of_seed_and_number() {
        let (all, few) = (scene([320, 240], 5), scene([320, 240], 3));
        assert_eq!(all.photograph(2), few.photograph(2));
        assert!(all.photograph(2).rgb != all.photograph(3).rgb);
    }

    #[test]
    fn calibration_gives_the_camera_back() {
        let scene = scene([480, 360], 12);
        let frames: Vec<Frame> = (0..12).map(|k| scene.photograph(k)).collect();
        let found = calibrate(&frames, &BOARD, &CalibrateOptions::default()).unwrap();
        assert!(found.rejected.is_empty(), "{:?}", found.rejected);
        let truth = scene.camera.focal;
        let off = |c: usize| (found.camera.focal[c] / truth[c] - 1.0).abs();
        // 0.0005, and 0.061 px, are measured.
        assert!(off(0).max(off(1)) < 0.002, "{:?}, true {truth:?}", found.camera.focal);
        assert!(found.rms_px() < 0.1, "{} px", found.rms_px());
    }

    #[test]
    fn boards_that_cannot_be_found_are_refused() {
        let board = Board { corners: [60, 40], square: 3.0 };
        let options = ChessboardOptions { board, size: [320, 240], pictures: 3, seed: 2 };
        let text = Chessboard::new(&options).err().unwrap().to_string();
        assert!(text.contains("px wide") && text.contains("320x240"), "{text}");
        let board = Board { corners: [2, 5], square: 3.0 };
        let error = Chessboard::new(&ChessboardOptions { board, ..options }).err().unwrap();
        assert!(error.to_string().contains("2x5"), "{error}");
    }
}
