//! What an input costs in memory: a global allocator that counts by thread. What C libraries allocate (zstd,
//! lz4) passes it by.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    cell::Cell,
};

/// The system's allocator, counted.
pub struct Counting;

/// What a thread has allocated since [`measure`] began.
#[derive(Clone, Copy, Debug, Default)]
pub struct Usage {
    live: isize,
    /// Most bytes that were live at once.
    pub peak: usize,
    /// Largest single allocation, bytes.
    pub largest: usize,
}

thread_local! {
    static USAGE: Cell<Usage> = const { Cell::new(Usage { live: 0, peak: 0, largest: 0 }) };
}

/// Runs something and tells what this thread allocated meanwhile.
pub fn measure<T>(work: impl FnOnce() -> T) -> (T, Usage) {
    USAGE.set(Usage::default());
    let result = work();
    (result, USAGE.get())
}

fn count(taken: usize, given_back: usize) {
    // A thread that ends has nothing left to count with.
    let _ = USAGE.try_with(|usage| {
        let mut now = usage.get();
        now.live += taken as isize - given_back as isize;
        now.peak = now.peak.max(now.live.max(0) as usize);
        now.largest = now.largest.max(taken);
        usage.set(now);
    });
}

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: as asked of the caller.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size(), 0);
        // SAFETY: as asked of the caller.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(0, layout.size());
        // SAFETY: as asked of the caller.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size, layout.size());
        // SAFETY: as asked of the caller.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[test]
fn what_is_live_at_once_is_counted() {
    let ((), usage) = measure(|| {
        for _ in 0..3 {
            drop(std::hint::black_box(vec![1u8; 1000]));
        }
        let mut grown = std::hint::black_box(Vec::<u8>::with_capacity(100));
        grown.reserve_exact(2000);
    });
    assert!((2000..3000).contains(&usage.peak), "{usage:?}");
    assert_eq!(usage.largest, 2000);
}
