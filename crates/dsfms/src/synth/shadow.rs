//! Self-occlusion of light: what a light sees of a surface, by a depth map of its own.

use crate::camera::{Camera, CameraModel, Lens};
use crate::geometry::{Point3, Vector3};
use crate::light::LightModel;
use crate::mesh::Mesh;
use crate::raster::{Raster, rasterize};

/// Side of a depth map, px.
const SIDE: usize = 768;

/// A distant light is put this many surface depths away.
const FAR: f64 = 1e4;

/// One depth map per position of the light.
pub(super) struct Shadows {
    maps: Vec<ShadowMap>,
    /// A point this much behind the map is in shadow, length units.
    bias: f64,
}

struct ShadowMap {
    light: Vector3,
    camera: CameraModel,
    raster: Raster,
}

impl Shadows {
    /// Look at the surface (camera axes) from every position of the light along z.
    pub(super) fn cast(light: &LightModel, mesh: &Mesh) -> Self {
        let deepest = mesh.positions.iter().map(|p| p.z).fold(0.0, f64::max);
        let mut positions: Vec<Vector3> = light.sources().iter().map(|p| p.coords).collect();
        if positions.is_empty() {
            positions.push(Vector3::new(0.0, 0.0, -FAR * deepest));
        }
        let maps = positions.into_iter().map(|position| ShadowMap::of(position, mesh)).collect();
        Self { maps, bias: 0.25 * mesh.mean_edge_length() }
    }

    /// Share of the light's positions that see a point.
    pub(super) fn lit(&self, point: &Point3) -> f64 {
        let seen = self.maps.iter().filter(|map| map.sees(point, self.bias)).count();
        seen as f64 / self.maps.len().max(1) as f64
    }
}

impl ShadowMap {
    fn of(light: Vector3, mesh: &Mesh) -> Self {
        let positions: Vec<Point3> = mesh.positions.iter().map(|p| p - light).collect();
        let widest = positions
            .iter()
            .filter(|p| p.z > 0.0)
            .map(|p| (p.x.abs() / p.z).max(p.y.abs() / p.z))
            .fold(1e-9, f64::max);
        let middle = 0.5 * (SIDE as f64 - 1.0);
        let camera = CameraModel {
            size: [SIDE; 2],
            focal: [0.98 * middle / widest; 2],
            centre: [middle; 2],
            lens: Lens::default(),
        };
        let raster = rasterize(&camera, &mesh.topology, &positions);
        Self { light, camera, raster }
    }

    fn sees(&self, point: &Point3, bias: f64) -> bool {
        let from_light = point - self.light;
        let Some(pixel) = self.camera.project(&from_light).map(|p| p.pixel) else { return true };
        let (x, y) = (pixel.x.round(), pixel.y.round());
        let inside = (0.0..SIDE as f64).contains(&x) && (0.0..SIDE as f64).contains(&y);
        !inside || from_light.z <= self.raster.depth[y as usize * SIDE + x as usize] + bias
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::{PointLight, Spot};

    /// A floor at z = 100 and a small screen at z = 50 before its middle.
    fn scene() -> Mesh {
        let square = |s: f64, z: f64| {
            [[-s, -s], [s, -s], [s, s], [-s, s]].map(|[x, y]| Point3::new(x, y, z))
        };
        let positions = [square(40.0, 100.0), square(5.0, 50.0)].concat();
        let faces = vec![[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]];
        Mesh::new(positions, faces).unwrap()
    }

    #[test]
    fn a_screen_throws_its_shadow_away_from_the_light() {
        let light = LightModel::Point(PointLight {
            positions: vec![Point3::new(-10.0, 0.0, 0.0)],
            reference_distance: 100.0,
            spot: Spot::Isotropic,
        });
        let mesh = scene();
        let shadows = Shadows { bias: 1.0, ..Shadows::cast(&light, &mesh) };
        // Seen from x = −10 the screen (−5 to 5) covers 0 to 20 of the floor.
        for (x, lit) in [(-3.0, 1.0), (3.0, 0.0), (17.0, 0.0), (23.0, 1.0)] {
            assert_eq!(shadows.lit(&Point3::new(x, 0.0, 100.0)), lit, "x = {x}");
        }
        let distant = Shadows { bias: 1.0, ..Shadows::cast(&LightModel::Collinear, &mesh) };
        for (x, lit) in [(4.0, 0.0), (6.0, 1.0)] {
            assert_eq!(distant.lit(&Point3::new(x, 0.0, 100.0)), lit, "x = {x}");
        }
    }
}
