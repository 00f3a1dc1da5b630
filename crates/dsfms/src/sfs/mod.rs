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
mod error;
mod grid;
mod input;
mod options;
mod rows;

pub use error::SfsError;
pub use input::SfsInput;
pub use options::SfsOptions;

use crate::geometry::Point3;
use crate::raster::{rasterize, visible_vertices};
use crate::solver::Summary;

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
    use crate::camera::CameraModel;
    use crate::geometry::{Isometry, Vector3};
    use crate::image::{Mask, Plane};
    use crate::light::{Light, LightModel, PointLight, Spot};
    use crate::mesh::Mesh;
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
