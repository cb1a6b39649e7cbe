//! A stage: its prims, units and values. Values are checked as they are read.

use std::collections::BTreeMap;
use std::path::PathBuf;

use super::super::engine::Engine;
use super::super::error::{Place, SceneError, Warning};
use super::super::graph::FAR;
use super::super::graph::math::Vec3;
use super::files::{Files, Origin};
use super::layer::Value;
use super::lexer::Fault;
use super::prims::{self, Prim, Property, is_word};
use super::units::StageUnits;

/// Smallest and largest accepted unit. \[m, kg\]
const UNITS: (f64, f64) = (1e-12, 1e12);

/// A composed stage.
pub(super) struct Stage<'f> {
    files: &'f Files,
    pub(super) engine: &'f dyn Engine,
    pub(super) prims: Vec<Prim>,
    pub(super) units: StageUnits,
    /// True if the stage states its time codes per second.
    pub(super) has_rate: bool,
    places: BTreeMap<String, usize>,
}

impl<'f> Stage<'f> {
    pub(super) fn new(
        files: &'f Files,
        engine: &'f dyn Engine,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, SceneError> {
        let units = StageUnits::METERS;
        let prims = prims::all(files)?;
        let places = prims.iter().enumerate().map(|(i, prim)| (prim.path.clone(), i)).collect();
        let mut stage = Self { files, engine, prims, units, has_rate: false, places };
        let unit = |key: &str, (low, high): (f64, f64)| stage.metadata_number(key, low, high);
        let meters = unit("metersPerUnit", UNITS)?;
        if meters.is_none() {
            warnings.push(Warning {
                place: Place::File,
                message: "there is no metersPerUnit: a unit is a centimeter, as OpenUSD has it"
                    .into(),
            });
        }
        let kilograms = unit("kilogramsPerUnit", UNITS)?;
        let own = unit("timeCodesPerSecond", (1e-3, 1e9))?;
        let rate = own.or(unit("framesPerSecond", (1e-3, 1e9))?);
        let start = unit("startTimeCode", (-FAR, FAR))?;
        let up = stage.metadata("upAxis");
        let z_up = match up {
            None => false,
            Some((value, _)) if is_word(value, "y") => false,
            Some((value, _)) if is_word(value, "z") => true,
            Some((value, at)) => {
                let accepted = "accepted: \"Y\", \"Z\"";
                return Err(files.fault(0, Fault::new(at, "upAxis", value.label(), accepted)));
            }
        };
        stage.has_rate = rate.is_some();
        stage.units = StageUnits {
            meters: meters.unwrap_or(0.01),
            kilograms: kilograms.unwrap_or(1.0),
            z_up,
            rate: rate.unwrap_or(24.0),
            start: start.unwrap_or(0.0),
        };
        Ok(stage)
    }

    /// Returns a metadata value of the stage and its offset in the root layer.
    pub(super) fn metadata(&self, key: &str) -> Option<(&'f Value, usize)> {
        let entry = self.files.layers.first()?.root.metadata(key)?;
        (entry.value != Value::Blocked).then_some((&entry.value, entry.at))
    }

    /// Returns the paths of all layers.
    pub(super) fn layers(&self) -> Vec<PathBuf> {
        self.files.paths.clone()
    }

    /// Returns the name of the default prim.
    pub(super) fn default_prim(&self) -> Option<String> {
        match self.metadata("defaultPrim") {
            Some((Value::Text(name), _)) => Some(name.clone()),
            _ => None,
        }
    }

    fn metadata_number(&self, key: &str, low: f64, high: f64) -> Result<Option<f64>, SceneError> {
        match self.metadata(key) {
            None => Ok(None),
            Some((Value::Number(x), _)) if (low..=high).contains(x) => Ok(Some(*x)),
            Some((other, at)) => {
                let accepted = format!("accepted: a number from {low:e} to {high:e}");
                Err(self.files.fault(0, Fault::new(at, key, other.label(), accepted)))
            }
        }
    }

    /// Returns an error about the stage as a whole.
    pub(super) fn fault(&self, item: &str, accepted: String) -> SceneError {
        self.files.fault(0, Fault::new(0, item, "", accepted))
    }

    pub(super) fn prim(&self, index: usize) -> Option<&Prim> {
        self.prims.get(index)
    }

    /// Returns the index of the prim at a path.
    pub(super) fn find(&self, path: &str) -> Option<usize> {
        self.places.get(path).copied()
    }

    /// Iterates over a prim and its ancestors, upwards.
    pub(super) fn up(&self, index: usize) -> impl Iterator<Item = (usize, &Prim)> {
        let next = |(_, prim): &(usize, &Prim)| {
            let above = prim.parent?;
            Some((above, self.prim(above)?))
        };
        std::iter::successors(self.prim(index).map(|prim| (index, prim)), next)
    }

    pub(super) fn place(&self, prim: &Prim) -> Place {
        self.files.place(prim.origin)
    }

    pub(super) fn warn(&self, prim: &Prim, what: impl std::fmt::Display, to: &mut Vec<Warning>) {
        to.push(Warning { place: self.place(prim), message: format!("<{}>: {what}", prim.path) });
    }

    /// Returns an error about a prim.
    pub(super) fn wrong(
        &self,
        prim: &Prim,
        what: &str,
        value: String,
        accepted: &str,
    ) -> SceneError {
        let Origin { layer, at } = prim.origin;
        let item = format!("{what} of <{}>", prim.path);
        self.files.fault(layer, Fault::new(at, item, value, accepted))
    }

    /// Returns an error about a property.
    pub(super) fn refuse(&self, prim: &Prim, name: &str, accepted: &str) -> SceneError {
        let property = prim.properties.get(name);
        let Origin { layer, at } = property.map_or(prim.origin, |property| property.origin);
        let value = property.and_then(Property::value).map_or_else(String::new, Value::label);
        let item = format!("{name} of <{}>", prim.path);
        self.files.fault(layer, Fault::new(at, item, value, format!("accepted: {accepted}")))
    }

    pub(super) fn value<'p>(&self, prim: &'p Prim, name: &str) -> Option<&'p Value> {
        prim.properties.get(name).and_then(Property::value)
    }

    /// Reads a number within a range.
    pub(super) fn number(
        &self,
        prim: &Prim,
        name: &str,
        low: f64,
        high: f64,
    ) -> Result<Option<f64>, SceneError> {
        match self.value(prim, name) {
            None => Ok(None),
            Some(Value::Number(x)) if (low..=high).contains(x) => Ok(Some(*x)),
            Some(_) => Err(self.refuse(prim, name, &format!("a number from {low:?} to {high:?}"))),
        }
    }

    pub(super) fn flag(&self, prim: &Prim, name: &str) -> Result<Option<bool>, SceneError> {
        match self.value(prim, name) {
            None => Ok(None),
            Some(Value::Number(x)) => Ok(Some(*x != 0.0)),
            Some(value) if is_word(value, "true") => Ok(Some(true)),
            Some(value) if is_word(value, "false") => Ok(Some(false)),
            Some(_) => Err(self.refuse(prim, name, "true, false, 1 or 0")),
        }
    }

    pub(super) fn word<'p>(
        &self,
        prim: &'p Prim,
        name: &str,
    ) -> Result<Option<&'p str>, SceneError> {
        match self.value(prim, name) {
            None => Ok(None),
            Some(Value::Text(text)) => Ok(Some(text)),
            Some(_) => Err(self.refuse(prim, name, "a text")),
        }
    }

    /// Reads a vector with components of magnitude up to `most`.
    pub(super) fn vector<const N: usize>(
        &self,
        prim: &Prim,
        name: &str,
        most: f64,
    ) -> Result<Option<[f64; N]>, SceneError> {
        let Some(vector) = self.any_vector::<N>(prim, name)? else { return Ok(None) };
        if vector.iter().all(|x| x.abs() <= most) {
            return Ok(Some(vector));
        }
        Err(self.refuse(prim, name, &format!("{N} numbers from {:?} to {most:?}", -most)))
    }

    /// Reads a vector; components may be infinite but not NaN.
    pub(super) fn any_vector<const N: usize>(
        &self,
        prim: &Prim,
        name: &str,
    ) -> Result<Option<[f64; N]>, SceneError> {
        let vector = match self.value(prim, name) {
            None => return Ok(None),
            Some(Value::Tuple(numbers)) => <[f64; N]>::try_from(numbers.as_slice()).ok(),
            Some(_) => None,
        };
        match vector.filter(|vector| vector.iter().all(|x| !x.is_nan())) {
            Some(vector) => Ok(Some(vector)),
            None => Err(self.refuse(prim, name, &format!("{N} numbers"))),
        }
    }

    /// Reads a list of points with coordinates of magnitude up to `most`.
    pub(super) fn points(
        &self,
        prim: &Prim,
        name: &str,
        most: f64,
    ) -> Result<Vec<Vec3>, SceneError> {
        let points = match self.value(prim, name) {
            None => Vec::new(),
            Some(Value::Tuples(3, numbers)) => numbers.as_chunks::<3>().0.to_vec(),
            Some(Value::Numbers(none)) if none.is_empty() => Vec::new(),
            Some(_) => return Err(self.refuse(prim, name, "a list of points")),
        };
        let Some(wrong) = points.iter().position(|p| p.iter().any(|x| !(-most..=most).contains(x)))
        else {
            return Ok(points);
        };
        let value = points.get(wrong).map_or_else(String::new, |point| format!("{point:?}"));
        let Origin { layer, at } = prim.properties.get(name).map_or(prim.origin, |p| p.origin);
        let item = format!("point {wrong} of {name} of <{}>", prim.path);
        let accepted = format!("accepted: coordinates up to {most:e}");
        Err(self.files.fault(layer, Fault::new(at, item, value, accepted)))
    }

    /// Reads a list of whole numbers from 0.
    pub(super) fn whole_numbers(
        &self,
        prim: &Prim,
        name: &str,
    ) -> Result<Option<Vec<u32>>, SceneError> {
        let Some(value) = self.value(prim, name) else { return Ok(None) };
        let Value::Numbers(numbers) = value else {
            return Err(self.refuse(prim, name, "a list of whole numbers"));
        };
        let whole = |x: &f64| {
            (x.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(x)).then_some(*x as u32)
        };
        let whole_numbers: Option<Vec<u32>> = numbers.iter().map(whole).collect();
        whole_numbers.map(Some).ok_or_else(|| self.refuse(prim, name, "whole numbers from 0"))
    }

    pub(super) fn targets<'p>(&self, prim: &'p Prim, name: &str) -> &'p [String] {
        prim.properties.get(name).map_or(&[], |property| &property.targets)
    }
}
