//! The page that `softrig diagnose --report` writes, read back by a parser: every
//! verdict makes a whole page, nothing is loaded from elsewhere, and names of
//! files stay text. What it looks like is seen in `report_in_browser.rs`.

use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use scraper::{ElementRef, Html, Selector};
use softrig::diagnose::decide::verdict::Answer;
use softrig_lab_tests::reports::{EVIL, EVIL_MODEL, Report, of_every_kind};
use softrig_report::Outputs;
use softrig_report::content::Notice;
use softrig_report::terminal::summary;

static REPORTS: LazyLock<Vec<Report>> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("reports");
    of_every_kind(&folder)
});

fn all<'a>(page: &'a Html, selector: &str) -> Vec<ElementRef<'a>> {
    page.select(&Selector::parse(selector).unwrap()).collect()
}

fn text(element: ElementRef<'_>) -> String {
    let text: String = element.text().collect();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn every_verdict_makes_a_whole_page() {
    let answers: Vec<Answer> = REPORTS.iter().map(|report| report.answer).collect();
    for answer in [
        Answer::EffectFound,
        Answer::ParametersOnly,
        Answer::NoDiscrepancy,
        Answer::CannotTell,
        Answer::Unexplained,
    ] {
        assert!(
            answers.contains(&answer),
            "{answer:?} is not in {answers:?}"
        );
    }
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        let what = report.answer;
        assert_eq!(page.errors, Vec::<String>::new(), "{what:?}");
        assert_eq!(all(&page, "h1").len(), 1);
        assert_eq!(text(all(&page, "h1")[0]), report.content.sentence);
        assert_eq!(all(&page, "dl.keys > div").len(), 4, "{what:?}");
        let sections: Vec<&str> = all(&page, "section")
            .iter()
            .filter_map(|section| section.attr("id"))
            .collect();
        let expected: &[&str] = match what {
            Answer::NoDiscrepancy | Answer::ParametersOnly => {
                &["model", "runs", "left", "open", "made"]
            }
            _ => &["where", "tried", "model", "runs", "left", "open", "made"],
        };
        assert_eq!(sections, expected, "{what:?}");
        // Each section has a heading and says something.
        for section in all(&page, "section") {
            let heading = Selector::parse("h2").unwrap();
            assert_eq!(section.select(&heading).count(), 1);
            assert!(text(section).len() > 40, "{what:?}");
        }
        assert_eq!(all(&page, "#run-pictures svg").len(), 5);
        let maps = if what == Answer::Unexplained { 2 } else { 0 };
        assert_eq!(all(&page, ".map svg").len(), maps, "{what:?}");
        let named = usize::from(what == Answer::EffectFound);
        assert_eq!(all(&page, ".effect").len(), named);
        let next = usize::from(what == Answer::CannotTell);
        assert_eq!(all(&page, "pre.command").len(), next);
        let heads: Vec<String> = all(&page, ".parameters th.number")
            .into_iter()
            .map(text)
            .collect();
        let kept = what == Answer::NoDiscrepancy;
        assert_eq!(heads.contains(&"refit".to_owned()), kept, "{heads:?}");
        assert!(!report.html.contains("NaN") && !report.html.contains("inf<"));
        assert!(report.html.len() < 700_000, "{} bytes", report.html.len());
    }
}

#[test]
fn a_page_can_be_read_without_seeing_it() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        assert_eq!(all(&page, "html")[0].attr("lang"), Some("en"));
        assert_eq!(all(&page, "meta[name=viewport]").len(), 1);
        for picture in all(&page, "svg") {
            let spoken = picture.attr("aria-label").unwrap_or_default();
            assert!(spoken.len() > 20, "{spoken:?}");
            assert_eq!(picture.attr("role"), Some("img"));
        }
        for table in all(&page, "table") {
            let caption = Selector::parse("caption").unwrap();
            assert_eq!(table.select(&caption).count(), 1);
        }
        // Without a script no switch is offered that does nothing.
        let live = all(&page, "input:not([hidden])");
        assert!(live.iter().all(|input| {
            input
                .ancestors()
                .filter_map(ElementRef::wrap)
                .any(|above| above.attr("hidden").is_some())
        }));
    }
}

#[test]
fn nothing_is_loaded_from_elsewhere() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        for element in all(&page, "*") {
            for attribute in [
                "src",
                "href",
                "srcset",
                "data",
                "action",
                "poster",
                "xlink:href",
            ] {
                let place = element.attr(attribute).filter(|_| attribute == "href");
                if let Some(place) = place.and_then(|to| to.strip_prefix('#')) {
                    // Within the page.
                    assert_eq!(all(&page, &format!("[id={place}]")).len(), 1, "{place}");
                } else {
                    assert_eq!(element.attr(attribute), None, "{}", element.value().name());
                }
            }
        }
        for style in all(&page, "style") {
            let style = text(style);
            assert!(!style.contains("url(") && !style.contains("@import"));
        }
        let policy = all(&page, "meta[http-equiv=Content-Security-Policy]");
        let policy = policy[0].attr("content").unwrap();
        assert!(policy.starts_with("default-src 'none'"), "{policy}");
    }
}

#[test]
fn names_of_files_and_models_stay_text() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        assert_eq!(all(&page, "script").len(), 1);
        assert_eq!(
            text(all(&page, "title")[0]),
            format!("Diagnosis of {EVIL_MODEL}")
        );
        let headings: Vec<String> = all(&page, "#run-pictures h3")
            .into_iter()
            .map(text)
            .collect();
        assert!(headings.contains(&EVIL.to_owned()), "{headings:?}");
        let files: Vec<String> = all(&page, ".files tbody th")
            .into_iter()
            .map(text)
            .collect();
        assert!(files.iter().any(|file| file.contains(EVIL)), "{files:?}");
        if report.answer == Answer::CannotTell {
            let command = text(all(&page, "pre.command")[0]);
            assert!(
                command.contains("softrig plan --model ")
                    && command.contains(" --between quadratic_damping,angle_dependent_damping "),
                "{command}"
            );
        }
    }
}

#[test]
fn what_cannot_be_told_apart_is_drawn_with_letters() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        let switches: Vec<String> = all(&page, "[data-switches=curves] label")
            .into_iter()
            .map(text)
            .collect();
        let lettered = report.answer == Answer::CannotTell;
        assert_eq!(switches.iter().any(|label| label == "with A"), lettered);
        assert_eq!(switches.iter().any(|label| label == "with B"), lettered);
        let said = text(all(&page, "#runs")[0]);
        assert_eq!(said.contains("A is "), lettered, "{said}");
    }
}

#[test]
fn the_pressure_stands_under_every_angle() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        for picture in all(&page, "#run-pictures svg") {
            let panels = Selector::parse(".panel").unwrap();
            let ordinates: Vec<&str> = picture
                .select(&panels)
                .filter_map(|panel| panel.attr("data-y-label"))
                .collect();
            let expected = ["angle (°)", "pressure (kPa)", "simulated − measured (°)"];
            assert_eq!(ordinates, expected);
            // One time axis.
            let ranges: Vec<&str> = picture
                .select(&panels)
                .filter_map(|panel| panel.attr("data-x"))
                .collect();
            assert!(ranges.iter().all(|range| range == &ranges[0]));
        }
    }
}

#[test]
fn what_is_left_is_said_in_words_and_two_panels() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        assert_eq!(all(&page, "#left svg").len(), 2);
        let said = text(all(&page, "#left p")[0]);
        let white = said.starts_with("What is left is white")
            || said.starts_with("What is left is nearly white");
        // Drag is missing from these; the others lack nothing.
        let lacks = matches!(report.answer, Answer::CannotTell | Answer::Unexplained);
        assert_eq!(white, !lacks, "{:?}: {said}", report.answer);
        assert_eq!(
            said.contains("does not go with the pressure"),
            white,
            "{said}"
        );
    }
}

#[test]
fn the_repaired_curve_has_a_band_behind_it() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        let bands = all(&page, "#run-pictures .series polygon").len();
        let expected = match report.answer {
            Answer::EffectFound | Answer::ParametersOnly => 5,
            _ => 0,
        };
        assert_eq!(bands, expected, "{:?}", report.answer);
        let said = text(all(&page, "#runs p")[0]);
        assert_eq!(said.contains("confidence"), expected > 0, "{said}");
    }
}

#[test]
fn an_error_is_the_same_number_wherever_it_stands() {
    let report = REPORTS
        .iter()
        .find(|report| report.answer == Answer::EffectFound)
        .unwrap();
    let content = &report.content;
    let [fitted, held_out] = &content.errors[..] else {
        panic!("two rows")
    };
    let rows = content.tried.iter().flat_map(|group| &group.rows);
    for row in rows {
        if row.name.is_empty() {
            assert_eq!(
                [&row.fitted, &row.held_out],
                [&fitted.refit, &held_out.refit]
            );
        }
        if row.name == "quadratic_damping" {
            let errors = [&fitted.repaired, &held_out.repaired];
            assert_eq!([&row.fitted, &row.held_out], errors);
            assert!(content.keys[2].note.contains(&row.explained));
        }
    }
    let key = format!("{} → {}°", held_out.refit, held_out.repaired);
    assert_eq!(content.keys[0].value, key);
    for error in [&held_out.refit, &held_out.repaired, &held_out.floor] {
        assert!(
            content.lede.contains(&format!("{error}°")),
            "{}",
            content.lede
        );
    }
    // No error or parameter that a person reads has more than three digits that count.
    let long = |text: &str| {
        text.trim_start_matches(['0', '.', '−'])
            .replace('.', "")
            .len()
            > 3
    };
    let page = Html::parse_document(&report.html);
    for cell in all(
        &page,
        ".totals td:not([data-label=number]), .parameters td.number",
    ) {
        // An error and its fit.
        assert!(!text(cell).split_whitespace().any(long), "{}", text(cell));
    }
}

#[test]
fn hashes_are_those_of_the_files() {
    use sha2::{Digest, Sha256};
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        let shown: Vec<String> = all(&page, ".files .hash").into_iter().map(text).collect();
        // Each recording of the example has its metadata beside it.
        let found: Vec<String> = report
            .files
            .iter()
            .flat_map(|path| {
                let meta = path.to_string_lossy().replace(".csv", ".meta.toml");
                let meta = Path::new(&meta).to_owned();
                let meta = (meta != *path).then_some(meta);
                std::iter::once(path.clone()).chain(meta)
            })
            .map(|path| {
                let digest = Sha256::digest(fs::read(path).unwrap());
                digest
                    .iter()
                    .fold(String::new(), |text, byte| text + &format!("{byte:02x}"))
            })
            .collect();
        assert_eq!(shown, found);
    }
}

#[test]
fn the_same_diagnosis_gives_the_same_bytes_but_for_the_wall_time() {
    for report in REPORTS.iter() {
        let different: Vec<(&str, &str)> = report
            .html
            .lines()
            .zip(report.later.lines())
            .filter(|(a, b)| a != b)
            .collect();
        assert_eq!(different.len(), 1, "{different:?}");
        assert!(different[0].0.contains("wall time"));
        assert_eq!(report.html.lines().count(), report.later.lines().count());
    }
}

#[test]
fn what_explains_too_little_has_no_probability() {
    for report in REPORTS.iter() {
        let page = Html::parse_document(&report.html);
        let unexplained = report.answer == Answer::Unexplained;
        let line = "Closest, but not good enough:";
        assert_eq!(report.summary.contains(line), unexplained);
        assert_eq!(all(&page, "p.closest").len(), usize::from(unexplained));
        if unexplained {
            assert!(text(all(&page, "p.closest")[0]).starts_with(line));
            assert!(!report.summary.contains("probability"));
            assert!(all(&page, "[data-label=probability]").is_empty());
            assert!(!all(&page, "tr.closest .tag").is_empty());
            assert!(report.content.lede.contains("That is not enough"));
        }
    }
}

#[test]
fn a_run_is_promised_only_where_it_is_expected_to_separate() {
    let report = REPORTS
        .iter()
        .find(|report| report.answer == Answer::CannotTell)
        .unwrap();
    assert!(report.content.lede.contains("The run proposed below"));
    assert!(report.summary.contains("Next experiment: steps"));
    let mut weak = report.content.clone();
    weak.next_suffices = false;
    let said = summary(&weak, &Outputs::default(), 1, 1.0);
    assert!(said.contains("a different measurement"), "{said}");
    weak.next.clear();
    let said = summary(&weak, &Outputs::default(), 1, 1.0);
    assert!(said.contains("none that the board can make"), "{said}");
}

#[test]
fn the_terminal_says_the_same_in_25_lines() {
    for report in REPORTS.iter() {
        let lines: Vec<&str> = report.summary.lines().collect();
        assert!(lines.len() <= 25, "{}\n{}", lines.len(), report.summary);
        assert_eq!(lines[0], report.content.sentence);
        let page = Html::parse_document(&report.html);
        let words = |cell| text(cell).split_whitespace().collect::<Vec<_>>().join(" ");
        let cells: Vec<String> = all(&page, ".totals td").into_iter().map(words).collect();
        for row in &report.content.errors {
            let [error, fit] = [&row.refit, &row.fits[1]];
            assert!(report.summary.contains(&format!("{error}, {fit}")));
            assert!(cells.contains(&format!("{error} {fit}")), "{cells:?}");
        }
        assert!(report.summary.contains("Report: report.html"));
        // Also where much is to be said about many recordings.
        let mut noted = report.content.clone();
        let notice = Notice {
            about: Some("run".to_owned()),
            text: "samples are missing".to_owned(),
            advice: "record it again".to_owned(),
        };
        noted.notices = vec![notice; 30];
        let said = summary(&noted, &Outputs::default(), 1, 1.0);
        assert_eq!(said.lines().count(), 25, "{said}");
        assert!(said.contains("more notes on the page"), "{said}");
        let named = report.answer == Answer::EffectFound;
        assert_eq!(lines[2].contains("repaired"), named, "{}", report.summary);
    }
}
