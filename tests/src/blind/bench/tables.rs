//! The score of the set for people (terminal, Markdown) and programs (CSV).

use std::fmt::Write;

use super::super::cases::Hidden;
use super::super::score::Rate;
use super::super::tables::{aligned, counted, markdown_table, number, shown, too_faint};
use super::super::truth::kinds;
use super::score::{Figures, Grade, Grades, Scored, Strength};

/// The heading of the set in the documentation.
pub const HEADING: &str = "## The bench set";

/// What the set is, for the documentation.
pub const DESCRIPTION: &str = "\
Cases that look like a bench rather than like a simulator. A case is a whole session of
80 to 130 s with its metadata, in a third of the cases cut into files without any: steps,
a staircase, triangles, small reversals, a multisine and a hold in a drawn order, without
rest in between, half of them without a return to zero. Hysteresis, creep, drift and the
largest angle so far belong to the session. The zeros of both sensors are off (pressure
0.3 kPa rms and at most 0.7 kPa, angle up to 1.5°), the clock jitters by 3 to 15 % of an
interval, 50 to 200 Hz, and in three of ten cases the top hundredth of the angle's range is
cut off. A coloured force that nothing explains acts on every rig: an Ornstein–Uhlenbeck
process of 1 to 2 % of the elastic force at 60°, with a correlation time of 0.3 to 5 s.

Of twelve cases seven hide one effect, one hides two, two are quiet (nothing, or only
parameters) and two hide what is outside the catalogue: stiction that grows with the time
at rest, a stiffness that pulsates, a random force of 10 to 20 %. Two of the seven are of
other rigs: a near-integrator with dry friction, free swings without pressure (a file a
release), Bouc–Wen's hysteresis with a drawn shape under a random multisine. The size of an
effect is drawn so that the refitted model misses by 1.5 to 8 times what it misses by
without the effect: the noise of the sensor, and what the coloured force leaves.

Right is the exact name, a member of the same family (or `cannot_tell` with that family),
or an answer set of at most three that holds the truth. Wrong is a name of another family,
at full strength or for a part of the gap. What each row counts is in
`tests/src/blind/bench/score.rs`.
";

fn rows(figures: &Figures) -> Vec<(String, String)> {
    let mut rows = Vec::new();
    let mut row = |label: &str, figure: String| rows.push((label.to_owned(), figure));
    let Figures { one, two, .. } = figures;
    row("one effect: right", shown(one.right));
    row("… the exact name", shown(one.exact));
    row(
        "… … of these, for a part of the gap",
        one.exact_as_part.to_string(),
    );
    row("… its family", shown(one.family));
    row("… in an answer set of at most three", shown(one.set));
    row(
        "one effect: another family at full strength",
        shown(one.wrong_full),
    );
    row(
        "one effect: another family for a part",
        shown(one.wrong_part),
    );
    row(
        "one effect: cannot tell, without the truth",
        shown(one.open),
    );
    row("one effect: silent (unexplained)", shown(one.silent));
    row("one effect: nothing missing, or refused", shown(one.denied));
    for (rig, rate) in &figures.by_rig {
        row(&format!("one effect, {rig}: right"), shown(*rate));
    }
    row("one effect, whole session: right", shown(figures.whole));
    row(
        "one effect, session cut into files: right",
        shown(figures.cut),
    );
    row("two effects: right", shown(two.right));
    row("two effects: one of the two", shown(two.one_of_two));
    row(
        "two effects: another family at full strength",
        shown(two.wrong_full),
    );
    row(
        "two effects: another family for a part",
        shown(two.wrong_part),
    );
    row("quiet: a name at full strength", shown(figures.quiet_full));
    row("quiet: a name for a part", shown(figures.quiet_part));
    row(
        "quiet: nothing or parameters only",
        shown(figures.quiet_right),
    );
    row(
        "outside: a name at full strength",
        shown(figures.outside_full),
    );
    row("outside: a name for a part", shown(figures.outside_part));
    row(
        "outside: silent (unexplained)",
        shown(figures.outside_silent),
    );
    row("any case: refused", shown(figures.refused));
    row(
        "held-out RMSE, repaired over refit, median",
        number(figures.held_out, 3),
    );
    row(
        "… where the cause is outside the catalogue",
        number(figures.held_out_outside, 3),
    );
    row(
        "wall time a case, median (s)",
        number(figures.seconds_median, 1),
    );
    row(
        "wall time a case, worst (s)",
        number(figures.seconds_worst, 1),
    );
    row(
        "processor time a case, median (s)",
        number(figures.cpu_median, 1),
    );
    row(
        "processor time a case, worst (s)",
        number(figures.cpu_worst, 1),
    );
    rows
}

/// What a case hides, as a row's label.
fn row_label(case: &Scored) -> String {
    match case.answer.hidden {
        Hidden::Nothing => "(nothing)".to_owned(),
        Hidden::Parameters => "(parameters)".to_owned(),
        Hidden::Two => "(two)".to_owned(),
        Hidden::Outside => format!("({})", case.answer.laws.concat()),
        Hidden::One => case.answer.kinds.concat(),
    }
}

/// What a verdict said, in a few words.
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

const KIND_HEAD: [&str; 9] = [
    "hidden",
    "cases",
    "exact",
    "family",
    "set",
    "wrong, full",
    "wrong, part",
    "silent",
    "other answers than the exact name",
];

/// One line for each kind: counts of what was answered.
fn kind_rows(scored: &[Scored]) -> Vec<[String; 9]> {
    let special = [
        "(two)",
        "(nothing)",
        "(parameters)",
        "(dwell_stiction)",
        "(pulsating_stiffness)",
        "(random_force)",
    ];
    kinds()
        .into_iter()
        .chain(special)
        .filter_map(|label| {
            let cases: Vec<&Scored> = scored
                .iter()
                .filter(|case| row_label(case) == label)
                .collect();
            if cases.is_empty() {
                return None;
            }
            let grades = Grades::of(&cases);
            let has_name = !label.starts_with('(') || label == "(two)";
            let count = |rate: Rate, counts: bool| {
                if counts {
                    rate.hits.to_string()
                } else {
                    String::new()
                }
            };
            let others = cases.iter().filter(|case| case.grade != Grade::Exact);
            Some([
                label.to_owned(),
                cases.len().to_string(),
                count(grades.exact, has_name),
                count(grades.family, has_name),
                count(grades.set, has_name),
                count(grades.wrong_full, true),
                count(grades.wrong_part, true),
                count(grades.silent, true),
                counted(others.map(|case| answer_label(case))),
            ])
        })
        .collect()
}

/// How many effects could not be drawn as large as is asked for.
fn faint(scored: &[Scored]) -> String {
    let cases = scored.iter().map(|case| &case.answer);
    too_faint(cases.map(|answer| (answer.case.as_str(), answer.visible)))
}

/// A line for each case without a verdict: why.
fn refusals(scored: &[Scored]) -> Vec<String> {
    scored
        .iter()
        .filter_map(|case| {
            let reason = case.refused.as_deref()?;
            // The path before the file's name says nothing.
            let reason = reason.rsplit_once("recordings/").map_or(reason, |it| it.1);
            Some(format!("{} was refused: {reason}", case.answer.case))
        })
        .collect()
}

/// The tables for a terminal.
pub fn terminal(scored: &[Scored]) -> String {
    let mut text = String::from("\nbench set\n\n");
    let mut table = vec![KIND_HEAD.map(str::to_owned).to_vec()];
    table.extend(kind_rows(scored).into_iter().map(Vec::from));
    text += &aligned(&table);
    let _ = writeln!(text, "\n  {}", faint(scored));
    for line in refusals(scored) {
        let _ = writeln!(text, "  {line}");
    }
    text.push('\n');
    let table: Vec<Vec<String>> = rows(&Figures::of(scored))
        .into_iter()
        .map(|(label, figure)| vec![label, figure])
        .collect();
    text += &aligned(&table);
    text
}

/// The section of the documentation, with its heading.
pub fn section(scored: &[Scored], command: &str, tool: &str) -> String {
    let mut text = format!(
        "{HEADING}\n\n{DESCRIPTION}\n```\n{command}\n```\n\nSources of the tool: {tool}.\n\n| | |\n|---|---|\n"
    );
    for (label, figure) in rows(&Figures::of(scored)) {
        let _ = writeln!(text, "| {label} | {figure} |");
    }
    text.push('\n');
    text += &markdown_table(KIND_HEAD, &kind_rows(scored));
    let _ = writeln!(text, "\n{}.", faint(scored));
    for line in refusals(scored) {
        let _ = writeln!(text, "\n{line}.");
    }
    text
}

/// The page with its other sections as they are and this one at its end.
pub fn with_section(page: &str, section: &str) -> String {
    format!("{}\n\n{section}", other_sections(page).trim_end())
}

/// What of the page is not of this set.
pub fn other_sections(page: &str) -> &str {
    page.find(HEADING).map_or(page, |at| &page[..at])
}

/// The section of this set in a page.
pub fn own_section(page: &str) -> Option<&str> {
    page.find(HEADING).map(|at| &page[at..])
}

/// A line for each case.
pub fn csv(scored: &[Scored]) -> String {
    let mut text = String::from(
        "case,rig,cut,hidden,kinds,laws,misfit_over_noise,partner_over_noise,visible,noise_deg,coloured_misfit_deg,rate_hz,samples,verdict,strength,family,named,answer_set,repair,grade,held_out_repaired_over_refit,seconds,cpu_seconds\n",
    );
    for case in scored {
        let (answer, said) = (&case.answer, &case.said);
        let open: Vec<String> = said.answer_set.iter().map(|set| set.join("+")).collect();
        let hidden = format!("{:?}", answer.hidden).to_lowercase();
        let grade = match case.grade {
            Grade::Wrong(Strength::Full) => "wrong".to_owned(),
            Grade::Wrong(Strength::Part) => "wrong_part".to_owned(),
            Grade::OneOfTwo => "one_of_two".to_owned(),
            grade => format!("{grade:?}").to_lowercase(),
        };
        let strength = match Strength::of(said) {
            _ if said.named.is_empty() => "",
            Strength::Full => "full",
            Strength::Part => "part",
        };
        let fields = [
            answer.case.clone(),
            answer.rig.name().to_owned(),
            answer.cut.to_string(),
            hidden,
            answer.kinds.join("+"),
            answer.laws.join("+"),
            format!("{:.3}", answer.misfit_over_noise),
            number(answer.partner_over_noise, 3),
            answer.visible.to_string(),
            format!("{:.3}", answer.instruments.angle_noise.to_degrees()),
            format!("{:.3}", answer.coloured_misfit.to_degrees()),
            format!("{}", answer.instruments.rate_hz),
            answer.samples.to_string(),
            said.verdict.clone(),
            strength.to_owned(),
            said.family.clone().unwrap_or_default(),
            said.named.join("+"),
            open.join(" "),
            said.repair.clone().unwrap_or_default().replace(", ", "+"),
            grade,
            number(said.held_out, 4),
            format!("{:.2}", case.seconds),
            number(case.cpu_seconds, 2),
        ];
        let _ = writeln!(text, "{}", fields.join(","));
    }
    text
}
