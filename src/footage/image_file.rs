//! One picture read by content (BMP, PNG, TIFF, JPEG), and the numbered pictures of a folder.

use super::bitmap::pixels_within_header;
use crate::short_list::short_list;
use image::{ColorType, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

/// Largest side of a picture, px. High-speed cameras stay below 4096, photographs below 16384.
const MAX_SIDE_PX: u32 = 16_384;
/// Largest number of pixels; 64 Mpx leaves room for any camera of today.
pub const MAX_PIXELS: u64 = 1 << 26;
/// Frame numbers become times: beyond this a double does not tell neighbours apart.
pub const LARGEST_FRAME_NUMBER: u64 = 1 << 53;
/// Largest file, bytes: four bytes a pixel at the largest size, plus a header.
const MAX_BYTES: u64 = (MAX_PIXELS << 2) + (1 << 20);
/// Most pictures in one folder (a million frames is over 16 minutes at 1000 frames a second).
const MAX_PICTURES: usize = 1_000_000;
/// Folders named that may be meant in the place of one that is not there.
const NAMED: usize = 4;

/// Why a picture or a folder of pictures cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FootageError {
    #[error("{path}: cannot be read ({source})", path = .path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("{path}: there is no such folder; beside it: {beside}", path = .path.display())]
    NoFolder { path: PathBuf, beside: String },
    #[error("{path}: the file is empty; the recording may have been cut off", path = .path.display())]
    Empty { path: PathBuf },
    #[error("{path}: {bytes} bytes; allowed: up to {MAX_BYTES}", path = .path.display())]
    FileTooLarge { path: PathBuf, bytes: u64 },
    #[error("{path}: not a picture by its content (it begins with \"{begins}\"); allowed: BMP, PNG, TIFF, JPEG", path = .path.display())]
    UnknownFormat { path: PathBuf, begins: String },
    #[error("{path}: {width}x{height} px; allowed: 1 to {MAX_SIDE_PX} px a side and {MAX_PIXELS} px in all", path = .path.display())]
    Size { path: PathBuf, width: u32, height: u32 },
    #[error("{path}: the {format} picture is cut off ({what}); copy it again from the camera", path = .path.display())]
    Truncated { path: PathBuf, format: &'static str, what: String },
    #[error("{path}: the {format} picture is damaged ({what}); copy it again from the camera", path = .path.display())]
    Damaged { path: PathBuf, format: &'static str, what: String },
    #[error("{path}: a kind of {format} picture that is not read ({what}); allowed: grey or colour of up to 16 whole bits a channel; save it as such", path = .path.display())]
    Unsupported { path: PathBuf, format: &'static str, what: String },
    #[error("{path}: no number in the file name; frames are paired by the last digits of their names, so name it like frame_0012.bmp or move it away", path = .path.display())]
    NoNumber { path: PathBuf },
    #[error("{path}: the number in the file name is too long; allowed: up to {}", u64::MAX, path = .path.display())]
    NumberTooLarge { path: PathBuf },
    #[error("{path}: {number} is no frame number; allowed: up to {LARGEST_FRAME_NUMBER}; number frames from 0 or 1", path = .path.display())]
    NoFrameNumber { path: PathBuf, number: u64 },
    #[error("{first} and {second} both have the number {number} (the last digits of a name are the frame's number); keep one of them in this folder, or rename the pictures so that their names end with it", first = .first.display(), second = .second.display())]
    DuplicateNumber { number: u64, first: PathBuf, second: PathBuf },
    #[error("{path}: no pictures in this folder; allowed: BMP, PNG, TIFF, JPEG, their frame numbers in their names", path = .path.display())]
    NoPictures { path: PathBuf },
    #[error("{left} and {right} share no frame number (the first has {left_numbers}, the second {right_numbers}); pictures are paired by the last digits of their names", left = .left.display(), right = .right.display())]
    NoCommonFrames { left: PathBuf, right: PathBuf, left_numbers: String, right_numbers: String },
    #[error("{path}: more than {MAX_PICTURES} pictures in one folder", path = .path.display())]
    TooMany { path: PathBuf },
}

/// An 8-bit grey picture, row by row from the top left. Pixel (0, 0) means the centre of the top-left pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GreyImage {
    pub width: usize,
    pub height: usize,
    /// `width * height` values.
    pub pixels: Vec<u8>,
}

impl GreyImage {
    /// The grey value at column `x`, row `y`; `None` outside the picture.
    pub fn get(&self, x: usize, y: usize) -> Option<u8> {
        if x < self.width { self.pixels.get(y * self.width + x).copied() } else { None }
    }
}

/// A picture as its file holds it.
#[derive(Debug)]
pub(super) enum Decoded {
    Grey(GreyImage),
    /// More than 8 bits a pixel, as high-speed cameras of 10, 12 or 14 bits write them.
    Deep {
        width: usize,
        height: usize,
        values: Vec<u16>,
    },
}

impl Decoded {
    /// Bits a pixel that the picture's values need, 8 to 16 in steps of two; a camera's range, unless all of it is dark.
    pub fn bits(&self) -> u32 {
        match self {
            Decoded::Grey(_) => 8,
            Decoded::Deep { values, .. } => (u16::BITS - values.iter().fold(0, |all, v| all | v).leading_zeros()).next_multiple_of(2).max(8),
        }
    }

    /// As 8-bit grey, the range of so many bits over all of it; brighter pixels become white.
    pub fn grey(self, bits: u32) -> GreyImage {
        match self {
            Decoded::Grey(image) => image,
            Decoded::Deep { width, height, values } => {
                let full = (1u32 << bits.clamp(8, 16)) - 1;
                let pixels = values.iter().map(|v| ((u32::from(*v).min(full) * 255 + full / 2) / full) as u8).collect();
                GreyImage { width, height, pixels }
            }
        }
    }
}

/// Reads one picture by its content, whatever its extension says, as 8-bit grey.
///
/// Colour becomes luminance (Rec. 709); of a picture of more than 8 bits the range of as many bits as its values need (8, 10, 12,
/// 14 or 16) is scaled to 8 bits: cameras of 12 bits write files of 16.
pub fn read_grey(path: &Path) -> Result<GreyImage, FootageError> {
    let decoded = read_decoded(path)?;
    let bits = decoded.bits();
    Ok(decoded.grey(bits))
}

/// The same, with all the bits there are.
pub(super) fn read_decoded(path: &Path) -> Result<Decoded, FootageError> {
    let unreadable = |source| FootageError::Unreadable { path: path.into(), source };
    let file = std::fs::File::open(path).map_err(unreadable)?;
    let bytes_on_disk = file.metadata().map_err(unreadable)?.len();
    if bytes_on_disk > MAX_BYTES {
        return Err(FootageError::FileTooLarge { path: path.into(), bytes: bytes_on_disk });
    }
    let mut bytes = Vec::with_capacity(bytes_on_disk as usize);
    // The length may change while we read (a pipe, a file being copied): the limit holds for what is read.
    file.take(MAX_BYTES).read_to_end(&mut bytes).map_err(unreadable)?;
    decode(&bytes, path)
}

/// Decodes a picture already in memory; `path` serves the error messages only.
fn decode(bytes: &[u8], path: &Path) -> Result<Decoded, FootageError> {
    if bytes.is_empty() {
        return Err(FootageError::Empty { path: path.into() });
    }
    let Some((format, format_name)) = format_of(bytes) else {
        let begins = bytes.iter().take(8).flat_map(|b| std::ascii::escape_default(*b)).map(char::from).collect();
        return Err(FootageError::UnknownFormat { path: path.into(), begins });
    };
    let failed = |e: image::ImageError| match &e {
        image::ImageError::IoError(io) if io.kind() == std::io::ErrorKind::UnexpectedEof => truncated(path, format_name, "the file ends early"),
        image::ImageError::Limits(_) => {
            FootageError::Damaged { path: path.into(), format: format_name, what: "it asks for more memory than any camera picture".into() }
        }
        // Whole as it may be: another copy from the camera would not be read either.
        image::ImageError::Unsupported(_) => FootageError::Unsupported { path: path.into(), format: format_name, what: e.to_string() },
        _ if e.to_string().to_lowercase().contains("eof") => truncated(path, format_name, "the file ends early"),
        _ => FootageError::Damaged { path: path.into(), format: format_name, what: e.to_string() },
    };
    if format == ImageFormat::Jpeg && !jpeg_is_whole(bytes) {
        return Err(truncated(path, format_name, "the end marker is missing"));
    }
    if format == ImageFormat::Bmp
        && let Some((offset, end)) = pixels_within_header(bytes)
    {
        let what = format!("its pixels begin at byte {offset}, within its header and palette of {end}");
        return Err(FootageError::Damaged { path: path.into(), format: format_name, what });
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE_PX);
    limits.max_image_height = Some(MAX_SIDE_PX);
    limits.max_alloc = Some(MAX_PIXELS * 8);
    reader.limits(limits);
    let decoder = match reader.into_decoder() {
        Ok(decoder) => decoder,
        Err(e @ image::ImageError::Limits(_)) => {
            // The limit error does not say the size; a second look at the header does, unless something else is too large.
            return Err(match ImageReader::with_format(Cursor::new(bytes), format).into_dimensions() {
                Ok((width, height)) if !is_picture_size(width, height) => FootageError::Size { path: path.into(), width, height },
                _ => failed(e),
            });
        }
        Err(e) => return Err(failed(e)),
    };
    let (width, height) = decoder.dimensions();
    if !is_picture_size(width, height) {
        return Err(FootageError::Size { path: path.into(), width, height });
    }
    let color = decoder.color_type();
    let image = image::DynamicImage::from_decoder(decoder).map_err(failed)?;
    let (width, height) = (width as usize, height as usize);
    Ok(match color {
        ColorType::L8 => Decoded::Grey(GreyImage { width, height, pixels: image.into_bytes() }),
        _ if color.bytes_per_pixel() > color.channel_count() => Decoded::Deep { width, height, values: image.into_luma16().into_raw() },
        _ => Decoded::Grey(GreyImage { width, height, pixels: image.into_luma8().into_raw() }),
    })
}

fn is_picture_size(width: u32, height: u32) -> bool {
    [width, height].iter().all(|side| (1..=MAX_SIDE_PX).contains(side)) && u64::from(width) * u64::from(height) <= MAX_PIXELS
}

/// The numbered pictures of a folder, sorted by number. The number is the last run of digits in the name.
///
/// Other files (notes, thumbnails databases) and hidden ones are passed over; a picture is told by its content or its
/// extension, so a damaged picture is listed and fails when it is read, not silently left out. Gaps are allowed.
pub fn numbered_images(folder: &Path) -> Result<Vec<(u64, PathBuf)>, FootageError> {
    let unreadable = |source| FootageError::Unreadable { path: folder.into(), source };
    let mut found = Vec::new();
    let entries = std::fs::read_dir(folder).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => FootageError::NoFolder { path: folder.into(), beside: folders_beside(folder) },
        _ => unreadable(e),
    })?;
    for entry in entries {
        let entry = entry.map_err(unreadable)?;
        let (name, path) = (entry.file_name().to_string_lossy().into_owned(), entry.path());
        // The folder itself says what most entries are; only a link must be followed.
        let is_file = || entry.file_type().map_or(true, |t| if t.is_symlink() { path.is_file() } else { t.is_file() });
        if name.starts_with('.') || !is_file() || !is_picture(&path) {
            continue;
        }
        if found.len() == MAX_PICTURES {
            return Err(FootageError::TooMany { path: folder.into() });
        }
        found.push((number_in(&name, &path)?, path));
    }
    found.sort();
    for pair in found.windows(2) {
        if pair[0].0 == pair[1].0 {
            return Err(FootageError::DuplicateNumber { number: pair[0].0, first: pair[0].1.clone(), second: pair[1].1.clone() });
        }
    }
    Ok(found)
}

/// Folders beside one that is not there: under one of these names it may have been meant.
fn folders_beside(folder: &Path) -> String {
    let entries = folder.parent().and_then(|parent| std::fs::read_dir(parent).ok()).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.filter(|e| e.path().is_dir()).map(|e| format!("`{}`", e.file_name().to_string_lossy())).collect();
    names.sort();
    if names.is_empty() { "none".to_owned() } else { short_list(&names, NAMED, ", ") }
}

/// The last run of digits of the name without its extension; of the whole name when that has none (`frame.0012`).
fn number_in(name: &str, path: &Path) -> Result<u64, FootageError> {
    let stem = Path::new(name).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let digits = last_digits(&stem).or_else(|| last_digits(name)).ok_or_else(|| FootageError::NoNumber { path: path.into() })?;
    digits.parse().map_err(|_| FootageError::NumberTooLarge { path: path.into() })
}

/// The last run of digits in a text.
pub(crate) fn last_digits(text: &str) -> Option<&str> {
    let end = text.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = text[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |i| i + text[i..].chars().next().map_or(1, char::len_utf8));
    Some(&text[start..end])
}

fn is_picture(path: &Path) -> bool {
    let by_name = path.extension().is_some_and(|e| ["bmp", "png", "tif", "tiff", "jpg", "jpeg"].iter().any(|k| e.eq_ignore_ascii_case(k)));
    by_name || {
        let mut head = Vec::with_capacity(8);
        std::fs::File::open(path).is_ok_and(|f| f.take(8).read_to_end(&mut head).is_ok() && format_of(&head).is_some())
    }
}

fn format_of(bytes: &[u8]) -> Option<(ImageFormat, &'static str)> {
    match bytes {
        [b'B', b'M', ..] => Some((ImageFormat::Bmp, "BMP")),
        [0x89, b'P', b'N', b'G', ..] => Some((ImageFormat::Png, "PNG")),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => Some((ImageFormat::Tiff, "TIFF")),
        [0xff, 0xd8, 0xff, ..] => Some((ImageFormat::Jpeg, "JPEG")),
        _ => None,
    }
}

/// The decoder fills a cut-off JPEG with grey; the end marker tells. Some cameras pad the file after it.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let end = bytes.iter().rposition(|b| *b != 0).map_or(0, |i| i + 1);
    bytes[..end].windows(2).rev().take(4096).any(|w| w == [0xff, 0xd9])
}

fn truncated(path: &Path, format: &'static str, what: &str) -> FootageError {
    FootageError::Truncated { path: path.into(), format, what: what.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 5x4 ramp in every format.
    fn encoded(format: ImageFormat) -> (Vec<u8>, Vec<u8>) {
        let pixels: Vec<u8> = (0..64 * 48).map(|i| (i / 13 % 251) as u8).collect();
        let image = image::GrayImage::from_raw(64, 48, pixels.clone()).expect("sizes agree");
        let mut out = Cursor::new(Vec::new());
        image::DynamicImage::from(image).write_to(&mut out, format).expect("encodes");
        (out.into_inner(), pixels)
    }

    const ALL: [ImageFormat; 4] = [ImageFormat::Bmp, ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Jpeg];

    #[test]
    fn truth_every_format_is_read_by_content_whatever_the_extension() {
        let folder = tempfile::tempdir().expect("folder");
        for format in ALL {
            let (bytes, pixels) = encoded(format);
            let path = folder.path().join("picture_1.xyz");
            std::fs::write(&path, bytes).expect("written");
            let grey = read_grey(&path).expect("read");
            assert_eq!((grey.width, grey.height), (64, 48));
            if format != ImageFormat::Jpeg {
                assert_eq!(grey.pixels, pixels, "{format:?}");
            }
        }
    }

    #[test]
    fn truth_pictures_of_12_bits_in_files_of_16_keep_their_greys() {
        let folder = tempfile::tempdir().expect("folder");
        let values: Vec<u16> = (0..64 * 48).map(|i| (i * 4095 / (64 * 48 - 1)) as u16).collect();
        for (name, gain, bits) in [("a_1.png", 1, 12), ("a_2.tif", 1, 12), ("a_3.png", 16, 16)] {
            let image = image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_raw(64, 48, values.iter().map(|v| v * gain).collect()).expect("sizes agree");
            image.save(folder.path().join(name)).expect("written");
            assert_eq!(read_decoded(&folder.path().join(name)).expect("read").bits(), bits, "{name}");
            let grey = read_grey(&folder.path().join(name)).expect("read").pixels;
            assert_eq!((grey[0], grey[64 * 48 - 1]), (0, 255), "{name}");
            assert!(grey.iter().zip(&values).all(|(g, v)| (f64::from(*g) - f64::from(*v) * 255.0 / 4095.0).abs() <= 0.6), "{name}");
        }
        let dim = Decoded::Deep { width: 3, height: 1, values: vec![3, 40, 200] };
        assert_eq!(dim.bits(), 8);
        assert_eq!(dim.grey(8).pixels, [3, 40, 200]);
        assert_eq!(Decoded::Deep { width: 2, height: 1, values: vec![511, 1024] }.grey(10).pixels, [127, 255]);
    }

    #[test]
    fn fails_a_picture_cut_at_any_of_many_places() {
        for format in ALL {
            let (bytes, _) = encoded(format);
            for keep in [0.02, 0.1, 0.4, 0.7, 0.9, 0.97] {
                let cut = &bytes[..(bytes.len() as f64 * keep) as usize];
                let e = decode(cut, Path::new("cut_7.bmp")).expect_err("a cut picture must not be read");
                assert!(e.to_string().starts_with("cut_7.bmp"), "{format:?} {keep}: {e}");
            }
        }
    }

    #[test]
    fn fails_sizes_that_would_fill_the_memory_before_taking_it() {
        let (mut bytes, _) = encoded(ImageFormat::Bmp);
        bytes[18..22].copy_from_slice(&1_000_000_000i32.to_le_bytes());
        bytes[22..26].copy_from_slice(&1_000_000_000i32.to_le_bytes());
        let e = decode(&bytes, Path::new("huge.bmp")).expect_err("too large");
        assert!(matches!(e, FootageError::Size { .. } | FootageError::Damaged { .. }), "{e}");
    }

    #[test]
    fn fails_a_bitmap_whose_header_would_be_read_as_pixels() {
        let (bytes, _) = encoded(ImageFormat::Bmp);
        let begin = u32::from_le_bytes(bytes[10..14].try_into().expect("four bytes"));
        for (offset, sound) in [(begin, true), (begin - 4, false), (10, false), (0, false)] {
            let mut bytes = bytes.clone();
            bytes[10..14].copy_from_slice(&offset.to_le_bytes());
            let read = decode(&bytes, Path::new("a_1.bmp")).map_err(|e| e.to_string());
            assert!(if sound { read.is_ok() } else { read.is_err_and(|e| e.contains(&format!("its pixels begin at byte {offset}, within"))) }, "{offset}");
        }
    }

    #[test]
    fn fails_a_kind_of_picture_that_is_not_read_without_blaming_the_copy() {
        let (mut bytes, _) = encoded(ImageFormat::Bmp);
        // A JPEG picture in a bitmap's clothes.
        bytes[30..34].copy_from_slice(&4u32.to_le_bytes());
        let e = decode(&bytes, Path::new("a_1.bmp")).expect_err("not read").to_string();
        assert!(e.starts_with("a_1.bmp: a kind of BMP picture that is not read (") && e.contains("save it as such") && !e.contains("copy it again"), "{e}");
    }

    #[test]
    fn fails_something_that_is_not_a_picture() {
        assert!(matches!(decode(b"MZ\x90\0 not a picture", Path::new("a")), Err(FootageError::UnknownFormat { .. })));
        assert!(matches!(decode(b"", Path::new("a")), Err(FootageError::Empty { .. })));
    }

    #[test]
    fn truth_numbers_are_the_last_digits_and_sorted_as_numbers() {
        let folder = tempfile::tempdir().expect("folder");
        let (bytes, _) = encoded(ImageFormat::Png);
        for name in ["cam1_10.png", "cam1_9.bmp", "cam2_000011.png", "x.0012", "notes.txt", ".hidden_3.png"] {
            std::fs::write(folder.path().join(name), if name == "notes.txt" { b"text" as &[u8] } else { &bytes }).expect("written");
        }
        let numbers: Vec<u64> = numbered_images(folder.path()).expect("listed").into_iter().map(|(n, _)| n).collect();
        assert_eq!(numbers, [9, 10, 11, 12]);
        std::fs::write(folder.path().join("again_0009.png"), &bytes).expect("written");
        assert!(matches!(numbered_images(folder.path()), Err(FootageError::DuplicateNumber { number: 9, .. })));
        std::fs::remove_file(folder.path().join("again_0009.png")).expect("removed");
        std::fs::write(folder.path().join("background.png"), &bytes).expect("written");
        assert!(matches!(numbered_images(folder.path()), Err(FootageError::NoNumber { .. })));
    }
}
