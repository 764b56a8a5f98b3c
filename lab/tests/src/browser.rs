//! Pages in headless Chromium, for tests that look at them.
//!
//! `cargo xtask test` says where Chromium is. Without it there is nothing to run, and the tests say
//! so. Where the browser does not answer, a test ends. Of Chromium's `DevTools` protocol this takes a
//! dozen commands, which are JSON over a web socket; the libraries for it compile all of them.
#![allow(clippy::missing_panics_doc)]

use std::cell::{Cell, RefCell};
use std::env;
use std::fs;
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Message, WebSocket, client::client_with_config};

const CHROMIUM: &str = "SOFTRIG_CHROMIUM";

/// How long Chromium may take to start.
const START: Duration = Duration::from_secs(60);
/// How long a page may be silent: what it computes takes minutes on a busy computer.
const SILENT: Duration = Duration::from_secs(600);

/// Without a window, a sandbox (a container's user is often root, with which it refuses to start),
/// the network, and savings that slow down what nobody sees.
const FLAGS: [&str; 13] = [
    "--headless",
    "--no-sandbox",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
    "--disable-gpu",
    "--disable-quic",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-background-timer-throttling",
    "--disable-backgrounding-occluded-windows",
    "--disable-renderer-backgrounding",
];

/// A browser that ends with this.
#[derive(Debug)]
pub struct Browser {
    process: Child,
    /// Where it keeps what it knows, and says where it listens.
    profile: TempDir,
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A browser; none where it is not said which, which is printed.
pub fn browser() -> Option<Browser> {
    let Some(chromium) = env::var_os(CHROMIUM) else {
        println!("skipped: {CHROMIUM} is not set; `cargo xtask test` sets it");
        return None;
    };
    let profile = tempfile::tempdir().expect("a folder");
    let process = Command::new(chromium)
        .args(FLAGS)
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("Chromium starts");
    Some(Browser { process, profile })
}

impl Browser {
    /// The port and the path at which it listens.
    fn address(&self) -> (String, String) {
        let file = self.profile.path().join("DevToolsActivePort");
        let began = Instant::now();
        loop {
            let text = fs::read_to_string(&file).unwrap_or_default();
            if let Some((port, path)) = text.split_once('\n')
                && path.starts_with('/')
            {
                return (port.to_owned(), path.trim().to_owned());
            }
            assert!(began.elapsed() < START, "Chromium does not listen");
            sleep(Duration::from_millis(20));
        }
    }
}

/// A page in a browser, with what it complained about.
#[derive(Debug)]
pub struct Page {
    socket: RefCell<WebSocket<TcpStream>>,
    target: String,
    session: String,
    /// Number of the last command.
    last: Cell<u64>,
    /// How often it was loaded.
    loads: Cell<u32>,
    complaints: RefCell<Vec<String>>,
}

impl Page {
    /// Opens an empty one.
    pub fn open(browser: &Browser) -> Self {
        let (port, path) = browser.address();
        let stream = TcpStream::connect(format!("127.0.0.1:{port}")).expect("Chromium's port");
        stream.set_read_timeout(Some(SILENT)).expect("a limit");
        // A picture of a whole page is one message.
        let config = WebSocketConfig::default()
            .max_message_size(None)
            .max_frame_size(None);
        let url = format!("ws://127.0.0.1:{port}{path}");
        let (socket, _) = client_with_config(url, stream, Some(config)).expect("a socket");
        let mut page = Self {
            socket: RefCell::new(socket),
            target: String::new(),
            session: String::new(),
            last: Cell::new(0),
            loads: Cell::new(0),
            complaints: RefCell::new(Vec::new()),
        };
        let text = |value: &Value| value.as_str().expect("an identifier").to_owned();
        let created = page.asks("Target.createTarget", &json!({ "url": "about:blank" }));
        page.target = text(&created["targetId"]);
        let attached = page.asks(
            "Target.attachToTarget",
            &json!({ "targetId": page.target, "flatten": true }),
        );
        page.session = text(&attached["sessionId"]);
        for domain in ["Page", "Log", "Runtime"] {
            page.asks(&format!("{domain}.enable"), &json!({}));
        }
        page
    }

    /// Sends a command and waits for its answer.
    fn asks(&self, method: &str, parameters: &Value) -> Value {
        let id = self.last.get() + 1;
        self.last.set(id);
        let mut command = json!({ "id": id, "method": method, "params": parameters });
        if !self.session.is_empty() {
            command["sessionId"] = json!(self.session);
        }
        let mut socket = self.socket.borrow_mut();
        socket
            .send(Message::text(command.to_string()))
            .expect("Chromium listens");
        loop {
            let said = self.hears(&mut socket);
            if said["id"] == id {
                assert!(said["error"].is_null(), "{method}: {}", said["error"]);
                return said["result"].clone();
            }
        }
    }

    /// The next message, of which complaints and loads are kept.
    fn hears(&self, socket: &mut WebSocket<TcpStream>) -> Value {
        loop {
            let Message::Text(text) = socket.read().expect("Chromium answers") else {
                continue;
            };
            let said: Value = serde_json::from_str(&text).expect("JSON");
            match said["method"].as_str() {
                Some("Log.entryAdded" | "Runtime.exceptionThrown" | "Runtime.consoleAPICalled") => {
                    self.complaints
                        .borrow_mut()
                        .push(said["params"].to_string());
                }
                Some("Page.loadEventFired") => self.loads.set(self.loads.get() + 1),
                _ => {}
            }
            return said;
        }
    }

    /// What it complained about so far.
    pub fn complaints(&self) -> Vec<String> {
        // What was said before comes before the answer.
        self.value("0");
        self.complaints.borrow().clone()
    }

    /// Sends a command that loads the page, and waits until it is loaded.
    fn loads(&self, method: &str, parameters: &Value) {
        let before = self.loads.get();
        self.asks(method, parameters);
        let mut socket = self.socket.borrow_mut();
        while self.loads.get() == before {
            self.hears(&mut socket);
        }
    }

    /// Loads a file at a width.
    pub fn load(&self, path: &Path, width: u32) {
        self.asks(
            "Emulation.setDeviceMetricsOverride",
            &json!({
                "width": width, "height": 900, "deviceScaleFactor": 1.0, "mobile": width < 600,
            }),
        );
        let url = format!("file://{}", path.display());
        self.loads("Page.navigate", &json!({ "url": url }));
    }

    /// Runs a script before any that the page has, whatever the page's rules for content are.
    pub fn begins_with(&self, script: &str) {
        self.asks("Page.setBypassCSP", &json!({ "enabled": true }));
        self.asks(
            "Page.addScriptToEvaluateOnNewDocument",
            &json!({ "source": script }),
        );
    }

    /// Presses a key that has a text, as the space bar.
    pub fn types(&self, key: &str, code: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.asks(
                "Input.dispatchKeyEvent",
                &json!({ "type": kind, "key": key, "code": code }),
            );
        }
    }

    /// Loads it again.
    pub fn reload(&self) {
        self.loads("Page.reload", &json!({}));
    }

    /// Shows it in a colour scheme.
    pub fn prefers(&self, scheme: &str) {
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.asks(
            "Emulation.setEmulatedMedia",
            &json!({ "features": features }),
        );
    }

    /// What a script is worth.
    pub fn value(&self, script: &str) -> Value {
        let found = self.asks(
            "Runtime.evaluate",
            &json!({ "expression": script, "returnByValue": true, "awaitPromise": true }),
        );
        assert!(found["exceptionDetails"].is_null(), "{script}: {found}");
        found["result"]["value"].clone()
    }

    /// The number that a script is worth.
    pub fn number(&self, script: &str) -> f64 {
        self.value(script).as_f64().expect(script)
    }

    /// The text that a script is worth.
    pub fn text(&self, script: &str) -> String {
        self.value(script).as_str().expect(script).to_owned()
    }

    /// Gives files to the field that a selector finds.
    pub fn gives(&self, selector: &str, files: &[&str]) {
        let document = self.asks("DOM.getDocument", &json!({}));
        let field = self.asks(
            "DOM.querySelector",
            &json!({ "nodeId": document["root"]["nodeId"], "selector": selector }),
        );
        self.asks(
            "DOM.setFileInputFiles",
            &json!({ "nodeId": field["nodeId"], "files": files }),
        );
    }

    /// Moves the mouse.
    pub fn points_at(&self, x: f64, y: f64) {
        self.asks(
            "Input.dispatchMouseEvent",
            &json!({ "type": "mouseMoved", "x": x, "y": y }),
        );
    }

    /// Presses the tabulator key.
    pub fn tabs(&self) {
        for kind in ["rawKeyDown", "keyUp"] {
            self.asks(
                "Input.dispatchKeyEvent",
                &json!({ "type": kind, "key": "Tab", "code": "Tab", "windowsVirtualKeyCode": 9 }),
            );
        }
    }

    /// Saves downloads in a folder.
    pub fn saves_into(&self, folder: &Path) {
        self.asks(
            "Browser.setDownloadBehavior",
            &json!({ "behavior": "allow", "downloadPath": folder }),
        );
    }

    /// The whole page as a picture.
    pub fn shoot(&self, path: &Path) {
        let taken = self.asks(
            "Page.captureScreenshot",
            &json!({
                "format": "png", "captureBeyondViewport": true,
                "clip": {
                    "x": 0.0, "y": 0.0, "scale": 1.0,
                    "width": self.number("document.documentElement.clientWidth"),
                    // Longer than any picture that can be looked at.
                    "height": self.number("document.documentElement.scrollHeight").min(12_000.0),
                },
            }),
        );
        let bytes = base64(taken["data"].as_str().expect("a picture"));
        assert!(bytes.starts_with(b"\x89PNG"));
        fs::write(path, bytes).expect("a folder for screenshots");
    }

    /// The page as it is printed: PDF.
    pub fn print(&self) -> Vec<u8> {
        let printed = self.asks("Page.printToPDF", &json!({}));
        base64(printed["data"].as_str().expect("a print"))
    }

    /// Closes it.
    pub fn close(self) {
        self.asks("Target.closeTarget", &json!({ "targetId": self.target }));
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
