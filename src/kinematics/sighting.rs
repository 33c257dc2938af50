//! What the cameras saw of one body in one window: image points with times, grouped by target and camera.

use crate::calibration::CameraId;
use crate::median::upper_median;
use crate::tracking::{Target, Tracks};
use nalgebra::{DMatrix, DVector, Matrix3, Vector2, Vector3};

/// One image point of one target. `t` in s from the shot's time origin (a frame number), pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    pub frame: u64,
    pub t: f64,
    pub camera: CameraId,
    pub target: Target,
    pub uv: Vector2<f64>,
    pub sd: Vector2<f64>,
}

/// Turns frame numbers into seconds: time = (frame − origin) × period, the middle of the exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameClock {
    pub origin: u64,
    pub period_s: f64,
}

impl FrameClock {
    pub fn time_s(&self, frame: u64) -> f64 {
        (frame as f64 - self.origin as f64) * self.period_s
    }

    /// Frame number, with its fraction, of a time.
    pub fn frame_at(&self, t: f64) -> f64 {
        self.origin as f64 + t / self.period_s
    }
}

/// The sightings of `targets` with `from ≤ t ≤ to`, sorted by target, camera, frame.
pub fn sightings(tracks: &Tracks, clock: FrameClock, targets: &[Target], from: f64, to: f64) -> Vec<Sighting> {
    let mut seen: Vec<Sighting> = tracks
        .points
        .iter()
        .filter(|p| targets.contains(&p.target))
        .filter_map(|p| {
            let t = clock.time_s(p.frame);
            let point = p.point.filter(|_| (from..=to).contains(&t))?;
            Some(Sighting { frame: p.frame, t, camera: p.camera, target: p.target, uv: point.uv, sd: point.sd })
        })
        .collect();
    seen.sort_by_key(|s| (s.target, s.camera, s.frame));
    seen
}

/// The sightings that a fit used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UsedSightings {
    pub frames: usize,
    /// Left out as outliers.
    pub rejected: usize,
    /// From the reference time to the farthest frame, s.
    pub length_s: f64,
    /// Factor on their stated deviations.
    pub noise_scale: f64,
}

impl UsedSightings {
    /// Of so many in `all`, those that were left.
    pub(crate) fn of(left: &[Sighting], all: usize, reference_t: f64, noise_scale: f64) -> Self {
        let length_s = left.iter().map(|s| (s.t - reference_t).abs()).fold(0.0, f64::max);
        UsedSightings { frames: frames_in(left), rejected: all - left.len(), length_s, noise_scale }
    }
}

/// Number of frames that hold a sighting.
pub(crate) fn frames_in(sightings: &[Sighting]) -> usize {
    let mut frames: Vec<u64> = sightings.iter().map(|s| s.frame).collect();
    frames.sort_unstable();
    frames.dedup();
    frames.len()
}

/// What one target's image error in one camera has in common over a window (tape, string shadow, edge of the disc), one
/// standard deviation: a constant, px, and as the view turns a drift, px/s, that does not stay the same, px/s². All three are
/// marginalised exactly: residuals of a group share the covariance σ² I + τ² 11ᵀ + κ² ttᵀ + γ² t²t²ᵀ, t from the group's mean
/// time. Without the last the bend of a band's path tells an angular velocity that nothing else does: where a racket turned by
/// 0.8 rad, rates were wrong by three deviations.
///
/// `untold` is for a target whose look is learnt from the very pictures in which it is then measured (the ball's cover): a shift and
/// an even drift of all its places are learnt along, so that neither the residuals nor the stated deviations, which are those of a
/// place beside a known look, tell them. They are in proportion to what the stated deviations leave open of the mean and of the
/// slope of the stretch, and so matter in short ones only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommonError {
    pub constant_px: f64,
    pub drift_px_s: f64,
    pub bend_px_s2: f64,
    /// Further constant and drift, in deviations of mean and slope.
    pub untold: f64,
}

impl CommonError {
    /// With what a group leaves untold on one axis; `stated` are its times from their mean, s, and stated deviations, px.
    fn of_group(&self, stated: impl Iterator<Item = (f64, f64)>) -> Self {
        let (information, leverage) = stated.fold((0.0, 0.0), |(a, b), (t, sd)| (a + sd.powi(-2), b + (t / sd).powi(2)));
        let with = |known: f64, precision: f64| if precision > 0.0 { known.hypot(self.untold / precision.sqrt()) } else { known };
        CommonError { constant_px: with(self.constant_px, information), drift_px_s: with(self.drift_px_s, leverage), ..*self }
    }

    /// The three at `t` from the group's mean time, in units of one point's deviation `sd_px`.
    fn at(&self, t: f64, sd_px: f64) -> Vector3<f64> {
        Vector3::new(self.constant_px, self.drift_px_s * t, self.bend_px_s2 * t * t) / sd_px
    }
}

/// Groups of equal target and camera, as ranges of `sightings` (which must be sorted).
fn groups(sightings: &[Sighting]) -> Vec<std::ops::Range<usize>> {
    let mut ranges = Vec::new();
    let mut start = 0;
    for i in 1..=sightings.len() {
        if i == sightings.len() || (sightings[i].target, sightings[i].camera) != (sightings[start].target, sightings[start].camera) {
            if i > start {
                ranges.push(start..i);
            }
            start = i;
        }
    }
    ranges
}

/// Divides residuals by the square root of their covariance, group by group and axis by axis.
///
/// With y = r/σ and U = [τ 1/σ, κ t/σ, γ t²/σ], the inverse root of I + U Uᵀ is I − U V diag((1 − 1/√(1+λ))/λ) Vᵀ Uᵀ, where
/// Uᵀ U = V diag(λ) Vᵀ. None of that depends on the residuals: a fit has it computed once. Where a camera shakes, all its points of a
/// frame share that too ([`Shaken`]).
pub(crate) struct Whitener {
    groups: Vec<Group>,
    /// In place of groups, of a camera that shakes.
    shaken: Vec<Shaken>,
    points: usize,
}

/// One group and axis.
struct Group {
    range: std::ops::Range<usize>,
    axis: usize,
    /// Rows of U and σ.
    shared: Vec<(Vector3<f64>, f64)>,
    vectors: Matrix3<f64>,
    shrink: Vector3<f64>,
}

/// All points of a camera that shakes, one axis. What the points of a frame share is taken out first, frame by frame; then, with U what that leaves
/// of the groups' columns, I + U Uᵀ as above. One product of both roots is as good as the symmetric one, and of many frames the work grows as they do.
struct Shaken {
    axis: usize,
    points: Vec<ShakenPoint>,
    /// (1 − 1/√(1+λ))/λ of each frame, λ = Σ (s/σ)².
    shrink: Vec<f64>,
    shared: DMatrix<f64>,
    /// V diag((1 − 1/√(1+λ))/λ) Vᵀ.
    taken: DMatrix<f64>,
}

struct ShakenPoint {
    /// Place among the sightings.
    place: usize,
    sd: f64,
    /// Its frame among those of the camera.
    frame: usize,
    /// s/σ.
    shake: f64,
}

impl Shaken {
    fn new(sightings: &[Sighting], groups: &[&Group], shake_px: f64) -> Self {
        let axis = groups.first().map_or(0, |g| g.axis);
        let mut frames: Vec<u64> = groups.iter().flat_map(|g| g.range.clone()).map(|place| sightings[place].frame).collect();
        frames.sort_unstable();
        frames.dedup();
        let point = |(place, sd): (usize, f64)| {
            let frame = frames.partition_point(|f| *f < sightings[place].frame);
            ShakenPoint { place, sd, frame, shake: shake_px / sd }
        };
        let points: Vec<ShakenPoint> = groups.iter().flat_map(|g| g.range.clone().zip(g.shared.iter().map(|(_, sd)| *sd))).map(point).collect();
        let mut shrink = vec![0.0; frames.len()];
        points.iter().for_each(|p| shrink[p.frame] += p.shake * p.shake);
        shrink.iter_mut().for_each(|l| *l = shrinking(*l));
        let mut shaken = Shaken { axis, shared: DMatrix::zeros(points.len(), 3 * groups.len()), points, shrink, taken: DMatrix::zeros(0, 0) };
        let own = groups.iter().enumerate().flat_map(|(k, g)| g.shared.iter().map(move |(u, _)| (k, u)));
        for (row, (k, u)) in own.enumerate() {
            shaken.shared.fixed_view_mut::<1, 3>(row, 3 * k).copy_from(&u.transpose());
        }
        for column in 0..shaken.shared.ncols() {
            let left = shaken.still(shaken.shared.column(column).into_owned());
            shaken.shared.set_column(column, &left);
        }
        let eigen = shaken.shared.tr_mul(&shaken.shared).symmetric_eigen();
        shaken.taken = &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(shrinking)) * eigen.eigenvectors.transpose();
        shaken
    }

    /// Residuals over their deviations without what the points of each frame share.
    fn still(&self, mut y: DVector<f64>) -> DVector<f64> {
        let mut common = vec![0.0; self.shrink.len()];
        self.points.iter().zip(y.iter()).for_each(|(p, y)| common[p.frame] += p.shake * y);
        self.points.iter().zip(y.iter_mut()).for_each(|(p, y)| *y -= p.shake * self.shrink[p.frame] * common[p.frame]);
        y
    }

    fn whiten(&self, misfit_px: &[Vector2<f64>], out: &mut DVector<f64>) {
        let mut y = self.still(DVector::from_iterator(self.points.len(), self.points.iter().map(|p| misfit_px[p.place][self.axis] / p.sd)));
        y -= &self.shared * (&self.taken * self.shared.tr_mul(&y));
        self.points.iter().zip(y.iter()).for_each(|(p, y)| out[2 * p.place + self.axis] = *y);
    }
}

/// (1 − 1/√(1+λ))/λ.
fn shrinking(l: f64) -> f64 {
    if l > 1e-12 { (1.0 - 1.0 / (1.0 + l).sqrt()) / l } else { 0.5 }
}

impl Whitener {
    /// `shake_px` by camera.
    pub fn new(sightings: &[Sighting], common: CommonError, scale: f64, shake_px: [f64; 2]) -> Self {
        let group = |range: std::ops::Range<usize>, axis: usize| {
            let mean_t = sightings[range.clone()].iter().map(|s| s.t).sum::<f64>() / range.len() as f64;
            let common = common.of_group(sightings[range.clone()].iter().map(|s| (s.t - mean_t, s.sd[axis])));
            let row = |s: &Sighting| (common.at(s.t - mean_t, s.sd[axis] * scale), s.sd[axis] * scale);
            let shared: Vec<(Vector3<f64>, f64)> = sightings[range.clone()].iter().map(row).collect();
            let gram = shared.iter().fold(Matrix3::zeros(), |sum, (u, _)| sum + u * u.transpose());
            let eigen = gram.symmetric_eigen();
            Group { range, axis, shared, vectors: eigen.eigenvectors, shrink: eigen.eigenvalues.map(shrinking) }
        };
        let groups: Vec<Group> =
            groups(sightings).into_iter().flat_map(|range| [(range.clone(), 0), (range, 1)]).map(|(range, axis)| group(range, axis)).collect();
        let camera = |g: &Group| sightings[g.range.start].camera;
        let mut shaken = Vec::new();
        for shaking in CameraId::BOTH.into_iter().filter(|c| shake_px[c.index()] > 0.0) {
            for axis in 0..2 {
                let own: Vec<&Group> = groups.iter().filter(|g| g.axis == axis && camera(g) == shaking).collect();
                if !own.is_empty() {
                    shaken.push(Shaken::new(sightings, &own, shake_px[shaking.index()]));
                }
            }
        }
        let groups = groups.into_iter().filter(|g| shake_px[camera(g).index()] <= 0.0).collect();
        Whitener { groups, shaken, points: sightings.len() }
    }

    pub fn whiten(&self, misfit_px: &[Vector2<f64>]) -> DVector<f64> {
        let mut out = DVector::zeros(2 * self.points);
        for g in &self.groups {
            let own = || misfit_px[g.range.clone()].iter().zip(&g.shared);
            let dot: Vector3<f64> = own().fold(Vector3::zeros(), |sum, (misfit, (u, sd))| sum + u * (misfit[g.axis] / sd));
            let take = g.vectors * g.shrink.component_mul(&(g.vectors.transpose() * dot));
            for (i, (misfit, (u, sd))) in g.range.clone().zip(own()) {
                out[2 * i + g.axis] = misfit[g.axis] / sd - u.dot(&take);
            }
        }
        self.shaken.iter().for_each(|s| s.whiten(misfit_px, &mut out));
        out
    }
}

/// Factor on the deviations for errors that persist from frame to frame: √((1+ρ)/(1−ρ)) with ρ the residuals' correlation
/// between neighbouring frames, each group's mean taken out; at least 1. `whitened` as [`Whitener::whiten`] gives it.
pub(crate) fn persistence(sightings: &[Sighting], whitened: &DVector<f64>) -> f64 {
    let (mut product, mut square, mut pairs, mut points) = (0.0, 0.0, 0, 0);
    for range in groups(sightings).into_iter().filter(|r| r.len() >= 6) {
        for axis in 0..2 {
            let mean = range.clone().map(|i| whitened[2 * i + axis]).sum::<f64>() / range.len() as f64;
            for i in range.clone() {
                let r = whitened[2 * i + axis] - mean;
                square += r * r;
                points += 1;
                if i + 1 < range.end && sightings[i + 1].frame == sightings[i].frame + 1 {
                    product += r * (whitened[2 * (i + 1) + axis] - mean);
                    pairs += 1;
                }
            }
        }
    }
    if pairs < 20 || square <= 0.0 {
        return 1.0;
    }
    let rho = ((product / pairs as f64) / (square / points as f64)).clamp(0.0, 0.8);
    ((1.0 + rho) / (1.0 - rho)).sqrt()
}

/// Size of each sighting's residual (both axes, in its own standard deviations) after its group's common error is taken out.
/// The common error is the group's median, so that one bad point cannot hide itself.
pub(crate) fn deviations(sightings: &[Sighting], misfit_px: &[Vector2<f64>], common: CommonError) -> Vec<f64> {
    let mut out = vec![0.0; sightings.len()];
    for range in groups(sightings) {
        for axis in 0..2 {
            let usual = upper_median(range.clone().map(|i| misfit_px[i][axis])).unwrap_or(0.0);
            let shift = usual.clamp(-3.0 * common.constant_px, 3.0 * common.constant_px);
            for i in range.clone() {
                out[i] += ((misfit_px[i][axis] - shift) / sightings[i].sd[axis]).powi(2);
            }
        }
    }
    out.into_iter().map(f64::sqrt).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_whitening_is_the_inverse_root_of_the_stated_covariance() {
        // Hand calculation for two points, σ = (1, 2), τ = 3: covariance [[1+9, 9], [9, 4+9]].
        let at = |frame, sd| Sighting { frame, t: 0.0, camera: CameraId::Left, target: Target::M1, uv: Vector2::zeros(), sd: Vector2::new(sd, 1.0) };
        let seen = [at(0, 1.0), at(1, 2.0)];
        let r = [Vector2::new(0.7, 0.0), Vector2::new(-1.3, 0.0)];
        let white = Whitener::new(&seen, CommonError { constant_px: 3.0, drift_px_s: 0.0, bend_px_s2: 0.0, untold: 0.0 }, 1.0, [0.0; 2]).whiten(&r);
        let covariance = nalgebra::Matrix2::new(10.0, 9.0, 9.0, 13.0);
        let v = nalgebra::Vector2::new(0.7, -1.3);
        let expected = v.dot(&(covariance.try_inverse().expect("positive") * v));
        assert!((white.norm_squared() - expected).abs() < 1e-12);
    }

    #[test]
    fn truth_points_of_a_frame_share_the_shake_of_their_camera_alone() {
        // Two bands in two frames of either camera, σ = 1 along u, shake of the left camera 2: within a frame the covariance is [[5, 4], [4, 5]].
        let at = |target, camera, frame| Sighting { frame, t: 0.0, camera, target, uv: Vector2::zeros(), sd: Vector2::new(1.0, 1.0) };
        let mut seen = Vec::new();
        for target in [Target::M1, Target::M2] {
            for camera in CameraId::BOTH {
                seen.extend([at(target, camera, 0), at(target, camera, 1)]);
            }
        }
        let misfit: Vec<Vector2<f64>> = [0.7, -0.4, 0.1, 0.9, -1.1, 0.3, 0.5, -0.6].map(|x| Vector2::new(x, 0.0)).to_vec();
        let none = CommonError { constant_px: 0.0, drift_px_s: 0.0, bend_px_s2: 0.0, untold: 0.0 };
        let white = Whitener::new(&seen, none, 1.0, [2.0, 0.0]).whiten(&misfit);
        let inverse = nalgebra::Matrix2::new(5.0, 4.0, 4.0, 5.0).try_inverse().expect("positive");
        let both = |a: usize, b: usize| Vector2::new(misfit[a].x, misfit[b].x);
        let left: f64 = [both(0, 4), both(1, 5)].iter().map(|v| v.dot(&(inverse * v))).sum();
        let right: f64 = [2, 3, 6, 7].iter().map(|i| misfit[*i].x.powi(2)).sum();
        assert!((white.norm_squared() - left - right).abs() < 1e-12);
        // Beside what each target's points share, too: the covariance of the left camera's four, and of the right one's.
        let white = Whitener::new(&seen, CommonError { constant_px: 0.3, ..none }, 1.0, [2.0, 0.0]).whiten(&misfit);
        let chi2 = |places: [usize; 4], shake: f64| {
            let covariance = nalgebra::Matrix4::from_fn(|a, b| {
                let shares = |with: usize, size: f64| if a == b || a == with { size } else { 0.0 };
                f64::from(a == b) + shares(b ^ 2, shake * shake) + shares(b ^ 1, 0.09)
            });
            let r = nalgebra::Vector4::from_fn(|k, _| misfit[places[k]].x);
            r.dot(&(covariance.try_inverse().expect("positive") * r))
        };
        assert!((white.norm_squared() - chi2([0, 1, 4, 5], 2.0) - chi2([2, 3, 6, 7], 0.0)).abs() < 1e-12);
    }

    #[test]
    fn truth_what_a_stretch_leaves_untold_is_in_proportion_to_what_it_tells_of_mean_and_slope() {
        // Three places a millisecond apart, σ = 0.1 px: mean to 0.1/√3 px, slope to 0.1/√2 px/ms.
        let common = CommonError { constant_px: 0.0, drift_px_s: 3.0, bend_px_s2: 0.0, untold: 2.0 };
        let seen = common.of_group([-1e-3, 0.0, 1e-3].map(|t| (t, 0.1)).into_iter());
        assert!((seen.constant_px - 0.2 / 3.0f64.sqrt()).abs() < 1e-12);
        assert!((seen.drift_px_s - 3.0f64.hypot(200.0 / 2.0f64.sqrt())).abs() < 1e-9);
        // Thirty places leave a tenth of that of the slope, and less.
        let long = common.of_group((0..30).map(|k| (1e-3 * (f64::from(k) - 14.5), 0.1)));
        assert!(long.drift_px_s < 0.05 * seen.drift_px_s, "{}", long.drift_px_s);
    }
}
