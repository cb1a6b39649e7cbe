//! [`Decompositions`]: those that are known, by content.

use std::collections::HashMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::surface::Surface;
use super::{ALGORITHM, Decomposition, DecompositionOptions, NotSolid, Unit};
use crate::recording::file::write_whole;

/// The variable that names the folder of stored decompositions, or turns it off.
const VARIABLE: &str = "DRYSTONE_CACHE";

/// Decompositions that are known by the content of their meshes: in memory, and in a folder if there is one.
///
/// Equal meshes, also of other sizes and places, are decomposed once. Stored pieces have the bits that
/// [`decompose`](super::decompose) finds. A file that is damaged, or of another version, is ignored, and so is
/// a folder that cannot be written.
#[derive(Debug, Default)]
pub struct Decompositions {
    known: HashMap<u128, Arc<Unit>>,
    folder: Option<PathBuf>,
}

impl Decompositions {
    /// Keeps them in a folder as well, which is made when there is something to keep.
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: Some(folder.to_owned()), ..Self::default() }
    }

    /// Keeps them in the user's folder for caches: `$DRYSTONE_CACHE`, else `drystone` in `$XDG_CACHE_HOME` or
    /// in `~/.cache` (macOS `~/Library/Caches`, Windows `%LOCALAPPDATA%`). With `DRYSTONE_CACHE=off`, or
    /// without any of these, in memory only.
    pub fn of_user() -> Self {
        let known = |name: &str| env::var_os(name).filter(|value| !value.is_empty());
        let folder = match known(VARIABLE) {
            Some(value) if value.eq_ignore_ascii_case("off") => None,
            Some(value) => Some(PathBuf::from(value)),
            None => {
                let home = |below: &str| known("HOME").map(|home| Path::new(&home).join(below));
                let caches = if cfg!(windows) {
                    known("LOCALAPPDATA").map(PathBuf::from)
                } else if cfg!(target_os = "macos") {
                    home("Library/Caches")
                } else {
                    let named = known("XDG_CACHE_HOME").map(PathBuf::from);
                    named.filter(|folder| folder.is_absolute()).or_else(|| home(".cache"))
                };
                caches.map(|caches| caches.join("drystone"))
            }
        };
        Self { folder, ..Self::default() }
    }

    /// The decomposition of a mesh, as [`decompose`](super::decompose) makes it.
    ///
    /// # Errors
    /// The mesh encloses no volume.
    pub fn of(
        &mut self,
        vertices: &[[f64; 3]],
        triangles: &[[u32; 3]],
        options: &DecompositionOptions,
    ) -> Result<Decomposition, NotSolid> {
        let options = options.clamped();
        let surface = Surface::new(vertices, triangles)?;
        let key = key(&surface, &options);
        let unit = match self.known.get(&key) {
            Some(unit) => unit.clone(),
            None => {
                let file =
                    self.folder.as_ref().map(|folder| folder.join(format!("{key:032x}.pieces")));
                let stored = file.as_deref().and_then(read);
                let unit = match stored {
                    Some(unit) => unit,
                    None => {
                        let unit = Unit::of(&surface, &options)?;
                        if let Some(file) = &file {
                            write(file, &unit);
                        }
                        unit
                    }
                };
                let unit = Arc::new(unit);
                self.known.insert(key, unit.clone());
                unit
            }
        };
        Ok(unit.at(surface.center, surface.size))
    }
}

/// Of everything that pieces depend on.
fn key(surface: &Surface, options: &DecompositionOptions) -> u128 {
    let mut hash = Xxh3::new();
    let mut add = |number: u64| hash.update(&number.to_le_bytes());
    add(u64::from(ALGORITHM));
    add(options.accuracy.to_bits());
    add(u64::from(options.pieces));
    add(surface.corners.len() as u64);
    surface.corners.iter().flatten().for_each(|x| add(*x as u64));
    surface.triangles.iter().flatten().for_each(|corner| add(u64::from(*corner)));
    hash.digest128()
}

/// Stored pieces, with the hash of their bytes behind them.
fn read(file: &Path) -> Option<Unit> {
    let bytes = fs::read(file).ok()?;
    let (content, sum) = bytes.split_last_chunk::<8>()?;
    if xxh3_64(content) != u64::from_le_bytes(*sum) {
        return None;
    }
    let unit: Unit = postcard::from_bytes(content).ok()?;
    let sound = unit.pieces.iter().all(super::pieces::Hull::is_sound);
    (sound && !unit.pieces.is_empty()).then_some(unit)
}

/// What cannot be stored is found again the next time.
fn write(file: &Path, unit: &Unit) {
    let Ok(mut bytes) = postcard::to_stdvec(unit) else { return };
    bytes.extend(xxh3_64(&bytes).to_le_bytes());
    if let Some(folder) = file.parent() {
        let _ = fs::create_dir_all(folder);
    }
    let _ = write_whole(file, |out| out.write_all(&bytes));
}
