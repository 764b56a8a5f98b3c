//! Every constant of the decision, with its meaning, unit and origin.
//!
//! [`super::decide`] reads nothing but [`Policy`]; where only noise may remain, formulas
//! are told apart by [`Exact`]. The tables in `docs/diagnosis.md` are written from here,
//! and a test holds them there.

/// A row of the table: name, value, unit, meaning, where it comes from.
pub type Row = (&'static str, f64, &'static str, &'static str, &'static str);

macro_rules! policy {
    ($(#[doc = $about:literal])+ $name:ident: $( $(#[doc = $meaning:literal])+ $field:ident: $value:literal, $unit:literal, $origin:literal; )+) => {
        $(#[doc = $about])+
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            $( $(#[doc = $meaning])+ pub $field: f64, )+
        }

        impl $name {
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
    /// The constants of the decision where something always remains.
    Policy:
    /// A structure takes part if the share of the error that it leaves is at most so
    /// many times the least that one of its size leaves.
    comparable: 1.5, "–", "what another formula of the right family leaves, real rigs";
    /// Evidence below this gives no name.
    evidence: 100.0, "2 ln Bayes factor", "largest that a random force gave any effect";
    /// An effect's special case is preferred unless the general one has so much more
    /// evidence.
    special_case: 20.0, "2 ln Bayes factor", "twice very strong (Kass and Raftery 1995)";
    /// An effect that is not told from its special case is that, if the special case
    /// leaves at most so much more of the error.
    same_effect: 0.08, "–", "the same effect by another formula";
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
    /// A formula is not the right one if a table of its own variable beside it leaves at
    /// most this share of its error, fitted and held out.
    shape: 0.85, "–", "right formulas 0.98 to 1.03, wrong ones 0.26 to 0.77, real rigs";
    /// The repaired model is written if it leaves at most this share of the refit's
    /// error on segments that were not fitted.
    worth_writing: 0.95, "–", "5 %: less is within what a repetition differs";
}

policy! {
    /// The constants of the decision where only noise may remain, and formulas are told
    /// apart.
    Exact:
    /// A residual counts as noise if its coloured part stays below this share of the
    /// noise floor.
    coloured_share: 0.15, "noise floor", "set on clean simulated recordings";
    /// A residual counts as noise if its RMS stays below this factor of the noise floor.
    rms_factor: 1.08, "noise floor", "set on clean simulated recordings";
    /// What the noise of the measured pressure leaves counts so many times.
    input_factor: 1.5, "–", "one draw of the noise stands for all";
    /// Final fits of single effects are made if the best coarse fit leaves at most so
    /// many times the noise.
    may_settle: 3.0, "noise", "set on clean simulated recordings";
    /// Formulas are told apart if the structure that leaves least leaves at most so many
    /// times the noise.
    may_leave: 2.0, "noise", "a quarter more than `leaves`";
    /// No further effect is looked for beside one that leaves at most so many times the
    /// noise.
    done: 1.2, "noise", "what the right effect by another formula leaves";
    /// Evidence that a larger structure has to bring for each effect, beyond what its
    /// parameters and the choice among effects cost.
    effect_evidence: 10.0, "2 ln Bayes factor", "very strong (Kass and Raftery 1995)";
    /// The first effect leaves at most this share of the error on segments that were not
    /// fitted.
    first_leaves: 0.97, "–", "set on clean simulated recordings";
    /// Each further effect leaves at most this share of it.
    further_leaves: 0.9, "–", "no term without need";
    /// Each further effect leaves at most this share of the squares beyond the noise, or
    /// only noise.
    further_excess: 0.3, "–", "right pairs left up to 0.21, menders of a formula 0.37 and more";
    /// Probability below which a rival is rejected, relative to the best of its size.
    rejected: 0.05, "–", "one in twenty";
    /// A rival that leaves so many times the squares beyond the noise is worse than a
    /// formula can be.
    far_worse: 4.0, "–", "the right effect by another formula leaves a fifth of what wrong ones leave";
    /// Squares beyond the noise below this share of the noise's are not told from none.
    noise_share: 0.11, "noise²", "with far_worse: a rival at the noise leaves a fifth more";
    /// Two structures that leave only noise are told apart from this difference on.
    told_apart: 100.0, "2 ln Bayes factor", "a look-alike by another formula brought 43 to 135";
    /// Evidence against a structure that leaves only noise, below that.
    doubt: 4.0, "2 ln Bayes factor", "less probable, and not rejected";
    /// An effect that another imitates stays in the answer if it leaves at most this
    /// share of the squared gap.
    imitated: 0.08, "–", "the same effect by another formula";
    /// A larger structure is not believed if chance does as well more often.
    chance: 0.01, "–", "one in a hundred; 499 draws show it";
    /// Share of the gap on segments that were not fitted that an effect closes.
    closes: 0.75, "–", "known effects closed 77 % and more, unknown ones 72 % at most";
    /// Share of that gap that several effects close.
    closes_several: 0.8, "–", "several imitate more";
    /// Share of that gap that is enough however much is left.
    closes_large: 0.9, "–", "a gap ten times what is left";
    /// Times the noise that an effect leaves there.
    leaves: 1.6, "noise", "the right effect by another formula left up to 1.6";
    /// Times the noise that several effects leave there.
    leaves_several: 1.45, "noise", "several right ones left up to 1.4";
    /// Times the noise that any leave where what is held out repeats what was fitted.
    leaves_on_repeats: 1.2, "noise", "repeats do not show whether a formula holds elsewhere";
    /// What could not be named itself and closes so much less than the best is no rival.
    falls_short: 0.2, "–", "a fifth of the gap";
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_every_row_says_where_it_comes_from() {
        for rows in [Policy::ROWS, Exact::ROWS] {
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
