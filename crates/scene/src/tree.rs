//! A hierarchy of bounding boxes, so that a ray tests few of a room's items.

use crate::shapes::{Ray, Shape};
use nalgebra::Vector3;

type V = Vector3<f64>;

/// Wider than rounding, so that no ray slips between an item and its box.
const MARGIN_M: f64 = 1e-9;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    low: V,
    high: V,
}

impl Bounds {
    pub(crate) fn of(shape: &Shape) -> Self {
        let (low, high) = shape.bounds();
        Self { low: low.add_scalar(-MARGIN_M), high: high.add_scalar(MARGIN_M) }
    }

    fn with(self, other: Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// Whether a ray is in the box at some distance up to a limit.
    fn is_met(&self, origin: &V, inverse: &V, within_m: f64) -> bool {
        let (mut enter, mut leave) = (0.0_f64, within_m);
        for k in 0..3 {
            let (a, b) = ((self.low[k] - origin[k]) * inverse[k], (self.high[k] - origin[k]) * inverse[k]);
            // A ray along a face gives no number, which min and max pass over.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter <= leave
    }
}

/// A box; the boxes within it follow it in the list.
#[derive(Debug, Clone)]
struct Node {
    bounds: Bounds,
    item: Option<usize>,
    /// The next node if the ray does not meet this one.
    next: usize,
}

/// Boxes around items, halved along their longest side down to single items.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tree {
    nodes: Vec<Node>,
}

impl Tree {
    /// A tree over items, named by the indices of their bounds.
    pub(crate) fn of(bounds: &[Bounds]) -> Self {
        let mut tree = Self { nodes: Vec::with_capacity(2 * bounds.len()) };
        let mut items: Vec<usize> = (0..bounds.len()).collect();
        tree.add(bounds, &mut items);
        tree
    }

    fn add(&mut self, bounds: &[Bounds], items: &mut [usize]) {
        let Some(all) = items.iter().map(|k| bounds[*k]).reduce(Bounds::with) else { return };
        let own = self.nodes.len();
        let item = if let [only] = items { Some(*only) } else { None };
        self.nodes.push(Node { bounds: all, item, next: 0 });
        if item.is_none() {
            let axis = (all.high - all.low).imax();
            let middle = |k: &usize| bounds[*k].low[axis] + bounds[*k].high[axis];
            items.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
            let (left, right) = items.split_at_mut(items.len() / 2);
            self.add(bounds, left);
            self.add(bounds, right);
        }
        self.nodes[own].next = self.nodes.len();
    }

    /// Calls `look` with each item whose bounds a ray meets within a distance, which `look` may reduce.
    pub(crate) fn along(&self, ray: &Ray, within_m: f64, mut look: impl FnMut(usize) -> f64) {
        let inverse = ray.direction.map(|d| 1.0 / d);
        let (mut within_m, mut at) = (within_m, 0);
        while let Some(node) = self.nodes.get(at) {
            if !node.bounds.is_met(&ray.origin, &inverse, within_m) {
                at = node.next;
                continue;
            }
            if let Some(item) = node.item {
                within_m = look(item);
            }
            at += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// All items that a ray meets are visited, and most of those far from it are not.
        #[test]
        fn no_item_that_is_met_is_left_out(
            places in prop::collection::vec((-4.0..4.0, -4.0..4.0, 0.0..3.0, 0.0..180.0), 1..40),
            aim in (-1.0..1.0, -1.0..1.0, -1.0..1.0),
            level in any::<bool>(),
        ) {
            let shapes: Vec<Shape> =
                places.iter().map(|(x, y, z, yaw)| Shape::block([*x, *y, *z], [0.4, 0.3, 0.2], *yaw)).collect();
            let bounds: Vec<Bounds> = shapes.iter().map(Bounds::of).collect();
            let direction = V::new(aim.0, aim.1, if level { 0.0 } else { aim.2 });
            prop_assume!(direction.norm() > 0.1);
            let ray = Ray { origin: V::new(0.1, -6.0, 1.5), direction: direction.normalize() };
            let mut shown = Vec::new();
            Tree::of(&bounds).along(&ray, f64::MAX, |k| { shown.push(k); f64::MAX });
            let met: Vec<usize> = (0..shapes.len()).filter(|k| shapes[*k].meet(&ray).is_some()).collect();
            prop_assert!(met.iter().all(|k| shown.contains(k)), "{met:?} {shown:?}");
            let near = |k: &usize| bounds[*k].is_met(&ray.origin, &ray.direction.map(|d| 1.0 / d), f64::MAX);
            prop_assert!(shown.iter().all(near));
        }
    }

    #[test]
    fn nothing_holds_nothing() {
        let ray = Ray { origin: V::zeros(), direction: V::x() };
        Tree::of(&[]).along(&ray, f64::MAX, |_| panic!("there is nothing"));
    }
}
