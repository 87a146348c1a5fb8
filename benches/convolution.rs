//! Speed of the network's convolutions at 1080p, for each instruction set and number of threads.
//!
//! `cargo bench --bench convolution [-- FILTER]`; FILTER picks layers by name. The last column divides by the CPU time of all
//! threads (Linux), which holds on a shared machine where wall time does not.
//!
//! Predicted: a 3×3 layer does 9·co/4 FLOPs a byte of input and output (co = ci), 72 at 32 channels; a 1×1 layer 80→48 does
//! 15. One core at 230 GFLOPS and 15 GB/s turns over at 15 FLOPs a byte, so every 3×3 layer is bound by the FMA units and
//! the 1×1 layers stand on the edge. AVX-512 does 64 FLOPs a cycle (Zen 5), AVX2 half, SSE2 without FMA a quarter at most.
//! What was measured: NOTES.md.

use std::time::{Duration, Instant};

use hush::layers::{Activation, Conv, Epilogue, Winograd};
use hush::simd::Isa;
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
const BUDGET: Duration = Duration::from_millis(1000);
const BATCH: Duration = Duration::from_millis(200);

fn main() {
    let filter = std::env::args().skip(1).find(|word| !word.starts_with('-')).unwrap_or_default();
    println!("{:<22} {:>8} {:>8} {:>9} {:>9} {:>9}", "layer", "isa", "threads", "ms", "GFLOPS", "a core");
    for (inputs, outputs, kernel, stride, rows, columns) in LAYERS {
        let name = format!("{kernel}x{kernel}/{stride} {inputs}-{outputs} {rows}x{columns}");
        if !name.contains(&filter) {
            continue;
        }
        let weight = Array4::from_shape_fn((outputs, inputs, kernel, kernel), |(a, b, c, d)| {
            ((a * 7 + b * 5 + c * 3 + d) % 11) as f32 * 0.01 - 0.05
        });
        let bias = Array1::from_elem(outputs, 0.1);
        let conv = Conv::new(weight.view(), Some(bias.view()), stride);
        let mut input = Activation::new(rows, columns, inputs);
        input.as_mut_slice().iter_mut().enumerate().for_each(|(i, v)| *v = (i % 13) as f32 * 0.1 - 0.6);
        let (out_rows, out_columns) = conv.output_size(rows, columns);
        let flops = 2.0 * (out_rows * out_columns * outputs * inputs * kernel * kernel) as f64;
        let epilogue = Epilogue { relu_input: kernel == 3, ..Epilogue::default() };
        measure(&name, flops, |isa, output| conv.run(isa, &input, output, epilogue));
        if kernel == 3 && stride == 1 && inputs == outputs {
            let winograd = Winograd::new(weight.view(), bias.view());
            measure(&format!("winograd {inputs} {rows}x{columns}"), flops, |isa, output| {
                winograd.run(isa, &input, output, epilogue)
            });
        }
    }
}

/// Prints a line for each instruction set and number of threads; GFLOPS count the products of the plain sum.
fn measure(name: &str, flops: f64, run: impl Fn(Isa, &mut Activation) + Sync) {
    let mut output = Activation::empty();
    for isa in Isa::available().into_iter().rev() {
        for threads in 1..=std::thread::available_parallelism().map_or(1, usize::from).min(2) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
            let best = fastest(&pool, || run(isa, &mut output));
            let core = best.cpu.map_or("-".into(), |cpu| format!("{:.1}", flops / cpu / 1e9));
            let (ms, giga) = (best.wall * 1e3, flops / best.wall / 1e9);
            println!("{name:<22} {:>8} {threads:>8} {ms:>9.2} {giga:>9.1} {core:>9}", isa.name());
        }
    }
}

/// Seconds of one run at best.
struct Best {
    wall: f64,
    cpu: Option<f64>,
}

fn fastest(pool: &rayon::ThreadPool, mut run: impl FnMut() + Send) -> Best {
    pool.install(&mut run);
    let start = Instant::now();
    let mut best = Best { wall: f64::INFINITY, cpu: cpu_seconds(pool).map(|_| f64::INFINITY) };
    while start.elapsed() < BUDGET {
        // Enough runs that the clock of CPU time, which ticks in milliseconds, is good to some percent.
        let (batch, before, mut runs) = (Instant::now(), cpu_seconds(pool), 0);
        while runs == 0 || batch.elapsed() < BATCH {
            let one = Instant::now();
            pool.install(&mut run);
            best.wall = best.wall.min(one.elapsed().as_secs_f64());
            runs += 1;
        }
        let used = cpu_seconds(pool).zip(before).map(|(after, before)| (after - before) / f64::from(runs));
        best.cpu = best.cpu.zip(used).map(|(best, used)| best.min(used));
    }
    best
}

/// CPU time that the pool's threads have used so far; None where the system does not tell.
fn cpu_seconds(pool: &rayon::ThreadPool) -> Option<f64> {
    let times = pool.broadcast(|_| {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    });
    times.into_iter().sum::<Option<f64>>().map(|ns| ns * 1e-9)
}
