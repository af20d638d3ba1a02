//! Rules of names and inertias.

use std::collections::BTreeSet;

use nalgebra::Matrix3;

use super::{
    description::{Description, InertialText},
    finding::Findings,
    numbers::is_number,
    rule::Rule,
};
use crate::model::{impossible_inertia, is_plain_name, principal_moments};

/// MuJoCo refuses less, kg.
const MIN_MASS_KG: f64 = 1e-6;

pub(super) fn check(description: &Description, found: &mut Findings) {
    names(description, found);
    if description.links.is_empty() {
        found.error(Rule::Tree, "robot", "has no link");
    }
    for link in &description.links {
        // A link without shapes is a mere frame and needs no mass.
        let bare = link.visuals.is_empty() && link.collisions.is_empty();
        match &link.inertial {
            None if !bare => {
                found.error(
                    Rule::Inertia,
                    &link.name,
                    "has no <inertial>: Gazebo drops the link, Drake gives it no mass, PyBullet 1 kg",
                );
            }
            Some(inertial) => inertia(&link.name, inertial, found),
            None => {}
        }
        for (kind, shapes) in [("visual", &link.visuals), ("collision", &link.collisions)] {
            if shapes.iter().any(|s| s.name.is_none()) {
                found.warn(Rule::Name, &link.name, format!("has a <{kind}> without a name"));
            }
        }
    }
}

fn names(description: &Description, found: &mut Findings) {
    let links: BTreeSet<&str> = description.links.iter().map(|l| l.name.as_str()).collect();
    let joints: BTreeSet<&str> = description.joints.iter().map(|j| j.name.as_str()).collect();
    for name in links.union(&joints) {
        if !is_plain_name(name) {
            found.error(
                Rule::Name,
                name,
                "is no name for USD and MJCF; use letters, digits and _, beginning with a letter",
            );
        }
    }
    for name in links.intersection(&joints) {
        found.error(Rule::Name, name, "names both a link and a joint; USD and MJCF need one name each");
    }
}

/// What importers do not take of an inertia that is possible.
fn inertia(link: &str, inertial: &InertialText, found: &mut Findings) {
    match inertial.mass {
        None => found.error(Rule::Inertia, link, "the <inertial> has no mass"),
        Some(mass) if (0.0..MIN_MASS_KG).contains(&mass) => {
            found.error(
                Rule::Inertia,
                link,
                format!("the mass is {mass} kg; SDF drops such a link, MuJoCo refuses it"),
            );
        }
        Some(_) => {}
    }
    match tensor(inertial) {
        None if inertial.inertia.contains(&None) => {
            found.error(Rule::Inertia, link, "the inertia lacks an element")
        }
        // Impossible tensors are reported by `sound`.
        Some(tensor) if impossible_inertia(&tensor).is_none() => {
            let least = principal_moments(&tensor)[0];
            if least <= 0.0 {
                found.error(
                    Rule::Inertia,
                    link,
                    format!("the principal moment {least:.3e} kg m^2 is not positive"),
                );
            }
        }
        _ => {}
    }
}

/// Inertias that no body has.
pub(super) fn sound(description: &Description, found: &mut Findings) {
    for link in &description.links {
        if let Some(why) = link.inertial.as_ref().and_then(tensor).and_then(|t| impossible_inertia(&t)) {
            found.error(Rule::Inertia, &link.name, why);
        }
    }
}

/// The tensor, where it has all its numbers.
fn tensor(inertial: &InertialText) -> Option<Matrix3<f64>> {
    let [xx, xy, xz, yy, yz, zz] = inertial.inertia;
    let (xx, xy, xz, yy, yz, zz) = (xx?, xy?, xz?, yy?, yz?, zz?);
    let tensor = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    tensor.iter().all(|x| is_number(*x)).then_some(tensor)
}
