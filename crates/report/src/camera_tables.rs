//! The tables of the cameras.

use crate::Table;
use mavsight_geometry::camera_parameters::{CENTRE, DISTORTION, INTRINSICS};
use mavsight_geometry::{CAMERA_PARAMETERS, Camera, Dlt};
use mavsight_pose::Rig;

/// Table 1 of the paper, and the residual of each control point.
pub(crate) fn camera_tables(rig: &Rig) -> Vec<Table> {
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
