//! Charts as SVG text: a small library of the figures this field uses.
//!
//! A [`Chart`] has two axes with units and any number of layers ([`Points`], [`Line`], [`Band`], [`Bars`], [`Cells`],
//! [`Arrows`], [`Shape`], [`Rule`]), drawn in the order they were added. [`face`] draws the racket's face,
//! [`Scene`] a room in a fixed oblique view. Every figure is complete by itself: it may stand in a page or in a file of
//! its own; its ink is `currentColor`, so it follows the page's light or dark theme. Coordinates are rounded to a tenth
//! of a pixel; same input, same bytes. Values that are not finite are left out.
//!
//! ```
//! use sweetspot::report::chart::{Chart, Points};
//! let svg = Chart::new("Ball speed")
//!     .x("measured", "m/s")
//!     .y("predicted", "m/s")
//!     .identity_line()
//!     .add(Points::new(&[(30.1, 29.8), (33.0, 33.4)]).y_error(&[0.2, 0.3]))
//!     .to_svg();
//! assert!(svg.starts_with("<svg"));
//! ```

mod axis;
mod draw;
pub mod face;
mod histogram;
mod layer;
mod palette;
mod plot;
mod scene;
mod svg;

pub use histogram::{bin_edges, histogram};
pub use layer::{Arrows, Band, Bars, Cells, Layer, Line, Picture, Points, Rule, Shape, Symbol};
pub(in crate::report) use palette::dark_style;
pub use palette::{Colour, diverging, sequential};
pub use plot::{Chart, Legend};
pub use scene::Scene;
pub(in crate::report) use svg::OWN_STYLE;
