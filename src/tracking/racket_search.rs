//! Finds the racket in one pair of pictures without knowing anything but its figure.
//!
//! Tape-like places of both pictures are paired along epipolar lines; triples of the resulting space points whose
//! distances are those of three markers give a pose each; the pose that explains most tape in both pictures wins. A
//! racket's usual figure equals itself turned by half a turn about its long axis, so the answer may have m2 and m3
//! (and m4 and m5) exchanged: [`super::face`] decides that once for the whole shot.

use super::band::BandView;
use super::band_search::BandCandidate;
use super::racket_figure::RacketFigure;
use super::racket_pose::{MarkerObservation, RacketPose, View, fit_pose_in, rigid_from_points};
use super::track_file::ImagePoint;
use crate::calibration::CameraId;
use nalgebra::{Isometry3, Point3, Vector2};

/// Two rays of one marker may miss each other by this, m: two pixels at 12 m, and the two cameras see different sides of
/// the tube.
const RAY_GAP_M: f64 = 0.014;
/// Distances between triangulated markers may be wrong by this, m (a candidate is good to about a pixel, depth to three).
const DISTANCE_TOLERANCE_M: f64 = 0.020;
/// A candidate belongs to a marker of a rough pose within this, px.
const GATE_PX: f64 = 6.0;
/// Least number of image points that must agree before a racket is believed: three markers seen by both cameras.
const LEAST_POINTS: usize = 6;
/// Most hypotheses followed up.
const FOLLOWED: usize = 12;

/// The racket's pose, or `None` when the pictures hold no figure like it.
pub fn search(view: &View, figure: &RacketFigure, candidates: &[Vec<BandCandidate>; 2]) -> Option<RacketPose> {
    let points = space_candidates(view, candidates);
    let mut hypotheses: Vec<(usize, f64, Isometry3<f64>)> = Vec::new();
    // Markers 2-3 or 1-4, ... : each pair of markers may be the one that is seen well.
    for i in 0..5 {
        for j in i + 1..5 {
            for (a, pa) in points.iter().enumerate() {
                for (b, pb) in points.iter().enumerate() {
                    if a == b || ((pa - pb).norm() - figure.distance_m(i, j)).abs() > DISTANCE_TOLERANCE_M {
                        continue;
                    }
                    for k in j + 1..5 {
                        for (c, pc) in points.iter().enumerate() {
                            let fits = c != a
                                && c != b
                                && ((pa - pc).norm() - figure.distance_m(i, k)).abs() < DISTANCE_TOLERANCE_M
                                && ((pb - pc).norm() - figure.distance_m(j, k)).abs() < DISTANCE_TOLERANCE_M;
                            if !fits {
                                continue;
                            }
                            let local = [figure.points[i], figure.points[j], figure.points[k]];
                            if let Some(pose) = rigid_from_points(&local, &[*pa, *pb, *pc]) {
                                let seen = associate(view, figure, &pose, candidates, GATE_PX);
                                let miss: f64 = seen.iter().map(|(_, miss, _)| miss).sum();
                                if seen.len() >= LEAST_POINTS {
                                    hypotheses.push((seen.len(), miss / seen.len() as f64, pose));
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    hypotheses.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)));
    let mut tried: Vec<Isometry3<f64>> = Vec::new();
    let mut best: Option<(f64, RacketPose)> = None;
    for (_, _, pose) in hypotheses {
        let near = |q: &Isometry3<f64>| (q.translation.vector - pose.translation.vector).norm() < 0.02 && q.rotation.angle_to(&pose.rotation) < 0.15;
        if tried.iter().any(near) {
            continue;
        }
        if tried.len() == FOLLOWED {
            break;
        }
        tried.push(pose);
        if let Some((score, pose)) = follow(view, figure, candidates, &pose)
            && best.as_ref().is_none_or(|b| score > b.0)
        {
            best = Some((score, pose));
        }
    }
    best.map(|b| b.1)
}

/// Refines a rough pose on the candidates and scores it by the tape it explains.
fn follow(view: &View, figure: &RacketFigure, candidates: &[Vec<BandCandidate>; 2], rough: &Isometry3<f64>) -> Option<(f64, RacketPose)> {
    let mut pose = *rough;
    let mut fitted = None;
    for gate in [GATE_PX, 4.0, 2.5] {
        let seen = associate(view, figure, &pose, candidates, gate);
        let observations: Vec<MarkerObservation> = seen.iter().map(|s| s.0).collect();
        let fit = fit_pose_in(view, figure, &observations, Some(&pose)).ok()?;
        pose = fit.global_from_racket;
        fitted = Some((seen, fit));
    }
    let (seen, fit) = fitted?;
    // A candidate is good to about 0.7 px; more than three times that is another thing.
    if seen.len() < LEAST_POINTS || fit.chi2 > 6.0 * fit.dof.max(1) as f64 {
        return None;
    }
    let strength: f64 = seen.iter().map(|s| s.2).sum();
    Some((strength * (1.0 - 0.1 * (fit.chi2 / fit.dof.max(1) as f64).sqrt()), fit))
}

/// The nearest candidate of each marker in each picture, with its distance, px, and contrast. A candidate serves once.
fn associate(
    view: &View,
    figure: &RacketFigure,
    pose: &Isometry3<f64>,
    candidates: &[Vec<BandCandidate>; 2],
    gate_px: f64,
) -> Vec<(MarkerObservation, f64, f64)> {
    let mut out: Vec<(MarkerObservation, f64, f64)> = Vec::with_capacity(10);
    for camera in CameraId::BOTH {
        let mut used = [usize::MAX; 5];
        for marker in 0..5 {
            let Some(band) = BandView::at(view, figure, pose, camera, marker) else { continue };
            let mut best: Option<(usize, f64)> = None;
            for (i, c) in candidates[camera.index()].iter().enumerate() {
                let d = (c.uv - band.centre).norm();
                if d < gate_px && best.is_none_or(|b| d < b.1) && !used.contains(&i) {
                    best = Some((i, d));
                }
            }
            if let Some((i, d)) = best {
                used[marker] = i;
                let c = &candidates[camera.index()][i];
                let point = ImagePoint { uv: c.uv, sd: Vector2::new(0.7, 0.7) };
                out.push((MarkerObservation { camera, marker, point }, d, c.contrast));
            }
        }
    }
    out
}

/// Space points of candidates whose rays meet.
fn space_candidates(view: &View, candidates: &[Vec<BandCandidate>; 2]) -> Vec<Point3<f64>> {
    let rays = CameraId::BOTH.map(|c| candidates[c.index()].iter().map(|p| view.ray(c, p.uv)).collect::<Vec<_>>());
    let mut out = Vec::new();
    for l in rays[0].iter().flatten() {
        for r in rays[1].iter().flatten() {
            if let Some((p, gap)) = view.nearest_to_rays(l, r)
                && gap < RAY_GAP_M
            {
                out.push(p);
            }
        }
    }
    out
}
