//! Pictures that must be decoded whole (PNG, TIFF, JPEG, colour bitmaps), kept while there is room: tracking looks at each several
//! times, and decoding takes longer than measuring.

use super::image_file::{Decoded, read_decoded};
use super::{FootageError, GreyImage};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

/// Room for pictures, bytes: 256 of 512 x 512. What comes later is decoded each time, so that memory does not grow with the clip.
const MOST_BYTES: usize = 64 << 20;

/// Pictures of a camera whose values tell how many bits it records.
const SAMPLES: usize = 9;

#[derive(Debug, Default)]
pub struct DecodedPictures {
    kept: Mutex<Kept>,
    /// Of each camera's folder.
    depths: Vec<Depth>,
}

/// How many bits a camera records, for pictures of more than eight. One for all of a clip: its background is compared with it.
#[derive(Debug)]
struct Depth {
    folder: PathBuf,
    samples: Vec<PathBuf>,
    bits: OnceLock<u32>,
}

#[derive(Debug, Default)]
struct Kept {
    bytes: usize,
    by_path: HashMap<PathBuf, Arc<GreyImage>>,
}

impl DecodedPictures {
    /// Of the pictures of these folders.
    pub fn of(cameras: [(&Path, &[(u64, PathBuf)]); 2]) -> Self {
        let depths = cameras.map(|(folder, pictures)| Depth {
            folder: folder.into(),
            samples: pictures.iter().step_by(pictures.len().div_ceil(SAMPLES).max(1)).map(|(_, path)| path.clone()).collect(),
            bits: OnceLock::new(),
        });
        DecodedPictures { kept: Mutex::default(), depths: depths.into() }
    }

    /// One line for each camera that turned out to write more than 8 bits.
    pub fn depth_notes(&self) -> Vec<String> {
        let told = |d: &Depth| {
            let name = d.folder.file_name().unwrap_or_default().to_string_lossy();
            Some(format!("{name} camera: pictures of more than 8 bits; their values are those of {} bits, scaled to 8", d.bits.get()?))
        };
        self.depths.iter().filter_map(told).collect()
    }

    /// How many bits the camera of this picture records.
    fn bits(&self, path: &Path, picture: &Decoded) -> u32 {
        let Some(depth) = self.depths.iter().find(|d| path.parent() == Some(&d.folder)) else { return picture.bits() };
        // Pictures that cannot be read say so when it is their turn.
        let all = || depth.samples.iter().filter_map(|path| Some(read_decoded(path).ok()?.bits())).fold(8, u32::max);
        *depth.bits.get_or_init(all)
    }

    /// The picture, decoded now or earlier.
    ///
    /// # Errors  as [`super::read_grey`]; a picture that cannot be read is tried again each time
    pub fn read(&self, path: &Path) -> Result<Arc<GreyImage>, FootageError> {
        if let Some(image) = self.kept.lock().ok().and_then(|kept| kept.by_path.get(path).cloned()) {
            return Ok(image);
        }
        let image = Arc::new(match read_decoded(path)? {
            Decoded::Grey(image) => image,
            deep => {
                let bits = self.bits(path, &deep);
                deep.grey(bits)
            }
        });
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
    fn law_a_dark_picture_has_the_range_of_its_camera() {
        let folder = tempfile::tempdir().expect("folder");
        let pictures: Vec<(u64, PathBuf)> = (0..30).map(|i| (i, folder.path().join(format!("{i}.png")))).collect();
        for (i, path) in &pictures {
            let value = if *i < 10 { 200 } else { 3000 + *i as u16 };
            image::ImageBuffer::from_pixel(32, 32, image::Luma([value])).save(path).expect("written");
        }
        let read = DecodedPictures::of([(folder.path(), &pictures), (Path::new("none"), &[])]);
        assert!(read.depth_notes().is_empty());
        let first = |i: usize| read.read(&pictures[i].1).expect("read").pixels[0];
        assert_eq!((first(0), first(29)), (12, 189));
        assert_eq!(read.depth_notes().len(), 1);
        assert!(read.depth_notes()[0].contains("of 12 bits"), "{:?}", read.depth_notes());
    }

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
