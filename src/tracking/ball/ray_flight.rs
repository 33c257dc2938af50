//! A straight flight from image points of either camera, in no matter which frames, and a place it comes from.
//!
//! Seen from one camera, a dozen metres away, a flight is known across the line of sight; its depth and how that changes are all but free, and
//! are taken from the origin and the steepness of perspective. Points of the other camera decide them to a millimetre.

use crate::calibration::CameraId;
use crate::tracking::racket::racket_pose::View;
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Point3, Vector2, Vector6};

/// What an outline measured without the ball's light is good to, px.
const RAY_SD_PX: f64 = 0.5;
/// What is known of the ball's velocity beforehand, one deviation of each component, m/s: perspective alone says little about its approach.
const SPEED_SD_M_S: f64 = 40.0;
/// Tukey's limit, deviations.
const TUKEY: f64 = 5.0;
const ROUNDS: usize = 5;

/// The ball's centre in one picture.
#[derive(Debug, Clone, Copy)]
pub struct RayPoint {
    /// Of the frame in the clip.
    pub index: usize,
    /// Frame number.
    pub number: f64,
    pub camera: CameraId,
    pub uv: Vector2<f64>,
}

/// Where the ball was about then.
#[derive(Debug, Clone, Copy)]
pub struct Origin {
    pub number: f64,
    pub place: Point3<f64>,
    /// m, each axis.
    pub sd_m: f64,
    pub frame_rate_hz: f64,
}

/// Place (global, m) at the origin's frame and step (m per frame).
#[derive(Debug, Clone, Copy)]
pub struct RayFlight {
    number: f64,
    state: Vector6<f64>,
}

impl RayFlight {
    /// The flight nearest to the rays, points that disagree left out by Tukey's weights; `None` where it is undetermined.
    pub fn fit(view: &View, points: &[RayPoint], origin: &Origin) -> Option<RayFlight> {
        let mut state = Vector6::zeros();
        state.fixed_rows_mut::<3>(0).copy_from(&origin.place.coords);
        let per_step = (origin.frame_rate_hz / SPEED_SD_M_S).powi(2);
        for round in 0..ROUNDS {
            let (mut h, mut g) = (Matrix6::zeros(), Vector6::zeros());
            for axis in 0..3 {
                h[(axis, axis)] += origin.sd_m.powi(-2);
                g[axis] += origin.sd_m.powi(-2) * (origin.place[axis] - state[axis]);
                h[(axis + 3, axis + 3)] += per_step;
                g[axis + 3] -= per_step * state[axis + 3];
            }
            for p in points {
                let ray = view.ray(p.camera, p.uv)?;
                let eye = view.eye(p.camera);
                let row = row(p.number - origin.number);
                let from_eye = row * state - eye.coords;
                // What lies across the ray, in px at the ball's distance.
                let across = Matrix3::identity() - ray * ray.transpose();
                let scale = view.rig.camera(p.camera).fx / from_eye.norm().max(1e-3) / RAY_SD_PX;
                let off = across * from_eye;
                let size = off.norm() * scale / TUKEY;
                // The first rounds find where the flight is at all.
                let weight = if round < 2 { 1.0 } else { (1.0 - size.min(1.0).powi(2)).powi(2) } * scale.powi(2);
                h += row.transpose() * across * row * weight;
                g -= row.transpose() * off * weight;
            }
            state += h.cholesky()?.solve(&g);
        }
        (state.iter().all(|v| v.is_finite())).then_some(RayFlight { number: origin.number, state })
    }

    /// Global, m.
    pub fn at(&self, number: f64) -> Point3<f64> {
        Point3::from(row(number - self.number) * self.state)
    }

    /// Length of the step, m per frame.
    pub fn step_m(&self) -> f64 {
        self.state.fixed_rows::<3>(3).norm()
    }
}

/// Place so many frames after the origin, from the state.
fn row(frames: f64) -> Matrix3x6<f64> {
    let mut row = Matrix3x6::zeros();
    row.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
    row.fixed_view_mut::<3, 3>(0, 3).copy_from(&(Matrix3::identity() * frames));
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_pose::tests::rig;
    use nalgebra::Vector3;

    fn point(view: &View, camera: CameraId, k: usize, at: Point3<f64>) -> RayPoint {
        RayPoint { index: k, number: k as f64, camera, uv: view.project(camera, &at).expect("seen") }
    }

    #[test]
    fn truth_one_camera_and_the_origin_give_a_flight_and_two_more_points_its_depth() {
        let rig = rig();
        let view = View::new(&rig);
        let flight = |k: f64| Point3::new(0.02 + 0.021 * k, 1.05 + 0.003 * k, 0.1 - 0.024 * k);
        let mut points: Vec<RayPoint> = (4..20).map(|k| point(&view, CameraId::Left, k, flight(k as f64))).collect();
        // Another thing in one of the pictures.
        points[7].uv += Vector2::new(40.0, -10.0);
        let origin = Origin { number: 0.0, place: flight(0.0) + Vector3::new(0.03, -0.01, 0.02), sd_m: 0.04, frame_rate_hz: 1000.0 };
        let px = |camera, f: &RayFlight| (view.project(camera, &f.at(15.0)).expect("seen") - view.project(camera, &flight(15.0)).expect("seen")).norm();
        let found = RayFlight::fit(&view, &points, &origin).expect("a flight");
        assert!(px(CameraId::Left, &found) < 0.1 && (found.at(0.0) - flight(0.0)).norm() < 0.1, "{} {}", px(CameraId::Left, &found), found.at(0.0));
        // In that camera's picture other depths look the same, in the other one they do not.
        let elsewhere = Origin { place: origin.place + view.ray(CameraId::Left, Vector2::new(256.0, 256.0)).expect("a ray") * 0.05, ..origin };
        let farther = RayFlight::fit(&view, &points, &elsewhere).expect("a flight");
        assert!(
            px(CameraId::Left, &farther) < 0.1 && px(CameraId::Right, &farther) > 2.0,
            "{} {}",
            px(CameraId::Left, &farther),
            px(CameraId::Right, &farther)
        );
        points.extend([6, 18].map(|k| point(&view, CameraId::Right, k, flight(k as f64))));
        let found = RayFlight::fit(&view, &points, &origin).expect("a flight");
        assert!((found.at(12.0) - flight(12.0)).norm() < 5e-4, "{}", found.at(12.0) - flight(12.0));
        assert!((found.step_m() - 0.032).abs() < 1e-3);
    }
}
