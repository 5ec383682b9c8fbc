//! The figures of the report, numbered as in the paper.

use crate::chart::{Chart, Curve, Panel, Role, data, draw};
use crate::heatmap::{HeatMap, draw_heat_maps};
use crate::{Figure, ReportError};
use mavsight_flight::InputSeries;
use mavsight_geometry::{EulerAngles, Isometry3, Vector3};
use mavsight_pose::{
    MapPlane, MotionSample, NORMAL_95, PoseEstimate, PoseSample, Rig, control_volume, euler_std,
    precision_map,
};
use mavsight_session::RunResults;
use mavsight_simulator::FlightState;

type Of<'a, T> = &'a dyn Fn(&T) -> f64;

pub(crate) fn curve(label: &str, role: Role, points: impl Iterator<Item = (f64, f64)>) -> Curve {
    Curve { label: label.to_owned(), role, points: points.collect(), half_width: vec![] }.thinned()
}

pub(crate) fn figure(caption: &str, panels: Vec<Panel>) -> Result<Figure, ReportError> {
    figure_over("time, s", caption, panels)
}

pub(crate) fn figure_over(
    axis: &'static str,
    caption: &str,
    panels: Vec<Panel>,
) -> Result<Figure, ReportError> {
    let chart = Chart { axis, panels };
    Ok(Figure::chart(caption, draw(&chart)?, data(&chart)))
}

fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}

const MAP_CELLS: usize = 30;

pub(crate) fn precision(rig: &Rig, pixel_std_px: f64) -> Result<Vec<Figure>, ReportError> {
    let Some(volume) = control_volume(rig) else { return Ok(vec![]) };
    let values = |plane: MapPlane| precision_map(rig, plane, MAP_CELLS, MAP_CELLS, pixel_std_px).std_mm;
    let maps = HeatMap::through(&volume, MAP_CELLS, values);
    if maps.iter().all(HeatMap::is_empty) {
        return Ok(vec![]);
    }
    let caption = format!(
        "Predicted error (3-D standard deviation) of the place of one ball whose centre is seen with {pixel_std_px:.3} px \
         in each coordinate, with all that is not known of the cameras; crossed out where fewer than two cameras see it."
    );
    Ok(vec![Figure::new(caption, draw_heat_maps(&maps, "mm")?)])
}

/// Figure 7: recorded inputs, two neighbours of one unit in a panel; none where no input was recorded.
pub(crate) fn inputs(recorded: &InputSeries) -> Result<Option<Figure>, ReportError> {
    let units: Vec<InputUnit> = recorded.names().iter().map(|name| InputUnit::of(name)).collect();
    let columns: Vec<usize> = (0..units.len()).collect();
    let alike = columns.chunk_by(|a, b| units[*a] == units[*b]).flat_map(|group| group.chunks(2));
    let panel = |columns: &[usize]| {
        let unit = &units[columns[0]];
        let curves = columns.iter().zip([Role::Estimate, Role::Model]).map(|(k, role)| {
            // Thinned one by one: an hour's inputs are many.
            let rows = recorded.times_s().iter().enumerate();
            let points = rows.map(|(row, t_s)| (*t_s, unit.shown * recorded.row(row)[*k]));
            curve(recorded.names()[*k].trim_end_matches(unit.ending), role, points)
        });
        let names: Vec<&str> =
            columns.iter().map(|k| recorded.names()[*k].trim_end_matches(unit.ending)).collect();
        let axis = match unit.name {
            "" => names.join(", "),
            name => format!("{}, {name}", names.join(", ")),
        };
        Panel { axis, curves: curves.collect() }
    };
    let panels: Vec<Panel> = alike.map(panel).collect();
    (!panels.is_empty()).then(|| figure("Figure 7: recorded inputs.", panels)).transpose()
}

/// The unit at the end of a column's name, and in what it is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
struct InputUnit {
    ending: &'static str,
    name: &'static str,
    shown: f64,
}

impl InputUnit {
    fn of(column: &str) -> Self {
        let known = [
            Self { ending: "_rad_s", name: "rad/s", shown: 1.0 },
            Self { ending: "_rad", name: "°", shown: 180.0 / std::f64::consts::PI },
            Self { ending: "_n", name: "N", shown: 1.0 },
        ];
        let own = known.into_iter().find(|unit| column.ends_with(unit.ending));
        own.unwrap_or(Self { ending: "", name: "", shown: 1.0 })
    }
}

/// Captions of figures 8 to 11, and what their three panels show.
const MOTION: [(&str, [&str; 3]); 4] = [
    ("Figure 8: position in the world.", ["X, m", "Y, m", "Z, m"]),
    ("Figure 9: attitude.", ["roll φ, °", "pitch θ, °", "yaw ψ, °"]),
    ("Figure 10: velocity in body axes.", ["u, m/s", "v, m/s", "w, m/s"]),
    ("Figure 11: angular rates in body axes.", ["p, °/s", "q, °/s", "r, °/s"]),
];

/// The quantities of the figures at one instant, in the figures' units.
struct Quantities {
    t_s: f64,
    values: [Vector3<f64>; 4],
    half_widths: [Vector3<f64>; 4],
}

fn degrees(v: Vector3<f64>) -> Vector3<f64> {
    v.map(f64::to_degrees)
}

fn angles(e: &EulerAngles) -> Vector3<f64> {
    degrees(Vector3::new(e.phi_rad, e.theta_rad, e.psi_rad))
}

/// Position and attitude; nowhere without a pose.
fn of_pose(pose: Option<&Isometry3<f64>>) -> [Vector3<f64>; 2] {
    let of = |p: &Isometry3<f64>| [p.translation.vector, angles(&EulerAngles::from_world_from_body(p))];
    pose.map_or([Vector3::repeat(f64::NAN); 2], of)
}

impl Quantities {
    fn of_sample(s: &MotionSample) -> Self {
        let [position, attitude] = of_pose(Some(&s.world_from_body));
        let std = |k: usize| s.covariance.quantity(k).diagonal().map(|v| v.max(0.0).sqrt());
        let turn = euler_std(&s.world_from_body, &s.covariance.quantity(1));
        Self {
            t_s: seconds(s.t_ns),
            values: [position, attitude, s.velocity_in_body_m_s, degrees(s.rates_rad_s)],
            half_widths: [std(0), degrees(turn), std(2), degrees(std(3))].map(|std| NORMAL_95 * std),
        }
    }

    fn of_truth(s: &FlightState) -> Self {
        let values =
            [s.position_in_world_m, angles(&s.attitude), s.velocity_in_body_m_s, degrees(s.rates_rad_s)];
        Self { t_s: s.t_s, values, half_widths: [Vector3::zeros(); 4] }
    }

    /// Where the motion is not known, curves are broken.
    fn unknown(t_ns: i64) -> Self {
        let nothing = [Vector3::repeat(f64::NAN); 4];
        Self { t_s: seconds(t_ns), values: nothing, half_widths: nothing }
    }
}

/// Figures 8 to 11: single poses, smoothed motion, and truth where it is known.
pub(crate) fn motion(
    results: &RunResults,
    truth: Option<&[FlightState]>,
) -> Result<Vec<Figure>, ReportError> {
    let Some(motion) = &results.motion else { return Ok(vec![]) };
    let pose = |p: &PoseSample| of_pose(p.estimate.as_ref().ok().map(|e| &e.world_from_body));
    let measured: Vec<_> = results.poses.iter().map(|p| (seconds(p.t_ns), pose(p))).collect();
    let known = motion.samples.iter().map(Quantities::of_sample);
    let mut smoothed: Vec<Quantities> =
        known.chain(motion.unknown_ns.iter().map(|t_ns| Quantities::unknown(*t_ns))).collect();
    smoothed.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    let truth: Option<Vec<Quantities>> = truth.map(|t| t.iter().map(Quantities::of_truth).collect());
    let panel = |figure: usize, k: usize| {
        let mut curves = Vec::new();
        if figure < 2 {
            let points = measured.iter().map(|(t_s, pose)| (*t_s, pose[figure][k]));
            curves.push(curve("single frames", Role::Measured, points));
        }
        let value = |q: &Quantities| (q.t_s, q.values[figure][k]);
        let (points, half_width) = smoothed.iter().map(|q| (value(q), q.half_widths[figure][k])).unzip();
        let label = "smoothed, 95 %".to_owned();
        curves.push(Curve { label, role: Role::Estimate, points, half_width }.thinned());
        curves.extend(truth.iter().map(|truth| curve("truth", Role::Truth, truth.iter().map(value))));
        Panel { axis: MOTION[figure].1[k].to_owned(), curves }
    };
    let drawn = |k: usize| figure(MOTION[k].0, (0..3).map(|axis| panel(k, axis)).collect());
    (0..MOTION.len()).map(drawn).collect()
}

pub(crate) fn quality(results: &RunResults) -> Result<Vec<Figure>, ReportError> {
    let poses = &results.poses;
    if !poses.iter().any(|p| p.estimate.is_ok()) {
        return Ok(vec![]);
    }
    let panel = |axis: &str, f: Of<'_, PoseEstimate>| {
        let points = poses.iter().map(|p| (seconds(p.t_ns), p.estimate.as_ref().map_or(f64::NAN, f)));
        Panel { axis: axis.to_owned(), curves: vec![curve("single frames", Role::Estimate, points)] }
    };
    let trace = |e: &PoseEstimate, at: usize| e.covariance().fixed_view::<3, 3>(at, at).trace();
    Ok(vec![figure(
        "Each frame: reprojection residual, and the predicted errors of position (3-D) and attitude (an axis).",
        vec![
            panel("residual, px", &|e| e.residual_px.unwrap_or(f64::NAN)),
            panel("position, mm", &|e| 1e3 * trace(e, 0).sqrt()),
            panel("attitude, °", &|e| (trace(e, 3) / 3.0).sqrt().to_degrees()),
        ],
    )?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_of_any_aircraft_are_drawn_under_their_names() {
        let of = |names: &[&str]| {
            let all: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
            let values = (0..2 * names.len()).map(|k| k as f64).collect();
            inputs(&InputSeries::new(all, vec![0.0, 1.0], values).expect("inputs"))
        };
        let quadrotor = of(&["motor_1", "motor_2"]).expect("a figure").expect("inputs").markup;
        assert!(quadrotor.contains("motor_1") && quadrotor.contains("motor_2"));
        let columns = ["omega_u_rad_s", "omega_l_rad_s", "delta_lon_rad", "delta_lat_rad"];
        let helicopter = of(&columns).expect("a figure").expect("inputs").markup;
        assert!(
            helicopter.contains("omega_u, omega_l, rad/s") && helicopter.contains("delta_lon, delta_lat, °")
        );
        assert!(of(&[]).expect("nothing to draw").is_none());
    }
}
