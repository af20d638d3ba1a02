//! Pixel matches of a dataset: `correspondence_loftr/no_filter/src_<id>_tgt_all_top30.npz`, each
//! a NumPy array of dictionaries `{source id: N x 2 pixels, target id: N x 2 pixels}` (u, v).

use std::{collections::BTreeMap, path::Path};

use super::{
    files::read,
    npz::{NpzError, members},
    pickle::{Node, Pickle, PickleError},
};
use crate::npy::{NpyFault, npy_parts};
use capture::{Capture, CaptureError, PixelMatch};
use common::note::{Note, NoteCode};
use common::stop::Stop;

/// Largest number of pixels read from matches.
const MAX_MATCHES: usize = 40_000_000;

/// Why the matches of a file are not used.
#[derive(Debug, thiserror::Error)]
enum MatchesError {
    /// The archive cannot be read.
    #[error(transparent)]
    Archive(#[from] NpzError),
    /// The array in it cannot be read.
    #[error(transparent)]
    Array(#[from] NpyFault),
    /// The pickle in it cannot be read.
    #[error(transparent)]
    Pickle(#[from] PickleError),
    /// The array has another type.
    #[error("an array of `{0}`, not of dictionaries")]
    Type(String),
    /// The array is not a list of dictionaries.
    #[error("no list of dictionaries")]
    NoList,
    /// An entry is not a dictionary.
    #[error("an entry that is no dictionary")]
    NoDictionary,
    /// A dictionary does not have two images.
    #[error("a dictionary with {0} entries, not 2")]
    Entries(usize),
    /// A frame id is not text.
    #[error("a frame id that is no text")]
    NoId,
    /// Pixels are not an N x 2 array.
    #[error("pixels that are no N x 2 array")]
    NoPixels,
    /// There are more pixels than the limit.
    #[error("more than {MAX_MATCHES} pixels")]
    Large,
    /// The two arrays have different lengths.
    #[error("{0} pixels match {1}")]
    Lengths(usize, usize),
}

/// Adds the matches between kept frames; a broken file gives a warning.
///
/// # Errors
/// [`CaptureError::Read`].
pub fn import_matches(folder: &Path, capture: &mut Capture, stop: &Stop) -> Result<(), CaptureError> {
    let folder = folder.join("correspondence_loftr").join("no_filter");
    if !folder.is_dir() {
        return Ok(());
    }
    let entries =
        std::fs::read_dir(&folder).map_err(|source| CaptureError::Read { path: folder.clone(), source })?;
    let mut files: Vec<_> =
        entries.flatten().map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "npz")).collect();
    // `read_dir` has no order, and results of a run depend on the order of matches.
    files.sort();
    let mut places = BTreeMap::new();
    for (state, frames) in capture.states.iter().enumerate() {
        places.extend(
            frames
                .iter()
                .enumerate()
                .map(|(i, f)| (f.id.clone(), (state, i, f.intrinsics.width, f.intrinsics.height))),
        );
    }
    let mut outside = 0;
    let mut left = MAX_MATCHES;
    for file in &files {
        stop.check()?;
        match read_matches(&read(file)?, &places, &mut capture.matches, &mut left) {
            Ok(lost) => outside += lost,
            Err(why) => capture.warnings.push(Note::new(
                NoteCode::MatchesUnreadable,
                format!("`{}`: matches not used: {why}", file.display()),
            )),
        }
    }
    if outside > 0 {
        capture.warnings.push(Note::new(
            NoteCode::MatchesOutside,
            format!("{outside} matches lie outside their images and are not used"),
        ));
    }
    capture.notes.push(Note::new(
        NoteCode::MatchesRead,
        format!(
            "{} pixel matches between kept frames of the two states, from {} files",
            capture.matches.len(),
            files.len()
        ),
    ));
    Ok(())
}

/// For each frame id: state, index, width, height.
type Places = BTreeMap<String, (usize, usize, usize, usize)>;

/// Adds the matches of one file; returns the number of those outside their images. `left` is the number of
/// matches that may still be read.
fn read_matches(
    archive: &[u8],
    places: &Places,
    matches: &mut Vec<PixelMatch>,
    left: &mut usize,
) -> Result<usize, MatchesError> {
    let mut outside = 0;
    for member in members(archive)? {
        let file = member.unpack()?;
        let (descr, _, payload) = npy_parts(&file)?;
        // An array of objects: its payload is a pickle.
        if !descr.ends_with('O') {
            return Err(MatchesError::Type(descr.escape_debug().to_string()));
        }
        let pickle = Pickle::read(payload)?;
        for entry in pickle.items(pickle.root).ok_or(MatchesError::NoList)? {
            outside += add_pair(&pickle, *entry, places, matches, left)?;
        }
    }
    Ok(outside)
}

fn add_pair(
    pickle: &Pickle,
    entry: usize,
    places: &Places,
    matches: &mut Vec<PixelMatch>,
    left: &mut usize,
) -> Result<usize, MatchesError> {
    let Node::Dict(items) = &pickle.nodes[entry] else { return Err(MatchesError::NoDictionary) };
    let [a, b] = items[..] else { return Err(MatchesError::Entries(items.len())) };
    let (id_a, pixels_a) = frame_pixels(pickle, a.0, a.1, left)?;
    let (id_b, pixels_b) = frame_pixels(pickle, b.0, b.1, left)?;
    let [place_a, place_b] = [id_a, id_b].map(|id| places.get(id).copied());
    if pixels_a.len() != pixels_b.len() {
        return Err(MatchesError::Lengths(pixels_a.len(), pixels_b.len()));
    }
    let (Some(place_a), Some(place_b)) = (place_a, place_b) else { return Ok(0) };
    let (zero, one, pixels_0, pixels_1) = match (place_a.0, place_b.0) {
        (0, 1) => (place_a, place_b, pixels_a, pixels_b),
        (1, 0) => (place_b, place_a, pixels_b, pixels_a),
        // Matches within a state show no motion.
        _ => return Ok(0),
    };
    let mut outside = 0;
    for (p, q) in pixels_0.iter().zip(&pixels_1) {
        if !is_inside(p, zero.2, zero.3) || !is_inside(q, one.2, one.3) {
            outside += 1;
            continue;
        }
        let pixel = |p: &[f64; 2]| p.map(|v| v as f32);
        matches.push(PixelMatch { frame0: zero.1, pixel0: pixel(p), frame1: one.1, pixel1: pixel(q) });
    }
    Ok(outside)
}

/// Frame id and matched pixels of one side of a pair.
fn frame_pixels<'a>(
    pickle: &'a Pickle,
    key: usize,
    value: usize,
    left: &mut usize,
) -> Result<(&'a str, Vec<[f64; 2]>), MatchesError> {
    let Node::Str(id) = &pickle.nodes[key] else { return Err(MatchesError::NoId) };
    let pixels = pickle.pairs(value).ok_or(MatchesError::NoPixels)?;
    // Counted at every mention, as one array may be mentioned often.
    *left = left.checked_sub(pixels.len()).ok_or(MatchesError::Large)?;
    // Keys come with and without the prefix, as those of the keyframes.
    Ok((id.strip_prefix("frame_").unwrap_or(id), pixels))
}

fn is_inside(p: &[f64; 2], width: usize, height: usize) -> bool {
    p[0] >= 0.0 && p[1] >= 0.0 && p[0] <= (width - 1) as f64 && p[1] <= (height - 1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Written by NumPy: `np.savez[_compressed](f, data=np.array([{...}, {...}, {...}], dtype=object))` with
    /// pairs 0_0001 -> 1_0002 (int64, 3 matches, one outside), 1_0002 -> 0_0001 (float32, 1), 0_0001 ->
    /// 1_0009 (unknown).
    const STORED: &[u8] = include_bytes!("../../../tests/golden/matches.npz");
    const DEFLATED: &[u8] = include_bytes!("../../../tests/golden/matches_deflated.npz");

    fn places() -> Places {
        BTreeMap::from([("0_0001".to_owned(), (0, 4, 640, 480)), ("1_0002".to_owned(), (1, 7, 640, 480))])
    }

    #[test]
    fn numpy_files_are_read() {
        for archive in [STORED, DEFLATED] {
            let mut matches = Vec::new();
            assert_eq!(read_matches(archive, &places(), &mut matches, &mut MAX_MATCHES.clone()).unwrap(), 1);
            let of = |p0, p1| PixelMatch { frame0: 4, pixel0: p0, frame1: 7, pixel1: p1 };
            assert_eq!(
                matches,
                [of([10.0, 20.0], [11.0, 21.0]), of([639.0, 479.0], [0.0, 0.0]), of([7.5, 8.25], [5.0, 6.0])]
            );
        }
    }

    #[test]
    fn broken_files_are_errors() {
        // The last two bytes only give the length of a comment.
        for cut in 0..STORED.len() - 2 {
            assert!(
                read_matches(&STORED[..cut], &places(), &mut Vec::new(), &mut MAX_MATCHES.clone()).is_err(),
                "{cut}"
            );
        }
        for i in 0..STORED.len() {
            let mut bytes = STORED.to_vec();
            bytes[i] ^= 0xff;
            read_matches(&bytes, &places(), &mut Vec::new(), &mut MAX_MATCHES.clone()).ok();
        }
    }

    #[test]
    fn a_pickle_that_calls_something_is_refused() {
        let evil = b"\x80\x03cos\nsystem\nX\x04\x00\x00\x00echo\x85R.";
        assert_eq!(Pickle::read(evil).unwrap_err(), PickleError::Call("os.system".to_owned()));
    }
}
