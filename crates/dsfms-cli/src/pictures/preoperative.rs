//! A preoperative surface on a template, from three sides.

use super::TEXT;
use crate::commands::register_ct::carried::Carried;
use crate::draw::{CLAY, SideView, blend, error_colour};
use crate::sheet::legend::ColourBar;
use crate::sheet::{Anchor, Ink, Item, Sheet, raster};
use crate::structures::COLOURS;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::mesh::Mesh;
use dsfms::mesh::normals::vertex_normals;
use dsfms::nalgebra::{Translation3, UnitQuaternion};
use dsfms::preoperative::Preoperative;
use dsfms::raster::Raster;
use image::RgbImage;

/// Side of a panel, and height of the line of text under them, px.
const PANEL: u32 = 420;
const LINE: u32 = 26;
/// Height of the legend, px.
const LEGEND: u32 = 46;
const PAPER: [u8; 3] = [255; 3];
/// Turned to the right and upwards, degrees: from the front, from the side, from above.
const SIDES: [(&str, f64, f64); 3] =
    [("front", 0.0, 0.0), ("side", 75.0, 0.0), ("above", 0.0, 75.0)];
const CT: [u8; 3] = [86, 140, 190];
/// No partner on the other surface.
const ALONE: [f64; 3] = [200.0, 90.0, 160.0];

/// What is drawn.
pub struct ShownRegistration<'a> {
    pub template: &'a Mesh,
    /// Topology of the preoperative mesh.
    pub ct: &'a Mesh,
    pub found: &'a Preoperative,
    pub carried: &'a [Carried],
}

/// Above: the CT surface (blue, see-through) over the template (clay) and the structures; below:
/// the template with its distances from the CT surface.
pub fn draw(shown: &ShownRegistration) -> RgbImage {
    let mut sheet = Sheet::in_pixels(PANEL * SIDES.len() as u32, 2 * PANEL + LINE + LEGEND);
    let turn = facing(shown.template);
    let turned = |points: &[Point3]| points.iter().map(|p| turn * p).collect::<Vec<_>>();
    let (template, ct) = (turned(&shown.template.positions), turned(&shown.found.vertices));
    let structures: Vec<Vec<Point3>> =
        shown.carried.iter().map(|c| turned(&c.mesh.positions)).collect();
    let (values, full) = residuals(shown);
    for (k, (name, yaw, pitch)) in (0..).zip(SIDES) {
        let reach = SideView::reach(&ct, yaw, pitch).max(SideView::reach(&template, yaw, pitch));
        let view = SideView::fitted(&ct, [PANEL as usize; 2], yaw, pitch, 1.05 * reach);
        let overlay = overlaid(shown, &view, &template, &ct, &structures);
        sheet.put([k * PANEL, 0], overlay);
        let coloured = distances(shown, &view, &template, &values, full);
        sheet.put([k * PANEL, PANEL + LINE], coloured);
        let middle = f64::from(k * PANEL + PANEL / 2);
        sheet.write([middle, f64::from(PANEL) + 17.0], Anchor::Middle, TEXT, name);
    }
    sheet.items.extend(legend(shown, full));
    raster::pixels(&sheet, 1.0)
}

/// What the colours of the lower row mean.
fn legend(shown: &ShownRegistration, full: f64) -> Vec<Item> {
    let y = f64::from(2 * PANEL + LINE) + 8.0;
    let rms = shown.found.bent.unwrap_or(shown.found.rigid).rms;
    let words = format!("distance from the template to CT, rms {rms:.2} mm");
    let bar = ColourBar {
        at: [430.0, y],
        size: [360.0, 14.0],
        colour: &|t| error_colour(t, 1.0),
        ticks: &[
            (0.0, "0".into()),
            (0.5, format!("{:.1}", 0.5 * full)),
            (1.0, format!("≥{full:.1} mm")),
        ],
        text: TEXT,
    };
    let mut items = bar.items();
    items.push(Item::text([410.0, y + 12.0], Anchor::End, TEXT, words));
    let alone = ALONE.map(|v| v as u8);
    items.push(Item::block([850.0, y], [14.0, 14.0], Ink::Rgb(alone)));
    items.push(Item::text([872.0, y + 12.0], Anchor::Start, TEXT, "no partner on the CT surface"));
    items
}

/// Turns what the template shows towards the viewer (−z).
fn facing(mesh: &Mesh) -> Isometry {
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let sum: Vector3 = normals.iter().sum();
    let turn = UnitQuaternion::rotation_between(&sum, &-Vector3::z()).unwrap_or_default();
    Isometry::from_parts(Translation3::identity(), turn)
}

fn overlaid(
    shown: &ShownRegistration,
    view: &SideView,
    template: &[Point3],
    ct: &[Point3],
    structures: &[Vec<Point3>],
) -> RgbImage {
    let mut picture =
        view.render_with(&shown.template.topology, template, PAPER, |_, _| CLAY.map(f64::from));
    let surface = view.raster(&shown.template.topology, template);
    for ((item, points), colour) in shown.carried.iter().zip(structures).zip(COLOURS.iter().cycle())
    {
        let mesh = item.mesh.with_positions(points.clone());
        through(&mut picture, view, &mesh, &surface, *colour, [0.85, 0.5]);
    }
    let mesh = shown.ct.with_positions(ct.to_vec());
    through(&mut picture, view, &mesh, &surface, CT, [0.45, 0.2]);
    picture
}

/// A mesh over the picture: opacity in front of the surface and behind it.
fn through(
    picture: &mut RgbImage,
    view: &SideView,
    mesh: &Mesh,
    surface: &Raster,
    colour: [u8; 3],
    opacity: [f64; 2],
) {
    let raster = view.raster(&mesh.topology, &mesh.positions);
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let side = raster.size[0];
    for i in 0..raster.face.len() {
        let Some(face) = mesh.topology.faces.get(raster.face[i] as usize) else { continue };
        let weights = raster.barycentric[i];
        let normal: Vector3 = face.iter().zip(weights).map(|(&v, w)| normals[v as usize] * w).sum();
        let shade = 0.4 + 0.6 * normal.try_normalize(0.0).map_or(0.0, |n| view.facing(&n));
        let shaded = colour.map(|c| (f64::from(c) * shade) as u8);
        let hidden = usize::from(raster.depth[i] > surface.depth[i]);
        blend(picture, (i % side) as i64, (i / side) as i64, shaded, opacity[hidden]);
    }
}

/// Distance at every vertex of the template, of the nearest sample, and the end of the scale, mm.
fn residuals(shown: &ShownRegistration) -> (Vec<Option<f64>>, f64) {
    let samples = &shown.found.samples;
    let nearest = |p: &Point3| {
        let away = |k: &usize| (samples[*k].point - p).norm_squared();
        let k = (0..samples.len()).min_by(|a, b| away(a).total_cmp(&away(b)))?;
        shown.found.distances[k]
    };
    let values = shown.template.positions.iter().map(nearest).collect();
    let residual = shown.found.bent.unwrap_or(shown.found.rigid);
    (values, residual.p95.max(1.0))
}

fn distances(
    shown: &ShownRegistration,
    view: &SideView,
    template: &[Point3],
    values: &[Option<f64>],
    full: f64,
) -> RgbImage {
    let faces = &shown.template.topology.faces;
    view.render_with(&shown.template.topology, template, PAPER, |face, w| {
        let mut sum = 0.0;
        for (&v, w) in faces[face].iter().zip(w) {
            let Some(value) = values[v as usize] else { return ALONE };
            sum += w * value;
        }
        error_colour(sum, full).map(f64::from)
    })
}
