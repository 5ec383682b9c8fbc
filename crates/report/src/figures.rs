//! The figures of the report, numbered as in the paper.

use crate::chart::{Chart, Curve, Panel, Role, draw};
use crate::heatmap::{HeatMap, draw_heat_maps};
use crate::html::{data_address, image};
use crate::{Figure, ReportError};
use mavsight_flight::InputSeries;
use mavsight_geometry::{EulerAngles, ImageSize, Isometry3, Vector2, Vector3};
use mavsight_pose::{
    MapPlane, MotionSample, PoseEstimate, PoseSample, Rig, control_volume, euler_std, precision_map,
};
use mavsight_session::RunResults;
use mavsight_simulator::FlightState;
use mavsight_vision::Frame;

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
    Ok(Figure { caption: caption.to_owned(), markup: draw(&Chart { axis, panels })? })
}

fn seconds(t_ns: i64) -> f64 {
    t_ns as f64 * 1e-9
}

const NORMAL_95: f64 = 1.959_964;

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
    Ok(vec![Figure { caption, markup: draw_heat_maps(&maps, "mm")? }])
}

/// Figure 4: the object from the first camera; figure 6: the flight's path over a frame of each camera.
pub(crate) fn pictures(frames: &[Frame], results: &RunResults) -> Result<Vec<Figure>, ReportError> {
    let mut figures = Vec::new();
    let Some(rig) = &results.rig else { return Ok(figures) };
    for (k, (camera, frame)) in rig.cameras.iter().zip(frames).enumerate() {
        let seen = results.poses.iter().map(|p| {
            let place = p.estimate.as_ref().ok()?.world_from_body.translation.vector;
            Some(camera.camera.project(&place).ok()?.pixel)
        });
        let seen: Vec<Option<Vector2<f64>>> = seen.collect();
        if let Some(first) = seen.iter().flatten().next().filter(|_| k == 0) {
            let caption = "Figure 4: the observed object, from the first frame of the first camera.";
            figures.push(Figure { caption: caption.to_owned(), markup: image(&close_up(frame, first)?) });
        }
        let ImageSize { width_px, height_px } = frame.size;
        let picture = png(frame.to_rgb(), width_px, height_px)?;
        let caption = format!("Figure 6: path of the body origin over the first frame of {}.", camera.name);
        figures.push(Figure { caption, markup: with_path(&picture, frame.size, &seen) });
    }
    Ok(figures)
}

/// A picture with a white line on a black one over it, broken where there is no point.
fn with_path(png: &[u8], size: ImageSize, points: &[Option<Vector2<f64>>]) -> String {
    let (mut path, mut last) = (String::new(), None::<Vector2<f64>>);
    for point in points {
        let Some(p) = point else {
            last = None;
            continue;
        };
        // Steps of less than half a pixel do not show.
        if last.is_none_or(|last| (p - last).norm() > 0.5) {
            // The middle of the first pixel is half a pixel from the corner.
            path += &format!("{}{:.1} {:.1}", if last.is_some() { "L" } else { "M" }, p.x + 0.5, p.y + 0.5);
            last = Some(*p);
        }
    }
    let line = |color: &str, width: f64| {
        format!("<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\"/>")
    };
    format!(
        "<svg role=\"img\" viewBox=\"0 0 {0} {1}\"><image width=\"{0}\" height=\"{1}\" href=\"{2}\"/>{3}{4}</svg>",
        size.width_px,
        size.height_px,
        data_address(png),
        line("#000", 3.5),
        line("#fff", 1.8)
    )
}

/// A window of a quarter of the frame around a point, enlarged fourfold.
fn close_up(frame: &Frame, at: &Vector2<f64>) -> Result<Vec<u8>, ReportError> {
    const ENLARGE: u32 = 4;
    let (width, height) = (frame.size.width_px / 4, frame.size.height_px / 5);
    let place =
        |c: f64, half: u32, end: u32| (c - f64::from(half / 2)).clamp(0.0, f64::from(end - half)) as u32;
    let (x0, y0) = (place(at.x, width, frame.size.width_px), place(at.y, height, frame.size.height_px));
    let mut rgb = Vec::with_capacity((width * height * ENLARGE * ENLARGE * 3) as usize);
    for y in 0..height * ENLARGE {
        for x in 0..width * ENLARGE {
            rgb.extend(frame.rgb((x0 + x / ENLARGE) as usize, (y0 + y / ENLARGE) as usize));
        }
    }
    png(rgb, width * ENLARGE, height * ENLARGE)
}

fn png(rgb: Vec<u8>, width: u32, height: u32) -> Result<Vec<u8>, ReportError> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::from_raw(width, height, rgb).ok_or(ReportError::Picture)?;
    image.write_to(&mut bytes, image::ImageFormat::Png).map_err(|_| ReportError::Picture)?;
    Ok(bytes.into_inner())
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
            panel("residual, px", &|e| e.residual_px),
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
