//! Cache of convex decompositions by mesh content: [`Decompositions`].

use std::collections::HashMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::{ALGORITHM, Decomposition, Unit};
use drystone_scene::solid_mesh::SolidMesh;
use drystone_scene::{DecompositionOptions, NotSolid, ShapeKind, write_whole};

/// Environment variable that names the cache folder, or turns it off.
const VARIABLE: &str = "DRYSTONE_CACHE";

/// Cache of decompositions by the content of their meshes, in memory and optionally in a folder.
///
/// Meshes that differ only in position and size share one decomposition. Stored pieces are bitwise
/// equal to those of [`decompose`](super::decompose). The cache ignores files that are damaged or
/// of another version, and a folder that cannot be written.
#[derive(Debug, Default)]
pub struct Decompositions {
    known: HashMap<u128, Arc<Unit>>,
    folder: Option<PathBuf>,
}

impl Decompositions {
    /// Uses a folder as well, which is created when the first decomposition is stored.
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: Some(folder.to_owned()), ..Self::default() }
    }

    /// Uses the user's cache folder as well. This is `$DRYSTONE_CACHE` if set, else the folder
    /// `drystone` in the system's cache folder: `%LOCALAPPDATA%` on Windows, `~/Library/Caches` on
    /// macOS, elsewhere `$XDG_CACHE_HOME` or `~/.cache`. With `DRYSTONE_CACHE=off`, or without any
    /// of these, the cache is in memory only.
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

    /// Returns the decomposition of a mesh as [`decompose`](super::decompose) makes it.
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
        let surface = SolidMesh::new(vertices, triangles)?;
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

    /// Returns the pieces as which a mesh of a dynamic body collides; `None` for other shapes.
    ///
    /// Its vertices are rounded to `f32`, as for contacts.
    pub fn of_shape(&mut self, kind: &ShapeKind) -> Option<Result<Decomposition, NotSolid>> {
        let ShapeKind::Trimesh { vertices, triangles, decomposition, .. } = kind else {
            return None;
        };
        let single: Vec<_> = vertices.iter().map(|p| p.map(|x| f64::from(x as f32))).collect();
        Some(self.of(&single, triangles, &decomposition.unwrap_or_default()))
    }
}

/// Returns the hash of everything that the pieces depend on.
fn key(surface: &SolidMesh, options: &DecompositionOptions) -> u128 {
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

/// Reads stored pieces, which are followed by the hash of their bytes; `None` if they are damaged.
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

/// Stores pieces. Errors are ignored: the pieces are then recomputed the next time.
fn write(file: &Path, unit: &Unit) {
    let Ok(mut bytes) = postcard::to_stdvec(unit) else { return };
    bytes.extend(xxh3_64(&bytes).to_le_bytes());
    if let Some(folder) = file.parent() {
        let _ = fs::create_dir_all(folder);
    }
    let _ = write_whole(file, |out| out.write_all(&bytes));
}
