//! Small inputs of large cost, given to the program: each ends in time, within a bound of memory, with a
//! sentence. The program runs under a limit of its address space, so that an allocation beyond it ends the
//! process and the test.

#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]

mod common;
#[path = "common/program.rs"]
mod program;

use std::{
    io::{Read as _, Write as _},
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use common::{BagWriter, write_keyframes, write_metadata};
use io::ros2msg::{CameraInfo, CompressedImage, TfMessage, decode, encode};
use program::{Message, messages, rewrite, shipped};
use tempfile::TempDir;

/// Address space of the program, MiB.
const MEMORY: u64 = 1500;
/// Longest run.
const PATIENCE: Duration = Duration::from_secs(30);
/// Length of the bracket and element bombs.
const DEEP: usize = 100_000;

/// Runs the program; it must end by itself, in time and with this code, and say all words.
fn ends(code: i32, arguments: &[&str], words: &[&str]) -> String {
    let limited = format!("ulimit -v {} && exec \"$@\"", MEMORY << 10);
    let mut command = Command::new("sh");
    command.args(["-c", &limited, "sh", env!("CARGO_BIN_EXE_artitwin")]).args(arguments);
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut pipes: Vec<Box<dyn std::io::Read + Send>> =
        vec![Box::new(child.stdout.take().unwrap()), Box::new(child.stderr.take().unwrap())];
    let readers: Vec<_> = pipes
        .drain(..)
        .map(|mut pipe| {
            thread::spawn(move || {
                let mut text = Vec::new();
                pipe.read_to_end(&mut text).unwrap();
                text
            })
        })
        .collect();
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break Some(status);
        }
        if begun.elapsed() > PATIENCE {
            child.kill().unwrap();
            child.wait().unwrap();
            break None;
        }
        thread::sleep(Duration::from_millis(5));
    };
    let text: String =
        readers.into_iter().map(|r| String::from_utf8_lossy(&r.join().unwrap()).into_owned()).collect();
    let Some(status) = status else { panic!("{arguments:?} did not end in {PATIENCE:?}:\n{text}") };
    assert_eq!(status.code(), Some(code), "{status}:\n{}", &text[..text.len().min(4000)]);
    words.iter().for_each(|word| {
        assert!(text.contains(word), "`{word}` is not in:\n{}", &text[..text.len().min(4000)])
    });
    text
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// `reconstruct` on a source that is refused before the first stage ends.
fn refuses(folder: &TempDir, source: &Path, words: &[&str]) {
    ends(
        1,
        &["reconstruct", text(source), "--out", text(&folder.path().join("runs")), "--preset", "preview"],
        words,
    );
}

/// A state of the drawer with its messages changed.
fn state(folder: &TempDir, name: &str, change: impl FnMut(&mut Message) -> bool) -> PathBuf {
    let bag = folder.path().join(name);
    rewrite(&shipped("drawer/state0"), &bag, change);
    bag
}

/// A zip archive with one deflated member that its directory names so often.
fn archive(content: &[u8], times: u16) -> Vec<u8> {
    let mut packed = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(content).unwrap();
    let packed = packed.finish().unwrap();
    let lengths =
        [&(packed.len() as u32).to_le_bytes()[..], &(content.len() as u32).to_le_bytes(), &[1, 0, 0, 0]]
            .concat();
    let local =
        [&b"PK\x03\x04"[..], &[20, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0], &lengths, b"a", &packed].concat();
    let central =
        [&b"PK\x01\x02"[..], &[20, 0, 20, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0], &lengths, &[0; 14], b"a"]
            .concat();
    let end = [
        &b"PK\x05\x06"[..],
        &[0; 4],
        &times.to_le_bytes(),
        &times.to_le_bytes(),
        &[0; 4],
        &(local.len() as u32).to_le_bytes(),
        &[0; 2],
    ];
    [local, central.repeat(usize::from(times)), end.concat()].concat()
}

/// A pickled NumPy array of objects in its file.
fn npy(pickle: &[u8]) -> Vec<u8> {
    let header = "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }";
    [&b"\x93NUMPY\x01\0"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes(), pickle].concat()
}

#[test]
fn archives_of_matches() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    write_keyframes(&data);
    let matches = data.join("correspondence_loftr/no_filter");
    std::fs::create_dir_all(&matches).unwrap();
    // Every member is within the limit, all together are not.
    let zeros = npy(&vec![b'N'; 60 << 20]);
    std::fs::write(matches.join("src_0_a.npz"), archive(&zeros, 60)).unwrap();
    std::fs::write(matches.join("src_0_b.npz"), archive(&zeros, 1)).unwrap();
    // A type of 20 MB, remembered and used for 400 arrays.
    let long = vec![b'f'; 20 << 20];
    let dtype =
        [&b"\x80\x03cnumpy\ndtype\nX"[..], &(long.len() as u32).to_le_bytes(), &long, b"\x85R"].concat();
    let dtype = [&dtype[..], b"(K\x03X\x01\0\0\0<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tbq\x01]"].concat();
    let array = b"(cnumpy.core.multiarray\n_reconstruct\n)R(K\x01K\x01\x85h\x01\x89C\0tbe";
    std::fs::write(
        matches.join("src_0_c.npz"),
        archive(&npy(&[&dtype[..], &array.repeat(400), b"."].concat()), 1),
    )
    .unwrap();
    let words = [
        "members `a` and `a` share bytes",
        "mentions more than 2000000 values",
        "a name of 20971520 characters",
    ];
    let told = ends(0, &["inspect", text(&data)], &words);
    assert_eq!(told.matches("matches not used").count(), 3, "{told}");
}

fn chunk(kind: &[u8; 4], body: &[u8]) -> Vec<u8> {
    let body = [&kind[..], body].concat();
    [&(body.len() as u32 - 4).to_be_bytes()[..], &body, &crc32fast::hash(&body).to_be_bytes()].concat()
}

fn deflated(bytes: usize) -> Vec<u8> {
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    (0..bytes >> 20).for_each(|_| packed.write_all(&[0; 1 << 20]).unwrap());
    packed.write_all(&vec![0; bytes & 0xf_ffff]).unwrap();
    packed.finish().unwrap()
}

/// A black PNG of 8 bits a pixel with chunks before its pixels.
fn png(side: u32, colors: u8, before: &[u8]) -> Vec<u8> {
    let size = side as usize * (1 + side as usize * if colors == 2 { 3 } else { 1 });
    let header = [&side.to_be_bytes()[..], &side.to_be_bytes(), &[8, colors, 0, 0, 0]].concat();
    [
        b"\x89PNG\r\n\x1a\n".to_vec(),
        chunk(b"IHDR", &header),
        before.to_vec(),
        chunk(b"IDAT", &deflated(size)),
        chunk(b"IEND", b""),
    ]
    .concat()
}

/// The image of a message replaced.
fn with_image(message: &mut Message, format: &str, file: &[u8]) {
    let mut image: CompressedImage = decode(&message.data).unwrap();
    (image.format, image.data) = (format.into(), file.to_vec());
    message.data = encode(&image).unwrap();
}

#[test]
fn images_of_many_pixels() {
    let folder = tempfile::tempdir().unwrap();
    const SIDE: u32 = 8192;
    let gray = png(SIDE, 0, &[]);
    // RVL: all zeros, told by one number.
    let number = [0x89, 0x88, 0x88, 0x88, 0x10, 0, 0, 0];
    let rvl = [&[0; 12][..], &SIDE.to_le_bytes(), &SIDE.to_le_bytes(), &number].concat();
    let bag = folder.path().join("large");
    for state in 0..2 {
        rewrite(&shipped(&format!("drawer/state{state}")), &bag.join(format!("state{state}")), |m| {
            match m.type_name.as_str() {
                "sensor_msgs/msg/CameraInfo" => {
                    let mut info: CameraInfo = decode(&m.data).unwrap();
                    (info.width, info.height) = (SIDE, SIDE);
                    m.data = encode(&info).unwrap();
                }
                "sensor_msgs/msg/CompressedImage" if m.is("compressedDepth") => {
                    with_image(m, "16UC1; compressedDepth rvl", &rvl)
                }
                "sensor_msgs/msg/CompressedImage" => with_image(m, "rgb8; png", &gray),
                _ => {}
            }
            !m.is("/object_mask")
        });
    }
    let words = [
        "32 frames of 8192x8192 pixels take 24.0 GiB",
        "capture.memory_gib = 8",
        "--set capture.frames_per_state=5",
    ];
    refuses(&folder, &bag, &words);
    // Where the camera is small, a large image is not even decoded.
    let small = folder.path().join("small");
    for state in 0..2 {
        rewrite(&shipped(&format!("drawer/state{state}")), &small.join(format!("state{state}")), |m| {
            if m.is("color/image_raw/compressed") {
                with_image(m, "rgb8; png", &gray);
            }
            true
        });
    }
    refuses(
        &folder,
        &small,
        &["all 16 are broken", "an image of 8192x8192 pixels, but its camera has 320x240"],
    );
}

#[test]
fn chunks_of_a_png_that_unpack_to_much() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    write_keyframes(&data);
    let packed = [&b"a\0\0"[..], &deflated(1 << 30)].concat();
    let before = [chunk(b"iCCP", &packed), chunk(b"zTXt", &packed)].concat();
    let path = data.join("color_segmented/0_0000.png");
    let plain = std::fs::read(&path).unwrap();
    std::fs::write(&path, [&plain[..33], &before, &plain[33..]].concat()).unwrap();
    ends(0, &["inspect", text(&data)], &["usable: yes"]);
    std::fs::write(&path, png(8192, 2, &[])).unwrap();
    ends(1, &["inspect", text(&data)], &["20 frames of 8192x8192 pixels take 15.0 GiB"]);
    std::fs::write(&path, plain).unwrap();
    std::fs::write(data.join("depth_filtered/0_0001.png"), png(8192, 0, &[])).unwrap();
    ends(1, &["inspect", text(&data)], &["it has 8192x8192 pixels, more than 16 times the 120x90"]);
}

/// A recording with records before its first, as bytes.
fn with_records(folder: &TempDir, name: &str, records: &[u8]) -> PathBuf {
    let bag = state(folder, name, |_| true);
    let file = bag.join(format!("{name}.mcap"));
    let whole = std::fs::read(&file).unwrap();
    let first = 17 + u64::from_le_bytes(*whole[9..].first_chunk().unwrap()) as usize;
    std::fs::write(&file, [&whole[..first], records, &whole[first..]].concat()).unwrap();
    bag
}

fn record(opcode: u8, body: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

#[test]
fn lengths_and_chunks_of_a_bag() {
    let folder = tempfile::tempdir().unwrap();
    let schema = [&[9, 0][..], &4u32.to_le_bytes(), b"name", &[0; 4], &u32::MAX.to_le_bytes()].concat();
    let bag = with_records(&folder, "schema", &record(3, &schema));
    ends(1, &["inspect", text(&bag)], &["a record names a field of 4294967295 bytes"]);
    let bomb = |size: usize| {
        let zeros = zstd::bulk::compress(&record(0x80, &vec![0; size - 9]), 1).unwrap();
        let front =
            [&[0; 16][..], &(size as u64).to_le_bytes(), &[0; 4], &4u32.to_le_bytes(), b"zstd"].concat();
        record(6, &[&front[..], &(zeros.len() as u64).to_le_bytes(), &zeros].concat())
    };
    // 49 GiB in chunks of 256 MiB; the same again in small ones, of which each may be.
    let bag = with_records(&folder, "large", &bomb((256 << 20) - 64).repeat(200));
    ends(1, &["inspect", text(&bag)], &["200 of ", "chunks left out as damaged", "posed RGB-D views: 16"]);
    let bag = with_records(&folder, "many", &bomb(16 << 20).repeat(2000));
    ends(1, &["inspect", text(&bag)], &["chunks left out as damaged", "256 times its size"]);
    let bag = state(&folder, "twice", |_| true);
    write_metadata(&bag, &["twice.mcap", "./twice.mcap"], "");
    ends(1, &["inspect", text(&bag)], &["names `./twice.mcap` twice"]);
}

#[test]
fn brackets_in_yaml() {
    let folder = tempfile::tempdir().unwrap();
    let nested =
        ["[".repeat(DEEP) + &"]".repeat(DEEP), "{a: ".repeat(DEEP), "- ".repeat(DEEP), "? ".repeat(DEEP)];
    let config = folder.path().join("config.yaml");
    for text_of in &nested {
        std::fs::write(&config, format!("surface: {text_of}\n")).unwrap();
        ends(2, &["config", "show", "--config", text(&config)], &["error"]);
    }
    std::fs::write(&config, format!("surface: {}", nested[0])).unwrap();
    ends(2, &["config", "show", "--config", text(&config)], &["nested deeper than 128"]);
    ends(
        2,
        &["config", "show", "--set", &format!("surface.nodes={}", "[".repeat(50_000))],
        &["nested deeper than 128"],
    );
    let bag = state(&folder, "bag", |_| true);
    std::fs::write(bag.join("metadata.yaml"), format!("x: {}\n", nested[0])).unwrap();
    ends(1, &["inspect", text(&bag)], &["nested deeper than 128", "posed RGB-D views: 16"]);
    let data = folder.path().join("data");
    write_keyframes(&data);
    std::fs::write(data.join("init_keyframes.yml"), format!("x: {}\n", nested[0])).unwrap();
    ends(1, &["inspect", text(&data)], &["nested deeper than 128"]);
}

/// A folder with a URDF of this text.
fn model(folder: &TempDir, name: &str, urdf: &str) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::create_dir_all(&path).unwrap();
    std::fs::write(path.join("t.urdf"), urdf).unwrap();
    path
}

const INERTIAL: &str =
    "<inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";

/// `check` of the folder, and `diagnose` of the URDF.
fn examined(folder: &Path, code: i32, checked: &[&str], diagnosed: &[&str]) {
    ends(code, &["check", text(folder)], checked);
    let out = folder.with_extension("out");
    ends(
        1,
        &["diagnose", text(&folder.join("t.urdf")), text(&shipped("drawer/state0")), "--out", text(&out)],
        diagnosed,
    );
}

/// `diagnose` of the URDF by frames, which reads its meshes.
fn seen(folder: &TempDir, twin: &Path, words: &[&str]) {
    let (urdf, bag, out) = (twin.join("t.urdf"), shipped("drawer/state0"), folder.path().join("out"));
    ends(1, &["diagnose", text(&urdf), "--frames", text(&bag), "--out", text(&out)], words);
}

#[test]
fn nested_xml_elements() {
    let folder = tempfile::tempdir().unwrap();
    for depth in [20_000, DEEP] {
        let inner = "<x>".repeat(depth) + &"</x>".repeat(depth);
        let twin = model(&folder, "deep", &format!("<robot name='r'><link name='a'/>{inner}</robot>"));
        examined(&twin, 1, &["nested deeper than 128"], &["nested deeper than 128"]);
        let within =
            model(&folder, "deep_link", &format!("<robot name='r'><link name='a'>{inner}</link></robot>"));
        seen(&folder, &within, &["nested deeper"]);
    }
    let entities: String =
        (1..10).map(|i| format!("<!ENTITY a{i} \"{}\">", format!("&a{};", i - 1).repeat(10))).collect();
    let laughs = format!("<!DOCTYPE r [<!ENTITY a0 \"aaaaaaaaaa\">{entities}]><robot name='&a9;'/>");
    examined(&model(&folder, "laughs", &laughs), 1, &["declares entities"], &["declares entities"]);
}

#[test]
fn long_chains_of_links() {
    let folder = tempfile::tempdir().unwrap();
    let link = |i: usize, solid: bool| {
        let solid = if solid {
            "<collision name='c'><geometry><box size='0.01 0.01 0.01'/></geometry></collision>"
        } else {
            ""
        };
        format!("<link name='l{i}'>{INERTIAL}{solid}</link>")
    };
    let joint = |i: usize, kind: &str| {
        format!(
            "<joint name='j{i}' type='{kind}'><origin xyz='0.02 0 0'/><parent link='l{i}'/>\
             <child link='l{}'/><axis xyz='0 0 1'/>\
             <limit lower='-1' upper='1' effort='1' velocity='1'/></joint>",
            i + 1
        )
    };
    let chain = |count: usize, solid: bool, kind: &str| {
        let links: String = (0..count).map(|i| link(i, solid)).collect();
        let joints: String = (0..count - 1).rev().map(|i| joint(i, kind)).collect();
        format!("<robot name='r'>{links}{joints}</robot>")
    };
    let twin = model(&folder, "solid", &chain(4_000, true, "revolute"));
    ends(0, &["check", text(&twin)], &["only a part of them was looked at"]);
    examined(&model(&folder, "fixed", &chain(4_000, false, "fixed")), 0, &["0 errors"], &["error: "]);
    let bare = |i: usize| format!("<link name='l{i}'/>");
    let links: String = (0..40_000).map(bare).collect();
    let joints: String = (0..39_999).rev().map(|i| joint(i, "fixed")).collect();
    let twin = model(&folder, "longest", &format!("<robot name='r'>{links}{joints}</robot>"));
    examined(&twin, 1, &["40000 links or joints; 10000 are the limit"], &["40000 links or joints"]);
}

#[test]
fn many_messages() {
    let folder = tempfile::tempdir().unwrap();
    // Camera parameters that are not equal to themselves.
    let (mut info, mut tf) = (None, None);
    let flood = |name: &str, count: usize, add: &dyn Fn(&mut BagWriter, usize, i64)| {
        let bag = folder.path().join(name);
        std::fs::create_dir_all(&bag).unwrap();
        let mut writer = BagWriter::create(&bag.join("0.mcap"), Some(mcap::Compression::Zstd), 768_000);
        let mut last = 0;
        for m in messages(&shipped("drawer/state0")) {
            writer.bytes(&m.topic, &m.type_name, "cdr", m.log_nanos, &m.data);
            last = m.log_nanos;
        }
        (0..count).for_each(|i| add(&mut writer, i, last));
        writer.finish();
        write_metadata(&bag, &["0.mcap"], "");
        bag
    };
    for m in messages(&shipped("drawer/state0")) {
        if m.is("color/camera_info") {
            info.get_or_insert(m);
        } else if m.is("/tf") {
            tf.get_or_insert(m);
        }
    }
    let (info, tf) = (info.unwrap(), tf.unwrap());
    for nan in [true, false] {
        let change = |writer: &mut BagWriter, i: usize, last: i64| {
            let mut m: CameraInfo = decode(&info.data).unwrap();
            m.k[if nan { 0 } else { 2 }] =
                if nan { f64::from_bits(f64::NAN.to_bits() + i as u64) } else { m.k[2] + 1e-6 * i as f64 };
            writer.message(&info.topic, &info.type_name, last, &m);
        };
        let bag = flood("infos", 100_000, &change);
        ends(1, &["inspect", text(&bag)], &[if nan { "focal lengths NaN" } else { "posed RGB-D views: 16" }]);
    }
    let string = |i: usize| format!("/t{i}");
    let bag = flood("topics", 20_000, &|w, i, last| {
        w.bytes(&string(i), "std_msgs/msg/String", "cdr", last, b"\0\x01\0\0\x02\0\0\0a\0\0\0")
    });
    ends(1, &["inspect", text(&bag)], &["a bag with so many messages is not supported", "ros2 bag convert"]);
    let bag = flood("tiny", 1_000_000, &|w, _, last| {
        w.bytes("/m", "std_msgs/msg/String", "cdr", last, b"\0\x01\0\0\x02\0\0\0a\0\0\0")
    });
    ends(1, &["inspect", text(&bag)], &["1000000", "posed RGB-D views: 16"]);
    let frames = |w: &mut BagWriter, i: usize, last: i64| {
        let mut m: TfMessage = decode(&tf.data).unwrap();
        m.transforms.iter_mut().for_each(|t| t.child_frame_id = format!("c{i}"));
        w.message("/tf", &tf.type_name, last, &m);
    };
    let told = ends(
        1,
        &["inspect", text(&flood("frames", 200_000, &frames))],
        &["more frames than are taken (10000)", "views: 16", "and 98"],
    );
    assert!(told.lines().count() < 1000, "{}", told.lines().count());
}

#[test]
fn names_do_not_steer_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let evil = "\u{1b}[2J\u{9b}2J\u{7}";
    let bag = state(&folder, "topic", |m| {
        if m.is("/object_mask") {
            (m.topic, m.type_name) = (format!("/x{evil}"), format!("sensor_msgs/msg/{evil}"));
        }
        true
    });
    let frame = state(&folder, "frame", |m| {
        if m.is("/tf") || m.is("/tf_static") {
            let mut tf: TfMessage = decode(&m.data).unwrap();
            tf.transforms.iter_mut().for_each(|t| t.child_frame_id.push_str(evil));
            m.data = encode(&tf).unwrap();
        }
        true
    });
    let twin = model(
        &folder,
        "names",
        &format!("<robot name='r'><link name='a'/><link name='{}'/></robot>", "&#x9b;2J&#10;x"),
    );
    let tell = |code, arguments: &[&str]| {
        let told = ends(code, arguments, &[]);
        assert!(!told.chars().any(|c| c.is_control() && c != '\n'), "{told:?}");
    };
    tell(1, &["inspect", text(&bag)]);
    tell(1, &["inspect", text(&frame)]);
    tell(1, &["reconstruct", text(&frame), text(&bag), "--out", text(&folder.path().join("runs"))]);
    tell(1, &["check", text(&twin)]);
    tell(1, &["inspect", &format!("/nowhere{evil}")]);
}

#[test]
fn devices_and_pipes_in_place_of_files() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let told = "device, pipe or socket";
    for (kind, odd) in [("zero", Path::new("/dev/zero")), ("pipe", &pipe)] {
        let data = folder.path().join(format!("data_{kind}"));
        write_keyframes(&data);
        for file in ["cam_K.txt", "init_keyframes.yml", "depth_filtered/0_0001.png"] {
            let path = data.join(file);
            let content = std::fs::read(&path).unwrap();
            std::fs::remove_file(&path).unwrap();
            symlink(odd, &path).unwrap();
            ends(1, &["inspect", text(&data)], &[told, file]);
            std::fs::remove_file(&path).unwrap();
            std::fs::write(&path, content).unwrap();
        }
        ends(2, &["config", "show", "--config", text(odd)], &["cannot read", told]);
        ends(
            1,
            &[
                "diagnose",
                text(odd),
                text(&shipped("drawer/state0")),
                "--out",
                text(&folder.path().join("out")),
            ],
            &[told],
        );
        ends(1, &["inspect", text(odd)], &["is not a recording"]);
        let mesh = "<visual name='v'><geometry><mesh filename='m.obj'/></geometry></visual>";
        let twin = model(
            &folder,
            &format!("twin_{kind}"),
            &format!("<robot name='r'><link name='a'>{INERTIAL}{mesh}</link></robot>"),
        );
        symlink(odd, twin.join("m.obj")).unwrap();
        ends(0, &["check", text(&twin)], &["the file is missing"]);
        seen(&folder, &twin, &[told, "m.obj"]);
        let bag = state(&folder, &format!("bag_{kind}"), |_| true);
        std::fs::remove_file(bag.join("metadata.yaml")).unwrap();
        symlink(odd, bag.join("metadata.yaml")).unwrap();
        symlink(odd, bag.join("other.mcap")).unwrap();
        ends(1, &["inspect", text(&bag)], &["posed RGB-D views: 16"]);
        #[cfg(feature = "onnx")]
        ends(
            1,
            &[
                "reconstruct",
                text(&shipped("drawer")),
                "--out",
                text(&folder.path().join("runs")),
                "--matcher",
                text(odd),
            ],
            &[told],
        );
    }
}

#[test]
fn meshes_that_claim_much() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = "<visual name='v'><geometry><mesh filename='m.ply'/></geometry></visual>";
    let twin =
        model(&folder, "twin", &format!("<robot name='r'><link name='a'>{INERTIAL}{mesh}</link></robot>"));
    let axes = "property float x\nproperty float y\nproperty float z\n";
    let nothing: String = (0..20_000).map(|i| format!("element q{i} 20000000\n")).collect();
    for (elements, words) in [
        (
            format!("{nothing}element vertex 20000000\n{axes}"),
            "20000000 elements vertex: the file ends early",
        ),
        ("element vertex 20000000\n".to_owned(), "no vertices with x, y and z"),
        ("element vertex 20000000\n".repeat(50), "names its vertices twice"),
        (
            format!(
                "element vertex 0\n{axes}element face 20000000\nproperty list uchar int vertex_indices\n"
            ),
            "20000000 elements face",
        ),
    ] {
        for format in ["ascii", "binary_little_endian"] {
            std::fs::write(twin.join("m.ply"), format!("ply\nformat {format} 1.0\n{elements}end_header\n"))
                .unwrap();
            seen(&folder, &twin, &[words, "m.ply"]);
        }
    }
    // One mesh of 200 MB, named often, is not read often.
    let shapes = "<visual name='v'><geometry><mesh filename='m.obj'/></geometry></visual>".repeat(1000);
    let twin =
        model(&folder, "often", &format!("<robot name='r'><link name='a'>{INERTIAL}{shapes}</link></robot>"));
    std::fs::write(twin.join("m.obj"), "# nothing\n".repeat(1 << 20)).unwrap();
    ends(1, &["check", text(&twin)], &["names meshes of 10485760000 bytes"]);
}
