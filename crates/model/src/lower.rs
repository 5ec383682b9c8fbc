//! Names and units: from the tree of an expression to the graph.

mod call;
mod dimension;

pub(crate) use dimension::Dimension;

use crate::document::{Source, Text, shown};
use crate::fault::{Fault, ModelError, near};
use crate::graph::{Graph, Node, Variable};
use crate::syntax::{Kind, Part, parse};
use crate::unit::Unit;
use std::collections::HashMap;

/// A part of the graph with its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Value {
    pub(crate) node: Node,
    pub(crate) dimension: Dimension,
}

/// What a name stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Meaning {
    Value(Value),
    Definition(usize),
    Table(usize),
}

/// Units of a look-up table.
#[derive(Debug, Clone)]
struct TableUnits {
    x: Dimension,
    y: Dimension,
}

#[derive(Debug, Clone)]
struct Definition {
    name: String,
    text: Text,
    unit: Option<Unit>,
    /// Once it is read.
    state: Option<Value>,
}

/// Definitions within definitions and parentheses within parentheses together, at most.
const DEEPEST: usize = 400;
/// Nodes of a graph, at most: derivatives of more would take seconds.
const LARGEST: usize = 50_000;

/// Turns expressions into one graph.
pub(crate) struct Lower<'a> {
    pub(crate) graph: Graph,
    pub(crate) source: Source<'a>,
    names: HashMap<String, Meaning>,
    kinds: HashMap<String, &'static str>,
    definitions: Vec<Definition>,
    tables: Vec<TableUnits>,
    /// Definitions that are being read, each for the one before.
    under_way: Vec<usize>,
    depth: usize,
}

/// Names that the format has in `[outputs]` alone.
pub(crate) const ACCELERATIONS: [&str; 6] = ["a_x", "a_y", "a_z", "p_dot", "q_dot", "r_dot"];
const OF_FORMAT: &str = "a name of the format";
/// Characters of a name, at most.
const LONGEST_NAME: usize = 60;

impl<'a> Lower<'a> {
    pub(crate) fn new(source: Source<'a>) -> Self {
        let mut out = Self {
            graph: Graph::default(),
            source,
            names: HashMap::new(),
            kinds: HashMap::new(),
            definitions: Vec::new(),
            tables: Vec::new(),
            under_way: Vec::new(),
            depth: 0,
        };
        out.kinds.extend(ACCELERATIONS.map(|name| (name.to_owned(), OF_FORMAT)));
        let pi = out.graph.constant(std::f64::consts::PI);
        out.provide("pi", pi, Some(Unit::ONE));
        out
    }

    /// A name that the format has.
    pub(crate) fn provide(&mut self, name: &str, node: Node, unit: Option<Unit>) {
        let value = Value { node, dimension: Dimension::of(unit) };
        self.names.insert(name.to_owned(), Meaning::Value(value));
        self.kinds.insert(name.to_owned(), OF_FORMAT);
    }

    /// A name of the file for a variable.
    pub(crate) fn declare(
        &mut self,
        name: &str,
        at: usize,
        variable: Variable,
        unit: Option<Unit>,
    ) -> Result<Node, ModelError> {
        let what = match variable {
            Variable::State(_) => "a state",
            Variable::Input(_) => "an input",
            Variable::Parameter(_) => "a parameter",
        };
        let node = self.graph.variable(variable);
        self.name(name, at, what, Meaning::Value(Value { node, dimension: Dimension::of(unit) }))?;
        Ok(node)
    }

    pub(crate) fn define(
        &mut self,
        name: &str,
        at: usize,
        text: Text,
        unit: Option<Unit>,
    ) -> Result<(), ModelError> {
        let k = self.definitions.len();
        self.name(name, at, "a definition", Meaning::Definition(k))?;
        self.definitions.push(Definition { name: name.to_owned(), text, unit, state: None });
        Ok(())
    }

    pub(crate) fn table(
        &mut self,
        name: &str,
        at: usize,
        table: crate::graph::Table,
        units: [Option<Unit>; 2],
    ) -> Result<(), ModelError> {
        self.name(name, at, "a table", Meaning::Table(self.tables.len()))?;
        self.tables.push(TableUnits { x: Dimension::of(units[0]), y: Dimension::of(units[1]) });
        self.graph.tables.push(table);
        Ok(())
    }

    fn name(
        &mut self,
        name: &str,
        at: usize,
        kind: &'static str,
        meaning: Meaning,
    ) -> Result<(), ModelError> {
        let mut letters = name.chars();
        let begins = letters.next().is_some_and(|c| c.is_alphabetic() || c == '_');
        let long = name.chars().nth(LONGEST_NAME).is_some();
        if long || !begins || !letters.all(|c| c.is_alphanumeric() || c == '_') {
            return self.source.fault(at, Fault::BadName(shown(name)));
        }
        if let Some(what) =
            self.kinds.get(name).copied().or_else(|| call::is_function(name).then_some("a function"))
        {
            let (name, what) = (name.to_owned(), what.to_owned());
            return self.source.fault(at, Fault::Taken { name, what });
        }
        self.names.insert(name.to_owned(), meaning);
        self.kinds.insert(name.to_owned(), kind);
        Ok(())
    }

    /// All definitions, so that those that nothing uses are checked too.
    pub(crate) fn finish_definitions(&mut self) -> Result<Vec<(String, Node)>, ModelError> {
        let count = self.definitions.len();
        (0..count).map(|k| Ok((self.definitions[k].name.clone(), self.definition(k)?.node))).collect()
    }

    /// The value of an expression that must have the unit declared for it, where there is one.
    pub(crate) fn expression(
        &mut self,
        what: &str,
        text: &Text,
        unit: Option<Unit>,
    ) -> Result<Node, ModelError> {
        Ok(self.checked(what, text, unit)?.node)
    }

    fn checked(&mut self, what: &str, text: &Text, unit: Option<Unit>) -> Result<Value, ModelError> {
        let part = self.parsed(text)?;
        match unit {
            Some(unit) => self.with_unit(&part, text, what, unit),
            None => self.value(&part, text),
        }
    }

    fn parsed(&self, text: &Text) -> Result<Part, ModelError> {
        parse(&text.text).or_else(|(at, fault)| self.source.fault(text.place(at), fault))
    }

    /// The value of a part that must have a unit; of a sum the term that has another is refused.
    fn with_unit(&mut self, part: &Part, text: &Text, what: &str, unit: Unit) -> Result<Value, ModelError> {
        match &part.kind {
            Kind::Sum(terms) => self.sum(terms, text, Some((what, unit))),
            Kind::Negative(inner) => {
                let value = self.with_unit(inner, text, what, unit)?;
                Ok(Value { node: self.graph.negate(value.node), ..value })
            }
            _ => {
                let value = self.value(part, text)?;
                self.require(what, Dimension::Known(unit), value.dimension, text.place(part.at))?;
                Ok(value)
            }
        }
    }

    /// Refuses a unit that is known and another than wanted.
    fn require(&self, what: &str, wanted: Dimension, found: Dimension, at: usize) -> Result<(), ModelError> {
        match (wanted, found) {
            (Dimension::Known(wanted), Dimension::Known(found)) if wanted != found => {
                self.source.fault(at, Fault::units(what, wanted, found))
            }
            _ => Ok(()),
        }
    }

    /// Where the first name in an expression is that depends on a variable, and that name.
    pub(crate) fn first_use(&self, text: &Text, of: Variable) -> Result<(usize, String), ModelError> {
        let part = self.parsed(text)?;
        let depends = |name: &str| match self.names.get(name) {
            Some(Meaning::Value(value)) => self.graph.variables(&[value.node]).contains(&of),
            Some(Meaning::Definition(k)) => match self.definitions[*k].state {
                Some(value) => self.graph.variables(&[value.node]).contains(&of),
                None => false,
            },
            _ => false,
        };
        let first = part.names().into_iter().find(|(_, name)| depends(name));
        Ok(first.map_or((text.at, String::new()), |(at, name)| (text.place(at), name.to_owned())))
    }

    fn definition(&mut self, k: usize) -> Result<Value, ModelError> {
        if let Some(value) = self.definitions[k].state {
            return Ok(value);
        }
        let Definition { name, text, unit, .. } = self.definitions[k].clone();
        if let Some(first) = self.under_way.iter().position(|way| *way == k) {
            let circle = self.under_way[first..].iter().take(8).map(|k| self.definitions[*k].name.as_str());
            let names: Vec<&str> = circle.chain([name.as_str()]).collect();
            return self.source.fault(text.at, Fault::Circle(names.join(" needs ")));
        }
        self.under_way.push(k);
        let mut value = self.checked(&format!("`{name}`"), &text, unit)?;
        value.dimension = unit.map_or(value.dimension, Dimension::Known);
        self.under_way.pop();
        self.definitions[k].state = Some(value);
        Ok(value)
    }

    fn value(&mut self, part: &Part, text: &Text) -> Result<Value, ModelError> {
        let at = text.place(part.at);
        self.depth += 1;
        if self.depth > DEEPEST {
            return self.source.fault(at, Fault::TooDeep(DEEPEST));
        }
        if self.graph.len() > LARGEST {
            let (what, found, most) = ("operations in all expressions together", self.graph.len(), LARGEST);
            return self.source.fault(at, Fault::TooMany { what, found, most });
        }
        let value = match &part.kind {
            Kind::Number(number) => {
                Value { node: self.graph.constant(*number), dimension: Dimension::Literal }
            }
            Kind::Name(name) => self.named(name, at)?,
            Kind::Negative(inner) => {
                let Value { node, dimension } = self.value(inner, text)?;
                Value { node: self.graph.negate(node), dimension }
            }
            Kind::Sum(terms) => self.sum(terms, text, None)?,
            Kind::Product(factors) => self.product(factors, text)?,
            Kind::Power(base, exponent) => self.power(base, exponent, text)?,
            Kind::Call(name, arguments) => {
                let values: Result<Vec<(Value, usize)>, ModelError> =
                    arguments.iter().map(|a| Ok((self.value(a, text)?, text.place(a.at)))).collect();
                self.call(name, at, &values?)?
            }
        };
        self.depth -= 1;
        Ok(value)
    }

    fn named(&mut self, name: &str, at: usize) -> Result<Value, ModelError> {
        match self.names.get(name).copied() {
            Some(Meaning::Value(value)) => Ok(value),
            Some(Meaning::Definition(k)) => self.definition(k),
            Some(Meaning::Table(_)) => {
                self.source.fault(at, Fault::Arguments { name: name.to_owned(), wanted: 1, found: 0 })
            }
            None if ACCELERATIONS.contains(&name) => {
                let place = "forces, moments, states and definitions".to_owned();
                let allows = "give the accelerations: use it in [outputs]";
                self.source.fault(at, Fault::NotHere { name: name.to_owned(), place, allows })
            }
            None => {
                let near = near(name, self.names.keys().map(String::as_str));
                self.source.fault(at, Fault::UnknownName { name: shown(name), near })
            }
        }
    }

    /// A sum, whose terms must have a unit where one is wanted, else that of the terms before.
    fn sum(
        &mut self,
        terms: &[(bool, Part)],
        text: &Text,
        wanted: Option<(&str, Unit)>,
    ) -> Result<Value, ModelError> {
        let mut sum: Option<Value> = None;
        for (minus, term) in terms {
            let value = match wanted {
                Some((what, unit)) => self.with_unit(term, text, what, unit)?,
                None => self.value(term, text)?,
            };
            sum = Some(match sum {
                None if *minus => Value { node: self.graph.negate(value.node), ..value },
                None => value,
                Some(sum) => {
                    let at = text.place(term.at);
                    self.require("the sum before this term", sum.dimension, value.dimension, at)?;
                    let node = if *minus {
                        self.graph.subtract(sum.node, value.node)
                    } else {
                        self.graph.add(sum.node, value.node)
                    };
                    Value { node, dimension: sum.dimension.or(value.dimension) }
                }
            });
        }
        Ok(sum.unwrap_or(Value { node: self.graph.constant(0.0), dimension: Dimension::Literal }))
    }

    fn product(&mut self, factors: &[(bool, Part)], text: &Text) -> Result<Value, ModelError> {
        let one = Value { node: self.graph.constant(1.0), dimension: Dimension::Literal };
        factors.iter().try_fold(one, |product, (over, factor)| {
            let value = self.value(factor, text)?;
            Ok(if *over {
                let node = self.graph.divide(product.node, value.node);
                Value { node, dimension: product.dimension.over(value.dimension) }
            } else {
                let node = self.graph.multiply(product.node, value.node);
                Value { node, dimension: product.dimension.times(value.dimension) }
            })
        })
    }

    fn power(&mut self, base: &Part, exponent: &Part, text: &Text) -> Result<Value, ModelError> {
        let (base_at, at) = (text.place(base.at), text.place(exponent.at));
        let (base, exponent) = (self.value(base, text)?, self.value(exponent, text)?);
        self.require("an exponent", Dimension::Known(Unit::ONE), exponent.dimension, at)?;
        let dimension = match (base.dimension, self.graph.constant_value(exponent.node)) {
            (Dimension::Known(unit), Some(n)) => Dimension::Known(unit.to_the(n)),
            (Dimension::Known(_), None) => {
                let what = "the base of an exponent that is no number";
                self.require(what, Dimension::Known(Unit::ONE), base.dimension, base_at)?;
                base.dimension
            }
            (other, _) => other,
        };
        Ok(Value { node: self.graph.power(base.node, exponent.node), dimension })
    }
}
