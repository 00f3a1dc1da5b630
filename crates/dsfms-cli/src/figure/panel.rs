//! One panel of a figure: a surface from one side in one of its colourings.

use crate::draw::{self, SideView};
use dsfms::geometry::Vector3;
use dsfms::io::mesh::MeshFile;
use dsfms::mesh::Mesh;
use dsfms::mesh::normals::vertex_normals;
use dsfms::raster::Raster;
use dsfms::template::Template;
use image::RgbImage;

const PAPER: [u8; 3] = [255; 3];
/// What the camera did not see.
const UNSEEN: [f64; 3] = [150.0, 153.0, 158.0];

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
pub struct Row {
    pub name: String,
    pub file: MeshFile,
    /// Error or expected error per vertex.
    pub values: Option<Vec<f64>>,
    /// Hidden structures.
    pub structures: Vec<Mesh>,
}

/// What all panels share.
#[derive(Clone, Copy)]
pub struct Scale {
    /// Side of a panel, px.
    pub panel: u32,
    /// Error at the end of the ramp.
    pub limit: f64,
    /// Half a panel, length units.
    pub reach: f64,
}

/// One panel, drawn twice as large and halved, which smooths its edges.
pub fn panel(
    first: &Row,
    row: &Row,
    (layer, view): (Layer, &View),
    template: Option<&Template>,
    scale: Scale,
) -> RgbImage {
    let camera = camera(first, view, 2 * scale.panel as usize, scale.reach);
    let mesh = &row.file.mesh;
    let faces = &mesh.topology.faces;
    let texels = template.and_then(|t| t.albedo.as_ref());
    let visible = row.file.attributes.get("visible");
    let seen = |face: usize| {
        visible.is_none_or(|v| faces[face].iter().all(|&corner| v[corner as usize] != 0.0))
    };
    let colour = |face: usize, w: [f64; 3]| match (layer, texels, &row.values) {
        (Layer::Albedo, Some(texels), _) => display(texels.at(face, w)),
        (Layer::Error, _, Some(values)) => {
            let value: f64 = faces[face].iter().zip(w).map(|(&v, w)| w * values[v as usize]).sum();
            draw::error_colour(value, scale.limit).map(f64::from)
        }
        _ if !seen(face) => UNSEEN,
        _ => draw::CLAY.map(f64::from),
    };
    let mut large = camera.render_with(&mesh.topology, &mesh.positions, PAPER, colour);
    if layer == Layer::Shape {
        let surface = camera.raster(&mesh.topology, &mesh.positions);
        for (structure, colour) in
            row.structures.iter().zip(crate::structures::COLOURS.iter().cycle())
        {
            draw_structure(&mut large, &camera, &surface, structure, *colour, scale.reach);
        }
    }
    let filter = image::imageops::FilterType::Triangle;
    image::imageops::resize(&large, scale.panel, scale.panel, filter)
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

/// All rows are seen from the place that the first one fixes.
pub fn camera(first: &Row, view: &View, side: usize, reach: f64) -> SideView {
    SideView::fitted(&first.file.mesh.positions, [side, side], view.yaw, view.pitch, reach)
}

/// One scale for all panels.
pub fn reach(views: &[View], rows: &[Row]) -> f64 {
    let of = |r: &Row, v: &View| SideView::reach(&r.file.mesh.positions, v.yaw, v.pitch);
    rows.iter().flat_map(|r| views.iter().map(move |v| of(r, v))).fold(0.0, f64::max)
}

/// Linear light for a screen; an albedo of one half looks bright.
fn display(linear: [f32; 3]) -> [f64; 3] {
    linear.map(|v| 255.0 * (1.6 * f64::from(v)).clamp(0.0, 1.0).powf(1.0 / 2.2))
}
