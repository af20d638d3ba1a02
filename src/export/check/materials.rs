//! Rules for the materials that a URDF defines.

use std::collections::BTreeSet;

use super::{
    description::{Description, LinkText, MaterialText},
    finding::{Findings, Folder},
    paths::path_in_folder,
    places::unique_places,
    rule::Rule,
};

pub(super) fn check_materials(description: &Description, folder: &Folder, urdf: &str, found: &mut Findings) {
    let shared = &description.materials;
    if shared.iter().any(|m| m.name.is_none()) {
        found.add_error(Rule::Name, "robot", "has a <material> without a name: urdfdom refuses the model");
    }
    unique_places("materials", shared.iter().filter_map(|m| m.name.as_deref()), found);
    let mut of_links: Vec<(&LinkText, &MaterialText)> = Vec::new();
    for link in &description.links {
        of_links.extend(link.visuals.iter().filter_map(|v| Some((link, v.material.as_ref()?))));
    }
    let all: Vec<&MaterialText> =
        shared.iter().chain(of_links.iter().map(|(_, material)| *material)).collect();
    let defined: BTreeSet<&String> =
        all.iter().filter(|m| m.is_defined).filter_map(|m| m.name.as_ref()).collect();
    for material in all.iter().filter(|m| m.is_blank) {
        let name = material.name.as_deref().unwrap_or("robot");
        found.add_warning(Rule::Color, name, "has a <color> without rgba: MuJoCo refuses the model");
    }
    for (link, material) in of_links.iter().filter(|(_, m)| !m.is_defined) {
        match &material.name {
            Some(name) if !defined.contains(name) => {
                let message = format!("has the material '{name}', which is not there: it has no color");
                found.add_warning(Rule::Texture, &link.name, message);
            }
            _ => {}
        }
    }
    let textures: BTreeSet<&String> = all.iter().filter_map(|m| m.texture.as_ref()).collect();
    for texture in textures {
        match path_in_folder(folder, texture, urdf) {
            Err(why) => found.add_warning(Rule::Texture, texture, format!("the texture {why}")),
            Ok(file) if !folder.contains_key(&file) => {
                found.add_warning(Rule::Texture, texture, "the texture is missing");
            }
            Ok(_) => {}
        }
    }
}
