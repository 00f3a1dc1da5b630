//! Where a volume lies: `sform`, else `qform`.

use super::header::{NiftiHeader, PIXDIM, Q_OFFSET, QFORM, QUATERNION, ROWS, SFORM, UNITS};
use crate::geometry::Vector3;
use nalgebra::{Affine3, Matrix3, Matrix4, Quaternion, UnitQuaternion};

/// How far the squares of `quatern_b` to `quatern_d` may sum beyond 1 by rounding.
const ROUNDED: f64 = 1e-3;

/// From voxels to mm, RAS; what is wrong otherwise.
pub(super) fn world_from_voxel(header: &NiftiHeader) -> Result<Affine3<f64>, String> {
    let unit = match header.0[UNITS] & 7 {
        0 | 2 => 1.0,
        1 => 1e3,
        3 => 1e-3,
        code => {
            return Err(format!(
                "header field xyzt_units: expected 0 or 2 (mm), 1 (m) or 3 (µm) in its three low bits, found {code}; \
                 export the volume again, in mm"
            ));
        }
    };
    let (sform, qform) = (header.short(SFORM), header.short(QFORM));
    let (field, matrix) = match (sform > 0, qform > 0) {
        (true, _) => ("srow_x, srow_y, srow_z", by_rows(header)),
        (false, true) => ("quatern_b to qoffset_z, pixdim", by_quaternion(header)?),
        (false, false) => {
            return Err(format!(
                "header fields sform_code and qform_code: expected one above 0, which says where the voxels lie, found \
                 {sform} and {qform}; export the volume again with its orientation"
            ));
        }
    };
    if !matrix.iter().all(|v| v.is_finite()) {
        return Err(format!(
            "header fields {field}: expected finite numbers, found NaN or infinity; export the volume again"
        ));
    }
    let mut scaled = matrix * unit;
    scaled[(3, 3)] = 1.0;
    Ok(Affine3::from_matrix_unchecked(scaled))
}

fn by_rows(header: &NiftiHeader) -> Matrix4<f64> {
    let rows: [[f64; 4]; 3] = [0, 1, 2].map(|r| header.floats(ROWS + 16 * r));
    Matrix4::from_fn(|r, c| if r < 3 { rows[r][c] } else { f64::from(u8::from(c == 3)) })
}

/// Rotation by a unit quaternion whose real part is not stored, sides of a voxel, and a last axis
/// that may be mirrored.
fn by_quaternion(header: &NiftiHeader) -> Result<Matrix4<f64>, String> {
    let [b, c, d] = header.floats(QUATERNION);
    let rest = 1.0 - (b * b + c * c + d * d);
    if rest < -ROUNDED {
        return Err(format!(
            "header fields quatern_b, quatern_c, quatern_d: expected squares that sum to at most 1, found {}; export the \
             volume again",
            1.0 - rest
        ));
    }
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(rest.max(0.0).sqrt(), b, c, d));
    let [factor, x, y, z] = header.floats(PIXDIM);
    let last = if factor < 0.0 { -z } else { z };
    let linear =
        turn.to_rotation_matrix().matrix() * Matrix3::from_diagonal(&Vector3::new(x, y, last));
    let mut matrix = linear.to_homogeneous();
    let offset: [f64; 3] = header.floats(Q_OFFSET);
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::from(offset));
    Ok(matrix)
}
