//! The table of the lenses that a camera file can name.

use super::{Distorted, LensModel, brown_conrady, kannala_brandt, pinhole, rational};
use crate::geometry::Vector2;
use serde::{Deserialize, Serialize};

/// A line of the table.
#[derive(Debug)]
pub struct LensKind {
    /// As our files call it.
    pub name: &'static str,
    /// Names of its coefficients in OpenCV's order.
    pub coefficients: &'static [&'static str],
    /// Whether all coefficients zero make a pinhole of it.
    pub perspective: bool,
    words: &'static [&'static str],
    least: usize,
    make: fn(&[f64]) -> Lens,
}

macro_rules! lenses {
    ($($(#[$meta:meta])* $kind:ident = $module:ident
        $({ $($(#[$about:meta])* $field:ident: $data:ty),* $(,)? })?),* $(,)?) => {
        /// Lens distortion of normalised coordinates.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum Lens {
            $($(#[$meta])* $kind $({ $($(#[$about])* $field: $data),* })?,)*
        }

        $(impl From<$module::$kind> for Lens {
            fn from($module::$kind { $($($field),*)? }: $module::$kind) -> Self {
                Self::$kind { $($($field),*)? }
            }
        })*

        impl Lens {
            /// Every kind of lens.
            pub const KINDS: &'static [LensKind] = &[$(LensKind {
                name: $module::$kind::NAME,
                coefficients: $module::$kind::COEFFICIENTS,
                perspective: $module::$kind::PERSPECTIVE,
                words: $module::$kind::WORDS,
                least: $module::$kind::LEAST,
                make: |c| $module::$kind::of(c).into(),
            }),*];

            /// Its line of the table.
            pub fn kind(&self) -> &'static LensKind {
                let name = match self { $(Self::$kind { .. } => $module::$kind::NAME),* };
                let known = Self::KINDS.iter().find(|kind| kind.name == name);
                known.unwrap_or(&Self::KINDS[0])
            }

            /// Distorted normalised coordinates `(x/z, y/z)`; `None` outside the model's domain.
            pub(crate) fn distort(&self, point: &Vector2) -> Option<Distorted> {
                match *self { $(Self::$kind { $($($field),*)? } =>
                    $module::$kind { $($($field),*)? }.distort(point)),* }
            }

            /// Inverse of [`Lens::distort`]; `None` where there is none.
            pub(crate) fn undistort(&self, point: &Vector2) -> Option<Vector2> {
                match *self { $(Self::$kind { $($($field),*)? } =>
                    $module::$kind { $($($field),*)? }.undistort(point)),* }
            }

            /// `∂(x_d, y_d)/∂(k1, k2)` at `(x/z, y/z)`; zero of a lens without them.
            pub(crate) fn radial_derivatives(&self, point: &Vector2) -> [Vector2; 2] {
                match *self { $(Self::$kind { $($($field),*)? } =>
                    $module::$kind { $($($field),*)? }.radial_derivatives(point)),* }
            }

            fn values(&self) -> Vec<f64> {
                match *self { $(Self::$kind { $($($field),*)? } =>
                    $module::$kind { $($($field),*)? }.coefficients()),* }
            }
        }
    };
}

lenses! {
    /// Perfect pinhole.
    #[default]
    Pinhole = pinhole,
    /// OpenCV's k1, k2, k3 (radial) and p1, p2 (tangential).
    BrownConrady = brown_conrady {
        /// Radial coefficients k1, k2, k3.
        k: [f64; 3],
        /// Tangential coefficients p1, p2.
        p: [f64; 2],
    },
    /// OpenCV fisheye: `θ_d = θ(1 + k1θ² + k2θ⁴ + k3θ⁶ + k4θ⁸)`.
    KannalaBrandt = kannala_brandt {
        /// k1 to k4.
        k: [f64; 4],
    },
    /// OpenCV's rational model: Brown-Conrady with its radial part over
    /// `1 + k4 r² + k5 r⁴ + k6 r⁶`.
    Rational = rational {
        /// Radial coefficients k1 to k6.
        k: [f64; 6],
        /// Tangential coefficients p1, p2.
        p: [f64; 2],
    },
}

impl Lens {
    /// Every coefficient with its name, in the order of OpenCV.
    pub fn coefficients(&self) -> Vec<(&'static str, f64)> {
        self.kind().coefficients.iter().copied().zip(self.values()).collect()
    }

    /// The first of the table that has every coefficient that is not zero; a lens that is no
    /// pinhole without coefficients stays.
    pub(crate) fn simplest(self) -> Self {
        let kind = self.kind();
        let named = self.coefficients();
        let holds = |k: &&LensKind| {
            let has = |c: &(&str, f64)| c.1 == 0.0 || k.coefficients.contains(&c.0);
            k.perspective && named.iter().all(has)
        };
        let simpler = Self::KINDS.iter().find(holds).filter(|_| kind.perspective);
        simpler.map_or(self, |simpler| simpler.named_coefficients(&named))
    }

    /// k1 and k2; zero of a lens without them.
    pub(crate) fn radial(&self) -> [f64; 2] {
        let named = self.coefficients();
        ["k1", "k2"].map(|k| named.iter().find(|c| c.0 == k).map_or(0.0, |c| c.1))
    }

    /// After a step of k1 and k2, where it has them.
    pub(crate) fn radial_moved(&self, step: [f64; 2]) -> Self {
        let kind = self.kind();
        let mut c = self.values();
        for (name, step) in ["k1", "k2"].into_iter().zip(step) {
            if let Some(i) = kind.coefficients.iter().position(|c| *c == name) {
                c[i] += step;
            }
        }
        (kind.make)(&c)
    }
}

impl LensKind {
    /// The kind that a text names, e.g. `"fisheye"`, `"rational_polynomial"`; `None` where it names
    /// none.
    pub fn told(text: &str) -> Option<&'static Self> {
        let text = text.to_lowercase();
        let says = |kind: &&Self| kind.words.iter().any(|word| text.contains(word));
        Lens::KINDS.iter().rev().find(says)
    }

    /// With coefficients by their names; those it does not have are left out, and the others 0.
    pub fn named_coefficients(&self, named: &[(&str, f64)]) -> Lens {
        let value = |name: &&str| named.iter().find(|c| c.0 == *name).map_or(0.0, |c| c.1);
        (self.make)(&self.coefficients.iter().map(value).collect::<Vec<f64>>())
    }

    /// With a list of coefficients in OpenCV's order, the simplest that holds them; zeros may
    /// follow those that it has, where the lens is one of the perspective family, of which none at
    /// all are a pinhole.
    ///
    /// # Errors
    /// What is wrong with the list.
    pub fn listed_coefficients(&self, list: &[f64]) -> Result<Lens, String> {
        let (count, known) = (list.len(), self.coefficients.len());
        if count == 0 && self.perspective {
            return Ok(Lens::default());
        }
        if count < self.least || count > known && !self.perspective {
            return Err(format!("holds {count} numbers; {}", self.expected()));
        }
        if list.iter().skip(known).any(|v| *v != 0.0) {
            return Err(format!(
                "holds {count} coefficients, some beyond {known} not zero; {}",
                self.expected()
            ));
        }
        let mut all: Vec<f64> = list.iter().copied().take(known).collect();
        all.resize(known, 0.0);
        Ok((self.make)(&all).simplest())
    }

    /// What it expects, in words.
    pub fn expected(&self) -> String {
        match self.coefficients {
            [] => format!("{} has no coefficients", self.name),
            names => format!("{} has {}", self.name, names.join(" ")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lens_is_known_by_words() {
        for (text, name) in [
            ("plumb_bob", "brown_conrady"),
            ("brown_conrady (OpenCV: k1,k2,p1,p2,k3=0)", "brown_conrady"),
            ("OPENCV_FISHEYE", "kannala_brandt"),
            ("rational_polynomial", "rational"),
            ("FULL_OPENCV", "rational"),
            ("none", "none"),
        ] {
            assert_eq!(LensKind::told(text).unwrap().name, name, "{text}");
        }
        assert!(LensKind::told("moebius").is_none());
    }

    #[test]
    fn the_simplest_lens_holds_every_coefficient() {
        let rational = LensKind::told("rational").unwrap();
        let lens = |list: &[f64]| rational.listed_coefficients(list).unwrap();
        assert_eq!(lens(&[0.0; 8]), Lens::Pinhole);
        let brown = Lens::BrownConrady { k: [0.1, 0.2, 0.5], p: [0.3, 0.4] };
        assert_eq!(lens(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 0.0, 0.0]), brown);
        let all = Lens::Rational { k: [0.1, 0.2, 0.5, 0.6, 0.7, 0.8], p: [0.3, 0.4] };
        let list = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
        assert_eq!(lens(&list), all);
        assert_eq!(all.values(), list);
        assert_eq!(lens(&[&list[..], &[0.0; 4]].concat()), all);
        let tilted = rational.listed_coefficients(&[&list[..], &[0.1; 4]].concat());
        assert!(tilted.unwrap_err().contains("beyond 8"));
        // A fisheye without coefficients is no pinhole.
        let fisheye = Lens::KannalaBrandt { k: [0.0; 4] };
        assert_eq!(fisheye.simplest(), fisheye);
    }

    #[test]
    fn every_lens_tells_its_coefficients() {
        for kind in Lens::KINDS {
            let values: Vec<f64> = (1..=kind.coefficients.len()).map(|i| 0.01 * i as f64).collect();
            let lens = (kind.make)(&values);
            assert_eq!((lens.kind().name, lens.values()), (kind.name, values));
            let step = lens.radial_moved([0.5, 0.25]).radial();
            let [k1, k2] = lens.radial();
            let free = kind.coefficients.contains(&"k1");
            assert_eq!(step, if free { [k1 + 0.5, k2 + 0.25] } else { [0.0; 2] });
        }
    }
}
