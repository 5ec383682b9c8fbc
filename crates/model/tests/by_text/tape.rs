//! Expressions as a list of steps, read character by character and worked out in 57 digits.

use super::File;
use super::number::{Constants, NAMES, Op, big, minus, over, plus, small};
use astro_float_num::BigFloat;
use std::collections::HashMap;

/// The step of a central difference: its error is some 1e-34, that of rounding 1e-40.
const STEP: f64 = 1.0 / (1_u64 << 56) as f64;

pub(crate) struct Tape {
    ops: Vec<Op>,
    outputs: Vec<usize>,
    /// The steps that depend on each variable.
    depend: Vec<Vec<usize>>,
}

/// Values of outputs and their derivatives, row by row for each variable, rounded; and the sizes of values.
pub(crate) struct Differences {
    pub(crate) values: Vec<f64>,
    pub(crate) sizes: Vec<f64>,
    pub(crate) slopes: Vec<Vec<f64>>,
    size_at: Vec<f64>,
    at: Vec<f64>,
}

struct Reader<'a> {
    file: &'a File,
    known: HashMap<String, usize>,
    ops: Vec<Op>,
    letters: Vec<char>,
    next: usize,
}

impl Tape {
    /// The expressions of these names as functions of variables of these names.
    pub(crate) fn new(file: &File, variables: &[String], outputs: &[String]) -> Self {
        let known = variables.iter().enumerate().map(|(k, name)| (name.clone(), k)).collect();
        let ops = (0..variables.len()).map(Op::Variable).collect();
        let mut reader = Reader { file, known, ops, letters: Vec::new(), next: 0 };
        let outputs = outputs.iter().map(|name| reader.named(name)).collect();
        let ops = reader.ops;
        let depend = (0..variables.len()).map(|variable| {
            let mut depends = vec![false; ops.len()];
            depends[variable] = true;
            for k in variables.len()..ops.len() {
                depends[k] = ops[k].operands().iter().any(|a| depends[*a]);
            }
            (0..ops.len()).filter(|k| depends[*k]).collect()
        });
        Self { depend: depend.collect(), ops, outputs }
    }

    pub(crate) fn values(&self, variables: &[f64]) -> Vec<f64> {
        let variables: Vec<BigFloat> = variables.iter().map(|v| big(*v)).collect();
        let base = self.run(&variables, &mut Constants::new());
        self.outputs.iter().map(|k| small(&base[*k])).collect()
    }

    fn run(&self, variables: &[BigFloat], constants: &mut Constants) -> Vec<BigFloat> {
        let mut base = Vec::with_capacity(self.ops.len());
        for op in &self.ops {
            let value = op.value(&base, variables, constants);
            base.push(value);
        }
        base
    }

    /// Central differences by some variables, row by row; no row for others.
    pub(crate) fn differences(
        &self,
        variables: &[f64],
        by: &[usize],
        constants: &mut Constants,
    ) -> Differences {
        let mut variables: Vec<BigFloat> = variables.iter().map(|v| big(*v)).collect();
        let base = self.run(&variables, constants);
        let mut work = base.clone();
        let step = big(STEP);
        let mut slopes = Vec::new();
        for k in by.iter().copied() {
            let own = variables[k].clone();
            let mut ends = Vec::new();
            for end in [plus(&own, &step), minus(&own, &step)] {
                variables[k] = end;
                for j in &self.depend[k] {
                    work[*j] = self.ops[*j].value(&work, &variables, constants);
                }
                ends.push(self.outputs.iter().map(|j| work[*j].clone()).collect::<Vec<BigFloat>>());
            }
            variables[k] = own;
            self.depend[k].iter().for_each(|j| work[*j] = base[*j].clone());
            let wide = big(2.0 * STEP);
            let slope = |(a, b): (&BigFloat, &BigFloat)| small(&over(&minus(a, b), &wide));
            slopes.push(ends[0].iter().zip(&ends[1]).map(slope).collect());
        }
        let at: Vec<f64> = base.iter().map(small).collect();
        let mut sizes = Vec::with_capacity(at.len());
        for (k, op) in self.ops.iter().enumerate() {
            sizes.push(op.size(&sizes, &at, at[k]));
        }
        let chosen = |of: &[f64]| self.outputs.iter().map(|k| of[*k]).collect();
        Differences { values: chosen(&at), sizes: chosen(&sizes), slopes, size_at: sizes, at }
    }

    /// How far rounding may turn the derivatives by a variable: sums of terms without regard to sign.
    pub(crate) fn terms(&self, variable: usize, of: &Differences) -> Vec<f64> {
        let (sizes, at) = (&of.size_at, &of.at);
        let mut terms = vec![0.0; at.len()];
        terms[variable] = 1.0;
        for k in self.depend[variable].iter().filter(|k| **k != variable) {
            let weights = self.ops[*k].weights(sizes, at, at[*k]);
            let own = self.ops[*k].operands().into_iter().zip(weights).filter(|(a, _)| terms[*a] > 0.0);
            terms[*k] = own.map(|(a, weight)| weight * terms[a]).sum();
        }
        self.outputs.iter().map(|k| terms[*k]).collect()
    }
}

impl Reader<'_> {
    fn push(&mut self, op: Op) -> usize {
        self.ops.push(op);
        self.ops.len() - 1
    }

    fn named(&mut self, name: &str) -> usize {
        if let Some(k) = self.known.get(name) {
            return *k;
        }
        let text = self.file.texts.get(name).unwrap_or_else(|| panic!("{name}"));
        let letters = text.chars().filter(|c| !c.is_whitespace()).collect();
        let before = (std::mem::replace(&mut self.letters, letters), std::mem::take(&mut self.next));
        let k = self.sum();
        assert_eq!(self.next, self.letters.len(), "{text}");
        (self.letters, self.next) = before;
        self.known.insert(name.to_owned(), k);
        k
    }

    fn eat(&mut self, c: char) -> bool {
        let found = self.letters.get(self.next) == Some(&c);
        self.next += usize::from(found);
        found
    }

    fn sum(&mut self) -> usize {
        let mut left = self.product();
        loop {
            if self.eat('+') {
                let right = self.product();
                left = self.push(Op::Add(left, right));
            } else if self.eat('-') {
                let right = self.product();
                left = self.push(Op::Subtract(left, right));
            } else {
                return left;
            }
        }
    }

    fn product(&mut self) -> usize {
        let mut left = self.unary();
        loop {
            if self.eat('*') {
                let right = self.unary();
                left = self.push(Op::Multiply(left, right));
            } else if self.eat('/') {
                let right = self.unary();
                left = self.push(Op::Divide(left, right));
            } else {
                return left;
            }
        }
    }

    fn unary(&mut self) -> usize {
        if self.eat('-') {
            let zero = self.push(Op::Constant(big(0.0)));
            let inner = self.unary();
            return self.push(Op::Subtract(zero, inner));
        }
        let base = self.atom();
        if !self.eat('^') {
            return base;
        }
        let exponent = self.unary();
        let number = match &self.ops[exponent] {
            Op::Constant(n) => Some(small(n)),
            Op::Subtract(zero, n) => match (&self.ops[*zero], &self.ops[*n]) {
                (Op::Constant(zero), Op::Constant(n)) if small(zero) == 0.0 => Some(-small(n)),
                _ => None,
            },
            _ => None,
        };
        match number.filter(|n| n.fract() == 0.0) {
            Some(n) => self.push(Op::Whole(base, n as i32)),
            None => self.push(Op::Power(base, exponent)),
        }
    }

    fn atom(&mut self) -> usize {
        if self.eat('(') {
            let inner = self.sum();
            assert!(self.eat(')'));
            return inner;
        }
        let from = self.next;
        let first = self.letters[from];
        while let Some(c) = self.letters.get(self.next) {
            let before = self.letters[self.next.saturating_sub(1)];
            let of_number = first.is_ascii_digit() || first == '.';
            let sign = of_number && "+-".contains(*c) && "eE".contains(before) && self.next > from;
            if !(c.is_alphanumeric() || "_$.".contains(*c) || sign) {
                break;
            }
            self.next += 1;
        }
        let word: String = self.letters[from..self.next].iter().collect();
        if first.is_ascii_digit() || first == '.' {
            return self.push(Op::Constant(big(word.parse().unwrap())));
        }
        if !self.eat('(') {
            return self.named(&word);
        }
        let mut arguments = vec![self.sum()];
        while self.eat(',') {
            arguments.push(self.sum());
        }
        assert!(self.eat(')'));
        self.call(&word, &arguments)
    }

    fn call(&mut self, name: &str, arguments: &[usize]) -> usize {
        if let Some((_, function)) = NAMES.iter().find(|(known, _)| *known == name) {
            return self.push(Op::Function(*function, arguments[0]));
        }
        if let Some(points) = self.file.curves.get(name) {
            return self.push(Op::Table(arguments[0], points.clone()));
        }
        match (name, arguments) {
            ("atan2", [y, x]) => self.push(Op::Atan2(*y, *x)),
            ("min", [a, b]) => self.push(Op::Minimum(*a, *b)),
            ("max", [a, b]) => self.push(Op::Maximum(*a, *b)),
            ("clamp", [x, low, high]) => {
                let raised = self.push(Op::Maximum(*x, *low));
                self.push(Op::Minimum(raised, *high))
            }
            // x - half above the zone, x + half below it.
            ("deadzone", [x, half]) => {
                let zero = self.push(Op::Constant(big(0.0)));
                let less = self.push(Op::Subtract(*x, *half));
                let above = self.push(Op::Maximum(less, zero));
                let more = self.push(Op::Add(*x, *half));
                let below = self.push(Op::Minimum(more, zero));
                self.push(Op::Add(above, below))
            }
            ("saturate", [x, limit]) => {
                let share = self.push(Op::Divide(*x, *limit));
                let tanh = self.call("tanh", &[share]);
                self.push(Op::Multiply(*limit, tanh))
            }
            _ => panic!("{name}"),
        }
    }
}
