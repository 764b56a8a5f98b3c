//! `softrig monitor --foxglove` and `--mcap`: telemetry live for Foxglove and Lichtblick, and as a log.
//!
//! Both have a topic for each column of a recording, as `softrig convert` writes logs, at times by the
//! board's clock. The server has threads of its own and a queue for each client, of which the
//! oldest messages are lost where a client is slow. The link to the board is on a thread of its own
//! too, so that neither a client nor a disk holds up a heartbeat: docs/decisions/0077.

use std::fs::File;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use foxglove::{
    Context, McapWriterHandle, PartialMetadata, RawChannel, Schema, WebSocketServerHandle,
};

use super::address::host_and_port;
use super::output::{self, FileKind, Output};
use super::row::Row;
use softrig_formats::error::{InputError, not_written};
use softrig_importers::mcap;
use softrig_link::record::COLUMNS;

/// The port that Foxglove and Lichtblick expect.
const PORT: &str = "8765";

/// Columns of text.
const TEXTS: [&str; 1] = ["state"];

/// Who is sent the telemetry.
pub(super) struct Live {
    topics: Vec<(&'static str, Arc<RawChannel>)>,
    server: Option<Server>,
    /// Where to log: the file begins with the first sample, so that a board that never answers leaves
    /// none.
    file: Option<PathBuf>,
    log: Option<Log>,
    /// The system's time of the first sample (ns since 1970).
    begin_ns: Option<u64>,
    /// Its topics live no longer than it.
    context: Arc<Context>,
}

/// Who answers clients, as long as it is kept.
struct Server {
    address: String,
    _handle: WebSocketServerHandle,
}

/// A log that is being written.
struct Log {
    path: PathBuf,
    writer: McapWriterHandle<Watched>,
    fault: Fault,
}

/// What went wrong with a file, for whoever cannot be told by the writer.
type Fault = Arc<Mutex<Option<std::io::Error>>>;

impl Live {
    /// Serves at an address and writes to a file, as far as they are given.
    ///
    /// # Errors
    ///
    /// Names an address at which nobody can listen, and a file that cannot be written or would be
    /// replaced.
    pub(super) fn of(
        address: Option<&str>,
        file: Option<&PathBuf>,
    ) -> Result<Option<Self>, InputError> {
        if address.is_none() && file.is_none() {
            return Ok(None);
        }
        output::check(&[Output::of("--mcap", FileKind::Recording, file)], [])?;
        let context = Context::new();
        let mut topics = Vec::new();
        for column in COLUMNS.split(',').skip(1) {
            let topic = mcap::topic(column, TEXTS.contains(&column));
            let schema = Schema::new(
                topic.schema_name,
                mcap::SCHEMA_ENCODING,
                topic.schema.into_bytes(),
            );
            let channel = context
                .channel_builder(topic.name)
                .message_encoding(mcap::MESSAGE_ENCODING)
                .schema(schema)
                .build_raw()
                .map_err(|error| InputError::new(error.to_string(), "report it"))?;
            topics.push((column, channel));
        }
        let server = address.map(|it| serve(&context, it)).transpose()?;
        Ok(Some(Self {
            topics,
            server,
            file: file.cloned(),
            log: None,
            begin_ns: None,
            context,
        }))
    }

    /// Where to look, in a sentence; none if nobody is served.
    pub(super) fn invitation(&self) -> Option<String> {
        let server = self.server.as_ref()?;
        Some(format!(
            "live for Foxglove and Lichtblick: open a Foxglove WebSocket at {}",
            server.address
        ))
    }

    /// Hands on a sample.
    ///
    /// # Errors
    ///
    /// Names the file if it can no longer be written.
    pub(super) fn take(&mut self, row: &Row) -> Result<(), InputError> {
        let since_ns = row.time_ms.saturating_mul(1_000_000);
        let begin_ns = match self.begin_ns {
            Some(begin_ns) => begin_ns,
            None => self.begin(since_ns)?,
        };
        let at = PartialMetadata::with_log_time(begin_ns.saturating_add_signed(since_ns));
        for (name, value) in row.fields() {
            if let Some((_, topic)) = self.topics.iter().find(|(column, _)| *column == name) {
                topic.log_with_meta(mcap::message(value).as_bytes(), at);
            }
        }
        self.log.as_ref().map_or(Ok(()), Log::check)
    }

    /// Fixes when the first sample was, and begins the log with that.
    fn begin(&mut self, since_ns: i64) -> Result<u64, InputError> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let now_ns = now.map_or(0, |it| u64::try_from(it.as_nanos()).unwrap_or(0));
        let begin_ns = now_ns.saturating_add_signed(since_ns.saturating_neg());
        self.begin_ns = Some(begin_ns);
        if let Some(path) = &self.file {
            let log = begin(&self.context, path)?;
            let columns: Vec<&str> = self.topics.iter().map(|(column, _)| *column).collect();
            let (name, about) = mcap::about(&columns, begin_ns);
            log.writer
                .write_metadata(&name, about)
                .map_err(|error| log.failed(&error))?;
            self.log = Some(log);
        }
        Ok(begin_ns)
    }

    /// Ends the log, so that it is whole.
    ///
    /// # Errors
    ///
    /// Names the file if it cannot be written.
    pub(super) fn end(self) -> Result<(), InputError> {
        let Some(Log {
            path,
            writer,
            fault,
        }) = self.log
        else {
            return Ok(());
        };
        let outcome = writer.close().map_err(|error| error.to_string());
        let outcome = outcome.and_then(|mut file| file.flush().map_err(|error| error.to_string()));
        taken(&path, &fault)?;
        outcome.map_err(|error| not_written(&path, &std::io::Error::other(error)))
    }
}

impl Log {
    fn check(&self) -> Result<(), InputError> {
        taken(&self.path, &self.fault)
    }

    fn failed(&self, error: &foxglove::FoxgloveError) -> InputError {
        let error = std::io::Error::other(error.to_string());
        self.check()
            .err()
            .unwrap_or_else(|| not_written(&self.path, &error))
    }
}

/// Listens at `[HOST:]PORT`, of this machine alone if no host is named.
fn serve(context: &Arc<Context>, address: &str) -> Result<Server, InputError> {
    let fault = |why: &dyn std::fmt::Display| {
        InputError::new(
            format!("--foxglove {address}: {why}"),
            format!("use a free port, such as {PORT}, or HOST:PORT for access from other machines"),
        )
    };
    let (host, port) = host_and_port(address).map_err(|why| fault(&why))?;
    let handle = context
        .websocket_server()
        .name(concat!("softrig/", env!("CARGO_PKG_VERSION")))
        .bind(host, port)
        .start_blocking()
        .map_err(|error| fault(&error))?;
    let host = if host.contains(':') {
        format!("[{host}]")
    } else {
        host.to_owned()
    };
    Ok(Server {
        address: format!("ws://{host}:{}", handle.port()),
        _handle: handle,
    })
}

/// Begins a log.
fn begin(context: &Arc<Context>, path: &Path) -> Result<Log, InputError> {
    let fault = Fault::default();
    let file = File::create(path).map_err(|error| not_written(path, &error))?;
    let watched = Watched {
        file: BufWriter::new(file),
        fault: Arc::clone(&fault),
    };
    let writer = context
        .mcap_writer()
        .create(watched)
        .map_err(|error| not_written(path, &std::io::Error::other(error.to_string())))?;
    Ok(Log {
        path: path.to_owned(),
        writer,
        fault,
    })
}

/// What went wrong with a file, once.
fn taken(path: &Path, fault: &Fault) -> Result<(), InputError> {
    let fault = fault.lock().unwrap_or_else(PoisonError::into_inner).take();
    fault.map_or(Ok(()), |error| Err(not_written(path, &error)))
}

/// A file whose faults are kept: nobody hears what a topic's log says of them.
struct Watched {
    file: BufWriter<File>,
    fault: Fault,
}

impl Watched {
    fn note<T>(&self, outcome: std::io::Result<T>) -> std::io::Result<T> {
        if let Err(error) = &outcome {
            let kept = std::io::Error::new(error.kind(), error.to_string());
            let mut fault = self.fault.lock().unwrap_or_else(PoisonError::into_inner);
            fault.get_or_insert(kept);
        }
        outcome
    }
}

impl Write for Watched {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let outcome = self.file.write(bytes);
        self.note(outcome)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let outcome = self.file.flush();
        self.note(outcome)
    }
}

impl Seek for Watched {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let outcome = self.file.seek(to);
        self.note(outcome)
    }
}
