//! Finds the racket in one pair of pictures without knowing anything but its figure.
//!
//! Tape-like places of both pictures are paired along epipolar lines; triples of the resulting space points whose
//! distances are those of three markers give a pose each; the pose that explains most tape in both pictures wins. A
//! racket's usual figure equals itself turned by half a turn about its long axis, so the answer may have m2 and m3
//! (and m4 and m5) exchanged: [`crate::tracking::racket::face`] decides that once for the whole shot.

use crate::calibration::CameraId;
use crate::tracking::racket::face;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_pose::{MarkerObservation, RacketPose, View, fit_pose};
use crate::tracking::racket::rigid_points::Triangle;
use crate::tracking::tape::band_search::BandCandidate;
use crate::tracking::tape::visible_patches::VisiblePatches;
use crate::tracking::track_file::ImagePoint;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Two rays of one marker may miss each other by this, m: two pixels at 12 m, and the two cameras see different sides of
/// the tube.
const RAY_GAP_M: f64 = 0.014;
/// Distances between triangulated markers may be wrong by this, m (a candidate is good to about a pixel, depth to three).
const DISTANCE_TOLERANCE_M: f64 = 0.020;
/// A candidate belongs to a marker of a rough pose within this, px.
const GATE_PX: f64 = 6.0;
/// Least number of image points that must agree before a racket is believed: three markers seen by both cameras.
const LEAST_POINTS: usize = 6;
/// No racket moves faster than this, m/s: the tip of one that serves at 250 km/h does 50.
const FASTEST_M_S: f64 = 60.0;
/// And none turns faster than this, rad/s: one that is hit far off its axis turns at half of it.
const FASTEST_RAD_S: f64 = 150.0;
/// The attitude that three markers tell may be wrong by this, rad.
const ATTITUDE_TOLERANCE_RAD: f64 = 0.3;
/// Most hypotheses followed up: of those on which most image points agree, and of those that explain most contrast. Three clear tapes before
/// a dark curtain are fewer than what its folds bring together by chance.
const FOLLOWED: [usize; 2] = [12, 12];
/// Among so many of the likeliest hypotheses they are chosen: one racket makes some tens of them.
const ORDERED: usize = 1000;

/// Triples of markers that may be on what looks like tape. Where there are more, chance makes them, and only figures of all five markers count: of
/// a picture without the racket half a million were followed up, for a second.
const MOST_TRIPLES: usize = 50_000;

/// Candidates per picture, strongest first, that are tried before all of them: on a decent recording the tape is among
/// them, and chance triples grow with the sixth power of their number.
const STRONGEST: usize = 24;
/// Image points that must agree before the strongest candidates decide alone: four markers seen by both cameras.
const CLEAR_POINTS: usize = 8;
/// Otherwise what explains this share of the likeliest pose's tape is asked about too.
const ALIKE: f64 = 0.85;

/// Where a racket may have got to.
#[derive(Debug, Clone, Copy)]
pub struct Reach {
    centre: Point3<f64>,
    radius_m: f64,
    /// Where each marker was (the other of the two that half a turn exchanges, if that is no turn), and how far from there it may be, m.
    markers: [([Point3<f64>; 2], f64); 5],
    attitude: UnitQuaternion<f64>,
    turn_rad: f64,
    /// Whether half a turn about the long axis is no turn.
    symmetric: bool,
}

impl Reach {
    /// Its markers so many seconds after or before a pose.
    pub fn of(figure: &RacketFigure, last: &Isometry3<f64>, seconds: f64) -> Self {
        let (moved_m, turn_rad) = (FASTEST_M_S * seconds.abs() + DISTANCE_TOLERANCE_M, FASTEST_RAD_S * seconds.abs() + ATTITUDE_TOLERANCE_RAD);
        Self::around(figure, last, moved_m, turn_rad)
    }

    /// Its markers not farther from a pose than this, m, and however it is turned by an angle of this, rad.
    pub fn around(figure: &RacketFigure, last: &Isometry3<f64>, moved_m: f64, turn_rad: f64) -> Self {
        let mean = Point3::from(figure.points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / figure.points.len() as f64);
        let figure_m = figure.points.iter().map(|p| (p - mean).norm()).fold(0.0, f64::max);
        let symmetric = face::symmetric(figure);
        let marker = |p: &Point3<f64>| {
            let twin = if symmetric { face::half_turn() * p } else { *p };
            ([last * p, last * twin], moved_m + ATTITUDE_TOLERANCE_RAD * (p - mean).norm())
        };
        Reach { centre: last * mean, radius_m: figure_m + moved_m, markers: figure.points.each_ref().map(marker), attitude: last.rotation, turn_rad, symmetric }
    }

    /// Where its middle was.
    pub fn centre(&self) -> Point3<f64> {
        self.centre
    }

    /// Whether a marker can have got there.
    fn holds(&self, marker: usize, place: &Point3<f64>) -> bool {
        let (was, radius_m) = &self.markers[marker];
        was.iter().any(|was| (place - was).norm() < *radius_m)
    }

    /// Whether it can have turned to this attitude.
    pub fn turns_to(&self, attitude: &UnitQuaternion<f64>) -> bool {
        let from = |a: &UnitQuaternion<f64>| self.attitude.angle_to(a) < self.turn_rad;
        from(attitude) || self.symmetric && from(&(attitude * face::half_turn()))
    }

    /// Its circle in a picture: centre and radius, px.
    pub fn circle(&self, view: &View, camera: CameraId) -> Option<(Vector2<f64>, f64)> {
        let distance = (self.centre - view.eye(camera)).norm();
        let near = (distance - self.radius_m).max(0.1 * distance);
        Some((view.project(camera, &self.centre)?, view.rig.camera(camera).fx.max(view.rig.camera(camera).fy) * self.radius_m / near))
    }
}

/// The racket's poses within reach that explain about as much tape as the likeliest does, likeliest first. One, where four markers decide it; of
/// three the figure may hold another triangle that differs by millimetres only, which the bands themselves tell from it. Candidates come strongest
/// first, those along lines last where they crowd.
pub fn search(view: &View, figure: &RacketFigure, candidates: &[Vec<BandCandidate>; 2], reach: Option<&Reach>) -> Vec<RacketPose> {
    let strongest = candidates.each_ref().map(|c| c.iter().take(STRONGEST).copied().collect::<Vec<_>>());
    let clear = |found: &Followed| found.seen >= CLEAR_POINTS;
    let mut found = search_among(view, figure, &strongest, reach);
    if !found.first().is_some_and(clear) {
        found = search_among(view, figure, candidates, reach);
    }
    let Some(best) = found.first() else { return Vec::new() };
    let (least, most) = (ALIKE * best.score, if clear(best) { 1 } else { found.len() });
    found.into_iter().take(most).filter(|f| f.score >= least).map(|f| f.pose).collect()
}

/// All poses that put the racket on figures like it, likeliest first. Lettering makes figures too, and may look more like tape than tape in the
/// shade does.
pub fn search_all(view: &View, figure: &RacketFigure, candidates: &[Vec<BandCandidate>; 2]) -> impl Iterator<Item = RacketPose> {
    search_among(view, figure, candidates, None).into_iter().map(|f| f.pose)
}

/// A pose refined on the candidates.
struct Followed {
    pose: RacketPose,
    /// Image points that agree.
    seen: usize,
    /// Their contrast, less where they agree badly.
    score: f64,
}

/// The best poses, best first.
fn search_among(view: &View, figure: &RacketFigure, candidates: &[Vec<BandCandidate>; 2], reach: Option<&Reach>) -> Vec<Followed> {
    let mut places = space_candidates(view, candidates);
    places.retain(|p| reach.is_none_or(|r| (0..5).any(|marker| r.holds(marker, p))));
    let points = SpacePoints::of(figure, places, reach);
    let seen = Seen { patches: VisiblePatches::of(view, figure), near: CameraId::BOTH.map(|c| Neighbours::of(view.rig.image_size, &candidates[c.index()])) };
    // Markers 2-3 or 1-4, ... : each pair of markers may be the one that is seen well.
    let pairs = PAIRS.into_par_iter().with_max_len(1);
    let whole = pairs.clone().map(|pair| points.triples(pair).take(MOST_TRIPLES + 1).count()).sum::<usize>() > MOST_TRIPLES;
    let possible = |pair| points.triples(pair).filter(|triple| !whole || points.hold_the_others(triple));
    let mut hypotheses: Vec<Hypothesis> =
        pairs.flat_map_iter(|pair| possible(pair).filter_map(|triple| hypothesis(figure, &points, &seen, reach, &triple))).collect();
    let mut tried: Vec<Isometry3<f64>> = Vec::new();
    let mut take = |most: usize, likelier: &dyn Fn(&Hypothesis, &Hypothesis) -> Ordering| {
        // Of a hundred thousand only the likeliest are put in order.
        if hypotheses.len() > ORDERED {
            hypotheses.select_nth_unstable_by(ORDERED, likelier);
        }
        let likeliest = hypotheses.len().min(ORDERED);
        hypotheses[..likeliest].sort_by(likelier);
        let most = tried.len() + most;
        for Hypothesis { pose, .. } in &hypotheses[..likeliest] {
            let near = |q: &Isometry3<f64>| (q.translation.vector - pose.translation.vector).norm() < 0.02 && q.rotation.angle_to(&pose.rotation) < 0.15;
            if tried.len() < most && !tried.iter().any(near) {
                tried.push(*pose);
            }
        }
    };
    take(FOLLOWED[0], &|a, b| b.seen.cmp(&a.seen).then(a.miss_px.total_cmp(&b.miss_px)));
    take(FOLLOWED[1], &|a, b| b.contrast.total_cmp(&a.contrast));
    let followed: Vec<_> = tried.par_iter().with_max_len(1).map(|pose| follow(view, figure, &seen, pose)).collect();
    let mut found: Vec<Followed> = followed.into_iter().flatten().collect();
    // The first of equals stays first.
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found
}

/// A pose that puts three markers on space points.
struct Hypothesis {
    pose: Isometry3<f64>,
    /// Image points that agree, how far they are off in the mean, and the contrast of all of them.
    seen: usize,
    miss_px: f64,
    contrast: f64,
}

/// The pose that puts three markers on space points.
fn hypothesis(figure: &RacketFigure, points: &SpacePoints, seen: &Seen, reach: Option<&Reach>, triple: &[Placed; 3]) -> Option<Hypothesis> {
    let local = Triangle::of(triple.map(|(marker, _)| &figure.points[marker]))?;
    let pose = local.onto(&Triangle::of(triple.map(|(_, point)| &points.places[point]))?);
    if reach.is_some_and(|r| !r.turns_to(&pose.rotation)) {
        return None;
    }
    let (mut agree, mut miss, mut contrast) = (0, 0.0, 0.0);
    for (_, _, miss_px, band) in seen.around(&pose, GATE_PX) {
        (agree, miss, contrast) = (agree + 1, miss + miss_px, contrast + band.contrast);
    }
    (agree >= LEAST_POINTS).then(|| Hypothesis { pose, seen: agree, miss_px: miss / agree as f64, contrast })
}

/// A marker on a space point, by their numbers.
type Placed = (usize, usize);

/// Space points, and which of them are as far apart as two markers are.
struct SpacePoints {
    places: Vec<Point3<f64>>,
    /// By point and pair of markers, so many words each: a bit for every other point.
    apart: Vec<u64>,
    /// By marker, so many words each: a bit for every point where it may be.
    may_be: Vec<u64>,
    words: usize,
}

/// Pairs of markers: 0-1, 0-2, 0-3, 0-4, 1-2, ...
const PAIRS: [(usize, usize); 10] = [(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4)];

impl SpacePoints {
    fn of(figure: &RacketFigure, places: Vec<Point3<f64>>, reach: Option<&Reach>) -> Self {
        let words = places.len().div_ceil(64);
        let distances = PAIRS.map(|(i, j)| figure.distance_m(i, j));
        let mut apart = vec![0; places.len() * PAIRS.len() * words];
        for (a, p) in places.iter().enumerate() {
            for (b, q) in places[..a].iter().enumerate() {
                let d = (p - q).norm();
                for (pair, known) in distances.iter().enumerate() {
                    if (d - known).abs() < DISTANCE_TOLERANCE_M {
                        apart[(a * PAIRS.len() + pair) * words + b / 64] |= 1 << (b % 64);
                        apart[(b * PAIRS.len() + pair) * words + a / 64] |= 1 << (a % 64);
                    }
                }
            }
        }
        let mut may_be = vec![0; 5 * words];
        for marker in 0..5 {
            for (a, _) in places.iter().enumerate().filter(|(_, p)| reach.is_none_or(|r| r.holds(marker, p))) {
                may_be[marker * words + a / 64] |= 1 << (a % 64);
            }
        }
        SpacePoints { places, apart, may_be, words }
    }

    /// The points where a marker may be.
    fn of_marker(&self, marker: usize) -> &[u64] {
        &self.may_be[marker * self.words..][..self.words]
    }

    /// The points as far from this one as marker `j` is from marker `i`.
    fn apart(&self, point: usize, i: usize, j: usize) -> &[u64] {
        let (i, j) = (i.min(j), i.max(j));
        let pair = i * (7 - i) / 2 + j - 1;
        &self.apart[(point * PAIRS.len() + pair) * self.words..][..self.words]
    }

    /// Two markers and each of those after them on points as far apart as they are.
    fn triples(&self, (i, j): (usize, usize)) -> impl Iterator<Item = [Placed; 3]> {
        let of_third = move |k: usize| {
            let with_first = move |a: usize| {
                let with_second = move |b: usize| {
                    let both = self.apart(a, i, k).iter().zip(self.apart(b, j, k)).zip(self.of_marker(k));
                    bits(both.map(|((c, d), may)| c & d & may)).map(move |c| [(i, a), (j, b), (k, c)])
                };
                bits(self.apart(a, i, j).iter().zip(self.of_marker(j)).map(|(b, may)| b & may)).flat_map(with_second)
            };
            bits(self.of_marker(i).iter().copied()).flat_map(with_first)
        };
        (j + 1..5).flat_map(of_third)
    }

    /// Whether each of the other two markers may be on some point as far from these three as it is.
    fn hold_the_others(&self, triple: &[Placed; 3]) -> bool {
        let mut others = (0..5).filter(|marker| triple.iter().all(|(other, _)| other != marker));
        others.all(|marker| {
            let [a, b, c] = triple.map(|(other, point)| self.apart(point, other, marker));
            a.iter().zip(b).zip(c).zip(self.of_marker(marker)).any(|(((a, b), c), may)| a & b & c & may != 0)
        })
    }
}

/// The numbers of the bits that are set.
fn bits(words: impl Iterator<Item = u64>) -> impl Iterator<Item = usize> {
    words.enumerate().flat_map(|(k, word)| {
        std::iter::successors(Some(word), |left| Some(left & left.wrapping_sub(1)))
            .take_while(|left| *left != 0)
            .map(move |left| 64 * k + left.trailing_zeros() as usize)
    })
}

/// Refines a rough pose on the candidates; scores it by the tape it explains and counts the points that agree.
fn follow(view: &View, figure: &RacketFigure, seen: &Seen, rough: &Isometry3<f64>) -> Option<Followed> {
    let mut pose = *rough;
    let mut fitted = None;
    for gate in [GATE_PX, 4.0, 2.5] {
        let (mut observations, mut strength) = (Vec::with_capacity(10), 0.0);
        for (camera, marker, _, band) in seen.around(&pose, gate) {
            observations.push(MarkerObservation { camera, marker, point: ImagePoint { uv: band.uv, sd: Vector2::new(0.7, 0.7) } });
            strength += band.contrast;
        }
        let fit = fit_pose(view, figure, &observations, Some(&pose)).ok()?;
        pose = fit.global_from_racket;
        fitted = Some((observations.len(), strength, fit));
    }
    let (agree, strength, fit) = fitted?;
    // A candidate is good to about 0.7 px; more than three times that is another thing.
    if agree < LEAST_POINTS || fit.misfit() > 6.0 {
        return None;
    }
    Some(Followed { score: strength * (1.0 - 0.1 * fit.misfit().sqrt()), seen: agree, pose: fit })
}

/// What looks like tape in both pictures, and where a pose puts the tape.
struct Seen<'a> {
    patches: VisiblePatches,
    near: [Neighbours<'a>; 2],
}

impl Seen<'_> {
    /// The nearest candidate of each marker in each picture within `gate_px`, at most [`GATE_PX`], with its distance, px. A candidate serves once.
    fn around(&self, pose: &Isometry3<f64>, gate_px: f64) -> impl Iterator<Item = (CameraId, usize, f64, &BandCandidate)> {
        let nearest: [[Option<(usize, f64)>; 5]; 2] = {
            let patches = self.patches.at(pose);
            std::array::from_fn(|c| self.near[c].nearest(&patches[c], gate_px))
        };
        CameraId::BOTH.into_iter().flat_map(move |camera| {
            let c = camera.index();
            let found = move |marker: usize| nearest[c][marker].map(|(i, miss_px)| (camera, marker, miss_px, &self.near[c].candidates[i]));
            (0..5).filter_map(found)
        })
    }
}

/// The candidates near any place of a picture, without looking through all of them.
struct Neighbours<'a> {
    candidates: &'a [BandCandidate],
    /// Row by row of cells: candidates within [`GATE_PX`] of any of its pixels, in their own order.
    near: Vec<(usize, Vector2<f64>)>,
    /// Where those of each cell begin.
    begin: Vec<usize>,
    columns: usize,
    rows: usize,
}

impl<'a> Neighbours<'a> {
    const CELL_PX: f64 = 8.0;

    fn of(size: [usize; 2], candidates: &'a [BandCandidate]) -> Self {
        let count = |px: usize| (px as f64 / Self::CELL_PX).ceil() as usize + 1;
        let (columns, rows) = (count(size[0]), count(size[1]));
        let mut cells: Vec<(usize, usize)> = Vec::new();
        for (i, c) in candidates.iter().enumerate() {
            for row in Self::cell(c.uv.y - GATE_PX, rows)..=Self::cell(c.uv.y + GATE_PX, rows) {
                for column in Self::cell(c.uv.x - GATE_PX, columns)..=Self::cell(c.uv.x + GATE_PX, columns) {
                    cells.push((row * columns + column, i));
                }
            }
        }
        cells.sort_unstable();
        let begin = (0..=columns * rows).map(|cell| cells.partition_point(|c| c.0 < cell)).collect();
        Neighbours { candidates, near: cells.iter().map(|(_, i)| (*i, candidates[*i].uv)).collect(), begin, columns, rows }
    }

    /// Places outside the picture belong to its border: what lies within the gate of them does so too.
    fn cell(at: f64, n: usize) -> usize {
        ((at / Self::CELL_PX).max(0.0) as usize).min(n - 1)
    }

    /// The nearest candidate within `gate_px` of each place, and how far it is; none serves twice.
    fn nearest(&self, places: &[Vector2<f64>; 5], gate_px: f64) -> [Option<(usize, f64)>; 5] {
        let mut out = [None; 5];
        for (k, place) in places.iter().enumerate() {
            let cell = Self::cell(place.y, self.rows) * self.columns + Self::cell(place.x, self.columns);
            let mut best = (usize::MAX, gate_px * gate_px);
            for (i, uv) in &self.near[self.begin[cell]..self.begin[cell + 1]] {
                let square = (uv - place).norm_squared();
                if square < best.1 && out[..k].iter().flatten().all(|(used, _): &(usize, f64)| used != i) {
                    best = (*i, square);
                }
            }
            out[k] = (best.0 != usize::MAX).then(|| (best.0, best.1.sqrt()));
        }
        out
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::tests::rig;
    use nalgebra::{Translation3, Unit};
    use rand::{Rng, SeedableRng};

    /// Bands of a racket in both pictures.
    fn bands(view: &View, figure: &RacketFigure, pose: &Isometry3<f64>, contrast: f64) -> [Vec<BandCandidate>; 2] {
        CameraId::BOTH.map(|c| {
            let uv = |m: usize| view.patch(c, figure, m, pose).expect("seen");
            (0..5).map(|m| BandCandidate { uv: uv(m), contrast }).collect()
        })
    }

    #[test]
    fn truth_a_racket_is_found_where_it_can_have_got_to_and_no_clearer_one_elsewhere() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let turned = UnitQuaternion::from_euler_angles(0.3, 0.4, -0.5);
        let [here, elsewhere] = [(0.0, 0.9, -0.1), (0.1, 1.1, 0.7)].map(|(x, y, z)| Isometry3::from_parts(Translation3::new(x, y, z), turned));
        let mut seen = bands(&view, &figure, &elsewhere, 90.0);
        for (seen, more) in seen.iter_mut().zip(bands(&view, &figure, &here, 40.0)) {
            seen.extend(more);
        }
        let found = |reach: Option<Reach>| search(&view, &figure, &seen, reach.as_ref())[0].global_from_racket.translation.vector;
        assert!((found(None) - elsewhere.translation.vector).norm() < 0.01);
        // Three frames after it was 0.1 m away.
        let last = Isometry3::from_parts(Translation3::new(0.05, 0.85, -0.15), turned);
        let reach = Reach::of(&figure, &last, 0.003);
        assert!((found(Some(reach)) - here.translation.vector).norm() < 0.01);
        // In three frames it does not turn by a radian; the half turn about its long axis nobody sees.
        let tilted = |angle: f64, axis: Vector3<f64>| turned * UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), angle);
        assert!(reach.turns_to(&tilted(0.5, Vector3::y())) && !reach.turns_to(&tilted(1.0, Vector3::y())));
        assert!(reach.turns_to(&tilted(3.0, Vector3::x())) && !reach.turns_to(&tilted(3.0, Vector3::z())));
        // Its circle holds it in both pictures, and not the other one.
        for camera in CameraId::BOTH {
            let (centre, radius) = reach.circle(&view, camera).expect("seen");
            let farthest = |pose| bands(&view, &figure, pose, 1.0)[camera.index()].iter().map(|b| (b.uv - centre).norm()).fold(0.0, f64::max);
            assert!(farthest(&here) < radius && farthest(&elsewhere) > radius);
        }
    }

    #[test]
    fn truth_bits_are_counted_across_words() {
        assert_eq!(bits([0b1001, 0, 1 << 63].into_iter()).collect::<Vec<_>>(), [0, 3, 191]);
    }

    #[test]
    fn truth_pairs_of_points_as_far_apart_as_two_markers_are_marked() {
        let figure = figure();
        let places: Vec<Point3<f64>> = (0..80).map(|k| figure.points[k % 5] + Vector3::x() * 10.0 * (k / 5) as f64).collect();
        let points = SpacePoints::of(&figure, places, None);
        for (i, j) in PAIRS {
            for group in [0, 15] {
                let found: Vec<usize> = bits(points.apart(5 * group + i, i, j).iter().copied()).collect();
                assert!(found.contains(&(5 * group + j)) && found.iter().all(|k| k / 5 == group), "{i} {j}: {found:?}");
            }
        }
    }

    /// So many places around a racket that chance puts three of its markers on them a hundred thousand times.
    #[test]
    fn truth_a_racket_among_more_figures_than_are_followed_up_is_found_by_all_its_markers() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let pose = Isometry3::from_parts(Translation3::new(0.0, 0.9, -0.1), UnitQuaternion::from_euler_angles(0.3, 0.4, -0.5));
        let mut seen = bands(&view, &figure, &pose, 60.0);
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        // In a ball around it, so that both pictures show them.
        for _ in 0..65 {
            let place = pose * (Point3::from(figure.points[0]) + Vector3::from_fn(|_, _| rng.random_range(-0.2..0.2)));
            for (seen, camera) in seen.iter_mut().zip(CameraId::BOTH) {
                seen.push(BandCandidate { uv: view.project(camera, &place).expect("seen"), contrast: 50.0 });
            }
        }
        let points = SpacePoints::of(&figure, space_candidates(&view, &seen), None);
        let triples: usize = PAIRS.iter().map(|pair| points.triples(*pair).count()).sum();
        assert!(triples > 2 * MOST_TRIPLES, "{triples}");
        let found = search(&view, &figure, &seen, None)[0].global_from_racket;
        assert!((found.translation.vector - pose.translation.vector).norm() < 0.01, "{found} {pose}");
    }
}
