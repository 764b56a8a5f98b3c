//! The examples in `docs/serial.md` are what board and computer really say.

use softrig_link::line::{Incoming, request_text};
use wire::command::Request;
use wire::fault::Fault;
use wire::reply::Refusal;

const MANUAL: &str = include_str!("../../../docs/serial.md");

fn examples(mark: &str) -> Vec<&'static str> {
    MANUAL
        .split("```")
        .skip(1)
        .step_by(2)
        .flat_map(str::lines)
        .filter_map(|line| line.strip_prefix(mark))
        .collect()
}

#[test]
fn what_the_computer_sends_is_obeyed_or_refused_for_want_of_a_checksum() {
    let sent = examples("> ");
    assert!(sent.len() >= 8, "{sent:?}");
    for line in sent {
        match Request::parse(line.as_bytes()) {
            Ok(request) if line.contains('*') => {
                assert_eq!(request_text(&request).trim_end(), line);
            }
            Ok(request) => assert!(request.command.is_harmless(), "{line}"),
            Err(error) => assert!(
                line == "arm" && error == wire::command::Rejection::Unsealed,
                "{line}: {error:?}"
            ),
        }
    }
}

#[test]
fn what_the_board_says_is_understood() {
    let said = examples("< ");
    assert!(said.len() >= 6, "{said:?}");
    for line in said {
        let incoming = Incoming::parse(line.as_bytes());
        match incoming {
            Incoming::Sample(sample) => assert_eq!(sample.sequence, 512),
            Incoming::Reply { outcome, .. } => {
                assert!(matches!(
                    outcome,
                    Ok(_) | Err(Refusal::Unsealed | Refusal::NotNow)
                ));
            }
            Incoming::Remark(text) => assert!(
                text.starts_with("softrig ")
                    || text.starts_with("free ")
                    || text == Fault::EmergencyStop.sentence()
                    || text.starts_with("status, "),
                "{text}"
            ),
            Incoming::Other(text) => assert!(
                text.starts_with("step ") || text.starts_with("self-test: "),
                "{text}"
            ),
            Incoming::Damaged => panic!("{line}: {incoming:?}"),
        }
    }
}
