//! The occluding contour of a shape, where the organ's outline in the frame is known.

use crate::camera::{Camera, CameraModel};
use crate::energy::{ContourPoint, Silhouette};
use crate::geometry::{Point3, area_normal};
use crate::image::Outline;
use crate::mesh::Topology;
use crate::raster::{Raster, rasterize, regions::distance_to};
use crate::register::Body;

/// A vertex further inside the predicted silhouette than this is on no contour against what lies
/// around the organ, px: the noise of an outline.
const AT_CONTOUR: f64 = 2.0;

/// Vertices of the contour of `shape` (camera axes) against its surroundings: where faces turned to
/// the camera meet others, and the rim of an open surface, held on one side only, if at all; with
/// `true` for the rim.
fn contour(
    camera: &CameraModel,
    topology: &Topology,
    shape: &[Point3],
    raster: &Raster,
    outline: &Outline,
) -> Vec<(usize, bool)> {
    let outside = distance_to(&raster.silhouette().complement());
    let turned: Vec<bool> = topology
        .faces
        .iter()
        .map(|face| {
            let [a, b, c] = face.map(|v| &shape[v as usize]);
            area_normal(a, b, c).dot(&a.coords) < 0.0
        })
        .collect();
    let mut found = Vec::new();
    for (v, faces) in topology.vertex_faces.iter().enumerate() {
        let front = faces.iter().filter(|&&f| turned[f as usize]).count();
        let rim = topology.boundary[v] && front > 0;
        let held = if rim { outline.holds_rims } else { front > 0 && front < faces.len() };
        if !held {
            continue;
        }
        let Some(pixel) = camera.project(&shape[v]).map(|p| p.pixel) else { continue };
        if !outline.known_at(&pixel) {
            continue;
        }
        let [x, y] = [pixel.x.round() as usize, pixel.y.round() as usize];
        if f64::from(outside[y * raster.size[0] + x]) <= AT_CONTOUR {
            found.push((v, rim));
        }
    }
    found
}

/// Fewest vertices of a contour that tell how far it is from the outline.
const TELLING: usize = 12;

/// Distance of the contour of `shape` (camera axes) from the organ's outline, px, that nine tenths
/// of its vertices do not exceed; `None` where the outline is known at too few of them.
pub(crate) fn outline_distance(
    camera: &CameraModel,
    topology: &Topology,
    shape: &[Point3],
    outline: &Outline,
) -> Option<f64> {
    let raster = rasterize(camera, topology, shape);
    let found = contour(camera, topology, shape, &raster, outline).into_iter();
    let off = |(v, _): (usize, bool)| {
        Some(outline.distance.sample(&camera.project(&shape[v])?.pixel)?.0.abs())
    };
    let mut all: Vec<f64> = found.filter_map(off).collect();
    all.sort_unstable_by(f64::total_cmp);
    (all.len() >= TELLING).then(|| all[9 * all.len() / 10])
}

/// The condition on the contour of the full mesh at `full`, carried by `body` at `shape`.
pub(super) fn silhouette<'a>(
    camera: &'a CameraModel,
    body: &Body,
    [full, shape]: [&[Point3]; 2],
    raster: &Raster,
    outline: &'a Outline,
    sigma_px: f64,
) -> Silhouette<'a, CameraModel> {
    let topology = &body.full().rest.topology;
    let point = |(v, one_sided): (usize, bool)| {
        let (face, barycentric) = body.place(v)?;
        let corners = body.scene().rest.topology.faces[face as usize];
        let offset = full[v] - body.point((face, barycentric), shape);
        Some(ContourPoint { corners, barycentric, offset, one_sided })
    };
    let found = contour(camera, topology, full, raster, outline).into_iter();
    let points = found.filter_map(point).collect();
    Silhouette { camera, distance: &outline.distance, points, sigma_px }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;
    use crate::geometry::Vector3;
    use crate::image::Mask;
    use crate::mesh::shapes;
    use crate::raster::rasterize;

    fn camera() -> CameraModel {
        CameraModel {
            size: [160, 120],
            focal: [300.0; 2],
            centre: [80.0, 60.0],
            lens: Lens::Pinhole,
        }
    }

    #[test]
    fn the_contour_of_a_ball_is_its_widest_circle() {
        let mesh = shapes::icosphere(3, 10.0);
        let shape: Vec<Point3> =
            mesh.positions.iter().map(|p| p + Vector3::new(0.0, 0.0, 60.0)).collect();
        let camera = camera();
        let raster = rasterize(&camera, &mesh.topology, &shape);
        let organ: Mask = raster.silhouette();
        let outline = Outline::new(&organ, None);
        let found = contour(&camera, &mesh.topology, &shape, &raster, &outline);
        assert!(found.len() > 20, "{}", found.len());
        for (v, rim) in found {
            assert!(!rim);
            let pixel = camera.project(&shape[v]).unwrap().pixel;
            let distance = outline.distance.sample(&pixel).unwrap().0;
            assert!(distance.abs() < 2.5, "vertex {v}: {distance} px");
        }
    }

    #[test]
    fn the_outline_is_as_far_as_the_contour_is_moved() {
        let mesh = shapes::icosphere(3, 10.0);
        let at = |x: f64| -> Vec<Point3> {
            mesh.positions.iter().map(|p| p + Vector3::new(x, 0.0, 60.0)).collect()
        };
        let camera = camera();
        let organ = rasterize(&camera, &mesh.topology, &at(0.0)).silhouette();
        let off =
            |x: f64, outline: &Outline| outline_distance(&camera, &mesh.topology, &at(x), outline);
        let outline = Outline::new(&organ, None);
        // Seldom more than a px of rounding, then 2 mm at a focal length of 300 px and a depth of
        // 60 mm.
        assert!(off(0.0, &outline).unwrap() < 1.5);
        assert!((off(2.0, &outline).unwrap() - 10.0).abs() < 1.5);
        let unknown = Outline::known_off(&organ, &Mask::filled(organ.size, true));
        assert_eq!(off(0.0, &unknown), None);
    }

    #[test]
    fn a_mask_holds_the_rim_of_an_open_surface_and_colours_do_not() {
        // A sheet that faces the camera.
        let mesh = shapes::irregular_sheet(9);
        let facing = |p: &Point3| Point3::new(20.0 * (p.x - 0.5), 20.0 * (0.5 - p.y), 60.0);
        let shape: Vec<Point3> = mesh.positions.iter().map(facing).collect();
        let camera = camera();
        let raster = rasterize(&camera, &mesh.topology, &shape);
        let organ = raster.silhouette();
        let rims = |outline: &Outline| {
            let found = contour(&camera, &mesh.topology, &shape, &raster, outline);
            found.iter().filter(|(_, rim)| *rim).count()
        };
        assert!(rims(&Outline::new(&organ, None)) > 10);
        assert_eq!(rims(&Outline::known_off(&organ, &Mask::filled(organ.size, false))), 0);
    }
}
