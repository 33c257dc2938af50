//! The quick way through an uncompressed 8-bit grey bitmap, the format high-speed cameras write: one read into a buffer that
//! is used again, looked at in place. Everything else goes the general way ([`super::read_grey`]).

use super::GreyView;
use std::io::Read;
use std::path::Path;

/// Largest file taken the quick way, bytes.
const MOST: u64 = 1 << 26;

/// Where the pixels stand in the file's bytes.
#[derive(Debug, Clone, Copy)]
struct Layout {
    offset: usize,
    width: usize,
    height: usize,
    stride: usize,
    flipped: bool,
}

/// A bitmap's bytes, reused from picture to picture.
#[derive(Debug, Default)]
pub struct Bitmap {
    bytes: Vec<u8>,
    layout: Option<Layout>,
}

impl Bitmap {
    /// Reads the file; `false` when it is not an uncompressed 8-bit bitmap with a grey ramp, whole to its last row.
    pub fn read(&mut self, path: &Path) -> std::io::Result<bool> {
        self.layout = None;
        self.bytes.clear();
        let file = std::fs::File::open(path)?;
        let length = file.metadata()?.len();
        if !(54..=MOST).contains(&length) {
            return Ok(false);
        }
        let mut file = file.take(length);
        let mut head = [0u8; 54];
        file.read_exact(&mut head)?;
        if head[..2] != *b"BM" {
            return Ok(false);
        }
        self.bytes.extend_from_slice(&head);
        file.read_to_end(&mut self.bytes)?;
        self.layout = layout(&self.bytes);
        Ok(self.layout.is_some())
    }

    /// The picture read last.
    pub fn view(&self) -> Option<GreyView<'_>> {
        let l = self.layout?;
        GreyView::band(self.bytes.get(l.offset..)?, l.stride, l.flipped, (l.width, l.height), 0, l.height)
    }
}

fn layout(bytes: &[u8]) -> Option<Layout> {
    let u32_at = |i: usize| Some(u32::from_le_bytes(bytes.get(i..i + 4)?.try_into().ok()?));
    let i32_at = |i: usize| u32_at(i).map(|v| v as i32);
    let (offset, header) = (u32_at(10)? as usize, u32_at(14)? as usize);
    let (width, height) = (i32_at(18)?, i32_at(22)?);
    let bits = u16::from_le_bytes(bytes.get(28..30)?.try_into().ok()?);
    if header < 40 || bits != 8 || u32_at(30)? != 0 || !(1..=16_384).contains(&width) || height == 0 || height.unsigned_abs() > 16_384 {
        return None;
    }
    let colours = match u32_at(46)? {
        0 => 256,
        n if n <= 256 => n as usize,
        _ => return None,
    };
    let palette = bytes.get(14 + header..14 + header + 4 * colours)?;
    let grey_ramp = palette.chunks_exact(4).enumerate().all(|(i, c)| usize::from(c[0]) == i && c[0] == c[1] && c[1] == c[2]);
    let (width, height_px) = (width as usize, height.unsigned_abs() as usize);
    let stride = width.div_ceil(4) * 4;
    let whole = bytes.len() >= offset.checked_add(stride.checked_mul(height_px)?)?;
    // A pixel beyond a short palette has no colour of its own: only a full ramp is sure.
    (grey_ramp && colours == 256 && whole).then_some(Layout { offset, width, height: height_px, stride, flipped: height > 0 })
}

#[cfg(test)]
mod tests {
    use super::super::{GreyImage, read_grey};
    use super::*;

    #[test]
    fn agrees_with_the_general_reader_and_refuses_what_it_does_not_know() {
        let folder = tempfile::tempdir().expect("folder");
        let pixels: Vec<u8> = (0..37 * 21).map(|i| (i * 5 % 256) as u8).collect();
        let image = image::GrayImage::from_raw(37, 21, pixels.clone()).expect("sizes agree");
        let (bmp, png) = (folder.path().join("a_1.bmp"), folder.path().join("a_2.bmp"));
        image.save_with_format(&bmp, image::ImageFormat::Bmp).expect("saved");
        image.save_with_format(&png, image::ImageFormat::Png).expect("saved");
        let mut quick = Bitmap::default();
        assert!(quick.read(&bmp).expect("read"));
        let view = quick.view().expect("a view");
        let rows: Vec<u8> = (0..21).flat_map(|y| view.row(y).expect("inside").to_vec()).collect();
        assert_eq!(GreyImage { width: 37, height: 21, pixels: rows }, read_grey(&bmp).expect("read"));
        assert!(!quick.read(&png).expect("read") && quick.view().is_none());
        let whole = std::fs::read(&bmp).expect("read");
        std::fs::write(&bmp, &whole[..whole.len() - 40]).expect("written");
        assert!(!quick.read(&bmp).expect("read"));
    }
}
