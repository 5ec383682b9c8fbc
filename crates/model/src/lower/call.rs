//! Functions of the notation.

use super::{Dimension, Lower, Meaning, Value};
use crate::document::shown;
use crate::fault::{Fault, ModelError, near};
use crate::graph::Function;
use crate::unit::Unit;

/// Functions of one number without a unit.
const PURE: [(&str, Function); 9] = [
    ("sin", Function::Sin),
    ("cos", Function::Cos),
    ("tan", Function::Tan),
    ("asin", Function::Asin),
    ("acos", Function::Acos),
    ("atan", Function::Atan),
    ("exp", Function::Exp),
    ("log", Function::Log),
    ("tanh", Function::Tanh),
];
/// Functions that keep or change units, and how many arguments they take.
const OTHERS: [(&str, usize); 8] = [
    ("sqrt", 1),
    ("abs", 1),
    ("atan2", 2),
    ("min", 2),
    ("max", 2),
    ("clamp", 3),
    ("deadzone", 2),
    ("saturate", 2),
];

fn names<'a>() -> impl Iterator<Item = &'a str> {
    PURE.iter().map(|(name, _)| *name).chain(OTHERS.iter().map(|(name, _)| *name))
}

pub(super) fn is_function(name: &str) -> bool {
    names().any(|known| known == name)
}

impl Lower<'_> {
    /// The value of a function of arguments, each with its place.
    pub(super) fn call(
        &mut self,
        name: &str,
        at: usize,
        arguments: &[(Value, usize)],
    ) -> Result<Value, ModelError> {
        let table = match self.names.get(name) {
            Some(Meaning::Table(k)) => Some(*k),
            _ => None,
        };
        let pure = PURE.iter().find(|(known, _)| *known == name).map(|(_, function)| *function);
        let other = OTHERS.iter().find(|(known, _)| *known == name).map(|(_, wanted)| *wanted);
        let wanted = match (pure, table, other) {
            (Some(_), ..) | (_, Some(_), _) => 1,
            (.., Some(wanted)) => wanted,
            _ => {
                let tables = self.names.iter().filter(|(_, m)| matches!(m, Meaning::Table(_)));
                let known: Vec<&str> = names().chain(tables.map(|(name, _)| name.as_str())).collect();
                let (near, name) = (near(name, known.into_iter()), shown(name));
                return self.source.fault(at, Fault::UnknownFunction { name, near });
            }
        };
        if arguments.len() != wanted {
            let (name, found) = (name.to_owned(), arguments.len());
            return self.source.fault(at, Fault::Arguments { name, wanted, found });
        }
        let (first, place) = arguments[0];
        let what = format!("the argument of `{name}`");
        if let Some(k) = table {
            let units = self.tables[k].clone();
            self.require(&what, units.x, first.dimension, place)?;
            let node = self.graph.apply(Function::Table(k as u32), first.node);
            return Ok(Value { node, dimension: units.y });
        }
        if let Some(function) = pure {
            self.require(&what, Dimension::Known(Unit::ONE), first.dimension, place)?;
            let node = self.graph.apply(function, first.node);
            return Ok(Value { node, dimension: Dimension::Known(Unit::ONE) });
        }
        self.with_units(name, arguments)
    }

    fn with_units(&mut self, name: &str, arguments: &[(Value, usize)]) -> Result<Value, ModelError> {
        let mut dimension = arguments[0].0.dimension;
        for (value, place) in &arguments[1..] {
            self.require(&format!("what stands before in `{name}`"), dimension, value.dimension, *place)?;
            dimension = dimension.or(value.dimension);
        }
        let nodes: Vec<_> = arguments.iter().map(|(value, _)| value.node).collect();
        let graph = &mut self.graph;
        let node = match (name, nodes.as_slice()) {
            ("sqrt", [a]) => {
                if let Dimension::Known(unit) = dimension {
                    dimension = Dimension::Known(unit.to_the(0.5));
                }
                graph.apply(Function::Sqrt, *a)
            }
            ("atan2", [y, x]) => {
                dimension = Dimension::Known(Unit::ONE);
                graph.atan2(*y, *x)
            }
            ("min", [a, b]) => graph.minimum(*a, *b),
            ("max", [a, b]) => graph.maximum(*a, *b),
            ("clamp", [a, low, high]) => {
                let raised = graph.maximum(*a, *low);
                graph.minimum(raised, *high)
            }
            ("deadzone", [a, half]) => {
                let low = graph.negate(*half);
                let raised = graph.maximum(*a, low);
                let inside = graph.minimum(raised, *half);
                graph.subtract(*a, inside)
            }
            ("saturate", [a, limit]) => {
                let share = graph.divide(*a, *limit);
                let bounded = graph.apply(Function::Tanh, share);
                graph.multiply(*limit, bounded)
            }
            (_, nodes) => graph.apply(Function::Abs, nodes[0]),
        };
        Ok(Value { node, dimension })
    }
}
