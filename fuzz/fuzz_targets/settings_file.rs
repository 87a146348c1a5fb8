#![no_main]

mod support;

libfuzzer_sys::fuzz_target!(init: support::start(), |bytes: &[u8]| support::run(hush_fuzz::settings::check_file, bytes));
