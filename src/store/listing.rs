//! Which objects an input consists of.

use sha2::{Digest as _, Sha256};

use super::{Bucket, ObjectFacts, Scheme, StoreError, Uri};
use crate::io::hex;

/// Most objects below a prefix: a bag of 10,000 files, or the images of a dataset.
const MAX_OBJECTS: usize = 100_000;
/// Files that only datasets hold.
const OF_DATASETS: [&str; 3] = ["init_keyframes.yml", "cam_K.txt", "camera_train.json"];

/// What an input is to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A recording: an MCAP file, a rosbag2 folder, a folder of states, a dataset.
    Recording,
    /// A twin of which the URDF and what stands beside it is read.
    Twin,
    /// A twin with its meshes.
    TwinWithMeshes,
    /// A file that is read whole.
    File,
}

/// The objects of an input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listing {
    /// The input.
    pub uri: Uri,
    /// What is read of it, by path.
    pub objects: Vec<ObjectFacts>,
    /// Paths of files that only have to be there.
    pub names: Vec<String>,
}

impl Listing {
    /// A digest of names, sizes and tags: it changes when an object does.
    #[must_use]
    pub fn identity(&self) -> String {
        let mut digest = Sha256::new();
        for object in &self.objects {
            let line = format!("{}/{}\n{}\n{}\n", self.uri.root, object.path, object.bytes, object.tag);
            digest.update((line.len() as u64).to_le_bytes());
            digest.update(line);
        }
        hex(&digest.finalize())
    }

    /// Bytes of all objects.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.objects.iter().map(|o| o.bytes).sum()
    }

    /// The objects of each bag, a list a bag, and what is read whole.
    #[must_use]
    pub fn bags(&self) -> (Vec<Vec<&ObjectFacts>>, Vec<&ObjectFacts>) {
        let (mut bags, mut others): (Vec<(String, Vec<&ObjectFacts>)>, Vec<&ObjectFacts>) =
            Default::default();
        for object in &self.objects {
            if !object.path.to_ascii_lowercase().ends_with(".mcap") {
                others.push(object);
                continue;
            }
            let (folder, name) = object.path.rsplit_once('/').unwrap_or(("", &object.path));
            let closed = self.objects.iter().any(|o| o.path == format!("{folder}/metadata.yaml"));
            // state0.mcap and state1.mcap side by side are a bag each.
            let bag = if name.starts_with("state") && !closed { object.path.as_str() } else { folder };
            match bags.iter_mut().find(|(of, _)| of == bag) {
                Some((_, files)) => files.push(object),
                None => bags.push((bag.to_owned(), vec![object])),
            }
        }
        (bags.into_iter().map(|(_, files)| files).collect(), others)
    }
}

/// The objects of an input.
///
/// # Errors
/// [`StoreError::Missing`] where nothing is there; a store that cannot be reached.
pub fn list(bucket: &dyn Bucket, uri: &Uri, role: Role) -> Result<Listing, StoreError> {
    let object = if uri.is_prefix { None } else { bucket.head(&uri.path)? };
    if let Some(object) = object {
        let mut objects = vec![object];
        beside(bucket, uri, role, &mut objects)?;
        return Ok(Listing { uri: uri.clone(), objects, names: Vec::new() });
    }
    if uri.scheme == Scheme::Http {
        let missing = if uri.is_prefix { StoreError::NoFolder } else { StoreError::Missing };
        return Err(missing(uri.to_string()));
    }
    let all = bucket.list(&uri.path, MAX_OBJECTS)?;
    // Stores keep empty objects in the place of folders.
    let all: Vec<ObjectFacts> = all.into_iter().filter(|o| is_safe(&o.path) && !is_marker(o)).collect();
    if all.is_empty() {
        return Err(StoreError::Missing(uri.to_string()));
    }
    let (objects, names) = chosen(uri, all, role);
    Ok(Listing { uri: uri.clone(), objects, names })
}

/// What stands beside the object of a twin.
fn beside(
    bucket: &dyn Bucket,
    uri: &Uri,
    role: Role,
    objects: &mut Vec<ObjectFacts>,
) -> Result<(), StoreError> {
    let (folder, name) = uri.path.rsplit_once('/').unwrap_or(("", &uri.path));
    let path = |name: &str| if folder.is_empty() { name.to_owned() } else { format!("{folder}/{name}") };
    match role {
        Role::Recording | Role::File => {}
        Role::TwinWithMeshes if uri.scheme != Scheme::Http => {
            let others = bucket.list(folder, MAX_OBJECTS)?;
            objects.extend(others.into_iter().filter(|o| o.path != uri.path && is_safe(&o.path)));
        }
        Role::Twin | Role::TwinWithMeshes => {
            let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
            for other in [path("model.sdf"), path(&format!("{stem}.usda"))] {
                objects.extend(bucket.head(&other)?);
            }
        }
    }
    objects.sort();
    Ok(())
}

/// Of all objects below a prefix those that are read, and the names of the others where they matter.
fn chosen(uri: &Uri, all: Vec<ObjectFacts>, role: Role) -> (Vec<ObjectFacts>, Vec<String>) {
    let name = |o: &ObjectFacts| o.path.rsplit('/').next().unwrap_or_default().to_ascii_lowercase();
    let below = |o: &ObjectFacts| {
        o.path.strip_prefix(&uri.path).map_or(0, |r| r.trim_matches('/').matches('/').count())
    };
    match role {
        Role::Twin => {
            let read = |o: &ObjectFacts| {
                let name = name(o);
                below(o) == 0 && (name.ends_with(".urdf") || name.ends_with(".usda") || name == "model.sdf")
            };
            (all.into_iter().filter(read).collect(), Vec::new())
        }
        Role::TwinWithMeshes | Role::File => (all, Vec::new()),
        Role::Recording => {
            if all.iter().any(|o| OF_DATASETS.iter().any(|d| d.eq_ignore_ascii_case(&name(o)))) {
                return (all, Vec::new());
            }
            let is_mcap = |o: &ObjectFacts| name(o).ends_with(".mcap") || name(o).ends_with(".mcap.zstd");
            let is_read = |o: &ObjectFacts| is_mcap(o) || name(o) == "metadata.yaml";
            let (read, others): (Vec<_>, Vec<_>) = all.into_iter().partition(is_read);
            // Names of databases refuse a bag; all names stand in the refusal of a folder that is none.
            let matter = |o: &ObjectFacts| {
                let name = name(o);
                name.ends_with(".db3") || name.ends_with(".db3.zstd")
            };
            let none = !read.iter().any(is_mcap);
            let names = others.into_iter().filter(|o| none || matter(o)).map(|o| o.path).collect();
            (read, names)
        }
    }
}

/// Whether a path stays within the folder that it is fetched to.
fn is_safe(path: &str) -> bool {
    !path
        .split('/')
        .any(|p| p.is_empty() || p == "." || p == ".." || p.len() > 255 || p.contains(['\\', '\0']))
}

fn is_marker(object: &ObjectFacts) -> bool {
    object.bytes == 0 && (object.path.ends_with('/') || object.path.ends_with("_$folder$"))
}
