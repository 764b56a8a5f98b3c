//! The table, and the page of the documentation.

use std::fmt::Write as _;

use super::results::{BlackBox, BlackBoxes};
use super::{COMMAND, RigResult};
use softrig_tests::verdict::{Verdict, significant};

/// Headings of the table.
const HEADINGS: [&str; 13] = [
    "rig",
    "known or published",
    "answer",
    "closure",
    "nominal",
    "refit",
    "repaired",
    "repaired / refit",
    "ARX",
    "NARX",
    "NARX, free initial state",
    "diagnosis, s (CPU)",
    "ARX + NARX, s (CPU)",
];

/// Errors that differ by less than this share are those of one model.
const SAME: f64 = 1e-3;

/// Columns of text; the others are numbers.
const TEXT_COLUMNS: usize = 3;

impl RigResult {
    /// The cells of the table's row.
    fn cells(&self) -> [String; HEADINGS.len()] {
        let number = |value: Option<f64>| value.map_or("–".into(), significant);
        let control = if self.rig.known.control {
            " (control)"
        } else {
            ""
        };
        let mut cells = [const { String::new() }; HEADINGS.len()];
        cells[0] = format!("{}{control}", self.rig.name);
        cells[1].clone_from(&self.rig.page.known);
        match &self.diagnosis {
            Ok((diagnosed, seconds)) => {
                cells[2] = diagnosed.in_a_cell();
                cells[3] = percent(diagnosed.closed());
                cells[4] = number(diagnosed.holdout_rmse_deg.nominal);
                cells[5] = number(diagnosed.holdout_rmse_deg.refit);
                cells[6] = number(diagnosed.holdout_rmse_deg.repaired);
                cells[7] = number(diagnosed.ratio());
                cells[11] = seconds.words();
            }
            Err(why) => cells[2] = format!("failed: {}", one_cell(why)),
        }
        match &self.black_boxes {
            Ok(BlackBoxes { arx, narx, .. }) => {
                cells[8] = free_run(arx);
                cells[9] = free_run(narx);
                cells[10] = number(narx.with_freedom);
                cells[12] = format!("{} + {}", arx.seconds.words(), narx.seconds.words());
            }
            Err(why) => cells[8] = format!("failed: {}", one_cell(why)),
        }
        cells
    }
}

fn free_run(model: &BlackBox) -> String {
    model.rms().map_or("diverges".into(), significant)
}

fn percent(share: Option<f64>) -> String {
    // Adding zero turns −0 into 0.
    share.map_or("–".into(), |share| {
        format!("{:.0} %", (100.0 * share).round() + 0.0)
    })
}

/// One line, and nothing that ends a cell of the table.
fn one_cell(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    text.replace('|', "/").chars().take(160).collect()
}

/// The table for a terminal.
pub(super) fn plain_table(rows: &[RigResult]) -> String {
    let mut lines = vec![HEADINGS.map(str::to_owned)];
    lines.extend(rows.iter().map(RigResult::cells));
    let width = |column: usize| {
        let widths = lines.iter().map(|cells| cells[column].chars().count());
        widths.max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..HEADINGS.len()).map(width).collect();
    let mut text = String::new();
    for cells in &lines {
        let mut line = String::new();
        for (column, (cell, &width)) in cells.iter().zip(&widths).enumerate() {
            let _ = if column < TEXT_COLUMNS {
                write!(line, "{cell:<width$}  ")
            } else {
                write!(line, "{cell:>width$}  ")
            };
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}

/// The table in Markdown.
fn markdown_table(rows: &[RigResult]) -> String {
    let mut text = format!("| {} |\n|", HEADINGS.join(" | "));
    for column in 0..HEADINGS.len() {
        text += if column < TEXT_COLUMNS {
            "---|"
        } else {
            "---:|"
        };
    }
    text.push('\n');
    for row in rows {
        let mut cells = row.cells();
        cells[0] = cells[0].replacen(
            &row.rig.name,
            &format!("[{}](#{})", row.rig.name, anchor(&row.rig.page.title)),
            1,
        );
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
    text
}

/// The link to a heading, as GitHub makes it.
fn anchor(title: &str) -> String {
    let kept = title
        .chars()
        .filter(|c| c.is_alphanumeric() || " -".contains(*c));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

/// The summary of the rows.
pub(super) fn summary(rows: &[RigResult]) -> String {
    let count = |control: bool, holds: fn(&Verdict) -> bool| {
        let rows = || {
            rows.iter()
                .filter(move |row| row.rig.known.control == control)
        };
        let counted = rows().filter(|row| {
            let diagnosed = row.diagnosis.as_ref();
            diagnosed.is_ok_and(|(diagnosed, _)| holds(diagnosed))
        });
        format!("{} of {}", counted.count(), rows().count())
    };
    // Repaired model and best black box that is allowed as much.
    let pairs: Vec<(f64, f64)> = rows
        .iter()
        .filter_map(|row| {
            let repaired = row.diagnosis.as_ref().ok()?.0.holdout_rmse_deg.repaired?;
            let BlackBoxes { arx, narx, .. } = row.black_boxes.as_ref().ok()?;
            let errors = |model: &BlackBox| [model.rms(), model.with_freedom];
            let errors = [errors(arx), errors(narx)].concat().into_iter().flatten();
            Some((repaired, errors.fold(f64::INFINITY, f64::min)))
        })
        .collect();
    let better = pairs.iter().filter(|(ours, theirs)| ours <= theirs).count();
    format!(
        "An effect or a family is named for {} rigs with something known and for {} controls;\n\
         {} controls are diagnosed without a discrepancy. The model that `-o` writes predicts at\n\
         least as well as the best of the black boxes, chosen with hindsight and with or without\n\
         a free initial state, on {better} of {}.",
        count(false, Verdict::names_something),
        count(true, Verdict::names_something),
        count(true, Verdict::lacks_nothing),
        pairs.len()
    )
}

const INTRODUCTION: &str = "\
Eight rigs that others recorded; most of them are not soft actuators. The benchmark asks two
questions. Does `softrig diagnose` find in unknown hardware what its authors report? And does the
model that it writes predict the validation recordings? The recordings are not part of this
repository. They are read from `data/real` in the folder `../shared`, or in the folder that
`SOFTRIG_SHARED` names. The output files of a run are in `target/real/NAME`.

Each rig is diagnosed with the linear model that one would write down first. In a *control*
little or nothing is missing, and naming an effect is an error.
";

const READING: &str = "\
- **nominal, refit, repaired**: RMS error on the validation recordings, in the unit of the
  column `angle_deg`, which is not a degree for every rig (see the axis of each picture). They
  come from the JSON of `softrig diagnose`. Without a repair, the repaired model is the refit.
- **closure**: the share of the gap that the repair explains (`closure.overall` of the JSON,
  where that is there, else `adequacy.holdout_gap_closed`).
- **ARX, NARX**: black boxes on the same split (`bench/black_box/black_box.py`). ARX has up to
  six past outputs and inputs, chosen by the BIC of the one-step error; NARX is a polynomial
  of degree up to three, with its terms chosen by forward selection and cross-validation on
  the free-run error, and refined on that error. Both are judged by free-run simulation from
  measured initial samples, as many as the model's order. They contain no physics, and name none.
- **NARX, free initial state**: `softrig` estimates the zeros of both sensors and the initial state on each
  validation recording. The black boxes of the other columns start from noisy samples instead.
  In this column NARX gets the same zeros with the same priors, and a free initial angle and rate.
- `softrig` leaves out samples at which a sensor is at the end of its range; the black boxes are
  judged at every sample. For the black boxes, recordings of several sampling rates are resampled
  to the slowest fitted one, and may be decimated further by two or four. Their errors are still
  computed at the times of the recorded samples.
- **diagnosis, ARX + NARX, s (CPU)**: wall-clock seconds, and processor seconds in brackets, of the diagnosis
  and of choosing, fitting and judging each black box, on the machine that wrote this page.
- Each picture shows the validation run on which the refit misses most.
";

/// The page of the documentation.
pub(super) fn page(rows: &[RigResult]) -> String {
    let mut text = format!(
        "# Real rigs\n\nWritten by `{COMMAND}`; do not edit.\n\n{INTRODUCTION}\n{}\n\n{}\n{READING}",
        summary(rows),
        markdown_table(rows),
    );
    for row in rows {
        let _ = write!(text, "\n{}", section(row));
    }
    text
}

fn section(row: &RigResult) -> String {
    let rig = &row.rig;
    let about = &rig.page;
    let control = if rig.known.control {
        " This is a control."
    } else {
        ""
    };
    let mut text = format!(
        "## {}\n\n{}{control} Source: [{}]({}), {}.\n\n",
        about.title, about.about, about.source, about.link, about.licence
    );
    let number = |value: Option<f64>| value.map_or("–".into(), significant);
    match &row.diagnosis {
        Ok((diagnosed, _)) => {
            let _ = write!(
                text,
                "The diagnosis: {} On the validation recordings the refit misses by {}",
                diagnosed.report(),
                number(diagnosed.holdout_rmse_deg.refit)
            );
            text += &if diagnosed
                .ratio()
                .is_some_and(|ratio| (ratio - 1.0).abs() < SAME)
            {
                ", and there is no repair.".to_owned()
            } else {
                format!(
                    ", the repaired model by {}.",
                    number(diagnosed.holdout_rmse_deg.repaired)
                )
            };
        }
        Err(why) => {
            let _ = write!(text, "The diagnosis failed: {}.", one_cell(why));
        }
    }
    if let Ok(BlackBoxes {
        arx,
        narx,
        sampled_alike,
    }) = &row.black_boxes
    {
        let _ = write!(text, " ARX: {}; NARX: {}.", arx.words(), narx.words());
        if !sampled_alike {
            text += " The recordings differ in their sampling rates.";
        }
    }
    text += "\n";
    if row.diagnosis.is_ok() {
        let _ = write!(
            text,
            "\n![{}: a validation run, measured and simulated](images/real_{}.svg)\n",
            about.title, rig.name
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::real::results::Seconds;
    use crate::real::rigs::all;

    fn rows() -> Vec<RigResult> {
        let mut rigs = all().unwrap();
        let verdict = r#"{"verdict": "effect_found", "effects": [{"kind": "gravity"}],
            "adequacy": {"holdout_gap_closed": 0.955},
            "holdout_rmse_deg": {"nominal": 4.0, "refit": 2.5, "repaired": 0.25}}"#;
        let seconds = Seconds {
            wall: 3.25,
            cpu: Some(6.0),
        };
        let black_box = |rms: Option<f64>, with_freedom: Option<f64>| -> BlackBox {
            serde_json::from_value(serde_json::json!({
                "diverges": rms.is_none(), "rms_deg": rms, "rms_with_freedom_deg": with_freedom,
                "output_lags": [1, 2], "input_lags": [0], "terms": 7, "degree": 3,
                "rate_hz": 50.0, "wall_s": 1.0,
            }))
            .unwrap()
        };
        vec![
            RigResult {
                rig: rigs.remove(0),
                diagnosis: Ok((Verdict::parse(verdict).unwrap(), seconds)),
                black_boxes: Ok(BlackBoxes {
                    arx: black_box(None, None),
                    narx: black_box(Some(0.5), Some(0.3)),
                    sampled_alike: false,
                }),
            },
            RigResult {
                rig: rigs.remove(6),
                diagnosis: Err("rig | took\ntoo long".into()),
                black_boxes: Err("no numpy".into()),
            },
        ]
    }

    #[test]
    fn the_table_shows_what_there_is() {
        let rows = rows();
        let cells = rows[0].cells();
        assert_eq!(
            cells[2..],
            [
                "gravity",
                "96 %",
                "4.00",
                "2.50",
                "0.250",
                "0.100",
                "diverges",
                "0.500",
                "0.300",
                "3.2 (6.0)",
                "1.0 (–) + 1.0 (–)"
            ]
        );
        let cells = rows[1].cells();
        assert_eq!(cells[0], "falling_bowling_ball (control)");
        assert_eq!(cells[2], "failed: rig / took too long");
        assert_eq!(cells[8], "failed: no numpy");
        let table = plain_table(&rows);
        assert_eq!(table.lines().count(), 3);
        let columns: Vec<usize> = table
            .lines()
            .filter_map(|line| line.find("gravity"))
            .collect();
        assert_eq!(columns.len(), 1);
    }

    #[test]
    fn the_summary_counts_names_and_wins() {
        let said = summary(&rows());
        assert!(
            said.contains("for 1 of 1 rigs with something known and for 0 of 1 controls"),
            "{said}"
        );
        assert!(said.ends_with("on 1 of 1."), "{said}");
    }

    #[test]
    fn the_page_has_a_row_and_a_section_a_rig() {
        let page = page(&rows());
        let table: Vec<&str> = page.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(table.len(), 4);
        let bars = |line: &&str| line.matches('|').count();
        assert!(
            table.iter().all(|line| bars(line) == HEADINGS.len() + 1),
            "{table:?}"
        );
        assert!(page.contains("| [pendulum](#pendulum) |"));
        assert!(page.contains("](images/real_pendulum.svg)"));
        assert!(!page.contains("](images/real_falling_bowling_ball.svg)"));
        assert_eq!(anchor("Torque-limited pendulum"), "torque-limited-pendulum");
    }
}
