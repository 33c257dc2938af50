//! A look at a picture, or at a band of its rows, in full-picture coordinates: what tracking measures on.

use super::GreyImage;

/// Rows `first_row..first_row + rows` of a picture `width` wide and `height` high. Bottom-up bitmaps are looked at in
/// place: `flipped` says that the memory starts with the lowest row.
#[derive(Debug, Clone, Copy)]
pub struct GreyView<'a> {
    pixels: &'a [u8],
    stride: usize,
    flipped: bool,
    pub width: usize,
    pub height: usize,
    pub first_row: usize,
    pub rows: usize,
}

impl<'a> GreyView<'a> {
    /// The whole picture.
    pub fn of(image: &'a GreyImage) -> Self {
        GreyView { pixels: &image.pixels, stride: image.width, flipped: false, width: image.width, height: image.height, first_row: 0, rows: image.height }
    }

    /// A band of rows in memory; `None` when `pixels` is shorter than the band.
    pub fn band(pixels: &'a [u8], stride: usize, flipped: bool, size: (usize, usize), first_row: usize, rows: usize) -> Option<Self> {
        let (width, height) = size;
        let needed = rows.checked_mul(stride)?;
        (stride >= width && pixels.len() >= needed && first_row.checked_add(rows)? <= height).then_some(GreyView {
            pixels,
            stride,
            flipped,
            width,
            height,
            first_row,
            rows,
        })
    }

    /// One row of the picture; `None` outside the band.
    #[inline]
    pub fn row(&self, y: usize) -> Option<&'a [u8]> {
        let i = y.checked_sub(self.first_row).filter(|i| *i < self.rows)?;
        let at = if self.flipped { self.rows - 1 - i } else { i } * self.stride;
        self.pixels.get(at..at + self.width)
    }

    /// Grey value at a pixel; `None` outside the band.
    #[inline]
    pub fn get(&self, x: i64, y: i64) -> Option<u8> {
        if x < 0 || y < 0 {
            return None;
        }
        self.row(y as usize)?.get(x as usize).copied()
    }

    /// Whether a box (inclusive) lies inside the band.
    pub fn contains(&self, x0: i64, y0: i64, x1: i64, y1: i64) -> bool {
        x0 >= 0 && y0 >= self.first_row as i64 && x1 < self.width as i64 && y1 < (self.first_row + self.rows) as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_band_and_its_flipped_twin_show_the_same_pixels() {
        let image = GreyImage { width: 5, height: 4, pixels: (0..20).collect() };
        let whole = GreyView::of(&image);
        let flipped: Vec<u8> = [3, 2, 1].iter().flat_map(|y| image.pixels[y * 5..y * 5 + 5].to_vec()).collect();
        let band = GreyView::band(&flipped, 5, true, (5, 4), 1, 3).expect("fits");
        for y in 0..4 {
            for x in 0..5 {
                assert_eq!(band.get(x, y), if y >= 1 { whole.get(x, y) } else { None });
            }
        }
        assert!(GreyView::band(&flipped, 5, true, (5, 4), 2, 3).is_none());
        assert_eq!(whole.get(-1, 0), None);
    }
}
