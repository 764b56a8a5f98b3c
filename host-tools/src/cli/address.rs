//! Who is sent samples, or asks for them: `HOST:PORT`, or a port of this machine.

/// The host and the port of an address; without a host it is this machine.
///
/// # Errors
///
/// What is wrong with it.
pub(super) fn host_and_port(address: &str) -> Result<(&str, u16), String> {
    let (host, port) = match address.rsplit_once(':') {
        // An address of IPv6 stands in brackets.
        Some((host, port)) => (host.trim_matches(['[', ']']), port),
        None => ("127.0.0.1", address),
    };
    match port.parse() {
        Ok(port) => Ok((host, port)),
        Err(_) => Err(format!("{port:?} is no port")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_one_of_this_machine() {
        for (address, host, port) in [
            ("9870", "127.0.0.1", 9870),
            ("lab:9870", "lab", 9870),
            ("[::1]:9870", "::1", 9870),
        ] {
            assert_eq!(host_and_port(address), Ok((host, port)), "{address}");
        }
        for wrong in ["", "lab", "lab:", "70000"] {
            assert!(host_and_port(wrong).unwrap_err().contains("no port"));
        }
    }
}
