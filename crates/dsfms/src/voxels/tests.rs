use super::*;
use crate::geometry::{Isometry, Point3, Similarity, Vector3};
use crate::mesh::{Mesh, shapes};
use crate::structures::Carrier;
use nalgebra::{Affine3, Matrix4};

/// An egg of 20 x 24 x 28 mm about (30, -20, 15) in LPS.
fn egg() -> Mesh {
    let ball = shapes::icosphere(3, 1.0);
    let at = |p: &Point3| Point3::new(30.0 + 10.0 * p.x, -20.0 + 12.0 * p.y, 15.0 + 14.0 * p.z);
    ball.with_positions(ball.positions.iter().map(at).collect())
}

/// Voxels of 1.5 x 1.5 x 2 mm around the egg, the first axis from right to left.
fn grid() -> VoxelGrid {
    let rows = Matrix4::new(
        -1.5, 0.0, 0.0, -6.0, //
        0.0, 1.5, 0.0, -4.0, //
        0.0, 0.0, 2.0, -12.0, //
        0.0, 0.0, 0.0, 1.0,
    );
    VoxelGrid::new([32, 32, 26], Affine3::from_matrix_unchecked(rows)).unwrap()
}

/// A linear function of the world, single precision.
fn linear(p: &Point3) -> f64 {
    100.0 + 3.0 * p.x - 2.0 * p.y + 0.5 * p.z
}

fn volume(grid: &VoxelGrid) -> VoxelVolume {
    let [nx, ny, _] = grid.size();
    let value = |i: usize| linear(&(grid.world_from_voxel() * voxel(i, nx, ny))) as f32;
    let bytes = (0..grid.count()).flat_map(|i| value(i).to_le_bytes()).collect();
    VoxelVolume::new(grid.clone(), VoxelKind::F32, bytes).unwrap()
}

fn voxel(i: usize, nx: usize, ny: usize) -> Point3 {
    Point3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64)
}

fn warped(motion: &VoxelMotion, source: &VoxelVolume) -> VoxelVolume {
    let slices = (0..source.grid().size()[2])
        .map(|k| motion.warped_slice(source, -7.0, Sampling::Linear, k));
    let bytes = slices.flat_map(|s| {
        assert_eq!(s.unsolved, 0);
        s.bytes
    });
    VoxelVolume::new(source.grid().clone(), source.kind(), bytes.collect()).unwrap()
}

fn body(grid: &VoxelGrid) -> VoxelBody {
    let mesh = egg();
    VoxelBody::new(grid, MeshAxes::Lps, &mesh, &PlacedOrgan::template(&mesh)).unwrap()
}

fn pose() -> Isometry {
    Isometry::new(Vector3::new(4.0, -9.0, 120.0), Vector3::new(0.4, -0.7, 1.1))
}

/// Wider in x, bent in y.
fn bent(p: &Point3) -> Point3 {
    Point3::new(30.0 + 1.15 * (p.x - 30.0), p.y + 0.02 * (p.z - 15.0).powi(2), p.z)
}

#[test]
fn a_rigid_motion_leaves_the_organ_in_its_place() {
    let (grid, mesh) = (grid(), egg());
    let body = body(&grid);
    let deformed: Vec<Point3> = mesh.positions.iter().map(|p| pose() * p).collect();
    let motion = body.motion(&deformed).unwrap();
    assert!(motion.surface_mm()[1] < 1e-9);
    let source = volume(&grid);
    let found = warped(&motion, &source);
    let egg_mm3 = 4.0 / 3.0 * std::f64::consts::PI * 10.0 * 12.0 * 14.0;
    let voxels = body.inside();
    assert!((voxels as f64 * 4.5 / egg_mm3 - 1.0).abs() < 0.03, "{voxels}");
    for i in 0..grid.count() {
        let expected = if body.inside[i] { source.value(i) } else { -7.0 };
        assert!((found.value(i) - expected).abs() < 1e-3, "{i}");
    }
    assert!((0..3).all(|c| motion.field_slice(c, 13).iter().all(|v| v.abs() < 1e-9)));
    // RAS (-30, 20, 15) is the egg's middle, LPS (30, -20, 15).
    let seen = motion.camera_from_world().transform_point(&Point3::new(-30.0, 20.0, 15.0));
    assert!((seen - pose() * Point3::new(30.0, -20.0, 15.0)).norm() < 1e-9);
    assert_eq!((body.covered(), motion.lost()), (1.0, 0));
}

#[test]
fn the_field_is_the_motion_of_structures_and_the_volume_its_inverse() {
    let (grid, mesh) = (grid(), egg());
    let body = body(&grid);
    let moved: Vec<Point3> = mesh.positions.iter().map(bent).collect();
    let deformed: Vec<Point3> = moved.iter().map(|p| pose() * p).collect();
    let motion = body.motion(&deformed).unwrap();
    assert!((1.0..6.0).contains(&motion.surface_mm()[1]), "{:?}", motion.surface_mm());
    let carrier = Carrier::new(&mesh).unwrap();
    let carried = carrier.carry(&deformed).unwrap();
    let [nx, ny, nz] = grid.size();
    let field: Vec<Vec<f32>> =
        (0..3).map(|c| (0..nz).flat_map(|k| motion.field_slice(c, k)).collect()).collect();
    let source = volume(&grid);
    let found = warped(&motion, &source);
    let mut compared = 0;
    for (i, &inside) in body.inside.iter().enumerate() {
        let world = grid.world_from_voxel() * voxel(i, nx, ny);
        let lps = Point3::new(-world.x, -world.y, world.z);
        let along = |c: usize| f64::from(field[c][i]);
        let u = Vector3::new(along(0), along(1), along(2));
        if inside {
            // Steps of one voxel here: nothing is interpolated.
            let expected = carried.rigid().inverse() * carried.at(&lps) - lps;
            assert!((u - expected).norm() < 1e-5, "{u} {expected}");
        } else if !body.near[i] {
            assert_eq!(u, Vector3::zeros());
        }
        // Where a voxel goes, the warped volume has its value.
        let to = motion.at(&voxel(i, nx, ny));
        let corners = grid.corners(&to);
        if inside && corners.iter().all(|c| found.value(c.0) != -7.0) {
            let value: f64 = corners.iter().map(|c| c.1 * found.value(c.0)).sum();
            assert!((value - linear(&world)).abs() < 0.3, "{value} {}", linear(&world));
            compared += 1;
        }
    }
    assert!(compared > body.inside() / 2, "{compared}");
}

#[test]
fn labels_are_not_mixed() {
    let (grid, mesh) = (grid(), egg());
    let body = body(&grid);
    let labels = (0..grid.count()).map(|i| 3 + 4 * (i % 2) as u8).collect();
    let labels = VoxelVolume::new(grid, VoxelKind::U8, labels).unwrap();
    let moved: Vec<Point3> = mesh.positions.iter().map(bent).collect();
    let motion = body.motion(&moved).unwrap();
    let slice = motion.warped_slice(&labels, 0.0, Sampling::Nearest, 13).bytes;
    assert!(
        slice.iter().all(|v| [0, 3, 7].contains(v)) && slice.contains(&3) && slice.contains(&7)
    );
}

#[test]
fn a_registered_organ_goes_its_way_and_its_bending_is_in_the_field() {
    let (grid, mesh) = (grid(), egg());
    let way = Similarity::new(Vector3::new(-3.0, 8.0, 1.0), Vector3::new(0.9, 0.2, -0.5), 0.05);
    let placed: Vec<Point3> = mesh.positions.iter().map(|p| way * p).collect();
    // The template is another mesh: what the camera sees of the organ.
    let part = mesh.with_positions(placed.clone());
    let faces: Vec<usize> = (0..part.topology.faces.len())
        .filter(|&f| part.corners(f).iter().all(|p| (way.inverse() * *p).z > 12.0))
        .collect();
    let template = part.subset(&faces).0;
    let still = PlacedOrgan { mesh: mesh.clone(), template_from_mesh: way, vertices: placed };
    let body = VoxelBody::new(&grid, MeshAxes::Lps, &template, &still).unwrap();
    let seen: Vec<Point3> = template.positions.iter().map(|p| pose() * p).collect();
    let motion = body.motion(&seen).unwrap();
    assert!(motion.surface_mm()[1] < 1e-6);
    let at = motion.camera_from_world().transform_point(&Point3::new(-30.0, 20.0, 15.0));
    assert!((at - pose() * (way * Point3::new(30.0, -20.0, 15.0))).norm() < 1e-9);
    // Bent by the registration, at rest in the frame.
    let vertices = mesh.positions.iter().map(|p| way * bent(p)).collect();
    let body = VoxelBody::new(&grid, MeshAxes::Lps, &template, &PlacedOrgan { vertices, ..still })
        .unwrap();
    let motion = body.motion(&seen).unwrap();
    let largest = mesh.positions.iter().map(|p| (bent(p) - p).norm()).fold(0.0, f64::max);
    assert!((motion.surface_mm()[1] - largest).abs() < 1e-6);
    let from = grid.world_from_voxel().inverse() * Point3::new(-30.0, 20.0, 15.0 + 14.0);
    let to = grid.world_from_voxel() * motion.at(&from);
    let expected = bent(&Point3::new(30.0, -20.0, 29.0));
    assert!((Point3::new(-to.x, -to.y, to.z) - expected).norm() < 0.2, "{to} {expected}");
}

#[test]
fn surfaces_that_enclose_nothing_are_refused_with_what_helps() {
    let (grid, mesh) = (grid(), egg());
    let of = |mesh: &Mesh, axes| VoxelBody::new(&grid, axes, mesh, &PlacedOrgan::template(mesh));
    let error = of(&mesh, MeshAxes::Ras).unwrap_err();
    let VoxelError::Beside { turned: MeshAxes::Lps, others } = error else { panic!("{error}") };
    assert_eq!(others, body(&grid).inside());
    let open = shapes::hemisphere(3, 10.0);
    let error = of(&open, MeshAxes::Ras).unwrap_err();
    assert!(matches!(error, VoxelError::Open { edges } if edges > 10), "{error}");
    let fewer = PlacedOrgan { vertices: vec![Point3::origin()], ..PlacedOrgan::template(&mesh) };
    let error = VoxelBody::new(&grid, MeshAxes::Lps, &mesh, &fewer).unwrap_err();
    assert!(error.to_string().contains("1 vertices"), "{error}");
    assert!(matches!(body(&grid).motion(&[]), Err(VoxelError::Structure(_))));
}

/// The lattice of a fine volume has steps of several voxels.
#[test]
fn between_the_nodes_of_a_fine_volume_the_motion_is_off_by_less_than_a_hundredth() {
    let mesh = egg();
    let scale = Matrix4::new_nonuniform_scaling(&Vector3::new(-0.2, -0.2, 0.2));
    let shift = Matrix4::new_translation(&Vector3::new(-12.0, 40.0, -5.0));
    let map = Affine3::from_matrix_unchecked(shift * scale);
    let grid = VoxelGrid::new([180, 200, 200], map).unwrap();
    let body = body(&grid);
    assert!(body.lattice.count() < 600_000, "{}", body.lattice.count());
    let moved: Vec<Point3> = mesh.positions.iter().map(bent).collect();
    let motion = body.motion(&moved).unwrap();
    let carrier = Carrier::new(&mesh).unwrap();
    let carried = carrier.carry(&moved).unwrap();
    let mut worst: f64 = 0.0;
    for i in (0..grid.count()).step_by(997).filter(|&i| body.inside[i]) {
        let at = voxel(i, 180, 200);
        let world = map * at;
        let lps = Point3::new(-world.x, -world.y, world.z);
        let expected = carried.rigid().inverse() * carried.at(&lps);
        let found = map * motion.at(&at);
        worst = worst.max((Point3::new(-found.x, -found.y, found.z) - expected).norm());
    }
    // Largest displacement about 4 mm.
    assert!(worst < 0.01 * motion.surface_mm()[1], "{worst}");
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    let (grid, mesh) = (grid(), egg());
    let moved: Vec<Point3> = mesh.positions.iter().map(bent).collect();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let body = body(&grid);
            let motion = body.motion(&moved).unwrap();
            let slice = motion.warped_slice(&volume(&grid), 0.0, Sampling::Linear, 12).bytes;
            (slice, motion.field_slice(0, 12).iter().map(|v| v.to_bits()).collect::<Vec<_>>())
        })
    };
    assert_eq!(with(1), with(3));
}
