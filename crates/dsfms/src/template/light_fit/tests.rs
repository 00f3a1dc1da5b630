//! The light fit on made-up pictures.

use super::super::albedo::{AlbedoOptions, estimate_albedo};
use super::super::test_scene::{Picture, bounds, patch, pictures, pictures_of, true_albedo};
use super::*;
use crate::geometry::Point3;
use crate::light::{Coat, PointLight, Spot};

const LIGHT_PLACE: [f64; 3] = [2.0, -4.0, 1.0];

fn point_light(position: Point3, reference_distance: f64, spot: Spot) -> LightModel {
    PointLight { positions: vec![position], reference_distance, spot }.into()
}

fn known_light() -> LightModel {
    point_light(LIGHT_PLACE.into(), 50.0, Spot::CosinePower { exponent: 2.0 })
}

/// Pictures through a lens of such vignetting, and what the fit with a known light finds.
fn through(vignetting: f64) -> (Vec<Picture>, LightFit) {
    let coat = Coat { vignetting, ..AlbedoOptions::default().coat() };
    let pictures = pictures_of(&patch(), &known_light(), coat, [1.0, 1.1, 0.95, 1.0, 0.9]);
    let views: Vec<_> = pictures.iter().map(|p| p.view()).collect();
    let options = LightFitOptions {
        bounds: bounds(),
        normal_smoothing: 0,
        spots: 300,
        vignetting: Vignetting::Estimated,
        ..Default::default()
    };
    let fit = fit_light(&patch(), &views, Some(&known_light()), &options).unwrap();
    (pictures, fit)
}

/// Root mean square relative error of the albedo up to one factor, when so much vignetting is
/// known.
fn albedo_error(pictures: &[Picture], vignetting: f64) -> f64 {
    let views: Vec<_> = pictures.iter().map(|p| p.view()).collect();
    let options =
        AlbedoOptions { bounds: bounds(), normal_smoothing: 0, vignetting, ..Default::default() };
    let mesh = patch();
    let found = estimate_albedo(&mesh, &views, &known_light(), &options).unwrap().texels;
    let ratio = |face: usize| -> f64 {
        let at = mesh.topology.faces[face].map(|v| mesh.positions[v as usize].coords);
        let middle = Point3::from((at[0] + at[1] + at[2]) / 3.0);
        let value = found.value[found.index(face, [1.0 / 3.0; 3])];
        f64::from(value[0]) / true_albedo(&middle)[0]
    };
    let ratios: Vec<f64> = (0..mesh.topology.faces.len()).map(ratio).collect();
    let n = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / n;
    (ratios.iter().map(|r| (r / mean - 1.0).powi(2)).sum::<f64>() / n).sqrt()
}

#[test]
fn vignetting_is_recovered_and_the_albedo_gains_by_it() {
    let (pictures, fit) = through(-0.3);
    assert!((fit.vignetting / -0.3 - 1.0).abs() < 0.2, "{:?}", fit.candidates);
    let [with, without] = [fit.vignetting, 0.0].map(|a| albedo_error(&pictures, a));
    assert!(with < 0.7 * without, "{with} with, {without} without");
}

#[test]
fn a_lens_without_vignetting_is_left_so() {
    let (_, fit) = through(0.0);
    assert_eq!(fit.vignetting, 0.0, "{:?}", fit.candidates);
    assert_eq!(fit.candidates[0].name, "given");
}

#[test]
fn finds_an_offset_light_from_nothing() {
    let mesh = patch();
    let place = Point3::new(2.0, -4.0, 1.0);
    let light = point_light(place, 50.0, Spot::CosinePower { exponent: 2.0 });
    let pictures = pictures(&mesh, &light, [1.0, 1.1, 0.95, 1.0, 0.9]);
    let views: Vec<_> = pictures.iter().map(|p| p.view()).collect();
    let options =
        LightFitOptions { bounds: bounds(), normal_smoothing: 0, spots: 300, ..Default::default() };
    let fit = fit_light(&mesh, &views, None, &options).unwrap();
    let LightModel::Point(found) = &fit.light else { panic!("{:?}", fit.candidates) };
    assert!((found.positions[0] - place).norm() < 1.5, "{:?}", fit.candidates);
    assert!(fit.relative_residual < 0.02 && fit.ambient < 0.03);
    let collinear = fit.candidates.iter().find(|c| c.name == "collinear").unwrap();
    assert!(collinear.relative_residual > 2.0 * fit.relative_residual);
}

#[test]
fn a_distant_light_is_recognised() {
    let mesh = patch();
    let pictures = pictures(&mesh, &LightModel::Collinear, [1.0; 5]);
    let views: Vec<_> = pictures.iter().map(|p| p.view()).collect();
    let options = LightFitOptions {
        bounds: bounds(),
        normal_smoothing: 0,
        spots: 200,
        gain_sigma: 0.02,
        ..Default::default()
    };
    let fit = fit_light(&mesh, &views, None, &options).unwrap();
    assert_eq!(fit.light, LightModel::Collinear, "{:?}", fit.candidates);
}

#[test]
fn one_view_takes_the_light_that_is_given() {
    let coat = AlbedoOptions::default().coat();
    let pictures = pictures_of(&patch(), &known_light(), coat, [1.0; 5]);
    let mesh = patch();
    let views: Vec<_> = pictures.iter().take(1).map(|p| p.view()).collect();
    let options =
        LightFitOptions { bounds: bounds(), normal_smoothing: 0, spots: 300, ..Default::default() };
    let fit = |initial| fit_light(&mesh, &views, initial, &options).unwrap();
    let known = known_light();
    assert_eq!(fit(Some(&known)).light, known);
    assert!(fit(None).candidates.is_empty() && fit(None).observations[0] >= MIN_SPOTS);
    let options = AlbedoOptions { bounds: bounds(), normal_smoothing: 0, ..Default::default() };
    let light = fit(None).light;
    let albedo = estimate_albedo(&mesh, &views, &light, &options).unwrap();
    assert_eq!(albedo.gains.len(), 1);
}
