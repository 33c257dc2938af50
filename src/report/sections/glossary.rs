//! Words of the report for someone who meets them first.

use crate::report::markup::{escape, prose};
use crate::report::page::Section;
use std::fmt::Write;

/// Term and meaning, in one or two plain sentences.
const WORDS: [(&str, &str); 22] = [
    (
        "racket axes x, y, z",
        "Origin at the stringbed centre; x points to the handle, y across the face from marker 2 to marker 3, z out of the strings. Velocities along them are those seen from the ground, only resolved along the racket's directions.",
    ),
    ("global axes U, V, W", "U along the court to the net, V up, W across the court; from the three-sphere frame."),
    (
        "standard deviation (sd), ±",
        "How far repeated measurements would typically lie from the true value. Two of them to each side hold the truth about 95 times in 100.",
    ),
    ("95 % interval, 95 % band", "A range made so that it holds the true value in 95 of 100 such experiments."),
    ("residual", "Measured less predicted. In “own sd” it is divided by its standard deviation, so that 1 is an ordinary miss and 4 a rare one."),
    (
        "noise floor",
        "The error that even a perfect model would show, because the measurements scatter; 1 when the stated noise is right. `compare` takes it from one model's residuals, smooth trends taken out: where that model fails this is an upper bound. `diagnose` takes the least that any model it tried leaves.",
    ),
    ("held-out impacts", "Impacts the fit never sees, always the same ones, picked by a hash of their id. An error that falls on them has fallen in earnest."),
    ("reduced χ²", "Mean square of the residuals in own sd; about 1 for a sound model."),
    ("p-value", "How often chance alone would give a result at least this odd, if nothing were wrong."),
    ("structure test", "Asks whether the residuals depend on anything measured, in any smooth way, before any particular effect is suspected."),
    ("effect", "A named piece of physics, or a measuring error that looks like one, that can be added to the model."),
    ("alias", "Another effect that explains this data about as well; only further impacts can tell them apart."),
    ("probability of a candidate", "How likely it is among the candidates looked at, given the data; it says nothing of causes nobody listed."),
    ("restitution (COR)", "Speed of separation over speed of approach at the contact point, along the normal."),
    ("apparent restitution (ACOR)", "Ball speed after over ball speed before, relative to the racket's contact point before the impact."),
    ("effective mass", "The mass a point of the racket seems to have when the ball strikes it there; greatest at the centre of mass."),
    ("centre of percussion", "A hit there leaves the hand's place at rest: no jar at the wrist."),
    ("node point", "The place on the strings where the frame's first vibration has no motion: a hit there does not sting."),
    ("ideal point", "The place that would have given the ball most speed in this very stroke."),
    ("dead spot", "The place whose effective mass equals the ball's over the restitution: a ball falling on the resting racket stays dead there."),
    (
        "playing angle",
        "Angle in the face between the ball's incoming velocity relative to the impact point and the normal, positive where the ball climbs the face; playing_angle_thesis_deg in shot.json is the thesis's own (equations 4.16a, b).",
    ),
    ("reprojection error", "Distance in the picture between a corner found and where the calibrated cameras say it should be."),
];

/// The glossary, folded.
pub fn glossary() -> Section {
    let mut list = String::from("<details><summary>The words of this report, explained</summary><dl>");
    for (term, meaning) in WORDS {
        let _ = write!(list, "<dt>{}</dt><dd>{}</dd>", escape(term), prose(meaning));
    }
    list.push_str("</dl></details>");
    Section::new("glossary", "Glossary").html(&list)
}
