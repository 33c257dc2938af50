//! Pictures that must be decoded whole (PNG, TIFF, JPEG, colour bitmaps), kept while there is room: tracking looks at each several
//! times, and decoding takes longer than measuring.

use super::{FootageError, GreyImage, read_grey};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Room for pictures, bytes: 256 of 512 x 512. What comes later is decoded each time, so that memory does not grow with the clip.
const MOST_BYTES: usize = 64 << 20;

#[derive(Debug, Default)]
pub struct DecodedPictures {
    kept: Mutex<Kept>,
}

#[derive(Debug, Default)]
struct Kept {
    bytes: usize,
    by_path: HashMap<PathBuf, Arc<GreyImage>>,
}

impl DecodedPictures {
    /// The picture, decoded now or earlier.
    ///
    /// # Errors  as [`read_grey`]; a picture that cannot be read is tried again each time
    pub fn read(&self, path: &Path) -> Result<Arc<GreyImage>, FootageError> {
        if let Some(image) = self.kept.lock().ok().and_then(|kept| kept.by_path.get(path).cloned()) {
            return Ok(image);
        }
        let image = Arc::new(read_grey(path)?);
        if let Ok(mut kept) = self.kept.lock()
            && kept.bytes + image.pixels.len() <= MOST_BYTES
            && kept.by_path.insert(path.into(), image.clone()).is_none()
        {
            kept.bytes += image.pixels.len();
        }
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn law_pictures_are_kept_up_to_the_room_there_is() {
        let folder = tempfile::tempdir().expect("folder");
        let path = |i: usize| folder.path().join(format!("{i}.png"));
        // Eight pictures of 3000 x 3000 are more than fits.
        for i in 0..8 {
            let image = image::GrayImage::from_pixel(3000, 3000, image::Luma([i as u8]));
            image.save(path(i)).expect("written");
        }
        let pictures = DecodedPictures::default();
        for round in 0..2 {
            for i in 0..8 {
                assert_eq!(pictures.read(&path(i)).expect("read").pixels[7], i as u8, "{round}");
            }
        }
        assert!(pictures.read(&folder.path().join("none.png")).is_err());
        let kept = pictures.kept.lock().expect("free");
        assert_eq!((kept.by_path.len(), kept.bytes), (7, 7 * 9_000_000));
    }
}
