//! Z-buffer rendering with texture, shading, self-occlusion and highlights (paper §8.1), through
//! the same [`Light`] as the energies.

use super::random::{Random, normal};
use super::shadow::Shadows;
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Point3, Vector3, point_at};
use crate::image::{Frame, ToneCurve};
use crate::light::{Light, LightModel, specular_angle};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;
use crate::raster::rasterize;
use crate::template::SurfaceTexels;

/// A highlight `strength · exp(−½(angle/width)²)` about the mirror direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// Peak brightness, linear light.
    pub strength: f64,
    /// Width of the lobe, radians of normal deviation.
    pub width: f64,
}

/// What a rendered frame looks like.
#[derive(Clone, Debug)]
pub struct RenderOptions {
    /// Exposure gain on diffuse and specular light.
    pub gain: f64,
    /// Ambient light, linear.
    pub ambient: f64,
    /// Highlights, if any.
    pub gloss: Option<Gloss>,
    /// Standard deviation of the noise on encoded values, of 255.
    pub noise: f64,
    /// Tone curve of the written frame.
    pub tone: ToneCurve,
    /// Cast the shadows of the surface on itself.
    pub shadows: bool,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            gain: 1.0,
            ambient: 0.0,
            gloss: None,
            noise: 1.0,
            tone: ToneCurve::Srgb,
            shadows: true,
            seed: 0,
        }
    }
}

/// Render a surface with positions in camera axes; the background is black.
///
/// ```
/// use dsfms::geometry::{Point3, Vector3};
/// use dsfms::{light::LightModel, synth::{Case, RenderOptions, patch, render}};
///
/// let (camera, organ) = (Case::example(1).camera, patch(60, 1));
/// let before: Vec<Point3> =
///     organ.mesh.positions.iter().map(|p| p + Vector3::new(0.0, 0.0, 75.0)).collect();
/// let mesh = organ.mesh.with_positions(before);
/// let light = LightModel::Collinear;
/// let frame = render(&camera, &light, &mesh, &organ.albedo, &RenderOptions::default());
/// assert_eq!(frame.size, camera.size);
/// ```
pub fn render(
    camera: &CameraModel,
    light: &LightModel,
    mesh: &Mesh,
    albedo: &SurfaceTexels,
    options: &RenderOptions,
) -> Frame {
    let raster = rasterize(camera, &mesh.topology, &mesh.positions);
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let shadows = options.shadows.then(|| Shadows::cast(light, mesh));
    let linear = raster.render([0.0; 3], |face, b| {
        let corners = mesh.topology.faces[face].map(|v| v as usize);
        let point = point_at(corners.map(|v| &mesh.positions[v]), b);
        let sum: Vector3 = corners.iter().zip(b).map(|(&v, w)| normals[v] * w).sum();
        let lit = shadows.as_ref().map_or(1.0, |s| s.lit(&point));
        brightness(light, albedo.at(face, b), &point, &sum.normalize(), lit, options)
    });
    let encode = encoder(&options.tone);
    let mut random = Random::new(options.seed, 0x401);
    let rgb = linear
        .iter()
        .map(|p| {
            p.map(|v| {
                let noise =
                    if options.noise > 0.0 { options.noise * normal(&mut random) } else { 0.0 };
                (encode(v) + noise).round().clamp(0.0, 255.0) as u8
            })
        })
        .collect();
    Frame { name: "frame_000".to_owned(), size: camera.size(), rgb }
}

fn brightness(
    light: &LightModel,
    albedo: [f32; 3],
    point: &Point3,
    normal: &Vector3,
    lit: f64,
    options: &RenderOptions,
) -> [f64; 3] {
    let shade = lit * light.shade(point, normal).value;
    let glint = options.gloss.map_or(0.0, |g| {
        lit * g.strength * (-0.5 * (specular_angle(light, point, normal) / g.width).powi(2)).exp()
    });
    albedo.map(|a| options.gain * (a as f64 * shade + glint) + options.ambient)
}

/// Encoded value (of 255, not rounded) of linear light, by inverting the decoder's table.
pub fn encoder(tone: &ToneCurve) -> impl Fn(f64) -> f64 {
    let table = tone.table();
    move |light: f64| {
        let above = table.partition_point(|&t| (t as f64) < light);
        if above == 0 || above == 256 {
            return above.min(255) as f64;
        }
        let (low, high) = (table[above - 1] as f64, table[above] as f64);
        (above - 1) as f64 + (light - low) / (high - low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_inverts_decoding() {
        let encode = encoder(&ToneCurve::Srgb);
        for v in [0.0, 1.0, 77.0, 254.0, 255.0] {
            assert!((encode(ToneCurve::Srgb.decode(v / 255.0)) - v).abs() < 1e-3, "{v}");
        }
        assert_eq!(encode(7.0), 255.0);
    }
}
