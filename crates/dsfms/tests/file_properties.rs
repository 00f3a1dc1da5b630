//! Every reader after every writer, on drawn content: what was written comes back, number by
//! number. OFF, legacy VTK, `poses.json` and masks have no writer in the library; the files are
//! written here as other programs write them.

use dsfms::camera::{CameraModel, Lens};
use dsfms::geometry::{Isometry, Point2, Point3, Vector3};
use dsfms::image::{Frame, ToneCurve};
use dsfms::io::camera::{CameraFile, read_camera, write_camera};
use dsfms::io::colmap::{
    ColmapCamera, ColmapImage, ColmapModel, ColmapPoint, Format, read_model, write_model,
};
use dsfms::io::igtl::{Head, ImagePlacement, image as image_message, picture, read};
use dsfms::io::masks::read_mask;
use dsfms::io::matches::{read_matches, write_matches};
use dsfms::io::mesh::{MeshUnit, read_mesh};
use dsfms::io::nifti::{NiftiFile, read_nifti, write_warped};
use dsfms::io::obj::{ObjExtras, write_obj};
use dsfms::io::ply::{PlyExtras, Precision, write_ply};
use dsfms::io::poses::{PoseList, read_poses};
use dsfms::io::stl::write_stl;
use dsfms::io::vertex_truth::{VertexTruth, read_vertex_truth, write_vertex_truth};
use dsfms::io::vtk::{VtkExtras, write_vtp};
use dsfms::light::{LightModel, PointLight, RingLight, Spot};
use dsfms::synth::{Case, patch};
use dsfms::template::{Features, Template};
use dsfms::track::shapes::{ShapeFile, read_shapes};
use dsfms::voxels::{VoxelGrid, VoxelKind, VoxelVolume};
use dsfms::{LengthUnit, Match, Mesh, read_template, write_template};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::fmt::Write as _;
use std::path::Path;

/// The same draws in every run, without files of failures: the message holds the input.
fn config(cases: u32) -> ProptestConfig {
    let rng_seed = RngSeed::Fixed(0x7E57);
    ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() }
}

/// A number of any sign and of 10⁻⁶ to 10⁶ in size, or 0.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        1 => Just(0.0),
        8 => (-6.0..6.0f64, any::<bool>())
            .prop_map(|(e, minus)| if minus { -10f64.powf(e) } else { 10f64.powf(e) }),
    ]
}

/// A surface of drawn size, place and vertex order, one of its vertices in no face.
#[derive(Clone, Debug)]
struct Surface {
    mesh: Mesh,
    unit: LengthUnit,
}

fn surface() -> impl Strategy<Value = Surface> {
    let order = (16usize..60).prop_flat_map(|n| {
        let order: Vec<usize> = (0..200).collect();
        (Just(n), Just(order).prop_shuffle())
    });
    (order, any::<u64>(), -3.0..4.0f64, prop::array::uniform3(number()), any::<bool>()).prop_map(
        |((n, order), seed, size, shift, metric)| {
            let mesh = patch(n, seed).mesh;
            let count = mesh.positions.len();
            let mut ranks: Vec<usize> = (0..count).collect();
            ranks.sort_by_key(|&v| order[v]);
            // A shift that leaves the digits of the shape in 32 bits.
            let size = 10f64.powf(size);
            let shift = Vector3::from(shift.map(|s| s.clamp(-10.0 * size, 10.0 * size)));
            let single = |p: Point3| p.coords.map(|x| f64::from(x as f32)).into();
            let mut positions = vec![single(Point3::from(shift)); count + 1];
            for (old, &new) in ranks.iter().enumerate() {
                positions[new] = single(mesh.positions[old] * size + shift);
            }
            let faces: Vec<_> =
                mesh.topology.faces.iter().map(|f| f.map(|v| ranks[v as usize] as u32)).collect();
            let unit = if metric { LengthUnit::Millimetre } else { LengthUnit::TemplateUnit };
            Surface { mesh: Mesh::new(positions, faces).unwrap(), unit }
        },
    )
}

/// As other programs write them; `{}` of a float is its shortest text.
fn off(s: &Surface) -> String {
    let (p, faces) = (&s.mesh.positions, &s.mesh.topology.faces);
    let mut text = format!("OFF\n# units {}\n{} {} 0\n", s.unit.label(), p.len(), faces.len());
    p.iter().for_each(|p| writeln!(text, "{} {} {}", p.x, p.y, p.z).unwrap());
    faces.iter().for_each(|f| writeln!(text, "3 {} {} {}", f[0], f[1], f[2]).unwrap());
    text
}

fn legacy(s: &Surface, binary: bool) -> Vec<u8> {
    let (p, faces) = (&s.mesh.positions, &s.mesh.topology.faces);
    let kind = if binary { "BINARY" } else { "ASCII" };
    let head = format!("# vtk DataFile Version 3.0\norgan, units {}\n{kind}\n", s.unit.label());
    let mut file = format!("{head}DATASET POLYDATA\nPOINTS {} double\n", p.len()).into_bytes();
    for c in p.iter().flat_map(|p| [p.x, p.y, p.z]) {
        match binary {
            true => file.extend(c.to_be_bytes()),
            false => file.extend(format!("{c} ").bytes()),
        }
    }
    file.extend(format!("\nPOLYGONS {} {}\n", faces.len(), 4 * faces.len()).bytes());
    for c in faces.iter().flat_map(|f| [3, f[0], f[1], f[2]]) {
        match binary {
            true => file.extend(c.to_be_bytes()),
            false => file.extend(format!("{c} ").bytes()),
        }
    }
    file.push(b'\n');
    file
}

fn write_as(path: &Path, name: &str, s: &Surface) {
    let (mesh, unit) = (&s.mesh, s.unit);
    let double = PlyExtras { precision: Precision::Double, ..Default::default() };
    let (topology, positions) = (&mesh.topology, &mesh.positions);
    match name {
        "a.ply" => write_ply(path, topology, positions, unit, &PlyExtras::default()).unwrap(),
        "double.ply" => write_ply(path, topology, positions, unit, &double).unwrap(),
        "a.obj" => write_obj(path, mesh, unit, &ObjExtras::default()).unwrap(),
        "a.vtp" => write_vtp(path, topology, positions, unit, &VtkExtras::default()).unwrap(),
        "a.off" => std::fs::write(path, off(s)).unwrap(),
        "text.vtk" => std::fs::write(path, legacy(s, false)).unwrap(),
        "binary.vtk" => std::fs::write(path, legacy(s, true)).unwrap(),
        other => panic!("{other}"),
    }
}

fn isometry() -> impl Strategy<Value = Isometry> {
    (prop::array::uniform3(number()), prop::array::uniform3(-3.0..3.0f64))
        .prop_map(|(t, r)| Isometry::new(Vector3::from(t), Vector3::from(r)))
}

fn camera() -> impl Strategy<Value = CameraModel> {
    let c = -0.9..0.9f64;
    let lens = prop_oneof![
        Just(Lens::Pinhole),
        (prop::array::uniform3(c.clone()), prop::array::uniform2(-0.1..0.1f64), 0.01..0.9f64)
            .prop_map(|(mut k, p, first)| {
                // All zeros are a pinhole.
                k[0] = first;
                Lens::BrownConrady { k, p }
            }),
        prop::array::uniform4(c.clone()).prop_map(|k| Lens::KannalaBrandt { k }),
        (prop::array::uniform6(c), prop::array::uniform2(-0.1..0.1f64), 0.01..0.9f64).prop_map(
            |(mut k, p, last)| {
                // Without a denominator it is Brown-Conrady.
                k[5] = last;
                Lens::Rational { k, p }
            }
        ),
    ];
    let size = prop::array::uniform2(1usize..4000);
    (size, prop::array::uniform2(1.0..1e5f64), prop::array::uniform2(-0.9..1.9f64), lens).prop_map(
        |(size, focal, centre, lens)| {
            let centre = [centre[0] * size[0] as f64, centre[1] * size[1] as f64];
            CameraModel { size, focal, centre, lens }
        },
    )
}

fn camera_file() -> impl Strategy<Value = CameraFile> {
    let tone = prop_oneof![
        Just(None),
        Just(Some(ToneCurve::Linear)),
        Just(Some(ToneCurve::Srgb)),
        (0.5..3.0f64).prop_map(|g| Some(ToneCurve::Gamma(g))),
    ];
    let spot = prop_oneof![
        Just(Spot::Isotropic),
        (0.0..40.0f64, 1.0..100.0f64)
            .prop_map(|(inner_deg, more)| Spot::Linear { inner_deg, outer_deg: inner_deg + more }),
        (0.1..9.0f64).prop_map(|exponent| Spot::CosinePower { exponent }),
    ];
    let places = prop::collection::vec(prop::array::uniform3(number()), 1..4);
    let point =
        (places, 0.1..1e3f64, spot.clone()).prop_map(|(positions, reference_distance, spot)| {
            let positions = positions.into_iter().map(|[x, y, z]| Point3::new(x, y, z)).collect();
            Some(LightModel::Point(PointLight { positions, reference_distance, spot }))
        });
    let ring = (0.0..50.0f64, prop::array::uniform3(number()), 0.1..1e3f64, spot).prop_map(
        |(radius, centre, reference_distance, spot)| {
            Some(RingLight { radius, centre: centre.into(), reference_distance, spot }.into())
        },
    );
    let light = prop_oneof![Just(None), Just(Some(LightModel::Collinear)), point, ring];
    (camera(), tone, light, prop::option::of(-2.0..0.0f64)).prop_map(
        |(camera, tone, light, vignetting)| CameraFile { camera, tone, light, vignetting },
    )
}

/// Two corners of a face that sum to at most 1.
fn barycentric() -> impl Strategy<Value = [f64; 3]> {
    (0.0..1.0f64, 0.0..1.0f64).prop_map(|(a, b)| {
        let second = b * (1.0 - a);
        [a, second, 1.0 - a - second]
    })
}

fn matches() -> impl Strategy<Value = Vec<Match>> {
    let one = (0u32..100, barycentric(), -300.0..900.0f64, -200.0..700.0f64);
    let one = one.prop_map(|(face, barycentric, x, y)| Match {
        face,
        barycentric,
        pixel: Point2::new(x, y),
    });
    prop::collection::vec(one, 1..40)
}

/// Pixels with the number of their point.
type Sighted = Vec<([f64; 2], usize)>;

fn model() -> impl Strategy<Value = ColmapModel> {
    let points = prop::collection::vec((prop::array::uniform2(number()), 0usize..5), 0..6);
    let images =
        prop::collection::vec(("[a-z]{1,8}/[a-z0-9_]{1,8}\\.png", isometry(), points), 1..5);
    let place = (prop::array::uniform3(number()), any::<[u8; 3]>(), 0.0..9.0f64);
    (camera(), images, prop::collection::vec(place, 5)).prop_map(|(camera, images, places)| {
        let cameras = vec![ColmapCamera { id: 7, camera }];
        let mut tracks = vec![Vec::new(); places.len()];
        let image = |(i, (name, pose, points)): (usize, (String, Isometry, Sighted))| {
            let id = 3 + i as u32;
            let points = points.into_iter().enumerate().map(|(k, ([x, y], point))| {
                tracks[point].push((id, k as u32));
                (Point2::new(x, y), Some(11 + point as u64))
            });
            ColmapImage { id, camera: 7, name, pose, points: points.collect() }
        };
        let images = images.into_iter().enumerate().map(image).collect();
        let points = places.into_iter().zip(tracks).enumerate();
        let points = points.map(|(k, (([x, y, z], rgb, error_px), track))| ColmapPoint {
            id: 11 + k as u64,
            position: Point3::new(x, y, z),
            rgb,
            error_px,
            track,
        });
        ColmapModel { cameras, images, points: points.collect() }
    })
}

fn same_pose(a: &Isometry, b: &Isometry) -> bool {
    let scale = 1.0 + a.translation.vector.norm();
    (a.to_homogeneous() - b.to_homogeneous()).amax() < 1e-12 * scale
}

proptest! {
    #![proptest_config(config(24))]

    #[test]
    fn meshes_come_back_with_order_faces_and_unit(s in surface()) {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.ply", "double.ply", "a.obj", "a.vtp", "a.off", "text.vtk", "binary.vtk"] {
            let path = folder.path().join(name);
            write_as(&path, name, &s);
            let file = read_mesh(&path).unwrap();
            let single = |mesh: &Mesh| -> Vec<[f32; 3]> {
                mesh.positions.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect()
            };
            prop_assert_eq!(single(&file.mesh), single(&s.mesh), "{}", name);
            prop_assert_eq!(&file.mesh.topology.faces, &s.mesh.topology.faces, "{}", name);
            prop_assert_eq!(file.unit, Some(MeshUnit::from(s.unit)), "{}", name);
        }
        let path = folder.path().join("a.stl");
        write_stl(&path, &s.mesh, s.unit).unwrap();
        let file = read_mesh(&path).unwrap();
        prop_assert_eq!(file.mesh.topology.faces.len(), s.mesh.topology.faces.len());
        for f in 0..s.mesh.topology.faces.len() {
            prop_assert_eq!(file.mesh.corners(f), s.mesh.corners(f), "face {}", f);
        }
        prop_assert_eq!(file.unit, Some(MeshUnit::from(s.unit)));
    }

    #[test]
    fn cameras_come_back(file in camera_file()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.json");
        write_camera(&path, &file).unwrap();
        let found = read_camera(&path).unwrap();
        // An exponent below one, which in files is that of the encoding, comes back as its table.
        let light = |file: &CameraFile| file.tone.as_ref().map(ToneCurve::table);
        prop_assert_eq!(light(&found), light(&file));
        let tone = match &file.tone {
            Some(ToneCurve::Gamma(g)) if *g < 1.0 => found.tone.clone(),
            tone => tone.clone(),
        };
        prop_assert_eq!(found, CameraFile { tone, ..file });
    }

    #[test]
    fn matches_come_back(matches in matches()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("matches.csv");
        write_matches(&path, &matches).unwrap();
        prop_assert_eq!(read_matches(&path, 100, [640, 480]).unwrap(), matches);
    }

    #[test]
    fn models_of_colmap_come_back(model in model()) {
        let folder = tempfile::tempdir().unwrap();
        for (name, format) in [("text", Format::Text), ("binary", Format::Binary)] {
            let path = folder.path().join(name);
            write_model(&path, &model, format).unwrap();
            let found = read_model(&path).unwrap();
            prop_assert_eq!(found.images.len(), model.images.len());
            // Half a pixel is added on the way out and taken off on the way in.
            let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + a.abs());
            let (a, b) = (&model.cameras[0].camera, &found.cameras[0].camera);
            prop_assert_eq!((a.size, a.focal, a.lens), (b.size, b.focal, b.lens), "{}", name);
            prop_assert!((0..2).all(|k| near(a.centre[k], b.centre[k])), "{:?}", b.centre);
            for (a, b) in model.images.iter().zip(&found.images) {
                prop_assert_eq!((a.id, a.camera, &a.name), (b.id, b.camera, &b.name));
                prop_assert!(same_pose(&a.pose, &b.pose), "{}: {:?} {:?}", name, a.pose, b.pose);
                prop_assert_eq!(a.points.len(), b.points.len());
                for (a, b) in a.points.iter().zip(&b.points) {
                    prop_assert!(near(a.0.x, b.0.x) && near(a.0.y, b.0.y) && a.1 == b.1);
                }
            }
            prop_assert_eq!(&found.points, &model.points, "{}", name);
        }
    }

    #[test]
    fn poses_come_back(poses in prop::collection::vec(isometry(), 1..6)) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.json");
        let entry = |(i, pose): (usize, &Isometry)| {
            let r = pose.rotation.to_rotation_matrix();
            let rows: Vec<Vec<f64>> =
                (0..3).map(|k| r.matrix().row(k).iter().copied().collect()).collect();
            let t: Vec<f64> = pose.translation.vector.iter().copied().collect();
            serde_json::json!({ "image": format!("f_{i}.png"), "R": rows, "t": t })
        };
        let list: Vec<_> = poses.iter().enumerate().map(entry).collect();
        std::fs::write(&path, serde_json::Value::from(list).to_string()).unwrap();
        let found = read_poses(&path, PoseList::Exploration).unwrap();
        prop_assert_eq!(found.len(), poses.len());
        for (i, (a, b)) in poses.iter().zip(&found).enumerate() {
            prop_assert_eq!(&b.name, &format!("f_{i}.png"));
            prop_assert!(same_pose(a, &b.camera_from_world), "{:?} {:?}", a, b);
        }
    }

    #[test]
    fn masks_come_back(
        (size, data) in (1usize..40, 1usize..40)
            .prop_flat_map(|(w, h)| (Just([w, h]), prop::collection::vec(any::<bool>(), w * h))),
        tiff in any::<bool>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(if tiff { "mask.tif" } else { "mask.png" });
        let value = |x: u32, y: u32| data[y as usize * size[0] + x as usize];
        image::GrayImage::from_fn(size[0] as u32, size[1] as u32, |x, y| {
            image::Luma([if value(x, y) { 255 } else { 0 }])
        })
        .save(&path)
        .unwrap();
        let mask = read_mask(&path).unwrap();
        prop_assert_eq!(mask.size, size);
        prop_assert_eq!(mask.data, data);
    }

    #[test]
    fn shapes_and_truths_come_back(
        frames in prop::collection::vec(prop::option::of(prop::collection::vec(prop::array::uniform3(number()), 5)), 0..6),
        visible in prop::collection::vec(any::<bool>(), 1..20),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("vertices.npz");
        let mut file = ShapeFile::create(&path, 5).unwrap();
        let points = |s: &Vec<[f64; 3]>| -> Vec<Point3> {
            s.iter().map(|p| Point3::from(p.map(|c| f64::from(c as f32)))).collect()
        };
        for frame in &frames {
            let shape = frame.as_ref().map(&points);
            file.push(shape.as_deref(), &[true; 5], if shape.is_some() { 0 } else { 2 }).unwrap();
        }
        file.finish().unwrap();
        let (shapes, status) = read_shapes(&path).unwrap();
        prop_assert_eq!(shapes.len(), frames.len());
        for ((frame, shape), status) in frames.iter().zip(&shapes).zip(status) {
            match frame {
                Some(frame) => prop_assert_eq!(&points(frame), shape),
                None => prop_assert!(shape.iter().flat_map(|p| p.iter()).all(|c| c.is_nan())),
            }
            prop_assert_eq!(status, if frame.is_some() { 0 } else { 2 });
        }
        let path = folder.path().join("a_vertices.npz");
        let displacement = (0..visible.len()).map(|k| f64::from(0.3 * k as f32)).collect();
        let truth = VertexTruth { visible, displacement };
        write_vertex_truth(&path, &truth).unwrap();
        prop_assert_eq!(read_vertex_truth(&path).unwrap(), truth);
    }

    #[test]
    fn pictures_of_openigtlink_come_back(
        (size, rgb) in (1usize..20, 2usize..20).prop_flat_map(|(w, h)| {
            // A side of one pixel is left out by senders, and a picture needs two.
            (Just([w + 1, h]), prop::collection::vec(any::<[u8; 3]>(), (w + 1) * h))
        }),
        device in "[A-Za-z]{1,20}",
    ) {
        let frame = Frame { name: String::new(), size, rgb };
        let plane = ImagePlacement { axes: [[1.0, 0.0, 0.0]; 3], centre: [0.0; 3] };
        let bytes = image_message(Head { device: &device, time: None }, &frame, &plane);
        let found = read(&mut bytes.as_slice(), |_| true).unwrap().unwrap();
        prop_assert_eq!(&found.header.device, &device);
        let (size, rgb) = picture(&found.content).unwrap();
        prop_assert_eq!((size, rgb), (frame.size, frame.rgb));
    }
}

/// A volume of any kind and place; its map holds numbers of single precision.
fn volume() -> impl Strategy<Value = VoxelVolume> {
    use VoxelKind::{F32, F64, I8, I16, I32, U8, U16, U32};
    let kind = prop::sample::select(vec![U8, I8, U16, I16, U32, I32, F32, F64]);
    let size = prop::array::uniform3(1usize..7);
    let turn = prop::array::uniform3(-3.0..3.0f64);
    let sides = prop::array::uniform3(0.1..9.0f64);
    (kind, size, turn, sides, prop::array::uniform3(-900.0..900.0f64)).prop_flat_map(
        |(kind, size, turn, sides, shift)| {
            let turn = Isometry::new(Vector3::from(shift), Vector3::from(turn)).to_homogeneous();
            let map = turn * dsfms::nalgebra::Matrix4::new_nonuniform_scaling(&sides.into());
            let map = map.map(|v| f64::from(v as f32));
            let map = dsfms::nalgebra::Affine3::from_matrix_unchecked(map);
            let grid = VoxelGrid::new(size, map).unwrap();
            let bytes = prop::collection::vec(any::<u8>(), grid.count() * kind.bytes());
            bytes.prop_map(move |bytes| VoxelVolume::new(grid.clone(), kind, bytes).unwrap())
        },
    )
}

proptest! {
    #![proptest_config(config(24))]

    #[test]
    fn volumes_come_back(volume in volume()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.nii.gz");
        let file = NiftiFile::new(volume);
        let slice = file.volume.bytes().len() / file.volume.grid().size()[2];
        write_warped(&path, &file, |k| file.volume.bytes()[k * slice..][..slice].to_vec()).unwrap();
        let found = read_nifti(&path).unwrap();
        prop_assert_eq!(&found.volume, &file.volume);
        // And once more with the header that was read.
        write_warped(&path, &found, |k| found.volume.bytes()[k * slice..][..slice].to_vec()).unwrap();
        prop_assert_eq!(read_nifti(&path).unwrap(), found);
    }
}

proptest! {
    #![proptest_config(config(6))]

    #[test]
    fn templates_come_back(
        s in surface(),
        seed in any::<u64>(),
        camera in prop::option::of(camera()),
        features in prop::collection::vec((0u32..20, barycentric()), 0..9),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("organ.template");
        let albedo = patch(16, seed).albedo;
        let faces = s.mesh.topology.faces.len();
        let albedo = dsfms::template::SurfaceTexels {
            resolution: vec![1; faces],
            offset: (0..=faces as u32).collect(),
            value: albedo.value.iter().copied().cycle().take(faces).collect(),
            spread: vec![0.25; faces],
            views: (0..faces).map(|f| (f % 5) as u16).collect(),
        };
        let features = Features {
            descriptors: features.iter().map(|f| [f.0 as u8; 128]).collect(),
            faces: features.iter().map(|f| f.0).collect(),
            barycentrics: features.iter().map(|f| f.1).collect(),
        };
        let template = Template {
            unit: s.unit,
            mesh: s.mesh,
            flattening: None,
            albedo: Some(albedo),
            features: Some(features),
            camera,
            ..Case::example(1).template
        };
        write_template(&path, &template).unwrap();
        let found = read_template(&path).unwrap();
        prop_assert_eq!(found.unit, template.unit);
        prop_assert_eq!(&found.mesh.positions, &template.mesh.positions);
        prop_assert_eq!(&found.mesh.topology, &template.mesh.topology);
        prop_assert_eq!(&found.albedo, &template.albedo);
        prop_assert_eq!(&found.features, &template.features);
        prop_assert_eq!(&found.camera, &template.camera);
        prop_assert_eq!((&found.tone, &found.light), (&template.tone, &template.light));
    }
}
