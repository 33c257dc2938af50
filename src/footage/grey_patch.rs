//! A small part of a picture, kept when the rest of it is gone.

use super::GreyView;

/// The pixels of a box, copied.
#[derive(Debug, Clone)]
pub struct GreyPatch {
    pixels: Vec<u8>,
    /// First column and row.
    corner: (usize, usize),
    /// Columns and rows.
    extent: (usize, usize),
    /// Width and height of the picture.
    size: (usize, usize),
}

impl GreyPatch {
    /// Of a box (inclusive), of which what lies beyond the picture is left out; `None` where nothing is left or a row was not read.
    pub fn of(view: &GreyView, (x0, y0): (i64, i64), (x1, y1): (i64, i64)) -> Option<Self> {
        let (x0, y0) = (x0.max(0) as usize, y0.max(0) as usize);
        let (x1, y1) = (usize::try_from(x1).ok()?.min(view.width.checked_sub(1)?), usize::try_from(y1).ok()?.min(view.height.checked_sub(1)?));
        let (columns, rows) = ((x1 + 1).checked_sub(x0)?, (y1 + 1).checked_sub(y0)?);
        if columns == 0 || rows == 0 {
            return None;
        }
        let mut pixels = Vec::with_capacity(columns * rows);
        for y in y0..=y1 {
            pixels.extend_from_slice(view.row(y)?.get(x0..=x1)?);
        }
        Some(GreyPatch { pixels, corner: (x0, y0), extent: (columns, rows), size: (view.width, view.height) })
    }

    /// Whitens pixels (column, row in the picture): to whoever looks they say no more than a saturated one.
    pub fn whiten(&mut self, which: impl Fn(usize, usize) -> bool) {
        for (at, pixel) in self.pixels.iter_mut().enumerate() {
            if which(self.corner.0 + at % self.extent.0, self.corner.1 + at / self.extent.0) {
                *pixel = u8::MAX;
            }
        }
    }

    pub fn view(&self) -> GreyView<'_> {
        GreyView::patch(&self.pixels, self.corner, self.extent, self.size)
    }
}

#[cfg(test)]
mod tests {
    use super::super::GreyImage;
    use super::*;

    #[test]
    fn agrees_with_the_picture_inside_the_box_and_shows_nothing_else() {
        let image = GreyImage { width: 9, height: 7, pixels: (0..63).collect() };
        let whole = GreyView::of(&image);
        let patch = GreyPatch::of(&whole, (6, 2), (20, 4)).expect("inside");
        let view = patch.view();
        for y in -1..8 {
            for x in -1..10 {
                assert_eq!(view.get(x, y), if (6..9).contains(&x) && (2..5).contains(&y) { whole.get(x, y) } else { None }, "{x} {y}");
            }
        }
        assert!(view.contains(6, 2, 8, 4) && !view.contains(5, 2, 8, 4) && !view.contains(6, 2, 8, 5) && view.row(3).is_none());
        let mut whitened = patch.clone();
        whitened.whiten(|x, y| (x, y) == (7, 3));
        assert_eq!([(6, 3), (7, 3), (7, 4)].map(|(x, y)| whitened.view().get(x, y)), [Some(33), Some(255), Some(43)]);
        assert!(GreyPatch::of(&whole, (3, 8), (4, 9)).is_none() && GreyPatch::of(&whole, (3, 3), (2, 4)).is_none());
    }
}
