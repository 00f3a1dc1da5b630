//! `--formats`: reconstructed frames for other programs, beside the PLY files.

use anyhow::Context;
use clap::ValueEnum;
use dsfms::geometry::Point3;
use dsfms::io::animation::{Moment, write_animation};
use dsfms::io::atomic::write_atomic;
use dsfms::io::obj::{ObjExtras, write_mtl, write_obj};
use dsfms::io::stl::write_stl;
use dsfms::io::template::texture;
use dsfms::io::vtk::{Array, VtkExtras, write_pvd, write_vtp};
use dsfms::mesh::strain::{face_strains, vertex_means};
use dsfms::template::Template;
use dsfms::verdict::Region;
use std::path::Path;

/// A format of the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// frame_NNN.vtp and frames.pvd for ParaView and 3D Slicer, with strain, visible,
    /// expected_error, observed and region.
    Vtp,
    /// frame_NNN.obj with the template's UV, frames.mtl and frames.png, the albedo.
    Obj,
    /// frame_NNN.stl.
    Stl,
    /// frames.glb: all frames as one animation with the template's albedo.
    Glb,
}

/// Most frames of an animation: every target is held by the viewer at once.
const MOST_MOMENTS: usize = 250;

/// Material of all OBJ files of a folder; its picture lies beside it.
const MATERIAL: &str = "frames.mtl";

/// A material and its picture, the albedo, which has its name; nothing where there is none.
pub fn write_material(path: &Path, template: &Template) -> anyhow::Result<bool> {
    let Some(png) = texture(template).context("the albedo cannot be laid out")? else {
        return Ok(false);
    };
    // A space would end the name in the material.
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().replace(' ', "_");
    let name = format!("{stem}.png");
    write_atomic(&path.with_file_name(&name), |w| w.write_all(&png))?;
    write_mtl(path, &name)?;
    Ok(true)
}

/// Where and what.
#[derive(Clone, Copy)]
pub struct Formats<'a> {
    pub folder: &'a Path,
    pub template: &'a Template,
    pub list: &'a [Format],
}

/// A surface and what is known of its vertices.
#[derive(Clone, Copy, Default)]
pub struct Shape<'a> {
    pub vertices: &'a [Point3],
    pub visible: Option<&'a [bool]>,
    pub expected_error: Option<&'a [f64]>,
    pub observed: Option<&'a [bool]>,
    pub regions: Option<&'a [Region]>,
}

impl Formats<'_> {
    /// Whether the shapes of all frames are needed at the end.
    pub fn animated(&self) -> bool {
        self.list.contains(&Format::Glb)
    }

    /// The files of one frame, which lies `seconds` after the start.
    pub fn write_frame(&self, name: &str, seconds: f64, shape: &Shape) -> anyhow::Result<()> {
        let path = |ending: &str| self.folder.join(format!("{name}.{ending}"));
        for format in self.list {
            let mesh = || self.template.mesh.with_positions(shape.vertices.to_vec());
            match format {
                Format::Vtp => self.write_vtp(&path("vtp"), seconds, shape)?,
                Format::Obj => {
                    let uv = self.template.flattening.as_ref().map(|f| f.corners.as_slice());
                    let material = self.textured().then_some(MATERIAL);
                    let extras = ObjExtras { uv, material };
                    write_obj(&path("obj"), &mesh(), self.template.unit, &extras)?;
                }
                Format::Stl => write_stl(&path("stl"), &mesh(), self.template.unit)?,
                Format::Glb => {}
            }
        }
        Ok(())
    }

    fn write_vtp(&self, path: &Path, seconds: f64, shape: &Shape) -> anyhow::Result<()> {
        let rest = &self.template.mesh;
        let strain = face_strains(&rest.topology, &rest.positions, shape.vertices);
        let smooth = vertex_means(&rest.topology, &rest.positions, &strain);
        let flags = |f: &[bool]| f.iter().map(|&b| f64::from(u8::from(b))).collect::<Vec<f64>>();
        let (visible, observed) = (shape.visible.map(flags), shape.observed.map(flags));
        let number = |r: &Region| f64::from(*r as u8);
        let regions = shape.regions.map(|r| r.iter().map(number).collect::<Vec<f64>>());
        let optional = [
            ("visible", visible.as_deref()),
            ("expected_error", shape.expected_error),
            ("observed", observed.as_deref()),
            ("region", regions.as_deref()),
        ];
        let mut vertices = vec![Array { name: "strain", values: &smooth }];
        vertices
            .extend(optional.into_iter().filter_map(|(name, v)| Some(Array { name, values: v? })));
        let extras = VtkExtras {
            vertices: &vertices,
            faces: &[Array { name: "strain", values: &strain }],
            time: Some(seconds),
            comment: "camera axes of the frame: x right, y down, z forward",
        };
        Ok(write_vtp(path, &rest.topology, shape.vertices, self.template.unit, &extras)?)
    }

    /// Whether there is an albedo, and UV to lay it out by.
    fn textured(&self) -> bool {
        self.template.albedo.is_some() && self.template.flattening.is_some()
    }

    /// The files of the sequence: name, seconds and shape of every frame that has one.
    pub fn write_series(&self, frames: &[(String, f64, Vec<Point3>)]) -> anyhow::Result<()> {
        if self.list.contains(&Format::Obj) && !frames.is_empty() {
            write_material(&self.folder.join(MATERIAL), self.template)?;
        }
        if self.list.contains(&Format::Vtp) {
            let files: Vec<(f64, String)> =
                frames.iter().map(|(name, t, _)| (*t, format!("{name}.vtp"))).collect();
            write_pvd(&self.folder.join("frames.pvd"), &files)?;
        }
        if self.animated() && !frames.is_empty() {
            let every = frames.len().div_ceil(MOST_MOMENTS);
            let moments: Vec<Moment> = frames
                .iter()
                .step_by(every)
                .map(|(_, seconds, vertices)| Moment { seconds: *seconds, vertices })
                .collect();
            write_animation(&self.folder.join("frames.glb"), self.template, &moments)?;
        }
        Ok(())
    }
}
