//! The visual meshes of a link: its seen surface and its assumed walls.

use std::borrow::Cow;

use rayon::prelude::*;

use super::look::{Look, LookConfig, look};
use model::{ArticulatedModel, Link, identifier};
use surface::TriangleMesh;

/// A visual mesh of a link.
pub struct Visual<'a> {
    /// Its name in all formats.
    pub name: String,
    /// Name of its material in all formats.
    pub material: String,
    /// Its file, relative to the twin's folder.
    pub path: String,
    /// The mesh, in the frame of the link.
    pub mesh: &'a TriangleMesh,
    /// Whether no view saw it.
    pub is_assumed: bool,
}

impl Visual<'_> {
    /// Its material file, relative to the twin's folder.
    pub fn material_path(&self) -> String {
        self.path.replace(".obj", ".mtl")
    }

    /// Its texture, relative to the twin's folder.
    pub fn texture_path(&self) -> String {
        self.path.replace(".obj", ".png")
    }
}

/// The visual meshes of a link; empty ones are left out.
pub(crate) fn link_visuals(link: &Link) -> impl Iterator<Item = Visual<'_>> {
    let name = &link.name;
    let file = identifier(&link.name);
    let seen = Visual {
        name: format!("{name}_visual"),
        material: name.clone(),
        path: format!("meshes/visual/{file}.obj"),
        mesh: &link.visual,
        is_assumed: false,
    };
    // The file name differs as well, as some readers identify meshes by it alone.
    let assumed = Visual {
        name: format!("{name}_assumed"),
        material: format!("{name}_assumed"),
        path: format!("meshes/assumed/{file}_assumed.obj"),
        mesh: &link.assumed,
        is_assumed: true,
    };
    [seen, assumed].into_iter().filter(|v| !v.mesh.is_empty())
}

/// A visual mesh of a link, with its texture.
pub struct Drawn<'a> {
    /// Index of the link.
    pub link: usize,
    /// The mesh before decimation.
    pub visual: Visual<'a>,
    /// The decimated mesh with its texture.
    pub look: Cow<'a, Look>,
    /// Its texture as a PNG.
    pub png: Vec<u8>,
}

/// All meshes of a model, link by link; `looks` are those of the seen surfaces, in the order of the links.
pub(crate) fn drawn_meshes<'a>(model: &'a ArticulatedModel, looks: &'a [Look]) -> Vec<Drawn<'a>> {
    let mut all = Vec::new();
    for (number, (link, seen)) in model.links.iter().zip(looks).enumerate() {
        all.extend(link_visuals(link).map(|visual| (number, visual, seen)));
    }
    all.into_par_iter().map(|(link, visual, seen)| drawn_visual(link, visual, seen)).collect()
}

fn drawn_visual<'a>(link: usize, visual: Visual<'a>, seen: &'a Look) -> Drawn<'a> {
    let look = if visual.is_assumed { Cow::Owned(plain_look(visual.mesh)) } else { Cow::Borrowed(seen) };
    // Encoded once, as the folder and the viewer contain the same textures.
    let png = look.png_of_texture();
    Drawn { link, visual, look, png }
}

/// Looks of links without photos: the textures show the meshes' own colors.
pub(crate) fn plain_looks(model: &ArticulatedModel) -> Vec<Look> {
    model.links.iter().map(|link| plain_look(&link.visual)).collect()
}

fn plain_look(mesh: &TriangleMesh) -> Look {
    look(mesh, &[], &LookConfig::default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::example::{box_mesh, cabinet};

    #[test]
    fn a_wall_that_no_view_saw_is_a_mesh_of_its_own_in_its_own_color() {
        let mut model = cabinet();
        model.links[2].assumed = box_mesh([0.0; 3], [0.4, 0.3, 0.02], [200, 60, 50]);
        let looks = plain_looks(&model);
        let drawn = drawn_meshes(&model, &looks);
        let names: Vec<(usize, &str)> = drawn.iter().map(|d| (d.link, d.visual.name.as_str())).collect();
        assert_eq!(
            names,
            [(0, "body_visual"), (1, "door_visual"), (2, "drawer_visual"), (2, "drawer_assumed")]
        );
        assert_eq!(drawn[3].visual.texture_path(), "meshes/assumed/drawer_assumed.png");
        assert!(drawn[3].look.texture.contains(&[200, 60, 50]));
    }
}
