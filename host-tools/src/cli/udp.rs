//! Telemetry for other programs, live: a datagram of JSON a sample, as the UDP server of PlotJuggler
//! reads them.
//!
//! Sending never waits: a datagram that the system does not take is lost, and the link to the board,
//! which runs on a thread of its own, does not notice.

use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs, UdpSocket};

use serde_json::{Map, Value};

use super::address::host_and_port;
use super::row::Row;
use softrig_formats::error::InputError;

/// Where samples are sent.
#[derive(Debug)]
pub(super) struct Datagrams {
    socket: UdpSocket,
}

impl Datagrams {
    /// To `HOST:PORT`, or to a port of this machine.
    ///
    /// # Errors
    ///
    /// Refuses what is no address, and a name that nobody knows.
    pub(super) fn to(target: &str) -> Result<Self, InputError> {
        let fault = |why: &str| {
            InputError::new(
                format!("--udp {target}: {why}"),
                "write HOST:PORT, or only the port of a program on this machine, such as 9870",
            )
        };
        let (host, port) = host_and_port(target).map_err(|why| fault(&why))?;
        if port == 0 {
            return Err(fault("there is no port 0"));
        }
        let address = (host, port)
            .to_socket_addrs()
            .map_err(|error| fault(&error.to_string()))?
            .next()
            .ok_or_else(|| fault("the name has no address"))?;
        let any: SocketAddr = match address {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (std::net::Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(any)
            .and_then(|socket| {
                socket.connect(address)?;
                socket.set_nonblocking(true)?;
                Ok(socket)
            })
            .map_err(|error| fault(&error.to_string()))?;
        Ok(Self { socket })
    }

    /// Sends a sample. Whether somebody listens is not known, and does not matter.
    pub(super) fn take(&self, row: &Row) {
        let _ = self.socket.send(json(row).as_bytes());
    }
}

/// A row of a recording as JSON, with the names of its columns. Its time is called `timestamp`, which
/// PlotJuggler takes for the time of the others.
fn json(row: &Row) -> String {
    let renamed = |name| match name {
        "time_s" => "timestamp",
        name => name,
    };
    let fields = row.fields();
    let object: Map<String, Value> = fields
        .map(|(name, value)| (renamed(name).to_owned(), value))
        .collect();
    Value::Object(object).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_an_object_without_what_is_not_known() {
        let row = Row {
            time_ms: 250,
            text: "0.25,12.5,,30.00,,100,31.00,run,0,7,0\n".into(),
        };
        let value: Value = serde_json::from_str(&json(&row)).unwrap();
        assert_eq!(value["timestamp"], 0.25);
        assert_eq!(value["pressure_kpa"], 12.5);
        assert_eq!(value["state"], "run");
        assert!(value.get("angle_deg").is_none(), "{value}");
        assert!(value.get("time_s").is_none(), "{value}");
    }

    #[test]
    fn only_a_port_is_one_of_this_machine() {
        let there = UdpSocket::bind("127.0.0.1:0").unwrap();
        let port = there.local_addr().unwrap().port();
        let here = Datagrams::to(&port.to_string()).unwrap();
        assert_eq!(
            here.socket.peer_addr().unwrap(),
            there.local_addr().unwrap()
        );
        for wrong in ["", "0", "localhost", "70000", "no such host:9870"] {
            let error = Datagrams::to(wrong).unwrap_err().to_string();
            assert!(error.contains("HOST:PORT"), "{error}");
        }
    }
}
