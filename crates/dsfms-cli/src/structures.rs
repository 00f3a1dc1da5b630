//! Hidden structures of `--structures`: read, carried to every frame, drawn and written.

use crate::draw;
use crate::exit::Usage;
use crate::progress::Reporter;
use crate::report::data::{BuriedPlace, ShownStructure, pixels};
use crate::report::embed::{self, Cloud, Numbers};
use dsfms::camera::{Camera, CameraModel};
use dsfms::geometry::{Point2, Point3, Vector3};
use dsfms::image::Frame;
use dsfms::image::distance::distance_to;
use dsfms::io::mesh::read_mesh;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::mesh::Mesh;
use dsfms::mesh::normals::vertex_normals;
use dsfms::pipeline::{Progress, Reconstruction};
use dsfms::raster::{Raster, rasterize};
use dsfms::structures::{Carrier, Depth, depths};
use dsfms::template::Template;
use image::RgbImage;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// As the report's viewer has them.
pub const COLOURS: [[u8; 3]; 4] = [[242, 169, 0], [63, 127, 208], [111, 191, 115], [200, 111, 201]];
/// Widest halo, px.
const WIDEST_HALO: f64 = 60.0;

/// The structures at rest and what carries them.
pub struct Structures {
    items: Vec<Structure>,
    carrier: Carrier,
    rest: Mesh,
    half_extent: f64,
}

/// Widths of a halo at some places in the image.
#[derive(Default)]
struct Halo {
    places: Vec<(Point2, f64)>,
    widest: f64,
}

/// Points of a structure that shape its halo.
const HALO_POINTS: usize = 120;

impl Halo {
    fn new(camera: &CameraModel, points: &[Point3], widths: &[f64]) -> Self {
        let every = points.len().div_ceil(HALO_POINTS).max(1);
        let place = |(p, w): (&Point3, &f64)| Some((camera.project(p)?.pixel, *w));
        let places: Vec<(Point2, f64)> =
            points.iter().zip(widths).step_by(every).filter_map(place).collect();
        let widest = places.iter().map(|p| p.1).fold(0.0, f64::max);
        Self { places, widest }
    }

    /// Between the points, by their squared distances.
    fn at(&self, q: Point2) -> f64 {
        let weigh = |(sum, all): (f64, f64), (p, width): &(Point2, f64)| {
            let weight = 1.0 / ((p - q).norm_squared() + 1.0);
            (sum + weight * width, all + weight)
        };
        let (sum, all) = self.places.iter().fold((0.0, 0.0), weigh);
        (sum / all).max(1e-9)
    }
}

/// A structure in a frame.
pub struct Placed {
    points: Vec<Point3>,
    /// Expected error of every point: it grows with that of the surface above, with the depth under
    /// it and with the deformation.
    errors: Option<Vec<f64>>,
}

impl Placed {
    /// The errors in the image, px.
    fn halo(&self, camera: &CameraModel) -> Option<Vec<f64>> {
        let width =
            |(e, p): (&f64, &Point3)| (camera.focal[0] * e / p.z.max(1e-9)).clamp(0.0, WIDEST_HALO);
        Some(self.errors.as_ref()?.iter().zip(&self.points).map(width).collect())
    }
}

struct Structure {
    name: String,
    mesh: Mesh,
    depths: Vec<Depth>,
    /// How far its points may be off in the template, where the file says it (as of `register-ct`).
    known: Option<Vec<f64>>,
}

/// The name of a structure, which is that of its file and of no other structure.
pub fn own_name<'a>(
    path: &Path,
    mut others: impl Iterator<Item = &'a str>,
) -> Result<String, Usage> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    match others.any(|other| other == name) {
        true => Err(Usage(format!("two structures are called {name}; rename one of the files"))),
        false => Ok(name),
    }
}

impl Structures {
    /// Read the files, in the template's frame and unit; `None` without any.
    pub fn read(
        paths: &[PathBuf],
        template: &Template,
        reporter: &Reporter,
    ) -> anyhow::Result<Option<Self>> {
        if paths.is_empty() {
            return Ok(None);
        }
        let rest = template.mesh.clone();
        let carrier = Carrier::new(&rest)?;
        let middle =
            rest.positions.iter().map(|p| p.coords).sum::<Vector3>() / rest.positions.len() as f64;
        let half_extent =
            rest.positions.iter().map(|p| (p.coords - middle).norm()).fold(0.0, f64::max);
        let mut items = Vec::new();
        for path in paths {
            // A file that states no unit is taken to be in the template's.
            let file = read_mesh(path)?.in_unit(template.unit.into()).map_err(|mismatch| {
                Usage(format!("--structures {} and the template: {mismatch}", path.display()))
            })?;
            let known = file.attributes.get("expected_error").cloned();
            let mesh = file.mesh;
            let depths = depths(&rest, &mesh.positions).unwrap_or_default();
            let far = depths.iter().filter(|d| d.distance > half_extent).count();
            if 2 * far > depths.len() {
                reporter.warn(&format!(
                    "{}: most of it lies farther from the template than the template is large; \
                     structures must be in the template's frame and unit",
                    path.display()
                ));
            }
            let name = own_name(path, items.iter().map(|item: &Structure| item.name.as_str()))?;
            items.push(Structure { name, mesh, depths, known });
        }
        Ok(Some(Self { items, carrier, rest, half_extent }))
    }

    /// Their places in a frame, camera axes, and expected errors where `expected_error` tells those
    /// of the surface's vertices.
    pub fn carry(
        &self,
        vertices: &[Point3],
        expected_error: Option<&[f64]>,
    ) -> anyhow::Result<Vec<Placed>> {
        let carried = self.carrier.carry(vertices)?;
        let deformation = carried.deformation();
        let expected = |d: &Depth| {
            let surface = expected_error.map_or(0.0, |c| c[d.vertex as usize]);
            dsfms::structures::expected_error(surface, d.distance, self.half_extent, deformation)
        };
        let of = |s: &Structure| Placed {
            points: s.mesh.positions.par_iter().map(|p| carried.at(p)).collect(),
            errors: (expected_error.is_some() || s.known.is_some()).then(|| s.errors(&expected)),
        };
        Ok(self.items.iter().map(of).collect())
    }

    /// `OUT/NAME_<structure>.ply`, with the expected error of every point where it is known.
    pub fn write(
        &self,
        folder: &Path,
        name: &str,
        template: &Template,
        places: &[Placed],
    ) -> anyhow::Result<()> {
        for (item, Placed { points, errors }) in self.items.iter().zip(places) {
            // Not frame_*.ply of its own, which would be taken for a reconstructed surface.
            let path = folder.join(format!("structures/{name}_{}.ply", item.name));
            let extras = PlyExtras { expected_error: errors.as_deref(), ..Default::default() };
            write_ply(&path, &item.mesh.topology, points, template.unit, &extras)?;
        }
        Ok(())
    }

    /// Structures from the farthest to the nearest.
    fn far_first(&self, places: &[Placed]) -> Vec<usize> {
        let depth = |k: &usize| {
            let points = &places[*k].points;
            points.iter().map(|p| p.z).sum::<f64>() / points.len().max(1) as f64
        };
        let mut order: Vec<usize> = (0..self.items.len()).collect();
        order.sort_by(|a, b| depth(b).total_cmp(&depth(a)));
        order
    }

    /// For the report.
    pub fn shown(&self) -> Vec<ShownStructure> {
        let of = |s: &Structure| ShownStructure {
            name: s.name.clone(),
            faces: embed::faces(&s.mesh.topology.faces),
        };
        self.items.iter().map(of).collect()
    }

    /// For the report's frame.
    pub fn places(&self, camera: &CameraModel, places: &[Placed]) -> Vec<BuriedPlace> {
        let of = |(item, placed): (&Structure, &Placed)| BuriedPlace {
            at: Cloud::of(&placed.points),
            pixels: pixels(camera, &placed.points),
            under: Numbers::of(&item.depths.iter().map(|d| d.distance).collect::<Vec<f64>>()),
            halo: placed.halo(camera).as_deref().map(Numbers::of),
        };
        self.items.iter().zip(places).map(of).collect()
    }

    /// The structures over the image: fainter the deeper they lie under the surface as the camera
    /// sees it, each in a halo as wide as its expected error there.
    pub fn overlay(
        &self,
        frame: &Frame,
        camera: &CameraModel,
        result: &Reconstruction,
        places: &[Placed],
    ) -> RgbImage {
        let mut canvas = draw::picture(frame);
        self.draw(&mut canvas, camera, &result.vertices, places);
        canvas
    }

    /// The same over a picture; `vertices` of the surface, camera axes.
    pub fn draw(
        &self,
        canvas: &mut RgbImage,
        camera: &CameraModel,
        vertices: &[Point3],
        places: &[Placed],
    ) {
        let surface = rasterize(camera, &self.rest.topology, vertices);
        for k in self.far_first(places) {
            let (item, points) = (&self.items[k], &places[k].points);
            let colour = COLOURS[k % COLOURS.len()];
            let halo = places[k].halo(camera);
            let halo = halo.map(|h| Halo::new(camera, points, &h)).unwrap_or_default();
            item.draw(canvas, camera, &surface, points, colour, (&halo, self.half_extent));
        }
    }
}

impl Structure {
    /// Expected error of every point: of its place in the template, and of how it is carried.
    fn errors(&self, carried: &impl Fn(&Depth) -> f64) -> Vec<f64> {
        let known = |k: usize| self.known.as_ref().map_or(0.0, |errors| errors[k]);
        self.depths.iter().enumerate().map(|(k, d)| carried(d).hypot(known(k))).collect()
    }

    fn draw(
        &self,
        canvas: &mut RgbImage,
        camera: &CameraModel,
        surface: &Raster,
        points: &[Point3],
        colour: [u8; 3],
        (halo, half_extent): (&Halo, f64),
    ) {
        let topology = &self.mesh.topology;
        let normals = vertex_normals(topology, points);
        let raster = rasterize(camera, topology, points);
        let inside = raster.silhouette();
        let [away, within] = [&inside, &inside.complement()].map(distance_to);
        let width = raster.size[0];
        for i in 0..raster.face.len() {
            let (x, y) = ((i % width) as i64, (i / width) as i64);
            let Some(face) = topology.faces.get(raster.face[i] as usize) else {
                let d = f64::from(away.data[i]);
                if d < halo.widest {
                    let width = halo.at(Point2::new(x as f64, y as f64));
                    draw::blend(canvas, x, y, colour, 0.45 * (1.0 - d / width).max(0.0));
                }
                continue;
            };
            let weights = raster.barycentric[i];
            let normal: Vector3 =
                face.iter().zip(weights).map(|(&v, w)| normals[v as usize] * w).sum();
            let facing = normal.try_normalize(0.0).map_or(0.0, |n| n.z.abs());
            let shaded = colour.map(|c| (f64::from(c) * (0.45 + 0.55 * facing)) as u8);
            let under = (raster.depth[i] - surface.depth[i]).max(0.0);
            let fade = (-1.5 * under / half_extent).exp();
            let edge = f64::from(within.data[i]) < 1.5;
            draw::blend(canvas, x, y, shaded, if edge { 0.9 } else { 0.25 + 0.6 * fade });
        }
    }
}
