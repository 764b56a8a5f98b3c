//! Recordings as laboratories have them, through the `softrig` command: other columns, other
//! units, other formats, and there and back.
//!
//! The files in `data/` were written by the programs whose names they have: scipy, pyarrow, numpy,
//! h5py, npTDMS, rosbags and the recorder of ROS 2. `data/make.py` writes those of npTDMS and rosbags.

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
        columns: match units {
            "" => Columns::default(),
            units => Columns::of_units(units).unwrap(),
        },
        ..Layout::default()
    }
}

fn read(name: &str, layout: &Layout) -> (Recording, Vec<String>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("data")
        .join(name);
    softrig_importers::install();
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

/// A step of 200 samples: time (s), pressure (kPa), angle (°).
fn step() -> Vec<[f64; 3]> {
    let row = |k| {
        let time = f64::from(k) * 0.01;
        [time, 30.0, 50.0 * (1.0 - (-2.0 * time).exp())]
    };
    (0..200).map(row).collect()
}

/// The rows of that step, as `of` writes them.
fn rows(of: impl Fn(usize, [f64; 3]) -> String) -> String {
    let rows = step().into_iter().enumerate();
    rows.map(|(k, row)| of(k, row) + "\n").collect()
}

/// The top of a LabVIEW measurement file.
const LABVIEW: &str = "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tNo\nX_Columns\tOne\nTime_Pref\tRelative\nOperator\tlab\nDate\t2024/05/01\nTime\t12:00:00.5\n***End_of_Header***\t\n\t\nChannels\t2\t\t\t\nSamples\t200\t200\t\t\nDate\t2024/05/01\t2024/05/01\t\t\nX_Dimension\tTime\tTime\t\t\nX0\t0.0E+0\t0.0E+0\t\t\nDelta_X\t0.01\t0.01\t\t\n***End_of_Header***\t\t\t\nX_Value\tPressure\tAngle\tComment\n";

/// The step as one array of JSON.
fn json_array() -> String {
    let rows = rows(|k, [t, p, a]| {
        let end = if k == 199 { "" } else { "," };
        format!("{{\"time_s\": {t}, \"pressure_kpa\": {p}, \"angle_deg\": {a}}}{end}")
    });
    format!("[\n{rows}]\n")
}

/// Files as the programs of a laboratory write them, with the flags that read them.
#[test]
fn files_of_the_laboratory_are_read() {
    let plain =
        |separator: &str| rows(|_, [t, p, a]| format!("{t:.2}{separator}{p:.1}{separator}{a:.4}"));
    let named = "--columns time=#1,pressure=#2,angle=#3";
    let files = [
        (
            "labview.lvm",
            LABVIEW.to_owned() + &plain("\t"),
            "--columns time=X_Value,pressure=Pressure,angle=Angle",
        ),
        (
            "lines_above.csv",
            format!(
                "Rig 3;Monday\nOperator;Kim\n\ntime_s,pressure_kpa,angle_deg\n{}",
                plain(",")
            ),
            "",
        ),
        (
            "skipped.csv",
            format!(
                "time_s,pressure_kpa,angle_deg\n1,2,3\ntime_s,pressure_kpa,angle_deg\n{}",
                plain(",")
            ),
            "--skip-rows 2",
        ),
        ("headless.csv", plain(","), named),
        (
            "headless_below_text.txt",
            format!("a logger\nof the lab\n{}", plain(";")),
            named,
        ),
        (
            "savetxt.txt",
            rows(|_, [t, p, a]| format!("{t:.18e} {p:.18e} {a:.18e}")),
            named,
        ),
        (
            "aligned.txt",
            format!(
                "# time_s pressure_kpa  angle_deg\n{}",
                rows(|_, [t, p, a]| format!("  {t:8.3}   {p:6.1} {a:9.4}"))
            ),
            "",
        ),
        (
            "stamps.csv",
            "when,pressure_kpa,angle_deg\n".to_owned()
                + &rows(|k, [_, p, a]| {
                    format!("2024-05-01T12:00:{:05.2}+02:00,{p},{a}", 0.01 * k as f64)
                }),
            "--columns time=when",
        ),
        (
            "stamps_with_blanks.csv",
            "when;pressure_kpa;angle_deg\n".to_owned()
                + &rows(|k, [_, p, a]| {
                    format!("2024-05-01 23:59:{:06.3};{p};{a}", 58.0 + 0.01 * k as f64)
                }),
            "--columns time=when",
        ),
        (
            "lines.jsonl",
            rows(|_, [t, p, a]| {
                format!(
                    "{{\"t\": {t}, \"rig\": {{\"p\": {p}, \"joints\": [0, {a}]}}, \"state\": \"run\"}}"
                )
            }),
            "--columns time=t,pressure=rig.p,angle=rig.joints[1]",
        ),
        ("array.json", json_array(), ""),
    ];
    let bench = Bench::new();
    for (name, text, flags) in files {
        bench.put(name, &text);
        bench.put(&format!("{name}.gz"), super::common::compressed(&text));
        for name in [name, &format!("{name}.gz")] {
            let said = bench.prints(&format!("convert {name} -o out.csv {flags}"));
            assert!(said.contains("200 samples"), "{name}: {said}");
            let read = bench.recording("out.csv");
            for (row, [time, pressure, angle]) in step().into_iter().enumerate() {
                assert!(
                    (read.time[row] - read.time[0] - time).abs() < 1e-6,
                    "{name}"
                );
                assert!((read.pressure[row] / 1e3 - pressure).abs() < 1e-6, "{name}");
                assert!(
                    (read.angle[row].to_degrees() - angle).abs() < 1e-3,
                    "{name}"
                );
            }
            std::fs::remove_file(bench.path("out.csv")).unwrap();
        }
    }
}

#[test]
fn a_table_without_a_header_is_refused_with_the_flags_that_read_it() {
    let bench = Bench::new();
    bench.put("bare.csv", rows(|_, [t, p, a]| format!("{t},{p},{a}")));
    let said = bench.fails("compare --model m.toml bare.csv", &["has no header"]);
    let flags = said.split("--columns ").nth(1).unwrap();
    let flags = flags.split(',').take(3).collect::<Vec<_>>().join(",");
    bench.prints(&format!(
        "compare --model m.toml bare.csv --columns {flags}"
    ));
    // Of a header with other names, below other lines.
    bench.put("odd.csv", "Rig 3\nt;p;theta\n0;1;2\n1;1;2\n");
    bench.fails(
        "compare --model m.toml odd.csv",
        &["odd.csv, line 2", "--columns time=t"],
    );
    // The model file says it once.
    bench.put(
        "m.toml",
        format!("{MODEL}[recording]\nskip_rows = 1\ncolumns = {{ time = \"#1\", pressure = \"#2\", angle = \"#3\" }}\n"),
    );
    bench.prints("convert bare.csv -o out.csv --model m.toml");
    assert_eq!(bench.recording("out.csv").len(), 199);
}

#[test]
fn arrays_of_numpy_and_data_sets_of_h5py_are_read() {
    let columns = "time=t,pressure=rig[0],angle=rig[1]";
    let (recording, warnings) = read("numpy.npz", &layout(columns, "pressure=bar,angle=rad"));
    assert!(warnings.is_empty(), "{warnings:?}");
    let time = [0.0, 0.02, 0.04, 0.06, 0.08];
    let pascal = [0.0, 10_000.0, 25_000.0, 22_500.0, 20_000.0];
    let angle = [0.0, 0.1, 0.25, 0.3, 0.3];
    for (name, columns) in [
        ("numpy.npy", "time=#1,pressure=#2,angle=#3"),
        ("h5py.h5", "time=t,pressure=rig/p,angle=rig/table[1]"),
    ] {
        let (other, _) = read(name, &layout(columns, "pressure=bar,angle=rad"));
        assert!(near(&other.time, &recording.time), "{name}");
        assert!(near(&other.pressure, &recording.pressure), "{name}");
        assert!(near(&other.angle, &recording.angle), "{name}");
    }
    assert!(near(&recording.time, &time));
    assert!(near(&recording.pressure, &pascal));
    assert!(near(&recording.angle, &angle));
}

/// What is not read is named from its first bytes, with the line that converts it.
#[test]
fn formats_that_are_not_read_are_named_with_their_conversion() {
    let bench = Bench::new();
    for (start, parts) in [
        (&b"#ROSBAG V2.0\n"[..], ["ROS 1", "mcap convert run.bin"]),
        (b"TDSh\x0e\0\0\0", ["the index of a TDMS file", ".tdms"]),
        (b"\x28\xb5\x2f\xfd\x04", ["zstd", "zstd -d run.bin"]),
        (b"ARROW1\0\0", ["Feather", "to_parquet"]),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", ["Excel", "CSV"]),
        (b"ULog\x01\x12\x35", ["PX4", "ulog2csv run.bin"]),
        (b"BZh91AY", ["bzip2", "bunzip2"]),
    ] {
        let bytes = [start, &[0; 64]].concat();
        bench.put("run.bin", bytes);
        bench.refuses("compare --model m.toml run.bin", &parts);
    }
}

/// The folder of a bag stands for the recording in it.
#[test]
fn the_folder_of_a_bag_is_read() {
    let bench = Bench::new();
    let bag = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/ros2.mcap");
    std::fs::create_dir(bench.path("bag")).unwrap();
    std::fs::copy(bag, bench.path("bag/bag_0.mcap")).unwrap();
    bench.put("bag/metadata.yaml", "rosbag2_bagfile_information:\n");
    let flags = "--columns pressure=/rig/pressure.fluid_pressure,angle=/rig/angle --units pressure=pa,angle=rad";
    let said = bench.prints(&format!("convert bag -o out.csv {flags}"));
    assert!(said.contains("38 samples"), "{said}");
    std::fs::remove_file(bench.path("bag/bag_0.mcap")).unwrap();
    bench.put("bag/bag_0.db3.zstd", b"\x28\xb5\x2f\xfd\x04and more");
    bench.refuses(
        "compare --model m.toml bag",
        &["zstd", "zstd -d bag/bag_0.db3.zstd"],
    );
    std::fs::create_dir(bench.path("empty")).unwrap();
    bench.refuses("compare --model m.toml empty", &["is a folder"]);
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
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("data/ros2.mcap"),
        &Layout::default(),
    );
    let said = error.unwrap_err().to_string();
    assert!(said.contains("has no topic pressure_kpa"), "{said}");
    assert!(
        said.contains("--columns pressure=/rig/pressure,angle=/rig/angle"),
        "{said}"
    );
    let wrong = layout("pressure=/rig/pressure,angle=/rig/angle", "pressure=pa");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/ros2.mcap");
    let said = Recording::read_as(&path, &wrong).unwrap_err().to_string();
    assert!(
        said.contains("header, fluid_pressure, variance") && said.contains("/rig/pressure.FIELD"),
        "{said}"
    );
}

/// The samples of the files of npTDMS, as those of scipy, numpy and h5py.
#[test]
fn files_of_labview_are_read() {
    let pascal = [0.0, 10_000.0, 25_000.0, 22_500.0, 20_000.0];
    for (name, columns, units) in [
        // The waveform's own time; the channels say their units.
        ("nptdms.tdms", "pressure=Pressure,angle=Bend", ""),
        ("nptdms.tdms", "pressure=rig/Pressure,angle=rig/Bend", ""),
        (
            "nptdms_stamps.tdms",
            "time=when,pressure=rig/value,angle=flex/value",
            "pressure=mbar,angle=rad",
        ),
        (
            "interleaved.tdms",
            "time=t,pressure=it's the pressure,angle=angle",
            "pressure=bar,angle=rad",
        ),
    ] {
        let (recording, warnings) = read(name, &layout(columns, units));
        assert!(warnings.is_empty(), "{name}: {warnings:?}");
        let begin = recording.time[0];
        let time: Vec<f64> = recording.time.iter().map(|t| t - begin).collect();
        assert!(near(&time, &[0.0, 0.02, 0.04, 0.06, 0.08]), "{name}");
        let since_1970 = if name.contains("stamps") {
            1_714_564_800.0
        } else {
            0.0
        };
        assert!((begin - since_1970).abs() < 1e-6, "{name}: {begin}");
        assert!(near(&recording.pressure, &pascal), "{name}");
        assert!(
            near(&recording.angle, &[0.0, 0.1, 0.25, 0.3, 0.3]),
            "{name}"
        );
    }
    let (recording, _) = read("nptdms.tdms", &layout("pressure=Pressure,angle=Bend", ""));
    let extra = |name: &str| {
        &recording
            .extra
            .iter()
            .find(|it| it.name == name)
            .unwrap()
            .fields
    };
    assert_eq!(extra("state"), &["idle", "run", "run", "run", "idle"]);
    assert_eq!(extra("frame"), &["1", "2", "3", "4", "5"]);
    // What is said counts more than the file.
    let said = layout("pressure=Pressure,angle=Bend", "angle=deg");
    let (recording, _) = read("nptdms.tdms", &said);
    assert!((recording.angle[2].to_degrees() - 0.25).abs() < 1e-9);
}

/// A bag in which the first joint bends, and the same as MCAP, both of rosbags: the first and the
/// second of an array, by their places.
#[test]
fn fields_of_arrays_are_read_from_bags_of_both_kinds() {
    let at = |joint: usize| {
        layout(
            &format!("pressure=/rig/pressure.fluid_pressure,angle=/joint_states.position[{joint}]"),
            "pressure=pa,angle=rad",
        )
    };
    for name in ["rosbags.db3", "rosbags.mcap"] {
        let (recording, warnings) = read(name, &at(0));
        assert!(warnings[0].contains("2 of 40 angles"), "{warnings:?}");
        assert_eq!(recording.len(), 38, "{name}");
        for row in 0..recording.len() {
            let time = row as f64 * 0.01;
            assert!((recording.time[row] - time).abs() < 1e-9, "{name}");
            assert!((recording.angle[row] - 0.01 * (row + 1) as f64).abs() < 1e-12);
            let pressure = (time + 0.005) / 0.02 * 1000.0;
            assert!((recording.pressure[row] - pressure).abs() < 1e-6, "{name}");
        }
        let (recording, _) = read(name, &at(1));
        assert!(near(&recording.angle, &[-1.0; 38]), "{name}");
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("data")
            .join(name);
        let said = Recording::read_as(&path, &at(2)).unwrap_err().to_string();
        assert!(
            said.contains("no number in its field position.2")
                && said.contains("header, name, position, velocity, effort"),
            "{said}"
        );
    }
}

const JOINTS: &str = "--columns pressure=/rig/pressure.fluid_pressure,angle=/joint_states.position[0] --units pressure=pa,angle=rad";

/// A copy of the bag of rosbags, changed by SQL.
fn bag(bench: &Bench, name: &str, changes: &str) {
    let bag = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/rosbags.db3");
    std::fs::copy(bag, bench.path(name)).unwrap();
    let data_base = rusqlite::Connection::open(bench.path(name)).unwrap();
    data_base.execute_batch(changes).unwrap();
    data_base.close().unwrap();
}

/// Before Iron there were no definitions in bags; a bag may be packed, or still in its log of
/// changes; its folder may have it in parts.
#[test]
fn bags_of_all_versions_and_in_parts_are_the_same_recording() {
    let bench = Bench::new();
    bag(&bench, "new.db3", "");
    bench.prints(&format!("convert new.db3 -o whole.csv {JOINTS}"));
    let whole = std::fs::read_to_string(bench.path("whole.csv")).unwrap();
    assert_eq!(whole.lines().count(), 39);
    bag(
        &bench,
        "old.db3",
        "DROP TABLE message_definitions; ALTER TABLE topics DROP COLUMN type_description_hash;",
    );
    let bytes = std::fs::read(bench.path("new.db3")).unwrap();
    bench.put("packed.db3.gz", super::common::compressed(&bytes));
    // Other files of SQLite stay beside one that is in use.
    bag(&bench, "logged.db3", "PRAGMA journal_mode = WAL;");
    let writing = rusqlite::Connection::open(bench.path("logged.db3")).unwrap();
    writing
        .execute_batch("UPDATE messages SET timestamp = timestamp + 5000000000;")
        .unwrap();
    std::fs::create_dir(bench.path("bag")).unwrap();
    bench.put(
        "bag/metadata.yaml",
        "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - bag_0.db3\n    - bag_1.db3\n  duration:\n",
    );
    bag(
        &bench,
        "bag/bag_0.db3",
        "DELETE FROM messages WHERE timestamp >= 1200000000;",
    );
    bag(
        &bench,
        "bag/bag_1.db3",
        "DELETE FROM messages WHERE timestamp < 1200000000;",
    );
    for name in ["old.db3", "packed.db3.gz", "logged.db3", "bag"] {
        bench.prints(&format!("convert {name} -o again.csv {JOINTS}"));
        let again = std::fs::read_to_string(bench.path("again.csv")).unwrap();
        assert_eq!(again, whole, "{name}");
        std::fs::remove_file(bench.path("again.csv")).unwrap();
    }
    drop(writing);
    let beside = std::fs::read_dir(bench.path("bag")).unwrap();
    assert_eq!(beside.count(), 3, "nothing is left beside a bag");
    // A part that is missing is no short recording.
    std::fs::remove_file(bench.path("bag/bag_1.db3")).unwrap();
    bench.refuses(
        &format!("compare --model m.toml bag {JOINTS}"),
        &["bag/bag_1.db3"],
    );
    std::fs::remove_file(bench.path("bag/metadata.yaml")).unwrap();
    bag(&bench, "bag/other.db3", "");
    bench.refuses(
        &format!("compare --model m.toml bag {JOINTS}"),
        &["bag: holds 2 files", "one by one"],
    );
}

#[test]
fn faults_of_bags_are_named_with_what_to_do() {
    let bench = Bench::new();
    for (changes, parts) in [
        (
            "DROP TABLE messages;",
            ["no bag of ROS 2", "sqlite3 -header -csv run.db3"],
        ),
        (
            "DELETE FROM messages WHERE topic_id = 2;",
            [
                "topic /rig/pressure.fluid_pressure has no messages",
                "record it again",
            ],
        ),
        (
            "UPDATE topics SET name = '/elsewhere' WHERE id = 2;",
            ["has no topic /rig/pressure.fluid_pressure", "/elsewhere"],
        ),
        (
            "UPDATE topics SET type = 'lab_msgs/msg/Gauge' WHERE id = 2;",
            ["lab_msgs/msg/Gauge on /rig/pressure", "ros2 bag convert"],
        ),
        (
            "UPDATE topics SET serialization_format = 'protobuf';",
            ["is encoded as \"protobuf\"", "export the topic as CSV"],
        ),
        (
            "UPDATE messages SET data = x'0001';",
            ["has no number in its field", "name the field"],
        ),
        (
            "UPDATE messages SET data = 'text';",
            ["a message has a value of another type", "copy it again"],
        ),
        (
            "UPDATE messages SET timestamp = -5;",
            ["before 1970", "copy it again"],
        ),
        (
            "UPDATE messages SET data = x'28b52ffd00ff';",
            ["a message: ", "copy it again"],
        ),
        (
            "DROP TABLE messages; CREATE VIEW messages AS SELECT 1 AS topic_id;",
            ["no bag of ROS 2", "sqlite3"],
        ),
        (
            // Where the first of the array stands.
            "UPDATE messages SET data = CAST(substr(data, 1, 52) || x'000000000000f87f' || substr(data, 61) AS BLOB) WHERE topic_id = 1;",
            ["NaN is not a number", "delete the rows"],
        ),
    ] {
        bag(&bench, "run.db3", changes);
        let parts = ["run.db3", parts[0], parts[1]];
        bench.refuses(&format!("compare --model m.toml run.db3 {JOINTS}"), &parts);
    }
    bag(&bench, "run.db3", "");
    bench.put("run.db3-journal", "changes that were not made");
    bench.refuses(
        &format!("compare --model m.toml run.db3 {JOINTS}"),
        &["run.db3-journal stands beside it", "integrity_check"],
    );
}

/// Cut anywhere, a file is an error with its name and advice, and no panic.
#[test]
fn bags_that_are_cut_off_are_refused() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/rosbags.db3");
    let bytes = std::fs::read(path).unwrap();
    let layout = layout(
        "pressure=/rig/pressure.fluid_pressure,angle=/joint_states.position[0]",
        "pressure=pa,angle=rad",
    );
    for end in (16..bytes.len()).step_by(61).chain([bytes.len() - 1]) {
        let said = Recording::parse_bytes(&bytes[..end], Path::new("cut.db3"), &layout)
            .unwrap_err()
            .to_string();
        assert!(
            said.starts_with("cut.db3: is a damaged SQLite file"),
            "{end}: {said}"
        );
        assert!(said.contains("copy it again"), "{end}: {said}");
    }
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
            .stderr(contains("run.csv: is incomplete"));
        bench
            .line(&format!("convert {there} -o back/run.csv"))
            .assert()
            .success()
            .stderr(contains("is incomplete"));
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
            .contains("is incomplete")
    );
}
