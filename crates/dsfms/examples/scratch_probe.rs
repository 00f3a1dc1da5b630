use dsfms::geometry::Point3;
use dsfms::image::ToneCurve;
use dsfms::light::{LightModel, PointLight, Spot};
use dsfms::pipeline::{Method, Observation, ReconstructOptions, reconstruct};
use dsfms::synth::{Case, CaseOptions, Draw};
use rayon::prelude::*;

fn main() {
    let a: Vec<String> = std::env::args().collect();
    let n: u64 = a[1].parse().unwrap();
    let exts: Vec<f64> = a[2].split(',').map(|x| x.parse().unwrap()).collect();
    let methods: Vec<Method> = a[3].split(',').map(|m| serde_json::from_str(&format!("\"{m}\"")).unwrap()).collect();
    let mut o = ReconstructOptions::default();
    if let Some(s) = a.get(4) { if !s.is_empty() { o.joint = serde_json::from_str(s).unwrap(); } }
    if let Some(s) = a.get(5) { if !s.is_empty() { o.refine = serde_json::from_str(s).unwrap(); } }
    let near = std::env::var("NEAR").is_ok();
    let noise: f64 = std::env::var("NOISE").map(|s| s.parse().unwrap()).unwrap_or(1.0);
    let verbose = std::env::var("V").is_ok();
    let light = if near { LightModel::Point(PointLight { positions: vec![Point3::new(0.0, -3.0, 0.0)], reference_distance: 75.0, spot: Spot::Isotropic }) } else { LightModel::Collinear };
    for &e in &exts {
        let rows: Vec<(bool, f64, Vec<[f64; 4]>)> = (0..n).into_par_iter().map(|s| {
            let pull = s % 2 == 0;
            let case = Case::new(&CaseOptions { vertices: 334, extension: e, light: light.clone(), draw: Draw { count: 25, sigma_px: noise }, pull }, 7000 + s);
            let amp = case.deformation.vertices.iter().zip(&case.template.mesh.positions).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            let ob = Observation { frame: &case.frame, camera: &case.camera, tone: &ToneCurve::Srgb, matches: Some(&case.matches), instrument: None, organ: None };
            let errs = methods.iter().map(|&m| {
                let r = reconstruct(&case.template, &ob, m, &o).unwrap();
                let all = (r.vertices.iter().zip(&case.truth).map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / case.truth.len() as f64).sqrt();
                // tangential (across the ray) and depth parts in the zone
                let z: Vec<usize> = (0..case.truth.len()).filter(|&v| case.deformation.zone[v] || e == 0.0).collect();
                let mut dt = 0.0; let mut dd = 0.0;
                for &v in &z { let ray = case.truth[v].coords.normalize(); let d = r.vertices[v] - case.truth[v]; let al = d.dot(&ray); dd += al * al; dt += d.norm_squared() - al * al; }
                if verbose { let rigid = |v: usize| r.pose * case.template.mesh.positions[v]; let peak = *z.iter().max_by(|&&a, &&b| (case.truth[a] - rigid(a)).norm().total_cmp(&(case.truth[b] - rigid(b)).norm())).unwrap(); println!("    seed {s} {m:?} peak true {:.2} found {:.2} rms {:.2} cost {:?}", case.truth[peak].z - rigid(peak).z, r.vertices[peak].z - rigid(peak).z, case.zone_rms(&r.vertices), r.stages.last().and_then(|s| s.summary.as_ref()).map(|s| s.terms.iter().map(|t| format!("{} {:.1}", t.label.split(' ').next().unwrap(), t.after)).collect::<Vec<_>>())); }
                [case.zone_rms(&r.vertices), all, (dd / z.len() as f64).sqrt(), (dt / z.len() as f64).sqrt()]
            }).collect();
            (pull, amp, errs)
        }).collect();
        let k = n as f64;
        print!("ext {e:.2} amp {:.2} |", rows.iter().map(|r| r.1).sum::<f64>() / k);
        for (j, m) in methods.iter().enumerate() {
            let mean = |f: &dyn Fn(&(bool, f64, Vec<[f64; 4]>)) -> bool, i: usize| { let v: Vec<f64> = rows.iter().filter(|r| f(r)).map(|r| r.2[j][i]).collect(); v.iter().sum::<f64>() / v.len().max(1) as f64 };
            let z = mean(&|_| true, 0);
            let z0 = rows.iter().map(|r| r.2[0][0]).sum::<f64>() / k;
            let fails = rows.iter().filter(|r| r.2[j][0] > r.2[0][0]).count();
            print!(" {m:?} {z:.2} ({:.2}) pull {:.2} push {:.2} all {:.2} depth {:.2} tan {:.2} fail {fails} |", z / z0, mean(&|r| r.0, 0), mean(&|r| !r.0, 0), mean(&|_| true, 1), mean(&|_| true, 2), mean(&|_| true, 3));
        }
        println!();
        if verbose { for (s, r) in rows.iter().enumerate() { println!("  {s} {} {:.2} {:?}", r.0, r.1, r.2.iter().map(|x| format!("{:.2}", x[0])).collect::<Vec<_>>()); } }
    }
}
