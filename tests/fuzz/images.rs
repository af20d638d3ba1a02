//! Image files and compressed depth.

use std::io::Write as _;

use flate2::{Compression, read::ZlibDecoder, write::ZlibEncoder};
use image::ImageFormat;
use io::{
    image_codec as codec,
    image_codec::{MAX_SIDE, Raster},
    ros2msg::CompressedImage,
    rvl,
};

use super::{
    engine::{BYTES, Target, plain, whole},
    mutate::Parts,
    recorded::{SIZE, WORDS, compressed, compressed_depth, millimeters, picture},
};

/// A file of a few bytes may hold an image of [`MAX_SIDE`] pixels a side: 8 bytes a pixel as it is decoded,
/// and as much again where it is brought to another form.
const LARGEST_IMAGE: usize = 2 * 8 * MAX_SIDE * MAX_SIDE;

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";

fn check<T>(raster: &Raster<T>) {
    assert!((1..=MAX_SIDE).contains(&raster.width) && (1..=MAX_SIDE).contains(&raster.height));
    assert_eq!(raster.pixels.len(), raster.width * raster.height);
}

fn check_depth(depth: &Raster<f32>) {
    check(depth);
    assert!(depth.pixels.iter().all(|d| d.is_finite() && *d >= 0.0));
}

/// Everything that is read of a PNG or JPEG file.
fn decoded(input: &[u8]) -> bool {
    let color = codec::color_file(input).ok();
    color.iter().for_each(check);
    let depth = codec::depth_file(input, 0.001).ok();
    depth.iter().for_each(check_depth);
    let mask = codec::mask_file(input).ok();
    mask.iter().for_each(check);
    if let Ok((color, Some(mask))) = codec::color_with_alpha_file(input) {
        check(&color);
        assert_eq!(mask.len(), color.pixels.len());
    }
    color.is_some() || depth.is_some() || mask.is_some()
}

/// The chunks of a PNG, each its name and content; the pixels unpacked.
fn chunks(file: &[u8]) -> Parts {
    let mut parts = Vec::new();
    let mut rest = &file[PNG.len()..];
    while let [a, b, c, d, tail @ ..] = rest {
        let length = u32::from_be_bytes([*a, *b, *c, *d]) as usize;
        let mut part = tail[..4 + length].to_vec();
        if part.starts_with(b"IDAT") {
            let mut pixels = Vec::new();
            std::io::Read::read_to_end(&mut ZlibDecoder::new(&part[4..]), &mut pixels).unwrap();
            part = [&b"IDAT"[..], &pixels].concat();
        }
        parts.push(part);
        rest = &tail[8 + length..];
    }
    parts
}

/// A PNG of chunks, the pixels packed, with the right lengths and checksums.
fn png_file(parts: &[Vec<u8>]) -> Vec<u8> {
    let mut file = PNG.to_vec();
    for part in parts {
        let packed = match part.strip_prefix(b"IDAT") {
            Some(pixels) => {
                let mut encoder = ZlibEncoder::new(b"IDAT".to_vec(), Compression::fast());
                encoder.write_all(pixels).unwrap();
                encoder.finish().unwrap()
            }
            None => part.clone(),
        };
        file.extend((packed.len().saturating_sub(4) as u32).to_be_bytes());
        file.extend(&packed);
        file.extend(crc32fast::hash(&packed).to_be_bytes());
    }
    file
}

fn pngs() -> Vec<Vec<u8>> {
    let (width, height) = SIZE;
    let save = |picture: image::DynamicImage| {
        let mut file = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut file, ImageFormat::Png).unwrap();
        file.into_inner()
    };
    let count = (width * height) as usize;
    let rgba =
        image::RgbaImage::from_raw(width, height, (0..4 * count).map(|k| (k * 5) as u8).collect()).unwrap();
    let gray =
        image::GrayImage::from_raw(width, height, (0..count).map(|k| (k % 3) as u8).collect()).unwrap();
    vec![
        picture(ImageFormat::Png, false),
        picture(ImageFormat::Png, true),
        save(rgba.into()),
        save(gray.into()),
    ]
}

const CHUNKS: [&str; 14] = [
    "IHDR", "IDAT", "IEND", "PLTE", "tRNS", "gAMA", "iCCP", "sRGB", "tEXt", "zTXt", "iTXt", "acTL", "fcTL",
    "fdAT",
];

/// PNG files, damaged anywhere.
#[test]
fn png_bytes() {
    let target = Target {
        name: "images::png_bytes",
        seeds: whole(pngs()),
        words: &CHUNKS,
        assemble: plain,
        bytes: LARGEST_IMAGE,
    };
    target.run(decoded);
}

/// PNG files of whole chunks, with what they hold damaged.
#[test]
fn png_chunks() {
    let mut seeds: Vec<Parts> = pngs().iter().map(|file| chunks(file)).collect();
    for extra in [
        &b"gAMA\0\0\xb1\x8f"[..],
        b"tRNS\0\x01\0\x02\0\x03",
        b"tEXtComment\0hello",
        b"acTL\0\0\0\x02\0\0\0\0",
    ] {
        let mut parts = seeds[0].clone();
        parts.insert(1, extra.to_vec());
        seeds.push(parts);
    }
    let target = Target {
        name: "images::png_chunks",
        seeds,
        words: &CHUNKS,
        assemble: png_file,
        bytes: LARGEST_IMAGE,
    };
    target.run(decoded);
}

/// JPEG files.
#[test]
fn jpeg() {
    let gray = image::GrayImage::from_raw(16, 8, vec![100; 128]).unwrap();
    let mut small = std::io::Cursor::new(Vec::new());
    gray.write_to(&mut small, ImageFormat::Jpeg).unwrap();
    let seeds = whole([picture(ImageFormat::Jpeg, false), small.into_inner()]);
    let words = ["\u{0}\u{11}", "JFIF", "Exif\0\0", "ICC_PROFILE\0"];
    let target = Target { name: "images::jpeg", seeds, words: &words, assemble: plain, bytes: LARGEST_IMAGE };
    target.run(decoded);
}

/// `compressedDepth`: its header, and PNG or RVL behind it.
#[test]
fn depth() {
    let formats = [
        "16UC1; compressedDepth rvl",
        "16UC1; compressedDepth png",
        "32FC1; compressedDepth rvl",
        "32FC1; compressedDepth",
        "png",
    ];
    let seed = |format: &str| match format {
        "png" => picture(ImageFormat::Png, true),
        other => compressed_depth(other.ends_with("rvl")),
    };
    let seeds = formats.map(|format| vec![format.as_bytes().to_vec(), seed(format)]).to_vec();
    fn assemble(parts: &[Vec<u8>]) -> Vec<u8> {
        let [format, data @ ..] = parts else { return Vec::new() };
        [&[format.len().min(255) as u8][..], &format[..format.len().min(255)], &data.concat()].concat()
    }
    let target = Target { name: "images::depth", seeds, words: &WORDS, assemble, bytes: LARGEST_IMAGE };
    target.run(|input| {
        let Some((length, rest)) = input.split_first() else { return false };
        let Some((format, data)) = rest.split_at_checked(usize::from(*length)) else { return false };
        let message: CompressedImage = compressed(0, &String::from_utf8_lossy(format), data.to_vec());
        let depth = codec::compressed_depth(&message).ok();
        depth.iter().for_each(check_depth);
        depth.is_some()
    });
}

/// RVL: what is decoded has the right size and is the same after it was encoded again.
#[test]
fn rvl_code() {
    let (width, height) = SIZE;
    let pixels: Vec<u16> = (0..(width * height) as usize).map(millimeters).collect();
    let holes: Vec<u16> = pixels.iter().enumerate().map(|(k, p)| if k % 3 == 0 { 0 } else { *p }).collect();
    let wild: Vec<u16> = (0..pixels.len()).map(|k| (k * 40_503) as u16).collect();
    let count = (pixels.len() as u16).to_le_bytes().to_vec();
    let seeds = [pixels, holes, wild].map(|pixels| vec![count.clone(), rvl::encode(&pixels)]).to_vec();
    let target = Target { name: "images::rvl_code", seeds, words: &[], assemble: plain, bytes: BYTES };
    target.run(|input| {
        let Some((count, code)) = input.split_first_chunk::<2>() else { return false };
        let count = usize::from(u16::from_le_bytes(*count));
        let Ok(pixels) = rvl::decode(code, count) else { return false };
        assert_eq!(pixels.len(), count);
        assert_eq!(rvl::decode(&rvl::encode(&pixels), count), Ok(pixels));
        true
    });
}
