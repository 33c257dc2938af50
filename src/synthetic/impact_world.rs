//! Seeded tables of impacts with a hidden effect, in the form and with the noise of good footage.
//!
//! ```
//! use sweetspot::synthetic::hidden::Hidden;
//! use sweetspot::synthetic::impact_world::{Kind, TableSpec, generate_table};
//! let spec = TableSpec { hidden: vec![Hidden::new("frame-vibration", 1.0)], ..TableSpec::new(Kind::Lab, 20, 7) };
//! let made = generate_table(&spec).unwrap();
//! assert_eq!(made.table.rows.len(), 20);
//! ```

use super::body::Body;
use super::contact::{Aftermath, ContactError, Encounter, collide};
use super::hidden::{Hidden, HiddenError, entry, nature};
use super::measurement::{Deviations, FaultSetting, NoiseOptions, OUTLIER_MARK, TrueImpact, record, with_faults};
use super::motion::GRAVITY;
use super::nature::Nature;
use crate::equipment::{Ball, Head, Markers, Racket, Strings};
use crate::impact_table::{INPUTS, ImpactTable};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Time step of a contact, s: outcomes are within a tenth of the noise of those at a tenth of it.
pub const TIME_STEP_S: f64 = 2e-6;
/// Largest table this room makes.
pub const MAX_IMPACTS: usize = 100_000;

/// Where a player's hand holds, m.
pub const HAND_FROM_BUTT_M: f64 = 0.08;

/// Where the impacts take place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Racket hung at rest, ball shot at it, mount torque set and known, racket seen after impact.
    Lab,
    /// A player's forehand; nothing is known of the mount and of the racket after impact.
    Court,
}

/// What a table should be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableSpec {
    pub kind: Kind,
    pub impacts: usize,
    #[serde(default)]
    pub hidden: Vec<Hidden>,
    pub seed: u64,
    #[serde(default)]
    pub noise: NoiseOptions,
}

impl TableSpec {
    /// Nothing hidden, plain noise.
    pub fn new(kind: Kind, impacts: usize, seed: u64) -> Self {
        TableSpec { kind, impacts, hidden: Vec::new(), seed, noise: NoiseOptions::default() }
    }
}

/// What is true of a table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TableTruth {
    pub kind: Kind,
    pub seed: u64,
    pub hidden: Vec<Hidden>,
    /// Names that also count as right, for each hidden effect.
    pub aliases: BTreeMap<String, Vec<String>>,
    pub laws: Vec<String>,
    pub restitution: f64,
    pub friction: f64,
    pub understated: f64,
    /// Rows with one grossly wrong output: id and column.
    pub outliers: BTreeMap<String, String>,
    /// Offsets shared by each session, in sd, in the order of the table's inputs.
    pub session_offsets_sd: Vec<[f64; INPUTS.len()]>,
    /// Noiseless columns of each row, faults of the measurement left out.
    pub rows: BTreeMap<String, BTreeMap<&'static str, f64>>,
}

#[derive(Debug, Clone)]
pub struct SyntheticTable {
    pub table: ImpactTable,
    pub truth: TableTruth,
    /// As the data sheet has it (a hidden `racket-inertia` is not in it).
    pub racket: Racket,
    pub ball: Ball,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ImpactWorldError {
    #[error("`impacts` is {seen}; allowed: 1 to {MAX_IMPACTS}")]
    Impacts { seen: usize },
    #[error("`noise.{key}` is {seen}; allowed: {allowed}")]
    Noise { key: &'static str, seen: f64, allowed: &'static str },
    #[error(transparent)]
    Hidden(#[from] HiddenError),
    #[error("impact {id}: {source}")]
    Contact { id: String, source: ContactError },
}

/// The racket and ball of these worlds.
pub fn equipment() -> (Racket, Ball) {
    let racket = Racket {
        name: "synthetic 27 inch".to_owned(),
        mass_kg: 0.338,
        length_m: 0.685,
        balance_m: 0.328,
        stringbed_centre_m: 0.497,
        swingweight_kgm2: 0.0322,
        twistweight_kgm2: 0.00148,
        spinweight_kgm2: None,
        head: Head { inner_length_m: 0.335, inner_width_m: 0.255, tube_radius_m: 0.010 },
        strings: Strings { tension_lb: 58.0 },
        markers: Some(Markers { m1: [-0.1775, 0.0, 0.0], m2: [0.0, -0.1375, 0.0], m3: [0.0, 0.1375, 0.0], m4: [0.2, -0.045, 0.0], m5: [0.2, 0.045, 0.0] }),
    };
    let ball = Ball { name: "synthetic pressurised".to_owned(), mass_kg: 0.0577, diameter_m: 0.066, inertia_factor: 0.6667 };
    (racket, ball)
}

/// State of racket and ball at first contact, along racket axes (contract, section 4).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    pub ball: Vector3<f64>,
    pub ball_spin: Vector3<f64>,
    pub racket: Vector3<f64>,
    pub racket_rate: Vector3<f64>,
    pub place: Vector2<f64>,
    pub grip_torque: f64,
    pub order: f64,
    /// Racket axes to laboratory axes.
    pub attitude: UnitQuaternion<f64>,
    /// Stringbed centre in the laboratory, m.
    pub face_centre: Point3<f64>,
}

/// One impact in the laboratory frame: who meets whom, and what comes of it.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldImpact {
    pub encounter: Encounter,
    pub aftermath: Aftermath,
    /// Along racket axes at first contact, racket referred to the data sheet's centre of mass.
    pub truth: TrueImpact,
}

/// Lets racket and ball meet. `racket` is the data sheet; what it does not know stands in `nature`.
pub fn meet(racket: &Racket, ball: &Ball, approach: &Approach, nature: &Nature) -> Result<WorldImpact, ContactError> {
    let sheet_centre = racket.com_local().coords; // from the stringbed centre
    let (mass, centre, inertia) = with_tip_mass(racket, nature.unknown_tip_mass_kg);
    let to_lab = approach.attitude;
    let side = if (approach.ball - approach.racket).z <= 0.0 { 1.0 } else { -1.0 };
    let shift = to_lab * (centre - sheet_centre);
    let rate = to_lab * approach.racket_rate;
    let body = Body {
        mass_kg: mass,
        inertia_kg_m2: inertia,
        position: approach.face_centre + to_lab * centre,
        attitude: to_lab,
        velocity: to_lab * approach.racket + rate.cross(&shift),
        rate,
    };
    let ball_at = approach.face_centre + to_lab * Vector3::new(approach.place.x, approach.place.y, side * ball.radius_m());
    let encounter = Encounter {
        racket: body,
        ball: Body::sphere(ball.mass_kg, ball.inertia_kg_m2(), ball_at, to_lab * approach.ball, to_lab * approach.ball_spin),
        ball_radius_m: ball.radius_m(),
        face_centre: -centre,
        face_centre_from_butt_m: racket.stringbed_centre_m,
        half_axes: Vector2::new(0.5 * racket.head.inner_length_m, 0.5 * racket.head.inner_width_m),
        grip_torque_n_m: approach.grip_torque,
        order: approach.order,
    };
    let aftermath = collide(&encounter, nature, TIME_STEP_S)?;
    let to_racket = to_lab.inverse();
    let truth = TrueImpact {
        ball_in: approach.ball,
        ball_in_spin: approach.ball_spin,
        racket_in: approach.racket,
        racket_in_rate: approach.racket_rate,
        place: approach.place,
        grip_torque: None,
        ball_out: to_racket * aftermath.ball.velocity,
        ball_out_spin: to_racket * aftermath.ball.rate,
        racket_out: to_racket * (aftermath.racket.velocity - aftermath.racket.rate.cross(&shift)),
        racket_out_rate: to_racket * aftermath.racket.rate,
        contact_time: aftermath.contact_time_s,
    };
    Ok(WorldImpact { encounter, aftermath, truth })
}

/// Mass, centre of mass from the stringbed centre and principal inertias with a lump at the tip.
fn with_tip_mass(racket: &Racket, lump: f64) -> (f64, Vector3<f64>, Vector3<f64>) {
    let sheet = racket.com_local().coords;
    let tip = Vector3::new(racket.stringbed_centre_m - racket.length_m, 0.0, 0.0);
    let mass = racket.mass_kg + lump;
    let centre = (sheet * racket.mass_kg + tip * lump) / mass;
    let reduced = racket.mass_kg * lump / mass * (tip - sheet).norm_squared();
    (mass, centre, racket.inertia_kg_m2() + Vector3::new(0.0, reduced, reduced))
}

/// Draws one impact of the kind: ranges of the laboratory rig and of the published forehands (thesis, tables 5.6 to 5.28).
pub fn draw(kind: Kind, order: f64, rng: &mut impl Rng) -> Approach {
    let mut normal = |mean: f64, sd: f64| -> f64 {
        let z: f64 = StandardNormal.sample(rng);
        mean + sd * z.clamp(-3.2, 3.2)
    };
    match kind {
        Kind::Court => Approach {
            ball: Vector3::new(normal(0.0, 1.2), normal(-2.0, 2.0), normal(-9.4, 1.9).min(-3.0)),
            ball_spin: Vector3::new(normal(0.0, 100.0), normal(0.0, 95.0), normal(0.0, 70.0)),
            racket: Vector3::new(normal(-0.1, 3.0), normal(6.3, 3.3), normal(15.0, 2.6).max(6.0)),
            racket_rate: Vector3::new(normal(3.5, 7.0), normal(30.5, 6.0), normal(6.3, 15.0)),
            place: Vector2::new(normal(-0.052, 0.034), normal(0.002, 0.028)),
            grip_torque: 0.0,
            order,
            // z toward the net, y up: x is then against W.
            attitude: attitude_from([-Vector3::z(), Vector3::y(), Vector3::x()]),
            face_centre: Point3::new(0.3, 1.0, 0.3),
        },
        Kind::Lab => {
            let speed = rng.random_range(15.0..38.0_f64);
            let incidence = rng.random_range(0.0..60.0_f64).to_radians();
            let azimuth = rng.random_range(0.0..std::f64::consts::TAU);
            let (along, across) = (speed * incidence.cos(), speed * incidence.sin());
            let mut spin = |most: f64| rng.random_range(-most..most);
            let ball_spin = Vector3::new(spin(290.0), spin(290.0), spin(40.0));
            Approach {
                ball: Vector3::new(across * azimuth.cos(), across * azimuth.sin(), -along),
                ball_spin,
                racket: Vector3::zeros(),
                racket_rate: Vector3::zeros(),
                place: Vector2::new(rng.random_range(-0.12..0.11), rng.random_range(-0.085..0.085)),
                grip_torque: [0.0, 2.0, 4.0, 8.0][rng.random_range(0..4)],
                order,
                // Hung by the handle (x up), the face toward +U.
                attitude: attitude_from([Vector3::y(), Vector3::z(), Vector3::x()]),
                face_centre: Point3::new(0.3, 0.9, 0.3),
            }
        }
    }
}

fn attitude_from(axes: [Vector3<f64>; 3]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&axes)))
}

/// A table of impacts and what is true of it. The same specification gives the same table, whatever the thread count.
pub fn generate_table(spec: &TableSpec) -> Result<SyntheticTable, ImpactWorldError> {
    check(spec)?;
    let world = nature(&spec.hidden)?;
    let (racket, ball) = equipment();
    let hung = spec.kind == Kind::Lab;
    let sd = Deviations::of(hung, spec.noise.scale);
    let mut session_rng = stream(spec.seed, u64::MAX);
    let offsets: Vec<[f64; INPUTS.len()]> = (0..spec.noise.sessions)
        .map(|_| {
            std::array::from_fn(|_| {
                let z: f64 = StandardNormal.sample(&mut session_rng);
                spec.noise.session_offset_sd * z
            })
        })
        .collect();
    let name = if hung { "lab" } else { "court" };
    let made: Vec<_> = (0..spec.impacts)
        .into_par_iter()
        .map(|i| {
            let id = format!("{name}-{i:04}");
            let mut rng = stream(spec.seed, i as u64);
            let approach = draw(spec.kind, i as f64, &mut rng);
            let impact = meet(&racket, &ball, &approach, &world).map_err(|source| ImpactWorldError::Contact { id: id.clone(), source })?;
            let truth = TrueImpact { grip_torque: hung.then_some(approach.grip_torque), ..impact.truth };
            let setting = FaultSetting {
                gravity: approach.attitude.inverse() * GRAVITY,
                swing_arm: Vector3::new(racket.com_local().x - (racket.stringbed_centre_m - HAND_FROM_BUTT_M), 0.0, 0.0),
                ball_mass_kg: ball.mass_kg,
                ball_radius_m: ball.radius_m(),
            };
            let seen = with_faults(&truth, &world.measurement, &setting);
            let session = i * spec.noise.sessions / spec.impacts;
            let mut row = record(&seen, &id, &sd, &offsets[session], hung, &spec.noise, &mut rng);
            row.racket = Some(racket.name.clone());
            row.ball = Some(ball.name.clone());
            row.sequence = i as f64;
            let outlier = row.groups.remove(OUTLIER_MARK);
            if spec.noise.sessions > 1 {
                row.groups.insert("session".to_owned(), format!("day-{}", session + 1));
            }
            Ok((row, truth, outlier))
        })
        .collect::<Result<_, ImpactWorldError>>()?;
    let mut truth = TableTruth {
        kind: spec.kind,
        seed: spec.seed,
        hidden: spec.hidden.clone(),
        aliases: BTreeMap::new(),
        laws: Vec::new(),
        restitution: world.restitution,
        friction: world.friction,
        understated: spec.noise.understated,
        outliers: BTreeMap::new(),
        session_offsets_sd: offsets,
        rows: BTreeMap::new(),
    };
    for h in &spec.hidden {
        let e = entry(&h.effect)?;
        truth.aliases.insert(h.effect.clone(), e.aliases.iter().map(|a| (*a).to_owned()).collect());
        truth.laws.push(format!("{}: {}", e.name, e.law));
    }
    let mut table = ImpactTable::default();
    for (row, impact, outlier) in made {
        truth.rows.insert(row.id.clone(), impact.named().collect());
        if let Some(column) = outlier {
            truth.outliers.insert(row.id.clone(), column);
        }
        table.rows.push(row);
    }
    Ok(SyntheticTable { table, truth, racket, ball })
}

/// One generator per impact, so that rows do not depend on the order in which threads make them.
pub(super) fn stream(seed: u64, which: u64) -> ChaCha12Rng {
    let mut rng = ChaCha12Rng::seed_from_u64(seed);
    rng.set_stream(which);
    rng
}

fn check(spec: &TableSpec) -> Result<(), ImpactWorldError> {
    if spec.impacts == 0 || spec.impacts > MAX_IMPACTS {
        return Err(ImpactWorldError::Impacts { seen: spec.impacts });
    }
    let n = &spec.noise;
    let need = |key: &'static str, seen: f64, lo: f64, hi: f64, allowed: &'static str| {
        if seen >= lo && seen <= hi { Ok(()) } else { Err(ImpactWorldError::Noise { key, seen, allowed }) }
    };
    need("scale", n.scale, 0.0, 100.0, "0 to 100")?;
    need("understated", n.understated, 0.1, 10.0, "0.1 to 10")?;
    need("outliers", n.outliers, 0.0, 0.5, "0 to 0.5")?;
    need("outlier_sd", n.outlier_sd, 0.0, 1e3, "0 to 1000")?;
    need("session_offset_sd", n.session_offset_sd, 0.0, 100.0, "0 to 100")?;
    need("sessions", n.sessions as f64, 1.0, spec.impacts as f64, "1 to the number of impacts")?;
    need("missing", n.missing, 0.0, 0.95, "0 to 0.95")
}
