//! The quick way through an uncompressed 8-bit grey bitmap, the format high-speed cameras write: only the rows asked for are
//! read, into a buffer that is used again, and looked at in place. Everything else goes the general way
//! ([`super::read_grey`]).

use super::open_files::OpenFile;
use super::{GreyView, Rows};
use std::fs::File;
use std::path::Path;
use std::sync::OnceLock;

/// Largest file taken the quick way, bytes.
const MOST: u64 = 1 << 26;
/// Bytes looked at for header and palette: the longest header (124 bytes), a full palette and some room.
const HEAD: usize = 1280;

/// Where the pixels stand in the file.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Of the whole file, bytes.
    pub length: u64,
    offset: usize,
    width: usize,
    height: usize,
    stride: usize,
    flipped: bool,
}

/// What is known of a picture that has been read.
#[derive(Debug)]
pub struct Known {
    pub layout: Layout,
    open: Option<OpenFile>,
}

/// A band of a bitmap's rows; the memory is reused from picture to picture.
#[derive(Debug, Default)]
pub struct Bitmap {
    head: Vec<u8>,
    /// File length, everything before the pixels, and the layout of the picture looked at last: pictures of one camera share them.
    known: Option<(u64, Vec<u8>, Layout)>,
    bytes: Vec<u8>,
    /// First row and number of rows in `bytes`, and the file's layout.
    band: Option<(usize, usize, Layout)>,
    /// Rows of the band that were not read; empty where all were.
    left_out: Vec<bool>,
}

impl Bitmap {
    /// Reads rows of a file; `known` is what is known of it once it has been read. `false` when it is not an uncompressed 8-bit bitmap with
    /// a grey ramp, whole to its last row. Rows beyond the picture are left out.
    pub fn read(&mut self, path: &Path, rows: Rows, known: &OnceLock<Known>) -> std::io::Result<bool> {
        self.band = None;
        match known.get() {
            Some(Known { layout, open: Some(open) }) => self.read_rows(open.file(), rows, layout)?,
            Some(Known { layout, open: None }) => self.read_rows(&File::open(path)?, rows, layout)?,
            None => {
                let file = File::open(path)?;
                let length = file.metadata()?.len();
                if !(54..=MOST).contains(&length) {
                    return Ok(false);
                }
                self.head.resize(HEAD.min(length as usize), 0);
                read_exact_at(&file, &mut self.head, 0)?;
                let Some(layout) = self.layout(length) else { return Ok(false) };
                self.read_rows(&file, rows, &layout)?;
                known.get_or_init(|| Known { layout, open: OpenFile::keep(file) });
            }
        }
        Ok(true)
    }

    fn read_rows(&mut self, file: &File, rows: Rows, l: &Layout) -> std::io::Result<()> {
        let spans = rows.within(l.height);
        let (first, end) = spans.clone().fold((l.height, 0), |(first, end), span| (first.min(span.0), end.max(span.1)));
        let count = end.saturating_sub(first);
        if self.bytes.len() < count * l.stride {
            self.bytes.resize(count * l.stride, 0);
        }
        self.left_out.clear();
        if spans.clone().map(|(first, end)| end - first).sum::<usize>() < count {
            self.left_out.resize(count, true);
        }
        for (top, below) in spans {
            // Bottom-up bitmaps begin with the lowest row.
            let (in_file, in_band) = if l.flipped { (l.height - below, end - below) } else { (top, top - first) };
            let bytes = &mut self.bytes[in_band * l.stride..(in_band + below - top) * l.stride];
            read_exact_at(file, bytes, (l.offset + in_file * l.stride) as u64)?;
            if let Some(left_out) = self.left_out.get_mut(top - first..below - first) {
                left_out.fill(false);
            }
        }
        self.band = Some((first.min(l.height), count, *l));
        Ok(())
    }

    /// The layout of the file whose head was just read.
    fn layout(&mut self, length: u64) -> Option<Layout> {
        if let Some((known_length, head, layout)) = &self.known
            && *known_length == length
            && self.head.starts_with(head)
        {
            return Some(*layout);
        }
        let layout = layout(&self.head, length)?;
        let before_pixels = self.head.get(..layout.offset.min(self.head.len()))?.to_vec();
        self.known = Some((length, before_pixels, layout));
        Some(layout)
    }

    /// The rows read last.
    pub fn view(&self) -> Option<GreyView<'_>> {
        let (first, count, l) = self.band.as_ref()?;
        let bytes = self.bytes.get(..count * l.stride)?;
        Some(GreyView::band(bytes, l.stride, l.flipped, (l.width, l.height), *first, *count)?.without(&self.left_out))
    }
}

/// Fills `bytes` from this place in the file on.
#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(not(unix))]
fn read_exact_at(mut file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
    use std::io::{Read, Seek, SeekFrom};
    file.seek(SeekFrom::Start(at))?;
    file.read_exact(bytes)
}

/// Header and palette are in `head`; the file is `length` bytes long.
fn layout(head: &[u8], length: u64) -> Option<Layout> {
    let u32_at = |i: usize| Some(u32::from_le_bytes(head.get(i..i + 4)?.try_into().ok()?));
    let i32_at = |i: usize| u32_at(i).map(|v| v as i32);
    let (offset, header) = (u32_at(10)? as usize, u32_at(14)? as usize);
    let (width, height) = (i32_at(18)?, i32_at(22)?);
    let bits = u16::from_le_bytes(head.get(28..30)?.try_into().ok()?);
    let known = head.starts_with(b"BM") && (40..=124).contains(&header) && bits == 8 && u32_at(30)? == 0;
    if !known || !(1..=16_384).contains(&width) || height == 0 || height.unsigned_abs() > 16_384 {
        return None;
    }
    let colours = match u32_at(46)? {
        0 => 256,
        n if n <= 256 => n as usize,
        _ => return None,
    };
    let palette = head.get(14 + header..14 + header + 4 * colours)?;
    let grey_ramp = palette.chunks_exact(4).enumerate().all(|(i, c)| usize::from(c[0]) == i && c[0] == c[1] && c[1] == c[2]);
    let (width, height_px) = (width as usize, height.unsigned_abs() as usize);
    let stride = width.div_ceil(4) * 4;
    let whole = length >= offset.checked_add(stride.checked_mul(height_px)?)? as u64 && offset >= 14 + header + 4 * colours;
    // A pixel beyond a short palette has no colour of its own: only a full ramp is sure.
    (grey_ramp && colours == 256 && whole).then_some(Layout { length, offset, width, height: height_px, stride, flipped: height > 0 })
}

/// Where the pixels begin, and where header and palette end, of a bitmap of any kind whose pixels begin within these: they would be read as pixels.
pub fn pixels_within_header(head: &[u8]) -> Option<(u64, u64)> {
    let u32_at = |i: usize| Some(u64::from(u32::from_le_bytes(head.get(i..i + 4)?.try_into().ok()?)));
    let u16_at = |i: usize| Some(u64::from(u16::from_le_bytes(head.get(i..i + 2)?.try_into().ok()?)));
    let (offset, header) = (u32_at(10)?, u32_at(14)?);
    // The oldest header has sizes of two bytes, colours of three, and does not count them.
    let (bits, colours, colour_bytes) = if header == 12 { (u16_at(24)?, 0, 3) } else { (u16_at(28)?, u32_at(46)?, 4) };
    let palette = match bits {
        1..=8 if colours == 0 => colour_bytes << bits,
        1..=8 => colour_bytes * colours,
        _ => 0,
    };
    let end = 14 + header + palette;
    (offset < end).then_some((offset, end))
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
        assert!(quick.read(&bmp, Rows::ALL, &OnceLock::new()).expect("read"));
        let view = quick.view().expect("a view");
        let rows: Vec<u8> = (0..21).flat_map(|y| view.row(y).expect("inside").to_vec()).collect();
        assert_eq!(GreyImage { width: 37, height: 21, pixels: rows.clone() }, read_grey(&bmp).expect("read"));
        for (first, count) in [(0, 3), (7, 9), (18, 3), (18, 40), (30, 2)] {
            assert!(quick.read(&bmp, Rows::span(first, count), &OnceLock::new()).expect("read"));
            let band = quick.view().expect("a view");
            for y in 0..24 {
                let inside = (first..first + count).contains(&y) && y < 21;
                assert_eq!(band.row(y), if inside { Some(&rows[y * 37..(y + 1) * 37]) } else { None }, "{first} {count} {y}");
            }
        }
        assert!(quick.read(&bmp, Rows::of([(15, 19), (2, 5)]), &OnceLock::new()).expect("read"));
        for y in 0..24 {
            let inside = (2..5).contains(&y) || (15..19).contains(&y);
            assert_eq!(quick.view().expect("a view").row(y), if inside { Some(&rows[y * 37..(y + 1) * 37]) } else { None }, "{y}");
        }
        assert!(!quick.read(&png, Rows::ALL, &OnceLock::new()).expect("read") && quick.view().is_none());
        let whole = std::fs::read(&bmp).expect("read");
        std::fs::write(&bmp, &whole[..whole.len() - 40]).expect("written");
        assert!(!quick.read(&bmp, Rows::span(0, 2), &OnceLock::new()).expect("read"), "a cut file is refused even when the rows asked for are there");
    }
}
