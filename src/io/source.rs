//! Determines the kind of input at a path: bags, states, or a dataset.

use std::{
    io::ErrorKind,
    path::{Path, PathBuf},
};

use super::{bag::Bag, dataset::STATES, folder::ImageFolder};
use capture::{CaptureError, MAX_STATES};

/// An input to open.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// One recording per state, at least two.
    States(Vec<PathBuf>),
    /// One recording with both states.
    Both(PathBuf),
    /// A dataset folder with posed images (cam_K.txt, init_keyframes.yml).
    Keyframes(PathBuf),
    /// A dataset folder with `start` and `end` (camera_train.json).
    StartEnd(PathBuf),
}

impl Source {
    /// The kind of input at the paths.
    ///
    /// # Errors
    /// [`CaptureError::Missing`], [`CaptureError::NotARecording`] and [`CaptureError::Read`].
    pub fn of(paths: &[PathBuf]) -> Result<Self, CaptureError> {
        match paths {
            [] => {
                Err(CaptureError::NotARecording { path: PathBuf::new(), reason: "no path was given".into() })
            }
            [one] => Self::of_one(one),
            _ => {
                check_count(paths.len())?;
                for path in paths {
                    exists(path)?;
                    if !Bag::is_at(path) {
                        return Err(CaptureError::NotARecording {
                            path: path.clone(),
                            reason: describe(path),
                        });
                    }
                }
                Ok(Self::States(paths.to_vec()))
            }
        }
    }

    fn of_one(path: &Path) -> Result<Self, CaptureError> {
        exists(path)?;
        // Datasets first, by files that bags do not have.
        let has = |name: &str| path.join(name).is_file();
        if has("init_keyframes.yml") || (has("cam_K.txt") && !ImageFolder::is_at(path)) {
            return Ok(Self::Keyframes(path.to_owned()));
        }
        if STATES.iter().all(|s| path.join(s).join("camera_train.json").is_file()) {
            return Ok(Self::StartEnd(path.to_owned()));
        }
        // A folder named as a state is one, or the fault is there.
        let state = |s: usize| state_bag(path, s);
        let fault = (0..2).find(|s| state_folder(path, *s).is_dir() && state(*s).is_none());
        if let Some(folder) = fault.map(|s| state_folder(path, s)) {
            let reason = describe(&folder);
            return Err(CaptureError::NotARecording { path: folder, reason });
        }
        match (state(0), state(1)) {
            (Some(_), Some(_)) => {
                let states: Vec<PathBuf> = (0..).map_while(&state).collect();
                // A gap in the numbers is hardly intended.
                let count = states.len();
                if let Some(further) = (count + 1..=count + MAX_STATES).find(|s| state(*s).is_some()) {
                    let reason = format!(
                        "it holds state{further} but not state{count}; number the states without gaps"
                    );
                    return Err(CaptureError::NotARecording { path: path.to_owned(), reason });
                }
                check_count(count)?;
                Ok(Self::States(states))
            }
            // A folder with metadata.yaml is a bag itself, whatever its files are called.
            (Some(_), None) | (None, Some(_)) if !path.join("metadata.yaml").is_file() => {
                Err(CaptureError::OneState { path: path.to_owned() })
            }
            _ if Bag::is_at(path) => Ok(Self::Both(path.to_owned())),
            _ => Err(CaptureError::NotARecording { path: path.to_owned(), reason: describe(path) }),
        }
    }

    /// Number of states.
    #[must_use]
    pub fn states(&self) -> usize {
        match self {
            Self::States(paths) => paths.len(),
            Self::Both(_) | Self::Keyframes(_) | Self::StartEnd(_) => 2,
        }
    }

    /// A name for the object: that of the folder above the states, or of the recording;
    /// `[A-Za-z][A-Za-z0-9_]*`.
    #[must_use]
    pub fn object_name(&self) -> String {
        let path = match self {
            Self::States(paths) => match paths.as_slice() {
                // state0 and state1 side by side: the folder around them has the object's name.
                [zero, others @ ..]
                    if !others.is_empty()
                        && others.iter().all(|o| o.parent() == zero.parent() && o != zero) =>
                {
                    zero.parent().map_or_else(String::new, own_name)
                }
                paths => paths.first().map_or_else(String::new, |zero| own_name(zero)),
            },
            Self::Both(path) | Self::Keyframes(path) | Self::StartEnd(path) => own_name(path),
        };
        sanitize(&path)
    }
}

/// Whether a path is a recording: a rosbag2 folder, an MCAP or ROS 1 file, or a folder of images.
#[must_use]
pub fn is_recording(path: &Path) -> bool {
    Bag::is_at(path)
}

/// The object's name for the recordings at these paths, from the paths alone: `[A-Za-z][A-Za-z0-9_]*`.
#[must_use]
pub fn name_of(paths: &[PathBuf]) -> String {
    match paths {
        [one] => Source::Both(one.clone()),
        many => Source::States(many.to_vec()),
    }
    .object_name()
}

/// Refuses more states than [`MAX_STATES`].
fn check_count(count: usize) -> Result<(), CaptureError> {
    if count <= MAX_STATES { Ok(()) } else { Err(CaptureError::TooManyStates { count, limit: MAX_STATES }) }
}

fn exists(path: &Path) -> Result<(), CaptureError> {
    match path.metadata() {
        Ok(_) => Ok(()),
        Err(e) if e.kind() == ErrorKind::NotFound => Err(CaptureError::Missing { path: path.to_owned() }),
        Err(source) => Err(CaptureError::Read { path: path.to_owned(), source }),
    }
}

fn state_folder(path: &Path, s: usize) -> PathBuf {
    path.join(format!("state{s}"))
}

/// Recording of a state in a folder: a rosbag2 folder, a folder of images, or a bare file.
fn state_bag(path: &Path, s: usize) -> Option<PathBuf> {
    let folder = state_folder(path, s);
    let files = [folder.clone(), folder.with_extension("mcap"), folder.with_extension("bag")];
    files.into_iter().find(|p| Bag::is_at(p))
}

/// Last part of a path without extension, also where it is given as `.` or ``.
fn own_name(path: &Path) -> String {
    let stem = |p: &Path| p.file_stem().map(|n| n.to_string_lossy().into_owned());
    if let Some(name) = stem(path) {
        return name;
    }
    let given = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    std::fs::canonicalize(given).ok().and_then(|absolute| stem(&absolute)).unwrap_or_default()
}

fn sanitize(name: &str) -> String {
    let clean: String =
        name.chars().take(64).map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    // USD and ROS do not allow names that begin with a digit.
    if clean.starts_with(|c: char| c.is_ascii_alphabetic()) { clean } else { format!("object_{clean}") }
}

fn describe(path: &Path) -> String {
    if path.is_file() {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        return match extension.as_deref() {
            Some("r3d" | "zip") => "it is an archive; unpack it into a folder with `unzip`".into(),
            Some("mp4" | "mov" | "mkv" | "avi") => "it is a video of color alone, and depth is needed".into(),
            _ => "the file begins neither as an MCAP file nor as a ROS 1 bag".into(),
        };
    }
    let mut names: Vec<_> = std::fs::read_dir(path)
        .into_iter()
        .flatten()
        .flatten()
        .map(|e| e.file_name().to_string_lossy().into_owned())
        .take(1000)
        .collect();
    names.sort();
    match names.len() {
        0 => "the folder is empty".into(),
        n => format!("the folder holds {}{}", names[..n.min(5)].join(", "), if n > 5 { ", ..." } else { "" }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_identifiers() {
        let of = |s: &str| Source::Both(PathBuf::from(s)).object_name();
        assert_eq!(of("/x/my fridge-2.mcap"), "my_fridge_2");
        assert_eq!(of("/x/2nd"), "object_2nd");
        let states =
            |a: &str, b: &str| Source::States(vec![PathBuf::from(a), PathBuf::from(b)]).object_name();
        assert_eq!(states("/x/laptop/state0", "/x/laptop/state1"), "laptop");
        assert_eq!(states("/x/a/open", "/y/b/closed"), "open");
    }

    #[test]
    fn a_state_that_is_no_recording_is_named_and_not_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        for state in ["state0", "state1"] {
            std::fs::create_dir(folder.path().join(state)).unwrap();
            std::fs::write(folder.path().join(state).join("cloud.ply"), b"ply").unwrap();
        }
        let why = Source::of(&[folder.path().to_owned()]).unwrap_err().to_string();
        assert!(why.contains("state0` is not a recording: the folder holds cloud.ply"), "{why}");
        std::fs::write(folder.path().join("state0/a.bag"), b"#ROSBAG V2.0\n").unwrap();
        let why = Source::of(&[folder.path().to_owned()]).unwrap_err().to_string();
        assert!(why.contains("state1` is not a recording: the folder holds cloud.ply"), "{why}");
        let archive = folder.path().join("a.r3d");
        std::fs::write(&archive, b"PK").unwrap();
        assert!(Source::of(&[archive]).unwrap_err().to_string().contains("unzip"));
    }

    #[test]
    fn all_states_of_a_folder_are_found_and_a_gap_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_owned();
        let add = |s: usize| std::fs::write(root.join(format!("state{s}.mcap")), b"\x89MCAP0\r\n").unwrap();
        let of = || Source::of(std::slice::from_ref(&root));
        (0..3).for_each(add);
        let Ok(Source::States(states)) = of() else { panic!("{:?}", of()) };
        assert_eq!(states.len(), 3);
        add(4);
        assert!(of().unwrap_err().to_string().contains("state4 but not state3"));
        (3..MAX_STATES + 1).for_each(add);
        assert!(of().unwrap_err().to_string().contains("17 states, 16 at most"));
    }
}
