//! The report in headless Chromium: it loads without a complaint at the width
//! of a desk and of a phone, hovering reads values off the pictures, switches
//! work, and it prints. Screenshots are left for someone to look at.
//!
//! `cargo xtask test` says where Chromium is. Without it there is nothing to
//! run, and the test says so.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use softrig::diagnose::decide::verdict::Answer;
use softrig_lab_tests::browser::{Browser, Page, browser};
use softrig_lab_tests::reports::{Report, of_every_kind};
use softrig_report::pictures::{NOMINAL, REFITTED};

/// Widths of a desk and of a phone.
const WIDTHS: [u32; 2] = [1280, 390];

/// Moves the mouse onto the middle of the first panel of a picture.
fn hover(page: &Page, picture: &str) {
    let place = format!(
        "(() => {{ const svg = document.querySelector('{picture}'); \
         svg.scrollIntoView({{block: 'center', behavior: 'instant'}}); \
         const panel = svg.querySelector('.panel').dataset.area.split(' ').map(Number); \
         const at = new DOMPoint((panel[0] + panel[2]) / 2, (panel[1] + panel[3]) / 2) \
           .matrixTransform(svg.getScreenCTM()); return at.x + ' ' + at.y; }})()"
    );
    let place = page.text(&place);
    let (x, y) = place.split_once(' ').expect("two numbers");
    let number = |text: &str| -> f64 { text.parse().expect("a number") };
    page.points_at(number(x), number(y));
}

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("report_in_browser");
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

#[test]
fn the_report_works_in_a_browser() {
    let Some(browser) = browser() else { return };
    let folder = folder();
    for report in of_every_kind(&folder.join("cases")) {
        look_at(&browser, &report, &folder);
    }
    println!("screenshots: {}", folder.display());
}

fn look_at(browser: &Browser, report: &Report, folder: &Path) {
    let name = format!("{:?}", report.answer);
    let path = folder.join(format!("{name}.html"));
    fs::write(&path, &report.html).expect("a page");
    let page = Page::open(browser);
    for width in WIDTHS {
        page.load(&path, width);
        let overflow = page
            .number("document.documentElement.scrollWidth - document.documentElement.clientWidth");
        assert!(
            overflow <= 0.0,
            "{name} at {width} px is {overflow} px too wide"
        );
        page.shoot(&folder.join(format!("{name}_{width}.png")));
        hovering_reads_values(&page, report);
        dragging_looks_closer(&page);
        switches_hide_what_they_name(&page, report);
    }
    let printed = page.print();
    let pages = printed
        .windows(b"/Type /Page\n".len())
        .filter(|part| *part == b"/Type /Page\n")
        .count();
    assert!(
        printed.starts_with(b"%PDF") && pages > 0,
        "{name}: {pages} pages"
    );
    fs::write(folder.join(format!("{name}.pdf")), printed).expect("a print");
    let complaints = page.complaints();
    assert!(complaints.is_empty(), "{name}: {complaints:?}");
    page.close();
}

fn hovering_reads_values(page: &Page, report: &Report) {
    assert_eq!(page.value("readout.hidden"), Value::Bool(true));
    hover(page, "#run-pictures svg");
    let said = page.text("readout.textContent");
    assert_eq!(page.value("readout.hidden"), Value::Bool(false));
    assert!(said.starts_with("time (s): "), "{said:?}");
    for curve in ["measured", a_curve(report)] {
        assert!(said.contains(&format!("{curve}: ")), "{said:?}");
    }
    // What is read off is what was drawn: the last sample of the curve.
    let outside = page.value("document.querySelectorAll('.hair').length");
    assert_ne!(outside, json!(0));
    if report.answer == Answer::Unexplained {
        hover(page, ".map svg");
        let cell = page.number("document.querySelectorAll('.map .cell').length");
        assert!(cell > 10.0);
    }
    page.points_at(1.0, 1.0);
    assert_eq!(page.value("readout.hidden"), Value::Bool(true));
}

/// From a quarter to three quarters of the first panel: half of the time is left, in every
/// panel of the picture, until a double click.
fn dragging_looks_closer(page: &Page) {
    let ranges = "[...document.querySelector('#run-pictures svg').querySelectorAll('.panel')]\
                  .map((panel) => panel.dataset.x)";
    let drag = "(() => { const svg = document.querySelector('#run-pictures svg'); \
        const area = svg.querySelector('.panel').dataset.area.split(' ').map(Number); \
        const fire = (to, kind, share) => { \
          const at = new DOMPoint(area[0] + share * (area[2] - area[0]), (area[1] + area[3]) / 2) \
            .matrixTransform(svg.getScreenCTM()); \
          to.dispatchEvent(new PointerEvent(kind, {clientX: at.x, clientY: at.y, button: 0, \
            pointerType: 'mouse', bubbles: true})); }; \
        fire(svg, 'pointerdown', 0.25); fire(window, 'pointermove', 0.75); \
        fire(window, 'pointerup', 0.75); return 0; })()";
    let read = || -> Vec<[f64; 2]> {
        let text = page.text(&format!("{ranges}.join(' ')"));
        let numbers: Vec<f64> = text
            .split(' ')
            .map(|number| number.parse().expect("a number"))
            .collect();
        numbers.chunks(2).map(|pair| [pair[0], pair[1]]).collect()
    };
    let before = read();
    page.number(drag);
    let after = read();
    assert!(before.len() > 1 && after.len() == before.len());
    for ([low, high], [left, right]) in before.iter().zip(&after) {
        // Within a pixel.
        let width = high - low;
        assert!((left - (low + 0.25 * width)).abs() < 0.01 * width, "{left}");
        assert!(
            (right - (low + 0.75 * width)).abs() < 0.01 * width,
            "{right}"
        );
    }
    page.value(
        "document.querySelector('#run-pictures svg').dispatchEvent(new MouseEvent('dblclick'))",
    );
    assert_eq!(read(), before);
}

/// The label of a curve that every run of a report has.
fn a_curve(report: &Report) -> &'static str {
    if report.answer == Answer::CannotTell {
        REFITTED
    } else {
        NOMINAL
    }
}

fn switches_hide_what_they_name(page: &Page, report: &Report) {
    let curve = a_curve(report);
    let drawn = "[...document.querySelectorAll('#run-pictures figure')]\
                 .filter((figure) => figure.offsetHeight > 0).length";
    let lines = format!(
        "[...document.querySelectorAll('#run-pictures .series[data-label={curve}]')]\
         .filter((series) => series.getBoundingClientRect().height > 0).length"
    );
    let lines = lines.as_str();
    let click = |kind: &str| {
        let switch =
            format!("document.querySelector('[data-switches={kind}] input[value=KEY]').click()");
        let key = if kind == "runs" { "'0'" } else { curve };
        page.value(&switch.replace("KEY", &key.replace('\'', "\"")));
    };
    let before = (page.number(drawn), page.number(lines));
    assert!(before.0 > 1.0 && before.1 > 1.0);
    click("runs");
    assert!((page.number(drawn) - (before.0 - 1.0)).abs() < 0.5);
    click("curves");
    assert!(page.number(lines).abs() < 0.5);
    click("runs");
    click("curves");
    let after = (page.number(drawn), page.number(lines));
    assert!((after.0 - before.0).abs() < 0.5 && (after.1 - before.1).abs() < 0.5);
}
