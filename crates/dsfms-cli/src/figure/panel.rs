//! One panel of a figure: a surface from one side in one of its colourings.

use crate::draw::{self, SideView, Window};
use dsfms::geometry::Vector3;
use dsfms::io::mesh::MeshFile;
use dsfms::mesh::Mesh;
use dsfms::mesh::normals::vertex_normals;
use dsfms::raster::Raster;
use dsfms::template::Template;
use image::RgbImage;

const PAPER: [u8; 3] = [255; 3];
/// What the camera did not see.
pub const UNSEEN: [u8; 3] = [150, 153, 158];

/// Where the viewer stands, degrees from the laparoscope.
#[derive(Clone, Debug)]
pub struct View {
    pub yaw: f64,
    pub pitch: f64,
    pub name: String,
}

/// What a panel shows.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    Shape,
    Albedo,
    Error,
}

/// One surface.
pub struct Surface {
    pub name: String,
    pub file: MeshFile,
    /// Error or expected error per vertex.
    pub values: Option<Vec<f64>>,
    /// Hidden structures.
    pub structures: Vec<Mesh>,
    /// It has no error: the others are measured by it.
    pub is_truth: bool,
}

/// What all panels of a look share.
pub struct Shown<'a> {
    /// Fixes where the viewer stands.
    pub first: &'a Surface,
    pub layer: Layer,
    pub view: &'a View,
    /// What of the view is shown, px of the panel, and px per length unit.
    pub window: Window,
    pub size: [u32; 2],
    pub scale: f64,
    pub template: Option<&'a Template>,
    /// Error at the end of the ramp.
    pub limit: f64,
}

/// The window of a view that holds all surfaces, and a little more.
pub fn window(surfaces: &[Surface], view: &View) -> Window {
    let all = surfaces.iter().map(|s| &s.file.mesh.positions[..]);
    let first = &surfaces[0].file.mesh.positions;
    let mut window = SideView::window(first, all, [view.yaw, view.pitch]);
    for k in 0..2 {
        let margin = 0.02 * (window.high[k] - window.low[k]).max(1e-9);
        window.low[k] -= margin;
        window.high[k] += margin;
    }
    window
}

/// One panel, drawn twice as large and halved, which smooths its edges.
pub fn panel(shown: &Shown, surface: &Surface) -> RgbImage {
    let turned = [shown.view.yaw, shown.view.pitch];
    let size = shown.size.map(|n| 2 * n as usize);
    let first = &shown.first.file.mesh.positions;
    let camera = SideView::through(first, turned, shown.window, size, 2.0 * shown.scale);
    let mesh = &surface.file.mesh;
    let faces = &mesh.topology.faces;
    let texels = shown.template.and_then(|t| t.albedo.as_ref());
    let visible = surface.file.attributes.get("visible");
    let seen = |face: usize| {
        visible.is_none_or(|v| faces[face].iter().all(|&corner| v[corner as usize] != 0.0))
    };
    let colour = |face: usize, w: [f64; 3]| match (shown.layer, texels, &surface.values) {
        (Layer::Albedo, Some(texels), _) => display(texels.at(face, w)),
        (Layer::Error, _, Some(values)) => {
            let value: f64 = faces[face].iter().zip(w).map(|(&v, w)| w * values[v as usize]).sum();
            draw::error_colour(value, shown.limit).map(f64::from)
        }
        _ if !seen(face) => UNSEEN.map(f64::from),
        _ => draw::CLAY.map(f64::from),
    };
    let mut large = camera.render_with(&mesh.topology, &mesh.positions, PAPER, colour);
    if shown.layer == Layer::Shape {
        let under = camera.raster(&mesh.topology, &mesh.positions);
        let extent = shown.window.size().into_iter().fold(0.0, f64::max);
        let colours = crate::structures::COLOURS.iter().cycle();
        for (structure, colour) in surface.structures.iter().zip(colours) {
            draw_structure(&mut large, &camera, &under, structure, *colour, 0.5 * extent);
        }
    }
    let filter = image::imageops::FilterType::Triangle;
    image::imageops::resize(&large, shown.size[0], shown.size[1], filter)
}

/// A structure through the surface, fainter the deeper it lies under it.
fn draw_structure(
    picture: &mut RgbImage,
    camera: &SideView,
    surface: &Raster,
    mesh: &Mesh,
    colour: [u8; 3],
    reach: f64,
) {
    let raster = camera.raster(&mesh.topology, &mesh.positions);
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let width = raster.size[0];
    for i in 0..raster.face.len() {
        let Some(face) = mesh.topology.faces.get(raster.face[i] as usize) else { continue };
        let weights = raster.barycentric[i];
        let normal: Vector3 = face.iter().zip(weights).map(|(&v, w)| normals[v as usize] * w).sum();
        let facing = normal.try_normalize(0.0).map_or(0.0, |n| camera.facing(&n));
        let shaded = colour.map(|c| (f64::from(c) * (0.45 + 0.55 * facing)) as u8);
        let under = (raster.depth[i] - surface.depth[i]).max(0.0);
        let opacity = match under.is_finite() && under > 0.0 {
            true => 0.3 + 0.5 * (-2.0 * under / reach).exp(),
            false => 1.0,
        };
        draw::blend(picture, (i % width) as i64, (i / width) as i64, shaded, opacity);
    }
}

/// Linear light for a screen; an albedo of one half looks bright.
fn display(linear: [f32; 3]) -> [f64; 3] {
    linear.map(|v| 255.0 * (1.6 * f64::from(v)).clamp(0.0, 1.0).powf(1.0 / 2.2))
}
