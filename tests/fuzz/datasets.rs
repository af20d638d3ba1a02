//! Dataset folders: keyframes, cameras, matches.

use std::io::{Read as _, Write as _};

use flate2::{Compression, read::DeflateDecoder, write::DeflateEncoder};
use image::ImageFormat;
use io::inspect;

use super::{
    engine::{BYTES, Scratch, Target, plain, whole},
    mutate::Parts,
    recorded::picture_of,
};

/// Size of the images: they are read with every input.
const SMALL: (u32, u32) = (4, 3);
const CAMERA: &str = "14 0 7.5\n0 14 5.5\n0 0 1\n";
const MATCHES: &str = "correspondence_loftr/no_filter/src_0_0001_tgt_all_top30.npz";

/// A rigid camera-to-world matrix, row-major.
fn matrix(k: usize) -> String {
    let (s, c) = (0.05 * k as f64).sin_cos();
    format!("{c}, {}, 0, {}, {s}, {c}, 0, 0.5, 0, 0, 1, 1, 0, 0, 0, 1", -s, 0.1 * k as f64)
}

fn keyframes() -> String {
    let frame = |(id, time): (&str, usize)| {
        format!("frame_{id}:\n  cam_in_ob: [{}]\n  time: {time}\n", matrix(time + 1))
    };
    [("0_0001", 0), ("1_0002", 1)].map(frame).concat()
}

/// A keyframe dataset with a view of each state.
fn keyframe_folder(name: &str) -> Scratch {
    let scratch = Scratch::new(name);
    scratch.put("cam_K.txt", CAMERA);
    scratch.put("init_keyframes.yml", keyframes());
    for id in ["0_0001", "1_0002"] {
        scratch.put(&format!("color_segmented/{id}.png"), picture_of(SMALL, ImageFormat::Png, false));
        scratch.put(&format!("depth_filtered/{id}.png"), picture_of(SMALL, ImageFormat::Png, true));
    }
    scratch
}

fn opens(scratch: &Scratch) -> bool {
    inspect(&scratch.0).is_ok_and(|found| found.recordings.iter().any(|r| r.problem.is_none() && r.views > 0))
}

/// `init_keyframes.yml` and `cam_K.txt`.
#[test]
fn keyframe_list() {
    let name = "datasets::keyframe_list";
    let scratch = keyframe_folder(name);
    let flow =
        format!("{{frame_0_0001: {{cam_in_ob: [{}]}}, 1_0002: {{cam_in_ob: [{}]}}}}", matrix(0), matrix(3));
    let seeds = [keyframes(), flow].map(|yaml| vec![CAMERA.as_bytes().to_vec(), yaml.into_bytes()]).to_vec();
    fn assemble(parts: &[Vec<u8>]) -> Vec<u8> {
        let [camera, yaml @ ..] = parts else { return Vec::new() };
        [&[camera.len().min(255) as u8][..], &camera[..camera.len().min(255)], &yaml.concat()].concat()
    }
    let words = [
        "frame_",
        "0_",
        "1_",
        "../",
        "cam_in_ob",
        "time",
        "[",
        "{",
        "- ",
        "&a ",
        "*a",
        "!!float ",
        "<<: ",
        "\"",
        "|\n",
    ];
    let target = Target { name, seeds, words: &words, assemble, bytes: BYTES };
    target.run(|input| {
        let Some((length, rest)) = input.split_first() else { return false };
        let Some((camera, yaml)) = rest.split_at_checked(usize::from(*length)) else { return false };
        scratch.put("cam_K.txt", camera);
        scratch.put("init_keyframes.yml", yaml);
        opens(&scratch)
    });
}

/// `camera_train.json` of the start.
#[test]
fn cameras() {
    let name = "datasets::cameras";
    let scratch = Scratch::new(name);
    let rows = |k: usize| {
        let numbers: Vec<String> = matrix(k).split(", ").map(str::to_owned).collect();
        numbers.chunks(4).map(|row| format!("[{}]", row.join(","))).collect::<Vec<_>>().join(",")
    };
    let json = format!(
        "{{\"K\": [[14, 0, 8], [0, 14, 6], [0, 0, 1]], \"0000\": [{}], \"0001\": [{}]}}",
        rows(0),
        rows(2)
    );
    for state in ["start", "end"] {
        scratch.put(&format!("{state}/camera_train.json"), &json);
        for id in ["0000", "0001"] {
            scratch.put(&format!("{state}/train/{id}.png"), picture_of(SMALL, ImageFormat::Png, false));
            scratch.put(&format!("{state}/depth/{id}.png"), picture_of(SMALL, ImageFormat::Png, true));
        }
    }
    let words = ["\"K\"", "\"0000\"", "\"../0000\"", "[", "{", "null", "1e999", "-1", "\\u0000", "\\ud800"];
    let target = Target { name, seeds: whole([json.as_str()]), words: &words, assemble: plain, bytes: BYTES };
    target.run(|input| {
        scratch.put("start/camera_train.json", input);
        opens(&scratch)
    });
}

/// The members of a zip archive, each its method, the length of its name, name and content.
fn members(archive: &[u8]) -> Parts {
    let mut parts = Vec::new();
    let number = |at: usize| usize::from(archive[at]) | usize::from(archive[at + 1]) << 8;
    let end = archive.len() - 22;
    let mut at = number(end + 16);
    while at < end {
        let (method, packed, name, local) =
            (archive[at + 10], number(at + 20), number(at + 28), number(at + 42));
        let start = local + 30 + number(local + 26) + number(local + 28);
        let mut content = archive[start..start + packed].to_vec();
        if method == 8 {
            let mut unpacked = Vec::new();
            DeflateDecoder::new(content.as_slice()).read_to_end(&mut unpacked).unwrap();
            content = unpacked;
        }
        parts.push([&[method, name as u8][..], &archive[at + 46..at + 46 + name], &content].concat());
        at += 46 + name + number(at + 30) + number(at + 32);
    }
    parts
}

/// A zip archive of members, with the right sizes and checksums.
fn archive(parts: &[Vec<u8>]) -> Vec<u8> {
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for part in parts {
        let (method, rest) = part.split_first().unwrap_or((&0, &[]));
        let (length, rest) = rest.split_first().unwrap_or((&0, &[]));
        let (name, content) = rest.split_at(usize::from(*length).min(rest.len()));
        let method = u16::from(if method % 2 == 0 && *method < 8 { 0u8 } else { 8 });
        let packed = match method {
            0 => content.to_vec(),
            _ => {
                let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
                encoder.write_all(content).unwrap();
                encoder.finish().unwrap()
            }
        };
        let word = |n: usize| (n as u32).to_le_bytes();
        let sizes =
            [crc32fast::hash(content).to_le_bytes(), word(packed.len()), word(content.len())].concat();
        let common = [
            &[20, 0, 0, 0][..],
            &method.to_le_bytes(),
            &[0; 4],
            &sizes,
            &(name.len() as u16).to_le_bytes(),
            &[0, 0],
        ]
        .concat();
        let local = word(file.len());
        file.extend([b"PK\x03\x04", &common[..], name, &packed].concat());
        directory.extend([b"PK\x01\x02\x14\0", &common[..], &[0; 10], &local, name].concat());
    }
    let (count, at) = ((parts.len() as u16).to_le_bytes(), (file.len() as u32).to_le_bytes());
    let size = (directory.len() as u32).to_le_bytes();
    file.extend(directory);
    file.extend([b"PK\x05\x06\0\0\0\0", &count[..], &count, &size, &at, &[0, 0]].concat());
    file
}

const GOLDEN: [&[u8]; 2] =
    [include_bytes!("../golden/matches.npz"), include_bytes!("../golden/matches_deflated.npz")];
const WORDS: [&str; 14] = [
    "numpy.core.multiarray\n_reconstruct\n",
    "cnumpy\ndtype\n",
    "cos\nsystem\n",
    "'descr': '|O'",
    "'shape': (3,)",
    "PK\u{1}\u{2}",
    "PK\u{3}\u{4}",
    "(dNs",
    "]",
    "}",
    "h\u{1}",
    "R",
    "b",
    ".",
];

/// Whether the dataset is read with its matches.
fn matches_open(scratch: &Scratch, input: &[u8]) -> bool {
    scratch.put(MATCHES, input);
    let found = inspect(&scratch.0).unwrap();
    found
        .recordings
        .iter()
        .any(|r| r.views > 0 && !r.warnings.iter().any(|w| w.text.contains("matches not used")))
}

/// Archives of matches, damaged anywhere.
#[test]
fn npz_bytes() {
    let name = "datasets::npz_bytes";
    let scratch = keyframe_folder(name);
    let target = Target { name, seeds: whole(GOLDEN), words: &WORDS, assemble: plain, bytes: BYTES };
    target.run(|input| matches_open(&scratch, input));
}

/// Whole archives of matches: arrays and pickles damaged.
#[test]
fn npz_members() {
    let name = "datasets::npz_members";
    let scratch = keyframe_folder(name);
    let seeds = GOLDEN.map(members).to_vec();
    let target = Target { name, seeds, words: &WORDS, assemble: archive, bytes: BYTES };
    target.run(|input| matches_open(&scratch, input));
}
