//! Does the model fail otherwise in some groups of a table than in others: one racket, one ball, one player, one day?
//!
//! No smooth function of the inputs shows that, and where nothing looks for it it passes for noise. For every column that
//! parts the impacts into groups, each group has an impulse of its own along the normal (with speed and along the racket, too)
//! and along the slip, a friction, and its racket a push, a turn about either axis of the face, and a turn with the place of impact of its own: one player's hand,
//! one racket's mass, a place that is read beside the true one. What the model's parameters, the offsets of the sessions and all smooth corrections can imitate is projected out, and the rest tested as in [`super::structure`], corrected for the number of columns.

use super::fit::Fit;
use super::linearise::Linearised;
use super::observation::{Observation, Observations};
use super::project::{Nuisance, beside, project_out};
use super::structure::{ContactInputs, channels, friction_slope, independent_directions, wild_p_value};
use crate::impact_table::INPUTS;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

/// Level of the test, corrected for the number of columns. At 0.002 five of 300 sound tables with three such columns each failed: far in its
/// tail the bootstrap of few groups is too sure of itself. A fault worth naming is beyond 1e-4.
pub const GROUP_LEVEL: f64 = 0.0003;
/// Groups smaller than this are not looked at, nor columns with more than so many.
const FEWEST_IN_GROUP: usize = 8;
pub(super) const MOST_GROUPS: usize = 40;
/// A column of more different numbers is cut into so many ranges, unless it goes with an input or the order (correlation above the second).
const RANGES: usize = 4;
const OWN: f64 = 0.4;
/// What a group may have of its own: a channel (column of [`channels`]) times a factor, in words.
const CHANNELS: [(usize, Factor, &str); 8] = [
    (0, Factor::One, "the impulse along the normal"),
    (0, Factor::Speed, "the impulse along the normal, at 25 m/s more,"),
    (0, Factor::Along, "the impulse along the normal, at the head's end towards the handle,"),
    (1, Factor::One, "the impulse along the slip"),
    (9, Factor::One, "the racket's push along the normal"),
    (ANGULAR[0], Factor::One, "the racket's angular impulse about its own axis"),
    (ANGULAR[1], Factor::Along, "the racket's angular impulse about the axis across the face, at the head's end towards the handle,"),
    (ANGULAR[1], Factor::One, "the racket's angular impulse about the axis across the face"),
];
/// And the friction, where balls slide; its unit.
const FRICTION: &str = "the friction";
const OF_ITSELF: &str = "what it is in all";
/// The channels whose unit is an impulse at a lever of 0.1 m, about the racket's axis and across it, and the units in words.
const ANGULAR: [usize; 2] = [12, 13];
const IMPULSE: &str = "the impulse of a contact without rebound";
const AT_A_LEVER: &str = "that of a contact without rebound 10 cm from the centre of mass";
/// Speed that a change with speed is told for, m/s.
const SPEED_M_S: f64 = 25.0;

#[derive(Clone, Copy)]
enum Factor {
    One,
    /// Approach speed less the table's mean, over [`SPEED_M_S`].
    Speed,
    /// Place along the racket less the table's mean, over half the head's length.
    Along,
}

impl Factor {
    fn of(self, observations: &Observations, impacts: &[&Observation], fit: &Fit) -> Vec<f64> {
        let raw: Vec<f64> = fit
            .impacts
            .iter()
            .zip(impacts)
            .map(|(l, o)| {
                let gear = &observations.gear[o.gear];
                match self {
                    Factor::One => 1.0,
                    Factor::Speed => ContactInputs::of(&l.true_inputs, gear).approach_m_s / SPEED_M_S,
                    Factor::Along => l.true_inputs[12] / (0.5 * gear.racket.head.inner_length_m),
                }
            })
            .collect();
        let mean = if matches!(self, Factor::One) { 0.0 } else { raw.iter().sum::<f64>() / raw.len().max(1) as f64 };
        raw.iter().map(|v| v - mean).collect()
    }
}
/// Precision of the smooth corrections that are projected out: as good as free.
pub(super) const FREE: f64 = 1e-9;

/// What is most its own in a column whose groups differ.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct GroupMisfit {
    pub column: String,
    pub group: String,
    /// Impacts of the fit in it.
    pub n: usize,
    /// What differs, and by what share of `unit`.
    pub what: String,
    #[serde(default)]
    pub unit: String,
    pub change: f64,
    pub sd: f64,
    /// Of the whole column, corrected for the number of columns.
    pub p_value: f64,
}

impl GroupMisfit {
    /// In deviations.
    fn size(&self) -> f64 {
        self.change.abs() / self.sd
    }

    /// "where `racket` is "Gamma", the impulse along the normal is smaller than elsewhere by 3.9 ± 0.1 % of …".
    pub fn words(&self) -> String {
        format!(
            "where `{}` is {:?} ({} impacts), {} is {} than elsewhere by {:.1} ± {:.1} % of {}",
            self.column,
            self.group,
            self.n,
            self.what,
            if self.change < 0.0 { "smaller" } else { "larger" },
            100.0 * self.change.abs(),
            100.0 * self.sd,
            self.unit
        )
    }
}

/// The columns looked at, and those whose groups differ with the whitened signatures of their groups.
pub struct GroupTest {
    pub tested: usize,
    pub failing: Vec<(GroupMisfit, Vec<DMatrix<f64>>)>,
}

/// The columns that say of what kind an impact is: its racket, its ball, and the table's own; with the text of each impact.
pub(super) fn columns<'a>(observations: &'a Observations, impacts: &[&'a Observation]) -> Vec<(&'a str, Vec<Option<&'a str>>)> {
    let texts = |of: &dyn Fn(&'a Observation) -> Option<&'a str>| impacts.iter().map(|o| of(o)).collect();
    let gear = &observations.gear;
    let mut all = vec![("racket", texts(&|o| Some(gear[o.gear].racket.name.as_str()))), ("ball", texts(&|o| Some(gear[o.gear].ball.name.as_str())))];
    let own: BTreeSet<&str> = impacts.iter().flat_map(|o| o.groups.keys()).map(String::as_str).collect();
    all.extend(own.into_iter().map(|name| (name, texts(&|o| o.groups.get(name).map(String::as_str)))));
    all
}

/// A column, and of each impact its group there.
type Labels<'a> = (String, Vec<Option<Cow<'a, str>>>);

/// The groups of each column; none of one that has too many and holds no numbers of its own.
fn labels<'a>(observations: &'a Observations, impacts: &[&'a Observation]) -> Vec<Labels<'a>> {
    let grouped = |(name, texts): (&str, Vec<Option<&'a str>>)| {
        let distinct: BTreeSet<&str> = texts.iter().flatten().copied().collect();
        let labels = if distinct.len() > MOST_GROUPS { ranges(&texts, impacts)? } else { texts.into_iter().map(|t| t.map(Cow::Borrowed)).collect() };
        Some((name.to_owned(), labels))
    };
    columns(observations, impacts).into_iter().filter_map(grouped).collect()
}

/// A column of numbers (a temperature) in [`RANGES`] groups of neighbours of about equal size. `None` where it holds something else, or goes with
/// an input or with the order: what depends on these is not the column's.
fn ranges<'a>(texts: &[Option<&str>], impacts: &[&Observation]) -> Option<Vec<Option<Cow<'a, str>>>> {
    let mut numbers: Vec<(usize, f64)> = Vec::new();
    for (i, text) in texts.iter().enumerate() {
        if let Some(text) = text.filter(|t| !t.trim().is_empty()) {
            numbers.push((i, text.trim().parse::<f64>().ok().filter(|v| v.is_finite())?));
        }
    }
    let goes_with = |of: &dyn Fn(&Observation) -> f64| {
        let pairs: Vec<(f64, f64)> = numbers.iter().map(|(i, v)| (*v, of(impacts[*i]))).collect();
        correlation(&pairs).abs() > OWN
    };
    if (0..INPUTS.len()).any(|j| goes_with(&|o| o.inputs[j]) || goes_with(&|o| o.inputs[j].abs())) || goes_with(&|o| o.order) {
        return None;
    }
    numbers.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut labels: Vec<Option<Cow<str>>> = vec![None; texts.len()];
    for k in 0..RANGES {
        let part = &numbers[k * numbers.len() / RANGES..(k + 1) * numbers.len() / RANGES];
        let (Some(first), Some(last)) = (part.first(), part.last()) else { continue };
        for (i, _) in part {
            labels[*i] = Some(Cow::Owned(format!("{} to {}", first.1, last.1)));
        }
    }
    Some(labels)
}

fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let n = pairs.len().max(1) as f64;
    let (mean_a, mean_b) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (a, b) in pairs {
        aa += (a - mean_a).powi(2);
        bb += (b - mean_b).powi(2);
        ab += (a - mean_a) * (b - mean_b);
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// How many impacts each group has.
fn counted<'a>(labels: impl Iterator<Item = &'a Cow<'a, str>>) -> BTreeMap<&'a str, usize> {
    let mut count = BTreeMap::new();
    labels.for_each(|label| *count.entry(label.as_ref()).or_default() += 1);
    count
}

fn large_enough(count: &BTreeMap<&str, usize>) -> Vec<String> {
    count.iter().filter(|(_, n)| **n >= FEWEST_IN_GROUP).map(|(label, _)| (*label).to_owned()).collect()
}

/// The columns that part the impacts, each with its groups that are large enough.
fn parted<'a>(observations: &'a Observations, impacts: &[&'a Observation]) -> Vec<(Labels<'a>, Vec<String>)> {
    let mut parted: Vec<(Labels, Vec<String>)> = Vec::new();
    for labels in labels(observations, impacts) {
        let count = counted(labels.1.iter().flatten());
        let groups = large_enough(&count);
        // Two columns that part the impacts alike are one (a player and his racket).
        let again = parted.iter().any(|((_, earlier), _)| same_parts(earlier, &labels.1));
        let few = (2..=MOST_GROUPS).contains(&groups.len()) && count.len() <= MOST_GROUPS;
        if few && !again {
            parted.push((labels, groups));
        }
    }
    parted
}

/// Every column that parts the impacts: of each impact the place of its group among the column's, and how many these are.
pub(super) fn parts(observations: &Observations, impacts: &[&Observation]) -> Vec<(String, Vec<Option<usize>>, usize)> {
    let place = |((column, labels), groups): (Labels, Vec<String>)| {
        let of = labels.iter().map(|label| groups.iter().position(|g| Some(g.as_str()) == label.as_deref())).collect();
        (column, of, groups.len())
    };
    parted(observations, impacts).into_iter().map(place).collect()
}

/// The groups of one column that are large enough among the impacts of the fit, and of each of `impacts` its place among these. What belongs to no such
/// group goes with the last one, of the rest.
pub(super) fn groups_of_column(observations: &Observations, impacts: &[&Observation], column: &str) -> Option<(Vec<String>, Vec<usize>)> {
    let (_, labels) = labels(observations, impacts).into_iter().find(|(name, _)| name == column)?;
    let fitted = labels.iter().zip(impacts).filter(|(_, o)| !o.held_out);
    let mut groups = large_enough(&counted(fitted.filter_map(|(l, _)| l.as_ref())));
    let rest = groups.len();
    let of: Vec<usize> = labels.iter().map(|l| groups.iter().position(|g| Some(g.as_str()) == l.as_deref()).unwrap_or(rest)).collect();
    if of.contains(&rest) {
        groups.push("all others".to_owned());
    }
    (groups.len() >= 2).then_some((groups, of))
}

/// Tests the columns of groups, or takes those that are `known` to fail. `generic`: the whitened signatures of all smooth corrections.
pub(super) fn group_test(
    fit: &Fit,
    observations: &Observations,
    impacts: &[&Observation],
    generic: &[DMatrix<f64>],
    known: Option<&[GroupMisfit]>,
    seed: u64,
) -> GroupTest {
    if let Some([]) = known {
        return GroupTest { tested: 0, failing: Vec::new() };
    }
    let mut parted = parted(observations, impacts);
    let tested = parted.len();
    let factors = CHANNELS.map(|(_, factor, _)| factor.of(observations, impacts, fit));
    let friction = friction_slope(fit);
    // Whitened, outputs × channels.
    let response = |(i, (l, o)): (usize, (&Linearised, &&Observation))| {
        let all = channels(&o.without_unmeasured(&l.true_inputs), &observations.gear[o.gear]);
        let own = &l.whitener * DMatrix::from_fn(l.measured.len(), CHANNELS.len(), |row, k| all[(l.measured[row], CHANNELS[k].0)] * factors[k][i]);
        friction.as_ref().map_or_else(|| own.clone(), |slope| beside(&own, &DMatrix::from_columns(&[slope[i].column(0)])))
    };
    let responses: Vec<DMatrix<f64>> = fit.impacts.iter().zip(impacts).enumerate().map(response).collect();
    if let Some(known) = known {
        let columns = known.iter().filter_map(|k| Some((k.clone(), parted.iter().find(|((name, _), _)| *name == k.column)?)));
        return GroupTest { tested, failing: columns.map(|(misfit, column)| (misfit, signatures(&responses, column))).collect() };
    }
    let mut failing: Vec<(GroupMisfit, Vec<DMatrix<f64>>)> = Vec::new();
    let mut smooth = generic.to_vec();
    // The column whose groups stand apart most first; the others must show something beside it.
    while !parted.is_empty() {
        let Ok(nuisance) = Nuisance::with_columns(fit, &smooth, |_| FREE) else { break };
        let most = parted
            .iter()
            .enumerate()
            .filter_map(|(i, column)| Some((i, one_column(fit, &nuisance, &responses, column, tested, seed)?)))
            .max_by(|(_, a), (_, b)| a.0.size().total_cmp(&b.0.size()));
        let Some((i, (misfit, blocks))) = most else { break };
        parted.remove(i);
        smooth = smooth.iter().zip(&blocks).map(|(a, b)| beside(a, b)).collect();
        failing.push((misfit, blocks));
    }
    GroupTest { tested, failing }
}

/// Whitened signatures of what the groups of columns that are known to fail have of their own; no columns without such.
pub(super) fn known_signatures(fit: &Fit, observations: &Observations, impacts: &[&Observation], known: &[GroupMisfit]) -> Vec<DMatrix<f64>> {
    let none: Vec<DMatrix<f64>> = fit.impacts.iter().map(|l| DMatrix::zeros(l.z.len(), 0)).collect();
    let failing = group_test(fit, observations, impacts, &none, Some(known), 0).failing;
    failing.iter().fold(none, |all, (_, blocks)| all.iter().zip(blocks).map(|(a, b)| beside(a, b)).collect())
}

/// Whitened signatures of what each group of a column may have of its own.
fn signatures(responses: &[DMatrix<f64>], ((_, labels), groups): &(Labels, Vec<String>)) -> Vec<DMatrix<f64>> {
    let block = |(label, response): (&Option<Cow<str>>, &DMatrix<f64>)| {
        let width = response.ncols();
        let mut block = DMatrix::zeros(response.nrows(), groups.len() * width);
        if let Some(g) = groups.iter().position(|g| Some(g.as_str()) == label.as_deref()) {
            block.columns_mut(g * width, width).copy_from(response);
        }
        block
    };
    labels.iter().zip(responses).map(block).collect()
}

/// What is most its own in a column whose groups differ, with the whitened signatures of its groups.
fn one_column(
    fit: &Fit,
    nuisance: &Nuisance,
    responses: &[DMatrix<f64>],
    column: &(Labels, Vec<String>),
    tested: usize,
    seed: u64,
) -> Option<(GroupMisfit, Vec<DMatrix<f64>>)> {
    let blocks = signatures(responses, column);
    let ((column, labels), groups) = column;
    let projected = project_out(fit, nuisance, &blocks);
    let parts = &projected.contributions * independent_directions(&projected);
    let p_value = (wild_p_value(&parts, parts.row_sum().norm_squared(), seed) * tested as f64).min(1.0);
    if p_value >= GROUP_LEVEL {
        return None;
    }
    let told = |j: &usize| projected.information[(*j, *j)] > 1e-6 * projected.raw[*j];
    let z = |j: usize| projected.score[j].abs() / projected.information[(j, j)].sqrt();
    let most = (0..projected.score.len()).filter(told).max_by(|a, b| z(*a).total_cmp(&z(*b)))?;
    let width = projected.score.len() / groups.len();
    let group = &groups[most / width];
    let (what, unit) = match CHANNELS.get(most % width) {
        Some((channel, _, what)) => (*what, if ANGULAR.contains(channel) { AT_A_LEVER } else { IMPULSE }),
        None => (FRICTION, OF_ITSELF),
    };
    let misfit = GroupMisfit {
        column: column.clone(),
        group: group.clone(),
        n: labels.iter().filter(|l| l.as_deref() == Some(group)).count(),
        what: what.to_owned(),
        unit: unit.to_owned(),
        change: projected.score[most] / projected.information[(most, most)],
        sd: projected.information[(most, most)].powf(-0.5),
        p_value,
    };
    Some((misfit, blocks))
}

/// A column is taken to change slowly over the table where neighbours in the order differ by less than this share of what any two do.
const SLOWLY: f64 = 0.2;
/// Correlation beyond which a column is the order itself.
const THE_ORDER: f64 = 0.999;

/// Columns that change slowly, or in blocks, over the table (a temperature, the racket of a day): what goes with the order may be theirs.
pub(super) fn slow_columns(observations: &Observations, impacts: &[&Observation]) -> Vec<String> {
    let mut ordered = impacts.to_vec();
    ordered.sort_by(|a, b| a.order.total_cmp(&b.order));
    columns(observations, &ordered).into_iter().filter(|(_, texts)| is_slow(texts)).map(|(name, _)| name.to_owned()).collect()
}

fn is_slow(texts: &[Option<&str>]) -> bool {
    let texts: Vec<&str> = texts.iter().flatten().copied().collect();
    let numbers: Option<Vec<f64>> = texts.iter().map(|t| t.trim().parse::<f64>().ok().filter(|v| v.is_finite())).collect();
    let n = texts.len().max(2) as f64;
    let (neighbours, any) = match numbers {
        Some(numbers) => {
            // A number of the impact, or its time, is the order itself.
            let with_order: Vec<(f64, f64)> = numbers.iter().enumerate().map(|(i, v)| (i as f64, *v)).collect();
            if correlation(&with_order).abs() > THE_ORDER {
                return false;
            }
            let mean = numbers.iter().sum::<f64>() / n;
            let squares = numbers.windows(2).map(|two| (two[1] - two[0]).powi(2)).sum::<f64>() / (n - 1.0);
            (squares, 2.0 * numbers.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n)
        }
        None => {
            let mut count: BTreeMap<&str, f64> = BTreeMap::new();
            texts.iter().for_each(|t| *count.entry(t).or_default() += 1.0);
            let differ = texts.windows(2).filter(|two| two[0] != two[1]).count() as f64 / (n - 1.0);
            (differ, 1.0 - count.values().map(|c| (c / n).powi(2)).sum::<f64>())
        }
    };
    any > 0.0 && neighbours < SLOWLY * any
}

fn same_parts(a: &[Option<Cow<str>>], b: &[Option<Cow<str>>]) -> bool {
    let pairs: BTreeSet<(Option<&str>, Option<&str>)> = a.iter().map(Option::as_deref).zip(b.iter().map(Option::as_deref)).collect();
    let left: BTreeSet<Option<&str>> = pairs.iter().map(|p| p.0).collect();
    let right: BTreeSet<Option<&str>> = pairs.iter().map(|p| p.1).collect();
    pairs.len() == left.len() && pairs.len() == right.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_what_changes_slowly_is_told_from_what_is_mixed_and_from_the_order_itself() {
        let texts = |of: &dyn Fn(usize) -> String| (0..60).map(of).collect::<Vec<_>>();
        let slow = |texts: &[String]| is_slow(&texts.iter().map(|t| Some(t.as_str())).collect::<Vec<_>>());
        assert!(slow(&texts(&|i| format!("{}", 20.0 + 5.0 * (i as f64 / 12.0).sin()))));
        assert!(slow(&texts(&|i| if i < 31 { "red" } else { "blue" }.to_owned())));
        assert!(!slow(&texts(&|i| if i % 2 == 0 { "red" } else { "blue" }.to_owned())));
        assert!(!slow(&texts(&|i| format!("{}", (i * 37) % 60))));
        assert!(!slow(&texts(&|i| format!("{}", 100 + i))));
        assert!(!slow(&texts(&|_| "red".to_owned())));
    }
}
