//! The page for a browser, as somebody uses it: chooses files, presses buttons, reads.
#![allow(clippy::missing_panics_doc)]

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::browser::{Browser, Page};

const PAGE: &str = "SOFTRIG_PAGE";

/// The longest that anything may take on a computer with other work (s).
const LIMIT_S: u64 = 900;

/// The page that `cargo xtask test` built; none where it is not said, which is printed.
pub fn page() -> Option<PathBuf> {
    let page = env::var_os(PAGE).map(PathBuf::from);
    if page.is_none() {
        println!("skipped: {PAGE} is not set; `cargo xtask test` sets it");
    }
    page
}

/// The page, as somebody uses it.
#[derive(Debug)]
pub struct Person(pub Page);

impl Person {
    /// Somebody who has opened the page in a browser, at a width.
    pub fn opens(browser: &Browser, page: &Path, width: u32) -> Self {
        Self::finds(browser, page, width, "")
    }

    /// As [`opens`](Self::opens), in a browser in which a script has run before the page.
    pub fn finds(browser: &Browser, page: &Path, width: u32, before: &str) -> Self {
        let person = Self(Page::open(browser));
        if !before.is_empty() {
            person.0.begins_with(before);
        }
        person.0.load(page, width);
        person.waits();
        person
    }

    /// Loads the page again.
    pub fn reloads(&self) {
        self.0.reload();
        self.waits();
    }

    /// Waits until a script is true.
    pub fn waits_until(&self, script: &str) {
        let began = Instant::now();
        while self.0.value(script) != Value::Bool(true) {
            let said = "status.textContent + ' | ' + trouble.textContent";
            assert!(
                began.elapsed() < Duration::from_secs(LIMIT_S),
                "never: {script}; the page says {}",
                self.0.text(&by_id(said))
            );
            sleep(Duration::from_millis(100));
        }
    }

    /// Until the page has done what it was asked.
    pub fn waits(&self) {
        self.waits_until(
            "document.readyState === 'complete' && document.getElementById('version').textContent \
             !== '' && !document.body.classList.contains('busy')",
        );
    }

    /// Chooses files in the field of the page.
    pub fn chooses(&self, files: &[PathBuf]) {
        let names: Vec<&str> = files
            .iter()
            .map(|path| path.to_str().expect("a plain name"))
            .collect();
        self.0.gives("#files", &names);
        for path in files {
            let name = path.file_name().expect("a name").to_string_lossy();
            self.waits_until(&format!(
                "document.querySelector('main').textContent.includes('{name}')"
            ));
        }
        self.waits();
    }

    /// Presses the button of this id.
    pub fn presses(&self, id: &str) {
        self.0
            .value(&format!("document.getElementById('{id}').click()"));
    }

    /// Enters a value in the field of this id.
    pub fn enters(&self, id: &str, value: &str) {
        self.0.value(&format!(
            "(() => {{ const field = document.getElementById('{id}'); field.value = '{value}'; \
             field.dispatchEvent(new Event('change', {{ bubbles: true }})); }})()"
        ));
        self.waits();
    }

    /// Ticks the box that keeps a recording for validation.
    pub fn holds_out(&self, path: &Path) {
        let name = path.file_name().expect("a name").to_string_lossy();
        self.0.value(&format!(
            "[...document.querySelectorAll('.run')].find((run) => \
             run.querySelector('h3').firstChild.textContent === '{name}')\
             .querySelector('input').click()"
        ));
        self.waits();
    }

    /// The text of the element of this id.
    pub fn reads(&self, id: &str) -> String {
        self.0
            .text(&format!("document.getElementById('{id}').textContent"))
    }

    /// How many elements a selector finds.
    pub fn counts(&self, selector: &str) -> u64 {
        let script = format!("document.querySelectorAll('{selector}').length");
        self.0.value(&script).as_u64().expect("a number")
    }

    /// What a link saves.
    pub fn saves(&self, id: &str, name: &str, into: &Path) -> String {
        self.0.saves_into(into);
        self.presses(id);
        let path = into.join(name);
        let began = Instant::now();
        while !path.exists() {
            assert!(
                began.elapsed() < Duration::from_secs(60),
                "{name} is not saved"
            );
            sleep(Duration::from_millis(50));
        }
        sleep(Duration::from_millis(100));
        fs::read_to_string(path).expect("what was saved")
    }

    /// The browser found nothing wrong.
    pub fn has_no_complaints(&self) {
        let complaints = self.0.complaints();
        assert!(complaints.is_empty(), "{complaints:?}");
    }

    /// Nothing is wider than the window.
    pub fn fits(&self, what: &str) {
        let script = "document.documentElement.scrollWidth - document.documentElement.clientWidth";
        let over = self.0.number(script);
        assert!(over <= 0.0, "{what} is {over} px too wide");
    }
}

/// A script in which elements go by their ids.
fn by_id(script: &str) -> String {
    script
        .replace("status.", "document.getElementById('status').")
        .replace("trouble.", "document.getElementById('trouble').")
}
