//! A ball, or what is seen beside it, that is white to the sensor's limit: markings, shading and outline, by which place and spin are measured, are
//! cut off there.

use crate::calibration::CameraId;
use crate::footage::{FrameSource, Rows};
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::pictures::shot_frames::Shot;
use std::ops::Range;

/// Frames that are looked at, spread over those that show the ball.
const LOOKS: usize = 8;
/// Pixels so far from the middle, in the ball's radii, lie within the disc, and beside it.
const WITHIN: Range<f64> = 0.0..0.8;
const BESIDE: Range<f64> = 1.2..1.6;
/// Share of white pixels from which on the measured place and spin suffer, of the ball and of what lies beside it.
const TOLD: f64 = 0.1;
const TOLD_BESIDE: f64 = 0.25;

impl<S: FrameSource> Shot<'_, S> {
    /// What the user should know of a saturated ball, notes of either camera.
    pub(in crate::tracking) fn saturated_ball(&self, ball: &[Option<BallFrame>]) -> Vec<String> {
        let note = |camera: CameraId, (where_it_is, told, what, cut_off): (Range<f64>, f64, &str, &str)| {
            let share = self.white_share(ball, camera, &where_it_is)?;
            (share > told).then(|| {
                format!(
                    "{} camera: {:.0} % of {what} white to the limit (grey 255), so that {cut_off} cut off; its place and spin are less certain than stated: use less light or a shorter exposure",
                    camera.name(),
                    100.0 * share
                )
            })
        };
        let of = |camera: CameraId| {
            let looks = [
                (WITHIN, TOLD, "the ball's pixels are", "its markings and shading are"),
                (BESIDE, TOLD_BESIDE, "what is seen beside the ball is", "its outline is"),
            ];
            looks.into_iter().filter_map(move |look| note(camera, look))
        };
        CameraId::BOTH.into_iter().flat_map(of).collect()
    }

    fn white_share(&self, ball: &[Option<BallFrame>], camera: CameraId, radii: &Range<f64>) -> Option<f64> {
        let seen: Vec<(usize, &BallFrame)> =
            ball.iter().enumerate().filter_map(|(i, b)| Some((i, b.as_ref().filter(|b| b.points[camera.index()].is_some())?))).collect();
        let (mut white, mut all) = (0usize, 0usize);
        for (index, frame) in (0..LOOKS).filter_map(|k| seen.get(k * seen.len() / LOOKS)) {
            let centre = frame.points[camera.index()]?.uv;
            let radius = self.setup.rig.camera(camera).fx * self.setup.ball.radius_m() / (self.view.eye(camera) - frame.position).norm();
            let half = (radii.end * radius).max(1.0);
            let [from, to] = [(centre.y - half).max(0.0), (centre.y + half).max(0.0)].map(|v| v.round() as usize);
            self.with_buffers(|buffers| {
                let Ok(Some(view)) = self.read_one(*index, camera.index(), Rows::span(from, to + 1 - from), &mut buffers[camera.index()]) else { return };
                for y in from..=to {
                    for x in (centre.x - half).round() as i64..=(centre.x + half).round() as i64 {
                        let far = (x as f64 - centre.x).hypot(y as f64 - centre.y) / radius;
                        let Some(grey) = view.get(x, y as i64).filter(|_| radii.contains(&far)) else { continue };
                        all += 1;
                        white += usize::from(grey == u8::MAX);
                    }
                }
            });
        }
        (all > 0).then(|| white as f64 / all as f64)
    }
}
