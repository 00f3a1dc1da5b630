//! The paper's claim, on a handful of fresh cases: shading recovers what motion cannot, because no
//! match lies in the deformed zone. Figures of whole series: `docs/results`.

use dsfms::experiment::observation;
use dsfms::light::{LightModel, PointLight, Spot};
use dsfms::pipeline::{Method, ReconstructOptions, reconstruct};
use dsfms::synth::{Case, CaseOptions, Draw};

/// Mean zone error of each method over four cases, mm.
fn zone_errors(light: &LightModel, extension: f64, methods: [Method; 3]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for seed in 0..4 {
        let options = CaseOptions {
            vertices: 300,
            extension,
            light: light.clone(),
            draw: Draw { count: 25, sigma_px: 1.0 },
            pull: seed % 2 == 0,
        };
        let case = Case::new(&options, 40 + seed);
        for (sum, method) in sums.iter_mut().zip(methods) {
            let found = reconstruct(
                &case.template,
                &observation(&case),
                method,
                &ReconstructOptions::default(),
            )
            .expect("25 matches and an albedo are enough");
            *sum += case.zone_rms(&found.vertices) / 4.0;
        }
    }
    sums
}

#[test]
fn shading_recovers_the_zone_without_matches() {
    let near = LightModel::Point(PointLight {
        positions: vec![dsfms::geometry::Point3::new(0.0, -3.0, 0.0)],
        reference_distance: 75.0,
        spot: Spot::Isotropic,
    });
    for light in [LightModel::Collinear, near] {
        let [dsfm, dsfms, joint] =
            zone_errors(&light, 0.03, [Method::Dsfm, Method::Dsfms, Method::Joint]);
        assert!(dsfms < 0.9 * dsfm, "eq. 4: {dsfms:.3} against eq. 3: {dsfm:.3} mm");
        assert!(joint < 0.85 * dsfm, "joint: {joint:.3} against eq. 3: {dsfm:.3} mm");
    }
}
