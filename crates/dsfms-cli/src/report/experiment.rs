//! The report of an experiment: plots and tables, and the first case of every extension in 3D.

use super::Page;
use super::data::{PageData, ShownCamera, ShownFrame, ShownSurface, pixels, unit_name};
use super::embed::{self, Cloud, escape};
use super::template::definition_list;
use crate::chart::{Chart, Plot, Series, line_chart};
use crate::outputs::FrameReport;
use dsfms::experiment::{Arm, Metric, Plan, Row, SeriesOrgan, surface};
use dsfms::synth::{Case, Cell};

/// Most arms in 3D; an ablation has many more.
const MOST_SHOWN: usize = 5;

/// The page of a finished plan.
pub fn experiment_page(plan: &Plan, organ: &SeriesOrgan, rows: &[Row]) -> anyhow::Result<Page> {
    let noise = plan.noises.first().copied().unwrap_or_default();
    let mut cases = Vec::new();
    for &extension in &plan.extensions {
        cases.push((
            format!("extension {extension} %"),
            organ.case(&plan.protocol, Cell { extension, noise }, 0)?,
        ));
    }
    let arms = &plan.arms[..plan.arms.len().min(MOST_SHOWN)];
    Ok(Page {
        title: format!("Experiment on the {}", plan.organ),
        summary: summary(plan),
        sections: sections(plan, rows),
        data: cases_data(&cases, arms)?,
        curves: String::new(),
    })
}

/// One case by several methods.
pub fn case_page(name: &str, case: Case, arms: &[Arm], text: &str) -> anyhow::Result<Page> {
    Ok(Page {
        title: format!("Table 1, {name}"),
        summary: format!("<p>{}</p>", escape(text)),
        sections: String::new(),
        data: cases_data(&[(name.to_string(), case)], arms)?,
        curves: String::new(),
    })
}

/// Cases of one rest shape as frames, reconstructed once more; the truth beside the methods.
fn cases_data(cases: &[(String, Case)], arms: &[Arm]) -> anyhow::Result<PageData> {
    let Some((_, first)) = cases.first() else { anyhow::bail!("no case to show") };
    let template = &first.template;
    let mut data = PageData::of_template(template, 1.0, unit_name(template.unit))?;
    data.camera = Some(ShownCamera::of(&first.camera));
    data.methods = arms.iter().map(|a| a.name.clone()).collect();
    data.chosen = arms.len().saturating_sub(1);
    data.truth = Some(arms.len());
    data.methods.push("truth".into());
    for (name, case) in cases {
        let mut shown = ShownFrame::new(name, &case.frame)?;
        for arm in arms {
            let unit = case.template.unit;
            let found = surface(case, arm.method, &arm.options);
            let report = match &found {
                Ok(result) => FrameReport::of(name, arm.method, unit, result),
                Err(error) => FrameReport::failed(name, arm.method, unit, error.to_string()),
            };
            let faces = &case.template.mesh.topology.faces;
            shown.add(&report, found.ok().as_ref(), (&case.camera, faces), 1.0);
        }
        shown.surfaces.push(Some(ShownSurface {
            positions: Some(Cloud::of(&case.truth)),
            pixels: Some(pixels(&case.camera, &case.truth)),
            visible: Some(embed::flags(&case.visible)),
            ..Default::default()
        }));
        shown.status.push("ok");
        data.frames.push(shown);
    }
    Ok(data)
}

fn summary(plan: &Plan) -> String {
    let p = &plan.protocol;
    let place = if p.everywhere { "over the whole surface" } else { "outside the deformed zone" };
    let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    definition_list(&[
        ("Organ", format!("{}, {} vertices", plan.organ, p.vertices)),
        ("Cases", format!("{} of every extension and noise, seed {}", plan.count, p.seed)),
        (
            "Extension",
            format!(
                "{} %: {:?} relative edge-length change in the deformed zone",
                list(&plan.extensions),
                p.extension_of
            ),
        ),
        ("Matches", format!("{} {place}, noise {} px", p.matches, list(&plan.noises))),
        ("Light", p.light.name().into()),
        ("Errors", "absolute: nothing is aligned".into()),
        ("In 3D", "the first case of every extension, solved once more".into()),
    ])
}

fn sections(plan: &Plan, rows: &[Row]) -> String {
    let mut html = String::new();
    for &noise in &plan.noises {
        let own: Vec<&Row> = rows.iter().filter(|r| r.cell.noise == noise).collect();
        html += &format!("<h2>Matches with {noise} px of noise</h2>");
        if plan.extensions.len() > 1 && plan.arms.len() <= 6 {
            let drawn = Metric::ALL.map(|m| error_chart(plan, m, &own).page());
            html += &format!(
                "<p class=\"dim\">Means over the cases; thin bars end at the 90th percentile.</p>\
                 <div class=\"plots\">{}</div>",
                drawn.concat()
            );
        }
        html += &table(&own);
    }
    html
}

/// Error against extension: means of the arms, bars that end at the 90th percentile.
pub fn error_chart(plan: &Plan, metric: Metric, rows: &[&Row]) -> Chart {
    let of = |arm: &Arm| {
        let own = || rows.iter().filter(|r| r.arm == arm.name);
        Series {
            label: arm.name.clone(),
            points: own().map(|r| (r.cell.extension, r.errors[metric.index].mean)).collect(),
            whiskers: own().map(|r| r.errors[metric.index].p90).collect(),
        }
    };
    let series: Vec<Series> = plan.arms.iter().map(of).collect();
    let value = format!("{}, {}", metric.title, metric.unit);
    let against = "extension, % (lines: mean; bars: to the 90th percentile)";
    line_chart(&Plot { value: &value, against, ..Default::default() }, &series)
}

fn table(rows: &[&Row]) -> String {
    let mut html = String::from(
        "<div class=\"scroll\" tabindex=\"0\"><table><caption>Mean (90th percentile) over the cases, mm; time on one \
         thread</caption><thead><tr><th scope=\"col\">extension, %</th><th scope=\"col\" class=\"text\">method</th>\
         <th scope=\"col\">deformed zone</th><th scope=\"col\">whole surface</th><th scope=\"col\">zone, of \
         rigid's</th><th scope=\"col\">worse than dsfm</th><th scope=\"col\">without surface</th>\
         <th scope=\"col\">time, s</th></tr></thead><tbody>",
    );
    let cell = |v: Option<String>| v.unwrap_or("–".into());
    for r in rows {
        let [whole, zone] = [r.errors[0], r.errors[1]];
        html += &format!(
            "<tr><th scope=\"row\">{}</th><td class=\"text\">{}</td><td>{:.2} ({:.2})</td><td>{:.2} ({:.2})</td>\
             <td>{}</td><td>{}</td><td>{} of {}</td><td>{:.2}</td></tr>",
            r.cell.extension,
            escape(&r.arm),
            zone.mean,
            zone.p90,
            whole.mean,
            whole.p90,
            cell(r.to_rigid.map(|t| format!("{:.2}", t[1]))),
            cell(r.failures.map(|f| format!("{:.0} %", 100.0 * f))),
            r.lost,
            r.count + r.lost,
            r.seconds.mean
        );
    }
    html + "</tbody></table></div>"
}
