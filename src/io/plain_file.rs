//! Files under predictable names: planted links and pipes are never followed, emptied or waited for.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Write as _},
    path::Path,
};

/// Opens a plain file. Links are refused, not followed; pipes and devices are refused, not waited for. The
/// file's content stays.
///
/// # Errors
/// If it is something else, or the system refuses.
pub fn open_plain(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    // O_NONBLOCK, because otherwise opening a pipe waits until somebody writes.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, nix::libc::O_NOFOLLOW | nix::libc::O_NONBLOCK);
    let file = options.open(path)?;
    // The second check finds links on systems without O_NOFOLLOW.
    if file.metadata()?.is_file() && fs::symlink_metadata(path)?.is_file() {
        return Ok(file);
    }
    Err(io::Error::other("it is no plain file"))
}

/// Creates a plain file in place of another; of a link, the link is removed, not its target.
///
/// # Errors
/// If a folder has that name, or the system refuses.
pub fn create_plain(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    // Not `create`, which would empty a file put there meanwhile, or follow a link.
    File::create_new(path)
}

/// Writes a new file completely or not at all.
///
/// # Errors
/// If something has that name, or the system refuses.
pub fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = File::create_new(path)?;
    file.write_all(bytes).and_then(|()| file.sync_all()).inspect_err(|_| {
        // A half-written file is useless; if it cannot be removed, nothing more can be done.
        fs::remove_file(path).ok();
    })
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn links_pipes_and_folders_are_not_opened_and_nothing_is_emptied() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().to_owned();
        fs::create_dir_all(root.join("folder")).unwrap();
        let [victim, link, pipe] = ["victim", "link", "pipe"].map(|n| root.join(n));
        fs::write(&victim, "precious").unwrap();
        symlink(&victim, &link).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let open = |path: &Path| open_plain(path, OpenOptions::new().write(true).create(true));
        for path in [&link, &pipe, &root.join("folder")] {
            assert!(open(path).is_err(), "{}", path.display());
            assert!(open_plain(path, OpenOptions::new().read(true)).is_err(), "{}", path.display());
        }
        drop(open(&victim).unwrap());
        assert!(open(&root.join("new")).is_ok());
        create_plain(&link).unwrap().write_all(b"new").unwrap();
        create_plain(&pipe).unwrap();
        assert!(create_plain(&root.join("folder")).is_err());
        assert_eq!(fs::read_to_string(&victim).unwrap(), "precious");
        assert_eq!(fs::read_to_string(&link).unwrap(), "new");
    }
}
