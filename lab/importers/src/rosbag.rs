//! Bags of ROS 2 in SQLite, `.db3`, as rosbag2 writes them where MCAP is not chosen.
//!
//! The data base has a table of topics and one of messages. From ROS 2 Iron on it has the
//! definitions of their types too; older bags are read as far as everybody has the type.
//! [`topics`](crate::topics) makes columns of the messages. A bag is read where it stands: what
//! nobody asks for, as the images of a camera, is passed over.

use std::collections::HashMap;
use std::ffi::OsString;
use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, Error, ErrorCode, OpenFlags};

use crate::topics::{Encoding, Topics};
use softrig_formats::bounded::{Limits, too_large};
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::formats::{Samples, damaged, read_whole};

/// Bytes of one message.
const LARGEST_MESSAGE: i32 = 256 << 20;

/// Steps of SQLite's machine, a dozen for each message: a damaged index may lead in circles.
const MOST_STEPS: u64 = 20_000_000_000;
/// Steps between two looks at how many there were.
const STEPS: i32 = 1_000_000;

/// Bytes of the header of a data base.
const HEADER: u64 = 100;
/// In it: whether there is a log of changes beside it.
const JOURNAL_MODE: std::ops::Range<usize> = 18..20;

/// How a message begins that is packed on its own.
const ZSTD: &[u8] = b"\x28\xb5\x2f\xfd";

/// Reads the file of a bag where it stands.
///
/// # Errors
///
/// Names the file and what is wrong with it, or the topics that it has.
pub fn read_file(path: &Path, layout: &Layout, limits: Limits) -> Result<Samples, InputError> {
    let mut topics = Topics::of(layout);
    read_into(&mut topics, path, limits)?;
    topics
        .sheet(path, layout)?
        .samples(path, layout, limits, "topic")
}

/// Like [`read_file`], for what is unpacked or comes through a pipe.
///
/// # Errors
///
/// Like [`read_file`].
pub fn read(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let mut bytes = read_whole(whole, path, limits)?;
    check_length(&bytes, bytes.len() as u64, path)?;
    // In memory there is no log of changes beside it.
    if let Some(mode @ [2, 2]) = bytes.get_mut(JOURNAL_MODE) {
        mode.fill(1);
    }
    let fail = |error: Error| fault(path, &error);
    let mut data_base = Connection::open_in_memory().map_err(fail)?;
    let size = bytes.len();
    data_base
        .deserialize_read_exact("main", Cursor::new(bytes), size, true)
        .map_err(fail)?;
    let mut topics = Topics::of(layout);
    messages(data_base, &mut topics, path, limits)?;
    topics
        .sheet(path, layout)?
        .samples(path, layout, limits, "topic")
}

/// Takes the messages of a file, which may be one of several of a bag.
///
/// # Errors
///
/// Names the file and what is wrong with it.
pub(crate) fn read_into(
    topics: &mut Topics,
    path: &Path,
    limits: Limits,
) -> Result<(), InputError> {
    let data_base = open(path)?;
    messages(data_base, topics, path, limits)
}

/// Opens a bag so that nothing is changed, and nothing left beside it.
fn open(path: &Path) -> Result<Connection, InputError> {
    let beside = |ending: &str| {
        let mut name = OsString::from(path);
        name.push(ending);
        PathBuf::from(name)
    };
    let holds = |ending| std::fs::metadata(beside(ending)).is_ok_and(|about| about.len() > 0);
    if holds("-journal") {
        return Err(InputError::new(
            format!(
                "was not closed where it was recorded: {} stands beside it",
                beside("-journal").display()
            ),
            format!(
                "let SQLite repair it once: sqlite3 {} \"pragma integrity_check\"",
                path.display()
            ),
        )
        .in_file(path));
    }
    let has_log = holds("-wal");
    if !has_log {
        let fail = |error: std::io::Error| InputError::from_io(path, &error);
        let file = File::open(path).map_err(fail)?;
        let length = file.metadata().map_err(fail)?.len();
        let mut header = Vec::new();
        file.take(HEADER).read_to_end(&mut header).map_err(fail)?;
        check_length(&header, length, path)?;
    }
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    // Messages that are only in the log of changes are found if SQLite looks for it.
    let opened = if has_log || cfg!(windows) {
        Connection::open_with_flags(path, flags)
    } else {
        Connection::open_with_flags(unchanging(path), flags | OpenFlags::SQLITE_OPEN_URI)
    };
    opened.map_err(|error| fault(path, &error))
}

/// Refuses a file with fewer pages than its header counts: SQLite does so only where it looks for
/// one that is not there.
fn check_length(header: &[u8], length: u64, path: &Path) -> Result<(), InputError> {
    let number = |at: usize| {
        let bytes = header.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_be_bytes(bytes))
    };
    let (Some(changes), Some(pages), Some(valid_for)) = (number(24), number(28), number(92)) else {
        return Err(damaged(path, "SQLite", &"it ends in its header"));
    };
    let page_size = match u16::from_be_bytes([header[16], header[17]]) {
        1 => 65_536,
        size => u64::from(size),
    };
    // Old programs do not count.
    if changes == valid_for && u64::from(pages) * page_size > length {
        return Err(damaged(path, "SQLite", &"it ends in the middle"));
    }
    Ok(())
}

/// The address of a file that nobody changes, for which SQLite makes no files of its own.
fn unchanging(path: &Path) -> String {
    let bytes = path.as_os_str().as_encoded_bytes();
    let escaped = bytes.iter().map(|&byte| match byte {
        b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'.' | b'_' | b'-' => {
            char::from(byte).to_string()
        }
        byte => format!("%{byte:02X}"),
    });
    format!("file:{}?immutable=1", escaped.collect::<String>())
}

/// Takes the messages of a data base.
fn messages(
    mut data_base: Connection,
    topics: &mut Topics,
    path: &Path,
    limits: Limits,
) -> Result<(), InputError> {
    let fail = |error: Error| fault(path, &error);
    guard(&mut data_base).map_err(fail)?;
    if !(has_table(&data_base, "topics").map_err(fail)?
        && has_table(&data_base, "messages").map_err(fail)?)
    {
        return Err(InputError::new(
            "is a data base of SQLite, and no bag of ROS 2: it has no tables topics and messages",
            format!(
                "export the table with the recording: sqlite3 -header -csv {} \"select * from TABLE\" > run.csv",
                path.display()
            ),
        )
        .in_file(path));
    }
    topics.next_file();
    let definitions = definitions(&data_base).map_err(fail)?;
    let mut wanted = Vec::new();
    for (id, name, kind, format) in all_topics(&data_base).map_err(fail)? {
        let encoding = || match format.as_str() {
            "cdr" => Encoding::of_ros(&name, &kind, definitions.get(&kind).map_or("", |it| it)),
            other => Err(InputError::new(
                format!("topic {name} is encoded as \"{other}\""),
                "messages of ROS 2 (cdr) are read: convert the bag with ros2 bag convert, or export the topic as CSV",
            )),
        };
        if topics
            .note(id.cast_unsigned(), &name, encoding)
            .map_err(|error| error.in_file(path))?
        {
            wanted.push(id.to_string());
        }
    }
    let query = format!(
        "SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({})",
        wanted.join(", ")
    );
    let mut statement = data_base.prepare(&query).map_err(fail)?;
    let mut rows = statement.query([]).map_err(fail)?;
    while let Some(row) = rows.next().map_err(fail)? {
        let wrong = |_| damaged(path, "SQLite", &"a message has a value of another type");
        let id = row.get_ref(0).map_err(fail)?.as_i64().map_err(wrong)?;
        let time_ns = row.get_ref(1).map_err(fail)?.as_i64().map_err(wrong)?;
        let time_ns = u64::try_from(time_ns)
            .map_err(|_| damaged(path, "SQLite", &"a message is from before 1970"))?;
        let stored = row.get_ref(2).map_err(fail)?.as_blob().map_err(wrong)?;
        let unpacked;
        let message = if stored.starts_with(ZSTD) {
            unpacked = unpack(stored)
                .map_err(|error| damaged(path, "SQLite", &format!("a message: {error}")))?;
            &unpacked
        } else {
            stored
        };
        topics
            .take(id.cast_unsigned(), time_ns, message, limits)
            .map_err(|error| error.in_file(path))?;
    }
    Ok(())
}

/// Makes a data base of others harmless: no code of theirs is run, and none runs without an end.
fn guard(data_base: &mut Connection) -> rusqlite::Result<()> {
    data_base.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    data_base.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    data_base.set_limit(Limit::SQLITE_LIMIT_LENGTH, LARGEST_MESSAGE)?;
    data_base.pragma_update(None, "cell_size_check", true)?;
    let mut looks = 0_u64;
    let most = MOST_STEPS / u64::from(STEPS.unsigned_abs());
    let count = move || {
        looks += 1;
        looks > most
    };
    data_base.progress_handler(STEPS, Some(count))
}

/// Whether there is a table of that name, and no view or module behind it.
fn has_table(data_base: &Connection, name: &str) -> rusqlite::Result<bool> {
    let query = "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = ?1 AND sql LIKE 'CREATE TABLE%'";
    let count: i64 = data_base.query_row(query, [name], |row| row.get(0))?;
    Ok(count == 1)
}

/// The definitions of the types, by their names.
fn definitions(data_base: &Connection) -> rusqlite::Result<HashMap<String, String>> {
    if !has_table(data_base, "message_definitions")? {
        return Ok(HashMap::new());
    }
    let mut statement = data_base.prepare(
        "SELECT topic_type, encoded_message_definition FROM message_definitions WHERE encoding = 'ros2msg'",
    )?;
    let both = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?;
    both.collect()
}

/// Number, name, type and encoding of each topic.
fn all_topics(data_base: &Connection) -> rusqlite::Result<Vec<(i64, String, String, String)>> {
    let mut statement =
        data_base.prepare("SELECT id, name, type, serialization_format FROM topics")?;
    let all = statement.query_map([], |row| {
        Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?))
    })?;
    all.collect()
}

fn unpack(packed: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut message = Vec::new();
    let most = u64::from(LARGEST_MESSAGE.unsigned_abs());
    zstd::stream::read::Decoder::new(packed)?
        .take(most)
        .read_to_end(&mut message)?;
    Ok(message)
}

fn fault(path: &Path, error: &Error) -> InputError {
    match error.sqlite_error_code() {
        Some(ErrorCode::OperationInterrupted) => InputError::new(
            "has more messages than any recording is read for",
            "split it into several: ros2 bag convert",
        )
        .in_file(path),
        Some(ErrorCode::TooBig) => {
            too_large(u64::from(LARGEST_MESSAGE.unsigned_abs())).in_file(path)
        }
        _ => damaged(path, "SQLite", error),
    }
}
