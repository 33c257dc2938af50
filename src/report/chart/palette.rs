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

impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{:02x}{:02x}{:02x}", self.0, self.1, self.2)
    }
}

/// Colours of series in order of use.
pub const SERIES: [Colour; 6] = [Colour::BLUE, Colour::ORANGE, Colour::GREEN, Colour::PINK, Colour::SKY, Colour::AMBER];

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
