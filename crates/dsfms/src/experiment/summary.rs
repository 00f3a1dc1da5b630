//! Records to the rows of a table.

use super::{Errors, Plan, Record};
use crate::eval::ErrorStats;
use crate::synth::Cell;

/// Mean and 90th percentile over the cases of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Nine of ten cases are at most this.
    pub p90: f64,
}

/// One method in one cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Conditions.
    pub cell: Cell,
    /// Name of the arm.
    pub arm: String,
    /// Cases with a surface.
    pub count: usize,
    /// Cases without.
    pub lost: usize,
    /// Mean of the largest displacement, mm.
    pub amplitude: f64,
    /// Mean over the cases of the mean relative edge-length change in the zone, percent.
    pub mean_extension: f64,
    /// The errors in the order of [`Errors::NAMES`].
    pub errors: [Spread; 6],
    /// Mean errors divided by those of the rigid pose, where it was run.
    pub to_rigid: Option<[f64; 6]>,
    /// Mean errors divided by those of DSfM, where it was run.
    pub to_dsfm: Option<[f64; 6]>,
    /// Share of the cases whose zone error is above DSfM's, or without a surface.
    pub failures: Option<f64>,
    /// Time on one thread, seconds.
    pub seconds: Spread,
}

/// One row per cell and arm, in the order of the plan. Ratios are ratios of means.
pub fn summarise(records: &[Record], plan: &Plan) -> Vec<Row> {
    let mut rows = Vec::new();
    for cell in plan.cells() {
        let of = |arm: &str| -> Vec<&Record> {
            records.iter().filter(|r| r.cell == cell && r.arm == arm).collect()
        };
        let (rigid, dsfm) = (of("rigid"), of("dsfm"));
        for arm in &plan.arms {
            rows.push(row(cell, &arm.name, &of(&arm.name), &rigid, &dsfm));
        }
    }
    rows
}

fn row(cell: Cell, arm: &str, own: &[&Record], rigid: &[&Record], dsfm: &[&Record]) -> Row {
    let errors = spreads(own);
    let ratio = |base: &[&Record]| {
        let base_errors = (!base.is_empty()).then(|| spreads(base))?;
        Some(std::array::from_fn(|k| errors[k].mean / base_errors[k].mean))
    };
    let count = own.iter().filter(|r| r.errors.is_some()).count();
    let average = |value: fn(&Record) -> f64| {
        own.iter().map(|r| value(r)).sum::<f64>() / own.len().max(1) as f64
    };
    Row {
        cell,
        arm: arm.to_owned(),
        count,
        lost: own.len() - count,
        amplitude: average(|r| r.amplitude),
        mean_extension: average(|r| r.mean_extension),
        errors,
        to_rigid: ratio(rigid),
        to_dsfm: ratio(dsfm),
        failures: (!dsfm.is_empty()).then(|| failures(own, dsfm)),
        seconds: spread(own.iter().map(|r| r.seconds)),
    }
}

fn spreads(records: &[&Record]) -> [Spread; 6] {
    std::array::from_fn(|k| spread(records.iter().filter_map(|r| Some(r.errors?.values()[k]))))
}

fn spread(values: impl Iterator<Item = f64>) -> Spread {
    let stats = ErrorStats::of(values);
    stats.map_or(Spread { mean: f64::NAN, p90: f64::NAN }, |s| Spread { mean: s.mean, p90: s.p90 })
}

/// A case is a failure when a method gives nothing, or more zone error than DSfM.
fn failures(own: &[&Record], dsfm: &[&Record]) -> f64 {
    let zone = |errors: &Option<Errors>| errors.map_or(f64::INFINITY, |e| e.zone);
    let failed = own.iter().filter(|r| {
        let base = dsfm.iter().find(|b| b.case == r.case);
        r.errors.is_none() || base.is_some_and(|b| zone(&r.errors) > zone(&b.errors))
    });
    failed.count() as f64 / own.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::arms_of;
    use crate::pipeline::{Method, ReconstructOptions};
    use crate::synth::Protocol;

    #[test]
    fn ratios_and_failures_by_hand() {
        let cell = Cell { extension: 10.0, noise: 1.0 };
        let record = |arm: &str, case: usize, zone: Option<f64>| Record {
            cell,
            case,
            arm: arm.into(),
            amplitude: 2.0,
            mean_extension: 4.0,
            errors: zone.map(|z| Errors::from_values([1.0, z, 1.0, 1.0, 1.0, 1.0])),
            seconds: 0.5,
            note: String::new(),
        };
        let records = [
            record("dsfm", 0, Some(1.0)),
            record("dsfm", 1, Some(3.0)),
            record("joint", 0, Some(1.5)),
            record("joint", 1, Some(0.5)),
            record("joint", 2, None),
        ];
        let plan = Plan {
            organ: "patch".into(),
            protocol: Protocol::default(),
            extensions: vec![10.0],
            noises: vec![1.0],
            count: 3,
            arms: arms_of(&[Method::Dsfm, Method::Joint], &ReconstructOptions::default()),
            build: String::new(),
        };
        let rows = summarise(&records, &plan);
        assert_eq!(rows[0].errors[1], Spread { mean: 2.0, p90: 3.0 });
        let joint = &rows[1];
        assert_eq!((joint.count, joint.lost), (2, 1));
        assert_eq!(joint.to_dsfm.unwrap()[1], 0.5);
        assert_eq!(joint.to_rigid, None);
        assert!((joint.failures.unwrap() - 2.0 / 3.0).abs() < 1e-12);
    }
}
