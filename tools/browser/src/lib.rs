//! Steps of a heap of boxes and balls on `wasm32-unknown-unknown`: no clock, no threads, no
//! imports.

use drystone::{Body, InputError, Motion, StepSettings, World3};
use parry3d::shape::SharedShape;

/// Takes steps of 1/60 s and returns the FNV-1a hash of the poses; 0 if a step is refused.
#[unsafe(no_mangle)]
pub extern "C" fn hash(certified: bool, steps: u32) -> u64 {
    poses(certified, steps).map_or(0, |poses| {
        let bytes = poses.iter().flat_map(|number| number.to_bits().to_le_bytes());
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
        })
    })
}

fn poses(certified: bool, steps: u32) -> Result<Vec<f32>, InputError> {
    let settings = if certified { StepSettings::certified() } else { StepSettings::realtime() };
    let mut world = World3::new(settings);
    world.gravity = [0.0, -9.81, 0.0].into();
    let floor = SharedShape::cuboid(9.0, 0.5, 9.0);
    world.add(Body::new(Motion::Static, [0.0, -0.5, 0.0], floor))?;
    for i in 0..30u8 {
        let [x, y] = [f32::from(i % 3) * 0.4, 0.3 + 0.45 * f32::from(i / 3)];
        let is_ball = i % 4 == 0;
        let shape =
            if is_ball { SharedShape::ball(0.2) } else { SharedShape::cuboid(0.2, 0.2, 0.2) };
        world.add(Body::new(Motion::Dynamic, [x, y, 0.02 * f32::from(i)], shape))?;
    }
    world.time_stages(true);
    for _ in 0..steps {
        world.step(1.0 / 60.0)?;
    }
    let mut poses = Vec::new();
    world.write_poses(&mut poses);
    Ok(poses)
}
