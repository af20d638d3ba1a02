//! Free disk space.

use std::path::Path;

/// Free bytes on the file system of a folder; `None` if the system does not report them.
#[must_use]
#[cfg(unix)]
pub fn free_bytes(folder: &Path) -> Option<u64> {
    let disk = nix::sys::statvfs::statvfs(folder).ok()?;
    // Some network and user file systems give no sizes at all.
    (disk.blocks() > 0).then_some(())?;
    // POSIX counts blocks in fragments; their size is not the block size everywhere.
    #[allow(
        clippy::useless_conversion,
        clippy::unnecessary_cast,
        reason = "the types of the factors differ between systems"
    )]
    Some((disk.blocks_available() as u64).saturating_mul(disk.fragment_size() as u64))
}

/// Free bytes on the file system of a folder; `None` if the system does not report them.
#[must_use]
#[cfg(not(unix))]
pub fn free_bytes(_: &Path) -> Option<u64> {
    None
}
