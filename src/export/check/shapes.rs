//! Rules of visuals and collisions: each has a name and a known geometry.

use super::{
    description::{Description, Geometry, ShapeText},
    finding::Findings,
    rule::Rule,
};

pub(super) fn check(description: &Description, found: &mut Findings) {
    for link in &description.links {
        for (kind, shapes) in [("visual", &link.visuals), ("collision", &link.collisions)] {
            if shapes.iter().any(|s| s.name.is_none()) {
                found.warn(Rule::Name, &link.name, format!("has a <{kind}> without a name"));
            }
            shapes.iter().for_each(|shape| geometry(&link.name, kind, shape, found));
        }
    }
}

fn geometry(link: &str, kind: &str, shape: &ShapeText, found: &mut Findings) {
    let why = match &shape.geometry {
        Geometry::Missing => {
            format!("has a <{kind}> without geometry: importers drop it, PyBullet refuses the model")
        }
        Geometry::Other(tag) => {
            format!("has a <{kind}> of geometry <{tag}>; mesh, box, cylinder and sphere load everywhere")
        }
        _ => return,
    };
    found.warn(Rule::Geometry, link, why);
}
