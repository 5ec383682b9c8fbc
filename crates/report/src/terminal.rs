//! The summary of a run on one screen of a terminal.

use crate::Summary;
use crate::findings::MOST;
use crate::intervals::Estimates;
use crate::overview::sentences;
use mavsight_flight::Vehicle;
use mavsight_session::RunResults;

/// Columns of a line, and lines in all: what a person sees without scrolling, less the caller's own last lines.
const COLUMNS: usize = 100;
const LINES: usize = 22;
/// Lines that a finding may take.
const LINES_OF_FINDING: usize = 2;
const INDENT: &str = "     ";

/// What flew, how good it is, the parameters and what to mend, in at most 22 lines of 100 columns.
pub fn brief(vehicle: &Vehicle, results: &RunResults, summary: &Summary) -> String {
    let mut lines: Vec<String> =
        sentences(vehicle, results, summary).iter().flat_map(|s| wrapped(s, "", LINES_OF_FINDING)).collect();
    let advice = summary.advice.iter().take(MOST).enumerate();
    let advice: Vec<String> = advice
        .flat_map(|(k, a)| {
            // The remedy is read whole: what was found gives way.
            let room = (LINES_OF_FINDING * (COLUMNS - 6 - INDENT.len()))
                .saturating_sub(a.remedy.chars().count() + 1);
            let text = wrapped(
                &format!("{} {}", clipped(&a.what, room.max(40)), a.remedy),
                INDENT,
                LINES_OF_FINDING,
            );
            text.into_iter().enumerate().map(move |(line, text)| match line {
                0 => format!("  {}. {}", k + 1, text.trim_start()),
                _ => text,
            })
        })
        .collect();
    let of_advice = if advice.is_empty() { 0 } else { advice.len() + 2 };
    lines.extend(parameters(results, LINES.saturating_sub(lines.len() + of_advice)));
    if !advice.is_empty() {
        lines.extend([String::new(), "To mend, most harmful first".to_owned()]);
        lines.extend(advice);
    }
    lines.truncate(LINES);
    lines.join("\n") + "\n"
}

/// Parameters in two columns, as many as there is room for.
fn parameters(results: &RunResults, room: usize) -> Vec<String> {
    const HALF: usize = COLUMNS / 2;
    let all = Estimates::of(results).lines();
    let Some(rows) = room.checked_sub(2).filter(|rows| *rows > 0 && !all.is_empty()) else { return vec![] };
    let cell = |(name, value, verdict): &(String, String, &str)| {
        let doubt = if *verdict == "hardly determined" { " (?)" } else { "" };
        clipped(&format!("  {name:<14} {value}{doubt}"), HALF - 1)
    };
    let cells: Vec<String> = all.iter().map(cell).collect();
    let shown = cells.len().min(2 * rows);
    let half = shown.div_ceil(2);
    let left = if shown < cells.len() {
        format!(", {} of {}: parameters.csv has all", shown, cells.len())
    } else {
        String::new()
    };
    let doubt = if all.iter().any(|p| p.2 == "hardly determined") { "; (?) hardly determined" } else { "" };
    let mut lines = vec![String::new(), format!("Parameters: value ± standard deviation{doubt}{left}")];
    for k in 0..half {
        let second = cells.get(half + k).filter(|_| half + k < shown).map_or("", String::as_str);
        lines.push(format!("{:<HALF$}{second}", cells[k]).trim_end().to_owned());
    }
    lines
}

/// A text in lines of at most [`COLUMNS`], which all begin with an indent; what does not fit is left out and marked.
fn wrapped(text: &str, indent: &str, most: usize) -> Vec<String> {
    let mut lines = vec![indent.to_owned()];
    for word in text.split_whitespace() {
        let last = lines.len() - 1;
        let is_first = lines[last].len() == indent.len();
        let length = lines[last].chars().count() + usize::from(!is_first) + word.chars().count();
        if length <= COLUMNS || is_first {
            let space = if is_first { "" } else { " " };
            lines[last] += &format!("{space}{word}");
        } else {
            lines.push(format!("{indent}{word}"));
        }
    }
    if lines.len() > most {
        lines.truncate(most);
        let last = &mut lines[most - 1];
        *last = clipped(&format!("{last} …"), COLUMNS);
    }
    lines.iter().map(|line| clipped(line, COLUMNS)).collect()
}

fn clipped(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most.saturating_sub(1)).collect::<String>().trim_end().to_owned() + "…"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Advice, Harm};

    #[test]
    fn however_much_there_is_to_say_it_fits_on_one_screen() {
        let results = RunResults {
            notes: vec![format!("No motion: {}", "words ".repeat(60))],
            ..RunResults::default()
        };
        let mut summary = Summary::of(&results, None);
        let advice = |k: usize| Advice {
            harm: Harm::Fault,
            what: format!("fault {k} {}", "of a long kind ".repeat(20)),
            remedy: "x".repeat(300),
        };
        summary.advice = (0..9).map(advice).collect();
        let text = brief(&Vehicle::paper(), &results, &summary);
        assert!(text.lines().count() <= LINES, "{text}");
        assert!(text.lines().all(|line| line.chars().count() <= COLUMNS), "{text}");
        assert!(text.contains("5. fault 4") && !text.contains("fault 5"), "{text}");
    }
}
