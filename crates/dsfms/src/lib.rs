//! Template-based conformal shape from motion and shading for monocular laparoscopy.
//!
//! The stages follow the paper (Malti, Bartoli, Collins: *Template-Based Conformal
//! Shape-from-Motion-and-Shading for Laparoscopy*), each one a public function from the previous
//! stage's value to its own:
//!
//! ```text
//! frames ─► sfm ─► dense ─► mesh ─► template ─► register ─► refine ─► outputs
//!           poses  points   faces   uv, albedo   V′ (eq. 3)  V″ (eq. 4)
//! ```
//!
//! A template of the organ at rest, and the surface in one frame in which it is deformed:
//!
//! ```no_run
//! use dsfms::{
//!     CameraInput, Method, ReconstructOptions, Silent, TemplateOptions, find_frames, read_frame, read_frames,
//!     reconstruct, template_from_frames, write_template,
//! };
//!
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let camera = CameraInput::read("camera.json".as_ref(), None)?;
//!     let frames = read_frames(&find_frames(&["exploration".into()])?)?;
//!     let exploration = camera.exploration(&frames);
//!     let built = template_from_frames(&exploration, &TemplateOptions::default(), &Silent)?;
//!     write_template("organ.template".as_ref(), &built.template)?;
//!     let frame = read_frame("deformed.png".as_ref())?;
//!     let observation = camera.observation(&frame);
//!     let options = ReconstructOptions::default();
//!     let found = reconstruct(&built.template, &observation, Method::Joint, &options)?;
//!     println!("{} vertices, camera axes; {}", found.vertices.len(), found.verdict);
//!     Ok(())
//! }
//! ```
//!
//! The same on a synthetic organ whose deformed shape is known, with a given rest shape:
//!
//! ```
//! use dsfms::pipeline::template_from_posed_frames;
//! use dsfms::synth::Case;
//! use dsfms::{
//!     Exploration, LengthUnit, Method, Observation, ReconstructOptions, Silent, TemplateOptions, reconstruct,
//! };
//!
//! let case = Case::example(1);
//! let (frames, poses) = case.explore(4);
//! let poses: Vec<_> = poses.into_iter().map(Some).collect();
//! let exploration = Exploration::new(&frames, &case.camera).light(case.template.light.as_ref());
//! let (mesh, unit) = (case.template.mesh.clone(), LengthUnit::Millimetre);
//! let options = TemplateOptions::default();
//! let built = template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent)?;
//! let observation = Observation::new(&case.frame, &case.camera).matches(&case.matches);
//! let options = ReconstructOptions::default();
//! let found = reconstruct(&built.template, &observation, Method::Joint, &options)?;
//! assert!(case.zone_rms(&found.vertices) < 1.0); // mm, in the deformed zone
//! # Ok::<_, Box<dyn std::error::Error>>(())
//! ```
//!
//! `examples/` has four programs to begin with. What is named here in short lies in its module,
//! which says more.
//!
//! Conventions everywhere: OpenCV camera axes (x right, y down, z forward), pixel centres at
//! integers, lengths in mm where the scale is known (else template units), linear light in
//! `[0, 1]`, `f64` in every solver.

// What is public is meant to be.
#![deny(unreachable_pub)]

#[doc(alias = "camera calibration")]
pub mod calibrate;
pub mod camera;
pub mod checkpoint;
#[doc(alias("MVS", "multi-view stereo", "PatchMatch", "NCC", "TSDF", "graph cut"))]
pub mod dense;
pub mod energy;
#[doc(alias("benchmark", "metrics"))]
pub mod eval;
#[doc(alias = "uncertainty")]
pub mod expected_error;
pub mod experiment;
pub mod geometry;
pub mod guard;
pub mod image;
pub mod io;
pub mod light;
#[doc(alias = "triangle mesh")]
pub mod mesh;
pub mod options;
pub mod pipeline;
#[doc(alias("CT registration", "ICP", "Umeyama"))]
pub mod preoperative;
pub mod raster;
#[doc(alias("DSfMS", "eq. 4"))]
pub mod refine;
#[doc(alias("DSfM", "eq. 3"))]
pub mod register;
#[doc(alias("structure from motion", "SfM", "five-point algorithm", "MAGSAC", "RANSAC"))]
pub mod sfm;
#[doc(alias = "shape from shading")]
pub mod sfs;
pub mod solver;
#[doc(alias = "augmented reality")]
pub mod structures;
#[doc(alias("simulation", "renderer"))]
pub mod synth;
pub mod template;
pub mod track;
#[doc(alias = "failure detection")]
pub mod verdict;
pub mod video;
#[doc(alias("CT", "MRI", "NIfTI", "displacement field"))]
pub mod voxels;

pub use camera::CameraModel;
pub use image::{Frame, Mask};
pub use io::images::{find_frames, read_frame, read_frames};
pub use io::template::{read_template, write_template};
pub use mesh::Mesh;
/// Vectors and matrices of the public functions, in the version that they take.
pub use nalgebra;
pub use pipeline::inputs::CameraInput;
pub use pipeline::{
    Exploration, Method, Observation, ReconstructOptions, Reconstruction, Silent, TemplateOptions,
    reconstruct, template_from_frames,
};
pub use register::Match;
pub use template::{LengthUnit, Template};
pub use track::{TrackOptions, Tracker};
