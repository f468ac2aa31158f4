//! Long work that Python may interrupt and watch.
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use schuler_explain::watch::{Phase, Watch};

/// How often Python is asked whether the user has pressed Ctrl-C, and hears of the progress.
const INTERVAL: Duration = Duration::from_millis(50);

/// What the work and the thread that waits for it share.
#[derive(Default)]
pub(crate) struct Shared {
    cancelled: AtomicBool,
    finished: AtomicBool,
    progress: Mutex<Option<(Phase, f64)>>,
}

impl Watch for Shared {
    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    fn progress(&self, phase: Phase, part: f64) {
        if let Ok(mut progress) = self.progress.lock() {
            *progress = Some((phase, part));
        }
    }
}

/// Sets the flag and wakes the waiting thread however the work ends.
struct Wake<'s>(&'s AtomicBool, thread::Thread);

impl Drop for Wake<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
        self.1.unpark();
    }
}

/// Does `work` in a thread of its own while this one, which must be attached to the interpreter, lets others run, hears
/// signals and calls `progress` with phase and part.
///
/// # Errors
/// `KeyboardInterrupt` or what else a signal handler or `progress` raised, after the work has ended early.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Shared) -> T + Send,
) -> PyResult<T> {
    let shared = Shared::default();
    let (worked, raised) = thread::scope(|scope| {
        let wake = Wake(&shared.finished, thread::current());
        let worker = scope.spawn(|| {
            let _wake = wake;
            work(&shared)
        });
        let mut raised = None;
        while !shared.finished.load(Ordering::Acquire) {
            py.detach(|| thread::park_timeout(INTERVAL));
            if raised.is_none() {
                raised = py.check_signals().and_then(|()| tell(progress, &shared)).err();
                shared.cancelled.store(raised.is_some(), Ordering::Relaxed);
            }
        }
        (worker.join(), raised)
    });
    match (worked, raised) {
        (_, Some(raised)) => Err(raised),
        (Ok(answer), None) => Ok(answer),
        (Err(panic), None) => std::panic::resume_unwind(panic),
    }
}

fn tell(progress: Option<&Bound<'_, PyAny>>, shared: &Shared) -> PyResult<()> {
    let news = shared.progress.lock().ok().and_then(|mut progress| progress.take());
    if let (Some(progress), Some((phase, part))) = (progress, news) {
        progress.call1((phase.to_string(), part))?;
    }
    Ok(())
}
