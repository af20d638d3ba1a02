//! Runs a target on its seeds and on mutated inputs, judges every input, and keeps what failed.

use std::{
    cell::{Cell, RefCell},
    collections::BTreeMap,
    fs::{self, File},
    io::Write as _,
    os::unix::fs::FileExt as _,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::{
        Arc, LazyLock, Once,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use mutatis::Session;

use super::{
    memory::{Usage, measure},
    mutate::{Mutator, Parts},
};

/// Inputs of a target where `ARTITWIN_FUZZ` does not say.
const INPUTS: u64 = 100_000;
/// Processor seconds that one input may take.
const SECONDS: f64 = 1.0;
/// Bytes that may be live at once, beside [`PER_BYTE`] for each byte of the input.
pub const BYTES: usize = 64 << 20;
const PER_BYTE: usize = 64;
/// A target that stays at one input for so long is given up, seconds.
const HANGS: u64 = 60;
/// Tries to make a failing input smaller.
const SHRINKS: usize = 3000;

/// A reader under test.
pub struct Target<'a> {
    /// Path of its test, e.g. `images::png`.
    pub name: &'a str,
    /// Inputs that are accepted; all others are made of these.
    pub seeds: Vec<Parts>,
    /// Words of the format.
    pub words: &'a [&'a str],
    /// The input's bytes from its pieces, e.g. with the right checksums.
    pub assemble: fn(&[Vec<u8>]) -> Vec<u8>,
    /// Bytes that may be live at once beside those for each byte of the input.
    pub bytes: usize,
}

/// What all inputs of a target came to.
#[derive(Default)]
struct Tally {
    inputs: u64,
    accepted: u64,
    slowest: (f64, u64),
    most: (usize, u64),
    largest: usize,
    /// The first of each kind.
    failures: BTreeMap<String, String>,
}

impl Target<'_> {
    /// Runs the target: `read` gives the input to the reader, asserts what must hold, and tells whether it
    /// was accepted.
    ///
    /// # Panics
    /// If an input fails; tells where it lies and the command that runs it again.
    pub fn run(&self, mut read: impl FnMut(&[u8]) -> bool) {
        quiet_panics();
        let _one_thread =
            rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().unwrap();
        if let Some(path) = std::env::var_os("ARTITWIN_FUZZ_INPUT") {
            let bytes = fs::read(&path).unwrap();
            let (outcome, seconds, usage) = self.judge(&bytes, &mut read);
            println!("{}: {outcome:?}, {:.1} ms, {}", self.name, 1e3 * seconds, told(usage.peak));
            assert!(outcome.is_ok(), "{}", outcome.unwrap_err());
            return;
        }
        let (from, count) =
            (number("ARTITWIN_FUZZ_FROM").unwrap_or(0), number("ARTITWIN_FUZZ").unwrap_or(INPUTS));
        let start = processor_seconds();
        let watch = Watch::start(self.name);
        let mut tally = Tally::default();
        for index in from..from + count {
            watch.at(index);
            self.one(index, &mut tally, &mut read);
        }
        watch.end();
        self.tell(&tally, processor_seconds() - start);
        let failures: Vec<String> = tally.failures.into_values().collect();
        assert!(failures.is_empty(), "{}", failures.join("\n"));
    }

    fn one(&self, index: u64, tally: &mut Tally, read: &mut dyn FnMut(&[u8]) -> bool) {
        let parts = self.input(index);
        let (outcome, seconds, usage) = self.judge(&(self.assemble)(&parts), read);
        tally.inputs += 1;
        tally.accepted += u64::from(outcome == Ok(true));
        if seconds > tally.slowest.0 {
            tally.slowest = (seconds, index);
        }
        tally.most = tally.most.max((usage.peak, index));
        tally.largest = tally.largest.max(usage.largest);
        let outcome = match outcome {
            Ok(false) if (index as usize) < self.seeds.len() => {
                Err("an unchanged seed is refused".to_owned())
            }
            other => other,
        };
        if let Err(why) = outcome
            && !tally.failures.contains_key(&kind(&why))
        {
            let sentence = self.keep(index, &why, parts, read);
            tally.failures.insert(kind(&why), sentence);
        }
    }

    /// The input of a number: the seeds, then mutated ones, each by itself.
    fn input(&self, index: u64) -> Parts {
        if let Some(seed) = self.seeds.get(index as usize) {
            return seed.clone();
        }
        let named = self
            .name
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325, |sum: u64, b| (sum ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
        let random = mixed(named ^ mixed(index));
        let mut parts = self.seeds[(random >> 32) as usize % self.seeds.len()].clone();
        let mut session = Session::new().seed(random);
        let mut mutator = Mutator { seeds: &self.seeds, words: self.words };
        // One change half of the time, two a quarter, and so on.
        for _ in 0..=(random | 1 << 12).trailing_zeros() {
            session.mutate_with(&mut mutator, &mut parts).unwrap();
        }
        parts
    }

    /// Gives an input to the reader. The error is what is wrong with it.
    fn judge(&self, bytes: &[u8], read: &mut dyn FnMut(&[u8]) -> bool) -> (Result<bool, String>, f64, Usage) {
        let mut once = || {
            LISTENS.set(true);
            let outcome = measure(|| catch_unwind(AssertUnwindSafe(|| read(bytes))));
            LISTENS.set(false);
            outcome
        };
        let start = Instant::now();
        let (result, usage) = once();
        let mut seconds = start.elapsed().as_secs_f64();
        if seconds > SECONDS {
            // The machine may have been busy elsewhere.
            let start = processor_seconds();
            _ = once();
            seconds = processor_seconds() - start;
        }
        let most = self.bytes + PER_BYTE * bytes.len();
        let outcome = match result {
            Err(_) => Err(format!("panic: {}", PANIC.take())),
            Ok(_) if usage.peak > most => {
                Err(format!("memory: {} for {} bytes, {} at most", told(usage.peak), bytes.len(), told(most)))
            }
            Ok(_) if seconds > SECONDS => Err(format!("time: {seconds:.1} s, {SECONDS} at most")),
            Ok(accepted) => Ok(accepted),
        };
        (outcome, seconds, usage)
    }

    /// Makes a failing input smaller and writes it; the sentence tells of it.
    fn keep(&self, index: u64, why: &str, parts: Parts, read: &mut dyn FnMut(&[u8]) -> bool) -> String {
        let smallest = if why.starts_with("an unchanged") { parts } else { self.shrunk(why, parts, read) };
        let bytes = (self.assemble)(&smallest);
        let file = folder().join(format!("{}-{index}.bin", self.name.replace("::", "-")));
        fs::write(&file, &bytes).unwrap();
        let (file, name) = (file.display(), self.name);
        format!(
            "{name}, input {index}: {why}\n  {} bytes in {file}; again: \
             ARTITWIN_FUZZ_INPUT={file} cargo test --release --test fuzz -- --exact {name} --nocapture",
            bytes.len()
        )
    }

    fn shrunk(&self, why: &str, mut parts: Parts, read: &mut dyn FnMut(&[u8]) -> bool) -> Parts {
        let (mut session, start) = (Session::new().seed(1).shrink(true), Instant::now());
        let mut mutator = Mutator { seeds: &self.seeds, words: self.words };
        for _ in 0..SHRINKS {
            let mut smaller = parts.clone();
            session.mutate_with(&mut mutator, &mut smaller).unwrap();
            let outcome = self.judge(&(self.assemble)(&smaller), read).0;
            if outcome.is_err_and(|other| kind(&other) == kind(why)) {
                parts = smaller;
            }
            if start.elapsed() > Duration::from_secs(10) {
                break;
            }
        }
        parts
    }

    fn tell(&self, tally: &Tally, seconds: f64) {
        println!(
            "{}: {} inputs in {seconds:.1} s of a core ({:.0}/s), {:.1} % accepted; slowest {:.1} ms (input \
             {}); most memory {} (input {}), largest allocation {}",
            self.name,
            tally.inputs,
            tally.inputs as f64 / seconds,
            1e2 * tally.accepted as f64 / tally.inputs.max(1) as f64,
            1e3 * tally.slowest.0,
            tally.slowest.1,
            told(tally.most.0),
            tally.most.1,
            told(tally.largest)
        );
    }
}

/// Input of one piece that is its bytes.
pub fn plain(parts: &[Vec<u8>]) -> Vec<u8> {
    parts.concat()
}

/// Seeds of one piece each.
pub fn whole<T: AsRef<[u8]>>(seeds: impl IntoIterator<Item = T>) -> Vec<Parts> {
    seeds.into_iter().map(|seed| vec![seed.as_ref().to_vec()]).collect()
}

/// What is the same about failures with one cause: all but the numbers.
fn kind(why: &str) -> String {
    let place = why.split_once(" at src").map_or(why, |(_, place)| place);
    match why.split_once(':') {
        Some(("panic", _)) => place.to_owned(),
        Some((kind, _)) => kind.to_owned(),
        None => why.to_owned(),
    }
}

/// SplitMix64.
fn mixed(mut x: u64) -> u64 {
    x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable)
        .ok()
        .map(|text| text.parse().unwrap_or_else(|_| panic!("{variable}={text} is no number")))
}

fn told(bytes: usize) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

/// Processor seconds of this thread, where the system tells (Linux); else those of the clock.
fn processor_seconds() -> f64 {
    static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
    let told = fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanos = told.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanos.map_or_else(|| BEGIN.elapsed().as_secs_f64(), |n| 1e-9 * n)
}

/// Where failing inputs lie.
fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
    fs::create_dir_all(&folder).unwrap();
    folder
}

thread_local! {
    static LISTENS: Cell<bool> = const { Cell::new(false) };
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Keeps the message of a panic in a reader in place of printing it.
fn quiet_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let told = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| match LISTENS.get() {
            true => {
                let place =
                    info.location().map_or_else(String::new, |l| format!(" at {}:{}", l.file(), l.line()));
                PANIC.set(format!("{}{place}", info.payload_as_str().unwrap_or_default()));
            }
            false => told(info),
        }));
    });
}

/// Tells which input ran when the process ended without a word, and ends one that hangs.
struct Watch {
    now: Arc<AtomicU64>,
    done: Arc<AtomicBool>,
    file: File,
    path: PathBuf,
    guard: thread::JoinHandle<()>,
}

impl Watch {
    fn start(name: &str) -> Self {
        let path = folder().join(format!("{}.at", name.replace("::", "-")));
        let (now, done) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
        let guard = {
            let (now, done, name) = (Arc::clone(&now), Arc::clone(&done), name.to_owned());
            thread::spawn(move || {
                let mut last = (u64::MAX, Instant::now());
                while !done.load(Ordering::Relaxed) {
                    thread::park_timeout(Duration::from_secs(1));
                    let index = now.load(Ordering::Relaxed);
                    if index != last.0 {
                        last = (index, Instant::now());
                    } else if last.1.elapsed() > Duration::from_secs(HANGS) {
                        writeln!(
                            std::io::stderr(),
                            "{name}: input {index} takes more than {HANGS} s; it hangs"
                        )
                        .ok();
                        std::process::abort();
                    }
                }
            })
        };
        Self { now, done, file: File::create(&path).unwrap(), path, guard }
    }

    fn at(&self, index: u64) {
        self.now.store(index, Ordering::Relaxed);
        self.file.write_all_at(format!("{index:<20}").as_bytes(), 0).unwrap();
    }

    fn end(self) {
        self.done.store(true, Ordering::Relaxed);
        self.guard.thread().unpark();
        self.guard.join().unwrap();
        fs::remove_file(self.path).ok();
    }
}

/// A folder in memory, where the system has one, that goes away with the value.
pub struct Scratch(pub PathBuf);

impl Scratch {
    /// An empty folder.
    pub fn new(name: &str) -> Self {
        let memory = Path::new("/dev/shm");
        let base = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let path = base.join(format!("artitwin-fuzz-{}-{}", name.replace("::", "-"), std::process::id()));
        fs::remove_dir_all(&path).ok();
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes a file of the folder.
    pub fn put(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}
