//! What the page's viewer is given: surfaces, images and values, packed.

use super::embed::{self, Cloud, Numbers, base64};
use crate::outputs::FrameReport;
use dsfms::camera::{Camera, CameraModel};
use dsfms::geometry::{Isometry, Point3};
use dsfms::image::Frame;
use dsfms::mesh::Mesh;
use dsfms::pipeline::Reconstruction;
use dsfms::register::Match;
use dsfms::template::bake::bake;
use dsfms::template::{LengthUnit, SparsePoint, Template};
use serde::Serialize;

/// Side of the embedded albedo, px.
const ALBEDO_SIDE: usize = 768;
/// Growth of the charts, px: what bilinear sampling reaches beyond a seam.
const ALBEDO_MARGIN: usize = 3;

/// Everything that the viewer draws.
#[derive(Clone, Debug, Serialize)]
pub struct PageData {
    /// `mm` or `units`, after numbers.
    pub unit: &'static str,
    /// Rows of three vertices.
    pub faces: String,
    pub vertices: usize,
    /// Shape at rest: axes of the first camera in a template's report, else any.
    pub rest: Cloud,
    /// What `rest` is: `the shape at rest`.
    pub reference: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flattening: Option<FlatChart>,
    /// The albedo on the flattening.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub albedo: Option<String>,
    /// Names of the columns of `frames[..].surfaces`.
    pub methods: Vec<String>,
    /// The column that is the truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<usize>,
    /// The one shown first.
    pub chosen: usize,
    pub frames: Vec<ShownFrame>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<ShownCamera>,
    /// Places of the lights, camera axes; empty = along the optical axis or not known.
    pub lights: Vec<[f64; 3]>,
    /// Sparse points of structure from motion, axes of `rest`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<Cloud>,
    /// What is known of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub point_values: Option<PointValues>,
    /// Values of the vertices that do not change from frame to frame.
    pub scalars: Vec<Scalar>,
    /// The surface rests and the camera moves.
    pub moving_camera: bool,
    pub structures: Vec<ShownStructure>,
    /// What lies around the organ, axes of `rest`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surroundings: Option<ShownPart>,
    /// Most frames are names alone; `dsfms view` sends them when they are asked for.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub stream: bool,
    /// Frames follow each other; one without a surface is lost.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub video: bool,
}

/// Colour, error and sightings of the sparse points.
#[derive(Clone, Debug, Serialize)]
pub struct PointValues {
    /// Three bytes a point.
    rgb: String,
    /// px.
    error: Numbers,
    /// Frames that saw it.
    track: Numbers,
}

impl PointValues {
    pub fn of(points: &[SparsePoint]) -> Self {
        let each = |value: fn(&SparsePoint) -> f64| {
            Numbers::of(&points.iter().map(value).collect::<Vec<_>>())
        };
        Self {
            rgb: base64(&points.iter().flat_map(|p| p.rgb).collect::<Vec<_>>()),
            error: each(|p| p.error_px),
            track: each(|p| p.sightings.len() as f64),
        }
    }
}

/// A flattening with its distortion.
#[derive(Clone, Debug, Serialize)]
pub struct FlatChart {
    /// UV of the corners of every face, 16 bits for `[0, 1]`.
    uv: String,
    quasi_conformal: Numbers,
    log_area: Numbers,
}

/// A value per vertex.
#[derive(Clone, Debug, Serialize)]
pub struct Scalar {
    pub name: &'static str,
    pub unit: &'static str,
    pub values: Numbers,
}

/// What the frustum needs; distortion is in `pixels` already.
#[derive(Clone, Debug, Serialize)]
pub struct ShownCamera {
    size: [usize; 2],
    focal: [f64; 2],
    centre: [f64; 2],
}

/// A second surface, which rests.
#[derive(Clone, Debug, Serialize)]
pub struct ShownPart {
    pub faces: String,
    pub at: Cloud,
}

/// A hidden structure carried along: rows of three points.
#[derive(Clone, Debug, Serialize)]
pub struct ShownStructure {
    pub name: String,
    pub faces: String,
}

/// Where a hidden structure lies in a frame; per point.
#[derive(Clone, Debug, Serialize)]
pub struct BuriedPlace {
    pub at: Cloud,
    pub pixels: String,
    /// Depth under the surface at rest, length units.
    pub under: Numbers,
    /// Expected error, px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub halo: Option<Numbers>,
}

/// One frame.
#[derive(Clone, Debug, Serialize)]
pub struct ShownFrame {
    pub name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    #[serde(skip_serializing_if = "is_unknown")]
    pub size: [usize; 2],
    /// `camera_from_rest`, 3 rows of 4, where the camera moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose: Option<[[f64; 4]; 3]>,
    /// One a method; `null` where it failed. Empty: the frame is a name alone.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<Option<ShownSurface>>,
    /// One a method.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub status: Vec<&'static str>,
    /// Why it is not ok; one list a method.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<Vec<String>>,
}

/// A match in the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum ShownMatch {
    /// `x, y, kept`, and where the surface has the point.
    Placed(f32, f32, bool, f32, f32),
    /// Where that is behind the camera.
    Alone(f32, f32, bool),
}

/// One surface in one frame; the default is the surface at rest.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ShownSurface {
    /// Camera axes; absent = at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub positions: Option<Cloud>,
    /// Where the vertices appear in the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub visible: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_error: Option<Numbers>,
    pub matches: Vec<ShownMatch>,
    /// `camera_from_template`, rigid part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose: Option<[[f64; 4]; 3]>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub structures: Vec<BuriedPlace>,
}

/// After a number.
pub fn unit_name(unit: LengthUnit) -> &'static str {
    match unit {
        LengthUnit::Millimetre => "mm",
        LengthUnit::TemplateUnit => "units",
    }
}

/// Rows of a rigid motion.
pub fn rows(pose: &Isometry, scale: f64) -> [[f64; 4]; 3] {
    let m = pose.to_homogeneous();
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)] * if c == 3 { scale } else { 1.0 }))
}

impl ShownCamera {
    pub fn of(camera: &CameraModel) -> Self {
        Self { size: camera.size, focal: camera.focal, centre: camera.centre }
    }
}

impl PageData {
    /// A surface alone.
    pub fn of_mesh(mesh: &Mesh, unit: &'static str) -> Self {
        Self {
            unit,
            faces: embed::faces(&mesh.topology.faces),
            vertices: mesh.positions.len(),
            rest: Cloud::of(&mesh.positions),
            reference: "the shape at rest",
            flattening: None,
            albedo: None,
            methods: Vec::new(),
            truth: None,
            chosen: 0,
            frames: Vec::new(),
            camera: None,
            lights: Vec::new(),
            points: None,
            scalars: Vec::new(),
            moving_camera: false,
            structures: Vec::new(),
            surroundings: None,
            point_values: None,
            stream: false,
            video: false,
        }
    }

    /// The template's surface, lengths multiplied by `scale`.
    pub fn of_template(
        template: &Template,
        scale: f64,
        unit: &'static str,
    ) -> anyhow::Result<Self> {
        let scaled = template.mesh.positions.iter().map(|p| p * scale).collect();
        let mut data = Self::of_mesh(&template.mesh.with_positions(scaled), unit);
        data.flattening = template.flattening.as_ref().map(|f| FlatChart {
            uv: embed::words(f.corners.iter().flatten().flat_map(|p| {
                [p.x, p.y].map(|t| (t.clamp(0.0, 1.0) * f64::from(u16::MAX)).round() as u16)
            })),
            quasi_conformal: Numbers::of(&f.quasi_conformal),
            log_area: Numbers::of(&f.log_area),
        });
        if let (Some(texels), Some(f)) = (&template.albedo, &template.flattening) {
            let baked = bake(texels, f, ALBEDO_SIDE, ALBEDO_MARGIN)?;
            data.albedo = Some(embed::jpeg(&embed::displayed(&baked.image))?);
        }
        if let Some(light) = &template.light {
            data.lights = light.sources().iter().map(|p| (p * scale).coords.into()).collect();
        }
        data.camera = template.camera.as_ref().map(ShownCamera::of);
        if !template.seen.is_empty() {
            let seen: Vec<f64> = template.seen.iter().map(|&n| f64::from(n)).collect();
            let values = Numbers::of(&seen);
            data.scalars.push(Scalar { name: "Frames that saw it", unit: "frames", values });
        }
        if !template.sigma.is_empty() {
            let sigma: Vec<f64> = template.sigma.iter().map(|s| s * scale).collect();
            let values = Numbers::of(&sigma);
            data.scalars.push(Scalar { name: "Expected error of the template", unit, values });
        }
        Ok(data)
    }
}

impl ShownFrame {
    /// A frame without surfaces yet.
    pub fn new(name: &str, frame: &Frame) -> anyhow::Result<Self> {
        Ok(Self::with(name, Some(embed::photograph(frame)?), frame.size))
    }

    /// A name alone, for [`PageData::stream`].
    pub fn named(name: &str) -> Self {
        Self::with(name, None, [0, 0])
    }

    /// A frame by its parts.
    pub fn with(name: &str, image: Option<String>, size: [usize; 2]) -> Self {
        let name = name.to_string();
        Self { name, image, size, pose: None, surfaces: vec![], status: vec![], reasons: vec![] }
    }

    /// Add the next method's result; its lengths are multiplied by `scale`.
    pub fn add(
        &mut self,
        report: &FrameReport,
        result: Option<&Reconstruction>,
        (camera, faces): (&CameraModel, &[[u32; 3]]),
        scale: f64,
    ) {
        self.status.push(report.status);
        self.reasons.push(report.reasons.clone());
        self.surfaces.push(result.map(|r| ShownSurface::of(r, camera, faces, scale)));
    }
}

impl ShownFrame {
    /// Hidden structures of the last surface.
    pub fn add_structures(&mut self, places: Vec<BuriedPlace>) {
        if let Some(Some(surface)) = self.surfaces.last_mut() {
            surface.structures = places;
        }
    }
}

impl ShownSurface {
    fn of(result: &Reconstruction, camera: &CameraModel, faces: &[[u32; 3]], scale: f64) -> Self {
        let scaled: Vec<Point3> = result.vertices.iter().map(|p| p * scale).collect();
        let expected = result.expected_error.as_ref();
        Self {
            positions: Some(Cloud::of(&scaled)),
            pixels: Some(pixels(camera, &result.vertices)),
            visible: Some(embed::flags(&result.visible)),
            expected_error: expected
                .map(|c| Numbers::of(&c.iter().map(|v| v * scale).collect::<Vec<_>>())),
            matches: shown_matches(camera, faces, &result.vertices, &result.matches),
            pose: Some(rows(&result.pose, scale)),
            structures: Vec::new(),
        }
    }
}

/// Matches with the places where the surface has their points, to a hundredth of a pixel.
pub fn shown_matches(
    camera: &CameraModel,
    faces: &[[u32; 3]],
    vertices: &[Point3],
    matches: &[(Match, bool)],
) -> Vec<ShownMatch> {
    let short = |v: f64| ((100.0 * v).round() / 100.0) as f32;
    let shown = |(m, kept): &(Match, bool)| {
        let [x, y] = [short(m.pixel.x), short(m.pixel.y)];
        let corners = faces.get(m.face as usize).map(|f| f.map(|v| vertices[v as usize].coords));
        let point = corners.map(|c| (0..3).map(|i| c[i] * m.barycentric[i]).sum());
        match point.and_then(|p| camera.project(&Point3 { coords: p })) {
            Some(q) => ShownMatch::Placed(x, y, *kept, short(q.pixel.x), short(q.pixel.y)),
            None => ShownMatch::Alone(x, y, *kept),
        }
    };
    matches.iter().map(shown).collect()
}

fn is_unknown(size: &[usize; 2]) -> bool {
    *size == [0, 0]
}

/// Where points in camera axes appear.
pub fn pixels(camera: &CameraModel, points: &[Point3]) -> String {
    let found: Vec<_> = points.iter().map(|p| camera.project(p).map(|q| q.pixel)).collect();
    embed::pixels(camera.size, &found)
}
