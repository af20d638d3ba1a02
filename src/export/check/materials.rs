//! Rules of the URDF's own materials.

use std::collections::BTreeSet;

use super::{
    description::{Description, MaterialText},
    finding::{Findings, Folder},
    paths::inside,
    places::unique_places,
    rule::Rule,
};

pub(super) fn check(description: &Description, folder: &Folder, urdf: &str, found: &mut Findings) {
    let shared = &description.materials;
    if shared.iter().any(|m| m.name.is_none()) {
        found.error(Rule::Name, "robot", "has a <material> without a name: urdfdom refuses the model");
    }
    unique_places("materials", shared.iter().filter_map(|m| m.name.as_deref()), found);
    let of_links = || {
        let shapes = description.links.iter().flat_map(|l| l.visuals.iter().map(move |v| (l, v)));
        shapes.filter_map(|(link, visual)| Some((link, visual.material.as_ref()?)))
    };
    let named = |m: &'_ MaterialText| m.is_defined.then(|| m.name.clone()).flatten();
    let defined: BTreeSet<String> =
        shared.iter().chain(of_links().map(|(_, material)| material)).filter_map(named).collect();
    for material in shared.iter().chain(of_links().map(|(_, material)| material)).filter(|m| m.is_blank) {
        let name = material.name.as_deref().unwrap_or("robot");
        found.warn(Rule::Color, name, "has a <color> without rgba: MuJoCo refuses the model");
    }
    for (link, material) in of_links().filter(|(_, m)| !m.is_defined) {
        match &material.name {
            Some(name) if !defined.contains(name) => {
                let message = format!("has the material '{name}', which is not there: it has no color");
                found.warn(Rule::Texture, &link.name, message);
            }
            _ => {}
        }
    }
    let textures: BTreeSet<&String> = shared
        .iter()
        .chain(of_links().map(|(_, material)| material))
        .filter_map(|m| m.texture.as_ref())
        .collect();
    for texture in textures {
        match inside(texture, urdf) {
            Err(why) => found.warn(Rule::Texture, texture, format!("the texture {why}")),
            Ok(file) if !folder.contains_key(&file) => {
                found.warn(Rule::Texture, texture, "the texture is missing");
            }
            Ok(_) => {}
        }
    }
}
