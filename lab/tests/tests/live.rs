//! `softrig monitor --foxglove` and `--mcap`, with the firmware behind the cable.
use std::time::Duration;

use super::bench::Bench;
use super::bench::board::Script;

/// A client of `softrig monitor --foxglove`: what Foxglove and Lichtblick do.
struct Client(tungstenite::WebSocket<std::net::TcpStream>);

impl Client {
    /// Connects to the address that the monitor invites to.
    fn connect(address: &str) -> Self {
        let stream = std::net::TcpStream::connect(address.trim_start_matches("ws://")).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        let request = tungstenite::http::Request::builder()
            .uri(address)
            .header("Host", address.trim_start_matches("ws://"))
            .header("Connection", "Upgrade")
            .header("Upgrade", "websocket")
            .header("Sec-WebSocket-Version", "13")
            .header(
                "Sec-WebSocket-Key",
                tungstenite::handshake::client::generate_key(),
            )
            .header("Sec-WebSocket-Protocol", "foxglove.sdk.v1")
            .body(())
            .unwrap();
        Self(tungstenite::client(request, stream).unwrap().0)
    }

    /// What is said next in JSON with this `op`.
    fn hears(&mut self, op: &str) -> serde_json::Value {
        loop {
            if let tungstenite::Message::Text(text) = self.0.read().unwrap() {
                let said: serde_json::Value = serde_json::from_str(&text).unwrap();
                if said["op"] == op {
                    return said;
                }
            }
        }
    }

    /// Subscribes to every topic that is advertised; returns their names by their numbers.
    fn subscribe(&mut self) -> std::collections::BTreeMap<u64, String> {
        let said = self.hears("advertise");
        let channels = said["channels"].as_array().unwrap().iter();
        let topics: std::collections::BTreeMap<u64, String> = channels
            .map(|it| {
                assert_eq!(it["encoding"], "json", "{it}");
                assert_eq!(it["schemaEncoding"], "jsonschema", "{it}");
                let topic = it["topic"].as_str().unwrap().to_owned();
                (it["id"].as_u64().unwrap(), topic)
            })
            .collect();
        let each: Vec<serde_json::Value> = topics
            .keys()
            .map(|id| serde_json::json!({ "id": id, "channelId": id }))
            .collect();
        let request = serde_json::json!({ "op": "subscribe", "subscriptions": each });
        let request = tungstenite::Message::text(request.to_string());
        self.0.send(request).unwrap();
        topics
    }

    /// The next message: the topic's number, its time (ns) and its value; none at the end.
    fn message(&mut self) -> Option<(u64, u64, serde_json::Value)> {
        loop {
            match self.0.read() {
                // What begins with 1 is a message.
                Ok(tungstenite::Message::Binary(bytes)) if bytes[0] == 1 => {
                    let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                    let time_ns = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
                    let said: serde_json::Value = serde_json::from_slice(&bytes[13..]).unwrap();
                    return Some((id.into(), time_ns, said["value"].clone()));
                }
                Ok(_) => {}
                Err(_) => return None,
            }
        }
    }
}

/// What a monitor that was started says before its rows: the address to open.
fn invitation(err: &mut impl std::io::BufRead) -> String {
    let mut line = String::new();
    while !line.contains("ws://") {
        line.clear();
        assert_ne!(err.read_line(&mut line).unwrap(), 0, "nobody is invited");
    }
    let (_, address) = line.trim_end().split_once("ws://").unwrap();
    format!("ws://{address}")
}

/// A client sees the topics at the board's times, while another one never reads; no line of the
/// board is lost for either, and the log is the recording that was printed.
#[test]
fn the_monitor_is_live_for_foxglove_and_logs_the_same() {
    let bench = Bench::new(Script {
        speed: 1,
        ..Script::default()
    });
    let mut monitor =
        bench.start("monitor --port PORT --every 0 --seconds 4 --foxglove 0 --mcap seen.mcap");
    let mut err = std::io::BufReader::new(monitor.stderr.take().unwrap());
    let mut out = monitor.stdout.take().unwrap();
    let printed = std::thread::spawn(move || {
        let mut text = String::new();
        std::io::Read::read_to_string(&mut out, &mut text).unwrap();
        text
    });
    let address = invitation(&mut err);
    assert!(address.starts_with("ws://127.0.0.1:"), "{address}");
    let mut stalled = Client::connect(&address);
    stalled.subscribe();
    let mut client = Client::connect(&address);
    let topics = client.subscribe();
    assert!(topics.values().any(|it| it == "/state"), "{topics:?}");
    let mut angles: Vec<(u64, f64)> = Vec::new();
    let mut states = 0;
    while let Some((topic, time_ns, value)) = client.message() {
        match topics[&topic].as_str() {
            "/angle_deg" => angles.push((time_ns, value.as_f64().unwrap())),
            "/state" => states += usize::from(value == "idle"),
            _ => assert!(value.is_number(), "{value}"),
        }
    }
    assert!(monitor.wait().unwrap().success());
    let mut said = String::new();
    std::io::Read::read_to_string(&mut err, &mut said).unwrap();
    assert!(!said.contains("lost"), "{said}");
    assert!(
        angles.len() > 200 && states > 200,
        "{} {states}",
        angles.len()
    );
    let steps = angles.windows(2).map(|pair| pair[1].0 - pair[0].0);
    assert!(
        steps.clone().all(|step| step == 10_000_000),
        "by the board's clock"
    );
    let printed = printed.join().unwrap();
    let rows: Vec<(f64, f64)> = printed
        .lines()
        .skip(1)
        .map(|line| {
            let mut cells = line.split(',').map(str::parse);
            let time = cells.next().unwrap().unwrap();
            (time, cells.nth(1).unwrap().unwrap())
        })
        .collect();
    // The log is read as what it is, without being told its columns.
    softrig_importers::install();
    let logged = bench.recording("seen.mcap");
    assert!(
        logged.len() >= rows.len(),
        "{} {}",
        logged.len(),
        rows.len()
    );
    for (row, &(time, angle)) in rows.iter().enumerate() {
        assert!((logged.time[row] - time).abs() < 1e-9, "{row}");
        assert!(
            (logged.angle[row].to_degrees() - angle).abs() < 1e-9,
            "{row}"
        );
    }
    let first = angles[0].1;
    assert!(rows.iter().any(|(_, angle)| (angle - first).abs() < 1e-9));
    assert!(
        logged
            .extra
            .iter()
            .any(|it| it.name == "state" && it.fields[0] == "idle")
    );
}

#[test]
fn an_address_that_is_taken_and_a_log_that_is_there_are_refused() {
    let bench = Bench::new(Script::default());
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    for (flags, parts) in [
        (format!("--foxglove {port}"), ["in use", "use a free port"]),
        ("--foxglove nowhere".into(), ["is no port", "HOST:PORT"]),
        ("--foxglove 999999".into(), ["is no port", "HOST:PORT"]),
        ("--mcap m.toml".into(), ["--mcap", "m.toml"]),
        ("--mcap absent/seen.mcap".into(), ["absent", "folder"]),
    ] {
        let line = format!("monitor --port PORT --plain --seconds 1 {flags}");
        bench.rig(&line).failed(2, &parts);
    }
    let silent = Bench::new(Script {
        silent: true,
        ..Script::default()
    });
    let line = "monitor --port PORT --plain --mcap seen.mcap";
    assert_ne!(silent.rig(line).code, Some(0));
    assert!(!silent.path("seen.mcap").exists(), "nothing was seen");
    let monitor = "monitor --port PORT --plain --seconds 0.5 --mcap seen.mcap";
    bench.rig(monitor).ok();
    let before = std::fs::read(bench.path("seen.mcap")).unwrap();
    bench
        .rig(monitor)
        .failed(2, &["seen.mcap", "is a recording that exists"]);
    assert_eq!(std::fs::read(bench.path("seen.mcap")).unwrap(), before);
}
