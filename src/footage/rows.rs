//! Which rows of a picture are needed.

/// Most spans; more are taken as one.
const MOST: usize = 8;
/// Rows between two spans that are cheaper to read than to leave out.
const NEAR: usize = 6;

/// All rows of a picture, or a few spans of them from the top down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rows {
    /// First row and the one after the last.
    spans: [(usize, usize); MOST],
    count: usize,
}

impl Rows {
    pub const ALL: Rows = Rows { spans: [(0, usize::MAX); MOST], count: 1 };

    /// `count` rows from `first` on.
    pub fn span(first: usize, count: usize) -> Self {
        Rows { spans: [(first, first.saturating_add(count)); MOST], count: 1 }
    }

    /// Several spans (first row, the one after the last) in any order; those near each other become one.
    pub fn of(spans: impl IntoIterator<Item = (usize, usize)>) -> Self {
        let mut sorted: Vec<(usize, usize)> = spans.into_iter().collect();
        sorted.sort_unstable();
        let mut rows = Rows { spans: [(0, 0); MOST], count: 0 };
        for (first, end) in sorted {
            let last = rows.count.saturating_sub(1);
            if rows.count > 0 && (first <= rows.spans[last].1 + NEAR || rows.count == MOST) {
                rows.spans[last].1 = rows.spans[last].1.max(end);
            } else {
                rows.spans[rows.count] = (first, end);
                rows.count += 1;
            }
        }
        rows
    }

    /// The spans within a picture so many rows high: first row and the one after the last, none empty.
    pub fn within(&self, height: usize) -> impl Iterator<Item = (usize, usize)> + Clone {
        self.spans.into_iter().take(self.count).map(move |(first, end)| (first, end.min(height))).filter(|(first, end)| first < end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_spans_are_sorted_joined_and_cut_to_the_picture() {
        let rows = Rows::of([(40, 50), (3, 9), (12, 20), (90, 140), (45, 52)]);
        assert_eq!(rows.within(100).collect::<Vec<_>>(), [(3, 20), (40, 52), (90, 100)]);
        assert_eq!(rows.within(30).collect::<Vec<_>>(), [(3, 20)]);
        assert_eq!(Rows::ALL.within(7).collect::<Vec<_>>(), [(0, 7)]);
        assert_eq!(Rows::span(5, 9).within(7).collect::<Vec<_>>(), [(5, 7)]);
        let many = Rows::of((0..20).map(|k| (20 * k, 20 * k + 2)));
        assert_eq!(many.within(1000).collect::<Vec<_>>().last(), Some(&(140, 382)));
    }
}
