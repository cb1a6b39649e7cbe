//! Properties that bodies and colliders are declared with: [`Motion`], [`Material`], [`Filter`].

/// Cause of the motion of a body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// Forces and contacts.
    #[default]
    Dynamic,
    /// Nothing.
    Static,
    /// Its velocities or [`World::move_to`](crate::World::move_to): it pushes others and is never
    /// pushed.
    Kinematic,
}

/// Surface properties of a shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Coulomb friction coefficient. \[1\]
    pub friction: f64,
    /// Coefficient of restitution, 0..1. \[1\]
    pub restitution: f64,
    /// Rolling resistance: the largest distance by which the normal force may act ahead of the
    /// contact. A rolling ball of radius r decelerates as on an upward slope of this length over r.
    /// A contact takes the larger value of its two surfaces. \[m\]
    pub rolling_resistance: f64,
    /// Resistance to spinning about the normal: the largest moment divided by the normal force. A
    /// contact takes the larger value of its two surfaces. \[m\]
    pub spinning_resistance: f64,
    /// Rule that combines the friction of two surfaces.
    pub friction_combine: Combine,
    /// Rule that combines the restitution of two surfaces.
    pub restitution_combine: Combine,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            friction: 0.5,
            restitution: 0.0,
            rolling_resistance: 0.0,
            spinning_resistance: 0.0,
            friction_combine: Combine::GeometricMean,
            restitution_combine: Combine::Maximum,
        }
    }
}

impl Material {
    /// Returns the friction between two surfaces. \[1\]
    pub fn friction_with(&self, other: &Self) -> f64 {
        let rule = self.friction_combine.min(other.friction_combine);
        rule.combine(self.friction, other.friction)
    }

    /// Returns the restitution between two surfaces. \[1\]
    pub fn restitution_with(&self, other: &Self) -> f64 {
        let rule = self.restitution_combine.min(other.restitution_combine);
        rule.combine(self.restitution, other.restitution)
    }
}

/// Rule that combines two coefficients. When two surfaces differ, the earlier in this list decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Combine {
    /// (a + b) / 2.
    Average,
    /// min(a, b).
    Minimum,
    /// max(a, b).
    Maximum,
    /// a b.
    Multiply,
    /// sqrt(a b): the default for friction.
    GeometricMean,
}

impl Combine {
    /// Combines the coefficients of two surfaces by this rule.
    pub fn combine(self, x: f64, y: f64) -> f64 {
        match self {
            Self::Average => 0.5 * (x + y),
            Self::Minimum => x.min(y),
            Self::Maximum => x.max(y),
            Self::Multiply => x * y,
            Self::GeometricMean => (x * y).sqrt(),
        }
    }
}

/// Collision filter of a shape. Each named system is a bit. Two shapes collide if each accepts a
/// system of the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// Systems that the shape belongs to; 0 if it belongs to no named system.
    pub systems: u64,
    /// Systems that the shape collides with.
    pub collides_with: u64,
    /// True if the shape collides with shapes that belong to no named system.
    pub collides_with_unnamed: bool,
}

impl Filter {
    /// Returns true if both shapes accept each other.
    pub fn collides(&self, other: &Self) -> bool {
        self.accepts(other) && other.accepts(self)
    }

    fn accepts(&self, other: &Self) -> bool {
        if other.systems == 0 {
            self.collides_with_unnamed
        } else {
            self.collides_with & other.systems != 0
        }
    }
}

impl Default for Filter {
    fn default() -> Self {
        Self { systems: 0, collides_with: u64::MAX, collides_with_unnamed: true }
    }
}
