//! Pages in headless Chromium, for tests that look at them.
//!
//! `cargo xtask test` says where Chromium is. Without it there is nothing to run, and the tests say
//! so. Where the browser does not answer, a test ends.
#![allow(clippy::missing_panics_doc)]

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use headless_chrome::protocol::cdp::Emulation::SetDeviceMetricsOverride;
use headless_chrome::protocol::cdp::Page::CaptureScreenshot;
use headless_chrome::protocol::cdp::types::Event;
use headless_chrome::{Browser, LaunchOptions, Tab};
use serde_json::{Value, json};

const CHROMIUM: &str = "SOFTRIG_CHROMIUM";

/// How long a page may be silent: what it computes takes minutes on a busy computer.
const SILENT: Duration = Duration::from_secs(600);

/// A browser; none where it is not said which, which is printed.
pub fn browser() -> Option<Browser> {
    let Some(chromium) = env::var_os(CHROMIUM) else {
        println!("skipped: {CHROMIUM} is not set; `cargo xtask test` sets it");
        return None;
    };
    let options = LaunchOptions::default_builder()
        .path(Some(chromium.into()))
        // A container's user is often root, with which the sandbox refuses to start.
        .sandbox(false)
        .idle_browser_timeout(SILENT)
        .args(vec![OsStr::new("--hide-scrollbars")])
        .build()
        .expect("options");
    Some(Browser::new(options).expect("Chromium starts"))
}

/// A page in a browser, with what it complained about.
#[allow(missing_debug_implementations)]
pub struct Page {
    /// Its tab.
    pub tab: Arc<Tab>,
    /// What it complained about.
    pub complaints: Arc<Mutex<Vec<String>>>,
}

impl Page {
    /// Opens an empty one.
    pub fn open(browser: &Browser) -> Self {
        let tab = browser.new_tab().expect("a tab");
        let complaints = Arc::new(Mutex::new(Vec::new()));
        let heard = Arc::clone(&complaints);
        tab.add_event_listener(Arc::new(move |event: &Event| {
            let complaint = match event {
                Event::LogEntryAdded(entry) => format!("{entry:?}"),
                Event::RuntimeExceptionThrown(thrown) => format!("{thrown:?}"),
                Event::RuntimeConsoleAPICalled(call) => format!("{call:?}"),
                _ => return,
            };
            heard.lock().expect("no panic before").push(complaint);
        }))
        .expect("a listener");
        tab.enable_log().expect("the log");
        tab.enable_runtime().expect("the console");
        Self { tab, complaints }
    }

    /// Loads a file at a width.
    pub fn load(&self, path: &Path, width: u32) {
        let metrics: SetDeviceMetricsOverride = serde_json::from_value(json!({
            "width": width, "height": 900, "deviceScaleFactor": 1.0, "mobile": width < 600,
        }))
        .expect("metrics");
        self.tab.call_method(metrics).expect("a width");
        let url = format!("file://{}", path.display());
        self.tab.navigate_to(&url).expect("a page");
        self.tab.wait_until_navigated().expect("a loaded page");
    }

    /// What a script is worth.
    pub fn value(&self, script: &str) -> Value {
        let found = self.tab.evaluate(script, true).expect(script);
        found.value.unwrap_or(Value::Null)
    }

    /// The number that a script is worth.
    pub fn number(&self, script: &str) -> f64 {
        self.value(script).as_f64().expect(script)
    }

    /// The text that a script is worth.
    pub fn text(&self, script: &str) -> String {
        self.value(script).as_str().expect(script).to_owned()
    }

    /// The whole page as a picture.
    pub fn shoot(&self, path: &Path) {
        let shot: CaptureScreenshot = serde_json::from_value(json!({
            "format": "png", "captureBeyondViewport": true,
            "clip": {
                "x": 0.0, "y": 0.0, "scale": 1.0,
                "width": self.number("document.documentElement.clientWidth"),
                // Longer than any picture that can be looked at.
                "height": self.number("document.documentElement.scrollHeight").min(12_000.0),
            },
        }))
        .expect("a clip");
        let taken = self.tab.call_method(shot).expect("a screenshot");
        let bytes = base64(&taken.data);
        assert!(bytes.starts_with(b"\x89PNG"));
        fs::write(path, bytes).expect("a folder for screenshots");
    }
}

/// The bytes of what the protocol sends as text.
fn base64(text: &str) -> Vec<u8> {
    let digit = |letter: u8| match letter {
        b'A'..=b'Z' => Some(letter - b'A'),
        b'a'..=b'z' => Some(letter - b'a' + 26),
        b'0'..=b'9' => Some(letter - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None,
    };
    let mut bytes = Vec::with_capacity(text.len() * 3 / 4);
    let (mut bits, mut count) = (0_u32, 0);
    for value in text.bytes().filter_map(digit) {
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count & 0xFF) as u8);
        }
    }
    bytes
}
