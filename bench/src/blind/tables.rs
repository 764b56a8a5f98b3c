//! The score in rows: of figures, of kinds, of cases; for people (terminal) and for
//! programs (CSV). The pages are made of the same rows ([`page`](super::page)).

use std::collections::BTreeMap;
use std::fmt::Write;

use super::answer::{Answer, Collection};
use super::bench::cases as session;
use super::bench::session::Rig;
use super::counts::{Group, Rate, median};
use super::experiments::Set;
use super::grade::{Grade, Strength};
use super::hidden::Hidden;
use super::law::{Law, kinds};
use super::score::{Estimate, Scored};

/// "92 % (85–96), 74 of 80".
fn shown(rate: Rate) -> String {
    match (rate.share(), rate.wilson()) {
        (Some(share), Some((low, high))) => format!(
            "{:.0} % ({:.0}–{:.0}), {} of {}",
            100.0 * share,
            100.0 * low,
            100.0 * high,
            rate.hits,
            rate.of
        ),
        _ => "–".to_owned(),
    }
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{:.1} %", 100.0 * value))
}

/// A row of figures: label, what is asked for, and the figure.
pub type Row = (String, &'static str, String);

/// The rows of a set's figures.
pub fn rows(collection: Collection, cases: &Group<'_>) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut row = |label: &str, asked, figure| rows.push((label.to_owned(), asked, figure));
    let most = match collection {
        Collection::Runs(set) => {
            rows_of_runs(set, cases, &mut row);
            "≤ 15"
        }
        Collection::Bench => {
            rows_of_bench(cases, &mut |label, figure| row(label, "", figure));
            ""
        }
    };
    let seconds = |case: &Scored| Some(case.seconds);
    let median = number(cases.median(seconds), 1);
    row("wall time a case, median (s)", most, median);
    let worst = number(cases.worst(seconds), 1);
    row("wall time a case, worst (s)", "", worst);
    if collection == Collection::Bench {
        let median = number(cases.median(|case| case.cpu_seconds), 1);
        row("processor time a case, median (s)", "", median);
        let worst = number(cases.worst(|case| case.cpu_seconds), 1);
        row("processor time a case, worst (s)", "", worst);
    }
    rows
}

// A table: a row of it is a line.
#[rustfmt::skip]
fn rows_of_runs(set: Set, cases: &Group<'_>, row: &mut dyn FnMut(&str, &'static str, String)) {
    let asked = |rich: &'static str, paper: &'static str| match set {
        Set::Rich => rich,
        Set::Paper => paper,
    };
    let one = cases.hiding(&[Hidden::One]);
    let two = cases.hiding(&[Hidden::Two]);
    let outside = cases.hiding(&[Hidden::Outside]);
    let by_the = |same: bool| one.that(|case| case.secret().same_laws == same);
    let rate = |cases: &Group<'_>, is: fn(&Scored) -> bool| shown(cases.rate(is));
    let full: fn(&Scored) -> bool = |case| case.is_wrong(Strength::Full);
    let estimates = |base: bool| {
        let all = cases.iter().flat_map(|case| &case.estimates);
        all.filter(move |estimate: &&Estimate| estimate.base == base)
    };
    let covered = |base| shown(Rate::count(estimates(base).filter_map(|it| it.covered)));
    let error = |base| percent(median(estimates(base).map(|it| it.relative_error)));
    row("one effect: named, lenient", asked("≥ 92 %", "≥ 70 %"), rate(&one, Scored::is_lenient));
    row("one effect: named, strict", "", rate(&one, Scored::is_exact));
    row("… by the catalogue's formula, lenient", "", rate(&by_the(true), Scored::is_lenient));
    row("… by another formula, lenient", "", rate(&by_the(false), Scored::is_lenient));
    row("one effect: something else named", "", rate(&one, Scored::names_else));
    row("one effect: in the answer set", asked("≥ 97 %", "≥ 95 %"), rate(&one, Scored::holds));
    row("nothing or parameters only: a name", "≤ 3 %", rate(&cases.quiet(), Scored::names));
    row("… nothing hidden", "", rate(&cases.hiding(&[Hidden::Nothing]), Scored::names));
    row("… parameters only", "", rate(&cases.hiding(&[Hidden::Parameters]), Scored::names));
    row("outside the catalogue: a name at full strength", asked("≤ 15 %", "≤ 25 %"), rate(&outside, full));
    row("two effects: exact pair", asked("≥ 70 %", "–"), rate(&two, Scored::is_exact));
    row("two effects: all that is named is hidden", "", rate(&two, Scored::names_what_is_hidden));
    row("held-out RMSE over the oracle's, median", asked("≤ 1.05", "≤ 1.10"), number(one.median(Scored::over_oracle), 3));
    row("… against a perfect sensor", "", number(one.median(Scored::over_oracle_clean), 2));
    row("effect parameters: 95 % intervals cover", "90–98 %", covered(false));
    row("base ratios: 95 % intervals cover", "90–98 %", covered(true));
    row("effect parameters: median relative error", "", error(false));
    row("base ratios: median relative error", "", error(true));
}

// A table: a row of it is a line.
#[rustfmt::skip]
fn rows_of_bench(cases: &Group<'_>, row: &mut dyn FnMut(&str, String)) {
    let one = cases.hiding(&[Hidden::One]);
    let two = cases.hiding(&[Hidden::Two]);
    let (quiet, outside) = (cases.quiet(), cases.hiding(&[Hidden::Outside]));
    let right = |cases: &Group<'_>| shown(cases.rate(|case| case.grade.is_right()));
    let graded = |cases: &Group<'_>, grade| shown(cases.rate(|case| case.grade == grade));
    let (full, part) = (Grade::Wrong(Strength::Full), Grade::Wrong(Strength::Part));
    let session = |is: &dyn Fn(Rig, bool) -> bool| {
        let is = |case: &Scored| case.answer.session().is_some_and(|it| is(it.rig, it.cut));
        right(&one.that(is))
    };
    let as_part = one.that(|case| case.is_exact() && case.said.in_part).len();
    let denied = |case: &Scored| matches!(case.grade, Grade::Denied | Grade::Refused);
    let held_out = |cases: &Group<'_>| number(cases.median(|case| case.said.held_out), 3);
    row("one effect: right", right(&one));
    row("… the exact name", graded(&one, Grade::Exact));
    row("… … of these, for a part of the gap", as_part.to_string());
    row("… its family", graded(&one, Grade::Family));
    row("… in an answer set of at most three", graded(&one, Grade::Set));
    row("one effect: another family at full strength", graded(&one, full));
    row("one effect: another family for a part", graded(&one, part));
    row("one effect: cannot tell, without the truth", graded(&one, Grade::Open));
    row("one effect: silent (unexplained)", graded(&one, Grade::Silent));
    row("one effect: nothing missing, or refused", shown(one.rate(denied)));
    for rig in Rig::ALL {
        row(&format!("one effect, {}: right", rig.name()), session(&|of, _| of == rig));
    }
    row("one effect, whole session: right", session(&|rig, cut| rig != Rig::Swing && !cut));
    row("one effect, session cut into files: right", session(&|rig, cut| rig != Rig::Swing && cut));
    row("two effects: right", right(&two));
    row("two effects: one of the two", graded(&two, Grade::OneOfTwo));
    row("two effects: another family at full strength", graded(&two, full));
    row("two effects: another family for a part", graded(&two, part));
    row("quiet: a name at full strength", graded(&quiet, full));
    row("quiet: a name for a part", graded(&quiet, part));
    row("quiet: nothing or parameters only", graded(&quiet, Grade::Denied));
    row("outside: a name at full strength", graded(&outside, full));
    row("outside: a name for a part", graded(&outside, part));
    row("outside: silent (unexplained)", graded(&outside, Grade::Silent));
    row("any case: refused", graded(cases, Grade::Refused));
    row("held-out RMSE, repaired over refit, median", held_out(&cases.hiding(&[Hidden::One, Hidden::Two])));
    row("… where the cause is outside the catalogue", held_out(&outside));
}

/// What a case counts as in the rows of a table of kinds.
pub fn row_label(case: &Scored) -> String {
    let secret = case.secret();
    match (secret.hidden, &case.answer) {
        (Hidden::Nothing, _) => "(nothing)".to_owned(),
        (Hidden::Parameters, _) => "(parameters)".to_owned(),
        (Hidden::Two, _) => "(two)".to_owned(),
        (Hidden::Outside, Answer::Runs(_)) => "(outside)".to_owned(),
        (Hidden::Outside, Answer::Session(_)) => format!("({})", secret.laws.concat()),
        (Hidden::One, _) => secret.kinds.concat(),
    }
}

/// The labels of rows in their order.
pub(super) fn row_order() -> Vec<String> {
    let special = ["(two)", "(nothing)", "(parameters)", "(outside)"];
    let kinds = kinds().into_iter().chain(special).map(str::to_owned);
    let of_benches = Law::OF_BENCHES.map(|law| format!("({})", law.row().name));
    kinds.chain(of_benches).collect()
}

/// What the verdict counts as: in the columns of the confusion matrix, and beside
/// the runs of a kind.
pub fn column_label(case: &Scored) -> String {
    match case.said.named.as_slice() {
        [] => format!("({})", case.said.verdict),
        [one] => one.clone(),
        _ if case.is_exact() => "(the pair)".to_owned(),
        _ => "(several)".to_owned(),
    }
}

/// What the verdict on a session said, in a few words.
fn answer_label(case: &Scored) -> String {
    let said = &case.said;
    if !said.named.is_empty() {
        let part = match Strength::of(said) {
            Strength::Full => "",
            Strength::Part => " (part)",
        };
        return format!("{}{part}", said.named.join(" + "));
    }
    match (&said.family, &said.repair) {
        (Some(family), _) => format!("({}: {family})", said.verdict),
        (None, Some(repair)) => format!("({}, table of {repair})", said.verdict),
        (None, None) => format!("({})", said.verdict),
    }
}

/// What was answered to each kind, a line each under a head.
pub fn kind_rows(collection: Collection, cases: &Group<'_>) -> Vec<Vec<String>> {
    let head: &[&str] = match collection {
        Collection::Runs(_) => &[
            "hidden",
            "cases",
            "strict",
            "lenient",
            "in the answer set",
            "other answers",
        ],
        Collection::Bench => &[
            "hidden",
            "cases",
            "exact",
            "family",
            "set",
            "wrong, full",
            "wrong, part",
            "silent",
            "other answers than the exact name",
        ],
    };
    let mut rows = vec![head.iter().map(|&word| word.to_owned()).collect()];
    for label in row_order() {
        let cases = cases.that(|case| row_label(case) == label);
        let Some(first) = cases.iter().next() else {
            continue;
        };
        // Where nothing of the catalogue is hidden, no name is right.
        let has_name = first.secret().hidden.has_a_name();
        let if_named = |figure: String| if has_name { figure } else { String::new() };
        let rate = |is: fn(&Scored) -> bool| if_named(shown(cases.rate(is)));
        let count = |grade| cases.rate(|case| case.grade == grade).hits.to_string();
        let others = cases.that(|case| !case.is_exact());
        let mut row = vec![label, cases.len().to_string()];
        match collection {
            Collection::Runs(_) => row.extend([
                rate(Scored::is_exact),
                rate(Scored::is_lenient),
                rate(Scored::holds),
                counted(others.iter().map(column_label)),
            ]),
            Collection::Bench => row.extend([
                if_named(count(Grade::Exact)),
                if_named(count(Grade::Family)),
                if_named(count(Grade::Set)),
                count(Grade::Wrong(Strength::Full)),
                count(Grade::Wrong(Strength::Part)),
                count(Grade::Silent),
                counted(others.iter().map(answer_label)),
            ]),
        }
        rows.push(row);
    }
    rows
}

/// How many effects could not be drawn as large as is asked for. They count
/// like all others.
pub(super) fn faint(scored: &[Scored]) -> String {
    let cases = scored.iter().map(Scored::secret);
    let faint: Vec<&str> = cases
        .filter(|secret| !secret.visible)
        .map(|secret| secret.case.as_str())
        .collect();
    format!(
        "effects that are fainter or coarser than the range that is asked for: {} of {} cases {}",
        faint.len(),
        scored.len(),
        faint.join(" ")
    )
    .trim_end()
    .to_owned()
}

/// A line for each session without a verdict: why.
pub(super) fn refusals(scored: &[Scored]) -> Vec<String> {
    let sessions = scored.iter().filter(|case| case.answer.session().is_some());
    sessions
        .filter_map(|case| {
            let reason = case.refused.as_deref()?;
            // The path before the file's name says nothing.
            let reason = reason.rsplit_once("recordings/").map_or(reason, |it| it.1);
            Some(format!("{} was refused: {reason}", case.secret().case))
        })
        .collect()
}

/// What was answered how often.
fn counted(answers: impl Iterator<Item = String>) -> String {
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    for answer in answers {
        *counts.entry(answer).or_default() += 1;
    }
    let counts = counts.iter().map(|(what, count)| format!("{what} {count}"));
    counts.collect::<Vec<_>>().join(", ")
}

/// Columns padded to their widest entry.
fn aligned(rows: &[Vec<String>]) -> String {
    let mut text = String::new();
    let columns = rows.first().map_or(0, Vec::len);
    let width = |column: usize| {
        rows.iter()
            .map(|row| row[column].chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    for row in rows {
        let mut line = String::from(" ");
        for (entry, width) in row.iter().zip(&widths) {
            let _ = write!(line, " {entry:<width$} ");
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}

/// The sets that were scored, with their cases.
pub fn sets(scored: &[Scored]) -> Vec<(Collection, Group<'_>)> {
    let sets = Collection::ALL.map(|collection| (collection, Group::of(collection, scored)));
    let mut sets = Vec::from(sets);
    sets.retain(|(_, cases)| !cases.is_empty());
    sets
}

/// The tables for a terminal.
pub fn terminal(scored: &[Scored]) -> String {
    let mut text = String::new();
    for (collection, cases) in sets(scored) {
        let figures: Vec<Vec<String>> = rows(collection, &cases)
            .into_iter()
            .map(|(label, asked, figure)| vec![label, asked.to_owned(), figure])
            .collect();
        let _ = writeln!(
            text,
            "\n{} set\n\n{}\n{}",
            collection.name(),
            aligned(&figures),
            aligned(&kind_rows(collection, &cases)).trim_end()
        );
    }
    let _ = writeln!(text, "\n  {}", faint(scored));
    for line in refusals(scored) {
        let _ = writeln!(text, "  {line}");
    }
    text
}

/// A line for each case; what a set does not have is left empty.
pub fn csv(scored: &[Scored]) -> String {
    let head = CSV.map(|(name, _)| name).join(",");
    let line = |case: &Scored| CSV.map(|(_, field)| field(case)).join(",");
    let lines: Vec<String> = std::iter::once(head)
        .chain(scored.iter().map(line))
        .collect();
    lines.join("\n") + "\n"
}

/// What only a session has.
fn of_session(case: &Scored, field: fn(&session::Answer) -> String) -> String {
    case.answer.session().map(field).unwrap_or_default()
}

/// A column of the CSV file: its name, and what a case has there.
type Field = (&'static str, fn(&Scored) -> String);

const CSV: [Field; 26] = [
    ("case", |case| case.secret().case.clone()),
    ("set", |case| case.answer.collection().name().to_owned()),
    ("rig", |case| {
        of_session(case, |it| it.rig.name().to_owned())
    }),
    ("cut", |case| of_session(case, |it| it.cut.to_string())),
    ("hidden", |case| {
        format!("{:?}", case.secret().hidden).to_lowercase()
    }),
    ("kinds", |case| case.secret().kinds.join("+")),
    ("laws", |case| case.secret().laws.join("+")),
    ("misfit_over_noise", |case| {
        number(Some(case.secret().misfit_over_noise), 3)
    }),
    ("partner_over_noise", |case| {
        number(case.secret().partner_over_noise, 3)
    }),
    ("visible", |case| case.secret().visible.to_string()),
    ("noise_deg", |case| {
        let noise = match &case.answer {
            Answer::Runs(answer) => answer.sensors.angle_noise,
            Answer::Session(answer) => answer.instruments.angle_noise,
        };
        number(Some(noise.to_degrees()), 3)
    }),
    ("coloured_misfit_deg", |case| {
        of_session(case, |it| number(Some(it.coloured_misfit.to_degrees()), 3))
    }),
    ("rate_hz", |case| {
        of_session(case, |it| it.instruments.rate_hz.to_string())
    }),
    ("samples", |case| {
        of_session(case, |it| it.samples.to_string())
    }),
    ("verdict", |case| case.said.verdict.clone()),
    ("strength", |case| match Strength::of(&case.said) {
        _ if !case.names() => String::new(),
        Strength::Full => "full".to_owned(),
        Strength::Part => "part".to_owned(),
    }),
    ("family", |case| {
        case.said.family.clone().unwrap_or_default()
    }),
    ("named", |case| case.said.named.join("+")),
    ("answer_set", |case| {
        let sets = case.said.answer_set.iter();
        sets.map(|set| set.join("+")).collect::<Vec<_>>().join(" ")
    }),
    ("repair", |case| {
        let repair = case.said.repair.clone().unwrap_or_default();
        repair.replace(", ", "+")
    }),
    ("grade", |case| match case.grade {
        Grade::Wrong(Strength::Full) => "wrong".to_owned(),
        Grade::Wrong(Strength::Part) => "wrong_part".to_owned(),
        Grade::OneOfTwo => "one_of_two".to_owned(),
        grade => format!("{grade:?}").to_lowercase(),
    }),
    ("held_out_over_oracle", |case| number(case.over_oracle(), 4)),
    ("held_out_over_oracle_clean", |case| {
        number(case.over_oracle_clean(), 4)
    }),
    ("held_out_repaired_over_refit", |case| {
        number(case.said.held_out, 4)
    }),
    ("seconds", |case| number(Some(case.seconds), 2)),
    ("cpu_seconds", |case| number(case.cpu_seconds, 2)),
];
