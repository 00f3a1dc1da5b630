//! What the user says of the organ.

use clap::Args;
use dsfms::geometry::Point2;
use dsfms::pipeline::{
    Organ, OrganClick, OrganOptions, OrganOutline, OrganStroke, TemplateOptions, read_strokes,
};
use std::path::PathBuf;

/// Which part of the frames is the organ.
#[derive(Debug, Args)]
pub struct OrganArgs {
    /// Outlines of the organ in the frames, white = organ; in some of them is enough.
    #[arg(help_heading = "Organ", long, value_name = "DIR")]
    pub organ_masks: Option<PathBuf>,
    /// Outline of the organ on one frame, as FRAME:x,y,x,y,...; only the surface inside it stays.
    /// May be given for several frames.
    #[arg(help_heading = "Organ", long, value_name = "FRAME:X,Y,...", value_parser = parse_outline, conflicts_with_all = ["organ_masks", "mesh"])]
    pub organ_polygon: Vec<OrganOutline>,
    /// A pixel of one frame (the first, or X,Y@FRAME) that shows the organ; without it the organ is
    /// what the frames look at. Either way up to where depth steps, the surface folds inwards or
    /// colours change.
    #[arg(help_heading = "Organ", long, value_name = "X,Y[@FRAME]", value_parser = parse_click, conflicts_with = "mesh")]
    pub organ_click: Option<OrganClick>,
    /// A pixel of one frame that shows something else; may be given several times.
    #[arg(help_heading = "Organ", long, value_name = "X,Y[@FRAME]", value_parser = parse_click, conflicts_with_all = ["organ_polygon", "mesh"])]
    pub not_organ_click: Vec<OrganClick>,
    /// Strokes over the organ and over what is not, drawn on frames: a JSON file (see below).
    #[arg(help_heading = "Organ", long, value_name = "FILE", conflicts_with_all = ["organ_polygon", "mesh"])]
    pub organ_scribbles: Option<PathBuf>,
    /// Frames or a video of the deformed organ by the same camera, at most 24 of them are looked
    /// at: what moves apart is apart. They are no part of the template.
    #[arg(help_heading = "Organ", long, value_name = "DEFORMED", conflicts_with_all = ["organ_polygon", "mesh"])]
    pub also: Vec<PathBuf>,
    /// Keep what lies behind the organ too, as one surface.
    #[arg(help_heading = "Organ", long, conflicts_with_all = ["organ_masks", "organ_polygon", "organ_click", "not_organ_click", "organ_scribbles", "also", "mesh"])]
    pub whole: bool,
}

impl OrganArgs {
    /// Whether the options, or masks, say where the organ is.
    pub fn said(&self, options: &TemplateOptions) -> bool {
        matches!(options.organ, Organ::Shown(..)) || self.organ_masks.is_some()
    }

    /// What was said, over what the options say.
    pub fn apply(&self, options: &mut TemplateOptions) -> anyhow::Result<()> {
        let mut said = OrganOptions::from(std::mem::take(&mut options.organ));
        if !self.organ_polygon.is_empty() {
            said.outlines = self.organ_polygon.clone();
        }
        said.click = self.organ_click.clone().or(said.click);
        if let Some(path) = &self.organ_scribbles {
            said.strokes = read_strokes(path)?;
        }
        let not = |click| OrganStroke { organ: false, ..OrganStroke::from(click) };
        said.strokes.extend(self.not_organ_click.iter().map(not));
        said.whole |= self.whole;
        options.organ = said.into();
        Ok(())
    }
}

/// `FRAME:x,y,x,y,x,y…`
pub fn parse_outline(text: &str) -> Result<OrganOutline, String> {
    let expected = || format!("{text:?}; expected FRAME:x,y,x,y,x,y with three corners or more");
    let (frame, list) = text.rsplit_once(':').ok_or_else(expected)?;
    let numbers: Result<Vec<f64>, _> = list.split(',').map(|w| w.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|_| expected())?;
    let whole = numbers.len() >= 6 && numbers.len().is_multiple_of(2);
    if !whole || numbers.iter().any(|v| !v.is_finite()) {
        return Err(expected());
    }
    let corners = numbers.chunks(2).map(|p| Point2::new(p[0], p[1])).collect();
    Ok(OrganOutline { frame: frame.into(), corners })
}

/// `X,Y` or `X,Y@FRAME`
fn parse_click(text: &str) -> Result<OrganClick, String> {
    let expected = || format!("{text:?}; expected X,Y or X,Y@FRAME (px)");
    let (place, frame) = match text.split_once('@') {
        Some((place, frame)) if !frame.is_empty() => (place, Some(frame.to_string())),
        Some(_) => return Err(expected()),
        None => (text, None),
    };
    let (x, y) = place.split_once(',').ok_or_else(expected)?;
    let number = |w: &str| w.trim().parse::<f64>().ok().filter(|v| v.is_finite());
    let pixel = number(x).zip(number(y)).ok_or_else(expected)?;
    Ok(OrganClick { frame, pixel: Point2::new(pixel.0, pixel.1) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_click_may_name_its_frame() {
        let pixel = Point2::new(320.0, 2.5);
        assert_eq!(parse_click("320,2.5"), Ok(OrganClick { frame: None, pixel }));
        let frame = Some("a@b.png".to_string());
        assert_eq!(parse_click("320, 2.5@a@b.png"), Ok(OrganClick { frame, pixel }));
        for bad in ["320", "320,x", "320,2@", "@a"] {
            assert!(parse_click(bad).unwrap_err().contains("X,Y"), "{bad}");
        }
    }
}
