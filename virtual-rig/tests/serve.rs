// SPDX-License-Identifier: GPL-3.0-or-later
//! The rig behind its port, as another program sees it.

use std::{
    fs::{self, File, OpenOptions},
    io::{BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
    time::{Duration, Instant},
};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// A running `virtual-rig serve`, killed when dropped.
struct Served {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    port: PathBuf,
}

fn serve(folder: &Path, arguments: &[&str]) -> Served {
    let link = folder.join("port");
    let mut process = Command::new(env!("CARGO_BIN_EXE_virtual-rig"))
        .args(["serve", "--control", "--link"])
        .arg(&link)
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the rig starts");
    let input = process.stdin.take().unwrap();
    let mut output = BufReader::new(process.stdout.take().unwrap());
    let mut line = String::new();
    output.read_line(&mut line).unwrap();
    assert_eq!(line.trim(), format!("port {}", link.display()));
    Served {
        process,
        input,
        output,
        port: link,
    }
}

impl Served {
    fn control(&mut self, command: &str) -> String {
        writeln!(self.input, "{command}").unwrap();
        let mut line = String::new();
        self.output.read_line(&mut line).unwrap();
        line.trim().into()
    }

    fn open(&self) -> Client {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(&self.port)
            .expect("the port opens");
        Client {
            file,
            seen: Vec::new(),
        }
    }

    fn quit(mut self) {
        assert_eq!(self.control("quit"), "ok quit");
        assert!(self.process.wait().unwrap().success());
        assert!(
            fs::symlink_metadata(&self.port).is_err(),
            "the link is gone"
        );
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

struct Client {
    file: File,
    seen: Vec<u8>,
}

impl Client {
    fn send(&mut self, bytes: &[u8]) {
        self.file.write_all(bytes).unwrap();
    }

    /// The text up to and with `until`.
    fn read_until(&mut self, until: &str) -> String {
        let end = Instant::now() + Duration::from_secs(20);
        loop {
            let text = String::from_utf8_lossy(&self.seen).into_owned();
            if let Some(at) = text.find(until) {
                self.seen.drain(..at + until.len());
                return text[..at + until.len()].into();
            }
            assert!(Instant::now() < end, "no {until:?} in {text:?}");
            let mut polled = [PollFd::new(&self.file, PollFlags::IN)];
            let wait = Timespec {
                tv_sec: 0,
                tv_nsec: 100_000_000,
            };
            if poll(&mut polled, Some(&wait)).unwrap() > 0 {
                let mut buffer = [0; 256];
                let length = self.file.read(&mut buffer).unwrap();
                self.seen.extend(&buffer[..length]);
            }
        }
    }
}

/// A folder with `obey.elf` in it.
fn folder() -> Option<tempfile::TempDir> {
    let elf = super::common::obey_elf()?;
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("obey.elf"), elf).unwrap();
    Some(folder)
}

#[test]
fn opening_resets_and_closing_leaves_nothing_behind() {
    let Some(folder) = folder() else { return };
    let mut rig = serve(folder.path(), &["--image", "obey.elf", "--seed", "3"]);
    std::thread::sleep(Duration::from_millis(100));
    let mut client = rig.open();
    assert_eq!(client.read_until("ready\n"), "ready\n");
    client.send(b"xcl");
    client.send(b"m");
    // Arduino's bootloader has cleared the flag of the reset; the status below counts it.
    assert_eq!(client.read_until("\n"), "cause 0\n");
    let status = rig.control("status");
    assert!(
        status.contains("valve=closed") && status.contains("light=on"),
        "{status}"
    );
    assert!(
        status.contains("client=yes bootloader=no resets=1 faults=none"),
        "{status}"
    );
    // An answer that nobody reads.
    client.send(b"f");
    std::thread::sleep(Duration::from_millis(100));
    drop(client);
    std::thread::sleep(Duration::from_millis(100));
    assert!(rig.control("status").contains("client=no"));

    let mut client = rig.open();
    assert_eq!(client.read_until("ready\n"), "ready\n");
    assert!(rig.control("status").contains("valve=open"));
    assert_eq!(rig.control("press emergency-stop"), "ok emergency-stop on");
    client.send(b"k");
    assert_eq!(client.read_until("\n"), "switches 4\n");
    assert!(rig.control("nonsense").starts_with("error not a command"));
    assert_eq!(rig.control("power-cycle"), "ok power-cycle");
    client.read_until("ready\n");
    client.send(b"m");
    assert_eq!(client.read_until("\n"), "cause 0\n");
    rig.quit();
}

#[test]
fn real_time_is_kept() {
    let Some(folder) = folder() else { return };
    let begin = Instant::now();
    let mut rig = serve(folder.path(), &["--image", "obey.elf", "--duration", "2"]);
    assert!(rig.process.wait().unwrap().success());
    let took = begin.elapsed().as_secs_f64();
    assert!((1.95..4.0).contains(&took), "{took} s");
}

#[test]
fn eeprom_is_kept_in_its_file() {
    let Some(folder) = folder() else { return };
    let arguments = ["--image", "obey.elf", "--eeprom", "eeprom.bin"];
    let rig = serve(folder.path(), &arguments);
    let mut client = rig.open();
    client.read_until("ready\n");
    client.send(b"w");
    client.read_until("reads 90");
    drop(client);
    rig.quit();
    let file = folder.path().join("eeprom.bin");
    let stored = fs::read(&file).unwrap();
    assert_eq!((stored.len(), stored[100]), (4096, 0x5a));

    fs::write(&file, b"too short").unwrap();
    let refused = Command::new(env!("CARGO_BIN_EXE_virtual-rig"))
        .current_dir(folder.path())
        .arg("serve")
        .args(arguments)
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(1));
    let message = String::from_utf8_lossy(&refused.stderr);
    assert!(
        message.contains("9 bytes") && message.contains("4096"),
        "{message}"
    );
}

#[test]
fn at_full_speed_no_byte_is_lost_however_slowly_the_client_reads() {
    let Some(folder) = folder() else { return };
    let rig = serve(folder.path(), &["--image", "obey.elf", "--speed", "max"]);
    let mut client = rig.open();
    client.read_until("ready\n");
    let writer = client.file.try_clone().unwrap();
    let count = 3000;
    let writing = std::thread::spawn(move || {
        let mut writer = writer;
        writer.write_all(&b"f".repeat(count)).unwrap();
        writer.write_all(b"!").unwrap();
    });
    std::thread::sleep(Duration::from_millis(300));
    let text = client.read_until("!\n");
    writing.join().unwrap();
    assert_eq!(
        text.lines()
            .filter(|line| line.starts_with("flex "))
            .count(),
        count
    );
    rig.quit();
}

#[test]
fn at_full_speed_commands_are_obeyed_although_nobody_reads() {
    let Some(folder) = folder() else { return };
    let mut rig = serve(folder.path(), &["--image", "obey.elf", "--speed", "max"]);
    let mut client = rig.open();
    client.read_until("ready\n");
    // Answers of 180 kB, more than the kernel keeps for a reader.
    let mut writer = client.file.try_clone().unwrap();
    let writing = std::thread::spawn(move || {
        // Ends with an error when the rig has gone.
        let _ = writer.write_all(&b"f".repeat(20_000));
    });
    let time_s = |rig: &mut Served| -> f64 {
        let status = rig.control("status");
        let field = status.split_whitespace().nth(1).unwrap();
        field.strip_prefix("time_s=").unwrap().parse().unwrap()
    };
    // Left to itself it would go on for seconds in each turn.
    let waits = (0..60).any(|_| {
        let before = time_s(&mut rig);
        std::thread::sleep(Duration::from_millis(300));
        time_s(&mut rig) - before < 0.01
    });
    assert!(waits, "the rig goes on without its client");
    rig.quit();
    writing.join().unwrap();
}

#[test]
fn avrdude_writes_and_verifies_an_image_that_then_runs() {
    let Some(folder) = folder() else { return };
    if Command::new("avrdude").arg("-?").output().is_err() {
        eprintln!("skipped: there is no avrdude; `cargo xtask setup` installs it");
        return;
    }
    let mut rig = serve(folder.path(), &[]);
    let written = Command::new("avrdude")
        .args([
            "-p",
            "atmega2560",
            "-c",
            "wiring",
            "-b",
            "115200",
            "-D",
            "-P",
        ])
        .arg(&rig.port)
        .args(["-U", "flash:w:obey.elf:e"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&written.stderr);
    assert!(
        written.status.success() && said.contains("verified"),
        "{said}"
    );
    // At once: the board must notice even so.
    let mut client = rig.open();
    std::thread::sleep(Duration::from_millis(50));
    assert!(rig.control("status").contains("bootloader=yes resets=2"));
    client.read_until("ready\n");
    rig.quit();
}

#[test]
fn a_drawn_actuator_is_written_as_model_and_as_answer() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = [
        "--hide",
        "7",
        "--model-out",
        "model.toml",
        "--truth-out",
        "truth.toml",
    ];
    let rig = serve(folder.path(), &arguments);
    let read = |name| fs::read_to_string(folder.path().join(name)).unwrap();
    assert!(!read("model.toml").contains("[[effect]]"));
    assert!(read("truth.toml").contains("[[effect]]"));
    rig.quit();
    let rig = serve(folder.path(), &["--actuator", "truth.toml"]);
    rig.quit();
}

#[test]
fn something_else_at_the_links_place_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("port"), "precious").unwrap();
    let refused = Command::new(env!("CARGO_BIN_EXE_virtual-rig"))
        .current_dir(folder.path())
        .args(["serve", "--link", "port"])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--link"));
    assert_eq!(fs::read(folder.path().join("port")).unwrap(), b"precious");
}
