//! Filming a simulated flight: a session on disk, by the paper's cameras or by those of a file.

use super::named;
use crate::cli::{Film, WrongCall};
use crate::lab::{self, Shot, StagedFilm};
use crate::out::outln;
use crate::progress::Bars;
use anyhow::{Context, Result, bail};
use mavsight_geometry::{BrownConrady, Camera, ImageSize, Intrinsics, Vector3};
use mavsight_pipeline::{ControlPointRow, Progress};
use mavsight_scene::Aircraft;
use mavsight_score::{VISIBILITY, VirtualCamera, read_truth, write_visibility};
use mavsight_session::{
    ControlSection, LineTime, RATES_HZ, SESSION_SCHEMA, SessionCamera, SessionFile, load_vehicle,
    make_folder, read_toml, tables::read_control_points, tables::read_inputs, write_control_points,
    write_png, write_toml, write_vehicle, write_whole,
};
use mavsight_simulator::{FlightState, Scenario, Staging};
use mavsight_vision::Frame;
use serde::Deserialize;
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

/// What a scenario stages, beside the flight that `simulate` writes.
pub(super) const STAGING: &str = "staging.toml";

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    camera: Vec<FilmCamera>,
}

/// One of them. What its clock does is not written into the session: the chain has to find out.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct FilmCamera {
    name: String,
    centre_m: [f64; 3],
    #[serde(default = "middle")]
    target_m: [f64; 3],
    #[serde(default = "degrees")]
    field_of_view_deg: f64,
    #[serde(default = "pixels")]
    size_px: [u32; 2],
    #[serde(default)]
    k1: f64,
    #[serde(default)]
    k2: f64,
    /// The flight's where left out.
    frame_rate_hz: Option<f64>,
    /// How late its time stamps are at the start.
    #[serde(default)]
    late_s: f64,
    /// How fast its clock is.
    #[serde(default)]
    fast_ppm: f64,
    /// Of a rolling shutter; this alone is written into the session.
    #[serde(default)]
    line_time_s: f64,
}

/// The latest that a camera may begin, either way: an hour.
const LATEST_S: f64 = 3600.0;

fn middle() -> [f64; 3] {
    [0.0, 0.0, 1.5]
}

fn degrees() -> f64 {
    53.0
}

fn pixels() -> [u32; 2] {
    [640, 480]
}

impl FilmCamera {
    fn camera(&self) -> Result<Camera> {
        let wrong = |what: String| WrongCall(format!("camera {}: {what}", self.name));
        let numbers = [self.k1, self.k2, self.late_s, self.fast_ppm, self.line_time_s];
        let places = self.centre_m.iter().chain(&self.target_m);
        if !numbers.iter().chain(places).all(|v| v.is_finite()) || self.fast_ppm.abs() >= 1e5 {
            return Err(wrong("its numbers must be finite, and fast_ppm below 100000".into()).into());
        }
        let [width_px, height_px] = self.size_px;
        let is_size = |side_px: u32| (16..=8192).contains(&side_px);
        if !(1.0..179.0).contains(&self.field_of_view_deg) || !is_size(width_px) || !is_size(height_px) {
            let what = format!(
                "field_of_view_deg must be 1 to 179 ({} is given), size_px 16 to 8192 ({width_px} by {height_px} is given)",
                self.field_of_view_deg
            );
            return Err(wrong(what).into());
        }
        if let Some(rate_hz) = self.frame_rate_hz.filter(|rate_hz| !RATES_HZ.contains(rate_hz)) {
            return Err(wrong(format!("frame_rate_hz must be 0.01 to 100000, and is {rate_hz}")).into());
        }
        if self.late_s.abs() > LATEST_S {
            return Err(wrong(format!(
                "late_s must be at most {LATEST_S} either way, and is {}",
                self.late_s
            ))
            .into());
        }
        let size = ImageSize { width_px, height_px };
        let lens = Intrinsics::from_horizontal_fov(size, self.field_of_view_deg.to_radians());
        let mut camera =
            Camera::looking_at(Vector3::from(self.centre_m), Vector3::from(self.target_m), lens, size);
        camera.distortion = BrownConrady { k1: self.k1, k2: self.k2, ..BrownConrady::default() };
        Ok(camera)
    }

    /// Times of its frames over a flight: stamp k/rate = late + (1 + fast) t.
    fn times_s(&self, rate_hz: f64, end_s: f64) -> Vec<f64> {
        let time = |k: usize| (k as f64 / rate_hz - self.late_s) / (1.0 + 1e-6 * self.fast_ppm);
        (0..).map(time).take_while(|t| *t <= end_s + 1e-9).collect()
    }
}

fn cameras_of(path: Option<&Path>) -> Result<Vec<(FilmCamera, Camera)>> {
    let Some(path) = path else {
        let of_lab = |c: VirtualCamera| (FilmCamera { name: c.name, ..FilmCamera::default() }, c.camera);
        return Ok(lab::cameras().into_iter().map(of_lab).collect());
    };
    let file: CameraFile = named(read_toml(path, "camera file"))?;
    file.camera.into_iter().map(|c| c.camera().map(|camera| (c, camera))).collect()
}

struct Set<'a> {
    args: &'a Film,
    truth: &'a [FlightState],
    aircraft: &'a Aircraft,
    control: &'a [ControlPointRow],
    interval_s: f64,
    staging: Staging,
}

/// File of the recorded inputs, beside a flight.
pub(super) const INPUTS: &str = "inputs.csv";

pub(crate) fn film(args: &Film) -> Result<()> {
    let vehicle = named(load_vehicle(&args.flight.join("vehicle.toml")))?;
    let truth = named(read_truth(&args.flight.join("truth.csv"), &vehicle))?;
    // What is carried about has none.
    let inputs = Some(args.flight.join(INPUTS)).filter(|path| path.is_file());
    inputs.as_deref().map(|path| named(read_inputs(path, &vehicle))).transpose()?;
    let interval_s = match truth.as_slice() {
        [a, b, ..] => b.t_s - a.t_s,
        _ => 1.0 / Scenario::paper().frame_rate_hz,
    };
    make_folder(&args.out)?;
    let bars = Bars::new();
    let staging = staging_of(&args.flight)?;
    let room = lab::room(&staging);
    let aircraft = lab::aircraft(&vehicle);
    let control = match &args.control {
        Some(path) => named(read_control_points(path))?,
        None => lab::control_points(),
    };
    let set = Set { args, truth: &truth, aircraft: &aircraft, control: &control, interval_s, staging };
    let mut cameras = Vec::new();
    let mut visible = vec![Vec::new(); truth.len()];
    for (k, (own, camera)) in cameras_of(args.cameras.as_deref())?.iter().enumerate() {
        bars.start("building", None);
        let (name, camera) = (own.name.clone(), *camera);
        let view = VirtualCamera { name, camera, sees: Vec::new(), control_std_px: 0.0 };
        let film = lab::staged_film(&room, &view, k, args.seed, &set.staging);
        cameras.push(one_camera(&set, &film, own, camera.size, &bars)?);
        let shares = truth.iter().map(|row| film.visible_shares(&vehicle, &aircraft, row));
        visible.iter_mut().zip(shares).for_each(|(all, own): (&mut Vec<_>, _)| all.push(own));
    }
    bars.done();
    if args.cameras.is_none() {
        let names: Vec<String> = cameras.iter().map(|c| c.name.clone()).collect();
        write_visibility(&args.out.join(VISIBILITY), &truth, &names, &vehicle, &visible)?;
    }
    write_control_points(&args.out.join("control_points.csv"), &control)?;
    if args.flight.canonicalize().ok() != args.out.canonicalize().ok() {
        write_vehicle(&args.out.join("vehicle.toml"), &vehicle)?;
        for name in inputs.iter().map(|_| INPUTS).chain(["truth.csv"]) {
            let content = std::fs::read(args.flight.join(name)).context(name)?;
            write_whole(&args.out.join(name), &content)?;
        }
    }
    let session = SessionFile {
        schema: SESSION_SCHEMA,
        name: "virtual-flight".to_owned(),
        vehicle: "vehicle.toml".into(),
        inputs: inputs.map(|_| INPUTS.into()).unwrap_or_default(),
        truth: Some("truth.csv".into()),
        control: Some(ControlSection { points: "control_points.csv".into(), observations: None }),
        camera: cameras,
        ..SessionFile::default()
    };
    write_toml(&args.out.join("session.toml"), &session)?;
    outln!("{} cameras: {}", session.camera.len(), args.out.join("session.toml").display());
    Ok(())
}

/// What a scenario staged, as `simulate` left it beside a flight; nothing where there is none.
fn staging_of(flight: &Path) -> Result<Staging> {
    let path = flight.join(STAGING);
    if !path.is_file() {
        return Ok(Staging::default());
    }
    let staging: Staging = named(read_toml(&path, "staging file"))?;
    staging.check().map_err(|e| WrongCall(format!("{}: {e}", path.display())))?;
    Ok(staging)
}

fn one_camera(
    set: &Set<'_>,
    film: &StagedFilm<'_>,
    own: &FilmCamera,
    size: ImageSize,
    bars: &Bars,
) -> Result<SessionCamera> {
    let (args, name) = (set.args, &own.name);
    if own.line_time_s != 0.0 && set.staging != Staging::default() {
        let what = "occluders are filmed by a global shutter alone: leave line_time_s out";
        return Err(WrongCall(format!("camera {name}: {what}")).into());
    }
    let still = format!("{name}-control.png");
    let control = lab::control_frame(set.control);
    write_png(&args.out.join(&still), &Frame::from_rgb(size, film.still(Some(&control)))?)?;
    let rate_hz = own.frame_rate_hz.unwrap_or((1e6 / set.interval_s).round() / 1e6);
    let times_s = match args.cameras {
        Some(_) => own.times_s(rate_hz, set.truth.last().map_or(0.0, |row| row.t_s)),
        None => set.truth.iter().map(|row| row.t_s).collect(),
    };
    bars.start("filming", Some(times_s.len() as u64));
    let frames = times_s.iter().enumerate().filter_map(|(n, t_s)| {
        bars.step();
        if args.cameras.is_none() {
            return Some(film.frame(n, set.aircraft, &set.truth[n], set.interval_s));
        }
        let shot = Shot { t_s: *t_s, interval_s: 1.0 / rate_hz, line_time_s: own.line_time_s };
        film.frame_at(n, set.aircraft, set.truth, shot)
    });
    let video = if args.video {
        write_video(&args.out.join(format!("{name}.mp4")), size, 1.0 / rate_hz, frames)?;
        format!("{name}.mp4")
    } else {
        make_folder(&args.out.join(name))?;
        let file = |n: usize| args.out.join(name).join(format!("frame_{n:05}.png"));
        let mut written = 0;
        for rgb in frames {
            write_png(&file(written), &Frame::from_rgb(size, rgb)?)?;
            written += 1;
        }
        // A longer film that was there before would go on behind this one.
        for n in (written..).take_while(|n| file(*n).exists()) {
            std::fs::remove_file(file(n)).with_context(|| format!("{}", file(n).display()))?;
        }
        format!("{name}/frame_%05d.png")
    };
    Ok(SessionCamera {
        name: name.clone(),
        video: video.into(),
        still: Some(still.into()),
        frame_rate_hz: (!args.video).then_some(rate_hz),
        line_time_s: (own.line_time_s != 0.0).then_some(LineTime::Known(own.line_time_s)),
        ..SessionCamera::default()
    })
}

fn write_video(
    path: &Path,
    size: mavsight_geometry::ImageSize,
    interval_s: f64,
    frames: impl Iterator<Item = Vec<u8>>,
) -> Result<()> {
    // Beside its place until it is whole: what ffmpeg ends when it is cut off looks whole.
    let part = path.with_extension("part.mp4");
    let mut child = Command::new("ffmpeg")
        .args(["-v", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
        .args(["-s", &format!("{}x{}", size.width_px, size.height_px), "-r", &format!("{}", 1.0 / interval_s)])
        .args(["-i", "pipe:0", "-c:v", "libx264", "-crf", "12", "-pix_fmt", "yuv420p"])
        .arg(&part)
        .stdin(Stdio::piped())
        .spawn()
        .context("--video needs the ffmpeg program: install it with `apt-get install ffmpeg`, or leave --video out")?;
    let Some(mut pipe) = child.stdin.take() else { bail!("ffmpeg gave no input pipe") };
    for rgb in frames {
        pipe.write_all(&rgb).context("ffmpeg stopped reading frames")?;
    }
    drop(pipe);
    let status = child.wait()?;
    if !status.success() {
        bail!("ffmpeg could not write {}: {status}", path.display());
    }
    std::fs::rename(&part, path).with_context(|| format!("{}", path.display()))
}
