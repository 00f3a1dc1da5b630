//! The folder of `register-ct`, by which a volume comes to the template.

use anyhow::Context;
use dsfms::geometry::Similarity;
use dsfms::guard;
use dsfms::io::mesh::{MeshUnit, read_mesh};
use dsfms::nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use dsfms::template::Template;
use dsfms::voxels::PlacedOrgan;
use serde_json::Value;
use std::path::Path;

/// The mesh as it was given to `register-ct`, in mm.
pub const ORIGINAL: &str = "ct_original.ply";

/// The mesh of the volume, and where it lies in the template.
pub fn read(folder: &Path, template: &Template) -> anyhow::Result<PlacedOrgan> {
    let path = folder.join("registration.json");
    let text = guard::read_text_at_most(&path, guard::MOST_JSON_BYTES).with_context(|| {
        format!("{}: expected the folder of `dsfms register-ct`", path.display())
    })?;
    let record: Value = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
    let Some(found) = record.get("found") else {
        anyhow::bail!(
            "{}: this registration was refused ({}); register the mesh again",
            path.display(),
            record.pointer("/reasons/0").and_then(Value::as_str).unwrap_or("no reason is stated")
        );
    };
    let template_from_mesh = found
        .get("template_from_ct")
        .and_then(|matrix| serde_json::from_value(matrix.clone()).ok())
        .and_then(|rows: [[f64; 4]; 4]| similarity(&rows))
        .with_context(|| {
            format!(
                "{}: found.template_from_ct: expected a similarity of 4 x 4 numbers",
                path.display()
            )
        })?;
    let original = folder.join(ORIGINAL);
    anyhow::ensure!(
        original.is_file(),
        "{} is missing (folders of earlier versions have none); run `dsfms register-ct` again",
        original.display()
    );
    let mesh = read_mesh(&original)?.in_unit(MeshUnit::Millimetre)?.mesh;
    let placed = read_mesh(&folder.join("ct.ply"))?.in_unit(template.unit.into())?.mesh;
    Ok(PlacedOrgan { mesh, template_from_mesh, vertices: placed.positions })
}

/// Of a matrix that is one, within rounding.
fn similarity(rows: &[[f64; 4]; 4]) -> Option<Similarity> {
    let linear = Matrix3::from_fn(|r, c| rows[r][c]);
    let scale = linear.determinant().cbrt();
    let turn = linear / scale;
    let is_turn = (turn.transpose() * turn - Matrix3::identity()).amax() < 1e-6;
    let shift = Vector3::from_fn(|r, _| rows[r][3]);
    let finite = scale.is_finite() && shift.iter().all(|v| v.is_finite());
    (scale > 0.0 && is_turn && finite && rows[3] == [0.0, 0.0, 0.0, 1.0]).then(|| {
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
        Similarity::from_parts(Translation3::from(shift), turn, scale)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_registration_of_more_than_its_bound_is_not_parsed() {
        let folder = tempfile::tempdir().unwrap();
        let file = std::fs::File::create(folder.path().join("registration.json")).unwrap();
        file.set_len(guard::MOST_JSON_BYTES + 1).unwrap();
        let template = dsfms::synth::Case::example(1).template;
        let error = format!("{:#}", read(folder.path(), &template).err().unwrap());
        assert!(error.contains("registration.json") && error.contains("32 MiB"), "{error}");
    }

    #[test]
    fn a_matrix_is_a_similarity_or_refused() {
        let way = Similarity::new(Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.3, 2.0, -0.1), 0.04);
        let m = way.to_homogeneous();
        let rows: [[f64; 4]; 4] = std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]));
        let back = similarity(&rows).unwrap();
        assert!((back.to_homogeneous() - m).amax() < 1e-12);
        let mut sheared = rows;
        sheared[0][1] += 0.01;
        let mut mirrored = rows;
        (0..3).for_each(|r| mirrored[r][0] *= -1.0);
        for wrong in [sheared, mirrored, [[0.0; 4]; 4], [[f64::NAN; 4]; 4]] {
            assert!(similarity(&wrong).is_none(), "{wrong:?}");
        }
    }
}
