//! The threads that share the work, started before it, as many as the system lets the process have.

use super::error::CliError;
use std::io::Write;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Most threads that may be asked for.
const MOST: usize = 1024;

/// Starts the threads: as many as asked for, else as the environment says, else one a core.
///
/// rayon by itself starts them at the first use, and ends the program with a panic where the system refuses one.
pub fn start(asked: Option<usize>) -> Result<(), CliError> {
    if let Some(n) = asked.filter(|n| !(1..=MOST).contains(n)) {
        return Err(CliError::input(format!("--threads is {n}; allowed: 1 to {MOST}")));
    }
    let wanted = asked.unwrap_or_else(|| by_default(std::env::var("RAYON_NUM_THREADS").ok().as_deref()));
    let mut waiting = wait_for_work(wanted);
    let started = waiting.len();
    if started < wanted {
        let _ = writeln!(std::io::stderr(), "{started} of {wanted} threads could be started; the work goes on with {}", started.max(1));
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(started.max(1));
    let built = if started == 0 {
        pool.use_current_thread().build_global()
    } else {
        let refused = |what: &str| std::io::Error::other(what.to_owned());
        pool.spawn_handler(|work| waiting.pop().ok_or_else(|| refused("no thread left"))?.send(work).map_err(|_| refused("the thread has ended")))
            .build_global()
    };
    built.map_err(|e| CliError::input(format!("the threads could not be started ({e})")).hint("-j 1 works with one"))
}

/// What rayon would take by itself, within the same bound as `--threads`.
fn by_default(environment: Option<&str>) -> usize {
    let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    environment.and_then(|n| n.parse().ok()).filter(|n| *n > 0).unwrap_or_else(cores).min(MOST)
}

/// Up to so many threads, each of which runs the work sent to it. A refused one ends the list: a pool that could not be built is never built again.
fn wait_for_work(most: usize) -> Vec<Sender<rayon::ThreadBuilder>> {
    let thread = |_| {
        let (to, work): (_, Receiver<rayon::ThreadBuilder>) = channel();
        let run = move || {
            if let Ok(work) = work.recv() {
                work.run();
            }
        };
        std::thread::Builder::new().spawn(run).ok().map(|_| to)
    };
    (0..most).map_while(thread).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_environment_is_bound_as_the_option_is() {
        assert_eq!((by_default(Some("3")), by_default(Some("5000"))), (3, MOST));
        let cores = by_default(None);
        assert!((1..=MOST).contains(&cores));
        for nothing in ["0", "", "many", "-1"] {
            assert_eq!(by_default(Some(nothing)), cores, "{nothing:?}");
        }
    }

    #[test]
    fn fails_more_threads_than_allowed_are_refused() {
        for n in [0, MOST + 1] {
            assert!(start(Some(n)).is_err_and(|e| e.message.contains("allowed: 1 to 1024")));
        }
    }
}
