//! The summary on the terminal: the content of the report in some twenty lines.

use super::Outputs;
use super::content::{Content, Notice, ParameterRow, Rival};
use softrig::diagnose::decide::verdict::Answer;

/// Largest number of lines: one screen.
const LINES: usize = 25;

/// The hint if nothing was written.
pub const KEEP: &str = "Add --report report.html or -o repaired.toml to keep the result.";

/// The summary; `seed` and `seconds` are in its last line.
pub fn summary(content: &Content, outputs: &Outputs<'_>, seed: u64, seconds: f64) -> String {
    let mut lines = vec![content.sentence.clone()];
    lines.extend(content.ended.clone());
    lines.push(String::new());
    lines.extend(errors(content));
    lines.extend(content.tested.clone());
    let table = lines.len();
    lines.extend(content.closed.clone());
    lines.push(String::new());
    for effect in &content.effects {
        lines.push(format!(
            "{}: {}   ({})",
            effect.kind,
            effect.equation,
            effect.standing()
        ));
        lines.extend(effect.parameters.iter().map(parameter));
        lines.extend(effect.alike.iter().map(|sentence| format!("  {sentence}")));
    }
    let base = content.base.iter();
    let changed: Vec<&ParameterRow> = base.filter(|row| row.changed).collect();
    if !changed.is_empty() {
        lines.push(base_title(content.answer).into());
        lines.extend(changed.into_iter().map(parameter));
    }
    if !content.zeros.is_empty() {
        lines.push(content.zeros.clone());
    }
    lines.extend(content.undetermined.iter().map(|text| format!("  {text}.")));
    lines.push(String::new());
    if content.something_is_missing() {
        lines.extend(evidence(content));
    }
    lines.extend(content.refused.clone());
    lines.extend(written(content, outputs));
    lines.push(format!("{seconds:.1} s, seed {seed}"));
    let left_out = left_out(&content.left_out);
    let room = LINES.saturating_sub(lines.len() + left_out.len());
    let notes = notes(&content.notices, room);
    lines.splice(table..table, left_out.into_iter().chain(notes));
    lines.join("\n") + "\n"
}

/// What was left out of the files: the first sentences.
fn left_out(sentences: &[String]) -> Vec<String> {
    const SHOWN: usize = 6;
    if sentences.is_empty() {
        return Vec::new();
    }
    let mut lines = vec!["What was left out:".to_owned()];
    lines.extend(sentences.iter().take(SHOWN).map(|it| format!("  {it}.")));
    let more = sentences.len().saturating_sub(SHOWN);
    if more > 0 {
        lines.push(format!("  {more} more on the page of --report."));
    }
    lines
}

/// Notices about the recordings, in at most `room` lines, but at least two.
fn notes(notices: &[Notice], room: usize) -> Vec<String> {
    let room = room.max(2);
    let shown = if notices.len() > room {
        room - 1
    } else {
        notices.len()
    };
    let line = |notice: &Notice| {
        let about = notice
            .about
            .as_ref()
            .map_or_else(String::new, |name| format!("{name}: "));
        format!("Note: {about}{}; {}.", notice.text, notice.advice)
    };
    let mut lines: Vec<String> = notices[..shown].iter().map(line).collect();
    let more = notices.len() - shown;
    if more > 0 {
        lines.push(format!("{more} more notes on the page of --report."));
    }
    lines
}

/// A parameter, before and after, with its unit and interval.
fn parameter(row: &ParameterRow) -> String {
    let nominal = row
        .nominal
        .as_ref()
        .map_or_else(String::new, |nominal| format!("{nominal} → "));
    let unit = if row.unit.is_empty() {
        String::new()
    } else {
        format!(" {}", row.unit)
    };
    let certainty = row.certainty();
    format!(
        "  {} = {nominal}{}{unit} [{certainty}]",
        row.name, row.value
    )
}

/// The title of the base parameters.
fn base_title(answer: Answer) -> &'static str {
    if answer == Answer::NoDiscrepancy {
        "Base parameters, kept → refitted:"
    } else {
        "Base parameters, nominal → fitted:"
    }
}

/// The table: nominal, refit and, where something is added, repaired on fitted
/// and on held-out runs.
fn errors(content: &Content) -> Vec<String> {
    let line = |cells: [&str; 6]| {
        let [name, runs, nominal, refit, repaired, floor] = cells;
        let repaired = if content.repaired {
            format!("{repaired:>16} ")
        } else {
            String::new()
        };
        format!("{name:<20} {runs:>4} {nominal:>16} {refit:>16} {repaired}{floor:>8}")
    };
    let title = format!("RMS error ({}), fit", content.unit);
    let head = line([&title, "runs", "nominal", "refitted", "repaired", "noise"]);
    let rows = content.errors.iter().map(|row| {
        let [nominal, refit, repaired] = &row.fits;
        let with_fit = |error: &str, fit: &str| format!("{error}, {fit}");
        line([
            row.name,
            &row.runs.to_string(),
            &with_fit(&row.nominal, nominal),
            &with_fit(&row.refit, refit),
            &with_fit(&row.repaired, repaired),
            &row.floor,
        ])
    });
    std::iter::once(head).chain(rows).collect()
}

/// The missing force, the rivals, and the next experiment.
fn evidence(content: &Content) -> Vec<String> {
    let mut lines = Vec::new();
    if !content.gap.is_empty() {
        lines.push(format!("Where the gap lives: {}", content.gap.join(" ")));
    }
    if !content.steps.is_empty() {
        lines.push(format!(
            "Step by step, refitted: {}.",
            content.steps.join("; ")
        ));
    }
    let rivals: Vec<String> = content.rivals.iter().map(rival).collect();
    if !rivals.is_empty() {
        lines.push(format!("{}: {}", content.rivals_title(), rivals.join("; ")));
    }
    lines.extend(next(content));
    lines.extend(content.changes.iter().cloned());
    lines.extend(content.untried.iter().map(|untried| {
        format!(
            "Not tried: {}, because {}",
            untried.kinds.join(", "),
            untried.reason
        )
    }));
    lines
}

fn rival(rival: &Rival) -> String {
    let name = &rival.name;
    match (&rival.probability, &rival.closed) {
        (Some(probability), _) => {
            format!(
                "{name} (probability {probability}, ΔBIC {})",
                rival.delta_bic
            )
        }
        (None, Some(closed)) => format!("{name} (explains {closed} over three horizons)"),
        (None, None) => name.clone(),
    }
}

/// The run to do next, or that there is none.
fn next(content: &Content) -> Option<String> {
    let Some(run) = content.next.first() else {
        let none = content.answer == Answer::CannotTell && content.ended.is_none();
        return none.then(|| {
            "Next experiment: none that the board can make; a different measurement is needed."
                .into()
        });
    };
    let [a, b] = &run.separates;
    let run_is = format!(
        "{}{} ({}), {} s",
        run.before, run.protocol, run.title, run.seconds
    );
    Some(if content.next_suffices {
        format!(
            "Next experiment: {run_is}; it separates {a} from {b} by about {} in χ².",
            run.evidence
        )
    } else {
        format!(
            "Next experiment: a different measurement. The best run, {run_is}, separates {a} \
             from {b} by no more than {} in χ².",
            run.evidence
        )
    })
}

/// The written files.
fn written(content: &Content, outputs: &Outputs<'_>) -> Vec<String> {
    let model = match content.answer {
        _ if outputs.named_only => "Refitted model, without any effect",
        _ if content.is_unchanged() => "Model, unchanged",
        Answer::EffectFound => "Repaired model",
        _ if content.repaired => "Repaired model (unnamed)",
        _ => "Refitted model",
    };
    let lines: Vec<String> = [
        ("Report", outputs.page),
        ("Picture", outputs.picture),
        (model, outputs.model),
        ("Verdict", outputs.verdict),
    ]
    .into_iter()
    .filter_map(|(what, path)| path.map(|path| format!("{what}: {}", path.display())))
    .collect();
    if lines.is_empty() {
        vec![KEEP.into()]
    } else {
        lines
    }
}
