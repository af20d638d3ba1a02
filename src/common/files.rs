//! Reads regular files up to a size limit; every file that a user names is opened here. Also writes small
//! files atomically.

use std::{
    fs::{File, Metadata, OpenOptions},
    io::{self, ErrorKind, Read as _},
    path::Path,
};

use crate::limits::FileLimit;

/// Opens a file for reading. Links are followed; a device, pipe or socket is refused at once.
///
/// # Errors
/// The system's error, or that the file is not a regular one.
pub fn open_regular(path: &Path) -> io::Result<File> {
    // Checked first: merely opening a device may have an effect.
    check_regular(&std::fs::metadata(path)?)?;
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt as _;
        // If a pipe has replaced the file meanwhile, opening it does not block.
        options.custom_flags(nix::fcntl::OFlag::O_NONBLOCK.bits());
    }
    let file = options.open(path)?;
    check_regular(&file.metadata()?)?;
    Ok(file)
}

fn check_regular(metadata: &Metadata) -> io::Result<()> {
    match metadata {
        m if m.is_file() => Ok(()),
        m if m.is_dir() => Err(ErrorKind::IsADirectory.into()),
        _ => Err(io::Error::new(
            ErrorKind::InvalidInput,
            "it is a device, pipe or socket; give a regular file",
        )),
    }
}

/// Reads a whole file.
///
/// # Errors
/// As [`open_regular`], or if the file exceeds the limit.
pub fn read_limited(path: &Path, limit: FileLimit) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // One byte more than the limit reveals a file that is too large, even if it grows while it is read.
    open_regular(path)?.take(limit.bytes + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit.bytes {
        return Err(io::Error::new(
            ErrorKind::FileTooLarge,
            format!("more than {} bytes, the limit of {}", limit.bytes, limit.what),
        ));
    }
    Ok(bytes)
}

/// Reads a whole text file.
///
/// # Errors
/// As [`read_limited`], or if the text is not UTF-8.
pub fn read_text(path: &Path, limit: FileLimit) -> io::Result<String> {
    String::from_utf8(read_limited(path, limit)?)
        .map_err(|e| io::Error::new(ErrorKind::InvalidData, format!("not UTF-8 text: {e}")))
}

/// Writes a small file under a temporary name and renames it: after a crash there is the old file or the new
/// one, never half of one.
///
/// # Errors
/// The system's error.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut part = path.as_os_str().to_owned();
    part.push(".part");
    let written = std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path));
    written.inspect_err(|_| drop(std::fs::remove_file(&part)))
}

/// Largest number of files below an input folder.
const MAX_FILES: usize = 100_000;

/// Relative paths, with `/`, of all files below a folder, sorted. Links to files are followed; links to
/// folders are not, as they could form a loop.
///
/// # Errors
/// If something cannot be read, or the folder holds more than 100,000 files.
pub fn files_below(folder: &Path) -> io::Result<Vec<String>> {
    let mut found = Vec::new();
    let mut open = vec![(folder.to_owned(), String::new())];
    while let Some((path, prefix)) = open.pop() {
        for entry in std::fs::read_dir(&path)? {
            let entry = entry?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.file_type()?.is_dir() {
                open.push((entry.path(), format!("{name}/")));
            } else if entry.path().is_file() {
                found.push(name);
            }
            if found.len() > MAX_FILES {
                let folder = folder.display();
                return Err(io::Error::other(format!(
                    "{folder} holds more than {MAX_FILES} files: not a recording"
                )));
            }
        }
    }
    // `read_dir` returns them in no particular order.
    found.sort();
    Ok(found)
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    const SMALL: FileLimit = FileLimit { what: "a test", bytes: 10 };

    #[test]
    fn regular_files_are_read_up_to_their_limit_and_nothing_else_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("ten"), "0123456789").unwrap();
        std::fs::write(path("eleven"), "0123456789x").unwrap();
        symlink(path("ten"), path("link")).unwrap();
        symlink("/dev/zero", path("zero")).unwrap();
        let made = std::process::Command::new("mkfifo").arg(path("pipe")).status().unwrap();
        assert!(made.success());
        symlink(path("pipe"), path("pipe_link")).unwrap();
        assert_eq!(read_text(&path("ten"), SMALL).unwrap(), "0123456789");
        assert_eq!(read_text(&path("link"), SMALL).unwrap(), "0123456789");
        let message = |name: &str| read_limited(&path(name), SMALL).unwrap_err().to_string();
        assert_eq!(message("eleven"), "more than 10 bytes, the limit of a test");
        for odd in ["zero", "pipe", "pipe_link"] {
            assert!(message(odd).contains("device, pipe or socket"), "{}", message(odd));
        }
        assert!(message("gone").contains("No such file"));
        assert!(message("").contains("directory"));
        std::fs::write(path("ten"), [0xff]).unwrap();
        assert!(read_text(&path("ten"), SMALL).unwrap_err().to_string().contains("not UTF-8"));
    }
}
