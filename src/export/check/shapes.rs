//! Checks that visuals and collisions have a name and a known geometry.

use super::{
    description::{Description, Geometry, ShapeText},
    finding::Findings,
    rule::Rule,
};

pub(super) fn check_shapes(description: &Description, found: &mut Findings) {
    for link in &description.links {
        for (kind, shapes) in [("visual", &link.visuals), ("collision", &link.collisions)] {
            if shapes.iter().any(|s| s.name.is_none()) {
                found.add_warning(Rule::Name, &link.name, format!("has a <{kind}> without a name"));
            }
            shapes.iter().for_each(|shape| check_geometry(&link.name, kind, shape, found));
        }
    }
}

fn check_geometry(link: &str, kind: &str, shape: &ShapeText, found: &mut Findings) {
    let why = match &shape.geometry {
        Geometry::Missing => {
            format!("has a <{kind}> without geometry: importers drop it, PyBullet refuses the model")
        }
        Geometry::Other(tag) => {
            format!("has a <{kind}> of geometry <{tag}>; mesh, box, cylinder and sphere load everywhere")
        }
        _ => return,
    };
    found.add_warning(Rule::Geometry, link, why);
}
