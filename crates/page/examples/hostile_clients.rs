//! What hostile clients do to a live flight: latency from the last frame in hand to the pose, and from the
//! pose to an open page, without and with them, turn about in one flight through the virtual room.
//!
//! `cargo build -p mavsight && cargo run -p mavsight-page --example hostile_clients [-- CLIENTS ROUNDS SECONDS]`

#[path = "../tests/hostile/attack.rs"]
mod attack;

use attack::Attack;
use std::error::Error;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use tungstenite::{Message, WebSocket};

type Fallible<T> = Result<T, Box<dyn Error>>;

/// Between attack and calm, so that neither is measured in the other.
const BETWEEN: Duration = Duration::from_secs(1);

fn main() -> Fallible<()> {
    let given = |at: usize, usual: u64| std::env::args().nth(at).map_or(Ok(usual), |text| text.parse());
    let (clients, rounds, seconds) = (given(1, 2000)?, given(2, 6)?, given(3, 10)?);
    let own = std::env::current_exe()?;
    let program = own.parent().and_then(Path::parent).ok_or("no folder")?.join("mavsight");
    let flight = Flight::start(&program)?;
    let mut page = flight.open()?;
    let (mut calm, mut attacked) = (Measured::default(), Measured::default());
    let (mut connections, mut frames, mut bytes, mut most_open) = (0, 0, 0, 0);
    let before_kb = flight.resident_kb();
    listen(&mut page, BETWEEN, &mut Measured::default())?;
    for round in 0..rounds {
        listen(&mut page, Duration::from_secs(seconds), &mut calm)?;
        let attack = Attack::start(flight.address, usize::try_from(clients)?);
        listen(&mut page, BETWEEN, &mut Measured::default())?;
        listen(&mut page, Duration::from_secs(seconds), &mut attacked)?;
        attacked.commands += ask(&mut page)?;
        let tally = std::sync::Arc::clone(&attack.tally);
        drop(attack);
        connections += tally.connections.load(Ordering::Relaxed);
        frames += tally.frames.load(Ordering::Relaxed);
        bytes += tally.bytes.load(Ordering::Relaxed);
        most_open = tally.most_open.load(Ordering::Relaxed).max(most_open);
        let breaches = tally.breaches.lock().map_err(|_| "an attack has panicked")?;
        if !breaches.is_empty() {
            return Err(format!("served: {breaches:?}").into());
        }
        listen(&mut page, BETWEEN, &mut Measured::default())?;
        eprint!("\r{} of {rounds}", round + 1);
    }
    eprintln!();
    let after_kb = flight.resident_kb();
    println!(
        "{clients} clients, at most {most_open} connected at once; {connections} connections, {frames} WebSocket frames, \
         {:.0} MB sent; nothing served that the token guards, {} of {rounds} own commands answered",
        bytes as f64 * 1e-6,
        attacked.commands
    );
    println!("memory of the flight: {before_kb} to {after_kb} kB");
    for (what, calm, attacked) in [
        ("frame to pose", &mut calm.pose_ms, &mut attacked.pose_ms),
        ("frame to page", &mut calm.page_ms, &mut attacked.page_ms),
    ] {
        for share in [0.5, 0.99] {
            let (a, b) = (quantile(calm, share), quantile(attacked, share));
            println!(
                "{what}: {:.0} % {a:.2} ms without ({} poses), {b:.2} ms with ({} poses), ratio {:.2}",
                100.0 * share,
                calm.len(),
                attacked.len(),
                b / a
            );
        }
    }
    Ok(())
}

#[derive(Default)]
struct Measured {
    /// From the last frame in hand to the pose, by the flight itself.
    pose_ms: Vec<f64>,
    /// From the middle of the exposure to this page.
    page_ms: Vec<f64>,
    commands: u64,
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = (share * (values.len().max(1) - 1) as f64).round() as usize;
    values.get(at).copied().unwrap_or(f64::NAN)
}

struct Flight {
    child: Child,
    address: SocketAddr,
    token: String,
}

impl Flight {
    fn start(program: &Path) -> Fallible<Self> {
        let mut child = Command::new(program)
            .args(["live", "--virtual", "--serve", "127.0.0.1:0", "--rate", "30", "--size", "400x300"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let mut lines = BufReader::new(child.stderr.take().ok_or("no output")?).lines().map_while(Result::ok);
        let url = lines.find_map(|l| Some(l.split_once("http://")?.1.to_owned())).ok_or("no address")?;
        std::thread::spawn(move || lines.for_each(drop));
        let (address, token) = url.split_once('/').ok_or("no token")?;
        Ok(Self { child, address: address.parse()?, token: token.trim_end_matches('/').to_owned() })
    }

    fn open(&self) -> Fallible<WebSocket<TcpStream>> {
        let stream = TcpStream::connect(self.address)?;
        stream.set_read_timeout(Some(Duration::from_secs(20)))?;
        let request = tungstenite::http::Request::get(format!("ws://{}/{}/events", self.address, self.token))
            .header("Host", self.address.to_string())
            .header("Origin", format!("http://{}", self.address))
            .header("Connection", "Upgrade")
            .header("Upgrade", "websocket")
            .header("Sec-WebSocket-Version", "13")
            .header("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ==")
            .body(())?;
        Ok(tungstenite::client(request, stream).map_err(|e| e.to_string())?.0)
    }

    fn resident_kb(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        line.and_then(|l| l.trim().trim_end_matches(" kB").parse().ok()).unwrap_or_default()
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::io::stderr().flush();
    }
}

/// Notes the latencies of the poses that come in this time.
fn listen(page: &mut WebSocket<TcpStream>, time: Duration, into: &mut Measured) -> Fallible<()> {
    let begun = Instant::now();
    while begun.elapsed() < time {
        let Message::Text(text) = page.read()? else { continue };
        let event: serde_json::Value = serde_json::from_str(&text)?;
        let (Some(latency_ms), Some(captured_ns)) =
            (event["latency_ms"].as_f64(), event["captured_ns"].as_i64())
        else {
            continue;
        };
        if event["valid"] == true {
            let now_ns = SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos() as i64;
            into.pose_ms.push(latency_ms);
            into.page_ms.push((now_ns - captured_ns) as f64 * 1e-6);
        }
    }
    Ok(())
}

/// Gives a command; one if it is carried out.
fn ask(page: &mut WebSocket<TcpStream>) -> Fallible<u64> {
    page.send(Message::text(r#"{"command":"self_check"}"#))?;
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(10) {
        if let Message::Text(text) = page.read()? {
            let event: serde_json::Value = serde_json::from_str(&text)?;
            if event["event"] == "note" {
                return Ok(u64::from(event["text"].as_str().is_some_and(|t| t.contains("frames/s"))));
            }
        }
    }
    Ok(0)
}
