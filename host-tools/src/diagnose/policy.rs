//! Every constant of the decision, with its meaning, unit and origin.
//!
//! [`super::decide`] reads nothing else. The table in `docs/diagnosis.md` is written
//! from here, and a test holds it there.

/// A row of the table: name, value, unit, meaning, where it comes from.
pub type Row = (&'static str, f64, &'static str, &'static str, &'static str);

macro_rules! policy {
    ($( $(#[doc = $meaning:literal])+ $field:ident: $value:literal, $unit:literal, $origin:literal; )+) => {
        /// The constants of the decision.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Policy {
            $( $(#[doc = $meaning])+ pub $field: f64, )+
        }

        impl Policy {
            /// The constants that `rig diagnose` uses.
            pub const STANDARD: Self = Self { $( $field: $value, )+ };

            /// The table.
            pub const ROWS: &'static [Row] = &[$(
                (stringify!($field), $value, $unit, concat!($($meaning),+), $origin),
            )+];
        }
    };
}

policy! {
    /// A structure takes part if the share of the error that it leaves is at most so
    /// many times the least that one of its size leaves.
    comparable: 1.5, "–", "what another formula of the right family leaves, real rigs";
    /// Evidence below this gives no name.
    evidence: 100.0, "2 ln Bayes factor", "largest that a random force gave any effect";
    /// An effect's special case is preferred unless the general one has so much more
    /// evidence.
    special_case: 20.0, "2 ln Bayes factor", "twice very strong (Kass and Raftery 1995)";
    /// Closure from which an effect explains the error.
    explains: 0.666_666_666_666_666_6, "–", "two thirds: what remains is half of what is explained";
    /// Closure from which it explains part of it.
    part: 0.333_333_333_333_333_3, "–", "one third: what remains is twice what is explained";
    /// Closure from which a trace of an effect is shown as an answer set, without a name.
    trace: 0.15, "–", "half of what names a part";
    /// Evidence that such a trace has to have.
    trace_evidence: 500.0, "2 ln Bayes factor", "five times what a name needs";
    /// Structures within this share of the best evidence are rivals.
    rival_share: 0.1, "–", "spread between formulas of one family, real rigs";
    /// Structures within this much of the best evidence are rivals in any case.
    rival_least: 30.0, "2 ln Bayes factor", "three times very strong (Kass and Raftery 1995)";
    /// A further effect leaves at most this share of what remained without it.
    further_leaves: 0.5, "–", "half: the least that a person would call another cause";
    /// Evidence that a further effect has to add.
    further_evidence: 100.0, "2 ln Bayes factor", "as for the first effect";
    /// An excess error below this share of the noise is not told from none.
    noise_share: 0.3, "noise", "how well the noise is known: 4 % of its size";
    /// A structure that adds effects to what is named is the repaired model if it leaves
    /// at most this share of what that leaves.
    adds_to_repair: 0.8, "–", "a fifth: less is not worth another effect on the board";
    /// The repaired model is written if it leaves at most this share of the refit's
    /// error on segments that were not fitted.
    worth_writing: 0.95, "–", "5 %: less is within what a repetition differs";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_every_row_says_where_it_comes_from() {
        let mut names: Vec<&str> = Policy::ROWS.iter().map(|row| row.0).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Policy::ROWS.len());
        for (name, value, unit, meaning, origin) in Policy::ROWS {
            assert!(value.is_finite() && !unit.is_empty(), "{name}");
            assert!(meaning.len() > 20 && origin.len() > 10, "{name}");
        }
    }
}
