//! Recordings of live flights that are killed, and that run into the end of their disk, at random moments:
//! reads back what each has announced.
//!
//! `cargo build -p mavsight && cargo run -p mavsight --example killed_recordings [-- KILLS FULL SEED]`

#[path = "../tests/common/survivors.rs"]
mod survivors;

use anyhow::{Context, Result};
use mavsight_random::Random;
use std::path::{Path, PathBuf};
use std::time::Duration;
use survivors::{Survived, flight, survive};

fn main() -> Result<()> {
    let given =
        |at: usize, usual: u64| std::env::args().nth(at).map_or(Ok(usual), |text| text.parse::<u64>());
    let (kills, full, seed) = (given(1, 100)?, given(2, 20)?, given(3, 37)?);
    let program = program()?;
    let mut random = Random::new(seed, 0);
    let killed = |random: &mut Random, folder: &Path| {
        let after = Duration::from_secs_f64(random.between(0.0, 4.0));
        survive(flight(&program, folder, None), &program, folder, Some(after))
    };
    let filled = |random: &mut Random, folder: &Path| {
        // Blocks of half a kilobyte or of one, as the shell counts: 4 to 40 MB, of 43 that a film has.
        let blocks = random.between(8e3, 4e4) as u64;
        survive(flight(&program, folder, Some(blocks)), &program, folder, None)
    };
    report("killed", kills, &mut random, killed)?;
    report("on a full disk", full, &mut random, filled)
}

/// Flies again and again, and prints what became of the recordings.
fn report(
    what: &str,
    times: u64,
    random: &mut Random,
    one: impl Fn(&mut Random, &Path) -> std::result::Result<Survived, String>,
) -> Result<()> {
    let (mut all, mut lost) = (Survived::default(), 0);
    let (mut nothing_yet, mut faults) = (0, 0);
    for k in 0..times {
        let folder = std::env::temp_dir().join(format!("mavsight-{}-{k}", std::process::id()));
        match one(random, &folder) {
            Ok(own) => {
                nothing_yet += u64::from(own.bytes == 0);
                faults += u64::from(own.fault.is_some());
                all.seconds += own.seconds;
                all.bytes += own.bytes;
                all.instants += own.instants;
            }
            Err(why) => {
                lost += 1;
                eprintln!("{what}, {k}: {why}");
            }
        }
        if folder.exists() {
            std::fs::remove_dir_all(&folder)?;
        }
        eprint!("\r{what}: {} of {times}", k + 1);
    }
    eprintln!();
    println!(
        "{what}: {times} recordings, {lost} not read back as announced; announced and read back {} instants, {:.1} s, {:.0} MB; \
         {nothing_yet} had announced nothing yet, {faults} said a fault",
        all.instants,
        all.seconds,
        all.bytes as f64 * 1e-6
    );
    Ok(())
}

/// The program beside this example's folder.
fn program() -> Result<PathBuf> {
    let own = std::env::current_exe()?;
    let folder = own.parent().and_then(Path::parent).context("no folder")?;
    Ok(folder.join("mavsight"))
}
