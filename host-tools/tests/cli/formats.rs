//! Recordings as laboratories have them, through the `rig` command: other columns, other
//! units, other formats, and there and back.
//!
//! The files in `data/` were written by the programs whose names they have: scipy, pyarrow
//! and the recorder of ROS 2.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{BrotliLevel, Compression, GzipLevel, ZstdLevel};
use parquet::data_type::DoubleType;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use predicates::prelude::*;
use predicates::str::contains;
use softrig_formats::columns::{Columns, Layout, Names};
use softrig_formats::recording::Recording;

use super::common::{Bench, MODEL};

fn layout(columns: &str, units: &str) -> Layout {
    Layout {
        names: Names::parse(columns).unwrap(),
        columns: Columns::of_units(units).unwrap(),
        ..Layout::default()
    }
}

fn read(name: &str, layout: &Layout) -> (Recording, Vec<String>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data")
        .join(name);
    Recording::read_as(&path, layout).unwrap()
}

fn near(found: &[f64], expected: &[f64]) -> bool {
    let mut both = found.iter().zip(expected);
    found.len() == expected.len() && both.all(|(a, b)| (a - b).abs() < 1e-6 * b.abs().max(1.0))
}

#[test]
fn a_file_of_scipy_is_read() {
    let columns = "time=t,pressure=p_bar,angle=rig.theta";
    let (recording, warnings) = read("scipy.mat", &layout(columns, "pressure=bar,angle=rad"));
    assert!(warnings.is_empty(), "{warnings:?}");
    assert!(near(&recording.time, &[0.0, 0.02, 0.04, 0.06, 0.08]));
    let pascal = [0.0, 10_000.0, 25_000.0, 22_500.0, 20_000.0];
    assert!(near(&recording.pressure, &pascal));
    assert!(near(&recording.angle, &[0.0, 0.1, 0.25, 0.3, 0.3]));
}

#[test]
fn a_file_of_pyarrow_is_read_with_the_unit_of_its_time_stamps() {
    let (recording, _) = read(
        "arrow.parquet",
        &layout("time=when,angle=angle", "angle=deg"),
    );
    let since: Vec<f64> = recording
        .time
        .iter()
        .map(|t| t - recording.time[0])
        .collect();
    assert!(near(&since, &[0.0, 0.02, 0.04, 0.06, 0.08]), "{since:?}");
    assert!((recording.time[0] - 1_714_564_800.0).abs() < 1e-6);
    assert!((recording.pressure[3] - 22_500.0).abs() < 1e-9);
    assert_eq!(
        recording.extra[0].fields,
        ["idle", "run", "run", "", "idle"]
    );
    assert_eq!(recording.extra[1].fields, ["", "60.5", "60.5", "60.5", ""]);
}

/// A table of Parquet with a codec.
fn packed(codec: Compression) -> Vec<u8> {
    let message = "message m { required double time_s; required double pressure_kpa; required double angle_deg; }";
    let schema = Arc::new(parse_message_type(message).unwrap());
    let properties = WriterProperties::builder().set_compression(codec).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties)).unwrap();
    let mut group = writer.next_row_group().unwrap();
    for factor in [0.01, 0.1, 0.2] {
        let mut column = group.next_column().unwrap().unwrap();
        let values: Vec<f64> = (0..200).map(|k| f64::from(k) * factor).collect();
        let typed = column.typed::<DoubleType>();
        typed.write_batch(&values, None, None).unwrap();
        column.close().unwrap();
    }
    group.close().unwrap();
    writer.into_inner().unwrap()
}

#[test]
fn parquet_of_every_compression_is_read() {
    let bench = Bench::new();
    for codec in [
        Compression::UNCOMPRESSED,
        Compression::SNAPPY,
        Compression::GZIP(GzipLevel::default()),
        Compression::BROTLI(BrotliLevel::default()),
        Compression::LZ4,
        Compression::LZ4_RAW,
        Compression::ZSTD(ZstdLevel::default()),
    ] {
        bench.put("packed.parquet", packed(codec));
        let said = bench.prints("convert packed.parquet -o out.csv");
        assert!(said.contains("200 samples"), "{codec:?}: {said}");
        assert!((bench.recording("out.csv").angle[100].to_degrees() - 20.0).abs() < 1e-9);
        std::fs::remove_file(bench.path("out.csv")).unwrap();
    }
}

/// The pressure is logged at half the rate, 5 ms after the angle: between its messages it is
/// interpolated, and before the first and after the last there is none.
#[test]
fn a_bag_of_ros_2_is_read_at_the_times_of_the_angle() {
    let columns = "pressure=/rig/pressure.fluid_pressure,angle=/rig/angle";
    let (recording, warnings) = read("ros2.mcap", &layout(columns, "pressure=pa,angle=rad"));
    assert!(warnings[0].contains("2 of 40 angles"), "{warnings:?}");
    assert_eq!(recording.len(), 38);
    for row in 0..recording.len() {
        let time = row as f64 * 0.01;
        assert!((recording.time[row] - time).abs() < 1e-9);
        assert!((recording.angle[row] - 0.01 * (row + 1) as f64).abs() < 1e-12);
        let pressure = (time + 0.005) / 0.02 * 1000.0;
        assert!((recording.pressure[row] - pressure).abs() < 1e-6, "{row}");
    }
    let error = Recording::read_as(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/ros2.mcap"),
        &Layout::default(),
    );
    let said = error.unwrap_err().to_string();
    assert!(said.contains("has no topic pressure_kpa"), "{said}");
    assert!(
        said.contains("--columns pressure=/rig/pressure,angle=/rig/angle"),
        "{said}"
    );
    let wrong = layout("pressure=/rig/pressure,angle=/rig/angle", "pressure=pa");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/ros2.mcap");
    let said = Recording::read_as(&path, &wrong).unwrap_err().to_string();
    assert!(
        said.contains("header, fluid_pressure, variance") && said.contains("/rig/pressure.FIELD"),
        "{said}"
    );
}

/// A step in the units of a laboratory: ms, psi and rad.
fn foreign(header: &str) -> String {
    let rows = (0..200).map(|k| {
        let angle = 0.87 * (1.0 - (-0.02 * f64::from(k)).exp());
        format!("{},4.35,{angle:.5}\n", 10 * k)
    });
    format!("{header}\n{}", rows.collect::<String>())
}

/// The error of an unknown header has the command line in it that reads the file.
#[test]
fn the_suggested_flags_read_the_file() {
    let bench = Bench::new();
    bench.put("lab.csv", foreign("t_ms,p_psi,theta_rad"));
    let compare = "compare --model m.toml lab.csv";
    let said = bench.fails(compare, &["lab.csv, line 1, column time_s"]);
    let flags = said
        .split_once("add ")
        .and_then(|(_, rest)| rest.split_once(", or say so"))
        .unwrap_or_else(|| panic!("{said}"))
        .0;
    let by_flags = bench.prints(&format!("{compare} {flags}"));
    // Said once beside the model, it is the same for every command.
    let section = "
[recording]
columns = { time = \"t_ms\", pressure = \"p_psi\", angle = \"theta_rad\" }
units = { time = \"ms\", pressure = \"psi\", angle = \"rad\" }
";
    bench.put("m.toml", format!("{MODEL}{section}"));
    assert_eq!(bench.prints(compare), by_flags);
    bench.prints("simulate --model m.toml --recording lab.csv");
    bench.prints("convert lab.csv -o lab.parquet --model m.toml");
    bench.prints("compare --model m.toml lab.csv --units angle=rad");
    // A flag wins.
    bench.put("new.csv", foreign("t_ms,p_psi,theta"));
    let other = "compare --model m.toml new.csv";
    bench.fails(other, &["new.csv, line 1, column theta_rad"]);
    assert_eq!(
        bench.prints(&format!("{other} --columns angle=theta")),
        by_flags.replace("lab", "new")
    );
}

#[test]
fn faults_of_the_section_recording_are_refused_with_their_place() {
    let bench = Bench::new();
    bench.put("lab.csv", foreign("time_s,pressure_kpa,angle_deg"));
    for (section, parts) in [
        (
            "columns = \"t\"",
            ["line 18, column 11", "columns is no table"],
        ),
        (
            "columns = { t = \"t\" }",
            ["line 18, column 17", "none of time"],
        ),
        (
            "units = { pressure = \"V\" }",
            ["line 18, column 22", "kpa, psi"],
        ),
        (
            "units = { pressure = 3 }",
            ["line 18, column 22", "not in quotes"],
        ),
        ("setup.tilt = 90", ["[setup]", "known are tilt_deg"]),
        ("setup.tube_mm = -1", ["line 18", "tube_mm = -1 mm"]),
        ("absolute_pressure_kpa = 200", ["line 18", "from 0 to 110"]),
        (
            "flip_angle = 1",
            ["line 18, column 14", "neither true nor false"],
        ),
        ("unit = {}", ["line 18, column 1", "has no key unit"]),
    ] {
        bench.put("m.toml", format!("{MODEL}[recording]\n{section}\n"));
        bench.fails("compare --model m.toml lab.csv", &parts);
    }
}

const RECORDED: &str = "\
time_s,pressure_kpa,angle_deg,setpoint_deg,state
0.000,-0.05,59.81,60.00,idle
0.010,10.10,59.90,60.00,running
0.020,12.00,-0.10,,running
";
const META: &str = "protocol = \"paper\"\nsamples = 3.0 # of another tool\ncomplete = false\n";

#[test]
fn a_recording_is_converted_there_and_back_with_its_metadata() {
    let bench = Bench::new();
    bench.put("run.csv", RECORDED);
    bench.put("run.meta.toml", META);
    std::fs::create_dir(bench.path("back")).unwrap();
    for format in ["parquet", "mcap", "csv.gz"] {
        let there = format!("there/run.{format}");
        let folder = format!("convert run.csv -o there --to {format}");
        bench
            .line(&folder)
            .assert()
            .success()
            .stdout(contains("run.").and(contains("3 samples")))
            .stderr(contains("run.csv: is not complete"));
        bench
            .line(&format!("convert {there} -o back/run.csv"))
            .assert()
            .success()
            .stderr(contains("is not complete"));
        assert_eq!(bench.text("back/run.csv"), RECORDED, "{format}");
        assert_eq!(bench.text("back/run.meta.toml"), META, "{format}");
        // What was recorded is never replaced.
        bench.fails(&folder, &["is a recording that exists"]);
        for file in ["back/run.csv", "back/run.meta.toml"] {
            std::fs::remove_file(bench.path(file)).unwrap();
        }
    }
    // Beside the original its metadata are those of both.
    bench.prints("convert run.csv -o run.csv.gz");
    bench.prints("convert run.csv -o run.mcap");
    assert_eq!(bench.text("run.meta.toml"), META);
    bench.put("kept.meta.toml", "protocol = \"other\"\n");
    bench.fails(
        "convert run.csv -o kept.csv",
        &["kept.meta.toml", "never replaced"],
    );
    for (line, part) in [
        ("convert run.csv -o run.xlsx", "end it in .csv"),
        ("convert run.csv m.toml -o new", "say their format"),
        (
            "convert run.csv back/../run.csv -o new --to mcap",
            "as another is",
        ),
        ("convert run.csv -o run.csv", "is read by this command"),
        ("convert run.csv -o m.toml", "end it in .csv"),
        ("convert m.toml -o m.csv", "m.toml"),
    ] {
        bench.fails(line, &[part]);
    }
}

#[test]
fn a_damaged_recording_of_any_format_is_refused_without_a_panic() {
    let bench = Bench::new();
    bench.put("run.csv", RECORDED);
    for format in ["parquet", "mcap"] {
        bench.prints(&format!("convert run.csv -o run.{format}"));
        let whole = std::fs::read(bench.path(&format!("run.{format}"))).unwrap();
        let mut turned = whole.clone();
        // The length of the table of contents, or a record of the summary.
        let place = whole.len() - 8;
        turned[place] ^= 0x55;
        let cut = &whole[..whole.len() / 2];
        for damaged in [&turned[..], cut] {
            bench.put("bad", damaged);
            let assert = bench.line("compare --model m.toml bad").assert();
            let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
            assert!(!said.contains("panicked"), "{said}");
            if damaged == cut {
                bench.fails("compare --model m.toml bad", &["bad", "copy it again"]);
            }
        }
    }
}

/// Nobody is told on the terminal of a thousand cases, so it stands in the results.
#[test]
fn a_batch_says_that_a_recording_is_not_complete() {
    let bench = Bench::new();
    bench.prints("example -o demo --hide 11 --effect none --noise-deg 0.2");
    let mut names: Vec<String> = std::fs::read_dir(bench.path("demo/recordings"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|it| it == "csv"))
        .map(|path| path.file_name().unwrap().to_str().unwrap().to_owned())
        .collect();
    names.sort();
    let about = format!("demo/recordings/{}", names[0].replace(".csv", ".meta.toml"));
    let meta = std::fs::read_to_string(bench.path(&about)).unwrap_or_default();
    bench.put(&about, format!("complete = false\n{meta}"));
    let files: Vec<String> = names.iter().map(|it| format!("recordings/{it}")).collect();
    let rows = format!(
        "case,model,recordings,columns,units\nfirst,model.toml,{},angle=angle_deg,angle=deg\n",
        files.join(";")
    );
    bench.put("demo/cases.csv", rows);
    for how in [" s, 1 warning)", "known, 1 warning)"] {
        bench
            .line("diagnose --batch demo/cases.csv -o out")
            .assert()
            .success()
            .stdout(contains(how))
            .stderr(contains("1 of 1 cases").and(contains("warnings.txt")));
    }
    assert!(
        bench
            .text("out/first/warnings.txt")
            .contains("is not complete")
    );
}
