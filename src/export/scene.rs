//! MJCF files around the twin: a scene with floor, light and camera, and the same with a position actuator
//! per joint. The twin's own file stays passive.

use std::fmt::Write as _;

use nalgebra::{Point3, Vector3};

use super::{
    config::ExportConfig,
    mjcf::positions,
    urdf::{short, triple},
};
use geometry::bounding_box;
use model::{ArticulatedModel, Joint, JointLoad, escape_xml as escape, joint_load};

/// Direction to the camera from the object's center: in front, to the side and above; along no axis.
/// chosen: for the eye
const VIEW: [f64; 3] = [1.0, -0.7, 0.6];
/// Distance of the camera in radii of the object. chosen: for the eye
const AWAY: f64 = 3.0;
/// Natural frequency of a position actuator without friction, rad/s.
/// chosen: a second to settle.
const SERVO_RAD_S: f64 = 10.0;
/// Largest error of an actuator against friction or gravity, as a share of the range.
/// chosen: too little to be seen.
const SERVO_ERROR: f64 = 0.02;
/// Highest natural frequency that the time step of 2 ms can follow, rad/s. chosen: 0.4 rad a step.
const FASTEST_RAD_S: f64 = 200.0;

/// Text of `scene.xml`: the twin on a floor, with a light and a camera.
pub(crate) fn scene_text(model: &ArticulatedModel, twin_file: &str) -> String {
    let (lower, upper) = model_bounds(model);
    let center = nalgebra::center(&lower, &upper);
    let radius_m = (0.5 * (upper - lower).norm()).max(1e-3);
    let eye = center + Vector3::from(VIEW).normalize() * AWAY * radius_m;
    let forward = (center - eye).normalize();
    // The camera looks along its -z; y is up in the picture.
    let right = forward.cross(&Vector3::z()).normalize();
    let up = right.cross(&forward);
    format!(
        r#"<mujoco model="{name}_scene">
  <include file="{file}"/>
  <statistic center="{center}" extent="{extent}"/>
  <visual>
    <map shadowclip="3"/>
    <global offwidth="1280" offheight="960"/>
  </visual>
  <asset>
    <texture name="scene_sky" type="skybox" builtin="gradient" rgb1="0.8 0.85 0.9" rgb2="0.4 0.45 0.5" width="64" height="384"/>
    <texture name="scene_floor" type="2d" builtin="checker" rgb1="0.55 0.55 0.55" rgb2="0.45 0.45 0.45" width="128" height="128"/>
    <material name="scene_floor" texture="scene_floor" texuniform="true" texrepeat="4 4"/>
  </asset>
  <worldbody>
    <light name="scene_light" directional="true" pos="{light}" dir="-0.3 0.3 -1" diffuse="0.5 0.5 0.5"/>
    <geom name="scene_floor" type="plane" size="0 0 0.05" pos="{floor}" material="scene_floor" friction="0.6 0.005 0.0001"/>
    <camera name="scene_camera" pos="{eye}" xyaxes="{right} {up}"/>
  </worldbody>
</mujoco>
"#,
        name = escape(&model.name),
        file = escape(twin_file),
        center = triple(center.coords.as_ref()),
        extent = short(2.0 * radius_m),
        light = triple((center.coords + Vector3::new(0.0, 0.0, AWAY * radius_m)).as_ref()),
        floor = triple(&[center.x, center.y, lower.z]),
        eye = triple(eye.coords.as_ref()),
        right = triple(right.as_ref()),
        up = triple(up.as_ref()),
    )
}

/// Text of `scene_actuated.xml`: the scene with a position actuator per joint, and a keyframe `hold0`, ...
/// for each state held by them.
pub(crate) fn actuated_scene(model: &ArticulatedModel, config: &ExportConfig) -> String {
    let mut text = format!(
        "<mujoco model=\"{}_actuated\">\n  <include file=\"scene.xml\"/>\n  <actuator>\n",
        escape(&model.name)
    );
    for (j, joint) in model.joints.iter().enumerate() {
        let name = escape(&joint.name);
        let [kp, kv] = actuator_gains(joint, &joint_load(model, j));
        let l = &joint.limit;
        // Writing to a string cannot fail, here and below.
        writeln!(
            text,
            "    <position name=\"{name}\" joint=\"{name}\" kp=\"{}\" kv=\"{}\" ctrlrange=\"{} {}\" \
             forcerange=\"-{effort} {effort}\"/>",
            short(kp),
            short(kv),
            short(l.lower),
            short(l.upper),
            effort = short(l.effort),
        )
        .ok();
    }
    text.push_str("  </actuator>\n  <keyframe>\n");
    for (k, state) in model.states.iter().enumerate() {
        let goals = state.iter().map(|q| short(*q)).collect::<Vec<_>>().join(" ");
        let prefix = &config.prefix;
        let positions = positions(model, config.base, state);
        writeln!(text, "    <key name=\"{prefix}hold{k}\" qpos=\"{positions}\" ctrl=\"{goals}\"/>").ok();
    }
    text.push_str("  </keyframe>\n</mujoco>\n");
    text
}

/// Stiffness and damping of an actuator: as stiff as friction requires, limited by the time step, and
/// critically damped.
fn actuator_gains(joint: &Joint, load: &JointLoad) -> [f64; 2] {
    let range = (joint.limit.upper - joint.limit.lower).max(1e-6);
    let held = joint.dynamics.friction + load.effort;
    let stiff = (SERVO_RAD_S.powi(2) * load.inertia).max(held / (SERVO_ERROR * range));
    let kp = stiff.min(FASTEST_RAD_S.powi(2) * load.inertia).max(f64::MIN_POSITIVE);
    [kp, 2.0 * (kp * load.inertia).sqrt()]
}

/// Bounding box of all solids and surfaces in all states, in the world.
fn model_bounds(model: &ArticulatedModel) -> (Point3<f64>, Point3<f64>) {
    let closed = vec![vec![0.0; model.joints.len()]];
    let states = if model.states.is_empty() { &closed } else { &model.states };
    let places = states.iter().flat_map(|q| {
        model.links.iter().enumerate().flat_map(move |(l, link)| {
            let pose = model.world_from_link(l, q);
            let surface = link.visual.vertices.iter().map(|v| v.cast::<f64>());
            let solids = link.collision.iter().flat_map(|s| s.vertices.iter().copied());
            surface.chain(solids).map(move |p| pose * p)
        })
    });
    bounding_box(places).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Base;
    use model::example::cabinet;

    #[test]
    fn the_floor_is_below_all_and_the_camera_looks_at_the_middle() {
        let model = cabinet();
        let text = scene_text(&model, "cabinet.xml");
        let document = roxmltree::Document::parse(&text).unwrap();
        let of = |tag: &str, attribute: &str| -> Vec<f64> {
            let node = document.descendants().find(|n| n.has_tag_name(tag)).unwrap();
            node.attribute(attribute).unwrap().split(' ').map(|x| x.parse().unwrap()).collect()
        };
        let (lower, upper) = model_bounds(&model);
        assert!((of("geom", "pos")[2] - lower.z).abs() < 1e-9);
        let axes = of("camera", "xyaxes");
        let x = Vector3::from_row_slice(&axes[..3]);
        let y = Vector3::from_row_slice(&axes[3..]);
        let to = nalgebra::center(&lower, &upper) - Point3::from_slice(&of("camera", "pos"));
        assert!((x.cross(&y) + to.normalize()).norm() < 1e-9, "{text}");
        assert!(y.z > 0.0 && text.contains("<include file=\"cabinet.xml\"/>"));
    }

    #[test]
    fn every_joint_has_an_actuator_that_holds_every_state() {
        let mut model = cabinet();
        model.joints[0].dynamics.friction = 1.0;
        let config = ExportConfig { base: Base::Floating, ..ExportConfig::default() };
        let text = actuated_scene(&model, &config);
        let document = roxmltree::Document::parse(&text).unwrap();
        let servos: Vec<_> = document.descendants().filter(|n| n.has_tag_name("position")).collect();
        let words = |name: &str| servos.iter().map(|n| n.attribute(name).unwrap()).collect::<Vec<_>>();
        assert_eq!(words("joint"), ["door_hinge", "drawer_slide"]);
        assert_eq!(words("ctrlrange"), ["0 1.25", "0 0.18"]);
        assert_eq!(words("forcerange"), ["-50 50", "-50 50"]);
        // The friction of 1 N m leaves an error of 2 % of the range; the drawer has none.
        let kp: Vec<f64> = words("kp").iter().map(|k| k.parse().unwrap()).collect();
        let load = joint_load(&model, 0);
        assert!((kp[0] - (1.0 + load.effort) / (0.02 * 1.25)).abs() < 1e-6 * kp[0], "{kp:?} {load:?}");
        assert!(kp[1] >= 100.0 * 0.999, "{kp:?}");
        assert!(text.contains("qpos=\"0 0 0 1 0 0 0 1.25 0\" ctrl=\"1.25 0\""), "{text}");
    }
}
