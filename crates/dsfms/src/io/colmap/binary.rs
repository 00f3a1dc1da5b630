//! The binary form: little-endian numbers, names that end with a zero byte.

use super::super::atomic::{WriteError, write_atomic};
use super::super::error::InputError;
use super::model::{ColmapCamera, ColmapImage, ColmapModel, ColmapPoint};
use super::{camera, text};
use crate::geometry::{Point2, Point3};
use std::io::{self, Write};
use std::path::Path;

/// `POINT3D_ID` of a 2D point without a 3D point.
const NO_POINT: u64 = u64::MAX;

/// Bytes of a file that are still to be read.
struct Bytes<'a> {
    path: &'a Path,
    data: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], InputError> {
        let chunk = self.data.get(self.at..).and_then(|rest| rest.first_chunk::<N>());
        self.at += N;
        chunk.copied().ok_or_else(|| {
            let reason = format!(
                "ends after {} bytes, more are expected (truncated, or no COLMAP model)",
                self.data.len()
            );
            InputError::format(self.path, reason)
        })
    }

    fn u64(&mut self) -> Result<u64, InputError> {
        Ok(u64::from_le_bytes(self.take()?))
    }

    fn u32(&mut self) -> Result<u32, InputError> {
        Ok(u32::from_le_bytes(self.take()?))
    }

    fn f64(&mut self, what: &str) -> Result<f64, InputError> {
        let value = f64::from_le_bytes(self.take()?);
        match value.is_finite() {
            true => Ok(value),
            false => Err(self.wrong(&format!("{what} is {value}; expected a finite number"))),
        }
    }

    fn floats(&mut self, n: usize, what: &str) -> Result<Vec<f64>, InputError> {
        (0..n).map(|_| self.f64(what)).collect()
    }

    /// A count of things of at least `size` bytes each, which must fit into what is left.
    fn count(&mut self, size: usize, what: &str) -> Result<usize, InputError> {
        let n = self.u64()?;
        let left = self.data.len().saturating_sub(self.at);
        match usize::try_from(n).ok().filter(|n| n.saturating_mul(size) <= left) {
            Some(n) => Ok(n),
            None => Err(self.wrong(&format!("{n} {what} do not fit into the {left} bytes left"))),
        }
    }

    fn name(&mut self) -> Result<String, InputError> {
        let rest = self.data.get(self.at..).unwrap_or_default();
        let Some(length) = rest.iter().position(|&b| b == 0) else {
            return Err(self.wrong("an image name does not end"));
        };
        self.at += length + 1;
        String::from_utf8(rest[..length].to_vec())
            .map_err(|_| self.wrong("an image name is not UTF-8"))
    }

    fn wrong(&self, problem: &str) -> InputError {
        let at = self.at;
        InputError::format(
            self.path,
            format!("before byte {at}: {problem} (truncated, damaged, or no COLMAP model)"),
        )
    }
}

/// All entries of a file: a count, then so many of at least `size` bytes.
fn entries<T>(
    path: &Path,
    (size, what): (usize, &str),
    read: impl Fn(&mut Bytes) -> Result<T, InputError>,
) -> Result<Vec<T>, InputError> {
    let data = crate::guard::read(path).map_err(|source| InputError::read(path, source))?;
    let mut bytes = Bytes { path, data: &data, at: 0 };
    let n = bytes.count(size, what)?;
    let all = (0..n).map(|_| read(&mut bytes)).collect::<Result<_, _>>()?;
    match data.len() - bytes.at {
        0 => Ok(all),
        more => {
            Err(InputError::format(path, format!("{more} bytes follow the last of {n} {what}")))
        }
    }
}

pub(super) fn read_cameras(path: &Path) -> Result<Vec<ColmapCamera>, InputError> {
    entries(path, (24, "cameras"), |b| {
        let id = b.u32()?;
        let number = b.u32()?.cast_signed();
        let size = [b.u64()? as usize, b.u64()? as usize];
        let (model, n) = camera::by_number(number).map_err(|problem| b.wrong(&problem))?;
        let parameters = b.floats(n, "a camera parameter")?;
        let camera = camera::from_colmap(model, size, &parameters);
        Ok(ColmapCamera { id, camera: camera.map_err(|problem| b.wrong(&problem))? })
    })
}

pub(super) fn read_images(path: &Path) -> Result<Vec<ColmapImage>, InputError> {
    entries(path, (73, "images"), |b| {
        let id = b.u32()?;
        let values = b.floats(7, "a pose")?;
        let camera = b.u32()?;
        let name = b.name()?;
        let pose = text::pose(&values, &name).map_err(|problem| b.wrong(&problem))?;
        let n = b.count(24, "points of an image")?;
        let point = |b: &mut Bytes| {
            let p = Point2::new(b.f64("a pixel")? - 0.5, b.f64("a pixel")? - 0.5);
            let id = b.u64()?;
            Ok((p, (id != NO_POINT).then_some(id)))
        };
        let points = (0..n).map(|_| point(b)).collect::<Result<_, InputError>>()?;
        Ok(ColmapImage { id, camera, name, pose, points })
    })
}

pub(super) fn read_points(path: &Path) -> Result<Vec<ColmapPoint>, InputError> {
    entries(path, (51, "points"), |b| {
        let id = b.u64()?;
        let xyz = b.floats(3, "a position")?;
        let rgb = b.take()?;
        let error_px = b.f64("an error")?;
        let n = b.count(8, "entries of a track")?;
        let track = (0..n).map(|_| Ok((b.u32()?, b.u32()?))).collect::<Result<_, InputError>>()?;
        Ok(ColmapPoint { id, position: Point3::new(xyz[0], xyz[1], xyz[2]), rgb, error_px, track })
    })
}

pub(super) fn write(folder: &Path, model: &ColmapModel) -> Result<(), WriteError> {
    write_atomic(&folder.join("cameras.bin"), |w| {
        count(w, model.cameras.len())?;
        for ColmapCamera { id, camera } in &model.cameras {
            let (number, _, parameters) = camera::to_colmap(camera);
            w.write_all(&id.to_le_bytes())?;
            w.write_all(&number.to_le_bytes())?;
            camera.size.iter().try_for_each(|&n| count(w, n))?;
            floats(w, &parameters)?;
        }
        Ok(())
    })?;
    write_atomic(&folder.join("images.bin"), |w| {
        count(w, model.images.len())?;
        model.images.iter().try_for_each(|image| write_image(w, image))
    })?;
    write_atomic(&folder.join("points3D.bin"), |w| {
        count(w, model.points.len())?;
        for p in &model.points {
            w.write_all(&p.id.to_le_bytes())?;
            floats(w, p.position.coords.as_slice())?;
            w.write_all(&p.rgb)?;
            floats(w, &[p.error_px])?;
            count(w, p.track.len())?;
            for (image, index) in &p.track {
                w.write_all(&image.to_le_bytes())?;
                w.write_all(&index.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

fn write_image(w: &mut dyn Write, image: &ColmapImage) -> io::Result<()> {
    let (q, t) = (image.pose.rotation.quaternion(), image.pose.translation.vector);
    w.write_all(&image.id.to_le_bytes())?;
    floats(w, &[q.w, q.i, q.j, q.k, t.x, t.y, t.z])?;
    w.write_all(&image.camera.to_le_bytes())?;
    w.write_all(image.name.as_bytes())?;
    w.write_all(&[0])?;
    count(w, image.points.len())?;
    for (p, id) in &image.points {
        floats(w, &[p.x + 0.5, p.y + 0.5])?;
        w.write_all(&id.unwrap_or(NO_POINT).to_le_bytes())?;
    }
    Ok(())
}

fn count(w: &mut dyn Write, n: usize) -> io::Result<()> {
    w.write_all(&(n as u64).to_le_bytes())
}

fn floats(w: &mut dyn Write, values: &[f64]) -> io::Result<()> {
    values.iter().try_for_each(|v| w.write_all(&v.to_le_bytes()))
}
