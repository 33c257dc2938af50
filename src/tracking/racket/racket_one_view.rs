//! Finds the racket in one camera's picture, where the other does not show it: all five markers, about as far away as it was.
//!
//! From a dozen metres away three markers are seen as from infinity: their picture, whose scale the distance gives, is that of a triangle
//! tilted one way or the other, and both are tried (Huttenlocher and Ullman 1990, "Recognizing solid objects by alignment with an image").

use crate::calibration::CameraId;
use crate::tracking::racket::foretold_pose::Foretold;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{MarkerObservation, View, fit_pose_near};
use crate::tracking::racket::racket_search::Reach;
use crate::tracking::racket::rigid_points::Triangle;
use crate::tracking::tape::band_search::BandCandidate;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Isometry3, Point3, Vector2};

/// Candidates that are tried, strongest first: the tape is among them, or it is not believed.
const STRONGEST: usize = 16;
/// The distance may be wrong by this share: a third of a metre, and a pixel of the racket's size.
const DISTANCE_SHARE: f64 = 0.05;
/// A candidate belongs to a marker of a rough pose within this, px.
const GATE_PX: f64 = 4.0;
/// A candidate's place is good to this, px.
const CANDIDATE_SD_PX: f64 = 0.7;
/// Markers that must be near to candidates.
pub const FEWEST: usize = 4;
/// Poses that are handed on: those whose markers are nearest to candidates.
const MOST_POSES: usize = 12;
/// How far off a pose may be that three markers seen as from infinity tell, rad and m.
const OFF: (f64, f64) = (0.1, 0.1);
/// Poses as near to each other are one, m and rad.
const SAME: (f64, f64) = (0.05, 0.15);

/// Poses within reach that put at least four of the five markers on candidates of one camera's picture, best first. Candidates come strongest first.
pub fn search(view: &View, figure: &RacketFigure, camera: CameraId, candidates: &[BandCandidate], reach: &Reach) -> Vec<Isometry3<f64>> {
    let eye = view.eye(camera);
    let away = reach.centre() - eye;
    let (distance, axis) = (away.norm(), away.normalize());
    // The candidates' places at the racket's distance.
    let strongest = candidates.iter().take(STRONGEST);
    let places: Vec<(&BandCandidate, Point3<f64>)> =
        strongest.filter_map(|c| view.ray(camera, c.uv).map(|ray| (c, eye + ray * (distance / ray.dot(&axis))))).collect();
    let mut found: Vec<(f64, Isometry3<f64>, Vec<MarkerObservation>)> = Vec::new();
    let triples = (0..5).flat_map(|i| (i + 1..5).flat_map(move |j| (j + 1..5).map(move |k| [i, j, k])));
    for markers in triples {
        let local = markers.map(|m| &figure.points[m]);
        let Some(triangle) = Triangle::of(local) else { continue };
        let (a, b) = (local[1] - local[0], local[2] - local[0]);
        for (p, first) in &places {
            for (q, second) in places.iter().filter(|(q, _)| q.uv != p.uv) {
                for (_, third) in places.iter().filter(|(r, _)| r.uv != p.uv && r.uv != q.uv) {
                    let (u, v) = (second - first, third - first);
                    for (scale, [g, h]) in tilted([a.norm_squared(), b.norm_squared(), a.dot(&b)], [u.norm_squared(), v.norm_squared(), u.dot(&v)]) {
                        let beyond = |place: &Point3<f64>, by: f64| eye + (place - eye) * (scale + by / distance);
                        let corners = [beyond(first, 0.0), beyond(second, g), beyond(third, h)];
                        let Some(there) = Triangle::of(corners.each_ref()) else { continue };
                        let pose = triangle.onto(&there);
                        if reach.turns_to(&pose.rotation)
                            && let Some((miss, seen)) = agreeing(view, figure, camera, &pose, &places)
                        {
                            found.push((miss, pose, seen));
                        }
                    }
                }
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut distinct: Vec<(Isometry3<f64>, Vec<MarkerObservation>)> = Vec::new();
    for (_, pose, seen) in found {
        let same = |q: &Isometry3<f64>| (q.translation.vector - pose.translation.vector).norm() < SAME.0 && q.rotation.angle_to(&pose.rotation) < SAME.1;
        if distinct.len() < MOST_POSES && !distinct.iter().any(|(q, _)| same(q)) {
            distinct.push((pose, seen));
        }
    }
    // Seen as from infinity a marker is off by up to 3 px. Four of them alone would tell tilt and distance worse than that.
    let near = |pose| Foretold::within(pose, OFF.0, OFF.1);
    distinct.into_iter().map(|(pose, seen)| fit_pose_near(view, figure, &seen, &near(pose)).map_or(pose, |fit| fit.global_from_racket)).collect()
}

/// The two ways in which two sides of a triangle (squared lengths and product) are seen as these: by how much the picture must be scaled, and how far
/// the sides' ends lie behind their beginning. None where the scale is not about one.
fn tilted([aa, bb, ab]: [f64; 3], [uu, vv, uv]: [f64; 3]) -> impl Iterator<Item = (f64, [f64; 2])> {
    // (aa - s uu)(bb - s vv) = (ab - s uv)² in the squared scale; both factors are depths squared at the smaller root.
    let (q, p, r) = (uu * vv - uv * uv, aa * vv + bb * uu - 2.0 * ab * uv, aa * bb - ab * ab);
    let root = (p * p - 4.0 * q * r).max(0.0).sqrt();
    let squared = if p + root > 0.0 { 2.0 * r / (p + root) } else { f64::NAN };
    let scale = squared.sqrt();
    let (g, h) = ((aa - squared * uu).max(0.0).sqrt(), (bb - squared * vv).max(0.0).sqrt());
    let h = if ab - squared * uv < 0.0 { -h } else { h };
    let possible = (scale - 1.0).abs() < DISTANCE_SHARE;
    [(scale, [g, h]), (scale, [-g, -h])].into_iter().filter(move |_| possible)
}

/// The markers that have candidates near them, and how well these agree with a pose: the sum of their distances, px, and two gates more for one that has
/// none; `None` where two have none.
fn agreeing(
    view: &View,
    figure: &RacketFigure,
    camera: CameraId,
    pose: &Isometry3<f64>,
    places: &[(&BandCandidate, Point3<f64>)],
) -> Option<(f64, Vec<MarkerObservation>)> {
    let mut used = Vec::with_capacity(5);
    let mut seen = Vec::with_capacity(5);
    let mut sum = 0.0;
    for marker in 0..5 {
        let at = view.patch(camera, figure, marker, pose)?;
        let free = places.iter().enumerate().filter(|(k, _)| !used.contains(k)).map(|(k, (c, _))| ((c.uv - at).norm(), k));
        match free.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|near| near.0 < GATE_PX) {
            Some((miss, k)) => {
                used.push(k);
                seen.push(MarkerObservation { camera, marker, point: ImagePoint { uv: places[k].0.uv, sd: Vector2::repeat(CANDIDATE_SD_PX) } });
                sum += miss;
            }
            None => sum += 2.0 * GATE_PX,
        }
    }
    (seen.len() >= FEWEST).then_some((sum, seen))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::tests::rig;
    use nalgebra::{Translation3, UnitQuaternion};

    #[test]
    fn truth_a_racket_is_found_in_one_picture_among_other_things() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let turned = UnitQuaternion::from_euler_angles(0.3, 0.4, -0.5);
        let here = Isometry3::from_parts(Translation3::new(0.0, 0.9, -0.1), turned);
        let last = Isometry3::from_parts(Translation3::new(0.1, 0.85, -0.15), turned * UnitQuaternion::from_euler_angles(0.3, -0.2, 0.2));
        let reach = Reach::of(&figure, &last, 0.004);
        for camera in CameraId::BOTH {
            let uv = |marker: usize| view.patch(camera, &figure, marker, &here).expect("seen");
            let middle = uv(0);
            let other = |k: usize| middle + Vector2::new(((k * 37) % 90) as f64 - 45.0, ((k * 53) % 80) as f64 - 40.0);
            let mut seen: Vec<BandCandidate> = (0..5).map(|m| BandCandidate { uv: uv(m), contrast: 90.0 }).collect();
            seen.extend((0..6).map(|k| BandCandidate { uv: other(k), contrast: 50.0 }));
            let found = search(&view, &figure, camera, &seen, &reach);
            // How far away it is one camera hardly tells: the markers' places in its picture, and how the racket is turned, it does.
            let miss_px = |pose: &Isometry3<f64>| (0..5).map(|m| (view.patch(camera, &figure, m, pose).expect("seen") - uv(m)).norm()).fold(0.0, f64::max);
            let right = |pose: &&Isometry3<f64>| miss_px(pose) < 1.0 && pose.rotation.angle_to(&here.rotation) < 0.3;
            assert!(found.iter().any(|pose| right(&pose)), "{camera:?}: {:?}", found.iter().map(miss_px).collect::<Vec<_>>());
            // Three markers fit anywhere.
            assert!(search(&view, &figure, camera, &seen[..3], &reach).is_empty());
        }
    }
}
