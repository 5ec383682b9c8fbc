//! Distances between control balls as they are written down.

use crate::SessionError;
use crate::table::{Row, Table};
use mavsight_pose::{MeasuredBetween, NetworkMeasurement};
use std::collections::HashSet;
use std::path::Path;

/// What stands in the column `to` where a row is a height.
const FLOOR: &str = "floor";
/// What stands in place of a distance where a row is a plumb line.
const PLUMB: &str = "plumb";

/// Measured distances, heights and plumb lines, and the names of the points in the order of their first appearance.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DistanceTable {
    /// Names of the points.
    pub names: Vec<String>,
    /// Measurements, by the numbers of the points.
    pub measured: Vec<NetworkMeasurement>,
}

impl DistanceTable {
    /// Reads `from,to,distance_m` and, if it is there, `std_m`; a cell of it that is empty is the tape's, `tape_std_m`.
    ///
    /// A row whose distance is empty was not measured. Its names count for the order of the points, unless nothing was
    /// measured of them at all.
    ///
    /// # Errors
    /// Names the file, row and column; a table without any measurement.
    pub fn read(path: &Path, tape_std_m: f64) -> Result<Self, SessionError> {
        let table = Table::read(path, "distances")?;
        let [from, to, distance] = table.columns(["from", "to", "distance_m"])?;
        let std = table.column("std_m").ok();
        let mut all = Self::default();
        let is_measured = |row: &Row<'_>| !row.text(distance).is_empty();
        let measured_names: HashSet<&str> =
            table.rows()?.filter(is_measured).flat_map(|row| [row.text(from), row.text(to)]).collect();
        for row in table.rows()? {
            for name in [row.text(from), row.text(to)].into_iter().filter(|n| *n != FLOOR) {
                if measured_names.contains(name) {
                    all.point(name);
                }
            }
            if !is_measured(&row) {
                continue;
            }
            let std_m = std.map_or(Ok(None), |column| row.number_if_any(column))?.unwrap_or(tape_std_m);
            let added = all.add([row.text(from), row.text(to), row.text(distance)], std_m);
            added.map_err(|detail| row.refuse(distance, detail))?;
        }
        if all.measured.is_empty() {
            return Err(SessionError::file(
                path,
                "no distance is filled in: write what was measured in metres, as 3.002",
            ));
        }
        Ok(all)
    }

    /// Adds a row: the two points and their distance, `floor` as the second for a height, `plumb` as the distance where
    /// the first hangs above the second.
    ///
    /// # Errors
    /// What is wrong with it, and how it is written.
    pub fn add(&mut self, [from, to, distance]: [&str; 3], std_m: f64) -> Result<(), String> {
        if from.is_empty() || to.is_empty() || from == FLOOR {
            return Err("a distance is between two balls: give both names".into());
        }
        let first = self.point(from);
        let (between, value_m) = if distance == PLUMB {
            (MeasuredBetween::Plumb(first, self.point(to)), 0.0)
        } else {
            let value_m = distance.parse::<f64>().ok().filter(|v| v.is_finite());
            let value_m =
                value_m.ok_or_else(|| format!("{distance:?} is no distance: give metres, as 3.002"))?;
            let of_two = |all: &mut Self| MeasuredBetween::Distance(first, all.point(to));
            (if to == FLOOR { MeasuredBetween::Height(first) } else { of_two(self) }, value_m)
        };
        self.measured.push(NetworkMeasurement { between, value_m, std_m });
        Ok(())
    }

    fn point(&mut self, name: &str) -> usize {
        self.names.iter().position(|n| n == name).unwrap_or_else(|| {
            self.names.push(name.to_owned());
            self.names.len() - 1
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_distances_heights_and_plumb_lines() {
        let mut all = DistanceTable::default();
        all.add(["red", "green", "3.002"], 0.002).unwrap();
        all.add(["green", "floor", "0.05"], 0.001).unwrap();
        all.add(["blue", "red", "plumb"], 0.002).unwrap();
        assert_eq!(all.names, ["red", "green", "blue"]);
        let between: Vec<_> = all.measured.iter().map(|m| (m.between, m.value_m)).collect();
        assert_eq!(between[0], (MeasuredBetween::Distance(0, 1), 3.002));
        assert_eq!(between[1], (MeasuredBetween::Height(1), 0.05));
        assert_eq!(between[2], (MeasuredBetween::Plumb(2, 0), 0.0));
        assert!(all.add(["red", "blue", "3 m"], 0.002).unwrap_err().contains("3.002"));
    }
    #[test]
    fn rows_without_a_distance_were_not_measured() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("distances.csv");
        let read = |rows: &str| {
            std::fs::write(&path, format!("from,to,distance_m,std_m\n{rows}")).unwrap();
            DistanceTable::read(&path, 0.002)
        };
        let all =
            read("red,green,,\nred,blue,3.1,\nred,brown,,\ngreen,floor,0.05,0.001\nbrown,floor,,\n").unwrap();
        // The order is that of the form; brown was not measured at all.
        assert_eq!(all.names, ["red", "green", "blue"]);
        let stds: Vec<f64> = all.measured.iter().map(|m| m.std_m).collect();
        assert_eq!(stds, [0.002, 0.001]);
        let refused = read("red,green,,\n").unwrap_err().to_string();
        assert!(refused.contains("no distance is filled in"), "{refused}");
    }
}
