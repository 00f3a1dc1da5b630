//! Which part of the frames is the organ: what is taken, and what else may be meant.

use super::also;
use super::click::OrganClick;
use super::error::TemplateError;
use super::guess::{OrganGuess, guess_of};
use super::organ::Organ;
use super::organ_scene::OrganScene;
use super::registered::RegisteredFrames;
use super::strokes::{OrganStroke, seeds};
use crate::dense::{
    DenseError, DenseOptions, DepthMap, Labelling, Parting, PosedFrame, Seeds, overlap, surface,
};
use crate::geometry::Point3;
use crate::image::Mask;
use crate::image::distance::distance_to;
use crate::mesh::Mesh;
use crate::mesh::remesh::remesh;

/// Where the organ ends, as found in the frames.
#[derive(Clone, Debug)]
pub struct FoundOrgan {
    /// The likeliest.
    pub guess: OrganGuess,
    /// Whether the template holds it only, or all that stereo saw.
    pub taken: bool,
    /// What else may be meant, where that is open; see [`Self::open`].
    pub others: Vec<OrganGuess>,
}

impl FoundOrgan {
    /// Whether the user has to say what is meant.
    pub fn open(&self) -> bool {
        !self.taken || !self.others.is_empty()
    }

    /// All that may be meant, the likeliest first.
    pub fn guesses(&self) -> impl Iterator<Item = &OrganGuess> {
        std::iter::once(&self.guess).chain(&self.others)
    }
}

/// What the frames tell of the organ.
#[derive(Default)]
pub(super) struct ToldOrgan {
    /// See [`super::BuiltTemplate::organ`].
    pub(super) organ: Option<FoundOrgan>,
    /// The surface around it.
    pub(super) around: Option<Mesh>,
    /// By what it was told; `None` where nobody asked the frames.
    pub(super) scene: Option<OrganScene>,
}

/// Depth pixels of a frame by which the organ is told, at most: about as many as the labelling
/// looks at.
const COARSE: usize = 20_000;
/// And at least, all frames together: stereo on less finds nothing.
const COARSE_ALL: usize = 1000;
/// Shares of the outline found. Where depth steps along less, all is one surface; where more is
/// marked, it is the organ's. On eight generated scenes and the rendered one they are 0.5 to 0.8
/// and 0.97 to 0.99 with stereo at half the resolution, and 0.45 or more with the coarse stereo
/// used here; where one smooth surface fills the frames nothing is found
/// (`docs/results/parting.md`).
const STEPPING: f64 = 0.2;
const MARKED: f64 = 0.8;
/// Where the usual prior finds nothing, another's part is shown if depth steps along as much of its
/// outline.
const CLEAR: f64 = 0.4;
/// Other parts that are shown, at most.
const OTHERS: usize = 2;
/// A click gives a part if what it gives overlaps with it by as much.
const GIVES: f64 = 0.9;
/// Vertices of the surface around the organ, over those of the organ, since it is larger: with as
/// many its sparse points lie 0.4 mm off it in the median (clip of seed 21). The camera is told no
/// better with four times as many.
const AROUND: usize = 4;
/// Vertices of the surface around the organ before it is remeshed, over those it has then: coarse
/// stereo shows no more.
const FINER: usize = 4;

impl RegisteredFrames<'_> {
    /// The organ as the frames tell it from what lies behind, and that; see
    /// [`super::BuiltTemplate::organ`].
    pub(super) fn organ(&self, options: &DenseOptions) -> Result<ToldOrgan, TemplateError> {
        if self.said() {
            return Ok(ToldOrgan::default());
        }
        let coarse = self.coarser(options);
        let maps = self.stereo(&self.views, &coarse, "coarse stereo")?;
        let clicked =
            matches!(&self.options.organ, Organ::Shown(Some(_), strokes) if strokes.is_empty());
        let scene = self.kept(&maps);
        if clicked && self.piece_alone(&maps, &coarse)? {
            return Ok(ToldOrgan { scene: Some(scene), ..ToldOrgan::default() });
        }
        self.progress.step("organ", 0, 1);
        let found = self.outlined(&maps, scene, &coarse);
        self.progress.step("organ", 1, 1);
        found
    }

    /// Whether the user says in every frame where the organ ends, or wants everything.
    fn said(&self) -> bool {
        let masks = self.views.iter().all(|view| view.organ.is_some());
        masks || matches!(self.options.organ, Organ::Outlined(..) | Organ::Whole)
    }

    /// Stereo on no more pixels than the labelling reads, of small frames on half their width and
    /// height, as the surface itself: enough to tell the organ from what lies behind.
    fn coarser(&self, options: &DenseOptions) -> DenseOptions {
        let few = |view: &PosedFrame| (view.frame.rgb.len() / 4).min(COARSE);
        let pixels = self.views.iter().map(few).sum::<usize>().max(COARSE_ALL);
        DenseOptions { max_pixels: pixels.min(options.max_pixels), ..options.clone() }
    }

    /// Whether the piece clicked is the smaller part of what was seen and hangs on nothing else:
    /// its own rim is then nearer the truth than an outline found in images.
    fn piece_alone(&self, maps: &[DepthMap], options: &DenseOptions) -> Result<bool, DenseError> {
        let seen = surface(&self.views, maps, options)?.mesh;
        let all = seen.topology.faces.len();
        Ok(self.piece(seen).is_ok_and(|piece| 2 * piece.topology.faces.len() < all))
    }

    /// Where the organ ends before something else (the wall of a cavity), and the surface of that.
    /// It is what was clicked or drawn, what masks of some frames show, or else what the frames
    /// look at; and then it is taken only if its outline is marked.
    fn outlined(
        &self,
        maps: &[DepthMap],
        scene: OrganScene,
        options: &DenseOptions,
    ) -> Result<ToldOrgan, TemplateError> {
        let seeds = seeds(&scene.strokes, &self.named, maps, self.camera)?;
        let parting = Parting::new(&self.views, maps, &seeds, &scene.moved);
        let own = parting.best();
        let said = seeds != Seeds::default() || self.views.iter().any(|view| view.organ.is_some());
        let sure = said || own.stepping >= STEPPING && own.marked >= MARKED;
        let mut parts = vec![own];
        if !sure {
            parts.extend(parting.others(&parts[0], OTHERS));
            let clear = |part: &Labelling| part.stepping >= CLEAR && part.marked >= MARKED;
            if parts[0].stepping < STEPPING {
                if !parts.iter().any(clear) {
                    self.progress.warn(
                        "depth steps along little of any outline: all that was seen is taken for the organ",
                    );
                    return Ok(ToldOrgan { scene: Some(scene), ..ToldOrgan::default() });
                }
                // Nothing ends there: what another prior found does.
                parts.remove(0);
            }
        }
        let mut guesses = self.guesses(&parts, maps, (!sure).then_some(&scene.moved));
        let guess = guesses.remove(0);
        let taken = guess.masks.len() >= 2 && sure;
        let found = FoundOrgan { guess, taken, others: guesses };
        if !said || !taken {
            self.progress.warn(&found.told(said));
        }
        let around = taken.then(|| self.around(&parts[0].masks, maps, options)).flatten();
        Ok(ToldOrgan { organ: Some(found), around, scene: Some(scene) })
    }

    /// By what the organ is told: depth, what moved, and what was clicked and drawn.
    fn kept(&self, maps: &[DepthMap]) -> OrganScene {
        let click = self.options.organ.click().map(OrganStroke::from);
        let drawn = click.into_iter().chain(self.options.organ.strokes().iter().cloned());
        let on_its_frame = |stroke: OrganStroke| match stroke.frame_of(&self.named) {
            Ok((name, _)) => OrganStroke { frame: Some(name.to_string()), ..stroke },
            Err(_) => stroke,
        };
        let mut scene = OrganScene::among(&self.named, &self.views, maps, self.camera);
        scene.moved = also::moved(self.exploration, self.sparse, &self.options.sfm);
        scene.strokes = drawn.map(on_its_frame).collect();
        scene
    }

    /// Labellings as outlines in the frames; where it is open what is meant, with a click for each,
    /// under what is known to have `moved`.
    fn guesses(
        &self,
        parts: &[Labelling],
        maps: &[DepthMap],
        moved: Option<&Vec<(Point3, f64)>>,
    ) -> Vec<OrganGuess> {
        let guess = |(i, part): (usize, &Labelling)| {
            let click = moved.and_then(|moved| self.click_for(i, parts, maps, moved));
            guess_of(part, &self.views, maps, click)
        };
        parts.iter().enumerate().map(guess).collect()
    }

    /// A click that gives one of several labellings, tried.
    fn click_for(
        &self,
        own: usize,
        parts: &[Labelling],
        maps: &[DepthMap],
        moved: &[(Point3, f64)],
    ) -> Option<OrganClick> {
        let others: Vec<&Labelling> =
            parts.iter().enumerate().filter(|(i, _)| *i != own).map(|(_, part)| part).collect();
        let (view, place) = deepest(&parts[own], &others, maps)?;
        let map = &maps[view];
        let point = map.pose.inverse() * map.point(place);
        let seeds = Seeds { organ: vec![point], other: Vec::new() };
        let given = Parting::new(&self.views, maps, &seeds, moved).best();
        let pixel = self.views[view].pixel_of(&point)?;
        let frame = Some(self.views[view].frame.name.clone());
        let gives = overlap(&given.masks, &parts[own].masks) >= GIVES;
        gives.then(|| OrganClick { frame, pixel: pixel.map(f64::round) })
    }

    /// The surface around the organ, as coarse stereo saw it.
    fn around(&self, organ: &[Mask], maps: &[DepthMap], options: &DenseOptions) -> Option<Mesh> {
        let bare = |view: &PosedFrame<'_>| -> bool { view.organ.is_none() };
        let kept: Vec<usize> = (0..maps.len()).filter(|&i| bare(&self.views[i])).collect();
        let views: Vec<PosedFrame> = kept.iter().map(|&i| self.views[i]).collect();
        let rest = |&i: &usize| {
            let mut map = maps[i].clone();
            map.leave_out(&organ[i]);
            map
        };
        let maps: Vec<DepthMap> = kept.iter().map(rest).collect();
        let vertices = AROUND * self.options.vertices;
        let options = DenseOptions { target_vertices: Some(FINER * vertices), ..options.clone() };
        let seen = surface(&views, &maps, &options).ok()?;
        remesh(&seen.mesh, vertices, &self.options.remesh).ok()
    }
}

impl FoundOrgan {
    /// What is to be told of it.
    fn told(&self, said: bool) -> String {
        let percent = 100.0 * self.guess.marked;
        match (said, self.taken) {
            (true, _) => "what was said of the organ leaves nothing of it in two frames or more; all that was seen \
                          is kept"
                .into(),
            (_, true) => format!(
                "nothing says where the organ is: it is taken to be what the frames look at ({percent:.0} % of its \
                 outline is marked by depth, a fold or the image)"
            ),
            (_, false) => format!(
                "where the organ ends is open: {percent:.0} % of what may be its outline is marked by depth, a fold \
                 or the image, and {} be meant too; all that was seen is kept",
                match self.others.len() {
                    0 => "all of it may".to_string(),
                    1 => "another part may".to_string(),
                    n => format!("{n} other parts may"),
                }
            ),
        }
    }
}

/// The view and the place in its depth map, with depth, that lie deepest in what only `own` holds,
/// or, where that is little, in what it holds.
fn deepest(own: &Labelling, others: &[&Labelling], maps: &[DepthMap]) -> Option<(usize, usize)> {
    let only = |i: usize| {
        let not = others.iter().map(|other| other.masks[i].complement());
        not.fold(own.masks[i].clone(), |mask, not| mask.and(&not))
    };
    let find = |mask: &dyn Fn(usize) -> Mask| {
        let places = (0..maps.len()).flat_map(|i| {
            let mask = mask(i);
            let depth = inside(&mask);
            let best = (0..depth.len()).filter(|&p| maps[i].depth[p] > 0.0 && mask.data[p]);
            best.max_by(|&p, &q| depth[p].total_cmp(&depth[q]).then(q.cmp(&p)))
                .map(|p| (depth[p], i, p))
        });
        // Of equals the first.
        places.max_by(|a, b| a.0.total_cmp(&b.0).then((b.1, b.2).cmp(&(a.1, a.2))))
    };
    let alone = find(&only).filter(|(depth, ..)| *depth >= LEAST_INSIDE);
    let found = alone.or_else(|| find(&|i| own.masks[i].clone()))?;
    Some((found.1, found.2))
}

/// Px of the depth grid by which a click must lie inside a part.
const LEAST_INSIDE: f32 = 4.0;

/// Px to the nearest pixel outside of the mask or the frame.
fn inside(mask: &Mask) -> Vec<f32> {
    let [w, h] = mask.size;
    let away = distance_to(&mask.complement());
    let within = |(p, &away): (usize, &f32)| {
        let (x, y) = (p % w, p / w);
        away.min((x + 1).min(w - x).min(y + 1).min(h - y) as f32)
    };
    away.data.iter().enumerate().map(within).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_inside_is_that_to_the_rim_and_to_the_edge_of_the_frame() {
        let data = (0..35).map(|p| p != 17).collect();
        let depth = inside(&Mask { size: [7, 5], data });
        assert_eq!(
            [depth[0], depth[17], depth[16], depth[15], depth[8]],
            [1.0, 0.0, 1.0, 2.0, 2.0]
        );
    }

    #[test]
    fn a_click_lies_where_only_its_own_part_is() {
        let mask = |columns: std::ops::Range<usize>| {
            let data = (0..600).map(|p| columns.contains(&(p % 30))).collect();
            vec![Mask { size: [30, 20], data }]
        };
        let part = |masks| Labelling { masks, stepping: 1.0, marked: 1.0, borders: vec![vec![]] };
        let map = crate::dense::DepthMap {
            camera: crate::camera::CameraModel::pinhole([30, 20], [20.0; 2], [15.0, 10.0]),
            pose: crate::geometry::Isometry::identity(),
            depth: vec![5.0; 600],
            normal: vec![[0.0, 0.0, -1.0]; 600],
            sigma: vec![0.1; 600],
            confidence: vec![1.0; 600],
        };
        let (wide, narrow) = (part(mask(0..25)), part(mask(0..12)));
        let column = |own, others: &[&Labelling]| {
            deepest(own, others, std::slice::from_ref(&map)).unwrap().1 % 30
        };
        assert!((16..21).contains(&column(&wide, &[&narrow])));
        assert!((4..8).contains(&column(&narrow, &[&wide])));
    }
}
