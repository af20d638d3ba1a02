//! Where results of jobs stand: a folder of this machine or a store.

use std::{
    fs::{self, OpenOptions},
    io::{self, Write as _},
    path::{Path, PathBuf},
    sync::Arc,
};

use super::{JobError, manifest::MAX_MANIFEST, request::uri};
use crate::{
    files,
    io::{open_plain, result_files},
    limits::FileLimit,
    store::{Bucket, Created, StoreError, Traffic, UploadedFile, Uri, connect, upload},
};

/// Where results of jobs stand.
pub enum Output {
    /// A folder that is no store: the command's own rules hold.
    Plain(PathBuf),
    /// A folder that is a store.
    Folder(PathBuf),
    /// A store elsewhere.
    Store(Uri, Box<dyn Bucket>),
}

impl Output {
    /// What `--out` names.
    ///
    /// # Errors
    /// A URI that is not served; a store that cannot be used.
    pub fn of(out: &Path, traffic: &Arc<Traffic>) -> Result<Self, StoreError> {
        let Some(uri) = uri(out)? else { return Ok(Self::Plain(out.to_owned())) };
        if let Some(folder) = uri.local() {
            return Ok(Self::Folder(folder));
        }
        let bucket = connect(&uri, traffic)?;
        Ok(Self::Store(uri, bucket))
    }

    /// Whether results have keys here.
    #[must_use]
    pub fn is_store(&self) -> bool {
        !matches!(self, Self::Plain(_))
    }

    /// URI of what stands under a name.
    #[must_use]
    pub fn uri(&self, name: &str) -> String {
        match self {
            Self::Plain(folder) => folder.join(name).display().to_string(),
            Self::Folder(folder) => format!("file://{}", folder.join(name).display()),
            Self::Store(uri, _) => uri.join(name).to_string(),
        }
    }

    /// The text of a manifest; `None` where there is none.
    ///
    /// # Errors
    /// A store or disk that refuses.
    pub fn manifest(&self, key: &str) -> Result<Option<Vec<u8>>, JobError> {
        let name = format!("{key}.json");
        match self {
            Self::Plain(_) => Ok(None),
            Self::Folder(folder) => {
                let path = folder.join(name);
                let limit = FileLimit { what: "a manifest", bytes: MAX_MANIFEST };
                match files::read(&path, limit) {
                    Ok(text) => Ok(Some(text)),
                    Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
                    Err(source) => Err(JobError::Disk { path, source }),
                }
            }
            Self::Store(uri, bucket) => Ok(bucket.get(&uri.join(&name).path, MAX_MANIFEST)?),
        }
    }

    /// The files of a result that was made in `folder`, as they stand in the output under `key/name`.
    ///
    /// # Errors
    /// A store or disk that refuses.
    pub fn put_result(&self, folder: &Path, key: &str, name: &str) -> Result<Vec<UploadedFile>, JobError> {
        let listed = result_files(folder)
            .map_err(|source| JobError::Disk { path: folder.to_owned(), source })?
            .into_iter()
            .map(|(path, bytes, sha256)| UploadedFile { path, bytes, sha256 })
            .collect::<Vec<_>>();
        match self {
            // It was made in its place.
            Self::Plain(_) | Self::Folder(_) => Ok(listed),
            Self::Store(uri, bucket) => {
                let prefix = uri.join(&format!("{key}/{name}")).path;
                Ok(upload(bucket.as_ref(), folder, &listed, &prefix)?)
            }
        }
    }

    /// Puts a manifest in its place, unless one stands there.
    ///
    /// # Errors
    /// A store or disk that refuses.
    pub fn put_manifest(&self, key: &str, text: &[u8]) -> Result<Created, JobError> {
        let name = format!("{key}.json");
        match self {
            Self::Plain(_) => Ok(Created::Stood),
            Self::Folder(folder) => {
                let path = folder.join(name);
                create_whole(&path, text).map_err(|source| JobError::Disk { path, source })
            }
            Self::Store(uri, bucket) => {
                let made = bucket.create(vec![(uri.join(&name).path, text.to_vec())])?;
                Ok(made.first().copied().unwrap_or(Created::Stood))
            }
        }
    }
}

/// Makes a file that is there whole or not at all, unless one of its name is there.
fn create_whole(path: &Path, text: &[u8]) -> io::Result<Created> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let part = folder.join(format!(".{name}.{}.part", std::process::id()));
    let mut file = open_plain(&part, OpenOptions::new().write(true).create(true).truncate(true))?;
    let written = file.write_all(text).and_then(|()| file.sync_all());
    // A link is made whole, and where nothing stands, in one step.
    let made = written.and_then(|()| match fs::hard_link(&part, path) {
        Ok(()) => Ok(Created::New),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(Created::Stood),
        // Disks without links: whoever holds the job's lock is the only one to write it.
        Err(_) if path.exists() => Ok(Created::Stood),
        Err(_) => fs::rename(&part, path).map(|()| Created::New),
    });
    fs::remove_file(&part).ok();
    made
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::temp::Temp;

    #[test]
    fn a_manifest_is_written_once() {
        let folder = Temp::new("job-output");
        let out = Output::Folder(folder.0.join("new"));
        assert!(out.manifest("k").unwrap().is_none());
        assert_eq!(out.put_manifest("k", b"first").unwrap(), Created::New);
        assert_eq!(out.put_manifest("k", b"second").unwrap(), Created::Stood);
        assert_eq!(out.manifest("k").unwrap().unwrap(), b"first");
        assert_eq!(fs::read_dir(folder.0.join("new")).unwrap().count(), 1);
    }
}
