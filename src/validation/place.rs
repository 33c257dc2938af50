//! Where the model fails, in words: the range of one input over which one output is off.
//!
//! Residuals of every output are put in order of every varied input, and of time (the order of the impacts), and cut into equal groups; of all runs of
//! neighbouring groups the one that stands out most against the rest is taken. Its p-value is corrected for every range,
//! input and output looked at.

use super::by_group::GroupMisfit;
use super::comparison::{NormalSigns, coordinate_name};
use super::diagnosis::Place;
use super::linearise::Linearised;
use super::observation::Observation;
use super::tails::normal_tail;
use crate::impact_table::{OUTPUTS, OwnColumn, column_subject, unit};
use crate::quantity::HOLD_95_PERCENT;

/// Groups of equal size an input is cut into (fewer with few impacts).
const GROUPS: usize = 10;
/// Places listed at most.
const MOST_PLACES: usize = 6;
/// A place must be this unlikely by chance, all ranges looked at counted.
const LEVEL: f64 = 0.01;

/// What impacts are put in order of: an input, the order in time (index behind the inputs'), or a column of the user's own.
#[derive(Clone, Copy)]
enum Coordinate<'a> {
    Usual(usize),
    Own(&'a str),
}

impl Coordinate<'_> {
    fn name(&self) -> &str {
        match self {
            Coordinate::Usual(j) => coordinate_name(*j),
            Coordinate::Own(name) => name,
        }
    }

    /// NaN where an impact has no such number.
    fn of(&self, o: &Observation) -> f64 {
        match self {
            Coordinate::Usual(j) => o.inputs.get(*j).copied().unwrap_or(o.order),
            Coordinate::Own(name) => o.own.get(OwnColumn::named(name)),
        }
    }
}

/// The places that stand out, most significant first; one per pair of output and input. `c` is the noise scale, `own` are columns of the user's own
/// by which the model fails. Places must stand out of the noise, and (but for the first) of the scatter that is there: `p_value` is by the larger of
/// the two.
pub fn places(impacts: &[&Observation], fitted: &[Linearised], varied: &[usize], own: &[GroupMisfit], c: f64) -> Vec<Place> {
    // Words part impacts too, but into no ranges.
    let numbers = own.iter().map(|g| Coordinate::Own(&g.column)).filter(|column| impacts.iter().all(|o| !column.of(o).is_nan()));
    let coordinates: Vec<Coordinate> = varied.iter().map(|j| Coordinate::Usual(*j)).chain(numbers).collect();
    let mut found: Vec<(f64, Place)> = Vec::new();
    let signs = NormalSigns::of(impacts.iter().map(|o| o.inputs.as_slice()));
    let ranges = GROUPS * (GROUPS + 1) / 2;
    for k in 0..OUTPUTS.len() {
        let rows: Vec<(usize, f64, f64)> = fitted
            .iter()
            .enumerate()
            .filter_map(|(i, l)| {
                l.measured
                    .iter()
                    .position(|m| *m == k)
                    .map(|row| (i, signs.of_output(OUTPUTS[k], &impacts[i].inputs) * l.residual[row], c * l.covariance[(row, row)]))
            })
            .collect();
        for j in &coordinates {
            if let Some(place) = worst_range(&rows, impacts, &signs, k, *j, ranges * OUTPUTS.len() * coordinates.len()) {
                found.push(place);
            }
        }
    }
    found.sort_by(|(n, a), (m, b)| a.p_value.total_cmp(&b.p_value).then(n.total_cmp(m)).then(a.output.cmp(&b.output)).then(a.input.cmp(&b.input)));
    // Two inputs that vary together tell the same story twice; the stronger one stands.
    let mut listed: Vec<Place> = Vec::new();
    for (_, place) in found {
        // Where everything scatters by what is missing, the clearest stands for all.
        if place.p_value > LEVEL && !listed.is_empty() {
            continue;
        }
        let told = listed.iter().filter(|l| l.output == place.output).count();
        // A bias over the whole range is one story, whatever input it is put in order of.
        let again = listed.iter().any(|l| l.output == place.output && l.words == place.words);
        if told < 2 && !again && listed.len() < MOST_PLACES {
            listed.push(place);
        }
    }
    listed
}

/// The place, and how unlikely it is by the noise alone.
fn worst_range(
    rows: &[(usize, f64, f64)],
    impacts: &[&Observation],
    signs: &NormalSigns,
    k: usize,
    along: Coordinate,
    looked_at: usize,
) -> Option<(f64, Place)> {
    let groups = GROUPS.min(rows.len() / 6);
    if groups < 3 {
        return None;
    }
    let mut sorted = rows.to_vec();
    let coordinate = |i: usize| along.of(impacts[i]);
    sorted.sort_by(|a, b| coordinate(a.0).total_cmp(&coordinate(b.0)).then(a.0.cmp(&b.0)));
    let n = sorted.len();
    let value = |i: usize| coordinate(sorted[i].0);
    let edges = edges_between(n, groups, value);
    let groups = edges.len() - 1;
    let mut best: Option<(f64, usize, usize)> = None;
    for a in 0..groups {
        for b in a + 1..=groups {
            // The whole range is a bias, told by one full-range place; parts are compared with the rest.
            let inside = &sorted[edges[a]..edges[b]];
            let outside: Vec<_> = sorted[..edges[a]].iter().chain(&sorted[edges[b]..]).collect();
            let (m_in, v_in) = mean_and_variance(inside.iter());
            let z = if outside.is_empty() {
                m_in / v_in.sqrt()
            } else {
                let (m_out, v_out) = mean_and_variance(outside.iter().copied());
                // What is off must be the inside: a range whose complement is the odd one will be found as such.
                if m_in.abs() < m_out.abs() {
                    continue;
                }
                (m_in - m_out) / (v_in + v_out).sqrt()
            };
            if best.is_none_or(|(t, _, _)| z.abs() > t.abs()) {
                best = Some((z, a, b));
            }
        }
    }
    let (z, a, b) = best?;
    let corrected = |z: f64| (2.0 * normal_tail(z.abs()) * looked_at as f64).min(1.0);
    let by_noise = corrected(z);
    if by_noise > LEVEL {
        return None;
    }
    let inside = &sorted[edges[a]..edges[b]];
    let outside: Vec<(usize, f64, f64)> = sorted[..edges[a]].iter().chain(&sorted[edges[b]..]).copied().collect();
    let m = inside.len();
    let (mean, variance) = mean_and_variance(inside.iter());
    let sd = scatter_variance(inside, mean).sqrt();
    if mean.abs() < HOLD_95_PERCENT * sd {
        return None;
    }
    let (elsewhere, beyond) = if outside.is_empty() { (0.0, 0.0) } else { mean_and_variance(outside.iter()) };
    let spread = scatter_variance(inside, mean).max(variance) + if outside.is_empty() { 0.0 } else { scatter_variance(&outside, elsewhere).max(beyond) };
    let p_value = corrected((mean - elsewhere) / spread.sqrt());
    let (from, to) = (value(edges[a]), value(edges[b] - 1));
    // Mean of the output itself there: whether a difference makes it larger or smaller in size.
    let level = inside
        .iter()
        .filter_map(|r| {
            impacts[r.0].measured.iter().position(|x| *x == k).map(|row| signs.of_output(OUTPUTS[k], &impacts[r.0].inputs) * impacts[r.0].outputs[row])
        })
        .sum::<f64>()
        / m as f64;
    let words = in_words(OUTPUTS[k], along, from, to, mean, elsewhere, level, a == 0, b == groups);
    let place = Place {
        output: OUTPUTS[k].to_owned(),
        input: along.name().to_owned(),
        from,
        to,
        mean_residual: mean,
        ci_low: mean - HOLD_95_PERCENT * sd,
        ci_high: mean + HOLD_95_PERCENT * sd,
        mean_elsewhere: elsewhere,
        n: m,
        p_value,
        words,
    };
    Some((by_noise, place))
}

/// Where `n` sorted values are cut into groups of about equal size. No edge parts equal values: those that happen to come first are no range.
fn edges_between(n: usize, groups: usize, value: impl Fn(usize) -> f64) -> Vec<usize> {
    let whole = |mut edge: usize| {
        while edge > 0 && edge < n && value(edge - 1) == value(edge) {
            edge += 1;
        }
        edge
    };
    let mut edges: Vec<usize> = (0..=groups).map(|g| whole(g * n / groups)).collect();
    edges.dedup();
    edges
}

/// Mean residual with the weights of the noise, and its variance by that noise.
fn mean_and_variance<'a>(rows: impl Iterator<Item = &'a (usize, f64, f64)>) -> (f64, f64) {
    let (sum, weight) = rows.fold((0.0, 0.0), |(s, w), r| (s + r.1 / r.2, w + 1.0 / r.2));
    (sum / weight, 1.0 / weight)
}

/// Variance of that mean by how the residuals scatter: what else is wrong with the model widens it.
fn scatter_variance(rows: &[(usize, f64, f64)], mean: f64) -> f64 {
    // Weighted as in the test: an impact that is hardly known must not widen the interval of the others.
    rows.iter().map(|r| ((r.1 - mean) / r.2).powi(2)).sum::<f64>() / rows.iter().map(|r| 1.0 / r.2).sum::<f64>().powi(2)
}

/// "ball speed normal to the strings is over-predicted by 1.9 m/s for impacts beyond 60 mm toward the tip, not elsewhere".
fn in_words(output: &str, input: Coordinate, from: f64, to: f64, mean: f64, elsewhere: f64, level: f64, lowest: bool, highest: bool) -> String {
    let signed = level.abs() < 2.0 * mean.abs();
    let direction = |mean: f64| match (signed, mean * level < 0.0) {
        (false, true) => "over-predicted",
        (false, false) => "under-predicted",
        (true, _) if mean < 0.0 => "predicted too high",
        (true, _) => "predicted too low",
    };
    let whole = lowest && highest;
    let range = range_words(input, from, to, lowest, highest);
    let rest = if whole {
        String::new()
    } else if elsewhere.abs() < 0.25 * mean.abs() {
        ", not elsewhere".to_owned()
    } else {
        format!(" ({} by {} elsewhere)", direction(elsewhere), amount(output, elsewhere.abs()))
    };
    format!("{} is {} by {} {range}{rest}", column_subject(output), direction(mean), amount(output, mean.abs()))
}

fn amount(output: &str, value: f64) -> String {
    let text = match unit(output) {
        "s" => return format!("{:.2} ms", 1e3 * value),
        "rad/s" if value.abs() >= 10.0 => format!("{value:.0}"),
        "m/s" if value.abs() < 1.0 => format!("{value:.2}"),
        _ => format!("{value:.1}"),
    };
    format!("{text} {}", unit(output))
}

fn range_words(input: Coordinate, from: f64, to: f64, lowest: bool, highest: bool) -> String {
    let mm = |v: f64| format!("{:.0} mm", 1e3 * v);
    let usual = match input {
        Coordinate::Usual(j) => coordinate_name(j),
        Coordinate::Own(name) if !(lowest && highest) => return format!("where `{name}` is {from} to {to}"),
        Coordinate::Own(_) => "",
    };
    match usual {
        _ if lowest && highest => "over the whole range".to_owned(),
        "grip_torque" if from == to => format!("where the grip torque is {from:.1} N m"),
        "impact_x" if lowest && to < 0.0 => format!("for impacts beyond {} toward the tip", mm(-to)),
        "impact_x" if highest && from > 0.0 => format!("for impacts beyond {} toward the handle", mm(from)),
        "impact_x" => format!("for impacts between {} and {} along the racket (tip negative)", mm(from), mm(to)),
        "impact_y" if lowest && to < 0.0 => format!("for impacts beyond {} toward marker 2", mm(-to)),
        "impact_y" if highest && from > 0.0 => format!("for impacts beyond {} toward marker 3", mm(from)),
        "impact_y" => format!("for impacts between {} and {} across the face", mm(from), mm(to)),
        // People count from one.
        "order" => format!("for impacts {:.0} to {:.0} in the order they were recorded", from + 1.0, to + 1.0),
        other => {
            let name = match other {
                "grip_torque" => "the grip torque".to_owned(),
                _ => format!("{} before impact", column_subject(other).replace("speed", "velocity")),
            };
            let u = unit(other);
            let digits = if (to - from).abs() >= 20.0 { 0 } else { 1 };
            // Nothing is below minus nought.
            let tidy = |v: f64| if format!("{v:.digits$}").chars().any(|c| ('1'..='9').contains(&c)) { v } else { 0.0 };
            let (from, to) = (tidy(from), tidy(to));
            if lowest {
                format!("where {name} is below {to:.digits$} {u}")
            } else if highest {
                format!("where {name} is above {from:.digits$} {u}")
            } else {
                format!("where {name} is between {from:.digits$} and {to:.digits$} {u}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_equal_values_are_not_parted() {
        let torques = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 3.0, 4.0];
        assert_eq!(edges_between(10, 5, |i| torques[i]), [0, 5, 6, 9, 10]);
        assert_eq!(edges_between(10, 5, |i| i as f64), [0, 2, 4, 6, 8, 10]);
        assert_eq!(edges_between(10, 5, |_| 1.0), [0, 10]);
    }

    #[test]
    fn truth_words_say_too_fast_and_where() {
        let x = Coordinate::Usual(12);
        let words = in_words("ball_out_vz", x, -0.12, -0.06, -1.9, 0.02, 9.0, true, false);
        assert_eq!(words, "ball speed normal to the strings is over-predicted by 1.9 m/s for impacts beyond 60 mm toward the tip, not elsewhere");
        // A ball that leaves toward −z: measured less predicted is positive, so it is slower than predicted.
        assert!(in_words("ball_out_vz", x, -0.12, -0.06, 1.9, 0.02, -9.0, true, false).contains("over-predicted"));
        let torque = Coordinate::Usual(14);
        assert!(in_words("ball_out_vz", torque, 2.0, 5.0, 1.9, 0.02, 9.0, false, true).contains("where the grip torque is above 2.0 N m"));
    }
}
