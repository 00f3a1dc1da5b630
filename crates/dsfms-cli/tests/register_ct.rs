//! `register-ct` through the binary: results, refusals, bad input.

#[path = "../../dsfms/tests/common/organ.rs"]
mod organ;

use assert_cmd::Command;
use dsfms::Mesh;
use dsfms::geometry::{Point3, Similarity, Vector3};
use dsfms::io::mesh::{MeshUnit, read_mesh};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::preoperative::LandmarkPair;
use dsfms::template::LengthUnit;
use organ::{Explored, closed, organ, rms};
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;
use tempfile::TempDir;

struct Case {
    folder: TempDir,
    ct: Mesh,
    seen: Explored,
    landmarks: Vec<LandmarkPair>,
    tumour: Mesh,
}

impl Case {
    /// The CT mesh and its tumour in metres, a template in mm, five landmark pairs.
    fn new() -> Self {
        let ct = organ(20, 34);
        let pose =
            Similarity::new(Vector3::new(50.0, 20.0, -9.0), Vector3::new(0.4, 0.9, -0.2), 1.0);
        let seen = Explored::of(&ct, Vector3::new(0.2, 0.3, 1.0).normalize(), 3.0, 0.3, pose);
        let landmarks = seen.landmarks(&ct, 5, 2.0, &[], 0.0);
        let tumour = closed(6, 9, |d| d * 6.0 + Vector3::new(10.0, 5.0, 6.0));
        let case = Self { folder: tempfile::tempdir().unwrap(), ct, seen, landmarks, tumour };
        case.write("seen.ply", &case.seen.template, 1.0, LengthUnit::Millimetre);
        case.obj("ct.obj", &case.ct);
        case.obj("tumour.obj", &case.tumour);
        case.pairs("pairs.csv", 5);
        let template =
            ["template", "--mesh", "seen.ply", "-o", "organ.template", "--no-report", "--quiet"];
        case.dsfms(&template).assert().success();
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, mesh: &Mesh, factor: f64, unit: LengthUnit) {
        let points: Vec<Point3> = mesh.positions.iter().map(|p| p * factor).collect();
        let extras = PlyExtras::default();
        write_ply(&self.path(name), &mesh.topology, &points, unit, &extras).unwrap();
    }

    /// In metres, without a word of it.
    fn obj(&self, name: &str, mesh: &Mesh) {
        let vertex = |p: &Point3| format!("v {} {} {}\n", 1e-3 * p.x, 1e-3 * p.y, 1e-3 * p.z);
        let face = |f: &[u32; 3]| format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1);
        let vertices: String = mesh.positions.iter().map(vertex).collect();
        let faces: String = mesh.topology.faces.iter().map(face).collect();
        fs::write(self.path(name), vertices + &faces).unwrap();
    }

    /// The first landmarks, in the numbers of the files.
    fn pairs(&self, name: &str, count: usize) {
        let mut text = String::from("name,ct_x,ct_y,ct_z,template_x,template_y,template_z\n");
        for l in &self.landmarks[..count] {
            let (c, t) = (l.ct * 1e-3, l.template);
            text += &format!("{},{},{},{},{},{},{}\n", l.name, c.x, c.y, c.z, t.x, t.y, t.z);
        }
        fs::write(self.path(name), text).unwrap();
    }

    fn dsfms(&self, arguments: &[&str]) -> Command {
        let mut command = Command::cargo_bin("dsfms").unwrap();
        command.current_dir(self.folder.path()).args(arguments);
        command
    }

    /// What `register-ct` says on standard error, after its exit code.
    fn register(&self, more: &[&str], code: i32) -> String {
        let mut command =
            self.dsfms(&["register-ct", "organ.template", "ct.obj", "--mesh-unit", "m"]);
        let done = command.args(more).assert().code(code).get_output().clone();
        String::from_utf8_lossy(&done.stderr).into_owned()
    }

    fn record(&self, folder: &str) -> Value {
        let text = fs::read_to_string(self.path(folder).join("registration.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    }
}

#[test]
fn a_ct_in_metres_and_its_tumour_come_onto_the_template() {
    let case = Case::new();
    let input = ["--landmarks", "pairs.csv", "--structures", "tumour.obj", "-o", "ct"];
    case.register(&input, 0);
    let tumour = read_mesh(&case.path("ct/structures/tumour.ply")).unwrap();
    // What `reconstruct --structures` asks for: frame and unit of the template.
    assert_eq!(tumour.unit, Some(MeshUnit::Millimetre));
    assert_eq!(tumour.mesh.topology.faces, case.tumour.topology.faces);
    let pairs = tumour.mesh.positions.iter().zip(&case.tumour.positions);
    let error = rms(pairs.map(|(a, b)| (a - case.seen.now(b)).norm()));
    assert!(error < 2.5, "{error} mm");
    let expected = &tumour.attributes["expected_error"];
    assert!(expected.iter().all(|e| (0.2..10.0).contains(e)), "{expected:?}");
    let surface = read_mesh(&case.path("ct/ct.ply")).unwrap();
    assert_eq!(surface.mesh.topology.faces, case.ct.topology.faces);
    let record = case.record("ct");
    assert_eq!((&record["status"], &record["found"]["unit"]), (&json!("ok"), &json!("mm")));
    let number = |path: &str| record.pointer(path).and_then(Value::as_f64).unwrap();
    assert!(number("/found/residual/rms") < number("/found/residual_rigid/rms"));
    assert!(number("/found/residual/overlap") > 0.9);
    assert!((number("/found/mm_per_unit") - 1.0).abs() < 0.05);
    assert!(number("/found/structures/0/expected_error_mm") < 10.0);
    assert_eq!(record["landmarks"].as_array().unwrap().len(), 5);
    assert!(number("/landmarks/0/left_out_mm") > 0.0);
    // The matrices are each other's inverses and take a landmark where it belongs.
    let row = |name: &str, r: usize| -> Vec<f64> {
        serde_json::from_value(record["found"][name][r].clone()).unwrap()
    };
    let t = case.landmarks[0].template;
    let x: Vec<f64> = (0..3)
        .map(|r| {
            row("ct_from_template", r).iter().zip([t.x, t.y, t.z, 1.0]).map(|(a, b)| a * b).sum()
        })
        .collect();
    let off = (Point3::new(x[0], x[1], x[2]) - case.landmarks[0].ct).norm();
    assert!((off - number("/landmarks/0/final_mm")).abs() < 1e-6, "{off}");
    let picture = image::open(case.path("ct/registration.png")).unwrap().to_rgb8();
    let colours: std::collections::BTreeSet<[u8; 3]> = picture.pixels().map(|p| p.0).collect();
    assert!(picture.width() > 1000 && colours.len() > 500, "{}", colours.len());
    // A second run takes the folder's place; without bending the residual is that of the
    // similarity.
    case.register(&["--landmarks", "pairs.csv", "--rigid", "-o", "ct"], 0);
    let record = case.record("ct");
    assert!(record["found"].get("residual").is_none() && !case.path("ct/structures").exists());
}

#[test]
fn a_refusal_leaves_its_reason_and_nothing_else() {
    let case = Case::new();
    case.pairs("two.csv", 2);
    let said = case.register(&["--landmarks", "two.csv", "-o", "ct"], 1);
    assert!(said.contains("refused") && said.contains("at least 3"), "{said}");
    let record = case.record("ct");
    assert_eq!(record["status"], "failed");
    assert!(record["reasons"][0].as_str().unwrap().contains("2 landmark pairs"), "{record}");
    assert_eq!(fs::read_dir(case.path("ct")).unwrap().count(), 1);
}

#[test]
fn points_of_slicer_in_the_other_axes_are_told() {
    let case = Case::new();
    let markups = |name: &str, points: Vec<Point3>| {
        let point = |(k, p): (usize, &Point3)| json!({"label": format!("F-{k}"), "position": [p.x, p.y, p.z]});
        let list: Vec<Value> = points.iter().enumerate().map(point).collect();
        let text = json!({"markups": [{"coordinateSystem": "LPS", "controlPoints": list}]});
        fs::write(case.path(name), text.to_string()).unwrap();
    };
    // Far from the origin, as the scanner has them: x and y negated are elsewhere.
    let away = Vector3::new(150.0, 90.0, 20.0);
    let moved = case.ct.with_positions(case.ct.positions.iter().map(|p| p + away).collect());
    case.obj("ct.obj", &moved);
    markups("t.mrk.json", case.landmarks.iter().map(|l| l.template).collect());
    markups("ct.mrk.json", case.landmarks.iter().map(|l| (l.ct + away) * 1e-3).collect());
    let input = ["--landmarks", "ct.mrk.json", "t.mrk.json", "-o", "ct"];
    case.register(&input, 0);
    let said = case.register(&[&input[..], &["--mesh-axes", "ras"]].concat(), 64);
    assert!(said.contains("x and y negated") && said.contains("--mesh-axes"), "{said}");
}

#[test]
fn bad_input_is_named_and_leaves_nothing() {
    let case = Case::new();
    let header = "ct_vertex,template_vertex\n";
    fs::write(case.path("far.csv"), format!("{header}0,1\n5,2\n1000000,3\n")).unwrap();
    fs::write(case.path("word.csv"), format!("{header}0,1\n5,two\n")).unwrap();
    let shifted = closed(6, 9, |d| d * 6.0 + Vector3::new(900.0, 0.0, 0.0));
    case.obj("elsewhere.obj", &shifted);
    case.write("units.ply", &case.ct, 1.0, LengthUnit::TemplateUnit);
    for (more, code, needles) in [
        (&["--landmarks", "none.csv"][..], 1, ["none.csv", "no such file"]),
        (&["--landmarks", "far.csv"], 1, ["far.csv", "vertex 1000000"]),
        (&["--landmarks", "word.csv"], 1, ["line 3", "two"]),
        (&["--structures", "elsewhere.obj"], 64, ["elsewhere.obj", "one frame and unit"]),
        (&["--structures", "tumour.obj", "tumour.obj"], 64, ["tumour", "rename"]),
        (&["--max-deformation", "0mm"], 64, ["--max-deformation", "positive"]),
    ] {
        let said = case.register(&[more, &["-o", "out"]].concat(), code);
        assert!(needles.iter().all(|n| said.contains(n)), "{needles:?}: {said}");
        assert!(!case.path("out").exists());
    }
    let other = ["register-ct", "organ.template", "units.ply", "-o", "out"];
    let done = case.dsfms(&other).assert().code(64).get_output().clone();
    assert!(String::from_utf8_lossy(&done.stderr).contains("template units"));
    // A folder of the user is not replaced.
    fs::create_dir(case.path("mine")).unwrap();
    fs::write(case.path("mine/notes.txt"), "x").unwrap();
    let said = case.register(&["--landmarks", "pairs.csv", "-o", "mine"], 1);
    assert!(said.contains("notes.txt") && case.path("mine/notes.txt").exists(), "{said}");
}
