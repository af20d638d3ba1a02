//! Recordings brought to this machine: of bags the chunks that are needed, everything else whole.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Write as _},
    ops::Range,
    path::{Path, PathBuf},
};

use super::{Bucket, Listing, ObjectFacts, StoreError};
use crate::{
    files,
    io::{
        Glimpse, Piece, Ranges, Remembered, Wanted, excerpts, free_bytes, glimpse, is_whole_mcap,
        stored_bytes,
    },
};

/// Bytes of one request: four at a time are in memory.
const REQUEST: u64 = 8 << 20;
/// Ranges that lie nearer than this come in one request: what a request costs in time at 100 MB/s and 3 ms.
const NEAR: u64 = 256 << 10;
/// A file up to this size is fetched whole: its summary alone would cost as many requests.
const SMALL: u64 = 1 << 20;
/// Largest object that is fetched.
const LARGEST: u64 = 1 << 40;

/// An object as something that ranges are read from.
struct Stored<'a> {
    bucket: &'a dyn Bucket,
    object: &'a ObjectFacts,
}

impl Ranges for Stored<'_> {
    fn size(&self) -> u64 {
        self.object.bytes
    }

    fn range(&self, start: u64, count: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut sink = |_: usize, piece: &[u8]| {
            bytes.extend_from_slice(piece);
            Ok(())
        };
        self.bucket
            .ranges(self.object, &requests(&(start..start + count)), &mut sink)
            .map_err(io::Error::other)?;
        Ok(bytes)
    }

    fn many(&self, ranges: &[Range<u64>]) -> io::Result<Vec<Vec<u8>>> {
        let mut all = Vec::new();
        let mut sink = |_: usize, piece: &[u8]| {
            all.push(piece.to_vec());
            Ok(())
        };
        self.bucket.ranges(self.object, ranges, &mut sink).map_err(io::Error::other)?;
        Ok(all)
    }
}

/// Fetches an input below a folder; where it lies then, and what was seen in its bags. A file that is there
/// already is whole, and is left.
///
/// # Errors
/// [`StoreError`].
pub fn fetch(
    bucket: &dyn Bucket,
    listing: &Listing,
    folder: &Path,
    wanted: Wanted,
) -> Result<(PathBuf, Vec<Glimpse>), StoreError> {
    let place =
        |path: &str| folder.join(super::Uri { path: path.to_owned(), ..listing.uri.clone() }.relative());
    let path = place(&listing.uri.path);
    let (bags, others) = listing.bags();
    for object in others {
        fetch_whole(bucket, object, &place(&object.path))?;
    }
    let mut seen = Vec::new();
    for bag in bags {
        seen.push(fetch_bag(bucket, &bag, &place, wanted)?);
    }
    for name in &listing.names {
        make(&place(name))?;
    }
    Ok((path, seen))
}

/// Looks at the bags of an input, each by itself; of what is no bag the bytes alone.
///
/// # Errors
/// [`StoreError`].
pub fn look(bucket: &dyn Bucket, listing: &Listing, wanted: Wanted) -> Result<Vec<Glimpse>, StoreError> {
    let (bags, others) = listing.bags();
    let bytes = others.iter().map(|o| o.bytes).sum();
    // Without bags it is a dataset, of whose frames nothing is known.
    let frames = (!bags.is_empty()).then_some(0);
    let mut found = vec![Glimpse { bytes, needed_bytes: bytes, frames, ..Glimpse::default() }];
    for bag in bags {
        let sources: Vec<Stored> = bag.iter().map(|object| Stored { bucket, object }).collect();
        let files: Vec<Remembered> = sources.iter().map(|s| Remembered::of(s)).collect();
        found.push(seen(&bag, &files, wanted)?);
    }
    Ok(found)
}

/// Whether a bag is fetched whole without a look at what it holds.
fn is_small(bag: &[&ObjectFacts]) -> bool {
    bag.iter().all(|o| o.bytes <= SMALL)
}

/// Looks at a bag, and remembers what that took.
fn seen(bag: &[&ObjectFacts], files: &[Remembered], wanted: Wanted) -> Result<Glimpse, StoreError> {
    let look = || {
        if is_small(bag) {
            // All of it in one request: every look at it is served by that.
            files.iter().filter(|f| f.size() > 0).try_for_each(|f| f.range(0, f.size()).map(drop))?;
        }
        glimpse(files, wanted)
    };
    let found = look().map_err(|e| reading(e, bag))?;
    Ok(if is_small(bag) { Glimpse { needed_bytes: found.bytes, ..found } } else { found })
}

fn reading(error: io::Error, bag: &[&ObjectFacts]) -> StoreError {
    // The store's own error comes back out of the reader that it went through.
    match error.downcast::<StoreError>() {
        Ok(own) => own,
        Err(error) => {
            let uri = bag.first().map_or_else(String::new, |o| o.path.clone());
            StoreError::Access { uri, source: error.into() }
        }
    }
}

fn fetch_bag(
    bucket: &dyn Bucket,
    bag: &[&ObjectFacts],
    place: &dyn Fn(&str) -> PathBuf,
    wanted: Wanted,
) -> Result<Glimpse, StoreError> {
    let sources: Vec<Stored> = bag.iter().map(|object| Stored { bucket, object }).collect();
    let files: Vec<Remembered> = sources.iter().map(|s| Remembered::of(s)).collect();
    let seen = seen(bag, &files, wanted)?;
    if bag.iter().all(|o| place(&o.path).is_file()) {
        return Ok(seen);
    }
    let wanted = if is_small(bag) { Wanted::All } else { wanted };
    let plans = excerpts(&files, wanted).map_err(|e| reading(e, bag))?;
    for ((object, file), plan) in bag.iter().zip(&files).zip(&plans) {
        let to = place(&object.path);
        write(bucket, object, plan, &|range| file.parts(range, NEAR), &to)?;
        // An index that leads elsewhere than to its chunks: the file is read as it lies.
        let is_excerpt = !matches!(plan[..], [Piece::Stored(_)]);
        let walk = || files::open(&to).and_then(is_whole_mcap);
        if is_excerpt && !walk().map_err(scratch(&to))? {
            fs::remove_file(&to).map_err(scratch(&to))?;
            fetch_whole(bucket, object, &to)?;
        }
    }
    Ok(seen)
}

fn fetch_whole(bucket: &dyn Bucket, object: &ObjectFacts, to: &Path) -> Result<(), StoreError> {
    if to.is_file() {
        return Ok(());
    }
    write(bucket, object, &[Piece::Stored(0..object.bytes)], &|range| vec![(range.clone(), None)], to)
}

/// Ranges of one request each.
fn requests(range: &Range<u64>) -> Vec<Range<u64>> {
    let starts = (range.start..range.end).step_by(REQUEST as usize);
    starts.map(|start| start..range.end.min(start + REQUEST)).collect()
}

/// A range in parts, with the bytes that are at hand.
type Parts<'a> = &'a dyn Fn(&Range<u64>) -> Vec<(Range<u64>, Option<Vec<u8>>)>;

/// What is done to write a file.
enum Step {
    /// Bytes that are at hand.
    Known(Vec<u8>),
    /// A request, and which parts of what comes are kept.
    Request(Range<u64>, Vec<Range<u64>>),
}

fn steps(plan: &[Piece], parts: Parts) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    for piece in plan {
        let range = match piece {
            Piece::Made(bytes) => {
                steps.push(Step::Known(bytes.clone()));
                continue;
            }
            Piece::Stored(range) => range,
        };
        for (part, known) in parts(range) {
            match known {
                Some(bytes) => steps.push(Step::Known(bytes)),
                None => requests(&part).into_iter().for_each(|part| request(&mut steps, part)),
            }
        }
    }
    steps
}

/// Adds a request, to the one before where that is near.
fn request(steps: &mut Vec<Step>, part: Range<u64>) {
    match steps.last_mut() {
        Some(Step::Request(open, kept))
            if part.start.saturating_sub(open.end) <= NEAR && part.end - open.start <= REQUEST =>
        {
            open.end = part.end;
            kept.push(part);
        }
        _ => steps.push(Step::Request(part.clone(), vec![part])),
    }
}

/// Writes a file under another name, then gives it its own.
fn write(
    bucket: &dyn Bucket,
    object: &ObjectFacts,
    plan: &[Piece],
    parts: Parts,
    to: &Path,
) -> Result<(), StoreError> {
    if object.bytes > LARGEST {
        return Err(StoreError::TooLarge { uri: object.path.clone(), bytes: object.bytes, limit: LARGEST });
    }
    let above = to.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(above).map_err(scratch(above))?;
    let needed = stored_bytes(plan);
    if let Some(free) = free_bytes(above).filter(|free| *free < needed) {
        return Err(StoreError::Full { path: above.to_owned(), free, needed });
    }
    let part = above.join(format!("{}.part", to.file_name().unwrap_or_default().to_string_lossy()));
    let steps = steps(plan, parts);
    let ranges: Vec<Range<u64>> = steps
        .iter()
        .filter_map(|s| if let Step::Request(range, _) = s { Some(range.clone()) } else { None })
        .collect();
    let mut file = BufWriter::new(File::create(&part).map_err(scratch(&part))?);
    let mut next = steps.iter();
    // What is at hand before the next request, then what is kept of its answer.
    let mut sink = |_: usize, bytes: &[u8]| {
        for step in next.by_ref() {
            match step {
                Step::Known(known) => file.write_all(known)?,
                Step::Request(range, kept) => {
                    return kept.iter().try_for_each(|k| {
                        file.write_all(
                            &bytes[(k.start - range.start) as usize..(k.end - range.start) as usize],
                        )
                    });
                }
            }
        }
        Ok(())
    };
    bucket.ranges(object, &ranges, &mut sink)?;
    for step in next {
        if let Step::Known(known) = step {
            file.write_all(known).map_err(scratch(&part))?;
        }
    }
    file.into_inner().map_err(|e| scratch(&part)(e.into_error()))?;
    fs::rename(&part, to).map_err(scratch(to))
}

/// An empty file that only has to be there.
fn make(path: &Path) -> Result<(), StoreError> {
    let above = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(above).map_err(scratch(above))?;
    File::create(path).map(drop).map_err(scratch(path))
}

fn scratch(path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    let path = path.to_owned();
    move |source| StoreError::Scratch { path, source }
}
