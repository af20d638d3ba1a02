//! Size of a picture from the beginning of its file, before anything is decoded.

/// Width and height stated in a PNG or JPEG file; `None` without them.
#[must_use]
pub fn stated_size(file: &[u8]) -> Option<(usize, usize)> {
    match file {
        [0xff, 0xd8, ..] => jpeg_size(file),
        // IHDR has to be the first chunk, so the size always stands here.
        [0x89, b'P', b'N', b'G', ..] => Some((big(file.get(16..20)?), big(file.get(20..24)?))),
        _ => None,
    }
}

fn big(bytes: &[u8]) -> usize {
    bytes.iter().fold(0, |n, b| n << 8 | usize::from(*b))
}

/// Size from the first frame header.
fn jpeg_size(file: &[u8]) -> Option<(usize, usize)> {
    let mut at = 2;
    loop {
        let marker = *file.get(at + 1)?;
        if file[at] != 0xff {
            return None;
        }
        match marker {
            // Filling, and markers without a length.
            0xff => at += 1,
            0x01 | 0xd0..=0xd8 => at += 2,
            // Tables of codes and arithmetic conditions share the range of the frames.
            0xc0..=0xcf if ![0xc4, 0xc8, 0xcc].contains(&marker) => {
                return Some((big(file.get(at + 7..at + 9)?), big(file.get(at + 5..at + 7)?)));
            }
            // The end, or pixels before any frame.
            0xd9 | 0xda => return None,
            // A length counts its own two bytes; a smaller one is damage and must not stop the advance.
            _ => at += 2 + big(file.get(at + 2..at + 4)?).max(2),
        }
    }
}

/// A PNG file with only the chunks needed for its pixels: the others (profiles, texts)
/// are compressed, and a decoder unpacks them.
#[must_use]
pub fn bare_png(file: &[u8]) -> Vec<u8> {
    let mut bare = file[..file.len().min(8)].to_vec();
    let mut at = 8;
    while let Some(length) = file.get(at..at + 4).map(big) {
        let end = at.saturating_add(12).saturating_add(length).min(file.len());
        if [&b"IHDR"[..], b"PLTE", b"tRNS", b"IDAT", b"IEND"]
            .contains(&file.get(at + 4..at + 8).unwrap_or_default())
        {
            bare.extend_from_slice(&file[at..end]);
        }
        at = end;
    }
    bare
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write as _};

    use image::{DynamicImage, ImageFormat};

    use super::*;

    fn file(format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        DynamicImage::new_rgb8(321, 45).write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn sizes_are_stated_before_pixels() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg] {
            let file = file(format);
            assert_eq!(stated_size(&file), Some((321, 45)), "{format:?}");
            (0..file.len().min(200)).for_each(|cut| _ = stated_size(&file[..cut]));
        }
        let progressive =
            [&[0xff, 0xd8, 0xff, 0xff, 0xe0, 0, 4, 1, 2, 0xff, 0xc2, 0, 9, 8][..], &[0, 45, 1, 65]].concat();
        assert_eq!(stated_size(&progressive), Some((321, 45)));
        assert_eq!(stated_size(b"GIF89a"), None);
        assert_eq!(stated_size(&[0xff, 0xd8, 0xff, 0xe0, 0, 0]), None);
    }

    #[test]
    fn what_stands_beside_the_pixels_is_left_out() {
        let plain = file(ImageFormat::Png);
        let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        packed.write_all(&vec![0; 8 << 20]).unwrap();
        let packed = packed.finish().unwrap();
        let mut bomb = plain[..33].to_vec();
        for kind in [b"iCCP", b"zTXt", b"iTXt"] {
            let body = [&kind[..], b"a\0\0", &packed].concat();
            bomb.extend((body.len() as u32 - 4).to_be_bytes());
            bomb.extend(&body);
            bomb.extend(crc32fast::hash(&body).to_be_bytes());
        }
        bomb.extend(&plain[33..]);
        assert_eq!(bare_png(&bomb), plain);
        for cut in 0..plain.len() {
            assert!(bare_png(&plain[..cut]).len() <= cut);
        }
        assert_eq!(bare_png(&[&plain[..8], &[0xff; 20]].concat()).len(), 8);
    }
}
