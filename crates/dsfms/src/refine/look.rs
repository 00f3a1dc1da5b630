//! What one shape makes of a photograph at one blur: light and albedo at surface points.

use super::Photograph;
use super::glare::{Channels, pale};
use super::occluders::occluders;
use crate::camera::resample::moved;
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Point2, Point3, Vector3, point_at};
use crate::image::filter::blur_masked_all;
use crate::image::{ColorImage, Mask, Plane};
use crate::light::{Coated, Light, lit};
use crate::mesh::normals::vertex_normals;
use crate::mesh::{Mesh, Topology};
use crate::raster::{Raster, rasterize};
use rayon::prelude::*;

/// How a photograph is looked at; lengths in px.
pub(super) struct LookOptions {
    /// Standard deviation of the blur of image and albedo.
    pub(super) blur: f64,
    /// Points with less cosine towards the camera are left out.
    pub(super) grazing: f64,
    /// Points nearer to a predicted contour are left out.
    pub(super) contour: f64,
    /// What is nearer to a saturated pixel may be glare.
    pub(super) halo: f64,
    /// What is nearer to the mirror direction may be glare in a frame with highlights, degrees.
    pub(super) mirror_deg: f64,
    /// Colours tell glare and instruments from tissue.
    pub(super) colour: bool,
    /// Shading is blurred as the image is: the shape is near that of the frame.
    pub(super) blur_shade: bool,
}

/// A photograph with a shape in front of it.
pub(super) struct FrameLook<'a> {
    photo: &'a Photograph<'a>,
    pub(super) rest: &'a Mesh,
    pub(super) shape: &'a [Point3],
    options: LookOptions,
    pub(super) normals: Vec<Vector3>,
    pub(super) raster: Raster,
    /// Blurred over the pixels that count, each channel over its own.
    pub(super) image: ColorImage,
    albedo: ColorImage,
    /// Mean albedo times the shading of the shape, blurred likewise; `None` where that is not asked
    /// for.
    diffuse: Option<Plane>,
    support: Plane,
    /// `true` too near to a predicted contour.
    at_contour: Mask,
    /// Half a mean edge: what the z-buffer may be off at a slanted face.
    pub(super) tolerance: f64,
    glossy: f64,
}

impl<'a> FrameLook<'a> {
    pub(super) fn new(
        photo: &'a Photograph<'a>,
        rest: &'a Mesh,
        shape: &'a [Point3],
        options: LookOptions,
    ) -> Self {
        let raster = rasterize(photo.camera, &rest.topology, shape);
        let normals = vertex_normals(&rest.topology, shape);
        let (texels, picture) = (photo.albedo, photo.picture);
        let mean = |face, quarters| picture.shown(texels.observed_mean(face, quarters));
        let albedo = raster.render_quarters([f32::NAN; 3], mean);
        let known: Vec<bool> = albedo.iter().map(|a| !a[0].is_nan()).collect();
        let albedo = ColorImage { size: raster.size, data: albedo };
        let at_contour = if options.contour > 0.0 {
            raster.discontinuities(0.05).dilate(options.contour)
        } else {
            Mask::filled(raster.size, false)
        };
        let highlights = picture.saturated.data.iter().any(|&s| s);
        let mut look = Self {
            glossy: if highlights { options.mirror_deg.to_radians().cos() } else { f64::INFINITY },
            image: ColorImage { size: raster.size, data: Vec::new() },
            support: Plane { size: raster.size, data: Vec::new() },
            at_contour,
            tolerance: 0.5 * rest.mean_edge_length(),
            photo,
            rest,
            shape,
            options,
            normals,
            raster,
            albedo,
            diffuse: None,
        };
        // One mask for all channels: blurred over different pixels, glare would not stay white.
        let counts =
            |i: usize| known[i] && photo.usable.data[i] && picture.clipped[i] == [false; 3];
        let counts: Vec<bool> = (0..known.len()).map(counts).collect();
        let told = look.options.colour && !pale(&look.albedo, &known);
        let shade = if told || look.options.blur_shade { look.shading() } else { Vec::new() };
        let covered = match told {
            true => occluders(&picture.linear, &look.albedo, &shade, &counts),
            false => look.possible_glare(),
        };
        let data = counts.iter().zip(&covered.data).map(|(&counts, covered)| counts && !covered);
        let mask = Mask { size: look.raster.size, data: data.collect() };
        let channels = [0, 1, 2].map(|c| (&picture.linear, c)).into_par_iter();
        let channels = channels.chain([0, 1, 2].map(|c| (&look.albedo, c)));
        let mut planes: Vec<Plane> = channels.map(|(of, c)| of.channel(c)).collect();
        if look.options.blur_shade {
            planes.push(look.lit(&shade));
        }
        let (mut blurred, support) = blur_masked_all(&planes, &mask, look.options.blur);
        look.image = ColorImage::of_channels([&blurred[0], &blurred[1], &blurred[2]]);
        look.albedo = ColorImage::of_channels([&blurred[3], &blurred[4], &blurred[5]]);
        look.diffuse = look.options.blur_shade.then(|| blurred.pop()).flatten();
        let here = support.data.iter().zip(&mask.data);
        look.support.data = here.map(|(&s, &here)| if here { s } else { 0.0 }).collect();
        look
    }

    /// Mean albedo times the shading of every pixel.
    fn lit(&self, shade: &[f64]) -> Plane {
        let lit = |(a, s): (&[f32; 3], &f64)| (a[0] + a[1] + a[2]) / 3.0 * *s as f32;
        let data = self.albedo.data.iter().zip(shade).map(lit).collect();
        Plane { size: self.raster.size, data }
    }

    fn shading(&self) -> Vec<f64> {
        shading(self.photo.light, &self.rest.topology, self.shape, &self.normals, &self.raster)
    }

    /// Pixels that may be glare, where their colour does not tell: they must not reach their
    /// neighbours through the blur.
    fn possible_glare(&self) -> Mask {
        let mirror = self.raster.render(false, |face, b| {
            let face = self.rest.topology.faces[face];
            let on = self.on_face(face, b);
            on.is_some_and(|(point, _, normal)| self.mirrors(&point, &normal))
        });
        let data = (0..mirror.len()).map(|i| mirror[i] || self.in_halo(i)).collect();
        Mask { size: self.raster.size, data }
    }

    fn mirrors(&self, point: &Point3, normal: &Vector3) -> bool {
        self.photo.light.mirror_normal(point).dot(normal) > self.glossy
    }

    /// Visible vertices that mirror the light, with the normals that do.
    pub(super) fn highlights(&self, visible: &[bool]) -> Vec<(u32, Vector3)> {
        let inside = |&v: &usize| visible[v] && !self.rest.topology.boundary[v];
        let mirrors = |v: usize| {
            let pixel = self.photo.camera.project(&self.shape[v])?.pixel;
            let highlight =
                self.photo.picture.saturated.at_pixel(&pixel) && self.photo.usable.at_pixel(&pixel);
            highlight.then(|| (v as u32, self.photo.light.mirror_normal(&self.shape[v])))
        };
        (0..self.shape.len()).filter(inside).filter_map(mirrors).collect()
    }

    fn in_halo(&self, pixel: usize) -> bool {
        f64::from(self.photo.picture.to_saturated[pixel]) <= self.options.halo
    }

    /// A point inside a face, its pixel and its interpolated unit normal.
    pub(super) fn on_face(&self, face: [u32; 3], b: [f64; 3]) -> Option<(Point3, Point2, Vector3)> {
        let corners = face.map(|v| v as usize);
        let point = point_at(corners.map(|v| &self.shape[v]), b);
        let normal = corners.iter().zip(b).map(|(&v, w)| self.normals[v] * w).sum::<Vector3>();
        let pixel = self.photo.camera.project(&point)?.pixel;
        Some((point, pixel, normal.normalize()))
    }

    /// Where the camera sees a point, px.
    pub(super) fn project(&self, point: &Point3) -> Option<Point2> {
        Some(self.photo.camera.project(point)?.pixel)
    }

    /// A pixel of the frame, which `camera` took, in the picture that shading is read from: of a
    /// video it is a smaller one.
    pub(super) fn of_frame(&self, camera: &CameraModel, pixel: Point2) -> Option<Point2> {
        let own = self.photo.camera;
        if own == camera { Some(pixel) } else { moved(&pixel, own, camera) }
    }

    /// What the blur adds to the shading of a point; 0 where it is not looked at.
    fn added_shade(&self, pixel: &Point2, albedo: &[f64; 3], shade: f64) -> f64 {
        let mean = albedo.iter().sum::<f64>() / 3.0;
        let lit = self.diffuse.as_ref().and_then(|diffuse| diffuse.sample(pixel));
        lit.filter(|_| mean > 0.0).map_or(0.0, |lit| lit.0 / mean - shade)
    }

    /// What the channels say of a point; `None` where it is not looked at: [`Self::seen`].
    pub(super) fn at(&self, point: &Point3, pixel: &Point2, normal: &Vector3) -> Option<Channels> {
        let here = self.seen(point, pixel, normal)?;
        let shade = self.photo.light.shade(point, normal).value;
        let albedo = self.albedo.sampled(pixel)?;
        Some(Channels {
            image: self.image.sampled(pixel)?,
            albedo,
            shade,
            added_shade: self.added_shade(pixel, &albedo, shade),
            maybe_glare: self.mirrors(point, normal) || self.in_halo(here),
        })
    }

    /// The pixel in which a point is looked at, by its index; `None` where it is hidden, grazing,
    /// near a contour, or where most of the blur is of pixels that do not count.
    pub(super) fn seen(&self, point: &Point3, pixel: &Point2, normal: &Vector3) -> Option<usize> {
        let [w, h] = self.image.size;
        let (x, y) = (pixel.x.round(), pixel.y.round());
        if !(x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64) {
            return None;
        }
        let i = y as usize * w + x as usize;
        let occluded = self.raster.depth[i] < point.z - self.tolerance;
        let grazing = -normal.dot(&point.coords.normalize()) < self.options.grazing;
        let left_out = occluded || grazing || self.at_contour.data[i] || self.support.data[i] < 0.5;
        (!left_out).then_some(i)
    }
}

/// Diffuse shading of a shape (camera axes) at every pixel; 0 where there is none.
pub(super) fn shading(
    light: &Coated,
    topology: &Topology,
    shape: &[Point3],
    normals: &[Vector3],
    raster: &Raster,
) -> Vec<f64> {
    let lit = lit(light, shape, normals);
    raster.render(0.0, |face, b| {
        let corners = topology.faces[face];
        (0..3).map(|k| b[k] * lit[corners[k] as usize]).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::median;
    use crate::image::{Picture, diagonal};
    use crate::refine::JointOptions;
    use crate::synth::Case;

    /// Median size of the log ratio of image and prediction at the true shape, where no glare is.
    fn left(case: &Case, blur_shade: bool) -> f64 {
        let photo = &Photograph {
            camera: &case.camera,
            picture: &Picture::of(&case.frame, &case.template.tone),
            usable: &Mask::filled(case.camera.size, true),
            outline: None,
            light: &case.template.lighting(),
            albedo: case.template.albedo.as_ref().unwrap(),
            exposure: None,
        };
        let diagonal = diagonal(case.camera.size);
        let options = JointOptions::default().image.look(0.018 * diagonal, diagonal);
        let options = LookOptions { blur_shade, ..options };
        let look = FrameLook::new(photo, &case.template.mesh, &case.truth, options);
        let one = |v: usize| {
            let pixel = look.project(&case.truth[v])?;
            let seen = look.at(&case.truth[v], &pixel, &look.normals[v])?;
            (!seen.maybe_glare).then(|| seen.log_ratio())
        };
        let mut logs: Vec<f64> = (0..case.truth.len()).filter_map(one).collect();
        let gain = median(&mut logs).unwrap();
        median(&mut logs.iter().map(|l| (l - gain).abs()).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn shading_that_varies_within_the_blur_is_foretold() {
        let case = Case::example(1);
        let (with, without) = (left(&case, true), left(&case, false));
        assert!(with < 0.6 * without, "{with}, without {without}");
    }
}
