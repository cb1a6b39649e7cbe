//! Coulomb's cone K = { |r_t| <= mu r_n }.

/// Moves z to the nearest point of the cone of friction mu: z = (z_n, z_t), normal first. Without
/// tangents this is max(0, z_n); without friction it also removes the tangents.
///
/// The three cases are those of Tasora and Anitescu 2011: inside, below the polar cone, between.
pub fn project(z: &mut [f64], friction: f64) {
    let Some((normal, tangents)) = z.split_first_mut() else {
        return;
    };
    let slip = tangents.iter().map(|t| t * t).sum::<f64>().sqrt();
    if *normal >= 0.0 && slip <= friction * *normal {
        return;
    }
    if friction * slip <= -*normal {
        *normal = 0.0;
        tangents.fill(0.0);
        return;
    }
    *normal = (*normal + friction * slip) / (1.0 + friction * friction);
    // Where there are no tangents the length is zero, and nothing is scaled.
    for t in tangents {
        *t *= friction * *normal / slip;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projected(mut z: [f64; 3], friction: f64) -> [f64; 3] {
        project(&mut z, friction);
        z
    }

    #[test]
    fn each_case_of_the_projection() {
        assert_eq!(projected([2.0, 0.5, 0.0], 0.5), [2.0, 0.5, 0.0]);
        assert_eq!(projected([-1.0, 0.0, 1.5], 0.5), [0.0; 3]);
        // (0, 3, 4) onto the edge of the cone with slope 1.
        let [n, a, b] = projected([0.0, 3.0, 4.0], 1.0);
        assert!((n - 2.5).abs() + (a - 1.5).abs() + (b - 2.0).abs() < 1e-15);
        assert_eq!(projected([1.0, 3.0, 4.0], 0.0), [1.0, 0.0, 0.0]);
        assert_eq!(projected([-1.0, 0.0, 0.0], 0.0), [0.0; 3]);
        let mut alone = [-2.0];
        project(&mut alone, 0.0);
        assert_eq!(alone, [0.0]);
    }
}
