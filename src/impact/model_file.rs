//! The model file (contract, section 7): reading it strictly, and changing it without losing the user's comments.

use super::card::ParameterCard;
use super::effects::effect_card;
use super::error::ModelError;
use super::model::{Base, Model};
use super::parameter::Parameter;
use super::rigid::Sliding;
use super::viscoelastic::{BallLaw, FrictionDirection, NormalForce, Release, StringLaw};
use crate::limited_file::{LARGEST_TEXT, parser_words, read_text};
use crate::near_names::near_names;
use crate::quantity::as_written;
use std::path::Path;
use toml_edit::{DocumentMut, InlineTable, Item, Table, TableLike, Value};

impl Model {
    /// Reads and checks a model file.
    ///
    /// # Errors
    /// Unreadable or invalid TOML; unknown bases, keys, effects (with near matches); values out of range.
    pub fn read(path: &Path) -> Result<Model, ModelError> {
        let text = read_text(path, LARGEST_TEXT).map_err(|e| ModelError::Unreadable { path: path.into(), message: e.to_string() })?;
        Model::parse(&text, path)
    }

    /// From the text of a model file; `path` is for messages.
    ///
    /// # Errors
    /// As [`Model::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Model, ModelError> {
        Model::parse_unplaced(text, path).map_err(|e| e.in_file(path))
    }

    fn parse_unplaced(text: &str, path: &Path) -> Result<Model, ModelError> {
        let document = parse_document(text, path)?;
        only_keys(path, "the file", document.as_table(), &["base", "parameters", "effects"])?;
        let value = |key: &str, seen: String, allowed: &str| ModelError::Value { path: path.into(), key: key.into(), seen, allowed: allowed.into() };
        let bases = "\"rigid\" or \"viscoelastic\"";
        let base = match document.get("base").map(|b| b.as_str().ok_or_else(|| value("base", shown(b), bases))) {
            Some(Ok("rigid")) => Base::Rigid,
            Some(Ok("viscoelastic")) => Base::Viscoelastic,
            Some(Ok(other)) => return Err(value("base", format!("{other:?}"), bases)),
            Some(Err(e)) => return Err(e),
            None => return Err(value("base", "missing".into(), bases)),
        };
        let mut model = Model::new(base);
        if let Some(item) = document.get("parameters") {
            let table = item.as_table_like().ok_or_else(|| value("parameters", shown(item), "a table [parameters]"))?;
            let mut known: Vec<&str> = base.parameters().iter().map(|c| c.name).collect();
            match base {
                Base::Rigid => known.push("sliding"),
                Base::Viscoelastic => known.extend([BallLaw::KEY, StringLaw::KEY, Release::KEY, NormalForce::KEY, FrictionDirection::KEY]),
            }
            only_keys(path, "[parameters]", table, &known)?;
            if let Some(sliding) = table.get("sliding") {
                model.set_sliding(match sliding.as_str() {
                    Some("first-touch") => Sliding::FirstTouch,
                    Some("exact") => Sliding::Exact,
                    _ => return Err(value("parameters.sliding", shown(sliding), "\"first-touch\" (default) or \"exact\"")),
                });
            }
            if let Some(law) = read_choice(path, table, BallLaw::KEY, BallLaw::NAMES, BallLaw::from_name)? {
                model.set_ball_law(law)?;
            }
            if let Some(law) = read_choice(path, table, StringLaw::KEY, StringLaw::NAMES, StringLaw::from_name)? {
                model.set_string_law(law)?;
            }
            let laws = model.contact_laws_mut();
            if let Some(release) = read_choice(path, table, Release::KEY, Release::NAMES, Release::from_name)? {
                laws.release = release;
            }
            if let Some(place) = read_choice(path, table, NormalForce::KEY, NormalForce::NAMES, NormalForce::from_name)? {
                laws.normal_force = place;
            }
            if let Some(direction) = read_choice(path, table, FrictionDirection::KEY, FrictionDirection::NAMES, FrictionDirection::from_name)? {
                laws.friction_direction = direction;
            }
            read_parameters(path, &mut model, table, None, base.parameters())?;
        }
        if let Some(item) = document.get("effects") {
            let table = item.as_table_like().ok_or_else(|| value("effects", shown(item), "tables [effects.<name>]"))?;
            if table.len() > MOST_EFFECTS {
                return Err(value("effects", format!("{} tables", table.len()), &format!("at most {MOST_EFFECTS}")));
            }
            for (name, item) in table.iter() {
                let place = format!("effects.{name}");
                let own = item.as_table_like().ok_or_else(|| value(&place, shown(item), "a table"))?;
                model = read_effect(path, &model, name, own)?;
            }
        }
        let free = model.parameters().iter().filter(|p| p.fit).count();
        if free > MOST_FREE {
            return Err(value("fit", format!("true for {free} parameters"), &format!("at most {MOST_FREE}; no table of impacts tells more apart")));
        }
        Ok(model)
    }
}

/// Most effects of a model and most free parameters: reading takes their number squared, a fit cubed, and a fit's matrices hold it squared.
const MOST_EFFECTS: usize = 256;
const MOST_FREE: usize = 500;

/// One word out of a few, or nothing when the key is left out.
fn read_choice<T>(path: &Path, table: &dyn TableLike, key: &str, names: &[&str], from_name: fn(&str) -> Option<T>) -> Result<Option<T>, ModelError> {
    let Some(item) = table.get(key) else { return Ok(None) };
    let word = item.as_str().and_then(from_name);
    word.map(Some).ok_or_else(|| {
        let allowed = names.iter().map(|n| format!("\"{n}\"")).collect::<Vec<_>>().join(", ");
        ModelError::Value { path: path.into(), key: format!("parameters.{key}"), seen: shown(item), allowed }
    })
}

fn read_effect(path: &Path, model: &Model, name: &str, table: &dyn TableLike) -> Result<Model, ModelError> {
    // A parameter is named effect.parameter.
    if name.is_empty() || name.contains('.') {
        return Err(ModelError::Value { path: path.into(), key: "effects".into(), seen: format!("{name:?}"), allowed: "a name without dots".into() });
    }
    if table.contains_key("expression") || table.contains_key("replaces") {
        return read_expression(path, model, name, table);
    }
    let Some(card) = effect_card(name) else {
        return Err(ModelError::unknown_effect(name));
    };
    let known: Vec<&str> = card.parameters.iter().map(|c| c.name).collect();
    only_keys(path, &format!("[effects.{name}]"), table, &known)?;
    let mut model = model.with_effect(name)?;
    // What the file says decides what is fitted; what it leaves out stays at its default.
    for index in model.effect_parameters(name) {
        if let Some(p) = model.parameter_mut(index) {
            p.fit = false;
        }
    }
    read_parameters(path, &mut model, table, Some(name), card.parameters)?;
    Ok(model)
}

/// Most parameters of one expression.
const MAX_OWN_PARAMETERS: usize = 64;

fn read_expression(path: &Path, model: &Model, name: &str, table: &dyn TableLike) -> Result<Model, ModelError> {
    let place = format!("effects.{name}");
    let wrong = |key: &str, seen: String, allowed: &str| ModelError::Value { path: path.into(), key: format!("{place}.{key}"), seen, allowed: allowed.into() };
    if effect_card(name).is_some() {
        return Err(wrong("expression", name.to_owned(), "a name of your own; this one is in the catalogue"));
    }
    let text = |key: &str| -> Result<String, ModelError> {
        let missing = || {
            // A parameter is never a text: one that is may be the key, mistyped.
            let other = table.iter().find(|(k, item)| *k != "expression" && *k != "replaces" && item.as_str().is_some());
            wrong(key, "missing".into(), &other.map_or("a text in quotes".to_owned(), |(k, _)| format!("a text in quotes; `{k}` holds one, is it meant?")))
        };
        let item = table.get(key).ok_or_else(missing)?;
        item.as_str().map(str::to_owned).ok_or_else(|| wrong(key, shown(item), "a text in quotes"))
    };
    let (expression, replaces) = (text("expression")?, text("replaces")?);
    let mut parameters = Vec::new();
    for (key, item) in table.iter().filter(|(k, _)| *k != "expression" && *k != "replaces") {
        if !key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') || key.starts_with(|c: char| c.is_ascii_digit()) {
            return Err(wrong(key, key.to_owned(), "letters, digits and _, not starting with a digit"));
        }
        if parameters.len() == MAX_OWN_PARAMETERS {
            return Err(wrong(key, "one parameter too many".into(), &format!("at most {MAX_OWN_PARAMETERS} parameters")));
        }
        let mut parameter = Parameter::own(&format!("{name}.{key}"), 0.0);
        read_parameter(path, item, &mut parameter)?;
        parameter.rescale_own();
        parameters.push(parameter);
    }
    let keys: Vec<String> = parameters.iter().map(|p| p.key().to_owned()).collect();
    let model = model.with_expression(name, &replaces, &expression, parameters)?;
    // A fit would leave it where it is, and its user would believe that it acts.
    let own = model.effects().iter().find(|e| e.name == name).and_then(|e| e.expression.as_deref());
    let idle = own.and_then(|own| keys.iter().enumerate().find(|(index, _)| !own.uses_parameter(*index)));
    match idle {
        Some((_, key)) => Err(wrong(key, "not in the expression".into(), "a parameter that it names; write it there, or take it out of the file")),
        None => Ok(model),
    }
}

fn read_parameters(path: &Path, model: &mut Model, table: &dyn TableLike, effect: Option<&str>, cards: &[ParameterCard]) -> Result<(), ModelError> {
    for card in cards {
        let Some(item) = table.get(card.name) else { continue };
        let mut parameter = Parameter::from_card(effect, card);
        parameter.fit = false;
        read_parameter(path, item, &mut parameter)?;
        let index = model.index_of(&parameter.name)?;
        model.set_at(index, parameter.value)?;
        if let Some(p) = model.parameter_mut(index) {
            *p = parameter;
        }
    }
    Ok(())
}

/// Largest friction that a model file may state.
const NEVER_SLIPS: f64 = 1e6;

/// Reads `0.8` or `{ value = 0.8, fit = true, min = 0.3, max = 1.0 }` into a parameter that holds the allowed range.
pub(crate) fn read_parameter(path: &Path, item: &Item, parameter: &mut Parameter) -> Result<(), ModelError> {
    let place = match parameter.name.split_once('.') {
        Some((effect, key)) => format!("effects.{effect}.{key}"),
        None => format!("parameters.{}", parameter.name),
    };
    // A ball that never slips is asked for by a friction beyond any that is fitted.
    let beyond = if ["friction", "mu"].contains(&parameter.name.as_str()) { NEVER_SLIPS } else { parameter.max };
    let (hard_min, hard_max) = (parameter.min, beyond);
    let wrong = |key: &str, seen: String, allowed: String| ModelError::Value { path: path.into(), key: key.into(), seen, allowed };
    let number = |key: &str, item: &Item| -> Result<f64, ModelError> {
        let v = item.as_float().or_else(|| item.as_integer().map(|i| i as f64));
        v.filter(|v| v.is_finite()).ok_or_else(|| wrong(key, shown(item), "a finite number".into()))
    };
    let within = |key: &str, v: f64| -> Result<f64, ModelError> {
        if v >= hard_min && v <= hard_max { Ok(v) } else { Err(wrong(key, as_written(v), format!("{hard_min} to {hard_max}"))) }
    };
    let Some(table) = item.as_table_like() else {
        let v = item.as_float().or_else(|| item.as_integer().map(|i| i as f64));
        let v = v.ok_or_else(|| wrong(&place, shown(item), "a number, or { value = .., fit = .., min = .., max = .. }".into()))?;
        parameter.value = within(&place, v)?;
        parameter.max = parameter.max.max(v);
        return Ok(());
    };
    only_keys(path, &place, table, &["value", "fit", "min", "max"])?;
    if let Some(item) = table.get("fit") {
        parameter.fit = item.as_bool().ok_or_else(|| wrong(&format!("{place}.fit"), shown(item), "true or false".into()))?;
    }
    for (key, bound) in [("min", &mut parameter.min), ("max", &mut parameter.max)] {
        if let Some(item) = table.get(key) {
            let key = format!("{place}.{key}");
            *bound = within(&key, number(&key, item)?)?;
        }
    }
    if parameter.min > parameter.max {
        return Err(wrong(&format!("{place}.min"), parameter.min.to_string(), format!("at most max = {}", parameter.max)));
    }
    if let Some(item) = table.get("value") {
        parameter.value = number(&format!("{place}.value"), item)?;
        if table.get("max").is_none() && parameter.value <= hard_max {
            parameter.max = parameter.max.max(parameter.value);
        }
    }
    if !(parameter.value >= parameter.min && parameter.value <= parameter.max) {
        return Err(wrong(&format!("{place}.value"), as_written(parameter.value), format!("{} to {}", parameter.min, parameter.max)));
    }
    Ok(())
}

fn parse_document(text: &str, path: &Path) -> Result<DocumentMut, ModelError> {
    text.parse().map_err(|e: toml_edit::TomlError| ModelError::Toml { path: path.into(), message: parser_words(&e) })
}

pub(crate) fn only_keys(path: &Path, place: &str, table: &dyn TableLike, known: &[&str]) -> Result<(), ModelError> {
    for (key, _) in table.iter() {
        if !known.contains(&key) {
            return Err(ModelError::UnknownKey {
                path: path.into(),
                place: place.to_owned(),
                key: key.to_owned(),
                near: near_names(key, known.iter().copied()),
                known: known.join(", "),
            });
        }
    }
    Ok(())
}

fn shown(item: &Item) -> String {
    item.to_string().trim().to_owned()
}

fn inline(parameter: &Parameter) -> Item {
    let mut table = InlineTable::new();
    table.insert("value", parameter.value.into());
    table.insert("fit", parameter.fit.into());
    table.insert("min", parameter.min.into());
    table.insert("max", parameter.max.into());
    Item::Value(Value::InlineTable(table))
}

/// The model file's text with a catalogue effect added at its defaults; comments and layout stay.
///
/// # Errors
/// The text is no valid model; the effect is unknown or already there.
pub fn with_effect_added(text: &str, effect: &str, path: &Path) -> Result<String, ModelError> {
    let model = Model::parse(text, path)?.with_effect(effect).map_err(|e| match e {
        // An unknown name is nothing of the file's.
        ModelError::UnknownEffect { .. } => e,
        e => e.in_file(path),
    })?;
    let mut document = parse_document(text, path)?;
    let mut table = Table::new();
    for index in model.effect_parameters(effect) {
        let p = &model.parameters()[index];
        table.insert(p.key(), if p.fit { inline(p) } else { Item::Value(p.value.into()) });
    }
    if let Some(card) = effect_card(effect) {
        let first = card.physics.split(". ").next().unwrap_or(card.physics).trim_end_matches('.');
        table.decor_mut().set_prefix(format!("\n# {first}.\n"));
    }
    let effects = document.entry("effects").or_insert_with(|| {
        let mut t = Table::new();
        t.set_implicit(true);
        Item::Table(t)
    });
    if let Some(t) = effects.as_table_like_mut() {
        t.insert(effect, Item::Table(table));
    }
    let text = document.to_string();
    Model::parse(&text, path)?;
    Ok(text)
}

/// The model file's text with new values for parameters named as in [`Model::parameters`]; comments and layout stay.
///
/// # Errors
/// The text is no valid model, a name it does not have, or a value outside its bounds.
pub fn with_values(text: &str, values: &[(String, f64)], path: &Path) -> Result<String, ModelError> {
    let model = Model::parse(text, path)?;
    let mut document = parse_document(text, path)?;
    for (name, value) in values {
        let parameter = &model.parameters()[model.index_of(name)?];
        let (section, key): (Vec<&str>, &str) = match name.split_once('.') {
            Some((effect, key)) => (vec!["effects", effect], key),
            None => (vec!["parameters"], name),
        };
        let mut item = document.as_item_mut();
        for part in section {
            item = item.as_table_like_mut().ok_or(ModelError::NotFinite)?.entry(part).or_insert(Item::Table(Table::new()));
        }
        let Some(table) = item.as_table_like_mut() else { continue };
        match table.get_mut(key) {
            Some(existing) => match existing.as_table_like_mut() {
                Some(inner) => replace_value(inner.entry("value").or_insert(Item::None), *value),
                None => replace_value(existing, *value),
            },
            None => {
                let p = Parameter { value: *value, ..parameter.clone() };
                table.insert(key, if p.fit { inline(&p) } else { Item::Value(p.value.into()) });
            }
        }
    }
    let text = document.to_string();
    Model::parse(&text, path)?;
    Ok(text)
}

/// Puts a number where another stood, keeping spaces and comments around it.
fn replace_value(item: &mut Item, value: f64) {
    let decor = item.as_value().map(|v| v.decor().clone());
    let mut new = Value::from(value);
    if let Some(d) = decor {
        *new.decor_mut() = d;
    }
    *item = Item::Value(new);
}
