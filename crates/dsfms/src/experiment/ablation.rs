//! What each ingredient is worth: the methods with one thing left out at a time.

use super::Arm;
use crate::pipeline::{Method, ReconstructOptions};

/// One change to the options of a method.
struct Change {
    name: &'static str,
    method: Method,
    edit: fn(&mut ReconstructOptions),
}

/// A tolerance that holds nothing, and one that holds fast.
const LOOSE: f64 = 1e3;
const FAST: f64 = 1e-6;

const CHANGES: [Change; 32] = {
    use Method::{Dsfm, Dsfms, Joint};
    const fn change(
        name: &'static str,
        method: Method,
        edit: fn(&mut ReconstructOptions),
    ) -> Change {
        Change { name, method, edit }
    }
    [
        change("dsfm: as printed", Dsfm, |o| o.literal = true),
        change("dsfm: no stretch prior", Dsfm, |o| o.register.prior.stretch = 0.0),
        change("dsfm: match depths free", Dsfm, |o| o.register.depth_hold = LOOSE),
        change("dsfm: no smoothing", Dsfm, |o| o.register.prior.smoothing = 0.0),
        change("dsfm: no conformal prior", Dsfm, |o| o.register.prior.conformal = 0.0),
        change("dsfm: no annealing of the loss", Dsfm, |o| {
            o.register.robust_px[0] = o.register.robust_px[1]
        }),
        change("dsfms: as printed", Dsfms, |o| o.literal = true),
        change("dsfms: gain at its first estimate and no ambient", Dsfms, |o| {
            (o.refine.image.gain_sigma, o.refine.image.ambient_sigma) = (FAST, FAST);
        }),
        change("dsfms: reprojection held tightly", Dsfms, |o| o.refine.lambda_4 = 300.0),
        change("dsfms: least squares", Dsfms, |o| o.refine.huber = LOOSE),
        change("dsfms: grey", Dsfms, |o| o.refine.image.colour = false),
        change("dsfms: no halo", Dsfms, |o| o.refine.image.halo = 0.0),
        change("dsfms: no mirror cone", Dsfms, |o| o.refine.image.specular_deg = 0.0),
        change("dsfms: no specular condition", Dsfms, |o| o.refine.lambda_6 = 0.0),
        change("dsfms: contour samples kept", Dsfms, |o| o.refine.image.contour_blurs = 0.0),
        change("dsfms: grazing samples kept", Dsfms, |o| o.refine.image.grazing = 0.0),
        change("dsfms: one round", Dsfms, |o| o.refine.rounds = 1),
        change("joint: no shading", Joint, |o| o.joint.shading = 0.0),
        change("joint: no conformal prior", Joint, |o| o.joint.prior.conformal = 0.0),
        change("joint: no stretch prior", Joint, |o| o.joint.prior.stretch = 0.0),
        change("joint: strains squared", Joint, |o| o.joint.strain = LOOSE),
        change("joint: one sign", Joint, |o| o.joint.mirrors = 0),
        change("joint: no smoothing", Joint, |o| o.joint.prior.smoothing = 0.0),
        change("joint: gain at its first estimate and no ambient", Joint, |o| {
            (o.joint.image.gain_sigma, o.joint.image.ambient_sigma) = (FAST, FAST);
        }),
        change("joint: least squares", Joint, |o| o.joint.robust = LOOSE),
        change("joint: finest blur only", Joint, |o| {
            let finest = o.joint.blurs.last().copied();
            o.joint.blurs = finest.into_iter().collect();
        }),
        change("joint: grey", Joint, |o| o.joint.image.colour = false),
        change("joint: no halo", Joint, |o| o.joint.image.halo = 0.0),
        change("joint: no mirror cone", Joint, |o| o.joint.image.specular_deg = 0.0),
        change("joint: no specular condition", Joint, |o| o.joint.highlights = 0.0),
        change("joint: contour samples kept", Joint, |o| o.joint.image.contour_blurs = 0.0),
        change("joint: match depths free", Joint, |o| {
            (o.register.depth_hold, o.joint.near_depth_hold) = (LOOSE, LOOSE);
        }),
    ]
};

/// The rigid pose, each method whole under its own name, and then with one change each.
pub fn arms(options: &ReconstructOptions) -> Vec<Arm> {
    let methods = [Method::Rigid, Method::Dsfm, Method::Dsfms, Method::Joint];
    let whole = super::arms_of(&methods, options);
    let changed = CHANGES.iter().map(|change| {
        let mut options = options.clone();
        (change.edit)(&mut options);
        Arm { name: change.name.to_owned(), method: change.method, options }
    });
    whole.into_iter().chain(changed).collect()
}

/// Markdown: zone error of every arm, and that error over the one of the whole method.
pub fn markdown(plan: &super::Plan, rows: &[super::Row]) -> String {
    let mut text = format!(
        "{} cases a cell, organ {}, {:?} light, seed {}; mean RMS 3D error, mm, and the zone error \
         relative to the whole method.\n",
        plan.count, plan.organ, plan.protocol.light, plan.protocol.seed
    );
    for cell in plan.cells() {
        text += &format!(
            "\n### Extension {} %, match noise {} px\n\n\
             | arm | zone | 90th percentile | whole surface | relative | failures |\n\
             | --- | --- | --- | --- | --- | --- |\n",
            cell.extension, cell.noise
        );
        let here: Vec<&super::Row> = rows.iter().filter(|r| r.cell == cell).collect();
        for row in &here {
            let method = row.arm.split(':').next().unwrap_or_default();
            let whole = here.iter().find(|r| r.arm == method);
            let relative = whole.map_or(f64::NAN, |w| row.errors[1].mean / w.errors[1].mean);
            let failures = row.failures.map_or("-".into(), |f| format!("{:.0} %", 100.0 * f));
            text += &format!(
                "| {} | {:.3} | {:.3} | {:.3} | {relative:.2} | {failures} |\n",
                row.arm, row.errors[1].mean, row.errors[1].p90, row.errors[0].mean
            );
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_arm_differs_from_its_method_and_has_its_own_name() {
        let options = ReconstructOptions::default();
        let arms = arms(&options);
        for (i, arm) in arms.iter().enumerate() {
            assert!(arms[..i].iter().all(|other| other.name != arm.name), "{}", arm.name);
            assert!(!arm.name.contains(','));
            assert_eq!(arm.name.contains(':'), arm.options != options, "{}", arm.name);
        }
    }
}
