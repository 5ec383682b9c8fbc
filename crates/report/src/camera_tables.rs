//! The tables of the cameras.

use crate::Table;
use crate::html::row;
use mavsight_geometry::camera_parameters::{CENTRE, DISTORTION, INTRINSICS};
use mavsight_geometry::{CAMERA_PARAMETERS, Dlt};
use mavsight_pose::Rig;
use std::collections::BTreeSet;

/// Labels and decimals of the parameters of a camera, in their order from the projection centre on.
const PARAMETERS: [(&str, usize); 13] = [
    ("centre X, m", 4),
    ("centre Y, m", 4),
    ("centre Z, m", 4),
    ("f_x, px", 2),
    ("f_y, px", 2),
    ("skew, px", 2),
    ("principal point u, px", 2),
    ("principal point v, px", 2),
    ("k1", 5),
    ("k2", 5),
    ("p1", 5),
    ("p2", 5),
    ("k3", 5),
];

pub(crate) fn camera_tables(rig: &Rig) -> Vec<Table> {
    let header = |first: &str| row(first, rig.cameras.iter().map(|c| c.name.clone()));
    let parameters: Vec<Option<Dlt>> = rig.cameras.iter().map(|c| Dlt::from_camera(&c.camera).ok()).collect();
    let dlt = (0..11).map(|k| {
        let cells = parameters.iter().map(|dlt| dlt.map_or(String::new(), |dlt| six_digits(dlt.l[k])));
        row(format!("L{}", k + 1), cells)
    });
    let caption =
        "Table 1: the eleven DLT parameters, pixels counted from 0 at the centre of the top-left pixel.";
    let dlt = Table::new(caption, header("parameter"), dlt.collect());
    let names: BTreeSet<&String> =
        rig.cameras.iter().flat_map(|c| c.points.iter().map(|p| &p.name)).collect();
    let residuals = names.into_iter().map(|name| {
        let cells = rig.cameras.iter().map(|c| {
            let found = c.points.iter().find(|p| p.name == *name);
            found.map_or(String::new(), |p| {
                let mark = if p.used { "" } else { " ×" };
                let r = p.residual_px;
                format!("{:+.3}, {:+.3} ({:.1}){mark}", r.x, r.y, p.studentised)
            })
        });
        row(name, cells)
    });
    let caption = "Residual of each control point (u, v), px, and in brackets its studentised size: 1 is usual. \
                   A point marked × was left out; empty where it was not seen.";
    vec![parameters_table(rig), dlt, Table::new(caption, header("point"), residuals.collect())]
}

fn six_digits(value: f64) -> String {
    let digits = if value == 0.0 { 6.0 } else { (5.0 - value.abs().log10().floor()).clamp(0.0, 12.0) };
    format!("{value:.0$}", digits as usize)
}

/// The cameras that were estimated, each with the standard deviations of its parameters.
fn parameters_table(rig: &Rig) -> Table {
    let std = |camera: usize, at: usize| rig.uncertainty.rows(CAMERA_PARAMETERS * camera + at, 1).norm();
    let value = |camera: usize, at: usize| {
        let camera = &rig.cameras[camera].camera;
        if at < INTRINSICS { camera.centre_in_world()[at - CENTRE] } else { camera.lens()[at - INTRINSICS] }
    };
    let all = 0..rig.cameras.len();
    let mut rows = vec![row("model", rig.cameras.iter().map(|c| c.model.to_string()))];
    for (k, (label, digits)) in PARAMETERS.into_iter().enumerate() {
        let at = CENTRE + k;
        if at < DISTORTION || all.clone().any(|c| std(c, at) != 0.0 || value(c, at) != 0.0) {
            let cells = all.clone().map(|c| match (value(c, at), std(c, at)) {
                (value, std) if std > 0.0 => format!("{value:.digits$} ± {std:.digits$}"),
                (value, _) => format!("{value:.digits$}"),
            });
            rows.push(row(label, cells));
        }
    }
    let caption = "The cameras: most probable model, parameters and standard deviations.";
    Table::new(caption, row("parameter", rig.cameras.iter().map(|c| c.name.clone())), rows)
}
