//! Wavefront OBJ. Our own small reader, because the vertex order of the file must survive even
//! where texture indices differ from vertex indices.

use super::atomic::{WriteError, write_atomic};
use super::raw_mesh::{FormatError, RawMesh, fan, polygon_warning};
use crate::geometry::{Point2, Point3};
use crate::mesh::Mesh;
use std::collections::BTreeMap;
use std::path::Path;

/// Lines of an OBJ file that are understood, gathered.
#[derive(Default)]
struct ObjReader {
    mesh: RawMesh,
    texture: Vec<Point2>,
    uv: Vec<[Point2; 3]>,
    without_uv: usize,
    polygons: usize,
}

pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, FormatError> {
    let text = String::from_utf8_lossy(bytes);
    let mut reader = ObjReader::default();
    for (number, line) in joined_lines(&text) {
        reader
            .line(&line)
            .map_err(|reason| FormatError::Malformed(format!("line {number}: {reason}")))?;
    }
    Ok(reader.finish())
}

/// Lines with their 1-based number; a trailing backslash continues on the next line.
fn joined_lines(text: &str) -> Vec<(usize, String)> {
    let mut lines: Vec<(usize, String)> = Vec::new();
    let mut open = false;
    for (k, line) in text.lines().enumerate() {
        let (body, continues) = match line.trim_end().strip_suffix('\\') {
            Some(body) => (body, true),
            None => (line, false),
        };
        match lines.last_mut().filter(|_| open) {
            Some((_, last)) => {
                last.push(' ');
                last.push_str(body);
            }
            None => lines.push((k + 1, body.to_string())),
        }
        open = continues;
    }
    lines
}

impl ObjReader {
    fn line(&mut self, line: &str) -> Result<(), String> {
        if let Some(comment) = line.trim_start().strip_prefix('#') {
            self.mesh.state_unit(comment);
            return Ok(());
        }
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let [x, y, z] = numbers(words)?;
                self.mesh.positions.push(Point3::new(x, y, z));
            }
            Some("vt") => {
                let [u, v] = numbers(words)?;
                self.texture.push(Point2::new(u, v));
            }
            Some("f") => self.face(words)?,
            _ => {} // normals, groups, materials: nothing a surface needs
        }
        Ok(())
    }

    fn face<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Result<(), String> {
        let (mut corners, mut uv) = (Vec::new(), Vec::new());
        for word in words {
            let mut parts = word.split('/');
            let vertex = parts.next().unwrap_or_default();
            corners.push(index(vertex, self.mesh.positions.len(), "vertex")?);
            if let Some(t) = parts.next().filter(|t| !t.is_empty()) {
                let t = index(t, self.texture.len(), "texture coordinate")? as usize;
                let found = self.texture.get(t).ok_or_else(|| {
                    format!(
                        "texture coordinate {} of {} before this line",
                        t + 1,
                        self.texture.len()
                    )
                })?;
                uv.push(*found);
            }
        }
        if corners.len() < 3 {
            return Err(format!("a face needs at least 3 corners, found {}", corners.len()));
        }
        self.polygons += usize::from(corners.len() > 3);
        for triangle in fan(&corners) {
            self.mesh.faces.push(triangle.map(|k| corners[k]));
            if uv.len() == corners.len() {
                self.uv.push(triangle.map(|k| uv[k]));
            } else {
                self.without_uv += 1;
            }
        }
        Ok(())
    }

    fn finish(mut self) -> RawMesh {
        if self.polygons > 0 {
            self.mesh.warnings.push(polygon_warning(self.polygons));
        }
        if self.without_uv == 0 {
            self.mesh.uv = Some(self.uv).filter(|uv| !uv.is_empty());
        } else if !self.uv.is_empty() {
            self.mesh.warnings.push(format!(
                "{} of {} faces have no texture coordinates; all are left out",
                self.without_uv,
                self.mesh.faces.len()
            ));
        }
        self.mesh
    }
}

fn numbers<'a, const N: usize>(words: impl Iterator<Item = &'a str>) -> Result<[f64; N], String> {
    let mut values = [0.0; N];
    let mut found = 0;
    for (value, word) in values.iter_mut().zip(words) {
        *value = word.parse().map_err(|_| format!("expected a number, found '{word}'"))?;
        found += 1;
    }
    if found == N { Ok(values) } else { Err(format!("expected {N} numbers, found {found}")) }
}

/// 0-based index; OBJ counts from 1, and negative numbers from the end of what was read so far.
fn index(word: &str, count: usize, what: &str) -> Result<u32, String> {
    let n: i64 =
        word.parse().map_err(|_| format!("expected the number of a {what}, found '{word}'"))?;
    let index = if n < 0 { count as i64 + n } else { n - 1 };
    u32::try_from(index)
        .map_err(|_| format!("{what} {n} does not exist (OBJ counts from 1; {count} read so far)"))
}

/// What goes into an OBJ besides the surface; everything optional.
#[derive(Clone, Copy, Debug, Default)]
pub struct ObjExtras<'a> {
    /// UV per face corner, v upwards.
    pub uv: Option<&'a [[Point2; 3]]>,
    /// Name of a `.mtl` file beside this one, as [`write_mtl`] writes it.
    pub material: Option<&'a str>,
}

/// Name of the one material of a `.mtl`.
const MATERIAL: &str = "organ";

/// Write an OBJ with the mesh's vertex and face order, `# units …` in its first line. Texture
/// coordinate `i` is that of vertex `i`, so that programs that number vertices by pairs keep their
/// order; those that a vertex has besides, at a seam, stand behind.
///
/// # Errors
/// A file that cannot be written.
pub fn write_obj(
    path: &Path,
    mesh: &Mesh,
    unit: crate::template::LengthUnit,
    extras: &ObjExtras,
) -> Result<(), WriteError> {
    let texture = extras.uv.map(|uv| distinct(mesh, uv));
    write_atomic(path, |w| {
        writeln!(w, "# units {}", unit.label())?;
        if let Some(material) = extras.material {
            writeln!(w, "mtllib {material}\nusemtl {MATERIAL}")?;
        }
        for p in &mesh.positions {
            writeln!(w, "v {} {} {}", p.x as f32, p.y as f32, p.z as f32)?;
        }
        for [u, v] in texture.iter().flat_map(|(list, _)| list) {
            writeln!(w, "vt {u} {v}")?;
        }
        for (f, face) in mesh.topology.faces.iter().enumerate() {
            let [a, b, c] = face.map(|v| v + 1);
            match &texture {
                Some((_, corners)) => {
                    let [r, s, t] = corners[f].map(|k| k + 1);
                    writeln!(w, "f {a}/{r} {b}/{s} {c}/{t}")?;
                }
                None => writeln!(w, "f {a} {b} {c}")?,
            }
        }
        Ok(())
    })
}

/// Texture coordinates, those of the vertices first, and which of them every face corner has.
fn distinct(mesh: &Mesh, uv: &[[Point2; 3]]) -> (Vec<[f32; 2]>, Vec<[usize; 3]>) {
    let single = |p: &Point2| [p.x as f32, p.y as f32];
    let mut own: Vec<Option<[f32; 2]>> = vec![None; mesh.positions.len()];
    let mut further = Vec::new();
    let mut known = BTreeMap::new();
    let mut corner = |v: u32, p: &Point2| {
        let place = single(p);
        if *own[v as usize].get_or_insert(place) == place {
            return v as usize;
        }
        *known.entry((v, place.map(f32::to_bits))).or_insert_with(|| {
            further.push(place);
            mesh.positions.len() + further.len() - 1
        })
    };
    let faces = mesh.topology.faces.iter().zip(uv);
    let corners =
        faces.map(|(face, uv)| std::array::from_fn(|k| corner(face[k], &uv[k]))).collect();
    let mut list: Vec<[f32; 2]> = own.into_iter().map(Option::unwrap_or_default).collect();
    list.extend(further);
    (list, corners)
}

/// Write the material of an OBJ: a diffuse picture, `picture` beside the file.
///
/// # Errors
/// A file that cannot be written.
pub fn write_mtl(path: &Path, picture: &str) -> Result<(), WriteError> {
    write_atomic(path, |w| {
        write!(
            w,
            "newmtl {MATERIAL}\nKa 0 0 0\nKd 1 1 1\nKs 0.1 0.1 0.1\nNs 30\nillum 2\nmap_Kd {picture}\n"
        )
    })
}
