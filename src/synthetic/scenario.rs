//! A scenario file: what `sweetspot synth` should make. Unknown keys are refused.

use super::footage_spec::FootageSpec;
use super::hidden::Hidden;
use super::impact_world::{ImpactWorldError, Kind, SyntheticTable, TableSpec, generate_table};
use super::measurement::NoiseOptions;
use serde::Deserialize;

/// What a scenario file holds.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Scenario {
    /// An impacts table without pictures.
    Table(TableScenario),
    /// A session of footage; `setting` is `lab`, `court` or `hard`.
    Footage(FootageSpec),
}

/// `kind = "table"`.
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
    #[error(transparent)]
    World(#[from] ImpactWorldError),
}

/// The files of a table: name and bytes, in the forms of the contract, with `truth.json` beside them.
pub struct TableFiles(pub Vec<(&'static str, String)>);

impl Scenario {
    pub fn parse(text: &str) -> Result<Self, ScenarioError> {
        toml::from_str(text).map_err(|e| ScenarioError::Toml(e.to_string()))
    }
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
        assert!(Scenario::parse(&text.replace("understated", "overstated")).is_err());
    }
}
