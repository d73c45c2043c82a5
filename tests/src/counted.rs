//! An allocator that counts.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, counted; a program makes it its own by `#[global_allocator]`.
pub struct Counted {
    allocated: AtomicUsize,
    peak: AtomicUsize,
    limit: usize,
}

impl Counted {
    /// One that ends the process where more than `limit` bytes are allocated.
    pub const fn new(limit: usize) -> Self {
        Self { allocated: AtomicUsize::new(0), peak: AtomicUsize::new(0), limit }
    }

    /// Bytes that are allocated.
    pub fn allocated(&self) -> usize {
        self.allocated.load(Ordering::Relaxed)
    }

    /// The most that ever were, or were since [`Counted::forget_peak`].
    pub fn peak(&self) -> usize {
        self.peak.load(Ordering::Relaxed)
    }

    /// Counts the peak from now on.
    pub fn forget_peak(&self) {
        self.peak.store(self.allocated(), Ordering::Relaxed);
    }

    fn grow(&self, bytes: usize) {
        let now = self.allocated.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        if now > self.peak.fetch_max(now, Ordering::Relaxed) && now > self.limit {
            // Nothing may be allocated to say it: numbers are written without.
            use std::io::Write;
            let _ = writeln!(std::io::stderr(), "more than {} bytes allocated", self.limit);
            std::process::abort();
        }
    }
}

// SAFETY: every call is handed on to the system's allocator as it came; counting touches no memory of it.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        self.grow(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        self.grow(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        self.allocated.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        self.grow(size.saturating_sub(layout.size()));
        self.allocated.fetch_sub(layout.size().saturating_sub(size), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}
