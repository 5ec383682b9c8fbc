//! What the aircraft's own log holds.

use super::named;
use crate::cli::{ReadLog, WrongCall};
use crate::out::outln;
use anyhow::Result;
use mavsight_log::{Field, Log, Topic};
use mavsight_session::logs::{Preset, TableTime, read_log};

pub(crate) fn log(args: &ReadLog) -> Result<()> {
    let log = named(read_log(&args.file, TableTime::default(), &|_, _, _| false))?;
    for name in &args.topic {
        if let Err(missing @ mavsight_log::LogError::MissingTopic { .. }) = log.topic(name, None) {
            return Err(WrongCall(format!("{}: {missing}", args.file.display())).into());
        }
    }
    for note in &log.notes {
        eprintln!("note: {note}");
    }
    if args.json {
        outln!("{}", json(&log)?);
        return Ok(());
    }
    let from_ns = log.topics.iter().map(|t| t.first_ns).min().unwrap_or_default();
    let until_ns = log.topics.iter().map(|t| t.last_ns).max().unwrap_or_default();
    let [from_s, until_s] = [from_ns, until_ns].map(|t| t as f64 * 1e-9);
    outln!("{}: {}, {from_s:.3} to {until_s:.3} s on its own clock", args.file.display(), log.format);
    let shown = |topic: &&Topic| args.topic.is_empty() || args.topic.contains(&topic.name);
    let width = log.topics.iter().filter(shown).map(|t| t.name.chars().count()).max().unwrap_or(0).max(5);
    outln!(
        "{:width$} {:>4} {:>9} {:>9} {:>6} {:>11}  serves as",
        "topic",
        "no",
        "samples",
        "rate_hz",
        "gaps",
        "longest_s"
    );
    for topic in log.topics.iter().filter(shown) {
        row(topic, width)?;
        if args.topic.is_empty() { uses(topic)? } else { fields(topic)? }
    }
    let presets = Preset::ALL.iter().filter(|(_, preset)| preset.is_of(&log)).map(|(name, _)| *name);
    let presets = presets.collect::<Vec<_>>().join(", ");
    if !presets.is_empty() && args.topic.is_empty() {
        outln!("presets of `mavsight convert {} inputs.csv --preset NAME`: {presets}", args.file.display());
    }
    Ok(())
}

fn row(topic: &Topic, width: usize) -> Result<()> {
    let rate = topic.rate_hz.map_or_else(|| "-".to_owned(), |hz| format!("{hz:.2}"));
    let longest =
        topic.longest_gap.map_or_else(|| "-".to_owned(), |gap| format!("{:.3}", gap.length_ns as f64 * 1e-9));
    let serves = topic.serves.iter().map(|s| s.role.to_string()).collect::<Vec<_>>();
    let line = format!(
        "{:width$} {:>4} {:>9} {rate:>9} {:>6} {longest:>11}  {}",
        topic.name,
        topic.instance,
        topic.samples,
        topic.gaps,
        serves.join(", ")
    );
    outln!("{}", line.trim_end());
    Ok(())
}

/// The fields that serve as something.
fn uses(topic: &Topic) -> Result<()> {
    let mut shown: Vec<&[String]> = Vec::new();
    for serves in &topic.serves {
        if shown.contains(&&serves.fields[..]) {
            continue;
        }
        shown.push(&serves.fields);
        let first = topic.fields.iter().find(|f| Some(&f.name) == serves.fields.first());
        let unit = first.map_or(String::new(), unit_of);
        outln!("    {}: {}{unit}", serves.role, range(&serves.fields));
    }
    Ok(())
}

/// Names, or where they are many the first and the last.
fn range(names: &[String]) -> String {
    match names {
        [first, .., last] if names.len() > 4 => format!("{first} to {last}"),
        all => all.join(", "),
    }
}

fn fields(topic: &Topic) -> Result<()> {
    for field in &topic.fields {
        outln!("    {}{}", field.name, unit_of(field));
    }
    Ok(())
}

fn unit_of(field: &Field) -> String {
    field.unit.as_ref().map_or(String::new(), |unit| format!(" [{unit}]"))
}

fn json(log: &Log) -> Result<String> {
    let parameters: serde_json::Map<String, serde_json::Value> =
        log.parameters.iter().map(|(name, value)| (name.clone(), value.clone().into())).collect();
    let all = serde_json::json!({
        "format": log.format, "topics": log.topics, "parameters": parameters, "notes": log.notes
    });
    Ok(serde_json::to_string_pretty(&all)?)
}
