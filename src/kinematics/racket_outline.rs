//! The racket's outline in its face: how far outside the strings a place lies, and by how much a ball there passes the racket.

use crate::equipment::{Ball, Head, Racket};
use nalgebra::Vector2;
use std::f64::consts::TAU;

/// Points of the strings' ellipse to which a distance is taken: half a degree apart, which is exact to 0.01 mm.
const POINTS: usize = 720;

/// Distance of a local place from the strung ellipse, m: above 0 outside, below 0 on the strings.
pub(super) fn outside_strings(head: &Head, place: &Vector2<f64>) -> f64 {
    let (a, b) = (0.5 * head.inner_length_m, 0.5 * head.inner_width_m);
    let edge = |k: usize| {
        let angle = TAU * k as f64 / POINTS as f64;
        Vector2::new(a * angle.cos(), b * angle.sin())
    };
    let nearest = (0..POINTS).map(|k| (edge(k) - place).norm()).fold(f64::INFINITY, f64::min);
    if head.is_strung_at(place) { -nearest } else { nearest }
}

/// By how much a ball whose centre is over the place passes the head, m; 0 or less where it touches it.
pub(super) fn past_head(racket: &Racket, ball: &Ball, place: &Vector2<f64>) -> f64 {
    outside_strings(&racket.head, place) - 2.0 * racket.head.tube_radius_m - ball.radius_m()
}

/// The same of the whole racket: throat and handle lie, as wide as the throat is at its markers, between the head and the butt. `place` is local, m from the
/// stringbed's centre.
pub fn past_racket(racket: &Racket, ball: &Ball, place: &Vector2<f64>) -> f64 {
    let throat = racket.markers.as_ref().map_or(0.0, |m| m.m4[1].abs().max(m.m5[1].abs())) + racket.head.tube_radius_m;
    let beyond = Vector2::new((-place.x).max(place.x - racket.stringbed_centre_m), place.y.abs() - throat);
    past_head(racket, ball, place).min(beyond.map(|d| d.max(0.0)).norm() - ball.radius_m())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_distances_along_the_axes_of_a_usual_racket() {
        let racket: Racket = toml::from_str(
            "name = \"r\"\nmass_kg = 0.33\nlength_m = 0.685\nbalance_m = 0.325\nstringbed_centre_m = 0.4975\nswingweight_kgm2 = 0.0325\n\
             twistweight_kgm2 = 0.0015\n[head]\ninner_length_m = 0.335\ninner_width_m = 0.255\n[strings]\ntension_lb = 60.0\n[markers]\n\
             m1 = [-0.1775, 0, 0]\nm2 = [0, -0.1375, 0]\nm3 = [0, 0.1375, 0]\nm4 = [0.2, -0.045, 0]\nm5 = [0.2, 0.045, 0]\n",
        )
        .expect("racket");
        let ball: Ball = toml::from_str("name = \"b\"\nmass_kg = 0.0577\ndiameter_m = 0.066\ninertia_factor = 0.6667\n").expect("ball");
        // From the strings' half lengths 0.1675 and 0.1275 m; two tube radii and a ball's radius farther, 0.053 m, nothing is met.
        for (x, y, outside, past) in [
            (0.0, 0.0, -0.1275, -0.1805),
            (0.0, -0.1375, 0.010, -0.043),
            (0.0, 0.1905, 0.063, 0.010),
            (-0.1775, 0.0, 0.010, -0.043),
            (-0.25, 0.0, 0.0825, 0.0295),
            // Between throat and butt: the shaft, 0.055 m either way.
            (0.30, 0.0, 0.1325, -0.033),
            (0.30, 0.10, f64::NAN, 0.012),
            (0.5475, 0.0, 0.38, 0.017),
        ] {
            let place = Vector2::new(x, y);
            assert!(outside.is_nan() || (outside_strings(&racket.head, &place) - outside).abs() < 1e-5, "{place}");
            assert!((past_racket(&racket, &ball, &place) - past).abs() < 1e-5, "{place} {}", past_racket(&racket, &ball, &place));
        }
    }
}
