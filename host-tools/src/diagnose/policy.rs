//! Every constant of the decision, with its meaning, unit and origin.
//!
//! [`super::decide`] reads nothing but [`Policy`]; where only noise may remain, formulas
//! are told apart by [`Exact`]. The tables in `docs/diagnosis.md` are written from here,
//! and a test holds them there.

/// A row of the table: name, value, unit, meaning, origin.
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
    /// The constants of the decision where some model error always remains.
    Policy:
    /// A structure competes if the share of the error that it leaves is at most this
    /// multiple of the least share that a structure of its size leaves.
    comparable: 1.5, "–", "what another formula of the right family leaves, real rigs";
    /// Least evidence of a named effect.
    evidence: 100.0, "2 ln Bayes factor", "largest that a random force gave any effect";
    /// An effect's special case is preferred unless the general effect has this much more
    /// evidence.
    special_case: 20.0, "2 ln Bayes factor", "twice very strong (Kass and Raftery 1995)";
    /// An effect that cannot be distinguished from its special case counts as the special
    /// case, if that leaves at most this much more of the error.
    same_effect: 0.08, "–", "the same effect by another formula";
    /// Least closure of an effect that explains the error.
    explains: 0.666_666_666_666_666_6, "–", "two thirds: what remains is half of what is explained";
    /// Least closure of an effect that explains part of the error.
    part: 0.333_333_333_333_333_3, "–", "one third: what remains is twice what is explained";
    /// Least closure of a trace, which is shown as an answer set without a name.
    trace: 0.15, "–", "half of what names a part";
    /// Least evidence of a trace.
    trace_evidence: 500.0, "2 ln Bayes factor", "five times what a name needs";
    /// Structures within this share of the leader's evidence are rivals.
    rival_share: 0.1, "–", "spread between formulas of one family, real rigs";
    /// Structures within this distance of the leader's evidence are rivals in any case.
    rival_least: 30.0, "2 ln Bayes factor", "three times very strong (Kass and Raftery 1995)";
    /// A further effect leaves at most this share of the error that remained without it.
    further_leaves: 0.5, "–", "half: the least that a person would call another cause";
    /// Least additional evidence of a further effect.
    further_evidence: 100.0, "2 ln Bayes factor", "as for the first effect";
    /// An excess error below this share of the noise cannot be distinguished from none.
    noise_share: 0.3, "noise", "how well the noise is known: 4 % of its size";
    /// A structure that adds effects to the named ones is the repaired model if it leaves
    /// at most this share of their remaining error.
    adds_to_repair: 0.8, "–", "a fifth: less is not worth another effect on the board";
    /// A formula is wrong if a table of its own variable, added to it, leaves at most this
    /// share of its error, fitted and held out.
    shape: 0.85, "–", "right formulas 0.98 to 1.03, wrong ones 0.26 to 0.77, real rigs";
    /// The repaired model is written if it leaves at most this share of the refit's
    /// error on held-out segments.
    worth_writing: 0.95, "–", "5 %: less is within the difference between repeats";
}

policy! {
    /// The constants of the decision where only noise may remain, and formulas are
    /// distinguished.
    Exact:
    /// A residual counts as noise if its coloured part stays below this share of the
    /// noise floor.
    coloured_share: 0.15, "noise floor", "set on clean simulated recordings";
    /// A residual counts as noise if its RMS stays below this factor of the noise floor.
    rms_factor: 1.08, "noise floor", "set on clean simulated recordings";
    /// Factor on the error from noise of the measured pressure.
    input_factor: 1.5, "–", "how well differences know the noise";
    /// Final fits of single effects are made if the best coarse fit leaves at most this
    /// multiple of the noise.
    may_settle: 3.0, "noise", "set on clean simulated recordings";
    /// Formulas are distinguished if the best structure leaves at most this multiple of
    /// the noise.
    may_leave: 2.0, "noise", "a quarter more than `leaves`";
    /// No further effect is searched beside one that leaves at most this multiple of the
    /// noise.
    done: 1.2, "noise", "what the right effect by another formula leaves";
    /// Evidence required for each effect of a larger structure, beyond the price of its
    /// parameters and of the choice among effects.
    effect_evidence: 10.0, "2 ln Bayes factor", "very strong (Kass and Raftery 1995)";
    /// The first effect leaves at most this share of the error on held-out segments.
    first_leaves: 0.97, "–", "set on clean simulated recordings";
    /// Each further effect leaves at most this share of that error.
    further_leaves: 0.9, "–", "no term without need";
    /// Each further effect leaves at most this share of the squared error beyond the noise,
    /// or only noise.
    further_excess: 0.3, "–", "right pairs left up to 0.21, corrections of a formula 0.37 and more";
    /// Probability below which a rival is rejected, relative to the best of its size.
    rejected: 0.05, "–", "one in twenty";
    /// A rival that leaves this multiple of the squared error beyond the noise is worse
    /// than a wrong formula can explain.
    far_worse: 4.0, "–", "the right effect by another formula leaves a fifth of what wrong ones leave";
    /// A squared error beyond the noise below this share of the noise's square cannot be
    /// distinguished from none.
    noise_share: 0.11, "noise²", "with far_worse: a rival at the noise leaves a fifth more";
    /// Least difference that distinguishes two structures that both leave only noise.
    told_apart: 100.0, "2 ln Bayes factor", "a look-alike by another formula brought 43 to 135";
    /// Evidence against a structure that leaves only noise, if the difference is smaller.
    doubt: 4.0, "2 ln Bayes factor", "less probable, and not rejected";
    /// An effect that another imitates remains in the answer if it leaves at most this
    /// share of the squared gap.
    imitated: 0.08, "–", "the same effect by another formula";
    /// Largest probability that noise alone gains as much as a larger structure.
    chance: 0.01, "–", "one in a hundred; 9 999 draws show it";
    /// Least share of the gap on held-out segments that one effect closes.
    closes: 0.75, "–", "known effects closed 77 % and more, unknown ones 72 % at most";
    /// Least share of that gap that several effects close.
    closes_several: 0.8, "–", "several imitate more";
    /// Share of that gap that suffices whatever error remains.
    closes_large: 0.9, "–", "a gap ten times what is left";
    /// Largest multiple of the noise that one effect leaves there.
    leaves: 1.6, "noise", "the right effect by another formula left up to 1.6";
    /// Largest multiple of the noise that several effects leave there.
    leaves_several: 1.45, "noise", "several right ones left up to 1.4";
    /// Largest multiple of the noise if all held-out runs repeat fitted ones.
    leaves_on_repeats: 1.2, "noise", "repeats do not show whether a formula holds elsewhere";
    /// A structure that could not be named, and closes this much less than the best, is no
    /// rival.
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
