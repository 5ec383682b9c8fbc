//! What goes into a shell and into the manual.

use crate::cli::{Cli, Completions, Man};
use crate::out::outln;
use anyhow::{Context, Result};
use clap::CommandFactory;
use mavsight_session::make_folder;

pub(crate) fn completions(args: &Completions) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "mavsight", &mut script);
    crate::out::out!("{}", String::from_utf8_lossy(&script));
    Ok(())
}

pub(crate) fn pages(args: &Man) -> Result<()> {
    make_folder(&args.dir)?;
    clap_mangen::generate_to(Cli::command(), &args.dir).with_context(|| format!("{}", args.dir.display()))?;
    outln!("mavsight.1 and a page for each command: {}", args.dir.display());
    Ok(())
}
