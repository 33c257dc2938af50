//! A ball that is white to the sensor's limit: its markings and its shading, by which its place and its spin are measured, are cut off there.

use crate::calibration::CameraId;
use crate::footage::{FrameSource, Rows};
use crate::tracking::ball::ball_track::BallFrame;
use crate::tracking::pictures::shot_frames::Shot;

/// Frames that are looked at, spread over those that show the ball.
const LOOKS: usize = 8;
/// Half the side of the square that is looked at, in the ball's radii: it lies within the disc.
const WITHIN: f64 = 0.65;
/// Share of white pixels from which on the measured place and spin suffer.
const TOLD: f64 = 0.1;

impl<S: FrameSource> Shot<'_, S> {
    /// What the user should know of a saturated ball, a note per camera.
    pub(in crate::tracking) fn saturated_ball(&self, ball: &[Option<BallFrame>]) -> Vec<String> {
        let note = |camera: CameraId| {
            let share = self.white_share(ball, camera)?;
            (share > TOLD).then(|| {
                format!(
                    "{} camera: {:.0} % of the ball's pixels are white to the limit (grey 255), so that its markings and shading are cut off; its place and spin are less certain than stated: use less light or a shorter exposure",
                    camera.name(),
                    100.0 * share
                )
            })
        };
        CameraId::BOTH.into_iter().filter_map(note).collect()
    }

    fn white_share(&self, ball: &[Option<BallFrame>], camera: CameraId) -> Option<f64> {
        let seen: Vec<(usize, &BallFrame)> =
            ball.iter().enumerate().filter_map(|(i, b)| Some((i, b.as_ref().filter(|b| b.points[camera.index()].is_some())?))).collect();
        let (mut white, mut all) = (0usize, 0usize);
        for (index, frame) in (0..LOOKS).filter_map(|k| seen.get(k * seen.len() / LOOKS)) {
            let centre = frame.points[camera.index()]?.uv;
            let radius = self.setup.rig.camera(camera).fx * self.setup.ball.radius_m() / (self.view.eye(camera) - frame.position).norm();
            let half = (WITHIN * radius).max(1.0);
            let [from, to] = [(centre.y - half).max(0.0), (centre.y + half).max(0.0)].map(|v| v.round() as usize);
            self.with_buffers(|buffers| {
                let Ok(Some(view)) = self.read_one(*index, camera.index(), Rows::span(from, to + 1 - from), &mut buffers[camera.index()]) else { return };
                for y in from..=to {
                    for x in (centre.x - half).round() as i64..=(centre.x + half).round() as i64 {
                        let Some(grey) = view.get(x, y as i64) else { continue };
                        all += 1;
                        white += usize::from(grey == u8::MAX);
                    }
                }
            });
        }
        (all > 0).then(|| white as f64 / all as f64)
    }
}
