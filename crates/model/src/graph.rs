//! Expressions as a graph in which equal parts exist once, and their exact derivatives.

mod derive;
mod operation;

pub(crate) use operation::{Function, Node, Operation, Table, Variable};

use std::collections::HashMap;

/// Whole exponents up to this are products; beyond, a logarithm is more exact.
const LARGEST_POWER: f64 = 64.0;

/// Expressions of which equal parts exist once; an operand always comes before what uses it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Graph {
    operations: Vec<Operation>,
    known: HashMap<Operation, Node>,
    pub(crate) tables: Vec<Table>,
}

impl Graph {
    pub(crate) fn len(&self) -> usize {
        self.operations.len()
    }

    pub(crate) fn node(&self, k: usize) -> Node {
        Node(k as u32)
    }

    pub(crate) fn operation(&self, node: Node) -> Operation {
        self.operations[node.index()]
    }

    /// The value, where it depends on nothing.
    pub(crate) fn constant_value(&self, node: Node) -> Option<f64> {
        match self.operation(node) {
            Operation::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    pub(crate) fn constant(&mut self, value: f64) -> Node {
        // One zero only: equal numbers must be one node.
        self.intern(Operation::Constant((value + 0.0).to_bits()))
    }

    pub(crate) fn variable(&mut self, variable: Variable) -> Node {
        self.intern(Operation::Variable(variable))
    }

    fn intern(&mut self, operation: Operation) -> Node {
        if let Some(node) = self.known.get(&operation) {
            return *node;
        }
        let node = Node(self.operations.len() as u32);
        self.operations.push(operation);
        self.known.insert(operation, node);
        node
    }

    pub(super) fn is(&self, node: Node, value: f64) -> bool {
        self.constant_value(node) == Some(value)
    }

    /// The node of an operation, in its simplest form: constants are worked out, neutral operands dropped.
    pub(super) fn make(&mut self, operation: Operation) -> Node {
        use Operation as O;
        match operation {
            O::Add(a, b) if self.is(a, 0.0) => return b,
            O::Add(a, b) | O::Subtract(a, b) if self.is(b, 0.0) => return a,
            O::Subtract(a, b) if a == b => return self.constant(0.0),
            O::Multiply(a, b) if self.is(a, 1.0) => return b,
            O::Multiply(a, b) | O::Divide(a, b) if self.is(b, 1.0) => return a,
            O::Multiply(a, b) if self.is(a, 0.0) || self.is(b, 0.0) => return self.constant(0.0),
            O::Scaled(a, _) if self.is(a, 0.0) => return a,
            O::Scaled(a, b) if self.constant_value(a).is_some() => return self.multiply(a, b),
            O::Above(_, b) | O::NotAbove(_, b) if self.is(b, 0.0) => return b,
            O::Divide(a, _) if self.is(a, 0.0) => return a,
            O::Power(_, b) if self.is(b, 0.0) => return self.constant(1.0),
            O::Power(a, b) if self.is(b, 0.5) => return self.apply(Function::Sqrt, a),
            O::IntegerPower(_, 0) => return self.constant(1.0),
            O::IntegerPower(a, 1) => return a,
            O::IntegerPower(a, 2) => return self.multiply(a, a),
            O::Minimum(a, b) | O::Maximum(a, b) if a == b => return a,
            _ => {}
        }
        if let O::Power(a, b) = operation
            && let Some(n) = self.constant_value(b).filter(|n| n.fract() == 0.0 && n.abs() <= LARGEST_POWER)
        {
            return self.make(O::IntegerPower(a, n as i32));
        }
        if let O::Divide(a, b) = operation
            && !self.is(a, 1.0)
            && (self.constant_value(a).is_none() || self.constant_value(b).is_none())
        {
            // One division for all that is divided by the same.
            let one = self.constant(1.0);
            let over = self.make(O::Divide(one, b));
            return self.multiply(a, over);
        }
        let known = operation.operands().all(|a| self.constant_value(a).is_some());
        if known && !matches!(operation, O::Constant(_) | O::Variable(_)) {
            let at = |a: Node| self.constant_value(a).unwrap_or(f64::NAN);
            let value = operation.evaluate(&self.tables, at);
            return self.constant(value);
        }
        self.intern(match operation {
            O::Add(a, b) if b < a => O::Add(b, a),
            O::Multiply(a, b) if b < a => O::Multiply(b, a),
            other => other,
        })
    }

    pub(crate) fn add(&mut self, a: Node, b: Node) -> Node {
        self.make(Operation::Add(a, b))
    }

    pub(crate) fn subtract(&mut self, a: Node, b: Node) -> Node {
        self.make(Operation::Subtract(a, b))
    }

    pub(crate) fn negate(&mut self, a: Node) -> Node {
        let zero = self.constant(0.0);
        match self.operation(a) {
            Operation::Subtract(b, c) => self.subtract(c, b),
            _ => self.subtract(zero, a),
        }
    }

    pub(crate) fn multiply(&mut self, a: Node, b: Node) -> Node {
        self.make(Operation::Multiply(a, b))
    }

    pub(crate) fn divide(&mut self, a: Node, b: Node) -> Node {
        self.make(Operation::Divide(a, b))
    }

    pub(crate) fn minimum(&mut self, a: Node, b: Node) -> Node {
        self.make(Operation::Minimum(a, b))
    }

    pub(crate) fn maximum(&mut self, a: Node, b: Node) -> Node {
        self.make(Operation::Maximum(a, b))
    }

    pub(crate) fn atan2(&mut self, y: Node, x: Node) -> Node {
        self.make(Operation::Atan2(y, x))
    }

    pub(crate) fn apply(&mut self, function: Function, a: Node) -> Node {
        self.make(Operation::Apply(function, a))
    }

    pub(crate) fn power(&mut self, a: Node, b: Node) -> Node {
        self.make(Operation::Power(a, b))
    }

    pub(crate) fn sum(&mut self, terms: &[Node]) -> Node {
        let zero = self.constant(0.0);
        terms.iter().fold(zero, |sum, term| self.add(sum, *term))
    }

    /// Which nodes are reached from some, themselves included.
    pub(crate) fn reached(&self, from: &[Node]) -> Vec<bool> {
        let mut reached = vec![false; self.len()];
        from.iter().for_each(|node| reached[node.index()] = true);
        for k in (0..self.len()).rev() {
            if reached[k] {
                self.operations[k].operands().for_each(|node| reached[node.index()] = true);
            }
        }
        reached
    }

    /// The variables that some nodes depend on.
    pub(crate) fn variables(&self, of: &[Node]) -> Vec<Variable> {
        let reached = self.reached(of);
        let own = self.operations.iter().zip(reached).filter(|(_, reached)| *reached);
        own.filter_map(|(o, _)| if let Operation::Variable(v) = o { Some(*v) } else { None }).collect()
    }

    /// Copies some nodes with other nodes in the place of variables; whatever becomes known is worked out.
    pub(crate) fn substituted(
        &self,
        of: &[Node],
        mut replace: impl FnMut(Variable, &mut Graph) -> Node,
    ) -> (Graph, Vec<Node>) {
        let reached = self.reached(of);
        let mut out = Graph { tables: self.tables.clone(), ..Graph::default() };
        let mut copies = vec![Node(0); self.len()];
        for (k, operation) in self.operations.iter().enumerate().filter(|(k, _)| reached[*k]) {
            copies[k] = match operation {
                Operation::Variable(variable) => replace(*variable, &mut out),
                other => out.make(other.with_operands(|node| copies[node.index()])),
            };
        }
        (out, of.iter().map(|node| copies[node.index()]).collect())
    }
}
