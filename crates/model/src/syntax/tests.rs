use super::*;
use proptest::prelude::*;

/// The value of a tree in which x is 2, y is 3 and z is 0.7.
fn value(part: &Part) -> f64 {
    let fold = |parts: &[(bool, Part)], begin: f64, join: fn(f64, f64) -> f64, part: fn(f64, f64) -> f64| {
        parts
            .iter()
            .fold(begin, |all, (other, p)| if *other { part(all, value(p)) } else { join(all, value(p)) })
    };
    match &part.kind {
        Kind::Number(number) => *number,
        Kind::Name(name) => {
            [("x", 2.0), ("y", 3.0), ("z", 0.7)].into_iter().find(|(n, _)| n == name).unwrap().1
        }
        Kind::Negative(inner) => -value(inner),
        Kind::Sum(terms) => fold(terms, 0.0, |a, b| a + b, |a, b| a - b),
        Kind::Product(factors) => fold(factors, 1.0, |a, b| a * b, |a, b| a / b),
        Kind::Power(base, exponent) => value(base).powf(value(exponent)),
        Kind::Call(name, arguments) => call(name, &arguments.iter().map(value).collect::<Vec<f64>>()),
    }
}

fn call(name: &str, arguments: &[f64]) -> f64 {
    match (name, arguments) {
        ("cos", [x]) => x.cos(),
        ("max", [a, b]) => a.max(*b),
        _ => panic!("{name}"),
    }
}

#[test]
fn what_binds_tighter() {
    for (text, expected) in [
        ("-x^2", -4.0),
        ("(-x)^2", 4.0),
        ("2^3^2", 512.0),
        ("(2^3)^2", 64.0),
        ("12/x/y", 2.0),
        ("12/x*y", 18.0),
        ("12/(x*y)", 2.0),
        ("x - y - 4", -5.0),
        ("x - (y - 4)", 3.0),
        ("x^-2", 0.25),
        ("x^-y^2", 2_f64.powi(-9)),
        ("-x^-2", -0.25),
        ("--x", 2.0),
        ("---x", -2.0),
        ("+-+x", -2.0),
        ("x - -y", 5.0),
        ("x*-y", -6.0),
        ("-x*y", -6.0),
        ("x/-y^2", -2.0 / 9.0),
        ("2x", f64::NAN),
        ("1e2 + 1.5E-1 + .5", 100.65),
        ("2*e1", f64::NAN),
        ("max(x, -y)^2", 4.0),
        ("-max(x, y + 1)*2", -8.0),
        (" x\n +\ty ", 5.0),
    ] {
        match parse(text) {
            Ok(part) if text != "2*e1" => assert_eq!(value(&part), expected, "{text}"),
            Ok(part) => assert_eq!(part.names(), [(2, "e1")]),
            Err((at, fault)) => assert!(text == "2x" && at == 1, "{text}: {fault}"),
        }
    }
}

#[test]
fn a_part_knows_where_it_is() {
    let part = parse("a*(bé + -c)^d + f(g, h)").unwrap();
    assert_eq!(part.names(), [(0, "a"), (3, "bé"), (10, "c"), (13, "d"), (19, "g"), (22, "h")]);
    let Kind::Sum(terms) = &part.kind else { panic!() };
    assert_eq!(terms.iter().map(|(_, term)| term.at).collect::<Vec<usize>>(), [0, 17]);
}

/// An expression before it is text.
#[derive(Debug, Clone)]
enum Tree {
    Number(f64),
    Name(&'static str),
    Negative(Box<Tree>),
    Binary(char, Box<Tree>, Box<Tree>),
    Cosine(Box<Tree>),
    Larger(Box<Tree>, Box<Tree>),
}

impl Tree {
    fn value(&self) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Name(name) => value(&Part { at: 0, kind: Kind::Name((*name).to_owned()) }),
            Self::Negative(inner) => -inner.value(),
            Self::Binary('+', a, b) => a.value() + b.value(),
            Self::Binary('-', a, b) => a.value() - b.value(),
            Self::Binary('*', a, b) => a.value() * b.value(),
            Self::Binary('/', a, b) => a.value() / b.value(),
            Self::Binary(_, a, b) => a.value().powf(b.value()),
            Self::Cosine(a) => call("cos", &[a.value()]),
            Self::Larger(a, b) => call("max", &[a.value(), b.value()]),
        }
    }

    /// With no more parentheses than needed, where `outside` binds as tightly as this number says.
    fn text(&self, outside: u8) -> String {
        let (own, text) = match self {
            Self::Number(number) => (5, format!("{number:?}")),
            Self::Name(name) => (5, (*name).to_owned()),
            Self::Negative(inner) => (3, format!("-{}", inner.text(3))),
            Self::Binary(sign @ ('+' | '-'), a, b) => (1, format!("{} {sign} {}", a.text(1), b.text(2))),
            Self::Binary(sign @ ('*' | '/'), a, b) => (2, format!("{}{sign}{}", a.text(2), b.text(3))),
            Self::Binary(sign, a, b) => (4, format!("{}{sign}{}", a.text(5), b.text(3))),
            Self::Cosine(a) => (5, format!("cos({})", a.text(0))),
            Self::Larger(a, b) => (5, format!("max({}, {})", a.text(0), b.text(0))),
        };
        if own < outside { format!("({text})") } else { text }
    }
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        (0.0..1e3).prop_map(Tree::Number),
        prop::sample::select(vec!["x", "y", "z"]).prop_map(Tree::Name),
    ];
    leaf.prop_recursive(6, 40, 2, |inner| {
        let boxed = inner.prop_map(Box::new);
        prop_oneof![
            boxed.clone().prop_map(Tree::Negative),
            (prop::sample::select(vec!['+', '-', '*', '/', '^']), boxed.clone(), boxed.clone())
                .prop_map(|(sign, a, b)| Tree::Binary(sign, a, b)),
            boxed.clone().prop_map(Tree::Cosine),
            (boxed.clone(), boxed).prop_map(|(a, b)| Tree::Larger(a, b)),
        ]
    })
}

proptest! {
    #[test]
    fn what_is_written_is_read(tree in tree()) {
        let text = tree.text(0);
        let (read, meant) = (value(&parse(&text).unwrap()), tree.value());
        prop_assert!(read == meant || (read.is_nan() && meant.is_nan()), "{text}: {read} {meant}");
    }

    #[test]
    fn any_text_is_read_or_refused_within_it(text in "[-+*/^(), .0-9a-ze$é]{0,40}") {
        if let Err((at, _)) = parse(&text) {
            prop_assert!(at <= text.len());
        }
    }
}
