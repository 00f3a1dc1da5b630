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
//! Conventions everywhere: OpenCV camera axes (x right, y down, z forward), pixel centres at
//! integers, lengths in mm where the scale is known (else template units), linear light in
//! `[0, 1]`, `f64` in every solver.

pub mod calibrate;
pub mod camera;
pub mod confidence;
pub mod dense;
pub mod energy;
pub mod eval;
pub mod experiment;
pub mod geometry;
pub mod guard;
pub mod image;
pub mod io;
pub mod light;
pub mod mesh;
pub mod options;
pub mod pipeline;
pub mod raster;
pub mod refine;
pub mod register;
pub mod sfm;
pub mod sfs;
pub mod solver;
pub mod structures;
pub mod synth;
pub mod template;
pub mod track;
pub mod verdict;
pub mod video;
