//! The report of a template: its surface among the cameras that saw it.

use super::Page;
use super::data::{
    PageData, PointValues, ShownFrame, ShownPart, ShownSurface, pixels, rows, unit_name,
};
use super::embed::{self, Cloud, escape};
use dsfms::geometry::{Isometry, Point3};
use dsfms::image::Frame;
use dsfms::register::scene::visibility;
use dsfms::template::Template;
use dsfms::template::statistics::template_statistics;

/// Most exploration frames that are embedded; of more, evenly spaced ones.
pub const MOST_FRAMES: usize = 24;

/// Which of `count` items to show: all, or [`MOST_FRAMES`] evenly spaced ones.
pub fn chosen(count: usize) -> Vec<usize> {
    let shown = count.min(MOST_FRAMES);
    (0..shown).map(|k| k * (count - 1).max(1) / (shown - 1).max(1)).collect()
}

/// The page of a template, with `frames` of its exploration where they are at hand.
pub fn template_page(name: &str, template: &Template, frames: &[Frame]) -> anyhow::Result<Page> {
    Ok(Page {
        title: format!("Template {name}"),
        summary: facts(template),
        sections: String::new(),
        data: template_data(template, frames)?,
        curves: String::new(),
    })
}

fn template_data(template: &Template, frames: &[Frame]) -> anyhow::Result<PageData> {
    // Shown as the first camera saw it.
    let base = template.views.first().map_or(Isometry::identity(), |v| v.camera_from_template);
    let moved = |points: &[Point3]| points.iter().map(|p| base * p).collect::<Vec<_>>();
    let mut data = PageData::of_template(template, 1.0, unit_name(template.unit))?;
    data.rest = Cloud::of(&moved(&template.mesh.positions));
    let points: Vec<Point3> = template.points.iter().map(|p| p.position).collect();
    data.points = (!points.is_empty()).then(|| Cloud::of(&moved(&points)));
    data.point_values = (!points.is_empty()).then(|| PointValues::of(&template.points));
    data.surroundings = template.surroundings.as_ref().map(|around| ShownPart {
        faces: embed::faces(&around.mesh.topology.faces),
        at: Cloud::of(&moved(&around.mesh.positions)),
    });
    data.moving_camera = true;
    data.methods = vec!["template".into()];
    for k in chosen(template.views.len()) {
        let view = &template.views[k];
        let image = frames.iter().find(|f| f.name == view.name);
        let image = image.map(embed::photograph).transpose()?;
        let size = template.camera.as_ref().map_or([640, 480], |c| c.size);
        let mut shown = ShownFrame::with(&view.name, image, size);
        shown.pose = Some(rows(&(view.camera_from_template * base.inverse()), 1.0));
        shown.surfaces = vec![Some(seen_surface(template, &view.camera_from_template))];
        shown.status = vec!["ok"];
        data.frames.push(shown);
    }
    if data.frames.is_empty() {
        data.frames.push(still("at rest"));
    }
    Ok(data)
}

/// A frame without image that shows the surface at rest.
pub fn still(name: &str) -> ShownFrame {
    let mut frame = ShownFrame::with(name, None, [640, 480]);
    frame.surfaces = vec![Some(ShownSurface::default())];
    frame.status = vec!["ok"];
    frame
}

fn seen_surface(template: &Template, pose: &Isometry) -> ShownSurface {
    let Some(camera) = &template.camera else { return ShownSurface::default() };
    let posed: Vec<Point3> = template.mesh.positions.iter().map(|p| pose * p).collect();
    let visible = visibility(camera, &template.mesh, &posed);
    ShownSurface {
        pixels: Some(pixels(camera, &posed)),
        visible: Some(embed::flags(&visible)),
        ..ShownSurface::default()
    }
}

fn facts(template: &Template) -> String {
    let s = template_statistics(template);
    let unit = unit_name(s.unit);
    let [x, y, z] = s.extent;
    let mut rows = vec![
        (
            "Surface",
            format!(
                "{} vertices, {} faces, mean edge {:.2} {unit}",
                s.vertices, s.faces, s.mean_edge
            ),
        ),
        ("Extent", format!("{x:.1} × {y:.1} × {z:.1} {unit}, area {:.0} {unit}²", s.area)),
        (
            "Pieces",
            format!(
                "{}; {} boundary loop(s), Euler characteristic {}",
                s.components, s.boundary_loops, s.euler_characteristic
            ),
        ),
    ];
    if s.frames > 0 {
        let error = s
            .median_reprojection_px
            .map_or(String::new(), |px| format!(", median reprojection error {px:.2} px"));
        rows.push(("Exploration", format!("{} frames registered{error}", s.frames)));
    }
    if let Some(f) = &s.flattening {
        rows.push((
            "Flattening",
            format!(
                "quasi-conformal ratio {:.3} (median), {:.3} (95th percentile); area ratio {:.1}; {} flipped faces",
                f.quasi_conformal_median, f.quasi_conformal_p95, f.area_ratio, f.flipped
            ),
        ));
    }
    if let Some(a) = &s.albedo {
        rows.push((
            "Albedo",
            format!(
                "{:.0} % of {} texels observed, mean {:.2}",
                100.0 * a.observed,
                a.texels,
                a.mean
            ),
        ));
    }
    if unit == "units" {
        rows.push(("Scale", "not known: lengths are in units of the template, not in mm".into()));
    }
    definition_list(&rows)
}

/// Names and values.
pub fn definition_list(rows: &[(&str, String)]) -> String {
    let item =
        |(name, value): &(&str, String)| format!("<dt>{name}</dt><dd>{}</dd>", escape(value));
    format!("<dl class=\"facts\">{}</dl>", rows.iter().map(item).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chosen_frames_begin_and_end_with_the_sequence() {
        assert_eq!(chosen(0), [0usize; 0]);
        assert_eq!(chosen(1), [0]);
        assert_eq!(chosen(3), [0, 1, 2]);
        let many = chosen(100);
        assert_eq!((many.len(), many[0], many[MOST_FRAMES - 1]), (MOST_FRAMES, 0, 99));
        assert!(many.windows(2).all(|w| w[0] < w[1]));
    }
}
