//! One band of the tape near the place where the racket's pose puts it: whole, half covered, cut by the picture's border, or a speck.

use crate::calibration::CameraId;
use crate::footage::GreyView;
use crate::tracking::racket::racket_scene::RacketScene;
use crate::tracking::tape::band::{self, BandFit, BandPart, BandView, SPECK_HALF_PX};
use nalgebra::{Isometry3, Vector2};

/// Least share of the usual contrast that still counts as tape.
pub const LEAST_CONTRAST: f64 = 0.45;
/// Of the usual least contrast, the least that is asked of a band in the shade.
const DEEPEST_SHADE: f64 = 0.5;
/// A band of which one half is covered must show this many times the least contrast: nearly that of the others.
const HALF_SEEN_CONTRAST: f64 = 1.6;
/// It must be this near to where the others say it is, px.
const HALF_SEEN_SHIFT_PX: f64 = 1.5;
/// One that is fitted from there though a pixel beside has more contrast, this near.
const SMALL_SHIFT_PX: f64 = 0.5;
/// A speck, or what the border leaves, must tell its place this well, px.
const SPECK_SD_PX: f64 = 0.7;
/// Of the least contrast, what a speck must show: how bright it is depends on how much of it is seen.
const SPECK_CONTRAST: f64 = 0.6;

/// The contrast a band must have: less than the others' where the known light leaves it in the shade.
pub(in crate::tracking) fn least_of(scene: &RacketScene, band: &BandView, least_contrast: f64) -> f64 {
    let lit = scene.shape.lit(band).map_or(least_contrast, |lit| LEAST_CONTRAST * lit);
    lit.max(DEEPEST_SHADE * least_contrast).min(least_contrast)
}

/// One band near its expected place.
pub(in crate::tracking) fn find(
    scene: &RacketScene,
    image: &GreyView,
    pose: &Isometry3<f64>,
    camera: CameraId,
    marker: usize,
    (reach_px, weak): (i32, bool),
    least_contrast: f64,
) -> Option<BandFit> {
    let band = BandView::at(scene.view, scene.figure, pose, camera, marker)?;
    let least_contrast = least_of(scene, &band, least_contrast);
    find_whole(scene, image, &band, (reach_px, weak), least_contrast).or_else(|| if weak { find_cut(scene, image, &band, least_contrast) } else { None })
}

/// One band near the picture's border, which cuts off some of it, right where the others say it is.
fn find_cut(scene: &RacketScene, image: &GreyView, band: &BandView, least_contrast: f64) -> Option<BandFit> {
    let inside = |uv: &Vector2<f64>, by: f64| image.holds(uv.x - by, uv.y - by) && image.holds(uv.x + by, uv.y + by);
    if inside(&band.centre, band.half_length(scene.shape)) || !inside(&band.centre, 0.0) || band.contrast_inside(image, scene.shape)? < least_contrast {
        return None;
    }
    let f = band::fit(image, band, scene.shape, (0.0, 0.0), BandPart::Inside, None)?;
    (f.white - f.black > least_contrast && is_sure(&f, band) && inside(&f.uv, 0.0)).then_some(f)
}

/// Whether a band of which little is seen tells its place, and one near to where the others say that it is.
fn is_sure(f: &BandFit, band: &BandView) -> bool {
    f.covariance.trace() < SPECK_SD_PX * SPECK_SD_PX && (f.uv - band.centre).norm() < HALF_SEEN_SHIFT_PX
}

/// One band of which all is in the picture; covered in part, or a speck, where `weak`.
fn find_whole(scene: &RacketScene, image: &GreyView, band: &BandView, (reach_px, weak): (i32, bool), least_contrast: f64) -> Option<BandFit> {
    let (t, s, contrast) = band.search(image, scene.shape, reach_px)?;
    match contrast >= least_contrast {
        true => fit_whole(scene, image, band, ((t, s), weak), least_contrast),
        false if weak => find_part(scene, image, band, least_contrast),
        false => None,
    }
}

/// One band of which all is seen, from the place of most contrast (along the tube and across) and from where it is expected.
fn fit_whole(scene: &RacketScene, image: &GreyView, band: &BandView, (peak, weak): ((f64, f64), bool), least_contrast: f64) -> Option<BandFit> {
    let fit = |start| band::fit(image, band, scene.shape, start, BandPart::Whole, None).filter(|f| f.white - f.black > least_contrast);
    let near = |f: &BandFit| (f.uv - band.centre).norm() < SMALL_SHIFT_PX;
    let from_peak = fit(peak);
    if peak == (0.0, 0.0) || from_peak.as_ref().map_or(!weak, near) {
        return from_peak;
    }
    // A pixel beside it a small band may have more contrast, and no way down to it; where the tube glitters at its edge the way leads there.
    let from_place = fit((0.0, 0.0));
    if weak && from_place.as_ref().is_some_and(near) {
        return from_place;
    }
    // What is not the band tells its place less sharply; the pose that all share decides about either.
    [from_peak, from_place].into_iter().flatten().min_by(|a, b| a.covariance.trace().total_cmp(&b.covariance.trace()))
}

/// One band of which a part is seen, right where the others say it is.
fn find_part(scene: &RacketScene, image: &GreyView, band: &BandView, least_contrast: f64) -> Option<BandFit> {
    // A racket seen edge-on shows the tape at its tip as a speck: fainter than a band, but its place is known from the others.
    if scene.shape.white_half_m * band.px_per_m < SPECK_HALF_PX {
        let f = band::fit(image, band, scene.shape, (0.0, 0.0), BandPart::Whole, None)?;
        return (f.white - f.black > SPECK_CONTRAST * least_contrast && is_sure(&f, band)).then_some(f);
    }
    // The ball or the arm may cover one of the black bands: the other and the white still tell the place, where the pose is known.
    let [ahead, behind] = band.contrasts(image, scene.shape, 0.0, 0.0)?;
    let (part, contrast) = if ahead > behind { (BandPart::Ahead, ahead) } else { (BandPart::Behind, behind) };
    let least_contrast = HALF_SEEN_CONTRAST * least_contrast;
    if contrast < least_contrast {
        return None;
    }
    let f = band::fit(image, band, scene.shape, (0.0, 0.0), part, None)?;
    (f.white - f.black > least_contrast && (f.uv - band.centre).norm() < HALF_SEEN_SHIFT_PX).then_some(f)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footage::GreyImage;
    use crate::tracking::racket::racket_figure::tests::figure;
    use crate::tracking::racket::racket_pose::View;
    use crate::tracking::racket::racket_pose::tests::rig;
    use crate::tracking::tape::band::{BandShape, USUAL_BLUR_PX};
    use nalgebra::{Translation3, UnitQuaternion};

    /// A marker's picture with tape that is brighter toward one edge (-1 or 1), by `peak` grey levels, and a tube that glitters at that edge beyond
    /// the black: 25 places a pixel, blurred.
    fn glittering(band: &BandView, shape: &BandShape, edge: f64, peak: f64) -> GreyImage {
        let (white, black) = (shape.white_half_m * band.px_per_m, (shape.white_half_m + shape.black_m) * band.px_per_m);
        let light = |place: Vector2<f64>| {
            let t = place.dot(&band.along).abs();
            let q = edge * place.dot(&Vector2::new(-band.along.y, band.along.x)) / band.radius_px;
            match q.abs() < 1.0 {
                true if t < white => 40.0 + peak * (0.5 + 0.5 * q),
                true if t > black && q > 0.55 => 190.0,
                true => 6.0,
                false => 14.0,
            }
        };
        let blurred = |at: Vector2<f64>| {
            let places = (-12..=12).flat_map(|i| (-12..=12).map(move |j| Vector2::new(f64::from(i), f64::from(j)) / 5.0));
            let weighed = places.map(|d| ((-d.norm_squared() / (2.0 * USUAL_BLUR_PX * USUAL_BLUR_PX)).exp(), light(at + d)));
            let (sum, weight) = weighed.fold((0.0, 0.0), |(sum, weight), (w, grey)| (sum + w * grey, weight + w));
            (sum / weight) as u8
        };
        let place = |i: usize| Vector2::new((i % 512) as f64, (i / 512) as f64) - band.centre;
        let pixels = (0..512 * 512).map(place).map(|at| if at.norm() < 24.0 { blurred(at) } else { 14 }).collect();
        GreyImage { width: 512, height: 512, pixels }
    }

    /// The pixel of most contrast lies toward the bright edge, from which the way down leads to the glitter, more than 1 px off.
    #[test]
    fn truth_tape_on_a_tube_that_glitters_is_found_where_the_other_bands_say() {
        let (rig, figure) = (rig(), figure());
        let view = View::new(&rig);
        let scene = RacketScene { view: &view, figure: &figure, shape: &BandShape::default() };
        let pose = Isometry3::from_parts(Translation3::new(0.0, 1.0, 0.0), UnitQuaternion::from_euler_angles(0.3, 1.3, -0.5));
        let (mut asked, mut right) = (0, 0);
        for (marker, edge, peak) in (0..3).flat_map(|m| [-1.0, 1.0].into_iter().flat_map(move |e| [120.0, 180.0, 230.0].map(|p| (m, e, p)))) {
            let band = BandView::at(&view, &figure, &pose, CameraId::Right, marker).expect("seen");
            let image = glittering(&band, scene.shape, edge, peak);
            for off in [[0.0, 0.0], [0.3, 0.2], [-0.3, 0.2], [0.2, -0.4]] {
                let expected = BandView { centre: band.centre + Vector2::from(off), ..band };
                let found = find_whole(&scene, &GreyView::of(&image), &expected, (1, true), 20.0);
                asked += 1;
                right += usize::from(found.is_some_and(|f| (f.uv - band.centre).norm() < 0.3));
            }
        }
        assert!(10 * right >= 9 * asked, "{right} of {asked}");
    }
}
