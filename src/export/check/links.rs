//! Rules of names and inertias.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, SymmetricEigen};

use super::{
    Findings,
    description::{Description, InertialText},
};
use crate::model::is_plain_name;

/// MuJoCo refuses less, kg.
const MIN_MASS_KG: f64 = 1e-6;
/// Relative slack of the triangle inequality.
const SLACK: f64 = 1e-6;

pub(super) fn check(description: &Description, found: &mut Findings) {
    names(description, found);
    if description.links.is_empty() {
        found.error("tree", "robot", "has no link");
    }
    for link in &description.links {
        let bare = link.visuals.is_empty() && link.collisions.is_empty();
        match &link.inertial {
            None if !bare => {
                found.error("inertia", &link.name, "has no <inertial>: Gazebo drops the link, Drake gives it no mass, PyBullet 1 kg");
            }
            Some(inertial) => inertia(&link.name, inertial, found),
            None => {}
        }
        for (kind, shapes) in [("visual", &link.visuals), ("collision", &link.collisions)] {
            if shapes.iter().any(|s| s.name.is_none()) {
                found.warn("name", &link.name, format!("has a <{kind}> without a name"));
            }
        }
    }
}

fn names(description: &Description, found: &mut Findings) {
    let links = description.links.iter().map(|l| l.name.as_str());
    let all = links.chain(description.joints.iter().map(|j| j.name.as_str()));
    let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
    for name in all {
        *seen.entry(name).or_default() += 1;
        if !is_plain_name(name) {
            found.error("name", name, "is no name for USD and MJCF; use letters, digits and _, beginning with a letter");
        }
    }
    for (name, _) in seen.iter().filter(|(_, n)| **n > 1) {
        found.error("name", name, "names more than one link or joint; USD and MJCF need one name each");
    }
}

fn inertia(link: &str, inertial: &InertialText, found: &mut Findings) {
    let InertialText { mass, inertia } = inertial;
    if !mass.is_finite() {
        found.error("inertia", link, "the mass is no finite number");
    } else if *mass < MIN_MASS_KG {
        found.error("inertia", link, format!("the mass is {mass} kg; SDF drops such a link, MuJoCo refuses it"));
    }
    let [ixx, ixy, ixz, iyy, iyz, izz] = *inertia;
    if inertia.iter().any(|x| !x.is_finite()) {
        found.error("inertia", link, "the inertia has an element that is missing or no finite number");
        return;
    }
    let tensor = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
    let mut m: [f64; 3] = SymmetricEigen::new(tensor).eigenvalues.into();
    m.sort_by(f64::total_cmp);
    let [a, b, c] = m;
    if a <= 0.0 {
        found.error("inertia", link, format!("the principal moment {a:.3e} kg m^2 is not positive"));
    } else if a + b < c * (1.0 - SLACK) {
        found.error("inertia", link, format!("the principal moments {a:.3e}, {b:.3e}, {c:.3e} kg m^2 break A + B >= C"));
    }
}
