//! `dsfms experiment`: the paper's experiment on synthetic cases (§8.1).

pub mod pace;
mod place_args;
pub mod series;
mod table1;

use crate::args::Global;
use crate::exit::{Outcome, Usage};
use crate::interrupt;
use crate::outputs::{write_bytes, write_text};
use crate::progress::Reporter;
use crate::report::experiment::{error_chart, experiment_page};
use crate::sheet::{pdf, svg};
use crate::stdout::to_stdout;
use clap::{Args, Subcommand};
use dsfms::experiment::{
    Arm, Metric, Plan, Row, ablation, arms_of, markdown, run as run_plan, summarise, table_csv,
    times_csv,
};
use dsfms::pipeline::{Method, Progress};
use pace::Paced;
use place_args::PlaceArgs;
use series::SeriesArgs;
use std::path::Path;

const EXAMPLES: &str = "\
Examples:
  # Error against extension (Fig. 5): 100 cases for each of five extensions,
  # all methods
  dsfms experiment ext --count 100 --seed 1 -o results
  # Under a near light, with noisier matches
  dsfms experiment ext --light near --noise 1,4 --methods rigid,dsfm,joint \\
      -o near
  # The methods side by side, on a part of the liver
  dsfms experiment table1 --organ liver -o table1
  # What each ingredient is worth
  dsfms experiment ablation --count 40 -o ablation

Every finished case is appended to OUT/cases.csv. A run that was stopped goes
on where it was; the same folder is refused for other parameters or another
build of dsfms, unless --restart drops what runs wrote there, and so is one
that holds files of these names without the dsfms.json of a run. Errors are
absolute, in mm and px; nothing is aligned. OUT/report.html shows the plots,
and one case of every extension in 3D.";

/// Run the methods on synthetic deformations of known truth.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct ExperimentArgs {
    #[command(subcommand)]
    which: Which,
}

#[derive(Debug, Subcommand)]
enum Which {
    /// Error against extension: CSV and Markdown tables, plots as SVG and PDF.
    Ext(ExtArgs),
    /// The methods side by side as pictures.
    Table1(table1::Table1Args),
    /// The effect of leaving out one ingredient of a method at a time.
    Ablation(AblationArgs),
}

#[derive(Debug, Args)]
struct ExtArgs {
    #[command(flatten)]
    series: SeriesArgs,
    /// Methods, in the order of the columns.
    #[arg(long, value_delimiter = ',', default_value = "rigid,sfs,dsfm,dsfms,joint")]
    methods: Vec<super::reconstruct::MethodName>,
    /// Extensions, percent.
    #[arg(long, value_delimiter = ',', default_value = "0,5,10,15,20", value_parser = series::percent)]
    ext: Vec<f64>,
    #[command(flatten)]
    place: PlaceArgs,
}

#[derive(Debug, Args)]
struct AblationArgs {
    #[command(flatten)]
    series: SeriesArgs,
    /// Extensions, percent.
    #[arg(long, value_delimiter = ',', default_value = "10", value_parser = series::percent)]
    ext: Vec<f64>,
    #[command(flatten)]
    place: PlaceArgs,
}

/// What the series leave but plots.
const FILES: [&str; 7] = [
    "cases.csv",
    "table.md",
    "table.csv",
    "times.csv",
    "ablation.md",
    "ablation.csv",
    "report.html",
];

/// Whether a file has a name that the series give.
fn of_series(name: &str) -> bool {
    let plot = |metric: Metric| {
        let rest = name.strip_prefix(metric.name())?;
        let rest = rest.strip_suffix(".svg").or(rest.strip_suffix(".pdf"))?;
        let noise = rest.strip_prefix("_noise").map(str::parse::<f64>);
        Some(rest.is_empty() || noise.is_some_and(|noise| noise.is_ok()))
    };
    FILES.contains(&name) || Metric::ALL.into_iter().any(|metric| plot(metric).unwrap_or(false))
}

/// Run the command.
pub fn run(args: &ExperimentArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    match &args.which {
        Which::Ext(args) => ext(args, global, reporter),
        Which::Table1(args) => table1::run(args, global, reporter),
        Which::Ablation(args) => ablate(args, global, reporter),
    }
}

fn ext(args: &ExtArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let mut methods: Vec<Method> = Vec::new();
    for &name in &args.methods {
        let method = Method::from(name);
        if methods.contains(&method) {
            return Err(Usage(format!("--methods names {name:?} twice").to_lowercase()).into());
        }
        methods.push(method);
    }
    let arms = arms_of(&methods, &args.place.options()?);
    let (plan, rows) = work(&args.series, &args.ext, arms, &args.place, global, reporter)?;
    let out = &args.place.output;
    let text = markdown(&plan, &rows);
    write_text(&out.join("table.md"), &text)?;
    write_text(&out.join("table.csv"), &table_csv(&rows))?;
    write_text(&out.join("times.csv"), &times_csv(&rows))?;
    write_plots(out, &plan, &rows)?;
    experiment_page(&plan, &args.series.organ()?, &rows)?.write(&out.join("report.html"))?;
    reporter.finish();
    to_stdout(&text)?;
    to_stdout(&format!("\nTime on one thread:\n{}", times_csv(&rows)))?;
    Ok(outcome(&rows))
}

fn ablate(args: &AblationArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let arms = ablation::arms(&args.place.options()?);
    let (plan, rows) = work(&args.series, &args.ext, arms, &args.place, global, reporter)?;
    let out = &args.place.output;
    let text = ablation::markdown(&plan, &rows);
    write_text(&out.join("ablation.md"), &text)?;
    write_text(&out.join("ablation.csv"), &table_csv(&rows))?;
    experiment_page(&plan, &args.series.organ()?, &rows)?.write(&out.join("report.html"))?;
    reporter.finish();
    to_stdout(&text)?;
    Ok(outcome(&rows))
}

/// Plan, run and sum up.
fn work(
    series: &SeriesArgs,
    extensions: &[f64],
    arms: Vec<Arm>,
    place: &PlaceArgs,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<(Plan, Vec<Row>)> {
    let organ = series.organ()?;
    place.take(of_series)?;
    let plan = Plan {
        organ: organ.name().to_owned(),
        protocol: series.protocol(global.seed()),
        extensions: extensions.to_vec(),
        noises: series.noise.clone(),
        count: series.count,
        arms,
        build: crate::build::number()?,
    };
    let results = place.output.join("cases.csv");
    interrupt::advise(format!(
        "finished cases are kept in {}; the same command goes on from there",
        results.display()
    ));
    let records = run_plan(&plan, &organ, &results, &Paced::new(reporter))?;
    for lost in records.iter().filter(|r| r.errors.is_none()).take(5) {
        let (case, extension) = (lost.case, lost.cell.extension);
        reporter.warn(&format!("{} on case {case} at {extension} %: {}", lost.arm, lost.note));
    }
    let rows = summarise(&records, &plan);
    Ok((plan, rows))
}

/// `zone.svg`, `zone.pdf` and so on; with the noise in the name where there are several.
fn write_plots(out: &Path, plan: &Plan, rows: &[Row]) -> anyhow::Result<()> {
    for &noise in &plan.noises {
        let of_noise: Vec<&Row> = rows.iter().filter(|r| r.cell.noise == noise).collect();
        let suffix = if plan.noises.len() > 1 { format!("_noise{noise}") } else { String::new() };
        for metric in Metric::ALL {
            let name = |ending: &str| out.join(format!("{}{suffix}.{ending}", metric.name()));
            let sheet = error_chart(plan, metric, &of_noise).paper();
            write_text(&name("svg"), &svg::paper(&sheet)?)?;
            write_bytes(&name("pdf"), &pdf::file(&sheet)?)?;
        }
    }
    Ok(())
}

fn outcome(rows: &[Row]) -> Outcome {
    match (rows.iter().any(|r| r.count > 0), rows.iter().any(|r| r.lost > 0)) {
        (false, _) => Outcome::Nothing,
        (true, false) => Outcome::Ok,
        (true, true) => Outcome::Degraded,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_plots_are_those_of_errors_and_noises() {
        for name in ["rms.svg", "edge_zone.pdf", "zone_noise0.5.svg", "cases.csv", "report.html"] {
            assert!(of_series(name), "{name}");
        }
        for name in ["zone.png", "zone_of_mine.svg", "zone_noise.svg", "notes.txt", "dsfms.json"] {
            assert!(!of_series(name), "{name}");
        }
    }
}
