//! One shot's recording: the frames of both cameras, paired by the number in their names; gaps stay gaps.

use super::bitmap::Known;
use super::decoded_pictures::DecodedPictures;
use super::{FootageError, LARGEST_FRAME_NUMBER, numbered_images};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// One instant: the picture of each camera, where there is one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FramePair {
    pub number: u64,
    /// `[left, right]`.
    pub files: [Option<PathBuf>; 2],
}

/// Frames sorted by number.
#[derive(Debug, Clone, Default)]
pub struct Clip {
    pub pairs: Vec<FramePair>,
    pub(super) decoded: Arc<DecodedPictures>,
    /// Of each bitmap, once it has been read, how it stands in its file, by camera.
    pub(super) known: Arc<Vec<[OnceLock<Known>; 2]>>,
}

impl Clip {
    /// Lists `left/` and `right/` below the shot's folder.
    pub fn list(left: &Path, right: &Path) -> Result<Self, FootageError> {
        let folders = [left, right];
        let (left, right) = rayon::join(|| numbered_images(left), || numbered_images(right));
        let (left, right) = (left?, right?);
        if let Some((_, path)) = [&left, &right].into_iter().zip(folders).find(|(pictures, _)| pictures.is_empty()) {
            return Err(FootageError::NoPictures { path: path.into() });
        }
        // In each folder the last one has the largest number.
        if let Some((number, path)) = [left.last(), right.last()].into_iter().flatten().find(|(number, _)| *number > LARGEST_FRAME_NUMBER) {
            return Err(FootageError::NoFrameNumber { path: path.clone(), number: *number });
        }
        let decoded = Arc::new(DecodedPictures::of([(folders[0], &left), (folders[1], &right)]));
        let (mut l, mut r) = (left.into_iter().peekable(), right.into_iter().peekable());
        let mut pairs: Vec<FramePair> = Vec::new();
        loop {
            let number = match (l.peek(), r.peek()) {
                (Some(a), Some(b)) => a.0.min(b.0),
                (Some(a), None) => a.0,
                (None, Some(b)) => b.0,
                (None, None) => break,
            };
            let files = [l.next_if(|f| f.0 == number).map(|f| f.1), r.next_if(|f| f.0 == number).map(|f| f.1)];
            pairs.push(FramePair { number, files });
        }
        if pairs.iter().any(|pair| pair.files.iter().all(Option::is_some)) {
            return Ok(Clip::of(pairs, decoded));
        }
        let [left_numbers, right_numbers] = [0, 1].map(|camera| {
            let seen: Vec<u64> = pairs.iter().filter(|pair| pair.files[camera].is_some()).map(|pair| pair.number).collect();
            ranges(&seen).unwrap_or_default()
        });
        let [left, right] = folders.map(Path::to_path_buf);
        Err(FootageError::NoCommonFrames { left, right, left_numbers, right_numbers })
    }

    /// The same pictures paired anew: left `n` with right `n + shift`, under the left picture's number.
    pub fn shifted(&self, shift: i64) -> Clip {
        let mut files: std::collections::BTreeMap<u64, [Option<PathBuf>; 2]> = std::collections::BTreeMap::new();
        for pair in &self.pairs {
            if let Some(left) = &pair.files[0] {
                files.entry(pair.number).or_default()[0] = Some(left.clone());
            }
            // A right picture before the first number there can be has no partner.
            if let (Some(right), Some(number)) = (&pair.files[1], pair.number.checked_sub_signed(shift)) {
                files.entry(number).or_default()[1] = Some(right.clone());
            }
        }
        Clip::of(files.into_iter().map(|(number, files)| FramePair { number, files }).collect(), self.decoded.clone())
    }

    /// The clip with the two cameras' pictures exchanged.
    pub fn exchanged(&self) -> Clip {
        let pairs = self.pairs.iter().map(|FramePair { number, files: [left, right] }| FramePair { number: *number, files: [right.clone(), left.clone()] });
        Clip::of(pairs.collect(), self.decoded.clone())
    }

    /// So many successive pairs of it, those around the frame of that number.
    pub fn around(&self, number: u64, frames: usize) -> Clip {
        let middle = self.pairs.partition_point(|p| p.number < number);
        let first = middle.saturating_sub(frames / 2).min(self.pairs.len().saturating_sub(frames));
        Clip::of(self.pairs.iter().skip(first).take(frames).cloned().collect(), self.decoded.clone())
    }

    fn of(pairs: Vec<FramePair>, decoded: Arc<DecodedPictures>) -> Self {
        let known = Arc::new(pairs.iter().map(|_| Default::default()).collect());
        Clip { pairs, decoded, known }
    }

    /// Size of a picture's file, bytes, where it is known from reading it.
    pub fn known_length(&self, index: usize, camera: usize) -> Option<u64> {
        self.known.get(index)?[camera].get().map(|known| known.layout.length)
    }

    /// What the user should know about missing pictures: one line per camera that lacks some.
    pub fn gap_notes(&self) -> Vec<String> {
        ["left", "right"]
            .iter()
            .enumerate()
            .filter_map(|(camera, name)| Some(format!("{name} camera: no picture of frame {}", ranges(&self.missing(camera))?)))
            .collect()
    }

    /// How pictures of more than 8 bits were taken, once some have been read: one line per camera.
    pub fn depth_notes(&self) -> Vec<String> {
        self.decoded.depth_notes()
    }

    /// Frame numbers that one camera (0 left, 1 right) lacks between its clip's first and last frame.
    pub fn missing(&self, camera: usize) -> Vec<u64> {
        let (Some(first), Some(last)) = (self.pairs.first(), self.pairs.last()) else { return Vec::new() };
        let mut out = Vec::new();
        let mut at = 0;
        for number in first.number..=last.number {
            let here = self.pairs.get(at).filter(|p| p.number == number);
            if here.is_none_or(|p| p.files[camera].is_none()) {
                out.push(number);
                if out.len() >= 10_000 {
                    break; // a wild number in one name must not fill the memory
                }
            }
            at += usize::from(here.is_some());
        }
        out
    }
}

/// Ascending numbers as `3, 5-8`, at most a dozen runs; `None` without numbers.
fn ranges(numbers: &[u64]) -> Option<String> {
    const SHOWN: usize = 12;
    let mut runs: Vec<(u64, u64)> = Vec::new();
    for n in numbers {
        match runs.last_mut() {
            Some((_, last)) if last.checked_add(1) == Some(*n) => *last = *n,
            _ => runs.push((*n, *n)),
        }
    }
    let words: Vec<String> = runs.iter().take(SHOWN).map(|(a, b)| if a == b { a.to_string() } else { format!("{a}-{b}") }).collect();
    let more = if runs.len() > SHOWN { format!(" and more, {} in all", numbers.len()) } else { String::new() };
    (!runs.is_empty()).then(|| words.join(", ") + &more)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_frames_pair_by_number_and_gaps_are_named() {
        let folder = tempfile::tempdir().expect("folder");
        for (side, numbers) in [("left", [8, 9, 11]), ("right", [9, 10, 11])] {
            std::fs::create_dir(folder.path().join(side)).expect("made");
            for n in numbers {
                std::fs::write(folder.path().join(side).join(format!("{side}_{n}.bmp")), b"BM").expect("written");
            }
        }
        let clip = Clip::list(&folder.path().join("left"), &folder.path().join("right")).expect("listed");
        assert_eq!(clip.pairs.iter().map(|p| p.number).collect::<Vec<_>>(), [8, 9, 10, 11]);
        assert!(clip.pairs[0].files[1].is_none() && clip.pairs[1].files.iter().all(Option::is_some));
        assert_eq!((clip.missing(0), clip.missing(1)), (vec![10], vec![8]));
        assert_eq!(clip.gap_notes(), ["left camera: no picture of frame 10", "right camera: no picture of frame 8"]);
        // Left 8, 9, 11 with right 9, 10, 11 one later each.
        let shifted = clip.shifted(1);
        let both: Vec<u64> = shifted.pairs.iter().filter(|p| p.files.iter().all(Option::is_some)).map(|p| p.number).collect();
        assert_eq!(both, [8, 9]);
        assert!(shifted.pairs[0].files[1].as_ref().expect("paired").ends_with("right_9.bmp"));
        assert_eq!(shifted.shifted(-1).pairs, clip.pairs);
        let part = clip.around(clip.pairs[1].number, 2);
        assert_eq!(part.pairs, clip.pairs[..2]);
        assert_eq!(clip.around(u64::MAX, 2).pairs, clip.pairs[clip.pairs.len() - 2..]);
        assert_eq!(clip.around(0, 99).pairs, clip.pairs);
        assert_eq!(clip.exchanged().exchanged().pairs, clip.pairs);
        assert!(clip.exchanged().pairs[0].files[0].is_none() && clip.exchanged().pairs[2].files[0].as_ref().expect("there").ends_with("right_10.bmp"));
        assert_eq!(ranges(&[3, 5, 6, 7, 8, 10]).expect("some"), "3, 5-8, 10");
    }

    #[test]
    fn fails_a_camera_without_pictures_or_without_a_common_frame_is_named() {
        let folder = tempfile::tempdir().expect("folder");
        let [left, right] = ["left", "right"].map(|side| folder.path().join(side));
        for side in [&left, &right] {
            std::fs::create_dir(side).expect("made");
        }
        std::fs::write(left.join("l_7.bmp"), b"BM").expect("written");
        let told = Clip::list(&left, &right).expect_err("no clip").to_string();
        assert!(told.contains("right: no pictures"), "{told}");
        std::fs::write(right.join("r_8.bmp"), b"BM").expect("written");
        let told = Clip::list(&left, &right).expect_err("no clip").to_string();
        assert!(told.contains("(the first has 7, the second 8)"), "{told}");
    }
}
