//! Finding and opening serial ports.
//!
//! Reads of a port time out after some milliseconds, so that the reader can do other work.

use std::io::{self, Write};
use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use serialport::{ErrorKind, SerialPort as _, SerialPortType};

use super::holders::{Holder, holders};
use super::transport::{BAUD, Channel, Connector};
use super::usb::looks_like_a_board;
use super::virtual_rigs::{VirtualRig, virtual_rigs};
use softrig_formats::error::InputError;

/// How long a read waits for a byte.
const READ_WAIT: Duration = Duration::from_millis(20);

/// How long the reset line is pulled, and let go before anything is said.
const RESET_PULSE: Duration = Duration::from_millis(50);

/// How long a write waits for room.
#[cfg(target_os = "linux")]
const WRITE_WAIT: Duration = Duration::from_millis(100);

/// A serial port by its name.
#[derive(Clone, Debug)]
pub struct SerialConnector {
    name: String,
}

impl SerialConnector {
    /// Names a port, as `softrig ports` lists it.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into() }
    }

    fn open_port(&self) -> Result<Native, InputError> {
        no_port(Path::new(&self.name))?;
        let holders = holders(Path::new(&self.name));
        if !holders.is_empty() {
            return Err(busy(&self.name, &holders));
        }
        serialport::new(&self.name, BAUD)
            .timeout(READ_WAIT)
            .open_native()
            .map_err(|error| refused(&self.name, &error))
    }

    fn channel(&self, port: Native) -> Result<Channel, InputError> {
        let writer = writer(&port).map_err(|error| refused(&self.name, &error))?;
        Ok(Channel {
            reader: Box::new(port),
            writer,
        })
    }
}

/// The port of this system.
#[cfg(unix)]
type Native = serialport::TTYPort;
/// The port of this system.
#[cfg(windows)]
type Native = serialport::COMPort;

impl Connector for SerialConnector {
    fn name(&self) -> &str {
        &self.name
    }

    fn is_simulated(&self) -> bool {
        is_pseudo_terminal(&self.name)
    }

    fn open(&mut self) -> Result<Channel, InputError> {
        self.channel(self.open_port()?)
    }

    fn open_after_reset(&mut self) -> Result<Channel, InputError> {
        let mut port = self.open_port()?;
        for level in [false, true] {
            // A pseudo-terminal has no such lines, and its rig is reset by being opened.
            let _ = port.write_data_terminal_ready(level);
            let _ = port.write_request_to_send(level);
            std::thread::sleep(RESET_PULSE);
        }
        self.channel(port)
    }
}

/// The port to write to.
///
/// serialport asks the system before every write whether there is room. Linux answers that
/// only after it has worked off what has arrived from the board, which on a busy computer
/// took up to three seconds: longer than a board waits for a sign of life. So the port is
/// written to without asking.
#[cfg(target_os = "linux")]
fn writer(port: &serialport::TTYPort) -> serialport::Result<Box<dyn Write + Send>> {
    use rustix::process::{PidfdFlags, PidfdGetfdFlags, getpid, pidfd_getfd, pidfd_open};
    use std::os::fd::AsRawFd;
    let own = pidfd_open(getpid(), PidfdFlags::empty())
        .and_then(|own| pidfd_getfd(own, port.as_raw_fd(), PidfdGetfdFlags::empty()));
    match own {
        Ok(file) => Ok(Box::new(Unasked(file.into()))),
        // Before Linux 5.6, or where it is forbidden.
        Err(_) => Ok(Box::new(port.try_clone_native()?)),
    }
}

#[cfg(not(target_os = "linux"))]
fn writer(port: &impl serialport::SerialPort) -> serialport::Result<Box<dyn Write + Send>> {
    Ok(Box::new(port.try_clone()?))
}

/// A port that is written to without asking first whether there is room.
#[cfg(target_os = "linux")]
#[derive(Debug)]
struct Unasked(std::fs::File);

#[cfg(target_os = "linux")]
impl Write for Unasked {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let until = std::time::Instant::now() + WRITE_WAIT;
        loop {
            match self.0.write(bytes) {
                Err(error)
                    if error.kind() == io::ErrorKind::WouldBlock
                        && std::time::Instant::now() < until =>
                {
                    std::thread::sleep(Duration::from_millis(1));
                }
                written => return written,
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Refuses what is there and can be no port. It is not opened: a FIFO would wait for a writer.
#[cfg(unix)]
fn no_port(path: &Path) -> Result<(), InputError> {
    use std::os::unix::fs::{FileTypeExt, MetadataExt};
    let Ok(found) = std::fs::metadata(path) else {
        return Ok(());
    };
    let kind = found.file_type();
    // Linux has `/dev/null` and its like under the major number 1; half of the programs have that open,
    // which is no reason to end them.
    let is_memory = cfg!(target_os = "linux") && (found.rdev() >> 8) & 0xfff == 1;
    let what = if kind.is_char_device() && is_memory {
        "a device"
    } else if kind.is_char_device() {
        return Ok(());
    } else if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a FIFO"
    } else if kind.is_socket() {
        "a socket"
    } else if kind.is_block_device() {
        "a disk"
    } else {
        "a file"
    };
    Err(InputError::new(format!("is {what}, not a serial port"), ports_advice()).in_file(path))
}

/// Refuses what is there and can be no port.
#[cfg(not(unix))]
fn no_port(_: &Path) -> Result<(), InputError> {
    Ok(())
}

/// Whether the system says that a device is no terminal, which every serial port is: `/dev/null` and its like.
fn is_no_terminal(said: &str) -> bool {
    ["typewriter", "inappropriate ioctl", "not a tty"]
        .iter()
        .any(|phrase| said.contains(phrase))
}

/// Why a port cannot be opened, with what to do.
fn refused(name: &str, error: &serialport::Error) -> InputError {
    let said = error.description.to_lowercase();
    let (found, advice) = match error.kind() {
        ErrorKind::Io(io::ErrorKind::PermissionDenied) => (
            "may not be opened by this user".to_owned(),
            PERMISSION_ADVICE.to_owned(),
        ),
        _ if said.contains("busy") => return busy(name, &holders(Path::new(name))),
        _ if is_no_terminal(&said) => ("is a device, not a serial port".to_owned(), ports_advice()),
        _ if !Path::new(name).exists() && !name.to_uppercase().starts_with("COM") => {
            ("is not there".to_owned(), ports_advice())
        }
        _ => (
            format!("cannot be opened: {}", error.description),
            ports_advice(),
        ),
    };
    InputError::new(found, advice).in_file(Path::new(name))
}

/// A port has one reader: two would get half of the bytes each.
fn busy(name: &str, holders: &[Holder]) -> InputError {
    let (found, advice) = match holders {
        [] => (
            "another program has it open, and the system does not say which".to_owned(),
            format!(
                "close the serial monitor, the plotter or the other softrig that has it open; `sudo fuser -v {name}` names it on Linux"
            ),
        ),
        [one] => (
            format!("{one} has it open"),
            format!(
                "close that program, or end it with `kill {}`, and try again",
                one.pid
            ),
        ),
        several => (
            format!(
                "{} have it open",
                several
                    .iter()
                    .map(Holder::to_string)
                    .collect::<Vec<_>>()
                    .join(" and ")
            ),
            "close these programs, and try again".to_owned(),
        ),
    };
    InputError::new(found, advice).in_file(Path::new(name))
}

/// Advice for a user without the right to open a port.
pub const PERMISSION_ADVICE: &str = "join the group that owns serial ports: `sudo usermod -aG dialout $USER` (on Arch: uucp), then log out and in";

/// Names the ports that could have been meant.
fn ports_advice() -> String {
    let found = ports().unwrap_or_default();
    if found.is_empty() {
        return "no serial port was found: plug the board in, or start `softrig virtual`".into();
    }
    let names: Vec<String> = found
        .iter()
        .map(|port| {
            if port.looks_like_a_board {
                format!("{} (looks like an Arduino)", port.name)
            } else {
                port.name.clone()
            }
        })
        .collect();
    format!("use one of: {}", names.join(", "))
}

/// A serial port of this computer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PortFound {
    /// The value for `--port`.
    pub name: String,
    /// The device's own name.
    pub product: Option<String>,
    /// Its manufacturer.
    pub manufacturer: Option<String>,
    /// USB vendor, four hexadecimal digits.
    pub vendor_id: Option<String>,
    /// USB product, four hexadecimal digits.
    pub product_id: Option<String>,
    /// Serial number, which tells two boards apart.
    pub serial_number: Option<String>,
    /// Whether its vendor and product are those of a Mega or of the converters
    /// on its copies.
    pub looks_like_a_board: bool,
    /// Whether this user may open it.
    pub accessible: bool,
    /// Whether a simulated rig is behind it.
    pub simulated: bool,
}

impl From<VirtualRig> for PortFound {
    fn from(rig: VirtualRig) -> Self {
        let name = rig.port.display().to_string();
        Self {
            accessible: is_accessible(&name),
            name,
            product: Some(format!("virtual rig (process {})", rig.pid)),
            manufacturer: None,
            vendor_id: None,
            product_id: None,
            serial_number: None,
            looks_like_a_board: false,
            simulated: true,
        }
    }
}

/// Lists the serial ports, and those of the virtual rigs that run.
///
/// # Errors
///
/// When the system does not let them be listed.
pub fn ports() -> Result<Vec<PortFound>, InputError> {
    let mut found: Vec<PortFound> = serialport::available_ports()
        .map_err(|error| {
            InputError::new(
                format!("the serial ports cannot be listed: {}", error.description),
                "name the port with --port",
            )
        })?
        .into_iter()
        .filter(|port| !is_empty_socket(port))
        .map(|port| describe(&port))
        .collect();
    found.sort_by(|a, b| (!a.looks_like_a_board, &a.name).cmp(&(!b.looks_like_a_board, &b.name)));
    found.extend(virtual_rigs().into_iter().map(PortFound::from));
    Ok(found)
}

/// Linux lists sockets of the mainboard without a chip behind them.
fn is_empty_socket(port: &serialport::SerialPortInfo) -> bool {
    matches!(port.port_type, SerialPortType::Unknown) && port.port_name.contains("/ttyS")
}

fn describe(port: &serialport::SerialPortInfo) -> PortFound {
    let usb = match &port.port_type {
        SerialPortType::UsbPort(usb) => Some(usb),
        _ => None,
    };
    PortFound {
        accessible: is_accessible(&port.port_name),
        name: port.port_name.clone(),
        product: usb.and_then(|usb| usb.product.clone()),
        manufacturer: usb.and_then(|usb| usb.manufacturer.clone()),
        vendor_id: usb.map(|usb| format!("{:04x}", usb.vid)),
        product_id: usb.map(|usb| format!("{:04x}", usb.pid)),
        serial_number: usb.and_then(|usb| usb.serial_number.clone()),
        looks_like_a_board: usb.is_some_and(|usb| looks_like_a_board(usb.vid, usb.pid)),
        simulated: false,
    }
}

/// Whether the system would let this user open a port, without opening it:
/// that would reset a board in the middle of a run.
#[cfg(unix)]
fn is_accessible(name: &str) -> bool {
    use std::os::unix::fs::MetadataExt;
    let (Ok(port), Ok(me)) = (std::fs::metadata(name), std::fs::metadata("/proc/self")) else {
        // Not Linux: the system says so when the port is opened.
        return true;
    };
    if me.uid() == 0 {
        return true;
    }
    let mode = port.mode();
    let own_groups: Vec<u32> = std::fs::read_to_string("/proc/self/status")
        .unwrap_or_default()
        .lines()
        .find_map(|line| line.strip_prefix("Groups:").map(str::to_owned))
        .unwrap_or_default()
        .split_whitespace()
        .filter_map(|group| group.parse().ok())
        .chain([me.gid()])
        .collect();
    let bits = if port.uid() == me.uid() {
        mode >> 6
    } else if own_groups.contains(&port.gid()) {
        mode >> 3
    } else {
        mode
    };
    bits & 0o6 == 0o6
}

#[cfg(not(unix))]
fn is_accessible(_name: &str) -> bool {
    true
}

/// Whether a port is a pseudo-terminal: then a simulator is behind it, and what
/// is recorded has to say so.
pub fn is_pseudo_terminal(name: &str) -> bool {
    let path = Path::new(name);
    path.canonicalize()
        .is_ok_and(|path| path.starts_with("/dev/pts"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_has_a_port_open_is_named_with_what_to_do() {
        let holder = |pid, name: &str| Holder {
            pid,
            name: name.into(),
        };
        let say = |holders: &[Holder]| busy("/dev/ttyACM0", holders).to_string();
        let one = say(&[holder(4711, "arduino-ide")]);
        assert!(
            one.contains("arduino-ide (process 4711) has it open"),
            "{one}"
        );
        assert!(one.contains("kill 4711"), "{one}");
        let two = say(&[holder(1, "softrig"), holder(2, "screen")]);
        assert!(
            two.contains("softrig (process 1) and screen (process 2) have"),
            "{two}"
        );
        assert!(say(&[]).contains("fuser -v /dev/ttyACM0"));
    }

    /// Said at once: a FIFO that is opened waits for its other end.
    #[cfg(unix)]
    #[test]
    fn what_is_no_serial_port_is_refused_as_what_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("file"), "").unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(path("socket")).unwrap();
        let made = std::process::Command::new("mkfifo")
            .arg(path("fifo"))
            .status();
        assert!(made.unwrap().success());
        for (path, what) in [
            (path("file"), "is a file, not a serial port"),
            (path("fifo"), "is a FIFO, not a serial port"),
            (path("socket"), "is a socket, not a serial port"),
            (folder.path().to_owned(), "is a folder, not a serial port"),
            ("/dev/null".into(), "is a device, not a serial port"),
        ] {
            let name = path.display().to_string();
            let error = SerialConnector::new(&name).open().unwrap_err().to_string();
            assert!(error.contains(what) && error.contains(&name), "{error}");
        }
    }

    #[test]
    fn a_port_that_is_not_there_is_said_to_be_absent() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("port").display().to_string();
        let error = SerialConnector::new(&name).open().unwrap_err().to_string();
        assert!(error.contains("is not there"), "{error}");
        assert!(error.contains(&name), "{error}");
    }
}
