//! Racket and ball as their owners describe them (contract, section 2: `racket.toml`, `ball.toml`).
//!
//! Comes in: a TOML file. Goes out: [`Racket`], [`Ball`], with every value checked. Local racket axes: origin at the
//! stringbed centre, x toward the handle, y from marker 2 to marker 3, z = x × y. Body coordinates have the same
//! directions and their origin at the centre of mass (physics: `x_COM = stringbed_centre − balance` in local axes).

use crate::limited_file::{LARGEST_TEXT, parser_words, read_text};
use crate::quantity::as_written;
use nalgebra::{Point3, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Distance from the butt of the axis about which a swingweight is quoted (RDC convention), m.
pub const SWINGWEIGHT_AXIS_FROM_BUTT_M: f64 = 0.10;
/// From the strings' far end to the tip, m: the frame and its guard are 0.02; a wider range, for a file may say the length of the strings
/// or of the hoop.
const BEYOND_STRINGS_M: (f64, f64) = (-0.05, 0.12);
/// Two markers nearer than this are one.
const LEAST_APART_M: f64 = 0.01;

#[derive(Debug, thiserror::Error)]
pub enum EquipmentError {
    #[error("{path}: cannot be read ({source}); check the name, or write the file (docs/files.md tells what it holds)", path = .path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("{path}: {message}", path = .path.display())]
    Toml { path: PathBuf, message: String },
    #[error("{path}: `{key}` = {}; allowed: {allowed}", as_written(*.seen), path = .path.display())]
    Value { path: PathBuf, key: String, seen: f64, allowed: String },
    #[error("{path}: `name` = {name:?} is also the name in {other}, which holds other values; a table names its {kind} by it: give each its own", path = .path.display(), other = .other.display())]
    SameName { path: PathBuf, other: PathBuf, kind: &'static str, name: String },
}

/// What a racket's mass (kg) and moments of inertia (kg m²) may be, and its balance point (m from the butt) at least and at most.
pub const MASS_KG: (f64, f64) = (0.05, 2.0);
pub const BALANCE_M: (f64, f64) = (0.05, 1.5);
pub const SWINGWEIGHT_KGM2: (f64, f64) = (1e-4, 0.5);
pub const TWISTWEIGHT_KGM2: (f64, f64) = (1e-5, 0.1);

/// Tension that a file may state, lb: looser strings hold no ball, and no machine pulls more.
const TENSION_LB: (f64, f64) = (5.0, 100.0);
/// Beyond it, lb (35 kg), hardly any racket is strung; a number of newtons may be.
const TIGHT_LB: f64 = 77.0;
/// Below it a number may well be one of kilograms, lb: of a tennis racket (40 to 65 lb, 18 to 30 kg), and of the light ones of other games, which are strung looser.
const LOOSE_LB: f64 = 36.0;
const LOOSE_OF_A_LIGHT_RACKET_LB: f64 = 15.0;
/// Rackets of badminton and squash are lighter, those of tennis heavier, kg.
const LIGHT_KG: f64 = 0.2;
const LB_OF_A_KILOGRAM: f64 = 2.204_623;
const LB_OF_A_NEWTON: f64 = 0.224_809;

/// Mass of a ball over its volume: from balls of foam and large ones full of air (80 of table tennis, 90 of basketball) to solid ones (1100 of golf, 1700 of
/// billiards), with room on both sides.
const BALL_DENSITY_KG_M3: (f64, f64) = (20.0, 2500.0);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Head {
    pub inner_length_m: f64,
    pub inner_width_m: f64,
    #[serde(default = "default_tube_radius_m")]
    pub tube_radius_m: f64,
}

impl Head {
    /// Whether a place in the face, m along x and y from the stringbed's centre, lies inside the strings' ellipse.
    pub fn is_strung_at(&self, place: &Vector2<f64>) -> bool {
        (2.0 * place.x / self.inner_length_m).hypot(2.0 * place.y / self.inner_width_m) < 1.0
    }
}

fn default_tube_radius_m() -> f64 {
    0.010
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Strings {
    pub tension_lb: f64,
}

/// Marker positions in local axes, m; the middle of each tape band on the tube's axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Markers {
    pub m1: [f64; 3],
    pub m2: [f64; 3],
    pub m3: [f64; 3],
    pub m4: [f64; 3],
    pub m5: [f64; 3],
}

impl Markers {
    /// The five markers in order, local axes, m.
    pub fn points(&self) -> [Point3<f64>; 5] {
        [self.m1, self.m2, self.m3, self.m4, self.m5].map(|m| Point3::new(m[0], m[1], m[2]))
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Racket {
    pub name: String,
    pub mass_kg: f64,
    pub length_m: f64,
    /// Centre of mass, from the butt.
    pub balance_m: f64,
    /// Local origin, from the butt.
    pub stringbed_centre_m: f64,
    /// About the axis 0.10 m from the butt.
    pub swingweight_kgm2: f64,
    /// About the long axis x.
    pub twistweight_kgm2: f64,
    /// About an axis parallel to z, 0.10 m from the butt; default swing + twist (perpendicular axis theorem).
    pub spinweight_kgm2: Option<f64>,
    pub head: Head,
    pub strings: Strings,
    pub markers: Option<Markers>,
}

impl Racket {
    /// Reads and checks `racket.toml`.
    pub fn read(path: &Path) -> Result<Self, EquipmentError> {
        let racket: Racket = read_toml(path)?;
        racket.check(path)?;
        Ok(racket)
    }

    fn check(&self, path: &Path) -> Result<(), EquipmentError> {
        let need = |key: &str, seen: f64, lo: f64, hi: f64| in_range(path, key, seen, lo, hi);
        need("mass_kg", self.mass_kg, MASS_KG.0, MASS_KG.1)?;
        need("length_m", self.length_m, 0.3, 1.5)?;
        need("balance_m", self.balance_m, BALANCE_M.0, self.length_m)?;
        need("stringbed_centre_m", self.stringbed_centre_m, 0.1, self.length_m)?;
        need("swingweight_kgm2", self.swingweight_kgm2, SWINGWEIGHT_KGM2.0, SWINGWEIGHT_KGM2.1)?;
        need("twistweight_kgm2", self.twistweight_kgm2, TWISTWEIGHT_KGM2.0, TWISTWEIGHT_KGM2.1)?;
        if let Some(spin) = self.spinweight_kgm2 {
            need("spinweight_kgm2", spin, SWINGWEIGHT_KGM2.0, SWINGWEIGHT_KGM2.1 + TWISTWEIGHT_KGM2.1)?;
        }
        need("head.inner_length_m", self.head.inner_length_m, 0.05, self.length_m)?;
        need("head.inner_width_m", self.head.inner_width_m, 0.05, self.length_m)?;
        need("head.tube_radius_m", self.head.tube_radius_m, 0.0, 0.05)?;
        self.check_tension(path)?;
        let beyond = self.length_m - self.stringbed_centre_m - 0.5 * self.head.inner_length_m;
        if !(BEYOND_STRINGS_M.0..=BEYOND_STRINGS_M.1).contains(&beyond) {
            let allowed = format!(
                "such that half the head's inner length beyond it ends {} to {} m before the tip (it is measured from the butt; length_m {}, head.inner_length_m {})",
                BEYOND_STRINGS_M.0, BEYOND_STRINGS_M.1, self.length_m, self.head.inner_length_m
            );
            return Err(refused(path, "stringbed_centre_m", self.stringbed_centre_m, allowed));
        }
        self.check_inertia(path)?;
        self.markers.as_ref().map_or(Ok(()), |markers| self.check_markers(markers, path))
    }

    fn check_tension(&self, path: &Path) -> Result<(), EquipmentError> {
        let (key, seen, (least, most)) = ("strings.tension_lb", self.strings.tension_lb, TENSION_LB);
        if (least..=most).contains(&seen) {
            return Ok(());
        }
        let newtons = seen * LB_OF_A_NEWTON;
        let meant = if (least..=most).contains(&newtons) { format!("; if {seen} is in newtons, write {newtons:.1}") } else { String::new() };
        Err(refused(path, key, seen, format!("{least} to {most} lb (1 kg is 2.205 lb, 1 N 0.2248 lb){meant}")))
    }

    /// What makes one doubt that the tension is in lb, in words: for who takes the strings' stiffness from it. A loose tennis racket and one whose tension is in
    /// kg have the same number, so that none is refused for it.
    pub fn tension_doubt(&self) -> Option<String> {
        let (lb, kg) = (self.strings.tension_lb, self.mass_kg);
        let loose = if kg < LIGHT_KG { LOOSE_OF_A_LIGHT_RACKET_LB } else { LOOSE_LB };
        let doubt = if lb < loose {
            format!("loose strings for a racket of {kg} kg; if that is in kg, write {:.1}", lb * LB_OF_A_KILOGRAM)
        } else if lb > TIGHT_LB {
            format!("tighter than rackets are strung; if that is in newtons, write {:.1}", lb * LB_OF_A_NEWTON)
        } else {
            return None;
        };
        Some(format!("racket {:?}: `tension_lb` = {lb} are {doubt}", self.name))
    }

    fn check_inertia(&self, path: &Path) -> Result<(), EquipmentError> {
        let principal = self.inertia_kg_m2();
        let spinweight = self.spinweight_kgm2.unwrap_or(0.0);
        if principal.y <= 0.0 || principal.z <= 0.0 {
            let offset = self.mass_kg * (self.balance_m - SWINGWEIGHT_AXIS_FROM_BUTT_M).powi(2);
            let (key, seen) = if principal.y <= 0.0 { ("swingweight_kgm2", self.swingweight_kgm2) } else { ("spinweight_kgm2", spinweight) };
            let allowed = format!(
                "above mass × (balance − 0.10)² = {offset:.5} kg m², or the inertia about the centre of mass is negative; check mass, balance and {key}"
            );
            return Err(refused(path, key, seen, allowed));
        }
        // Mass along the racket with its centre at c has at most the inertia c (L - c) about it: all of it at the two ends (Bhatia and Davis 2000).
        let most = self.mass_kg * self.balance_m * (self.length_m - self.balance_m);
        if principal.y > most {
            let most = most + self.mass_kg * (self.balance_m - SWINGWEIGHT_AXIS_FROM_BUTT_M).powi(2);
            let allowed = format!(
                "below {most:.5} kg m², where all of the mass is at the two ends; check its unit (325 kg cm² are 0.0325 kg m²), mass, length and balance"
            );
            return Err(refused(path, "swingweight_kgm2", self.swingweight_kgm2, allowed));
        }
        // A racket is long: about its long axis it turns most easily, by far.
        if principal.x > 0.5 * principal.y {
            let allowed = format!("below half the inertia across the face about the centre of mass, {:.5} (a tenth of it is usual)", principal.y);
            return Err(refused(path, "twistweight_kgm2", self.twistweight_kgm2, allowed));
        }
        // No body has a principal inertia above the sum of the other two; 5 % leaves room for measuring error.
        let (a, b, c) = (principal.x, principal.y, principal.z);
        if a > 1.05 * (b + c) || b > 1.05 * (a + c) || c > 1.05 * (a + b) {
            let allowed = format!("inertias about the centre of mass (x {a:.5}, y {b:.5}, z {c:.5}) where none exceeds the sum of the other two");
            return Err(refused(path, "spinweight_kgm2", spinweight, allowed));
        }
        // Perpendicular axes: a flat body's spinweight is swing + twist. Rackets keep within some 5 %; beyond 15 % one of the
        // three is another axis's figure or a slip of the pen.
        let flat = self.swingweight_kgm2 + self.twistweight_kgm2;
        if let Some(spin) = self.spinweight_kgm2.filter(|spin| (spin - flat).abs() > 0.15 * flat) {
            let allowed = format!("within 15 % of swingweight + twistweight = {flat:.5} (perpendicular axis theorem); leave it out if it was not measured");
            return Err(refused(path, "spinweight_kgm2", spin, allowed));
        }
        Ok(())
    }

    fn check_markers(&self, markers: &Markers, path: &Path) -> Result<(), EquipmentError> {
        let p = markers.points();
        for (i, q) in p.iter().enumerate() {
            for (j, v) in q.coords.iter().enumerate() {
                in_range(path, &format!("markers.m{}[{j}]", i + 1), *v, -self.length_m, self.length_m)?;
            }
        }
        for (i, j) in (1..p.len()).flat_map(|j| (0..j).map(move |i| (i, j))) {
            let apart = (p[i] - p[j]).norm();
            if apart < LEAST_APART_M {
                let allowed = format!("at least {LEAST_APART_M} m apart, or they cannot be told from each other");
                return Err(refused(path, &format!("markers.m{} to m{}", i + 1, j + 1), apart, allowed));
            }
        }
        if let Some(k) = (1..p.len()).find(|&k| p[k].x <= p[0].x) {
            let allowed = format!("below m{}'s x = {} (m1 is at the tip, and x runs toward the handle)", k + 1, p[k].x);
            return Err(refused(path, "markers.m1[0]", p[0].x, allowed));
        }
        if p[2].y <= p[1].y {
            return Err(refused(path, "markers.m3[1]", p[2].y, format!("above m2's y = {} (y runs from marker 2 to marker 3)", p[1].y)));
        }
        Ok(())
    }

    /// Principal inertias (x, y, z) about the centre of mass, kg m².
    ///
    /// `I_y = SW − M (c − 0.10)²` (parallel axes); `I_x` is the twistweight; `I_z` likewise from the spinweight.
    pub fn inertia_kg_m2(&self) -> Vector3<f64> {
        let shift = self.mass_kg * (self.balance_m - SWINGWEIGHT_AXIS_FROM_BUTT_M).powi(2);
        let spin = self.spinweight_kgm2.unwrap_or(self.swingweight_kgm2 + self.twistweight_kgm2);
        Vector3::new(self.twistweight_kgm2, self.swingweight_kgm2 - shift, spin - shift)
    }

    /// Centre of mass in local axes, m (on +x, toward the handle).
    pub fn com_local(&self) -> Point3<f64> {
        Point3::new(self.stringbed_centre_m - self.balance_m, 0.0, 0.0)
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ball {
    pub name: String,
    pub mass_kg: f64,
    pub diameter_m: f64,
    /// I = factor · m · r²; thin shell 2/3, a real ball about 0.55.
    pub inertia_factor: f64,
}

impl Ball {
    /// Reads and checks `ball.toml`.
    pub fn read(path: &Path) -> Result<Self, EquipmentError> {
        let ball: Ball = read_toml(path)?;
        in_range(path, "mass_kg", ball.mass_kg, 0.001, 1.0)?;
        in_range(path, "diameter_m", ball.diameter_m, 0.005, 0.5)?;
        in_range(path, "inertia_factor", ball.inertia_factor, 0.05, 2.0 / 3.0 + 1e-3)?;
        // A slip of the decimal point in one of the two.
        let volume_m3 = std::f64::consts::PI / 6.0 * ball.diameter_m.powi(3);
        let (least, most) = (BALL_DENSITY_KG_M3.0 * volume_m3, BALL_DENSITY_KG_M3.1 * volume_m3);
        if !(least..=most).contains(&ball.mass_kg) {
            let allowed = format!(
                "{least:.2e} to {most:.2e} for a ball of diameter_m = {} ({} to {} kg per m³; a tennis ball has 380: 0.0577 kg and 0.066 m); check both",
                ball.diameter_m, BALL_DENSITY_KG_M3.0, BALL_DENSITY_KG_M3.1
            );
            return Err(refused(path, "mass_kg", ball.mass_kg, allowed));
        }
        Ok(ball)
    }

    pub fn radius_m(&self) -> f64 {
        0.5 * self.diameter_m
    }

    pub fn inertia_kg_m2(&self) -> f64 {
        self.inertia_factor * self.mass_kg * self.radius_m().powi(2)
    }
}

/// What a table names: a racket or a ball.
pub trait Named: PartialEq {
    const KIND: &'static str;
    fn name(&self) -> &str;
}

impl Named for Racket {
    const KIND: &'static str = "racket";
    fn name(&self) -> &str {
        &self.name
    }
}

impl Named for Ball {
    const KIND: &'static str = "ball";
    fn name(&self) -> &str {
        &self.name
    }
}

/// Reads one file after the other.
///
/// # Errors
/// The first that cannot be read, holds a value out of range, or bears the name of another with other values.
pub fn read_all<T: Named>(paths: &[PathBuf], read: impl Fn(&Path) -> Result<T, EquipmentError>) -> Result<Vec<T>, EquipmentError> {
    let mut all: Vec<T> = Vec::with_capacity(paths.len());
    for path in paths {
        let one = read(path)?;
        if let Some(i) = all.iter().position(|earlier| earlier.name() == one.name() && *earlier != one) {
            return Err(EquipmentError::SameName { path: path.clone(), other: paths[i].clone(), kind: T::KIND, name: one.name().to_owned() });
        }
        all.push(one);
    }
    Ok(all)
}

fn read_toml<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T, EquipmentError> {
    let text = read_text(path, LARGEST_TEXT).map_err(|source| EquipmentError::Unreadable { path: path.into(), source })?;
    toml::from_str(&text).map_err(|e| EquipmentError::Toml { path: path.into(), message: parser_words(&e) })
}

fn in_range(path: &Path, key: &str, seen: f64, lo: f64, hi: f64) -> Result<(), EquipmentError> {
    if seen.is_finite() && seen >= lo && seen <= hi { Ok(()) } else { Err(refused(path, key, seen, format!("{lo} to {hi}"))) }
}

fn refused(path: &Path, key: &str, seen: f64, allowed: String) -> EquipmentError {
    EquipmentError::Value { path: path.into(), key: key.into(), seen, allowed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_strings_end_at_half_the_heads_inner_axes() {
        let head = Head { inner_length_m: 0.335, inner_width_m: 0.255, tube_radius_m: 0.010 };
        // At (0.6, 0.8) of the half axes 0.1675 and 0.1275 m the edge is reached, far inside their rectangle.
        for (x, y, strung) in
            [(0.0, 0.0, true), (0.167, 0.0, true), (-0.168, 0.0, false), (0.0, -0.127, true), (0.0, 0.128, false), (0.100, 0.101, true), (-0.101, 0.103, false)]
        {
            assert_eq!(head.is_strung_at(&Vector2::new(x, y)), strung, "{x}, {y}");
        }
    }

    #[test]
    fn fails_a_tension_in_another_unit_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("racket.toml");
        let racket = |mass: f64, tension: f64| {
            let inertias = format!("swingweight_kgm2 = {}\ntwistweight_kgm2 = {}", 0.0956 * mass, 0.0044 * mass);
            let text = format!(
                "name = \"r\"\nmass_kg = {mass}\nlength_m = 0.685\nbalance_m = 0.33\nstringbed_centre_m = 0.4975\n{inertias}\n\
                 head = {{ inner_length_m = 0.335, inner_width_m = 0.255 }}\nstrings = {{ tension_lb = {tension} }}\n"
            );
            std::fs::write(&path, text).expect("written");
            Racket::read(&path)
        };
        // Tennis, 40 to 70 lb; badminton and squash, 16 to 35 lb.
        for (mass, tension) in [(0.34, 40.0), (0.30, 70.0), (0.34, 36.0), (0.09, 24.0), (0.15, 16.0)] {
            assert_eq!(racket(mass, tension).expect("a usual racket").tension_doubt(), None, "{mass} kg, {tension} lb");
        }
        // In kg, and in newtons of a badminton racket; a player's 25 lb have the number of 25 kg, and are taken.
        for (mass, tension, meant) in [(0.34, 25.0, "in kg, write 55.1"), (0.09, 11.0, "in kg, write 24.3"), (0.09, 98.0, "in newtons, write 22.0")] {
            let doubt = racket(mass, tension).expect("taken").tension_doubt().expect("doubted");
            assert!(doubt.contains(meant), "{doubt}");
        }
        for (tension, told) in
            [(245.0, "if 245 is in newtons, write 55.1"), (2.0, "allowed: 5 to 100 lb"), (600.0, "allowed: 5 to 100 lb"), (-5.0, "allowed: 5")]
        {
            let refused = racket(0.34, tension).expect_err("no tension").to_string();
            assert!(refused.contains("`strings.tension_lb`") && refused.contains(told), "{refused}");
        }
        assert!(racket(0.34, f64::NAN).is_err());
    }

    #[test]
    fn fails_a_ball_with_its_decimal_point_astray() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ball.toml");
        let ball = |mass: f64, diameter: f64| {
            std::fs::write(&path, format!("name = \"b\"\nmass_kg = {mass}\ndiameter_m = {diameter}\ninertia_factor = 0.5\n")).expect("written");
            Ball::read(&path)
        };
        // Tennis, foam, table tennis, squash, golf, billiards, basketball.
        for (mass, diameter) in [(0.0577, 0.066), (0.025, 0.09), (0.0027, 0.04), (0.024, 0.04), (0.0459, 0.0427), (0.17, 0.0572), (0.62, 0.24)] {
            assert!(ball(mass, diameter).is_ok(), "{mass} kg, {diameter} m");
        }
        for (mass, diameter) in [(0.577, 0.066), (0.00257, 0.066), (0.0577, 0.0066), (0.0577, 0.33)] {
            let message = ball(mass, diameter).expect_err("no ball").to_string();
            assert!(message.contains("`mass_kg` = ") && message.contains("diameter_m = "), "{message}");
        }
    }

    #[test]
    fn fails_a_racket_that_no_body_is() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("racket.toml");
        let racket = |more: &str| {
            let text = format!(
                "name = \"r\"\nmass_kg = 0.32\nlength_m = 0.685\nbalance_m = 0.325\nstringbed_centre_m = 0.525\nswingweight_kgm2 = 0.0325\n\
                 twistweight_kgm2 = 0.0014\n{more}head = {{ inner_length_m = 0.26, inner_width_m = 0.2 }}\nstrings = {{ tension_lb = 60.0 }}\n"
            );
            std::fs::write(&path, text).expect("written");
            Racket::read(&path)
        };
        assert!(racket("").is_ok() && racket("spinweight_kgm2 = 0.0339\n").is_ok());
        for spinweight in ["nan", "inf", "0.06", "0.017", "-0.03"] {
            let message = racket(&format!("spinweight_kgm2 = {spinweight}\n")).expect_err("no racket").to_string();
            assert!(message.contains("`spinweight_kgm2` = ") && message.contains("allowed: "), "{message}");
        }
        // 325 kg cm² divided by a thousand.
        let text = std::fs::read_to_string(&path)
            .expect("read")
            .replace("swingweight_kgm2 = 0.0325", "swingweight_kgm2 = 0.325")
            .replace("spinweight_kgm2 = -0.03\n", "");
        std::fs::write(&path, text).expect("written");
        let message = Racket::read(&path).expect_err("no racket").to_string();
        assert!(message.contains("`swingweight_kgm2` = 0.325") && message.contains("325 kg cm²"), "{message}");
    }

    #[test]
    fn fails_two_rackets_of_one_name_that_differ() {
        let folder = tempfile::tempdir().expect("a folder");
        let ball = |file: &str, mass: f64| {
            let path = folder.path().join(file);
            std::fs::write(&path, format!("name = \"b\"\nmass_kg = {mass}\ndiameter_m = 0.066\ninertia_factor = 0.55\n")).expect("written");
            path
        };
        let (a, same, other) = (ball("a.toml", 0.0577), ball("same.toml", 0.0577), ball("other.toml", 0.0560));
        assert_eq!(read_all(&[a.clone(), same], Ball::read).expect("one ball twice").len(), 2);
        let message = read_all(&[a, other], Ball::read).expect_err("two balls").to_string();
        assert!(message.contains("other.toml") && message.contains("a.toml") && message.contains("names its ball by it"), "{message}");
    }
}
