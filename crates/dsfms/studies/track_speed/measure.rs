//! Times, processor time and memory of a run.

use dsfms::track::{Origin, TrackStatus, Tracked};
use std::collections::BTreeMap;
use std::fs::read_to_string;
use std::time::Duration;

/// Collects what every frame took.
pub struct Meter {
    latency_ms: Vec<f64>,
    solve_ms: Vec<f64>,
    followed_ms: Vec<f64>,
    stages: BTreeMap<&'static str, Vec<f64>>,
    /// Of the frames that were not followed.
    others: BTreeMap<&'static str, Vec<f64>>,
    /// Mean photometric residual and reprojection error of every surface.
    residuals: [Vec<f64>; 2],
    status: [usize; 3],
    found: usize,
    /// Resident memory after every twentieth part of the run, less these figures, MiB.
    memory: Vec<f64>,
    count: usize,
    wall: f64,
    cpu: f64,
}

impl Meter {
    pub fn new(count: usize) -> Self {
        Self {
            latency_ms: Vec::with_capacity(count),
            solve_ms: Vec::with_capacity(count),
            followed_ms: Vec::with_capacity(count),
            stages: BTreeMap::new(),
            others: BTreeMap::new(),
            residuals: [Vec::new(), Vec::new()],
            status: [0; 3],
            found: 0,
            memory: Vec::new(),
            count,
            wall: 0.0,
            cpu: 0.0,
        }
    }

    pub fn add(&mut self, latency: Duration, solve: Duration, tracked: &Tracked) {
        self.latency_ms.push(1e3 * latency.as_secs_f64());
        self.solve_ms.push(1e3 * solve.as_secs_f64());
        self.status[tracked.status as usize] += 1;
        let origin = tracked.surface.as_ref().map(|s| s.origin);
        self.found += usize::from(origin == Some(Origin::Found));
        if let Some(s) = &tracked.surface {
            self.residuals[0].extend(s.photometric.map(|r| 100.0 * r));
            self.residuals[1].push(s.reprojection_px);
        }
        let followed = origin == Some(Origin::Followed);
        if followed {
            self.followed_ms.push(1e3 * solve.as_secs_f64());
        }
        let stages = if followed { &mut self.stages } else { &mut self.others };
        for (name, seconds) in &tracked.stages {
            stages.entry(name).or_default().push(1e3 * seconds);
        }
        if tracked.status != TrackStatus::Ok && self.count <= 1000 {
            eprintln!(
                "frame {}: {} ({:?})",
                self.latency_ms.len() - 1,
                tracked.status.label(),
                tracked.reasons
            );
        }
        if self.latency_ms.len().is_multiple_of((self.count / 20).max(1)) {
            self.memory.push(memory_mib("VmRSS:") - self.own_mib());
        }
    }

    /// What these figures themselves take, MiB.
    fn own_mib(&self) -> f64 {
        let stages = self.stages.values().chain(self.others.values());
        let all = [&self.latency_ms, &self.solve_ms, &self.followed_ms].into_iter();
        let all = all.chain(&self.residuals).chain(stages);
        all.map(Vec::len).sum::<usize>() as f64 * 8.0 / (1 << 20) as f64
    }

    pub fn finish(&mut self, wall: f64, cpu: f64) {
        (self.wall, self.cpu) = (wall, cpu);
    }

    pub fn print(&self) {
        let n = self.latency_ms.len();
        let [ok, degraded, lost] = self.status;
        println!("{n} frames: {ok} ok, {degraded} degraded, {lost} lost; {} found", self.found);
        println!(
            "{:.1} frames/s sustained; processor time {:.1} ms a frame",
            n as f64 / self.wall,
            1e3 * self.cpu / n as f64
        );
        println!("                median   mean    99 %    max, ms");
        row("latency", &self.latency_ms);
        row("solve", &self.solve_ms);
        row("solve followed", &self.followed_ms);
        for (name, times) in &self.stages {
            row(&format!("- {name}"), times);
        }
        println!("other frames: searched, or without a surface");
        for (name, times) in &self.others {
            row(&format!("- {name}"), times);
        }
        println!("residuals");
        row("photometric, %", &self.residuals[0]);
        row("mean px", &self.residuals[1]);
        let memory: Vec<String> = self.memory.iter().map(|m| format!("{m:.0}")).collect();
        println!("memory {} MiB; peak {:.0} MiB", memory.join(" "), memory_mib("VmHWM:"));
    }
}

fn row(name: &str, times: &[f64]) {
    let mut sorted = times.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let Some(&max) = sorted.last() else { return };
    let at = |q: f64| sorted[((sorted.len() - 1) as f64 * q).round() as usize];
    let mean = sorted.iter().sum::<f64>() / sorted.len() as f64;
    println!("{name:14} {:7.1} {mean:7.1} {:7.1} {max:7.1}", at(0.5), at(0.99));
}

/// User and system time of this process, seconds; 0 where the system does not tell.
pub fn cpu_seconds() -> f64 {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0.0 };
    tasks
        .flatten()
        .filter_map(|task| read_to_string(task.path().join("schedstat")).ok())
        .filter_map(|text| text.split_whitespace().next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-9
}

fn memory_mib(key: &str) -> f64 {
    let text = read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix(key)).unwrap_or_default();
    line.split_whitespace().next().and_then(|v| v.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}
