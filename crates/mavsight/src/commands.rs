//! What each command does.

mod campaign;
mod check;
mod check_page;
mod convert;
mod convert_formats;
mod demo;
mod film;
mod flights;
mod identify;
mod live;
mod live_flight;
mod live_links;
#[cfg(feature = "page")]
mod live_page;
mod live_sources;
mod live_virtual;
mod log;
mod manoeuvre;
mod manual;
mod new;
mod overlay;
#[cfg(feature = "page")]
mod pick;
mod plan;
mod run;
mod selftest;
mod stages;
mod targets;

use crate::cli::{Cli, Command, Plan, WrongCall};
use anyhow::Result;
use mavsight_session::SessionError;
use std::path::Path;

pub(crate) fn run(cli: &Cli) -> Result<()> {
    match &cli.command {
        Command::Demo(args) => demo::demo(args),
        Command::Targets(args) => targets::targets(args),
        Command::New(args) => new::new(args),
        Command::Check(args) => check::check(args),
        #[cfg(feature = "page")]
        Command::Pick(args) => pick::pick(args),
        Command::Run(args) => run::run(args),
        Command::Live(args) => live::live(args),
        Command::Simulate(args) => stages::simulate(args),
        Command::Film(args) => film::film(args),
        Command::Calibrate(args) => stages::calibrate(args),
        Command::Track(args) => stages::track(args),
        Command::Identify(args) => identify::identify(args),
        Command::Report(args) => stages::report(args),
        Command::Overlay(args) => overlay::overlay(args),
        Command::Convert(args) => convert::convert(args),
        Command::Log(args) => log::log(args),
        Command::Selftest(args) => selftest::selftest(args),
        Command::Plan(Plan::Cameras(args)) => plan::cameras(args),
        Command::Plan(Plan::Manoeuvre(args)) => manoeuvre::manoeuvre(args),
        Command::Campaign(args) => campaign::campaign(args),
        Command::Completions(args) => manual::completions(args),
        Command::Man(args) => manual::pages(args),
    }
}

/// Refuses a folder for results that is a file, before anything is worked out for it.
pub(crate) fn require_folder(out: &Path) -> Result<()> {
    if out.exists() && !out.is_dir() {
        let message = format!("{}: is a file: name a folder for the results", out.display());
        return Err(WrongCall(message).into());
    }
    Ok(())
}

/// A file that the caller named and that is not what it should be: the call was wrong.
pub(crate) fn named<T>(loaded: Result<T, SessionError>) -> Result<T> {
    loaded.map_err(|e| WrongCall(e.to_string()).into())
}
