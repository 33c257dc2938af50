//! Racket and ball of a shot followed beside each other, so that no core waits for the other.
//!
//! Finding the racket and learning its light and figure is the work of one core; meanwhile the other takes the median pictures and looks
//! for the ball. Then four pieces are left, each of them one way of one of the two; whoever is free takes the next, the racket's first,
//! because they are the longest. Whoever has nothing to do until the racket is followed to its ends goes on with the ball meanwhile. What is
//! found does not depend on who did what.

use crate::footage::{FrameSource, GreyImage};
use crate::tracking::ball::ball_track::BallScene;
use crate::tracking::ball::shot_ball::{FirstLook, Tried};
use crate::tracking::pictures::background::background;
use crate::tracking::pictures::shot_frames::Shot;
use crate::tracking::racket::racket_follower::OneWay;
use crate::tracking::racket::shot_racket::RacketStart;
use crate::tracking::shot_tracks::TrackingError;
use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

/// What the pictures show before any of them is known to be stale.
pub struct SideBySide<'s> {
    pub start: RacketStart,
    /// Toward the clip's beginning and toward its end.
    pub racket: [OneWay; 2],
    /// What either camera sees when nothing moves.
    pub still: [Option<GreyImage>; 2],
    pub look: FirstLook<'s>,
}

/// One way of following one of the two: toward the clip's end or not.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Piece {
    Racket(bool),
    /// As far as it is tried.
    Ball(bool),
    /// Farther, while nothing else waits: the way of which most frames are left first, so that both come to their ends at once.
    BallFarther(Reverse<usize>, bool),
}

/// The ball is followed so many frames before it is asked again what waits.
const FARTHER: usize = 4;

/// A piece's result, once it is there.
type Slot<T> = Mutex<Option<Result<T, TrackingError>>>;

fn put<T>(slot: &Slot<T>, result: Result<T, TrackingError>) {
    if let Ok(mut slot) = slot.lock() {
        *slot = Some(result);
    }
}

fn taken<T>(slots: [Slot<T>; 2]) -> Result<Option<[T; 2]>, TrackingError> {
    let [back, forth] = slots.map(|slot| slot.into_inner().ok().flatten().transpose());
    Ok(back?.zip(forth?).map(|(back, forth)| [back, forth]))
}

/// Follows the racket with `shot`, which learns its light and figure, and tries out the ball of the first look with `watched`, which knows nothing
/// of the racket.
pub fn side_by_side<'a, 'c, 's, S: FrameSource>(shot: &'a mut Shot<'c, S>, watched: &Shot<S>, scene: &'s BallScene) -> Result<SideBySide<'s>, TrackingError> {
    let (started, looked) = (OnceLock::<(&'a Shot<'c, S>, RacketStart)>::new(), OnceLock::<FirstLook<'s>>::new());
    let (rackets, balls): ([Slot<OneWay>; 2], [Slot<Tried<'s>>; 2]) = Default::default();
    let waiting: Mutex<BTreeSet<Piece>> = Mutex::default();
    let next = || waiting.lock().ok()?.pop_first();
    let add = |piece: Piece| waiting.lock().map(|mut waiting| waiting.insert(piece)).unwrap_or_default();
    let racket_ways_left = AtomicUsize::new(2);
    let work = || {
        while let Some(piece) = next() {
            match piece {
                Piece::Racket(forth) => {
                    if let Some((shot, start)) = started.get() {
                        put(&rackets[usize::from(forth)], shot.follow_racket(start, forth));
                    }
                    racket_ways_left.fetch_sub(1, Ordering::Relaxed);
                }
                Piece::Ball(forth) => {
                    if let Some(look) = looked.get()
                        && let Some(flight) = look.flights.first()
                    {
                        let tried = watched.tried_out(scene, look.first, &flight.balls, forth);
                        let left = tried.as_ref().map_or(0, |tried| tried.follower.left());
                        put(&balls[usize::from(forth)], tried);
                        add(Piece::BallFarther(Reverse(left), forth));
                    }
                }
                Piece::BallFarther(_, forth) if racket_ways_left.load(Ordering::Relaxed) > 0 => {
                    let slot = &balls[usize::from(forth)];
                    let Some(Ok(mut tried)) = slot.lock().ok().and_then(|mut slot| slot.take_if(|tried| tried.is_ok())) else { continue };
                    let goes_on = watched.follow_on(&mut tried.follower, FARTHER);
                    let (again, left) = (matches!(goes_on, Ok(true)), tried.follower.left());
                    put(slot, goes_on.map(|_| tried));
                    if again {
                        add(Piece::BallFarther(Reverse(left), forth));
                    }
                }
                Piece::BallFarther(..) => {}
            }
        }
    };
    let share = |pieces: [Piece; 2]| {
        for piece in pieces {
            add(piece);
        }
        rayon::join(work, work);
    };
    let racket = || -> Result<(), TrackingError> {
        let learning = shot;
        let start = learning.first_candidates().and_then(|candidates| learning.start(candidates));
        if start.is_err() {
            racket_ways_left.store(0, Ordering::Relaxed);
        }
        let learnt: &Shot<S> = learning;
        let _ = started.set((learnt, start?));
        share([Piece::Racket(false), Piece::Racket(true)]);
        Ok(())
    };
    let ball = || -> Result<[Option<GreyImage>; 2], TrackingError> {
        let (left, right) = rayon::join(|| background(watched.source, 0), || background(watched.source, 1));
        let still = [left?, right?];
        let _ = looked.set(watched.first_look(scene, &still)?);
        share([Piece::Ball(false), Piece::Ball(true)]);
        Ok(still)
    };
    let (racket, still) = rayon::join(racket, ball);
    racket?;
    let (still, racket, ball) = (still?, taken(rackets)?, taken(balls)?);
    let (Some((_, start)), Some(mut look), Some(racket)) = (started.into_inner(), looked.into_inner(), racket) else { return Err(TrackingError::Cancelled) };
    look.tried = ball;
    Ok(SideBySide { start, racket, still, look })
}
