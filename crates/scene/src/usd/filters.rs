//! Collision groups and filtered pairs of UsdPhysics, converted to the filters of the scene.
//!
//! Colliders in the same groups and with the same filtered pairs form a class, and each class is a
//! collision system of the scene.

use std::collections::{BTreeMap, BTreeSet};

use super::super::description::Filter;
use super::super::error::{SceneError, Warning};
use super::layer::Value;
use super::prims::{Prim, is_word};
use super::stage::Stage;

/// Membership that decides what a collider collides with: a group, or a prim in a filtered pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Tag {
    Group(usize),
    /// Member of no group.
    Outside,
    Prim(usize),
}

type Class = BTreeSet<Tag>;

/// A collision group.
struct Group<'s> {
    prim: usize,
    includes: &'s [String],
    excludes: &'s [String],
    /// True if prims below an included one are members, too.
    expands: bool,
    everything: bool,
    /// Filter in Drystone's own format, if the group was exported from one.
    own: Option<Filter>,
}

/// Returns the filters of the colliders, in their order.
pub(super) fn of(
    stage: &Stage<'_>,
    colliders: &[usize],
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Filter>, SceneError> {
    let rules = Rules::read(stage, warnings)?;
    if rules.groups.is_empty() && rules.named.is_empty() {
        return Ok(vec![Filter::default(); colliders.len()]);
    }
    let class = |collider: &usize| rules.class_of(stage, *collider);
    let classes: Vec<Class> = colliders.iter().map(class).collect();
    let systems = systems(stage, colliders, &classes)?;
    let filter = |(class, bit): (&&Class, &u64)| Filter {
        systems: *bit,
        collides_with: systems
            .iter()
            .filter(|(other, _)| rules.meet(class, other))
            .fold(0, |mask, (_, bit)| mask | bit),
        // Every collider belongs to a named system.
        collides_with_unnamed: true,
    };
    let filters = systems.iter().map(|of| (*of.0, filter(of))).collect();
    let exact = rules.are_equivalent(&filters);
    let filter = |class: &Class| {
        let own = rules.own(class).filter(|_| exact);
        own.or(filters.get(class).copied()).unwrap_or_default()
    };
    Ok(classes.iter().map(filter).collect())
}

/// Collision rules of a stage.
struct Rules<'s> {
    groups: Vec<Group<'s>>,
    /// For each group, the first of the groups merged with it.
    merged: Vec<usize>,
    /// Statements of groups about the membership of prims, see [`said`].
    said: BTreeMap<Option<usize>, Vec<(usize, bool)>>,
    /// Prims named by filtered pairs.
    named: BTreeSet<usize>,
    /// Pairs of tags whose members do not collide.
    apart: BTreeSet<(Tag, Tag)>,
}

impl<'s> Rules<'s> {
    fn read(stage: &'s Stage<'_>, warnings: &mut Vec<Warning>) -> Result<Self, SceneError> {
        let (mut groups, mut pairs) = (Vec::new(), Vec::new());
        for (index, prim) in stage.prims.iter().enumerate() {
            if prim.kind == "PhysicsCollisionGroup" {
                groups.push(group(stage, index, prim, warnings)?);
            }
            for path in stage.targets(prim, "physics:filteredPairs") {
                match stage.find(path) {
                    Some(other) => pairs.push([index, other]),
                    None => {
                        let what =
                            format!("its filtered pair <{path}> does not exist: it is ignored");
                        stage.warn(prim, what, warnings);
                    }
                }
            }
        }
        let merged = merged(stage, &groups)?;
        let said = said(stage, &groups);
        let named = pairs.iter().flatten().copied().collect();
        let mut rules = Self { groups, merged, said, named, apart: BTreeSet::new() };
        pairs.iter().for_each(|[a, b]| rules.part(Tag::Prim(*a), Tag::Prim(*b)));
        for index in 0..rules.groups.len() {
            rules.part_groups(stage, index)?;
        }
        Ok(rules)
    }

    fn part(&mut self, a: Tag, b: Tag) {
        self.apart.extend([(a, b), (b, a)]);
    }

    /// Separates a group from the groups that it filters, or from all others if its filter is
    /// inverted.
    fn part_groups(&mut self, stage: &Stage<'_>, index: usize) -> Result<(), SceneError> {
        let prim = self.groups.get(index).and_then(|group| stage.prim(group.prim));
        let Some(prim) = prim else { return Ok(()) };
        let listed: BTreeSet<usize> = stage
            .targets(prim, "physics:filteredGroups")
            .iter()
            .filter_map(|path| stage.find(path))
            // `groups` is in ascending order of prims.
            .filter_map(|prim| self.groups.binary_search_by_key(&prim, |group| group.prim).ok())
            .map(|group| self.first_of(group))
            .collect();
        let inverted = stage.flag(prim, "physics:invertFilteredGroups")?.unwrap_or(false);
        let own = Tag::Group(self.first_of(index));
        if inverted {
            let others = self.merged.clone();
            others
                .into_iter()
                .filter(|other| !listed.contains(other))
                .for_each(|other| self.part(own, Tag::Group(other)));
            self.part(own, Tag::Outside);
        } else {
            listed.into_iter().for_each(|other| self.part(own, Tag::Group(other)));
        }
        Ok(())
    }

    /// Returns the group that this one is merged into.
    fn first_of(&self, group: usize) -> usize {
        self.merged.get(group).copied().unwrap_or(group)
    }

    /// Returns the class of a collider.
    fn class_of(&self, stage: &Stage<'_>, collider: usize) -> Class {
        // The statement about the nearest prim decides.
        let mut inside = BTreeMap::new();
        for above in stage.up(collider).map(|(index, _)| Some(index)).chain([None]) {
            for (group, is_in) in self.said.get(&above).into_iter().flatten() {
                if above == Some(collider) || self.groups.get(*group).is_some_and(|of| of.expands) {
                    inside.entry(*group).or_insert(*is_in);
                }
            }
        }
        let inside = inside.into_iter().filter(|(_, is_in)| *is_in);
        let mut class: Class = inside.map(|(group, _)| Tag::Group(self.first_of(group))).collect();
        if class.is_empty() {
            class.insert(Tag::Outside);
        }
        let pairs = stage.up(collider).map(|(index, _)| index);
        class.extend(pairs.filter(|index| self.named.contains(index)).map(Tag::Prim));
        class
    }

    /// Returns true if two classes collide.
    fn meet(&self, a: &Class, b: &Class) -> bool {
        !a.iter().any(|x| b.iter().any(|y| self.apart.contains(&(*x, *y))))
    }

    /// Returns the own-format filter of a class that consists of a single exported group.
    fn own(&self, class: &Class) -> Option<Filter> {
        match class.iter().collect::<Vec<_>>().as_slice() {
            [Tag::Group(group)] => self.groups.get(*group).and_then(|group| group.own),
            _ => None,
        }
    }

    /// Returns true if the own-format filters still agree with these for every pair of classes.
    fn are_equivalent(&self, filters: &BTreeMap<&Class, Filter>) -> bool {
        filters.iter().all(|(a, x)| {
            filters.iter().all(|(b, y)| match (self.own(a), self.own(b)) {
                (Some(own_a), Some(own_b)) => own_a.collides(&own_b) == x.collides(y),
                _ => false,
            })
        })
    }
}

/// Assigns a bit to each class.
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

/// Returns for each group the first of the groups merged with it.
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

/// Collects by prim which groups include it (true) or exclude it (false). The key `None` holds
/// groups that include everything. Exclusions precede inclusions, so that a prim with both is
/// excluded.
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

/// Reads the own-format filter that a group was exported from.
fn own(stage: &Stage<'_>, prim: &Prim) -> Result<Option<Filter>, SceneError> {
    const NAMES: [&str; 2] = ["drystone:systems", "drystone:notCollidesWith"];
    let mut masks = [0_u64; 2];
    for (name, mask) in NAMES.into_iter().zip(&mut masks) {
        let Some(bits) = stage.whole_numbers(prim, name)? else { return Ok(None) };
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
