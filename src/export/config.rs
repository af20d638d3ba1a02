//! Choices between equivalent forms of the files, and facts that no recording contains.

use serde::{Deserialize, Serialize};

use model::{PartNames, is_plain_name};

/// Largest length of the prefix: names of 64 characters keep room for the rest.
const MAX_PREFIX: usize = 24;
/// Largest length of license and maintainer, characters.
const MAX_TEXT: usize = 200;

/// How the files of a twin are written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExportConfig {
    /// How `NAME.urdf` represents a screw joint.
    pub urdf_screw: UrdfScrew,
    /// Prefix of the names of all links and joints, for several twins in one scene.
    pub prefix: String,
    /// Whether the twin is fixed in the world or free to move.
    pub base: Base,
    /// How the moving parts are named.
    pub names: PartNames,
    /// License of the files, for `package.xml`; an SPDX identifier.
    pub license: String,
    /// Their maintainer: `Name <address>`.
    pub maintainer: String,
}

impl Default for ExportConfig {
    fn default() -> Self {
        Self {
            urdf_screw: UrdfScrew::default(),
            prefix: String::new(),
            base: Base::default(),
            names: PartNames::default(),
            // A ROS package needs both (REP 149), and the program knows neither.
            license: "unknown".to_owned(),
            maintainer: "nobody <nobody@example.com>".to_owned(),
        }
    }
}

impl ExportConfig {
    /// Refuses values that the files cannot represent.
    ///
    /// # Errors
    /// The key within the group, and what is wrong with its value.
    pub fn check_values(&self) -> Result<(), (&'static str, String)> {
        let is_short_name = is_plain_name(&self.prefix) && self.prefix.len() <= MAX_PREFIX;
        if !self.prefix.is_empty() && !is_short_name {
            let why = format!(
                "'{}'; give a letter, then letters, digits and _, {MAX_PREFIX} characters at most",
                self.prefix.escape_debug()
            );
            return Err(("prefix", why));
        }
        if !is_plain_line(&self.license) {
            return Err(("license", "give a line of text, such as an SPDX identifier".to_owned()));
        }
        match self.maintainer() {
            Some(_) if is_plain_line(&self.maintainer) => Ok(()),
            _ => Err(("maintainer", "give a line of the form Name <address>".to_owned())),
        }
    }

    /// Name and address of the maintainer.
    pub fn maintainer(&self) -> Option<(&str, &str)> {
        let (name, rest) = self.maintainer.split_once('<')?;
        let address = rest.trim_end().strip_suffix('>')?;
        let is_address = address.split_once('@').is_some_and(|(user, host)| {
            !user.is_empty() && !host.is_empty() && !address.contains(char::is_whitespace)
        });
        (is_address && !name.trim().is_empty()).then_some((name.trim(), address))
    }
}

fn is_plain_line(text: &str) -> bool {
    !text.trim().is_empty() && text.chars().count() <= MAX_TEXT && !text.chars().any(|c| c.is_control())
}

/// How a screw joint is represented in URDF, which has none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UrdfScrew {
    /// As a slide and a turn with `mimic`; `single_joint/NAME.urdf` holds the nearest joint for simulators
    /// without `mimic`.
    #[default]
    Pair,
    /// As the nearest joint, with its pitch in an element `artitwin:thread`.
    Nearest,
}

/// How the root link is held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Base {
    /// It is fixed in the world.
    #[default]
    Fixed,
    /// It moves freely. URDF cannot express either: there the simulator's own option decides.
    Floating,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_file_can_hold_is_refused_by_key() {
        ExportConfig::default().check_values().unwrap();
        let with = |edit: fn(&mut ExportConfig)| {
            let mut config = ExportConfig::default();
            edit(&mut config);
            config.check_values().map_err(|(key, _)| key)
        };
        assert_eq!(with(|c| c.prefix = "left_".into()), Ok(()));
        for prefix in ["2_", "a b", "_", "../", "a_prefix_of_25_characters"] {
            let config = ExportConfig { prefix: prefix.into(), ..ExportConfig::default() };
            assert_eq!(config.check_values().map_err(|(key, _)| key), Err("prefix"), "{prefix}");
        }
        assert_eq!(with(|c| c.license = " ".into()), Err("license"));
        assert_eq!(with(|c| c.license = "MIT\nApache".into()), Err("license"));
        assert_eq!(with(|c| c.maintainer = "Ada <ada@example.org>".into()), Ok(()));
        for maintainer in ["Ada", "<ada@example.org>", "Ada <ada>", "Ada <a b@c>", "Ada <ada@example.org"] {
            let config = ExportConfig { maintainer: maintainer.into(), ..ExportConfig::default() };
            assert_eq!(config.check_values().map_err(|(key, _)| key), Err("maintainer"), "{maintainer}");
        }
        let ada = ExportConfig { maintainer: "Ada L. <ada@example.org>".into(), ..ExportConfig::default() };
        assert_eq!(ada.maintainer(), Some(("Ada L.", "ada@example.org")));
    }
}
