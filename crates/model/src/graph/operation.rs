//! What a graph is made of: variables, operations, functions and tables.

/// A part of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Node(pub(super) u32);

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
    /// The product, but zero where the first is zero, be the second infinite: of derivatives.
    Scaled(Node, Node),
    /// The second where the first is above zero, else zero.
    Above(Node, Node),
    /// The second where the first is not above zero, else zero.
    NotAbove(Node, Node),
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
            | Self::Power(a, b)
            | Self::Scaled(a, b)
            | Self::Above(a, b)
            | Self::NotAbove(a, b) => (Some(a), Some(b)),
        };
        a.into_iter().chain(b)
    }

    /// This operation on operands at other places.
    pub(crate) fn moved(self, place: impl Fn(Node) -> usize) -> Self {
        self.with_operands(|node| Node(place(node) as u32))
    }

    pub(super) fn with_operands(self, mut map: impl FnMut(Node) -> Node) -> Self {
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
            Self::Scaled(a, b) => Self::Scaled(map(a), map(b)),
            Self::Above(a, b) => Self::Above(map(a), map(b)),
            Self::NotAbove(a, b) => Self::NotAbove(map(a), map(b)),
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
            // A NaN is handed on: `f64::min` would hide it.
            Self::Minimum(a, b) if at(a) < at(b) || at(a).is_nan() => at(a),
            Self::Maximum(a, b) if at(a) > at(b) || at(a).is_nan() => at(a),
            Self::Minimum(_, b) | Self::Maximum(_, b) => at(b),
            Self::Atan2(a, b) => at(a).atan2(at(b)),
            Self::Power(a, b) => at(a).powf(at(b)),
            Self::Scaled(a, _) if at(a) == 0.0 => 0.0,
            Self::Scaled(a, b) => at(a) * at(b),
            Self::Above(a, b) => {
                if at(a) > 0.0 {
                    at(b)
                } else {
                    0.0
                }
            }
            Self::NotAbove(a, b) => {
                if at(a) > 0.0 {
                    0.0
                } else {
                    at(b)
                }
            }
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
            Self::Table(k) => tables[k as usize].value(x),
            Self::Slope(k) => tables[k as usize].slope(x),
        }
    }
}
