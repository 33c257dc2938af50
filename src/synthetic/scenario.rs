//! A scenario file: what `sweetspot synth` should make. Unknown keys are refused.

use super::footage_spec::FootageSpec;
use super::hidden::Hidden;
use super::impact_world::{ImpactWorldError, Kind, SyntheticTable, TableSpec, generate_table};
use super::measurement::NoiseOptions;
use crate::limited_file::parser_words;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::de::DeTable;

/// What a scenario file holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Scenario {
    /// `kind = "table"`: an impacts table without pictures.
    Table(TableScenario),
    /// `kind = "footage"`: a session of footage; `setting` is `lab`, `court` or `hard`.
    Footage(FootageSpec),
}

/// An impacts table.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableScenario {
    /// `lab` or `court`.
    pub setting: Kind,
    pub impacts: usize,
    pub seed: u64,
    #[serde(default)]
    pub hidden: Vec<Hidden>,
    #[serde(default)]
    pub noise: NoiseOptions,
}

#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    #[error("{0}")]
    Toml(String),
    #[error("`kind` is {0}; allowed: \"table\" or \"footage\"")]
    Kind(String),
    #[error(transparent)]
    World(#[from] ImpactWorldError),
}

/// The files of a table: name and bytes, in the forms of the contract, with `truth.json` beside them.
pub struct TableFiles(pub Vec<(&'static str, String)>);

impl Scenario {
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        let told = |e: toml::de::Error| ScenarioError::Toml(parser_words(&e));
        // The kind is taken out before the rest is read: serde reads a choice that one of its keys makes from a copy that knows no lines.
        let mut table = DeTable::parse(text).map_err(told)?;
        let kind = table.get_mut().remove("kind").map(|kind| kind.into_inner());
        match kind.as_ref().map(|kind| kind.as_str()) {
            Some(Some("table")) => of_the_rest(table.into(), text).map(Scenario::Table).map_err(told),
            Some(Some("footage")) => of_the_rest(table.into(), text).map(Scenario::Footage).map_err(told),
            Some(Some(other)) => Err(ScenarioError::Kind(format!("{other:?}"))),
            Some(None) => Err(ScenarioError::Kind("no text in quotes".to_owned())),
            None => Err(ScenarioError::Kind("missing".to_owned())),
        }
    }
}

/// What the keys but the kind say; an error shows its line of the whole text.
fn of_the_rest<T: DeserializeOwned>(rest: toml::Deserializer, text: &str) -> Result<T, toml::de::Error> {
    T::deserialize(rest).map_err(|mut e| {
        e.set_input(Some(text));
        e
    })
}

impl TableScenario {
    /// Makes the table.
    pub fn generate(&self) -> Result<SyntheticTable, ScenarioError> {
        Ok(generate_table(&TableSpec { kind: self.setting, impacts: self.impacts, hidden: self.hidden.clone(), seed: self.seed, noise: self.noise.clone() })?)
    }
}

/// The rigid model a user would start from; its values are not the world's.
pub const FIRST_MODEL: &str = "base = \"rigid\"\n\n[parameters]\nrestitution = { value = 0.80, fit = true, min = 0.3, max = 1.0 }\nfriction = { value = 0.50, fit = true, min = 0.0, max = 1.5 }\n";

impl TableFiles {
    pub fn of(made: &SyntheticTable) -> Result<Self, ScenarioError> {
        let toml = |r: Result<String, toml::ser::Error>| r.map_err(|e| ScenarioError::Toml(e.to_string()));
        Ok(TableFiles(vec![
            ("impacts.csv", made.table.to_csv()),
            ("racket.toml", toml(toml::to_string(&made.racket))?),
            ("ball.toml", toml(toml::to_string(&made.ball))?),
            ("model.toml", FIRST_MODEL.to_owned()),
            ("truth.json", serde_json::to_string_pretty(&made.truth).map_err(|e| ScenarioError::Toml(e.to_string()))?),
        ]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_table_scenario_reads_and_a_misspelt_key_is_refused() {
        let text = "kind = \"table\"\nsetting = \"lab\"\nimpacts = 12\nseed = 3\n[[hidden]]\neffect = \"ball-wear\"\n[noise]\nunderstated = 1.25\n";
        let Scenario::Table(t) = Scenario::parse(text).expect("valid") else { panic!("a table") };
        let made = t.generate().expect("small");
        assert_eq!(made.table.rows.len(), 12);
        let sd = made.table.rows[0].get("ball_out_vz").and_then(|m| m.sd).expect("stated");
        assert!((sd - 0.08).abs() < 1e-12);
        let refused = |from: &str, to: &str| Scenario::parse(&text.replace(from, to)).expect_err("refused").to_string();
        let told = refused("understated", "overstated");
        assert!(told.contains("line 8") && told.contains("unknown key `overstated`"), "{told}");
        let told = refused("= 12", "= 7.5");
        assert!(told.contains("line 3") && told.contains("`7.5`, expected a whole number from 0 on"), "{told}");
        assert_eq!(refused("\"table\"", "\"tables\""), "`kind` is \"tables\"; allowed: \"table\" or \"footage\"");
        assert!(refused("kind", "kin").starts_with("`kind` is missing"));
    }
}
