//! Any bytes as what a request carries that the server reads itself: the list of a batch, ranges, conditions, encodings, ids.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (u64, &[u8])| {
    let (length, bytes) = input;
    tileserver::fuzzing::request(length, bytes);
});
