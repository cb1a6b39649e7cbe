//! Who collides with whom: collision groups and filtered pairs.
//!
//! Colliders that are in the same groups and have the same filtered pairs make a class, and a class is a
//! system of the scene.

use std::collections::{BTreeMap, BTreeSet};

use super::super::description::Filter;
use super::super::error::{SceneError, Warning};
use super::layer::Value;
use super::prims::{Prim, is_word};
use super::stage::Stage;

/// Something that a collider is in: a group, or what a filtered pair names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Tag {
    Group(usize),
    /// In no group.
    Outside,
    Prim(usize),
}

type Class = BTreeSet<Tag>;

/// A collision group.
struct Group<'s> {
    prim: usize,
    includes: &'s [String],
    excludes: &'s [String],
    /// Whether what is below is in it, too.
    expands: bool,
    everything: bool,
    /// What it was in the own format.
    own: Option<Filter>,
}

/// The filters of colliders, in their order.
pub(super) fn of(
    stage: &Stage<'_>,
    colliders: &[usize],
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Filter>, SceneError> {
    let mut groups = Vec::new();
    // Pairs of tags that do not collide.
    let mut apart: BTreeSet<(Tag, Tag)> = BTreeSet::new();
    let mut part = |a: Tag, b: Tag| apart.extend([(a, b), (b, a)]);
    let mut named = BTreeSet::new();
    for (index, prim) in stage.prims.iter().enumerate() {
        if prim.kind == "PhysicsCollisionGroup" {
            groups.push(group(stage, index, prim, warnings)?);
        }
        for path in stage.targets(prim, "physics:filteredPairs") {
            match stage.find(path) {
                Some(other) => {
                    part(Tag::Prim(index), Tag::Prim(other));
                    named.extend([index, other]);
                }
                None => {
                    let what = format!("its filtered pair <{path}> is not there: it is ignored");
                    stage.warn(prim, what, warnings);
                }
            }
        }
    }
    let merged = merged(stage, &groups)?;
    let all: BTreeSet<usize> = merged.iter().copied().collect();
    for (index, group) in groups.iter().enumerate() {
        let Some(prim) = stage.prim(group.prim) else { continue };
        let listed: BTreeSet<usize> = stage
            .targets(prim, "physics:filteredGroups")
            .iter()
            .filter_map(|path| stage.find(path))
            // They are in the order of their prims.
            .filter_map(|prim| groups.binary_search_by_key(&prim, |group| group.prim).ok())
            .filter_map(|group| merged.get(group).copied())
            .collect();
        let inverted = stage.flag(prim, "physics:invertFilteredGroups")?.unwrap_or(false);
        let own = merged.get(index).copied().unwrap_or(index);
        let filtered = if inverted { all.difference(&listed).copied().collect() } else { listed };
        filtered.iter().for_each(|other| part(Tag::Group(own), Tag::Group(*other)));
        if inverted {
            part(Tag::Group(own), Tag::Outside);
        }
    }
    if groups.is_empty() && named.is_empty() {
        return Ok(vec![Filter::default(); colliders.len()]);
    }
    let said = said(stage, &groups);
    let class_of = |collider: usize| -> Class {
        // What is said of the nearest decides.
        let mut inside = BTreeMap::new();
        for above in stage.up(collider).map(|(index, _)| Some(index)).chain([None]) {
            for (group, is_in) in said.get(&above).into_iter().flatten() {
                if above == Some(collider) || groups.get(*group).is_some_and(|of| of.expands) {
                    inside.entry(*group).or_insert(*is_in);
                }
            }
        }
        let inside = inside.into_iter().filter(|(_, is_in)| *is_in);
        let inside = inside.map(|(i, _)| Tag::Group(merged.get(i).copied().unwrap_or(i)));
        let mut class: Class = inside.collect();
        if class.is_empty() {
            class.insert(Tag::Outside);
        }
        let pairs = stage.up(collider).map(|(index, _)| index).filter(|i| named.contains(i));
        class.extend(pairs.map(Tag::Prim));
        class
    };
    let classes: Vec<Class> = colliders.iter().map(|collider| class_of(*collider)).collect();
    let own = |class: &Class| match class.iter().collect::<Vec<_>>().as_slice() {
        [Tag::Group(group)] => groups.get(*group).and_then(|group| group.own),
        _ => None,
    };
    let systems = systems(stage, colliders, &classes)?;
    let meets =
        |a: &Class, b: &Class| !a.iter().any(|x| b.iter().any(|y| apart.contains(&(*x, *y))));
    let filters: BTreeMap<&Class, Filter> = systems
        .iter()
        .map(|(class, bit)| {
            let others = systems.iter().filter(|(other, _)| meets(class, other));
            let filter = Filter {
                systems: *bit,
                collides_with: others.fold(0, |mask, (_, bit)| mask | bit),
                // Every class is a system.
                collides_with_unnamed: true,
            };
            (*class, filter)
        })
        .collect();
    // Those of the own format, as long as they still say the same.
    let same = filters.iter().all(|(a, x)| {
        filters.iter().all(|(b, y)| match (own(a), own(b)) {
            (Some(own_a), Some(own_b)) => own_a.collides(&own_b) == x.collides(y),
            _ => false,
        })
    });
    let filter = |class: &Class| {
        let exact = own(class).filter(|_| same);
        exact.or(filters.get(class).copied()).unwrap_or_default()
    };
    Ok(classes.iter().map(filter).collect())
}

/// A bit for each class.
fn systems<'c>(
    stage: &Stage<'_>,
    colliders: &[usize],
    classes: &'c [Class],
) -> Result<BTreeMap<&'c Class, u64>, SceneError> {
    let mut systems = BTreeMap::new();
    for (class, collider) in classes.iter().zip(colliders) {
        let next = u32::try_from(systems.len()).unwrap_or(u32::MAX);
        let Some(bit) = 1_u64.checked_shl(next) else {
            if systems.contains_key(class) {
                continue;
            }
            let prim = stage.prim(*collider);
            let accepted = "accepted: up to 64 kinds of colliders that differ in their groups and \
                            filtered pairs; put bodies that are filtered alike into a group";
            let wrong =
                prim.map(|prim| stage.wrong(prim, "filter", "one too many".into(), accepted));
            return wrong.map_or_else(|| Ok(systems), Err);
        };
        systems.entry(class).or_insert(bit);
    }
    Ok(systems)
}

/// For each group, the first of those that it is merged with.
fn merged(stage: &Stage<'_>, groups: &[Group<'_>]) -> Result<Vec<usize>, SceneError> {
    let mut first: BTreeMap<String, usize> = BTreeMap::new();
    let mut merged = Vec::new();
    for (index, group) in groups.iter().enumerate() {
        let prim = stage.prim(group.prim);
        let name = prim.map(|prim| stage.word(prim, "physics:mergeGroup")).transpose()?.flatten();
        merged.push(match name.filter(|name| !name.is_empty()) {
            Some(name) => *first.entry(name.to_owned()).or_insert(index),
            None => index,
        });
    }
    Ok(merged)
}

fn group<'s>(
    stage: &'s Stage<'_>,
    index: usize,
    prim: &'s Prim,
    warnings: &mut Vec<Warning>,
) -> Result<Group<'s>, SceneError> {
    const RULE: &str = "collection:colliders:expansionRule";
    if stage.value(prim, "collection:colliders:membershipExpression").is_some() {
        let what = "its membershipExpression is not read: only what it includes is in it";
        stage.warn(prim, what, warnings);
    }
    let rule = stage.word(prim, RULE)?;
    let expands = match rule {
        None | Some("expandPrims" | "expandPrimsAndProperties") => true,
        Some("explicitOnly") => false,
        Some(_) => return Err(stage.refuse(prim, RULE, "\"expandPrims\", \"explicitOnly\"")),
    };
    Ok(Group {
        prim: index,
        includes: stage.targets(prim, "collection:colliders:includes"),
        excludes: stage.targets(prim, "collection:colliders:excludes"),
        expands,
        everything: stage.flag(prim, "collection:colliders:includeRoot")?.unwrap_or(false),
        own: own(stage, prim)?,
    })
}

/// What groups say of the prims that they name, and of none of them: that everything is in it. What is both
/// excluded and included is excluded: that comes first.
fn said(stage: &Stage<'_>, groups: &[Group<'_>]) -> BTreeMap<Option<usize>, Vec<(usize, bool)>> {
    let mut said: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for (index, group) in groups.iter().enumerate() {
        for (paths, is_in) in [(group.excludes, false), (group.includes, true)] {
            for prim in paths.iter().filter_map(|path| stage.find(path)) {
                said.entry(Some(prim)).or_default().push((index, is_in));
            }
        }
        if group.everything {
            said.entry(None).or_default().push((index, true));
        }
    }
    said
}

/// The filter of the own format that a group was written for.
fn own(stage: &Stage<'_>, prim: &Prim) -> Result<Option<Filter>, SceneError> {
    const NAMES: [&str; 2] = ["drystone:systems", "drystone:notCollidesWith"];
    let mut masks = [0_u64; 2];
    for (name, mask) in NAMES.into_iter().zip(&mut masks) {
        let Some(bits) = stage.wholes(prim, name)? else { return Ok(None) };
        for bit in bits {
            let one = 1_u64.checked_shl(bit);
            *mask |= one.ok_or_else(|| stage.refuse(prim, name, "numbers from 0 to 63"))?;
        }
    }
    let [systems, not] = masks;
    let unnamed = match stage.value(prim, "drystone:collidesWithUnnamed") {
        Some(Value::Number(x)) => *x != 0.0,
        Some(value) => !is_word(value, "false"),
        None => true,
    };
    Ok(Some(Filter { systems, collides_with: !not, collides_with_unnamed: unnamed }))
}
