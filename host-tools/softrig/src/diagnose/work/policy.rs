//! Every constant of the decision, with its meaning, unit and origin.
//!
//! [`mod@crate::diagnose::decide`] reads nothing but [`Policy`], the search that comes before it
//! [`Search`]. The tables in `docs/diagnosis.md` and `docs/diagnosis-details.md` are written
//! from here, and a test holds them there.

/// A row of the table: name, value, unit, meaning, origin.
pub type Constant = (&'static str, f64, &'static str, &'static str, &'static str);

macro_rules! policy {
    ($(#[doc = $about:literal])+ $name:ident: $( $(#[doc = $meaning:literal])+ $field:ident: $value:literal, $unit:literal, $origin:literal; )+) => {
        $(#[doc = $about])+
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            $( $(#[doc = $meaning])+ pub $field: f64, )+
        }

        impl $name {
            /// The constants that `softrig diagnose` uses.
            pub const STANDARD: Self = Self { $( $field: $value, )+ };

            /// The table.
            pub const ROWS: &'static [Constant] = &[$(
                (stringify!($field), $value, $unit, concat!($($meaning),+), $origin),
            )+];
        }
    };
}

policy! {
    /// The constants of the decision.
    Policy:
    /// Least share of the error that an effect closes to be taken.
    part: 0.25, "–", "a quarter: less is a trace; real rigs, 0.15 to 0.34 decide alike";
    /// Least share that a structure closes to explain the error.
    explains: 0.666_666_666_666_666_6, "–", "two thirds: what remains is half of what is explained";
    /// A structure with a further effect leaves at most this share of what was left without.
    further_leaves: 0.6, "–", "what a person would call another cause; 0.5 to 0.7 decide alike";
    /// The same, fitted and held out each.
    further_leaves_each: 0.75, "–", "a quarter, as for the first effect";
    /// Least probability that a structure is better than a smaller one.
    sure: 0.9, "probability", "nine of ten draws";
    /// An error is smaller if it is at most this share of the other.
    sure_leaves: 0.9, "–", "a tenth: what zeros and the start of a run move";
    /// A structure is comparable with the leader if it leaves at most this multiple of its
    /// error.
    comparable: 1.3, "–", "what another formula of the right family leaves, real rigs";
    /// A rival is rejected if the leader predicts better with all but this probability.
    rejected: 0.05, "probability", "one in twenty";
    /// A structure with a doubt leads if it leaves less than all others by this factor.
    doubted: 1.5, "–", "a third less than anything that can be named";
    /// A structure with a parameter at its bound is a rival of one without a doubt only if it
    /// leaves less than this share of its error.
    doubted_leaves: 0.98, "–", "2 %: less is what the bound itself lets a fit follow";
    /// A formula beyond the catalogue that leaves more than noise takes part if it leaves at most this
    /// share of what every single effect leaves, fitted and held out.
    term_leaves: 0.5, "–", "half, on both: on one rig a wrong formula left a third of it, held out only";
    /// Only noise is left below this multiple of it.
    at_noise: 1.15, "noise", "half of `comparable`: what a floor is known to";
    /// Errors of formulas of one family are alike if they differ by less than this share of the
    /// range, in squares.
    accuracy: 0.0005, "range", "linearity of the best angle sensors";
    /// An excess error below this share of the noise cannot be distinguished from none.
    noise_share: 0.3, "noise", "how well the noise is known: 4 % of its size";
    /// A structure that adds effects to the named ones is the repaired model if it leaves
    /// at most this share of their remaining error.
    adds_to_repair: 0.8, "–", "a fifth: less is not worth another effect on the board";
    /// Default tolerance: an unexplained error of the refit below this share of the range of the
    /// angle does not matter.
    tolerance: 0.01, "range", "accuracy of a calibrated flex sensor";
    /// "Nothing is missing" is not claimed if the noise exceeds this share of the range of the
    /// angle.
    most_noise: 0.02, "range", "twice `tolerance`: it would hide what matters";
    /// A formula is wrong if a table of its own variable, added to it, leaves at most this
    /// share of its error, fitted and held out.
    shape: 0.85, "–", "right formulas 0.98 to 1.03, wrong ones 0.26 to 0.77, real rigs";
    /// The repaired model is written if it leaves at most this share of the refit's
    /// error on held-out segments.
    worth_writing: 0.95, "–", "5 %: less is within the difference between repeats";
}

policy! {
    /// The constants of the search: when only noise is left, and what is worth a fit.
    Search:
    /// A residual counts as noise if its coloured part stays below this share of the
    /// noise floor.
    coloured_share: 0.15, "noise floor", "set on clean simulated recordings";
    /// Factor on the error from noise of the measured pressure.
    input_factor: 1.5, "–", "how well differences know the noise";
    /// Parameters were off if the refit leaves at most this share of the supplied model's
    /// error on held-out segments.
    first_leaves: 0.97, "–", "set on clean simulated recordings";
    /// Final fits of single effects are made if the best coarse fit leaves at most this
    /// multiple of the noise.
    may_settle: 3.0, "noise", "set on clean simulated recordings";
    /// Final fits of combinations are made if the best leaves at most this multiple of the
    /// noise.
    may_leave: 2.0, "noise", "set on clean simulated recordings";
    /// No further effect is searched beside one that leaves at most this multiple of the
    /// noise.
    done: 1.2, "noise", "what the right effect by another formula leaves";
    /// A structure with less evidence than five others is measured on held-out segments if it
    /// leaves at most this multiple of the least error of these.
    worth_measuring: 1.5, "–", "more than `comparable`: a rival must not be missing";
    /// Evidence for zeros as calibrated before the effects are tried again with them.
    effect_evidence: 10.0, "2 ln Bayes factor", "very strong (Kass and Raftery 1995)";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_every_row_says_where_it_comes_from() {
        for rows in [Policy::ROWS, Search::ROWS] {
            let mut names: Vec<&str> = rows.iter().map(|row| row.0).collect();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), rows.len());
            for (name, value, unit, meaning, origin) in rows {
                assert!(value.is_finite() && !unit.is_empty(), "{name}");
                assert!(meaning.len() > 20 && origin.len() >= 10, "{name}");
            }
        }
    }
}
