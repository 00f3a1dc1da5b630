//! A pull under a near light, after an exploration of six frames of one exposure.

use dsfms::geometry::{Isometry, Point3};
use dsfms::light::{LightModel, PointLight, Spot};
use dsfms::synth::{Case, CaseOptions, Draw};
use dsfms::template::TemplateView;

/// With so many matches.
pub fn near_pull(count: usize) -> Case {
    let light = LightModel::Point(PointLight {
        positions: vec![Point3::new(3.0, 0.0, 0.0)],
        reference_distance: 75.0,
        spot: Spot::Isotropic,
    });
    let draw = Draw { count, sigma_px: 0.3 };
    let options = CaseOptions { vertices: 300, extension: 0.05, light, draw, pull: true };
    let mut case = Case::new(&options, 5);
    let view = |k: usize| TemplateView {
        name: format!("frame_{k}"),
        camera_from_template: Isometry::identity(),
        gain: [0.998, 1.002][k % 2],
        reprojection_px: 0.0,
    };
    case.template.views = (0..6).map(view).collect();
    case
}
