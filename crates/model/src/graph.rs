//! Expressions as a graph in which equal parts exist once, and their exact derivatives.

use std::collections::HashMap;

/// A part of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Node(u32);

impl Node {
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

/// A number that is known only when the graph is evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Variable {
    /// Of the state: position (3), quaternion (4), velocity (3), rates (3), further states.
    State(usize),
    /// Of the inputs.
    Input(usize),
    /// Of the parameters.
    Parameter(usize),
}

/// Functions of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Function {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sqrt,
    Exp,
    Log,
    Tanh,
    Abs,
    /// -1, 0 or 1.
    Sign,
    /// 1 above zero, else 0.
    Step,
    /// A look-up table, by its number.
    Table(u32),
    /// The slope of a look-up table.
    Slope(u32),
}

/// What a node computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Operation {
    /// The bits of a number.
    Constant(u64),
    Variable(Variable),
    Add(Node, Node),
    Subtract(Node, Node),
    Multiply(Node, Node),
    Divide(Node, Node),
    Minimum(Node, Node),
    Maximum(Node, Node),
    Atan2(Node, Node),
    Power(Node, Node),
    IntegerPower(Node, i32),
    Apply(Function, Node),
}

/// A look-up table: linear between its points, held beyond them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    pub(crate) x: Vec<f64>,
    pub(crate) y: Vec<f64>,
}

impl Table {
    fn interval(&self, x: f64) -> Option<(usize, f64)> {
        let after = self.x.partition_point(|k| *k <= x);
        let inside = after > 0 && after < self.x.len();
        inside.then(|| (after, (self.y[after] - self.y[after - 1]) / (self.x[after] - self.x[after - 1])))
    }

    pub(crate) fn value(&self, x: f64) -> f64 {
        match self.interval(x) {
            Some((after, slope)) => self.y[after - 1] + slope * (x - self.x[after - 1]),
            None if x.is_nan() => x,
            None => self.y[if x < self.x[0] { 0 } else { self.y.len() - 1 }],
        }
    }

    pub(crate) fn slope(&self, x: f64) -> f64 {
        if x.is_nan() { x } else { self.interval(x).map_or(0.0, |(_, slope)| slope) }
    }
}

impl Operation {
    pub(crate) fn operands(self) -> impl Iterator<Item = Node> {
        let (a, b) = match self {
            Self::Constant(_) | Self::Variable(_) => (None, None),
            Self::Apply(_, a) | Self::IntegerPower(a, _) => (Some(a), None),
            Self::Add(a, b)
            | Self::Subtract(a, b)
            | Self::Multiply(a, b)
            | Self::Divide(a, b)
            | Self::Minimum(a, b)
            | Self::Maximum(a, b)
            | Self::Atan2(a, b)
            | Self::Power(a, b) => (Some(a), Some(b)),
        };
        a.into_iter().chain(b)
    }

    /// This operation on operands at other places.
    pub(crate) fn moved(self, place: impl Fn(Node) -> usize) -> Self {
        self.with_operands(|node| Node(place(node) as u32))
    }

    fn with_operands(self, mut map: impl FnMut(Node) -> Node) -> Self {
        match self {
            Self::Constant(_) | Self::Variable(_) => self,
            Self::Apply(f, a) => Self::Apply(f, map(a)),
            Self::IntegerPower(a, n) => Self::IntegerPower(map(a), n),
            Self::Add(a, b) => Self::Add(map(a), map(b)),
            Self::Subtract(a, b) => Self::Subtract(map(a), map(b)),
            Self::Multiply(a, b) => Self::Multiply(map(a), map(b)),
            Self::Divide(a, b) => Self::Divide(map(a), map(b)),
            Self::Minimum(a, b) => Self::Minimum(map(a), map(b)),
            Self::Maximum(a, b) => Self::Maximum(map(a), map(b)),
            Self::Atan2(a, b) => Self::Atan2(map(a), map(b)),
            Self::Power(a, b) => Self::Power(map(a), map(b)),
        }
    }

    /// The value of an operation whose operands are known; a variable has none.
    pub(crate) fn evaluate(self, tables: &[Table], at: impl Fn(Node) -> f64) -> f64 {
        match self {
            Self::Constant(bits) => f64::from_bits(bits),
            Self::Variable(_) => f64::NAN,
            Self::Add(a, b) => at(a) + at(b),
            Self::Subtract(a, b) => at(a) - at(b),
            Self::Multiply(a, b) => at(a) * at(b),
            Self::Divide(a, b) => at(a) / at(b),
            Self::Minimum(a, b) => at(a).min(at(b)),
            Self::Maximum(a, b) => at(a).max(at(b)),
            Self::Atan2(a, b) => at(a).atan2(at(b)),
            Self::Power(a, b) => at(a).powf(at(b)),
            Self::IntegerPower(a, n) => at(a).powi(n),
            Self::Apply(function, a) => function.value(at(a), tables),
        }
    }
}

impl Function {
    fn value(self, x: f64, tables: &[Table]) -> f64 {
        match self {
            Self::Sin => x.sin(),
            Self::Cos => x.cos(),
            Self::Tan => x.tan(),
            Self::Asin => x.asin(),
            Self::Acos => x.acos(),
            Self::Atan => x.atan(),
            Self::Sqrt => x.sqrt(),
            Self::Exp => x.exp(),
            Self::Log => x.ln(),
            Self::Tanh => x.tanh(),
            Self::Abs => x.abs(),
            Self::Sign if x == 0.0 => 0.0,
            Self::Sign => x.signum(),
            Self::Step => f64::from(u8::from(x > 0.0)),
            Self::Table(k) => tables[k as usize].value(x),
            Self::Slope(k) => tables[k as usize].slope(x),
        }
    }
}

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

    fn is(&self, node: Node, value: f64) -> bool {
        self.constant_value(node) == Some(value)
    }

    /// The node of an operation, in its simplest form: constants are worked out, neutral operands dropped.
    fn make(&mut self, operation: Operation) -> Node {
        use Operation as O;
        match operation {
            O::Add(a, b) if self.is(a, 0.0) => return b,
            O::Add(a, b) | O::Subtract(a, b) if self.is(b, 0.0) => return a,
            O::Subtract(a, b) if a == b => return self.constant(0.0),
            O::Multiply(a, b) if self.is(a, 1.0) => return b,
            O::Multiply(a, b) | O::Divide(a, b) if self.is(b, 1.0) => return a,
            O::Multiply(a, b) if self.is(a, 0.0) || self.is(b, 0.0) => return self.constant(0.0),
            O::Divide(a, _) if self.is(a, 0.0) => return a,
            O::Power(_, b) if self.is(b, 0.0) => return self.constant(1.0),
            O::IntegerPower(_, 0) => return self.constant(1.0),
            O::IntegerPower(a, 1) => return a,
            O::IntegerPower(a, 2) => return self.multiply(a, a),
            O::Minimum(a, b) | O::Maximum(a, b) if a == b => return a,
            _ => {}
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

    /// An operation on other operands.
    pub(crate) fn again(&mut self, operation: Operation, operand: impl FnMut(Node) -> Node) -> Node {
        self.make(operation.with_operands(operand))
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
        const LARGEST: f64 = 64.0;
        match self.constant_value(b) {
            Some(n) if n.fract() == 0.0 && n.abs() <= LARGEST => {
                self.make(Operation::IntegerPower(a, n as i32))
            }
            Some(0.5) => self.apply(Function::Sqrt, a),
            _ => self.make(Operation::Power(a, b)),
        }
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

    /// The exact derivatives of some nodes by a variable: forward through the graph by the chain rule.
    ///
    /// At a kink (of `abs`, `min`, `max`, a table) the derivative is that of one side.
    pub(crate) fn derivatives(&mut self, of: &[Node], by: Variable) -> Vec<Node> {
        let reached = self.reached(of);
        let zero = self.constant(0.0);
        let mut slopes: Vec<Node> = vec![zero; reached.len()];
        for k in (0..reached.len()).filter(|k| reached[*k]) {
            let operation = self.operations[k];
            slopes[k] = match operation {
                Operation::Variable(v) if v == by => self.constant(1.0),
                _ if operation.operands().all(|a| slopes[a.index()] == zero) => zero,
                _ => self.chain(Node(k as u32), operation, |node| slopes[node.index()]),
            };
        }
        of.iter().map(|node| slopes[node.index()]).collect()
    }

    fn chain(&mut self, node: Node, operation: Operation, d: impl Fn(Node) -> Node) -> Node {
        use Operation as O;
        match operation {
            O::Constant(_) | O::Variable(_) => self.constant(0.0),
            O::Add(a, b) => self.add(d(a), d(b)),
            O::Subtract(a, b) => self.subtract(d(a), d(b)),
            O::Multiply(a, b) => {
                let (left, right) = (self.multiply(d(a), b), self.multiply(a, d(b)));
                self.add(left, right)
            }
            // Of one over b, which is the only division left.
            O::Divide(_, b) => {
                let square = self.multiply(node, node);
                let slope = self.negate(square);
                self.multiply(slope, d(b))
            }
            O::Minimum(a, b) => self.chosen(b, a, d(a), d(b)),
            O::Maximum(a, b) => self.chosen(a, b, d(a), d(b)),
            O::Atan2(y, x) => {
                let (left, right) = (self.multiply(x, d(y)), self.multiply(y, d(x)));
                let (xx, yy) = (self.multiply(x, x), self.multiply(y, y));
                let (above, below) = (self.subtract(left, right), self.add(xx, yy));
                self.divide(above, below)
            }
            O::IntegerPower(a, n) => {
                let (power, factor) = (self.make(O::IntegerPower(a, n - 1)), self.constant(f64::from(n)));
                let slope = self.multiply(factor, power);
                self.multiply(slope, d(a))
            }
            O::Power(a, b) => {
                let one = self.constant(1.0);
                let less = self.subtract(b, one);
                let power = self.power(a, less);
                let base = self.multiply(b, power);
                let by_base = self.multiply(base, d(a));
                if self.is(d(b), 0.0) {
                    return by_base;
                }
                let log = self.apply(Function::Log, a);
                let exponent = self.multiply(node, log);
                let by_exponent = self.multiply(exponent, d(b));
                self.add(by_base, by_exponent)
            }
            O::Apply(function, a) => {
                let slope = self.slope_of(node, function, a);
                self.multiply(slope, d(a))
            }
        }
    }

    /// `first` where `high` is above `low`, else `second`.
    fn chosen(&mut self, high: Node, low: Node, first: Node, second: Node) -> Node {
        let above = self.subtract(high, low);
        let (one, step) = (self.constant(1.0), self.apply(Function::Step, above));
        let other = self.subtract(one, step);
        let (first, second) = (self.multiply(step, first), self.multiply(other, second));
        self.add(first, second)
    }

    fn slope_of(&mut self, node: Node, function: Function, a: Node) -> Node {
        let one = self.constant(1.0);
        let aa = self.multiply(a, a);
        match function {
            Function::Sin => self.apply(Function::Cos, a),
            Function::Cos => {
                let sin = self.apply(Function::Sin, a);
                self.negate(sin)
            }
            Function::Tan => {
                let square = self.multiply(node, node);
                self.add(one, square)
            }
            Function::Asin | Function::Acos => {
                // (1 - a)(1 + a) keeps the digits near the ends that 1 - a² loses.
                let (left, right) = (self.subtract(one, a), self.add(one, a));
                let square = self.multiply(left, right);
                let root = self.apply(Function::Sqrt, square);
                let slope = self.divide(one, root);
                if function == Function::Asin { slope } else { self.negate(slope) }
            }
            Function::Atan => {
                let below = self.add(one, aa);
                self.divide(one, below)
            }
            Function::Sqrt => {
                let half = self.constant(0.5);
                self.divide(half, node)
            }
            Function::Exp => node,
            Function::Log => self.divide(one, a),
            Function::Tanh => {
                // 4/(eᵃ + e⁻ᵃ)² keeps the digits far from zero that 1 - tanh² loses.
                let (minus, four) = (self.negate(a), self.constant(4.0));
                let (up, down) = (self.apply(Function::Exp, a), self.apply(Function::Exp, minus));
                let sum = self.add(up, down);
                let square = self.multiply(sum, sum);
                self.divide(four, square)
            }
            Function::Abs => self.apply(Function::Sign, a),
            Function::Table(k) => self.apply(Function::Slope(k), a),
            Function::Sign | Function::Step | Function::Slope(_) => self.constant(0.0),
        }
    }
}
