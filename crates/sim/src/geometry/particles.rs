//! Particles in 2D and 3D: spheres without rotation, and half-spaces.

use drystone_solver::{SymmetricMatrix, Vector};

use super::{
    Bounds, ContactManifold, Curvature, Frame, Geometry, LookAhead, ManifoldPoint, MassProperties,
    NormalCarrier, Ray, Reach, SurfaceHit, leading,
};

/// The geometry of particles: (L, A) = (2, 0) or (3, 0).
#[derive(Clone, Copy, Debug)]
pub struct Particles;

/// The shape of a particle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SphereShape<const L: usize> {
    /// A sphere (2D: disk).
    Sphere {
        /// Radius. \[m\]
        radius: f32,
    },
    /// The half-space behind a plane through the position.
    Halfspace {
        /// Outward unit normal.
        normal: Vector<f32, L>,
    },
}

/// Half extent and reach of a half-space, which stands for infinity. \[m\]
const UNBOUNDED: f32 = 1.0e5;

impl<const L: usize> Geometry<L, 0> for Particles {
    type Pose = Vector<f32, L>;
    type Shape = SphereShape<L>;
    type Prepared = SphereShape<L>;
    type Scratch = ContactManifold<L>;

    fn pose(position: Vector<f32, L>, _rotation: &[f32]) -> Self::Pose {
        position
    }

    fn frame(pose: &Self::Pose) -> Frame<L> {
        let axes = std::array::from_fn(|i| {
            Vector(std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }))
        });
        Frame { position: *pose, axes }
    }

    fn advance(pose: &Self::Pose, by: Vector<f32, L>, _turn: Vector<f32, 0>) -> Self::Pose {
        *pose + by
    }

    fn rotation(_pose: &Self::Pose) -> [f64; 4] {
        [0.0, 0.0, 0.0, 1.0]
    }

    fn turn_between(_from: &Self::Pose, _to: &Self::Pose) -> Vector<f32, 0> {
        Vector::ZERO
    }

    fn compose(pose: &Self::Pose, local: &Self::Pose) -> Self::Pose {
        *pose + *local
    }

    fn write(pose: &Self::Pose, out: &mut Vec<f32>) {
        out.extend(pose.0);
        out.extend(if L == 3 { &[0.0, 0.0, 0.0, 1.0][..] } else { &[0.0][..] });
    }

    fn read(numbers: &[f32]) -> Self::Pose {
        Vector(leading(numbers))
    }

    fn bounds(shape: &Self::Shape, pose: &Self::Pose) -> Bounds<L> {
        let reach = Vector(
            [match shape {
                SphereShape::Sphere { radius } => *radius,
                SphereShape::Halfspace { .. } => UNBOUNDED,
            }; L],
        );
        Bounds { min: *pose - reach, max: *pose + reach }
    }

    fn reach(shape: &Self::Shape, pose: &Self::Pose) -> Reach {
        let core = pose.length();
        match shape {
            SphereShape::Sphere { radius } => Reach { all: core + radius, core },
            SphereShape::Halfspace { .. } => Reach { all: UNBOUNDED, core: UNBOUNDED },
        }
    }

    fn mass(shape: &Self::Shape, density: f32) -> MassProperties<L, 0> {
        let pi = std::f32::consts::PI;
        let volume = match shape {
            SphereShape::Sphere { radius } if L == 2 => pi * radius * radius,
            SphereShape::Sphere { radius } => 4.0 / 3.0 * pi * radius * radius * radius,
            SphereShape::Halfspace { .. } => 0.0,
        };
        MassProperties {
            mass: volume * density,
            center: Vector::ZERO,
            inertia: SymmetricMatrix::ZERO,
        }
    }

    fn unsupported(_: &Self::Shape) -> Option<&'static str> {
        None
    }

    fn extent(shape: &Self::Shape) -> Option<f32> {
        match shape {
            SphereShape::Sphere { radius } => Some(2.0 * radius),
            SphereShape::Halfspace { .. } => None,
        }
    }

    fn prepare(shape: Self::Shape) -> Self::Prepared {
        shape
    }

    fn placeholder() -> Self::Prepared {
        SphereShape::Sphere { radius: 0.0 }
    }

    fn is_open(_: &Self::Prepared) -> bool {
        false
    }

    fn is_curved(_: &Self::Prepared) -> bool {
        // Particles do not rotate.
        false
    }

    fn shape_of(collider: &Self::Prepared) -> &Self::Shape {
        collider
    }

    fn cast_ray(
        collider: &Self::Prepared,
        pose: &Self::Pose,
        ray: &Ray<L>,
    ) -> Option<SurfaceHit<L>> {
        let own = Ray { origin: ray.origin - *pose, ..*ray };
        match collider {
            SphereShape::Sphere { radius } => own.on_ball(Vector::ZERO, *radius),
            SphereShape::Halfspace { normal } => own.on_halfspace(*normal),
        }
    }

    fn collide(
        a: (&Self::Prepared, &Self::Pose),
        b: (&Self::Prepared, &Self::Pose),
        ahead: impl Into<LookAhead<L>>,
        _: Option<u64>,
        touch: &mut ContactManifold<L>,
        report: &mut dyn FnMut(&ContactManifold<L>),
    ) -> f32 {
        use SphereShape::{Halfspace, Sphere};
        let prediction = ahead.into().prediction;
        let between = *a.1 - *b.1;
        // The point on the sphere follows from its center and radius, the point on the plane from
        // the gap.
        match (a.0, b.0) {
            (Sphere { radius: r_a }, Sphere { radius: r_b }) => {
                balls([*a.1, *b.1], [*r_a, *r_b], prediction, touch, report)
            }
            (Sphere { radius }, Halfspace { normal }) => {
                touch.surfaces =
                    Curvature { radii: [*radius, 0.0], normal: NormalCarrier::FaceOfB };
                let (gap, on_a) = (between.dot(*normal) - radius, *a.1 - *normal * *radius);
                let point = ManifoldPoint { on_a, on_b: on_a - *normal * gap, gap, feature: 0 };
                meet(*normal, point, prediction, touch, report)
            }
            (Halfspace { normal }, Sphere { radius }) => {
                touch.surfaces =
                    Curvature { radii: [0.0, *radius], normal: NormalCarrier::FaceOfA };
                let (gap, on_b) = (-between.dot(*normal) - radius, *b.1 - *normal * *radius);
                let point = ManifoldPoint { on_a: on_b - *normal * gap, on_b, gap, feature: 0 };
                meet(-*normal, point, prediction, touch, report)
            }
            (Halfspace { .. }, Halfspace { .. }) => f32::NEG_INFINITY,
        }
    }
}

/// Reports the contact of two balls if their gap is at most `prediction` \[m\]. Returns the gap.
/// \[m\]
pub(super) fn balls<const L: usize>(
    centers: [Vector<f32, L>; 2],
    radii: [f32; 2],
    prediction: f32,
    touch: &mut ContactManifold<L>,
    report: &mut dyn FnMut(&ContactManifold<L>),
) -> f32 {
    let (normal, gap) = between_balls(centers[0] - centers[1], radii);
    let on_a = centers[0] - normal * radii[0];
    let point = ManifoldPoint { on_a, on_b: on_a - normal * gap, gap, feature: 0 };
    touch.surfaces = Curvature { radii, normal: NormalCarrier::Centers };
    meet(normal, point, prediction, touch, report)
}

/// Reports a contact point if its gap is at most `prediction` \[m\]. Returns the gap. \[m\]
fn meet<const L: usize>(
    normal: Vector<f32, L>,
    point: ManifoldPoint<L>,
    prediction: f32,
    touch: &mut ContactManifold<L>,
    report: &mut dyn FnMut(&ContactManifold<L>),
) -> f32 {
    if point.gap <= prediction {
        touch.part = 0;
        touch.normal = normal;
        touch.points.clear();
        touch.points.push(point);
        report(touch);
    }
    point.gap
}

/// Returns the unit normal from ball b to ball a and the gap \[m\]. `between` points from b's
/// center to a's.
pub(super) fn between_balls<const L: usize>(
    between: Vector<f32, L>,
    radii: [f32; 2],
) -> (Vector<f32, L>, f32) {
    let distance = between.length();
    let normal = if distance > 0.0 {
        between * (1.0 / distance)
    } else {
        // Concentric balls separate along the first axis.
        Vector(std::array::from_fn(|i| if i == 0 { 1.0 } else { 0.0 }))
    };
    (normal, distance - radii[0] - radii[1])
}
