//! The score as JSON: rows of figures, of kinds, of cases.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::answer::{Answer, Collection};
use super::bench::session::Rig;
use super::counts::{Group, Rate, median};
use super::experiments::Set;
use super::grade::{Grade, Strength};
use super::hidden::Hidden;
use super::law::{Law, kinds};
use super::laws::Class;
use super::score::{Estimate, Scored};

/// A law is found as it is if the model leaves at most this multiple of what the law itself leaves.
const AS_GOOD: f64 = 1.2;

/// A number with so many digits behind the point.
fn number(value: Option<f64>, digits: usize) -> Value {
    json!({ "value": value, "digits": digits })
}

fn percent(value: Option<f64>) -> Value {
    json!({ "percent": value.map(|value| 100.0 * value) })
}

/// A row of a set's figures: label, what is asked for, and a rate, a number or a count.
fn rows(collection: Collection, cases: &Group<'_>) -> Vec<Value> {
    let mut rows = Vec::new();
    let mut row = |label: &str, asked: &str, figure: Value| {
        rows.push(json!({ "label": label, "asked": asked, "figure": figure }));
    };
    let most = match collection {
        Collection::Runs(set) => {
            rows_of_runs(set, cases, &mut row);
            "≤ 15"
        }
        Collection::Bench => {
            rows_of_bench(cases, &mut |label, figure| row(label, "", figure));
            ""
        }
        Collection::Laws => {
            rows_of_laws(cases, &mut row);
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
fn rows_of_runs(set: Set, cases: &Group<'_>, row: &mut dyn FnMut(&str, &str, Value)) {
    let asked = |rich: &'static str, paper: &'static str| match set {
        Set::Rich => rich,
        Set::Paper => paper,
    };
    let one = cases.hiding(&[Hidden::One]);
    let two = cases.hiding(&[Hidden::Two]);
    let outside = cases.hiding(&[Hidden::Outside]);
    let by_the = |same: bool| one.that(|case| case.secret().same_laws == same);
    let rate = |cases: &Group<'_>, is: fn(&Scored) -> bool| cases.rate(is).shown();
    let full: fn(&Scored) -> bool = |case| case.is_wrong(Strength::Full);
    let estimates = |base: bool| {
        let all = cases.iter().flat_map(|case| &case.estimates);
        all.filter(move |estimate: &&Estimate| estimate.base == base)
    };
    let covered = |base| Rate::count(estimates(base).filter_map(|it| it.covered)).shown();
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
fn rows_of_bench(cases: &Group<'_>, row: &mut dyn FnMut(&str, Value)) {
    let one = cases.hiding(&[Hidden::One]);
    let two = cases.hiding(&[Hidden::Two]);
    let (quiet, outside) = (cases.quiet(), cases.hiding(&[Hidden::Outside]));
    let right = |cases: &Group<'_>| cases.rate(|case| case.grade.is_right()).shown();
    let graded = |cases: &Group<'_>, grade| cases.rate(|case| case.grade == grade).shown();
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
    row("… … of these, for a part of the gap", as_part.into());
    row("… its family", graded(&one, Grade::Family));
    row("… in an answer set of at most three", graded(&one, Grade::Set));
    row("one effect: another family at full strength", graded(&one, full));
    row("one effect: another family for a part", graded(&one, part));
    row("one effect: cannot tell, without the truth", graded(&one, Grade::Open));
    row("one effect: silent (unexplained)", graded(&one, Grade::Silent));
    row("one effect: nothing missing, or refused", one.rate(denied).shown());
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

// A table: a row of it is a line.
#[rustfmt::skip]
fn rows_of_laws(cases: &Group<'_>, row: &mut dyn FnMut(&str, &str, Value)) {
    let [within, beyond, quiet] = [Class::Within, Class::Beyond, Class::Nothing].map(|class| {
        cases.that(|case| case.answer.law().is_some_and(|it| it.class == class))
    });
    let rate = |cases: &Group<'_>, is: fn(&Scored) -> bool| cases.rate(is).shown();
    let full: fn(&Scored) -> bool = |case| case.is_wrong(Strength::Full);
    let part: fn(&Scored) -> bool = |case| case.is_wrong(Strength::Part);
    let as_good: fn(&Scored) -> bool = |case| case.over_law().is_some_and(|ratio| ratio <= AS_GOOD);
    let time = |cases: &Group<'_>| number(cases.median(|case| case.cpu_seconds), 1);
    row("a law that the grammar has: it is named, or one that pushes alike", "≥ 75 %", rate(&within, Scored::is_exact));
    row("… it is in the answer", "≥ 90 %", rate(&within, Scored::has_the_law));
    row("… the model leaves at most 1.2 times what the law leaves", "≥ 85 %", rate(&within, as_good));
    row("… another formula, at full strength", "", rate(&within, Scored::is_wrong_formula));
    row("… another name, at full strength", "", rate(&within, full));
    row("… another name, for a part", "", rate(&within, part));
    row("… processor time, median (s)", "", time(&within));
    row("a law that it does not have: a name at full strength", "≤ 10 %", rate(&beyond, full));
    row("… and that is a formula", "", rate(&beyond, Scored::is_wrong_formula));
    row("… a name for a part", "", rate(&beyond, part));
    row("… processor time, median (s)", "", time(&beyond));
    row("nothing hidden: a name", "0 %", rate(&quiet, Scored::names));
    row("… processor time, median (s)", "", time(&quiet));
}

/// What a case counts as in the rows of a table of kinds.
fn row_label(case: &Scored) -> String {
    let secret = case.secret();
    match (secret.hidden, &case.answer) {
        (Hidden::Nothing, _) => "(nothing)".to_owned(),
        (Hidden::Parameters, _) => "(parameters)".to_owned(),
        (Hidden::Two, _) => "(two)".to_owned(),
        (Hidden::Outside, Answer::Session(_)) => format!("({})", secret.laws.concat()),
        (Hidden::Outside, _) => "(outside)".to_owned(),
        (Hidden::One, _) => secret.kinds.concat(),
    }
}

/// The labels of rows in their order.
fn row_order() -> Vec<String> {
    let special = ["(two)", "(nothing)", "(parameters)", "(outside)"];
    let kinds = kinds().into_iter().chain(special).map(str::to_owned);
    let of_benches = Law::OF_BENCHES.map(|law| format!("({})", law.row().name));
    kinds.chain(of_benches).collect()
}

/// What the verdict counts as: in the columns of the confusion matrix, and beside
/// the runs of a kind.
fn column_label(case: &Scored) -> String {
    match case.said.named.as_slice() {
        [] => format!("({})", case.said.verdict),
        [one] => one.clone(),
        _ if case.is_exact() => "(the pair)".to_owned(),
        _ => "(several)".to_owned(),
    }
}

/// What the verdict on a session or a law said, in a few words.
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

/// What was answered to the cases that hide one kind.
fn kind_rows(cases: &Group<'_>) -> Vec<Value> {
    let mut rows = Vec::new();
    for label in row_order() {
        let cases = cases.that(|case| row_label(case) == label);
        let Some(first) = cases.iter().next() else {
            continue;
        };
        let count = |grade| cases.rate(|case| case.grade == grade).hits;
        let others = cases.that(|case| !case.is_exact());
        let of_session = first.answer.session().is_some();
        let answer = if of_session {
            answer_label
        } else {
            column_label
        };
        rows.push(json!({
            "hidden": label, "cases": cases.len(),
            // Where nothing of the catalogue is hidden, no name is right.
            "has_a_name": first.secret().hidden.has_a_name(),
            "strict": cases.rate(Scored::is_exact).shown(),
            "lenient": cases.rate(Scored::is_lenient).shown(),
            "in_answer_set": cases.rate(Scored::holds).shown(),
            "exact": count(Grade::Exact), "family": count(Grade::Family), "set": count(Grade::Set),
            "wrong": count(Grade::Wrong(Strength::Full)),
            "wrong_part": count(Grade::Wrong(Strength::Part)),
            "silent": count(Grade::Silent),
            "answers": counted(cases.iter().map(column_label)),
            "others": counted(others.iter().map(answer)),
        }));
    }
    rows
}

/// The columns of the confusion matrix: what was hidden or answered.
fn columns(rows: &[Value]) -> Vec<String> {
    let special = [
        "(the pair)",
        "(several)",
        "(cannot_tell)",
        "(unexplained)",
        "(parameters_only)",
        "(no_discrepancy)",
        "(refused)",
    ];
    let columns = kinds().into_iter().chain(special).map(str::to_owned);
    let is_used = |column: &String| {
        let mut rows = rows.iter();
        rows.any(|row| row["hidden"] == **column || row["answers"].get(column).is_some())
    };
    columns.filter(is_used).collect()
}

/// All figures of the cases: the sets that were scored, effects that could not be drawn as large as is asked for, which
/// count like all others, and why sessions were refused.
pub fn figures(scored: &[Scored]) -> Value {
    let sets = Collection::ALL.map(|collection| (collection, Group::of(collection, scored)));
    let sets = sets.iter().filter(|(_, cases)| !cases.is_empty());
    let sets = sets.map(|(collection, cases)| {
        let kinds = kind_rows(cases);
        json!({
            "name": collection.name(), "rows": rows(*collection, cases), "columns": columns(&kinds),
            "kinds": kinds,
        })
    });
    let faint = scored.iter().map(Scored::secret);
    let faint = faint.filter(|secret| !secret.visible).map(|it| &it.case);
    let refused = scored.iter().filter_map(|case| {
        case.answer.session()?;
        let reason = case.refused.as_deref()?;
        // The path before the file's name says nothing.
        let reason = reason.rsplit_once("recordings/").map_or(reason, |it| it.1);
        Some(json!({ "case": case.secret().case, "why": reason }))
    });
    json!({
        "benchmark": "blind", "sets": sets.collect::<Vec<_>>(), "faint": faint.collect::<Vec<_>>(),
        "refused": refused.collect::<Vec<_>>(), "cases": scored.iter().map(case).collect::<Vec<_>>(),
    })
}

/// What was answered how often.
fn counted(answers: impl Iterator<Item = String>) -> BTreeMap<String, u32> {
    let mut counts = BTreeMap::new();
    for answer in answers {
        *counts.entry(answer).or_default() += 1;
    }
    counts
}

/// A case; what its set does not have is absent.
fn case(case: &Scored) -> Value {
    let (secret, said) = (case.secret(), &case.said);
    let strength = match Strength::of(said) {
        Strength::Full => "full",
        Strength::Part => "part",
    };
    let grade = match case.grade {
        Grade::Wrong(Strength::Full) => "wrong".to_owned(),
        Grade::Wrong(Strength::Part) => "wrong_part".to_owned(),
        Grade::OneOfTwo => "one_of_two".to_owned(),
        grade => format!("{grade:?}").to_lowercase(),
    };
    let mut row = json!({
        "case": secret.case, "set": case.answer.collection().name(),
        "hidden": format!("{:?}", secret.hidden).to_lowercase(),
        "kinds": secret.kinds, "laws": secret.laws,
        "misfit_over_noise": secret.misfit_over_noise, "partner_over_noise": secret.partner_over_noise,
        "visible": secret.visible, "verdict": said.verdict,
        "strength": case.names().then_some(strength), "family": said.family, "named": said.named,
        "answer_set": said.answer_set, "repair": said.repair, "grade": grade,
        "held_out_over_oracle": case.over_oracle(),
        "held_out_over_oracle_clean": case.over_oracle_clean(),
        "held_out_repaired_over_refit": said.held_out,
        "seconds": case.seconds, "cpu_seconds": case.cpu_seconds,
    });
    let rest = match &case.answer {
        Answer::Runs(answer) => json!({ "noise_deg": answer.sensors.angle_noise.to_degrees() }),
        Answer::Session(it) => json!({
            "rig": it.rig.name(), "cut": it.cut,
            "noise_deg": it.instruments.angle_noise.to_degrees(),
            "coloured_misfit_deg": it.coloured_misfit.to_degrees(),
            "rate_hz": it.instruments.rate_hz, "samples": it.samples,
        }),
        Answer::Law(it) => json!({
            "class": it.class, "answer": answer_label(case), "law_rmse_deg": it.law_rmse_deg,
            "refit_rmse_deg": said.fitted.map(|it| it[0]),
            "repaired_rmse_deg": said.fitted.map(|it| it[1]),
        }),
    };
    if let (Value::Object(row), Value::Object(rest)) = (&mut row, rest) {
        row.extend(rest);
    }
    row
}
