use super::*;
use crate::camera::{CameraModel, Lens};
use crate::geometry::Point3;
use crate::image::ToneCurve;
use crate::light::{LightModel, PointLight, REFERENCE_DISTANCE, RingLight, Spot};

fn read(name: &str, text: &str) -> Result<CameraFile, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    read_camera(&path).map_err(|error| {
        let message = error.to_string();
        assert!(message.contains(name), "no file name in {message}");
        message
    })
}

const PLAIN: &str =
    r#"{"fx": 548.0, "fy": 549, "cx": 316.4, "cy": 243.2, "width": 640, "height": 480}"#;

fn with(field: &str) -> String {
    PLAIN.replace('}', &format!(", {field}}}"))
}

fn plain() -> CameraModel {
    CameraModel::pinhole([640, 480], [548.0, 549.0], [316.4, 243.2])
}

#[test]
fn six_numbers_are_complete() {
    let file = read("camera.json", PLAIN).unwrap();
    assert_eq!(file, CameraFile { camera: plain(), tone: None, light: None, vignetting: None });
}

#[test]
fn a_described_scene() {
    let text = with(
        r#""distortion_model": "brown_conrady (OpenCV: k1,k2,p1,p2,k3=0)",
        "distortion": {"k1": -0.2, "k2": 0.1, "p1": 0.001, "p2": 0},
        "pixel_convention": "OpenCV: the centre of the top-left pixel is (0,0)",
        "tone_curve": "8-bit value = round(255*OETF(linear radiance)), OETF = sRGB (IEC 61966-2-1)",
        "light": {"kind": "offset", "offsets_mm_camera_frame": [[0, -3, 0], [1, 3, 0]],
          "falloff": "inverse square times a spot profile: 1 within 10 deg of the optical axis, falling linearly with the angle to 0 at 52 deg",
          "note": "rigidly attached"}"#,
    );
    let file = read("camera.json", &text).unwrap();
    let lens = Lens::BrownConrady { k: [-0.2, 0.1, 0.0], p: [0.001, 0.0] };
    assert_eq!(file.camera, CameraModel { lens, ..plain() });
    assert_eq!(file.tone, Some(ToneCurve::Srgb));
    let light = PointLight {
        positions: vec![Point3::new(0.0, -3.0, 0.0), Point3::new(1.0, 3.0, 0.0)],
        reference_distance: REFERENCE_DISTANCE,
        spot: Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 },
    };
    assert_eq!(file.light, Some(LightModel::Point(light)));
}

#[test]
fn written_files_read_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("camera.json");
    let light = |spot| {
        let positions = vec![Point3::new(0.0, -3.0, 0.1)];
        LightModel::Point(PointLight { positions, reference_distance: 62.5, spot })
    };
    let table = (0..256).map(|i| i as f64 / 256.0).collect();
    for (lens, tone, light) in [
        (Lens::Pinhole, None, None),
        (
            Lens::BrownConrady { k: [-0.23, 0.34, -0.24], p: [0.1, 0.2] },
            Some(ToneCurve::Gamma(2.2)),
            Some(light(Spot::CosinePower { exponent: 1.5 })),
        ),
        (
            Lens::KannalaBrandt { k: [0.1, 0.2, 0.3, 0.4] },
            Some(ToneCurve::Table(table)),
            Some(light(Spot::Linear { inner_deg: 5.0, outer_deg: 40.0 })),
        ),
        (
            Lens::Rational { k: [0.5, 0.1, 0.01, 0.6, 0.2, 0.02], p: [0.1, 0.2] },
            None,
            Some(
                RingLight {
                    radius: 3.5,
                    centre: Point3::new(0.1, 0.2, -1.0),
                    reference_distance: 62.5,
                    spot: Spot::Linear { inner_deg: 5.0, outer_deg: 40.0 },
                }
                .into(),
            ),
        ),
        (Lens::Pinhole, Some(ToneCurve::Linear), Some(light(Spot::Isotropic))),
        (Lens::Pinhole, Some(ToneCurve::Srgb), Some(LightModel::Collinear)),
    ] {
        let file = CameraFile {
            camera: CameraModel { lens, ..plain() },
            tone,
            light,
            vignetting: Some(-0.25),
        };
        write_camera(&path, &file).unwrap();
        assert_eq!(read_camera(&path).unwrap(), file);
    }
    let nowhere = dir.path().join("no").join("camera.json");
    let file = CameraFile { camera: plain(), tone: None, light: None, vignetting: None };
    assert!(write_camera(&nowhere, &file).unwrap_err().to_string().contains("cannot be written"));
}

#[test]
fn words_for_lights_tones_and_conventions() {
    let light = |text: &str| read("c.json", &with(&format!("\"light\": {text}"))).unwrap().light;
    assert_eq!(light(r#"{"kind": "distant"}"#), Some(LightModel::Collinear));
    assert_eq!(light("\"Collinear\""), Some(LightModel::Collinear));
    assert_eq!(light("null"), None);
    let Some(LightModel::Point(point)) =
        light(r#"{"kind": "colocated", "falloff": "1/r^2, cos^2 profile"}"#)
    else {
        panic!()
    };
    assert_eq!(point.positions, [Point3::origin()]);
    assert_eq!(point.spot, Spot::CosinePower { exponent: 2.0 });
    let Some(LightModel::Point(point)) =
        light(r#"{"positions": [1, 2, 3], "spot": {"inner_deg": 1, "outer_deg": 2}}"#)
    else {
        panic!()
    };
    assert_eq!(point.spot, Spot::Linear { inner_deg: 1.0, outer_deg: 2.0 });
    let ring = |spot| RingLight {
        radius: 4.5,
        centre: Point3::new(0.0, 0.0, -2.0),
        reference_distance: 60.0,
        spot,
    };
    for (text, spot) in [
        (r#""radius": 4.5, "reference_distance": 60, "note": "of LEDs""#, Spot::Isotropic),
        (
            r#""radius_mm": 4.5, "reference_distance_mm": 60, "spot": {"exponent": 2}"#,
            Spot::CosinePower { exponent: 2.0 },
        ),
    ] {
        let text = format!(r#"{{"kind": "ring", "centre": [0, 0, -2], {text}}}"#);
        assert_eq!(light(&text), Some(ring(spot).into()));
    }
    // Older files call several points a ring.
    assert_eq!(
        light(r#"{"kind": "ring of points", "positions": [[1, 0, 0], [-1, 0, 0]]}"#)
            .unwrap()
            .sources()
            .len(),
        2
    );
    let tone =
        |text: &str| read("c.json", &with(&format!("\"tone_curve\": \"{text}\""))).unwrap().tone;
    assert_eq!(tone("Gamma 2.2"), Some(ToneCurve::Gamma(2.2)));
    assert_eq!(tone("gamma 1/2.2"), Some(ToneCurve::Gamma(2.2)));
    assert_eq!(tone("linear"), Some(ToneCurve::Linear));
    let convention = |text: &str| {
        let text = with(&format!("\"pixel_convention\": \"{text}\""));
        read("c.json", &text).unwrap().camera.centre
    };
    assert_eq!(
        convention("COLMAP: the centre of the top-left pixel is (0.5, 0.5)"),
        [315.9, 242.7]
    );
    assert_eq!(convention("integer centres"), [316.4, 243.2]);
    let fisheye = with(r#""distortion_model": "fisheye", "k1": 0.1, "k4": 0.2"#);
    let lens = read("c.json", &fisheye).unwrap().camera.lens;
    assert_eq!(lens, Lens::KannalaBrandt { k: [0.1, 0.0, 0.0, 0.2] });
}

#[test]
fn bad_json_is_explained() {
    for (text, words) in [
        (PLAIN.replace("548.0", "NaN"), "NaN and Infinity are not valid JSON"),
        (PLAIN.replace("548.0", "-Infinity"), "NaN and Infinity are not valid JSON"),
        (PLAIN.replace("548.0", "null"), "field fx: is null; expected a finite number"),
        (PLAIN.replace("548.0", "\"548 px\""), "field fx: is \"548 px\""),
        (PLAIN.replace("548.0", "-548"), "field fx is -548"),
        (PLAIN.replace("548.0", "1e999"), "not valid JSON"),
        (PLAIN.replace("\"fx\"", "\"f_x\""), "field fx: is missing; found only"),
        (PLAIN.replace("\"fx\"", "\"FX\""), "did you mean to write \"FX\""),
        (PLAIN.replace("640", "0"), "field width"),
        (PLAIN.replace("640", "640.5"), "field width"),
        (PLAIN.replace("316.4", "9000"), "cx is 9000"),
        (with("\"distortion\": {\"k_1\": 0.1}"), "field distortion.k_1: is no coefficient"),
        (
            with("\"distortion\": {\"k1\": 0.1, \"k4\": 0.1}"),
            "brown_conrady has no such coefficient",
        ),
        (with("\"distortion\": {\"k1\": null}"), "field distortion.k1"),
        (with("\"distortion_model\": \"moebius\""), "field distortion_model"),
        (with("\"tone_curve\": \"log-c\""), "field tone_curve"),
        (with("\"light\": {\"kind\": \"torch\"}"), "field light.kind"),
        (with("\"light\": {\"kind\": \"point\"}"), "field light.positions"),
        (with("\"light\": {\"kind\": \"ring\"}"), "field light.radius: missing"),
        (with("\"light\": {\"kind\": \"ring\", \"radius\": -1}"), "light.radius is -1"),
        (with("\"light\": {\"kind\": \"ring\", \"radios\": 4}"), "field light.radios"),
        (with("\"light\": {\"kind\": \"ring\", \"radius\": [4]}"), "field light"),
        (
            with("\"light\": {\"kind\": \"point\", \"positions\": [[1, 2]]}"),
            "field light.positions",
        ),
        ("{}".into(), "field width: is missing"),
        ("{".into(), "not valid JSON"),
        ("[]".into(), "expected an object"),
        (" ".into(), "empty"),
    ] {
        let message = read("camera.json", &text).unwrap_err();
        assert!(message.contains(words), "{message:?} lacks {words:?}");
    }
}

#[test]
fn opencv_yaml_and_json() {
    let yaml = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 548., 0., 316.4, 0.,\n       549., 243.2, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.2, 0.1, 0.001, 0.002, 0.05 ]\n";
    let lens = Lens::BrownConrady { k: [-0.2, 0.1, 0.05], p: [0.001, 0.002] };
    assert_eq!(read("c.yaml", yaml).unwrap().camera, CameraModel { lens, ..plain() });
    let json = r#"{"K": [[548, 0, 316.4], [0, 549, 243.2], [0, 0, 1]], "width": 640, "height": 480,
        "dist_coeffs": [[0.1, 0.2, 0.3, 0.4]], "camera_model": "fisheye"}"#;
    let lens = Lens::KannalaBrandt { k: [0.1, 0.2, 0.3, 0.4] };
    assert_eq!(read("c.json", json).unwrap().camera, CameraModel { lens, ..plain() });
    let rational = yaml.replace("0.05 ]", "0.05, 0.1, 0.2, 0.3 ]");
    let lens = Lens::Rational { k: [-0.2, 0.1, 0.05, 0.1, 0.2, 0.3], p: [0.001, 0.002] };
    assert_eq!(read("c.yml", &rational).unwrap().camera.lens, lens);
    let thin = yaml.replace("0.05 ]", "0.05, 0, 0, 0, 0.01, 0, 0, 0 ]");
    assert!(read("c.yml", &thin).unwrap_err().contains("thin-prism"));
    let plumb = rational.replace("camera_matrix", "distortion_model: plumb_bob\ncamera_matrix");
    assert!(read("c.yml", &plumb).unwrap_err().contains("brown_conrady has k1 k2 p1 p2 k3"));
    let ros =
        rational.replace("camera_matrix", "distortion_model: rational_polynomial\ncamera_matrix");
    assert_eq!(read("c.yml", &ros).unwrap().camera.lens, lens);
    assert!(read("c.yml", &yaml.replace("548.", ".nan")).unwrap_err().contains("camera_matrix"));
    let sizeless = yaml.replace("image_width", "wide");
    assert!(read("c.yml", &sizeless).unwrap_err().contains("field image_width: is missing"));
}

#[test]
fn colmap_cameras() {
    let text = "# Camera list\n1 OPENCV 640 480 548 549 316.9 243.7 -0.2 0.1 0.001 0.002\n";
    let lens = Lens::BrownConrady { k: [-0.2, 0.1, 0.0], p: [0.001, 0.002] };
    let camera = read("cameras.txt", text).unwrap().camera;
    assert_eq!(camera.lens, lens);
    assert!((camera.centre[0] - 316.4).abs() < 1e-12 && (camera.centre[1] - 243.2).abs() < 1e-12);
    let simple = read("cameras.txt", "1 SIMPLE_PINHOLE 640 480 500 320 240\n").unwrap();
    assert_eq!((simple.camera.focal, simple.camera.centre), ([500.0; 2], [319.5, 239.5]));
    for (bad, words) in [
        ("1 FOV 640 480 1 2 3 4 5\n", "not supported"),
        ("1 PINHOLE 640 480 500 320 240\n", "line 1: 3 parameters"),
        ("1 PINHOLE 640 480 nan 500 320 240\n", "no finite number"),
        (
            "1 SIMPLE_PINHOLE 640 480 500 320 240\n2 SIMPLE_PINHOLE 640 480 501 320 240\n",
            "1 and 2 differ",
        ),
        ("# nothing\n", "no camera"),
        ("hello\n", "line 1"),
    ] {
        let message = read("cameras.txt", bad).unwrap_err();
        assert!(message.contains(words), "{message:?} lacks {words:?}");
    }
}

#[test]
fn images_of_a_model_may_have_cameras_of_their_own() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    let zoomed = "1 SIMPLE_PINHOLE 640 480 500 320 240\n2 SIMPLE_PINHOLE 640 480 700 320 240\n";
    write("cameras.txt", zoomed);
    let image =
        |id: u32, camera: u32| format!("{id} 1 0 0 0 0 0 0 {camera} a/frame_{id:03}.png\n\n");
    write("images.txt", &[image(1, 1), image(2, 2), image(3, 2)].concat());
    let found = super::read_image_cameras(dir.path()).unwrap().unwrap();
    assert_eq!(found.common.focal, [700.0; 2]);
    assert_eq!(found.of("frame_001").focal, [500.0; 2]);
    assert_eq!(found.of("frame_003.png").focal, [700.0; 2]);
    assert_eq!(found.of("other").focal, [700.0; 2], "not in the model");
    write("images.txt", &image(1, 7));
    let message = super::read_image_cameras(dir.path()).unwrap_err().to_string();
    assert!(message.contains("camera 7") && message.contains("frame_001"), "{message}");
    write("cameras.txt", "1 SIMPLE_PINHOLE 640 480 500 320 240\n");
    assert_eq!(super::read_image_cameras(dir.path()).unwrap(), None);
}

#[test]
fn fields_that_would_be_lost_are_errors() {
    for (field, near) in [
        ("\"distorsion\": {\"k1\": -0.3}", "distortion"),
        ("\"Distortion\": [0.1, 0]", "distortion"),
        ("\"vigneting\": -0.2", "vignetting"),
        ("\"tone_cruve\": \"linear\"", "tone_curve"),
        ("\"distortion_coefficients\": [-0.3, 0, 0, 0]", "expected"),
    ] {
        let message = read("camera.json", &with(field)).unwrap_err();
        assert!(message.contains(near) && message.contains("not known"), "{field}: {message}");
    }
    assert!(read("camera.json", &with("\"skew\": 3")).unwrap_err().contains("skew: is not 0"));
    let light =
        "\"light\": {\"kind\": \"point\", \"positions\": [[5, 0, 0]], \"referense_distance\": 40}";
    assert!(read("camera.json", &with(light)).unwrap_err().contains("reference_distance"));
    // Remarks are texts.
    let remark = "\"projection\": \"x right, y down\", \"note\": \"of the left eye\"";
    assert_eq!(read("camera.json", &with(remark)).unwrap().camera, plain());
    let ros = "image_width: 640\nimage_height: 480\ncamera_mQtrix:\n  data: [1]\nK: [548, 0, 316.4, 0, 549, 243.2, 0, 0, 1]\n\
               extrinsics: [1, 2]\nnframes: 30\n";
    assert!(read("camera.yaml", ros).unwrap_err().contains("camera_matrix"));
    let good = ros.replace("camera_mQtrix:\n  data: [1]\n", "");
    assert_eq!(read("camera.yaml", &good).unwrap().camera, plain());
}

#[test]
fn an_error_does_not_list_what_nobody_reads() {
    let many: String = (0..9000).map(|i| format!("key{i}: {i}\n")).collect();
    let message = read("camera.yaml", &format!("K: [1]\n{many}")).unwrap_err();
    assert!(message.len() < 1000, "{} bytes", message.len());
    let deep = format!("a: {}{}\n", "[".repeat(60_000), "]".repeat(60_000));
    assert!(read("camera.yaml", &deep).unwrap_err().contains("too deeply"));
}

#[test]
fn opencv_xml() {
    let text = r#"<?xml version="1.0"?>
<opencv_storage>
<!-- <made> by calibration.exe -->
<calibration_time>"Mon 1 Jan"</calibration_time>
<image_width>640</image_width>
<image_height>480</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows><cols>3</cols><dt>d</dt>
  <data>548. 0. 3.164e+02 0. 549. 243.2 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows><cols>1</cols><dt>d</dt>
  <data>-0.2 0.1 0.001 0. 0.</data></distortion_coefficients>
</opencv_storage>"#;
    let lens = Lens::BrownConrady { k: [-0.2, 0.1, 0.0], p: [0.001, 0.0] };
    assert_eq!(read("cal.xml", text).unwrap().camera, CameraModel { lens, ..plain() });
    let cut = &text[..text.len() - 40];
    assert!(read("cal.xml", cut).unwrap_err().contains("ends before"));
    let other = "<svg><a/></svg>";
    assert!(read("cal.xml", other).unwrap_err().contains("opencv_storage"));
    let deep = "<a>".repeat(100);
    assert!(read("cal.xml", &deep).unwrap_err().contains("too deeply"));
}

#[test]
fn transforms_of_nerfstudio() {
    let text = r#"{"w": 640, "h": 480, "fl_x": 548.0, "fl_y": 549, "cx": 316.9, "cy": 243.7,
        "k1": -0.2, "k2": 0.1, "p1": 0.001, "p2": 0, "camera_model": "OPENCV", "frames": []}"#;
    let lens = Lens::BrownConrady { k: [-0.2, 0.1, 0.0], p: [0.001, 0.0] };
    let found = read("transforms.json", text).unwrap().camera;
    assert!((found.centre[0] - 316.4).abs() < 1e-9 && (found.centre[1] - 243.2).abs() < 1e-9);
    assert_eq!(found, CameraModel { lens, centre: found.centre, ..plain() });
}

#[test]
fn numbers_written_as_texts() {
    let text = r#"{"projection": "frame", "width": "640", "height": "480", "fx": "5.48e+02", "fy": "549",
        "cx": "316.4", "cy": "243.2", "skew": "0.0", "k1": "-0.2", "k2": "0.1", "k3": "0", "k4": "0",
        "p1": "0.001", "p2": "0"}"#;
    let lens = Lens::BrownConrady { k: [-0.2, 0.1, 0.0], p: [0.001, 0.0] };
    assert_eq!(read("p2ilf.json", text).unwrap().camera, CameraModel { lens, ..plain() });
    let skewed = text.replace("\"skew\": \"0.0\"", "\"skew\": \"1.5\"");
    assert!(read("p2ilf.json", &skewed).unwrap_err().contains("skew"));
}

#[test]
fn poses_are_no_intrinsics() {
    let text = r#"{"K": [[548, 0, 1], [0, 549, 1], [0, 0, 1]], "exploration": [{"image": "a.png",
        "R": [[1,0,0],[0,1,0],[0,0,1]], "t": [0,0,1]}]}"#;
    assert!(
        read("poses.json", text).unwrap_err().contains("camera poses (R and t), no intrinsics")
    );
}
