//! Common interface of all engines. Each gets the same scene; no body sleeps.

#[cfg(feature = "box2d")]
mod box2d;
#[cfg(feature = "box3d")]
mod box3d;
mod drystone;
#[cfg(feature = "jolt")]
mod jolt;
mod rapier;

use std::fmt;
use std::str::FromStr;

use clap::ValueEnum;
use drystone_scene::{BodiesAs, Body, Combine, Filter, Material, Motion, Rotation, Scene, Track};

pub(crate) use self::drystone::Drystone;
use crate::hold::Hold;

/// A scene in an engine.
pub(crate) trait Engine {
    /// Takes a step of `dt` \[s\].
    ///
    /// # Errors
    /// The engine lacks capacity for the step.
    fn step(&mut self, dt: f32) -> Result<(), Refusal>;

    /// Appends the poses of all bodies in scene order: 3D px py pz qx qy qz qw, 2D px py angle.
    /// \[m, rad\]
    fn write_poses(&self, out: &mut Vec<f32>);
}

/// An engine without tracks of its own.
trait Peer: Engine {
    /// Moves a kinematic body, given by its index in the scene, to a pose at the end of the next
    /// step of `dt` \[s\].
    fn move_to(&mut self, body: usize, position: &[f64], rotation: &Rotation, dt: f32);
}

/// A peer whose kinematic bodies follow tracks.
struct Tracked<P> {
    peer: P,
    tracks: Vec<(usize, Track)>,
    /// Simulated time. \[s\]
    time: f64,
}

impl<P: Peer> Engine for Tracked<P> {
    fn step(&mut self, dt: f32) -> Result<(), Refusal> {
        self.time += f64::from(dt);
        for (body, track) in &self.tracks {
            let (position, rotation) = track.at(self.time);
            self.peer.move_to(*body, &position, &rotation, dt);
        }
        self.peer.step(dt)
    }

    fn write_poses(&self, out: &mut Vec<f32>) {
        self.peer.write_poses(out);
    }
}

/// Adds the tracks of the scene to a peer, if there are any.
fn follow<P: Peer + 'static>(peer: P, scene: &Scene) -> Box<dyn Engine> {
    let bodies = scene.bodies.iter().enumerate();
    let tracks: Vec<_> = bodies
        .filter(|(_, body)| !body.track.times.is_empty())
        .map(|(index, body)| (index, body.track.clone()))
        .collect();
    if tracks.is_empty() { Box::new(peer) } else { Box::new(Tracked { peer, tracks, time: 0.0 }) }
}

/// Error: an engine cannot run a scene.
#[derive(Debug, thiserror::Error)]
#[error("{item}: {reason}")]
pub(crate) struct Refusal {
    item: String,
    reason: String,
}

impl Refusal {
    fn new(item: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { item: item.into(), reason: reason.into() }
    }

    fn body(index: usize, body: &Body, reason: impl Into<String>) -> Self {
        Self::new(body.name.clone().unwrap_or_else(|| format!("body {index}")), reason)
    }
}

/// The engines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EngineKind {
    Drystone,
    Rapier2d,
    Rapier3d,
    Box2d,
    Box3d,
    Jolt,
}

impl EngineKind {
    /// All engines, in the order of the table.
    pub(crate) const ALL: [Self; 6] =
        [Self::Drystone, Self::Rapier2d, Self::Rapier3d, Self::Box2d, Self::Box3d, Self::Jolt];

    /// Returns the name of the engine.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Drystone => "drystone",
            Self::Rapier2d => "rapier2d",
            Self::Rapier3d => "rapier3d",
            Self::Box2d => "box2d",
            Self::Box3d => "box3d",
            Self::Jolt => "jolt",
        }
    }

    /// Returns the version of the source.
    pub(crate) fn version(self) -> &'static str {
        match self {
            Self::Drystone => "this checkout",
            Self::Rapier2d => env!("VERSION_RAPIER2D"),
            Self::Rapier3d => env!("VERSION_RAPIER3D"),
            Self::Box2d => env!("VERSION_BOXDD_SYS"),
            Self::Box3d => env!("VERSION_BOXDDD_SYS"),
            Self::Jolt => env!("VERSION_OXIJOLT_SYS"),
        }
    }

    /// Whether the engine is part of this build.
    pub(crate) fn is_built(self) -> bool {
        match self {
            Self::Drystone | Self::Rapier2d | Self::Rapier3d => true,
            Self::Box2d => cfg!(feature = "box2d"),
            Self::Box3d => cfg!(feature = "box3d"),
            Self::Jolt => cfg!(feature = "jolt"),
        }
    }

    /// Whether the engine runs scenes of `dimension` 2 or 3.
    pub(crate) fn has_dimension(self, dimension: usize) -> bool {
        match self {
            Self::Drystone => true,
            Self::Rapier2d | Self::Box2d => dimension == 2,
            Self::Rapier3d | Self::Box3d | Self::Jolt => dimension == 3,
        }
    }

    /// Returns the settings of `--quality`, from fast to exact.
    pub(crate) fn efforts(self) -> Vec<Effort> {
        let substeps =
            |counts: &[u32]| -> Vec<_> { counts.iter().map(|&n| Effort::Substeps(n)).collect() };
        let mut efforts = match self {
            Self::Jolt => substeps(&[1, 2, 3, 4, 6, 8]),
            _ => substeps(&[4, 6, 8, 12, 16, 24, 32, 48, 64]),
        };
        if self == Self::Drystone {
            efforts.extend([0.1, 0.03, 0.01].map(Effort::Sag));
        }
        efforts
    }
}

/// Effort of an engine per step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Effort {
    /// Default settings of the engine; for Drystone the real-time preset.
    Default,
    /// Number of substeps, with the contact stiffness raised in proportion; Jolt: number of
    /// collision steps.
    Substeps(u32),
    /// Drystone's certified preset with this sag. \[mm\]
    Sag(f32),
}

impl fmt::Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Default => f.write_str("default"),
            Self::Substeps(count) => write!(f, "{count}"),
            Self::Sag(sag) => write!(f, "sag {sag}"),
        }
    }
}

impl FromStr for Effort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "default" => Ok(Self::Default),
            other => match (other.strip_prefix("sag ").map(str::parse), other.parse()) {
                (Some(Ok(sag)), _) if sag > 0.0 => Ok(Self::Sag(sag)),
                (None, Ok(count @ 1..=1024)) => Ok(Self::Substeps(count)),
                _ => Err("accepted: default, 1 to 1024, sag above 0".to_string()),
            },
        }
    }
}

/// Returns substeps and contact stiffness \[Hz\] for the engines that share Box2D's soft contacts;
/// `None` for their defaults. Both rise together, since stiffness alone sets how deep a contact
/// penetrates.
fn soft_step(effort: Effort) -> Option<(u32, f32)> {
    match effort {
        Effort::Substeps(count) => Some((count, 7.5 * count as f32)),
        _ => None,
    }
}

/// Builds a scene in an engine with `threads` threads.
///
/// # Errors
/// The engine does not support something in the scene.
pub(crate) fn build(
    kind: EngineKind,
    scene: &Scene,
    effort: Effort,
    threads: usize,
) -> Result<Box<dyn Engine>, Refusal> {
    if matches!(effort, Effort::Sag(_)) && kind != EngineKind::Drystone {
        return Err(Refusal::new(kind.name(), "has no certified settings"));
    }
    if kind != EngineKind::Drystone {
        accept(scene)?;
    }
    match kind {
        EngineKind::Drystone => {
            Ok(Box::new(Drystone::new(scene, drystone::settings(effort), threads)?))
        }
        EngineKind::Rapier2d => rapier::flat(scene, effort, threads),
        EngineKind::Rapier3d => rapier::space(scene, effort, threads),
        #[cfg(feature = "box2d")]
        EngineKind::Box2d => Ok(follow(box2d::Box2d::new(scene, effort, threads)?, scene)),
        #[cfg(feature = "box3d")]
        EngineKind::Box3d => Ok(follow(box3d::Box3d::new(scene, effort, threads)?, scene)),
        #[cfg(feature = "jolt")]
        EngineKind::Jolt => Ok(follow(jolt::Jolt::new(scene, effort, threads)?, scene)),
        #[allow(unreachable_patterns)]
        _ => {
            Err(Refusal::new(kind.name(), "is not part of this build; build with --features peers"))
        }
    }
}

/// Checks that the scene means the same in all engines.
fn accept(scene: &Scene) -> Result<(), Refusal> {
    if scene.bodies_as == BodiesAs::Particles {
        return Err(Refusal::new("bodies_as", "particles, which peers do not have"));
    }
    let materials: Vec<&Material> =
        scene.bodies.iter().flat_map(|body| &body.shapes).map(|shape| &shape.material).collect();
    let alike = materials.windows(2).all(|pair| {
        pair[0].friction == pair[1].friction && pair[0].restitution == pair[1].restitution
    });
    for (index, body) in scene.bodies.iter().enumerate() {
        let refuse = |reason: &str| Err(Refusal::body(index, body, reason));
        if body.mass.mass.is_some_and(f64::is_infinite)
            || body.mass.inertia.iter().flatten().any(|moment| !moment.is_finite())
        {
            return refuse("has an infinite mass or moment of inertia");
        }
        for shape in &body.shapes {
            let Material { friction_combine: friction, restitution_combine: bounce, .. } =
                shape.material;
            let usual = friction == Combine::GeometricMean && bounce == Combine::Maximum;
            let product = friction == Combine::Multiply || bounce == Combine::Multiply;
            // Means, minimum and maximum of two equal numbers are the same.
            if !usual && (product || !alike) {
                return refuse(
                    "combines friction or restitution in a way that not all engines have",
                );
            }
            if shape.filter != Filter::default() {
                return refuse(
                    "collides with some bodies only, which this program does not carry over",
                );
            }
        }
    }
    Ok(())
}

/// Returns the joints of a scene, as every engine has them.
fn holds(scene: &Scene) -> Result<Vec<Hold>, Refusal> {
    let refuse = |index: usize, name: &Option<String>, why: &str| {
        Refusal::new(name.clone().unwrap_or_else(|| format!("joint {index}")), why)
    };
    let joints = scene.joints.iter().enumerate();
    joints.map(|(index, of)| Hold::of(of).map_err(|why| refuse(index, &of.name, why))).collect()
}

/// Returns the density of all shapes of a body, from its density or its mass. \[kg/m^3, 2D kg/m^2\]
fn density(body: &Body, volume: f64) -> f64 {
    match body.mass.mass {
        Some(mass) => mass / volume,
        None => body.mass.density.unwrap_or(1000.0),
    }
}

/// Whether a dynamic body states its center of mass or moments of inertia.
fn states_inertia(body: &Body) -> bool {
    body.motion == Motion::Dynamic && (body.mass.center.is_some() || body.mass.inertia.is_some())
}

/// Mass properties in double precision, in 2D and in 3D.
macro_rules! solids {
    ($name:ident: $parry:ident, $shapes:ident, $stated:expr) => {
        pub(crate) mod $name {
            use drystone_scene::{Body, Mass};
            pub(crate) use $parry::mass_properties::MassProperties;

            use super::Refusal;
            use crate::shapes::$shapes::{pose, shape, vector};

            /// Returns the volume of the shapes of a body. \[m^3, 2D m^2\]
            pub(crate) fn volume(index: usize, body: &Body) -> Result<f64, Refusal> {
                Ok(solid(index, body, 1.0)?.mass())
            }

            /// Returns mass, center and inertia of a body. Values that it does not state are those
            /// of its shapes.
            pub(crate) fn stated(index: usize, body: &Body) -> Result<MassProperties, Refusal> {
                let density = super::density(body, volume(index, body)?);
                let mut of = solid(index, body, density)?;
                if let Some(center) = &body.mass.center {
                    of.local_com = vector(center);
                }
                let inertia: fn(&MassProperties, &[f64], &Mass) -> MassProperties = $stated;
                Ok(body
                    .mass
                    .inertia
                    .as_ref()
                    .map_or(of, |moments| inertia(&of, moments, &body.mass)))
            }

            fn solid(index: usize, body: &Body, density: f64) -> Result<MassProperties, Refusal> {
                let mut sum = MassProperties::default();
                for part in &body.shapes {
                    let shape = shape(&part.kind).map_err(|why| Refusal::body(index, body, why))?;
                    let local = pose(&part.position, &part.rotation);
                    sum += shape.mass_properties(density).transform_by(&local);
                }
                Ok(sum)
            }
        }
    };
}

solids!(flat_solid: parry2d_f64, exact_flat, |of, moments, _| {
    MassProperties::new(of.local_com, of.mass(), moments.first().copied().unwrap_or(0.0))
});
solids!(solid: parry3d_f64, exact_space, |of, moments, mass| {
    let axes = drystone_scene::Rotation::Quaternion(mass.inertia_rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let frame = pose(&[], &axes).rotation;
    MassProperties::with_principal_inertia_frame(of.local_com, of.mass(), vector(moments), frame)
});

#[cfg(test)]
mod tests {
    use std::path::Path;

    use drystone_bake::read_json;

    use super::*;

    const DT: f32 = 1.0 / 60.0;

    /// Returns the poses after one second in every engine of this build.
    fn after_a_second(text: &str, change: fn(&mut Scene)) -> Vec<(EngineKind, Vec<f32>)> {
        let mut scene = read_json(Path::new("test.json"), text).unwrap().scene;
        change(&mut scene);
        let kinds = EngineKind::ALL.into_iter();
        let kinds = kinds.filter(|kind| kind.is_built() && kind.has_dimension(scene.dimension));
        kinds
            .map(|kind| {
                let mut engine = build(kind, &scene, Effort::Default, 1).unwrap();
                (0..60).for_each(|_| engine.step(DT).unwrap());
                let mut poses = Vec::new();
                engine.write_poses(&mut poses);
                (kind, poses)
            })
            .collect()
    }

    fn assert_near(kind: EngineKind, found: &[f32], expected: &[f32], tolerance: f32) {
        let near = found.iter().zip(expected).all(|(x, y)| (x - y).abs() <= tolerance);
        assert!(near && found.len() == expected.len(), "{kind:?}: {found:?}, not {expected:?}");
    }

    /// A moving, free body whose center of mass is half a meter from its origin.
    const FREE: &str = r#"{"gravity": [0, 0, 0], "bodies": [{
        "linear_velocity": [1, 2, 0.5], "angular_velocity": [0, 0, 0.3], "shapes": [
            {"type": "sphere", "radius": 0.25},
            {"type": "sphere", "radius": 0.25, "position": [1, 0, 0]}
    ]}]}"#;

    /// Returns the 2D version of [`FREE`].
    fn flat_free() -> String {
        let flat = FREE.replace(r#""gravity": [0, 0, 0]"#, r#""dimension": 2, "gravity": [0, 0]"#);
        let flat = flat.replace(", 0.5]", "]").replace("[0, 0, 0.3]", "0.3");
        flat.replace("[1, 0, 0]", "[1, 0]")
    }

    /// Returns the origin of the body after one second, if its center of mass began at `center`.
    fn origin(center: [f32; 2]) -> [f32; 2] {
        let (sin, cos) = 0.3f32.sin_cos();
        let [x, y] = center;
        [x + 1.0 - (cos * x - sin * y), y + 2.0 - (sin * x + cos * y)]
    }

    #[test]
    fn bodies_turn_about_the_center_of_mass_of_their_shapes() {
        let [x, y] = origin([0.5, 0.0]);
        for (kind, poses) in after_a_second(FREE, |_| ()) {
            assert_near(kind, &poses[..3], &[x, y, 0.5], 2e-3);
        }
        for (kind, poses) in after_a_second(&flat_free(), |_| ()) {
            assert_near(kind, &poses, &[x, y, 0.3], 2e-3);
        }
    }

    #[test]
    fn bodies_turn_about_the_center_of_mass_that_they_state() {
        let [x, y] = origin([0.25, 0.5]);
        let stated = after_a_second(FREE, |scene| {
            scene.bodies[0].mass.center = Some(vec![0.25, 0.5, 0.0]);
            scene.bodies[0].mass.inertia = Some(vec![20.0, 30.0, 40.0]);
        });
        for (kind, poses) in stated {
            assert_near(kind, &poses[..3], &[x, y, 0.5], 2e-3);
        }
    }

    #[test]
    fn kinematic_bodies_turn_about_their_origins() {
        let kinematic = |scene: &mut Scene| scene.bodies[0].motion = Motion::Kinematic;
        for (kind, poses) in after_a_second(FREE, kinematic) {
            assert_near(kind, &poses[..3], &[1.0, 2.0, 0.5], 2e-3);
            assert_near(kind, &poses[5..], &[0.15f32.sin(), 0.15f32.cos()], 2e-3);
        }
        for (kind, poses) in after_a_second(&flat_free(), kinematic) {
            assert_near(kind, &poses, &[1.0, 2.0, 0.3], 2e-3);
        }
    }

    #[test]
    fn kinematic_bodies_follow_their_tracks() {
        let followed = after_a_second(FREE, |scene| {
            let body = &mut scene.bodies[0];
            body.motion = Motion::Kinematic;
            let quarter = 0.5f64.sqrt();
            body.track = Track {
                times: vec![0.0, 0.5, 2.0],
                positions: vec![vec![0.0; 3], vec![0.0, 1.0, 0.0], vec![3.0, 1.0, 0.0]],
                rotations: [
                    [0.0, 0.0, 0.0, 1.0],
                    [0.0, quarter, 0.0, quarter],
                    [0.0, quarter, 0.0, quarter],
                ]
                .map(Rotation::Quaternion)
                .to_vec(),
            };
        });
        let quarter = 0.5f32.sqrt();
        for (kind, poses) in followed {
            assert_near(kind, &poses, &[1.0, 1.0, 0.0, 0.0, quarter, 0.0, quarter], 5e-3);
        }
    }

    /// A body of 1 m that a joint of the world holds at its end, at rest, without gravity.
    fn held(joint: &str) -> String {
        format!(
            r#"{{"gravity": [0, 0, 0], "bodies": [{{"shapes": [{{"type": "box",
                "half_extents": [0.5, 0.1, 0.1]}}], "position": [0.5, 0, 0]}}],
                "joints": [{{"bodies": [0], "anchor": [0, 0, 0], {joint}}}]}}"#
        )
    }

    #[test]
    fn motors_turn_and_push_the_same_way() {
        let hinge = r#""type": "hinge", "axis": [0, 0, 1], "motor": {"velocity": 0.5}"#;
        let [sin, cos] = [0.5f32.sin(), 0.5f32.cos()];
        for (kind, poses) in after_a_second(&held(hinge), |_| ()) {
            assert_near(kind, &poses[..3], &[0.5 * cos, 0.5 * sin, 0.0], 0.02);
        }
        let slider = r#""type": "slider", "axis": [1, 0, 0], "motor": {"velocity": 0.5}"#;
        for (kind, poses) in after_a_second(&held(slider), |_| ()) {
            assert_near(kind, &poses[..3], &[1.0, 0.0, 0.0], 0.02);
        }
    }

    #[test]
    fn limits_stop_the_same_way() {
        let hinge = r#""type": "hinge", "axis": [0, 0, 1], "limits": [-0.4, 0.9]"#;
        for gravity in [-1.0, 1.0] {
            let pulled = held(hinge).replacen("[0, 0, 0]", &format!("[0, {gravity}, 0]"), 1);
            let angle: f32 = if gravity < 0.0 { -0.4 } else { 0.9 };
            for (kind, poses) in after_a_second(&pulled, |_| ()) {
                let found = poses[1].atan2(poses[0]);
                let stopped =
                    if gravity < 0.0 { found >= angle - 0.1 } else { found <= angle + 0.1 };
                assert!(stopped && found * angle > 0.0, "{kind:?}: {found} rad, not {angle}");
            }
        }
    }

    #[test]
    fn what_is_held_stays_and_does_not_collide() {
        for kind in ["fixed", "ball"] {
            let text = r#"{"gravity": [0, -9.81, 0], "bodies": [
                {"motion": "static", "shapes": [{"type": "sphere", "radius": 0.5}]},
                {"position": [0, -0.5, 0], "shapes": [{"type": "sphere", "radius": 0.5}]}],
                "joints": [{"type": "KIND", "bodies": [1, 0], "anchor": [0, 0, 0]}]}"#;
            for (engine, poses) in after_a_second(&text.replace("KIND", kind), |_| ()) {
                assert_near(engine, &poses[7..10], &[0.0, -0.5, 0.0], 2e-3);
            }
        }
    }

    #[test]
    fn joints_that_not_all_engines_have_are_refused() {
        let universal = r#""type": "universal", "axes": [[1, 0, 0], [0, 1, 0]]"#;
        let scene = read_json(Path::new("test.json"), &held(universal)).unwrap().scene;
        for kind in EngineKind::ALL.into_iter().filter(|kind| kind.is_built()) {
            let refused = build(kind, &scene, Effort::Default, 1).is_err();
            assert_eq!(refused, kind != EngineKind::Drystone, "{kind:?}");
        }
    }

    #[test]
    fn balls_rest_on_tilted_half_spaces() {
        let space = r#"{"gravity": [-5.886, -7.848, 0], "bodies": [
            {"motion": "static", "position": [0, 1, 0], "shapes": [{"type": "halfspace", "normal": [0.6, 0.8, 0]}]},
            {"position": [0.36, 1.48, 0], "shapes": [{"type": "sphere", "radius": 0.5}]}
        ]}"#;
        let flat = space.replace(", 0]", "]").replacen('{', r#"{"dimension": 2, "#, 1);
        for (kind, poses) in after_a_second(space, |_| ()) {
            assert_near(kind, &poses[7..10], &[0.3, 1.4, 0.0], 0.025);
        }
        for (kind, poses) in after_a_second(&flat, |_| ()) {
            assert_near(kind, &poses[3..5], &[0.3, 1.4], 0.025);
        }
    }
}
