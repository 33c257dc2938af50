//! Which frames of free flight tell the ball's spin and teach its cover: a few next to the contact, evenly spread.

use super::contact_length::LONGEST_CONTACT_S;

/// Frames used on each side: more of them add little and take as long again.
const MOST_FRAMES: f64 = 24.0;
/// Time next to the contact over which they are spread, s, where the camera takes more frames within it: a spin is told the better the
/// farther the ball turns meanwhile.
const REACH_S: f64 = 24.0e-3;

/// Frames of free flight before (0) and after (1) the contact.
#[derive(Debug, Clone, Copy)]
pub(super) struct FlightSample {
    reach_s: f64,
    frame_rate_hz: f64,
    /// Every how many frames, by side.
    strides: [u64; 2],
}

impl FlightSample {
    /// From the frames that show the ball in space: number, and time after the contact in s.
    pub fn of(seen: impl Iterator<Item = (u64, f64)>, frame_rate_hz: f64) -> Self {
        let all = FlightSample { reach_s: REACH_S.max(MOST_FRAMES / frame_rate_hz), frame_rate_hz, strides: [1; 2] };
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
        let side = if (-self.reach_s..0.0).contains(&t) {
            0
        } else if (LONGEST_CONTACT_S..LONGEST_CONTACT_S + self.reach_s).contains(&t) {
            1
        } else {
            return None;
        };
        number.is_multiple_of(self.strides[side]).then_some(side)
    }

    /// Rate at which the sample's frames of either side follow each other.
    pub fn rates_hz(&self) -> [f64; 2] {
        self.strides.map(|stride| self.frame_rate_hz / stride as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(rate: f64, frames: std::ops::Range<i64>) -> ([usize; 2], [f64; 2]) {
        let all: Vec<(u64, f64)> = frames.map(|n| ((n + 1000) as u64, n as f64 / rate)).collect();
        let sample = FlightSample::of(all.iter().copied(), rate);
        let count = |side| all.iter().filter(|(n, t)| sample.side(*n, *t) == Some(side)).count();
        ([count(0), count(1)], sample.rates_hz())
    }

    #[test]
    fn a_faster_camera_spreads_as_many_frames_over_the_same_time() {
        assert_eq!(sample(1000.0, -60..60), ([24, 24], [1000.0; 2]));
        assert_eq!(sample(4000.0, -200..200), ([24, 24], [1000.0; 2]));
        assert_eq!(sample(500.0, -60..60), ([24, 24], [500.0; 2]));
    }

    #[test]
    fn a_short_flight_keeps_its_frames() {
        // 5 ms before the contact at 4000 frames a second.
        assert_eq!(sample(4000.0, -20..200), ([20, 24], [4000.0, 1000.0]));
    }
}
