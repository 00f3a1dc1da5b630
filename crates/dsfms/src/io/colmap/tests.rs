use super::*;
use crate::camera::{CameraModel, Lens};
use crate::geometry::{Isometry, Point2, Point3, Vector3};

fn model() -> ColmapModel {
    let lenses = [
        Lens::Pinhole,
        Lens::BrownConrady { k: [-0.2, 0.1, 0.0], p: [1e-3, -2e-3] },
        Lens::BrownConrady { k: [-0.2, 0.1, 0.03], p: [1e-3, -2e-3] },
        Lens::KannalaBrandt { k: [0.1, 0.2, -0.3, 0.4] },
    ];
    let camera = |(id, lens): (usize, &Lens)| ColmapCamera {
        id: id as u32 + 1,
        camera: CameraModel {
            size: [640, 480],
            focal: [500.25, 510.0 / 3.0],
            centre: [319.5, 239.25],
            lens: *lens,
        },
    };
    let pose = Isometry::new(Vector3::new(0.1, -2.0, 1.0 / 3.0), Vector3::new(0.3, 0.2, -0.9));
    let image = |id: u32, points| ColmapImage {
        id,
        camera: 2,
        name: format!("left eye/frame {id}.png"),
        pose,
        points,
    };
    ColmapModel {
        cameras: lenses.iter().enumerate().map(camera).collect(),
        images: vec![
            image(3, vec![(Point2::new(1.5, 2.25), Some(7)), (Point2::new(9.0, 8.0), None)]),
            image(5, vec![(Point2::new(100.0, 20.5), Some(7))]),
            image(6, Vec::new()),
        ],
        points: vec![ColmapPoint {
            id: 7,
            position: Point3::new(0.1, 1.0 / 7.0, 50.0),
            rgb: [1, 2, 255],
            error_px: 0.37,
            track: vec![(3, 0), (5, 0)],
        }],
    }
}

#[test]
fn both_forms_come_back() {
    for format in [Format::Text, Format::Binary] {
        let dir = tempfile::tempdir().unwrap();
        write_model(dir.path(), &model(), format).unwrap();
        let back = read_model(dir.path()).unwrap();
        assert_eq!(back.cameras, model().cameras, "{format:?}");
        assert_eq!(back.points, model().points);
        for (a, b) in back.images.iter().zip(model().images) {
            assert_eq!((a.id, a.camera, &a.name, &a.points), (b.id, b.camera, &b.name, &b.points));
            // Reading normalises the quaternion.
            assert!((a.pose.to_homogeneous() - b.pose.to_homogeneous()).amax() < 1e-15);
        }
    }
}

#[test]
fn bytes_are_where_colmap_has_them() {
    let dir = tempfile::tempdir().unwrap();
    write_model(dir.path(), &model(), Format::Binary).unwrap();
    let cameras = std::fs::read(dir.path().join("cameras.bin")).unwrap();
    assert_eq!(cameras[..8], 4u64.to_le_bytes());
    assert_eq!(cameras[8..16], [1, 0, 0, 0, 1, 0, 0, 0], "id 1, PINHOLE");
    assert_eq!(cameras[16..24], 640u64.to_le_bytes());
    assert_eq!(cameras[48..56], 320f64.to_le_bytes(), "cx in COLMAP's convention");
    assert_eq!(cameras.len(), 8 + 4 * 24 + 8 * (4 + 8 + 12 + 8));
    let images = std::fs::read(dir.path().join("images.bin")).unwrap();
    assert_eq!(images[8..12], 3u32.to_le_bytes());
    let name = 8 + 4 + 56 + 4;
    assert_eq!(&images[name..name + 20], b"left eye/frame 3.png");
    assert_eq!(images[name + 21..name + 29], 2u64.to_le_bytes());
    assert_eq!(images[name + 29..name + 37], 2f64.to_le_bytes());
    let second = name + 29 + 24;
    assert_eq!(images[second + 16..second + 24], [255; 8], "no 3D point");
}

#[test]
fn damaged_files_are_named() {
    let dir = tempfile::tempdir().unwrap();
    write_model(dir.path(), &model(), Format::Binary).unwrap();
    for part in ["cameras", "images", "points3D"] {
        let path = dir.path().join(format!("{part}.bin"));
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 3]).unwrap();
        let message = read_model(dir.path()).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("truncated"), "{message}");
        std::fs::write(&path, [&whole[..], &[0]].concat()).unwrap();
        assert!(read_model(dir.path()).unwrap_err().to_string().contains("1 bytes follow"));
        std::fs::write(&path, [255; 40]).unwrap();
        assert!(read_model(dir.path()).unwrap_err().to_string().contains("do not fit"));
        std::fs::write(&path, whole).unwrap();
    }
    let mut wrong = model();
    wrong.points[0].track[1] = (5, 1);
    write_model(dir.path(), &wrong, Format::Binary).unwrap();
    assert!(read_model(dir.path()).unwrap_err().to_string().contains("point 1 of image 5"));
    let empty = tempfile::tempdir().unwrap();
    let message = read_model(empty.path()).unwrap_err().to_string();
    assert!(message.contains("images.bin or images.txt"), "{message}");
}
