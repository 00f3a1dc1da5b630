//! Shape from shading alone: the baseline the paper compares with.
//!
//! One image, a Lambertian surface, the light at the camera's centre, perspective (Prados and
//! Faugeras 2003). The registration is given: the posed rigid template says which pixels show the
//! organ, with which albedo, how far away it is on average and how bright a unit of light is; its
//! shape is not used. A depth map is found by least squares,
//!
//! ```text
//! Σ ρ((gain·α·s(z) − I)/σ)² + Σ (second differences of ln z)² + Σ_border (ln z − ln z̄)²
//! ```
//!
//! and every visible vertex moves along its sightline to it; hidden ones follow smoothly. Shading
//! leaves convex and concave undecided where the fall-off is weak, and errors of slope add up over
//! the image: several times the error of the methods that use the template's shape is normal.

mod carry;
mod depth_map;
mod grid;
mod rows;

use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point3};
use crate::image::{Mask, Plane};
use crate::light::LightModel;
use crate::mesh::Mesh;
use crate::options::{OptionError, check, from_zero, positive};
use crate::raster::{rasterize, visible_vertices};
use crate::solver::Summary;
use crate::template::SurfaceTexels;
use serde::{Deserialize, Serialize};

/// What shape from shading sees of one frame.
#[derive(Clone, Copy, Debug)]
pub struct SfsInput<'a> {
    /// Rest surface in the template frame.
    pub mesh: &'a Mesh,
    /// `camera_from_template` of the rigid registration.
    pub pose: Isometry,
    /// Camera of the frame.
    pub camera: &'a CameraModel,
    /// The frame, linear grey in `[0, 1]`.
    pub grey: &'a Plane,
    /// `true` where the organ may be seen (no instrument, inside the organ's outline).
    pub usable: &'a Mask,
    /// `true` where the frame is saturated.
    pub saturated: &'a Mask,
    /// The template's albedo; `None` = the same everywhere.
    pub albedo: Option<&'a SurfaceTexels>,
    /// The light; a near one is moved to the camera's centre.
    pub light: &'a LightModel,
}

/// Options of [`shape_from_shading`]. Other values are not measured: it is here to compare with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SfsOptions {
    /// Nodes of the depth map along the longer side of the organ's bounding box, `8..=200`.
    pub nodes_across: usize,
    /// Noise of the brightness relative to its median.
    pub relative_noise: f64,
    /// Expected curvature of the surface times its distance.
    pub curvature: f64,
    /// Expected deviation of ln depth at the border from the mean.
    pub border_sigma: f64,
    /// Saturated pixels are grown by this, px.
    pub halo_px: f64,
    /// Depth of the bulge it starts from, relative to the distance.
    pub start_bulge: f64,
    /// Most steps of the solver.
    pub max_iterations: usize,
}

impl Default for SfsOptions {
    fn default() -> Self {
        Self {
            nodes_across: 72,
            relative_noise: 0.05,
            curvature: 3.0,
            border_sigma: 0.1,
            halo_px: 12.0,
            start_bulge: 0.1,
            max_iterations: 40,
        }
    }
}

impl SfsOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[
            ("sfs.nodes_across", (8..=200).contains(&self.nodes_across), "from 8 to 200"),
            (
                "sfs.relative_noise, curvature, border_sigma",
                positive(&[self.relative_noise, self.curvature, self.border_sigma]),
                "positive",
            ),
            ("sfs.halo_px", from_zero(&[self.halo_px]), "0 or more"),
            ("sfs.start_bulge", (-1.0..1.0).contains(&self.start_bulge), "from -1 to below 1"),
            ("sfs.max_iterations", self.max_iterations >= 1, "at least 1"),
        ])
    }
}

/// What [`shape_from_shading`] found.
#[derive(Clone, Debug)]
pub struct SfsResult {
    /// One position per vertex, camera axes.
    pub vertices: Vec<Point3>,
    /// Exposure gain, from the rigid pose's predicted brightness.
    pub gain: f64,
    /// The solve of the depth map.
    pub summary: Summary,
}

/// Why there is no depth map.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SfsError {
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// Frame, masks and camera differ.
    #[error(
        "the frame or a mask is {found:?} px but the camera says {expected:?}; use the camera of this resolution"
    )]
    SizeMismatch {
        /// Size of the frame or mask.
        found: [usize; 2],
        /// Size in the camera.
        expected: [usize; 2],
    },
    /// Nothing to solve.
    #[error(
        "only {found} nodes of the depth map see the organ, at least {needed} are needed; check the pose and the masks"
    )]
    TooSmall {
        /// Usable nodes.
        found: usize,
        /// Fewest that make sense.
        needed: usize,
    },
}

/// Depth from the shading of one frame; deterministic.
///
/// # Errors
/// An option out of its bounds, images of another size than the camera, or no usable pixel that
/// shows the mesh.
#[doc(alias = "SfS")]
pub fn shape_from_shading(input: &SfsInput, options: &SfsOptions) -> Result<SfsResult, SfsError> {
    options.validate()?;
    let expected = input.camera.size;
    for found in [input.grey.size, input.usable.size, input.saturated.size] {
        if found != expected {
            return Err(SfsError::SizeMismatch { found, expected });
        }
    }
    let posed: Vec<_> = input.mesh.positions.iter().map(|p| input.pose * p).collect();
    let raster = rasterize(input.camera, &input.mesh.topology, &posed);
    let light = input.light.at_camera();
    let grid = grid::PixelGrid::new(input, &raster, &posed, &light, options)?;
    let (log_depth, summary) = depth_map::solve(&grid, &light, options);
    let tolerance = 0.01 * grid.mean_depth;
    let topology = &input.mesh.topology;
    let visible = visible_vertices(input.camera, topology, &posed, &raster, tolerance);
    let vertices = carry::vertices(input, &grid, &log_depth, &posed, &visible);
    Ok(SfsResult { vertices, gain: grid.gain, summary })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vector3;
    use crate::light::{Light, PointLight, Spot};
    use crate::mesh::normals::vertex_normals;

    const SIZE: [usize; 2] = [80, 80];

    fn camera() -> CameraModel {
        CameraModel::pinhole(SIZE, [80.0; 2], [39.5; 2])
    }

    /// A square patch, flat or bulging by `height` towards the camera, 50 units away.
    fn patch(height: f64) -> Mesh {
        const N: u32 = 21;
        let at = |i: u32| -16.0 + 32.0 * f64::from(i) / f64::from(N - 1);
        let bulge = |x: f64, y: f64| -height * (-(x * x + y * y) / 80.0).exp();
        let positions = (0..N * N)
            .map(|k| (at(k % N), at(k / N)))
            .map(|(x, y)| Point3::new(x, y, 50.0 + bulge(x, y)))
            .collect();
        let cell = |k: u32| [[k, k + N, k + 1], [k + 1, k + N, k + N + 1]];
        let faces =
            (0..(N - 1) * (N - 1)).flat_map(|c| cell(c / (N - 1) * N + c % (N - 1))).collect();
        Mesh::new(positions, faces).unwrap()
    }

    fn photograph(mesh: &Mesh, light: &LightModel) -> Plane {
        let raster = rasterize(&camera(), &mesh.topology, &mesh.positions);
        let normals = vertex_normals(&mesh.topology, &mesh.positions);
        let data = raster.render(0.0, |face, w| {
            let corners = mesh.topology.faces[face].map(|v| v as usize);
            let n: Vector3 = (0..3).map(|k| normals[corners[k]] * w[k]).sum();
            let p = crate::geometry::point_at(mesh.corners(face), w);
            0.4 * light.shade(&p, &n.normalize()).value as f32
        });
        Plane { size: SIZE, data }
    }

    #[test]
    fn a_bulge_appears_where_the_shading_says() {
        let light = LightModel::Point(PointLight {
            positions: vec![Point3::origin()],
            reference_distance: 50.0,
            spot: Spot::Isotropic,
        });
        let (rest, deformed) = (patch(0.0), patch(4.0));
        let grey = photograph(&deformed, &light);
        let camera = camera();
        let input = SfsInput {
            mesh: &rest,
            pose: Isometry::identity(),
            camera: &camera,
            grey: &grey,
            usable: &Mask::filled(SIZE, true),
            saturated: &Mask::filled(SIZE, false),
            albedo: None,
            light: &light,
        };
        let options = SfsOptions { nodes_across: 32, ..Default::default() };
        let found = shape_from_shading(&input, &options).unwrap();
        let (before, after) = found.summary.cost();
        assert!(after < 0.2 * before, "cost {before} to {after}");
        let centre = 10 * 21 + 10;
        let border: f64 = (0..21).map(|i| found.vertices[i].z).sum::<f64>() / 21.0;
        let height = border - found.vertices[centre].z;
        assert!((1.5..8.0).contains(&height), "bulge of {height}, true 4");
        let gone = SfsInput { pose: Isometry::translation(0.0, 0.0, -200.0), ..input };
        assert!(matches!(shape_from_shading(&gone, &options), Err(SfsError::TooSmall { .. })));
    }
}
