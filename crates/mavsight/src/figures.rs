//! The figures of the report, numbered as in the paper.

use crate::page::Page;
use anyhow::{Context, Result};
use mavsight_geometry::{EulerAngles, Vector2, Vector3};
use mavsight_pose::{MotionSample, Rig, control_volume, euler_std, precision_map};
use mavsight_report::{Chart, Curve, Figure, HeatMap, Panel, Role, draw, draw_heat_maps, png_figure};
use mavsight_scene::draw_path;
use mavsight_session::{RunResults, TruthRow};
use mavsight_vision::Frame;

/// A value at each instant.
type Of<'a, T> = &'a dyn Fn(&T) -> f64;

pub(crate) fn curve(label: &str, role: Role, points: impl Iterator<Item = (f64, f64)>) -> Curve {
    Curve { label: label.to_owned(), role, points: points.collect(), half_width: vec![] }.thinned()
}

pub(crate) fn figure(caption: &str, panels: Vec<Panel>) -> Result<Figure> {
    figure_over("time, s", caption, panels)
}

/// Panels over another axis.
pub(crate) fn figure_over(axis: &'static str, caption: &str, panels: Vec<Panel>) -> Result<Figure> {
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
pub(crate) fn precision(rig: &Rig, pixel_std_px: f64) -> Result<Vec<Figure>> {
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

/// Figure 4: the object as the first camera sees it; figure 6: the path of the flight over a frame of each camera.
pub(crate) fn pictures(page: &Page<'_>, results: &RunResults) -> Result<Vec<Figure>> {
    let mut figures = Vec::new();
    let Some(rig) = &results.rig else { return Ok(figures) };
    let path: Vec<Option<Vector3<f64>>> = results
        .poses
        .iter()
        .map(|p| p.estimate.as_ref().map(|e| e.world_from_body.translation.vector))
        .collect();
    for (k, (camera, frame)) in rig.cameras.iter().zip(page.frames).enumerate() {
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
fn close_up(frame: &Frame, at: &Vector2<f64>) -> Result<Vec<u8>> {
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

fn png(rgb: Vec<u8>, width: u32, height: u32) -> Result<Vec<u8>> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbImage::from_raw(width, height, rgb).context("the picture has its size")?;
    image.write_to(&mut bytes, image::ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// Figure 7.
pub(crate) fn inputs(recorded: &mavsight_flight::InputSeries) -> Result<Figure> {
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

type OfTruth = fn(&TruthRow) -> f64;

/// One panel of truth, smoothed motion and, where it exists, single measurements.
fn motion_panel(
    (results, truth): (&RunResults, Option<&[TruthRow]>),
    axis: &str,
    of_truth: OfTruth,
    (smoothed, std): (Of<'_, MotionSample>, Of<'_, MotionSample>),
    measured: Option<Of<'_, mavsight_geometry::Isometry3<f64>>>,
) -> Panel {
    let mut curves = Vec::new();
    if let Some(measured) = measured {
        let points = results.poses.iter().map(|p| {
            (seconds(p.t_ns), p.estimate.as_ref().map_or(f64::NAN, |e| measured(&e.world_from_body)))
        });
        curves.push(curve("single frames", Role::Measured, points));
    }
    if let Some(motion) = &results.motion {
        // Where the motion is not known, the curve is broken.
        let known = motion.samples.iter().map(|s| (seconds(s.t_ns), smoothed(s), NORMAL_95 * std(s)));
        let unknown = motion.unknown_ns.iter().map(|t_ns| (seconds(*t_ns), f64::NAN, f64::NAN));
        let mut all: Vec<(f64, f64, f64)> = known.chain(unknown).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (points, half_width) = all.into_iter().map(|(t_s, value, half)| ((t_s, value), half)).unzip();
        let label = "smoothed, 95 %".to_owned();
        curves.push(Curve { label, role: Role::Estimate, points, half_width }.thinned());
    }
    if let Some(truth) = truth {
        curves.push(curve("truth", Role::Truth, truth.iter().map(|r| (r.t_s, of_truth(r)))));
    }
    Panel { axis: axis.to_owned(), curves }
}

/// Figures 8 to 11.
pub(crate) fn motion(results: &RunResults, truth: Option<&[TruthRow]>) -> Result<Vec<Figure>> {
    if results.motion.is_none() {
        return Ok(vec![]);
    }
    let deg = |r: f64| r.to_degrees();
    let std = |s: &MotionSample, row: usize| s.covariance.variance(row).max(0.0).sqrt();
    let place = |axis: &str, k: usize, t: OfTruth| {
        let smoothed = |s: &MotionSample| s.world_from_body.translation.vector[k];
        motion_panel(
            (results, truth),
            axis,
            t,
            (&smoothed, &|s| std(s, k)),
            Some(&|p| p.translation.vector[k]),
        )
    };
    let angle = |axis: &str, k: usize, t: OfTruth| {
        let of = move |p: &mavsight_geometry::Isometry3<f64>| {
            let e = EulerAngles::from_world_from_body(p);
            [e.phi_rad, e.theta_rad, e.psi_rad][k].to_degrees()
        };
        let turn =
            move |s: &MotionSample| euler_std(&s.world_from_body, &s.covariance.quantity(1))[k].to_degrees();
        motion_panel((results, truth), axis, t, (&|s| of(&s.world_from_body), &turn), Some(&of))
    };
    let speed = |axis: &str, k: usize, t: OfTruth| {
        motion_panel((results, truth), axis, t, (&|s| s.velocity_in_body_m_s[k], &|s| std(s, 6 + k)), None)
    };
    let rate = |axis: &str, k: usize, t: OfTruth| {
        motion_panel((results, truth), axis, t, (&|s| deg(s.rates_rad_s[k]), &|s| deg(std(s, 9 + k))), None)
    };
    Ok(vec![
        figure(
            "Figure 8: position in the world.",
            vec![place("X, m", 0, |r| r.x_m), place("Y, m", 1, |r| r.y_m), place("Z, m", 2, |r| r.z_m)],
        )?,
        figure(
            "Figure 9: attitude.",
            vec![
                angle("roll φ, °", 0, |r| r.phi_rad.to_degrees()),
                angle("pitch θ, °", 1, |r| r.theta_rad.to_degrees()),
                angle("yaw ψ, °", 2, |r| r.psi_rad.to_degrees()),
            ],
        )?,
        figure(
            "Figure 10: velocity in body axes.",
            vec![
                speed("u, m/s", 0, |r| r.u_m_s),
                speed("v, m/s", 1, |r| r.v_m_s),
                speed("w, m/s", 2, |r| r.w_m_s),
            ],
        )?,
        figure(
            "Figure 11: angular rates in body axes.",
            vec![
                rate("p, °/s", 0, |r| r.p_rad_s.to_degrees()),
                rate("q, °/s", 1, |r| r.q_rad_s.to_degrees()),
                rate("r, °/s", 2, |r| r.r_rad_s.to_degrees()),
            ],
        )?,
    ])
}

/// How good each frame was.
pub(crate) fn quality(results: &RunResults) -> Result<Vec<Figure>> {
    let poses = &results.poses;
    if !poses.iter().any(|p| p.estimate.is_some()) {
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
        "Each frame: what reprojection leaves, and the predicted errors of position (3-D) and attitude (an axis).",
        vec![
            panel("residual, px", &|e| e.residual_px),
            panel("position, mm", &spread),
            panel("attitude, °", &turn),
        ],
    )?])
}
