//! How long the white tape is along its tube. No file tells: tape is sold in several widths and cut by hand.

use crate::footage::GreyView;
use crate::tracking::racket::racket_scene::{RacketFrame, RacketScene};
use crate::tracking::tape::band::{BandShape, BandView};
use crate::tracking::tape::band_trial::{self, Trial};

/// Half lengths tried, of the one expected; where the longest or the shortest of them says least, lengths around that one, so many times: from
/// 10 to 44 mm of white. Taken for 23 mm, white of 30 mm put markers 0.7 mm off, white of 38 mm 4.6.
const TRIED: [f64; 7] = [0.82, 0.88, 0.94, 1.0, 1.06, 1.12, 1.18];
const FARTHER: usize = 5;
/// Of the one expected, before anything was seen.
const EXPECTED_SD: f64 = 0.1;

/// Half the length of the white that leaves least of a frame's bands unexplained, m; the scene's own where they do not tell.
pub fn white_half_m(scene: &RacketScene, images: &[Option<GreyView>; 2], frame: &RacketFrame) -> f64 {
    let usual = scene.shape.white_half_m;
    let mut about = 1.0;
    for _ in 0..FARTHER {
        let mut trial = Trial::new(TRIED.map(|by| about * by));
        let tried = trial.values;
        let looks = |camera, marker| {
            let band = BandView::at(scene.view, scene.figure, &frame.pose.global_from_racket, camera, marker)?;
            Some(tried.map(|by| (band, BandShape { white_half_m: by * usual, ..*scene.shape })))
        };
        for (_, against) in band_trial::against_in_frame(images, frame, |_| true, looks) {
            trial.add(&against);
        }
        let trial = trial.expecting(1.0, EXPECTED_SD);
        if let Some((by, _)) = trial.least() {
            return by * usual;
        }
        let Some(end) = trial.end() else { break };
        about = end;
    }
    usual
}
