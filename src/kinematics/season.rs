//! Many shots together: means and standard deviations of chapter 5, by group, and the thesis's own beside them.

use super::shot::Shot;
use serde::Serialize;
use std::collections::BTreeMap;

/// Quantities of the thesis's figures 5.6 to 5.17 and 5.20 to 5.24, with men's and women's mean and standard deviation of
/// tables 5.27, 5.28 (and of the figures where the tables lack them), in SI or the unit of the quantity.
const THESIS: [(&str, Option<[f64; 4]>); 40] = [
    ("racket_in_global_vx", Some([15.96, 2.99, 14.93, 1.49])),
    ("racket_in_global_vy", Some([6.21, 4.22, 5.51, 2.86])),
    ("racket_in_global_vz", Some([-4.43, 2.87, -1.10, 2.71])),
    ("racket_in_speed", Some([17.7, 5.9, 16.0, 4.2])),
    ("ball_in_global_vx", Some([-9.30, 2.70, -9.34, 1.89])),
    ("ball_in_global_vy", Some([-0.64, 1.71, 0.20, 1.68])),
    ("ball_in_global_vz", Some([1.13, 1.04, 0.08, 0.91])),
    ("ball_in_speed", Some([9.4, 3.4, 9.3, 2.7])),
    ("ball_out_global_vx", Some([32.86, 5.04, 30.54, 3.01])),
    ("ball_out_global_vy", Some([5.37, 2.20, 4.47, 1.54])),
    ("ball_out_global_vz", Some([-4.72, 3.56, -0.81, 2.53])),
    ("ball_out_speed", Some([33.6, 6.6, 30.9, 4.2])),
    ("racket_in_wx", Some([2.75, 10.30, 4.33, 5.28])),
    ("racket_in_wy", Some([30.53, 7.39, 30.24, 4.06])),
    ("racket_in_wz", Some([6.46, 14.90, 8.88, 14.02])),
    ("racket_in_rate", Some([31.3, 19.6, 31.8, 15.5])),
    ("ball_out_topspin_rpm", Some([1125.0, 1122.0, 1036.0, 812.0])),
    ("playing_angle_deg", Some([-17.8, 13.2, -18.8, 11.0])),
    ("impact_from_butt", Some([0.5496, 0.0317, 0.5492, 0.0306])),
    ("impact_y", Some([0.0017, 0.0263, 0.0014, 0.0265])),
    ("impact_beyond_ideal_point", Some([0.0447, 0.0241, 0.0447, 0.0241])),
    ("impact_beyond_centre_of_percussion", Some([0.0226, 0.0272, 0.0226, 0.0272])),
    ("impact_beyond_node_point", Some([0.0006, 0.0155, 0.0006, 0.0155])),
    ("ball_in_topspin_rpm", None),
    ("impact_x", None),
    ("tip_in_speed", None),
    ("impact_point_in_speed", None),
    ("planar_racket_velocity", None),
    ("planar_relative_velocity", None),
    ("incidence_angle_deg", None),
    ("apparent_restitution", None),
    ("restitution", None),
    ("effective_mass", None),
    ("impact_success_ratio", None),
    ("efficiency", None),
    ("contact_time", None),
    ("racket_out_speed", None),
    ("racket_out_rate", None),
    ("ball_in_spin_rpm", None),
    ("ball_out_spin_rpm", None),
];

/// Mean and spread of one quantity over the shots of one group.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GroupStatistic {
    /// Grouping column and value; `all` and empty for the whole session.
    pub column: String,
    pub value: String,
    pub quantity: String,
    pub unit: String,
    pub n: usize,
    pub mean: f64,
    /// Standard error of the mean; absent with one shot.
    pub mean_sd: Option<f64>,
    /// Standard deviation between shots as the thesis gives it (n − 1), measuring error included; absent with one shot.
    pub sd: Option<f64>,
    /// Root mean square of the shots' own measuring errors.
    pub measuring_sd: f64,
    /// The thesis's players (tables 5.27, 5.28): mean and standard deviation, men then women.
    pub thesis_men: Option<[f64; 2]>,
    pub thesis_women: Option<[f64; 2]>,
}

/// The shots of every group of every grouping column.
pub fn shots_by_group<'a>(shots: &[&'a Shot]) -> BTreeMap<&'a str, BTreeMap<&'a str, Vec<&'a Shot>>> {
    let mut columns: BTreeMap<&str, BTreeMap<&str, Vec<&Shot>>> = BTreeMap::new();
    for shot in shots {
        for (column, value) in &shot.groups {
            columns.entry(column).or_default().entry(value).or_default().push(shot);
        }
    }
    columns
}

/// Statistics of all shots, then of every group of every grouping column that tells at most twelve groups apart.
pub fn season_statistics(shots: &[&Shot]) -> Vec<GroupStatistic> {
    const MOST_GROUPS: usize = 12;
    let mut out = statistics("all", "", shots);
    for (column, groups) in shots_by_group(shots) {
        if (2..=MOST_GROUPS).contains(&groups.len()) {
            out.extend(groups.into_iter().flat_map(|(value, own)| statistics(column, value, &own)));
        }
    }
    out
}

fn statistics(column: &str, value: &str, shots: &[&Shot]) -> Vec<GroupStatistic> {
    THESIS
        .iter()
        .filter_map(|(name, thesis)| {
            let seen: Vec<_> = shots.iter().filter_map(|s| s.quantities.get(name)).collect();
            let (first, n) = (seen.first()?, seen.len() as f64);
            let mean = seen.iter().map(|q| q.value).sum::<f64>() / n;
            let sd = (seen.len() > 1).then(|| (seen.iter().map(|q| (q.value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt());
            Some(GroupStatistic {
                column: column.to_owned(),
                value: value.to_owned(),
                quantity: (*name).to_owned(),
                unit: first.unit.clone(),
                n: seen.len(),
                mean,
                mean_sd: sd.map(|sd| sd / n.sqrt()),
                sd,
                measuring_sd: (seen.iter().map(|q| q.sd * q.sd).sum::<f64>() / n).sqrt(),
                thesis_men: thesis.map(|t| [t[0], t[1]]),
                thesis_women: thesis.map(|t| [t[2], t[3]]),
            })
        })
        .collect()
}

/// Mean forward speed of the incoming ball by its vertical velocity (table 5.9b: do players hit on the rise?).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RiseInterval {
    pub from_m_s: f64,
    pub to_m_s: f64,
    pub n: usize,
    pub mean_forward_speed_m_s: Option<f64>,
    pub thesis_m_s: f64,
}

/// Table 5.9b for these shots.
pub fn rise_table(shots: &[&Shot]) -> Vec<RiseInterval> {
    [(2.0, 5.0, 8.41), (0.0, 2.0, 9.58), (-1.0, 0.0, 10.39), (-4.0, -1.0, 9.63)]
        .into_iter()
        .map(|(from, to, thesis)| {
            let speeds: Vec<f64> = shots
                .iter()
                .filter_map(|s| Some((s.quantities.get("ball_in_global_vy")?.value, s.quantities.get("ball_in_global_vx")?.value)))
                .filter(|(up, _)| (from..to).contains(up))
                .map(|(_, along)| along.abs())
                .collect();
            let mean = (!speeds.is_empty()).then(|| speeds.iter().sum::<f64>() / speeds.len() as f64);
            RiseInterval { from_m_s: from, to_m_s: to, n: speeds.len(), mean_forward_speed_m_s: mean, thesis_m_s: thesis }
        })
        .collect()
}

/// `season.csv`: one line per group and quantity.
pub fn season_to_csv(statistics: &[GroupStatistic]) -> String {
    let mut csv = csv::Writer::from_writer(Vec::new());
    let number = |v: Option<f64>| v.map_or_else(String::new, |v| v.to_string());
    let header = [
        "column",
        "value",
        "quantity",
        "unit",
        "n",
        "mean",
        "mean_sd",
        "sd",
        "measuring_sd",
        "thesis_men_mean",
        "thesis_men_sd",
        "thesis_women_mean",
        "thesis_women_sd",
    ];
    let mut write = |fields: Vec<String>| csv.write_record(&fields).unwrap_or_else(|e| unreachable!("writing to memory: {e}"));
    write(header.iter().map(|h| (*h).to_owned()).collect());
    for s in statistics {
        let (men, women) = (s.thesis_men, s.thesis_women);
        write(vec![
            s.column.clone(),
            s.value.clone(),
            s.quantity.clone(),
            s.unit.clone(),
            s.n.to_string(),
            s.mean.to_string(),
            number(s.mean_sd),
            number(s.sd),
            s.measuring_sd.to_string(),
            number(men.map(|t| t[0])),
            number(men.map(|t| t[1])),
            number(women.map(|t| t[0])),
            number(women.map(|t| t[1])),
        ]);
    }
    String::from_utf8(csv.into_inner().unwrap_or_default()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shot(player: &str, values: &[(&str, f64, f64)]) -> Shot {
        let quantities: serde_json::Map<_, _> =
            values.iter().map(|(name, value, sd)| ((*name).to_owned(), serde_json::json!({ "value": value, "sd": sd, "unit": "m/s" }))).collect();
        let window = serde_json::json!({ "frames": 20, "rejected_points": 0, "noise_scale": 1.0, "laws": [] });
        let shot = serde_json::json!({
            "id": "s", "racket": "r", "ball": "b", "ball_side_of_face": "+z", "groups": [["player", player]], "quantities": quantities,
            "windows": { "ball_in": window, "racket_in": window },
        });
        serde_json::from_value(shot).expect("a shot")
    }

    #[test]
    fn truth_means_and_deviations_by_hand_in_all_and_in_each_group() {
        let shots = [shot("A", &[("ball_out_speed", 30.0, 0.3)]), shot("A", &[("ball_out_speed", 34.0, 0.4)]), shot("B", &[("ball_out_speed", 35.0, 0.5)])];
        let all = season_statistics(&shots.iter().collect::<Vec<_>>());
        let of = |column: &str, value: &str| all.iter().find(|s| s.column == column && s.value == value).expect("a line");
        assert_eq!(all.len(), 3, "one quantity in all and in two groups");
        // Of 30, 34, 35: mean 33, squares 9 + 1 + 4 = 14 over two degrees of freedom.
        let s = of("all", "");
        assert!(s.n == 3 && (s.mean - 33.0).abs() < 1e-12 && (s.sd.expect("three") - 7f64.sqrt()).abs() < 1e-12);
        assert!((s.mean_sd.expect("three") - (7.0 / 3.0f64).sqrt()).abs() < 1e-12 && (s.measuring_sd - (0.5 / 3.0f64).sqrt()).abs() < 1e-12);
        assert_eq!((s.thesis_men, s.thesis_women), (Some([33.6, 6.6]), Some([30.9, 4.2])));
        assert!((of("player", "A").mean, of("player", "A").n) == (32.0, 2));
        let alone = of("player", "B");
        assert!(alone.n == 1 && alone.sd.is_none() && alone.mean_sd.is_none() && alone.measuring_sd == 0.5);
        let csv = season_to_csv(&all);
        assert!(csv.lines().count() == 4 && csv.contains("player,B,ball_out_speed,m/s,1,35,,,0.5,33.6,6.6,30.9,4.2"), "{csv}");
    }

    #[test]
    fn truth_a_ball_is_counted_in_the_interval_of_its_vertical_velocity() {
        let shots: Vec<Shot> = [(2.0, -8.0), (4.9, 10.0), (0.0, -9.0), (-0.5, -11.0), (-4.0, 7.0), (5.0, 1.0)]
            .iter()
            .map(|(up, along)| shot("A", &[("ball_in_global_vy", *up, 0.1), ("ball_in_global_vx", *along, 0.1)]))
            .collect();
        let table = rise_table(&shots.iter().collect::<Vec<_>>());
        let seen: Vec<(f64, usize, Option<f64>)> = table.iter().map(|r| (r.from_m_s, r.n, r.mean_forward_speed_m_s)).collect();
        assert_eq!(seen, [(2.0, 2, Some(9.0)), (0.0, 1, Some(9.0)), (-1.0, 1, Some(11.0)), (-4.0, 1, Some(7.0))]);
        assert!(rise_table(&[]).iter().all(|r| r.n == 0 && r.mean_forward_speed_m_s.is_none()));
    }
}
