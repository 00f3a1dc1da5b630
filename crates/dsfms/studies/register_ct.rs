//! Preoperative surfaces on what an exploration would have shown of them: figures of
//! `docs/results/register_ct.md`.
//!
//! `cargo run --release --example register_ct -- DATA OUT` with the folders `organs_ucl`,
//! `organs_hra` and `p2ilf_liver` in DATA. Every case is written to OUT/CASE (ct.ply, template.ply,
//! targets.ply, landmarks.csv, truth.json), so that another program can be asked the same
//! (`scripts/peer_register_ct.py`).

#[path = "../tests/common/organ.rs"]
mod organ;

use dsfms::Mesh;
use dsfms::geometry::{Point3, Similarity, Vector3};
use dsfms::io::mesh::{MeshUnit, read_repaired};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::mesh::components::largest_component;
use dsfms::mesh::normals::vertex_normals;
use dsfms::mesh::surface_points::ClosestPoints;
use dsfms::preoperative::{
    LandmarkPair, Preoperative, PreoperativeOptions, ScaleRule, register_preoperative,
};
use dsfms::template::LengthUnit;
use organ::{Explored, rms};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Noise of the template's surface, mm.
const NOISE: f64 = 0.7;
/// Noise of a landmark pair, mm.
const PICKED: f64 = 3.0;

struct Organ {
    name: &'static str,
    mesh: Mesh,
    targets: Vec<Point3>,
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [data, out, only @ ..] = &arguments[..] else {
        return Err("expected DATA OUT [ORGAN]".into());
    };
    println!(
        "| organ | seen | deformation, mm | landmarks | verdict | scale error | rigid rms, mm | bent rms, mm | target \
         error, mm | if rigid | expected | overlap | condition | s |"
    );
    println!("|{}", " --- |".repeat(14));
    for organ in organs(Path::new(data))? {
        if only.first().is_some_and(|o| !organ.name.contains(o.as_str())) {
            continue;
        }
        let deformations: &[f64] =
            if organ.name.contains("UCL") { &[0.0, 6.0, 12.0] } else { &[6.0] };
        for (seen, share) in [("a side", 1.0), ("a patch", 0.6)] {
            for &deformation in deformations {
                for landmarks in [5, 0] {
                    case(&organ, (seen, share), deformation, landmarks, Path::new(out))?;
                }
            }
        }
    }
    if only.first().is_none_or(|o| o == "p2ilf") {
        p2ilf(Path::new(data))?;
    }
    Ok(())
}

/// A real liver: its preoperative mesh, and the part that faces the camera of the mesh that was
/// registered to real laparoscopic views by others. The rest of that mesh, which is not given, says
/// how well the hidden side comes out.
fn p2ilf(data: &Path) -> Result<()> {
    let read = |path: &str| -> Result<Mesh> {
        Ok(read_repaired(&data.join("p2ilf_liver").join(path))?.mesh)
    };
    let ct = read("originalMesh/meshGT.obj")?;
    let now = read("registeredMesh/originalMesh_views12345678_ct1_wrp1_arap0_alterscheme3.obj")?;
    let normals = vertex_normals(&now.topology, &now.positions);
    // The camera stands at the origin.
    let seen =
        |v: u32| normals[v as usize].dot(&-now.positions[v as usize].coords.normalize()) > 0.1;
    let faces = |wanted: bool| -> Vec<usize> {
        let all = now.topology.faces.iter().enumerate();
        all.filter(|(_, f)| f.iter().all(|&v| seen(v)) == wanted).map(|(k, _)| k).collect()
    };
    let template = largest_component(&now.subset(&faces(true)).0).0;
    let hidden = now.subset(&faces(false)).0.positions;
    println!(
        "\n| P2ILF liver | verdict | scale | rigid rms, mm | bent rms, mm | hidden side, mm | if rigid | condition |"
    );
    println!("|{}", " --- |".repeat(8));
    for scale in [ScaleRule::Fixed, ScaleRule::Within(0.05), ScaleRule::Free] {
        let options = PreoperativeOptions { scale, ..Default::default() };
        let found = register_preoperative((&template, &[]), &ct, &[], &options, &|_, _, _| {});
        let found = match found {
            Ok(found) => found,
            Err(error) => {
                println!("| {scale:?} | refused: {error} | | | | | | |");
                continue;
            }
        };
        let back = found.similarity.inverse();
        let away = |vertices: Vec<Point3>| {
            let surface = ct.with_positions(vertices);
            let closest = ClosestPoints::new(&surface);
            rms(hidden.iter().filter_map(|p| closest.closest(p)).map(|s| s.distance))
        };
        let rigid = ct.positions.iter().map(|p| back * p).collect();
        let doubts: Vec<String> = found.doubts.iter().map(ToString::to_string).collect();
        println!(
            "| {scale:?} | {} | {:.3} | {:.2} | {:.2} | {:.1} | {:.1} | {:.4} |",
            if doubts.is_empty() { "ok".into() } else { doubts.join("; ") },
            found.similarity.scaling(),
            found.rigid.rms,
            found.bent.map_or(0.0, |r| r.rms),
            away(found.vertices.clone()),
            away(rigid),
            found.uncertainty.condition
        );
    }
    Ok(())
}

fn organs(data: &Path) -> Result<Vec<Organ>> {
    let metric = |path: &str| -> Result<Mesh> {
        let file = read_repaired(&data.join(path))?;
        Ok(file.in_unit(MeshUnit::Millimetre)?.mesh)
    };
    let one = |path: &str| -> Result<Mesh> { Ok(largest_component(&metric(path)?).0) };
    let ucl = |name: &str| metric(&format!("organs_ucl/Liver/{name}.vtk"));
    let mut targets = ucl("liver_tumours")?.positions;
    targets.extend(ucl("portal_vein")?.positions.iter().step_by(20));
    let mut organs =
        vec![Organ { name: "liver (UCL)", mesh: one("organs_ucl/Liver/liver.vtk")?, targets }];
    let others = [
        ("liver (HRA)", "organs_hra/VH_F_Liver.glb"),
        ("kidney (HRA)", "organs_hra/VH_F_Kidney_L.glb"),
        ("spleen (HRA)", "organs_hra/VH_F_Spleen.glb"),
        ("gallbladder (HRA)", "organs_hra/VH_F_Gallbladder.glb"),
    ];
    for (name, path) in others {
        let mesh = one(path)?;
        let targets = inside(&mesh);
        organs.push(Organ { name, mesh, targets });
    }
    Ok(organs)
}

/// Points half way between the surface and the middle, and the middle's own surroundings.
fn inside(mesh: &Mesh) -> Vec<Point3> {
    let sum: Vector3 = mesh.positions.iter().map(|p| p.coords).sum();
    let middle = Point3::from(sum / mesh.positions.len() as f64);
    mesh.positions
        .iter()
        .step_by(mesh.positions.len() / 60 + 1)
        .map(|p| middle + (p - middle) * 0.5)
        .collect()
}

fn case(
    organ: &Organ,
    (seen, share): (&str, f64),
    deformation: f64,
    count: usize,
    out: &Path,
) -> Result<()> {
    let truth =
        Similarity::new(Vector3::new(120.0, -40.0, 60.0), Vector3::new(0.7, -1.1, 0.4), 8.0);
    let view = Vector3::new(0.2, -0.9, 0.4).normalize();
    let mut explored = Explored::of(&organ.mesh, view, deformation, NOISE, truth);
    explored.template = patch(&explored.template, share);
    let wrong: &[usize] = if count > 4 { &[1] } else { &[] };
    let landmarks = explored.landmarks(&organ.mesh, count, PICKED, wrong, 40.0);
    let name = format!("{}-{seen}-{deformation}-{count}", organ.name).replace([' ', '(', ')'], "");
    write_case(&out.join(name), organ, &explored, &landmarks)?;
    let start = Instant::now();
    let options = PreoperativeOptions::default();
    let found = register_preoperative(
        (&explored.template, &[]),
        &organ.mesh,
        &landmarks,
        &options,
        &|_, _, _| {},
    );
    let seconds = start.elapsed().as_secs_f64();
    let head = format!("| {} | {seen} | {deformation} | {count}", organ.name);
    match found {
        Ok(found) => row(&head, organ, &explored, &found, seconds)?,
        Err(error) => println!("{head} | refused: {error} | | | | | | | | | {seconds:.0} |"),
    }
    Ok(())
}

/// The part of a surface within a share of its reach from the middle.
fn patch(mesh: &Mesh, share: f64) -> Mesh {
    let sum: Vector3 = mesh.positions.iter().map(|p| p.coords).sum();
    let middle = Point3::from(sum / mesh.positions.len() as f64);
    let reach = mesh.positions.iter().map(|p| (p - middle).norm()).fold(0.0, f64::max);
    let near = |v: &u32| (mesh.positions[*v as usize] - middle).norm() <= share * reach;
    let faces = (0..mesh.topology.faces.len()).filter(|&f| mesh.topology.faces[f].iter().all(near));
    largest_component(&mesh.subset(&faces.collect::<Vec<_>>()).0).0
}

fn row(
    head: &str,
    organ: &Organ,
    explored: &Explored,
    found: &Preoperative,
    seconds: f64,
) -> Result<()> {
    let scale = explored.truth.scaling();
    let carried = found.carry(&organ.targets)?;
    let error = |at: &dyn Fn(usize) -> Point3| {
        let of = |(k, p): (usize, &Point3)| (at(k) - explored.now(p)).norm() * scale;
        rms(organ.targets.iter().enumerate().map(of))
    };
    let back = found.similarity.inverse();
    let expected = rms(found.expected(&organ.targets, &carried, &explored.template)?.into_iter());
    let verdict = match found.doubts.is_empty() {
        true => "ok".to_string(),
        false => found.doubts.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "),
    };
    println!(
        "{head} | {verdict} | {:+.1} % | {:.2} | {:.2} | {:.1} | {:.1} | {expected:.1} | {:.0} % | {:.4} | {seconds:.0} |",
        100.0 * (found.similarity.scaling() / scale - 1.0),
        found.rigid.rms,
        found.bent.map_or(0.0, |r| r.rms),
        error(&|k| carried[k]),
        error(&|k| back * organ.targets[k]),
        100.0 * found.rigid.overlap,
        found.uncertainty.condition,
    );
    Ok(())
}

fn write_case(
    folder: &Path,
    organ: &Organ,
    explored: &Explored,
    landmarks: &[LandmarkPair],
) -> Result<()> {
    let write = |name: &str, mesh: &Mesh, unit| {
        let extras = PlyExtras::default();
        write_ply(&folder.join(name), &mesh.topology, &mesh.positions, unit, &extras)
    };
    write("ct.ply", &organ.mesh, LengthUnit::Millimetre)?;
    write("template.ply", &explored.template, LengthUnit::TemplateUnit)?;
    let mut pairs = String::from("name,ct_x,ct_y,ct_z,template_x,template_y,template_z\n");
    for l in landmarks {
        let (a, b) = (l.ct, l.template);
        pairs += &format!("{},{},{},{},{},{},{}\n", l.name, a.x, a.y, a.z, b.x, b.y, b.z);
    }
    std::fs::write(folder.join("landmarks.csv"), pairs)?;
    let rows =
        |points: &[Point3]| -> Vec<[f64; 3]> { points.iter().map(|p| p.coords.into()).collect() };
    let now: Vec<Point3> = organ.targets.iter().map(|p| explored.now(p)).collect();
    let text = serde_json::json!({
        "scale": explored.truth.scaling(), "targets": rows(&organ.targets), "now": rows(&now),
    });
    std::fs::write(folder.join("truth.json"), text.to_string())?;
    Ok(())
}
