//! Corners into rows and columns.

use crate::Vector2;
use std::collections::HashMap;

/// Corners from which a lattice is begun, and neighbours of them that may be next in a row.
const SEEDS: usize = 40;
const NEIGHBOURS: usize = 8;
/// A corner is where the lattice expects it to within this part of a step.
const WITHIN: f64 = 0.3;

type Cells = HashMap<(i32, i32), usize>;

/// The corners of a whole board of so many columns and rows, row by row: along the longer count, clockwise as
/// seen.
pub(super) fn lattice(corners: &[Vector2<f64>], columns: usize, rows: usize) -> Option<Vec<Vector2<f64>>> {
    for seed in 0..corners.len().min(SEEDS) {
        let near = nearest(corners, seed, NEIGHBOURS);
        for (k, a) in near.iter().enumerate() {
            for b in &near[k + 1..] {
                let (along, down) = (corners[*a] - corners[seed], corners[*b] - corners[seed]);
                let sine = along.perp(&down) / (along.norm() * down.norm());
                if sine.abs() < 0.5 {
                    continue;
                }
                // Clockwise as seen, with v down.
                let (first, second) = if sine > 0.0 { (*a, *b) } else { (*b, *a) };
                if let Some(found) = grown(corners, (seed, first, second), columns, rows) {
                    return Some(found);
                }
            }
        }
    }
    None
}

/// So many of the other corners, the nearest first.
pub(super) fn nearest(corners: &[Vector2<f64>], of: usize, count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..corners.len()).filter(|k| *k != of).collect();
    let distance = |k: &usize| (corners[*k] - corners[of]).norm_squared();
    let nearer = |a: &usize, b: &usize| distance(a).total_cmp(&distance(b));
    if order.len() > count {
        order.select_nth_unstable_by(count, nearer);
        order.truncate(count);
    }
    order.sort_by(nearer);
    order
}

/// The lattice that two steps begin, if it is the board.
fn grown(
    corners: &[Vector2<f64>],
    (seed, first, second): (usize, usize, usize),
    columns: usize,
    rows: usize,
) -> Option<Vec<Vector2<f64>>> {
    let mut cells: Cells = [((0, 0), seed), ((1, 0), first), ((0, 1), second)].into();
    let mut open: Vec<(i32, i32)> = vec![(0, 0), (1, 0), (0, 1)];
    while let Some(cell) = open.pop() {
        for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
            let next = (cell.0 + dx, cell.1 + dy);
            if cells.contains_key(&next) {
                continue;
            }
            let Some(step) = step(corners, &cells, cell, (dx, dy)) else { continue };
            let expected = corners[cells[&cell]] + step;
            let Some((k, off)) = corners
                .iter()
                .enumerate()
                .map(|(k, c)| (k, (c - expected).norm()))
                .min_by(|a, b| a.1.total_cmp(&b.1))
            else {
                continue;
            };
            if off < WITHIN * step.norm() && !cells.values().any(|v| *v == k) {
                cells.insert(next, k);
                open.push(next);
                if cells.len() > columns * rows {
                    return None;
                }
            }
        }
    }
    arranged(corners, &cells, columns, rows)
}

/// The step from a cell in a direction: as the one before it, or as that of a neighbour in the next row.
fn step(
    corners: &[Vector2<f64>],
    cells: &Cells,
    cell: (i32, i32),
    (dx, dy): (i32, i32),
) -> Option<Vector2<f64>> {
    let own = corners[cells[&cell]];
    if let Some(before) = cells.get(&(cell.0 - dx, cell.1 - dy)) {
        return Some(own - corners[*before]);
    }
    for side in [1, -1] {
        let beside = (cell.0 + side * dy, cell.1 + side * dx);
        if let (Some(from), Some(to)) = (cells.get(&beside), cells.get(&(beside.0 + dx, beside.1 + dy))) {
            return Some(corners[*to] - corners[*from]);
        }
    }
    None
}

fn arranged(
    corners: &[Vector2<f64>],
    cells: &Cells,
    columns: usize,
    rows: usize,
) -> Option<Vec<Vector2<f64>>> {
    if cells.len() != columns * rows {
        return None;
    }
    let (left, top) = (cells.keys().map(|c| c.0).min()?, cells.keys().map(|c| c.1).min()?);
    let (width, height) =
        (cells.keys().map(|c| c.0).max()? - left + 1, cells.keys().map(|c| c.1).max()? - top + 1);
    let (columns, rows) = (columns as i32, rows as i32);
    let at = |i: i32, j: i32| cells.get(&(left + i, top + j)).map(|k| corners[*k]);
    let mut out = Vec::with_capacity(cells.len());
    for j in 0..rows {
        for i in 0..columns {
            out.push(match (width == columns && height == rows, width == rows && height == columns) {
                (true, _) => at(i, j)?,
                // A quarter turn keeps the order clockwise.
                (_, true) => at(rows - 1 - j, i)?,
                _ => return None,
            });
        }
    }
    Some(out)
}
