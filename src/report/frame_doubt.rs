//! Which frames around an impact deserve a look, from the tracks alone.

use crate::calibration::CameraId;
use crate::median::upper_median;
use crate::tracking::{PointState, SpacePoint, Target, Tracks};

/// Frames looked at on either side of the impact.
const AROUND: u64 = 15;
/// Frames of doubt taken per shot, beside the impact itself.
const TAKEN: usize = 3;
/// A residual or deviation this many times its usual size is worth words.
const WORTH_WORDS: f64 = 3.0;
/// A residual below this is no doubt whatever is usual, px.
const FINE_PX: f64 = 0.15;

/// A frame of one camera with the reason to look at it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Doubt {
    pub frame: u64,
    pub camera: CameraId,
    /// 0: the impact, shown for reference; above: how many times the usual, hidden points counting one each.
    pub score: f64,
    pub words: String,
}

/// Both cameras at the impact, then the most doubtful frames near it, worst first.
pub(super) fn frames_of_doubt(tracks: &Tracks, points: &[SpacePoint]) -> Vec<Doubt> {
    let Some(impact) = impact_frame(tracks, points) else {
        return Vec::new();
    };
    let near = |frame: u64| frame.abs_diff(impact) <= AROUND;
    let mut found: Vec<Doubt> = Vec::new();
    for frame in tracks.frames().into_iter().filter(|f| near(*f)) {
        for camera in CameraId::BOTH {
            found.extend(doubt(tracks, points, frame, camera, impact));
        }
    }
    found.sort_by(|a, b| b.score.total_cmp(&a.score).then_with(|| (a.frame, a.camera).cmp(&(b.frame, b.camera))));
    // Neighbouring frames show the same trouble: one of each run is enough.
    let mut taken: Vec<Doubt> = Vec::new();
    for d in found {
        if taken.len() < TAKEN && taken.iter().all(|t| t.camera != d.camera || t.frame.abs_diff(d.frame) > 3) {
            taken.push(d);
        }
    }
    let reference = CameraId::BOTH.map(|camera| Doubt { frame: impact, camera, score: 0.0, words: "the impact".to_owned() });
    taken.extend(reference);
    taken
}

/// Frame at t = 0 of the reconstructed points, else the middle of the tracks.
pub(super) fn impact_frame(tracks: &Tracks, points: &[SpacePoint]) -> Option<u64> {
    let nearest = points.iter().filter(|p| p.t.is_finite()).min_by(|a, b| a.t.abs().total_cmp(&b.t.abs()));
    let frames = tracks.frames();
    nearest.map(|p| p.frame).or_else(|| frames.get(frames.len() / 2).copied())
}

fn doubt(tracks: &Tracks, points: &[SpacePoint], frame: u64, camera: CameraId, impact: u64) -> Option<Doubt> {
    let (mut score, mut words) = (0.0f64, Vec::new());
    let hidden: Vec<&str> =
        tracks.points.iter().filter(|p| p.frame == frame && p.camera == camera && p.state == PointState::Occluded).map(|p| p.target.name()).collect();
    if !hidden.is_empty() {
        score += hidden.len() as f64;
        words.push(format!("{} not seen", hidden.join(", ")));
    }
    for target in Target::ALL {
        let residuals: Vec<f64> = points.iter().filter(|p| p.target == target).map(|p| p.residual_px).collect();
        if let Some(p) = points.iter().find(|p| p.frame == frame && p.target == target) {
            let times = p.residual_px / median(residuals).max(FINE_PX);
            if times > WORTH_WORDS {
                score += times;
                words.push(format!("{}: the two views differ by {:.2} px", target.name(), p.residual_px));
            }
        }
        let sds: Vec<f64> = tracks.points.iter().filter(|p| p.camera == camera && p.target == target).filter_map(|p| p.point.map(|i| i.sd.norm())).collect();
        if let Some(own) = tracks.get(frame, camera, target) {
            let times = own.sd.norm() / median(sds).max(1e-3);
            if times > WORTH_WORDS {
                score += 0.5 * times;
                words.push(format!("{}: uncertain by {:.2} px", target.name(), own.sd.norm()));
            }
        }
    }
    // Nearer the impact it matters more.
    let weight = 1.0 / (1.0 + frame.abs_diff(impact) as f64 / AROUND as f64);
    (score > 0.0).then(|| Doubt { frame, camera, score: score * weight, words: words.join("; ") })
}

fn median(values: Vec<f64>) -> f64 {
    upper_median(values.into_iter().filter(|v| v.is_finite())).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::{ImagePoint, TrackPoint};
    use nalgebra::{Point3, Vector2, Vector3};

    #[test]
    fn truth_the_frame_with_the_large_residual_comes_first() {
        let mut tracks = Tracks::default();
        let mut points = Vec::new();
        for frame in 0..21u64 {
            for camera in CameraId::BOTH {
                let point = Some(ImagePoint { uv: Vector2::new(1.0, 2.0), sd: Vector2::new(0.05, 0.05) });
                tracks.points.push(TrackPoint { frame, camera, target: Target::Ball, point, state: PointState::Measured });
            }
            let residual_px = if frame == 7 { 2.0 } else { 0.1 };
            let t = (frame as f64 - 10.0) * 1e-3;
            points.push(SpacePoint { frame, t, target: Target::Ball, position: Point3::origin(), sd: Vector3::zeros(), residual_px });
        }
        let doubts = frames_of_doubt(&tracks, &points);
        assert_eq!((doubts[0].frame, doubts[1].frame), (7, 7));
        assert!(doubts[0].words.contains("ball: the two views differ by 2.00 px"));
        assert_eq!(doubts.iter().filter(|d| d.frame == 10).count(), 2);
        assert!(frames_of_doubt(&Tracks::default(), &[]).is_empty());
    }
}
