//! Names of quantities set as symbols: C_m,alpha_u becomes C with the subscript m,α and u below that.

/// Greek letters by their names in files.
const GREEK: [(&str, &str); 19] = [
    ("alpha", "α"),
    ("beta", "β"),
    ("gamma", "γ"),
    ("delta", "δ"),
    ("epsilon", "ε"),
    ("zeta", "ζ"),
    ("eta", "η"),
    ("theta", "θ"),
    ("kappa", "κ"),
    ("lambda", "λ"),
    ("mu", "μ"),
    ("nu", "ν"),
    ("xi", "ξ"),
    ("rho", "ρ"),
    ("sigma", "σ"),
    ("tau", "τ"),
    ("phi", "φ"),
    ("psi", "ψ"),
    ("omega", "ω"),
];

/// Small letters that stand for quantities, as far as no unit follows.
const SMALL: [&str; 5] = ["d", "f", "h", "k", "r"];
const UNITS: [&str; 9] = ["m", "s", "px", "rad", "n", "kg", "hz", "ns", "deg"];

/// A text as HTML: symbols set, what is between backticks as code, all else escaped.
pub(crate) fn html(text: &str) -> String {
    let mut out = String::new();
    let (mut rest, mut before) = (text, ' ');
    while let Some(c) = rest.chars().next() {
        let code = rest.strip_prefix('`').and_then(|r| r.split_once('`'));
        if let Some((code, after)) = code {
            out += &format!("<code>{}</code>", escaped(code));
            (rest, before) = (after, '`');
            continue;
        }
        let token = if is_boundary(before) { token(rest) } else { "" };
        if token.is_empty() {
            out += &escaped(&rest[..c.len_utf8()]);
            (rest, before) = (&rest[c.len_utf8()..], c);
            continue;
        }
        let after = &rest[token.len()..];
        out += &symbol(token).filter(|_| may_follow(after)).unwrap_or_else(|| escaped(token));
        (rest, before) = (after, 'a');
    }
    out
}

/// A parameter's name as HTML; one that is no symbol in words, without the unit that it ends in.
pub(crate) fn name(name: &str, unit: &str) -> String {
    let words = || escaped(&name.strip_suffix(&format!("_{unit}")).unwrap_or(name).replace('_', " "));
    if token(name).len() == name.len() { symbol(name).unwrap_or_else(words) } else { html(name) }
}

/// A text as HTML, also between quotes.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn is_boundary(before: char) -> bool {
    !(before.is_alphanumeric() || ['_', '/', '.', '-', '\\'].contains(&before))
}

/// What may stand behind a symbol: not the rest of a path, a file's name or a word.
fn may_follow(after: &str) -> bool {
    let mut next = after.chars();
    match (next.next(), next.next()) {
        (Some('/' | '-' | '='), _) => false,
        (Some('.'), Some(c)) => !c.is_alphanumeric(),
        _ => true,
    }
}

/// Letters, digits and underscores at the beginning, and what follows on commas without a space.
fn token(text: &str) -> &str {
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut end = text.find(|c| !is_word(c)).unwrap_or(text.len());
    while end > 0 && text[end..].starts_with(',') {
        let more = text[end + 1..].find(|c| !is_word(c)).unwrap_or(text.len() - end - 1);
        if more == 0 {
            break;
        }
        end += 1 + more;
    }
    &text[..end]
}

fn is_capital(head: &str) -> bool {
    head.len() == 1 && head.chars().all(|c| c.is_ascii_uppercase())
}

fn greek(name: &str) -> Option<&'static str> {
    GREEK.iter().find(|(known, _)| *known == name).map(|(_, letter)| *letter)
}

fn symbol(token: &str) -> Option<String> {
    let Some((head, below)) = token.split_once('_') else {
        return Some(format!("<var>{}</var>", greek(token).filter(|_| token.len() > 2)?));
    };
    let mut parts = below.split(',');
    let first = parts.next().filter(|first| !first.is_empty() && !first.contains('_'))?;
    let is_small = SMALL.contains(&head) && !UNITS.contains(&first);
    let letter = match greek(head) {
        Some(letter) => letter,
        None if is_capital(head) || is_small => head,
        None => return None,
    };
    let below: Vec<String> = std::iter::once(first).chain(parts).map(subscript).collect();
    Some(format!("<var>{letter}</var><sub>{}</sub>", below.join(",")))
}

/// One part of a subscript, which may have a subscript of its own.
fn subscript(part: &str) -> String {
    let letter = |name: &str| greek(name).map_or_else(|| escaped(name), str::to_owned);
    match part.split_once('_') {
        Some((head, below)) if greek(head).is_some() || is_capital(head) => {
            format!("{}<sub>{}</sub>", letter(head), escaped(below))
        }
        _ => letter(part),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_quantities_are_set_as_symbols() {
        let cm = "<var>C</var><sub>m,α<sub>u</sub></sub>";
        assert_eq!(html("C_m,alpha_u"), cm);
        assert_eq!(
            html("C_X,0 + 4.6·C_X,T_u"),
            "<var>C</var><sub>X,0</sub> + 4.6·<var>C</var><sub>X,T<sub>u</sub></sub>"
        );
        assert_eq!(html("T_u and tau_f, s"), "<var>T</var><sub>u</sub> and <var>τ</var><sub>f</sub>, s");
        assert_eq!(html("(C_m,alpha_u)."), format!("({cm})."));
        assert_eq!(name("input_lag_s", "s"), "input lag");
        assert_eq!(name("theta", ""), "<var>θ</var>");
    }

    #[test]
    fn what_is_no_symbol_is_left_as_it_is() {
        for text in [
            "frame_00003.png",
            "time_offset_s",
            "a/T_u/b",
            "t_s",
            "h_m",
            "chi-square",
            "C_X.csv",
            "I_xx=3",
            "5 µs",
        ] {
            assert_eq!(html(text), text);
        }
        assert_eq!(html("`C_X <b>`"), "<code>C_X &lt;b&gt;</code>");
        assert_eq!(html("1 < 2 & `open"), "1 &lt; 2 &amp; `open");
    }
}
