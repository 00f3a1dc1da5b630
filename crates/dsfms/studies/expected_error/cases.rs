//! Rows of synthetic cases with everything that varies drawn from a seed.

use super::{METHODS, ModelRows, append, judged};
use dsfms::Observation;
use dsfms::experiment::SeriesOrgan;
use dsfms::geometry::{Point2, Point3};
use dsfms::image::{Frame, Mask};
use dsfms::mesh::remesh::{RemeshOptions, remesh};
use dsfms::mesh::{Mesh, normals::vertex_normals};
use dsfms::synth::random::{Random, uniform};
use dsfms::synth::{
    Admitted, Attraction, Case, CaseOptions, Cell, Draw, ExtensionOf, LightKind, Protocol,
    deform_to, patch::textured,
};
use nalgebra::Rotation3;
use rayon::prelude::*;

/// The rows of every model.
pub fn rows(organs: &[SeriesOrgan; 3], seed: u64, cases: usize) -> ModelRows {
    let found: Vec<ModelRows> = (0..cases)
        .into_par_iter()
        .map(|i| case_rows(organs, seed, i).unwrap_or_default())
        .collect();
    let mut all = ModelRows::default();
    found.into_iter().for_each(|case| append(&mut all, case));
    all
}

/// A case with everything that varies drawn from its seed; every third has an instrument in view.
fn case_rows(organs: &[SeriesOrgan; 3], seed: u64, index: usize) -> Option<ModelRows> {
    let mut random = Random::new(seed, 0xC0 + index as u64);
    let mut pick = |n: usize| random.below(n);
    let protocol = Protocol {
        vertices: [250, 334, 600][pick(3)],
        light: [LightKind::Distant, LightKind::Near][pick(2)],
        matches: [15, 25, 25, 50, 150][pick(5)],
        everywhere: pick(4) == 0,
        attractions: 1 + pick(2),
        seed,
        ..Protocol::default()
    };
    let cell = Cell {
        extension: [0.0, 5.0, 10.0, 15.0, 20.0][pick(5)],
        noise: [0.5, 1.0, 1.0, 2.0, 4.0][pick(5)],
    };
    let organ = &organs[pick(3)];
    let case = match organ {
        SeriesOrgan::Surface { mesh, .. } if pick(2) == 0 => closed(mesh, &protocol, cell, index)?,
        _ => organ.case(&protocol, cell, index).ok()?,
    };
    let instrument = index.is_multiple_of(3).then(|| instrument(&case.frame, &mut random));
    Some(case_judged(&case, instrument.as_ref(), index))
}

/// A whole organ, of which the camera sees one side.
fn closed(organ: &Mesh, protocol: &Protocol, cell: Cell, index: usize) -> Option<Case> {
    let seed = protocol.case_seed(index);
    let mut random = Random::new(seed, 0xC105ED);
    let mut turn = || std::f64::consts::TAU * uniform(&mut random);
    let turn = Rotation3::from_euler_angles(turn(), turn(), turn());
    let [low, high] = organ.bounding_box();
    let scale = 55.0 / (high - low).norm();
    let centre = nalgebra::center(&low, &high);
    let place = |p: &Point3| Point3::from(turn * ((p - centre) * scale));
    let mesh = organ.with_positions(organ.positions.iter().map(place).collect());
    let mesh = remesh(&mesh, protocol.vertices, &RemeshOptions::default()).ok()?;
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let facing: Vec<usize> = (0..normals.len()).filter(|&v| normals[v].z < -0.8).collect();
    let v = *facing.get(random.below(facing.len().max(1)))?;
    let pull = index.is_multiple_of(2);
    let direction = normals[v] * if pull { 1.0 } else { -1.0 };
    let point = mesh.positions[v] + direction * 20.0;
    let attraction = Attraction { direction, point, angle: (protocol.reach / 20.0).atan() };
    let deformation =
        deform_to(&mesh, &[attraction], 0.01 * cell.extension, ExtensionOf::Largest, 0.0);
    let options = CaseOptions {
        vertices: mesh.positions.len(),
        extension: 0.01 * cell.extension,
        light: protocol.light.model(),
        draw: Draw { count: protocol.matches, sigma_px: cell.noise },
        pull,
    };
    Some(Case::of(textured(mesh, seed), deformation, &options, Admitted::Calm, seed, &mut random))
}

/// A shaft from a side of the image to a place near its centre, 70 px wide.
fn instrument(frame: &Frame, random: &mut Random) -> Mask {
    let [w, h] = frame.size.map(|n| n as f64);
    let mut near = |n: f64| n * (0.35 + 0.3 * uniform(random));
    let tip = Point2::new(near(w), near(h));
    let angle = std::f64::consts::TAU * uniform(random);
    let along = nalgebra::Vector2::new(angle.cos(), angle.sin());
    let covered = |i: usize| {
        let p = Point2::new((i % frame.size[0]) as f64, (i / frame.size[0]) as f64) - tip;
        p.dot(&along) > 0.0 && p.perp(&along).abs() < 35.0
    };
    Mask { size: frame.size, data: (0..frame.size[0] * frame.size[1]).map(covered).collect() }
}

fn case_judged(case: &Case, instrument: Option<&Mask>, index: usize) -> ModelRows {
    let covered = |m: &dsfms::register::Match| instrument.is_some_and(|i| i.at_pixel(&m.pixel));
    let matches: Vec<_> = case.matches.iter().filter(|m| !covered(m)).copied().collect();
    let observation =
        Observation::new(&case.frame, &case.camera).matches(&matches).instrument(instrument);
    let mut all = ModelRows::default();
    for method in METHODS {
        let most = case.truth.len();
        append(&mut all, judged(&case.template, &observation, &case.truth, method, index, most));
    }
    all
}
