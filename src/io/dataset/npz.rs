//! NumPy archives: a zip file of `.npy` arrays (stored or deflated).

use std::io::Read;

/// Largest member, bytes after decompression.
const MEMBER_LIMIT: u64 = 256 << 20;
const END: [u8; 4] = *b"PK\x05\x06";
const CENTRAL: [u8; 4] = *b"PK\x01\x02";
const LOCAL: [u8; 4] = *b"PK\x03\x04";

fn u16_at(data: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(u16::from_le_bytes(*data.get(at..)?.first_chunk()?)))
}

fn u32_at(data: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(*data.get(at..)?.first_chunk()?)).ok()
}

/// Members of a zip archive, name and content, in the order of its directory.
///
/// # Errors
/// A sentence on what is broken or not supported (encryption, other compression, members over 4 GiB).
pub fn members(archive: &[u8]) -> Result<Vec<(String, Vec<u8>)>, String> {
    let broken = || "the zip archive is broken".to_owned();
    let search = archive.len().saturating_sub(22 + 65_535);
    let end = archive[search..].windows(4).rposition(|w| w == END).map(|i| i + search).ok_or("it is no zip archive")?;
    let count = u16_at(archive, end + 10).ok_or_else(broken)?;
    let mut at = u32_at(archive, end + 16).ok_or_else(broken)?;
    let mut found = Vec::new();
    for _ in 0..count {
        if archive.get(at..at + 4) != Some(&CENTRAL) {
            return Err(broken());
        }
        let field16 = |offset| u16_at(archive, at + offset).ok_or_else(broken);
        let field32 = |offset| u32_at(archive, at + offset).ok_or_else(broken);
        let (flags, method) = (field16(8)?, field16(10)?);
        let (packed, size, local) = (field32(20)?, field32(24)?, field32(42)?);
        let (name_len, extra_len, comment_len) = (field16(28)?, field16(30)?, field16(32)?);
        let name = archive.get(at + 46..at + 46 + name_len).ok_or_else(broken)?;
        let name = String::from_utf8_lossy(name).into_owned();
        if flags & 1 != 0 || [packed, size, local].contains(&(u32::MAX as usize)) {
            return Err(format!("member `{}` is encrypted or too large", name.escape_debug()));
        }
        if archive.get(local..local + 4) != Some(&LOCAL) {
            return Err(broken());
        }
        let skip = u16_at(archive, local + 26).zip(u16_at(archive, local + 28)).map(|(n, e)| 30 + n + e).ok_or_else(broken)?;
        let data = archive.get(local + skip..local + skip + packed).ok_or_else(broken)?;
        found.push((name, unpack(data, method, size as u64)?));
        at += 46 + name_len + extra_len + comment_len;
    }
    Ok(found)
}

fn unpack(data: &[u8], method: usize, size: u64) -> Result<Vec<u8>, String> {
    if size > MEMBER_LIMIT {
        return Err(format!("a member of {size} bytes is larger than {MEMBER_LIMIT}"));
    }
    let mut content = Vec::new();
    match method {
        0 => content.extend_from_slice(data),
        8 => _ = flate2::read::DeflateDecoder::new(data).take(size + 1).read_to_end(&mut content).map_err(|e| e.to_string())?,
        other => return Err(format!("compression method {other} is not supported")),
    }
    if content.len() as u64 == size { Ok(content) } else { Err("a member has another size than the directory says".into()) }
}

/// Type and payload of a `.npy` file; its header is a Python dictionary in text.
///
/// # Errors
/// A sentence where it is no such file.
pub fn npy_payload(file: &[u8]) -> Result<(String, &[u8]), String> {
    let front = file.strip_prefix(b"\x93NUMPY").ok_or("it is no .npy array")?;
    let (length, at) = match front.first() {
        Some(1) => (u16_at(front, 2), 4),
        Some(2 | 3) => (u32_at(front, 2), 6),
        _ => return Err("its .npy version is not known".into()),
    };
    let length = length.ok_or("its header is cut")?;
    let header = front.get(at..at + length).ok_or("its header is cut")?;
    let text = String::from_utf8_lossy(header);
    let descr = text.split("'descr':").nth(1).and_then(|rest| rest.split('\'').nth(1)).ok_or("its header has no descr")?;
    Ok((descr.to_owned(), &front[at + length..]))
}
