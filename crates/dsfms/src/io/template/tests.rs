use super::*;
use crate::camera::{CameraModel, Lens};
use crate::geometry::{Isometry, Vector3};
use crate::image::ToneCurve;
use crate::light::{Coat, LightModel, PointLight, Spot};
use crate::mesh::shapes;
use crate::template::bake::choose_resolution;
use crate::template::flatten::{FlattenOptions, flatten};
use crate::template::statistics::template_statistics;
use crate::template::usual::{Appearance, Usual};
use crate::template::{Features, LengthUnit, SparsePoint, SurfaceTexels, TemplateView};

fn tiny() -> Template {
    let mesh = shapes::icosphere(1, 7.123456789);
    let values: Vec<[f32; 3]> =
        (0..mesh.positions.len()).map(|i| [0.01 * i as f32, 0.3, 0.2]).collect();
    let resolution = choose_resolution(&mesh, 1.0);
    let mut albedo = SurfaceTexels::from_vertex_values(&mesh, &values, resolution).unwrap();
    albedo.views[3] = 0;
    Template {
        unit: LengthUnit::Millimetre,
        seen: (0..mesh.positions.len() as u32).collect(),
        sigma: (0..mesh.positions.len())
            .map(|i| if i == 7 { f64::INFINITY } else { 0.1 })
            .collect(),
        flattening: Some(flatten(&mesh, &FlattenOptions::default()).unwrap()),
        mesh,
        albedo: Some(albedo),
        features: Some(Features {
            descriptors: vec![[7; 128], [9; 128]],
            faces: vec![3, 5],
            barycentrics: vec![[0.1, 0.2, 0.7], [1.0 / 3.0; 3]],
        }),
        views: vec![TemplateView {
            name: "frame_000".into(),
            camera_from_template: Isometry::new(
                Vector3::new(0.1, 0.2, 1.0 / 3.0),
                Vector3::new(0.3, -0.2, 0.1),
            ),
            gain: 1.0 / 7.0,
            reprojection_px: 0.27,
        }],
        points: vec![SparsePoint {
            position: crate::geometry::Point3::new(0.1, 2.0, 1.0 / 3.0),
            rgb: [1, 2, 255],
            error_px: 0.7,
            sightings: vec![(0, crate::geometry::Point2::new(12.25, 300.5))],
        }],
        camera: Some(CameraModel {
            size: [640, 480],
            focal: [700.1, 699.9],
            centre: [319.5, 239.5],
            lens: Lens::BrownConrady { k: [0.1, -0.02, 0.003], p: [1e-4, -2e-5] },
        }),
        tone: ToneCurve::Gamma(2.2),
        light: Some(LightModel::Point(PointLight {
            positions: vec![crate::geometry::Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 },
        })),
        coat: Coat { refractive_index: 1.4, ambient: 0.03, vignetting: -0.2 },
        usual: Some(Usual {
            frames: 12,
            appearance: Appearance {
                correlation: Some(0.9),
                contrast: None,
                residual: 1.0 / 30.0,
                shown: 0.98,
                compared: 0.8,
            },
            depth: [40.1, 90.2],
        }),
        surroundings: Some(Surroundings {
            mesh: shapes::icosphere(1, 31.7),
            features: Features {
                descriptors: vec![[7; 128]],
                faces: vec![3],
                barycentrics: vec![[0.25, 0.25, 0.5]],
            },
        }),
    }
}

fn assert_same(a: &Template, b: &Template) {
    assert_eq!(a.unit, b.unit);
    assert_eq!(a.mesh.positions, b.mesh.positions);
    assert_eq!(a.mesh.topology, b.mesh.topology);
    assert_eq!(a.seen, b.seen);
    assert_eq!(a.sigma, b.sigma);
    assert_eq!(a.points, b.points);
    assert_eq!(a.flattening, b.flattening);
    assert_eq!(a.albedo, b.albedo);
    assert_eq!(a.features, b.features);
    assert_eq!(a.views, b.views);
    assert_eq!(a.camera, b.camera);
    assert_eq!(a.tone, b.tone);
    assert_eq!(a.light, b.light);
    assert_eq!(a.coat, b.coat);
    assert_eq!(a.usual, b.usual);
    let around = |t: &Template| {
        t.surroundings.as_ref().map(|s| (s.mesh.positions.clone(), s.features.clone()))
    };
    assert_eq!(around(a), around(b));
}

#[test]
fn usual_figures_that_nothing_can_be_measured_by_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organ.template");
    write_template(&path, &tiny()).unwrap();
    let good = fs::read_to_string(path.join(USUAL)).unwrap();
    for (from, to) in [("0.98", "nan"), ("0.0333", "-0.0333"), ("40.1", "400.1"), ("frames", "x")] {
        assert!(good.contains(from), "{good}");
        fs::write(path.join(USUAL), good.replace(from, to)).unwrap();
        let error = read_template(&path).unwrap_err().to_string();
        assert!(error.contains(USUAL), "{error}");
    }
    // An older template has none.
    fs::remove_file(path.join(USUAL)).unwrap();
    assert_eq!(read_template(&path).unwrap().usual, None);
}

#[test]
fn a_template_comes_back_bit_for_bit_and_can_be_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/organ.template");
    let mut template = tiny();
    write_template(&path, &template).unwrap();
    assert_same(&read_template(&path).unwrap(), &template);
    template.features = None;
    template.albedo = None;
    template.flattening = None;
    template.seen.clear();
    template.sigma.clear();
    template.usual = None;
    // As templates without it are.
    template.surroundings = None;
    template.unit = LengthUnit::TemplateUnit;
    write_template(&path, &template).unwrap();
    assert_same(&read_template(&path).unwrap(), &template);
    assert!(!path.join(ALBEDO).exists() && !path.join(SIGMA).exists());
    assert!(!path.join(SURROUNDINGS).exists() && !path.join(SURROUNDING_FEATURES).exists());
    assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
}

#[test]
fn the_glb_opens_in_a_gltf_reader() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organ.template");
    let template = tiny();
    write_template(&path, &template).unwrap();
    let document = gltf::Gltf::open(path.join("template.glb")).unwrap();
    assert_eq!(document.images().count(), 1);
    let file = read_mesh(&path.join("template.glb")).unwrap();
    assert_eq!(file.mesh.topology.faces.len(), template.mesh.topology.faces.len());
    let uv = file.uv.unwrap();
    let wanted = &template.flattening.unwrap().corners;
    assert!(uv.iter().flatten().zip(wanted.iter().flatten()).all(|(a, b)| (a - b).norm() < 1e-6));
    let sparse = fs::read_to_string(path.join("sparse/cameras.txt")).unwrap();
    assert!(sparse.contains("1 FULL_OPENCV 640 480 700.1 699.9 320 240 0.1 "), "{sparse}");
}

#[test]
fn refuses_to_replace_what_is_not_a_template() {
    let folder = tempfile::tempdir().unwrap();
    let error = write_template(folder.path(), &tiny()).unwrap_err();
    assert!(matches!(error, TemplateFileError::NotATemplate { .. }));
    assert!(folder.path().is_dir());
}

#[test]
fn every_damage_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organ.template");
    let missing = read_template(&path).unwrap_err();
    assert!(matches!(missing, TemplateFileError::Missing { .. }));
    write_template(&path, &tiny()).unwrap();
    let albedo = fs::read(path.join(ALBEDO)).unwrap();
    fs::write(path.join(ALBEDO), &albedo[..albedo.len() / 2]).unwrap();
    let cut = read_template(&path).unwrap_err().to_string();
    assert!(cut.contains(ALBEDO), "{cut}");
    fs::remove_file(path.join(ALBEDO)).unwrap();
    assert!(matches!(read_template(&path), Err(TemplateFileError::Damaged { .. })));
    fs::write(path.join(ALBEDO), &albedo).unwrap();
    for (sigma, what) in [(vec![0.1; 41], "holds 41"), (vec![-0.1; 42], "deviation is -0.1")] {
        arrays::write_sigma(&path.join(SIGMA), &sigma).unwrap();
        let wrong = read_template(&path).unwrap_err().to_string();
        assert!(wrong.contains(SIGMA) && wrong.contains(what), "{wrong}");
    }
    arrays::write_sigma(&path.join(SIGMA), &[0.1; 42]).unwrap();
    let template = tiny();
    let mut texels = template.albedo.clone().unwrap();
    texels.value[3][1] = f32::NAN;
    arrays::write_albedo(&path.join(ALBEDO), &texels).unwrap();
    let wrong = read_template(&path).unwrap_err().to_string();
    assert!(wrong.contains(ALBEDO) && wrong.contains("albedo is NaN"), "{wrong}");
    fs::write(path.join(ALBEDO), &albedo).unwrap();
    if let Some(mut map) = template.flattening.clone() {
        map.corners[0][0].x = f64::INFINITY;
        arrays::write_flattening(&path.join(FLATTENING), &map).unwrap();
        let wrong = read_template(&path).unwrap_err().to_string();
        assert!(wrong.contains(FLATTENING) && wrong.contains("not finite"), "{wrong}");
        let good = template.flattening.as_ref().unwrap();
        arrays::write_flattening(&path.join(FLATTENING), good).unwrap();
    }
    // As templates were before.
    fs::remove_file(path.join(SIGMA)).unwrap();
    fs::remove_file(path.join(USUAL)).unwrap();
    let older = read_template(&path).unwrap();
    assert!(older.sigma.is_empty() && older.usual.is_none());
    fs::write(path.join(USUAL), "frames = 3").unwrap();
    let wrong = read_template(&path).unwrap_err().to_string();
    assert!(wrong.contains(USUAL) && wrong.contains("appearance"), "{wrong}");
    fs::remove_file(path.join(USUAL)).unwrap();
    let manifest = fs::read_to_string(path.join(MANIFEST)).unwrap();
    let edit = |from: &str, to: &str| {
        fs::write(path.join(MANIFEST), manifest.replace(from, to)).unwrap();
        read_template(&path).unwrap_err()
    };
    let version = edit("version = 1", "version = 99");
    assert!(matches!(version, TemplateFileError::Version { found: 99, .. }));
    let count = edit("vertices = 42", "vertices = 43");
    assert!(matches!(count, TemplateFileError::Count { expected: 43, found: 42, .. }), "{count}");
    let coat = edit("ambient = ", "ambient = nan # ");
    assert!(coat.to_string().contains("coat"), "{coat}");
    let light = ["nan"; 256].join(", ");
    for (from, to, what) in [
        ("gamma = 2.2", "gamma = nan", "tone"),
        ("gamma = 2.2", "table = [0.0, 1.0]", "tone"),
        ("gamma = 2.2", &format!("table = [{light}]"), "tone"),
        ("gain = ", "gain = nan # ", "frame_000"),
        ("translation = [", "translation = [inf, 0.0, 0.0] # ", "frame_000"),
        ("rotation = [", "rotation = [0.0, 0.0, 0.0, 0.0] # ", "frame_000"),
    ] {
        assert!(manifest.contains(from), "{manifest}");
        let wrong = edit(from, to).to_string();
        assert!(wrong.contains("template.toml") && wrong.contains(what), "{to:.40}: {wrong}");
    }
    let field = edit("unit = ", "unity = ");
    assert!(field.to_string().contains("template.toml"), "{field}");
}

#[test]
fn statistics_of_the_tiny_template() {
    let s = template_statistics(&tiny());
    assert_eq!((s.vertices, s.faces, s.components, s.boundary_loops), (42, 80, 1, 0));
    assert_eq!((s.euler_characteristic, s.frames, s.features), (2, 1, 2));
    assert_eq!(s.seen_vertices, Some(41));
    assert_eq!(s.median_sigma, Some(0.1));
    // A third of the area of the faces around each vertex of which nothing is known.
    let mut template = tiny();
    let known = |t: &Template| template_statistics(t).unmeasured.unwrap();
    let before = known(&template);
    template.sigma = vec![0.1; 42];
    assert_eq!(known(&template), 0.0);
    template.sigma[7] = f64::INFINITY;
    let (areas, around) =
        (template.mesh.face_areas(), template.mesh.topology.vertex_faces[7].clone());
    let share: f64 = around.iter().map(|&f| areas[f as usize] / 3.0).sum();
    assert!((known(&template) - share / areas.iter().sum::<f64>()).abs() < 1e-12);
    template.sigma.clear();
    assert_eq!(template_statistics(&template).unmeasured, None);
    assert!(before < 0.1, "{before}");
    assert_eq!(s.flattening.unwrap().flipped, 0);
    let albedo = s.albedo.unwrap();
    assert!(albedo.observed < 1.0 && albedo.observed > 0.99);
    assert!(albedo.p5 < albedo.mean && albedo.mean < albedo.p95);
}

#[test]
fn what_would_not_read_back_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flat.template");
    let mut template = tiny();
    let [a, b, _] = template.mesh.topology.faces[0].map(|v| v as usize);
    template.mesh.positions[a] = template.mesh.positions[b];
    let error = write_template(&path, &template).unwrap_err();
    assert!(matches!(error, TemplateFileError::Unreadable { .. }), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// What a manifest and resolutions state alike is not believed before the values are there.
#[test]
fn texels_that_are_only_stated_take_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organ.template");
    write_template(&path, &tiny()).unwrap();
    let mut texels = tiny().albedo.unwrap();
    texels.resolution.fill(u16::MAX);
    arrays::write_albedo(&path.join(ALBEDO), &texels).unwrap();
    let manifest = fs::read_to_string(path.join(MANIFEST)).unwrap();
    let stated = 80 * u64::from(u16::MAX).pow(2);
    let found = texels.value.len();
    let lies = manifest.replace(&format!("texels = {found}"), &format!("texels = {stated}"));
    assert_ne!(lies, manifest);
    fs::write(path.join(MANIFEST), lies).unwrap();
    let wrong = read_template(&path).unwrap_err();
    assert!(matches!(wrong, TemplateFileError::Count { what: "texels", .. }), "{wrong}");
}

#[test]
fn manifests_of_more_than_their_bound_are_not_parsed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("organ.template");
    write_template(&path, &tiny()).unwrap();
    for (name, mib) in [(USUAL, "1 MiB"), (MANIFEST, "32 MiB")] {
        let file = fs::File::create(path.join(name)).unwrap();
        file.set_len(MOST_MANIFEST_BYTES + 1).unwrap();
        let wrong = read_template(&path).unwrap_err().to_string();
        assert!(wrong.contains(name) && wrong.contains(mib), "{wrong}");
    }
}
