//! Changes of an input: what breaks readers, at random places.

use mutatis::{Candidates, Mutate, Rng};

/// An input before it is put together: its pieces, e.g. the records of a bag or the chunks of a PNG.
pub type Parts = Vec<Vec<u8>>;

/// Largest input, bytes: time goes into many small ones.
const MAX_BYTES: usize = 48 << 10;
/// Lengths and counts that readers get wrong.
const NUMBERS: [u64; 20] = [
    0,
    1,
    2,
    3,
    7,
    8,
    16,
    64,
    127,
    128,
    255,
    256,
    8192,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
];
/// Numbers that calculations get wrong.
const REALS: [f64; 14] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    5e-324,
    1e-200,
    1e30,
    3.4e38,
];
/// The same in text.
const WRITTEN: [&str; 18] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "255",
    "65536",
    "4294967296",
    "-9223372036854775808",
    "18446744073709551616",
    "1e308",
    "1e-320",
    "1e999",
    "NaN",
    ".nan",
    "inf",
    "-.inf",
    "0.1",
];

/// Changes inputs of one format.
pub struct Mutator<'a> {
    /// Where spans and pieces of others are taken from.
    pub seeds: &'a [Parts],
    /// Words of the format.
    pub words: &'a [&'a str],
}

type Change = fn(&Mutator<'_>, &mut Rng, &mut Parts);

/// What is likelier stands more than once.
const CHANGES: [Change; 25] = [
    flip_bit,
    flip_bit,
    set_byte,
    set_byte,
    number,
    number,
    number,
    number,
    real,
    nudge,
    delete_span,
    delete_span,
    double_span,
    copy_over,
    cut,
    insert_noise,
    word,
    word,
    foreign_span,
    written_number,
    written_number,
    repeat,
    drop_part,
    double_part,
    exchange_part,
];
const SHRINKING: [Change; 4] = [delete_span, delete_span, cut, drop_part];

impl Mutate<Parts> for Mutator<'_> {
    fn mutate(&mut self, candidates: &mut Candidates<'_>, parts: &mut Parts) -> mutatis::Result<()> {
        let changes: &[Change] = if candidates.shrink() { &SHRINKING } else { &CHANGES };
        candidates.mutation_group(changes.len() as u32, |context, which| {
            changes[which as usize](self, context.rng(), parts);
            Ok(())
        })
    }
}

/// Some part that holds something, and a place in it.
fn place<'a>(rng: &mut Rng, parts: &'a mut Parts) -> Option<(&'a mut Vec<u8>, usize)> {
    let part = rng.choose(parts.iter_mut())?;
    let at = rng.gen_index(part.len())?;
    Some((part, at))
}

/// A length up to `most`; short ones are likelier.
fn length(rng: &mut Rng, most: usize) -> usize {
    let most = if rng.gen_bool() { most.min(8) } else { most };
    rng.gen_index(most).map_or(0, |n| n + 1)
}

fn flip_bit(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let bit = rng.gen_u8() % 8;
    if let Some((part, at)) = place(rng, parts) {
        part[at] ^= 1 << bit;
    }
}

fn set_byte(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let byte = rng.gen_u8();
    if let Some((part, at)) = place(rng, parts) {
        part[at] = byte;
    }
}

/// Writes over what is there, mostly at a multiple of its width, as lengths stand in binary formats.
fn put(rng: &mut Rng, parts: &mut Parts, bytes: &[u8]) {
    let aligned = rng.gen_u8() % 4 > 0;
    let Some((part, mut at)) = place(rng, parts) else { return };
    if aligned {
        at -= at % bytes.len();
    }
    for (slot, byte) in part[at..].iter_mut().zip(bytes) {
        *slot = *byte;
    }
}

fn number(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let value = rng.choose(NUMBERS).unwrap_or_default();
    let width = rng.choose([2, 4, 4, 8]).unwrap_or(4);
    match rng.gen_u8() % 4 {
        0 => put(rng, parts, &value.to_be_bytes()[8 - width..]),
        _ => put(rng, parts, &value.to_le_bytes()[..width]),
    }
}

fn real(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let value = rng.choose(REALS).unwrap_or_default();
    match rng.gen_bool() {
        true => put(rng, parts, &value.to_le_bytes()),
        false => put(rng, parts, &(value as f32).to_le_bytes()),
    }
}

fn nudge(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let step = rng.gen_u8() % 16;
    if let Some((part, at)) = place(rng, parts) {
        part[at] = part[at].wrapping_add(step).wrapping_sub(8);
    }
}

fn delete_span(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let Some((part, at)) = place(rng, parts) else { return };
    let rest = part.len() - at;
    let end = at + length(rng, rest);
    part.drain(at..end);
}

fn span(rng: &mut Rng, parts: &mut Parts) -> Vec<u8> {
    let Some((part, at)) = place(rng, parts) else { return Vec::new() };
    let (part, rest) = (part.clone(), part.len() - at);
    part[at..at + length(rng, rest)].to_vec()
}

fn insert(rng: &mut Rng, parts: &mut Parts, bytes: &[u8]) {
    let size: usize = parts.iter().map(Vec::len).sum();
    if let Some((part, at)) = place(rng, parts).filter(|_| size + bytes.len() <= MAX_BYTES) {
        part.splice(at..at, bytes.iter().copied());
    }
}

fn double_span(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let span = span(rng, parts);
    insert(rng, parts, &span);
}

fn copy_over(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let span = span(rng, parts);
    let Some((part, at)) = place(rng, parts) else { return };
    for (slot, byte) in part[at..].iter_mut().zip(&span) {
        *slot = *byte;
    }
}

fn cut(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    if let Some((part, at)) = place(rng, parts) {
        part.truncate(at);
    }
}

fn insert_noise(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let mut noise = [0; 16];
    rng.gen_bytes(&mut noise);
    let count = length(rng, noise.len());
    insert(rng, parts, &noise[..count]);
}

fn word(own: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let Some(word) = rng.choose(own.words) else { return };
    match rng.gen_bool() {
        true => insert(rng, parts, word.as_bytes()),
        false => put(rng, parts, word.as_bytes()),
    }
}

fn foreign_span(own: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let Some(mut donor) = rng.choose(own.seeds).cloned() else { return };
    let span = span(rng, &mut donor);
    insert(rng, parts, &span);
}

/// Takes another number in place of one in text.
fn written_number(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let new = rng.choose(WRITTEN).unwrap_or_default();
    let Some((part, at)) = place(rng, parts) else { return };
    let Some(start) = part[at..].iter().position(u8::is_ascii_digit).map(|k| k + at) else { return };
    let numeric = |b: &u8| b.is_ascii_digit() || b".eE+-".contains(b);
    let end = part[start..].iter().position(|b| !numeric(b)).map_or(part.len(), |k| k + start);
    part.splice(start..end, new.bytes());
}

/// A short span many times over: deep nesting and long lists.
fn repeat(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let mut unit = span(rng, parts);
    unit.truncate(64);
    let most = if rng.gen_u8().is_multiple_of(16) { 20_000 } else { 40 };
    let count = length(rng, most).min(MAX_BYTES / 2 / unit.len().max(1));
    insert(rng, parts, &unit.repeat(count));
}

fn drop_part(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    if let Some(k) = rng.gen_index(parts.len()).filter(|_| parts.len() > 1) {
        parts.remove(k);
    }
}

fn double_part(_: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let size: usize = parts.iter().map(Vec::len).sum();
    let Some(part) = rng.choose(parts.iter()).filter(|p| size + p.len() <= MAX_BYTES).cloned() else {
        return;
    };
    let at = rng.gen_index(parts.len()).unwrap_or_default();
    parts.insert(at, part);
}

/// Puts two pieces in each other's place, or one of another input in place of one.
fn exchange_part(own: &Mutator<'_>, rng: &mut Rng, parts: &mut Parts) {
    let (Some(a), Some(b)) = (rng.gen_index(parts.len()), rng.gen_index(parts.len())) else { return };
    let foreign = rng.choose(own.seeds).and_then(|donor| rng.choose(donor.iter()));
    match foreign.filter(|_| rng.gen_bool()) {
        Some(foreign) => parts[a].clone_from(foreign),
        None => parts.swap(a, b),
    }
}
