//! The report of a run: which figures and tables of the paper it shows.

use crate::summary::{Summary, pixel_std_px, title};
use crate::{figures, fits, motion_fits};
use anyhow::Result;
use mavsight_flight::{InputSeries, Vehicle};
use mavsight_geometry::camera_parameters::{CENTRE, DISTORTION, INTRINSICS};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Dlt};
use mavsight_pose::Rig;
use mavsight_report::{Figure, Report, Table, render};
use mavsight_session::{RunResults, TruthRow, results::names, write_whole};
use mavsight_vision::Frame;
use std::path::Path;

/// What the report is made of.
pub(crate) struct Page<'a> {
    pub(crate) vehicle: &'a Vehicle,
    pub(crate) inputs: Option<&'a InputSeries>,
    pub(crate) truth: Option<&'a [TruthRow]>,
    pub(crate) frames: &'a [Frame],
}

/// Writes `report.html`.
pub(crate) fn write_page(page: &Page<'_>, results: &RunResults, summary: &Summary, out: &Path) -> Result<()> {
    let mut report = Report {
        title: format!("mavsight: {}", results.session),
        lead: lead(page, results),
        headline: headline(summary),
        verdicts: summary.verdicts.clone(),
        notes: summary.notes.clone(),
        sections: Vec::new(),
    };
    let mut section = |heading: &str, tables: Vec<Table>, figures: Vec<Figure>| {
        if !tables.is_empty() || !figures.is_empty() {
            report.sections.push((heading.to_owned(), tables, figures));
        }
    };
    section("Figures of merit", summary_tables(summary), vec![]);
    if let Some(rig) = &results.rig {
        let mut pictures = figures::precision(rig, pixel_std_px(results))?;
        pictures.extend(figures::pictures(page, results)?);
        section("Cameras", camera_tables(rig), pictures);
    }
    let inputs = page.inputs.map(figures::inputs).transpose()?;
    section("Aircraft and inputs", vec![vehicle_table(page)], inputs.into_iter().collect());
    section("Motion", vec![], figures::motion(results, page.truth)?);
    section("Coefficients", fits::tables(results), fits::figures(results)?);
    section("Equations of motion", motion_fits::tables(results), vec![]);
    section("Quality", vec![], figures::quality(results)?);
    write_whole(&out.join(names::REPORT), render(&report)?.as_bytes())?;
    Ok(())
}

fn lead(page: &Page<'_>, results: &RunResults) -> String {
    let instants = results.poses.len();
    let end_s = results.poses.last().map_or(0.0, |p| p.t_ns as f64 * 1e-9);
    let truth = if page.truth.is_some() { " Truth is drawn as a black dashed line." } else { "" };
    format!("{}: {instants} instants over {end_s:.1} s.{truth}", page.vehicle.name)
}

/// The few figures that a reader looks for first.
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
    let mut tables: Vec<Table> = Vec::new();
    for row in summary.rows.iter().filter(|r| !r.shown.is_empty() && r.section != "parameters") {
        let caption = title(row.section);
        if tables.last().is_none_or(|t| t.caption != caption) {
            tables.push(Table {
                caption: caption.to_owned(),
                header: vec!["figure".into(), "value".into()],
                rows: vec![],
            });
        }
        if let Some(table) = tables.last_mut() {
            table.rows.push(vec![row.label.clone(), row.shown.clone()]);
        }
    }
    tables
}

/// Table 1 of the paper, and the residual of each control point.
fn camera_tables(rig: &Rig) -> Vec<Table> {
    let names: Vec<String> = rig.cameras.iter().map(|c| c.name.clone()).collect();
    let header = |first: &str| std::iter::once(first.to_owned()).chain(names.clone()).collect::<Vec<_>>();
    let dlt = Table {
        caption:
            "Table 1: the eleven DLT parameters, pixels counted from 0 at the centre of the top-left pixel."
                .to_owned(),
        header: header("parameter"),
        rows: (0..11)
            .map(|k| {
                let cells = rig
                    .cameras
                    .iter()
                    .map(|c| Dlt::from_camera(&c.camera).map_or(String::new(), |dlt| six_digits(dlt.l[k])));
                std::iter::once(format!("L{}", k + 1)).chain(cells).collect()
            })
            .collect(),
    };
    let mut points: Vec<&String> =
        rig.cameras.iter().flat_map(|c| c.points.iter().map(|p| &p.name)).collect();
    points.sort();
    points.dedup();
    let residuals = Table {
        caption:
            "Residual of each control point (u, v), px, and in brackets its studentised size: 1 is usual. \
                  A point marked × was left out; empty where it was not seen."
                .to_owned(),
        header: header("point"),
        rows: points
            .iter()
            .map(|name| {
                let cells = rig.cameras.iter().map(|c| {
                    let found = c.points.iter().find(|p| p.name == **name);
                    found.map_or(String::new(), |p| {
                        let mark = if p.used { "" } else { " ×" };
                        let r = p.residual_px;
                        format!("{:+.3}, {:+.3} ({:.1}){mark}", r.x, r.y, p.studentised)
                    })
                });
                std::iter::once((*name).clone()).chain(cells).collect()
            })
            .collect(),
    };
    vec![parameters_table(rig), dlt, residuals]
}

/// Six significant digits.
fn six_digits(value: f64) -> String {
    let digits = if value == 0.0 { 6.0 } else { (5.0 - value.abs().log10().floor()).clamp(0.0, 12.0) };
    format!("{value:.0$}", digits as usize)
}

/// One parameter of a camera.
type OfCamera = fn(&Camera) -> f64;

/// The cameras that were estimated, each with the standard deviations of its parameters.
fn parameters_table(rig: &Rig) -> Table {
    let names = rig.cameras.iter().map(|c| c.name.clone());
    let std = |camera: usize, row: usize| rig.uncertainty.rows(CAMERA_PARAMETERS * camera + row, 1).norm();
    let with_std = |value: f64, std: f64, digits: usize| {
        if std > 0.0 { format!("{value:.digits$} ± {std:.digits$}") } else { format!("{value:.digits$}") }
    };
    let row = |label: &str, digits: usize, at: usize, of: &dyn Fn(&Camera) -> f64| {
        let cells = rig.cameras.iter().enumerate().map(|(k, c)| with_std(of(&c.camera), std(k, at), digits));
        std::iter::once(label.to_owned()).chain(cells).collect::<Vec<_>>()
    };
    let models = rig.cameras.iter().map(|c| c.model.to_string());
    let mut rows = vec![std::iter::once("model".to_owned()).chain(models).collect()];
    for (k, axis) in ["X", "Y", "Z"].iter().enumerate() {
        rows.push(row(&format!("centre {axis}, m"), 4, CENTRE + k, &|c| c.centre_in_world()[k]));
    }
    let linear: [(&str, OfCamera); 5] = [
        ("f_x, px", |c| c.intrinsics.fx_px),
        ("f_y, px", |c| c.intrinsics.fy_px),
        ("skew, px", |c| c.intrinsics.skew_px),
        ("principal point u, px", |c| c.intrinsics.cx_px),
        ("principal point v, px", |c| c.intrinsics.cy_px),
    ];
    for (k, (label, of)) in linear.iter().enumerate() {
        rows.push(row(label, 2, INTRINSICS + k, of));
    }
    let lens: [(&str, OfCamera); 5] = [
        ("k1", |c| c.distortion.k1),
        ("k2", |c| c.distortion.k2),
        ("p1", |c| c.distortion.p1),
        ("p2", |c| c.distortion.p2),
        ("k3", |c| c.distortion.k3),
    ];
    for (k, (label, of)) in lens.iter().enumerate() {
        let known = (0..rig.cameras.len()).all(|c| std(c, DISTORTION + k) == 0.0);
        if !known || rig.cameras.iter().any(|c| of(&c.camera) != 0.0) {
            rows.push(row(label, 5, DISTORTION + k, of));
        }
    }
    Table {
        caption: "The cameras: most probable model, parameters and standard deviations.".to_owned(),
        header: std::iter::once("parameter".to_owned()).chain(names).collect(),
        rows,
    }
}

/// Table 2 of the paper.
fn vehicle_table(page: &Page<'_>) -> Table {
    let (v, r, e) = (page.vehicle, &page.vehicle.rotor, &page.vehicle.environment);
    let row = |name: &str, value: String, unit: &str| vec![name.to_owned(), value, unit.to_owned()];
    let [ix, iy, iz] = v.inertia_kg_m2;
    Table {
        caption: "Table 2: constants of the vehicle file.".to_owned(),
        header: vec!["constant".into(), "value".into(), "unit".into()],
        rows: vec![
            row("air density ρ", e.air_density_kg_m3.to_string(), "kg/m³"),
            row("gravity g", e.gravity_m_s2.to_string(), "m/s²"),
            row("mass m", v.mass_kg.to_string(), "kg"),
            row("rotor radius R", r.radius_m.to_string(), "m"),
            row("inertia I_xx, I_yy, I_zz", format!("{ix}, {iy}, {iz}"), "kg m²"),
            row("thrust coefficient, upper", r.thrust_coefficient_upper.to_string(), ""),
            row("thrust coefficient, lower", r.thrust_coefficient_lower.to_string(), ""),
            row("flapping time, lower rotor τ_fl", r.flap_time_lower_s.to_string(), "s"),
            row("flapping time, fly-bar τ_ff", r.flap_time_flybar_s.to_string(), "s"),
            row("linkage K_b", r.swashplate_gain.to_string(), ""),
            row("linkage K_u (not in the paper)", r.flybar_gain.to_string(), ""),
        ],
    }
}
