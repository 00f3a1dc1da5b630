//! `dsfms export`: a template for other programs.

use crate::args::Global;
use crate::exit::{Outcome, Usage};
use crate::formats::write_material;
use crate::outputs::prepare_for;
use crate::pictures::template::write_pictures;
use crate::place::{self, mark};
use crate::progress::Reporter;
use crate::stdout::to_stdout;
use anyhow::Context;
use clap::Args;
use dsfms::io::colmap::{ColmapModel, Format, write_model};
use dsfms::io::images::find_frames;
use dsfms::io::obj::{ObjExtras, write_obj};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::io::stl::write_stl;
use dsfms::io::template::{read_template, vertex_colours, write_viewer};
use dsfms::io::template_sparse::colmap_model;
use dsfms::io::vtk::{VtkExtras, write_vtp};
use dsfms::mesh::normals::vertex_normals;
use dsfms::template::{Surroundings, Template};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  # Cameras, poses and sparse points for COLMAP, as binary files
  dsfms export organ.template --colmap sparse/0 --images exploration/ --binary
  # The surface for MeshLab and for a web viewer
  dsfms export organ.template --mesh organ.obj --mesh organ.glb
  # Pictures of flattening and albedo
  dsfms export organ.template --pictures pictures/

Folders that hold files of these names are refused, unless their dsfms.json
says that they are of an older export.";

/// What a folder of pictures holds.
const PICTURES: [&str; 3] = ["flattening.png", "albedo.png", "albedo_spread.png"];
/// Files of a COLMAP model, without their endings.
const MODEL: [&str; 3] = ["cameras", "images", "points3D"];

/// Write a template for other programs: COLMAP model, mesh files, pictures.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct ExportArgs {
    /// Template folder.
    #[arg(value_name = "TEMPLATE")]
    template: PathBuf,
    /// Folder for a COLMAP model of the exploration: cameras, images, points3D.
    #[arg(long, value_name = "DIR")]
    colmap: Option<PathBuf>,
    /// Folder of the exploration's images, whose file names the COLMAP model then holds; without it
    /// the names have no extension, and other programs do not find the images.
    #[arg(long, value_name = "DIR", requires = "colmap")]
    images: Option<PathBuf>,
    /// Write the COLMAP model as .bin instead of .txt.
    #[arg(long, requires = "colmap")]
    binary: bool,
    /// Surface as PLY (with normals and albedo as colour), OBJ (with UV, .mtl and albedo), VTP, STL
    /// or GLB (with UV and albedo), by the file's extension; may be given several times.
    #[arg(long, value_name = "FILE")]
    mesh: Vec<PathBuf>,
    /// What lies around the organ, where the template has it, as PLY.
    #[arg(long, value_name = "FILE")]
    surroundings: Option<PathBuf>,
    /// Folder for pictures: flattening.png, albedo.png, albedo_spread.png.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

/// Run the command.
pub fn run(args: &ExportArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let none = args.colmap.is_none() && args.mesh.is_empty() && args.pictures.is_none();
    if none && args.surroundings.is_none() {
        let problem = "nothing to export; give --colmap, --mesh, --surroundings or --pictures";
        return Err(Usage(problem.into()).into());
    }
    if let Some(path) = args.mesh.iter().find(|p| kind(p).is_none()) {
        let problem = format!("--mesh {}: expected .ply, .obj, .vtp, .stl or .glb", path.display());
        return Err(Usage(problem).into());
    }
    args.mesh.iter().try_for_each(|path| check_beside(path))?;
    let template = read_template(&args.template)?;
    let out = [&args.colmap, &args.pictures, &args.surroundings].into_iter().flatten();
    if let Some(path) = out.chain(&args.mesh).find(|path| place::within(path, &args.template)) {
        let problem =
            format!("{} lies in the template itself; choose another place", path.display());
        return Err(Usage(problem).into());
    }
    if let Some(folder) = args.pictures.as_ref().filter(|folder| folder.is_file()) {
        let problem =
            format!("--pictures {}: expected a folder, and this is a file", folder.display());
        return Err(Usage(problem).into());
    }
    check_folders(args)?;
    let mut lines = Vec::new();
    if let Some(folder) = &args.colmap {
        lines.push(colmap(&template, folder, args)?);
    }
    for path in &args.mesh {
        mesh(&template, path)?;
        lines.push(format!("{}: surface, {}", path.display(), template.unit.label()));
    }
    if let Some(path) = &args.surroundings {
        surroundings(&template, path)?;
        lines.push(format!("{}: surroundings, {}", path.display(), template.unit.label()));
    }
    if let Some(folder) = &args.pictures {
        mark::claim(folder, "export")?;
        // Of another template, which may have had more of them.
        mark::remove(folder, |name| PICTURES.contains(&name))?;
        for path in write_pictures(&template, folder)? {
            lines.push(path.display().to_string());
        }
    }
    reporter.finish();
    if !global.quiet {
        to_stdout(&(lines.join("\n") + "\n"))?;
    }
    Ok(Outcome::Ok)
}

/// Folders in which our names are those of an older export.
fn check_folders(args: &ExportArgs) -> anyhow::Result<()> {
    let of_model = |name: &str| {
        let stem = name.strip_suffix(".txt").or(name.strip_suffix(".bin"));
        stem.is_some_and(|stem| MODEL.contains(&stem))
    };
    let check = |folder: &Option<PathBuf>, option, ours: &dyn Fn(&str) -> bool| match folder {
        Some(folder) => mark::check_names(folder, &["export"], option, ours),
        None => Ok(()),
    };
    check(&args.colmap, "--colmap", &of_model)?;
    check(&args.pictures, "--pictures", &|name| PICTURES.contains(&name))
}

/// An OBJ has its material and its albedo beside it, which are not to replace files of others.
fn check_beside(path: &Path) -> anyhow::Result<()> {
    let beside = ["mtl", "png"].map(|extension| path.with_extension(extension));
    match beside.iter().find(|file| file.exists() && !path.exists()) {
        Some(file) if matches!(kind(path), Some(Kind::Obj)) => {
            let [path, file] = [path, file].map(|p| p.display());
            let problem = format!("--mesh {path} would overwrite {file}; choose another name");
            Err(Usage(problem).into())
        }
        _ => Ok(()),
    }
}

fn surroundings(template: &Template, path: &Path) -> anyhow::Result<()> {
    let Some(Surroundings { mesh: around, .. }) = &template.surroundings else {
        let problem = "the template holds no surroundings: it has them where it was built from frames that show \
                       more than the organ, and the organ was not outlined in all of them";
        return Err(Usage(problem.into()).into());
    };
    prepare_for(path)?;
    let normals = vertex_normals(&around.topology, &around.positions);
    let extras = PlyExtras { normals: Some(&normals), ..Default::default() };
    Ok(write_ply(path, &around.topology, &around.positions, template.unit, &extras)?)
}

fn colmap(template: &Template, folder: &Path, args: &ExportArgs) -> anyhow::Result<String> {
    let mut model = colmap_model(template);
    if let Some(images) = &args.images {
        name_files(&mut model, images)?;
    }
    if model.cameras.is_empty() || model.images.is_empty() {
        return Err(Usage(
            "the template has no exploration frames, so there is no COLMAP model of it".into(),
        )
        .into());
    }
    // Other programs would read the one of them that they prefer.
    let other = folder.join(if args.binary { "images.txt" } else { "images.bin" });
    if other.exists() {
        let problem =
            format!("--colmap: {} is of another model; choose another folder", other.display());
        return Err(Usage(problem).into());
    }
    mark::claim(folder, "export")?;
    write_model(folder, &model, if args.binary { Format::Binary } else { Format::Text })?;
    let names = match args.images {
        Some(_) => "",
        None => {
            "\n  images are named as the frames are, without ending: with --images FRAMES as their files, \
             where other programs look for them"
        }
    };
    let sightings: usize = model.points.iter().map(|p| p.track.len()).sum();
    Ok(format!(
        "{}: {} images, {} points, {sightings} observations, lengths in {}{names}",
        folder.display(),
        model.images.len(),
        model.points.len(),
        template.unit.label()
    ))
}

/// The names of the image files, by the stems that frames have.
fn name_files(model: &mut ColmapModel, folder: &Path) -> anyhow::Result<()> {
    let files = find_frames(&[folder.into()])?;
    for image in &mut model.images {
        let own = |path: &&PathBuf| path.file_stem().is_some_and(|stem| *stem == *image.name);
        let file = files.iter().find(own).with_context(|| {
            format!("--images {}: no image is called {:?}", folder.display(), image.name)
        })?;
        image.name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    }
    Ok(())
}

#[derive(Clone, Copy)]
enum Kind {
    Ply,
    Obj,
    Stl,
    Vtp,
    Glb,
}

fn kind(path: &Path) -> Option<Kind> {
    let extension = path.extension()?.to_string_lossy().to_lowercase();
    match extension.as_str() {
        "ply" => Some(Kind::Ply),
        "obj" => Some(Kind::Obj),
        "stl" => Some(Kind::Stl),
        "vtp" => Some(Kind::Vtp),
        "glb" => Some(Kind::Glb),
        _ => None,
    }
}

fn mesh(template: &Template, path: &Path) -> anyhow::Result<()> {
    prepare_for(path)?;
    let (mesh, unit) = (&template.mesh, template.unit);
    let uv = template.flattening.as_ref().map(|f| f.corners.as_slice());
    match kind(path) {
        Some(Kind::Ply) => {
            let expected = (!template.sigma.is_empty()).then_some(template.sigma.as_slice());
            let (colours, normals) =
                (vertex_colours(template), vertex_normals(&mesh.topology, &mesh.positions));
            let extras = PlyExtras {
                expected_error: expected,
                color: colours.as_deref(),
                normals: Some(&normals),
                ..Default::default()
            };
            write_ply(path, &mesh.topology, &mesh.positions, unit, &extras)?;
        }
        Some(Kind::Obj) => {
            let library = path.with_extension("mtl");
            let written = write_material(&library, template)?;
            let name = library.file_name().unwrap_or_default().to_string_lossy();
            let material = written.then_some(&*name);
            write_obj(path, mesh, unit, &ObjExtras { uv, material })?;
        }
        Some(Kind::Stl) => write_stl(path, mesh, unit)?,
        Some(Kind::Vtp) => {
            write_vtp(path, &mesh.topology, &mesh.positions, unit, &VtkExtras::default())?;
        }
        Some(Kind::Glb) | None => write_viewer(path, template)?,
    }
    Ok(())
}
