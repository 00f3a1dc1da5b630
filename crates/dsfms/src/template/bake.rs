//! Between surface texels and the outside: UV images, values per vertex.

use super::{Flattening, SurfaceTexels};
use crate::geometry::{Point2, Vector2, signed_area};
use crate::image::{ColorImage, Mask};
use crate::mesh::Mesh;
use rayon::prelude::*;

/// Most subdivisions of a face's edges: 4,096 texels a face.
pub const MAX_RESOLUTION: u16 = 64;

/// Why values do not fit a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// Not one item per face or vertex.
    #[error("{found} {what} given for a mesh of {expected}; were they made for another mesh?")]
    Count {
        /// What was counted.
        what: &'static str,
        /// In the mesh.
        expected: usize,
        /// Given.
        found: usize,
    },
    /// An image without pixels.
    #[error("the image has no pixels")]
    EmptyImage,
    /// A value that is not a finite number ≥ 0.
    #[error("the albedo of vertex {vertex} is {value}; expected a finite number of at least 0")]
    BadValue {
        /// 0-based vertex.
        vertex: usize,
        /// What was found.
        value: f32,
    },
}

/// Subdivisions of every face such that a texel's edge is about `texel_size` (length units of the
/// mesh, above 0), between 1 and [`MAX_RESOLUTION`].
pub fn choose_resolution(mesh: &Mesh, texel_size: f64) -> Vec<u16> {
    // The side of the equilateral triangle of the same area.
    let side = |area: f64| (area * 4.0 / 3f64.sqrt()).sqrt();
    mesh.face_areas()
        .into_iter()
        .map(|a| (side(a) / texel_size).round().clamp(1.0, MAX_RESOLUTION as f64) as u16)
        .collect()
}

impl SurfaceTexels {
    /// Sample an image in linear light through UV corners (v upwards, `[0, 1]²`; outside, the
    /// nearest edge pixel), bilinearly at texel centres. Counts as observed once, with no spread.
    ///
    /// # Errors
    /// Counts that differ, or an image without pixels.
    pub fn from_uv_image(
        uv: &[[Point2; 3]],
        image: &ColorImage,
        resolution: Vec<u16>,
    ) -> Result<Self, BakeError> {
        count("UV corners of faces", resolution.len(), uv.len())?;
        if image.data.is_empty() {
            return Err(BakeError::EmptyImage);
        }
        Ok(Self::filled_by(resolution, |face, b| {
            let [p, q, r] = uv[face];
            let at = p.coords * b[0] + q.coords * b[1] + r.coords * b[2];
            bilinear(image, at)
        }))
    }

    /// Interpolate one linear RGB value per vertex (grey: three equal ones) over the faces.
    ///
    /// # Errors
    /// Counts that differ, or a value that is negative or not finite.
    pub fn from_vertex_values(
        mesh: &Mesh,
        values: &[[f32; 3]],
        resolution: Vec<u16>,
    ) -> Result<Self, BakeError> {
        count("values per vertex", mesh.positions.len(), values.len())?;
        count("resolutions of faces", mesh.topology.faces.len(), resolution.len())?;
        for (vertex, value) in values.iter().enumerate() {
            if let Some(&value) = value.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
                return Err(BakeError::BadValue { vertex, value });
            }
        }
        Ok(Self::filled_by(resolution, |face, b| {
            let corners = mesh.topology.faces[face].map(|v| values[v as usize]);
            [0, 1, 2].map(|c| (0..3).map(|k| b[k] as f32 * corners[k][c]).sum())
        }))
    }

    fn filled_by(resolution: Vec<u16>, value: impl Fn(usize, [f64; 3]) -> [f32; 3] + Sync) -> Self {
        let mut texels = Self::new(resolution);
        texels.value = (0..texels.resolution.len())
            .into_par_iter()
            .flat_map_iter(|f| texels.centres(f).map(|b| value(f, b)).collect::<Vec<_>>())
            .collect();
        texels.spread.fill(0.0);
        texels.views.fill(1);
        texels
    }
}

fn count(what: &'static str, expected: usize, found: usize) -> Result<(), BakeError> {
    if expected == found { Ok(()) } else { Err(BakeError::Count { what, expected, found }) }
}

fn bilinear(image: &ColorImage, uv: Vector2) -> [f32; 3] {
    let [w, h] = image.size;
    let place = |t: f64, n: usize| (t * n as f64 - 0.5).clamp(0.0, n as f64 - 1.0);
    let (x, y) = (place(uv.x, w), place(1.0 - uv.y, h));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
    let (u, v) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let at = |x: usize, y: usize| image.data[y * w + x];
    let [a, b, c, d] = [at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)];
    [0, 1, 2].map(|k| (1.0 - v) * ((1.0 - u) * a[k] + u * b[k]) + v * ((1.0 - u) * c[k] + u * d[k]))
}

/// Surface values laid out as a UV image.
#[derive(Clone, Debug, PartialEq)]
pub struct Baked {
    /// Linear RGB; row 0 is at v = 1.
    pub image: ColorImage,
    /// `true` where a face covers the pixel centre (before the margin was grown).
    pub covered: Mask,
    /// Pixels that more than one face claims: charts that overlap themselves.
    pub overlapping: usize,
}

/// Draw surface texels into a square UV image of `size` px, then grow the charts by `margin` px so
/// that bilinear lookups at seams find colour. Uncovered pixels are black.
///
/// # Errors
/// Texels of another number of faces.
pub fn bake(
    texels: &SurfaceTexels,
    flattening: &Flattening,
    size: usize,
    margin: usize,
) -> Result<Baked, BakeError> {
    count("faces of texels", flattening.corners.len(), texels.resolution.len())?;
    let mut baked = Baked {
        image: ColorImage { size: [size; 2], data: vec![[0.0; 3]; size * size] },
        covered: Mask::filled([size; 2], false),
        overlapping: 0,
    };
    for (face, uv) in flattening.corners.iter().enumerate() {
        draw(&mut baked, size, uv, |b| texels.at(face, b));
    }
    let mut known = baked.covered.clone();
    for _ in 0..margin {
        grow(&mut baked.image, &mut known);
    }
    Ok(baked)
}

fn draw(baked: &mut Baked, size: usize, uv: &[Point2; 3], value: impl Fn([f64; 3]) -> [f32; 3]) {
    let scale = size as f64;
    let pixel = uv.map(|p| Point2::new(p.x * scale - 0.5, (1.0 - p.y) * scale - 0.5));
    let total = signed_area(&pixel);
    if total == 0.0 {
        return;
    }
    let range = |c: usize| {
        let [a, b, d] = pixel.map(|p| p[c]);
        let low = a.min(b).min(d).ceil().max(0.0) as usize;
        let high = (a.max(b).max(d).floor() + 1.0).clamp(0.0, scale) as usize;
        low..high
    };
    for y in range(1) {
        for x in range(0) {
            let p = Point2::new(x as f64, y as f64);
            let b1 = signed_area(&[pixel[0], p, pixel[2]]) / total;
            let b2 = signed_area(&[pixel[0], pixel[1], p]) / total;
            let b = [1.0 - b1 - b2, b1, b2];
            if b.iter().any(|&b| b < 0.0) {
                continue;
            }
            let at = y * size + x;
            // A centre on a shared edge belongs to both faces; only an inner one shows an overlap.
            let inner = b.iter().all(|&b| b > 1e-9);
            baked.overlapping += usize::from(baked.covered.data[at] && inner);
            baked.covered.data[at] = true;
            baked.image.data[at] = value(b);
        }
    }
}

/// Fill the unknown neighbours of known pixels with the mean of those.
fn grow(image: &mut ColorImage, known: &mut Mask) {
    let [w, h] = image.size;
    let before = known.clone();
    let old = image.data.clone();
    for at in (0..w * h).filter(|&at| !before.data[at]) {
        let (x, y) = (at % w, at / w);
        let (mut sum, mut n) = ([0.0f32; 3], 0.0f32);
        for j in y.saturating_sub(1)..(y + 2).min(h) {
            for i in x.saturating_sub(1)..(x + 2).min(w) {
                if before.at(i, j) {
                    n += 1.0;
                    (0..3).for_each(|c| sum[c] += old[j * w + i][c]);
                }
            }
        }
        if n > 0.0 {
            image.data[at] = sum.map(|s| s / n);
            known.data[at] = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::template::flatten::{FlattenOptions, flatten};

    #[test]
    fn a_linear_image_survives_the_round_trip() {
        let mesh = shapes::hemisphere(2, 1.0);
        let map = flatten(&mesh, &FlattenOptions::default()).unwrap();
        let size = 64;
        let data = (0..size * size)
            .map(|i| [(i % size) as f32 / 64.0, (i / size) as f32 / 64.0, 0.5])
            .collect();
        let image = ColorImage { size: [size; 2], data };
        let resolution = choose_resolution(&mesh, 0.02);
        let texels = SurfaceTexels::from_uv_image(&map.corners, &image, resolution).unwrap();
        let baked = bake(&texels, &map, size, 2).unwrap();
        assert_eq!(baked.overlapping, 0);
        assert!((0.3..0.95).contains(&baked.covered.coverage()), "{}", baked.covered.coverage());
        for at in (0..size * size).filter(|&at| baked.covered.data[at]) {
            for c in 0..3 {
                assert!((baked.image.data[at][c] - image.data[at][c]).abs() < 0.02);
            }
        }
    }

    #[test]
    fn vertex_values_are_interpolated() {
        let p = crate::geometry::Point3::new;
        let points = vec![p(0., 0., 0.), p(1., 0., 0.), p(0., 1., 0.)];
        let mesh = shapes::mesh(points, vec![[0, 1, 2]]);
        let values = [[0.0; 3], [0.3; 3], [0.6, 0.6, 0.0]];
        let texels = SurfaceTexels::from_vertex_values(&mesh, &values, vec![1]).unwrap();
        assert!((texels.value[0][0] - 0.3).abs() < 1e-6 && (texels.value[0][2] - 0.1).abs() < 1e-6);
        assert_eq!((texels.views[0], texels.spread[0]), (1, 0.0));
        assert!(matches!(
            SurfaceTexels::from_vertex_values(&mesh, &values[..2], vec![1]),
            Err(BakeError::Count { expected: 3, found: 2, .. })
        ));
        let bad = [[0.0; 3], [f32::NAN; 3], [0.0; 3]];
        assert!(matches!(
            SurfaceTexels::from_vertex_values(&mesh, &bad, vec![1]),
            Err(BakeError::BadValue { vertex: 1, .. })
        ));
    }

    #[test]
    fn resolution_follows_the_size_of_a_face() {
        let mesh = shapes::irregular_sheet(2);
        assert_eq!(choose_resolution(&mesh, 1e-9), [64, 64]);
        assert_eq!(choose_resolution(&mesh, 10.0), [1, 1]);
        assert_eq!(choose_resolution(&mesh, 0.107), [10, 10]);
    }
}
