//! `report`: results as one self-contained HTML page, with the pictures a scientist would put in a paper.
//!
//! Comes in: plain results of the other rooms. Goes out: the page as a `String` (inline SVG and CSS, no network, no
//! script). [`chart`] draws; [`sections`] says what is drawn, one file per section, each a pure function that returns
//! `None` when it has no data; `page` puts sections together. Text that a user wrote is escaped on the way in.

pub mod chart;
mod frame_doubt;
mod frame_rate;
mod markup;
mod model_reports;
mod page;
mod parameter_unit;
mod results_file;
pub mod sections;
mod session_report;
mod session_results;

pub use frame_rate::frame_rate_page;
pub use model_reports::{comparison_report, diagnosis_report};
pub use page::{Layout, Report, Section, Table, Tone};
pub use results_file::read_session_results;
pub use sections::{HistogramBin, SeasonFigure, histograms_to_csv, season_figures};
pub use session_report::session_report;
pub use session_results::{FramePicture, PredictedShot, SessionResults, ShotResults};
