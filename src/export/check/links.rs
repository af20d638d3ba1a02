//! Rules of names and inertias.

use std::collections::BTreeSet;

use nalgebra::Matrix3;

use super::{
    description::{Description, InertialText},
    finding::{Findings, Level},
    numbers::is_number,
    rule::Rule,
    welds::Welds,
};
use model::{impossible_inertia, is_plain_name, principal_moments};

/// MuJoCo refuses a smaller mass, kg. chosen: above its bound
const MIN_MASS_KG: f64 = 1e-6;

pub(super) fn check_links(description: &Description, welds: &Welds, found: &mut Findings) {
    check_names(description, found);
    let links = &description.links;
    if links.is_empty() {
        found.add_error(Rule::Tree, "robot", "has no link");
    }
    let is_heavy = welds.bodies_with(|link| links[link].inertial.as_ref().is_some_and(is_of_a_body));
    for (l, link) in links.iter().enumerate() {
        // A link that does not move, or is fixed to a body with a mass, loads anyway.
        let level = if welds.is_moving(l) && !is_heavy[l] { Level::Error } else { Level::Warning };
        // A link without shapes that does not move by itself is only a frame.
        let bare = link.visuals.is_empty() && link.collisions.is_empty();
        match &link.inertial {
            None if level == Level::Error || !bare => {
                let message =
                    "has no <inertial>: Gazebo drops the link, Drake gives it no mass, PyBullet 1 kg";
                found.add_finding(level, Rule::Inertia, &link.name, message);
            }
            None => {}
            Some(inertial) => check_inertia(&link.name, inertial, level, found),
        }
    }
}

/// Whether simulators accept it for a moving body.
fn is_of_a_body(inertial: &InertialText) -> bool {
    inertial.mass.is_some_and(|m| m >= MIN_MASS_KG)
        && inertia_tensor(inertial).is_some_and(|t| principal_moments(&t)[0] > 0.0)
}

fn check_names(description: &Description, found: &mut Findings) {
    let links: BTreeSet<&str> = description.links.iter().map(|l| l.name.as_str()).collect();
    let joints: BTreeSet<&str> = description.joints.iter().map(|j| j.name.as_str()).collect();
    for name in links.union(&joints) {
        if name.is_empty() {
            found.add_error(Rule::Name, "robot", "has a link or a joint without a name");
        } else if !is_plain_name(name) {
            found.add_warning(
                Rule::Name,
                name,
                "is no name for USD, whose importers change it; use letters, digits and _, a letter first",
            );
        }
    }
    for name in links.intersection(&joints) {
        found.add_error(Rule::Name, name, "names both a link and a joint; USD and MJCF need one name each");
    }
}

/// Reports how importers misread an inertia that is possible.
fn check_inertia(link: &str, inertial: &InertialText, level: Level, found: &mut Findings) {
    let mut add = |message: String| found.add_finding(level, Rule::Inertia, link, message);
    match inertial.mass {
        None => add("the <inertial> has no mass: MuJoCo refuses the model".to_owned()),
        Some(mass) if (0.0..MIN_MASS_KG).contains(&mass) => {
            add(format!("the mass is {mass} kg; SDF drops such a link, MuJoCo refuses one that moves"));
        }
        Some(_) => {}
    }
    match inertia_tensor(inertial) {
        None if inertial.inertia.contains(&None) => {
            add("the inertia lacks an element: MuJoCo refuses the model".to_owned());
        }
        // Impossible tensors are reported by `sound`.
        Some(tensor) if impossible_inertia(&tensor).is_none() => {
            let least = principal_moments(&tensor)[0];
            if least <= 0.0 {
                add(format!("the principal moment {least:.3e} kg m^2 is not positive"));
            }
        }
        _ => {}
    }
}

/// Reports inertias that no body can have.
pub(super) fn check_possible_inertias(description: &Description, found: &mut Findings) {
    for link in &description.links {
        if let Some(why) =
            link.inertial.as_ref().and_then(inertia_tensor).and_then(|t| impossible_inertia(&t))
        {
            found.add_error(Rule::Inertia, &link.name, why);
        }
    }
}

/// The inertia tensor, kg m^2; `None` if a number is missing.
fn inertia_tensor(inertial: &InertialText) -> Option<Matrix3<f64>> {
    let [xx, xy, xz, yy, yz, zz] = inertial.inertia;
    let xx = xx?;
    let xy = xy?;
    let xz = xz?;
    let yy = yy?;
    let yz = yz?;
    let zz = zz?;
    let tensor = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    tensor.iter().all(|x| is_number(*x)).then_some(tensor)
}
