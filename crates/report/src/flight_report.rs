//! The report of a flight: which figures and tables of the paper it shows.

use crate::camera_tables::camera_tables;
use crate::sections::pixel_std_px;
use crate::summary::title;
use crate::{Report, ReportError, Row, Summary, Table, equation_error, figures, output_error, render};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_session::{RunResults, results::names, write_whole};
use mavsight_simulator::FlightState;
use mavsight_vision::Frame;
use std::path::Path;

/// What a report shows in addition to the results.
#[derive(Debug, Clone, Copy)]
pub struct FlightReport<'a> {
    /// The aircraft.
    pub vehicle: &'a Vehicle,
    /// Recorded inputs, where there are any.
    pub inputs: Option<&'a InputSeries>,
    /// Truth, drawn next to the estimates.
    pub truth: Option<&'a [FlightState]>,
    /// The first frame of each camera.
    pub frames: &'a [Frame],
}

/// Writes `report.html` into a folder.
///
/// # Errors
/// A figure that cannot be drawn, or what the file system refuses.
pub fn write_report(
    flight: &FlightReport<'_>,
    results: &RunResults,
    summary: &Summary,
    out: &Path,
) -> Result<(), ReportError> {
    let mut report = Report {
        title: format!("mavsight: {}", results.session),
        lead: lead(flight, results),
        headline: headline(summary),
        verdicts: summary.verdicts.clone(),
        notes: summary.notes.clone(),
        sections: Vec::new(),
    };
    report.add("Figures of merit", summary_tables(summary), vec![]);
    if let Some(rig) = &results.rig {
        let mut pictures = figures::precision(rig, pixel_std_px(results))?;
        pictures.extend(figures::pictures(flight.frames, results)?);
        report.add("Cameras", camera_tables(rig), pictures);
    }
    let inputs = flight.inputs.map(figures::inputs).transpose()?.flatten();
    report.add("Aircraft and inputs", vec![vehicle_table(flight.vehicle)], inputs.into_iter().collect());
    report.add("Motion", vec![], figures::motion(results, flight.truth)?);
    report.add("Coefficients", equation_error::tables(results), equation_error::figures(results)?);
    report.add("Equations of motion", output_error::tables(results), vec![]);
    report.add("Quality", vec![], figures::quality(results)?);
    write_whole(&out.join(names::REPORT), render(&report)?.as_bytes())?;
    Ok(())
}

fn lead(flight: &FlightReport<'_>, results: &RunResults) -> String {
    let instants = results.poses.len();
    let end_s = results.poses.last().map_or(0.0, |p| p.t_ns as f64 * 1e-9);
    let truth = if flight.truth.is_some() { " Truth is drawn as a black dashed line." } else { "" };
    format!("{}: {instants} instants over {end_s:.1} s.{truth}", flight.vehicle.name)
}

fn headline(summary: &Summary) -> Vec<(String, String)> {
    let wanted = [
        ("poses", "measured", "frames measured"),
        ("motion", "position_std_mm", "predicted position error"),
        ("truth", "motion_position_rms_mm", "position error against truth"),
        ("truth", "motion_attitude_rms_deg", "roll, pitch, yaw error against truth"),
        ("fit", "C_X_r2", "R² of C_X"),
        ("fit", "C_m_r2", "R² of C_m"),
    ];
    wanted
        .iter()
        .filter_map(|(section, key, label)| {
            let row = summary.rows.iter().find(|r| r.section == *section && r.key == *key)?;
            Some(((*label).to_owned(), row.shown.clone()))
        })
        .collect()
}

fn summary_tables(summary: &Summary) -> Vec<Table> {
    let rows: Vec<&Row> = summary.shown().collect();
    let sections = rows.chunk_by(|a, b| a.section == b.section);
    let table = |rows: &[&Row]| {
        let cells = rows.iter().map(|r| vec![r.label.clone(), r.shown.clone()]);
        Table::new(title(rows[0].section), ["figure", "value"], cells.collect())
    };
    sections.map(table).collect()
}

fn vehicle_table(v: &Vehicle) -> Table {
    let e = &v.environment;
    let inertia = v.inertia_kg_m2.map(|i| i.to_string()).join(", ");
    let body = [
        ("air density ρ", e.air_density_kg_m3.to_string(), "kg/m³"),
        ("gravity g", e.gravity_m_s2.to_string(), "m/s²"),
        ("mass m", v.mass_kg.to_string(), "kg"),
        ("inertia I_xx, I_yy, I_zz", inertia, "kg m²"),
    ];
    let body = body.map(|(name, value, unit)| vec![name.to_owned(), value, unit.to_owned()]);
    let of_model = v.parameters.iter().map(|(name, value)| {
        let p = v.model.parameter(name).map(|k| &v.model.parameters[k]);
        let text = p.map_or("", |p| p.text.as_str());
        let unit = p.and_then(|p| p.unit).map_or_else(String::new, |unit| unit.to_string());
        let name = if text.is_empty() { name.clone() } else { format!("{name}: {text}") };
        vec![name, value.to_string(), if unit == "1" { String::new() } else { unit }]
    });
    let rows = body.into_iter().chain(of_model).collect();
    let caption = format!("Table 2: constants of the vehicle file; flight model: {}.", v.model.name);
    Table::new(caption, ["constant", "value", "unit"], rows)
}
