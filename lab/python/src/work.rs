//! Long work without the interpreter's lock.
//!
//! The work runs on threads of its own while the calling thread waits without the lock, so
//! that other Python threads continue. The calling thread checks for Ctrl-C every twentieth of
//! a second: then KeyboardInterrupt is raised at once, and the work is asked to stop and ends
//! at its next fit.
//!
//! The threads are created for each call. A longer-lived pool would be missing in a forked
//! process, as `multiprocessing` makes, and the work would wait for it for ever.

use std::num::NonZero;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use library::diagnose::work::job::Job;
use library::diagnose::work::progress::State;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::progress;

/// How often signals are looked for.
const SIGNALS: Duration = Duration::from_millis(50);

/// How often progress is reported at most, if it changes.
const REPORTS: Duration = Duration::from_millis(100);

/// How often it is reported while nothing changes but the time.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// Who wants to know how far the work is.
pub struct Listener<'py> {
    callback: Option<Bound<'py, PyAny>>,
    said: Option<(Instant, State)>,
}

impl<'py> Listener<'py> {
    pub fn new(callback: Option<Bound<'py, PyAny>>) -> Self {
        Self {
            callback,
            said: None,
        }
    }

    /// Calls back if there is something to say.
    fn tell(&mut self, state: State) -> PyResult<()> {
        let Some(callback) = &self.callback else {
            return Ok(());
        };
        let news = |before: &State| {
            (&before.stage, before.done, before.fits, &before.best)
                != (&state.stage, state.done, state.fits, &state.best)
        };
        let is_due = self.said.as_ref().is_none_or(|(when, before)| {
            let since = when.elapsed();
            since >= HEARTBEAT || (since >= REPORTS && news(before))
        });
        if is_due {
            callback.call1((progress::Progress::of(&state),))?;
            self.said = Some((Instant::now(), state));
        }
        Ok(())
    }
}

/// Does `work`, which reports to `progress`, on as many threads as are asked for, or as there
/// are processors.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    threads: Option<NonZero<usize>>,
    job: Job,
    mut listener: Listener<'_>,
    work: impl FnOnce(&Job) -> T + Send + 'static,
) -> PyResult<T> {
    let job = Arc::new(job);
    let reports = Arc::clone(&job);
    let failed = |error: &dyn std::fmt::Display| {
        PyRuntimeError::new_err(format!("no threads could be started: {error}"))
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.map_or(0, NonZero::get))
        .build()
        .map_err(|error| failed(&error))?;
    let (done, mut result) = channel();
    std::thread::Builder::new()
        .name("softrig".into())
        .spawn(move || {
            let work = || pool.install(|| work(&reports));
            // Nobody may be waiting any more.
            let _ = done.send(catch_unwind(AssertUnwindSafe(work)));
        })
        .map_err(|error| failed(&error))?;
    loop {
        let waiting = &mut result;
        let outcome = py.detach(move || waiting.recv_timeout(SIGNALS));
        // Before a result is looked at: it may have come while somebody pressed Ctrl-C.
        let go_on = py.check_signals().and_then(|()| listener.tell(job.state()));
        if let Err(interrupted) = go_on {
            job.allowance.stop();
            return Err(interrupted);
        }
        match outcome {
            Ok(Ok(value)) => return Ok(value),
            Err(RecvTimeoutError::Timeout) => {}
            Ok(Err(_)) | Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err(
                    "softrig has a defect: the work was aborted; see stderr for its message",
                ));
            }
        }
    }
}
