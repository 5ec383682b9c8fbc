//! The summary of a run on one screen of a terminal.

use crate::findings::MOST;
use crate::intervals::Estimates;
use crate::overview::sentences;
use crate::{Advice, Summary};
use mavsight_flight::Vehicle;
use mavsight_session::RunResults;

/// Columns of a line, and lines in all: what a person sees without scrolling, less the caller's own last lines.
const COLUMNS: usize = 100;
const LINES: usize = 22;
/// Lines that a sentence of the overview may take, and a finding with its remedy.
const LINES_OF_SENTENCE: usize = 3;
const LINES_OF_FINDING: usize = 4;
/// Lines that parameters take at least, where there are any: a gap, a heading and two rows.
const LINES_OF_PARAMETERS: usize = 4;
const INDENT: &str = "     ";

/// What flew, how good it is, the parameters and what to mend, in at most 22 lines of 100 columns.
///
/// Findings stand whole, the most harmful first; what there is no room for is counted.
pub fn brief(vehicle: &Vehicle, results: &RunResults, summary: &Summary) -> String {
    let mut lines: Vec<String> =
        sentences(vehicle, results, summary).iter().flat_map(|s| wrapped(s, "", LINES_OF_SENTENCE)).collect();
    let estimates = Estimates::of(results).lines();
    let of_parameters = if estimates.is_empty() { 0 } else { LINES_OF_PARAMETERS };
    let advice = to_mend(&summary.advice, LINES.saturating_sub(lines.len() + of_parameters));
    lines.extend(parameters(&estimates, LINES.saturating_sub(lines.len() + advice.len())));
    lines.extend(advice);
    lines.truncate(LINES);
    lines.join("\n") + "\n"
}

/// A heading and as many findings as there is room for.
fn to_mend(all: &[Advice], room: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let mut shown = 0;
    for (k, advice) in all.iter().take(MOST).enumerate() {
        let own = finding(k + 1, advice);
        if k > 0 && lines.len() + own.len() + 2 > room {
            break;
        }
        lines.extend(own);
        shown += 1;
    }
    let more = match all.len() - shown {
        0 => String::new(),
        more => format!("; {more} more in the report"),
    };
    let heading = [String::new(), format!("To mend, most harmful first{more}")];
    if shown == 0 { lines } else { heading.into_iter().chain(lines).collect() }
}

/// The remedy is read whole: what was found gives way.
fn finding(number: usize, advice: &Advice) -> Vec<String> {
    let room =
        (LINES_OF_FINDING * (COLUMNS - 6 - INDENT.len())).saturating_sub(advice.remedy.chars().count() + 1);
    let text = format!("{} {}", clipped(&advice.what, room.max(40)), advice.remedy);
    let lines = wrapped(&text, INDENT, LINES_OF_FINDING).into_iter().enumerate();
    lines
        .map(|(line, text)| match line {
            0 => format!("  {number}. {}", text.trim_start()),
            _ => text,
        })
        .collect()
}

/// Parameters in two columns, as many as there is room for.
fn parameters(all: &[(String, String, &str)], room: usize) -> Vec<String> {
    const HALF: usize = COLUMNS / 2;
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
    use crate::Harm;

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
        assert!(text.contains("  2. fault 1") && text.contains("more in the report"), "{text}");
    }

    /// A run ended a remedy in the middle of a word.
    #[test]
    fn what_is_to_be_mended_stands_whole() {
        let advice = Advice {
            harm: Harm::Missing,
            what: format!("The flight does not determine {}.", "T_u, T_l of C_X, C_Z, C_m, ".repeat(3)),
            remedy: format!(
                "To separate them, {}end.",
                "move omega_l and omega_u, each by itself, ".repeat(3)
            ),
        };
        let text = finding(1, &advice).join(" ");
        assert!(!text.contains('…') && text.ends_with("end."), "{text}");
        assert_eq!(to_mend(&vec![advice; 9], 12).last().map(|line| line.contains("end.")), Some(true));
    }
}
