//! Recorded inputs against the ranges that the model's file gives them.

use mavsight_flight::InputSeries;
use mavsight_model::{Input, Model, Unit};
use mavsight_pipeline::Finding;
use std::f64::consts::{PI, TAU};

/// Share of a range beyond an end that rounding in a table may reach.
const ROUNDING: f64 = 1e-6;

/// Says of each input that leaves the range of the model's file how far it goes, and whether another unit explains that:
/// degrees for radians, revolutions a minute for radians a second.
pub(crate) fn beyond_range(inputs: &InputSeries, model: &Model) -> Vec<Finding> {
    let notes = model.inputs.iter().filter_map(|input| of_input(&inputs.column(&input.column)?, input));
    notes.map(|note| Finding { causes: vec![], camera: None, note }).collect()
}

fn of_input(values: &[f64], input: &Input) -> Option<String> {
    let (min, max) = (input.min, input.max);
    let span = if (max - min).is_finite() { max - min } else { 0.0 };
    let is_within = |value: f64| value >= min - ROUNDING * span && value <= max + ROUNDING * span;
    let outside = values.iter().filter(|value| !is_within(**value)).count();
    if outside == 0 {
        return None;
    }
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let is_rate = input.unit.is_some() && input.unit == Unit::parse("rad/s").ok();
    let other = [
        (input.is_angle, PI / 180.0, "degrees", "radians"),
        (is_rate, TAU / 60.0, "revolutions a minute", "radians a second"),
    ];
    // What overshoots by less than the range is wide may be in any unit.
    let is_far = (min - least).max(largest - max) > span && span > 0.0;
    let explains = |factor: f64| is_far && values.iter().all(|value| is_within(value * factor));
    let remedy = match other.iter().find(|(is_own, factor, ..)| *is_own && explains(*factor)) {
        Some((_, _, from, to)) => {
            let within = format!("In {from} all would lie within.");
            format!("{within} Give the column in {to}, or correct min and max of the model.")
        }
        None => "Correct the column, or min and max of the model.".to_owned(),
    };
    let rounded = |value: f64| (1e4 * value).round() / 1e4;
    Some(format!(
        "The input {} leaves its range of {min} to {max} in {outside} of {} rows and reaches {} to {}. {remedy}",
        input.column,
        values.len(),
        rounded(least),
        rounded(largest)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavsight_flight::Vehicle;

    /// What is said of the paper's helicopter whose inputs are those of hover, with one input replaced.
    fn said(column: &str, values: [f64; 2]) -> Vec<String> {
        let vehicle = Vehicle::paper();
        let names: Vec<String> = vehicle.input_columns().into_iter().map(str::to_owned).collect();
        let place = names.iter().position(|name| name == column).expect("an input");
        let mut rows = [vehicle.trim(), vehicle.trim()];
        rows.iter_mut().zip(values).for_each(|(row, value)| row[place] = value);
        let inputs = InputSeries::new(names, vec![0.0, 1.0], rows.concat()).expect("a series");
        beyond_range(&inputs, &vehicle.model).into_iter().map(|finding| finding.note).collect()
    }

    #[test]
    fn an_input_in_another_unit_is_named_with_both_units() {
        assert!(said("delta_lon_rad", [-0.35, 0.35]).is_empty());
        let degrees = said("delta_lon_rad", [-10.0, 10.0]).join("");
        assert!(degrees.contains("2 of 2 rows") && degrees.contains("In degrees"), "{degrees}");
        let per_minute = said("omega_u_rad_s", [2000.0, 2100.0]).join("");
        assert!(per_minute.contains("In revolutions a minute"), "{per_minute}");
    }

    #[test]
    fn no_unit_is_blamed_where_it_does_not_explain_the_values() {
        for (column, values) in [
            ("delta_lat_rad", [0.0, 40.0]),
            ("delta_lat_rad", [0.0, 0.36]),
            ("omega_u_rad_s", [200.0, 410.0]),
        ] {
            let said = said(column, values).join("");
            assert!(said.contains("1 of 2 rows") && !said.contains(" would "), "{said}");
        }
    }
}
