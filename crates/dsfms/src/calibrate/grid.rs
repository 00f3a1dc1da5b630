//! From loose corners to the board's grid: a seed and its four neighbours, grown outwards.

use super::saddle::Saddle;
use crate::geometry::{Point2, Vector2};
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};

/// Grid place (column, row) to index of a corner.
pub(super) type Lattice = BTreeMap<[i32; 2], usize>;

/// The four directions, opposite ones two apart.
const SIDES: [[i32; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];
/// Seeds tried: a board with one usable corner among this many is found.
const MAX_SEEDS: usize = 400;
/// How far from its predicted place a corner may lie, in steps of the grid.
const TOLERANCE: f64 = 0.3;
/// How far the bright direction may differ from a right angle to the neighbour's, rad: shear turns
/// both, but alike.
const MAX_TURN: f64 = 0.6;

/// The largest grid of the corners; several seeds compete.
pub(super) fn largest_grid(corners: &[Saddle]) -> Lattice {
    let mut best = Lattice::new();
    let mut taken = vec![false; corners.len()];
    for seed in 0..corners.len().min(MAX_SEEDS) {
        if taken[seed] {
            continue;
        }
        let Some(mut grid) = start(corners, seed) else { continue };
        grow(corners, &mut grid);
        grid.values().for_each(|&i| taken[i] = true);
        if grid.len() > best.len() {
            best = grid;
        }
    }
    best
}

/// Whether two corners can be neighbours: bright and dark change places.
fn opposed(a: &Saddle, b: &Saddle) -> bool {
    let turn = (a.bright - b.bright).rem_euclid(PI);
    (turn - FRAC_PI_2).abs() < MAX_TURN
}

/// A corner with its nearest opposed corner in each of the four sectors between bright and dark.
fn start(corners: &[Saddle], seed: usize) -> Option<Lattice> {
    let own = &corners[seed];
    let mut nearest: [Option<(f64, usize)>; 4] = [None; 4];
    for (i, other) in corners.iter().enumerate() {
        let d = other.at - own.at;
        let distance = d.norm();
        if i == seed || !opposed(own, other) {
            continue;
        }
        let angle = (d.y.atan2(d.x) - own.bright).rem_euclid(2.0 * PI);
        let sector = ((angle / FRAC_PI_2) as usize).min(3);
        if nearest[sector].is_none_or(|(known, _)| distance < known) {
            nearest[sector] = Some((distance, i));
        }
    }
    let mut grid = Lattice::from([([0, 0], seed)]);
    for (side, found) in SIDES.iter().zip(nearest) {
        grid.insert(*side, found?.1);
    }
    let arm = |k: usize| corners[grid[&SIDES[k]]].at - own.at;
    let straight = |k: usize| {
        let (a, b): (Vector2, Vector2) = (arm(k), arm(k + 2));
        (a + b).norm() < TOLERANCE * a.norm().max(b.norm())
    };
    (straight(0) && straight(1)).then_some(grid)
}

fn grow(corners: &[Saddle], grid: &mut Lattice) {
    let mut used = vec![false; corners.len()];
    grid.values().for_each(|&i| used[i] = true);
    loop {
        let mut added = false;
        let places: Vec<[i32; 2]> = grid.keys().copied().collect();
        for place in places {
            for side in SIDES {
                let target = plus(place, side, 1);
                if grid.contains_key(&target) {
                    continue;
                }
                let at = |p: [i32; 2]| grid.get(&p).map(|&i| corners[i].at);
                let Some((p, step)) = predict(&at, place, side) else { continue };
                let own = &corners[grid[&place]];
                let fits = |i: &usize| !used[*i] && opposed(own, &corners[*i]);
                let near = (0..corners.len()).filter(fits).map(|i| ((corners[i].at - p).norm(), i));
                let near = near.min_by(|a, b| a.0.total_cmp(&b.0));
                if let Some((distance, i)) = near
                    && distance < TOLERANCE * step
                {
                    grid.insert(target, i);
                    used[i] = true;
                    added = true;
                }
            }
        }
        if !added {
            return;
        }
    }
}

/// Where the neighbour of `place` on one side should be, and the length of the step there: straight
/// on, else parallel to the next row.
pub(super) fn predict(
    at: &dyn Fn([i32; 2]) -> Option<Point2>,
    place: [i32; 2],
    side: [i32; 2],
) -> Option<(Point2, f64)> {
    let own = at(place)?;
    if let Some(back) = at(plus(place, side, -1)) {
        let step = own - back;
        // A step grows or shrinks steadily under perspective and distortion.
        let change = at(plus(place, side, -2)).map_or(Vector2::zeros(), |b| step - (back - b));
        return Some((own + step + change, step.norm()));
    }
    [[side[1], side[0]], [-side[1], -side[0]]].iter().find_map(|across| {
        let beside = plus(place, *across, 1);
        let step = at(plus(beside, side, 1))? - at(beside)?;
        Some((own + step, step.norm()))
    })
}

pub(super) fn plus(place: [i32; 2], side: [i32; 2], times: i32) -> [i32; 2] {
    [place[0] + times * side[0], place[1] + times * side[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(columns: i32, rows: i32) -> Vec<Saddle> {
        let place = |i: i32| [i % columns, i / columns];
        (0..columns * rows)
            .map(|i| {
                let [c, r] = place(i);
                let w = 1.0 + 0.02 * f64::from(c);
                let at = Point2::new(
                    (20.0 * f64::from(c) + 4.0 * f64::from(r)) / w + 50.0,
                    (17.0 * f64::from(r) - 3.0 * f64::from(c)) / w + 90.0,
                );
                let bright = if (c + r) % 2 == 0 { 0.7 } else { 0.7 + FRAC_PI_2 };
                Saddle { at, contrast: 0.3, bright }
            })
            .collect()
    }

    #[test]
    fn a_sheared_board_is_found_among_clutter() {
        let mut corners = board(7, 5);
        for k in 0..30 {
            let at = Point2::new(f64::from(k * 53 % 300), f64::from(k * 97 % 200));
            corners.push(Saddle { at, contrast: 0.1, bright: f64::from(k) });
        }
        let grid = largest_grid(&corners);
        assert_eq!(grid.values().filter(|&&i| i < 35).count(), 35);
        let range = |axis: usize| {
            let places = grid.iter().filter(|(_, i)| **i < 35).map(|(p, _)| p[axis]);
            places.clone().max().unwrap() - places.min().unwrap() + 1
        };
        let mut size = [range(0), range(1)];
        size.sort_unstable();
        assert_eq!(size, [5, 7]);
    }

    #[test]
    fn nothing_without_alternating_corners() {
        let mut corners = board(6, 6);
        corners.iter_mut().for_each(|c| c.bright = 0.7);
        assert!(largest_grid(&corners).is_empty());
    }
}
