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
        // Every class is a system.
        collides_with_unnamed: true,
    };
    let filters = systems.iter().map(|of| (*of.0, filter(of))).collect();
    let exact = rules.say_the_same(&filters);
    let filter = |class: &Class| {
        let own = rules.own(class).filter(|_| exact);
        own.or(filters.get(class).copied()).unwrap_or_default()
    };
    Ok(classes.iter().map(filter).collect())
}

/// What a stage says of who collides with whom.
struct Rules<'s> {
    groups: Vec<Group<'s>>,
    /// For each group, the first of those that it is merged with.
    merged: Vec<usize>,
    /// What groups say of the prims that they name ([`said`]).
    said: BTreeMap<Option<usize>, Vec<(usize, bool)>>,
    /// Prims in filtered pairs.
    named: BTreeSet<usize>,
    /// Pairs of tags that do not collide.
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
                            format!("its filtered pair <{path}> is not there: it is ignored");
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

    /// Parts a group from those that it filters, or from all others.
    fn part_groups(&mut self, stage: &Stage<'_>, index: usize) -> Result<(), SceneError> {
        let prim = self.groups.get(index).and_then(|group| stage.prim(group.prim));
        let Some(prim) = prim else { return Ok(()) };
        let listed: BTreeSet<usize> = stage
            .targets(prim, "physics:filteredGroups")
            .iter()
            .filter_map(|path| stage.find(path))
            // They are in the order of their prims.
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

    /// The group that one is merged into.
    fn first_of(&self, group: usize) -> usize {
        self.merged.get(group).copied().unwrap_or(group)
    }

    /// What a collider is in.
    fn class_of(&self, stage: &Stage<'_>, collider: usize) -> Class {
        // What is said of the nearest decides.
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

    /// Whether two classes collide.
    fn meet(&self, a: &Class, b: &Class) -> bool {
        !a.iter().any(|x| b.iter().any(|y| self.apart.contains(&(*x, *y))))
    }

    /// The filter of the own format that the only group of a class was written for.
    fn own(&self, class: &Class) -> Option<Filter> {
        match class.iter().collect::<Vec<_>>().as_slice() {
            [Tag::Group(group)] => self.groups.get(*group).and_then(|group| group.own),
            _ => None,
        }
    }

    /// Whether the filters of the own format still say the same as these.
    fn say_the_same(&self, filters: &BTreeMap<&Class, Filter>) -> bool {
        filters.iter().all(|(a, x)| {
            filters.iter().all(|(b, y)| match (self.own(a), self.own(b)) {
                (Some(own_a), Some(own_b)) => own_a.collides(&own_b) == x.collides(y),
                _ => false,
            })
        })
    }
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
