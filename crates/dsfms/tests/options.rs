//! Options from a user: bounds, what belongs to whom, and the names that reports print.

use dsfms::calibrate::{Board, CalibrateOptions, calibrate};
use dsfms::geometry::Isometry;
use dsfms::image::{Frame, Mask, Plane};
use dsfms::light::LightModel;
use dsfms::mesh::remesh::{RemeshOptions, remesh};
use dsfms::pipeline::{
    Exploration, Method, Observation, ReconstructError, ReconstructOptions, Reconstruction, Silent,
    TemplateOptions, reconstruct, template_from_frames,
};
use dsfms::preoperative::{PreoperativeOptions, register_preoperative};
use dsfms::register::{Prior, PriorWeights, RegisterOptions, pose, pose_near};
use dsfms::sfm::bundle::{Bundle, BundleOptions, adjust, covariance};
use dsfms::sfm::{self, SfmOptions};
use dsfms::sfs::{SfsInput, SfsOptions, shape_from_shading};
use dsfms::synth::{Case, Cell, Protocol};
use dsfms::template::albedo::{AlbedoOptions, estimate_albedo, refine_by_shading};
use dsfms::template::flatten::{FlattenOptions, flatten};
use dsfms::template::light_fit::{LightFitOptions, Vignetting, fit_light};
use dsfms::track::{TrackError, TrackOptions, Tracker};
use dsfms::video::{SelectOptions, select_frames};
use serde::Serialize;
use serde::de::DeserializeOwned;

fn case() -> Case {
    let protocol = Protocol { vertices: 150, ..Default::default() };
    protocol.case(Cell { extension: 5.0, noise: 1.0 }, 0)
}

fn solve(
    case: &Case,
    method: Method,
    options: &ReconstructOptions,
) -> Result<Reconstruction, ReconstructError> {
    let seen = Observation::new(&case.frame, &case.camera).matches(&case.matches);
    // What the verdict refuses (the printed forms, a grey frame) is a surface all the same.
    Reconstruction::even_refused(reconstruct(&case.template, &seen, method, options))
}

/// Labels of the terms of the last solve.
fn labels(found: &Reconstruction) -> Vec<String> {
    let last = found.stages.iter().rev().find_map(|s| s.summary.as_ref()).unwrap();
    last.terms.iter().map(|t| t.label.clone()).collect()
}

#[test]
fn options_out_of_bounds_are_refused_by_name() {
    let case = case();
    let mut options = ReconstructOptions::default();
    options.register.robust_px = [60.0, -1.0];
    let error = solve(&case, Method::Dsfm, &options).unwrap_err().to_string();
    assert!(error.contains("register.robust_px"), "{error}");
    let mut options = ReconstructOptions::default();
    options.joint.blurs.clear();
    let error = solve(&case, Method::Joint, &options).unwrap_err().to_string();
    assert!(error.contains("joint.blurs"), "{error}");
    for text in ["[register]\nrobust_px = [60, -1]", "[joint]\nblurs = []", "[refine]\nhuber = 0"] {
        assert!(ReconstructOptions::from_toml(text).is_err(), "{text}");
    }
    let tracked = TrackOptions { reconstruct: options, ..Default::default() };
    let tone = &case.template.tone;
    let tracker = Tracker::new(&case.template, &case.camera, tone, Method::Joint, tracked);
    assert!(matches!(tracker.err(), Some(TrackError::Options(_))));
    for text in ["search_every = 0", "[video]\nleast_blur_px = 0"] {
        assert!(TrackOptions::from_toml(text).is_err(), "{text}");
    }
    // No comparison with it holds: the limit would be none.
    let error = ReconstructOptions::from_toml("[verdict]\ncontradicted = nan").unwrap_err();
    assert!(error.to_string().contains("verdict must be numbers"), "{error}");
    assert!(ReconstructOptions::from_toml("[verdict]\ncontradicted = inf").is_ok());
    assert!(TemplateOptions::from_toml("[albedo]\nmax_texels = 4294967296").is_err());
    let error = TemplateOptions::from_toml("vertices = 5").unwrap_err().to_string();
    assert!(error.contains("vertices must be 100 to 50,000"), "{error}");
    let error = TemplateOptions::from_toml("[sfm]\nratio = 2.0").unwrap_err().to_string();
    assert!(error.contains("ratio"), "{error}");
    assert!(TemplateOptions::default().validate().is_ok());
    assert!(TrackOptions::realtime().validate().is_ok());
}

#[test]
fn masks_and_matches_of_something_else_are_refused() {
    let case = case();
    let (small, options) = (Mask::filled([10, 10], true), ReconstructOptions::default());
    let seen = Observation::new(&case.frame, &case.camera).matches(&case.matches);
    let refused = |seen: &Observation| {
        reconstruct(&case.template, seen, Method::Dsfm, &options).unwrap_err().to_string()
    };
    for seen in [seen.instrument(&small), seen.organ(&small)] {
        let error = refused(&seen);
        assert!(error.contains("mask is [10, 10] px"), "{error}");
    }
    let mut matches = case.matches.clone();
    matches[3].face = 1_000_000;
    let error = refused(&seen.matches(&matches));
    assert!(error.contains("match 3 names face 1000000"), "{error}");
    // The same of an exploration.
    let frames = vec![case.frame.clone(); 2];
    let organ = [None, Some(small)];
    let exploration = Exploration::new(&frames, &case.camera).organ(&organ);
    let built = template_from_frames(&exploration, &TemplateOptions::default(), &Silent);
    let error = built.unwrap_err().to_string();
    assert!(error.contains("[10, 10] px"), "{error}");
}

/// The numbers of options that are not integers: path of each, as `joint.blurs` (of a list, its
/// first).
fn numbers_of(table: &toml::Table, below: &str) -> Vec<String> {
    let path = |key: &String| if below.is_empty() { key.clone() } else { format!("{below}.{key}") };
    let of = |(key, value): (&String, &toml::Value)| match value {
        toml::Value::Float(_) => vec![path(key)],
        toml::Value::Array(list) if list.iter().any(toml::Value::is_float) => vec![path(key)],
        toml::Value::Table(inner) => numbers_of(inner, &path(key)),
        _ => Vec::new(),
    };
    table.iter().flat_map(of).collect()
}

/// Options with another number in one place.
fn with_number<T: Serialize + DeserializeOwned>(base: &T, path: &str, number: f64) -> T {
    let mut all = toml::Table::try_from(base).unwrap();
    let (tables, key) = path.rsplit_once('.').unwrap_or(("", path));
    let tables = tables.split('.').filter(|table| !table.is_empty());
    let inner = tables.fold(&mut all, |table, key| table[key].as_table_mut().unwrap());
    match &mut inner[key] {
        toml::Value::Array(list) => list[0] = number.into(),
        value => *value = number.into(),
    }
    all.try_into().unwrap()
}

/// No number of the options can be "not a number", and none but those of `signed` is negative; the
/// error names it.
fn numbers_are_checked<T: Serialize + DeserializeOwned>(
    base: &T,
    validate: impl Fn(&T) -> Result<(), String>,
    signed: &[&str],
) {
    assert_eq!(validate(base), Ok(()));
    let paths = numbers_of(&toml::Table::try_from(base).unwrap(), "");
    assert!(!paths.is_empty());
    for path in &paths {
        for number in [f64::NAN, -2.5] {
            if number < 0.0 && signed.iter().any(|s| path.starts_with(s)) {
                continue;
            }
            let error = validate(&with_number(base, path, number)).expect_err(path);
            // Bounds of observations and limits of the verdict are named by their table.
            let named = path.rsplit('.').take(2).any(|key| error.contains(key));
            assert!(named, "{path} = {number}: {error}");
        }
    }
}

#[test]
fn every_number_of_every_options_file_is_checked_by_name() {
    let text = |e: &dyn std::fmt::Display| e.to_string();
    let template = |o: &TemplateOptions| o.validate().map_err(|e| text(&e));
    numbers_are_checked(
        &TemplateOptions::default(),
        template,
        &["albedo.ambient", "albedo.vignetting"],
    );
    let frame = |o: &ReconstructOptions| o.validate().map_err(|e| text(&e));
    numbers_are_checked(&ReconstructOptions::default(), frame, &["verdict."]);
    for options in [TrackOptions::default(), TrackOptions::realtime()] {
        let track = |o: &TrackOptions| o.validate().map_err(|e| text(&e));
        numbers_are_checked(&options, track, &["reconstruct.verdict."]);
    }
    let ct = |o: &PreoperativeOptions| o.validate().map_err(|e| text(&e));
    numbers_are_checked(&PreoperativeOptions::default(), ct, &[]);
    numbers_are_checked(&SelectOptions::default(), |o| o.validate().map_err(|e| text(&e)), &[]);
}

/// What a public root says of one bad option.
fn refusals() -> Vec<(&'static str, String)> {
    let case = case();
    let mesh = &case.template.mesh;
    let (camera, light) = (&case.camera, LightModel::default());
    let plane = Plane { size: camera.size, data: vec![0.5; camera.size[0] * camera.size[1]] };
    let [usable, saturated] = [true, false].map(|all| Mask::filled(camera.size, all));
    let input = SfsInput {
        mesh,
        pose: Isometry::translation(0.0, 0.0, 75.0),
        camera,
        grey: &plane,
        usable: &usable,
        saturated: &saturated,
        albedo: None,
        light: &light,
    };
    let sfs = SfsOptions { curvature: f64::NAN, ..Default::default() };
    let sfm = SfmOptions { min_inlier_fraction: -0.5, ..Default::default() };
    let fit = LightFitOptions { vignetting: Vignetting::Known(f64::NAN), ..Default::default() };
    let albedo = AlbedoOptions { ambient: f64::INFINITY, ..Default::default() };
    let remeshed = RemeshOptions { rounds: 0, ..Default::default() };
    let flattened = FlattenOptions { max_area_ratio: 1.0, ..Default::default() };
    let register = RegisterOptions { robust_px: [60.0, f64::NAN], ..Default::default() };
    let ct = PreoperativeOptions { strain: -0.1, ..Default::default() };
    let video = SelectOptions { max_frames: 0, ..Default::default() };
    let board = Board { corners: [7, 5], square: f64::NAN };
    let adjusted = BundleOptions { prior_scale: f64::NAN, ..Default::default() };
    let mut bundle = Bundle {
        cameras: Vec::new(),
        priors: Vec::new(),
        camera_of: Vec::new(),
        poses: Vec::new(),
        fixed: Vec::new(),
        points: Vec::new(),
        observations: Vec::new(),
    };
    let frames = vec![case.frame.clone(); 2];
    let (given, start) = (&case.matches, input.pose);
    vec![
        ("curvature", shape_from_shading(&input, &sfs).unwrap_err().to_string()),
        (
            "min_inlier_fraction",
            sfm::reconstruct(&frames, &[], camera, &sfm, &|_, _, _| {}).unwrap_err().to_string(),
        ),
        ("vignetting", fit_light(mesh, &[], None, &fit).unwrap_err().to_string()),
        ("ambient", estimate_albedo(mesh, &[], &light, &albedo).unwrap_err().to_string()),
        ("ambient", refine_by_shading(mesh, &[], &[], &light, &albedo).unwrap_err().to_string()),
        ("rounds", remesh(mesh, 100, &remeshed).unwrap_err().to_string()),
        ("max_area_ratio", flatten(mesh, &flattened).unwrap_err().to_string()),
        ("robust_px", pose(camera, mesh, given, &register, 0).unwrap_err().to_string()),
        ("robust_px", pose_near(camera, &[], &[], &register, start).unwrap_err().to_string()),
        (
            "strain",
            register_preoperative((mesh, &[]), mesh, &[], &ct, &|_, _, _| {})
                .unwrap_err()
                .to_string(),
        ),
        ("max_frames", select_frames("none.mp4".as_ref(), &video).unwrap_err().to_string()),
        (
            "square",
            calibrate(&frames, &board, &CalibrateOptions::default()).unwrap_err().to_string(),
        ),
        ("prior_scale", adjust(&mut bundle, &adjusted).unwrap_err().to_string()),
        ("prior_scale", covariance(&bundle, &adjusted).unwrap_err().to_string()),
    ]
}

#[test]
fn every_public_root_names_the_option_that_it_refuses() {
    for (field, error) in refusals() {
        assert!(error.contains(field), "{field}: {error}");
    }
}

/// The weights as `dsfms options reconstruct` printed them when several tables had a copy of them.
const EARLIER: &str = "
seed = 0
literal = false
[register]
prior = \"conformal\"
conformal = 30000.0
stretch = 3000.0
smoothing = 100.0
match_sigma_px = 1.0
robust_px = [60.0, 4.0]
depth_hold = 0.04
depth_hold_motion = 3.0
stay = 3.0
anchor = 0.1
literal = false
[refine]
reprojection = 0.01
diffuse = 1.0
specular = 10.0
smoothing = 30.0
depth_hold = 0.012
reference_count = 300.0
blur = 0.0045
sigma_absolute = 0.002
sigma_relative = [0.01, 0.1]
colour = true
huber = 2.0
gain_sigma = 0.3
ambient_sigma = 0.05
grazing = 0.2
specular_deg = 8.0
contour_blurs = 1.5
halo = 0.02
rounds = 3
literal = false
[joint]
prior = \"conformal\"
conformal = 10000.0
stretch = 300.0
smoothing = 30.0
photometric = 4.0
sigma_relative = [0.01, 0.1]
sigma_absolute = 0.002
colour = true
robust = 3.0
match_px = 4.0
near_depth_hold = 0.07
near_depth_motion = 100.0
gain_sigma = 0.1
ambient_sigma = 0.02
smooth_gain = 0.0
smooth_length = 0.3
blurs = [0.018, 0.009, 0.0045, 0.003]
max_samples = 8000
contour_blurs = 1.5
grazing = 0.25
specular_deg = 12.0
silhouette = 1.0
silhouette_px = 2.0
specular = 1.0
halo = 0.02
strain = 0.1
mirrors = 2
[joint.exposure_unknown]
stretch = 4000.0
strain = 0.2
smooth_gain = 0.01
";

#[test]
fn options_of_earlier_versions_are_read_and_what_cannot_be_is_named() {
    let read = ReconstructOptions::from_toml;
    let mut expected = ReconstructOptions::default();
    // The default of today is another.
    expected.register.anchor = 0.1;
    assert_eq!(read(EARLIER).unwrap(), expected);
    let below: String = EARLIER.replace("\n[", "\n[reconstruct.");
    let track = TrackOptions::from_toml(&below.replacen("seed", "[reconstruct]\nseed", 1)).unwrap();
    let expected = TrackOptions { reconstruct: expected, ..TrackOptions::default() };
    assert_eq!(track, expected);
    // Stated for 334 samples, 300 vertices.
    let options = read("[joint]\nphotometric = 2\n[refine]\nreprojection = 1.0").unwrap();
    assert_eq!((options.joint.shading, options.refine.lambda_4), (668.0, 300.0));
    // A part of a table leaves the rest of it as it is in this table.
    let options = read("[joint.prior]\nkind = \"arap\"").unwrap();
    let prior = ReconstructOptions::default().joint.prior;
    assert_eq!(options.joint.prior, PriorWeights { kind: Prior::Arap, ..prior });
    let error = read("[refine]\nreference_count = 200").unwrap_err().to_string();
    assert!(error.contains("lambda_4, lambda_5 and lambda_6"), "{error}");
    let error = read("[register]\nanchor = -1.0").unwrap_err().to_string();
    assert!(error.contains("anchor"), "{error}");
}

#[test]
fn literal_of_a_table_of_the_file_counts() {
    let case = case();
    let vertices = |text: &str| {
        let options = ReconstructOptions::from_toml(text).unwrap();
        solve(&case, Method::Dsfm, &options).unwrap().vertices
    };
    let printed = vertices("literal = true");
    assert_eq!(vertices("[register]\nliteral = true"), printed);
    assert_eq!(vertices("[refine]\nliteral = true"), printed);
    // A video is followed from the last shape, from which the printed forms do not start.
    let error = TrackOptions::from_toml("[reconstruct.register]\nliteral = true").unwrap_err();
    assert!(error.to_string().contains("reconstruct.literal must be false"), "{error}");
    assert_ne!(vertices(""), printed);
}

#[test]
fn reports_name_the_equation_that_a_term_belongs_to() {
    let case = case();
    let options = ReconstructOptions::default();
    let motion = labels(&solve(&case, Method::Dsfm, &options).unwrap());
    assert!(motion.iter().any(|l| l == "depth prior"), "{motion:?}");
    assert!(!motion.iter().any(|l| l.contains("eq. 4")), "{motion:?}");
    let joint = labels(&solve(&case, Method::Joint, &options).unwrap());
    assert!(joint.iter().any(|l| l == "shading"), "{joint:?}");
    assert!(!joint.iter().any(|l| l.contains("eq. ")), "{joint:?}");
    let shaded = labels(&solve(&case, Method::Dsfms, &options).unwrap());
    assert!(shaded.iter().any(|l| l == "smoothing (eq. 4)"), "{shaded:?}");
}

#[test]
fn the_commented_defaults_are_the_defaults_and_miss_no_field() {
    let template = TemplateOptions::commented();
    assert_eq!(TemplateOptions::from_toml(&template).unwrap(), TemplateOptions::default());
    let frame = ReconstructOptions::commented();
    assert_eq!(ReconstructOptions::from_toml(&frame).unwrap(), ReconstructOptions::default());
    let track = TrackOptions::commented();
    assert_eq!(TrackOptions::from_toml(&track).unwrap(), TrackOptions::default());
    for text in [&template, &frame, &track] {
        let undocumented = text.lines().zip(text.lines().skip(1)).find(|(above, line)| {
            line.contains(" = ") && !line.starts_with('#') && !above.starts_with("# ")
        });
        assert_eq!(undocumented, None);
        let empty = text.split("\n\n").find(|table| table.lines().count() < 2);
        assert_eq!(empty, None, "a table without fields");
    }
    for field in ["combine", "voxel", "focal", "grazing_cos", "max_extra_cuts", "corner_deg"] {
        assert!(
            template.lines().any(|l| l.trim_start_matches("# ").starts_with(&format!("{field} =")))
        );
    }
}

#[test]
fn the_same_case_gives_the_same_surface_at_any_resolution() {
    let solved = |scale: f64| {
        let mut case = case();
        let [w, h] = case.camera.size.map(|n| (scale * n as f64).round() as usize);
        // Pixel centres lie at integers.
        let at = |x: f64| scale * (x + 0.5) - 0.5;
        case.camera.size = [w, h];
        case.camera.focal = case.camera.focal.map(|f| scale * f);
        case.camera.centre = case.camera.centre.map(at);
        case.matches.iter_mut().for_each(|m| m.pixel = m.pixel.map(at));
        case.frame = Frame { size: [w, h], rgb: vec![[128; 3]; w * h], ..case.frame };
        let found = solve(&case, Method::Dsfm, &ReconstructOptions::default()).unwrap();
        let kept = found.matches.iter().filter(|m| m.1).count();
        (found.vertices, kept)
    };
    let (middle, kept) = solved(1280.0 / 720.0);
    for width in [320.0, 3840.0] {
        let (found, other) = solved(width / 720.0);
        assert_eq!(other, kept, "{width} px");
        let off = found.iter().zip(&middle).map(|(a, b)| (a - b).norm());
        let mean = off.sum::<f64>() / middle.len() as f64;
        assert!(mean < 0.03, "{width} px: {mean} mm");
    }
}
