//! The page for a browser, opened as a file in headless Chromium and used as a person would: choose
//! files, correct a unit, diagnose, stop, save, reload. What it answers is held against the command.
//!
//! `cargo xtask test` builds the page and says where it is. Without it or without Chromium there is
//! nothing to run, and the tests say so.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Parser;
use model_core::catalogue::Kind;
use serde_json::Value;
use softrig::synth::example::{Example, Hidden, NOISE_DEG, make};
use softrig_cli::cli::diagnose;
use softrig_formats::model_file::{ModelFile, recording_layout};
use softrig_formats::recording::Recording;
use softrig_lab_tests::browser::browser;
use softrig_lab_tests::person::{Person, page};
use softrig_tests::shared;

/// A desk, and the narrowest phone.
const WIDTHS: [u32; 2] = [1280, 360];

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("page_in_browser")
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// What the command writes for the same files and flags.
fn command(folder: &Path, words: &[&str], recordings: &[PathBuf]) -> (Value, String) {
    let [json, report] = ["command.json", "command.html"].map(|name| folder.join(name));
    let path = |path: &Path| path.to_str().expect("a plain name").to_owned();
    let mut all = vec!["diagnose".to_owned(), "--model".into()];
    all.push(path(&folder.join("model.toml")));
    all.extend(recordings.iter().map(|it| path(it)));
    all.extend(words.iter().map(|word| (*word).to_owned()));
    all.extend([
        "--json".into(),
        path(&json),
        "--report".into(),
        path(&report),
    ]);
    diagnose::run(&diagnose::Args::try_parse_from(all).expect("a command")).expect("a verdict");
    let text = fs::read_to_string(json).expect("a verdict");
    let report = fs::read_to_string(report).expect("a report");
    (serde_json::from_str(&text).expect("JSON"), report)
}

/// Where two verdicts say something else, but for what is of the computer and of the folder.
fn differences(page: &Value, command: &Value, place: &str) -> Vec<String> {
    const OF_ITS_OWN: [&str; 3] = ["seconds", "tool_version", "recordings"];
    match (page, command) {
        (Value::Object(page), Value::Object(command)) => {
            let keys = page.keys().chain(command.keys()).collect::<BTreeSet<_>>();
            keys.into_iter()
                .filter(|key| !OF_ITS_OWN.contains(&key.as_str()))
                .flat_map(|key| {
                    let [one, other] = [page, command].map(|it| it.get(key));
                    let nothing = Value::String("absent".into());
                    let [one, other] = [one, other].map(|it| it.unwrap_or(&nothing));
                    differences(one, other, &format!("{place}/{key}"))
                })
                .collect()
        }
        (Value::Array(page), Value::Array(command)) => {
            if page.len() != command.len() {
                let [page, command] = [page.len(), command.len()];
                return vec![format!(
                    "{place}: {page} in the page, {command} of the command"
                )];
            }
            let pairs = page.iter().zip(command).enumerate();
            pairs
                .flat_map(|(index, (one, other))| {
                    differences(one, other, &format!("{place}/{index}"))
                })
                .collect()
        }
        _ if page == command => Vec::new(),
        _ => vec![format!(
            "{place}: {page} in the page, {command} of the command"
        )],
    }
}

/// The headings of a report, with their numbers.
fn headings(report: &str) -> Vec<String> {
    let html = scraper::Html::parse_document(report);
    let selector = scraper::Selector::parse("h1, h2, h3").expect("a selector");
    html.select(&selector)
        .map(|heading| heading.text().collect())
        .collect()
}

/// A few short recordings with friction in them. As another program writes them: other names, the
/// pressure in psi, of which the header says nothing.
fn foreign(folder: &Path) -> Vec<PathBuf> {
    let Example {
        model, recordings, ..
    } = make(Hidden::Effect(Kind::CoulombFriction), 0.1, 4).expect("an example");
    fs::write(folder.join("model.toml"), model).expect("a file");
    let write = |(name, recording, _): &(String, Recording, String)| {
        let path = folder.join(name);
        let mut text = "t,Pressure,theta_deg\n".to_owned();
        for row in 0..recording.len() {
            let psi = recording.pressure[row] / 6_894.757;
            let deg = recording.angle[row].to_degrees();
            text += &format!("{:.3},{psi:.4},{deg:.3}\n", recording.time[row]);
        }
        fs::write(&path, text).expect("a file");
        path
    };
    let wanted = ["step30_1", "step60_1", "step90_1", "step90_2", "triangle"];
    let is_wanted = |name: &str| wanted.iter().any(|it| name.starts_with(it));
    let recordings = recordings.iter().filter(|(name, ..)| is_wanted(name));
    recordings.map(write).collect()
}

#[test]
fn a_person_finds_what_the_model_lacks() {
    let (Some(page), Some(browser)) = (page(), browser()) else {
        return;
    };
    let folder = folder("person");
    let recordings = foreign(&folder);
    let person = Person::opens(&browser, &page, WIDTHS[0]);
    person.fits("the empty page");
    columns_are_found_and_a_unit_is_corrected(&person, &recordings);
    what_cannot_be_read_is_refused(&person, &folder);
    person.chooses(&[folder.join("model.toml")]);
    assert_eq!(person.reads("trouble"), "");
    assert!(person.reads("model-name").starts_with("model.toml: "));
    the_verdict_is_the_commands(&person, &folder, &recordings);
    all_of_it_is_kept(&person, &page, &folder);
    everything_has_a_name_and_a_place(&person);
    person.presses("clear");
    person.waits();
    person.reloads();
    assert_eq!(
        person.0.value("document.getElementById('result').hidden"),
        Value::Bool(true)
    );
    assert_eq!(person.counts(".runs figure"), 0);
    person.has_no_complaints();
    println!("screenshots: {}", folder.display());
}

/// The names of the columns are found; that the pressure is in psi only the person knows.
fn columns_are_found_and_a_unit_is_corrected(person: &Person, recordings: &[PathBuf]) {
    person.chooses(recordings);
    let columns = ["time", "pressure", "angle"].map(|key| {
        person
            .0
            .text(&format!("document.getElementById('column-{key}').value"))
    });
    assert_eq!(columns, ["t", "Pressure", "theta_deg"]);
    assert_eq!(person.counts(".runs svg"), 5);
    let highest =
        "Number([...document.querySelectorAll('#runs svg .panel')][1].dataset.y.split(' ')[1])";
    let before = person.0.number(highest);
    person.enters("unit-pressure", "psi");
    let ratio = person.0.number(highest) / before;
    assert!((ratio - 6.894_757).abs() < 0.01, "{ratio}");
}

/// A broken file hides no other, and is refused as by the command; what is too large is refused
/// before it is read.
fn what_cannot_be_read_is_refused(person: &Person, folder: &Path) {
    let broken = folder.join("broken.csv");
    fs::write(&broken, "t,Pressure,theta_deg\n0,1,2\n0.01,x,2\n").expect("a file");
    person.chooses(std::slice::from_ref(&broken));
    let refused = Recording::parse_as(
        &fs::read_to_string(&broken).expect("a file"),
        Path::new("broken.csv"),
        &softrig_formats::columns::Layout {
            names: softrig_formats::columns::Names::parse(
                "time=t,pressure=Pressure,angle=theta_deg",
            )
            .expect("names"),
            ..Default::default()
        },
    )
    .expect_err("it is broken")
    .to_string();
    assert!(
        refused.starts_with("broken.csv, line 3, column Pressure: "),
        "{refused}"
    );
    assert_eq!(
        person
            .0
            .text("document.querySelector('#runs .fault').textContent"),
        refused
    );
    person
        .0
        .value("document.querySelector('[aria-label=\"Remove broken.csv\"]').click()");
    person.waits();
    person.0.value(
        "(() => { const all = new DataTransfer(); \
         all.items.add(new File([new Uint8Array(2 ** 20 * 257)], 'long.csv')); \
         window.dispatchEvent(new DragEvent('drop', { dataTransfer: all })); })()",
    );
    person.waits();
    assert!(
        person
            .reads("trouble")
            .starts_with("long.csv has 257 MiB, more than")
    );
}

/// The diagnosis shows how far it is, and is the command's.
fn the_verdict_is_the_commands(person: &Person, folder: &Path, recordings: &[PathBuf]) {
    person.presses("diagnose");
    person.waits_until("document.getElementById('how-far').textContent.includes('fits')");
    person.waits();
    let words = [
        "--columns",
        "time=t,pressure=Pressure,angle=theta_deg",
        "--units",
        "pressure=psi",
    ];
    let (verdict, report) = command(folder, &words, recordings);
    let saved: Value =
        serde_json::from_str(&person.saves("save-verdict", "verdict.json", folder)).expect("JSON");
    assert_eq!(saved["verdict"], "effect_found");
    assert_eq!(differences(&saved, &verdict, ""), Vec::<String>::new());
    let page_report = person.saves("save-report", "report.html", folder);
    assert_eq!(headings(&page_report), headings(&report));
    assert!(page_report.contains("--units pressure=psi"));
    assert_eq!(
        person.0.text("document.getElementById('report').srcdoc"),
        page_report
    );
    let repaired = person.saves("save-model", "repaired.toml", folder);
    let repaired = ModelFile::parse(&repaired, Path::new("repaired.toml")).expect("a model");
    assert!(repaired.model.effects().next().is_some());
}

/// All of it is there after a reload, on a desk and on a phone, light, dark and on paper.
fn all_of_it_is_kept(person: &Person, page: &Path, folder: &Path) {
    let sentence = person.reads("sentence");
    person.reloads();
    assert_eq!(person.reads("sentence"), sentence);
    assert_eq!(
        person
            .0
            .text("document.getElementById('unit-pressure').value"),
        "psi"
    );
    for scheme in ["light", "dark"] {
        person.0.prefers(scheme);
        for width in WIDTHS {
            person.0.load(page, width);
            person.waits();
            person.fits(&format!("the verdict at {width} px"));
            // The report is in a frame without rights, into which nobody can look.
            sleep(Duration::from_secs(1));
            person
                .0
                .shoot(&folder.join(format!("verdict_{scheme}_{width}.png")));
        }
    }
    let printed = person.0.print();
    assert!(printed.starts_with(b"%PDF"));
    fs::write(folder.join("verdict.pdf"), printed).expect("a file");
}

/// For a keyboard and a screen reader: whatever can be used has a name, and is reached in the order
/// of the page.
fn everything_has_a_name_and_a_place(person: &Person) {
    let nameless = person.0.text(
        "[...document.querySelectorAll('button, a, input, select, iframe')].filter((it) => \
         !(it.getAttribute('aria-label') || it.title || it.textContent.trim() || \
         [...(it.labels ?? [])].some((label) => label.textContent.trim())))\
         .map((it) => it.outerHTML).join(' ')",
    );
    assert_eq!(nameless, "");
    person
        .0
        .value("document.activeElement.blur(); window.scrollTo(0, 0)");
    let mut reached = Vec::new();
    for _ in 0..6 {
        person.0.tabs();
        reached.push(
            person
                .0
                .text("document.activeElement.id || document.activeElement.className"),
        );
    }
    let place = |id: &str| reached.iter().position(|it| it == id);
    assert!(place("example").is_some(), "{reached:?}");
    assert!(place("example") < place("files"), "{reached:?}");
}

/// A log without names and without a time, in hundredths: the page shows what is in it, and the
/// person says with the mouse what it is.
#[test]
fn a_table_without_names_is_said_with_the_mouse() {
    let (Some(page), Some(browser)) = (page(), browser()) else {
        return;
    };
    let folder = folder("mouse");
    let lines = (0..200)
        .map(|k| f64::from(k) / 20.0)
        .map(|t| format!("{:.0}\t{:.4}\t7\n", 1e4 * t.sin().abs(), (t - 0.2).sin()));
    let rows = lines.collect::<Vec<String>>().concat();
    let log = folder.join("log.txt");
    fs::write(&log, rows).expect("a file");
    for width in WIDTHS {
        let person = Person::opens(&browser, &page, width);
        person.chooses(std::slice::from_ref(&log));
        assert_eq!(person.counts("#look tbody tr"), 3);
        assert_eq!(person.counts("#look polyline"), 3);
        person.0.shoot(&folder.join(format!("look_{width}.png")));
        let says = |column: u32, meaning: &str| {
            person.0.value(&format!(
                "(() => {{ const field = document.querySelectorAll('#look select')[{column}]; \
                 field.value = '{meaning}'; \
                 field.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()"
            ));
            person.waits();
        };
        says(0, "pressure=kpa");
        says(1, "angle=rad");
        person.enters("unit-time", "s*20");
        person.enters("unit-pressure", "kpa*100");
        let is = |column: u32| {
            let script = format!("document.querySelectorAll('#look select')[{column}].value");
            person.0.text(&script)
        };
        assert_eq!([is(0), is(1), is(2)], ["pressure=kpa*100", "angle=rad", ""]);
        person.fits("the columns of a file");
        assert_eq!(person.reads("trouble"), "");
        let saved = person.saves("save-layout", "softrig.toml", &folder);
        let layout = recording_layout(&saved, Path::new("softrig.toml")).expect("a section");
        let (recording, _) = Recording::read_as(&log, &layout).expect("a recording");
        assert!((recording.duration() - 9.95).abs() < 1e-9);
        let highest = recording.pressure.iter().copied().fold(0.0, f64::max);
        assert!((highest - 1e5).abs() < 2e2, "{highest}");
        let shown = "document.querySelector('#runs figcaption').textContent";
        assert!(person.0.text(shown).contains("one every 50.0 ms"));
        // The next width saves its own.
        fs::remove_file(folder.join("softrig.toml")).expect("a file");
        person.presses("clear");
        person.waits();
        person.has_no_complaints();
        person.0.close();
    }
}

/// Always the same example, stopped in the page as soon as fits are counted: an answer may be there
/// before anybody has looked from outside.
const STOPS_AT_ITS_FIRST_FITS: &str = "(() => {
    Math.random = () => 0.5;
    new MutationObserver((_, observer) => {
        if (!document.getElementById('how-far').textContent.includes('fits')) return;
        observer.disconnect();
        const root = document.documentElement;
        window.atWork = {
            pictures: document.querySelectorAll('.runs svg').length,
            tooWide: root.scrollWidth - root.clientWidth,
        };
        document.getElementById('stop').click();
    }).observe(document.getElementById('how-far'), { childList: true });
})()";

#[test]
fn an_example_takes_one_click_and_stopping_keeps_what_is_known() {
    let (Some(page), Some(browser)) = (page(), browser()) else {
        return;
    };
    let person = Person::opens(&browser, &page, WIDTHS[1]);
    person.0.value(STOPS_AT_ITS_FIRST_FITS);
    person.presses("example");
    person.waits_until("window.atWork !== undefined");
    person.waits();
    // The page lived while the library worked.
    assert_eq!(person.0.value("window.atWork.pictures"), 11);
    assert!(person.0.number("window.atWork.tooWide") <= 0.0);
    assert!(
        person
            .reads("truth")
            .starts_with("The simulated actuator hid: ")
    );
    let folder = folder("stopped");
    let verdict: Value =
        serde_json::from_str(&person.saves("save-verdict", "verdict.json", &folder)).expect("JSON");
    assert_eq!(verdict["ended"], "budget");
    assert!(
        verdict["not_tried"]
            .as_array()
            .is_some_and(|all| !all.is_empty())
    );
    assert_ne!(verdict["verdict"], "effect_found");
    person.presses("clear");
    person.waits();
    person.has_no_complaints();
}

/// Waits for the verdict of what the page was asked at `began`, and prints it beside the command's
/// and what differs between the two.
fn answers_as_the_command(
    person: &Person,
    began: Instant,
    folder: &Path,
    recordings: &[PathBuf],
    holdout: &[PathBuf],
) -> Vec<String> {
    person.waits();
    let in_page = began.elapsed();
    assert_eq!(person.reads("trouble"), "", "{}", folder.display());
    let holdout: Vec<&str> = holdout
        .iter()
        .flat_map(|path| ["--holdout", path.to_str().expect("a plain name")])
        .collect();
    let began = Instant::now();
    let (verdict, _) = command(folder, &holdout, recordings);
    let of_command = began.elapsed();
    let saved = person.saves("save-verdict", "verdict.json", folder);
    let saved = serde_json::from_str(&saved).expect("JSON");
    let name = folder.file_name().expect("a name").display();
    println!(
        "{name}: {}, {:.1} s in the page, {:.1} s of the command",
        verdict["verdict"],
        in_page.as_secs_f64(),
        of_command.as_secs_f64()
    );
    let differences = differences(&saved, &verdict, &name.to_string());
    for it in &differences {
        println!("{it}");
    }
    differences
}

/// Asks the page and the command for a diagnosis of every folder with `model.toml`, `recordings/`
/// and perhaps `holdout/`, and prints all before it complains.
fn every_folder_has_the_answer_of_the_command(folders: &str) {
    let (Some(page), Some(browser), Some(cases)) = (page(), browser(), shared(folders)) else {
        return;
    };
    // Chromium reads no file whose path leads upwards.
    let cases = cases.canonicalize().expect("cases");
    let mut all = Vec::new();
    for case in sorted(&cases).iter().filter(|path| path.is_dir()) {
        let name = case.file_name().expect("a name").to_string_lossy();
        let folder = folder(&name);
        fs::copy(case.join("model.toml"), folder.join("model.toml")).expect("a model");
        let recordings = sorted(&case.join("recordings"));
        let holdout = case.join("holdout");
        let holdout = if holdout.is_dir() {
            sorted(&holdout)
        } else {
            Vec::new()
        };
        let person = Person::opens(&browser, &page, WIDTHS[0]);
        person.presses("clear");
        person.waits();
        let model = vec![folder.join("model.toml")];
        person.chooses(&[recordings.clone(), holdout.clone(), model].concat());
        for path in &holdout {
            person.holds_out(path);
        }
        let began = Instant::now();
        person.presses("diagnose");
        all.extend(answers_as_the_command(
            &person,
            began,
            &folder,
            &recordings,
            &holdout,
        ));
        person.0.close();
    }
    assert_eq!(all, Vec::<String>::new());
}

/// Files of a folder, sorted.
fn sorted(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("a file").path())
        .collect();
    files.sort();
    files
}

#[test]
#[ignore = "a minute for each case: cargo test … -- --ignored has_the_answer_of_the_command"]
fn every_sample_case_has_the_answer_of_the_command() {
    every_folder_has_the_answer_of_the_command("cases");
}

#[test]
#[ignore = "a minute for each rig: cargo test … -- --ignored has_the_answer_of_the_command"]
fn every_recorded_rig_has_the_answer_of_the_command() {
    every_folder_has_the_answer_of_the_command("data/rigs");
}

#[test]
#[ignore = "a minute for each example: cargo test … -- --ignored has_the_answer_of_the_command"]
fn an_example_of_one_click_has_the_answer_of_the_command() {
    let (Some(page), Some(browser)) = (page(), browser()) else {
        return;
    };
    for seed in [7_u64, 8] {
        let folder = folder(&format!("example {seed}"));
        make(Hidden::Drawn, NOISE_DEG, seed)
            .and_then(|example| example.write(&folder))
            .expect("an example");
        let person = Person::opens(&browser, &page, WIDTHS[0]);
        // The page draws a seed from 1 to a million.
        person
            .0
            .value(&format!("Math.random = () => ({seed} - 0.5) / 1e6; 0"));
        let began = Instant::now();
        person.presses("example");
        let recordings = sorted(&folder.join("recordings"));
        let recordings: Vec<PathBuf> = recordings
            .into_iter()
            .filter(|path| path.extension().is_some_and(|it| it == "csv"))
            .collect();
        let differences = answers_as_the_command(&person, began, &folder, &recordings, &[]);
        assert_eq!(differences, Vec::<String>::new());
        person.0.close();
    }
}
