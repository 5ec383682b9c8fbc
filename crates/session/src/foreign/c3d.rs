//! C3D (c3d.org), points only: written as Intel floats in millimetres, read in any of its integer and float
//! forms; analog data and events are passed over. A point with a residual below zero was not seen.

use super::c3d_parameters::{BLOCK, Parameters, Processor, Section, read as read_parameters};
use super::marker_paths::{MarkerPaths, even_clock};
use super::trc::scale_of;
use super::{Noted, numbered};
use crate::{SessionError, error::read_bytes, write_whole};
use mavsight_geometry::Vector3;
use std::path::Path;

/// Reads the points of a file. The first frame's number over the rate is its time, frame 1 being at zero.
///
/// # Errors
/// Says what is wrong: not C3D, a file that breaks off (frames announced and there), no points, no rate,
/// unknown units.
pub fn read(path: &Path) -> Result<Noted<MarkerPaths>, SessionError> {
    let bytes = read_bytes(path, "C3D marker paths")?;
    if bytes.len() < 2 * BLOCK || bytes[1] != 0x50 {
        let detail = "not a C3D file (its second byte is 0x50): correct the path or --from";
        return Err(SessionError::value(path, "header", detail));
    }
    let (processor, parameters) = read_parameters(path, &bytes, usize::from(bytes[0]))?;
    let layout = layout(path, &bytes, processor, &parameters)?;
    let units = parameters.get("POINT:UNITS").and_then(|p| p.texts().into_iter().next());
    let units = units.unwrap_or_else(|| "mm".into());
    let unit_m = scale_of(&units).ok_or_else(|| {
        SessionError::value(path, "POINT:UNITS", format!("{units:?}: mm, cm or m is known"))
    })?;
    let width = if layout.scale < 0.0 { 4 } else { 2 };
    let room = bytes.len() / (4 * width);
    if layout.points > room {
        let detail =
            format!("{} points, and room for {room} in the whole file: it is damaged", layout.points);
        return Err(SessionError::value(path, "POINT:USED", detail));
    }
    let further = (2..).map(|k| format!("POINT:LABELS{k}"));
    let labels = std::iter::once("POINT:LABELS".to_owned()).chain(further);
    let given: Vec<String> = labels.map_while(|key| parameters.get(&key)).flat_map(|p| p.texts()).collect();
    let names = (0..layout.points).map(|k| numbered(&given, k, "point")).collect();
    let record = width * (4 * layout.points + layout.analog);
    let data = bytes.get(layout.data_at..).unwrap_or_default();
    let whole = data.len() / record;
    if whole < layout.frames {
        let detail = format!("{} are announced, {whole} are there: the file breaks off", layout.frames);
        return Err(SessionError::value(path, "frames", detail));
    }
    let mut paths = MarkerPaths { names, ..MarkerPaths::default() };
    for (k, frame) in data.chunks_exact(record).take(layout.frames).enumerate() {
        let tick = layout.first - 1 + k as i64;
        paths.t_ns.push((tick as f64 * 1e9 / layout.rate_hz).round() as i64);
        paths.points_m.push(
            frame.chunks_exact(4 * width).take(layout.points).map(|p| point(p, &layout, unit_m)).collect(),
        );
    }
    let missing = paths.points_m.iter().flatten().filter(|p| p.is_none()).count();
    let notes =
        (missing > 0).then(|| format!("{missing} of {} points were not seen", layout.frames * layout.points));
    Ok(Noted { value: paths, notes: notes.into_iter().collect() })
}

struct Layout {
    processor: Processor,
    points: usize,
    analog: usize,
    first: i64,
    frames: usize,
    rate_hz: f64,
    /// Below zero: floats.
    scale: f64,
    data_at: usize,
}

fn point(bytes: &[u8], layout: &Layout, unit_m: f64) -> Option<Vector3<f64>> {
    let mut v = [0.0; 4];
    for (value, b) in v.iter_mut().zip(bytes.chunks_exact(bytes.len() / 4)) {
        *value = match *b {
            [a, b] => f64::from(layout.processor.int([a, b])),
            [a, b, c, d] => layout.processor.float([a, b, c, d]),
            _ => return None,
        };
    }
    let seen = v[3] >= 0.0 && v.iter().all(|x| x.is_finite());
    let factor = if layout.scale < 0.0 { unit_m } else { unit_m * layout.scale };
    seen.then(|| Vector3::new(v[0], v[1], v[2]) * factor)
}

fn layout(
    path: &Path,
    bytes: &[u8],
    processor: Processor,
    parameters: &Parameters,
) -> Result<Layout, SessionError> {
    let word = |k: usize| f64::from(processor.int([bytes[2 * k - 2], bytes[2 * k - 1]]) as u16);
    let float =
        |k: usize| processor.float([bytes[2 * k - 2], bytes[2 * k - 1], bytes[2 * k], bytes[2 * k + 1]]);
    let count = |key: &str| parameters.get(key).and_then(|p| p.counts().first().copied());
    let number = |key: &str| parameters.get(key).and_then(|p| p.numbers().first().copied());
    let points = count("POINT:USED").unwrap_or(word(2));
    let rate_hz = number("POINT:RATE").unwrap_or(float(11));
    let scale = number("POINT:SCALE").unwrap_or(float(7));
    let data_block = count("POINT:DATA_START").filter(|b| *b > 0.0).unwrap_or(word(9));
    // Field numbers of 32 bits in two words, low word first, for what the header's 16 bits cannot hold.
    let long = |key: &str| {
        let words = parameters.get(key)?.counts();
        Some(words.first()? + 65536.0 * words.get(1).copied().unwrap_or(0.0))
    };
    let first = long("TRIAL:ACTUAL_START_FIELD").unwrap_or(word(4));
    let last = long("TRIAL:ACTUAL_END_FIELD").unwrap_or(word(5));
    let frames = number("POINT:LONG_FRAMES").unwrap_or(last - first + 1.0);
    let checks = [
        (points >= 1.0, "POINT:USED", "the file has no points: export marker trajectories".to_owned()),
        (
            crate::RATES_HZ.contains(&rate_hz),
            "POINT:RATE",
            format!("{rate_hz} Hz: a rate of 0.01 to 100000 is wanted"),
        ),
        (
            scale.is_finite() && scale != 0.0,
            "POINT:SCALE",
            format!("{scale}: a number other than zero is wanted"),
        ),
        ((0.0..1e9).contains(&first), "first frame", format!("{first}: the header is damaged")),
        ((1.0..1e9).contains(&frames), "frames", format!("from {first} to {last}: the header is damaged")),
        (data_block >= 2.0, "POINT:DATA_START", format!("block {data_block}: the header is damaged")),
    ];
    if let Some((_, key, detail)) = checks.into_iter().find(|(holds, ..)| !holds) {
        return Err(SessionError::value(path, key, detail));
    }
    Ok(Layout {
        processor,
        points: points as usize,
        analog: word(3) as usize,
        first: first as i64,
        frames: frames as usize,
        rate_hz,
        scale,
        data_at: (data_block as usize - 1).saturating_mul(BLOCK),
    })
}

/// Writes marker paths: coordinates are 32-bit floats of millimetres (0.1 µm at a metre). Instants that are
/// missing on the even clock become frames in which nothing was seen; a first instant on the clock's grid
/// keeps its time as the number of the first frame.
///
/// # Errors
/// Times on no even clock, more than 255 markers, what the file system refuses.
pub fn write(path: &Path, paths: &MarkerPaths) -> Result<Vec<String>, SessionError> {
    let n = paths.names.len();
    if n == 0 || n > 255 || paths.names.iter().any(|name| name.len() > 127) {
        let detail = format!("{n} of them: 1 to 255, with names of at most 127 letters, fit a C3D file");
        return Err(SessionError::value(path, "markers", detail));
    }
    let clock = even_clock(path, &paths.t_ns)?;
    let ticks = (paths.t_ns[0] as f64 * 1e-9 * clock.rate_hz).round();
    let off = paths.t_ns[0] as f64 * 1e-9 * clock.rate_hz - ticks;
    let is_on_grid = off.abs() < 0.05 && (0.0..1e9).contains(&ticks);
    let first = if is_on_grid { ticks as u32 + 1 } else { 1 };
    let note =
        || format!("times begin at zero in the file: {} s is taken off", crate::s_from_ns(paths.t_ns[0]));
    let notes = (!is_on_grid).then(note).into_iter().collect();
    let last = first + clock.ticks.len() as u32 - 1;
    let section = section(paths, first, last, clock.rate_hz as f32);
    let blocks = section.len() / BLOCK;
    let data_block = (2 + blocks) as u16;
    let mut bytes = vec![0u8; BLOCK];
    (bytes[0], bytes[1]) = (2, 0x50);
    let short = |x: u32| u16::try_from(x).unwrap_or(u16::MAX);
    for (word, value) in
        [(2, n as u16), (3, 0), (4, short(first)), (5, short(last)), (6, 0), (9, data_block), (10, 0)]
    {
        bytes[2 * word - 2..2 * word].copy_from_slice(&value.to_le_bytes());
    }
    bytes[12..16].copy_from_slice(&(-1f32).to_le_bytes());
    bytes[20..24].copy_from_slice(&(clock.rate_hz as f32).to_le_bytes());
    bytes.extend(section);
    for tick in &clock.ticks {
        for k in 0..n {
            let place = tick.and_then(|t| paths.points_m[t].get(k).copied().flatten());
            let [x, y, z, residual] = place.map_or([0.0, 0.0, 0.0, -1.0], |p| {
                [(p.x * 1e3) as f32, (p.y * 1e3) as f32, (p.z * 1e3) as f32, 0.0]
            });
            [x, y, z, residual].iter().for_each(|v: &f32| bytes.extend(v.to_le_bytes()));
        }
    }
    bytes.resize(bytes.len().div_ceil(BLOCK) * BLOCK, 0);
    write_whole(path, &bytes)?;
    Ok(notes)
}

fn section(paths: &MarkerPaths, first: u32, last: u32, rate_hz: f32) -> Vec<u8> {
    let n = paths.names.len();
    let frames = last - first + 1;
    let build = |data_block: u16| {
        let mut s = Section::new();
        s.group(1, "POINT");
        s.ints(1, "USED", &[n as u16]);
        s.float(1, "SCALE", -1.0);
        s.float(1, "RATE", rate_hz);
        s.ints(1, "DATA_START", &[data_block]);
        s.ints(1, "FRAMES", &[u16::try_from(frames).unwrap_or(u16::MAX)]);
        if frames > u32::from(u16::MAX) {
            s.float(1, "LONG_FRAMES", frames as f32);
        }
        s.texts(1, "LABELS", &paths.names);
        s.texts(1, "DESCRIPTIONS", &vec![String::new(); n]);
        s.texts(1, "UNITS", &["mm".to_owned()]);
        s.group(2, "ANALOG");
        s.ints(2, "USED", &[0]);
        s.float(2, "RATE", 0.0);
        s.group(3, "FORCE_PLATFORM");
        s.ints(3, "USED", &[0]);
        s.group(4, "TRIAL");
        let words = |x: u32| [x as u16, (x >> 16) as u16];
        s.ints(4, "ACTUAL_START_FIELD", &words(first));
        s.ints(4, "ACTUAL_END_FIELD", &words(last));
        s.finish()
    };
    // The data begin behind the section, whose length does not depend on where that is.
    let blocks = build(0).len() / BLOCK;
    build((2 + blocks) as u16)
}
