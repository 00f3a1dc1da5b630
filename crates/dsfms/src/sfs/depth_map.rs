//! The depth map by Levenberg–Marquardt on ln depth.

use super::grid::{PixelCell, PixelGrid};
use super::options::SfsOptions;
use super::rows::{ShadingRow, step};
use crate::geometry::{Point3, area_normal};
use crate::light::{Light, LightModel};
use crate::solver::{Loss, Options, Problem, Step, Summary, minimize};

const LABELS: [&str; 3] = ["shading (SfS)", "smoothing (SfS)", "border depth (SfS)"];
/// Largest change of ln depth in one step.
const MAX_STEP: f64 = 0.2;

/// ln depth of every node, and how it was found.
pub(super) fn solve(
    grid: &PixelGrid,
    light: &LightModel,
    options: &SfsOptions,
) -> (Vec<f64>, Summary) {
    let mut map = LogDepths { grid, light, options, rows: Vec::new() };
    let start = map.start();
    let limits = Options {
        max_steps: options.max_iterations,
        cost_tolerance: 1e-4,
        initial_damping: 1e-2,
        fastest: 1.0,
        ..Options::default()
    };
    minimize(&mut map, start, &limits)
}

struct LogDepths<'a> {
    grid: &'a PixelGrid,
    light: &'a LightModel,
    options: &'a SfsOptions,
    /// At the last linearisation.
    rows: Vec<ShadingRow>,
}

impl Problem for LogDepths<'_> {
    type State = Vec<f64>;

    fn costs(&self, u: &Vec<f64>) -> Option<Vec<f64>> {
        let costs = self.terms(u);
        costs.iter().all(|cost| cost.is_finite()).then(|| costs.to_vec())
    }

    fn labels(&self) -> Vec<&'static str> {
        LABELS.to_vec()
    }

    fn linearise(&mut self, u: &Vec<f64>) -> f64 {
        self.rows = self.rows(u);
        f64::INFINITY
    }

    fn step(&mut self, damping: f64) -> Option<Step> {
        step(&self.rows, self.grid.sightlines.len(), damping)
    }

    fn retract(&self, u: &Vec<f64>, delta: &[f64]) -> Vec<f64> {
        u.iter().zip(delta).map(|(u, d)| u + d.clamp(-MAX_STEP, MAX_STEP)).collect()
    }
}

impl LogDepths<'_> {
    /// The mean depth, bulging a little towards the camera: organs do, and a flat start could not
    /// tell a hill from a hollow.
    fn start(&self) -> Vec<f64> {
        let (mean, bulge) = (self.grid.mean_depth.ln(), self.options.start_bulge);
        let dome = |t: &f64| 1.0 - (1.0 - t) * (1.0 - t);
        self.grid.inwardness.iter().map(|t| mean - bulge * (dome(t) - 0.5)).collect()
    }

    /// Brightness residual of a cell over its noise; the light of a cell turned away is 0.
    fn shading(&self, cell: &PixelCell, u: [f64; 3]) -> f64 {
        let corner =
            |k: usize| Point3::from(self.grid.sightlines[cell.nodes[k] as usize] * u[k].exp());
        let [a, b, c] = [corner(0), corner(1), corner(2)];
        let normal = area_normal(&a, &b, &c).try_normalize(0.0).unwrap_or_default();
        let centre = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let predicted = self.grid.gain * cell.albedo * self.light.shade(&centre, &normal).value;
        (predicted - cell.brightness) / (self.options.relative_noise * self.grid.median_brightness)
    }

    fn gathered(cell: &PixelCell, u: &[f64]) -> [f64; 3] {
        cell.nodes.map(|n| u[n as usize])
    }

    fn second_difference(&self, t: [u32; 3], u: &[f64]) -> f64 {
        u[t[0] as usize] - 2.0 * u[t[1] as usize] + u[t[2] as usize]
    }

    fn smoothing_weight(&self) -> f64 {
        (self.options.curvature * self.grid.angular_step.powi(2)).powi(-2)
    }

    fn border_residuals<'b>(&'b self, u: &'b [f64]) -> impl Iterator<Item = (usize, f64)> + 'b {
        let mean = self.grid.mean_depth.ln();
        let nodes = self.grid.border.iter().enumerate().filter(|(_, b)| **b);
        nodes.map(move |(i, _)| (i, u[i] - mean))
    }

    fn terms(&self, u: &[f64]) -> [f64; 3] {
        let loss = Loss::Huber(2.0);
        let shading =
            |c: &PixelCell| loss.evaluate(self.shading(c, Self::gathered(c, u)).powi(2)).0;
        let smooth = |t: &[u32; 3]| self.second_difference(*t, u).powi(2);
        [
            self.grid.cells.iter().map(shading).sum(),
            self.smoothing_weight() * self.grid.triples.iter().map(smooth).sum::<f64>(),
            self.border_residuals(u).map(|(_, r)| r * r).sum::<f64>()
                / self.options.border_sigma.powi(2),
        ]
    }

    fn rows(&self, u: &[f64]) -> Vec<ShadingRow> {
        let smooth = self.smoothing_weight();
        let border = self.options.border_sigma.powi(-2);
        let shading = self.grid.cells.iter().map(|cell| self.shading_row(cell, u));
        let smoothing = self.grid.triples.iter().map(|&t| ShadingRow {
            index: t,
            slope: [1.0, -2.0, 1.0],
            residual: self.second_difference(t, u),
            weight: smooth,
        });
        let border = self.border_residuals(u).map(|(i, residual)| ShadingRow {
            index: [i as u32; 3],
            slope: [1.0, 0.0, 0.0],
            residual,
            weight: border,
        });
        shading.chain(smoothing).chain(border).collect()
    }

    fn shading_row(&self, cell: &PixelCell, u: &[f64]) -> ShadingRow {
        /// Half the step of the central difference, of the logarithm of depth: between rounding and
        /// curvature.
        const H: f64 = 1e-6;
        let at = Self::gathered(cell, u);
        let moved = |k: usize, h: f64| {
            let mut moved = at;
            moved[k] += h;
            self.shading(cell, moved)
        };
        let residual = self.shading(cell, at);
        let slope = std::array::from_fn(|k| (moved(k, H) - moved(k, -H)) / (2.0 * H));
        let weight = Loss::Huber(2.0).evaluate(residual * residual).1;
        ShadingRow { index: cell.nodes, slope, residual, weight }
    }
}
