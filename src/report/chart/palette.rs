//! Colours that people with any colour vision can tell apart, on light and on dark paper.
//!
//! Series: Okabe and Ito, "Color Universal Design" (2008), without yellow (too pale on white) and black (invisible on
//! dark). Sequential: anchors along cividis (Nuñez, Anderton, Renslow, PLoS ONE 2018); diverging: blue to orange through
//! near-white, so that zero is pale and sign is hue.

use std::fmt;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

impl Colour {
    pub const BLUE: Colour = Colour(0x00, 0x72, 0xb2);
    pub const ORANGE: Colour = Colour(0xd5, 0x5e, 0x00);
    pub const GREEN: Colour = Colour(0x00, 0x9e, 0x73);
    pub const PINK: Colour = Colour(0xcc, 0x79, 0xa7);
    pub const SKY: Colour = Colour(0x56, 0xb4, 0xe9);
    pub const AMBER: Colour = Colour(0xe6, 0x9f, 0x00);
    pub const GREY: Colour = Colour(0x80, 0x80, 0x80);
}

impl Colour {
    /// Whether white letters read better on it than black ones (perceived brightness after Rec. 601, halfway).
    pub(super) fn is_dark(self) -> bool {
        0.299 * f64::from(self.0) + 0.587 * f64::from(self.1) + 0.114 * f64::from(self.2) < 128.0
    }
}

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }
}

/// What each colour becomes on dark paper: the same hue, light enough to be seen there (4.5 : 1 and more against the page).
const ON_DARK: [(Colour, Colour); 7] = [
    (Colour::BLUE, Colour(0x4c, 0x9f, 0xe6)),
    (Colour::ORANGE, Colour(0xe8, 0x70, 0x2a)),
    (Colour::GREEN, Colour(0x2f, 0xbf, 0x94)),
    (Colour::PINK, Colour(0xe3, 0x9b, 0xc4)),
    (Colour::SKY, Colour(0xa8, 0xdc, 0xff)),
    (Colour::AMBER, Colour(0xf5, 0xc2, 0x42)),
    (Colour::GREY, Colour(0xc0, 0xc6, 0xcd)),
];

/// Rules that give figures inside a page their colours for dark paper. A figure's own attributes are those for light
/// paper, which is what it shows in a file of its own; a page's rules go before attributes. Print is light.
pub(in crate::report) fn dark_style() -> String {
    let rules: String =
        ON_DARK.iter().map(|(light, dark)| format!("svg [stroke=\"{light}\"] {{ stroke: {dark}; }} svg [fill=\"{light}\"] {{ fill: {dark}; }}\n")).collect();
    format!("@media screen and (prefers-color-scheme: dark) {{\n{rules}}}\n")
}

/// Colours of series in order of use.
const SERIES: [Colour; 6] = [Colour::BLUE, Colour::ORANGE, Colour::GREEN, Colour::PINK, Colour::SKY, Colour::AMBER];

impl Colour {
    /// Of the `k`-th series.
    pub fn of_series(k: usize) -> Colour {
        SERIES[k % SERIES.len()]
    }
}

const SEQUENTIAL: [[f64; 3]; 6] =
    [[0.0, 32.0, 77.0], [60.0, 77.0, 110.0], [108.0, 110.0, 114.0], [153.0, 144.0, 115.0], [203.0, 184.0, 95.0], [253.0, 231.0, 55.0]];
const DIVERGING: [[f64; 3]; 7] =
    [[8.0, 64.0, 129.0], [56.0, 133.0, 188.0], [158.0, 202.0, 225.0], [244.0, 244.0, 240.0], [253.0, 190.0, 120.0], [224.0, 110.0, 20.0], [140.0, 52.0, 4.0]];

/// Colour for a share from 0 (dark) to 1 (bright).
pub fn sequential(share: f64) -> Colour {
    between(&SEQUENTIAL, share)
}

/// Colour for a signed share from -1 (blue) through 0 (pale) to 1 (orange).
pub fn diverging(share: f64) -> Colour {
    between(&DIVERGING, 0.5 * (share + 1.0))
}

fn between(anchors: &[[f64; 3]], share: f64) -> Colour {
    let place = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.5 } * (anchors.len() - 1) as f64;
    let left = (place.floor() as usize).min(anchors.len() - 2);
    let mix = |k: usize| {
        let (a, b) = (anchors[left][k], anchors[left + 1][k]);
        (a + (b - a) * (place - left as f64)).round() as u8
    };
    Colour(mix(0), mix(1), mix(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contrast of two colours (WCAG 2.1: relative luminances, 0.05 of flare).
    fn contrast(a: Colour, b: Colour) -> f64 {
        let linear = |v: u8| {
            let s = f64::from(v) / 255.0;
            if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
        };
        let luminance = |c: Colour| 0.2126 * linear(c.0) + 0.7152 * linear(c.1) + 0.0722 * linear(c.2);
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn truth_black_on_white_has_the_greatest_contrast() {
        assert!((contrast(Colour(0, 0, 0), Colour(255, 255, 255)) - 21.0).abs() < 1e-9);
    }

    #[test]
    fn law_every_series_is_seen_on_dark_paper() {
        let style = dark_style();
        assert!(style.contains("screen and (prefers-color-scheme: dark)"), "print stays light");
        for colour in SERIES.into_iter().chain([Colour::GREY]) {
            let Some((_, dark)) = ON_DARK.iter().find(|(light, _)| *light == colour) else { panic!("{colour} has no tone for dark paper") };
            // The page's dark paper, as page.css has it.
            let seen = contrast(*dark, Colour(0x14, 0x18, 0x1d));
            assert!(seen >= 4.5, "{colour} becomes {dark}: {seen:.1} : 1");
            assert!(style.contains(&format!("[stroke=\"{colour}\"] {{ stroke: {dark}; }}")) && style.contains(&format!("[fill=\"{colour}\"]")));
        }
    }
}
