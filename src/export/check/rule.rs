//! The rules of a check (`docs/codes.md`).

use std::fmt;

macro_rules! rules {
    ($($name:ident = $word:literal, $meaning:literal;)*) => {
        /// The rule that a finding breaks; findings of one level are sorted by it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Rule {
            $(#[doc = $meaning] $name,)*
        }

        impl Rule {
            /// All rules, each with its word and what it demands.
            pub const ALL: &[(Self, &str, &str)] = &[$((Self::$name, $word, $meaning),)*];

            /// Its word in output lines.
            pub fn word(self) -> &'static str {
                match self {
                    $(Self::$name => $word,)*
                }
            }
        }
    };
}

rules! {
    Color = "color", "Colors are four numbers that are not negative.";
    File = "file", "There is a URDF, and its findings can be listed.";
    Fit = "fit", "Collision shapes stand where the visible surface does.";
    Format = "format", "Meshes and textures are of formats that all importers read.";
    Geometry = "geometry", "Sizes and scales are numbers that a shape can have.";
    Inertia = "inertia", "Masses and inertias are those of a body, and none is missing or too small.";
    Joint = "joint", "Joints are of types that load everywhere, with an axis; mimics follow one that leads.";
    Limit = "limit", "Joints have limits, effort and velocity that importers take.";
    Mesh = "mesh", "Meshes are there, whole and, for collisions, convex.";
    Name = "name", "Names are unique and plain.";
    Origin = "origin", "Places are numbers.";
    Overlap = "overlap", "Collision shapes are apart at rest.";
    Path = "path", "Files are named by paths inside the folder.";
    Sweep = "sweep", "Collision shapes stay apart while the joints move.";
    Texture = "texture", "Materials and textures are there.";
    Tree = "tree", "Links and joints make one tree.";
    Xml = "xml", "The text is XML of a robot.";
}

impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_rules_is_that_of_the_program() {
        let table = include_str!("../../../docs/codes.md");
        let (_, table) = table.split_once("## Rules of `check`").unwrap();
        let (table, _) = table.split_once("\n## ").unwrap();
        let rows: Vec<&str> = table.lines().filter(|l| l.starts_with("| `")).collect();
        let expected: Vec<String> =
            Rule::ALL.iter().map(|(_, word, meaning)| format!("| `{word}` | {meaning} |")).collect();
        assert_eq!(rows, expected);
        assert!(Rule::ALL.is_sorted_by_key(|(_, word, _)| word));
    }
}
