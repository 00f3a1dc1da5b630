//! Intrinsics from pictures of a chessboard (Zhang 2000): corners, homographies, a closed form,
//! then all intrinsics and poses together.
//!
//! ```text
//! frames ─► saddle points ─► grid ─► sub-pixel corners ─► homographies ─► K, poses ─► refined, σ
//! ```
//!
//! Only the corners inside the board are used, those where four squares meet. A chessboard looks
//! the same mirrored, so mirrored pictures need no special care.

mod board;
mod closed_form;
mod error;
mod grid;
mod homography;
mod options;
mod refine;
mod saddle;
mod subpixel;
mod target;
#[cfg(test)]
mod test_scene;

pub use board::{BoardCorner, Rejection, find_board};
pub use error::{CalibrateError, MIN_VIEWS};
pub use options::CalibrateOptions;
pub use refine::Estimate;
pub use target::Board;

use crate::camera::CameraModel;
use crate::geometry::{Isometry, Vector2};
use crate::image::Frame;
use crate::solver::Summary;
use rayon::prelude::*;

/// One image of the board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardView {
    /// Index of the frame.
    pub frame: usize,
    /// Corners found.
    pub corners: Vec<BoardCorner>,
    /// `camera_from_board`; the board's x and y run along its sides, mm.
    pub pose: Isometry,
    /// Corner minus projection, px, in the order of `corners`.
    pub residuals: Vec<Vector2>,
}

/// What calibration returns.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The intrinsics, pixel centres at integers.
    pub camera: CameraModel,
    /// Every intrinsic with its standard deviation: fx fy cx cy k1 k2 p1 p2 k3.
    pub estimates: Vec<Estimate>,
    /// Covariance of the intrinsics in the order of `estimates`, row by row; zero for fixed ones.
    pub covariance: Vec<Vec<f64>>,
    /// Images in which the board was found, in order.
    pub views: Vec<BoardView>,
    /// Index of every other image, and why.
    pub rejected: Vec<(usize, Rejection)>,
    /// The solve.
    pub summary: Summary,
}

impl BoardView {
    /// Root mean square distance of the corners from their projections, px.
    pub fn rms_px(&self) -> f64 {
        let sum: f64 = self.residuals.iter().map(|r| r.norm_squared()).sum();
        (sum / self.residuals.len().max(1) as f64).sqrt()
    }

    /// Largest distance of a corner from its projection, px.
    pub fn largest_px(&self) -> f64 {
        self.residuals.iter().map(|r| r.norm()).fold(0.0, f64::max)
    }
}

impl Calibration {
    /// Root mean square distance of all corners from their projections, px.
    pub fn rms_px(&self) -> f64 {
        let all = || self.views.iter().flat_map(|v| &v.residuals);
        (all().map(|r| r.norm_squared()).sum::<f64>() / all().count().max(1) as f64).sqrt()
    }
}

/// Calibrate a camera from frames of one size that show the board in different positions.
///
/// Frames without a whole board are left out with a reason; it is an error if fewer than
/// [`MIN_VIEWS`] are left.
///
/// ```no_run
/// use dsfms::calibrate::{Board, CalibrateOptions, calibrate};
///
/// let frames = dsfms::read_frames(&dsfms::find_frames(&["board".into()])?)?;
/// let board = Board { corners: [9, 6], square: 5.0 };
/// let found = calibrate(&frames, &board, &CalibrateOptions::default())?;
/// println!("{:?}, {:.2} px", found.camera.focal, found.rms_px());
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A board or frames that cannot be used, or fewer than [`MIN_VIEWS`] frames that show it.
#[doc(alias("camera calibration", "chessboard", "intrinsics", "Zhang"))]
pub fn calibrate(
    frames: &[Frame],
    board: &Board,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    check(frames, board)?;
    let found: Vec<_> =
        frames.par_iter().map(|frame| find_board(&frame.luma(), board, options.partial)).collect();
    let (mut views, mut rejected) = (Vec::new(), Vec::new());
    for (frame, found) in found.into_iter().enumerate() {
        match found {
            Ok(corners) => views.push((frame, corners)),
            Err(why) => rejected.push((frame, why)),
        }
    }
    if views.len() < MIN_VIEWS {
        return Err(CalibrateError::too_few(views.len(), frames, &rejected, board));
    }
    from_corners(frames[0].size, views, rejected, board, options)
}

fn from_corners(
    size: [usize; 2],
    found: Vec<(usize, Vec<BoardCorner>)>,
    rejected: Vec<(usize, Rejection)>,
    board: &Board,
    options: &CalibrateOptions,
) -> Result<Calibration, CalibrateError> {
    let corners: Vec<&[BoardCorner]> = found.iter().map(|(_, c)| c.as_slice()).collect();
    let start = closed_form::start(size, &corners, board).ok_or(CalibrateError::Degenerate)?;
    let solved = refine::refine(size, &corners, board, options, start)?;
    let views = found
        .into_iter()
        .zip(solved.poses)
        .zip(solved.residuals)
        .map(|(((frame, corners), pose), residuals)| BoardView { frame, corners, pose, residuals })
        .collect();
    Ok(Calibration {
        camera: solved.camera,
        estimates: solved.estimates,
        covariance: solved.covariance,
        views,
        rejected,
        summary: solved.summary,
    })
}

impl Board {
    /// Check corners and square.
    ///
    /// # Errors
    /// Fewer than 3 corners along a side, or a square without a length.
    pub fn validate(&self) -> Result<(), CalibrateError> {
        if self.corners.iter().any(|&n| n < 3) {
            return Err(CalibrateError::Board { corners: self.corners });
        }
        match self.square.is_finite() && self.square > 0.0 {
            true => Ok(()),
            false => Err(CalibrateError::Square(self.square)),
        }
    }
}

fn check(frames: &[Frame], board: &Board) -> Result<(), CalibrateError> {
    board.validate()?;
    match frames.iter().find(|f| f.size != frames[0].size) {
        None => Ok(()),
        Some(other) => Err(CalibrateError::Sizes {
            first: frames[0].name.clone(),
            first_size: frames[0].size,
            other: other.name.clone(),
            other_size: other.size,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::test_scene::{board, camera, picture, poses};
    use super::*;
    use crate::camera::Camera;
    use crate::geometry::Point3;
    use crate::synth::random::{Random, normal};

    fn frames() -> Vec<Frame> {
        let frame = |(i, pose): (usize, &Isometry)| {
            let image = picture(pose);
            let rgb = image.data.iter().map(|v| [(v * 255.0).round() as u8; 3]).collect();
            Frame { name: format!("board_{i}"), size: image.size, rgb }
        };
        poses().iter().enumerate().map(frame).collect()
    }

    #[test]
    fn a_rendered_board_gives_its_camera_back() {
        let mut frames = frames();
        let blank = Frame { name: "blank".into(), rgb: vec![[90; 3]; 260 * 200], ..frames[0] };
        frames.insert(1, blank);
        let found = calibrate(&frames, &board(), &CalibrateOptions::default()).unwrap();
        assert_eq!(found.rejected.len(), 1);
        assert_eq!(found.views.len(), 5);
        assert!(found.rms_px() < 0.06, "{}", found.rms_px());
        let truth = [240.0, 243.0, 127.0, 103.0];
        for (e, t) in found.estimates.iter().zip(truth) {
            assert!((e.value - t).abs() < 3.0 && e.deviation > 0.0, "{e:?}");
        }
        assert_eq!(found.estimates[8].deviation, 0.0);
    }

    #[test]
    fn deviations_say_how_far_the_estimates_scatter() {
        let mut random = Random::new(4, 0);
        let (noise, runs) = (0.1, 60);
        let mut miss = [0.0; 4];
        let mut said = 0.0;
        for _ in 0..runs {
            let views: Vec<_> = poses()
                .iter()
                .enumerate()
                .map(|(i, pose)| {
                    let corner = |k: usize| {
                        let grid = [k % 7, k / 7];
                        let p = Point3::new(3.0 * grid[0] as f64, 3.0 * grid[1] as f64, 0.0);
                        let pixel = camera().project(&(pose * p)).unwrap().pixel;
                        let off = Vector2::new(normal(&mut random), normal(&mut random)) * noise;
                        BoardCorner { grid, pixel: pixel + off }
                    };
                    (i, (0..35).map(corner).collect::<Vec<_>>())
                })
                .collect();
            let options = CalibrateOptions::default();
            let found = from_corners([260, 200], views, Vec::new(), &board(), &options).unwrap();
            let truth = [240.0, 243.0, 127.0, 103.0];
            for k in 0..4 {
                miss[k] += (found.estimates[k].value - truth[k]).powi(2) / f64::from(runs);
            }
            said += found.estimates[0].deviation / f64::from(runs);
        }
        let scatter = miss[0].sqrt();
        assert!((0.7..1.4).contains(&(scatter / said)), "{scatter} {said}");
    }

    #[test]
    fn a_wrong_board_size_is_said() {
        let asked = Board { corners: [8, 6], square: 3.0 };
        let error = calibrate(&frames(), &asked, &CalibrateOptions::default()).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("7x5") && text.contains("8x6") && text.contains("not the squares"),
            "{text}"
        );
        let error = calibrate(&frames()[..2], &board(), &CalibrateOptions::default()).unwrap_err();
        assert!(error.to_string().contains("found in 2 of 2 images"), "{error}");
    }
}
