#![no_main]

libfuzzer_sys::fuzz_target!(init: dsfms_fuzz::prepare(), |bytes: &[u8]| dsfms_fuzz::run("landmarks", bytes));
