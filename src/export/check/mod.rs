//! Static checks of a URDF folder for what importers would refuse, silently lose, or let explode.
//!
//! They work on files in memory and on any URDF, not only on those written here.

mod description;
mod finding;
mod joints;
mod links;
mod materials;
mod mesh_text;
mod meshes;
mod named;
mod numbers;
mod overlap;
mod paths;
mod placement;
mod places;
mod rule;
mod shapes;
mod tree;
mod welds;

use std::borrow::Cow;

pub use description::{
    Description, Geometry, INERTIA, InertialText, JointText, LimitText, LinkText, ShapeText, UnsoundUrdf,
};
use finding::Findings;
pub use finding::{CheckFinding, Folder, Level};
pub use named::named_files;
pub use paths::package_name;
pub(crate) use rule::Rule;
use welds::Welds;

use common::limits::with_declaration;

/// All findings on the URDFs of a folder, errors first; a folder without any URDF is an error. Files named
/// `*.ros.urdf` may contain `package://` paths of the folder's package.
pub fn check_folder(folder: &Folder) -> Vec<CheckFinding> {
    let mut all = Vec::new();
    let urdfs: Vec<&String> = folder.keys().filter(|p| p.ends_with(".urdf")).collect();
    if urdfs.is_empty() {
        let mut found = Findings::of_file(".");
        found.add_error(Rule::File, ".", "the folder holds no .urdf file");
        return found.all;
    }
    for path in urdfs {
        all.extend(check_urdf(folder, path));
    }
    // By level first, in the order of the fields of `CheckFinding`.
    all.sort();
    all
}

fn check_urdf(folder: &Folder, path: &str) -> Vec<CheckFinding> {
    let mut found = Findings::of_file(path);
    // Bytes that are not UTF-8 are replaced; the rules then report the text.
    let text = folder.get(path).map(|b| String::from_utf8_lossy(b).into_owned()).unwrap_or_default();
    let declared = with_declaration(&text);
    if matches!(declared, Cow::Owned(_)) {
        found.add_warning(Rule::Xml, path, "its <?xml ...?> has no version: readers of XML refuse the file");
    }
    let description = match Description::parse(&declared) {
        Ok(description) => description,
        Err(problem) => {
            found.add_error(Rule::Xml, path, problem.to_string());
            return found.all;
        }
    };
    check_soundness(&description, &mut found);
    links::check_possible_inertias(&description, &mut found);
    let is_sound = found.all.is_empty();
    let welds = Welds::of_description(&description);
    links::check_links(&description, &welds, &mut found);
    shapes::check_shapes(&description, &mut found);
    joints::check_joints(&description, &mut found);
    materials::check_materials(&description, folder, path, &mut found);
    let solids = meshes::checked_solids(&description, folder, path, &mut found);
    // Positions have no meaning if the tree or a number is broken.
    if is_sound
        && !found.all.iter().any(|f| f.level == Level::Error && [Rule::Limit, Rule::Joint].contains(&f.rule))
    {
        overlap::check_overlap(&description, &solids, &welds, &mut found);
    }
    found.all
}

/// Reports what is wrong for every reader, importer or not: ambiguous names, links that form no tree,
/// malformed or impossible numbers.
fn check_soundness(description: &Description, found: &mut Findings) {
    check_numbers(description, found);
    tree::check_tree(description, found);
    joints::check_joint_limits(description, found);
}

fn check_numbers(description: &Description, found: &mut Findings) {
    for bad in &description.bad_numbers {
        found.add_error(bad.rule, &bad.subject, bad.message.as_str());
    }
}

impl Description {
    /// Refuses a URDF that does not describe bodies: names used twice, links that form no tree, malformed
    /// numbers. What only some importers refuse is left out, and inertias that no body can have: a robot has
    /// many links that a recording does not move.
    ///
    /// # Errors
    /// [`UnsoundUrdf::Broken`].
    pub fn require_sound(self) -> Result<Self, UnsoundUrdf> {
        let mut found = Findings::of_file("");
        check_soundness(&self, &mut found);
        self.without(found)
    }

    /// Refuses a URDF with malformed or impossible numbers.
    ///
    /// # Errors
    /// [`UnsoundUrdf::Broken`].
    pub fn require_numbers(self) -> Result<Self, UnsoundUrdf> {
        let mut found = Findings::of_file("");
        check_numbers(&self, &mut found);
        self.without(found)
    }

    fn without(self, found: Findings) -> Result<Self, UnsoundUrdf> {
        let more = found.all.len().saturating_sub(1);
        found.all.into_iter().next().map_or(Ok(self), |first| Err(UnsoundUrdf::Broken { first, more }))
    }
}

#[cfg(test)]
mod tests;
