//! The racket of a shot: found in some frame, its light and figure learnt there, from where it is followed both ways.

use crate::calibration::CameraId;
use crate::footage::{FrameBuffer, FrameSource, GreyView};
use crate::median::upper_median;
use crate::tracking::pictures::recording::{Fingerprint, Fingerprints};
use crate::tracking::pictures::shot_frames::{Shot, spread};
use crate::tracking::racket::band_near::LEAST_CONTRAST;
use crate::tracking::racket::racket_figure::RacketFigure;
use crate::tracking::racket::racket_follower::OneWay;
use crate::tracking::racket::racket_scene::RacketFrame;
use crate::tracking::racket::racket_search;
use crate::tracking::racket::racket_track;
use crate::tracking::shot_tracks::TrackingError;
use crate::tracking::tape::band::{BandView, USUAL_BLUR_PX};
use crate::tracking::tape::band_search::{self, BandCandidate, MOST};
use crate::tracking::tape::tape_blur::{BlurEvidence, out_of_focus};
use crate::tracking::tape::tape_length;
use crate::tracking::tape::tape_light::TapeLight;
use crate::tracking::tape::throat::ThroatEvidence;
use crate::tracking::tape::throat_bend::BendEvidence;
use crate::tracking::tape::tube_width::WidthEvidence;
use nalgebra::Isometry3;
use rayon::prelude::*;

/// Frames whose pictures are asked for the direction of the throat.
const THROAT_FRAMES: usize = 8;
/// The same for its width and its bend: the first frame found and those after it.
const WIDTH_FRAMES: usize = 4;
/// Times that widths are tried around the widest or the narrowest tried before: from 0.55 to 1.3 of the head's.
const FARTHER_WIDTHS: usize = 2;
/// Rounds in which the light on the tape is found.
const LIGHT_ROUNDS: usize = 2;
/// How far the pose of a racket just found may be off, px.
pub(in crate::tracking) const START_REACH_PX: i32 = 2;
/// The same of one measured before.
const MEASURED_REACH_PX: i32 = 1;
/// The candidate to which the bands of a racket just found are compared, strongest first (those along lines after the others where they crowd).
const STRONG: usize = 9;
/// A racket is clear when its bands have more than this share of that candidate's contrast: 0.9 to 3.1 on practice and rendered
/// sessions, figures of noise 0.03 to 0.3.
const CLEAR_STRENGTH: f64 = 0.6;
/// And when both cameras together show so many of its ten bands (one marker may be hidden): figures of letters have six or seven.
const CLEAR_BANDS: usize = 8;
/// Bands of a racket miss the pose they share by less than this, px: 0.03 to 0.13 of three tapes alone, a triangle of other markers that differs by
/// 4 mm from theirs, with or without a seventh band by chance, by 0.2 to 0.7.
const AGREEING_PX: f64 = 0.15;
/// Unclear rackets looked at before other likely figures of as many frames are asked, and the best of them is taken.
const DOUBTFUL_STARTS: usize = 16;
/// Frames beside those that a stale picture has spoilt, which tell how the racket moves there.
const BESIDE_STALE: usize = 8;
/// Places of a picture that look like tape before those that keep their place, or cannot be the racket's, are left out.
pub(in crate::tracking) const MOST_BEFORE_SOME_GO: usize = 400;
/// What keeps its place moves by less than this, px,
pub(in crate::tracking) const STILL_PX: f64 = 1.5;
/// in so large a share of the frames.
const STILL_SHARE: f64 = 0.6;
/// The racket where it was found, and the contrast its bands must have, by camera.
pub struct RacketStart {
    pub(in crate::tracking) index: usize,
    pub(in crate::tracking) frame: RacketFrame,
    pub(in crate::tracking) least_contrast: [f64; 2],
    /// Told from everything else in the pictures; otherwise it is what looked most like a racket.
    pub(in crate::tracking) clear: bool,
}

impl RacketStart {
    /// How strong its bands are beside what else looks like tape in the same pictures, in the camera where they are weaker: noise along a
    /// white line, or between lines, makes figures too, of bands much fainter than the tape's, in one camera more than in the other.
    fn strength(&self, candidates: &[Vec<BandCandidate>; 2]) -> f64 {
        let of = |camera: usize| {
            let strong = candidates[camera].get(STRONG).or(candidates[camera].last())?.contrast;
            Some(self.least_contrast[camera] / (LEAST_CONTRAST * strong))
        };
        (0..2).filter_map(of).fold(f64::INFINITY, f64::min)
    }

    fn is_clear(&self, strength: f64) -> bool {
        strength > CLEAR_STRENGTH && self.frame.count() >= CLEAR_BANDS
    }

    fn told_clearly(self) -> Self {
        RacketStart { clear: true, ..self }
    }
}

/// Whether most other frames have a candidate at the same place.
fn stands_still(candidate: &BandCandidate, others: &[&[BandCandidate]]) -> bool {
    let seen = others.iter().filter(|frame| frame.iter().any(|c| (c.uv - candidate.uv).norm() < STILL_PX)).count();
    seen as f64 > STILL_SHARE * others.len() as f64
}

impl<S: FrameSource> Shot<'_, S> {
    /// What may be tape in the frame that is searched first; nothing where one of its pictures is missing.
    pub(in crate::tracking) fn first_candidates(&self) -> Result<Option<[Vec<BandCandidate>; 2]>, TrackingError> {
        self.candidates_in(spread(self.source.len()).first().copied().unwrap_or_default(), MOST)
    }

    /// The racket in some frame, with its light and figure.
    pub(in crate::tracking) fn start(&mut self, first: Option<[Vec<BandCandidate>; 2]>) -> Result<RacketStart, TrackingError> {
        let start = self.acquire_racket(first)?;
        let clear = start.clear;
        let start = self.light_tape(start)?;
        let start = self.focus_tape(start)?;
        let start = self.measure_tape(start)?;
        // One frame tells the throat's direction to a degree or two, and the bands are followed with it; several tell it better.
        let start = self.turn_throat(start)?;
        let start = self.shape_throat(start)?;
        // Bands thought too wide show another light.
        Ok(RacketStart { clear, ..self.light_tape(start)? })
    }

    /// Finds the racket in some frame: the middle first (of which candidates may be known), then halves, quarters, ... until one is clear;
    /// the best of those found when none is.
    fn acquire_racket(&self, mut first: Option<[Vec<BandCandidate>; 2]>) -> Result<RacketStart, TrackingError> {
        let (mut searched, mut most) = (0, [0, 0]);
        let mut found: Vec<(f64, RacketStart)> = Vec::new();
        for index in spread(self.source.len()) {
            let candidates = match first.take() {
                Some(candidates) => candidates,
                None => match self.candidates_in(index, MOST)? {
                    Some(candidates) => candidates,
                    None => continue,
                },
            };
            searched += 1;
            for c in 0..2 {
                most[c] = most[c].max(candidates[c].len());
            }
            let poses = racket_search::search(self.view, &self.figure, &candidates, None);
            let starts: Result<Vec<_>, _> = poses.iter().map(|pose| self.confirm(index, &pose.global_from_racket)).collect();
            let Some(start) = starts?.into_iter().flatten().min_by(|a, b| a.frame.miss_px().total_cmp(&b.frame.miss_px())) else { continue };
            let strength = start.strength(&candidates);
            if start.is_clear(strength) {
                return Ok(start.told_clearly());
            }
            found.push((strength, start));
            if found.len() == DOUBTFUL_STARTS {
                break;
            }
        }
        if let Some(start) = self.racket_among_figures()? {
            return Ok(start);
        }
        // Bands as strong as tape that agree on one pose, as many as can be; of as many the strongest, or of strong ones those that agree best.
        let likeness = |(strength, start): &(f64, RacketStart)| {
            let (strong, miss_px) = (*strength > CLEAR_STRENGTH, start.frame.miss_px());
            (strong, strong && miss_px < AGREEING_PX, start.frame.count(), if strong { -miss_px } else { *strength })
        };
        let best = found.into_iter().max_by(|a, b| likeness(a).partial_cmp(&likeness(b)).unwrap_or(std::cmp::Ordering::Equal));
        best.map(|(_, start)| start).ok_or(TrackingError::NoRacket { searched, left: most[0], right: most[1] })
    }

    /// A clear racket where the likeliest figure of a frame is none: among all that looks like tape and does not keep its place, as lettering does.
    /// (A racket that hangs still is found in a frame in which it moves.)
    fn racket_among_figures(&self) -> Result<Option<RacketStart>, TrackingError> {
        let mut frames = Vec::new();
        for index in spread(self.source.len()).into_iter().take(DOUBTFUL_STARTS) {
            if let Some(candidates) = self.candidates_in(index, MOST_BEFORE_SOME_GO)? {
                frames.push((index, candidates));
            }
        }
        for (index, candidates) in &frames {
            let moving = [0, 1].map(|camera| {
                let others: Vec<&[BandCandidate]> = frames.iter().filter(|(i, _)| i != index).map(|(_, c)| c[camera].as_slice()).collect();
                candidates[camera].iter().filter(|c| !stands_still(c, &others)).take(MOST).copied().collect()
            });
            for pose in racket_search::search_all(self.view, &self.figure, &moving) {
                let start = self.confirm(*index, &pose.global_from_racket)?.filter(|s| s.is_clear(s.strength(&moving)));
                if let Some(start) = start {
                    return Ok(Some(start.told_clearly()));
                }
            }
        }
        Ok(None)
    }

    /// What may be tape in both pictures of a frame, at most so many places in each; nothing where one is missing.
    fn candidates_in(&self, index: usize, most: usize) -> Result<Option<[Vec<BandCandidate>; 2]>, TrackingError> {
        self.with_buffers(|buffers| {
            let [Some(l), Some(r)] = &self.read(index, buffers)? else { return Ok(None) };
            Ok(Some(self.band_candidates([l, r], most)))
        })
    }

    /// What may be tape in either picture.
    fn band_candidates(&self, images: [&GreyView; 2], most: usize) -> [Vec<BandCandidate>; 2] {
        let of = |camera: CameraId| band_search::candidates(images[camera.index()], 0..usize::MAX, self.px_per_m(camera), self.shape.white_half_m, 0.0, most);
        let (left, right) = rayon::join(|| of(CameraId::Left), || of(CameraId::Right));
        [left, right]
    }

    /// A racket is believed when the bands themselves, not only candidate places, agree on one pose.
    fn confirm(&self, index: usize, pose: &Isometry3<f64>) -> Result<Option<RacketStart>, TrackingError> {
        self.look_around(index, pose, START_REACH_PX, |images| self.confirm_in(index, images, pose))
    }

    /// What is seen in a frame's pictures around a pose that may be off by so much, in the rows that [`racket_track::measure`] looks at.
    fn look_around<R>(&self, index: usize, pose: &Isometry3<f64>, reach_px: i32, look: impl FnOnce(&[Option<GreyView>; 2]) -> R) -> Result<R, TrackingError> {
        let rows = CameraId::BOTH.map(|c| self.scene().rows(c, pose, reach_px));
        self.with_buffers(|buffers| Ok(look(&self.read_rows(index, rows, buffers)?)))
    }

    fn confirm_in(&self, index: usize, images: &[Option<GreyView>; 2], pose: &Isometry3<f64>) -> Option<RacketStart> {
        let scene = self.scene();
        let frame = racket_track::measure(&scene, images, pose, START_REACH_PX, &[4.0, 4.0])?;
        if frame.count() < 6 || frame.pose.misfit() > 40.0 {
            return None;
        }
        let mut least_contrast = [0.0; 2];
        for camera in CameraId::BOTH {
            let image = images[camera.index()].as_ref()?;
            let contrasts = (0..5)
                .filter(|m| frame.points[camera.index()][*m].is_some())
                .filter_map(|m| BandView::at(self.view, &self.figure, &frame.pose.global_from_racket, camera, m)?.contrast(image, &self.shape, 0.0, 0.0));
            least_contrast[camera.index()] = LEAST_CONTRAST * upper_median(contrasts)?;
        }
        Some(RacketStart { index, frame, least_contrast, clear: false })
    }

    /// The start with the light as its bands show it: the first time every band tells its own brightness, then what the light leaves over.
    fn light_tape(&mut self, mut start: RacketStart) -> Result<RacketStart, TrackingError> {
        let known = self.shape;
        (self.shape.light, self.shape.black_shaded) = (None, false);
        for _ in 0..LIGHT_ROUNDS {
            let pose = start.frame.pose.global_from_racket;
            let Some(light) = self.look_around(start.index, &pose, START_REACH_PX, |images| TapeLight::of(&self.scene(), images, &start.frame))? else { break };
            let before = self.shape;
            self.shape.light = Some(light);
            let Some(again) = self.confirm(start.index, &pose)? else {
                self.shape = before;
                break;
            };
            start = again;
        }
        if self.shape.light.is_none() {
            self.shape = known;
        }
        self.shape.black_shaded = self.shape.light.is_some();
        Ok(start)
    }

    /// The start with the pictures as sharp as their tape shows them.
    fn focus_tape(&mut self, start: RacketStart) -> Result<RacketStart, TrackingError> {
        let mut blur = BlurEvidence::wide();
        self.look_again(start.index, &start.frame, |images| blur.add(&self.scene(), images, &start.frame))?;
        let (before, usual) = (self.blur_px, self.shape);
        self.set_blur(blur.blur_px(before));
        if self.shape == usual {
            return Ok(start);
        }
        let again = self.confirm_again(&start)?;
        if again.is_none() {
            self.set_blur(before);
        }
        Ok(again.unwrap_or(start))
    }

    /// Bands are fitted with the usual blur as long as pictures are in focus: between 0.5 and 0.75 px it makes no difference to their places.
    fn set_blur(&mut self, blur_px: [f64; 2]) {
        self.blur_px = blur_px;
        self.shape.blur_px = blur_px.map(|tape| out_of_focus(USUAL_BLUR_PX, tape));
    }

    /// The start with the white tape as long as its bands show it.
    fn measure_tape(&mut self, start: RacketStart) -> Result<RacketStart, TrackingError> {
        let white_half_m = self.look_again(start.index, &start.frame, |images| tape_length::white_half_m(&self.scene(), images, &start.frame))?;
        let before = std::mem::replace(&mut self.shape.white_half_m, white_half_m);
        let again = self.confirm_again(&start)?;
        if again.is_none() {
            self.shape.white_half_m = before;
        }
        Ok(again.unwrap_or(start))
    }

    /// The start with the throat's direction as its pictures show it.
    fn turn_throat(&mut self, start: RacketStart) -> Result<RacketStart, TrackingError> {
        let Some(figure) = self.throat_of(ThroatEvidence::wide(), &[(start.index, &start.frame)])? else { return Ok(start) };
        self.confirm_with(start, figure)
    }

    /// The figure with the throat's direction as the pictures of a few of these frames show it.
    pub(in crate::tracking) fn throat_of(&self, none: ThroatEvidence, frames: &[(usize, &RacketFrame)]) -> Result<Option<RacketFigure>, TrackingError> {
        let looked_at = frames.len().min(THROAT_FRAMES);
        let of_frame = |k: usize| {
            let (index, frame) = frames[k * frames.len() / looked_at];
            let mut evidence = none.clone();
            self.look_again(index, frame, |images| evidence.add(&self.scene(), images, frame)).map(|()| evidence)
        };
        let parts: Result<Vec<ThroatEvidence>, TrackingError> = (0..looked_at).into_par_iter().with_max_len(1).map(of_frame).collect();
        let mut evidence = none.clone();
        parts?.iter().for_each(|part| evidence.join(part));
        Ok(evidence.angle(&self.figure).map(|(angle, _)| self.figure.with_throat(angle)))
    }

    /// The pictures of the bands of a frame measured before.
    fn look_again<R>(&self, index: usize, frame: &RacketFrame, look: impl FnOnce(&[Option<GreyView>; 2]) -> R) -> Result<R, TrackingError> {
        self.look_around(index, &frame.pose.global_from_racket, MEASURED_REACH_PX, look)
    }

    /// The start with the throat's width and bend as its pictures and the next ones show them, and these as sharp as they are.
    fn shape_throat(&mut self, start: RacketStart) -> Result<RacketStart, TrackingError> {
        let next = self.follow_racket_one_way(&start, (start.index + 1..self.source.len()).take(WIDTH_FRAMES - 1))?.0;
        let frames: Vec<(usize, &RacketFrame)> = std::iter::once((start.index, &start.frame)).chain(next.iter().map(|(i, f)| (*i, f))).collect();
        let before = self.figure.clone();
        let mut tried = 1.0;
        let (mut width, mut bend, mut blur) = self.throat_shape(&frames)?;
        for _ in 0..FARTHER_WIDTHS {
            let Some(beyond) = width.beyond() else { break };
            tried *= beyond;
            self.figure = before.with_throat_width(tried);
            (width, bend, blur) = self.throat_shape(&frames)?;
        }
        self.figure = before;
        self.set_blur(blur.blur_px(self.blur_px));
        let shaped = self.figure.with_throat_width(width.throat_to_head(tried)).with_throat_bend(bend.bend());
        self.confirm_with(start, shaped)
    }

    /// What the pictures of frames say about the throat's width and bend, and how sharp they are.
    fn throat_shape(&self, frames: &[(usize, &RacketFrame)]) -> Result<(WidthEvidence, BendEvidence, BlurEvidence<5>), TrackingError> {
        let none = || (WidthEvidence::none(), BendEvidence::none(), BlurEvidence::near(self.blur_px));
        let of_frame = |(index, frame): &(usize, &RacketFrame)| {
            let (mut width, mut bend, mut blur) = none();
            let look = |images: &[Option<GreyView>; 2]| {
                width.add(&self.scene(), images, frame);
                bend.add(&self.scene(), images, frame);
                blur.add(&self.scene(), images, frame);
            };
            self.look_again(*index, frame, look).map(|()| (width, bend, blur))
        };
        let parts: Result<Vec<_>, TrackingError> = frames.par_iter().with_max_len(1).map(of_frame).collect();
        let (mut width, mut bend, mut blur) = none();
        for (w, b, sharp) in &parts? {
            width.join(w);
            bend.join(b);
            blur.join(sharp);
        }
        Ok((width, bend, blur))
    }

    /// The start measured once more; `None` when its bands no longer agree.
    fn confirm_again(&self, start: &RacketStart) -> Result<Option<RacketStart>, TrackingError> {
        self.confirm(start.index, &start.frame.pose.global_from_racket)
    }

    /// The start measured once more with another figure, which stays if the bands agree.
    fn confirm_with(&mut self, start: RacketStart, figure: RacketFigure) -> Result<RacketStart, TrackingError> {
        let before = std::mem::replace(&mut self.figure, figure);
        let again = self.confirm_again(&start)?;
        if again.is_none() {
            self.figure = before;
        }
        Ok(again.unwrap_or(start))
    }

    /// The racket of all frames, and every picture's fingerprint.
    pub(in crate::tracking) fn both_ways(&self, start: &RacketStart, ways: [OneWay; 2]) -> Result<(Vec<Option<RacketFrame>>, Fingerprints), TrackingError> {
        let n = self.source.len();
        let mut all = vec![None; n];
        all[start.index] = Some(start.frame.clone());
        let mut prints = vec![[None, None]; n];
        prints[start.index] = self.look_again(start.index, &start.frame, |images| images.map(|v| v.map(|v| Fingerprint::of(&v))))?;
        for (frames, seen) in ways {
            for (index, frame) in frames {
                all[index] = Some(frame);
            }
            for (index, print) in seen {
                prints[index] = print;
            }
        }
        Ok((all, prints))
    }

    /// Measures the frames with a stale picture again, from the other camera alone, and looks again into those beside them in which the racket was lost:
    /// followed with that picture, it was expected elsewhere.
    pub(in crate::tracking) fn remeasure_stale(&self, start: &RacketStart, racket: &mut [Option<RacketFrame>]) -> Result<(), TrackingError> {
        let mut buffers = [FrameBuffer::default(), FrameBuffer::default()];
        let stale = |index: &usize| self.stale.get(*index).is_some_and(|stale| stale.contains(&true));
        for index in (0..racket.len()).filter(stale) {
            let pose = |i: Option<usize>| racket.get(i?)?.as_ref().map(|r| r.pose.global_from_racket);
            racket[index] = match (pose(index.checked_sub(1)), pose(Some(index + 1))) {
                (Some(a), Some(b)) => {
                    let images = self.read(index, &mut buffers)?;
                    racket_track::measure(&self.scene(), &images, &a.lerp_slerp(&b, 0.5), 2, &start.least_contrast)
                }
                _ => None,
            };
        }
        let lost: Vec<usize> = (0..racket.len()).filter(|index| racket[*index].is_none()).collect();
        for gap in lost.chunk_by(|a, b| a + 1 == *b).filter(|gap| gap.iter().any(stale)) {
            let (first, last) = (gap[0], gap[gap.len() - 1]);
            self.follow_into(start, first..=last, (0..first).rev(), racket)?;
            self.follow_into(start, (first..=last).rev(), last + 1..racket.len(), racket)?;
        }
        Ok(())
    }

    /// Follows it into frames without it from those beside them, the nearest first.
    fn follow_into(
        &self,
        start: &RacketStart,
        frames: impl Iterator<Item = usize>,
        beside: impl Iterator<Item = usize>,
        racket: &mut [Option<RacketFrame>],
    ) -> Result<(), TrackingError> {
        let known: Vec<(usize, &RacketFrame)> = beside.map_while(|index| Some((index, racket[index].as_ref()?))).take(BESIDE_STALE).collect();
        let (Some((index, nearest)), Some((farthest, nearer))) = (known.first(), known.split_last()) else { return Ok(()) };
        let mut motion = self.found_at(farthest.0, farthest.1);
        nearer.iter().rev().for_each(|(index, frame)| motion.go_on(self.source.number(*index) as f64, frame));
        let found = RacketStart { index: *index, frame: (*nearest).clone(), ..*start };
        let unseen: Vec<usize> = frames.take_while(|index| racket[*index].is_none()).collect();
        for (index, frame) in self.follow_racket_through(&found, Some(motion), unseen.into_iter(), false)?.0 {
            racket[index] = Some(frame);
        }
        Ok(())
    }
}
