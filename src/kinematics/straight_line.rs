//! A straight line through places in time that a few wrong ones do not turn.

use crate::median::upper_median;
use nalgebra::{Point3, Vector3};

/// A place and a velocity.
pub type Line = (Point3<f64>, Vector3<f64>);

/// Line through points by least absolute deviation in its slope (Theil-Sen), evaluated at `t`: position and velocity.
pub fn straight_line(points: &[(f64, Point3<f64>)], t: f64) -> Line {
    let span = (points.len() / 2).max(1);
    let mut out = (Point3::origin(), Vector3::zeros());
    for k in 0..3 {
        let slopes = points.iter().zip(points.iter().skip(span)).map(|(a, b)| (b.1[k] - a.1[k]) / (b.0 - a.0));
        let slope = upper_median(slopes.filter(|s| s.is_finite())).unwrap_or(0.0);
        out.0[k] = upper_median(points.iter().map(|(at, p)| p[k] + slope * (t - at))).unwrap_or(0.0);
        out.1[k] = slope;
    }
    out
}
