//! The figures of the report, numbered as in the paper.

use crate::{Chart, Curve, Figure, HeatMap, Panel, ReportError, Role, draw, draw_heat_maps, png_figure};
use mavsight_geometry::{EulerAngles, Isometry3, Vector2, Vector3};
use mavsight_pose::{MotionSample, Rig, control_volume, euler_std, precision_map};
use mavsight_scene::draw_path;
use mavsight_score::TruthRow;
use mavsight_session::RunResults;
use mavsight_vision::Frame;

/// A value at each instant.
type Of<'a, T> = &'a dyn Fn(&T) -> f64;

pub(crate) fn curve(label: &str, role: Role, points: impl Iterator<Item = (f64, f64)>) -> Curve {
    Curve { label: label.to_owned(), role, points: points.collect(), half_width: vec![] }.thinned()
}

pub(crate) fn figure(caption: &str, panels: Vec<Panel>) -> Result<Figure, ReportError> {
    figure_over("time, s", caption, panels)
}

/// Panels over another axis.
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

/// Half-width of a normal 95 % interval.
const NORMAL_95: f64 = 1.959_964;

/// Cells along each side of a map.
const MAP_CELLS: usize = 30;

/// The predicted precision over the calibrated volume.
pub(crate) fn precision(rig: &Rig, pixel_std_px: f64) -> Result<Vec<Figure>, ReportError> {
    let Some(volume) = control_volume(rig) else { return Ok(vec![]) };
    let middle = 0.5 * (volume.low_m + volume.high_m);
    let planes = [
        (volume.horizontal(), format!("horizontal, Z = {:.2} m", middle.z), "Y, m", 1),
        (volume.vertical(), format!("upright, Y = {:.2} m", middle.y), "Z, m", 2),
    ];
    let maps: Vec<HeatMap> = planes
        .into_iter()
        .map(|(plane, title, y_axis, axis)| HeatMap {
            title,
            x_axis: "X, m".to_owned(),
            y_axis: y_axis.to_owned(),
            x: (volume.low_m.x, volume.high_m.x),
            y: (volume.low_m[axis], volume.high_m[axis]),
            columns: MAP_CELLS,
            rows: MAP_CELLS,
            values: precision_map(rig, plane, MAP_CELLS, MAP_CELLS, pixel_std_px).std_mm,
        })
        .collect();
    if maps.iter().all(|m| m.values.iter().all(Option::is_none)) {
        return Ok(vec![]);
    }
    let caption = format!(
        "Predicted error (3-D standard deviation) of the place of one ball whose centre is seen with {pixel_std_px:.3} px \
         in each coordinate, with all that is not known of the cameras; crossed out where fewer than two cameras see it."
    );
    Ok(vec![Figure { caption, markup: draw_heat_maps(&maps, "mm")? }])
}

/// Figure 4: the object as the first camera sees it; figure 6: the path of the flight over a frame of each
/// camera.
pub(crate) fn pictures(frames: &[Frame], results: &RunResults) -> Result<Vec<Figure>, ReportError> {
    let mut figures = Vec::new();
    let Some(rig) = &results.rig else { return Ok(figures) };
    let path: Vec<Option<Vector3<f64>>> = results
        .poses
        .iter()
        .map(|p| p.estimate.as_ref().ok().map(|e| e.world_from_body.translation.vector))
        .collect();
    for (k, (camera, frame)) in rig.cameras.iter().zip(frames).enumerate() {
        let seen: Vec<Vector2<f64>> = path
            .iter()
            .map(|p| {
                p.and_then(|p| camera.camera.project(&p).ok()).map_or(Vector2::repeat(f64::NAN), |s| s.pixel)
            })
            .collect();
        if let Some(first) = seen.iter().find(|p| k == 0 && p.x.is_finite()) {
            figures.push(png_figure(
                "Figure 4: the observed object, from the first frame of the first camera.",
                &close_up(frame, first)?,
            ));
        }
        let mut rgb = frame.to_rgb();
        draw_path(&mut rgb, frame.size, &seen, [0, 0, 0], 3.5);
        draw_path(&mut rgb, frame.size, &seen, [255, 255, 255], 1.8);
        let caption = format!("Figure 6: path of the body origin over the first frame of {}.", camera.name);
        figures.push(png_figure(caption, &png(rgb, frame.size.width_px, frame.size.height_px)?));
    }
    Ok(figures)
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

/// Figure 7.
pub(crate) fn inputs(recorded: &mavsight_flight::InputSeries) -> Result<Figure, ReportError> {
    // Thinned one by one: an hour's inputs are many.
    let series = |label: &str, role: Role, f: Of<'_, mavsight_flight::InputSample>| {
        curve(label, role, recorded.samples().iter().map(|s| (s.t_s, f(s))))
    };
    let panel = |axis: &str, upper: Of<'_, mavsight_flight::InputSample>, lower: Of<'_, _>| Panel {
        axis: axis.to_owned(),
        curves: vec![
            series("upper rotor, longitudinal", Role::Estimate, upper),
            series("lower rotor, lateral", Role::Model, lower),
        ],
    };
    figure(
        "Figure 7: recorded inputs.",
        vec![
            panel("rotor speed, rad/s", &|s| s.omega_u_rad_s, &|s| s.omega_l_rad_s),
            panel("swash-plate, °", &|s| s.delta_lon_rad.to_degrees(), &|s| s.delta_lat_rad.to_degrees()),
        ],
    )
}

/// One quantity of the motion over time.
struct Quantity<'a> {
    axis: &'a str,
    truth: fn(&TruthRow) -> f64,
    smoothed: Of<'a, MotionSample>,
    std: Of<'a, MotionSample>,
    /// In a single pose, where it has the quantity.
    measured: Option<Of<'a, Isometry3<f64>>>,
}

impl Quantity<'_> {
    /// A panel of truth, smoothed motion and, where it exists, single measurements.
    fn panel(&self, results: &RunResults, truth: Option<&[TruthRow]>) -> Panel {
        let mut curves = Vec::new();
        if let Some(measured) = self.measured {
            let points = results.poses.iter().map(|p| {
                (seconds(p.t_ns), p.estimate.as_ref().map_or(f64::NAN, |e| measured(&e.world_from_body)))
            });
            curves.push(curve("single frames", Role::Measured, points));
        }
        if let Some(motion) = &results.motion {
            // Where the motion is not known, the curve is broken.
            let known = (motion.samples.iter())
                .map(|s| (seconds(s.t_ns), (self.smoothed)(s), NORMAL_95 * (self.std)(s)));
            let unknown = motion.unknown_ns.iter().map(|t_ns| (seconds(*t_ns), f64::NAN, f64::NAN));
            let mut all: Vec<(f64, f64, f64)> = known.chain(unknown).collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (points, half_width) = all.into_iter().map(|(t_s, value, half)| ((t_s, value), half)).unzip();
            let label = "smoothed, 95 %".to_owned();
            curves.push(Curve { label, role: Role::Estimate, points, half_width }.thinned());
        }
        if let Some(truth) = truth {
            curves.push(curve("truth", Role::Truth, truth.iter().map(|r| (r.t_s, (self.truth)(r)))));
        }
        Panel { axis: self.axis.to_owned(), curves }
    }
}

/// Figures 8 to 11.
pub(crate) fn motion(results: &RunResults, truth: Option<&[TruthRow]>) -> Result<Vec<Figure>, ReportError> {
    if results.motion.is_none() {
        return Ok(vec![]);
    }
    let std = |s: &MotionSample, row: usize| s.covariance.variance(row).max(0.0).sqrt();
    let place = |axis: &str, k: usize, truth_of: fn(&TruthRow) -> f64| {
        let smoothed: Of<'_, MotionSample> = &|s| s.world_from_body.translation.vector[k];
        let measured: Of<'_, Isometry3<f64>> = &|p| p.translation.vector[k];
        let measured = Some(measured);
        Quantity { axis, truth: truth_of, smoothed, std: &|s| std(s, k), measured }.panel(results, truth)
    };
    let angle = |axis: &str, k: usize, truth_of: fn(&TruthRow) -> f64| {
        let of = |p: &Isometry3<f64>| {
            let e = EulerAngles::from_world_from_body(p);
            [e.phi_rad, e.theta_rad, e.psi_rad][k].to_degrees()
        };
        let std: Of<'_, MotionSample> =
            &|s| euler_std(&s.world_from_body, &s.covariance.quantity(1))[k].to_degrees();
        let smoothed: Of<'_, MotionSample> = &|s| of(&s.world_from_body);
        Quantity { axis, truth: truth_of, smoothed, std, measured: Some(&of) }.panel(results, truth)
    };
    let speed = |axis: &str, k: usize, truth_of: fn(&TruthRow) -> f64| {
        let smoothed: Of<'_, MotionSample> = &|s| s.velocity_in_body_m_s[k];
        Quantity { axis, truth: truth_of, smoothed, std: &|s| std(s, 6 + k), measured: None }
            .panel(results, truth)
    };
    let rate = |axis: &str, k: usize, truth_of: fn(&TruthRow) -> f64| {
        let smoothed: Of<'_, MotionSample> = &|s| s.rates_rad_s[k].to_degrees();
        let std: Of<'_, MotionSample> = &|s| std(s, 9 + k).to_degrees();
        Quantity { axis, truth: truth_of, smoothed, std, measured: None }.panel(results, truth)
    };
    let positions =
        vec![place("X, m", 0, |r| r.x_m), place("Y, m", 1, |r| r.y_m), place("Z, m", 2, |r| r.z_m)];
    let angles = vec![
        angle("roll φ, °", 0, |r| r.phi_rad.to_degrees()),
        angle("pitch θ, °", 1, |r| r.theta_rad.to_degrees()),
        angle("yaw ψ, °", 2, |r| r.psi_rad.to_degrees()),
    ];
    let speeds = vec![
        speed("u, m/s", 0, |r| r.u_m_s),
        speed("v, m/s", 1, |r| r.v_m_s),
        speed("w, m/s", 2, |r| r.w_m_s),
    ];
    let rates = vec![
        rate("p, °/s", 0, |r| r.p_rad_s.to_degrees()),
        rate("q, °/s", 1, |r| r.q_rad_s.to_degrees()),
        rate("r, °/s", 2, |r| r.r_rad_s.to_degrees()),
    ];
    Ok(vec![
        figure("Figure 8: position in the world.", positions)?,
        figure("Figure 9: attitude.", angles)?,
        figure("Figure 10: velocity in body axes.", speeds)?,
        figure("Figure 11: angular rates in body axes.", rates)?,
    ])
}

/// How good each frame was.
pub(crate) fn quality(results: &RunResults) -> Result<Vec<Figure>, ReportError> {
    let poses = &results.poses;
    if !poses.iter().any(|p| p.estimate.is_ok()) {
        return Ok(vec![]);
    }
    let panel = |axis: &str, f: Of<'_, mavsight_pose::PoseEstimate>| {
        let points = poses.iter().map(|p| (seconds(p.t_ns), p.estimate.as_ref().map_or(f64::NAN, f)));
        Panel { axis: axis.to_owned(), curves: vec![curve("single frames", Role::Estimate, points)] }
    };
    let spread =
        |e: &mavsight_pose::PoseEstimate| 1e3 * e.covariance().fixed_view::<3, 3>(0, 0).trace().sqrt();
    let turn = |e: &mavsight_pose::PoseEstimate| {
        (e.covariance().fixed_view::<3, 3>(3, 3).trace() / 3.0).sqrt().to_degrees()
    };
    Ok(vec![figure(
        "Each frame: reprojection residual, and the predicted errors of position (3-D) and attitude (an axis).",
        vec![
            panel("residual, px", &|e| e.residual_px),
            panel("position, mm", &spread),
            panel("attitude, °", &turn),
        ],
    )?])
}
