//! Files that are broken in every way: each is read or refused with a place in it, and soon.

#![allow(clippy::unwrap_used, clippy::panic)]

use mavsight_model::{Body, Dynamics, Model};
use std::time::{Duration, Instant};

const FILES: u64 = 500;
const BODY: Body = Body {
    mass_kg: 0.5,
    inertia_kg_m2: [3e-3, 4e-3, 5e-3, 0.0, 0.0, 0.0],
    gravity_m_s2: 9.81,
    air_density_kg_m3: 1.2,
};

/// A fixed sequence of random numbers (splitmix64).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n.max(1) as u64) as usize
    }

    fn of<'a>(&mut self, words: &[&'a str]) -> &'a str {
        words[self.below(words.len())]
    }

    /// Small numbers and large ones alike.
    fn size(&mut self, most: usize) -> usize {
        let part = self.below(most.ilog2() as usize + 1);
        (most >> part).max(1)
    }
}

fn shelf() -> Vec<String> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/shelf");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
    files.sort();
    files.into_iter().map(|path| std::fs::read_to_string(path).unwrap()).collect()
}

const WORDS: [&str; 24] = [
    "=", "\"", "'", "{", "}", "[", "]", "[[", "(", ")", "^", "*", "/", "-", ",", "NaN", "inf", "1e999",
    "0/0", "\u{0}", "\u{feff}", "日本", "\u{301}", "\\u0041",
];

/// A small model with this in it.
fn model(sections: &str, force: &str) -> String {
    format!("schema = 2\nname = \"hostile\"\n{sections}\n[forces]\nx = \"{force}\"\n")
}

fn lines(n: usize, line: impl Fn(usize) -> String) -> String {
    (0..n).map(line).collect::<Vec<String>>().join("\n")
}

/// Damage at random places.
fn damaged(random: &mut Random, text: &str, way: usize) -> String {
    let mut letters: Vec<char> = text.chars().collect();
    let mut rows: Vec<String> = text.lines().map(str::to_owned).collect();
    match way {
        0 => letters.into_iter().take(random.below(text.len())).collect(),
        1 => {
            let from = random.below(letters.len());
            letters.drain(from..(from + random.size(2000)).min(text.chars().count()));
            letters.into_iter().collect()
        }
        2 => {
            for k in 0..rows.len() {
                let other = random.below(rows.len());
                rows.swap(k, other);
            }
            rows.join("\n")
        }
        3 => {
            let mut words: Vec<&str> = text.split_inclusive([' ', '(', ')', '*', ',', '"', '\n']).collect();
            for _ in 0..random.size(16) {
                let (a, b) = (random.below(words.len()), random.below(words.len()));
                words.swap(a, b);
            }
            words.concat()
        }
        4 => {
            for _ in 0..random.size(16) {
                let (at, word) = (random.below(letters.len()), random.of(&WORDS));
                letters.splice(at..at, word.chars());
            }
            letters.into_iter().collect()
        }
        5 => {
            let (row, at) = (rows[random.below(rows.len())].clone(), random.below(rows.len()));
            rows.insert(at, row);
            rows.join("\r\n")
        }
        _ => {
            for _ in 0..random.size(64) {
                let at = random.below(letters.len());
                letters[at] = char::from(32 + random.below(95) as u8);
            }
            letters.into_iter().collect()
        }
    }
}

/// Files that are too large, too deep or in circles.
fn built(random: &mut Random, way: usize) -> String {
    let n = random.size(100_000);
    match way {
        0 => {
            let n = n.min(900);
            let circle = lines(n, |k| format!("d_{k} = \"u + d_{}\"", (k + 1) % n));
            model(&format!("[definitions]\n{circle}"), "d_0")
        }
        1 => {
            let n = n.min(10_000);
            model(
                &format!("[states]\n{}", lines(n, |k| format!("s_{k} = {{ derivative = \"-s_{k}\" }}"))),
                "s_0",
            )
        }
        2 => model("", &format!("{}u{}", random.of(&["(", "-(", "sin(", "1/("]).repeat(n), ")".repeat(n))),
        3 => model(
            "",
            &vec![random.of(&["u", "2", "-u", "(u)"]); n].join(random.of(&["^", "*", "+", "/", "^-", "-"])),
        ),
        4 => {
            let n = random.size(1_200_000);
            random
                .of(&["a", "a = 1\n", "[a]\n", "[[table]]\n", "\"", "é", "[", "x.", "# \n", "a = \"\\n\"\n"])
                .repeat(n)
        }
        5 => {
            let number =
                random.of(&["1e308", "-1e308", "1e999", "nan", "-inf", "0xffffffffffffffff", "1e-320"]);
            let digits = "9".repeat(random.size(10_000));
            let number = if random.below(2) == 0 { number } else { &digits };
            let text = "k*u^2*1e300*1e300/(u - u) + 0/0 + (k*v)^999 + exp(1e5*u) + log(-u^2)";
            model(&format!("[parameters]\nk = {{ value = {number}, free = true }}"), text)
        }
        6 => format!("schema = 2\nname = {}1{}", "[".repeat(n), "]".repeat(n)),
        7 => format!("schema = 2\nname = {}1{}", "{ a = ".repeat(n), "}".repeat(n)),
        8 => format!("schema = 2\n[{}]\nname = 1", vec!["a"; n].join(".")),
        // Each definition twice in the next: as a tree it would be 2^n large.
        9 => {
            let n = n.min(999);
            let chain = lines(n, |k| format!("d_{} = \"d_{k}*sin(d_{k}) + d_{k}/(1 + d_{k}^2)\"", k + 1));
            model(&format!("[definitions]\nd_0 = \"u*v\"\n{chain}"), &format!("d_{n}"))
        }
        // Every state in the derivative of every other.
        10 => {
            let n = n.min(100);
            let sum =
                (0..n).map(|k| format!("sin(s_{k}*s_{})", (k + 7) % n)).collect::<Vec<String>>().join("*");
            let states = lines(n, |k| format!("s_{k} = {{ derivative = \"{sum} + u^{}\" }}", k + 1));
            model(&format!("[states]\n{states}"), "s_0")
        }
        11 => {
            let name = random.of(&["a", "_", "ä"]).repeat(n);
            model(&format!("[definitions]\n{name} = \"u\""), &format!("{name}b + {}", "q".repeat(n)))
        }
        12 => {
            let n = n.min(30_000);
            let equations = lines(n, |_| {
                "[[equation]]\nname = \"X\"\nmeasured = \"force_x\"\nregressors = [\"u\"]".into()
            });
            format!("{}{equations}", model("", "u"))
        }
        // As many operations as one file may have.
        _ => {
            let n = n.min(800);
            let long =
                |k: usize| (0..60).map(|j| format!("u^{}*v*{k}", j + 3)).collect::<Vec<String>>().join(" + ");
            let names = (0..n).map(|k| format!("d_{k}")).collect::<Vec<String>>().join("*");
            model(&format!("[definitions]\n{}", lines(n, |k| format!("d_{k} = \"{}\"", long(k)))), &names)
        }
    }
}

fn file(seed: u64, shelf: &[String]) -> String {
    let mut random = Random(seed);
    match random.below(21) {
        way @ 0..7 => {
            let k = random.below(shelf.len());
            damaged(&mut random, &shelf[k], way)
        }
        way => built(&mut random, way - 7),
    }
}

/// Reads a file; `Ok` with the time that its equations of motion took.
fn read(text: &str) -> Option<Duration> {
    match Model::parse("hostile.toml", text) {
        Ok(model) => {
            let values = model.values(&BODY, |_| None);
            let begin = Instant::now();
            let free: Vec<usize> = (0..model.parameters.len()).collect();
            let dynamics = Dynamics::new(&model, &values, &free);
            let start = model.at_rest(&values);
            let _ = model.check(&values, &start);
            let mut rates = vec![0.0; dynamics.states()];
            let mut evaluation = dynamics.with(&values);
            evaluation.set_inputs(&start.inputs);
            evaluation.linearise(&start.state, &mut rates);
            Some(begin.elapsed())
        }
        Err(error) => {
            let rows: Vec<&str> = text.split('\n').collect();
            assert!(error.line >= 1 && error.line <= rows.len(), "{}", error.line);
            let columns = rows[error.line - 1].chars().count() + 1;
            assert!(
                error.column >= 1 && error.column <= columns,
                "column {} of {columns}: {}",
                error.column,
                error.fault
            );
            assert!(error.to_string().len() < 2000, "{}", error.to_string().len());
            None
        }
    }
}

#[test]
fn hostile_files_are_refused_at_a_place_in_them() {
    let shelf = shelf();
    let mut accepted = 0;
    for seed in 0..FILES {
        let text = file(seed, &shelf);
        accepted += usize::from(read(&text).is_some());
    }
    println!("{accepted} of {FILES} are models");
    assert!(accepted > 5 && accepted < 250, "{accepted}");
}

/// Peak of the resident memory, where the system says it.
fn peak_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok().map(|kb: f64| kb / 1024.0)
}

/// As many derivatives as a file may have: products of a hundred factors in each of `states` states.
fn largest(states: usize) -> String {
    let line = |k: usize| {
        let factors =
            (0..states).map(|j| format!("sin(s_{}*u + {k})", (k + j) % states)).collect::<Vec<String>>();
        format!("s_{k} = {{ derivative = \"{}\" }}", factors.join("*"))
    };
    model(&format!("[states]\n{}", lines(states, line)), "s_0")
}

/// By itself, as other tests take time and memory: `cargo test --release --test hostile -- --ignored`.
#[test]
#[ignore = "measures time and memory"]
fn hostile_files_take_a_second_and_200_mb_at_most() {
    let shelf = shelf();
    let (mut slowest, mut motion) = ((Duration::ZERO, 0), (Duration::ZERO, 0));
    for seed in 0..FILES {
        let text = file(seed, &shelf);
        let (begin, before) = (Instant::now(), peak_mb());
        let of_motion = read(&text).unwrap_or_default();
        slowest = slowest.max((begin.elapsed() - of_motion, seed));
        motion = motion.max((of_motion, seed));
        if let (Some(before), Some(after)) = (before, peak_mb())
            && after > before + 10.0
        {
            println!(
                "seed {seed}: {before:.0} to {after:.0} MB: {}",
                text.chars().take(100).collect::<String>()
            );
        }
    }
    for states in [60, 80, 100] {
        let begin = Instant::now();
        let of_motion = read(&largest(states));
        println!("{states} states: {:?} to read, equations of motion {of_motion:?}", begin.elapsed());
        motion = motion.max((of_motion.unwrap_or_default(), 0));
    }
    println!("slowest to read {slowest:?}, to make equations of motion {motion:?}, peak {:?} MB", peak_mb());
    assert!(slowest.0 < Duration::from_secs(1), "{slowest:?}");
    assert!(motion.0 < Duration::from_secs(2), "{motion:?}");
    assert!(peak_mb().is_none_or(|mb| mb < 200.0), "{:?}", peak_mb());
}
