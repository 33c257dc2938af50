//! Pictures' files that stay open: tracking looks at each several times, and opening costs as much as reading the rows of a ball.

use std::fs::File;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A file that stays open.
#[derive(Debug)]
pub struct OpenFile(File);

static OPEN: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);
/// Most files kept open, and those left to everything else.
const ENOUGH: u64 = 1024;
const LEFT: u64 = 64;

/// Lets files stay open, half as many as the system allows at most. To be called before the program's first thread: later every doubling of
/// the system's table of open files stops all of them for milliseconds.
#[cfg(unix)]
pub fn let_files_stay_open() {
    let allowed = rustix::process::getrlimit(rustix::process::Resource::Nofile).current.unwrap_or(u64::MAX);
    let most = ENOUGH.min((allowed / 2).saturating_sub(LEFT));
    // The table becomes as long as its highest number asks for, and stays so.
    if most > 0 && rustix::io::fcntl_dupfd_cloexec(std::io::stderr(), (most + LEFT) as i32).is_ok() {
        MOST.store(most as usize, Ordering::Relaxed);
    }
}

/// Reading at a place moves the file's own one elsewhere: no two threads may share it.
#[cfg(not(unix))]
pub fn let_files_stay_open() {}

impl OpenFile {
    /// `None`, and the file closed, when enough are open.
    pub fn keep(file: File) -> Option<Self> {
        let keep = |open: usize| (open < MOST.load(Ordering::Relaxed)).then_some(open + 1);
        OPEN.fetch_update(Ordering::Relaxed, Ordering::Relaxed, keep).is_ok().then(|| OpenFile(file))
    }

    pub fn file(&self) -> &File {
        &self.0
    }
}

impl Drop for OpenFile {
    fn drop(&mut self) {
        OPEN.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn law_files_stay_open_up_to_half_of_what_is_allowed() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("picture.bmp");
        std::fs::write(&path, b"BM").expect("written");
        let open = || File::open(&path).expect("opened");
        let_files_stay_open();
        let most = MOST.load(Ordering::Relaxed);
        assert!(most > 0 && most as u64 <= ENOUGH);
        // Other tests may hold some of them meanwhile.
        let kept: Vec<OpenFile> = (0..=most).map_while(|_| OpenFile::keep(open())).collect();
        assert!(!kept.is_empty() && kept.len() <= most);
        std::fs::remove_file(&path).expect("removed");
        let mut text = String::new();
        kept[0].file().read_to_string(&mut text).expect("read");
        assert_eq!(text, "BM");
        drop(kept);
        assert!(OPEN.load(Ordering::Relaxed) < most);
    }
}
