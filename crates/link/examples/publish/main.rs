//! Flies a circle through every outlet of a file, for trying clients without cameras:
//!
//!     cargo run -p mavsight-link --example publish -- outlets.toml 60
//!
//! `outlets.toml` has the sections of `[live]`: `[mavlink]`, `[natnet]`, `[vrpn]`, `[json]`, `[zenoh]`.

mod circle;

use mavsight_link::{Body, LiveSection, open};
use std::error::Error;
use std::time::{Duration, Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, seconds, rest @ ..] = &words[..] else {
        return Err("publish OUTLETS.toml SECONDS [RATE_HZ]".into());
    };
    let rate_hz: f64 = rest.first().map_or(Ok(60.0), |text| text.parse())?;
    let seconds: f64 = seconds.parse()?;
    let options: LiveSection = toml::from_str(&std::fs::read_to_string(file)?)?;
    let mut outlets = open(&options, &Body::new("circle", circle::markers()))?;
    println!("{} outlets are open", outlets.len());
    for outlet in &mut outlets {
        outlet.event(&circle::scene())?;
    }
    let mut took_us: Vec<Vec<f64>> = outlets.iter().map(|_| Vec::new()).collect();
    let begun = Instant::now();
    for sequence in 0..(seconds * rate_hz) as u64 {
        let due = Duration::from_secs_f64(sequence as f64 / rate_hz);
        std::thread::sleep(due.saturating_sub(begun.elapsed()));
        let fix = circle::fix(sequence, mavsight_link::now_ns());
        let event = circle::event(&fix);
        for (outlet, took_us) in outlets.iter_mut().zip(&mut took_us) {
            let at = Instant::now();
            if let Err(fault) = outlet.send(&fix).and_then(|()| outlet.event(&event)) {
                eprintln!("{fault}");
            }
            took_us.push(at.elapsed().as_secs_f64() * 1e6);
        }
    }
    for (k, took_us) in took_us.iter_mut().enumerate() {
        took_us.sort_by(f64::total_cmp);
        let part = |share: f64| took_us.get((share * took_us.len() as f64) as usize).copied().unwrap_or(0.0);
        println!("outlet {}: {:.0} us an instant, 99 % within {:.0} us", k + 1, part(0.5), part(0.99));
    }
    Ok(())
}
