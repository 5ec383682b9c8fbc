//! Flights through the virtual room that end badly while they record, and what is read back of them.

use mavsight_session::FrameSource;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc::channel;
use std::time::Duration;

/// What a flight had announced as recorded, all of which was read back.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Survived {
    pub(crate) seconds: f64,
    pub(crate) bytes: u64,
    pub(crate) instants: usize,
    pub(crate) fault: Option<String>,
}

/// Frames a second of the flights.
const RATE_HZ: f64 = 30.0;

/// The flight, recorded, with its events on standard output; `limit` ends its files at so many blocks.
pub(crate) fn flight(program: &Path, folder: &Path, limit: Option<u64>) -> Command {
    let mut command = match limit {
        None => Command::new(program),
        Some(blocks) => {
            let mut shell = Command::new("sh");
            // A file that may not grow then gives an error instead of a signal, as a full disk does.
            shell.args(["-c", &format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\""), "sh"]).arg(program);
            shell
        }
    };
    command.args(["live", "--virtual", "--fast", "--json", "--rate", "30", "--size", "400x300"]);
    command.args(["--for", if limit.is_some() { "4" } else { "600" }, "--record"]).arg(folder);
    command.stdout(Stdio::piped()).stderr(Stdio::null());
    command
}

/// Runs a flight, kills it `after` its first event where that is given, and reads back what it has announced.
///
/// # Errors
/// What was announced and is not there, or not as it was sent.
pub(crate) fn survive(
    mut flight: Command,
    program: &Path,
    folder: &Path,
    after: Option<Duration>,
) -> Result<Survived, String> {
    let mut child = flight.spawn().map_err(|e| e.to_string())?;
    let lines = BufReader::new(child.stdout.take().ok_or("no output")?).lines();
    let (begun, begins) = channel();
    let reader = std::thread::spawn(move || {
        let heard = lines.map_while(Result::ok).inspect(|_| {
            let _ = begun.send(());
        });
        // The last line may be cut.
        heard.filter_map(|line| serde_json::from_str(&line).ok()).collect::<Vec<Value>>()
    });
    if let Some(after) = after {
        begins.recv_timeout(Duration::from_secs(120)).map_err(|_| "the flight does not begin")?;
        std::thread::sleep(after);
        child.kill().map_err(|e| e.to_string())?;
    }
    child.wait().map_err(|e| e.to_string())?;
    let heard = reader.join().map_err(|_| "the reader has panicked")?;
    read_back(&heard, program, folder)
}

fn read_back(heard: &[Value], program: &Path, folder: &Path) -> Result<Survived, String> {
    let Some(last) = heard.iter().rfind(|e| e["event"] == "recording") else {
        return Ok(Survived::default());
    };
    let (Some(seconds), Some(bytes)) = (last["seconds"].as_f64(), last["bytes"].as_u64()) else {
        return Err(format!("{last}"));
    };
    let fault = last["fault"].as_str().map(str::to_owned);
    let heard = poses(heard);
    let files = ["cam1.y4m", "cam2.y4m", "detected.ndjson", "sent.ndjson", "inputs.csv"];
    let lengths = files.map(|name| std::fs::metadata(folder.join(name)).map_or(0, |m| m.len()));
    if lengths.iter().sum::<u64>() < bytes {
        return Err(format!("{lengths:?} bytes of {bytes}"));
    }
    // Before there are two, of no instant is it said that it is whole.
    let Some(first_ns) = heard.keys().next().copied().filter(|_| seconds > 0.0) else {
        return Ok(Survived { fault, bytes, ..Survived::default() });
    };
    let last_ns = first_ns + (seconds * 1e9).round() as i64;
    let announced: BTreeMap<i64, Value> =
        heard.into_iter().take_while(|(t_ns, _)| *t_ns <= last_ns).collect();
    let sent = poses(&lines(folder, "sent.ndjson"));
    let detected = lines(folder, "detected.ndjson");
    let seen = |camera: &str| -> BTreeSet<i64> {
        detected.iter().filter(|d| d["camera"] == camera).filter_map(|d| d["t_ns"].as_i64()).collect()
    };
    let (seen, filmed) =
        (["cam1", "cam2"].map(seen), [stamps(&folder.join("cam1.y4m")), stamps(&folder.join("cam2.y4m"))]);
    let again = replayed(program, &folder.join("session.toml"))?;
    let shown = |pose: &Value| ["valid", "position_m", "attitude", "covariance"].map(|k| pose[k].clone());
    for (t_ns, pose) in &announced {
        if sent.get(t_ns) != Some(pose) {
            return Err(format!("what was sent at {t_ns} ns of {last_ns} is {:?}", sent.get(t_ns)));
        }
        if !seen.iter().chain(&filmed).all(|stamps| stamps.contains(t_ns)) {
            return Err(format!("frames or detections of {t_ns} ns of {last_ns} are missing"));
        }
        if again.get(t_ns).map(shown) != Some(shown(pose)) {
            return Err(format!("replayed, {t_ns} ns of {last_ns} is {:?}", again.get(t_ns)));
        }
    }
    let inputs = std::fs::read_to_string(folder.join("inputs.csv")).map_err(|e| e.to_string())?;
    let last_input_s = inputs.lines().filter_map(|l| l.split(',').next()?.parse::<f64>().ok()).next_back();
    if last_input_s.is_none_or(|t_s| t_s < last_ns as f64 * 1e-9 - 2.0 / RATE_HZ) {
        return Err(format!("inputs end at {last_input_s:?} s of {} s", last_ns as f64 * 1e-9));
    }
    Ok(Survived { seconds, bytes, instants: announced.len(), fault })
}

/// Poses, or that there was none, by their time.
fn poses(events: &[Value]) -> BTreeMap<i64, Value> {
    let poses = events.iter().filter(|e| e["event"] == "pose");
    poses.filter_map(|e| Some(((e["t_s"].as_f64()? * 1e9).round() as i64, e.clone()))).collect()
}

fn lines(folder: &Path, name: &str) -> Vec<Value> {
    let text = std::fs::read_to_string(folder.join(name)).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// Stamps of the whole frames.
fn stamps(film: &Path) -> BTreeSet<i64> {
    FrameSource::open(film, None).map_or(BTreeSet::new(), |f| f.map_while(Result::ok).map(|f| f.0).collect())
}

fn replayed(program: &Path, session: &Path) -> Result<BTreeMap<i64, Value>, String> {
    let run = Command::new(program).arg("live").arg(session).args(["--replay", "--fast", "--json"]).output();
    let text = String::from_utf8_lossy(&run.map_err(|e| e.to_string())?.stdout).into_owned();
    Ok(poses(&text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect::<Vec<_>>()))
}
