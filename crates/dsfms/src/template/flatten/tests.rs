use super::*;
use crate::mesh::shapes;

fn worst(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, |m, v| f64::max(m, v.abs()))
}

fn check(mesh: &Mesh) -> Flattening {
    let map = flatten(mesh, &FlattenOptions::default()).unwrap();
    assert_eq!(map.flipped(), 0);
    assert_eq!(map.corners.len(), mesh.topology.faces.len());
    for p in map.corners.iter().flatten() {
        assert!((0.0..=1.0).contains(&p.x) && (0.0..=1.0).contains(&p.y), "{p}");
    }
    map
}

#[test]
fn a_flat_sheet_stays_as_it_is() {
    let map = check(&shapes::irregular_sheet(9));
    assert!(map.seam.is_empty());
    assert!(worst(&map.quasi_conformal) < 1.0 + 1e-6);
    assert!(worst(&map.log_area) < 1e-6);
}

#[test]
fn a_tube_unrolls_without_distortion() {
    let map = check(&shapes::tube(24, 9, 3.0));
    assert_eq!(map.seam.len(), 8);
    assert!(worst(&map.quasi_conformal) < 1.0 + 1e-6, "{}", worst(&map.quasi_conformal));
}

#[test]
fn a_hemisphere_becomes_the_stereographic_disc() {
    let map = check(&shapes::hemisphere(4, 1.0));
    assert!(map.seam.is_empty());
    let mut ratios = map.quasi_conformal.clone();
    ratios.sort_by(f64::total_cmp);
    assert!(ratios[ratios.len() / 2] < 1.03, "{}", ratios[ratios.len() / 2]);
    // Scale of the stereographic map: 2/(1 + cos θ), so the area ratio rim to pole is 4.
    let low = map.log_area.iter().copied().fold(f64::INFINITY, f64::min);
    let high = map.log_area.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    assert!(((high - low).exp() - 4.0).abs() < 0.8, "{}", (high - low).exp());
}

#[test]
fn every_method_agrees_where_there_is_one_answer() {
    let median = |values: &[f64]| {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    };
    for method in [FlattenMethod::Bff, FlattenMethod::Lscm, FlattenMethod::Spectral] {
        let options = FlattenOptions { method, max_extra_cuts: 0, ..FlattenOptions::default() };
        let flat = flatten(&shapes::irregular_sheet(9), &options).unwrap();
        assert_eq!(flat.flipped(), 0);
        assert!(worst(&flat.quasi_conformal) < 1.0 + 1e-5, "{method:?}");
        assert!(worst(&flat.log_area) < 1e-5, "{method:?}: {}", worst(&flat.log_area));
        let tube = flatten(&shapes::tube(24, 9, 3.0), &options).unwrap();
        assert!(worst(&tube.log_area) < 1e-5, "{method:?}: {}", worst(&tube.log_area));
        let cap = flatten(&shapes::hemisphere(4, 1.0), &options).unwrap();
        assert_eq!(cap.flipped(), 0);
        assert!(
            median(&cap.quasi_conformal) < 1.05,
            "{method:?}: {}",
            median(&cap.quasi_conformal)
        );
    }
}

#[test]
fn closed_and_handled_surfaces_are_cut() {
    for mesh in [shapes::icosphere(3, 2.0), shapes::torus(24, 14)] {
        let map = check(&mesh);
        assert!(!map.seam.is_empty());
        let mut ratios = map.quasi_conformal.clone();
        ratios.sort_by(f64::total_cmp);
        assert!(ratios[ratios.len() / 2] < 1.1, "{}", ratios[ratios.len() / 2]);
    }
}

#[test]
fn components_lie_side_by_side() {
    let sheet = shapes::irregular_sheet(5);
    let n = sheet.positions.len() as u32;
    let mut positions = sheet.positions.clone();
    positions.extend(sheet.positions.iter().map(|p| p * 2.0));
    let mut faces = sheet.topology.faces.clone();
    faces.extend(sheet.topology.faces.iter().map(|f| f.map(|v| v + n)));
    let map = check(&shapes::mesh(positions, faces));
    let half = map.corners.len() / 2;
    let area = |range: std::ops::Range<usize>| map.corners[range].iter().map(signed_area).sum();
    let (small, large): (f64, f64) = (area(0..half), area(half..2 * half));
    assert!((large / small - 4.0).abs() < 1e-6);
    let bound = |range: std::ops::Range<usize>, axis: usize| {
        let x = map.corners[range].iter().flatten().map(|p| p[axis]);
        x.fold((1.0f64, 0.0f64), |(low, high), x| (low.min(x), high.max(x)))
    };
    let apart = |axis| {
        let (a, b) = (bound(0..half, axis), bound(half..2 * half, axis));
        a.0 > b.1 || b.0 > a.1
    };
    assert!(apart(0) || apart(1));
}

#[test]
fn refuses_a_face_without_area() {
    let p = |x: f64, y: f64| crate::geometry::Point3::new(x, y, 0.0);
    let mesh = shapes::mesh(vec![p(0., 0.), p(1., 0.), p(2., 0.)], vec![[0, 1, 2]]);
    let error = flatten(&mesh, &FlattenOptions::default()).unwrap_err();
    assert_eq!(error, FlattenError::DegenerateFace { face: 0 });
}
