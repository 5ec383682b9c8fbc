//! What is known of an expression's unit.

use crate::unit::Unit;

/// The unit of an expression, as far as it is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dimension {
    Known(Unit),
    /// A number as it stands: takes the unit of its neighbours in a sum, has none in a product.
    Literal,
    /// Something without a declared unit is in it: not checked.
    Unknown,
}

impl Dimension {
    pub(crate) fn of(unit: Option<Unit>) -> Self {
        unit.map_or(Self::Unknown, Self::Known)
    }

    /// Of a sum.
    pub(crate) fn or(self, other: Self) -> Self {
        match (self, other) {
            (Self::Known(_), _) => self,
            (_, Self::Known(_)) => other,
            (Self::Literal, Self::Literal) => Self::Literal,
            _ => Self::Unknown,
        }
    }

    fn joined(self, other: Self, join: fn(Unit, Unit) -> Unit) -> Self {
        match (self, other) {
            (Self::Literal, Self::Literal) => Self::Literal,
            (Self::Unknown, _) | (_, Self::Unknown) => Self::Unknown,
            (a, b) => {
                let unit = |d| if let Self::Known(unit) = d { unit } else { Unit::ONE };
                Self::Known(join(unit(a), unit(b)))
            }
        }
    }

    pub(crate) fn times(self, other: Self) -> Self {
        self.joined(other, Unit::times)
    }

    pub(crate) fn over(self, other: Self) -> Self {
        self.joined(other, Unit::over)
    }
}
