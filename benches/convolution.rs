//! Speed of the network's convolutions at 1080p, for each instruction set and number of threads.
//!
//! `cargo bench --bench convolution [-- FILTER]`; FILTER picks layers by name. What was predicted and measured: NOTES.md.

use std::time::{Duration, Instant};

use hush::simd::{Activation, Conv, Epilogue, Isa};
use ndarray::{Array1, Array4};

/// Channels in and out, kernel size, stride, and the input's rows and columns.
const LAYERS: [(usize, usize, usize, usize, usize, usize); 8] = [
    (40, 32, 3, 1, 540, 960),
    (32, 32, 3, 1, 540, 960),
    (48, 48, 3, 1, 540, 960),
    (48, 80, 3, 2, 540, 960),
    (80, 80, 3, 1, 270, 480),
    (96, 96, 3, 1, 135, 240),
    (80, 48, 1, 1, 540, 960),
    (128, 48, 1, 1, 540, 960),
];

/// The fastest of the runs that fit into this time: the machine may be shared.
const BUDGET: Duration = Duration::from_millis(600);

fn main() {
    let filter = std::env::args().skip(1).find(|word| !word.starts_with('-')).unwrap_or_default();
    println!("{:<22} {:>8} {:>8} {:>9} {:>9} {:>7}", "layer", "isa", "threads", "ms", "GFLOPS", "GB/s");
    for (inputs, outputs, kernel, stride, rows, columns) in LAYERS {
        let name = format!("{kernel}x{kernel}/{stride} {inputs}-{outputs} {rows}x{columns}");
        if !name.contains(&filter) {
            continue;
        }
        let weight = Array4::from_shape_fn((outputs, inputs, kernel, kernel), |(a, b, c, d)| {
            ((a * 7 + b * 5 + c * 3 + d) % 11) as f32 * 0.01 - 0.05
        });
        let conv = Conv::new(weight.view(), Some(Array1::from_elem(outputs, 0.1).view()), stride);
        let mut input = Activation::new(rows, columns, inputs);
        input.as_mut_slice().iter_mut().enumerate().for_each(|(i, v)| *v = (i % 13) as f32 * 0.1 - 0.6);
        let mut output = Activation::empty();
        let (out_rows, out_columns) = conv.output_size(rows, columns);
        let flops = 2.0 * (out_rows * out_columns * outputs * inputs * kernel * kernel) as f64;
        let bytes = 4.0 * (rows * columns * inputs + out_rows * out_columns * outputs) as f64;
        for isa in Isa::available().into_iter().rev() {
            for threads in 1..=std::thread::available_parallelism().map_or(1, usize::from).min(2) {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
                let epilogue = Epilogue { relu_input: kernel == 3, ..Epilogue::default() };
                let seconds = pool.install(|| fastest(|| conv.run(isa, &input, &mut output, epilogue)));
                let (giga, bandwidth) = (flops / seconds / 1e9, bytes / seconds / 1e9);
                println!("{name:<22} {:>8} {threads:>8} {:>9.2} {giga:>9.1} {bandwidth:>7.1}", isa.name(), seconds * 1e3);
            }
        }
    }
}

fn fastest(mut run: impl FnMut()) -> f64 {
    run();
    let start = Instant::now();
    let mut best = f64::INFINITY;
    while start.elapsed() < BUDGET {
        let one = Instant::now();
        run();
        best = best.min(one.elapsed().as_secs_f64());
    }
    best
}
