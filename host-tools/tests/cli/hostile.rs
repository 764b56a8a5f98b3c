//! Names and texts that others chose, which a terminal would obey.

use assert_cmd::Command;

use super::common::{Bench, HEADER, MODEL, clean_recording};

/// A title for the window, a cleared screen, a colour, a line that overwrites itself, and one
/// that is read from the right: what a terminal obeys.
const HOSTILE: &str = "\u{1b}]0;title\u{7}\u{1b}[2J\u{9b}31m\rgpj.\u{202e}\u{2066}\u{7f}";

/// [`HOSTILE`] in the quotes of TOML.
fn hostile_toml() -> String {
    let escaped = |c: char| format!("\\U{:08x}", u32::from(c));
    HOSTILE.chars().map(escaped).collect()
}

/// Asserts that nothing that a terminal obeys was printed, and returns all that was.
pub fn harmless(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let mut said = String::from_utf8(output.stdout).unwrap();
    said += &String::from_utf8(output.stderr).unwrap();
    assert!(!said.contains("panicked"), "{said}");
    let obeyed = |c: char| (c.is_control() && c != '\n') || matches!(c, '\u{202e}' | '\u{2066}');
    assert!(!said.contains(obeyed), "{command:?} said {said:?}");
    said
}

#[cfg(unix)]
#[test]
fn names_of_files_are_not_obeyed_by_the_terminal() {
    let bench = Bench::new();
    let name = |ending: &str| format!("{HOSTILE}{ending}");
    bench.put(&name(".csv"), clean_recording());
    bench.put(&name(".meta.toml"), "complete = false\n");
    bench.put(&name(".toml"), MODEL);
    bench.put("broken.csv", "");
    for (line, files) in [
        ("simulate --model m.toml --recording", vec![name(".csv")]),
        ("compare --model m.toml", vec![name(".csv")]),
        ("fit --model m.toml", vec![name(".csv")]),
        ("gap", vec![name(".csv")]),
        ("diagnose --model m.toml", vec![name(".csv")]),
        ("compare --model m.toml", vec![name("absent.csv")]),
        ("compare good.csv --model", vec![name("absent.toml")]),
        ("compare broken.csv --model", vec![name(".toml")]),
        ("compare good.csv --model", vec![name(".csv")]),
        (
            "simulate --protocol step --angle-deg 60 --model m.toml -o",
            vec![name(".csv")],
        ),
        (
            "simulate --protocol step --angle-deg 60 --model m.toml -o",
            vec![name("/out.csv")],
        ),
        (
            "simulate --protocol step --angle-deg 60 --model m.toml -o",
            vec![name("new.csv")],
        ),
        (
            "simulate --model m.toml --protocol",
            vec![name("absent.toml")],
        ),
        ("materials fit-curve", vec![name(".csv")]),
        (
            "materials predict --viscosity-cps 1 --tensile-mpa 1 --modulus-mpa",
            vec![name("")],
        ),
        ("record --dry-run --protocol", vec![name("")]),
        ("record --seconds 1 -o run.csv --port", vec![name("")]),
        ("diagnose -o out.parquet --batch", vec![name(".csv")]),
        ("example -o", vec![name(".csv")]),
        ("simulate", vec![name("")]),
        ("", vec![name("")]),
        ("compare --model m.toml --units", vec![name("")]),
        ("simulate --angle-deg", vec![name("")]),
    ] {
        let said = harmless(bench.line(line).args(files));
        assert!(
            line.starts_with("compare broken") || said.contains("\\u001b]0;title"),
            "`softrig {line}` does not show the name: {said:?}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_without_a_writer_and_too_many_threads_are_refused() {
    let bench = Bench::new();
    let made = std::process::Command::new("mkfifo")
        .arg(bench.path("pipe.csv"))
        .status();
    assert!(made.unwrap().success());
    let mut line = bench.line("compare --model m.toml pipe.csv");
    let said = line.timeout(std::time::Duration::from_secs(20)).assert();
    let said = super::common::stderr(&said.code(2));
    assert!(
        said.contains("is a pipe") && said.contains("cat "),
        "{said}"
    );
    let mut line = bench.line("compare --model m.toml good.csv");
    let said = line.env("RAYON_NUM_THREADS", "10000").assert().code(2);
    let said = super::common::stderr(&said);
    assert!(said.contains("10000 threads"), "{said}");
}

/// An editor and a terminal obey what is in the source of the page as well.
#[cfg(unix)]
#[test]
fn names_of_files_are_not_obeyed_in_the_source_of_a_page() {
    let bench = Bench::with_example("none", "0.2");
    let name = format!("{HOSTILE}.csv");
    let run = bench.text("demo/recordings/step60_1.csv");
    bench.put(&name, run);
    let mut line = bench.line(
        "diagnose --model demo/model.toml demo/recordings/step60_2.csv --budget 1s --report page.html --plot gap.svg",
    );
    harmless(line.arg(&name));
    let obeyed = |c: char| (c.is_control() && c != '\n') || matches!(c, '\u{202e}' | '\u{2066}');
    for file in ["page.html", "gap.svg"] {
        let source = bench.text(file);
        assert!(!source.contains(obeyed), "{file}");
    }
    assert!(bench.text("page.html").contains("\\u001b]0;title"));
}

#[test]
fn what_files_hold_is_not_obeyed_by_the_terminal() {
    let bench = Bench::new();
    let toml = hostile_toml();
    assert!(toml.starts_with("\\U0000001b\\U0000005d"), "{toml}");
    let in_model = |from: &str, to: &str| MODEL.replace(from, to);
    for (name, model) in [
        ("name.toml", in_model("bench actuator", &toml)),
        ("key.toml", in_model("exponent", &format!("\"{toml}\""))),
        ("kind.toml", in_model("coulomb_friction", &toml)),
        ("free.toml", in_model("\"stiffness\"", &format!("\"{toml}\""))),
        ("number.toml", in_model("= 4.2", &format!("= \"{toml}\""))),
        ("raw.toml", in_model("bench actuator", HOSTILE)),
        ("text.toml", HOSTILE.to_owned()),
        (
            "material.toml",
            in_model(
                "[dynamics]",
                &format!(
                    "[actuator]\nmaterial = \"{toml}\"\nlength_m = 1\nwidth_m = 1\nheight_m = 1\n[dynamics]"
                ),
            )
            .replace("exponent = 1.727\n", ""),
        ),
    ] {
        bench.put(name, model);
        for line in [
            "simulate --protocol step --angle-deg 60 --model",
            "compare good.csv --model",
            "fit good.csv --model",
        ] {
            harmless(bench.line(line).arg(name));
        }
    }
    harmless(&mut bench.line("gap good.csv"));
    harmless(&mut bench.line("diagnose good.csv other.csv --model name.toml"));

    let table = |header: &str, field: &str| {
        let text = clean_recording();
        let header = HEADER.replace("angle_deg", header);
        text.replace(HEADER, &header)
            .replacen("0.01,30.0", &format!("0.01,{field}"), 1)
    };
    bench.put("column.csv", table(HOSTILE, "30.0"));
    bench.put("more.csv", table(&format!("angle_deg,{HOSTILE}"), "30.0"));
    bench.put("field.csv", table("angle_deg", HOSTILE));
    bench.put("text.csv", HOSTILE.repeat(1_000));
    bench.put("noted.csv", clean_recording());
    bench.put(
        "noted.meta.toml",
        format!("protocol = \"{toml}\"\nsetpoint_deg = 50\n"),
    );
    bench.put("wrong.csv", clean_recording());
    bench.put("wrong.meta.toml", format!("repeat = \"{toml}\"\n"));
    bench.put("broken.csv", clean_recording());
    bench.put("broken.meta.toml", HOSTILE);
    for name in [
        "column.csv",
        "more.csv",
        "field.csv",
        "text.csv",
        "noted.csv",
        "wrong.csv",
        "broken.csv",
    ] {
        for line in [
            "simulate --model m.toml --recording",
            "compare --model m.toml",
            "gap",
            "fit --model m.toml",
            "materials fit-curve",
            "diagnose -o out.parquet --batch",
        ] {
            harmless(bench.line(line).arg(name));
        }
    }
    bench.put(
        "p.toml",
        format!(
            "schema = 1\nname = \"{toml}\"\ntitle = \"{toml}\"\n[[segment]]\nkind = \"release\"\nduration_s = 1\n"
        ),
    );
    let said = harmless(&mut bench.line("record --dry-run --protocol p.toml"));
    assert!(said.contains("\\u001b]0;title"), "{said}");
    for (from, to) in [
        ("release", toml.as_str()),
        ("duration_s", &format!("\"{toml}\"")),
    ] {
        bench.put("q.toml", bench.text("p.toml").replace(from, to));
        harmless(&mut bench.line("record --dry-run --protocol q.toml"));
    }
    bench.put(
        "batch.csv",
        format!("case,model,recordings,holdout\n{HOSTILE},{HOSTILE},{HOSTILE},{HOSTILE}\n"),
    );
    harmless(&mut bench.line("diagnose -o out.parquet --batch batch.csv"));
}
