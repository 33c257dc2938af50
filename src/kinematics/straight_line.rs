//! A straight line through places in time that a few wrong ones do not turn.

use nalgebra::{Point3, Vector3};

/// A place and a velocity.
pub type Line = (Point3<f64>, Vector3<f64>);

/// Line through points by least absolute deviation in its slope (Theil-Sen), evaluated at `t`: position and velocity.
pub fn straight_line(points: &[(f64, Point3<f64>)], t: f64) -> Line {
    let span = (points.len() / 2).max(1);
    let mut out = (Point3::origin(), Vector3::zeros());
    for k in 0..3 {
        let mut slopes: Vec<f64> =
            (0..points.len() - span).map(|i| (points[i + span].1[k] - points[i].1[k]) / (points[i + span].0 - points[i].0)).filter(|s| s.is_finite()).collect();
        slopes.sort_by(f64::total_cmp);
        let slope = slopes.get(slopes.len() / 2).copied().unwrap_or(0.0);
        let mut offsets: Vec<f64> = points.iter().map(|(at, p)| p[k] + slope * (t - at)).collect();
        offsets.sort_by(f64::total_cmp);
        out.0[k] = offsets.get(offsets.len() / 2).copied().unwrap_or(0.0);
        out.1[k] = slope;
    }
    out
}
