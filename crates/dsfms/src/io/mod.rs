//! Files: meshes, the template container, and writing without half-written results.

pub mod atomic;
pub mod gltf_mesh;
pub mod mesh;
pub mod obj;
pub mod ply;
mod ply_read;
pub mod stl;
pub mod template;
mod template_glb;
mod template_manifest;
