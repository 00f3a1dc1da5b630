//! What the organ is, as the user says it.

use super::click::OrganClick;
use super::outline::OrganOutline;
use super::strokes::OrganStroke;
use serde::{Deserialize, Serialize};

/// Which part of the frames is the organ. Masks of frames ([`super::Exploration::organ`]) hold
/// beside it; where every frame has one, the frames are not asked.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "OrganOptions", into = "OrganOptions")]
pub enum Organ {
    /// What the frames look at, if its outline is marked; else all that stereo saw.
    #[default]
    LookedAt,
    /// All that stereo saw.
    Whole,
    /// What lies inside these outlines, and of that the connected surface that was clicked, if any
    /// was.
    Outlined(Vec<OrganOutline>, Option<OrganClick>),
    /// What a click or strokes, which may also show what it is not, are on.
    Shown(Option<OrganClick>, Vec<OrganStroke>),
}

impl Organ {
    /// Outlines on frames.
    pub fn outlines(&self) -> &[OrganOutline] {
        match self {
            Self::Outlined(outlines, _) => outlines,
            _ => &[],
        }
    }

    /// A pixel that shows the organ.
    pub fn click(&self) -> Option<&OrganClick> {
        match self {
            Self::Outlined(_, click) | Self::Shown(click, _) => click.as_ref(),
            _ => None,
        }
    }

    /// What was drawn on frames.
    pub fn strokes(&self) -> &[OrganStroke] {
        match self {
            Self::Shown(_, strokes) => strokes,
            _ => &[],
        }
    }

    /// Whether one connected piece is named, which need not be the largest.
    pub(super) fn names_a_piece(&self) -> bool {
        matches!(self, Self::Outlined(..) | Self::Shown(Some(_), _))
    }
}

/// [`Organ`] as a file of options says it: where several fields do, outlines come before clicks and
/// strokes, and `whole` is last.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OrganOptions {
    /// The organ as outlined on frames; empty = masks alone say what is organ.
    pub outlines: Vec<OrganOutline>,
    /// A pixel that shows the organ: the connected surface there stays.
    pub click: Option<OrganClick>,
    /// Pixels that show the organ, and such that do not, as drawn on frames.
    pub strokes: Vec<OrganStroke>,
    /// Keep what lies behind the organ too, where depth steps and no mask, outline or click tells
    /// them apart.
    pub whole: bool,
}

impl From<OrganOptions> for Organ {
    fn from(said: OrganOptions) -> Self {
        let OrganOptions { outlines, click, strokes, whole } = said;
        match (outlines.is_empty(), click.is_some() || !strokes.is_empty(), whole) {
            (false, ..) => Self::Outlined(outlines, click),
            (_, true, _) => Self::Shown(click, strokes),
            (.., true) => Self::Whole,
            (.., false) => Self::LookedAt,
        }
    }
}

impl From<Organ> for OrganOptions {
    fn from(organ: Organ) -> Self {
        let none = Self::default();
        match organ {
            Organ::LookedAt => none,
            Organ::Whole => Self { whole: true, ..none },
            Organ::Outlined(outlines, click) => Self { outlines, click, ..none },
            Organ::Shown(click, strokes) => Self { click, strokes, ..none },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::TemplateOptions;

    #[test]
    fn a_file_says_it_in_a_table_or_where_earlier_versions_did() {
        let organ = |text: &str| TemplateOptions::from_toml(text).map(|options| options.organ);
        assert_eq!(organ("").unwrap(), Organ::LookedAt);
        assert_eq!(organ("[organ]\nwhole = true").unwrap(), Organ::Whole);
        assert_eq!(organ("whole = true").unwrap(), Organ::Whole);
        let clicked = organ("[organ.click]\npixel = [3.0, 4.0]").unwrap();
        assert_eq!(organ("whole = true\n[click]\npixel = [3.0, 4.0]").unwrap(), clicked);
        assert_eq!(clicked.click().unwrap().pixel, [3.0, 4.0].into());
        assert!(clicked.names_a_piece() && !Organ::Whole.names_a_piece());
        let outlined = organ("outlines = [{ frame = \"a\", corners = [[1.0, 2.0]] }]").unwrap();
        assert_eq!((outlined.outlines().len(), outlined.strokes().len()), (1, 0));
        let again: Organ = OrganOptions::from(outlined.clone()).into();
        assert_eq!(again, outlined);
        assert!(organ("[organ]\nwide = 1").unwrap_err().to_string().contains("wide"));
    }
}
