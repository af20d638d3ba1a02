//! NumPy archives: a zip file of `.npy` arrays (stored or deflated).

use std::io::Read;

use common::limits::ARCHIVE;

const END: [u8; 4] = *b"PK\x05\x06";
const CENTRAL: [u8; 4] = *b"PK\x01\x02";
const LOCAL: [u8; 4] = *b"PK\x03\x04";

fn u16_at(data: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(u16::from_le_bytes(*data.get(at..)?.first_chunk()?)))
}

fn u32_at(data: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(*data.get(at..)?.first_chunk()?)).ok()
}

/// Why an archive cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// Another kind of file.
    #[error("it is no zip archive")]
    NoZip,
    /// Its directory is invalid.
    #[error("the zip archive is broken")]
    Broken,
    /// A member is encrypted or too large.
    #[error("member `{0}` is encrypted or too large")]
    Member(String),
    /// Two members overlap.
    #[error("members `{0}` and `{1}` share bytes")]
    Shared(String, String),
    /// The members unpack to more bytes than the limit.
    #[error("its members unpack to {0} bytes; {ARCHIVE} are the limit")]
    Large(u64),
    /// The compression is not deflate.
    #[error("compression method {0} is not supported")]
    Compression(usize),
    /// A member cannot be unpacked.
    #[error(transparent)]
    Unpack(#[from] std::io::Error),
    /// A member unpacks to another size than stated.
    #[error("a member has another size than the directory says")]
    Size,
}

/// A member of a zip archive, still packed.
#[derive(Clone, Copy, Debug)]
pub struct Member<'a> {
    data: &'a [u8],
    method: usize,
    size: u64,
}

/// Members of a zip archive, in the order of its directory.
///
/// # Errors
/// If the archive is broken or has unsupported parts: encryption, members over 4 GiB, members that share
/// bytes (a directory that names one of them twice), more than [`ARCHIVE`] bytes in all.
pub fn members(archive: &[u8]) -> Result<Vec<Member<'_>>, NpzError> {
    // The end record has 22 bytes and up to 65,535 of a comment behind it.
    let search = archive.len().saturating_sub(22 + 65_535);
    let end =
        archive[search..].windows(4).rposition(|w| w == END).map(|i| i + search).ok_or(NpzError::NoZip)?;
    let count = u16_at(archive, end + 10).ok_or(NpzError::Broken)?;
    let mut at = u32_at(archive, end + 16).ok_or(NpzError::Broken)?;
    let mut found = Vec::new();
    let mut places = Vec::new();
    for _ in 0..count {
        if archive.get(at..at + 4) != Some(&CENTRAL) {
            return Err(NpzError::Broken);
        }
        let field16 = |offset| u16_at(archive, at + offset).ok_or(NpzError::Broken);
        let field32 = |offset| u32_at(archive, at + offset).ok_or(NpzError::Broken);
        let flags = field16(8)?;
        let method = field16(10)?;
        // From the directory: a streamed member has zeros in its own header.
        let packed = field32(20)?;
        let size = field32(24)?;
        let local = field32(42)?;
        let name_len = field16(28)?;
        let extra_len = field16(30)?;
        let comment_len = field16(32)?;
        let name = archive.get(at + 46..at + 46 + name_len).ok_or(NpzError::Broken)?;
        let name = String::from_utf8_lossy(name).escape_debug().take(64).collect::<String>();
        // Bit 0: encrypted. All ones: ZIP64, where the size stands elsewhere.
        if flags & 1 != 0 || [packed, size, local].contains(&(u32::MAX as usize)) {
            return Err(NpzError::Member(name));
        }
        if archive.get(local..local + 4) != Some(&LOCAL) {
            return Err(NpzError::Broken);
        }
        // Lengths of the local header. Those of the directory may differ.
        let skip = u16_at(archive, local + 26)
            .zip(u16_at(archive, local + 28))
            .map(|(n, e)| 30 + n + e)
            .ok_or(NpzError::Broken)?;
        let data = archive.get(local + skip..local + skip + packed).ok_or(NpzError::Broken)?;
        places.push((local, local + skip + packed, name));
        found.push(Member { data, method, size: size as u64 });
        at += 46 + name_len + extra_len + comment_len;
    }
    places.sort();
    // Members with shared bytes would unpack a small archive many times over.
    if let Some(pair) = places.windows(2).find(|pair| pair[1].0 < pair[0].1) {
        return Err(NpzError::Shared(pair[0].2.clone(), pair[1].2.clone()));
    }
    let all: u64 = found.iter().map(|m| m.size).sum();
    if all > ARCHIVE { Err(NpzError::Large(all)) } else { Ok(found) }
}

impl Member<'_> {
    /// Its content.
    ///
    /// # Errors
    /// If the compression is broken or not supported, or the size differs from that in the directory.
    pub fn unpack(&self) -> Result<Vec<u8>, NpzError> {
        let mut content = Vec::new();
        match self.method {
            0 => content.extend_from_slice(self.data),
            8 => {
                let decoder = flate2::read::DeflateDecoder::new(self.data);
                // One byte beyond the stated size reveals more data.
                _ = decoder.take(self.size + 1).read_to_end(&mut content)?;
            }
            other => return Err(NpzError::Compression(other)),
        }
        if content.len() as u64 == self.size { Ok(content) } else { Err(NpzError::Size) }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    /// An archive with one member and a directory that names it so often, each time with this size.
    fn archive(content: &[u8], size: u32, times: u16) -> Vec<u8> {
        let mut packed = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
        packed.write_all(content).unwrap();
        let packed = packed.finish().unwrap();
        let lengths = [&(packed.len() as u32).to_le_bytes()[..], &size.to_le_bytes(), &[1, 0, 0, 0]].concat();
        let local =
            [&LOCAL[..], &[20, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0], &lengths, b"a", &packed].concat();
        let central =
            [&CENTRAL[..], &[20, 0, 20, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0], &lengths, &[0; 14], b"a"]
                .concat();
        let end = [
            &END[..],
            &[0; 4],
            &times.to_le_bytes(),
            &times.to_le_bytes(),
            &[0; 4],
            &(local.len() as u32).to_le_bytes(),
            &[0; 2],
        ];
        [local, central.repeat(usize::from(times)), end.concat()].concat()
    }

    #[test]
    fn a_member_counts_once_and_within_the_budget() {
        let one = archive(b"content", 7, 1);
        assert_eq!(members(&one).unwrap()[0].unpack().unwrap(), b"content");
        assert!(matches!(members(&archive(b"content", 7, 60)), Err(NpzError::Shared(a, b)) if a == b));
        let large = archive(b"content", 300 << 20, 1);
        let why = members(&large).unwrap_err().to_string();
        assert!(why.contains("unpack to 314572800 bytes; 268435456 are the limit"), "{why}");
        let lying = archive(&[0; 1 << 20], 7, 1);
        assert!(matches!(members(&lying).unwrap()[0].unpack(), Err(NpzError::Size)));
    }
}
