//! `dsfms experiment table1`: the methods side by side (the paper's Table 1, with the truth).

use super::place_args::PlaceArgs;
use super::series::{SeriesArgs, percent};
use crate::args::Global;
use crate::draw::overlay::overlay;
use crate::draw::{SideView, error_colour, picture};
use crate::exit::Outcome;
use crate::outputs::{write_png, write_text};
use crate::progress::Reporter;
use crate::report::experiment::case_page;
use crate::sheet::legend::ColourBar;
use crate::sheet::{Anchor, Sheet, raster};
use crate::stdout::to_stdout;
use clap::Args;
use dsfms::camera::CameraModel;
use dsfms::experiment::{arms_of, measure, surface};
use dsfms::geometry::Point3;
use dsfms::pipeline::{Method, Progress, ReconstructOptions};
use dsfms::raster::{Raster, rasterize};
use dsfms::synth::{Case, Cell, RenderOptions, render};
use image::{Rgb, RgbImage, imageops};

#[derive(Debug, Args)]
pub struct Table1Args {
    #[command(flatten)]
    series: SeriesArgs,
    /// Extension, percent.
    #[arg(long, default_value = "10", value_parser = percent)]
    ext: f64,
    #[command(flatten)]
    place: PlaceArgs,
}

const METHODS: [(&str, Method); 4] = [
    ("SfS", Method::Sfs),
    ("DSfM", Method::Dsfm),
    ("DSfMS", Method::Dsfms),
    ("joint", Method::Joint),
];

const FILES: [&str; 5] =
    ["table1.md", "table1_pull.png", "table1_pull.html", "table1_push.png", "table1_push.html"];

/// Size of a picture in the grid, px: half of the camera's.
const TILE: [u32; 2] = [360, 288];
/// Room for a heading above every block.
const HEAD: u32 = 26;
/// Size of the letters, px.
const TEXT: f64 = 16.0;
const PAPER: [u8; 3] = [255; 3];

/// Two cases, a pull and a push, one PNG and one page in 3D each.
pub fn run(args: &Table1Args, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let organ = args.series.organ()?;
    let protocol = args.series.protocol(global.seed());
    let options = args.place.options()?;
    args.place.take(|name| FILES.contains(&name))?;
    let cell = Cell { extension: args.ext, noise: args.series.noise[0] };
    let mut text = String::from(
        "| case | error | SfS | DSfM | DSfMS | joint |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    for (index, name) in ["pull", "push"].into_iter().enumerate() {
        reporter.step("cases", index, 2);
        let case = organ.case(&protocol, cell, index)?;
        let shapes = METHODS.map(|(_, method)| shape(&case, method, &options));
        text += &figures(name, &case, &shapes);
        write_png(&args.place.output.join(format!("table1_{name}.png")), &grid(&case, &shapes))?;
        let what =
            format!("Organ {}, extension {} %, seed {}", organ.name(), args.ext, global.seed());
        case_page(name, case, &arms_of(&METHODS.map(|m| m.1), &options), &what)?
            .write(&args.place.output.join(format!("table1_{name}.html")))?;
    }
    reporter.finish();
    let text = format!(
        "Extension {} %, organ {}, {} cases of seed {}: pull and push. Columns: SfS, DSfM, DSfMS, joint, \
         truth. Rows: as the laparoscope would see the shape; from the side; error from 0 (blue) to \
         the largest displacement (yellow).\n\n{text}",
        args.ext,
        organ.name(),
        2,
        global.seed()
    );
    write_text(&args.place.output.join("table1.md"), &text)?;
    to_stdout(&text)?;
    Ok(Outcome::Ok)
}

/// The surface of a method; `None` where it gives none.
fn shape(case: &Case, method: Method, options: &ReconstructOptions) -> Option<Vec<Point3>> {
    Some(surface(case, method, options).ok()?.vertices)
}

fn figures(name: &str, case: &Case, shapes: &[Option<Vec<Point3>>; 4]) -> String {
    let errors = shapes.each_ref().map(|s| s.as_ref().map(|s| measure(case, s)));
    ["zone, mm", "whole surface, mm"]
        .into_iter()
        .enumerate()
        .map(|(k, what)| {
            let value = |e: Option<f64>| e.map_or("-".to_owned(), |e| format!("{e:.3}"));
            let pick = |e: &Option<_>| {
                value(e.as_ref().map(|e: &dsfms::experiment::Errors| [e.zone, e.rms][k]))
            };
            format!("| {name} | {what} | {} |\n", errors.each_ref().map(pick).join(" | "))
        })
        .collect()
}

fn grid(case: &Case, shapes: &[Option<Vec<Point3>>; 4]) -> RgbImage {
    let [w, h] = TILE;
    let mut sheet = Sheet::in_pixels(6 * w, 3 * (h + HEAD));
    let mut put = |column: u32, row: u32, title: &str, tile: RgbImage| {
        let (x, y) = (column * w, row * (h + HEAD));
        sheet.put([x, y + HEAD], tile);
        sheet.write([f64::from(x) + 8.0, f64::from(y) + 19.0], Anchor::Start, TEXT, title);
    };
    let topology = &case.template.mesh.topology;
    let half = |p: &RgbImage| imageops::resize(p, w, h, imageops::FilterType::Triangle);
    put(0, 0, "image", half(&picture(&case.frame)));
    let matches: Vec<_> = case.matches.iter().map(|m| (*m, true)).collect();
    let shown = overlay(&case.frame, &case.camera, topology, &case.truth, &case.visible, &matches);
    put(0, 1, "truth mesh", half(&shown));
    let side = SideView::of(&case.truth, TILE.map(|s| s as usize * 5 / 4));
    let rest = &case.template.mesh.positions;
    let moved = case.deformation.vertices.iter().zip(rest).map(|(a, b)| (a - b).norm());
    let full = moved.fold(1e-3, f64::max);
    put(0, 2, "error, mm", ramp(full));
    let columns = METHODS.iter().map(|m| m.0).zip(shapes.iter().map(Option::as_deref));
    for (k, (name, shape)) in columns.chain([("truth", Some(&case.truth[..]))]).enumerate() {
        let Some(shape) = shape else { continue };
        let column = k as u32 + 1;
        let front = rasterize(&halved(&case.camera), topology, shape);
        put(column, 0, name, textured(case, shape));
        put(column, 1, &format!("{name} side"), side_view(case, &side, shape));
        let zone = measure(case, shape).zone;
        put(column, 2, &format!("{name} {zone:.2} mm"), errors(case, shape, &front, full));
    }
    raster::pixels(&sheet, 1.0)
}

/// The camera of a picture of half the size.
fn halved(camera: &CameraModel) -> CameraModel {
    let mut half = camera.clone();
    half.size = camera.size.map(|s| s / 2);
    half.focal = camera.focal.map(|f| 0.5 * f);
    half.centre = camera.centre.map(|c| 0.5 * (c + 0.5) - 0.5);
    half
}

fn paint(raster: &Raster, colour: impl Fn(usize, [f64; 3]) -> [u8; 3] + Sync) -> RgbImage {
    let pixels = raster.render(PAPER, colour);
    let [w, h] = raster.size.map(|s| s as u32);
    RgbImage::from_fn(w, h, |x, y| Rgb(pixels[(y * w + x) as usize]))
}

/// As the laparoscope would see the shape, without highlights.
fn textured(case: &Case, shape: &[Point3]) -> RgbImage {
    let template = &case.template;
    let mesh = template.mesh.with_positions(shape.to_vec());
    let look = RenderOptions { noise: 0.0, ..Default::default() };
    let (light, albedo) = (template.light.clone(), template.albedo.clone());
    let (light, albedo) = (light.unwrap_or_default(), albedo.unwrap_or_default());
    picture(&render(&halved(&case.camera), &light, &mesh, &albedo, &look))
}

/// A view from the side, a little enlarged.
fn side_view(case: &Case, view: &SideView, shape: &[Point3]) -> RgbImage {
    let large = view.render(&case.template.mesh.topology, shape, None);
    let [w, h] = TILE;
    imageops::crop_imm(&large, (large.width() - w) / 2, (large.height() - h) / 2, w, h).to_image()
}

fn errors(case: &Case, shape: &[Point3], raster: &Raster, full: f64) -> RgbImage {
    let faces = &case.template.mesh.topology.faces;
    paint(raster, |face, b| {
        let error = |v: u32| (shape[v as usize] - case.truth[v as usize]).norm();
        let value: f64 = faces[face].iter().zip(b).map(|(&v, w)| w * error(v)).sum();
        error_colour(value, full)
    })
}

/// The scale of the error colours.
fn ramp(full: f64) -> RgbImage {
    let [w, h] = TILE;
    let ticks = [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| (t, format!("{:.1}", full * t)));
    let bar = ColourBar {
        at: [30.0, f64::from(h) / 2.0 - 14.0],
        size: [f64::from(w) - 60.0, 28.0],
        colour: &|t| error_colour(t, 1.0),
        ticks: &ticks,
        text: TEXT,
    };
    let mut tile = Sheet::in_pixels(w, h);
    tile.items = bar.items();
    raster::pixels(&tile, 1.0)
}
