//! `softrig export`.

use predicates::str::{contains, is_match};

use super::common::{Bench, MODEL};

#[test]
fn a_model_is_exported_and_may_replace_what_was_exported() {
    let bench = Bench::new();
    for (language, extension, says) in [
        ("c", "c", "softrig_run"),
        ("python", "py", "def simulate"),
        ("matlab", "m", "function angle_deg = finger("),
        ("modelica", "mo", "package finger"),
    ] {
        let line = format!("export --model m.toml --to {language} -o finger.{extension}");
        for _ in 0..2 {
            bench
                .line(&line)
                .assert()
                .success()
                .stdout(contains("written: finger"));
        }
        let code = bench.text(&format!("finger.{extension}"));
        assert!(
            code.contains(says) && code.contains("coulomb_friction"),
            "{language}"
        );
        assert!(code.contains("bench actuator"), "{language}");
        bench
            .line(&format!("export --model m.toml --to {language}"))
            .assert()
            .success()
            .stdout(contains("0.913"));
    }
}

/// A unit is an archive, which replaces its like and nothing else.
#[test]
fn a_functional_mockup_unit_is_packed_with_its_source() {
    let bench = Bench::new();
    let line = "export --model m.toml --to fmu -o finger.fmu";
    for _ in 0..2 {
        bench
            .line(line)
            .assert()
            .success()
            .stdout(contains("written: finger.fmu"));
    }
    let bytes = std::fs::read(bench.path("finger.fmu")).unwrap();
    let mut unit = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    let mut text = String::new();
    let description = unit.by_name("modelDescription.xml").unwrap();
    std::io::Read::read_to_string(&mut { description }, &mut text).unwrap();
    assert!(text.contains("modelName=\"bench actuator\""), "{text}");
    assert!(unit.by_name("sources/finger.c").is_ok());
    bench
        .line("export --model m.toml --to fmu")
        .assert()
        .code(2)
        .stderr(contains("name its file with -o finger.fmu"));
    bench.put("other.fmu", "PK\u{3}\u{4} somebody's work");
    bench
        .line("export --model m.toml --to fmu -o other.fmu")
        .assert()
        .code(2)
        .stderr(contains("is something else"));
    // Without a compiler there is the source, and a sentence.
    bench
        .line("export --model m.toml --to fmu -o source.fmu")
        .env("CC", "no-such-compiler")
        .assert()
        .success()
        .stderr(contains("only its source"));
}

#[test]
fn an_export_starts_as_a_recording_does() {
    let bench = Bench::with_example("none", "0.2");
    bench
        .line("export --model demo/truth.toml --to python --recording demo/recordings/triangle.csv")
        .assert()
        .success()
        .stdout(is_match(r"(?m)^START_DEG = -?[0-9.e-]+$").unwrap())
        .stdout(is_match(r"(?m)^LARGEST_ANGLE_DEG = (8|9)[0-9.]+$").unwrap());
}

/// A sum is written term by term, however long it is.
#[test]
fn an_export_of_a_long_sum_takes_no_longer_than_it_is() {
    let bench = Bench::new();
    let terms: Vec<&str> = (0..240).map(|k| ["a*th", "w", "th"][k % 3]).collect();
    let effect = format!(
        "\n[[effect]]\nkind = \"custom\"\nname = \"long\"\nforce = \"{}\"\n[effect.parameters]\na = 0.01\n",
        terms.join("+")
    );
    bench.put("long.toml", MODEL.to_owned() + &effect);
    for language in ["c", "python", "matlab", "modelica"] {
        let begun = std::time::Instant::now();
        let code = bench.prints(&format!("export --model long.toml --to {language}"));
        assert!(begun.elapsed().as_secs_f64() < 1.0, "{language}");
        assert!(code.matches("th").count() > 80, "{language}");
    }
}

#[test]
fn an_export_replaces_nothing_else() {
    let bench = Bench::new();
    bench.put("mine.c", "int main(void) { return 0; }\n");
    bench.refuses(
        "export --model m.toml --to c -o mine.c",
        &["mine.c: is something else", "-o exported.c"],
    );
    bench.refuses(
        "export --model m.toml --to c -o good.csv",
        &["good.csv: is a recording"],
    );
    bench.refuses(
        "export --model m.toml --to c -o m.toml",
        &["m.toml: is read by this command"],
    );
    bench.refuses(
        "export --model m.toml --to matlab -o 2-fingers.m",
        &[
            "2-fingers.m: is no name of a MATLAB function",
            "-o model_2_fingers.m",
        ],
    );
    bench.put("warp.toml", MODEL.replace("coulomb_friction", "warp_drive"));
    bench.refuses(
        "export --model warp.toml --to c -o warp.c",
        &["warp.toml, line 15", "not a known kind of effect"],
    );
}
