//! How well the surface of a template is known, over a frame that it was made from.

use super::TEXT;
use crate::draw::{dot, error_colour, picture};
use crate::outputs::write_png;
use crate::sheet::{Anchor, Item, raster};
use dsfms::Mesh;
use dsfms::camera::{Camera, CameraModel};
use dsfms::geometry::{Isometry, Point2, Vector3, median};
use dsfms::image::Frame;
use dsfms::mesh::normals::vertex_normals;
use dsfms::template::statistics::unmeasured;
use dsfms::template::{Template, TemplateView};
use image::{Rgb, RgbImage};
use std::path::Path;

/// A vertex that no depth map measured.
const UNMEASURED: [u8; 3] = [235, 30, 60];
/// Radius of a vertex, of the frame's width.
const RADIUS: f64 = 0.004;
/// Room for the words, px.
const BELOW: u32 = 34;

/// Write `measured.png`: the vertices on the frame that sees most of them, dark blue where they are
/// known best, yellow at twice the median of their expected errors and beyond, red where nothing
/// measured them.
pub fn write_measured(template: &Template, frames: &[Frame], folder: &Path) -> anyhow::Result<()> {
    let (Some(camera), Some(share)) = (&template.camera, unmeasured(template)) else {
        return Ok(());
    };
    let mesh = &template.mesh;
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let seen = |view: &TemplateView| {
        let frame = frames.iter().find(|f| f.name == view.name)?;
        Some((frame, places(mesh, &normals, camera, &view.camera_from_template)))
    };
    let views = template.views.iter().filter_map(seen);
    let Some((frame, places)) = views.rev().max_by_key(|(_, places)| places.len()) else {
        return Ok(());
    };
    let mut known: Vec<f64> = template.sigma.iter().copied().filter(|s| s.is_finite()).collect();
    let full = 2.0 * median(&mut known).unwrap_or(1.0);
    let [w, h] = frame.size.map(|s| s as u32);
    let mut canvas = RgbImage::from_pixel(w, h + BELOW, Rgb([255; 3]));
    image::imageops::replace(&mut canvas, &picture(frame), 0, 0);
    for (v, at) in places {
        let sigma = template.sigma[v];
        let colour = if sigma.is_finite() { error_colour(sigma, full) } else { UNMEASURED };
        dot(&mut canvas, at, RADIUS * f64::from(w), colour, 1.0);
    }
    let words = format!(
        "expected error: dark blue 0, yellow {full:.2} {} and more; red: not measured ({:.0} % of the area)",
        template.unit.label(),
        100.0 * share
    );
    let at = [8.0, f64::from(h) + 22.0];
    raster::draw(&mut canvas, &[Item::text(at, Anchor::Start, TEXT, words)], 1.0);
    write_png(&folder.join("measured.png"), &canvas)
}

/// Vertices that face a camera, and where they are in its image, px; what hides them is not asked.
fn places(
    mesh: &Mesh,
    normals: &[Vector3],
    camera: &CameraModel,
    pose: &Isometry,
) -> Vec<(usize, Point2)> {
    let place = |v: usize| {
        let point = pose * mesh.positions[v];
        let facing = (pose.rotation * normals[v]).dot(&point.coords) < 0.0;
        let pixel = camera.project(&point).filter(|_| facing)?.pixel;
        let [w, h] = camera.size.map(|s| s as f64 - 0.5);
        ((-0.5..w).contains(&pixel.x) && (-0.5..h).contains(&pixel.y)).then_some((v, pixel))
    };
    (0..mesh.positions.len()).filter_map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::synth::Case;

    #[test]
    fn what_is_not_measured_is_red_where_it_is_seen() {
        let case = Case::example(3);
        let (frames, poses) = case.explore(2);
        let mut template = case.template.clone();
        template.camera = Some(case.camera.clone());
        let view = |(frame, pose): (&Frame, &Isometry)| TemplateView {
            name: frame.name.clone(),
            gain: 1.0,
            reprojection_px: 0.5,
            camera_from_template: *pose,
        };
        template.views = frames.iter().zip(&poses).map(view).collect();
        let folder = tempfile::tempdir().unwrap();
        write_measured(&template, &frames, folder.path()).unwrap();
        assert!(!folder.path().join("measured.png").exists());

        template.sigma = vec![0.1; template.mesh.positions.len()];
        let mesh = &template.mesh;
        let normals = vertex_normals(&mesh.topology, &mesh.positions);
        let seen = places(mesh, &normals, &case.camera, &poses[0]);
        let &(v, at) = &seen[seen.len() / 2];
        template.sigma[v] = f64::INFINITY;
        template.views.truncate(1);
        write_measured(&template, &frames, folder.path()).unwrap();
        let drawn = image::open(folder.path().join("measured.png")).unwrap().to_rgb8();
        let [x, y] = [at.x.round() as u32, at.y.round() as u32];
        assert_eq!(drawn.get_pixel(x, y).0, UNMEASURED);
        let &(_, at) = seen.iter().find(|(_, p)| (p - at).norm() > 20.0).unwrap();
        assert_ne!(drawn.get_pixel(at.x.round() as u32, at.y.round() as u32).0, UNMEASURED);
    }
}
