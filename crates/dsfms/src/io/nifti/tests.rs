use super::header::{DATATYPE, DIM, LENGTH, NiftiHeader, ROWS};
use super::*;
use crate::geometry::{Point3, Vector3};
use crate::voxels::{VoxelKind, VoxelVolume};
use flate2::{Compression, write::GzEncoder};
use std::io::Write;
use std::path::Path;

/// A header as another program writes it, with an sform of 2, 3 and 4 mm.
fn head(size: [i16; 3], code: i16, bits: i16) -> NiftiHeader {
    let mut header = NiftiHeader([0; LENGTH]);
    header.set(0, &348i32.to_le_bytes());
    [3, size[0], size[1], size[2], 1, 1, 1, 1]
        .iter()
        .enumerate()
        .for_each(|(i, &n)| header.set_short(40 + 2 * i, n));
    header.set_short(70, code);
    header.set_short(72, bits);
    [1.0, 2.0, 3.0, 4.0].iter().enumerate().for_each(|(i, &v)| header.set_float(76 + 4 * i, v));
    header.set_float(108, 352.0);
    header.set(123, &[2]);
    header.set_short(254, 1);
    let rows = [[-2.0, 0.0, 0.0, 90.0], [0.0, 3.0, 0.0, -120.0], [0.0, 0.0, 4.0, 10.0]];
    rows.iter().flatten().enumerate().for_each(|(i, &v)| header.set_float(280 + 4 * i, v));
    header.set(344, b"n+1\0");
    header
}

fn file(header: &NiftiHeader, data: &[u8]) -> Vec<u8> {
    [&header.0[..], &[0; 4], data].concat()
}

fn read_bytes(bytes: &[u8]) -> Result<NiftiFile, String> {
    read_nifti_from(bytes, Path::new("ct.nii")).map_err(|error| error.to_string())
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut zip = GzEncoder::new(Vec::new(), Compression::default());
    zip.write_all(bytes).unwrap();
    zip.finish().unwrap()
}

/// 2 x 1 x 2 voxels of 16 bits.
fn small() -> (NiftiHeader, Vec<u8>) {
    let data = [-1000i16, 7, 300, 40].iter().flat_map(|v| v.to_le_bytes()).collect();
    (head([2, 1, 2], 4, 16), data)
}

fn refused(bytes: &[u8], words: &[&str]) {
    let text = read_bytes(bytes).unwrap_err();
    assert!(text.starts_with("ct.nii: "), "{text}");
    words.iter().for_each(|word| assert!(text.contains(word), "{word}: {text}"));
}

#[test]
fn values_and_places_by_hand_in_either_byte_order_packed_or_not() {
    let (header, data) = small();
    let plain = file(&header, &data);
    let mut turned = header.clone();
    turned.turn();
    let large: Vec<u8> = data.chunks(2).flat_map(|b| [b[1], b[0]]).collect();
    for bytes in
        [plain.clone(), packed(&plain), file(&turned, &large), packed(&file(&turned, &large))]
    {
        let found = read_bytes(&bytes).unwrap();
        assert_eq!(found.volume.grid().size(), [2, 1, 2]);
        assert_eq!(
            (0..4).map(|i| found.volume.value(i)).collect::<Vec<_>>(),
            [-1000.0, 7.0, 300.0, 40.0]
        );
        assert_eq!((found.background(), found.is_labels()), (-1000.0, false));
        let at = found.volume.grid().world_from_voxel() * Point3::new(1.0, 0.0, 1.0);
        assert_eq!(at, Point3::new(88.0, -120.0, 14.0));
        assert_eq!(found.header, header);
    }
    // A negative scale turns small and large around.
    let mut inverse = header;
    inverse.set_float(112, -1.0);
    assert_eq!(read_bytes(&file(&inverse, &data)).unwrap().background(), 300.0);
}

#[test]
fn every_number_format() {
    let values: [(i16, i16, VoxelKind, Vec<u8>, f64); 8] = [
        (2, 8, VoxelKind::U8, vec![200], 200.0),
        (256, 8, VoxelKind::I8, vec![200], -56.0),
        (4, 16, VoxelKind::I16, (-5i16).to_le_bytes().into(), -5.0),
        (512, 16, VoxelKind::U16, 65_000u16.to_le_bytes().into(), 65_000.0),
        (8, 32, VoxelKind::I32, (-70_000i32).to_le_bytes().into(), -70_000.0),
        (768, 32, VoxelKind::U32, 4_000_000_000u32.to_le_bytes().into(), 4e9),
        (16, 32, VoxelKind::F32, 0.5f32.to_le_bytes().into(), 0.5),
        (64, 64, VoxelKind::F64, 0.1f64.to_le_bytes().into(), 0.1),
    ];
    for (code, bits, kind, data, value) in values {
        let found = read_bytes(&file(&head([1, 1, 1], code, bits), &data)).unwrap();
        assert_eq!((found.volume.kind(), found.volume.value(0)), (kind, value));
    }
}

#[test]
fn a_qform_turns_and_mirrors() {
    let (mut header, data) = small();
    header.set_short(254, 0);
    header.set_short(252, 1);
    // Half a turn about z, and the last axis mirrored.
    header.set_float(76, -1.0);
    header.set_float(264, 1.0);
    [5.0, 6.0, 7.0].iter().enumerate().for_each(|(i, &v)| header.set_float(268 + 4 * i, v));
    let map = *read_bytes(&file(&header, &data)).unwrap().volume.grid().world_from_voxel();
    assert_eq!(map * Point3::origin(), Point3::new(5.0, 6.0, 7.0));
    let moved = map * Vector3::new(1.0, 1.0, 1.0);
    assert!((moved - Vector3::new(-2.0, -3.0, -4.0)).norm() < 1e-6, "{moved}");
    // In metres.
    header.set(123, &[1]);
    let map = *read_bytes(&file(&header, &data)).unwrap().volume.grid().world_from_voxel();
    assert!((map * Point3::origin() - Point3::new(5000.0, 6000.0, 7000.0)).norm() < 1e-6);
}

#[test]
fn what_is_wrong_is_named_with_its_field() {
    let (header, data) = small();
    let with = |change: &dyn Fn(&mut NiftiHeader)| {
        let mut header = header.clone();
        change(&mut header);
        file(&header, &data)
    };
    refused(b"", &["0 bytes"]);
    refused(&header.0[..200], &["truncated", "348", "found 200"]);
    refused(&file(&header, &data[..5]), &["truncated", "8 bytes", "found 5"]);
    refused(&with(&|h| h.set(0, b"NRRD")), &["sizeof_hdr", "expected 348", "dcm2niix"]);
    refused(&with(&|h| h.set(0, &540i32.to_le_bytes())), &["NIfTI-2"]);
    refused(&with(&|h| h.set(344, b"ni1\0")), &["magic", "two files"]);
    refused(&with(&|h| h.set(344, &[0; 4])), &["magic", "Analyze"]);
    refused(&with(&|h| h.set_short(DIM, 2)), &["dim[0]", "found 2"]);
    refused(&with(&|h| h.set_short(DIM + 4, 0)), &["dim[2]", "found 0"]);
    refused(&with(&|h| h.set_short(DIM + 6, -3)), &["dim[3]", "found -3"]);
    let series = |h: &mut NiftiHeader| {
        h.set_short(DIM, 4);
        h.set_short(DIM + 8, 20);
    };
    refused(&with(&series), &["dim[4]", "found 20"]);
    let huge = |h: &mut NiftiHeader| (1..4).for_each(|c| h.set_short(DIM + 2 * c, 32767));
    refused(&with(&huge), &["dim", "2^29"]);
    let large = |h: &mut NiftiHeader| (1..4).for_each(|c| h.set_short(DIM + 2 * c, 800));
    let heavy = |h: &mut NiftiHeader| {
        large(h);
        h.set_short(DATATYPE, 16);
        h.set_short(72, 32);
    };
    refused(&with(&heavy), &["dim", "MiB"]);
    refused(&with(&|h| h.set_short(DATATYPE, 128)), &["datatype", "found 128"]);
    refused(&with(&|h| h.set_short(72, 8)), &["bitpix", "expected 16"]);
    refused(&with(&|h| h.set_float(ROWS, f32::NAN)), &["srow_x", "NaN"]);
    refused(&with(&|h| h.set_float(ROWS, 0.0)), &["srow", "singular"]);
    refused(&with(&|h| h.set_short(254, 0)), &["sform_code", "found 0 and 0"]);
    refused(&with(&|h| h.set(123, &[5])), &["xyzt_units", "found 5"]);
    refused(&with(&|h| h.set_float(108, 3.0)), &["vox_offset", "found 3"]);
    refused(&with(&|h| h.set_float(108, f32::INFINITY)), &["vox_offset"]);
    refused(&with(&|h| h.set_float(108, 4000.0)), &["truncated", "byte 4000"]);
    let mut qform = header.clone();
    [(252, 1), (254, 0)].iter().for_each(|&(at, v)| qform.set_short(at, v));
    qform.set_float(256, 1.2);
    refused(&file(&qform, &data), &["quatern_b", "at most 1"]);
}

#[test]
fn packed_data_that_is_damaged_or_endless_is_refused_within_bounds() {
    let (header, data) = small();
    let good = packed(&file(&header, &data));
    refused(&good[..good.len() / 2], &["cannot be read"]);
    let mut bad = good.clone();
    let checksum = bad.len() - 8;
    bad[checksum] ^= 1;
    refused(&bad, &["cannot be read"]);
    // 64 MiB of zeros in 64 KiB: read only as far as the header goes.
    let bomb = packed(&[file(&header, &data), vec![0; 64 << 20]].concat());
    assert!(bomb.len() < 1 << 17 && read_bytes(&bomb).is_ok());
    // 1 GiB stated, nothing there: no memory is set aside.
    let mut large = header;
    (1..4).for_each(|c| large.set_short(DIM + 2 * c, 800));
    refused(&packed(&file(&large, &data)), &["truncated", "found 8 bytes"]);
}

#[test]
fn a_volume_comes_back_and_a_field_is_as_itk_has_it() {
    let (header, data) = small();
    let folder = tempfile::tempdir().unwrap();
    let source = read_bytes(&file(&header, &data)).unwrap();
    let path = folder.path().join("warped.nii.gz");
    write_warped(&path, &source, |k| data[4 * k..4 * k + 4].into()).unwrap();
    assert_eq!(read_nifti(&path).unwrap().volume, source.volume);
    let path = folder.path().join("field.nii.gz");
    write_displacement(&path, &source, |c, k| vec![c as f32, 10.0 * k as f32]).unwrap();
    let mut bytes = Vec::new();
    let opened = std::fs::File::open(&path).unwrap();
    std::io::Read::read_to_end(&mut flate2::read::GzDecoder::new(opened), &mut bytes).unwrap();
    let field = NiftiHeader(std::array::from_fn(|i| bytes[i]));
    let dims: Vec<i16> = (0..8).map(|i| field.short(DIM + 2 * i)).collect();
    assert_eq!(dims, [5, 2, 1, 2, 1, 3, 1, 1]);
    assert_eq!((field.short(68), field.short(70), field.short(72)), (1007, 16, 32));
    assert_eq!((field.float(112), field.float(116), field.float(108)), (1.0, 0.0, 352.0));
    assert_eq!(&field.0[ROWS..ROWS + 48], &header.0[ROWS..ROWS + 48]);
    let values: Vec<f32> =
        bytes[352..].chunks(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    assert_eq!(values, [0., 0., 0., 10., 1., 0., 1., 10., 2., 0., 2., 10.]);
    // Not a volume of one value a voxel.
    assert!(read_nifti(&path).unwrap_err().to_string().contains("dim[5]"));
}

#[test]
fn a_folder_and_a_missing_file_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let text = read_nifti(folder.path()).unwrap_err().to_string();
    assert!(text.contains("not a regular file"), "{text}");
    let text = read_nifti(&folder.path().join("none.nii")).unwrap_err().to_string();
    assert!(text.contains("no such file"), "{text}");
}

#[test]
fn bytes_must_be_those_of_the_grid() {
    let (header, data) = small();
    let source = read_bytes(&file(&header, &data)).unwrap();
    let grid = source.volume.grid().clone();
    let error = VoxelVolume::new(grid, VoxelKind::F64, data).unwrap_err().to_string();
    assert!(error.contains("8 bytes") && error.contains("expected 32"), "{error}");
}
