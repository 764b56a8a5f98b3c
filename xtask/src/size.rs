//! Size and load of the image, compared with budgets and with the golden file.
//!
//! Flash, static memory and the bound of the stack come from the image, the deepest stack and
//! processor time from a run on the simulated rig, which is exact to the cycle. Exceeding a budget
//! always fails. A changed figure may be correct, but must not go unnoticed: it fails too, until
//! the golden file is updated. So are the cycles of the model's steps, counted in the self-test. The
//! tables of `docs/benchmarks.md` are written from that file.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    avr, bench,
    shell::{Outcome, read, root},
    stack,
};

/// A figure: its name in the golden file, what it is, in a few words and as the documentation
/// says it, the most that it may be, and how far it may move unnoticed.
struct Measure {
    name: &'static str,
    title: &'static str,
    in_full: &'static str,
    unit: &'static str,
    budget: f64,
    tolerance: f64,
}

const RAM_BYTES: f64 = 8_192.0;

const ROWS: [Measure; 7] = [
    Measure {
        name: "flash_bytes",
        title: "flash",
        in_full: "flash",
        unit: "bytes",
        // Below 128 KiB every function is in reach of a 16-bit word address, so that calls of
        // computed addresses would need no trampolines. What the watches of safety need counts.
        budget: 124.0 * 1024.0,
        tolerance: 1_024.0,
    },
    Measure {
        name: "static_ram_bytes",
        title: "static RAM",
        in_full: "static RAM",
        unit: "bytes",
        // With the stack's 1 984 bytes 7 104 of 8 192; a tenth of either is free.
        budget: 5_120.0,
        tolerance: 32.0,
    },
    Measure {
        name: "stack_bytes",
        title: "stack, deepest",
        in_full: "stack, at its deepest",
        unit: "bytes",
        budget: 1_984.0,
        tolerance: 128.0,
    },
    Measure {
        name: "stack_bound_bytes",
        title: "stack, bound",
        in_full: "stack, as deep as any path through the code could make it",
        unit: "bytes",
        budget: 1_984.0,
        tolerance: 128.0,
    },
    Measure {
        name: "cpu_at_rest_percent",
        title: "processor at rest",
        in_full: "processor at rest: 100 Hz control, telemetry, prediction",
        unit: "%",
        budget: 25.0,
        tolerance: 1.0,
    },
    Measure {
        name: "cpu_in_a_run_percent",
        title: "processor, pump at full flow",
        in_full: "processor in a run, pump at full flow, 14 300 steps/s",
        unit: "%",
        budget: 53.0,
        tolerance: 2.0,
    },
    Measure {
        name: "cpu_in_a_run_with_the_dearest_model_percent",
        title: "… with the dearest model",
        in_full: "… with the three most expensive effects, at the largest number of steps",
        unit: "%",
        budget: 60.0,
        tolerance: 2.0,
    },
];

/// Whether to compare with the golden file or write it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Golden {
    /// Compare with it.
    Check,
    /// Write it.
    Accept,
}

/// Measures the image in a simulator, and compares.
pub fn size(image: &Path, golden: Golden, simulator: &Path) -> Outcome {
    let mut figures = measure(image, simulator)?;
    let avr::Size { flash, static_ram } = avr::size(image)?;
    figures.push(("flash_bytes".into(), flash as f64));
    figures.push(("static_ram_bytes".into(), static_ram as f64));
    let bound = stack::bound(&avr::disassembly(image)?)?;
    figures.push(("stack_bound_bytes".into(), bound.bytes as f64));
    figures.extend(bench::sections(image, simulator)?.figures);
    let path = golden_path();
    if golden == Golden::Accept {
        write(&path, &golden_text(&figures))?;
        let document = document_path();
        let text = fs::read_to_string(&document)
            .map_err(|error| format!("cannot read {}: {error}", document.display()))?;
        write(&document, &with_tables(&text, &figures)?)?;
    }
    let before = parse(&fs::read_to_string(&path).unwrap_or_default());
    let (report, wrong) = compare(&figures, &before);
    print!("{report}");
    println!("  the deepest path:");
    for (function, bytes) in &bound.path {
        println!("  {bytes:>6} {function}");
    }
    if let (Some(fixed), Some(stack)) = (
        value(&figures, "static_ram_bytes"),
        value(&figures, "stack_bound_bytes"),
    ) {
        println!("  RAM never used {:>18} bytes", RAM_BYTES - fixed - stack);
    }
    if wrong.is_empty() {
        Ok(())
    } else {
        Err(wrong.join("\n").into())
    }
}

fn write(path: &Path, text: &str) -> Outcome {
    fs::write(path, text)
        .map_err(|error| format!("cannot write {}: {error}", path.display()).into())
}

/// Where people read the figures.
fn document_path() -> PathBuf {
    root().join("docs/benchmarks.md")
}

/// The first line of the document's table.
const TABLE_HEAD: &str = "| what the image takes | now | budget |";

/// The document's table.
fn document_table(figures: &[(String, f64)]) -> String {
    let mut table = format!("{TABLE_HEAD}\n|---|---:|---:|\n");
    for row in &ROWS {
        if let Some(now) = value(figures, row.name) {
            let [now, budget] = [now, row.budget].map(|number| with_unit(number, row.unit));
            table.push_str(&format!("| {} | {now} | {budget} |\n", row.in_full));
        }
    }
    table
}

/// How cycles of the image's sections begin in the golden file, and those of the sketch in C.
pub const CYCLES: &str = "cycles_";
/// See [`CYCLES`].
pub const C_CYCLES: &str = "c_cycles_";

/// A section of the base model, as the golden file and the documentation call it.
const SECTIONS: [(&str, &str); 5] = [
    ("power_minimax", "one power, minimax"),
    ("power_micromath", "one power, guarded micromath"),
    ("step_micromath", "one step, power by micromath"),
    ("step_minimax", "one step, power by minimax"),
    ("step_table", "**one step, power by table**"),
];

/// The section of a step with an effect begins so.
const WITH_EFFECT: &str = "step_table+";

/// Share of its cycles by which a section may move unnoticed.
const CYCLES_TOLERANCE: f64 = 0.02;

/// The first line of the document's table of cycles.
const CYCLES_HEAD: &str = "| on the ATmega2560 | cycles | of plain C |";

/// The document's table of cycles.
pub fn cycles_table(figures: &[(String, f64)]) -> String {
    let of = |prefix: &str, name: &str| value(figures, &format!("{prefix}{name}"));
    let mut table = format!("{CYCLES_HEAD}\n|---|---:|---:|\n");
    let mut row = |title: &str, name: &str, prefix: &str| {
        let rival = if name.starts_with("power") {
            "power_minimax"
        } else {
            "step_minimax"
        };
        if let (Some(cycles), Some(rival)) = (of(prefix, name), of(C_CYCLES, rival)) {
            let share = 100.0 * cycles / rival;
            let cycles = with_unit(cycles, "");
            table.push_str(&format!("| {title} | {} | {share:.0} % |\n", cycles.trim()));
        }
    };
    for (name, title) in SECTIONS {
        row(title, name, CYCLES);
    }
    let mut effects: Vec<(&str, f64)> = figures
        .iter()
        .filter_map(|(name, cycles)| {
            let name = name.strip_prefix(CYCLES)?.strip_prefix(WITH_EFFECT)?;
            Some((name, *cycles))
        })
        .collect();
    effects.sort_by(|a, b| a.1.total_cmp(&b.1));
    for (effect, _) in effects {
        let title = format!("… with `{effect}`");
        row(&title, &format!("{WITH_EFFECT}{effect}"), CYCLES);
    }
    row(
        "… with the three most expensive together",
        "step_dearest",
        CYCLES,
    );
    row("plain C: one power (`pow`)", "power_minimax", C_CYCLES);
    row(
        "plain C: one RK4 step, no effects",
        "step_minimax",
        C_CYCLES,
    );
    table
}

/// A number with its unit, thousands apart.
fn with_unit(number: f64, unit: &str) -> String {
    let mut text = number.to_string();
    let end = text.find('.').unwrap_or(text.len());
    if end > 3 {
        text.insert(end - 3, ' ');
    }
    format!("{text} {unit}")
}

/// The document with the tables of these figures in the places of those that it has.
fn with_tables(document: &str, figures: &[(String, f64)]) -> Outcome<String> {
    let mut document = document.to_owned();
    for (head, table) in [
        (TABLE_HEAD, document_table(figures)),
        (CYCLES_HEAD, cycles_table(figures)),
    ] {
        document = with_table(&document, head, &table).ok_or_else(|| {
            format!(
                "{} has no table that begins with `{head}`",
                document_path().display()
            )
        })?;
    }
    Ok(document)
}

/// The document with this table in the place of the one that begins so.
fn with_table(document: &str, head: &str, table: &str) -> Option<String> {
    let (before, rest) = document.split_once(head)?;
    let (_, after) = rest.split_once("\n\n")?;
    Some(format!("{before}{table}\n{after}"))
}

fn golden_path() -> PathBuf {
    root().join("firmware/size.txt")
}

/// Runs the image through its paces.
fn measure(image: &Path, simulator: &Path) -> Outcome<Vec<(String, f64)>> {
    let said = read(Command::new(simulator).arg("measure").arg(image))?;
    let figures = parse(&said);
    if value(&figures, "resets") != Some(0.0) {
        return Err("the board was reset while it was measured".into());
    }
    // A line may lie across either end of the ten seconds.
    let lines = value(&figures, "telemetry_lines_in_10_s");
    if !lines.is_some_and(|lines| (999.0..=1_001.0).contains(&lines)) {
        return Err("the board did not send its hundred lines a second".into());
    }
    Ok(figures)
}

/// Reads `NAME VALUE` lines; what begins with `#` is a remark.
fn parse(text: &str) -> Vec<(String, f64)> {
    text.lines()
        .filter(|line| !line.starts_with('#'))
        .filter_map(|line| {
            let (name, value) = line.split_once(' ')?;
            Some((name.to_owned(), value.trim().parse().ok()?))
        })
        .collect()
}

fn value(figures: &[(String, f64)], name: &str) -> Option<f64> {
    figures.iter().find(|(n, _)| n == name).map(|&(_, v)| v)
}

fn golden_text(figures: &[(String, f64)]) -> String {
    let mut text =
        String::from("# What the image takes; `cargo xtask size --accept` writes this.\n");
    for row in &ROWS {
        if let Some(value) = value(figures, row.name) {
            text.push_str(&format!("{} {value}\n", row.name));
        }
    }
    for (name, cycles) in figures.iter().filter(|(name, _)| is_cycles(name)) {
        text.push_str(&format!("{name} {cycles}\n"));
    }
    text
}

fn is_cycles(name: &str) -> bool {
    name.starts_with(CYCLES) || name.starts_with(C_CYCLES)
}

/// The table, and what is wrong with it.
fn compare(figures: &[(String, f64)], before: &[(String, f64)]) -> (String, Vec<String>) {
    let mut report = format!(
        "  {:<30}{:>9}{:>9}{:>11}{:>10}\n",
        "", "now", "budget", "headroom", "before"
    );
    let mut wrong = Vec::new();
    for row in &ROWS {
        let Some(now) = value(figures, row.name) else {
            wrong.push(format!("{} was not measured", row.title));
            continue;
        };
        let last = value(before, row.name);
        report.push_str(&format!(
            "  {:<30}{now:>9}{:>9}{:>10.0}%{:>10}  {}\n",
            row.title,
            row.budget,
            100.0 * (1.0 - now / row.budget),
            last.map_or("–".into(), |last| last.to_string()),
            row.unit,
        ));
        if now > row.budget {
            wrong.push(format!(
                "{}: {now} {} exceed the budget of {}",
                row.title, row.unit, row.budget
            ));
        }
        match last {
            Some(last) if (now - last).abs() <= row.tolerance => {}
            Some(last) => wrong.push(format!(
                "{}: {now} {}, {last} before; more than {} apart. If that is meant, \
                 `cargo xtask size --accept` and commit firmware/size.txt",
                row.title, row.unit, row.tolerance
            )),
            None => wrong.push(format!(
                "{}: not in firmware/size.txt; `cargo xtask size --accept` writes it",
                row.title
            )),
        }
    }
    for (name, now) in figures.iter().filter(|(name, _)| is_cycles(name)) {
        let last = value(before, name);
        if last.is_none_or(|last| (now - last).abs() > CYCLES_TOLERANCE * last) {
            let last = last.map_or("none".into(), |last| last.to_string());
            wrong.push(format!(
                "{name}: {now}, {last} before. If that is meant, `cargo xtask size --accept` and \
                 commit firmware/size.txt"
            ));
        }
    }
    (report, wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(flash: f64) -> Vec<(String, f64)> {
        ROWS.iter()
            .map(|row| {
                let value = if row.name == "flash_bytes" {
                    flash
                } else {
                    row.budget / 2.0
                };
                (row.name.to_owned(), value)
            })
            .collect()
    }

    #[test]
    fn what_was_accepted_passes() {
        let now = figures(80_000.0);
        let golden = parse(&golden_text(&now));
        assert_eq!(golden.len(), ROWS.len());
        assert!(compare(&now, &golden).1.is_empty());
        assert!(compare(&figures(80_900.0), &golden).1.is_empty());
    }

    #[test]
    fn the_document_shows_the_golden_file() {
        let document = fs::read_to_string(document_path()).unwrap();
        let golden = parse(&fs::read_to_string(golden_path()).unwrap());
        let updated = with_tables(&document, &golden).unwrap();
        assert_eq!(document, updated, "`cargo xtask size --accept` writes it");
    }

    /// The page has no figure of a section that was not measured, and none is missing.
    #[test]
    fn the_table_of_cycles_has_every_section_once() {
        let golden = parse(&fs::read_to_string(golden_path()).unwrap());
        let sections = golden.iter().filter(|(name, _)| is_cycles(name)).count();
        // What a call costs by itself is in none of the rows.
        let without = golden
            .iter()
            .filter(|(name, _)| name.ends_with("_nothing"))
            .count();
        let rows = cycles_table(&golden).lines().count() - 2;
        assert!(
            rows >= 30 && rows + without >= sections,
            "{rows} of {sections}"
        );
    }

    #[test]
    fn a_step_that_takes_longer_is_told() {
        let golden = vec![("cycles_step_table".to_owned(), 1_058.0)];
        let told = |now: f64| {
            let figures = [("cycles_step_table".to_owned(), now)];
            compare(&figures, &golden)
                .1
                .iter()
                .any(|it| it.contains("cycles_step_table"))
        };
        assert!(!told(1_060.0) && told(1_100.0) && told(1_000.0));
    }

    #[test]
    fn a_move_and_a_broken_budget_are_told() {
        let golden = figures(80_000.0);
        let moved = compare(&figures(82_000.0), &golden).1;
        assert!(moved.len() == 1 && moved[0].contains("--accept"));
        let smaller = compare(&figures(70_000.0), &golden).1;
        assert_eq!(smaller.len(), 1);
        let too_large = figures(ROWS[0].budget + 1.0);
        let wrong = compare(&too_large, &too_large).1;
        assert!(wrong.len() == 1 && wrong[0].contains("budget"));
        assert_eq!(compare(&golden, &[]).1.len(), ROWS.len());
    }
}
