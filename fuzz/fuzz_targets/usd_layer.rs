#![no_main]
#![feature(alloc_error_hook)]

mod support;

fn start() {
    support::start();
    // Memory that is not there ends the process that reads stages, which is an error of the run; here it is a panic.
    std::alloc::set_alloc_error_hook(|layout| panic!("no {} bytes", layout.size()));
}

libfuzzer_sys::fuzz_target!(init: start(), |bytes: &[u8]| support::run(hush_fuzz::settings::check_stage, bytes));
