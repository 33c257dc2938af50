//! Finds a racket not far from where it was foretold, after it had been hidden or out of both pictures for some frames: what looks like tape there is
//! given to the markers one by one, and each tells where the others should be (joint compatibility, after Neira and Tardos 2001).

use crate::calibration::CameraId;
use crate::tracking::racket::foretold_pose::{Foretold, moved};
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{MarkerObservation, View, fit_pose_near};
use crate::tracking::tape::band_search::BandCandidate;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Isometry3, Matrix2, Matrix6, SMatrix, Vector2};

/// A candidate's place is good to this, px.
const CANDIDATE_SD_PX: f64 = 0.7;
/// One that is farther off than this belongs to no marker, in squared deviations of both coordinates (99 %).
const GATE: f64 = 9.2;
/// Bands that must be given to markers, of so many markers.
pub const FEWEST: usize = 4;
const FEWEST_MARKERS: usize = 3;
/// Poses that are handed on.
const MOST_POSES: usize = 3;

/// One marker's band on one candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Given {
    camera: CameraId,
    marker: usize,
    candidate: usize,
}

/// A band's place, px, how it changes with the pose, and one over the covariance of a candidate's distance from it.
struct Expected {
    uv: Vector2<f64>,
    by_pose: SMatrix<f64, 2, 6>,
    precision: Matrix2<f64>,
}

/// What has been given so far, and the pose it tells.
struct Hypothesis {
    given: Vec<Given>,
    pose: Isometry3<f64>,
    covariance: Matrix6<f64>,
}

/// Poses that agree with the foretold one and put at least four bands on candidates, those with most bands first.
pub fn search(view: &View, figure: &RacketFigure, candidates: &[Vec<BandCandidate>; 2], foretold: &Foretold) -> Vec<Isometry3<f64>> {
    let nothing = Hypothesis { given: Vec::new(), pose: foretold.pose, covariance: *foretold.covariance() };
    let mut found: Vec<(usize, f64, Isometry3<f64>)> = Vec::new();
    let mut tried: Vec<Vec<Given>> = Vec::new();
    for seed in nothing.possible(view, figure, candidates) {
        let mut hypothesis = Hypothesis { given: Vec::new(), ..nothing };
        let mut next = Some(seed.0);
        while let Some(given) = next {
            if hypothesis.give(view, figure, candidates, given).is_none() {
                break;
            }
            next = hypothesis.possible(view, figure, candidates).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(given, _)| given);
        }
        let mut given = hypothesis.given;
        given.sort_by_key(|g| (g.camera, g.marker));
        let mut markers: Vec<usize> = given.iter().map(|g| g.marker).collect();
        markers.sort_unstable();
        markers.dedup();
        if given.len() < FEWEST || markers.len() < FEWEST_MARKERS || tried.contains(&given) {
            continue;
        }
        let point = |g: &Given| ImagePoint { uv: candidates[g.camera.index()][g.candidate].uv, sd: Vector2::repeat(CANDIDATE_SD_PX) };
        let seen: Vec<MarkerObservation> = given.iter().map(|g| MarkerObservation { camera: g.camera, marker: g.marker, point: point(g) }).collect();
        if let Ok(pose) = fit_pose_near(view, figure, &seen, foretold) {
            found.push((given.len(), pose.chi2, pose.global_from_racket));
        }
        tried.push(given);
    }
    found.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.total_cmp(&b.1)));
    found.into_iter().take(MOST_POSES).map(|(_, _, pose)| pose).collect()
}

impl Hypothesis {
    /// Bands not given yet, each with a candidate near enough to where this pose has it, and how far off that is, squared deviations.
    fn possible<'a>(&'a self, view: &'a View, figure: &'a RacketFigure, candidates: &'a [Vec<BandCandidate>; 2]) -> impl Iterator<Item = (Given, f64)> + 'a {
        let bands = CameraId::BOTH.into_iter().flat_map(|camera| (0..5).map(move |marker| (camera, marker)));
        let free = bands.filter(|(camera, marker)| !self.given.iter().any(|g| g.camera == *camera && g.marker == *marker));
        free.flat_map(move |(camera, marker)| {
            let seen = self.expects(view, figure, camera, marker);
            seen.into_iter().flat_map(move |Expected { uv, precision, .. }| {
                candidates[camera.index()].iter().enumerate().filter_map(move |(candidate, c)| {
                    let off = c.uv - uv;
                    let squared = off.dot(&(precision * off));
                    let used = self.given.iter().any(|g| g.camera == camera && g.candidate == candidate);
                    (squared < GATE && !used).then_some((Given { camera, marker, candidate }, squared))
                })
            })
        })
    }

    /// Where this pose has a band.
    fn expects(&self, view: &View, figure: &RacketFigure, camera: CameraId, marker: usize) -> Option<Expected> {
        let (uv, by_pose) = view.patch_with_jacobian(camera, figure, marker, &self.pose)?;
        let spread = by_pose * self.covariance * by_pose.transpose() + Matrix2::identity() * CANDIDATE_SD_PX.powi(2);
        Some(Expected { uv, by_pose, precision: spread.try_inverse()? })
    }

    /// The pose with one more band.
    fn give(&mut self, view: &View, figure: &RacketFigure, candidates: &[Vec<BandCandidate>; 2], given: Given) -> Option<()> {
        let Expected { uv, by_pose, precision } = self.expects(view, figure, given.camera, given.marker)?;
        let gain = self.covariance * by_pose.transpose() * precision;
        let step = gain * (candidates[given.camera.index()][given.candidate].uv - uv);
        let left = self.covariance - gain * by_pose * self.covariance;
        self.covariance = 0.5 * (left + left.transpose());
        self.pose = moved(&self.pose, &step.into());
        self.given.push(given);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::tests::rig;
    use nalgebra::{Translation3, UnitQuaternion};

    #[test]
    fn truth_four_bands_in_one_picture_are_told_among_other_things() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let turned = UnitQuaternion::from_euler_angles(0.3, 0.4, -0.5);
        let here = Isometry3::from_parts(Translation3::new(0.0, 0.9, -0.1), turned);
        let off = UnitQuaternion::from_euler_angles(0.04, -0.05, 0.03);
        let expected = Foretold::within(Isometry3::from_parts(Translation3::new(0.02, 0.88, -0.08), off * turned), 0.05, 0.03);
        let miss_px = |pose: &Isometry3<f64>, camera: CameraId| {
            let at = |pose: &Isometry3<f64>, m: usize| view.project(camera, &(pose * figure.points[m])).expect("seen");
            (0..5).map(|m| (at(pose, m) - at(&here, m)).norm()).fold(0.0, f64::max)
        };
        for camera in CameraId::BOTH {
            for hidden in 0..5 {
                let uv = |marker: usize| view.patch(camera, &figure, marker, &here).expect("seen");
                let other = |k: usize| uv(hidden) + Vector2::new(((k * 37) % 90) as f64 - 45.0, ((k * 53) % 80) as f64 - 40.0);
                let mut seen: Vec<BandCandidate> = (1..7).map(|k| BandCandidate { uv: other(k), contrast: 50.0 }).collect();
                seen.extend((0..5).filter(|m| *m != hidden).map(|m| BandCandidate { uv: uv(m), contrast: 90.0 }));
                let mut candidates = [Vec::new(), Vec::new()];
                candidates[camera.index()] = seen;
                let found = search(&view, &figure, &candidates, &expected);
                assert!(
                    found.iter().any(|pose| miss_px(pose, camera) < 1.5),
                    "{camera:?} {hidden}: {:?}",
                    found.iter().map(|p| miss_px(p, camera)).collect::<Vec<_>>()
                );
                // Three bands fit too easily.
                candidates[camera.index()].truncate(3);
                assert!(search(&view, &figure, &candidates, &expected).is_empty());
            }
        }
    }

    #[test]
    fn law_bands_farther_off_than_foretold_are_other_things() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let here = Isometry3::from_parts(Translation3::new(0.0, 0.9, -0.1), UnitQuaternion::from_euler_angles(0.3, 0.4, -0.5));
        let band = |camera, marker| BandCandidate { uv: view.patch(camera, &figure, marker, &here).expect("seen"), contrast: 90.0 };
        let candidates = CameraId::BOTH.map(|camera| (0..5).map(|marker| band(camera, marker)).collect::<Vec<_>>());
        let foretold = |by_m: f64| Foretold::within(Translation3::new(0.0, by_m, 0.0) * here, 0.01, 0.01);
        assert!(!search(&view, &figure, &candidates, &foretold(0.02)).is_empty());
        assert!(search(&view, &figure, &candidates, &foretold(0.08)).is_empty());
    }
}
