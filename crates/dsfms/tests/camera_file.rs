//! The camera file as README.md and `docs/camera.schema.json` describe it.

use dsfms::camera::{CameraModel, Lens};
use dsfms::geometry::Point3;
use dsfms::image::ToneCurve;
use dsfms::io::camera::{CameraFile, read_camera, write_camera};
use dsfms::light::{LightModel, PointLight, RingLight, Spot};
use serde_json::Value;
use std::path::Path;

fn document(name: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    std::fs::read_to_string(root.join(name)).unwrap()
}

fn written(file: &CameraFile) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.json");
    write_camera(&path, file).unwrap();
    assert_eq!(&read_camera(&path).unwrap(), file);
    serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap()
}

/// The file of README.md.
fn described() -> CameraFile {
    CameraFile {
        camera: CameraModel {
            size: [640, 480],
            focal: [548.0, 549.0],
            centre: [316.4, 243.2],
            lens: Lens::BrownConrady { k: [-0.1, 0.02, 0.0], p: [0.0, 0.0] },
        },
        tone: Some(ToneCurve::Srgb),
        light: Some(LightModel::Point(PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 },
        })),
        vignetting: Some(-0.15),
    }
}

#[test]
fn the_example_of_the_readme_is_read_as_it_says() {
    let readme = document("README.md");
    let example = readme.split("```json\n").nth(1).and_then(|rest| rest.split("```").next());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.json");
    std::fs::write(&path, example.unwrap()).unwrap();
    assert_eq!(read_camera(&path).unwrap(), described());
}

/// The first camera file that a newcomer opens.
#[test]
fn the_camera_of_the_demo_is_written_as_the_readme_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../dsfms-cli/data/demo/camera.json");
    let given: Value = serde_json::from_str(&std::fs::read_to_string(&root).unwrap()).unwrap();
    let again = written(&read_camera(&root).unwrap());
    // Coefficients of 0 are left out.
    let numbers = given.as_object().unwrap().iter().filter(|f| !f.1.is_object());
    for (field, value) in numbers {
        assert_eq!(again[field], *value, "{field}");
    }
    for field in ["kind", "positions"] {
        assert_eq!(again["light"][field], given["light"][field]);
    }
    let spot = |file: &Value, end: &str| file["light"]["spot"][end].as_f64();
    assert!(["inner_deg", "outer_deg"].iter().all(|e| spot(&given, e) == spot(&again, e)));
}

#[test]
fn spots_are_written_as_numbers() {
    let spot = |spot| {
        let mut file = described();
        if let Some(LightModel::Point(light)) = &mut file.light {
            light.spot = spot;
        }
        written(&file)["light"]["spot"].clone()
    };
    let linear = spot(Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 });
    assert_eq!(linear, serde_json::json!({ "inner_deg": 10.0, "outer_deg": 52.0 }));
    let power = spot(Spot::CosinePower { exponent: 2.0 });
    assert_eq!(power, serde_json::json!({ "exponent": 2.0 }));
    assert_eq!(spot(Spot::Isotropic), "isotropic");
}

#[test]
fn the_schema_knows_every_field_that_is_written() {
    let schema: Value = serde_json::from_str(&document("docs/camera.schema.json")).unwrap();
    let file = written(&described());
    let known = |file: &Value, schema: &Value| {
        let object = file.as_object().unwrap();
        object.keys().all(|key| schema["properties"].get(key).is_some())
    };
    assert!(known(&file, &schema), "{file:#}");
    let light = &schema["properties"]["light"];
    let kinds = light["properties"]["kind"]["enum"].as_array().unwrap();
    let (reference_distance, spot) = (60.0, Spot::Isotropic);
    let ring = RingLight { radius: 4.0, centre: Point3::origin(), reference_distance, spot };
    for given in [described().light.unwrap(), ring.into(), LightModel::Collinear] {
        let file = written(&CameraFile { light: Some(given), ..described() });
        assert!(known(&file["light"], light), "{:#}", file["light"]);
        assert!(kinds.contains(&file["light"]["kind"]));
    }
    let models = schema["properties"]["distortion_model"]["enum"].as_array().unwrap();
    for kind in Lens::KINDS {
        let named: Vec<_> = kind.coefficients.iter().map(|name| (*name, 0.01)).collect();
        let mut file = described();
        file.camera.lens = kind.named_coefficients(&named);
        let file = written(&file);
        assert!(models.contains(&file["distortion_model"]), "{file:#}");
        let distortion = &schema["properties"]["distortion"]["oneOf"][0];
        assert!(known(&file["distortion"], distortion), "{file:#}");
    }
    let conventions = schema["properties"]["pixel_convention"]["enum"].as_array().unwrap();
    assert!(conventions.contains(&file["pixel_convention"]));
    for field in schema["required"].as_array().unwrap() {
        assert!(file.get(field.as_str().unwrap()).is_some(), "{field}");
    }
}
