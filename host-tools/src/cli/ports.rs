//! `softrig ports`: lists the serial ports, and finds the board.

use clap::Parser;

use softrig_link::{PortFound, ports};

/// Lists the serial ports, marks those that look like a Mega, and lists the virtual rigs that run.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig ports
  softrig ports --json | jq -r '.[0].name'")]
pub struct Args {
    /// Print a JSON list
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
///
/// When the system does not let ports be listed.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let found = ports()?;
    let text = if args.json {
        format!("{}\n", serde_json::to_string_pretty(&found)?)
    } else {
        table(&found)
    };
    Ok(super::print(&text)?)
}

fn table(found: &[PortFound]) -> String {
    if found.is_empty() {
        return "No serial port was found. Plug the board in with a cable that carries data \
                (many only charge), or start a simulated one with `softrig virtual`.\n"
            .into();
    }
    let mut text = String::new();
    for port in found {
        let names: Vec<&str> = [&port.manufacturer, &port.product]
            .into_iter()
            .flatten()
            .map(String::as_str)
            .collect();
        let ids = match (&port.vendor_id, &port.product_id) {
            (Some(vendor), Some(product)) => format!("{vendor}:{product}"),
            _ => String::new(),
        };
        let serial = port
            .serial_number
            .as_ref()
            .map_or_else(String::new, |number| format!("  serial {number}"));
        let mark = if port.looks_like_a_board { "* " } else { "  " };
        let line = format!(
            "{mark}{:<16} {ids:<9}  {}{serial}",
            port.name,
            names.join(" ")
        );
        text += line.trim_end();
        text.push('\n');
    }
    if found.iter().any(|port| port.looks_like_a_board) {
        text += "\n* looks like an Arduino Mega or a copy\n";
    }
    if found.iter().any(|port| !port.accessible) {
        text += &format!(
            "\nYou lack permission to open: {}.\n",
            softrig_link::PERMISSION_ADVICE
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_to_do_is_said_when_there_is_none_and_when_it_is_closed() {
        assert!(table(&[]).contains("softrig virtual"));
        let mut port = PortFound {
            name: "/dev/ttyACM0".into(),
            product: Some("Mega 2560".into()),
            manufacturer: None,
            vendor_id: Some("2341".into()),
            product_id: Some("0042".into()),
            serial_number: None,
            looks_like_a_board: true,
            accessible: true,
            simulated: false,
        };
        let text = table(std::slice::from_ref(&port));
        assert!(text.starts_with("* /dev/ttyACM0"), "{text}");
        assert!(!text.contains("dialout"));
        port.accessible = false;
        assert!(table(&[port]).contains("usermod -aG dialout"));
    }
}
