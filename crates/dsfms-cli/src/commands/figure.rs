//! `dsfms figure`: a plate for a paper.

use crate::draw::{self, CIVIDIS, SideView};
use crate::exit::{Outcome, Usage};
use crate::figure::panel::{Layer, Row, Scale, View, camera, panel, reach};
use crate::figure::{Anchor, Item, Sheet, TEXT, text_width};
use crate::outputs::{prepare_for, write_png, write_text};
use crate::report::chart::nice;
use crate::report::folder::{Column, columns};
use anyhow::Context;
use clap::{Args, ValueEnum};
use dsfms::io::mesh::{MeshFile, MeshUnit, read_mesh};
use dsfms::io::names::frame_number;
use dsfms::io::template::read_template;
use dsfms::mesh::Mesh;
use dsfms::template::Template;
use image::RgbImage;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  # One frame, shaded, from the laparoscope and from the side
  dsfms figure out --frame 3 -o frame3.png
  # All methods of the demo with their error against the truth, as SVG
  dsfms figure dsfms-demo --frame 4 --truth dsfms-demo/truth/frame_004.ply \\
      -o methods.svg
  # All around, with the structures that were carried along
  dsfms figure out --frame 3 --turntable 8 -o turn.png
  # A mesh with the albedo of its template
  dsfms figure out/frame_003.ply --template organ.template \\
      --views front,side,above -o organ.png

Where the frames say which vertices the camera saw (output folders do), the
rest of the shape is grey: nothing but the template speaks of it. Hidden
structures show through the shape, fainter the deeper. Rows are methods (output
folders), columns views of the shape, of the albedo (with --template) and of
the error (with --truth) or, where the frames have one, of the expected error.
The truth must have the vertices of the frames. Errors are distances from
vertex to vertex, without alignment.";

/// Draw a publication figure of one frame.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct FigureArgs {
    /// Output folders (or a folder of them), or mesh files.
    #[arg(required = true, value_name = "OUT_OR_MESH")]
    paths: Vec<PathBuf>,
    /// Number of the frame in output folders; default the first.
    #[arg(long, value_name = "N")]
    frame: Option<u64>,
    /// True mesh of this frame: same vertices, camera axes.
    #[arg(long, value_name = "MESH")]
    truth: Option<PathBuf>,
    /// Template, for its albedo.
    #[arg(long, value_name = "TEMPLATE")]
    template: Option<PathBuf>,
    /// Views, in order.
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["front", "side"])]
    views: Vec<ViewName>,
    /// So many views all around, from the laparoscope's on, instead of --views.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=36), conflicts_with = "views")]
    turntable: Option<u32>,
    /// Leave out the hidden structures that lie in OUT/structures.
    #[arg(long)]
    no_structures: bool,
    /// Side of a panel, px.
    #[arg(long, value_name = "PX", default_value_t = 480, value_parser = clap::value_parser!(u32).range(120..=2000))]
    panel: u32,
    /// Error at the upper end of the colour bar; default a round number that covers 98 %.
    #[arg(long, value_name = "LENGTH")]
    max: Option<f64>,
    /// Picture to write; .png or .svg.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ViewName {
    /// As the laparoscope looks.
    Front,
    /// From the right, 65 degrees.
    Side,
    /// From the left, 65 degrees.
    Left,
    /// From above, 65 degrees.
    Above,
    /// From behind.
    Back,
}

impl ViewName {
    fn view(self) -> View {
        let (yaw, pitch, name) = match self {
            Self::Front => (0.0, 0.0, "front"),
            Self::Side => (65.0, 0.0, "side"),
            Self::Left => (-65.0, 0.0, "left side"),
            Self::Above => (0.0, 65.0, "above"),
            Self::Back => (180.0, 0.0, "back"),
        };
        View { yaw, pitch, name: name.into() }
    }
}

impl FigureArgs {
    /// What is looked at from where.
    fn all_views(&self) -> Vec<View> {
        let turn = |k: u32, n: u32| {
            let yaw = 360.0 * f64::from(k) / f64::from(n);
            View { yaw, pitch: 0.0, name: format!("{yaw:.0} degrees") }
        };
        match self.turntable {
            Some(n) => (0..n).map(|k| turn(k, n)).collect(),
            None => self.views.iter().map(|v| v.view()).collect(),
        }
    }
}

const MARGIN: u32 = 16;
const UNSEEN: &str = "grey: not seen";

/// Run the command.
pub fn run(args: &FigureArgs) -> anyhow::Result<Outcome> {
    let extension = args.output.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !matches!(extension.as_str(), "png" | "svg") {
        let text =
            format!("-o {}: expected a name that ends in .png or .svg", args.output.display());
        return Err(Usage(text).into());
    }
    let rows = rows(args)?;
    let template = args.template.as_deref().map(read_template).transpose()?;
    let sheet = sheet(args, &rows, template.as_ref())?;
    prepare_for(&args.output)?;
    match extension.as_str() {
        "png" => write_png(&args.output, &sheet.pixels())?,
        _ => write_text(&args.output, &sheet.svg()?)?,
    }
    Ok(Outcome::Ok)
}

fn rows(args: &FigureArgs) -> anyhow::Result<Vec<Row>> {
    let truth = args.truth.as_deref().map(read_mesh).transpose()?;
    let mut unit = truth.as_ref().and_then(|truth| truth.unit);
    let first = if unit.is_some() { "the truth" } else { "the first mesh" };
    let mut rows = Vec::new();
    for path in &args.paths {
        let label = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let found = match path.is_dir() {
            true => columns(path)?,
            false => vec![Column { name: label(), paths: vec![path.clone()] }],
        };
        if found.is_empty() {
            anyhow::bail!("{} holds no frame_NNN.ply", path.display());
        }
        for column in found {
            let chosen = choose(&column, path, args.frame)?;
            let mut file = read_mesh(chosen)?;
            // One colour bar for all rows: one unit, that of the truth or of the first row.
            unit = unit.or(file.unit);
            if let Some(unit) = unit {
                let of = || format!("{}: its unit and that of {first}", chosen.display());
                file = file.in_unit(unit).with_context(of)?;
            }
            let values = match &truth {
                Some(truth) => Some(errors(&file, truth, &column.name)?),
                None => file.attributes.get("expected_error").cloned(),
            };
            let structures = match args.no_structures {
                true => Vec::new(),
                false => buried(chosen)?,
            };
            rows.push(Row { name: column.name, file, values, structures });
        }
    }
    Ok(rows)
}

fn choose<'a>(column: &'a Column, path: &Path, frame: Option<u64>) -> anyhow::Result<&'a PathBuf> {
    let number = |p: &PathBuf| frame_number(&p.file_stem().unwrap_or_default().to_string_lossy());
    match frame {
        Some(n) if path.is_dir() => {
            column.paths.iter().find(|p| number(p) == Some(n)).with_context(|| {
                let held: Vec<u64> = column.paths.iter().filter_map(number).collect();
                format!("{} holds no frame {n}; it holds {}", column.name, runs(&held))
            })
        }
        _ => Ok(&column.paths[0]),
    }
}

/// Ascending numbers as runs: `0-3, 7`.
fn runs(numbers: &[u64]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run.iter().map(u64::to_string).collect(),
    });
    runs.collect::<Vec<_>>().join(", ")
}

/// `structures/frame_NNN_*.ply` beside a frame.
fn buried(frame: &Path) -> anyhow::Result<Vec<Mesh>> {
    let stem = frame.file_stem().unwrap_or_default().to_string_lossy();
    let Ok(entries) = std::fs::read_dir(frame.with_file_name("structures")) else {
        return Ok(Vec::new());
    };
    let own = |p: &PathBuf| {
        let name = p.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(&format!("{stem}_")) && name.ends_with(".ply")
    };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(own).collect();
    paths.sort();
    paths.iter().map(|p| Ok(read_mesh(p)?.mesh)).collect()
}

fn errors(file: &MeshFile, truth: &MeshFile, name: &str) -> anyhow::Result<Vec<f64>> {
    let (found, known) = (&file.mesh.positions, &truth.mesh.positions);
    if found.len() != known.len() {
        anyhow::bail!(
            "{name} has {} vertices and the truth {}; both must have the same, in the same order",
            found.len(),
            known.len()
        );
    }
    Ok(found.iter().zip(known).map(|(a, b)| (a - b).norm()).collect())
}

fn sheet(args: &FigureArgs, rows: &[Row], template: Option<&Template>) -> anyhow::Result<Sheet> {
    let mut layers = vec![Layer::Shape];
    if let Some(template) = template {
        let fits = |r: &Row| r.file.mesh.topology.faces == template.mesh.topology.faces;
        if template.albedo.is_none() {
            anyhow::bail!("the template holds no albedo; leave --template out");
        }
        if let Some(row) = rows.iter().find(|r| !fits(r)) {
            anyhow::bail!("{} has other faces than the template", row.name);
        }
        layers.push(Layer::Albedo);
    }
    if rows.iter().any(|r| r.values.is_some()) {
        layers.push(Layer::Error);
    }
    let limit = args.max.unwrap_or_else(|| usual_limit(rows));
    let views = args.all_views();
    let scale = Scale { panel: args.panel, limit, reach: reach(&views, rows) };
    let cells: Vec<(Layer, &View)> =
        layers.iter().flat_map(|&l| views.iter().map(move |v| (l, v))).collect();
    let grid = Grid::of(args, rows, cells.len() as u32);
    let mut items = titles(args, &grid, &cells, rows);
    let places: Vec<(u32, u32)> =
        (0..rows.len() as u32).flat_map(|r| (0..cells.len() as u32).map(move |c| (r, c))).collect();
    let panels: Vec<RgbImage> = places
        .par_iter()
        .map(|&(r, c)| panel(&rows[0], &rows[r as usize], cells[c as usize], template, scale))
        .collect();
    for (&(r, c), picture) in places.iter().zip(panels) {
        items.push(Item::Picture { at: grid.at(r, c), picture });
    }
    let [width, bottom] = grid.size(rows.len() as u32);
    let unit = unit_of(&rows[0].file);
    let view = camera(&rows[0], &views[0], args.panel as usize, scale.reach);
    scale_bar(args, view, [grid.left, bottom], unit, &mut items);
    if layers.contains(&Layer::Error) {
        colour_bar(width, bottom, args.panel, limit, unit, &mut items);
    }
    let wide = width > 4 * text_width(UNSEEN);
    if wide && rows.iter().any(|r| r.file.attributes.contains_key("visible")) {
        let at = [width * 2 / 5, bottom + 14];
        items.push(Item::Text { at, anchor: Anchor::Middle, text: UNSEEN.into() });
    }
    Ok(Sheet { size: [width, bottom + 2 * TEXT + MARGIN], items })
}

/// Most panels of a turntable side by side.
const TURNTABLE_ACROSS: u32 = 6;

/// Where the panels lie, px.
struct Grid {
    left: u32,
    top: u32,
    across: u32,
    /// Lines of panels that a row takes.
    down: u32,
    step: [u32; 2],
}

impl Grid {
    fn of(args: &FigureArgs, rows: &[Row], cells: u32) -> Self {
        let names = rows.iter().map(|r| text_width(&r.name)).max().unwrap_or(0);
        let turning = args.turntable.is_some();
        let across = if turning { cells.min(TURNTABLE_ACROSS) } else { cells };
        let title = TEXT + 8;
        Self {
            left: if rows.len() > 1 { names + 2 * MARGIN } else { MARGIN },
            top: MARGIN + title,
            across,
            down: cells.div_ceil(across),
            // Every panel of a turntable has its own title.
            step: [args.panel + MARGIN, args.panel + MARGIN + if turning { title } else { 0 }],
        }
    }

    fn at(&self, row: u32, cell: u32) -> [u32; 2] {
        let line = row * self.down + cell / self.across;
        [self.left + cell % self.across * self.step[0], self.top + line * self.step[1]]
    }

    /// Right and lower end of `rows` rows.
    fn size(&self, rows: u32) -> [u32; 2] {
        let [x, y] = self.step;
        [self.left + self.across * x, self.top + rows * self.down * y]
    }
}

/// Names of the columns and of the rows.
fn titles(args: &FigureArgs, grid: &Grid, cells: &[(Layer, &View)], rows: &[Row]) -> Vec<Item> {
    let mut items = Vec::new();
    let lines = if args.turntable.is_some() { rows.len() as u32 } else { 1 };
    for (r, (c, (layer, view))) in
        (0..lines).flat_map(|r| (0..).zip(cells).map(move |cell| (r, cell)))
    {
        let what = match layer {
            Layer::Shape => "shape",
            Layer::Albedo => "albedo",
            Layer::Error if args.truth.is_some() => "error",
            Layer::Error => "expected error",
        };
        let [x, y] = grid.at(r, c);
        items.push(Item::Text {
            at: [x + args.panel / 2, y - TEXT - 8],
            anchor: Anchor::Middle,
            text: format!("{what}, {}", view.name),
        });
    }
    for (r, row) in (0..).zip(rows).filter(|_| rows.len() > 1) {
        let [x, y] = grid.at(r, 0);
        let at = [x - MARGIN, y + args.panel / 2 - TEXT / 2];
        items.push(Item::Text { at, anchor: Anchor::End, text: row.name.clone() });
    }
    items
}

fn usual_limit(rows: &[Row]) -> f64 {
    let mut all: Vec<f64> =
        rows.iter().filter_map(|r| r.values.as_ref()).flatten().copied().collect();
    all.retain(|v| v.is_finite());
    all.sort_by(f64::total_cmp);
    nice(all.get(all.len() * 98 / 100).copied().unwrap_or(1.0).max(1e-9))
}

fn unit_of(file: &MeshFile) -> &'static str {
    match file.unit {
        Some(MeshUnit::Millimetre) => "mm",
        Some(MeshUnit::Centimetre) => "cm",
        Some(MeshUnit::Metre) => "m",
        Some(MeshUnit::TemplateUnit) | None => "units",
    }
}

/// A length at the middle of the surface.
fn scale_bar(
    args: &FigureArgs,
    camera: SideView,
    [x, y]: [u32; 2],
    unit: &str,
    items: &mut Vec<Item>,
) {
    let scale = camera.scale();
    let wanted = 0.3 * f64::from(args.panel) / scale;
    let decade = 10f64.powf(wanted.log10().floor());
    let length = [5.0, 2.0, 1.0].into_iter().find(|s| s * decade <= wanted).unwrap_or(1.0) * decade;
    let width = (length * scale).round() as u32;
    items.push(Item::Rule { at: [x, y + 6], width });
    let text = format!("{length} {unit}");
    items.push(Item::Text { at: [x, y + 14], anchor: Anchor::Start, text });
}

fn colour_bar(right: u32, y: u32, panel: u32, limit: f64, unit: &str, items: &mut Vec<Item>) {
    let width = (panel * 4 / 5).max(200);
    let x = right.saturating_sub(width + 3 * MARGIN);
    let colour = |column: u32| draw::ramp(&CIVIDIS, f64::from(column) / f64::from(width - 1));
    let picture = RgbImage::from_fn(width, 16, |column, _| image::Rgb(colour(column)));
    items.push(Item::Picture { at: [x, y], picture });
    for (k, text) in
        [(0, "0".to_string()), (1, format!("{}", 0.5 * limit)), (2, format!("{limit} {unit}"))]
    {
        items.push(Item::Text { at: [x + k * width / 2, y + 20], anchor: Anchor::Middle, text });
    }
}
