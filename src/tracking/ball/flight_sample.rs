//! Which frames of free flight tell the ball's spin and teach its cover: a few next to the contact, evenly spread.

use crate::tracking::ball::contact_length::LONGEST_CONTACT_S;

/// Frames used on each side: more of them add little and take as long again.
const MOST_FRAMES: f64 = 24.0;
/// Time next to the contact over which they are spread, s, where the camera takes more frames within it: a spin is told the better the
/// farther the ball turns meanwhile.
const REACH_S: f64 = 24.0e-3;
/// The same of a ball that turns slowly: so long that it turns by this from one frame of the sample to the next, rad,
const TURN_RAD: f64 = 0.35;
/// and no longer than this, s: air brakes a spin by some hundredths in a second.
const LONGEST_REACH_S: f64 = 96.0e-3;

/// Frames of free flight before (0) and after (1) the contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::tracking) struct FlightSample {
    reach_s: [f64; 2],
    frame_rate_hz: f64,
    /// Every how many frames, by side.
    strides: [u64; 2],
}

impl FlightSample {
    /// From the frames that show the ball in space: number, and time after the contact in s. `fastest` is how fast the ball may turn on either
    /// side, rad/s, where that is known; `free_s` ends the sample at the bounces next to the strings: the court gives a ball another spin.
    pub fn of(seen: impl Iterator<Item = (u64, f64)>, frame_rate_hz: f64, fastest: [Option<f64>; 2], free_s: [f64; 2]) -> Self {
        let usual = REACH_S.max(MOST_FRAMES / frame_rate_hz);
        let reach_s = fastest.map(|rate| rate.map_or(usual, |rate| (MOST_FRAMES * TURN_RAD / rate).min(LONGEST_REACH_S).max(usual)));
        let reach_s = [reach_s[0].min(free_s[0]), reach_s[1].min(free_s[1] - LONGEST_CONTACT_S)];
        let all = FlightSample { reach_s, frame_rate_hz, strides: [1; 2] };
        let mut ends: [Option<(u64, u64)>; 2] = [None; 2];
        for (number, t) in seen {
            if let Some(side) = all.side(number, t) {
                let (first, last) = ends[side].unwrap_or((number, number));
                ends[side] = Some((first.min(number), last.max(number)));
            }
        }
        let strides = ends.map(|ends| ends.map_or(1, |(first, last)| (((last - first + 1) as f64 / MOST_FRAMES).round() as u64).max(1)));
        FlightSample { strides, ..all }
    }

    /// The side to which a frame so long after the contact, s, belongs, if it is one of the sample.
    pub fn side(&self, number: u64, t: f64) -> Option<usize> {
        let side = if (-self.reach_s[0]..0.0).contains(&t) {
            0
        } else if (LONGEST_CONTACT_S..LONGEST_CONTACT_S + self.reach_s[1]).contains(&t) {
            1
        } else {
            return None;
        };
        number.is_multiple_of(self.strides[side]).then_some(side)
    }

    /// Takes over the frames that another sample has on one side.
    pub fn take_side(&mut self, side: usize, other: &FlightSample) {
        (self.reach_s[side], self.strides[side]) = (other.reach_s[side], other.strides[side]);
    }

    /// Rate at which the sample's frames of either side follow each other.
    pub fn rates_hz(&self) -> [f64; 2] {
        self.strides.map(|stride| self.frame_rate_hz / stride as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(rate: f64, frames: std::ops::Range<i64>, fastest: [Option<f64>; 2]) -> ([usize; 2], [f64; 2]) {
        let all: Vec<(u64, f64)> = frames.map(|n| ((n + 1000) as u64, n as f64 / rate)).collect();
        let sample = FlightSample::of(all.iter().copied(), rate, fastest, [f64::INFINITY; 2]);
        let count = |side| all.iter().filter(|(n, t)| sample.side(*n, *t) == Some(side)).count();
        ([count(0), count(1)], sample.rates_hz())
    }

    #[test]
    fn a_faster_camera_spreads_as_many_frames_over_the_same_time() {
        assert_eq!(sample(1000.0, -60..60, [None; 2]), ([24, 24], [1000.0; 2]));
        assert_eq!(sample(4000.0, -200..200, [None; 2]), ([24, 24], [1000.0; 2]));
        assert_eq!(sample(500.0, -60..60, [None; 2]), ([24, 24], [500.0; 2]));
    }

    #[test]
    fn a_short_flight_keeps_its_frames() {
        // 5 ms before the contact at 4000 frames a second.
        assert_eq!(sample(4000.0, -20..200, [None; 2]), ([20, 24], [4000.0, 1000.0]));
    }

    #[test]
    fn a_bounce_ends_the_sample() {
        let all: Vec<(u64, f64)> = (-60..60).map(|n: i64| ((n + 1000) as u64, n as f64 / 1000.0)).collect();
        let sample = FlightSample::of(all.iter().copied(), 1000.0, [Some(10.0); 2], [0.0125, 0.0305]);
        let count = |side| all.iter().filter(|(n, t)| sample.side(*n, *t) == Some(side)).count();
        assert_eq!([count(0), count(1)], [12, 24]);
    }

    #[test]
    fn a_slow_spin_is_looked_at_for_longer() {
        // 0.35 rad from frame to frame: 2 ms at 170 rad/s; 10 rad/s would want 35 ms, and the sample ends after 96 ms.
        assert_eq!(sample(1000.0, -150..150, [Some(170.0), Some(10.0)]), ([24, 24], [500.0, 250.0]));
        assert_eq!(sample(1000.0, -150..150, [Some(400.0), None]), ([24, 24], [1000.0, 1000.0]));
        // A flight seen for 50 ms gives no more.
        assert_eq!(sample(1000.0, -50..150, [Some(10.0), None]), ([25, 24], [500.0, 1000.0]));
    }
}
