//! `dsfms figure`: a plate or a chart for a paper.

mod chart;
mod table;

use crate::exit::{Outcome, Usage};
use crate::figure::panel::{Layer, Surface, View};
use crate::figure::plate::Plate;
use crate::figure::surfaces::{Wanted, read};
use crate::outputs::{encode_png_at, prepare_for, write_bytes, write_text};
use crate::progress::Reporter;
use crate::report::folder::columns;
use crate::sheet::raster::pixels;
use crate::sheet::{Sheet, pdf, svg};
use chart::ChartArgs;
use clap::{Args, ValueEnum};
use dsfms::io::template::read_template;
use dsfms::pipeline::Progress;
use dsfms::template::Template;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  # One frame, shaded, from the laparoscope and from the side
  dsfms figure out --frame 3 -o frame3.pdf
  # All methods of the demo and their error against the truth
  dsfms figure dsfms-demo --frame 1 --truth dsfms-demo/truth/frame_001.ply \\
      -o methods.pdf
  # Three of them, in this order, two columns wide, as pixels
  dsfms figure dsfms-demo --methods rigid,dsfm,joint --frame 1 \\
      --truth dsfms-demo/truth/frame_001.ply --width 180 --dpi 600 -o plate.png
  # All around, with the structures that were carried along
  dsfms figure out --frame 3 --turntable 8 -o turn.svg
  # A column of a table, of every frame of a followed video; events and status
  # of the frames are drawn where the table has such columns
  dsfms figure tracked/summary.csv --y residual_px -o residual.pdf
  # Error of the methods of an experiment, bars to the 90th percentile
  dsfms figure results/table.csv --x extension --y zone_mean --bars zone_p90 \\
      --by arm --title 'error in the deformed zone, mm' -o zone.pdf
  # A mesh with the albedo of its template
  dsfms figure out/frame_003.ply --template organ.template \\
      --views front,side,above -o organ.svg

A plate of the width of a paper's text: letters of 8 pt, panels at --dpi, all
at one scale and cut to what they show. Methods (output folders) stand beside
each other, or the views do where that shows the surfaces larger. Every
surface is shown as shape, with --template by its albedo, with --truth by its
error (distance from vertex to vertex, without alignment; under it the mean
over the vertices) or else, where the frames have one, by its expected error.
The truth is shown last and must have the vertices of the frames. Where the
frames say which vertices the camera saw (output folders do), the rest of the
shape is grey. Hidden structures show through it, fainter the deeper.";

/// Draw a publication figure of one frame, or a chart of a table.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct FigureArgs {
    /// Output folders (or a folder of them), or mesh files; or one table, TABLE.csv.
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
    /// Folders by name, of those that are given, in this order.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    methods: Vec<String>,
    /// Order of the surfaces; default as given, and by error for a folder of folders.
    #[arg(long, value_enum, requires = "truth")]
    order: Option<Order>,
    /// Width of the figure, mm; the text of LNCS is 122 mm wide.
    #[arg(long, value_name = "MM", default_value = "122", value_parser = millimetres)]
    width: f64,
    /// Pixels per inch of the panels, and of a .png.
    #[arg(long, value_name = "DPI", default_value_t = 300, value_parser = clap::value_parser!(u32).range(72..=1200))]
    dpi: u32,
    /// Error at the upper end of the colour bar; default a round number that covers 98 % of the
    /// middle method's.
    #[arg(long, value_name = "LENGTH", value_parser = positive)]
    max: Option<f64>,
    /// File to write; .svg (text stays text), .pdf (fonts inside) or .png.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    chart: ChartArgs,
}

/// In which order surfaces stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Order {
    /// As given; folders of a folder by name.
    Given,
    /// The largest mean error first.
    Error,
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
            View { yaw, pitch: 0.0, name: format!("{yaw:.0}°") }
        };
        match self.turntable {
            Some(n) => (0..n).map(|k| turn(k, n)).collect(),
            None => self.views.iter().map(|v| v.view()).collect(),
        }
    }
}

/// Run the command.
pub fn run(args: &FigureArgs, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let format = FigureFormat::of(&args.output)?;
    if args.frame.is_some() && args.paths.iter().all(|path| path.is_file()) {
        let text = "--frame chooses from an output folder, and none is given; leave it out";
        return Err(Usage(text.into()).into());
    }
    let sheet = match args.paths.as_slice() {
        [table] if is_table(table) => {
            let (chart, left_out) = args.chart.chart(table)?;
            left_out.iter().for_each(|words| reporter.warn(&format!("{words}; left out")));
            Sheet { unit_mm: args.width / crate::chart::WIDTH, ..chart.paper() }
        }
        paths => match paths.iter().find(|path| is_table(path)) {
            Some(table) => {
                let text = format!("{} is a table, which is drawn alone", table.display());
                return Err(Usage(text).into());
            }
            None if args.chart.given() => {
                return Err(Usage("--x and --y belong to a table, TABLE.csv".into()).into());
            }
            None => plate(args, reporter)?,
        },
    };
    write(&sheet, &args.output, format, f64::from(args.dpi))?;
    Ok(Outcome::Ok)
}

fn is_table(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"))
}

/// Surfaces beside each other.
fn plate(args: &FigureArgs, reporter: &Reporter) -> anyhow::Result<Sheet> {
    let several = |p: &PathBuf| p.is_dir() && columns(p).is_ok_and(|c| c.len() > 1);
    let wanted = Wanted {
        paths: &args.paths,
        methods: &args.methods,
        frame: args.frame,
        truth: args.truth.as_deref(),
        structures: !args.no_structures,
        by_error: match args.order {
            Some(order) => order == Order::Error,
            // What has no order of the user's.
            None => args.methods.is_empty() && args.paths.iter().any(several),
        },
    };
    let (surfaces, lacking) = read(&wanted)?;
    for words in lacking {
        reporter.warn(&format!("{words}; left out"));
    }
    let template = args.template.as_deref().map(read_template).transpose()?;
    let layers = layers(&surfaces, template.as_ref())?;
    let plate = Plate {
        surfaces: &surfaces,
        layers: &layers,
        views: &args.all_views(),
        turning: args.turntable.is_some(),
        template: template.as_ref(),
        width_mm: args.width,
        dpi: f64::from(args.dpi),
        max: args.max,
    };
    Ok(plate.sheet())
}

fn write(sheet: &Sheet, output: &Path, format: FigureFormat, dpi: f64) -> anyhow::Result<()> {
    prepare_for(output)?;
    match format {
        FigureFormat::Png => {
            let pixels = pixels(sheet, dpi * sheet.unit_mm / MM_PER_INCH);
            write_bytes(output, &encode_png_at(&pixels, dpi)?)
        }
        FigureFormat::Pdf => write_bytes(output, &pdf::file(sheet)?),
        FigureFormat::Svg => write_text(output, &svg::paper(sheet)?),
    }
}

const MM_PER_INCH: f64 = 25.4;

enum FigureFormat {
    Svg,
    Pdf,
    Png,
}

impl FigureFormat {
    fn of(output: &Path) -> anyhow::Result<Self> {
        let extension = output.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match extension.as_str() {
            "svg" => Ok(Self::Svg),
            "pdf" => Ok(Self::Pdf),
            "png" => Ok(Self::Png),
            _ => {
                let name = output.display();
                let text = format!("-o {name}: expected a name that ends in .svg, .pdf or .png");
                Err(Usage(text).into())
            }
        }
    }
}

fn layers(surfaces: &[Surface], template: Option<&Template>) -> anyhow::Result<Vec<Layer>> {
    let mut layers = vec![Layer::Shape];
    if let Some(template) = template {
        let fits = |s: &Surface| s.file.mesh.topology.faces == template.mesh.topology.faces;
        if template.albedo.is_none() {
            anyhow::bail!("the template holds no albedo; leave --template out");
        }
        if let Some(other) = surfaces.iter().find(|s| !fits(s)) {
            anyhow::bail!("{} has other faces than the template", other.name);
        }
        layers.push(Layer::Albedo);
    }
    if surfaces.iter().any(|s| s.values.is_some()) {
        layers.push(Layer::Error);
    }
    Ok(layers)
}

fn millimetres(text: &str) -> Result<f64, String> {
    let valid = |v: &f64| (30.0..=1000.0).contains(v);
    text.parse().ok().filter(valid).ok_or_else(|| "expected 30 to 1000 mm".to_owned())
}

fn positive(text: &str) -> Result<f64, String> {
    let valid = |v: &f64| v.is_finite() && *v > 0.0;
    let number = text.strip_suffix("mm").unwrap_or(text).trim();
    let wrong = || "expected a number above zero, in the unit of the surfaces".to_owned();
    number.parse().ok().filter(valid).ok_or_else(wrong)
}
