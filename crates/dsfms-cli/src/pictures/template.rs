//! A template to look at: distortion of the flattening, albedo and its spread over the charts.

use super::TEXT;
use crate::draw::{error_colour, line};
use crate::outputs::{prepare_folder, write_png};
use crate::sheet::colours::{INK, diverging};
use crate::sheet::legend::ColourBar;
use crate::sheet::{Anchor, Item, raster};
use anyhow::Context;
use dsfms::camera::PosedFrame;
use dsfms::geometry::{Point2, Vector2, barycentric};
use dsfms::image::{Frame, Mask, viewport};
use dsfms::template::bake::bake;
use dsfms::template::texture::Texture;
use dsfms::template::{Flattening, SurfaceTexels, Template, TemplateView};
use image::{Rgb, RgbImage};
use std::path::{Path, PathBuf};

/// Px per unit of UV.
const SIDE: u32 = 900;
/// Least height of a picture's charts, px: room for the colour bar.
const MIN_HEIGHT: u32 = 320;
/// Side of a texture atlas, and how far its charts are grown, px.
const ATLAS: u32 = 2048;
const ATLAS_MARGIN: usize = 8;
const TOP: u32 = 44;
const MARGIN: u32 = 20;
/// Room for a colour bar with its labels, px.
const BAR: u32 = 110;
/// Where fewer than two views saw the surface.
const UNSEEN: [u8; 3] = [205, 208, 214];
const PAPER: [u8; 3] = [255; 3];
const SEAM: [u8; 3] = [0, 158, 115];
const FLIPPED: [u8; 3] = [255, 0, 255];

/// Write what the template has: `flattening.png`, and with an albedo `albedo.png` and
/// `albedo_spread.png`. Returns the files.
pub fn write_pictures(template: &Template, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    prepare_folder(folder)?;
    let Some(map) = &template.flattening else { return Ok(Vec::new()) };
    let mut pictures = vec![("flattening.png", flattening(template, map))];
    if let Some(albedo) = &template.albedo {
        pictures.push(("albedo.png", albedo_picture(map, albedo)));
        pictures.push(("albedo_spread.png", spread_picture(map, albedo)));
    }
    let mut written = Vec::new();
    for (name, picture) in pictures {
        let path = folder.join(name);
        write_png(&path, &picture)?;
        written.push(path);
    }
    Ok(written)
}

/// Write the look of the surface in its frames: `texture.png`, every face from its best view, and
/// `texture_blended.png`, all views; the same as plain images laid out by the UV of `template.glb`,
/// `atlas.png` and `atlas_blended.png`. `valid` holds one mask a frame, or nothing.
pub fn write_textures(
    template: &Template,
    frames: &[Frame],
    valid: &[Option<Mask>],
    folder: &Path,
) -> anyhow::Result<()> {
    let (Some(map), Some(camera)) = (&template.flattening, &template.camera) else {
        return Ok(());
    };
    let lit = viewport(frames);
    let masks: Vec<Option<Mask>> = (0..frames.len())
        .map(|i| match (valid.get(i).and_then(Option::as_ref), &lit) {
            (Some(own), Some(lit)) => Some(own.and(lit)),
            (own, lit) => own.or(lit.as_ref()).cloned(),
        })
        .collect();
    let view = |v: &TemplateView| {
        let i = frames.iter().position(|f| f.name == v.name)?;
        let (pose, valid) = (v.camera_from_template, masks[i].as_ref());
        Some(PosedFrame { valid, ..PosedFrame::new(&frames[i], camera, pose) })
    };
    let views: Vec<PosedFrame> = template.views.iter().filter_map(view).collect();
    let texture = Texture::new(&template.mesh, &views);
    let draw = |name: &str, title: &str, colour: &dyn Fn(usize, [f64; 3]) -> Option<[u8; 3]>| {
        let mut canvas = Charts::canvas(map, 1);
        let charts = Charts::new(map, 0);
        charts.fill(&mut canvas, |f, w| colour(f, w).unwrap_or(UNSEEN));
        charts.title(&mut canvas, title);
        write_png(&folder.join(name), &canvas)?;
        let atlas = atlas(template, map, colour)?;
        write_png(&folder.join(name.replace("texture", "atlas")), &atlas)
    };
    let title = "texture: each face from its best view; grey: not seen without glare";
    draw("texture.png", title, &|f, w| texture.best(f, w))?;
    let title = "texture: all views, blended by resolution; grey: not seen without glare";
    draw("texture_blended.png", title, &|f, w| texture.blended(f, w))
}

/// Colours as one image over UV, row 0 at v = 1, charts grown over their rims for bilinear lookups.
fn atlas(
    template: &Template,
    map: &Flattening,
    colour: &dyn Fn(usize, [f64; 3]) -> Option<[u8; 3]>,
) -> anyhow::Result<RgbImage> {
    let faces = template.mesh.topology.faces.len();
    let resolution = template.albedo.as_ref().map(|a| a.resolution.clone());
    let mut texels = SurfaceTexels::new(resolution.unwrap_or_else(|| vec![16; faces]));
    for face in 0..faces {
        let first = texels.offset[face] as usize;
        for (texel, b) in (first..).zip(texels.centres(face)) {
            texels.value[texel] = colour(face, b).unwrap_or(UNSEEN).map(f32::from);
        }
    }
    let baked = bake(&texels, map, ATLAS as usize, ATLAS_MARGIN)?;
    let pixels = baked.image.data.iter().flatten().map(|v| v.round() as u8).collect();
    RgbImage::from_raw(ATLAS, ATLAS, pixels).context("an atlas of another size than its pixels")
}

/// Charts coloured by a value per place, above the empty part of `[0, 1]²`; several stand side by
/// side.
struct Charts<'a> {
    map: &'a Flattening,
    /// Left end, upper end and height, px.
    left: u32,
    top: u32,
    high: u32,
}

impl<'a> Charts<'a> {
    fn new(map: &'a Flattening, column: u32) -> Self {
        let left = MARGIN + column * (SIDE + BAR + MARGIN);
        Self { map, left, top: TOP, high: Self::height(map) }
    }

    fn height(map: &Flattening) -> u32 {
        let top = map.corners.iter().flatten().map(|p| p.y).fold(0.0, f64::max);
        ((top * f64::from(SIDE)).ceil() as u32).max(MIN_HEIGHT)
    }

    fn canvas(map: &Flattening, columns: u32) -> RgbImage {
        let width = MARGIN + columns * (SIDE + BAR + MARGIN);
        RgbImage::from_pixel(width, TOP + Self::height(map) + MARGIN, Rgb(PAPER))
    }

    fn corners(&self, face: usize) -> [Point2; 3] {
        let [x, y] = [self.left, self.top + self.high].map(f64::from);
        self.map.corners[face]
            .map(|p| Point2::new(x, y) + Vector2::new(p.x, -p.y) * f64::from(SIDE))
    }

    /// Colour every pixel of every face; `colour` gets the face and the barycentrics.
    fn fill(&self, canvas: &mut RgbImage, colour: impl Fn(usize, [f64; 3]) -> [u8; 3]) {
        for face in 0..self.map.corners.len() {
            let corners = self.corners(face);
            let low = |k: usize| corners.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min).floor();
            let high = |k: usize| corners.iter().map(|p| p[k]).fold(0.0, f64::max).ceil();
            let solid = corners.map(|p| p.coords.push(0.0).into());
            for y in low(1) as u32..=high(1) as u32 {
                for x in low(0) as u32..=high(0) as u32 {
                    let p = Point2::new(f64::from(x), f64::from(y)).coords.push(0.0).into();
                    let [a, b, c] = &solid;
                    let Some(w) = barycentric(&p, [a, b, c]) else { continue };
                    if w.iter().all(|&w| w >= -1e-9) && x < canvas.width() && y < canvas.height() {
                        canvas.put_pixel(x, y, Rgb(colour(face, w)));
                    }
                }
            }
        }
    }

    /// Thin lines along the edges, thick ones along the seam.
    fn lines(&self, canvas: &mut RgbImage, template: &Template) {
        let opacity = (600.0 / self.map.corners.len() as f64).clamp(0.08, 0.35);
        let seam = |a: u32, b: u32| self.map.seam.binary_search(&[a.min(b), a.max(b)]).is_ok();
        for (f, face) in template.mesh.topology.faces.iter().enumerate() {
            let corners = self.corners(f);
            for k in 0..3 {
                let (p, q) = (corners[k], corners[(k + 1) % 3]);
                if seam(face[k], face[(k + 1) % 3]) {
                    for shift in [-1.0, 0.0, 1.0] {
                        let d = across(p, q, shift);
                        line(canvas, p + d, q + d, SEAM, 1.0);
                    }
                } else {
                    line(canvas, p, q, INK, opacity);
                }
            }
        }
    }

    fn bar(&self, canvas: &mut RgbImage, colour: impl Fn(f64) -> [u8; 3], ticks: &[(f64, String)]) {
        let high = 0.75 * f64::from(self.high);
        let at = [f64::from(self.left + SIDE + 14), f64::from(TOP) + high / 6.0];
        let bar = ColourBar { at, size: [18.0, high], colour: &colour, ticks, text: TEXT };
        raster::draw(canvas, &bar.items(), 1.0);
    }

    fn title(&self, canvas: &mut RgbImage, words: &str) {
        let at = [f64::from(self.left), 28.0];
        raster::draw(canvas, &[Item::text(at, Anchor::Start, TEXT, words)], 1.0);
    }
}

/// A pixel across a line.
fn across(p: Point2, q: Point2, by: f64) -> Vector2 {
    let d = q - p;
    Vector2::new(-d.y, d.x) * (by / d.norm().max(1e-9))
}

/// Left: area distortion, red where the chart is too large, blue where too small. Right: ratio of
/// the singular values. The seam is green, folded faces are magenta.
fn flattening(template: &Template, map: &Flattening) -> RgbImage {
    let mut canvas = Charts::canvas(map, 2);
    let folded = folded(map);
    let full = quantile(map.log_area.iter().map(|v| v.abs()), 0.99).max(0.05);
    let left = Charts::new(map, 0);
    let own = |f: usize, c: [u8; 3]| if folded[f] { FLIPPED } else { c };
    left.fill(&mut canvas, |f, _| own(f, diverging(map.log_area[f] / full)));
    left.lines(&mut canvas, template);
    let factor = |t: f64| format!("×{:.2}", (full * (2.0 * t - 1.0)).exp());
    let ticks: Vec<_> = [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| (t, factor(t))).to_vec();
    left.bar(&mut canvas, |t| diverging(2.0 * t - 1.0), &ticks);
    let seam = match map.seam.len() {
        0 => "no cut".into(),
        n => format!("green: cut along {n} edges"),
    };
    left.title(&mut canvas, &format!("area in the chart / area on the surface; {seam}"));
    let right = Charts::new(map, 1);
    let worst = (quantile(map.quasi_conformal.iter().copied(), 0.99) - 1.0).max(0.01);
    right.fill(&mut canvas, |f, _| own(f, error_colour(map.quasi_conformal[f] - 1.0, worst)));
    right.lines(&mut canvas, template);
    let ratio = |t: f64| (t, format!("{:.3}", 1.0 + worst * t));
    right.bar(&mut canvas, |t| error_colour(t, 1.0), &[0.0, 0.25, 0.5, 0.75, 1.0].map(ratio));
    let count = folded.iter().filter(|f| **f).count();
    let words = format!("quasi-conformal ratio (1 = angles kept); {count} folded faces");
    right.title(&mut canvas, &words);
    canvas
}

fn folded(map: &Flattening) -> Vec<bool> {
    let folds = |[a, b, c]: &[Point2; 3]| (b - a).perp(&(c - a)) <= 0.0;
    map.corners.iter().map(folds).collect()
}

fn albedo_picture(map: &Flattening, albedo: &SurfaceTexels) -> RgbImage {
    let mut canvas = Charts::canvas(map, 1);
    let charts = Charts::new(map, 0);
    let grey = |v: &[f32; 3]| f64::from(v[0] + v[1] + v[2]) / 3.0;
    let full = quantile(albedo.value.iter().map(grey), 0.995).max(1e-6);
    let encoded = |v: f64| (255.0 * (v / full).clamp(0.0, 1.0).powf(1.0 / 2.2)).round() as u8;
    charts.fill(&mut canvas, |f, w| albedo.at(f, w).map(|v| encoded(f64::from(v))));
    let ticks = [0.0, 0.25, 0.5, 0.75, 1.0].map(|t: f64| (t, format!("{:.3}", full * t)));
    charts.bar(&mut canvas, |t| [encoded(full * t); 3], &ticks);
    charts.title(&mut canvas, "albedo, linear units (shown with gamma 2.2)");
    canvas
}

fn spread_picture(map: &Flattening, albedo: &SurfaceTexels) -> RgbImage {
    let mut canvas = Charts::canvas(map, 1);
    let charts = Charts::new(map, 0);
    // One view has no spread, and filled-in texels have none of their own.
    let seen = |i: usize| albedo.views[i] > 1 && albedo.spread[i].is_finite();
    let places = 0..albedo.spread.len();
    let values = places.filter(|&i| seen(i)).map(|i| f64::from(albedo.spread[i]));
    let full = quantile(values, 0.99).max(1e-6);
    charts.fill(&mut canvas, |f, w| {
        let i = albedo.index(f, w);
        if seen(i) { error_colour(f64::from(albedo.spread[i]), full) } else { UNSEEN }
    });
    let ticks = [0.0, 0.25, 0.5, 0.75, 1.0].map(|t: f64| (t, format!("{:.4}", full * t)));
    charts.bar(&mut canvas, |t| error_colour(t, 1.0), &ticks);
    let words =
        "standard deviation of the albedo across views, linear units; grey: fewer than two views";
    charts.title(&mut canvas, words);
    canvas
}

/// Nearest-rank quantile; 0 of nothing.
fn quantile(values: impl Iterator<Item = f64>, q: f64) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let rank = (sorted.len().saturating_sub(1) as f64 * q).round() as usize;
    sorted.get(rank).copied().unwrap_or(0.0)
}
