//! The loop in the page: an empty board is flashed, checked, recorded, diagnosed, repaired and recorded
//! again. The browser's serial port is a socket, with a virtual rig at its end.

use std::fs;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use serde_json::Value;
use softrig_lab_tests::browser::{Browser, browser};
use softrig_lab_tests::person::{Person, page};
use softrig_link::{Channel, Connector, SerialConnector};
use tungstenite::{Message, WebSocket};

use super::served::{PORT, VirtualRig};

/// A desk, and a phone.
const WIDTHS: [u32; 2] = [1280, 380];

/// How long a socket waits for what the browser sends.
const WAIT: Duration = Duration::from_millis(2);

/// A cable from a socket to the port of a virtual rig.
struct Cable {
    address: u16,
    pulled: Arc<AtomicBool>,
}

impl Cable {
    fn to(rig: &VirtualRig) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().port();
        let port = rig.folder.path().join(PORT).display().to_string();
        let pulled = Arc::new(AtomicBool::new(false));
        let is_pulled = Arc::clone(&pulled);
        thread::spawn(move || {
            // One at a time, as with a port.
            for stream in listener.incoming().flatten() {
                if is_pulled.load(Ordering::Relaxed) {
                    continue;
                }
                let Ok(socket) = tungstenite::accept(stream) else {
                    continue;
                };
                if let Ok(board) = SerialConnector::new(&port).open() {
                    carries(socket, board, &is_pulled);
                }
            }
        });
        Self { address, pulled }
    }

    fn is_pulled(&self, yes: bool) {
        self.pulled.store(yes, Ordering::Relaxed);
    }

    /// The script that gives a page this port.
    fn script(&self) -> String {
        include_str!("port.js").replace("PORT", &self.address.to_string())
    }
}

/// Carries bytes both ways until one side ends.
fn carries(mut socket: WebSocket<TcpStream>, board: Channel, is_pulled: &AtomicBool) {
    let Channel {
        mut reader,
        mut writer,
    } = board;
    let (sender, came) = channel();
    let reading = thread::spawn(move || {
        let mut bytes = [0; 4096];
        loop {
            match reader.read(&mut bytes) {
                Ok(0) => return,
                Ok(count) if sender.send(bytes[..count].to_vec()).is_err() => return,
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::TimedOut => {
                    if sender.send(Vec::new()).is_err() {
                        return;
                    }
                }
                Err(_) => return,
            }
        }
    });
    socket.get_ref().set_read_timeout(Some(WAIT)).unwrap();
    let mut is_open = true;
    while is_open && !is_pulled.load(Ordering::Relaxed) {
        is_open = match socket.read() {
            Ok(Message::Binary(bytes)) => writer.write_all(&bytes).is_ok(),
            Ok(Message::Close(_)) => false,
            Ok(_) => true,
            Err(tungstenite::Error::Io(error)) => {
                matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
            }
            Err(_) => false,
        };
        let bytes: Vec<u8> = came.try_iter().flatten().collect();
        is_open &= bytes.is_empty() || socket.send(Message::binary(bytes)).is_ok();
    }
    // The port is free again when the browser hears that it is closed.
    drop((came, writer));
    let _ = reading.join();
    let _ = socket.flush();
}

/// Page, browser and rig; none where something was not built.
fn all(arguments: &[&str], erased: bool) -> Option<(PathBuf, Browser, VirtualRig)> {
    let page = page()?;
    let browser = browser()?;
    let rig = if erased {
        super::served::programs()?;
        VirtualRig::erased(arguments)
    } else {
        VirtualRig::start(arguments)
    };
    Some((page, browser, rig?))
}

fn connects(person: &Person) {
    person.presses("connect");
    person.waits();
}

fn done(person: &Person) -> String {
    person.waits();
    let said = person.reads("rig-findings") + &person.reads("rig-stage");
    assert_eq!(person.reads("trouble"), "", "{said}");
    person.reads("rig-done")
}

#[test]
fn an_empty_board_becomes_a_repaired_model_in_the_page() {
    let drawn = ["--hide", "1", "--seed", "1", "--speed", "max"];
    let Some((path, browser, rig)) = all(&drawn, true) else {
        return;
    };
    let cable = Cable::to(&rig);
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page_with_board");
    fs::create_dir_all(&pictures).unwrap();
    let person = Person::finds(&browser, &path, WIDTHS[0], &cable.script());
    connects(&person);
    person.0.shoot(&pictures.join("connected.png"));

    person.presses("flash");
    assert!(done(&person).contains("has the same checksum"));

    person.presses("check");
    // The page cannot know that this board's time is simulated: its second is short, and its lines
    // come when the processor has time. What does not ask when they come passes.
    let checked = done(&person);
    assert!(checked.contains("Clock"), "{checked}");
    for title in ["Firmware and settings", "Arithmetic", "Sensors at rest"] {
        assert!(!checked.contains(title), "{checked}");
        let passed = format!("{title}: passed.");
        assert!(person.reads("rig-findings").contains(&passed), "{passed}");
    }

    person.enters("protocol", "steps");
    person.presses("record");
    person.waits_until("parseFloat(document.getElementById('rig-now').textContent) > 110");
    person.0.shoot(&pictures.join("recording.png"));
    let recorded = done(&person);
    assert!(recorded.starts_with("run1.csv: "), "{recorded}");
    assert!(recorded.contains("no steps lost"), "{recorded}");

    person.presses("diagnose");
    person.waits();
    assert_eq!(person.reads("trouble"), "");

    person.enters("protocol", "follow");
    person.presses("record");
    let followed = done(&person);
    assert!(followed.starts_with("run2.csv: "), "{followed}");

    person.presses("upload");
    let uploaded = done(&person);
    assert!(uploaded.contains("stored and read back"), "{uploaded}");

    for (protocol, file) in [("follow", "run3.csv: "), ("steps", "run4.csv: ")] {
        person.enters("protocol", protocol);
        person.presses("record");
        let again = done(&person);
        assert!(again.starts_with(file), "{again}");
    }
    let sentence = person.reads("gap-sentence");
    assert!(sentence.contains("shrank"), "{sentence}");
    println!("{sentence}");
    let tracking = person.reads("gap-tracking");
    assert!(tracking.contains("misses its set-points by"), "{tracking}");

    for width in WIDTHS {
        person.0.load(&path, width);
        person.waits();
        person.fits(&format!("the page at {width} px"));
        person.0.shoot(&pictures.join(format!("loop_{width}.png")));
    }
    assert_eq!(person.reads("gap-sentence"), sentence);
    person.has_no_complaints();
}

/// Whether the board has stopped for a computer that fell silent: pump off, vent open.
fn has_lost_the_computer(rig: &VirtualRig) -> bool {
    let output = rig.rig(&["log", "--port", PORT]);
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8_lossy(&output.stdout).to_lowercase();
    println!("{said}");
    said.contains("computer lost")
}

/// Begins a protocol, and waits until the pump runs.
fn runs(person: &Person) {
    connects(person);
    person.enters("protocol", "steps");
    person.presses("record");
    person.waits_until("document.getElementById('rig-now').textContent.includes('running')");
}

#[test]
fn the_space_bar_stops_the_pump_and_keeps_what_was_recorded() {
    let Some((path, browser, rig)) = all(&["--hide", "2"], false) else {
        return;
    };
    let cable = Cable::to(&rig);
    let person = Person::finds(&browser, &path, WIDTHS[0], &cable.script());
    runs(&person);
    let is_in_view = "(() => { const at = document.getElementById('rig-stop').getBoundingClientRect(); \
         return at.width > 0 && at.bottom <= innerHeight && at.right <= innerWidth; })()";
    assert_eq!(person.0.value(is_in_view), Value::Bool(true));
    person.0.types(" ", "Space");
    person.waits();
    let trouble = person.reads("trouble");
    assert!(trouble.contains("the pump was told to stop"), "{trouble}");
    assert_eq!(person.counts("#runs .run"), 1);
    assert!(!has_lost_the_computer(&rig));
}

#[test]
fn a_closed_tab_and_a_pulled_cable_leave_the_pump_off() {
    let Some((path, browser, rig)) = all(&["--hide", "2"], false) else {
        return;
    };
    let cable = Cable::to(&rig);
    let person = Person::finds(&browser, &path, WIDTHS[0], &cable.script());
    runs(&person);
    // A second tab finds the port in use.
    let second = Person::finds(
        &browser,
        &path,
        WIDTHS[0],
        &format!(
            "{}; indexedDB.open = () => {{ throw 0; }};",
            cable.script().replace(
                "new WebSocket(address)",
                "new WebSocket('ws://127.0.0.1:9')"
            )
        ),
    );
    connects(&second);
    second.presses("check");
    second.waits();
    let trouble = second.reads("trouble");
    assert!(trouble.contains("another tab"), "{trouble}");
    second.0.close();

    cable.is_pulled(true);
    person.waits_until(
        "document.getElementById('rig-findings').textContent.includes('connection was lost')",
    );
    thread::sleep(Duration::from_secs(4));
    cable.is_pulled(false);
    person.waits();
    let trouble = person.reads("trouble");
    assert!(
        trouble.contains("samples are kept in run1.csv"),
        "{trouble}"
    );
    assert_eq!(person.counts("#runs .run"), 1);

    runs(&person);
    person.0.close();
    thread::sleep(Duration::from_secs(4));
    assert!(has_lost_the_computer(&rig));

    // What both had recorded is there when the page is opened again.
    let again = Person::finds(&browser, &path, WIDTHS[0], &cable.script());
    again.waits();
    let files = again.reads("runs");
    for file in ["run1.csv", "run2.csv"] {
        assert!(files.contains(file), "{files}");
    }
}
