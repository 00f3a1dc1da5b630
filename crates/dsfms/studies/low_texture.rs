//! Structure from motion where texture fades: the rendered scene with the contrast of its albedo
//! lowered, organ masks given.
//!
//!     cargo run --release --example low_texture -- SCENE [CONTRAST...] [--options TOML] [--out DIR]
//!
//! Every pixel of the organ is multiplied by the mean albedo plus CONTRAST times its deviation,
//! over the albedo (true, averaged over the pixel, in linear light): shading and highlights stay.
//! CONTRAST 1 0.6 0.4 0.2 unless given. Prints a row of Markdown each; DIR gets the frames.

use dsfms::camera::CameraModel;
use dsfms::geometry::{Isometry, Point3, Vector2, align_similarity};
use dsfms::image::{ColorImage, Frame, Mask, ToneCurve};
use dsfms::io::albedo::read_albedo_image;
use dsfms::io::camera::read_camera;
use dsfms::io::images::{find_frames, read_frames};
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::io::mesh::{MeshFile, read_mesh};
use dsfms::io::poses::{PoseList, match_poses, read_poses};
use dsfms::raster::rasterize;
use dsfms::sfm::{SfmOptions, reconstruct};
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

/// Samples of the albedo along each side of a pixel.
const SAMPLES: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let out = words.iter().position(|w| w == "--out").map(|i| words.drain(i..=i + 1).nth(1));
    let out = out.flatten().map(PathBuf::from);
    let options =
        words.iter().position(|w| w == "--options").map(|i| words.drain(i..=i + 1).nth(1));
    let options: SfmOptions = match options.flatten() {
        Some(path) => toml::from_str(&std::fs::read_to_string(path)?)?,
        None => SfmOptions::default(),
    };
    let scene = PathBuf::from(words.first().ok_or("usage: low_texture SCENE [CONTRAST...]")?);
    let given = words[1..].iter().map(|w| w.parse()).collect::<Result<Vec<f64>, _>>()?;
    let contrasts = if given.is_empty() { vec![1.0, 0.6, 0.4, 0.2] } else { given };
    let paths = find_frames(&[scene.join("exploration")])?;
    let frames = read_frames(&paths)?;
    let camera = read_camera(&scene.join("camera.json"))?.camera;
    let masks = read_masks(&frames, &paths, &scene.join("masks/exploration"), MaskKind::Organ)?.0;
    let masks: Vec<Option<Mask>> = masks.into_iter().map(Some).collect();
    let poses = read_poses(&scene.join("ground_truth/poses.json"), PoseList::Exploration)?;
    let names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
    let poses = match_poses(&poses, &names);
    let rest = read_mesh(&scene.join("ground_truth/rest_world.obj"))?;
    let texture = read_albedo_image(&scene.join("ground_truth/albedo.png"))?;
    let mean = |c: usize| -> f64 {
        texture.data.iter().map(|p| f64::from(p[c])).sum::<f64>() / texture.data.len() as f64
    };
    let mean = [0, 1, 2].map(mean);
    let albedos: Vec<Vec<[f64; 3]>> = poses
        .iter()
        .map(|pose| pose.map_or(Vec::new(), |pose| seen_albedo(&camera, &pose, &rest, &texture)))
        .collect();
    println!("| contrast | frames | points | reprojection px | centres rms mm | s |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for contrast in contrasts {
        let faded: Vec<Frame> = frames
            .iter()
            .zip(albedos.iter().zip(&masks))
            .map(|(frame, (albedo, mask))| fade(frame, albedo, mask.as_ref(), mean, contrast))
            .collect();
        if let Some(out) = &out {
            let folder = out.join(format!("{contrast}"));
            std::fs::create_dir_all(&folder)?;
            for frame in &faded {
                save(frame, &folder.join(format!("{}.png", frame.name)))?;
            }
        }
        let began = Instant::now();
        match reconstruct(&faded, &masks, &camera, &options, &|_, _, _| ()) {
            Ok(found) => println!(
                "| {contrast} | {} of {} | {} | {:.3} | {:.3} | {:.1} |",
                found.registered(),
                frames.len(),
                found.points.len(),
                found.mean_reprojection_px(),
                centre_error(&found.poses, &poses).unwrap_or(f64::NAN),
                began.elapsed().as_secs_f64()
            ),
            Err(error) => println!("| {contrast} | 0: {error} | | | | |"),
        }
    }
    Ok(())
}

/// True albedo of every pixel, averaged over it; zero beside the organ.
fn seen_albedo(
    camera: &CameraModel,
    pose: &Isometry,
    rest: &MeshFile,
    texture: &ColorImage,
) -> Vec<[f64; 3]> {
    let n = SAMPLES as f64;
    let fine = CameraModel {
        size: camera.size.map(|s| s * SAMPLES),
        focal: camera.focal.map(|f| f * n),
        centre: camera.centre.map(|c| (c + 0.5) * n - 0.5),
        ..camera.clone()
    };
    let Some(uv) = &rest.uv else { return Vec::new() };
    let positions: Vec<Point3> = rest.mesh.positions.iter().map(|p| pose * p).collect();
    let [width, height] = texture.size;
    let raster = rasterize(&fine, &rest.mesh.topology, &positions);
    let samples = raster.render([0.0f64; 3], |face, w| {
        let uv: Vector2 = uv[face].iter().zip(w).map(|(p, w)| p.coords * w).sum();
        let at = |t: f64, n: usize| ((t * n as f64) as usize).min(n - 1);
        texture.data[at(1.0 - uv.y, height) * width + at(uv.x, width)].map(f64::from)
    });
    let [w, h] = camera.size;
    let pixel = |i: usize| {
        let (x, y) = (i % w * SAMPLES, i / w * SAMPLES);
        let inside = (0..SAMPLES * SAMPLES)
            .map(|k| samples[(y + k / SAMPLES) * fine.size[0] + x + k % SAMPLES])
            .filter(|a| a[0] > 0.0);
        let (sum, count) =
            inside.fold(([0.0; 3], 0.0), |(s, n), a| ([0, 1, 2].map(|c| s[c] + a[c]), n + 1.0));
        sum.map(|s| if count > 0.0 { s / count } else { 0.0 })
    };
    (0..w * h).map(pixel).collect()
}

fn fade(
    frame: &Frame,
    albedo: &[[f64; 3]],
    organ: Option<&Mask>,
    mean: [f64; 3],
    contrast: f64,
) -> Frame {
    let table = ToneCurve::Srgb.table();
    let encode = |v: f64| {
        let v = v.clamp(0.0, 1.0);
        let e = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (255.0 * e).round() as u8
    };
    let pixel = |(i, (rgb, albedo)): (usize, (&[u8; 3], &[f64; 3]))| {
        if organ.is_some_and(|m| !m.data[i]) {
            return *rgb;
        }
        [0, 1, 2].map(|c| match albedo[c] {
            a if a > 0.0 && rgb[c] < 255 => {
                let faded = mean[c] + contrast * (a - mean[c]);
                encode(f64::from(table[rgb[c] as usize]) * faded / a)
            }
            _ => rgb[c],
        })
    };
    let rgb = frame.rgb.iter().zip(albedo).enumerate().map(pixel).collect();
    Frame { rgb, ..frame.clone() }
}

fn save(frame: &Frame, path: &std::path::Path) -> Result<(), Box<dyn Error>> {
    let [w, h] = frame.size.map(|s| s as u32);
    let pixel = |x: u32, y: u32| image::Rgb(frame.rgb[(y * w + x) as usize]);
    Ok(image::RgbImage::from_fn(w, h, pixel).save(path)?)
}

/// Camera centres after one similarity, root mean square, mm.
fn centre_error(found: &[Option<Isometry>], truth: &[Option<Isometry>]) -> Option<f64> {
    let centre = |p: &Isometry| p.inverse_transform_point(&Point3::origin());
    let (from, to): (Vec<Point3>, Vec<Point3>) = found
        .iter()
        .zip(truth)
        .filter_map(|(f, t)| Some((centre(f.as_ref()?), centre(t.as_ref()?))))
        .unzip();
    let world = align_similarity(&from, &to)?;
    let squares = from.iter().zip(&to).map(|(f, t)| (world * f - t).norm_squared());
    Some((squares.sum::<f64>() / from.len() as f64).sqrt())
}
