//! A look at a picture, or at a band of its rows, in full-picture coordinates: what tracking measures on.

use super::GreyImage;

/// Rows `first_row..first_row + rows` of a picture `width` wide and `height` high, without those that were left out. Bottom-up
/// bitmaps are looked at in place: `flipped` says that the memory starts with the lowest row.
#[derive(Debug, Clone, Copy)]
pub struct GreyView<'a> {
    pixels: &'a [u8],
    stride: usize,
    flipped: bool,
    /// By row of the band; empty where none is left out.
    left_out: &'a [bool],
    /// First column in memory and how many there are: all but in a patch.
    columns: (usize, usize),
    pub width: usize,
    pub height: usize,
    pub first_row: usize,
    pub rows: usize,
}

impl<'a> GreyView<'a> {
    /// The whole picture.
    pub fn of(image: &'a GreyImage) -> Self {
        GreyView {
            pixels: &image.pixels,
            stride: image.width,
            flipped: false,
            left_out: &[],
            columns: (0, image.width),
            width: image.width,
            height: image.height,
            first_row: 0,
            rows: image.height,
        }
    }

    /// A band of rows in memory; `None` when `pixels` is shorter than the band.
    pub fn band(pixels: &'a [u8], stride: usize, flipped: bool, size: (usize, usize), first_row: usize, rows: usize) -> Option<Self> {
        let (width, height) = size;
        let needed = rows.checked_mul(stride)?;
        (stride >= width && pixels.len() >= needed && first_row.checked_add(rows)? <= height).then_some(GreyView {
            pixels,
            stride,
            flipped,
            left_out: &[],
            columns: (0, width),
            width,
            height,
            first_row,
            rows,
        })
    }

    /// The same band of which some rows (by row of the band) were never read.
    pub fn without(self, left_out: &'a [bool]) -> Self {
        GreyView { left_out, ..self }
    }

    /// A box of a picture, row by row: its first column and row, columns and rows, and the picture's size.
    pub fn patch(pixels: &'a [u8], corner: (usize, usize), extent: (usize, usize), size: (usize, usize)) -> Self {
        let ((first_column, first_row), (columns, rows), (width, height)) = (corner, extent, size);
        GreyView { pixels, stride: columns, flipped: false, left_out: &[], columns: (first_column, columns), width, height, first_row, rows }
    }

    /// What is in memory of one row, with its first column; `None` outside the band and where the row was left out.
    #[inline]
    pub fn part_of_row(&self, y: usize) -> Option<(usize, &'a [u8])> {
        let i = y.checked_sub(self.first_row).filter(|i| *i < self.rows && !self.left_out.get(*i).is_some_and(|out| *out))?;
        let at = if self.flipped { self.rows - 1 - i } else { i } * self.stride;
        let (first, count) = self.columns;
        Some((first, self.pixels.get(at..at + count)?))
    }

    /// One whole row of the picture; `None` where it is not in memory.
    #[inline]
    pub fn row(&self, y: usize) -> Option<&'a [u8]> {
        self.part_of_row(y).map(|(_, row)| row).filter(|row| row.len() == self.width)
    }

    /// Grey value at a pixel; `None` where it is not in memory.
    #[inline]
    pub fn get(&self, x: i64, y: i64) -> Option<u8> {
        if x < 0 || y < 0 {
            return None;
        }
        let (first, row) = self.part_of_row(y as usize)?;
        row.get((x as usize).checked_sub(first)?).copied()
    }

    /// Whether a pixel lies beyond the picture's border.
    pub fn is_beyond(&self, x: i64, y: i64) -> bool {
        x < 0 || y < 0 || x >= self.width as i64 || y >= self.height as i64
    }

    /// Whether the pixel nearest to a place lies in the picture.
    pub fn holds(&self, x: f64, y: f64) -> bool {
        !self.is_beyond((x + 0.5).floor() as i64, (y + 0.5).floor() as i64)
    }

    /// Whether a box (inclusive) lies inside the band, all its rows read.
    pub fn contains(&self, x0: i64, y0: i64, x1: i64, y1: i64) -> bool {
        let (first, count) = self.columns;
        let inside = x0 >= first as i64 && y0 >= self.first_row as i64 && x1 < (first + count) as i64 && y1 < (self.first_row + self.rows) as i64;
        inside && (self.left_out.is_empty() || (y0..=y1).all(|y| self.part_of_row(y as usize).is_some()))
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
        let some = band.without(&[false, true, false]);
        assert_eq!([1, 2, 3].map(|y| some.get(2, y)), [whole.get(2, 1), None, whole.get(2, 3)]);
        assert!(some.contains(0, 1, 4, 1) && !some.contains(0, 1, 4, 3) && band.contains(0, 1, 4, 3));
    }
}
