//! Numbers of 192 bits (57 digits), and the operations of the notation on them.

use astro_float_num::{BigFloat, Consts, RoundingMode, Sign};

/// Bits of a number.
const BITS: usize = 192;
const ROUNDING: RoundingMode = RoundingMode::None;

/// What a step of a calculation does.
#[derive(Debug, Clone)]
pub(crate) enum Op {
    Constant(BigFloat),
    Variable(usize),
    Add(usize, usize),
    Subtract(usize, usize),
    Multiply(usize, usize),
    Divide(usize, usize),
    /// Whole exponents, of which the base may be below zero.
    Whole(usize, i32),
    Power(usize, usize),
    Atan2(usize, usize),
    Minimum(usize, usize),
    Maximum(usize, usize),
    Table(usize, Vec<(f64, f64)>),
    Function(Name, usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Name {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sqrt,
    Abs,
    Exp,
    Log,
    Tanh,
}

pub(crate) const NAMES: [(&str, Name); 11] = [
    ("sin", Name::Sin),
    ("cos", Name::Cos),
    ("tan", Name::Tan),
    ("asin", Name::Asin),
    ("acos", Name::Acos),
    ("atan", Name::Atan),
    ("sqrt", Name::Sqrt),
    ("abs", Name::Abs),
    ("exp", Name::Exp),
    ("log", Name::Log),
    ("tanh", Name::Tanh),
];

pub(crate) fn big(value: f64) -> BigFloat {
    BigFloat::from_f64(value, BITS)
}

pub(crate) fn small(value: &BigFloat) -> f64 {
    let Some((words, _, sign, exponent, _)) = value.as_raw_parts() else { return f64::NAN };
    let top = |k: usize| words.len().checked_sub(k).map_or(0.0, |k| words[k] as f64);
    let mantissa = top(1) * 2_f64.powi(-64) + top(2) * 2_f64.powi(-128);
    let size = mantissa * 2_f64.powi(exponent);
    if sign == Sign::Neg { -size } else { size }
}

pub(crate) fn plus(a: &BigFloat, b: &BigFloat) -> BigFloat {
    a.add(b, BITS, ROUNDING)
}

pub(crate) fn minus(a: &BigFloat, b: &BigFloat) -> BigFloat {
    a.sub(b, BITS, ROUNDING)
}

pub(crate) fn over(a: &BigFloat, b: &BigFloat) -> BigFloat {
    a.div(b, BITS, ROUNDING)
}

fn times(a: &BigFloat, b: &BigFloat) -> BigFloat {
    a.mul(b, BITS, ROUNDING)
}

fn whole(base: &BigFloat, n: i32) -> BigFloat {
    let power = (0..n.unsigned_abs()).fold(big(1.0), |power, _| times(&power, base));
    if n < 0 { over(&big(1.0), &power) } else { power }
}

/// What functions need to have worked out.
pub(crate) struct Constants {
    library: Consts,
    half_pi: BigFloat,
    /// One over factorials.
    over_factorial: Vec<BigFloat>,
}

/// Terms of a sine of 0.013: the next is 1e-66.
const TERMS: usize = 24;
/// Halvings of an angle before its series.
const HALVINGS: i32 = 6;

impl Constants {
    pub(crate) fn new() -> Self {
        let mut library = Consts::new().unwrap();
        let half_pi = over(&library.pi(BITS, ROUNDING), &big(2.0));
        let mut over_factorial = vec![big(1.0)];
        for k in 1..TERMS {
            over_factorial.push(over(&over_factorial[k - 1], &big(k as f64)));
        }
        Self { library, half_pi, over_factorial }
    }

    /// Sine and cosine by their series: in a fifteenth of the library's time.
    pub(crate) fn sin_cos(&self, x: &BigFloat) -> (BigFloat, BigFloat) {
        let quarters = (small(x) / std::f64::consts::FRAC_PI_2).round();
        let rest = minus(x, &times(&big(quarters), &self.half_pi));
        let part = times(&rest, &big(2_f64.powi(-HALVINGS)));
        let square = times(&part, &part);
        let series = |from: usize| {
            let terms = (from..TERMS).step_by(2).rev();
            terms.fold(big(0.0), |sum, k| minus(&self.over_factorial[k], &times(&sum, &square)))
        };
        let (mut sin, mut cos) = (times(&series(1), &part), series(0));
        for _ in 0..HALVINGS {
            let product = times(&sin, &cos);
            cos = minus(&times(&cos, &cos), &times(&sin, &sin));
            sin = plus(&product, &product);
        }
        match (quarters as i64).rem_euclid(4) {
            0 => (sin, cos),
            1 => (cos, sin.neg()),
            2 => (sin.neg(), cos.neg()),
            _ => (cos.neg(), sin),
        }
    }

    /// The angle of 64 bits, and what it lacks: some 1e-16, of which three terms are enough.
    pub(crate) fn atan(&self, x: &BigFloat) -> BigFloat {
        let near = big(small(x).atan());
        let (sin, cos) = self.sin_cos(&near);
        let rest = over(&minus(&times(x, &cos), &sin), &plus(&cos, &times(x, &sin)));
        let square = times(&rest, &rest);
        let inner = minus(&over(&big(1.0), &big(3.0)), &over(&square, &big(5.0)));
        plus(&near, &times(&rest, &minus(&big(1.0), &times(&square, &inner))))
    }

    pub(crate) fn asin(&self, x: &BigFloat) -> BigFloat {
        let one = big(1.0);
        let root = times(&minus(&one, x), &plus(&one, x)).sqrt(BITS, ROUNDING);
        if root.is_zero() {
            return times(x, &self.half_pi);
        }
        self.atan(&over(x, &root))
    }
}

fn atan2(y: &BigFloat, x: &BigFloat, constants: &mut Constants) -> BigFloat {
    let angle = constants.atan(&over(y, x));
    let pi = plus(&constants.half_pi, &constants.half_pi);
    match (x.is_negative(), y.is_negative()) {
        (false, _) => angle,
        (true, false) => plus(&angle, &pi),
        (true, true) => minus(&angle, &pi),
    }
}

fn table(points: &[(f64, f64)], x: &BigFloat) -> BigFloat {
    let at = small(x);
    let after = points.iter().position(|(px, _)| *px > at);
    match after {
        Some(0) => big(points[0].1),
        None => big(points[points.len() - 1].1),
        Some(k) => {
            let ((x0, y0), (x1, y1)) = (points[k - 1], points[k]);
            let share = over(&minus(x, &big(x0)), &minus(&big(x1), &big(x0)));
            plus(&big(y0), &times(&share, &minus(&big(y1), &big(y0))))
        }
    }
}

/// Angles of 50 digits: against the library's.
#[test]
fn angles_are_those_of_the_library() {
    let mut constants = Constants::new();
    let near =
        |a: &BigFloat, b: &BigFloat| assert!(small(&minus(a, b)).abs() < 1e-50, "{} {}", small(a), small(b));
    for k in -40..40 {
        let x = over(&big(f64::from(k)), &big(7.0));
        let (sin, cos) = constants.sin_cos(&x);
        near(&sin, &x.sin(BITS, ROUNDING, &mut constants.library));
        near(&cos, &x.cos(BITS, ROUNDING, &mut constants.library));
        near(&constants.atan(&x), &x.atan(BITS, ROUNDING, &mut constants.library));
        near(&constants.asin(&sin), &sin.asin(BITS, ROUNDING, &mut constants.library));
    }
}

impl Op {
    pub(crate) fn operands(&self) -> Vec<usize> {
        match self {
            Self::Constant(_) | Self::Variable(_) => Vec::new(),
            Self::Whole(a, _) | Self::Table(a, _) | Self::Function(_, a) => vec![*a],
            Self::Add(a, b)
            | Self::Subtract(a, b)
            | Self::Multiply(a, b)
            | Self::Divide(a, b)
            | Self::Power(a, b)
            | Self::Atan2(a, b)
            | Self::Minimum(a, b)
            | Self::Maximum(a, b) => vec![*a, *b],
        }
    }

    pub(crate) fn value(
        &self,
        at: &[BigFloat],
        variables: &[BigFloat],
        constants: &mut Constants,
    ) -> BigFloat {
        match self {
            Self::Constant(value) => value.clone(),
            Self::Variable(k) => variables[*k].clone(),
            Self::Add(a, b) => plus(&at[*a], &at[*b]),
            Self::Subtract(a, b) => minus(&at[*a], &at[*b]),
            Self::Multiply(a, b) => times(&at[*a], &at[*b]),
            Self::Divide(a, b) => over(&at[*a], &at[*b]),
            Self::Whole(a, n) => whole(&at[*a], *n),
            Self::Power(a, b) => at[*a].pow(&at[*b], BITS, ROUNDING, &mut constants.library),
            Self::Atan2(a, b) => atan2(&at[*a], &at[*b], constants),
            Self::Minimum(a, b) => at[*a].min(&at[*b]),
            Self::Maximum(a, b) => at[*a].max(&at[*b]),
            Self::Table(a, points) => table(points, &at[*a]),
            Self::Function(name, a) => name.value(&at[*a], constants),
        }
    }

    /// How far rounding may turn each derivative of this step: for each operand the size of its factor in the
    /// chain rule, with what a relative change of the operands by one makes of that factor. `size` is that of
    /// the operands' values, see [`Op::size`], `at` their values, `own` the value of this step.
    pub(crate) fn weights(&self, size: &[f64], at: &[f64], own: f64) -> [f64; 2] {
        let relative = |a: usize| size[a] / at[a].abs();
        match self {
            Self::Constant(_) | Self::Variable(_) => [0.0; 2],
            Self::Add(..) | Self::Subtract(..) | Self::Minimum(..) | Self::Maximum(..) => [1.0; 2],
            Self::Multiply(a, b) => [size[*b], size[*a]],
            Self::Divide(a, b) => {
                let over = relative(*b) / at[*b].abs();
                [over, over * size[*a] / at[*b].abs()]
            }
            Self::Whole(a, n) => [(f64::from(n * n) * own / at[*a]).abs() * relative(*a), 0.0],
            Self::Power(a, b) => {
                let log = at[*a].ln().abs();
                let wide = 1.0 + at[*b].abs() * relative(*a) + size[*b] * log;
                [(at[*b] * own / at[*a]).abs() * wide, own.abs() * log * wide]
            }
            Self::Atan2(a, b) => {
                let square = at[*a] * at[*a] + at[*b] * at[*b];
                [size[*b] / square, size[*a] / square]
            }
            Self::Table(_, points) => [steepest(points), 0.0],
            Self::Function(name, a) => {
                let [slope, bend] = name.slopes(at[*a]);
                [slope.abs() + bend.abs() * size[*a], 0.0]
            }
        }
    }

    /// How far rounding may turn the value: the sum of the sizes of its terms.
    pub(crate) fn size(&self, size: &[f64], at: &[f64], own: f64) -> f64 {
        match self {
            Self::Add(a, b) | Self::Subtract(a, b) => size[*a] + size[*b],
            Self::Multiply(a, b) => size[*a] * size[*b],
            Self::Divide(a, b) => size[*a] * size[*b] / (at[*b] * at[*b]),
            Self::Function(name, a) => own.abs() + name.slopes(at[*a])[0].abs() * size[*a],
            Self::Table(a, points) => own.abs() + steepest(points) * size[*a],
            _ => own.abs(),
        }
    }
}

fn steepest(points: &[(f64, f64)]) -> f64 {
    let slope = |w: &[(f64, f64)]| ((w[1].1 - w[0].1) / (w[1].0 - w[0].0)).abs();
    points.windows(2).map(slope).fold(0.0, f64::max)
}

impl Name {
    fn value(self, x: &BigFloat, constants: &mut Constants) -> BigFloat {
        match self {
            Self::Sin => constants.sin_cos(x).0,
            Self::Cos => constants.sin_cos(x).1,
            Self::Tan => {
                let (sin, cos) = constants.sin_cos(x);
                over(&sin, &cos)
            }
            Self::Asin => constants.asin(x),
            Self::Acos => minus(&constants.half_pi, &constants.asin(x)),
            Self::Atan => constants.atan(x),
            Self::Sqrt => x.sqrt(BITS, ROUNDING),
            Self::Abs => x.abs(),
            Self::Exp => x.exp(BITS, ROUNDING, &mut constants.library),
            Self::Log => x.ln(BITS, ROUNDING, &mut constants.library),
            Self::Tanh => x.tanh(BITS, ROUNDING, &mut constants.library),
        }
    }

    /// First and second derivative.
    fn slopes(self, x: f64) -> [f64; 2] {
        match self {
            Self::Sin => [x.cos(), x.sin()],
            Self::Cos => [x.sin(), x.cos()],
            Self::Tan => [1.0, 2.0 * x.tan()].map(|k| k / x.cos().powi(2)),
            Self::Asin | Self::Acos => [1.0, x / (1.0 - x * x)].map(|k| k / (1.0 - x * x).sqrt()),
            Self::Atan => [1.0, 2.0 * x / (1.0 + x * x)].map(|k| k / (1.0 + x * x)),
            Self::Sqrt => [0.5, 0.25 / x].map(|k| k / x.sqrt()),
            Self::Abs => [1.0, 0.0],
            Self::Exp => [x.exp(); 2],
            Self::Log => [1.0 / x, 1.0 / (x * x)],
            Self::Tanh => [1.0, 2.0 * x.tanh()].map(|k| k / x.cosh().powi(2)),
        }
    }
}
