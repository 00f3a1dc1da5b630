//! Files in and out: frames, masks, cameras, poses, matches, meshes and the template container;
//! everything is written to a temporary file first and renamed.

pub mod albedo;
pub mod animation;
pub mod atomic;
pub mod base64;
pub mod camera;
pub mod checkpoint;
pub mod clip_truth;
pub mod colmap;
pub mod error;
pub mod folder;
pub mod gltf_mesh;
pub mod igtl;
pub mod images;
pub mod landmarks;
pub mod masks;
pub mod matches;
pub mod mesh;
pub mod names;
pub(crate) mod npz;
pub mod obj;
mod off;
pub mod ply;
mod ply_read;
pub mod poses;
pub mod stl;
pub mod template;
mod template_arrays;
mod template_glb;
mod template_manifest;
pub mod template_sparse;
pub mod vertex_truth;
pub mod vtk;
mod vtk_read;
mod yaml;

pub use error::InputError;
