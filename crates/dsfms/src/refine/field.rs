//! The smooth part of what the image model leaves: an unknown log gain that varies slowly over the
//! surface.
//!
//! Light thrown from one part of the organ to another, the film of liquid, the profile of the spot:
//! none of it is in the model, and all of it is smooth. Taken for independent, thousands of samples
//! would bend the surface to explain it. A Gaussian field `γ(x) = Σ wₖ(x) γₖ`, `γₖ ~ N(0, σ)`, with
//! the spread and the length that the exploration shows, explains it instead.

use crate::geometry::Point3;

/// Nodes that a place reads: beyond a length and a half from it weights are next to nothing.
pub(super) const NEAREST: usize = 4;

/// Nodes at most: more would cost more than they tell.
const MOST: usize = 48;

/// Nodes of a field on the rest shape.
#[derive(Clone, Debug)]
pub(super) struct GainField {
    nodes: Vec<Point3>,
    /// Correlation length.
    length: f64,
}

impl GainField {
    /// Nodes a correlation length apart on `points` (the rest shape), each the farthest from those
    /// before it. `None` where the points lie so close together that one gain serves them all.
    pub(super) fn over(points: &[Point3], length: f64) -> Option<Self> {
        let mut nodes = vec![*points.first()?];
        let mut away: Vec<f64> = points.iter().map(|p| (p - nodes[0]).norm()).collect();
        while nodes.len() < MOST {
            let (farthest, &distance) =
                away.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)))?;
            if distance < length {
                break;
            }
            let node = points[farthest];
            nodes.push(node);
            away.iter_mut().zip(points).for_each(|(d, p)| *d = d.min((p - node).norm()));
        }
        (nodes.len() >= NEAREST).then_some(Self { nodes, length })
    }

    /// Number of nodes.
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The nodes a place of the rest shape reads, and their weights, whose squares add up to 1: the
    /// field has the same spread everywhere.
    pub(super) fn at(&self, point: &Point3) -> ([usize; NEAREST], [f64; NEAREST]) {
        let (mut nearest, mut squares) = ([0; NEAREST], [f64::INFINITY; NEAREST]);
        for (k, node) in self.nodes.iter().enumerate() {
            let square = (node - point).norm_squared();
            let Some(place) = squares.iter().position(|&s| square < s) else { continue };
            squares[place..].rotate_right(1);
            nearest[place..].rotate_right(1);
            (squares[place], nearest[place]) = (square, k);
        }
        let scale = 2.0 * self.length * self.length;
        let shares = squares.map(|s| ((squares[0] - s) / scale).exp());
        let norm = shares.iter().map(|w| w * w).sum::<f64>().sqrt();
        (nearest, shares.map(|w| w / norm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_lie_a_length_apart_and_weights_keep_the_spread() {
        let points: Vec<Point3> =
            (0..400).map(|i| Point3::new((i % 20) as f64, (i / 20) as f64, 0.0)).collect();
        let field = GainField::over(&points, 6.0).unwrap();
        for (k, a) in field.nodes.iter().enumerate() {
            assert!(field.nodes[..k].iter().all(|b| (a - b).norm() >= 6.0));
        }
        assert!(points.iter().all(|p| field.nodes.iter().any(|n| (p - n).norm() < 6.0)));
        let (nodes, shares) = field.at(&Point3::new(7.2, 9.1, 0.0));
        assert!((shares.iter().map(|w| w * w).sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(shares.windows(2).all(|w| w[0] >= w[1]));
        let mut distinct = nodes.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), NEAREST);
        assert!(GainField::over(&points[..3], 6.0).is_none());
    }
}
