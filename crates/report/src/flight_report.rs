//! The report of a flight: what a reader sees first, and which figures and tables of the paper follow.

use crate::camera_tables::camera_tables;
use crate::findings::MOST;
use crate::intervals::Estimates;
use crate::sections::pixel_std_px;
use crate::summary::title;
use crate::{Figure, Film, Report, ReportError, Row, Summary, Table};
use crate::{equation_error, figures, output_error, overlay, overview, render};
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_session::{RunResults, results::names, write_whole};
use mavsight_simulator::FlightState;
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
    /// The session file, where there is one: by it a film of what was found can be made.
    pub session: Option<&'a Path>,
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
    let overlays = overlay::overlays(flight.vehicle, results)?;
    let motion = figures::motion(results, flight.truth)?;
    let coefficients = equation_error::figures(results)?;
    let mut report = Report {
        title: results.session.clone(),
        lead: overview::sentences(flight.vehicle, results, summary),
        overview: overview::pictures(results, &overlays, &motion, &coefficients),
        film: flight.session.map(|session| film(session, out)),
        parameters: Estimates::of(results).table(flight.vehicle),
        advice: summary.advice.iter().take(MOST).cloned().collect(),
        ..Report::default()
    };
    report.fold("Verdicts on the parameters", summary.verdicts.clone(), vec![], vec![]);
    report.fold("Notes", summary.notes.clone(), vec![], vec![]);
    report.fold("Figures of merit", vec![], summary_tables(summary), vec![]);
    report.fold("Quality of each instant", vec![], vec![], figures::quality(results)?);
    let estimators = output_error::tables(results);
    report.fold("Estimators side by side", vec![], estimators, vec![]);
    let mut tables: Vec<Table> = Vec::new();
    let mut drawn: Vec<Figure> = Vec::new();
    if let Some(rig) = &results.rig {
        let (of_paper, others) = split(camera_tables(rig), |t| is_of_paper(&t.caption));
        tables.extend(of_paper);
        report.fold("Cameras", vec![], others, figures::precision(rig, pixel_std_px(results))?);
        drawn.extend(overlay::pictures(results, &overlays)?);
    }
    tables.push(vehicle_table(flight.vehicle));
    drawn.extend(flight.inputs.map(figures::inputs).transpose()?.flatten());
    drawn.extend(motion);
    let (of_paper, others) = split(equation_error::tables(results), |t| is_of_paper(&t.caption));
    tables.extend(of_paper);
    let (of_flight, residuals) = split(coefficients, |f| is_of_paper(&f.caption));
    drawn.extend(of_flight);
    report.fold("Equation error in detail", vec![], others, residuals);
    report.fold("Appendix: as in the paper", vec![], tables, drawn);
    write_whole(&out.join(names::REPORT), render(&report)?.as_bytes())?;
    Ok(())
}

/// The film beside the report, and the command that makes it.
fn film(session: &Path, out: &Path) -> Film {
    let path = out.join(names::FILM);
    let command = format!("mavsight overlay {} --out {}", session.display(), path.display());
    Film { file: names::FILM.to_owned(), command, is_there: path.is_file() }
}

/// Whether a table or a figure bears a number of the paper.
fn is_of_paper(caption: &str) -> bool {
    ["Table ", "Figure "].iter().any(|word| caption.starts_with(word))
}

fn split<T>(all: Vec<T>, is_first: impl Fn(&T) -> bool) -> (Vec<T>, Vec<T>) {
    all.into_iter().partition(is_first)
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
