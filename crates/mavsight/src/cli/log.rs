//! What may be typed after `log`.

use super::WrongCall;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use mavsight_flight::Interpolation;
use mavsight_session::logs::{LogInput, LogSection, Preset, TimeUnit};
use std::path::{Path, PathBuf};

/// `log`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  mavsight log flight.ulg\n  mavsight log flight.bin --topic IMU\n  \
mavsight log log10 --json\n\n\
Logs of PX4 (ULog), ArduPilot (DataFlash .bin) and the Crazyflie's card, and tables (.csv, .parquet). A gap is an\n\
interval of more than three times the median. More in docs/logs.md.")]
pub(crate) struct ReadLog {
    /// The log
    #[arg(value_name = "FILE")]
    pub(crate) file: PathBuf,
    /// Show every field of these topics, with its unit
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) topic: Vec<String>,
    /// Print all topics and fields as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Which fields of a log are which inputs.
#[derive(Debug, Args)]
pub(crate) struct LogMapping {
    /// Inputs of a known program, from a log
    #[arg(long, value_name = "NAME", value_parser = preset_parser())]
    pub(crate) preset: Option<Preset>,
    /// An input from a log, `COLUMN=TOPIC:FIELD`, then with commas between `instance=`, `unit=`, `scale=`,
    /// `offset=`, `interpolation=`; once for each input
    #[arg(long = "input", value_name = "INPUT", value_parser = log_input)]
    pub(crate) input_of_log: Vec<LogInput>,
    /// Which of several topics of one name --preset takes
    #[arg(long, value_name = "NUMBER", requires = "preset")]
    pub(crate) instance: Option<u32>,
    /// Column of the times, where a table is read as a log
    #[arg(long, value_name = "NAME")]
    pub(crate) time: Option<String>,
    /// Unit of these times: s, ms, us or ns
    #[arg(long, value_name = "UNIT", value_parser = time_unit_parser(), default_value = "s")]
    pub(crate) time_unit: TimeUnit,
}

impl LogMapping {
    /// An option of these that was given.
    pub(crate) fn given(&self) -> Option<&'static str> {
        let all = [
            ("--preset", self.preset.is_some()),
            ("--input", !self.input_of_log.is_empty()),
            ("--instance", self.instance.is_some()),
            ("--time", self.time.is_some()),
        ];
        all.into_iter().find(|(_, is_given)| *is_given).map(|(name, _)| name)
    }

    /// Of a log.
    pub(crate) fn section(&self, file: &Path) -> LogSection {
        LogSection {
            file: file.to_owned(),
            preset: self.preset,
            instance: self.instance,
            time: self.time.clone(),
            time_unit: self.time_unit,
            input: self.input_of_log.clone(),
        }
    }
}

fn preset_parser() -> impl TypedValueParser<Value = Preset> {
    PossibleValuesParser::new(Preset::ALL.map(|(name, _)| name)).map(|name| {
        let found = Preset::ALL.iter().find(|(known, _)| *known == name);
        found.map_or(Preset::Px4Outputs, |(_, preset)| *preset)
    })
}

fn time_unit_parser() -> impl TypedValueParser<Value = TimeUnit> {
    PossibleValuesParser::new(["s", "ms", "us", "ns"]).map(|name| match name.as_str() {
        "ms" => TimeUnit::Ms,
        "us" => TimeUnit::Us,
        "ns" => TimeUnit::Ns,
        _ => TimeUnit::S,
    })
}

/// An input from a log.
fn log_input(text: &str) -> Result<LogInput, WrongCall> {
    let wrong = |what: &str| {
        WrongCall(format!("{text:?}: {what}: write COLUMN=TOPIC:FIELD,scale=2,interpolation=linear"))
    };
    let mut parts = text.split(',');
    let (column, field) =
        parts.next().and_then(|t| t.split_once('=')).ok_or_else(|| wrong("no field is named"))?;
    let (topic, field) =
        field.split_once(':').map_or((None, field), |(topic, field)| (Some(topic.to_owned()), field));
    let mut input =
        LogInput { column: column.to_owned(), topic, field: field.to_owned(), ..LogInput::default() };
    for part in parts {
        let number = |t: &str| {
            t.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong("a number is none"))
        };
        match part.split_once('=').ok_or_else(|| wrong("a part has no ="))? {
            ("instance", value) => {
                input.instance = Some(value.parse().map_err(|_| wrong("an instance is no number"))?)
            }
            ("unit", value) => input.unit = Some(value.to_owned()),
            ("scale", value) => input.scale = Some(number(value)?),
            ("offset", value) => input.offset = number(value)?,
            ("interpolation", "hold") => input.interpolation = Interpolation::Hold,
            ("interpolation", "linear") => input.interpolation = Interpolation::Linear,
            (key, _) => {
                return Err(wrong(&format!("{key} is none of instance, unit, scale, offset, interpolation")));
            }
        }
    }
    Ok(input)
}
